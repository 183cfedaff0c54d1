#include "firmware/page/import.h"

#include <doctest/doctest.h>

#include <algorithm>

#include "firmware/page/json_body.h"
#include "firmware/page/register_text.h"
#include "firmware/settings/measured_fit.h"
#include "firmware/settings/state_text.h"
#include "tests/random.h"

using namespace finsight;
using namespace finsight::page;
using nlohmann::json;

namespace {

constexpr std::uint32_t kModel = 0x12345678;

MountModel mount() {
  MountModel model{};
  model.marker_id = {0, 1, 2};
  model.marker_size_mm = 8;
  model.T_finger_camera = Eigen::Isometry3f::Identity();
  for (std::size_t p = 0; p < kPlates; ++p) {
    model.T_finger_marker[p] = Eigen::Isometry3f(Eigen::Translation3f(0, 30 * static_cast<float>(p), 20));
  }
  return model;
}

FingerAtStart finger() {
  return {.model_name = "srm",
          .model_checksum = kModel,
          .mount = mount(),
          .furthest_mm = 2,
          .width_px = 640,
          .height_px = 480};
}

json settings() {
  json values;
  for (int i = 0; i < kSettingCount; ++i) {
    const RegisterRow& row = setting_row(i);
    const std::array words = {row.factory};
    if (row.writable) values[row.name] = register_value(row, words, false);
  }
  values["hold_time"] = 250;
  return values;
}

/// As a device exports it: with a lens, a mount half a millimetre off, and a zero.
json exported() {
  MeasuredMount measured = poses_of(mount());
  measured.T_finger_camera.translation().x() += 0.5;
  const json about = {{"finger", "srm"},
                      {"pack_checksum", checksum_text(kModel)},
                      {"mount", measured_mount_toml(measured)},
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
  return export_file(settings(), about, frame);
}

std::string refusal(const json& file, std::vector<PartText>* import = nullptr) {
  std::vector<PartText> any;
  const auto refused = read_import(file, finger(), import ? *import : any);
  return refused ? refused->reason : "";
}

std::string text_of(const std::vector<PartText>& import, Part part) {
  const auto found = std::ranges::find(import, part, &PartText::part);
  return found == import.end() ? "" : found->text;
}

/// Whether finsightd's own readers take it.
bool starts_with(const std::vector<PartText>& import) {
  MeasuredMount measured;
  for (const auto& [part, text] : import) {
    const auto table = TomlTable::parse_text(text, file_of(part));
    if (part == Part::kLens) check_lens(in_single_precision(read_lens(table, 640, 480)));
    if (part == Part::kMount) corrected_mount(mount(), measured = read_measured_mount(table));
    if (part == Part::kFit) check_fit(read_measured_fit(table), kModel, "fit");
    const ZeroBasis basis{kModel, measured};
    if (part == Part::kState && !read_state(table, "state", &basis).problem.empty()) return false;
  }
  return true;
}

}  // namespace

TEST_CASE("import: what was exported comes back, as text of the files that finsightd reads") {
  std::vector<PartText> import;
  REQUIRE(refusal(json_body(exported().dump()), &import) == "");
  CHECK(text_of(import, Part::kLens).find("457.25") != std::string::npos);
  CHECK(text_of(import, Part::kMount).find("[camera]\nposition_mm = [0.5000") != std::string::npos);
  CHECK(text_of(import, Part::kState).find("hold_time = 250\n") != std::string::npos);
  CHECK(text_of(import, Part::kState).find("low = [0.125, 0, 0, 0, 0, 0.0625]") != std::string::npos);
}

TEST_CASE("import: a fit comes along, and one of another pack is refused") {
  FitValues fit{};
  fit.model_checksum = kModel;
  fit.fitted_on = 9823;
  fit.force_scale = 1.125F;
  fit.force_sigma = 0.0625F;
  json file = exported();
  file["fit"] = measured_fit_toml(fit);
  std::vector<PartText> import;
  REQUIRE(refusal(file, &import) == "");
  CHECK(text_of(import, Part::kFit).find("force_scale = 1.125 ") != std::string::npos);
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
  for (const char* plate : {"/zero/low/0", "/zero/low/3"}) CHECK(with(plate, 9.9).find("zero") != std::string::npos);
  CHECK(with("/zero", true).find("zero") != std::string::npos);
  CHECK(with("/mount", "").find("camera") != std::string::npos);
  CHECK(with("/mount", 3).find("mount: found 3") != std::string::npos);
  CHECK(with("/mount", nullptr).find("the mount that the zero was measured with") != std::string::npos);
  CHECK(with("/lens", "width_px = 1280").find("lens") != std::string::npos);
  const std::string lens = exported()["lens"];
  std::string other = lens;
  other.replace(other.find("640"), 3, "800");
  CHECK(with("/lens", other).find("width_px: found 800, expected 640") != std::string::npos);
  for (const char* focal : {"1e-300", "0.001", "90000"}) {
    other = lens;
    other.replace(other.find("457.25"), 6, focal);
    CHECK(with("/lens", other).find("fx") != std::string::npos);
  }
  other = lens;
  other.replace(other.find("319.5"), 5, "639.99999999999");  // outside the image in single precision
  CHECK(with("/lens", other).find("cx") != std::string::npos);
  json far = exported();
  std::string moved = far["mount"];
  moved.replace(moved.find("0.5000"), 6, "50.500");
  far["mount"] = moved;
  CHECK(refusal(far).find("another finger") != std::string::npos);
}

TEST_CASE("import: a file that lacks something is refused, naming all of it") {
  json file = exported();
  file["settings"].erase("hold_time");
  for (const char* part : {"lens", "zero"}) file.erase(part);
  CHECK(refusal(file) == "The file is not complete: it lacks lens, zero, hold_time.");
  file.erase("settings");
  CHECK(refusal(file) == "The file is not complete: it lacks settings, lens, zero.");
  file["settings"] = 7;
  CHECK(refusal(file) == "settings: expected {name: value}.");
}

TEST_CASE("import: a mount that is near enough only before it is rounded is refused") {
  json file = exported();
  std::string moved = file["mount"];
  moved.replace(moved.find("0.5000, 0.0000"), 14,
                "7.99996, 6.000051");  // 9.999999 mm, but as 8 and 6.0001 more than 10
  file["mount"] = moved;
  CHECK(refusal(file).find("another finger") != std::string::npos);
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
    std::vector<PartText> import;
    const std::string reason = refusal(file, &import);
    if (reason.empty()) {
      CHECK(starts_with(import));
      ++taken;
    } else {
      ++refused;
    }
  }
  CHECK(refused > 100);
  CHECK(taken > 10);
}
