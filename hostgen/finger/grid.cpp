// The finger's parts are ranges of cells: a closed front wall, two posts at the back edges, a base ring, a cap, and per
// plate a crossbeam (both sides and the back) with the bar that carries the plate. The sides between them stay open.
#include "hostgen/finger/grid.h"

#include <algorithm>
#include <cmath>
#include <sstream>

#include "firmware/input_error.h"

namespace finsight::host {

namespace {

// Where parts are closer than this, TetGen fills the gap with slivers or aborts.
constexpr double kSmallestGapMm = 0.5;

Taper plus(Taper a, double offset_mm) { return {a.at_base_mm + offset_mm, a.slope}; }
Taper times(Taper a, double factor) { return {a.at_base_mm * factor, a.slope * factor}; }
Taper between(Taper a, Taper b, double share) {
  return {a.at_base_mm + share * (b.at_base_mm - a.at_base_mm), a.slope + share * (b.slope - a.slope)};
}

Taper inner_half_width(const FingerSpec& s) { return plus(s.half_width, -s.side_wall_mm); }
Taper inner_front(const FingerSpec& s) { return plus(s.front_z, s.front_wall_mm); }
Taper inner_back(const FingerSpec& s) { return plus(s.back_z, -s.back_wall_mm); }

/// The fractions at which plates begin and end, with both walls, ascending and without repetition.
std::vector<double> all_fractions(const FingerSpec& spec, std::array<double, 2> PlateSpec::*range, double first) {
  std::vector<double> fractions = {first, 1.0};
  for (const PlateSpec& plate : spec.plates) {
    fractions.insert(fractions.end(), (plate.*range).begin(), (plate.*range).end());
  }
  std::sort(fractions.begin(), fractions.end());
  fractions.erase(std::unique(fractions.begin(), fractions.end()), fractions.end());
  return fractions;
}

int position(const std::vector<double>& sorted, double value) {
  return static_cast<int>(std::lower_bound(sorted.begin(), sorted.end(), value) - sorted.begin());
}

/// Level planes from the base up: base ring, then per plate (low first) its lower face and its beam, then the cap.
std::vector<double> levels_mm(const FingerSpec& spec) {
  std::vector<double> levels = {0, spec.base_ring_mm};
  for (int plate = kPlates - 1; plate >= 0; --plate) {
    const double beam_y_mm = spec.plates[plate].beam_y_mm;
    levels.push_back(plate_bottom_mm(spec, plate));
    levels.push_back(beam_y_mm - spec.beam_mm / 2);
    levels.push_back(beam_y_mm + spec.beam_mm / 2);
  }
  levels.push_back(spec.height_mm - spec.top_mm);
  levels.push_back(spec.height_mm);
  return levels;
}

std::string mm_text(double value) {
  std::ostringstream text;
  text << value << " mm";
  return text.str();
}

void require(bool holds, const FingerSpec& spec, const std::string& field, const std::string& found,
             const std::string& expected) {
  if (!holds) throw InputError(spec.file.string(), field, found, expected);
}

void check_walls(const FingerSpec& spec) {
  // Widths and depths are linear in y, so the base and the underside of the cap bound everything between them.
  const double cap_y_mm = spec.height_mm - spec.top_mm;
  for (const double y_mm : {0.0, cap_y_mm, spec.height_mm}) {
    const std::string at = " at y = " + mm_text(y_mm);
    const double depth_mm = spec.back_z.at(y_mm) - spec.front_z.at(y_mm);
    require(depth_mm > kSmallestGapMm, spec, "shape.back_z", "a body " + mm_text(depth_mm) + " deep" + at,
            "the back behind the front at every height");
    require(spec.half_width.at(y_mm) > kSmallestGapMm, spec, "shape.half_width", mm_text(spec.half_width.at(y_mm)) + at,
            "a finger with a width at every height");
    if (y_mm > cap_y_mm) continue;  // inside the cap there is no hollow
    require(inner_back_mm(spec, y_mm) - inner_front_mm(spec, y_mm) > kSmallestGapMm, spec,
            "shape.front_wall_mm + back_wall_mm",
            mm_text(spec.front_wall_mm + spec.back_wall_mm) + " in a body " + mm_text(depth_mm) + " deep" + at,
            "walls thinner than the body, so that front and back do not cross");
    require(inner_half_width_mm(spec, y_mm) > kSmallestGapMm, spec, "shape.side_wall_mm",
            mm_text(spec.side_wall_mm) + " in a half width of " + mm_text(spec.half_width.at(y_mm)) + at,
            "side walls thinner than the half width");
  }
}

void check_levels(const FingerSpec& spec) {
  static constexpr std::array kNames = {"the base",        "the base ring's top",       "the low plate",
                                        "the low beam",    "the low beam's top",        "the middle plate",
                                        "the middle beam", "the middle beam's top",     "the top plate",
                                        "the top beam",    "the top beam's upper side", "the cap",
                                        "the tip"};
  const std::vector<double> levels = levels_mm(spec);
  for (std::size_t i = 1; i < levels.size(); ++i) {
    require(levels[i] - levels[i - 1] >= kSmallestGapMm, spec, "shape",
            std::string(kNames[i]) + " at y = " + mm_text(levels[i]) + " and " + kNames[i - 1] + " at " +
                mm_text(levels[i - 1]),
            "parts in the order base, low, middle, top plate, cap with gaps of at least " + mm_text(kSmallestGapMm));
  }
}

/// A plate's end must touch its wall or leave a gap that can be meshed.
void check_gap(const FingerSpec& spec, const std::string& field, double fraction, double gap_mm) {
  std::ostringstream found;
  found << fraction << " (" << gap_mm << " mm from the wall)";
  require(gap_mm == 0 || gap_mm >= kSmallestGapMm, spec, field, found.str(),
          "an end at the wall or at least " + mm_text(kSmallestGapMm) + " away from it");
}

void check_plate(const FingerSpec& spec, int plate) {
  const PlateSpec& p = spec.plates[plate];
  const std::string name = std::string("plates.") + kPlateNames[plate];
  const double y_mm = plate_bottom_mm(spec, plate);
  const double half_mm = inner_half_width_mm(spec, y_mm);
  const double depth_mm = inner_back_mm(spec, y_mm) - inner_front_mm(spec, y_mm);
  const double needed_mm = spec.marker_size_mm * (1 + 2.0 / 6.0);
  for (const auto& [field, ends, size_mm, first] :
       {std::tuple{name + ".across", p.across, (p.across[1] - p.across[0]) * half_mm, -1.0},
        std::tuple{name + ".deep", p.deep, (p.deep[1] - p.deep[0]) * depth_mm, 0.0}}) {
    require(ends[0] >= first && ends[1] <= 1 && ends[0] < ends[1], spec, field,
            std::to_string(ends[0]) + " to " + std::to_string(ends[1]), "an ascending range inside the finger");
    require(size_mm >= needed_mm, spec, field, "a plate of " + mm_text(size_mm),
            "at least " + mm_text(needed_mm) + " for the marker and its white border");
  }
  check_gap(spec, name + ".across", p.across[0], (p.across[0] + 1) * half_mm);
  check_gap(spec, name + ".across", p.across[1], (1 - p.across[1]) * half_mm);
  check_gap(spec, name + ".deep", p.deep[0], p.deep[0] * depth_mm);
  check_gap(spec, name + ".deep", p.deep[1], (1 - p.deep[1]) * depth_mm);
}

}  // namespace

double inner_half_width_mm(const FingerSpec& spec, double y_mm) { return inner_half_width(spec).at(y_mm); }
double inner_front_mm(const FingerSpec& spec, double y_mm) { return inner_front(spec).at(y_mm); }
double inner_back_mm(const FingerSpec& spec, double y_mm) { return inner_back(spec).at(y_mm); }
double plate_bottom_mm(const FingerSpec& spec, int plate) {
  return spec.plates[plate].beam_y_mm - spec.beam_mm / 2 - spec.plate_mm;
}

std::size_t FingerGrid::index(std::array<int, 3> cell) const {
  return static_cast<std::size_t>((cell[2] * cells(1) + cell[1]) * cells(0) + cell[0]);
}

int FingerGrid::label(std::array<int, 3> cell) const {
  for (int axis = 0; axis < 3; ++axis) {
    if (cell[axis] < 0 || cell[axis] >= cells(axis)) return kAir;
  }
  return labels[index(cell)];
}

Eigen::Vector3d FingerGrid::point(std::array<int, 3> corner) const {
  const double y_mm = lines[1][corner[1]].at_base_mm;
  return {lines[0][corner[0]].at(y_mm), y_mm, lines[2][corner[2]].at(y_mm)};
}

Eigen::Vector3d FingerGrid::middle(std::array<int, 3> cell) const {
  Eigen::Vector3d sum = Eigen::Vector3d::Zero();
  for (int corner = 0; corner < 8; ++corner) {
    sum += point({cell[0] + (corner & 1), cell[1] + (corner >> 1 & 1), cell[2] + (corner >> 2)});
  }
  return sum / 8;
}

std::string FingerGrid::part_name(std::array<int, 3> cell) const {
  const int value = label(cell);
  if (value >= kFirstPlate) return std::string("the ") + kPlateNames[value - kFirstPlate] + " plate";
  if (cell[1] == 0) return "the base ring";
  if (cell[1] == cells(1) - 1) return "the cap";
  if (cell[2] == 0) return "the front wall";
  for (int plate = 0; plate < kPlates; ++plate) {
    if (cell[1] == plate_level[plate] + 1) return std::string("the ") + kPlateNames[plate] + " crossbeam";
  }
  return "a post at the back";
}

FingerGrid make_grid(const FingerSpec& spec) {
  const std::vector<double> across = all_fractions(spec, &PlateSpec::across, -1);
  const std::vector<double> deep = all_fractions(spec, &PlateSpec::deep, 0);
  FingerGrid grid;
  grid.lines[0].push_back(times(spec.half_width, -1));
  for (const double fraction : across) grid.lines[0].push_back(times(inner_half_width(spec), fraction));
  grid.lines[0].push_back(spec.half_width);
  for (const double level : levels_mm(spec)) grid.lines[1].push_back({level, 0});
  grid.lines[2].push_back(spec.front_z);
  for (const double fraction : deep) grid.lines[2].push_back(between(inner_front(spec), inner_back(spec), fraction));
  grid.lines[2].push_back(spec.back_z);

  const int nx = grid.cells(0), ny = grid.cells(1), nz = grid.cells(2);
  grid.labels.assign(static_cast<std::size_t>(nx * ny * nz), kAir);
  using Range = std::array<int, 2>;  // first cell, one past the last
  const auto fill = [&](Range x, Range y, Range z, int label) {
    for (int k = z[0]; k < z[1]; ++k)
      for (int j = y[0]; j < y[1]; ++j)
        for (int i = x[0]; i < x[1]; ++i) grid.at({i, j, k}) = label;
  };
  const Range left = {0, 1}, right = {nx - 1, nx}, width = {0, nx}, height = {0, ny};
  const Range front = {0, 1}, back = {nz - 1, nz}, depth = {0, nz};
  const auto ring = [&](Range level) {
    fill(left, level, depth, kBody);
    fill(right, level, depth, kBody);
    fill(width, level, back, kBody);
  };
  fill(width, height, front, kBody);
  fill(left, height, back, kBody);
  fill(right, height, back, kBody);
  ring({0, 1});
  fill(width, {ny - 1, ny}, depth, kBody);
  for (int plate = 0; plate < kPlates; ++plate) {
    const PlateSpec& p = spec.plates[plate];
    const int level = 2 + 3 * (kPlates - 1 - plate);
    const Range beam = {level + 1, level + 2};
    const Range x = {1 + position(across, p.across[0]), 1 + position(across, p.across[1])};
    const Range z = {1 + position(deep, p.deep[0]), 1 + position(deep, p.deep[1])};
    const bool at_a_side = p.across[0] == -1 || p.across[1] == 1;
    ring(beam);
    fill(x, beam, at_a_side ? z : Range{1, nz - 1}, kBody);
    fill(x, {level, level + 1}, z, kFirstPlate + plate);
    grid.plate_level[plate] = level;
  }
  return grid;
}

void check_shape(const FingerSpec& spec) {
  check_walls(spec);
  check_levels(spec);
  for (int plate = 0; plate < kPlates; ++plate) check_plate(spec, plate);
}

}  // namespace finsight::host
