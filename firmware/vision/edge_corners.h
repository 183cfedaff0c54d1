// A marker's corners to a few hundredths of a pixel: a straight line through each of its four edges, cut with the next.
#pragma once

#include <array>
#include <optional>

#include "firmware/geometry/lens.h"
#include "firmware/types.h"
#include "firmware/vision/image_view.h"

namespace finsight {

/// How well the edges of a marker could be followed.
struct EdgeQuality {
  float scatter_px = 0;  ///< standard deviation of a corner along each axis, from how its edges' points scatter
  float blur_px = 0;     ///< standard deviation of the blur across the edges
};

/// Moves coarse corners (good to half a module, which is a sixth of a side) of a black square on white to where its
/// edges cross. Lines are fitted where the lens's distortion is taken away, because there they are straight; corners
/// come back in distorted pixels. An edge in glare is found where the glare's curvature does not move it; one whose
/// paper is brighter than the picture can show, by how far the light rises at the marker's others. Clockwise order.
/// Nothing, with `corners_px` unchanged, if an edge cannot be followed over half its length, is not straight, or a
/// corner ends up elsewhere. About 60 us for an edge of 50 pixels; never allocates.
std::optional<EdgeQuality> refine_corners(const ImageView& image, const Lens& camera, std::array<Vec2f, 4>& corners_px);

}  // namespace finsight
