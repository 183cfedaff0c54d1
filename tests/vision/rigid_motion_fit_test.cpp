#include "firmware/vision/rigid_motion_fit.h"

#include <doctest/doctest.h>

#include "tests/vision/sight.h"

using namespace finsight;
using namespace finsight::test;

namespace {

constexpr double kFocalPx = 490;

double size_mm(const std::array<PlateMotion, kPlates>& plates) {
  double sum_sq = 0;
  for (const PlateMotion& plate : plates) {
    sum_sq += std::pow(static_cast<double>(plate.displacement_mm.norm()), 2) +
              std::pow(28.65 * static_cast<double>(plate.rotation_rad.norm()), 2);
  }
  return std::sqrt(sum_sq);
}

}  // namespace

TEST_CASE("rigid motion fit: explains every motion of the camera, small and large, from any zero") {
  Random random(1);
  const RigidMotionFitter body(test_mount(), kFocalPx);
  for (int trial = 0; trial < 50; ++trial) {
    const Eigen::Vector3d t = 3 * Eigen::Vector3d(random.normal(), random.normal(), random.normal());
    const Eigen::Vector3d w = 0.06 * Eigen::Vector3d(random.normal(), random.normal(), random.normal());
    const auto plates = moved_as_one(t, w);
    const RigidMotionFit fit = body.fit(sight_of(plates, kFocalPx, 0, random), {});
    CHECK(fit.reprojection_px < 1e-3);
    CHECK(fit.size_mm == doctest::Approx(size_mm(plates)).epsilon(1e-3));
    // Seen from where they are, they have not moved.
    CHECK(body.fit(sight_of(plates, kFocalPx, 0, random), plates).size_mm < 1e-3);
  }
}

TEST_CASE("rigid motion fit: the residual is the corners' scatter for a camera's motion, and more for a touch") {
  Random random(2);
  const RigidMotionFitter body(test_mount(), kFocalPx);
  const TestPrior prior;
  for (const double scatter_px : {0.02, 0.1}) {
    double knocked = 0, touched = 0;
    for (int trial = 0; trial < 300; ++trial) {
      const auto moved = moved_as_one({1, 0.5, -1}, {0.01, 0, -0.03});
      knocked += body.fit(sight_of(moved, kFocalPx, scatter_px, random), {}).unexplained_sq / 300;
      const RigidMotionFit fit =
          body.fit(sight_of(plate_motions(prior.draw(random, 1)), kFocalPx, scatter_px, random), {});
      touched += fit.unexplained_sq / (fit.size_mm * fit.size_mm) / 300;
    }
    CHECK(std::abs(knocked) < 0.2 * std::pow(scatter_px / kFocalPx, 2));
    CHECK(touched > std::pow(1e-4, 2));
  }
}

TEST_CASE("rigid motion fit: has no answer for plates behind the camera or not seen") {
  Random random(3);
  const RigidMotionFitter body(test_mount(), kFocalPx);
  std::array<PlateMotion, kPlates> behind{};
  behind[kLowPlate].displacement_mm = Vec3f(0, -200, 0);
  const PlateSight sight = sight_of({}, kFocalPx, 0.02, random);
  CHECK(std::isinf(body.fit(sight, behind).unexplained_sq));
  PlateSight none = sight;
  none.seen.fill(false);
  CHECK(std::isinf(body.fit(none, {}).unexplained_sq));
}
