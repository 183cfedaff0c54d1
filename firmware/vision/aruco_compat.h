// The dictionary of markers, from OpenCV 4.6 (Debian 12, module aruco) or 4.10 (Debian 13, module objdetect).
#pragma once

#include <array>
#include <cstdint>

namespace finsight {

/// How many markers DICT_4X4_50 has; ids run from 0.
inline constexpr int kDictionaryMarkers = 50;

/// The 6x6 modules of a marker of DICT_4X4_50 with its black border, row by row from the top left, 1 = white. Throws
/// std::invalid_argument for an id that the dictionary does not have.
std::array<std::uint8_t, 36> marker_modules(int id);

}  // namespace finsight
