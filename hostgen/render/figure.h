// One frame as a figure: the camera's image with the markers found in it, and beside it the reconstructed finger with
// its touch.
#pragma once

#include <vector>

#include "firmware/model/model.h"
#include "firmware/vision/image_view.h"

namespace finsight::host {

/// What the stages made of one frame. A copy, because the stages own what they return.
struct FrameResult {
  std::vector<std::uint8_t> grey;  ///< [height, width]
  int width_px = 0, height_px = 0;
  MarkerCorners corners;
  std::vector<float> node_mm;  ///< [3 * nodes], where the mesh is now
  Touch touch;
};

struct ColourImage {
  int width_px = 0, height_px = 0;
  std::vector<std::uint8_t> rgb;  ///< [height, width, 3]
};

inline constexpr int kFigureWidth_px = 1200, kFigureHeight_px = 510;

/// On the left the camera's image, scaled to fit a width of 600 pixels and the figure's height, with the outlines and
/// ids of the markers found. On the right the surface of the mesh, coloured by displacement, in front of its shadow at
/// rest; where the touch is valid, its point with the circle that holds 68 % of the errors, and the force as an arrow.
/// The same input gives the same pixels.
ColourImage draw_figure(const ShapeModel& mesh, const std::array<int, kPlates>& marker_id, const FrameResult& frame);

}  // namespace finsight::host
