// Presents a calibration: tables, the TOML for board files, a plot.
#pragma once

#include <filesystem>
#include <string>

#include "firmware/calibrate/lens_calibration.h"

namespace finsight::host {

/// One line per image: corners, width of the edges, distance from the model, and whether it was used or why not.
std::string view_table(const std::vector<BoardView>& views);

/// The numbers with their standard deviations, the coverage, and the advice.
std::string calibration_text(const LensCalibration& calibration, const Coverage& coverage);

/// All corners in the image and how far they are from the model, `kPlotScale` times as long. Throws
/// std::runtime_error without gnuplot.
void plot_calibration(const LensCalibration& calibration, const std::vector<BoardView>& views,
                      const std::filesystem::path& svg);
inline constexpr int kPlotScale = 200;

}  // namespace finsight::host
