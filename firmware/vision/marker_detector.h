// Squares with a code of DICT_4X4_50 in an image, the same with every OpenCV, in bounded time.
#pragma once

#include <array>
#include <memory>
#include <vector>

#include "firmware/types.h"
#include "firmware/vision/image_view.h"

namespace finsight {

struct FoundMarker {
  int id = 0;
  std::array<Vec2f, 4> corners_px;  ///< clockwise from the marker's own top left corner; good to about `shrink` pixels
};

/// Sides of a marker in the image, in pixels: squares outside these limits are ignored.
struct SideLimits {
  float smallest_px = 0, largest_px = 0;
};

/// Bounds on the work of a search, whatever the image shows. Edges are neighbouring pixels that differ in the
/// thresholded image: 640x480 have 5,000 with three markers, 70,000 in preset worst, and up to 300,000 with noise.
struct SearchLimits {
  int noisy_edges = 40'000;  ///< with more the image is smoothed before it is searched
  int edges = 60'000;        ///< with more, even smoothed, it is not searched
  int squares = 128;         ///< whose codes are read, the largest first; a finger has about 10
};

/// OpenCV's own detector is not used: its time grows with the square of the candidates, and versions differ in what
/// they find. This one is its way (S. Garrido-Jurado et al., Automatic generation and detection of highly reliable
/// fiducial markers under occlusion, 2014) from OpenCV's parts.
class MarkerDetector {
 public:
  /// Keeps OpenCV to the calling thread and its messages off stderr, for the whole process.
  explicit MarkerDetector(const SearchLimits& limits = {});
  ~MarkerDetector();
  MarkerDetector(MarkerDetector&&) noexcept;
  MarkerDetector& operator=(MarkerDetector&&) noexcept;

  /// Searches `image`, reduced `shrink` times each way (1 searches it as it is), for markers whose code is read
  /// without a single wrong bit. A marker whose square is found by several thresholds is listed once; the same id at
  /// two places is listed twice. Allocates, as OpenCV does. Whatever OpenCV objects to gives an empty list. The list is
  /// valid until the next call.
  const std::vector<FoundMarker>& find(const ImageView& image, int shrink, const SideLimits& sides);

  /// Whether a square whose corners are known to a tenth of a module, clockwise from the marker's own top left, shows
  /// the marker `id`: read at full size, a code that blur or a coarse corner falsified is another one. Allocates, as
  /// OpenCV does.
  bool confirm(const ImageView& image, const std::array<Vec2f, 4>& corners_px, int id) const;

  /// The same for a marker that reflections may hide in part: what is brighter than its paper tells nothing. Up to five
  /// of the sixteen modules and half of the border may be hidden; all others must be right.
  bool confirm_partly(const ImageView& image, const std::array<Vec2f, 4>& corners_px, int id) const;

  /// Squares whose codes the last find() read; at most limits.squares.
  int squares_read() const { return squares_read_; }

 private:
  struct Workspace;
  void search(const ImageView& image, int shrink, const SideLimits& sides);

  SearchLimits limits_;
  std::unique_ptr<Workspace> workspace_;
  std::vector<FoundMarker> found_;
  int squares_read_ = 0;
};

}  // namespace finsight
