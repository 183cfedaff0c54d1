// Draws what a camera sees of the calibration board: mean over the pixel's area, blur, noise. The map from pixels to
// the board is exact at the pixels' corners and bilinear between them.
#pragma once

#include <Eigen/Geometry>
#include <vector>

#include "firmware/calibrate/board_view.h"
#include "firmware/geometry/lens.h"

namespace finsight::test {

Lens calibrated_camera();

class BoardPainter {
 public:
  explicit BoardPainter(const Lens& camera, const CharucoBoard& board = {});

  /// T_camera_board in squares.
  GreyImage paint(const Eigen::Isometry3d& T_camera_board, std::uint64_t seed, double blur_px = 0.7,
                  double noise = 1.5) const;

 private:
  double tone(const Eigen::Vector2d& at) const;

  double mean_grey(const Eigen::Vector2d& a, const Eigen::Vector2d& b, const Eigen::Vector2d& c,
                   const Eigen::Vector2d& d) const;

  GreyImage develop(std::vector<double> grey, std::uint64_t seed, double blur_px, double noise) const;

  void blur(std::vector<double>& grey, double sigma_px, bool level) const;

  Lens camera_;
  GreyImage modules_;
  std::vector<Eigen::Vector2d> rays_;
};

/// The board with its middle seen at a share of the image (0 ... 1 each way), `depth` squares away; positive tilts
/// bring its lower and its right side nearer.
Eigen::Isometry3d board_at(const Lens& camera, double across, double down, double lower_deg, double right_deg,
                           double depth = 13, double roll_deg = 0);

/// Fifteen views as someone takes them who follows the advice: all of the image, tilted to all sides.
std::vector<Eigen::Isometry3d> good_views(const Lens& camera);

}  // namespace finsight::test
