// A folder of images of the calibration board -> views, each used or rejected with the reason.
#pragma once

#include <Eigen/Geometry>
#include <filesystem>
#include <string>
#include <vector>

#include "hostgen/calibrate/charuco_board.h"

namespace finsight::host {

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

/// The .png, .pgm and .y4m files of a folder, by name. Throws InputError for a folder that is not there or holds none.
std::vector<std::filesystem::path> image_files(const std::filesystem::path& folder);

/// Looks for the board in every .png, .pgm and .y4m of the folder, in the order of their names; of a y4m in one frame
/// of `every`. Files that cannot be read are rejected views. Shows progress. Throws InputError like image_files().
std::vector<BoardView> read_board_views(const std::filesystem::path& folder, const CharucoBoard& board, int every);

/// Rejects unusable views, each with its reason: no board or another one, too few corners, blur, another image
/// size than most have, and views that repeat an earlier one. Keeps at most kMaxViews.
void reject_bad_views(const CharucoBoard& board, std::vector<BoardView>& views);
inline constexpr int kMaxViews = 60;  ///< more only cost time, which grows with their third power
inline constexpr int kMinCorners = 12;

/// Those that are not rejected.
std::vector<BoardView*> used_views(std::vector<BoardView>& views);

}  // namespace finsight::host
