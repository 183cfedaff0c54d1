#include "hostgen/recordings/audit.h"

#include <Eigen/Geometry>
#include <Eigen/QR>
#include <algorithm>
#include <cmath>
#include <map>
#include <numbers>
#include <numeric>
#include <set>

#include "firmware/geometry/so3.h"
#include "hostgen/learn/split.h"
#include "hostgen/util/statistics.h"

namespace finsight::host {

namespace {

constexpr double kDegrees = 180 / std::numbers::pi;
constexpr std::size_t kMinRows = 60;  // per contact point, for fits with 28 coefficients

const PlateMotion& top_plate(const RecordedMotion& motion, std::size_t row) {
  return motion.poses[row].plates[kTopPlate];
}

double motion_mm(const RecordedMotion& motion, std::size_t row) {
  return static_cast<double>(top_plate(motion, row).displacement_mm.norm());
}

Eigen::Quaterniond rotation(const RecordedMotion& motion, std::size_t row) {
  return so3_exp_quaternion(top_plate(motion, row).rotation_rad.cast<double>());
}

bool same_row(const RecordedMotion& motion, std::size_t a, std::size_t b) {
  const PlateMotion &p = top_plate(motion, a), &q = top_plate(motion, b);
  return p.displacement_mm == q.displacement_mm && p.rotation_rad == q.rotation_rad &&
         motion.pen_mm[a] == motion.pen_mm[b];
}

/// First row of every run of equal rows, split where a recording ends.
std::vector<std::vector<std::size_t>> distinct_rows(const RecordedMotion& motion) {
  std::vector<std::vector<std::size_t>> recordings;
  for (std::size_t row = 0; row < motion.poses.size(); ++row) {
    const bool begins = row == 0 || motion.recording[row] != motion.recording[row - 1];
    if (begins) recordings.emplace_back();
    if (begins || !same_row(motion, row, row - 1)) recordings.back().push_back(row);
  }
  return recordings;
}

// Rows by contact point, without outliers and repeats.
std::map<int, std::vector<std::size_t>> rows_by_point(const RecordedMotion& motion, const std::vector<bool>& outlier) {
  std::map<int, std::vector<std::size_t>> points;
  for (const auto& recording : distinct_rows(motion)) {
    for (const std::size_t row : recording) {
      if (!outlier[row]) points[motion.surface_node[row]].push_back(row);
    }
  }
  return points;
}

void audit_rows(const RecordedMotion& motion, RecordingAudit& audit) {
  using Key = std::array<float, 10>;
  const auto key = [&](std::size_t row) {
    Key k;
    const PlateMotion& plate = top_plate(motion, row);
    for (int i = 0; i < 3; ++i) {
      k[static_cast<std::size_t>(i)] = plate.displacement_mm[i];
      k[static_cast<std::size_t>(3 + i)] = plate.rotation_rad[i];
      k[static_cast<std::size_t>(6 + i)] = motion.pen_mm[row][i];
    }
    k[9] = static_cast<float>(motion.surface_node[row]);
    return k;
  };
  std::size_t repeated = 0;
  for (std::size_t row = 1; row < audit.rows; ++row) {
    repeated += motion.recording[row] == motion.recording[row - 1] && same_row(motion, row, row - 1);
  }
  audit.repeated = static_cast<double>(repeated) / static_cast<double>(audit.rows);

  const Split split = random_split(audit.rows, 1);
  std::set<Key> trained;
  for (const std::size_t row : split.train) trained.insert(key(row));
  const auto copies =
      std::count_if(split.test.begin(), split.test.end(), [&](std::size_t row) { return trained.contains(key(row)); });
  audit.leaked = static_cast<double>(copies) / std::max(1.0, static_cast<double>(split.test.size()));
}

void audit_plates(const RecordedMotion& motion, const std::vector<bool>& outlier, RecordingAudit& audit) {
  for (const PlatePoses& poses : motion.poses) {
    for (std::size_t p = 0; p < kPlates; ++p) audit.recorded[p] = audit.recorded[p] || poses.seen[p];
  }
  audit.smallest_motion_mm = 1e9;
  std::vector<double> change;
  std::size_t pushes = 0;
  for (const auto& rows : distinct_rows(motion)) {
    double largest = 0;
    for (const std::size_t row : rows) {
      if (outlier[row]) continue;
      largest = std::max(largest, motion_mm(motion, row));
      audit.smallest_motion_mm = std::min(audit.smallest_motion_mm, motion_mm(motion, row));
    }
    audit.largest_motion_mm = std::max(audit.largest_motion_mm, largest);
    double smallest = largest;
    for (const std::size_t row : rows) smallest = std::min(smallest, motion_mm(motion, row));
    bool out = false;  // from beyond 60 % of the largest motion until back below 40 %
    for (const std::size_t row : rows) {
      const double share = (motion_mm(motion, row) - smallest) / std::max(largest - smallest, 1e-9);
      if (!out && share > 0.6) ++pushes;
      out = out ? share > 0.4 : share > 0.6;
    }
    for (std::size_t i = 1; i < rows.size(); ++i) {
      if (!outlier[rows[i]] && !outlier[rows[i - 1]]) {
        change.push_back(kDegrees * rotation(motion, rows[i]).angularDistance(rotation(motion, rows[i - 1])));
      }
    }
  }
  audit.pushes_per_recording = static_cast<double>(pushes) / static_cast<double>(audit.recordings);
  audit.change_deg = {quantile(change, 0.5), quantile(change, 0.95), quantile(change, 0.99)};
  for (std::size_t row = 0; row < audit.rows; ++row) {
    if (!outlier[row]) continue;
    const double angle = static_cast<double>(top_plate(motion, row).rotation_rad.norm());
    audit.outliers.push_back({motion.line[row], motion_mm(motion, row), kDegrees * angle});
  }
}

void audit_points(const RecordedMotion& motion, const std::vector<bool>& outlier, RecordingAudit& audit) {
  std::map<int, std::size_t> all_rows;
  for (const int node : motion.surface_node) ++all_rows[node];
  for (const auto& [node, rows] : rows_by_point(motion, outlier)) {
    const std::size_t rest = *std::min_element(rows.begin(), rows.end(), [&](std::size_t a, std::size_t b) {
      return motion_mm(motion, a) < motion_mm(motion, b);
    });
    RecordingAudit::Point point{node, motion.pen_mm[rest], all_rows[node], 0, 0};
    for (const std::size_t row : rows) {
      point.largest_motion_mm = std::max(point.largest_motion_mm, top_plate(motion, row).displacement_mm.norm());
      point.largest_push_mm = std::max(point.largest_push_mm, motion.pen_mm[row].z() - point.place_mm.z());
    }
    audit.points.push_back(point);
  }
  audit.contact_points = all_rows.size();
}

// Least squares: columns of `targets` from `inputs`; RMS residual per target on the rows that `test` picks, fitted on
// the others.
Eigen::Vector3d squared_residual(const Eigen::MatrixXd& inputs, const Eigen::MatrixXd& targets, std::size_t every) {
  const auto count = inputs.rows();
  const auto period = static_cast<Eigen::Index>(every);
  std::vector<Eigen::Index> fit, test;
  for (Eigen::Index i = 0; i < count; ++i) (every == 0 || i % period ? fit : test).push_back(i);
  if (every == 0) test = fit;
  const Eigen::MatrixXd weights =
      inputs(fit, Eigen::all).eval().colPivHouseholderQr().solve(targets(fit, Eigen::all).eval());
  const Eigen::MatrixXd error = inputs(test, Eigen::all) * weights - targets(test, Eigen::all);
  return error.colwise().squaredNorm().transpose() / static_cast<double>(test.size());
}

Eigen::Matrix<double, 6, 1> scaled_pose(const PlateMotion& plate) {
  constexpr double kRotation = 20;  // makes rotations about as large as displacements, for the condition of the fit
  Eigen::Matrix<double, 6, 1> x;
  x << plate.displacement_mm.cast<double>(), kRotation * plate.rotation_rad.cast<double>();
  return x;
}

// A pen that is measured independently has errors of its own, so no function of the plate's pose predicts it to better
// than some tenths of a millimetre. Only a position that was computed from the pose can be predicted exactly.
void audit_truth(const RecordedMotion& motion, const std::vector<bool>& outlier, RecordingAudit& audit) {
  Eigen::Vector3d residual_sq = Eigen::Vector3d::Zero();
  double change_sq = 0, unexplained_sq = 0;
  for (const auto& [node, rows] : rows_by_point(motion, outlier)) {
    if (rows.size() < kMinRows) continue;
    const auto count = static_cast<Eigen::Index>(rows.size());
    Eigen::MatrixXd quadratic(count, 28), pen(count, 3), linear(count, 7);
    for (Eigen::Index i = 0; i < count; ++i) {
      const std::size_t row = rows[static_cast<std::size_t>(i)];
      const auto x = scaled_pose(top_plate(motion, row));
      linear.row(i) << 1.0, x.transpose();
      quadratic.row(i).head<7>() = linear.row(i);
      for (int a = 0, k = 7; a < 6; ++a) {
        for (int b = a; b < 6; ++b) quadratic(i, k++) = x[a] * x[b];
      }
      pen.row(i) = motion.pen_mm[row].cast<double>().transpose();
    }
    residual_sq += squared_residual(quadratic, pen, 3);
    const Eigen::MatrixXd pose_change = linear.bottomRows(count - 1) - linear.topRows(count - 1);
    const Eigen::MatrixXd pen_change = pen.bottomRows(count - 1) - pen.topRows(count - 1);
    change_sq += pen_change.squaredNorm();
    unexplained_sq += squared_residual(pose_change.rightCols(6), pen_change, 0).sum() * static_cast<double>(count - 1);
    ++audit.fitted_points;
  }
  for (int i = 0; i < 3; ++i) {
    audit.pen_residual_mm[static_cast<std::size_t>(i)] =
        std::sqrt(residual_sq[i] / static_cast<double>(std::max<std::size_t>(1, audit.fitted_points)));
  }
  audit.jitter_in_pen = change_sq > 0 ? 1 - unexplained_sq / change_sq : 0;
}

void audit_direction(const RecordedMotion& motion, const std::vector<bool>& outlier, RecordingAudit& audit) {
  std::map<int, float> place_z;
  for (const RecordingAudit::Point& point : audit.points) place_z[point.surface_node] = point.place_mm.z();
  double n = 0, x = 0, y = 0, xx = 0, yy = 0, xy = 0;
  for (std::size_t row = 0; row < audit.rows; ++row) {
    if (outlier[row]) continue;
    const double plate = static_cast<double>(top_plate(motion, row).displacement_mm.z());
    const double pen = static_cast<double>(motion.pen_mm[row].z() - place_z[motion.surface_node[row]]);
    n += 1, x += plate, y += pen, xx += plate * plate, yy += pen * pen, xy += plate * pen;
  }
  const double variance = (n * xx - x * x) * (n * yy - y * y);
  audit.motion_follows_pen = variance > 0 ? (n * xy - x * y) / std::sqrt(variance) : 0;
}

// Takes the touched part of the face for a trapezoid as wide as the outermost points. Its largest gap is the radius of
// the largest circle in it without a contact point.
void audit_face(RecordingAudit& audit) {
  if (audit.points.empty()) return;
  const auto count = static_cast<Eigen::Index>(audit.points.size());
  Eigen::MatrixXd place(count, 3);
  for (Eigen::Index i = 0; i < count; ++i)
    place.row(i) = audit.points[static_cast<std::size_t>(i)].place_mm.cast<double>();
  audit.x_mm = {place.col(0).minCoeff(), place.col(0).maxCoeff()};
  audit.y_mm = {place.col(1).minCoeff(), place.col(1).maxCoeff()};
  Eigen::MatrixXd one_y(count, 2);
  one_y << Eigen::VectorXd::Ones(count), place.col(1);
  const Eigen::Vector2d plane = one_y.colPivHouseholderQr().solve(place.col(2).eval());
  audit.z_at_base_mm = plane[0];
  audit.slope = plane[1];
  audit.plane_rms_mm = std::sqrt((one_y * plane - place.col(2)).squaredNorm() / static_cast<double>(count));

  const double height = audit.y_mm[1] - audit.y_mm[0];
  for (Eigen::Index i = 0; i < count; ++i) {
    const double up = height > 0 ? (place(i, 1) - audit.y_mm[0]) / height : 0;
    if (up <= 0.25) audit.half_width_mm[0] = std::max(audit.half_width_mm[0], std::abs(place(i, 0)));
    if (up >= 0.75) audit.half_width_mm[1] = std::max(audit.half_width_mm[1], std::abs(place(i, 0)));
  }
  const double widest = std::max(audit.half_width_mm[0], audit.half_width_mm[1]);
  const double step_mm = std::max(1.0, std::max(height, widest) / 250);  // 1 mm for a finger's face
  for (double y = audit.y_mm[0]; y <= audit.y_mm[1]; y += step_mm) {
    const double up = height > 0 ? (y - audit.y_mm[0]) / height : 0;
    const double half = audit.half_width_mm[0] + up * (audit.half_width_mm[1] - audit.half_width_mm[0]);
    for (double x = -half; x <= half; x += step_mm) {
      const double nearest_sq =
          (place.leftCols<2>().rowwise() - Eigen::RowVector2d(x, y)).rowwise().squaredNorm().minCoeff();
      audit.largest_gap_mm = std::max(audit.largest_gap_mm, std::sqrt(nearest_sq));
    }
  }
}

}  // namespace

std::vector<bool> find_outliers(const RecordedMotion& motion) {
  // Neither a finger nor noise moves a plate that far within two frames.
  constexpr double kJump_mm = 5, kJump_deg = 20;
  constexpr std::size_t kNeighbours = 3;  // before and after
  std::vector<bool> outlier(motion.poses.size(), false);
  for (const auto& rows : distinct_rows(motion)) {
    for (std::size_t i = 0; i < rows.size(); ++i) {
      std::vector<double> distance, angle;
      for (std::size_t j = i < kNeighbours ? 0 : i - kNeighbours; j < std::min(i + kNeighbours + 1, rows.size()); ++j) {
        if (j == i) continue;
        const Vec3f way = top_plate(motion, rows[i]).displacement_mm - top_plate(motion, rows[j]).displacement_mm;
        distance.push_back(static_cast<double>(way.norm()));
        angle.push_back(kDegrees * rotation(motion, rows[i]).angularDistance(rotation(motion, rows[j])));
      }
      if (quantile(distance, 0.5) <= kJump_mm && quantile(angle, 0.5) <= kJump_deg) continue;
      for (std::size_t row = rows[i]; row < motion.poses.size() && same_row(motion, row, rows[i]); ++row)
        outlier[row] = true;
    }
  }
  return outlier;
}

RecordingAudit audit_recordings(const RecordedMotion& motion) {
  RecordingAudit audit;
  audit.rows = motion.poses.size();
  audit.recordings = std::set<std::string>(motion.recording.begin(), motion.recording.end()).size();
  const std::vector<bool> outlier = find_outliers(motion);
  audit_rows(motion, audit);
  audit_plates(motion, outlier, audit);
  audit_points(motion, outlier, audit);
  audit_direction(motion, outlier, audit);
  audit_truth(motion, outlier, audit);
  audit_face(audit);
  return audit;
}

}  // namespace finsight::host
