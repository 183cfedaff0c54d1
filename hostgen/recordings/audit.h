// Checks recorded touches for faults before anyone trains on them.
#pragma once

#include <algorithm>
#include <array>
#include <filesystem>
#include <string>
#include <vector>

#include "firmware/ports/session.h"

namespace finsight::host {

/// Figures of one file of recordings. A "change" is between neighbouring rows of one recording that differ.
struct RecordingAudit {
  std::size_t rows = 0, recordings = 0, contact_points = 0;
  double pushes_per_recording = 0;  ///< excursions of the plate beyond half of its largest motion and back

  // Plates
  std::array<bool, kPlates> recorded{};                  ///< which plates' motions the file holds
  double smallest_motion_mm = 0, largest_motion_mm = 0;  ///< without outliers
  double motion_follows_pen = 0;       ///< correlation of the plate's and the pen's motion into the finger
  std::array<double, 3> change_deg{};  ///< rotation from row to row: median, 95 %, 99 %
  struct Outlier {
    int line;
    double motion_mm, rotation_deg;
  };
  std::vector<Outlier> outliers;  ///< rows in which the plate is far from where it is in the rows before and after

  // Rows
  double repeated = 0;  ///< share of rows that repeat the row before
  double leaked = 0;    ///< share of a random 7:1:2 split's test rows that have a copy in the training set

  // Truth
  std::size_t fitted_points = 0;  ///< contact points with enough rows for the fit; if 0, the following is meaningless
  std::array<double, 3>
      pen_residual_mm{};  ///< RMS x y z of the pen's position after a quadratic fit to the plate's pose
  /// The touch was computed from the pose: two independent measurements never agree so well.
  bool touch_is_computed() const {
    return fitted_points > 0 && *std::max_element(pen_residual_mm.begin(), pen_residual_mm.end()) < 0.02;
  }
  double jitter_in_pen = 0;  ///< share of the pen's changes (variance) that the plate's changes explain

  // Face: z = z_at_base_mm + slope * y through the contact points at rest
  double z_at_base_mm = 0, slope = 0, plane_rms_mm = 0;
  std::array<double, 2> x_mm{}, y_mm{};   ///< extent of the contact points
  std::array<double, 2> half_width_mm{};  ///< largest |x| in the lowest and in the highest quarter of that extent
  double largest_gap_mm = 0;              ///< largest distance from a point of that part of the face to a contact point
  struct Point {
    int surface_node;
    Vec3f place_mm;  ///< the pen's position when the plate had moved least
    std::size_t rows;
    float largest_motion_mm, largest_push_mm;
  };
  std::vector<Point> points;  ///< by surface_node
};

/// Needs at least one row; the reader of recordings refuses files without.
RecordingAudit audit_recordings(const RecordedMotion& motion);

/// Rows in which a plate has jumped away and come back; see RecordingAudit::outliers.
std::vector<bool> find_outliers(const RecordedMotion& motion);

/// One line per check: what was found, and "ok" or what it means for training.
std::string audit_table(const RecordingAudit& audit);

/// Contact points on the face, rotation from row to row, how far the plate moved, and the recorded touch against what
/// the plate alone predicts; an SVG. Throws std::runtime_error if gnuplot is missing.
void plot_audit(const RecordingAudit& audit, const RecordedMotion& motion, const std::filesystem::path& svg);

}  // namespace finsight::host
