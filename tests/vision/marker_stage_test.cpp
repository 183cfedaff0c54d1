#include "firmware/vision/marker_stage.h"

#include <doctest/doctest.h>

#include <limits>

#include "firmware/input_error.h"
#include "tests/vision/test_finger.h"

using namespace finsight;
using namespace finsight::test;

namespace {

constexpr std::array<bool, kPlates> kAll{true, true, true}, kNone{false, false, false};

Paint quick_paint() {
  Paint paint;
  paint.samples = 37;
  return paint;
}

std::vector<std::uint8_t> paint_moved(const Lens& camera, const PoseVectord& numbers, std::uint64_t seed) {
  return paint_plates(test_mount(), camera, plate_motions(numbers), quick_paint(), seed);
}

/// Mean distance of the seen markers' corners from the truth.
double mean_error_px(const Lens& camera, const PoseVectord& numbers, const MarkerCorners& found) {
  const MarkerCorners truth = corners_of(test_mount(), camera, plate_motions(numbers));
  double sum = 0;
  int count = 0;
  for (std::size_t p = 0; p < kPlates; ++p) {
    for (std::size_t k = 0; k < 4 && found.seen[p]; ++k, ++count) {
      sum += (found.corners_px[p][k] - truth.corners_px[p][k]).norm();
    }
  }
  return sum / count;
}

/// The test finger's markers painted one by one, some of them left out or given another id.
std::vector<std::uint8_t> paint_ids(const Lens& camera, const std::array<int, kPlates>& ids) {
  const MountModel mount = test_mount();
  Image image(camera, quick_paint());
  for (std::size_t p = 0; p < kPlates; ++p) {
    PaintedMarker marker = moved_marker(mount, {}, p);
    marker.id = ids[p];
    if (marker.id >= 0) image.add(marker);
  }
  return image.develop(3);
}

}  // namespace

TEST_CASE("markers: finds all three to 0.05 pixels, at rest and moved, in both image sizes") {
  const TestPrior prior;
  for (const Lens& camera : {camera_1280x720(), camera_640x480()}) {
    Random random(21);
    for (int i = 0; i < 4; ++i) {
      MarkerStage stage(test_mount(), camera);
      const PoseVectord numbers = i == 0 ? PoseVectord(PoseVectord::Zero()) : prior.draw(random);
      const std::vector<std::uint8_t> grey = paint_moved(camera, numbers, static_cast<std::uint64_t>(i));
      const MarkerCorners& found = stage.find(frame_of(camera, grey));
      REQUIRE(found.seen == kAll);
      CHECK(mean_error_px(camera, numbers, found) < 0.05);
    }
  }
}

TEST_CASE("markers: follows them through a fast touch, with the same corners as a full search") {
  const TestPrior prior;
  const Lens camera = camera_640x480();
  MarkerStage following(test_mount(), camera);
  for (int i = 0; i < 6; ++i) {
    PoseVectord numbers = PoseVectord::Zero();
    numbers += 0.4 * i * prior.ways.col(0) + 0.2 * i * prior.ways.col(2);
    const std::vector<std::uint8_t> grey = paint_moved(camera, numbers, static_cast<std::uint64_t>(i));
    const MarkerCorners& followed = following.find(frame_of(camera, grey));
    MarkerStage fresh(test_mount(), camera);
    const MarkerCorners& searched = fresh.find(frame_of(camera, grey));
    REQUIRE(followed.seen == kAll);
    REQUIRE(searched.seen == kAll);
    for (std::size_t p = 0; p < kPlates; ++p) {
      for (std::size_t k = 0; k < 4; ++k) {
        CHECK((followed.corners_px[p][k] - searched.corners_px[p][k]).norm() < 0.01F);
      }
    }
  }
}

TEST_CASE("markers: finds one that jumped out of its window in the same frame") {
  const Lens camera = camera_640x480();
  MarkerStage stage(test_mount(), camera);
  const std::vector<std::uint8_t> at_rest = paint_moved(camera, PoseVectord::Zero(), 1);
  REQUIRE(stage.find(frame_of(camera, at_rest)).seen == kAll);
  PoseVectord jumped = PoseVectord::Zero();
  jumped.segment<3>(0) << -6, 0, 20;
  const std::vector<std::uint8_t> after = paint_moved(camera, jumped, 2);
  const MarkerCorners& found = stage.find(frame_of(camera, after));
  CHECK(found.seen == kAll);
  CHECK(mean_error_px(camera, jumped, found) < 0.05);
}

TEST_CASE("markers: foreign and missing markers are not seen; one that returns is, within eight frames") {
  const Lens camera = camera_640x480();
  const std::array<int, kPlates> ids = test_mount().marker_id;
  MarkerStage stage(test_mount(), camera);
  const std::vector<std::uint8_t> strangers = paint_ids(camera, {0, 1, 49});
  CHECK(stage.find(frame_of(camera, strangers)).seen == kNone);

  const std::vector<std::uint8_t> two = paint_ids(camera, {ids[0], -1, ids[2]});
  for (int i = 0; i < 3; ++i) CHECK(stage.find(frame_of(camera, two)).seen == std::array{true, false, true});
  const std::vector<std::uint8_t> all = paint_ids(camera, ids);
  int frames = 1;
  while (stage.find(frame_of(camera, all)).seen != kAll && frames < 100) ++frames;
  CHECK(frames <= 8);
}

TEST_CASE("markers: finds one that was hidden for some frames in its window at once") {
  const Lens camera = camera_640x480();
  const std::array<int, kPlates> ids = test_mount().marker_id;
  MarkerStage stage(test_mount(), camera);
  const std::vector<std::uint8_t> all = paint_ids(camera, ids), two = paint_ids(camera, {ids[0], -1, ids[2]});
  for (const int hidden : {1, 2, 3, 6}) {
    CHECK(stage.find(frame_of(camera, all)).seen == kAll);
    for (int i = 0; i < hidden; ++i) CHECK(stage.find(frame_of(camera, two)).seen == std::array{true, false, true});
    CHECK(stage.find(frame_of(camera, all)).seen == kAll);
  }
}

TEST_CASE("markers: an id at two places is not seen") {
  const Lens camera = camera_640x480();
  const std::array<int, kPlates> ids = test_mount().marker_id;
  MarkerStage stage(test_mount(), camera);
  const std::vector<std::uint8_t> grey = paint_ids(camera, {ids[0], ids[2], ids[2]});
  CHECK(stage.find(frame_of(camera, grey)).seen == std::array{true, false, false});
  CHECK(stage.find(frame_of(camera, grey)).seen == std::array{true, false, false});
}

TEST_CASE("markers: sees none in unusable frames, and all in the next good one") {
  const Lens camera = camera_640x480();
  MarkerStage stage(test_mount(), camera);
  const std::vector<std::uint8_t> good = paint_moved(camera, PoseVectord::Zero(), 1);
  std::vector<std::uint8_t> black(good.size(), 0), white(good.size(), 255), noise(good.size());
  Random random(4);
  for (std::uint8_t& pixel : noise) pixel = static_cast<std::uint8_t>(random.uniform(0, 256));

  const auto refused_then_fine = [&](const Frame& frame) {
    CHECK(stage.find(frame).seen == kNone);
    CHECK(stage.find(frame_of(camera, good)).seen == kAll);
  };
  refused_then_fine({});
  refused_then_fine(frame_of(camera, black));
  refused_then_fine(frame_of(camera, white));
  refused_then_fine(frame_of(camera, noise));
  Frame wrong = frame_of(camera, good);
  wrong.width_px = 480;
  wrong.height_px = 640;
  refused_then_fine(wrong);
  wrong = frame_of(camera, good);
  wrong.stride_bytes = 100;
  refused_then_fine(wrong);
  wrong = frame_of(camera, good);
  wrong.height_px = 0;
  refused_then_fine(wrong);
}

TEST_CASE("markers: rows may be padded") {
  const Lens camera = camera_640x480();
  const std::vector<std::uint8_t> grey = paint_moved(camera, PoseVectord::Zero(), 1);
  std::vector<std::uint8_t> padded(704 * 480, 255);
  for (std::size_t y = 0; y < 480; ++y) std::copy_n(&grey[y * 640], 640, &padded[y * 704]);
  Frame frame = frame_of(camera, padded);
  frame.stride_bytes = 704;
  MarkerStage stage(test_mount(), camera);
  const MarkerCorners& found = stage.find(frame);
  CHECK(found.seen == kAll);
  CHECK(mean_error_px(camera, PoseVectord::Zero(), found) < 0.05);
}

TEST_CASE("markers: refuses an impossible mount or camera") {
  const auto refused = [](auto change) {
    MountModel mount = test_mount();
    Lens camera = camera_640x480();
    change(mount, camera);
    CHECK_THROWS_AS(MarkerStage(mount, camera), InputError);
  };
  const float nan = std::numeric_limits<float>::quiet_NaN();
  refused([](MountModel& m, Lens&) { m.marker_id[1] = 50; });
  refused([](MountModel& m, Lens&) { m.marker_id[1] = m.marker_id[2]; });
  refused([](MountModel& m, Lens&) { m.marker_size_mm = 0; });
  refused([&](MountModel& m, Lens&) { m.marker_size_mm = nan; });
  refused([](MountModel& m, Lens&) { m.T_finger_marker[0].translation().y() = -60; });
  refused([&](MountModel& m, Lens&) { m.T_finger_camera.translation().x() = nan; });
  refused([&](MountModel&, Lens& c) { c.fx = nan; });
}

namespace {

/// A reflection: all pixels of a disc around a point of a plate's marker (in its own frame) are as bright as can be.
void reflect(const Lens& camera, std::size_t plate, const Eigen::Vector2d& at_mm, double radius_mm,
             std::vector<std::uint8_t>& grey) {
  const PaintedMarker marker = moved_marker(test_mount(), {}, plate);
  const Vec2f middle = project(camera, marker.T_camera_marker * Eigen::Vector3d(at_mm.x(), at_mm.y(), 0)).cast<float>();
  const double px_per_mm = camera.fx / marker.T_camera_marker.translation().z();
  for (int y = 0; y < camera.height_px; ++y) {
    for (int x = 0; x < camera.width_px; ++x) {
      if ((Vec2f(static_cast<float>(x), static_cast<float>(y)) - middle).norm() > radius_mm * px_per_mm) continue;
      grey[static_cast<std::size_t>(y * camera.width_px + x)] = 255;
    }
  }
}

}  // namespace

TEST_CASE("markers: a reflection that breaks a border or hides modules does not lose a marker whose place is known") {
  const Lens camera = camera_640x480();
  const PoseVectord rest = PoseVectord::Zero();
  const MarkerCorners truth = corners_of(test_mount(), camera, plate_motions(rest));
  for (std::size_t p = 0; p < kPlates; ++p) {
    for (const Eigen::Vector2d& at_mm : {Eigen::Vector2d(3.4, 1), Eigen::Vector2d(-1, -3.4), Eigen::Vector2d(0, 0),
                                         Eigen::Vector2d(4, 0), Eigen::Vector2d(0.7, 2)}) {
      CAPTURE(p);
      CAPTURE(at_mm);
      std::vector<std::uint8_t> grey = paint_moved(camera, rest, 5);
      reflect(camera, p, at_mm, 1, grey);
      const Frame frame{grey.data(), camera.width_px, camera.height_px, camera.width_px};
      MarkerStage stage(test_mount(), camera);
      if (!stage.find(frame).seen[p]) {
        std::array<Vec2f, 4> expected = truth.corners_px[p];
        for (Vec2f& corner : expected) corner += Vec2f(1, -0.7F);
        CHECK(stage.find_at(frame, p, expected));
      }
      CHECK(stage.last().seen == kAll);
      CHECK(mean_error_px(camera, rest, stage.last()) < 0.1);
      CHECK(stage.find(frame).seen == kAll);  // from now on it is followed
    }
  }
}

TEST_CASE("markers: another marker or none where one is expected is not taken for it") {
  const Lens camera = camera_640x480();
  const MarkerCorners truth = corners_of(test_mount(), camera, plate_motions(PoseVectord::Zero()));
  std::array<int, kPlates> ids = test_mount().marker_id;
  for (const int other : {-1, 30, 31, 32, 33, 34}) {
    CAPTURE(other);
    ids[kTopPlate] = other;
    std::vector<std::uint8_t> grey = paint_ids(camera, ids);
    reflect(camera, kTopPlate, {1, 1}, 1, grey);
    const Frame frame{grey.data(), camera.width_px, camera.height_px, camera.width_px};
    MarkerStage stage(test_mount(), camera);
    CHECK(!stage.find(frame).seen[kTopPlate]);
    CHECK(!stage.find_at(frame, kTopPlate, truth.corners_px[kTopPlate]));
  }
}
