#include "hostgen/learn/corner_measurement.h"

#include <cmath>

#include "hostgen/finger/mount.h"
#include "hostgen/finger/plate_motion.h"

namespace finsight::host {

namespace {

constexpr double kLeastScatter_px = 0.01, kMostScatter_px = 0.4;
constexpr int kSteps = 2;  // the start is the truth, which is near

PlateMotion motion_of(const PlateNumbers& numbers, std::size_t plate) {
  const int first = 6 * static_cast<int>(plate);
  return {numbers.segment<3>(first), numbers.segment<3>(first + 3)};
}

}  // namespace

CornerMeasurement::CornerMeasurement(const FingerSpec& spec, const PlatePrior& prior)
    : spec_(spec),
      views_{View{spec.cameras[0].fx, {mount_of(spec), prior, spec.cameras[0].fx}},
             View{spec.cameras[1].fx, {mount_of(spec), prior, spec.cameras[1].fx}}} {}

std::array<float, kPlates> CornerMeasurement::measure(const std::array<bool, kPlates>& seen, Random& random,
                                                      PlateNumbers& numbers) const {
  const View& view = views_[random.index(views_.size())];
  const double scatter =
      std::exp(random.uniform(std::log(kLeastScatter_px), std::log(kMostScatter_px))) / view.focal_px;
  const Eigen::Isometry3d T_camera_finger = spec_.T_finger_camera.inverse();
  PlateSight sight;
  sight.seen = seen;
  for (std::size_t p = 0; p < kPlates; ++p) {
    const Eigen::Isometry3d T_camera_marker =
        T_camera_finger * moved(spec_.plates[p].T_finger_marker, motion_of(numbers, p));
    for (std::size_t k = 0; k < 4; ++k) {
      const Eigen::Vector3d corner = T_camera_marker * marker_corner(spec_.marker_size_mm, k);
      const Eigen::Vector2d noise(random.normal(), random.normal());
      sight.rays[p][k] = corner.head<2>() / corner.z() + scatter * noise;
    }
  }
  const PlateEstimator::Numbers found = view.estimator.estimate(sight, numbers.cast<double>(), kSteps);
  numbers = found.cast<float>();
  return view.estimator.noise(sight, found);
}

}  // namespace finsight::host
