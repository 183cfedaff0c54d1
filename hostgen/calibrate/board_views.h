// A folder of images of the calibration board -> views.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "firmware/calibrate/board_view.h"

namespace finsight::host {

/// The .png, .pgm and .y4m files of a folder, by name. Throws InputError for a folder that is not there or holds none.
std::vector<std::filesystem::path> image_files(const std::filesystem::path& folder);

/// Looks for the board in every .png, .pgm and .y4m of the folder, in the order of their names; of a y4m in one frame
/// of `every`. Files that cannot be read are rejected views. Shows progress. Throws InputError like image_files().
std::vector<BoardView> read_board_views(const std::filesystem::path& folder, const CharucoBoard& board, int every);

}  // namespace finsight::host
