#include "hostgen/hard_cases/motions.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <numbers>
#include <stdexcept>

#include "firmware/geometry/so3.h"
#include "firmware/shape/newton.h"
#include "hostgen/hard_cases/hard_motions.h"
#include "hostgen/util/common.h"

namespace finsight::host {

PlatePoses bent_plates(const MountModel& mount, double bend_mm, double sideways_mm, double twist_rad) {
  constexpr double kTip_mm = 110;  // height that the tip values refer to
  using Eigen::AngleAxisd;
  using Eigen::Vector3d;
  PlatePoses poses;
  for (std::size_t p = 0; p < kPlates; ++p) {
    const Vector3d c = mount.T_finger_marker[p].translation().cast<double>();
    const double s = c.y() / kTip_mm;
    const Vector3d axis_point(0, c.y(), 0);
    const AngleAxisd twist(twist_rad * s, Vector3d::UnitY());
    // Displacement grows with s^2, so the slope is 2 s times the tip's; the bent line gets shorter along y.
    const Eigen::Matrix3d R = (twist * AngleAxisd(2 * bend_mm * s / kTip_mm, Vector3d::UnitX()) *
                               AngleAxisd(-2 * sideways_mm * s / kTip_mm, Vector3d::UnitZ()))
                                  .toRotationMatrix();
    const double shortening_mm = 0.6 * (bend_mm * bend_mm + sideways_mm * sideways_mm) * s * s * s / kTip_mm;
    const Vector3d d =
        twist * (c - axis_point) + axis_point - c + Vector3d(sideways_mm * s * s, -shortening_mm, bend_mm * s * s);
    poses.plates[p].displacement_mm = d.cast<float>();
    poses.plates[p].rotation_rad = so3_log(R).cast<float>();
    poses.seen[p] = true;
  }
  poses.quality = Quality::kFresh;
  return poses;
}

PlateMotionPath bend_and_return(const MountModel& mount, const std::string& name, double bend_mm, double sideways_mm,
                                double twist_rad, double speed) {
  constexpr double kFramesPerSecond = 60, kSpeed_mm_s = 25, kTurn_rad_s = 0.65;
  const double seconds = std::max({std::abs(bend_mm) / kSpeed_mm_s, std::abs(sideways_mm) / kSpeed_mm_s,
                                   std::abs(twist_rad) / kTurn_rad_s}) /
                         speed;
  const int steps = std::max(4, static_cast<int>(std::ceil(seconds * kFramesPerSecond)));
  PlateMotionPath path{name, {}};
  for (int k = 0; k <= 2 * steps; ++k) {
    const double a = k <= steps ? double(k) / steps : 2.0 - double(k) / steps;
    const double eased = a * a * (3 - 2 * a);
    path.frames.push_back(bent_plates(mount, bend_mm * eased, sideways_mm * eased, twist_rad * eased));
  }
  return path;
}

std::vector<PlateMotionPath> report_motions(const MountModel& mount) {
  constexpr double kTwist_rad = std::numbers::pi / 4;
  return {bend_and_return(mount, "bend 10 mm", 10, 0, 0, 1),
          bend_and_return(mount, "bend 30 mm + twist 45 deg", 30, 0, kTwist_rad, 1),
          bend_and_return(mount, "the same, 4 times as fast", 30, 0, kTwist_rad, 4),
          {"bend 15 mm + twist 20 deg, noisy", HardMotion(mount).bend({15, 0, 20}).bend({}).noise(1).frames}};
}

Shapes converged_shapes(const ShapeModel& model, const MountModel& mount, const PlateMotionPath& motion) {
  constexpr double kTolerance_mm = 1e-6;
  constexpr int kMaxSteps = 200;
  NewtonSolver<double> solver(model, mount);
  Shapes shapes;
  for (const PlatePoses& poses : motion.frames) {
    if (interrupted()) throw Interrupted();
    if (!solver.converge(poses, kTolerance_mm, kMaxSteps).ok) {
      throw std::runtime_error(motion.name + ": frame " + std::to_string(shapes.size()) + " does not converge");
    }
    shapes.emplace_back(solver.node_mm().begin(), solver.node_mm().end());
  }
  return shapes;
}

}  // namespace finsight::host
