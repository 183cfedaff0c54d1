#include "hostgen/calibrate/resting_corners.h"

#include <doctest/doctest.h>

#include "firmware/geometry/so3.h"
#include "firmware/input_error.h"
#include "firmware/ports/session.h"
#include "firmware/settings/settings.h"
#include "hostgen/finger/mount.h"
#include "hostgen/render/renderer.h"
#include "tests/model/scratch_folder.h"
#include "tests/vision/test_finger.h"

using namespace finsight;
using namespace finsight::host;

namespace {

using Change = Eigen::Matrix<double, 6, 1 + kPlates>;

Eigen::Isometry3f changed(const Eigen::Isometry3f& pose, const Eigen::Matrix<double, 6, 1>& by) {
  Eigen::Isometry3f now = pose;
  now.translation() += by.head<3>().cast<float>();
  now.linear() = so3_exp(by.tail<3>()).cast<float>() * pose.linear();
  return now;
}

MountModel changed(MountModel mount, const Change& by) {
  mount.T_finger_camera = changed(mount.T_finger_camera, by.col(0));
  for (std::size_t p = 0; p < kPlates; ++p) {
    mount.T_finger_marker[p] = changed(mount.T_finger_marker[p], by.col(1 + static_cast<int>(p)));
  }
  return mount;
}

/// As parts are mounted.
Change drawn(test::Random& random) {
  Change by;
  for (int place = 0; place < 1 + kPlates; ++place) {
    for (int i = 0; i < 6; ++i) {
      const double mm = place == 0 ? 2 : 0.3, deg = place == 0 ? 3 : 2;
      by(i, place) = random.normal() * (i < 3 ? mm : deg * std::numbers::pi / 180);
    }
  }
  return by;
}

RestingCorners corners_of(const MountModel& mount, const Lens& lens, test::Random& random) {
  RestingCorners seen;
  seen.lens = lens;
  const MarkerCorners corners = test::corners_of(mount, lens, {});
  for (std::size_t p = 0; p < kPlates; ++p) {
    for (std::size_t k = 0; k < 4; ++k) {
      const double x_px = 0.05 * random.normal(), y_px = 0.05 * random.normal();
      seen.corner_px[p][k] = corners.corners_px[p][k].cast<double>() + Eigen::Vector2d(x_px, y_px);
    }
  }
  seen.frames = 10;
  return seen;
}

template <class Work>
std::string refusal(const Work& work) {
  try {
    work();
  } catch (const InputError& error) {
    return error.what();
  }
  return "accepted";
}

bool says(const std::string& text, const char* part) { return text.find(part) != std::string::npos; }

/// A session of a finger, frame by frame.
struct TestSession {
  TestSession(const FingerSpec& spec, const Lens& lens) : width(lens.width_px), height(lens.height_px) {
    SessionInfo info{.lens = lens,
                     .frames_per_second = 60,
                     .marker_dictionary = "DICT_4X4_50",
                     .marker_id = {0, 1, 2},
                     .marker_size_mm = spec.marker_size_mm,
                     .description = ""};
    folder.write(kSessionInfo, session_info_toml(info));
  }
  void write(const std::vector<std::vector<std::uint8_t>>& frames) const {
    Y4mWriter writer(folder / kSessionFrames, width, height, 60);
    for (const auto& grey : frames) writer.write(grey.data());
    writer.finish();
  }
  test::ScratchFolder folder;
  int width, height;
};

}  // namespace

TEST_CASE("mount estimate: recovers how camera and markers are mounted, as well as it says") {
  const Lens lens = test::camera_1280x720();
  const MountModel nominal = test::test_mount();
  test::Random random(11);
  constexpr int kTimes = 200;
  Change squares = Change::Zero();
  double prints = 0;
  for (int i = 0; i < kTimes; ++i) {
    const Change truth = drawn(random);
    MountModel real = changed(nominal, truth);
    const double print = 0.01 * random.normal();
    real.marker_size_mm *= static_cast<float>(1 + print);
    const MountEstimate found = estimate_mount(nominal, corners_of(real, lens, random), "s");
    CHECK(found.rms_px < 0.1);
    prints += std::pow((found.print - print) / found.print_sigma, 2) / kTimes;
    squares += ((found.change - truth).cwiseQuotient(found.sigma)).cwiseAbs2() / kTimes;
  }
  CHECK(squares.maxCoeff() < 1.5);  // 1 on average, and each of 24 from 200 draws
  CHECK(squares.minCoeff() > 0.7);
  CHECK(prints == doctest::Approx(1).epsilon(0.3));
  CHECK(squares.mean() == doctest::Approx(1).epsilon(0.12));
}

TEST_CASE("mount estimate: a camera that alone is displaced is found where it is") {
  const Lens lens = test::camera_1280x720();
  const MountModel nominal = test::test_mount();
  test::Random random(5);
  Change truth = Change::Zero();
  truth.col(0) << 1.2, -2, 0.8, 0.03, -0.02, 0.04;
  const MountEstimate found = estimate_mount(nominal, corners_of(changed(nominal, truth), lens, random), "s");
  const Change error = found.change - truth;
  CHECK(error.col(0).head<3>().cwiseAbs().maxCoeff() < 0.35);
  CHECK(error.col(0).tail<3>().cwiseAbs().maxCoeff() < 0.004);
  CHECK(error.cwiseQuotient(found.sigma).cwiseAbs().maxCoeff() < 4);  // markers' as well, which moved not at all
  CHECK(says(mount_text(found), "camera"));
  CHECK_FALSE(says(mount_text(found), "warning"));

  truth.col(3) << 5, 0, 0, 0, 0, 0;
  const MountEstimate odd = estimate_mount(nominal, corners_of(changed(nominal, truth), lens, random), "s");
  CHECK(says(mount_text(odd), "warning: the low marker is "));
}

TEST_CASE("mount estimate: what no mount explains, and what is too far away, is refused") {
  const Lens lens = test::camera_1280x720();
  const MountModel nominal = test::test_mount();
  test::Random random(5);
  RestingCorners seen = corners_of(nominal, lens, random);
  seen.corner_px[1][2].x() += 9;
  CHECK(says(refusal([&] { estimate_mount(nominal, seen, "s"); }), "s: markers' corners: found"));
  Change far = Change::Zero();
  far.col(0) << 0, -14, 0, 0, 0, 0;
  seen = corners_of(changed(nominal, far), lens, random);
  CHECK(says(refusal([&] { estimate_mount(nominal, seen, "s"); }), "s: camera: found 1"));
}

TEST_CASE("mount estimate: from a rendered session of a finger whose camera sits askew") {
  FingerSpec spec = read_finger_spec(FINSIGHT_SOURCE_DIR "/hostgen/fingers/srm.toml");
  const MountModel nominal = mount_of(spec);
  const Lens& c = spec.cameras[1];
  Change truth = Change::Zero();
  truth.col(0) << 1, -1.5, 0.5, 0.02, 0.03, -0.02;
  truth(0, 1) = 0.3;
  const MountModel real = changed(nominal, truth);
  FingerSpec mounted = spec;
  mounted.T_finger_camera = real.T_finger_camera.cast<double>();
  for (std::size_t p = 0; p < kPlates; ++p) mounted.plates[p].T_finger_marker = real.T_finger_marker[p].cast<double>();
  Renderer renderer(mounted, c, {}, 3);
  std::vector<std::vector<std::uint8_t>> frames(12);
  for (auto& grey : frames) renderer.render(std::array<PlateMotion, kPlates>{}, grey);
  const TestSession session(spec, c);
  session.write(frames);

  const RestingCorners seen = resting_corners(session.folder.path(), nominal);
  CHECK(seen.frames == 12);
  const MountEstimate found = estimate_mount(nominal, seen, "session");
  CHECK(found.rms_px < 0.1);
  CHECK(((found.change - truth).cwiseQuotient(found.sigma)).cwiseAbs().maxCoeff() < 3);
  // Where the camera has the markers is known much better than what of that is the camera's.
  for (std::size_t p = 0; p < kPlates; ++p) {
    const Eigen::Isometry3d off = found.mount.T_finger_camera.inverse() * found.mount.T_finger_marker[p] *
                                  (real.T_finger_camera.inverse() * real.T_finger_marker[p]).cast<double>().inverse();
    const Eigen::Vector3d at = (real.T_finger_camera.inverse() * real.T_finger_marker[p].translation()).cast<double>();
    CHECK((off * at - at).norm() < 0.3);
  }

  // Glossy paper by a ring of lights, whose reflection hides a part of the top marker.
  Renderer glossy(mounted, c, image_preset("glare"), 3);
  for (auto& grey : frames) glossy.render(std::array<PlateMotion, kPlates>{}, grey);
  session.write(frames);
  CHECK(resting_corners(session.folder.path(), nominal).frames == 12);

  // A frame of a touched finger among them, and markers that are not there.
  std::array<PlateMotion, kPlates> touched;
  touched[kTopPlate].displacement_mm.z() = 1.5F;
  for (std::size_t i = 0; i < 6; ++i) renderer.render(touched, frames[i]);
  session.write(frames);
  CHECK(says(refusal([&] { resting_corners(session.folder.path(), nominal); }),
             "top plate: found a marker that moves by"));
  Renderer::Scene covered{.plates = {}, .covered = {false, true, false}};
  for (auto& grey : frames) renderer.render({&covered, 1}, grey);
  session.write(frames);
  CHECK(says(refusal([&] { resting_corners(session.folder.path(), nominal); }), "found 0 (top 12, middle 0, low 12)"));
  MountModel other = nominal;
  other.marker_id = {0, 1, 3};
  CHECK(says(refusal([&] { resting_corners(session.folder.path(), other); }), "markers.id: found"));
  other = nominal;
  other.marker_size_mm = 10;
  CHECK(says(refusal([&] { resting_corners(session.folder.path(), other); }), "markers.size_mm: found 8"));
}
