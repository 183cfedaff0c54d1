#include "firmware/page/measured_files.h"

#include <doctest/doctest.h>

#include <fstream>
#include <iterator>
#include <map>

#include "tests/model/scratch_folder.h"

using namespace finsight;
using namespace finsight::page;

namespace {

std::string lens(double fx) {
  return "fx_fy_cx_cy = [" + std::to_string(fx) + ", 457, 319.5, 239.5]\nk1_k2_p1_p2_k3 = [0, 0, 0, 0, 0]\n";
}

FingerAtStart finger() {
  FingerAtStart finger;
  finger.width_px = 640;
  finger.height_px = 480;
  return finger;
}

std::string text_of(const std::filesystem::path& file) {
  std::ifstream in(file);
  return {std::istreambuf_iterator<char>(in), {}};
}

std::map<std::string, std::string> all_in(const test::ScratchFolder& folder) {
  std::map<std::string, std::string> files;
  for (const auto& entry : std::filesystem::directory_iterator(folder.path())) {
    files[entry.path().filename()] = text_of(entry.path());
  }
  return files;
}

std::optional<Refusal> restarted() { return std::nullopt; }
std::optional<Refusal> busy() { return Refusal{409, "busy"}; }

}  // namespace

TEST_CASE("measured files: all parts are stored, and what was there stays as the former") {
  const test::ScratchFolder folder;
  folder.write(kMeasuredLens, "old");
  folder.write("lens.toml.former", "older");
  REQUIRE_FALSE(store_parts(
      folder.path(), {{Part::kLens, "lens"}, {Part::kMount, "mount"}, {Part::kFit, "fit"}, {Part::kState, "state"}},
      restarted));
  CHECK(all_in(folder) == std::map<std::string, std::string>{{kMeasuredLens, "lens"},
                                                             {"lens.toml.former", "old"},
                                                             {kMeasuredMount, "mount"},
                                                             {kMeasuredFit, "fit"},
                                                             {kImportedState, "state"}});
}

TEST_CASE("measured files: what is stored a second time does not cost the former one") {
  const test::ScratchFolder folder;
  folder.write(kMeasuredLens, "old");
  for (int i = 0; i < 3; ++i) REQUIRE_FALSE(store_parts(folder.path(), {{Part::kLens, "new"}}, restarted));
  CHECK(all_in(folder) == std::map<std::string, std::string>{{kMeasuredLens, "new"}, {"lens.toml.former", "old"}});
}

TEST_CASE("measured files: nothing changes if the restart is refused or the disk fails") {
  const test::ScratchFolder folder;
  folder.write(kMeasuredLens, lens(450));
  folder.write("lens.toml.former", lens(440));
  const auto before = all_in(folder);
  const auto refused = store_parts(folder.path(), {{Part::kLens, "lens"}, {Part::kMount, "mount"}}, busy);
  REQUIRE(refused);
  CHECK(refused->reason == "busy");
  CHECK(all_in(folder) == before);
  CHECK(bring_back(folder.path(), Part::kLens, finger, busy)->reason == "busy");
  CHECK(all_in(folder) == before);
  folder.write("taken", "");
  CHECK(store_parts(folder / "taken", {{Part::kLens, "lens"}}, restarted)->status == 500);
}

TEST_CASE("measured files: the former one and the present one change places; without a former one there is none") {
  const test::ScratchFolder folder;
  CHECK(bring_back(folder.path(), Part::kLens, finger, restarted)->status == 409);
  folder.write(kMeasuredLens, lens(450));
  REQUIRE_FALSE(bring_back(folder.path(), Part::kLens, finger, restarted));
  CHECK(all_in(folder) == std::map<std::string, std::string>{{"lens.toml.former", lens(450)}});
  REQUIRE_FALSE(bring_back(folder.path(), Part::kLens, finger, restarted));
  CHECK(all_in(folder) == std::map<std::string, std::string>{{kMeasuredLens, lens(450)}});
}

TEST_CASE("measured files: a former one that finsightd would not start with is not brought back") {
  const test::ScratchFolder folder;
  folder.write(kMeasuredLens, lens(450));
  folder.write("lens.toml.former", lens(0.001));
  const auto before = all_in(folder);
  const auto refused = bring_back(folder.path(), Part::kLens, finger, restarted);
  REQUIRE(refused);
  CHECK(refused->status == 409);
  CHECK(refused->reason.find("fx") != std::string::npos);
  CHECK(all_in(folder) == before);
}
