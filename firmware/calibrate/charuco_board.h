// The calibration board: a ChArUco board as OpenCV defines it. How it looks, and where its corners are in an image.
#pragma once

#include <climits>
#include <string>
#include <vector>

#include "firmware/calibrate/grey_image.h"
#include "firmware/types.h"
#include "firmware/vision/marker_detector.h"

namespace finsight {

/// A chessboard whose white squares hold the markers 0, 1, ... of DICT_4X4_50, row by row, three quarters of the square
/// wide. The number of rows is odd: for even ones OpenCV changed the pattern after version 4.6.
/// Board frame: origin at the top left of the outermost square, x right, y down, z into the board; in squares.
struct CharucoBoard {
  int columns = 10, rows = 7;  ///< squares
  static constexpr int kModulesPerSquare = 8;

  /// Throws InputError for boards that cannot be: 3 ... 33 squares each way, odd rows, at most 50 markers.
  void check() const;
  int corners_per_row() const { return columns - 1; }
  int corners() const { return (columns - 1) * (rows - 1); }
  /// Of inner corner `id` (row by row from the top left), in squares.
  Eigen::Vector2d corner(int id) const { return {1 + id % corners_per_row(), 1 + id / corners_per_row()}; }
  static bool is_white(int column, int row) { return (column + row) % 2 != 0; }
  /// Of the marker in a white square.
  int marker(int column, int row) const { return (row * columns + column) / 2; }
  /// One pixel per module, 8 modules per square, and a white margin of half a square.
  GreyImage modules() const;
};

/// The board for a printer, with squares of exactly this size on paper.
std::string board_svg(const CharucoBoard& board, double square_mm);

/// What is seen of a board in one image.
struct BoardSight {
  std::vector<int> id;           ///< of inner corners
  std::vector<Vec2f> corner_px;  ///< of each
  int markers = 0;               ///< that were read, whether they are where the board has them or not
  int meetings = 0;              ///< inner corners whose two markers were read
  double square_px = 0;          ///< median side of the squares
  double edge_px = 0;            ///< median width of the squares' edges, upright or level ones, whichever are wider
};

class BoardFinder {
 public:
  explicit BoardFinder(const CharucoBoard& board);
  /// Finds the inner corners for which both adjacent markers predict the same place, refined to a tenth of a pixel.
  ///
  /// OpenCV has such a finder too. In Debian 12's version (4.6) its corners are off by (0.48, 0.48) pixels,
  /// which would shift the principal point by half a pixel; without that shift they scatter by 0.11 pixels RMS instead
  /// of 0.08, and in blurred images (sigma 1.5 pixels) it finds 537 corners instead of 725 in 23 views. See the test
  /// that compares both.
  BoardSight find(const ImageView& image);

 private:
  CharucoBoard board_;
  MarkerDetector detector_{{.noisy_edges = INT_MAX,
                            .edges = INT_MAX,
                            .squares = 4096}};  // a board is full of squares, and time does not matter here
};

}  // namespace finsight
