#include "hostgen/finger/jig_holes.h"

#include <algorithm>

#include "hostgen/finger/plate_geometry.h"

namespace finsight::host {

namespace {

constexpr int kRows = 3;
constexpr double kTowardsSide = 2.0 / 3;  // of the half width

double half_width_mm(const FingerSpec& spec, double y_mm) { return spec.half_width.at(y_mm) - spec.touch_edge_mm; }

std::vector<double> row_heights_mm(const FingerSpec& spec) {
  const auto [lowest, highest] = spec.touch_y_mm;
  const int rows = std::clamp(static_cast<int>((highest - lowest) / kJigRowSpacingMm), 1, kRows);
  std::vector<double> heights;
  for (int row = 0; row < rows; ++row) heights.push_back(lowest + (highest - lowest) * (row + 0.5) / rows);
  return heights;
}

}  // namespace

std::vector<JigHole> jig_holes(const FingerSpec& spec) {
  const std::vector<double> heights = row_heights_mm(spec);
  const auto side_mm = [&](double y_mm) { return kTowardsSide * half_width_mm(spec, y_mm); };
  const bool three_columns = std::ranges::all_of(heights, [&](double y_mm) { return side_mm(y_mm) >= kJigSpacingMm; });
  std::vector<JigHole> holes;
  Eigen::Vector3d inward = Eigen::Vector3d::Zero();
  for (const double y_mm : heights) {
    for (const int column : {-1, 0, 1}) {
      if (column != 0 && !three_columns) continue;
      const FrontPoint at = front_point(spec, column * side_mm(y_mm), y_mm);
      inward += at.inward;
      holes.push_back({.number = static_cast<int>(holes.size()) + 1, .contact_mm = at.at_mm});
    }
  }
  for (JigHole& hole : holes) hole.inward = inward.normalized();
  return holes;
}

}  // namespace finsight::host
