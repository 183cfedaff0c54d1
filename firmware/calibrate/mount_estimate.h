// Where camera and markers really are, from where the camera sees the markers of a finger at rest.
#pragma once

#include <Eigen/Core>
#include <array>
#include <numbers>
#include <string>

#include "firmware/geometry/lens.h"
#include "firmware/settings/measured_mount.h"

namespace finsight {

/// How well parts are made, as standard deviations: a camera held by its screws, a marker glued to a moulded plate.
inline constexpr double kCameraMm = 2, kCameraRad = 3 * std::numbers::pi / 180, kMarkerMm = 0.3,
                        kMarkerRad = 2 * std::numbers::pi / 180;

/// Mean corners of the three markers over a session, [plate][corner], pixels.
struct RestingCorners {
  Lens lens;  ///< of the pictures
  std::array<std::array<Eigen::Vector2d, 4>, kPlates> corner_px;
  int frames = 0;
};

/// Adds up the corners of pictures in which all three markers are seen.
class RestingCornersSum {
 public:
  void add(const MarkerCorners& corners);
  int frames() const { return frames_; }
  /// Throws InputError (`name` stands for the pictures) if fewer than ten show all three markers, or if one moves.
  RestingCorners mean(const Lens& lens, const std::string& name) const;

 private:
  struct Corner {
    Eigen::Vector2d sum = Eigen::Vector2d::Zero(), first = Eigen::Vector2d::Zero();
    double squares = 0;
  };
  std::array<std::array<Corner, 4>, kPlates> corners_;
  std::array<int, kPlates> seen_{};
  int frames_ = 0;
};

struct MountEstimate {
  /// A marker that was printed too small is put as much further away, where one of the nominal size looks the same.
  MeasuredMount mount;
  /// Camera, then top, middle and low marker: shift (mm) and rotation vector (rad) away from the nominal place, in the
  /// finger frame, and their standard deviations. [6, 4]
  Eigen::Matrix<double, 6, 1 + kPlates> change, sigma;
  double print = 0, print_sigma = 0;  ///< by how much all markers are larger than the nominal size, relative
  double rms_px = 0;                  ///< distance of the corners from the estimate
};

/// The most probable poses of the camera and the three markers. The markers are seen from the camera only, so a common
/// motion of all cannot be told from the camera's: what fits together is put down to the camera (mounted to 2 mm and 3
/// degrees) or the print's size (1 %), the rest to the markers (to 0.3 mm and 2 degrees). Gauss-Newton on 25 numbers;
/// corners further off than three times their scatter weigh less. Throws InputError (`name`
/// stands for the file) for corners that no such mount explains to half a pixel.
MountEstimate estimate_mount(const MountModel& nominal, const RestingCorners& seen, const std::string& name);

/// A table for people, with a warning for each part that is further off than three standard deviations of how parts are
/// mounted.
std::string mount_text(const MountEstimate& estimate);

}  // namespace finsight
