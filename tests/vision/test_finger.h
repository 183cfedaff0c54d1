// A finger for the tests of vision: three plates above a camera, and a Gaussian over their joint motion.
#pragma once

#include <Eigen/Geometry>
#include <vector>

#include "firmware/geometry/lens.h"
#include "firmware/geometry/so3.h"
#include "firmware/model/model.h"
#include "tests/random.h"
#include "tests/vision/marker_painter.h"

namespace finsight::test {

using PoseVectord = PoseVectorOf<double>;

inline Lens camera_1280x720() { return {1280, 720, 736.05, 735.90, 615.63, 365.71, -0.3956, 0.2259, 0, 0, -0.0912}; }
inline Lens camera_640x480() { return {640, 480, 490.70, 490.60, 303.59, 243.64, -0.3956, 0.2259, 0, 0, -0.0912}; }

/// The camera looks up along finger y from below the base; the markers look down at it, upright in its image.
inline MountModel test_mount() {
  MountModel mount;
  mount.T_finger_camera = Eigen::Isometry3f::Identity();
  mount.T_finger_camera.linear() << 1, 0, 0, 0, 0, 1, 0, -1, 0;
  mount.T_finger_camera.translation() << 0, -22, 2;
  const Vec3f centres[] = {{0, 88.5F, 1.7F}, {13.4F, 62.5F, 1}, {-16.4F, 34.5F, 0}};
  for (std::size_t p = 0; p < kPlates; ++p) {
    mount.T_finger_marker[p] = Eigen::Isometry3f::Identity();
    mount.T_finger_marker[p].linear() << 1, 0, 0, 0, 0, -1, 0, 1, 0;
    mount.T_finger_marker[p].translation() = centres[p];
  }
  mount.marker_id = {7, 23, 41};
  mount.marker_size_mm = 8;
  return mount;
}

/// Four modes of motion (bend, second bend, sideways, twist) of independent normal sizes, plus scatter of 0.1 mm and
/// 0.3 degrees.
struct TestPrior {
  TestPrior() {
    const double height[] = {0.75, 0.52, 0.29};  // of the finger
    for (int p = 0; p < kPlates; ++p) {
      const double y = height[p];
      ways.col(0).segment<6>(6 * p) << 0, -0.6 * y, 9 * y * y, 0.16 * y, 0, 0;
      ways.col(1).segment<6>(6 * p) << 0, -0.3 * y, 6 * y * (0.8 - y), 0.10 * (0.8 - 2 * y), 0, 0;
      ways.col(2).segment<6>(6 * p) << 2.5 * y * y, 0, 0, 0, 0, -0.05 * y;
      ways.col(3).segment<6>(6 * p) << 0.3 * y, 0, 0.4 * y, 0, 0.12 * y, 0;
      mean_.segment<6>(6 * p) << 0, -0.3F * static_cast<float>(y), 4 * static_cast<float>(y * y),
          0.08F * static_cast<float>(y), 0, 0;
      scatter.segment<6>(6 * p) << 0.1, 0.1, 0.1, 0.005, 0.005, 0.005;
    }
    Eigen::Matrix<double, kPoseDims, kPoseDims> covariance = ways * ways.transpose();
    covariance.diagonal() += scatter.cwiseAbs2();
    covariance_ = covariance.cast<float>();
  }
  PlatePrior view() const { return {{mean_.data(), kPoseDims}, {covariance_.data(), kPoseDims * kPoseDims}, noise_}; }

  /// A motion drawn from the prior, with or without the scatter. Without it, `size` 0 gives the mean.
  PoseVectord draw(Random& random, double size = 1) const {
    PoseVectord numbers = mean_.cast<double>();
    for (int way = 0; way < 4; ++way) numbers += size * random.normal() * ways.col(way);
    for (int i = 0; i < kPoseDims; ++i) numbers[i] += size * random.normal() * scatter[i];
    return numbers;
  }

  Eigen::Matrix<double, kPoseDims, 4> ways;
  PoseVectord scatter;

 private:
  const std::vector<float> noise_ = std::vector<float>(kPoseDims, 0.01f);
  PoseVector mean_;
  Eigen::Matrix<float, kPoseDims, kPoseDims> covariance_;
};

inline std::array<PlateMotion, kPlates> plate_motions(const PoseVectord& numbers) {
  std::array<PlateMotion, kPlates> plates;
  for (std::size_t p = 0; p < kPlates; ++p) {
    plates[p].displacement_mm = numbers.segment<3>(6 * static_cast<int>(p)).cast<float>();
    plates[p].rotation_rad = numbers.segment<3>(6 * static_cast<int>(p) + 3).cast<float>();
  }
  return plates;
}

/// Pose of a plate's marker in the camera frame, straight from the definition of PlateMotion.
inline PaintedMarker moved_marker(const MountModel& mount, const PlateMotion& motion, std::size_t plate) {
  Eigen::Isometry3d T_finger_marker = mount.T_finger_marker[plate].cast<double>();
  T_finger_marker.translation() += motion.displacement_mm.cast<double>();
  T_finger_marker.linear() = so3_exp(motion.rotation_rad.cast<double>()) * T_finger_marker.linear();
  return {mount.marker_id[plate], mount.marker_size_mm,
          mount.T_finger_camera.cast<double>().inverse() * T_finger_marker};
}

inline MarkerCorners corners_of(const MountModel& mount, const Lens& camera,
                                const std::array<PlateMotion, kPlates>& plates) {
  MarkerCorners corners;
  for (std::size_t p = 0; p < kPlates; ++p) {
    corners.corners_px[p] = true_corners(camera, moved_marker(mount, plates[p], p));
    corners.seen[p] = true;
  }
  return corners;
}

inline std::vector<std::uint8_t> paint_plates(const MountModel& mount, const Lens& camera,
                                              const std::array<PlateMotion, kPlates>& plates, const Paint& paint,
                                              std::uint64_t seed) {
  Image image(camera, paint);
  for (std::size_t p = 0; p < kPlates; ++p) image.add(moved_marker(mount, plates[p], p));
  return image.develop(seed);
}

inline Frame frame_of(const Lens& camera, const std::vector<std::uint8_t>& grey) {
  Frame frame;
  frame.grey = grey.data();
  frame.width_px = camera.width_px;
  frame.height_px = camera.height_px;
  frame.stride_bytes = camera.width_px;
  return frame;
}

/// Angle between the true and the estimated normal of a plate's marker.
inline double tilt_error_rad(const MountModel& mount, const PlateMotion& truth, const PlateMotion& found,
                             std::size_t plate) {
  const Eigen::Vector3d a = moved_marker(mount, truth, plate).T_camera_marker.linear().col(2);
  const Eigen::Vector3d b = moved_marker(mount, found, plate).T_camera_marker.linear().col(2);
  return std::atan2(a.cross(b).norm(), a.dot(b));
}

}  // namespace finsight::test
