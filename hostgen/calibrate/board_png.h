// The calibration board as a picture for a printer.
#pragma once

#include <string>

#include "firmware/calibrate/charuco_board.h"

namespace finsight::host {

/// About 600 dots per inch, a whole number of them per module.
std::string board_png(const CharucoBoard& board, double square_mm);

}  // namespace finsight::host
