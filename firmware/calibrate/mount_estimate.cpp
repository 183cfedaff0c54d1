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
constexpr double kPrintShare = 0.01;  // how well a print's size is made

constexpr int kPlaces = 1 + kPlates, kPrint = 6 * kPlaces, kNumbers = kPrint + 1, kCoordinates = 8 * kPlates;
using Numbers = Eigen::Matrix<double, kNumbers, 1>;  // per place: shift, rotation vector; in the finger frame; print
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
      Eigen::Matrix<double, kPoseDims, 1>::Zero(), kPrintShare;
  for (int p = 1; p < kPlaces; ++p) {
    sigma.segment<3>(6 * p).setConstant(kMarkerMm);
    sigma.segment<3>(6 * p + 3).setConstant(kMarkerRad);
  }
  return sigma;
}

/// Distances of the corners from where the numbers put them, pixels.
Eigen::Matrix<double, kCoordinates, 1> distances_px(const MountModel& nominal, const RestingCorners& seen,
                                                    const Numbers& x) {
  Eigen::Matrix<double, kCoordinates, 1> distances;
  const Isometry3d T_camera_finger = moved(nominal.T_finger_camera.cast<double>(), x.head<6>()).inverse();
  const double size_mm = (1 + x[kPrint]) * static_cast<double>(nominal.marker_size_mm);
  for (int p = 0; p < kPlates; ++p) {
    const auto plate = static_cast<std::size_t>(p);
    const Isometry3d T_camera_marker =
        T_camera_finger * moved(nominal.T_finger_marker[plate].cast<double>(), x.segment<6>(6 * (p + 1)));
    for (std::size_t k = 0; k < 4; ++k) {
      const Eigen::Vector3d at = T_camera_marker * marker_corner(size_mm, k);
      distances.segment<2>(8 * p + 2 * static_cast<int>(k)) =
          pixel_from_ray(seen.lens, at.head<2>() / at.z()) - seen.corner_px[plate][k];
    }
  }
  return distances;
}

/// The distances, then the numbers themselves; each in units of its scatter.
Residuals residuals(const MountModel& nominal, const RestingCorners& seen, const Numbers& x) {
  Residuals r;
  r << distances_px(nominal, seen, x) / kCornerSigmaPx, x.cwiseQuotient(mounted_to());
  return r;
}

/// Of squared residuals; less than one for corners that lie far off.
Residuals weights(const Residuals& r) {
  Residuals weight = Residuals::Ones();
  for (int corner = 0; corner < kCoordinates / 2; ++corner) {
    weight.segment<2>(2 * corner).setConstant(corner_weight(r.segment<2>(2 * corner).squaredNorm()));
  }
  return weight;
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
  constexpr int kSquareSteps = 4;  // converge quadratically, to 1e-9; from then on the weights change a little
  constexpr int kSteps = 12;
  constexpr double kDifference = 1e-5;  // mm and rad; the residuals' rounding is 1e-12 of them
  Numbers x = Numbers::Zero();
  Eigen::Matrix<double, kNumbers, kNumbers> information;
  for (int step = 0; step < kSteps; ++step) {
    Eigen::Matrix<double, kCoordinates + kNumbers, kNumbers> jacobian;
    for (int i = 0; i < kNumbers; ++i) {
      const Numbers by = kDifference * Numbers::Unit(i);
      jacobian.col(i) = (residuals(nominal, seen, x + by) - residuals(nominal, seen, x - by)) / (2 * kDifference);
    }
    const Residuals off = residuals(nominal, seen, x);
    const Residuals weight = step < kSquareSteps ? Residuals(Residuals::Ones()) : weights(off);
    information = jacobian.transpose() * weight.asDiagonal() * jacobian;
    x -= information.llt().solve(jacobian.transpose() * weight.asDiagonal() * off);
  }
  MountEstimate estimate;
  estimate.rms_px = std::sqrt(distances_px(nominal, seen, x).squaredNorm() / (4 * kPlates));
  if (!(estimate.rms_px <= kLargestPx)) {
    throw InputError(name, "markers' corners", std::to_string(estimate.rms_px) + " pixels from any mount",
                     "at most " + std::to_string(kLargestPx) + "; is it the lens, the marker size, the finger?");
  }
  const Numbers sigma = information.inverse().diagonal().cwiseSqrt();
  estimate.change = Eigen::Matrix<double, kPrint, 1>(x.head<kPrint>()).reshaped(6, kPlaces);
  estimate.sigma = Eigen::Matrix<double, kPrint, 1>(sigma.head<kPrint>()).reshaped(6, kPlaces);
  estimate.print = x[kPrint];
  estimate.print_sigma = sigma[kPrint];
  estimate.mount.where = name;
  estimate.mount.T_finger_camera = moved(nominal.T_finger_camera.cast<double>(), estimate.change.col(0));
  const Eigen::Vector3d camera = estimate.mount.T_finger_camera.translation();
  for (std::size_t p = 0; p < kPlates; ++p) {
    Isometry3d& marker = estimate.mount.T_finger_marker[p];
    marker = moved(nominal.T_finger_marker[p].cast<double>(), estimate.change.col(1 + static_cast<int>(p)));
    marker.translation() = camera + (marker.translation() - camera) / (1 + estimate.print);
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
  const Eigen::Matrix<double, 6, kPlaces> off =
      estimate.change.cwiseQuotient(mounted_to().head<kPrint>().reshaped(6, kPlaces));
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
  if (std::abs(estimate.print) > kUsual * kPrintShare) {
    text += "warning: markers are rarely printed in so wrong a size: is marker_size_mm the spec's?\n";
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
  char line[128];
  std::snprintf(line, sizeof line, "%-28s %11.2f %% of the spec's size; std. dev. %.2f %%\n", "print of the markers",
                100 * (1 + estimate.print), 100 * estimate.print_sigma);
  text += line;
  std::snprintf(line, sizeof line, "corners are %.3f pixels from that (RMS)\n", estimate.rms_px);
  return text + line + mounting_warnings(estimate);
}

}  // namespace finsight
