#include "firmware/page/import.h"

#include <doctest/doctest.h>

#include <fstream>
#include <iterator>

#include "firmware/page/json_body.h"
#include "firmware/settings/measured_fit.h"
#include "firmware/settings/settings.h"
#include "tests/model/scratch_folder.h"
#include "tests/random.h"

using namespace finsight;
using namespace finsight::page;
using nlohmann::json;

namespace {

constexpr std::uint32_t kModel = 0x12345678;
const Identity kIdentity{"sha256:12345678", "srm", 640, 480};

MountModel mount() {
  MountModel model{};
  model.T_finger_camera = Eigen::Isometry3f::Identity();
  for (std::size_t p = 0; p < kPlates; ++p) {
    model.T_finger_marker[p] = Eigen::Isometry3f(Eigen::Translation3f(0, 30 * static_cast<float>(p), 20));
  }
  return model;
}

/// As a device exports it: with a lens, a mount half a millimetre off, and a zero.
json exported() {
  MeasuredMount measured = poses_of(mount());
  measured.T_finger_camera.translation().x() += 0.5;
  const json about = {{"mount", measured_mount_toml(measured)},
                      {"lens",
                       {{"width_px", 640},
                        {"height_px", 480},
                        {"fx", 457.25},
                        {"fy", 457},
                        {"cx", 319.5},
                        {"cy", 239.5},
                        {"k1", 0.01},
                        {"k2", 0},
                        {"p1", 0},
                        {"p2", 0},
                        {"k3", 0}}}};
  PublishedFrame frame;
  frame.has_zero = 1;
  frame.zero[kLowPlate] = {0.125F, 0, 0, 0, 0, 0.0625F};
  return export_file(kIdentity, {{"hold_time", 250}}, about, frame);
}

SettingsWords factory() {
  SettingsWords words;
  for (int i = 0; i < kSettingCount; ++i) {
    const RegisterRow& row = setting_row(i);
    const bool is_process = row.address >= kProcessAddress;
    (is_process ? words.process[static_cast<std::size_t>(row.address - kProcessAddress)]
                : words.control[static_cast<std::size_t>(row.address - kFirstSettingRegister)]) = row.factory;
  }
  return words;
}

std::string refusal(const json& file, Import* import = nullptr) {
  Import any;
  const auto refused = read_import(file, kIdentity, factory(), mount(), kModel, import ? *import : any);
  return refused ? refused->reason : "";
}

std::string text_of(const std::filesystem::path& file) {
  std::ifstream in(file);
  return {std::istreambuf_iterator<char>(in), {}};
}

std::optional<Refusal> restarted() { return std::nullopt; }

}  // namespace

TEST_CASE("import: what was exported comes back, as text of the files that finsightd reads") {
  Import import;
  REQUIRE(refusal(json_body(exported().dump()), &import) == "");
  CHECK(import.lens.find("457.25") != std::string::npos);
  CHECK(import.mount.find("[camera]\nposition_mm = [0.5000") != std::string::npos);
  CHECK(import.state.find("hold_time = 250\n") != std::string::npos);
  CHECK(import.state.find("low = [0.125, 0, 0, 0, 0, 0.0625]") != std::string::npos);
}

TEST_CASE("import: a fit comes along, and one of another pack is refused") {
  FitValues fit{};
  fit.model_checksum = kModel;
  fit.fitted_on = 9823;
  fit.force_scale = 1.125F;
  fit.force_sigma = 0.0625F;
  json file = exported();
  file["fit"] = measured_fit_toml(fit);
  Import import;
  REQUIRE(refusal(file, &import) == "");
  CHECK(import.fit.find("force_scale = 1.125 ") != std::string::npos);
  ++fit.model_checksum;
  file["fit"] = measured_fit_toml(fit);
  CHECK(refusal(file).find("fit.model") != std::string::npos);
  file["fit"] = "force_scale = 1";
  CHECK(refusal(file).find("fit") == 0);
}

TEST_CASE("import: another pack's file is refused by name") {
  json file = exported();
  file["pack_checksum"] = "sha256:0";
  CHECK(refusal(file).find("pack_checksum: found \"sha256:0\"") == 0);
  file.erase("pack_checksum");
  CHECK(refusal(file).find("pack_checksum: found null") == 0);
}

TEST_CASE("import: whatever is wrong in a file is named") {
  const auto with = [](const char* field, const json& value) {
    json file = exported();
    file[json::json_pointer(field)] = value;
    return refusal(file);
  };
  CHECK(with("/finsight_export", 2).find("not a file") != std::string::npos);
  CHECK(with("/settings", json::array()).find("setting") != std::string::npos);
  CHECK(with("/settings/hold_time", 20000).find("hold_time: found 20000") == 0);
  CHECK(with("/settings/contact_on", 0.01).find("threshold") != std::string::npos);
  CHECK(with("/zero/low", json::array({1, 2})).find("zero.low") != std::string::npos);
  CHECK(with("/zero/low/3", "x").find("zero.low") != std::string::npos);
  CHECK(with("/zero/low/3", 1e30).find("zero.low") != std::string::npos);
  CHECK(with("/zero/gravity_g", 9).find("zero.gravity_g") != std::string::npos);
  CHECK(with("/zero", true).find("zero") != std::string::npos);
  CHECK(with("/mount", "").find("camera") != std::string::npos);
  CHECK(with("/mount", 3).find("mount: found 3") != std::string::npos);
  CHECK(with("/mount", nullptr).find("the mount that the zero was measured with") != std::string::npos);
  CHECK(with("/lens", "width_px = 1280").find("lens") != std::string::npos);
  const std::string lens = exported()["lens"];
  std::string other = lens;
  other.replace(other.find("640"), 3, "800");
  CHECK(with("/lens", other).find("width_px: found 800, expected 640") != std::string::npos);
  json far = exported();
  std::string moved = far["mount"];
  moved.replace(moved.find("0.5000"), 6, "50.500");
  far["mount"] = moved;
  CHECK(refusal(far).find("another finger") != std::string::npos);
}

TEST_CASE("import: whatever became of a file, it is refused with a reason or is a device's that could be") {
  const std::string text = exported().dump();
  test::Random random(5);
  int refused = 0, taken = 0;
  for (int trial = 0; trial < 4000; ++trial) {
    std::string broken = text;
    for (int change = 0; change < 1 + trial % 3; ++change) {
      const auto at = static_cast<std::size_t>(random.uniform() * static_cast<double>(broken.size()));
      const char byte = "0123456789-+.e[]{}\",:\\n x"[static_cast<std::size_t>(random.uniform() * 25)];
      if (trial % 2) {
        broken[at] = byte;
      } else {
        broken.insert(at, 1, byte);
      }
    }
    const json file = json_body(broken);
    if (file.is_discarded()) continue;
    Import import;
    const std::string reason = refusal(file, &import);
    if (reason.empty()) {
      CHECK(import.state.find("version = ") != std::string::npos);
      ++taken;
    } else {
      ++refused;
    }
  }
  CHECK(refused > 100);
  CHECK(taken > 10);
}

TEST_CASE("import: all of it is stored, and what was there stays as the former") {
  const test::ScratchFolder folder;
  folder.write(kMeasuredLens, "old");
  const Import import{"lens", "mount", "fit", "state"};
  REQUIRE_FALSE(store_import(folder.path(), import, restarted));
  CHECK(text_of(folder / kMeasuredLens) == "lens");
  CHECK(text_of(folder / "lens.toml.former") == "old");
  CHECK(text_of(folder / kMeasuredMount) == "mount");
  CHECK(text_of(folder / kMeasuredFit) == "fit");
  CHECK(text_of(folder / kImportedState) == "state");
}

TEST_CASE("import: nothing is stored if the device may not restart, or has no room") {
  const test::ScratchFolder folder;
  folder.write(kMeasuredLens, "old");
  const Import import{"lens", "mount", "", "state"};
  const auto refused = store_import(folder.path(), import, [] { return std::optional(Refusal{409, "busy"}); });
  REQUIRE(refused);
  CHECK(refused->reason == "busy");
  CHECK(text_of(folder / kMeasuredLens) == "old");
  CHECK_FALSE(std::filesystem::exists(folder / kMeasuredMount));
  CHECK_FALSE(std::filesystem::exists(folder / kImportedState));
  folder.write("taken", "");
  CHECK(store_import(folder / "taken", import, restarted));
}
