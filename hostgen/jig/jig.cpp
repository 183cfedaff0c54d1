// The jig is a bent grid of cells that are filled or not, so that its surface closes by itself. Grid lines i run along
// x, j along y, k along z. Across (i): cheek, gap, slab's edge, then seven lines for each column of guides, and the
// same mirrored. Along (j): the clip's two ends, then for each row seven lines for its guides and eleven for their
// numbers. Upwards (k): print bed, the slab's other face, the seat under the finger's base, and the cheeks' hooks.
#include "hostgen/jig/jig.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <map>

#include "firmware/input_error.h"
#include "hostgen/finger/grid.h"
#include "hostgen/finger/surface.h"
#include "hostgen/finger/surface_finger.h"
#include "hostgen/util/common.h"

namespace finsight::host {

namespace {

using Eigen::Vector2d;
using Eigen::Vector3d;

constexpr double kSlab_mm = 12;       // length of the guides: four times the pin's diameter keeps it upright
constexpr double kFaceGap_mm = 4;     // between slab and face
constexpr double kPlay_mm = 0.3;      // of printed parts that fit into each other
constexpr double kCheek_mm = 3;       // thickness
constexpr double kSeat_mm = 4;        // width of what the base rests on, inside each cheek
constexpr double kHook_mm = 1.2;      // how far the cheeks reach behind the base
constexpr double kHookRise_mm = 1.4;  // over which they come there: steeper than 45 degrees
constexpr double kLargestClip_mm = 8;
constexpr double kEdge_mm = 5;       // from the outer guides' axes to the slab's edge
constexpr double kPixel_mm = 0.5;    // half of a groove's width: numbers are 3 by 5 mm
constexpr double kGroove_mm = 0.55;  // depth; more than half the width, so that their roofs are steeper than 45 degrees
constexpr double kNumberGap_mm = 1.2;

constexpr int kAround = 6;      // cells across a guide: its bore has 24 corners
constexpr int kDigitTall = 10;  // cells
constexpr int kOuter = 4;       // grid lines beside the guides on either side: cheek, cheek, seat, slab
constexpr int kUp = 7;          // grid lines: bed, slab, seat, hook, hook's point twice, cheek's end
constexpr int kPerRow = kAround + 1 + kDigitTall + 1;

/// Rows of a digit from the top, three bits each, as in a display of seven bars: no two grooves meet at a corner only.
constexpr std::array<std::array<int, 5>, 10> kDigits = {{{7, 5, 5, 5, 7},
                                                         {1, 1, 1, 1, 1},
                                                         {7, 1, 7, 4, 7},
                                                         {7, 1, 7, 1, 7},
                                                         {5, 5, 7, 1, 1},
                                                         {7, 4, 7, 1, 7},
                                                         {7, 4, 7, 5, 7},
                                                         {7, 1, 1, 1, 1},
                                                         {7, 5, 7, 5, 7},
                                                         {7, 5, 7, 1, 7}}};

/// Guides of one row, in the jig's frame.
struct Row {
  std::vector<Vector3d> at_mm;
  std::vector<int> number;
};

std::vector<Row> rows_of(const JigFit& fit) {
  std::vector<Row> rows;
  double last_y_mm = 0;
  for (const JigHole& hole : fit.holes) {
    const Vector3d at = fit.T_finger_jig.inverse() * hole.contact_mm;
    if (rows.empty() || std::abs(hole.contact_mm.y() - last_y_mm) > 1e-6) rows.push_back({});
    last_y_mm = hole.contact_mm.y();
    rows.back().at_mm.push_back(at);
    rows.back().number.push_back(hole.number);
  }
  return rows;
}

class BentGrid {
 public:
  explicit BentGrid(const JigFit& fit) : fit_(fit), rows_(rows_of(fit)) {}
  TriangleSurface surface() const;

 private:
  using Spot = std::array<int, 3>;
  /// Which row, and the line within its guides or, after those, its number.
  struct Along {
    int row = 0, line = 0;
    bool in_guide() const { return line <= kAround; }
  };

  int columns() const { return static_cast<int>(rows_.front().at_mm.size()); }
  int lines(int axis) const {
    if (axis == 0) return 2 * kOuter + columns() * (kAround + 1);
    return axis == 1 ? 2 + static_cast<int>(rows_.size()) * kPerRow + 1 : kUp;
  }
  static Along along(int j) { return {(j - 2) / kPerRow, (j - 2) % kPerRow}; }
  static int column(int i) { return (i - kOuter) / (kAround + 1); }
  static int across(int i) { return (i - kOuter) % (kAround + 1); }
  bool in_columns(int i) const { return i >= kOuter && i < lines(0) - kOuter; }
  bool in_rows(int j) const { return j >= 2 && j < lines(1) - 1; }

  const Vector3d& guide(int i, int j) const;
  double outer_x_mm(int line, double side, const Vector3d& guide_mm, bool at_base, int k) const;
  double z_mm(int k) const;
  Vector3d point(const Spot& at) const;
  bool bored(int i, int j) const;
  bool grooved(int i, int j) const;
  bool ridge(int i, int j) const;
  bool filled(const Spot& cell) const;
  std::array<Spot, 4> face(const Spot& cell, int axis, int side) const;

  const JigFit& fit_;
  std::vector<Row> rows_;  // ascending y
};

/// The guide whose place a grid line follows: the nearest.
const Vector3d& BentGrid::guide(int i, int j) const {
  const int row = std::clamp(along(std::max(j, 2)).row, 0, static_cast<int>(rows_.size()) - 1);
  const int c = in_columns(i) ? column(i) : (i < kOuter ? 0 : columns() - 1);
  return rows_[static_cast<std::size_t>(row)].at_mm[static_cast<std::size_t>(c)];
}

/// Of the lines beside the guides, from the outermost (0) inwards. Around the base they follow the clip, whose hooks
/// bend the second one; elsewhere they lie evenly between the slab's edge and the guides.
double BentGrid::outer_x_mm(int line, double side, const Vector3d& guide_mm, bool at_base, int k) const {
  constexpr double kGuideHalf_mm = kAround / 2 * kPixel_mm;
  if (!at_base) {
    return guide_mm.x() + side * (kGuideHalf_mm + (kEdge_mm - kGuideHalf_mm) * (kOuter - line) / kOuter);
  }
  const double base_mm = side < 0 ? fit_.left_mm : fit_.right_mm;
  const double hook_mm = k == 4 || k == 5 ? kHook_mm + kPlay_mm : (k == 6 ? -kPlay_mm : 0);
  switch (line) {
    case 0:
      return base_mm + side * (kPlay_mm + kCheek_mm);
    case 1:
      return base_mm + side * (kPlay_mm - hook_mm);
    case 2:
      return base_mm - side * kSeat_mm;
    default:
      return 0.5 * (base_mm - side * kSeat_mm + guide_mm.x() + side * kGuideHalf_mm);
  }
}

double BentGrid::z_mm(int k) const {
  // The hook's slope meets the base's edge, which is the play away from where the slope begins.
  const double hook_mm = fit_.back_z_mm - kHookRise_mm * kPlay_mm / (kHook_mm + kPlay_mm);
  const double over = kHookRise_mm * (1 + kPlay_mm / kHook_mm);
  return std::array{fit_.print_bed_z_mm, fit_.slab_z_mm,       fit_.seat_z_mm,          hook_mm,
                    hook_mm + over,      hook_mm + over + 0.8, hook_mm + over + 0.8 + 3}[static_cast<std::size_t>(k)];
}

Vector3d BentGrid::point(const Spot& at) const {
  const auto [i, j, k] = at;
  const Vector3d& guide_mm = guide(i, j);
  const Along line = along(j);
  Vector3d place(0, 0, z_mm(k));
  if (in_columns(i)) {
    place.x() = guide_mm.x() + (across(i) - kAround / 2) * kPixel_mm;
  } else {
    const bool left = i < kOuter;
    place.x() = outer_x_mm(left ? i : lines(0) - 1 - i, left ? -1 : 1, guide_mm, j < 2, k);
  }
  if (j < 2) {  // on the planes that bound the clip in the finger's frame
    const Eigen::Matrix3d R = fit_.T_finger_jig.linear();
    const double y_mm = fit_.base_y_mm + j * fit_.clip_mm;
    place.y() = (y_mm - R(1, 0) * place.x() - R(1, 2) * place.z()) / R(1, 1);
    return place;
  }
  constexpr double kBore = kJigBoreMm / 2;
  if (!in_rows(j)) {
    place.y() = guide_mm.y() + kBore + kNumberGap_mm + kDigitTall * kPixel_mm + kEdge_mm / 2;
  } else if (!line.in_guide()) {
    place.y() = guide_mm.y() + kBore + kNumberGap_mm + (line.line - kAround - 1) * kPixel_mm;
  } else {
    place.y() = guide_mm.y() + kBore * (line.line - kAround / 2) / (kAround / 2.0);
    if (in_columns(i)) {
      const Vector2d square(across(i) - kAround / 2, line.line - kAround / 2);
      if (square.cwiseAbs().maxCoeff() == kAround / 2)
        place.head<2>() = guide_mm.head<2>() + kBore * square.normalized();
    }
  }
  if (k == 0 && ridge(i, j)) place.z() += kGroove_mm;
  return place;
}

bool BentGrid::bored(int i, int j) const {
  return in_columns(i) && in_rows(j) && across(i) < kAround && along(j).line < kAround;
}

/// Numbers are read from outside, where x points to the left.
bool BentGrid::grooved(int i, int j) const {
  if (!in_columns(i) || !in_rows(j) || across(i) >= kAround) return false;
  const Along line = along(j);
  const int up = line.line - kAround - 1;
  if (up < 0 || up >= kDigitTall) return false;
  const int number = rows_[static_cast<std::size_t>(line.row)].number[static_cast<std::size_t>(column(i))];
  const int bits = kDigits[static_cast<std::size_t>(number % 10)][static_cast<std::size_t>(4 - up / 2)];
  return bits >> (across(i) / 2) & 1;
}

/// Grid points along the middle of a groove, which is two cells wide.
bool BentGrid::ridge(int i, int j) const {
  return grooved(i, j) && grooved(i - 1, j) && grooved(i, j - 1) && grooved(i - 1, j - 1);
}

bool BentGrid::filled(const Spot& cell) const {
  const auto [i, j, k] = cell;
  for (int axis = 0; axis < 3; ++axis) {
    const int at = cell[static_cast<std::size_t>(axis)];
    if (at < 0 || at + 1 >= lines(axis)) return false;
  }
  if (k == 0) return !bored(i, j);
  const int from_side = std::min(i, lines(0) - 2 - i);
  return j == 0 && (from_side == 0 || (from_side == 1 && k == 1));
}

/// Counter-clockwise seen from outside.
std::array<BentGrid::Spot, 4> BentGrid::face(const Spot& cell, int axis, int side) const {
  std::array<Spot, 4> quad;
  for (const auto& [place, u, v] : {std::array{0, 0, 0}, {1, 1, 0}, {2, 1, 1}, {3, 0, 1}}) {
    Spot spot = cell;
    spot[static_cast<std::size_t>(axis)] += side;
    spot[static_cast<std::size_t>((axis + 1) % 3)] += u;
    spot[static_cast<std::size_t>((axis + 2) % 3)] += v;
    quad[static_cast<std::size_t>(side ? place : 3 - place)] = spot;
  }
  return quad;
}

TriangleSurface BentGrid::surface() const {
  TriangleSurface result;
  std::map<Spot, int> numbers;
  const auto number = [&](const Spot& spot) {
    const auto [place, added] = numbers.try_emplace(spot, static_cast<int>(result.point_mm.size()));
    if (added) result.point_mm.push_back(point(spot) - Vector3d(0, 0, fit_.print_bed_z_mm));
    return place->second;
  };
  const auto add = [&](const std::array<Spot, 4>& quad) {
    std::array<int, 4> n{};
    std::array<bool, 4> high{};
    for (std::size_t c = 0; c < 4; ++c) {
      n[c] = number(quad[c]);
      high[c] = quad[c][2] == 0 && ridge(quad[c][0], quad[c][1]);
    }
    // A groove's roof stays steep if the diagonal ends in the one corner that differs.
    const bool other = high[0] == high[2] && high[1] != high[3];
    const std::size_t a = other ? 1 : 0;
    result.triangle.push_back({n[a], n[a + 1], n[a + 2]});
    result.triangle.push_back({n[a], n[a + 2], n[(a + 3) % 4]});
  };
  for (int i = 0; i + 1 < lines(0); ++i) {
    for (int j = 0; j + 1 < lines(1); ++j) {
      for (int k = 0; k + 1 < lines(2); ++k) {
        if (!filled({i, j, k})) continue;
        for (int axis = 0; axis < 3; ++axis) {
          for (const int side : {0, 1}) {
            Spot beside = {i, j, k};
            beside[static_cast<std::size_t>(axis)] += 2 * side - 1;
            if (!filled(beside)) add(face({i, j, k}, axis, side));
          }
        }
      }
    }
  }
  return result;
}

/// Corners of the part of the surface between two heights, as far as edges tell.
std::vector<Vector3d> between(const std::vector<std::array<Vector3d, 2>>& edges, double low_mm, double high_mm) {
  std::vector<Vector3d> points;
  for (const auto& [a, b] : edges) {
    for (const Vector3d& end : {a, b}) {
      if (end.y() >= low_mm && end.y() <= high_mm) points.push_back(end);
    }
    for (const double plane_mm : {low_mm, high_mm}) {
      if ((a.y() < plane_mm) == (b.y() < plane_mm)) continue;
      points.push_back(a + (plane_mm - a.y()) / (b.y() - a.y()) * (b - a));
    }
  }
  return points;
}

Eigen::Isometry3d jig_frame(const Vector3d& inward) {
  Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
  T.linear().col(0) = (Vector3d::UnitX() - inward.x() * inward).normalized();
  T.linear().col(1) = inward.cross(T.linear().col(0));
  T.linear().col(2) = inward;
  return T;
}

void check_guides_between_seats(const FingerSpec& spec, const JigFit& fit) {
  constexpr double kRoom_mm = kAround / 2 * kPixel_mm + 0.5;
  for (const JigHole& hole : fit.holes) {
    const double x_mm = (fit.T_finger_jig.inverse() * hole.contact_mm).x();
    if (x_mm - kRoom_mm > fit.left_mm + kSeat_mm && x_mm + kRoom_mm < fit.right_mm - kSeat_mm) continue;
    throw InputError(spec.file.string(), "base",
                     std::to_string(fit.right_mm - fit.left_mm) + " mm wide, hardly more than the touched face",
                     "a base that is wider than the guides over the face, so that the jig can clip to it");
  }
}

JigFit fit_to(const FingerSpec& spec) {
  constexpr double kRoom_mm = 1;  // between the clip and the first guide
  JigFit fit;
  fit.holes = jig_holes(spec);
  fit.T_finger_jig = jig_frame(fit.holes.front().inward);
  const Eigen::Isometry3d T_jig_finger = fit.T_finger_jig.inverse();
  const auto edges = outline_edges(finger_surface(spec));
  fit.base_y_mm = edges.front()[0].y();
  double nearest_mm = (T_jig_finger * edges.front()[0]).z();
  for (const auto& edge : edges) {
    fit.base_y_mm = std::min(fit.base_y_mm, edge[0].y());
    nearest_mm = std::min(nearest_mm, (T_jig_finger * edge[0]).z());
  }
  fit.face_z_mm = nearest_mm;
  fit.slab_z_mm = nearest_mm - kFaceGap_mm;
  fit.print_bed_z_mm = fit.slab_z_mm - kSlab_mm;

  // The clip ends, on the slab's outer face, where the guides begin.
  const Eigen::Matrix3d R = fit.T_finger_jig.linear();
  const double first_y_mm = (T_jig_finger * fit.holes.front().contact_mm).y() - kJigBoreMm / 2 - kRoom_mm;
  const double lowest_z_mm = R(1, 2) > 0 ? fit.print_bed_z_mm : fit.slab_z_mm;
  fit.clip_mm = std::min(kLargestClip_mm, R(1, 1) * first_y_mm + R(1, 2) * lowest_z_mm - fit.base_y_mm);
  constexpr double kSmallestClip_mm = 3;
  if (fit.clip_mm < kSmallestClip_mm) {
    throw InputError(spec.file.string(), "touch.y_mm", "touches that begin where the base does",
                     "at least 3 mm between the base and the lowest guide, for the jig's clip");
  }
  const std::vector<Vector3d> gripped = between(edges, fit.base_y_mm, fit.base_y_mm + fit.clip_mm);
  Eigen::AlignedBox3d all;
  for (const Vector3d& point : gripped) all.extend(T_jig_finger * point);
  fit.left_mm = all.min().x();
  fit.right_mm = all.max().x();
  Eigen::AlignedBox3d beside;  // what lies at the cheeks
  for (const Vector3d& point : gripped) {
    const Vector3d at = T_jig_finger * point;
    if (std::min(at.x() - fit.left_mm, fit.right_mm - at.x()) <= kSeat_mm) beside.extend(at);
  }
  fit.seat_z_mm = beside.min().z();
  fit.back_z_mm = beside.max().z();
  check_guides_between_seats(spec, fit);
  return fit;
}

}  // namespace

Jig make_jig(const FingerSpec& spec) {
  Jig jig;
  jig.fit = fit_to(spec);
  jig.surface = BentGrid(jig.fit).surface();
  return jig;
}

void write_stl(const std::filesystem::path& file, const TriangleSurface& surface) {
  std::string bytes = "finsight jig, mm";
  bytes.resize(80, ' ');
  const auto add = [&](auto value) {
    char raw[sizeof value];
    std::memcpy(raw, &value, sizeof value);
    bytes.append(raw, sizeof value);
  };
  const auto add_vector = [&](const Vector3d& v) {
    for (int axis = 0; axis < 3; ++axis) add(static_cast<float>(v[axis]));
  };
  add(static_cast<std::uint32_t>(surface.triangle.size()));
  for (std::size_t t = 0; t < surface.triangle.size(); ++t) {
    add_vector(surface.twice_area(t).normalized());
    for (const Vector3d& corner : surface.corners(t)) add_vector(corner);
    add(std::uint16_t{0});
  }
  write_file_atomically(file, bytes);
}

}  // namespace finsight::host
