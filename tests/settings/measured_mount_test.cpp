#include "firmware/settings/measured_mount.h"

#include <doctest/doctest.h>

#include "firmware/input_error.h"
#include "firmware/loop/frame_loop.h"
#include "firmware/settings/settings.h"
#include "tests/model/scratch_folder.h"
#include "tests/model/tiny_model.h"
#include "tests/vision/test_finger.h"

using namespace finsight;

namespace {

/// The test finger's mount, with the camera and the low marker not quite where they should be.
MeasuredMount displaced() {
  const MountModel nominal = test::test_mount();
  MeasuredMount mount;
  mount.T_finger_camera = nominal.T_finger_camera.cast<double>();
  for (std::size_t p = 0; p < kPlates; ++p) mount.T_finger_marker[p] = nominal.T_finger_marker[p].cast<double>();
  mount.T_finger_camera.translation() += Eigen::Vector3d(1, -1.5, 0.7);
  mount.T_finger_camera.rotate(Eigen::AngleAxisd(0.03, Eigen::Vector3d(1, 2, -2).normalized()));
  mount.T_finger_marker[kLowPlate].translation().x() += 0.4;
  mount.where = "here";
  return mount;
}

std::string refusal(const MeasuredMount& mount) {
  try {
    corrected_mount(test::test_mount(), mount);
  } catch (const InputError& error) {
    return error.what();
  }
  return "accepted";
}

bool says(const std::string& text, const char* part) { return text.find(part) != std::string::npos; }

constexpr const char* kBoard = "pack = \"p\"\n[source]\nkind = \"session\"\npath = \"s\"\n[modbus]\n";

}  // namespace

TEST_CASE("measured mount: a board file reads what was written, as a file or as tables") {
  const test::ScratchFolder folder;
  const MeasuredMount mount = displaced();
  folder.write("mount.toml", measured_mount_toml(mount));
  const Settings named = read_settings(folder.write("board.toml", std::string("mount = \"mount.toml\"\n") + kBoard));
  REQUIRE(named.mount);
  CHECK(says(named.mount->where, "mount.toml"));
  CHECK(named.mount->T_finger_camera.isApprox(mount.T_finger_camera, 1e-5));
  for (std::size_t p = 0; p < kPlates; ++p) {
    CHECK(named.mount->T_finger_marker[p].isApprox(mount.T_finger_marker[p], 1e-5));
  }
  std::string tables = measured_mount_toml(mount);
  for (std::size_t at = 0; (at = tables.find("\n[", at)) != std::string::npos;) tables.insert(at += 2, "mount.");
  const Settings pasted = read_settings(folder.write("board.toml", std::string(kBoard) + "[mount." + tables.substr(1)));
  REQUIRE(pasted.mount);
  CHECK(pasted.mount->T_finger_camera.matrix() == named.mount->T_finger_camera.matrix());
  CHECK_FALSE(read_settings(folder.write("board.toml", kBoard)).mount);
}

TEST_CASE("measured mount: a missing or unknown key is refused with its place") {
  const auto read = [](const std::string& text) {
    try {
      read_measured_mount(TomlTable::parse_text(text, "mount.toml"));
    } catch (const InputError& error) {
      return std::string(error.what());
    }
    return std::string("accepted");
  };
  const std::string good = measured_mount_toml(displaced());
  CHECK(read(good) == "accepted");
  CHECK(says(read(good.substr(0, good.find("[low]"))), "low: found nothing"));
  CHECK(says(read("shift = 1\n" + good), "mount.toml:1: shift: found an unknown key"));
  CHECK(says(read(good + "roll = 1\n"), "low.roll: found an unknown key"));
  CHECK(says(read(good.substr(0, good.rfind("turn_deg"))), "low.turn_deg: found nothing"));
}

TEST_CASE("measured mount: one that is too far from the model's is refused") {
  CHECK(refusal(displaced()) == "accepted");
  MeasuredMount mount = displaced();
  mount.T_finger_camera.translation().y() -= 12;
  CHECK(says(refusal(mount), "here: camera: found 13."));
  mount = displaced();
  mount.T_finger_marker[kTopPlate].rotate(Eigen::AngleAxisd(0.3, Eigen::Vector3d::UnitX()));
  CHECK(says(refusal(mount), "here: top: found 17."));
}

TEST_CASE("measured mount: with it a displaced camera measures the plates of a resting and of a touched finger") {
  test::TinyModel tiny;
  const test::TestPrior prior;
  tiny.parts.mount = test::test_mount();
  tiny.prior_mean.assign(prior.view().mean.begin(), prior.view().mean.end());
  tiny.prior_covariance.assign(prior.view().covariance.begin(), prior.view().covariance.end());
  const Model model = tiny.open();
  const Lens camera = test::camera_640x480();
  const MeasuredMount measured = displaced();
  const MountModel real = corrected_mount(model.mount, measured);
  std::array<PlateMotion, kPlates> touched;
  touched[kTopPlate].displacement_mm = {0, -0.5F, 5};
  touched[kMiddlePlate].displacement_mm = {0, -0.3F, 2.5F};
  touched[kLowPlate].displacement_mm = {0, -0.1F, 0.8F};
  const auto worst_mm = [&](const LoopSettings& settings, const std::array<PlateMotion, kPlates>& plates) {
    FrameLoop loop(model, camera, settings);
    const auto grey = test::paint_plates(real, camera, plates, {.samples = 37}, 1);
    const RegisterImage& image = loop.step(test::frame_of(camera, grey));
    double worst = 0;  // of the top plate, the one that the registers show
    for (int i = 0; i < 3; ++i) {
      const auto shown = static_cast<std::int16_t>(image.words[static_cast<std::size_t>(14 + i)]);
      worst = std::max(worst, std::abs(0.01 * shown - static_cast<double>(plates[kTopPlate].displacement_mm[i])));
    }
    return worst;
  };
  LoopSettings with;
  with.mount = corrected_mount(test::test_mount(), measured);
  CHECK(worst_mm({}, {}) > 1);
  CHECK(worst_mm(with, {}) < 0.15);
  CHECK(worst_mm({}, touched) > 1);
  CHECK(worst_mm(with, touched) < 0.2);
}
