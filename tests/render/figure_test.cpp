#include "hostgen/render/figure.h"

#include <doctest/doctest.h>

#include <algorithm>

using namespace finsight;
using namespace finsight::host;

namespace {

/// One tetrahedron the size of a finger; its face at z = 0 is the touched one.
struct Pyramid {
  std::vector<float> rest_mm = {-20, 0, 0, 20, 0, 0, 0, 100, 0, 0, 20, 30};
  std::vector<std::int32_t> tet_nodes = {0, 2, 1, 3}, front_nodes = {0, 1, 2};
  ShapeModel mesh() const {
    ShapeModel mesh;
    mesh.nodes = 4;
    mesh.tets = 1;
    mesh.rest_mm = rest_mm;
    mesh.tet_nodes = tet_nodes;
    mesh.front_nodes = front_nodes;
    return mesh;
  }
};

constexpr std::array<int, kPlates> kIds = {0, 1, 2};

FrameResult touched_frame(const Pyramid& pyramid) {
  FrameResult frame;
  frame.grey.assign(300 * 200, 50);
  frame.width_px = 300;
  frame.height_px = 200;
  frame.corners.seen[kTopPlate] = true;
  frame.corners.corners_px[kTopPlate] = {Vec2f(100, 50), Vec2f(140, 50), Vec2f(140, 90), Vec2f(100, 90)};
  frame.node_mm = pyramid.rest_mm;
  frame.node_mm[8] += 10;  // the tip bends away
  frame.touch = {.point_mm = {0, 40, 0}, .contact_mm = {0, 40, 4}, .radius_68_mm = 5, .force_n = 4};
  frame.touch.quality = Quality::kFresh;
  return frame;
}

/// How many pixels of a box have clearly more of one colour (0 red, 1 green, 2 blue) than of the others.
long coloured(const ColourImage& image, int channel, int first_x, int last_x) {
  long count = 0;
  for (int y = 0; y < image.height_px; ++y) {
    for (int x = first_x; x < last_x; ++x) {
      const std::uint8_t* pixel = &image.rgb[3 * (static_cast<std::size_t>(y) * kFigureWidth_px + x)];
      const int others = std::max(pixel[(channel + 1) % 3], pixel[(channel + 2) % 3]);
      count += pixel[channel] > others + 80;
    }
  }
  return count;
}

constexpr int kRed = 0, kGreen = 1;

}  // namespace

TEST_CASE("figure: the outline of a found marker lies on its corners") {
  const Pyramid pyramid;
  const ColourImage figure = draw_figure(pyramid.mesh(), kIds, touched_frame(pyramid));
  REQUIRE(figure.width_px == kFigureWidth_px);
  REQUIRE(figure.height_px == kFigureHeight_px);
  for (const auto& [x, y] : {std::pair{201, 101}, {281, 101}, {281, 181}, {201, 181}}) {  // twice as large as the image
    const std::uint8_t* pixel = &figure.rgb[3 * (static_cast<std::size_t>(y) * kFigureWidth_px + x)];
    CHECK(pixel[1] > pixel[0] + 80);
  }
  FrameResult unseen = touched_frame(pyramid);
  unseen.corners.seen[kTopPlate] = false;
  CHECK(coloured(draw_figure(pyramid.mesh(), kIds, unseen), kGreen, 0, 600) == 0);
}

TEST_CASE("figure: only a valid touch is drawn, and a stronger one has a longer arrow") {
  const Pyramid pyramid;
  FrameResult frame = touched_frame(pyramid);
  const long weak = coloured(draw_figure(pyramid.mesh(), kIds, frame), kRed, 600, 1000);
  frame.touch.force_n *= 2;
  CHECK(coloured(draw_figure(pyramid.mesh(), kIds, frame), kRed, 600, 1000) > weak + 50);
  frame.touch.quality = Quality::kInvalid;
  CHECK(coloured(draw_figure(pyramid.mesh(), kIds, frame), kRed, 600, 1000) == 0);
}
