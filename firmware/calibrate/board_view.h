// Images of the calibration board as views, each used or rejected with the reason.
#pragma once

#include <Eigen/Geometry>
#include <string>
#include <vector>

#include "firmware/calibrate/charuco_board.h"

namespace finsight {

/// One image of the board.
struct BoardView {
  std::string name;  ///< file, and frame in it
  int width_px = 0, height_px = 0;
  BoardSight sight;
  std::string rejected;  ///< why; empty: it is used
  // Once calibrated, of those that are used:
  Eigen::Isometry3d T_camera_board = Eigen::Isometry3d::Identity();  ///< in squares
  std::vector<Vec2f> residual_px;                                    ///< of each corner: seen minus model
  double rms_px = 0;
};

/// What `finder` sees in an image.
BoardView view_of(const std::string& name, const ImageView& image, BoardFinder& finder);

/// Rejects unusable views, each with its reason: no board or another one, too few corners, blur, another image
/// size than most have, and views that repeat an earlier one. Keeps at most kMaxViews.
void reject_bad_views(const CharucoBoard& board, std::vector<BoardView>& views);
inline constexpr int kMaxViews = 60;  ///< more only cost time, which grows with their third power
inline constexpr int kMinCorners = 12;

/// Those that are not rejected.
std::vector<BoardView*> used_views(std::vector<BoardView>& views);

}  // namespace finsight
