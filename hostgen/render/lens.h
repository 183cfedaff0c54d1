// From rays to pixels and back, for one camera.
#pragma once

#include <optional>

#include "firmware/geometry/lens.h"
#include "hostgen/finger/spec.h"

namespace finsight::host {

/// Pinhole with Brown-Conrady distortion (OpenCV's convention). Strong polynomials turn back at some radius: rays
/// beyond it have no pixel, and pixels beyond its image have no ray.
class Lens {
 public:
  explicit Lens(const CameraIntrinsics& camera);
  /// Where the ray (x / z, y / z) of the camera frame meets the image, in pixels.
  std::optional<Eigen::Vector2d> pixel(const Eigen::Vector2d& ray) const;
  /// The ray that meets the image at `pixel`, exact to 1e-9.
  std::optional<Eigen::Vector2d> ray(const Eigen::Vector2d& pixel) const;

 private:
  CameraIntrinsics camera_;
  double max_radius_sq_;  // of rays, where the polynomial turns back
};

/// The same camera for the firmware's stages.
CameraModel camera_model(const CameraIntrinsics& camera);

}  // namespace finsight::host
