#include <Eigen/Geometry>
#include <charconv>
#include <cmath>
#include <fstream>
#include <set>

#include "firmware/geometry/so3.h"
#include "firmware/input_error.h"
#include "firmware/ports/session.h"

namespace finsight {

namespace {

constexpr int kColumns = 13;
constexpr std::array<const char*, kColumns> kColumnName = {
    "recording", "frame",     "marker_tx_mm", "marker_ty_mm", "marker_tz_mm", "marker_qx",   "marker_qy",
    "marker_qz", "marker_qw", "touch_x_mm",   "touch_y_mm",   "touch_z_mm",   "surface_node"};
constexpr int kTranslation = 2, kQuaternion = 5, kPen = 9, kNode = 12;
constexpr double kLargest = 1e6;  // a number beyond this is no length in mm; it also keeps floats finite
constexpr double kUnitTolerance = 1e-2;

using Row = std::array<std::string_view, kColumns>;

/// A field in an error message.
std::string shown(std::string_view text) {
  std::string result = "'";
  result += text.substr(0, 40);
  result += '\'';
  return result;
}

/// Where in the file a message is about.
struct Place {
  const std::string& file;
  long line = 0;

  [[noreturn]] void refuse(int column, const std::string& found, const std::string& expected) const {
    throw InputError(file + ":" + std::to_string(line),
                     "column " + std::to_string(column + 1) + " (" + kColumnName[column] + ")", found, expected);
  }
};

Row split(std::string_view line, const Place& place) {
  Row row;
  std::size_t count = 0;
  for (std::size_t at = 0; at <= line.size(); ++count) {
    const std::size_t comma = std::min(line.find(',', at), line.size());
    if (count < row.size()) row[count] = line.substr(at, comma - at);
    at = comma + 1;
  }
  if (count != row.size()) {
    throw InputError(place.file + ":" + std::to_string(place.line), "row", std::to_string(count) + " columns",
                     std::to_string(kColumns));
  }
  return row;
}

double number(const Row& row, int column, const Place& place) {
  const std::string_view text = row[column];
  double value = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  // Written so that NaN is refused too.
  if (error != std::errc() || end != text.data() + text.size() || !(std::abs(value) <= kLargest)) {
    place.refuse(column, shown(text), "a number of at most 1e6");
  }
  return value;
}

int label(const Row& row, int column, const Place& place) {
  const double value = number(row, column, place);
  if (value != std::floor(value)) place.refuse(column, shown(row[column]), "a whole number");
  return static_cast<int>(value);
}

Eigen::Vector3d vector(const Row& row, int column, const Place& place) {
  return {number(row, column, place), number(row, column + 1, place), number(row, column + 2, place)};
}

PlatePoses top_plate_poses(const Row& row, const Place& place) {
  // Columns: the marker's axes in the finger frame.
  const Eigen::Matrix3d R_finger_marker{{0, -1, 0}, {0, 0, -1}, {1, 0, 0}};
  const Eigen::Vector3d xyz = vector(row, kQuaternion, place);
  const Eigen::Quaterniond q(number(row, kQuaternion + 3, place), xyz.x(), xyz.y(), xyz.z());
  if (std::abs(q.norm() - 1) > kUnitTolerance) {
    place.refuse(kQuaternion, "a quaternion of length " + std::to_string(q.norm()), "length 1 within 0.01");
  }
  PlatePoses poses;
  PlateMotion& top = poses.plates[kTopPlate];
  top.displacement_mm = (R_finger_marker * vector(row, kTranslation, place)).cast<float>();
  top.rotation_rad = (R_finger_marker * so3_log(q.normalized().toRotationMatrix())).cast<float>();
  poses.seen[kTopPlate] = true;
  poses.quality = Quality::kFresh;
  return poses;
}

void check_column_names(std::string_view line, const Place& place) {
  const Row names = split(line, place);
  for (int column = 0; column < kColumns; ++column) {
    if (names[column] != kColumnName[column]) {
      place.refuse(column, shown(names[column]), kColumnName[column]);
    }
  }
}

}  // namespace

RecordedMotion read_recorded_motion(const std::filesystem::path& csv, const std::string& recording) {
  const std::string name = csv.string();
  std::error_code ignored;
  if (!std::filesystem::is_regular_file(csv, ignored)) throw InputError(name, "no such file");
  std::ifstream in(csv, std::ios::binary);
  if (!in) throw InputError(name, "cannot be opened");

  Place place{name};
  RecordedMotion motion;
  std::set<std::string, std::less<>> recordings;
  for (std::string line; std::getline(in, line);) {
    ++place.line;
    if (line.ends_with('\r')) line.pop_back();
    if (place.line == 1) {
      check_column_names(line, place);
      continue;
    }
    // Every row is checked, also in recordings that are not wanted, so that a damaged file is always found.
    const Row row = split(line, place);
    const PlatePoses poses = top_plate_poses(row, place);
    const Eigen::Vector3d pen_mm = vector(row, kPen, place);
    const int surface_node = label(row, kNode, place);
    recordings.emplace(row[0]);
    if (!recording.empty() && row[0] != recording) continue;
    motion.poses.push_back(poses);
    motion.pen_mm.push_back(pen_mm.cast<float>());
    motion.recording.emplace_back(row[0]);
    motion.surface_node.push_back(surface_node);
    motion.line.push_back(static_cast<int>(place.line));
  }
  if (motion.poses.empty()) {
    throw InputError(name, "recording", recording.empty() ? "no row" : "none named " + shown(recording),
                     recordings.empty() ? "rows of recorded motion"
                                        : "one of " + std::to_string(recordings.size()) + ", for example '" +
                                              *recordings.begin() + "'");
  }
  return motion;
}

}  // namespace finsight
