// The finger as a sheared grid: planes x = a + b y and z = a + b y, level planes y = const, and one label per cell.
// Whatever is built from it is watertight, because neighbours share their corners.
#pragma once

#include <Eigen/Core>
#include <array>
#include <string>
#include <vector>

#include "hostgen/finger/spec.h"

namespace finsight::host {

/// Labels of cells: 0 is air, then region + 1 (1 body, 2 + plate index).
inline constexpr int kAir = 0;
inline constexpr int kBody = 1;
inline constexpr int kFirstPlate = 2;

struct FingerGrid {
  std::array<std::vector<Taper>, 3> lines;  ///< planes of each axis, ascending; y's have slope 0
  std::vector<int> labels;                  ///< of cell (i, j, k), x fastest
  std::array<int, kPlates> plate_level;     ///< layer of cells in y that holds the plate; its beam is the next one up

  int cells(int axis) const { return static_cast<int>(lines[axis].size()) - 1; }
  /// Air outside the grid.
  int label(std::array<int, 3> cell) const;
  int& at(std::array<int, 3> cell) { return labels[index(cell)]; }
  /// Grid point (i, j, k), mm.
  Eigen::Vector3d point(std::array<int, 3> corner) const;
  /// Middle of a cell, mm.
  Eigen::Vector3d middle(std::array<int, 3> cell) const;
  /// What a filled cell is part of, in words: "the low crossbeam".
  std::string part_name(std::array<int, 3> cell) const;

 private:
  std::size_t index(std::array<int, 3> cell) const;
};

/// Inner half width, and both ends of the inner depth, at height y: what a plate's fractions refer to.
double inner_half_width_mm(const FingerSpec& spec, double y_mm);
double inner_front_mm(const FingerSpec& spec, double y_mm);
double inner_back_mm(const FingerSpec& spec, double y_mm);
/// Height of a plate's lower face.
double plate_bottom_mm(const FingerSpec& spec, int plate);

/// Sets where the plates' markers are at rest. read_finger_spec() does it; call it again after changing a length.
/// Plates lie level: marker x = finger x, y = finger z, z = finger -y (down, towards the camera).
void place_markers(FingerSpec& spec);

/// Expects a spec that check_shape() has accepted.
FingerGrid make_grid(const FingerSpec& spec);

/// Throws InputError with the reason if walls, levels, plates or markers do not fit into the finger.
void check_shape(const FingerSpec& spec);

}  // namespace finsight::host
