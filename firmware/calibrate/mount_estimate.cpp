#include "firmware/calibrate/mount_estimate.h"

#include <Eigen/Cholesky>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <numbers>

#include "firmware/geometry/so3.h"
#include "firmware/input_error.h"
#include "firmware/vision/ippe.h"
#include "firmware/vision/plate_estimator.h"

namespace finsight {

namespace {

using Eigen::Isometry3d;
using Eigen::Vector2d;

constexpr int kMinFrames = 10;
constexpr double kStillPx = 0.5;    // scatter of a corner: noise makes a tenth of that, the lightest touch more
constexpr double kLargestPx = 0.5;  // from the estimate: more is another lens, marker size or finger
constexpr double kDegPerRad = 180 / std::numbers::pi;
// How well parts are mounted: a camera by its screws, a marker glued to a moulded plate.
constexpr double kCameraMm = 2, kCameraRad = 3 / kDegPerRad, kMarkerMm = 0.3, kMarkerRad = 1 / kDegPerRad;

constexpr int kPlaces = 1 + kPlates, kNumbers = 6 * kPlaces, kCoordinates = 8 * kPlates;
using Numbers = Eigen::Matrix<double, kNumbers, 1>;  // per place: shift, rotation vector; in the finger frame
using Residuals = Eigen::Matrix<double, kCoordinates + kNumbers, 1>;

Isometry3d moved(const Isometry3d& pose, const Eigen::Matrix<double, 6, 1>& by) {
  Isometry3d now = pose;
  now.translation() += by.head<3>();
  now.linear() = so3_exp(Eigen::Vector3d(by.tail<3>())) * pose.linear();
  return now;
}

Numbers mounted_to() {
  Numbers sigma;
  sigma << Eigen::Vector3d::Constant(kCameraMm), Eigen::Vector3d::Constant(kCameraRad),
      Numbers::Zero().tail<kPoseDims>();
  for (int p = 1; p < kPlaces; ++p) {
    sigma.segment<3>(6 * p).setConstant(kMarkerMm);
    sigma.segment<3>(6 * p + 3).setConstant(kMarkerRad);
  }
  return sigma;
}

/// Distances of the corners from where the numbers put them, then the numbers themselves; each in units of its scatter.
Residuals residuals(const MountModel& nominal, const RestingCorners& seen, const Numbers& x) {
  Residuals r;
  const Isometry3d T_camera_finger = moved(nominal.T_finger_camera.cast<double>(), x.head<6>()).inverse();
  for (int p = 0; p < kPlates; ++p) {
    const auto plate = static_cast<std::size_t>(p);
    const Isometry3d T_camera_marker =
        T_camera_finger * moved(nominal.T_finger_marker[plate].cast<double>(), x.segment<6>(6 * (p + 1)));
    for (std::size_t k = 0; k < 4; ++k) {
      const Eigen::Vector3d at = T_camera_marker * marker_corner(static_cast<double>(nominal.marker_size_mm), k);
      const Vector2d off = pixel_from_ray(seen.lens, at.head<2>() / at.z()) - seen.corner_px[plate][k];
      r.segment<2>(8 * p + 2 * static_cast<int>(k)) = off / kCornerSigmaPx;
    }
  }
  r.tail<kNumbers>() = x.cwiseQuotient(mounted_to());
  return r;
}

}  // namespace

void RestingCornersSum::add(const MarkerCorners& corners) {
  for (std::size_t p = 0; p < kPlates; ++p) seen_[p] += corners.seen[p];
  if (!corners.seen[0] || !corners.seen[1] || !corners.seen[2]) return;
  for (std::size_t p = 0; p < kPlates; ++p) {
    for (std::size_t k = 0; k < 4; ++k) {
      Corner& corner = corners_[p][k];
      const Vector2d at = corners.corners_px[p][k].cast<double>();
      if (frames_ == 0) corner.first = at;
      corner.sum += at - corner.first;
      corner.squares += (at - corner.first).squaredNorm();
    }
  }
  ++frames_;
}

RestingCorners RestingCornersSum::mean(const Lens& lens, const std::string& name) const {
  if (frames_ < kMinFrames) {
    throw InputError(name, "frames that show all three markers",
                     std::to_string(frames_) + " (top " + std::to_string(seen_[kTopPlate]) + ", middle " +
                         std::to_string(seen_[kMiddlePlate]) + ", low " + std::to_string(seen_[kLowPlate]) + ")",
                     std::to_string(kMinFrames) + " or more");
  }
  RestingCorners rest{.lens = lens, .corner_px = {}, .frames = frames_};
  for (std::size_t p = 0; p < kPlates; ++p) {
    for (std::size_t k = 0; k < 4; ++k) {
      const Corner& corner = corners_[p][k];
      const Vector2d mean = corner.sum / frames_;
      const double scatter_px = std::sqrt(std::max(0.0, corner.squares / frames_ - mean.squaredNorm()));
      if (scatter_px > kStillPx) {
        throw InputError(name, std::string(kPlateNames[p]) + " plate",
                         "a marker that moves by " + std::to_string(scatter_px) + " pixels",
                         "a finger at rest: nothing touches it and nothing moves");
      }
      rest.corner_px[p][k] = corner.first + mean;
    }
  }
  return rest;
}

MountEstimate estimate_mount(const MountModel& nominal, const RestingCorners& seen, const std::string& name) {
  constexpr int kSteps = 10;            // it converges quadratically: to 1e-9 in four
  constexpr double kDifference = 1e-5;  // mm and rad; the residuals' rounding is 1e-12 of them
  Numbers x = Numbers::Zero();
  Eigen::Matrix<double, kNumbers, kNumbers> information;
  for (int step = 0; step < kSteps; ++step) {
    Eigen::Matrix<double, kCoordinates + kNumbers, kNumbers> jacobian;
    for (int i = 0; i < kNumbers; ++i) {
      const Numbers by = kDifference * Numbers::Unit(i);
      jacobian.col(i) = (residuals(nominal, seen, x + by) - residuals(nominal, seen, x - by)) / (2 * kDifference);
    }
    information = jacobian.transpose() * jacobian;
    x -= information.llt().solve(jacobian.transpose() * residuals(nominal, seen, x));
  }
  MountEstimate estimate;
  const Residuals left = residuals(nominal, seen, x);
  estimate.rms_px = kCornerSigmaPx * std::sqrt(left.head<kCoordinates>().squaredNorm() / (4 * kPlates));
  if (!(estimate.rms_px <= kLargestPx)) {
    throw InputError(name, "markers' corners", std::to_string(estimate.rms_px) + " pixels from any mount",
                     "at most " + std::to_string(kLargestPx) + "; is it the lens, the marker size, the finger?");
  }
  estimate.change = x.reshaped(6, kPlaces);
  estimate.sigma = information.inverse().diagonal().cwiseSqrt().reshaped(6, kPlaces);
  estimate.mount.where = name;
  estimate.mount.T_finger_camera = moved(nominal.T_finger_camera.cast<double>(), estimate.change.col(0));
  for (std::size_t p = 0; p < kPlates; ++p) {
    estimate.mount.T_finger_marker[p] =
        moved(nominal.T_finger_marker[p].cast<double>(), estimate.change.col(1 + static_cast<int>(p)));
  }
  corrected_mount(nominal, estimate.mount);  // throws what the firmware would refuse
  return estimate;
}

namespace {

std::string place_name(int place) {
  return place == 0 ? "camera" : std::string(kPlateNames[static_cast<std::size_t>(place - 1)]) + " marker";
}

/// Warns of offsets that explain the corners but are larger than parts are usually mounted.
std::string mounting_warnings(const MountEstimate& estimate) {
  constexpr double kUsual = 3;  // standard deviations
  const Eigen::Matrix<double, 6, kPlaces> off = estimate.change.cwiseQuotient(mounted_to().reshaped(6, kPlaces));
  std::string text;
  for (int place = 0; place < kPlaces; ++place) {
    const double most = off.col(place).cwiseAbs().maxCoeff();
    if (most <= kUsual) continue;
    char line[160];
    std::snprintf(line, sizeof line,
                  "warning: the %s is %.1f times further off than parts are usually mounted: is the "
                  "finger touched, or is it another spec's?\n",
                  place_name(place).c_str(), most);
    text += line;
  }
  return text;
}

}  // namespace

std::string mount_text(const MountEstimate& estimate) {
  std::string text = "away from the spec           shift, mm: x       y       z     rotation, deg: x       y       z\n";
  for (int place = 0; place < kPlaces; ++place) {
    for (const bool of_sigma : {false, true}) {
      const Eigen::Matrix<double, 6, 1> v = of_sigma ? estimate.sigma.col(place) : estimate.change.col(place);
      char line[160];
      std::snprintf(line, sizeof line, "%-28s %11.2f %7.2f %7.2f   %13.2f %7.2f %7.2f\n",
                    of_sigma ? "  std. dev." : place_name(place).c_str(), v[0], v[1], v[2], kDegPerRad * v[3],
                    kDegPerRad * v[4], kDegPerRad * v[5]);
      text += line;
    }
  }
  char line[96];
  std::snprintf(line, sizeof line, "corners are %.3f pixels from that (RMS)\n", estimate.rms_px);
  return text + line + mounting_warnings(estimate);
}

}  // namespace finsight
