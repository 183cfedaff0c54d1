// Views of the calibration board -> the camera's lens, and which further views would improve it.
#pragma once

#include <array>
#include <functional>
#include <string>
#include <vector>

#include "firmware/calibrate/board_view.h"
#include "firmware/geometry/lens.h"

namespace finsight {

struct LensCalibration {
  Lens lens;
  LensNumbers sigma{};  ///< standard deviation of each of its numbers
  double rms_px = 0;    ///< distance of corners from the model
  std::size_t views = 0, corners = 0;
};

inline constexpr std::size_t kMinViews = 6;

/// Pinhole and Brown-Conrady by cv::calibrateCamera (Zhang, "A flexible new technique for camera calibration", 2000),
/// from the views that are not rejected. Outlying corners and views are left out.
/// Fills in the views' poses and residuals. Throws InputError (`name` stands for the file) if fewer than kMinViews
/// are left or they do not determine a lens.
/// `between` is called between the steps, each of which may take seconds, and may throw to end them.
LensCalibration calibrate_lens(
    const CharucoBoard& board, std::vector<BoardView>& views, const std::string& name,
    const std::function<void()>& between = [] {});

/// What a board file's key `lens` names (firmware/ports/session.h, read_lens()), with comments. `source`: of the
/// images.
std::string lens_file(const LensCalibration& calibration, const std::string& source);
/// The lens alone, in the same form; and what was written so. Throws InputError naming `name`, the key and what is
/// wrong, also for another size of images.
std::string lens_text(const Lens& lens);
Lens read_lens_text(const std::string& text, const std::string& name, int width_px, int height_px);

/// How well the views cover the image and the tilts.
struct Coverage {
  std::array<int, 9> views{};        ///< by ninth of the image, row by row: views with three corners or more there
  std::array<int, 4> tilted{};       ///< views whose left, right, upper, lower side is nearer, by kTiltDeg or more
  std::vector<std::string> no_lens;  ///< corners of the image for which the model has no line of sight
};
inline constexpr double kTiltDeg = 12;
Coverage coverage_of(const LensCalibration& calibration, std::vector<BoardView>& views);

/// Which further views to record, in words; empty if nothing is missing.
std::vector<std::string> advice(const Coverage& coverage);

}  // namespace finsight
