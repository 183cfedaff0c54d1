#include "hostgen/learn/corner_measurement.h"

#include <cmath>

#include "hostgen/finger/mount.h"
#include "hostgen/finger/plate_motion.h"

namespace finsight::host {

namespace {

constexpr double kMinScatter_px = 0.01, kMaxScatter_px = 0.4;
constexpr int kSteps = 2;  // few are enough: they start at the true motion

}  // namespace

CornerMeasurement::CornerMeasurement(const FingerSpec& spec, const PlatePrior& prior)
    : spec_(spec),
      views_{View{spec.cameras[0].fx, {mount_of(spec), prior, spec.cameras[0].fx}},
             View{spec.cameras[1].fx, {mount_of(spec), prior, spec.cameras[1].fx}}} {}

std::array<float, kPlates> CornerMeasurement::measure(const std::array<bool, kPlates>& seen, Random& random,
                                                      PoseVector& numbers) const {
  const View& view = views_[random.index(views_.size())];
  const double scatter = std::exp(random.uniform(std::log(kMinScatter_px), std::log(kMaxScatter_px))) / view.focal_px;
  const PlatePoses truth = seen_poses({numbers.data(), kPoseDims});
  PlateSight sight;
  sight.seen = seen;
  for (std::size_t p = 0; p < kPlates; ++p) {
    const Eigen::Isometry3d marker = T_camera_marker(spec_, p, truth.plates[p]);
    for (std::size_t k = 0; k < 4; ++k) {
      const Eigen::Vector3d corner = marker * marker_corner(spec_.marker_size_mm, k);
      const Eigen::Vector2d noise(random.normal(), random.normal());
      sight.rays[p][k] = corner.head<2>() / corner.z() + scatter * noise;
    }
  }
  const PlateEstimator::Vector found = view.estimator.estimate(sight, numbers.cast<double>(), kSteps);
  numbers = found.cast<float>();
  return view.estimator.noise(sight, found);
}

}  // namespace finsight::host
