// The camera's lens: pinhole with Brown-Conrady distortion, OpenCV's convention (pixel centres at whole numbers).
#pragma once

#include <Eigen/Core>

namespace finsight {

/// Pinhole with Brown-Conrady distortion, for one image size. From the board file or from the session.
struct CameraModel {
  int width_px = 0, height_px = 0;
  float fx = 0, fy = 0, cx = 0, cy = 0;  ///< pixels
  float k1 = 0, k2 = 0, p1 = 0, p2 = 0, k3 = 0;
};

/// Throws InputError (file "camera", with field, found and expected) for a size outside 16 ... 8192 pixels, focal
/// lengths that are not positive, a principal point outside the image, and anything that is not finite.
void check_camera(const CameraModel& camera);

/// Where a direction of sight meets the image, and how the pixel moves with it.
struct Projection {
  Eigen::Vector2d pixel;
  Eigen::Matrix2d slope;  ///< d pixel / d ray
};
/// `ray` is (X / Z, Y / Z) of a point in the camera frame.
Projection project_ray(const CameraModel& camera, const Eigen::Vector2d& ray);

/// Direction of sight -> pixel.
Eigen::Vector2d pixel_from_ray(const CameraModel& camera, const Eigen::Vector2d& ray);

/// Pixel -> direction of sight, to 1e-6 pixels. Not-a-number where the lens model folds over and has no inverse, which
/// happens beyond the corners of the image that it was calibrated for.
Eigen::Vector2d ray_from_pixel(const CameraModel& camera, const Eigen::Vector2d& pixel);

}  // namespace finsight
