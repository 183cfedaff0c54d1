#include "firmware/vision/pose_stage.h"

#include <doctest/doctest.h>

#include <limits>

#include "firmware/input_error.h"
#include "firmware/model/plate_prior.h"
#include "firmware/vision/marker_stage.h"
#include "tests/count_allocations.h"
#include "tests/vision/test_finger.h"

using namespace finsight;
using namespace finsight::test;

namespace {

constexpr std::array<bool, kPlates> kAll{true, true, true}, kNone{false, false, false};
constexpr double kDegree = std::numbers::pi / 180;

MarkerCorners noisy(const MarkerCorners& corners, double sigma_px, Random& random) {
  MarkerCorners moved = corners;
  for (auto& marker : moved.corners_px) {
    for (Vec2f& corner : marker) {
      const double x = random.normal(), y = random.normal();
      corner += (sigma_px * Eigen::Vector2d(x, y)).cast<float>();
    }
  }
  return moved;
}

struct PoseErrors {
  double across = 0, depth = 0, tilt = 0;
  int count = 0, flips = 0;
  void add(const MountModel& mount, const std::array<PlateMotion, kPlates>& truth, const PlatePoses& found) {
    for (std::size_t p = 0; p < kPlates; ++p) {
      const Vec3f error = found.plates[p].displacement_mm - truth[p].displacement_mm;
      const double tilt_rad = tilt_error_rad(mount, truth[p], found.plates[p], p);
      across += error.x() * error.x() + error.z() * error.z();
      depth += error.y() * error.y();
      tilt += tilt_rad * tilt_rad;
      flips += tilt_rad > 8 * kDegree;
      ++count;
    }
  }
  double across_mm() const { return std::sqrt(across / (2 * count)); }
  double depth_mm() const { return std::sqrt(depth / count); }
  double tilt_deg() const { return std::sqrt(tilt / count) / kDegree; }
};

void check_close(const PlateMotion& found, const PlateMotion& truth, double mm, double rad) {
  CHECK((found.displacement_mm - truth.displacement_mm).norm() < mm);
  CHECK((found.rotation_rad - truth.rotation_rad).norm() < rad);
}

}  // namespace

TEST_CASE("poses: recovers the motion from exact corners, at rest and far bent") {
  const MountModel mount = test_mount();
  const TestPrior prior;
  for (const Lens& camera : {camera_1280x720(), camera_640x480()}) {
    PoseStage joint(mount, prior.view(), camera);
    PoseStage published(mount, prior.view(), camera, PoseMethod::kPublished);
    Random random(1);
    for (int i = 0; i < 30; ++i) {
      const PoseVectord numbers = i == 0 ? PoseVectord(PoseVectord::Zero()) : prior.draw(random);
      const std::array<PlateMotion, kPlates> truth = plate_motions(numbers);
      const MarkerCorners corners = corners_of(mount, camera, truth);
      const PlatePoses& found = joint.estimate(corners);
      CHECK(found.quality == Quality::kFresh);
      CHECK(found.seen == kAll);
      for (std::size_t p = 0; p < kPlates; ++p) {
        check_close(found.plates[p], truth[p], 0.15, 1.5 * kDegree);  // the prior pulls a little
        CHECK(found.reprojection_px[p] < 0.05F);
      }
      // IPPE alone has no prior and fits the corners exactly; within 1.5 degrees of face-on, rounding the corners to
      // float makes it pick either pose.
      const PlatePoses& alone = published.estimate(corners);
      CHECK(alone.seen == kAll);
      for (std::size_t p = 0; p < kPlates; ++p) {
        CHECK((alone.plates[p].displacement_mm - truth[p].displacement_mm).norm() < 0.1F);
        CHECK(tilt_error_rad(mount, truth[p], alone.plates[p], p) < 3 * kDegree);
        CHECK(alone.reprojection_px[p] < 0.001F);
      }
    }
  }
}

TEST_CASE("poses: in 500 noisy, nearly face-on views the joint estimate never flips, IPPE alone often") {
  const MountModel mount = test_mount();
  const TestPrior prior;
  const Lens camera = camera_640x480();
  PoseStage joint(mount, prior.view(), camera);
  PoseStage published(mount, prior.view(), camera, PoseMethod::kPublished);
  PoseErrors joint_errors, published_errors;
  Random random(2);
  for (int i = 0; i < 500; ++i) {
    const std::array<PlateMotion, kPlates> truth = plate_motions(prior.draw(random));
    const MarkerCorners corners = noisy(corners_of(mount, camera, truth), 0.15, random);
    joint_errors.add(mount, truth, joint.estimate(corners));
    published_errors.add(mount, truth, published.estimate(corners));
  }
  const auto report = [](const PoseErrors& e) {
    return doctest::String(("across " + std::to_string(e.across_mm()) + " mm, depth " + std::to_string(e.depth_mm()) +
                            " mm, tilt " + std::to_string(e.tilt_deg()) + " degrees, flips " + std::to_string(e.flips) +
                            " of " + std::to_string(e.count))
                               .c_str());
  };
  MESSAGE("joint: ", report(joint_errors), "; IPPE: ", report(published_errors));
  CHECK(joint_errors.flips <= joint_errors.count / 1000);
  CHECK(published_errors.flips >= published_errors.count / 50);
  CHECK(joint_errors.across_mm() < 0.05);
  CHECK(joint_errors.depth_mm() < 0.2);
  CHECK(joint_errors.tilt_deg() < 1);
  CHECK(joint_errors.tilt_deg() < published_errors.tilt_deg() / 3);
  CHECK(joint_errors.depth_mm() < published_errors.depth_mm());
}

TEST_CASE("poses: a single square of 35 pixels with 0.1 pixels of noise flips in less than 1 of 100 views") {
  const MountModel mount = test_mount();
  const TestPrior prior;
  const Lens camera = camera_640x480();
  PoseStage stage(mount, prior.view(), camera);
  PoseStage published(mount, prior.view(), camera, PoseMethod::kPublished);
  Random random(3);
  int flips = 0, ippe_flips = 0;
  for (int i = 0; i < 500; ++i) {
    const std::array<PlateMotion, kPlates> truth = plate_motions(prior.draw(random));
    MarkerCorners corners = noisy(corners_of(mount, camera, truth), 0.1, random);
    corners.seen = {true, false, false};
    const PlatePoses& found = stage.estimate(corners);
    REQUIRE(found.seen == corners.seen);
    flips += tilt_error_rad(mount, truth[0], found.plates[0], 0) > 10 * kDegree;
    ippe_flips += tilt_error_rad(mount, truth[0], published.estimate(corners).plates[0], 0) > 10 * kDegree;
  }
  MESSAGE("top plate alone: joint flips ", flips, ", IPPE ", ippe_flips, " of 500");
  CHECK(flips < 5);
  CHECK(ippe_flips > 15);
}

TEST_CASE("poses: finds the most probable combination of mirror poses") {
  const MountModel mount = test_mount();
  const TestPrior prior;
  const Lens camera = camera_640x480();
  PoseStage stage(mount, prior.view(), camera);
  const PlateEstimator estimator(mount, prior.view(), camera.fx);
  Random random(9);
  for (int i = 0; i < 300; ++i) {
    const PoseVectord truth = prior.draw(random);
    MarkerCorners corners = noisy(corners_of(mount, camera, plate_motions(truth)), 0.15, random);
    const unsigned mask = 1U + static_cast<unsigned>(i) % 7U;
    corners.seen = {(mask & 1) != 0, (mask & 2) != 0, (mask & 4) != 0};
    PlateSight sight;
    sight.seen = corners.seen;
    for (std::size_t p = 0; p < kPlates; ++p) {
      for (std::size_t k = 0; k < 4; ++k) {
        sight.rays[p][k] = ray_from_pixel(camera, corners.corners_px[p][k].cast<double>());
      }
    }
    const PoseVectord found = pose_vector(stage.estimate(corners)).cast<double>();
    sight.corner_sigma_px = estimator.corner_sigma_px(sight, found);
    PoseVectord from_truth = truth;
    for (int step = 0; step < 8; ++step) estimator.gauss_newton_step(sight, from_truth);
    CHECK(estimator.cost(sight, found) <
          estimator.cost(sight, from_truth) + 0.1);  // what further steps would still gain
  }
}

TEST_CASE("poses: from a drawn image to plate motions") {
  const MountModel mount = test_mount();
  const TestPrior prior;
  const Lens camera = camera_1280x720();
  PoseStage poses(mount, prior.view(), camera);
  Random random(4);
  for (int i = 0; i < 3; ++i) {
    MarkerStage markers(mount, camera);
    const std::array<PlateMotion, kPlates> truth = plate_motions(prior.draw(random));
    Paint paint;
    paint.samples = 37;
    const std::vector<std::uint8_t> grey = paint_plates(mount, camera, truth, paint, 1);
    const PlatePoses& found = poses.estimate(markers.find(frame_of(camera, grey)));
    REQUIRE(found.seen == kAll);
    for (std::size_t p = 0; p < kPlates; ++p) {
      check_close(found.plates[p], truth[p], 0.2, kDegree);
      CHECK(found.reprojection_px[p] < 0.1F);
    }
  }
}

TEST_CASE("poses: plates that are not seen are completed from the prior, close to where they are") {
  const MountModel mount = test_mount();
  const TestPrior prior;
  const Lens camera = camera_1280x720();
  Random random(5);
  for (const PoseMethod method : {PoseMethod::kJoint, PoseMethod::kPublished}) {
    PoseStage stage(mount, prior.view(), camera, method);
    for (unsigned mask = 1; mask < 7; ++mask) {
      MarkerCorners corners = corners_of(mount, camera, plate_motions(prior.draw(random)));
      corners.seen = {(mask & 1) != 0, (mask & 2) != 0, (mask & 4) != 0};
      PlatePoses found = stage.estimate(corners);
      CHECK(found.quality == Quality::kFresh);
      CHECK(found.seen == corners.seen);
      PlatePoses expected = found;
      complete_from_prior(prior.view(), expected);
      for (std::size_t p = 0; p < kPlates; ++p) {
        check_close(found.plates[p], expected.plates[p], 2e-3, 1e-3);
        if (!found.seen[p]) CHECK(found.reprojection_px[p] == 0);
      }
    }
  }
}

TEST_CASE("poses: with nothing seen they are invalid, and at rest") {
  const TestPrior prior;
  PoseStage stage(test_mount(), prior.view(), camera_640x480());
  MarkerCorners corners = corners_of(test_mount(), camera_640x480(), plate_motions(prior.ways.col(0)));
  CHECK(stage.estimate(corners).quality == Quality::kFresh);
  corners.seen = kNone;
  const PlatePoses& found = stage.estimate(corners);
  CHECK(found.quality == Quality::kInvalid);
  CHECK(found.seen == kNone);
  for (const PlateMotion& plate : found.plates) check_close(plate, {}, 1e-9, 1e-9);
}

TEST_CASE("poses: a plate at an impossible place is not seen and does not move the others") {
  const MountModel mount = test_mount();
  const TestPrior prior;
  const Lens camera = camera_1280x720();
  PoseStage stage(mount, prior.view(), camera);
  Random random(6);
  const std::array<PlateMotion, kPlates> truth = plate_motions(prior.draw(random));
  const MarkerCorners good = corners_of(mount, camera, truth);

  const auto middle_refused = [&](const std::array<Vec2f, 4>& middle) {
    MarkerCorners corners = good;
    corners.corners_px[kMiddlePlate] = middle;
    const PlatePoses& found = stage.estimate(corners);
    CHECK(found.seen == std::array{true, false, true});
    check_close(found.plates[kTopPlate], truth[kTopPlate], 0.2, kDegree);
    check_close(found.plates[kLowPlate], truth[kLowPlate], 0.2, kDegree);
  };
  const std::array<Vec2f, 4>& middle = good.corners_px[kMiddlePlate];
  middle_refused({middle[2], middle[3], middle[0], middle[1]});  // half a turn about its own axis
  middle_refused({middle[1], middle[0], middle[3], middle[2]});  // seen from behind
  middle_refused({middle[0], middle[1], middle[2], Vec2f(middle[3] + Vec2f(12, -9))});  // not a square
  middle_refused({middle[0], middle[0], middle[0], middle[0]});
  middle_refused({middle[0], middle[1], middle[2], Vec2f::Constant(std::nanf(""))});
  middle_refused({middle[0], middle[1], middle[2], Vec2f(1e9F, -1e9F)});
  std::array<Vec2f, 4> elsewhere = middle;
  for (Vec2f& corner : elsewhere) corner += Vec2f(-420, 150);  // some 45 mm away
  middle_refused(elsewhere);
  std::array<Vec2f, 4> tiny = middle;
  for (Vec2f& corner : tiny) corner = middle[0] + (corner - middle[0]) * 0.4F;  // 130 mm farther away
  middle_refused(tiny);
}

TEST_CASE("poses: random corners never give nonsense that is called fresh") {
  const TestPrior prior;
  const Lens camera = camera_640x480();
  for (const PoseMethod method : {PoseMethod::kJoint, PoseMethod::kPublished}) {
    PoseStage stage(test_mount(), prior.view(), camera, method);
    Random random(7);
    for (int i = 0; i < 300; ++i) {
      MarkerCorners corners;
      corners.seen = kAll;
      for (auto& marker : corners.corners_px) {
        for (Vec2f& corner : marker) {
          corner = Eigen::Vector2d(random.uniform(-50, 700), random.uniform(-50, 500)).cast<float>();
        }
      }
      const PlatePoses& found = stage.estimate(corners);
      for (std::size_t p = 0; p < kPlates; ++p) {
        CHECK(found.plates[p].displacement_mm.allFinite());
        CHECK(found.plates[p].rotation_rad.allFinite());
        if (found.seen[p]) CHECK(found.reprojection_px[p] <= 3);
      }
      CHECK((found.quality == Quality::kFresh) == (found.seen_count() > 0));
    }
  }
}

TEST_CASE("poses: far from the prior the corners decide") {
  const MountModel mount = test_mount();
  const TestPrior prior;
  const Lens camera = camera_1280x720();
  PoseStage stage(mount, prior.view(), camera);
  Random random(8);
  for (int i = 0; i < 20; ++i) {
    // Ten times the prior's scatter: 1 mm and 3 degrees.
    PoseVectord numbers = prior.draw(random);
    for (int n = 0; n < kPoseDims; ++n) numbers[n] += 10 * prior.scatter[n] * random.normal();
    const std::array<PlateMotion, kPlates> truth = plate_motions(numbers);
    const PlatePoses& found = stage.estimate(corners_of(mount, camera, truth));
    CHECK(found.seen == kAll);
    for (std::size_t p = 0; p < kPlates; ++p) {
      const Vec3f error = found.plates[p].displacement_mm - truth[p].displacement_mm;
      CHECK(Vec2f(error.x(), error.z()).norm() < 0.2F);
      CHECK(std::abs(error.y()) < 1.5F);
      CHECK(found.reprojection_px[p] < 1.0F);
    }
  }
}

TEST_CASE("poses: refuses an impossible camera or prior") {
  const TestPrior prior;
  Lens camera = camera_640x480();
  camera.fx = std::numeric_limits<double>::quiet_NaN();
  CHECK_THROWS_AS(PoseStage(test_mount(), prior.view(), camera), InputError);
  CHECK_THROWS_AS(PoseStage(test_mount(), PlatePrior{}, camera_640x480()), InputError);
}

TEST_CASE("poses: estimate allocates nothing after construction, seen or unseen, good or bad corners") {
  const MountModel mount = test_mount();
  const TestPrior prior;
  const Lens camera = camera_640x480();
  Random random(10);
  const MarkerCorners good = noisy(corners_of(mount, camera, plate_motions(prior.draw(random))), 0.15, random);
  MarkerCorners alone = good, none = good, turned = good, infinite = good;
  alone.seen = {true, false, false};
  none.seen = kNone;
  std::swap(turned.corners_px[kMiddlePlate][0], turned.corners_px[kMiddlePlate][2]);
  infinite.corners_px[kTopPlate][1].x() = std::numeric_limits<float>::infinity();
  const std::array all{good, alone, none, turned, infinite};
  for (const PoseMethod method : {PoseMethod::kJoint, PoseMethod::kPublished}) {
    PoseStage stage(mount, prior.view(), camera, method);
    int seen = 0;
    const long before = allocations;
    for (const MarkerCorners& corners : all) seen += stage.estimate(corners).seen_count();
    const long after = allocations;
    CHECK(after == before);
    CHECK(seen >= 3 + 1 + 0 + 2 + 2);
  }
}
