// OpenCV's marker detector, the same for OpenCV 4.6 (Debian 12, module aruco) and 4.10 (Debian 13, module objdetect).
#pragma once

#include <array>
#include <memory>
#include <vector>

#include "firmware/types.h"
#include "firmware/vision/grey_view.h"

namespace finsight {

struct FoundMarker {
  int id = 0;
  std::array<Vec2f, 4> corners_px;  ///< clockwise from the marker's own top left corner; good to about `shrink` pixels
};

/// Sides of a marker in the picture, in pixels: squares outside these limits are not looked at.
struct SideLimits {
  float smallest_px = 0, largest_px = 0;
};

/// Finds markers of DICT_4X4_50 whose code is read without a single wrong bit.
class MarkerDetector {
 public:
  /// Keeps OpenCV to the calling thread and its messages off stderr, for the whole process.
  MarkerDetector();
  ~MarkerDetector();
  MarkerDetector(MarkerDetector&&) noexcept;
  MarkerDetector& operator=(MarkerDetector&&) noexcept;

  /// Searches `picture`, reduced `shrink` times each way (1 searches it as it is). A marker whose square is found by
  /// several thresholds is listed once; the same id at two places is listed twice. Allocates, as OpenCV does. Whatever
  /// OpenCV objects to gives an empty list. The list is valid until the next call.
  const std::vector<FoundMarker>& find(const GreyView& picture, int shrink, const SideLimits& sides);

 private:
  struct OpenCv;
  std::unique_ptr<OpenCv> opencv_;
  std::vector<FoundMarker> found_;
};

/// How many markers DICT_4X4_50 has; ids run from 0.
inline constexpr int kDictionaryMarkers = 50;

/// The 6x6 modules of a marker of DICT_4X4_50 with its black border, row by row from the top left, 1 = white. For
/// renderers. Throws std::invalid_argument for an id that the dictionary does not have.
std::array<std::uint8_t, 36> marker_modules(int id);

}  // namespace finsight
