// A depth buffer over triangles that were split until they are small: a lens that bends straight lines then hardly
// matters within one.
#include "hostgen/first_spec/camera_picture.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include "firmware/vision/aruco_compat.h"

namespace finsight::host {

namespace {

using Eigen::Vector2d;
using Eigen::Vector3d;

constexpr double kPiece_mm = 4;
constexpr double kNearest_mm = 1;

class Picture {
 public:
  Picture(const Eigen::Isometry3d& T_finger_camera, const Lens& lens)
      : T_camera_finger_(T_finger_camera.inverse()),
        lens_(lens),
        radius_sq_(turning_radius_sq(lens)),
        grey_(static_cast<std::size_t>(lens.width_px) * static_cast<std::size_t>(lens.height_px), 0),
        depth_(grey_.size(), std::numeric_limits<double>::infinity()) {}

  /// A part of the finger in one tone, finger frame.
  void add(const std::array<Vector3d, 3>& corner, double tone) {
    const double longest =
        std::max({(corner[1] - corner[0]).norm(), (corner[2] - corner[1]).norm(), (corner[0] - corner[2]).norm()});
    if (longest > kPiece_mm) {
      std::array<Vector3d, 3> turned = corner;  // the longest edge first
      while ((turned[1] - turned[0]).norm() < longest) std::rotate(turned.begin(), turned.begin() + 1, turned.end());
      const Vector3d middle = 0.5 * (turned[0] + turned[1]);
      add({turned[0], middle, turned[2]}, tone);
      add({middle, turned[1], turned[2]}, tone);
      return;
    }
    fill(corner, tone);
  }
  const std::vector<std::uint8_t>& grey() const { return grey_; }

 private:
  void fill(const std::array<Vector3d, 3>& corner, double tone) {
    std::array<Vector2d, 3> pixel;
    std::array<double, 3> far{};
    for (std::size_t i = 0; i < 3; ++i) {
      const Vector3d at = T_camera_finger_ * corner[i];
      if (at.z() < kNearest_mm) return;
      const Vector2d ray = at.head<2>() / at.z();
      if (ray.squaredNorm() >= radius_sq_) return;
      pixel[i] = pixel_from_ray(lens_, ray);
      far[i] = at.z();
    }
    const Vector2d low = pixel[0].cwiseMin(pixel[1]).cwiseMin(pixel[2]),
                   high = pixel[0].cwiseMax(pixel[1]).cwiseMax(pixel[2]);
    const Vector2d ab = pixel[1] - pixel[0], ac = pixel[2] - pixel[0];
    const double area = ab.x() * ac.y() - ab.y() * ac.x();
    if (area == 0) return;
    for (int y = std::max(0, static_cast<int>(std::ceil(low.y())));
         y <= std::min<double>(lens_.height_px - 1, high.y()); ++y) {
      for (int x = std::max(0, static_cast<int>(std::ceil(low.x())));
           x <= std::min<double>(lens_.width_px - 1, high.x()); ++x) {
        const Vector2d ap = Vector2d(x, y) - pixel[0];
        const double b = (ap.x() * ac.y() - ap.y() * ac.x()) / area, c = (ab.x() * ap.y() - ab.y() * ap.x()) / area;
        if (b < 0 || c < 0 || b + c > 1) continue;
        const double here = (1 - b - c) * far[0] + b * far[1] + c * far[2];
        const auto place =
            static_cast<std::size_t>(y) * static_cast<std::size_t>(lens_.width_px) + static_cast<std::size_t>(x);
        if (here >= depth_[place]) continue;
        depth_[place] = here;
        grey_[place] = static_cast<std::uint8_t>(std::clamp(tone, 0.0, 255.0));
      }
    }
  }

  const Eigen::Isometry3d T_camera_finger_;
  const Lens lens_;
  const double radius_sq_;
  std::vector<std::uint8_t> grey_;
  std::vector<double> depth_;
};

/// The marker a hair's breadth below its plate, module by module with one module of white around it.
void add_marker(Picture& picture, const PicturedMarker& marker) {
  constexpr double kBelow_mm = 0.05, kWhite = 235, kBlack = 20;
  const std::array<std::uint8_t, 36> modules = marker_modules(marker.id);
  const double module_mm = marker.size_mm / 6;
  for (int row = -1; row <= 6; ++row) {
    for (int column = -1; column <= 6; ++column) {
      const bool border = row < 0 || row > 5 || column < 0 || column > 5;
      const double tone = border || modules[static_cast<std::size_t>(6 * row + column)] ? kWhite : kBlack;
      const auto corner = [&](int u, int v) -> Vector3d {
        return marker.T_finger_marker * Vector3d((column + u - 3) * module_mm, (row + v - 3) * module_mm, kBelow_mm);
      };
      picture.add({corner(0, 0), corner(1, 0), corner(1, 1)}, tone);
      picture.add({corner(0, 0), corner(1, 1), corner(0, 1)}, tone);
    }
  }
}

}  // namespace

std::vector<std::uint8_t> camera_picture(const TriangleSurface& surface, const std::vector<PicturedMarker>& markers,
                                         const Eigen::Isometry3d& T_finger_camera, const Lens& lens) {
  constexpr double kAmbient = 35, kLamp = 120;
  Picture picture(T_finger_camera, lens);
  for (std::size_t t = 0; t < surface.triangle.size(); ++t) {
    const Vector3d towards = (T_finger_camera.translation() - surface.middle(t)).normalized();
    const double facing = std::abs(surface.twice_area(t).normalized().dot(towards));
    picture.add(surface.corners(t), kAmbient + kLamp * facing);
  }
  for (const PicturedMarker& marker : markers) add_marker(picture, marker);
  return picture.grey();
}

}  // namespace finsight::host
