// The audit in words and as an image; declared in audit.h.
#include <cstdarg>
#include <cstdio>
#include <numbers>

#include "hostgen/recordings/audit.h"
#include "hostgen/util/gnuplot.h"

namespace finsight::host {

namespace {

__attribute__((format(printf, 1, 2))) std::string text(const char* format, ...) {
  char line[400];
  std::va_list arguments;
  va_start(arguments, format);
  std::vsnprintf(line, sizeof line, format, arguments);
  va_end(arguments);
  return line;
}

std::string row(const char* question, const std::string& found, const std::string& verdict) {
  return text("%-18s %-92s ", question, found.c_str()) + verdict + "\n";
}

std::string markers_row(const RecordingAudit& audit) {
  std::string names;
  std::size_t plates = 0;
  for (std::size_t p = 0; p < kPlates; ++p) {
    if (!audit.recorded[p]) continue;
    names += (names.empty() ? "" : ", ") + std::string(kPlateNames[p]);
    ++plates;
  }
  return row(
      "markers", text("%zu of %d plates recorded (%s)", plates, kPlates, names.c_str()),
      plates == kPlates
          ? "ok"
          : text("PROBLEM: a network with 18 inputs sees %zu numbers; the rest are copies or guesses", 6 * plates));
}

std::string outlier_row(const RecordingAudit& audit) {
  std::string found = text("%zu rows far from their neighbours in time", audit.outliers.size());
  if (!audit.outliers.empty()) {
    const RecordingAudit::Outlier& first = audit.outliers[0];
    found += text("; line %d: %.0f mm and %.0f deg", first.line, first.motion_mm, first.rotation_deg);
  }
  return row("outliers", found, audit.outliers.empty() ? "ok" : "PROBLEM: leave them out");
}

std::string truth_rows(const RecordingAudit& audit) {
  if (audit.fitted_points == 0) {
    return row("truth", "no contact point has the 60 distinct rows that this check needs",
               "not known: measured or computed");
  }
  const bool computed = audit.touch_is_computed();
  std::string rows =
      row("truth",
          text("a quadratic of the plate's pose predicts the touch to %.4f / %.4f / %.4f mm (RMS; x y z) at each point",
               audit.pen_residual_mm[0], audit.pen_residual_mm[1], audit.pen_residual_mm[2]),
          computed ? "PROBLEM: the touch was computed from the pose; it is not a measurement" : "ok");
  return rows + row("",
                    text("%.0f %% of its change from row to row is the plate's own jitter", 100 * audit.jitter_in_pen),
                    computed ? "(errors against it are agreement with another reconstruction)" : "");
}

std::string face_rows(const RecordingAudit& audit) {
  std::string rows = row("face",
                         text("z = %.2f mm + %.4f y, contact points within %.2f mm (RMS) of that plane",
                              audit.z_at_base_mm, audit.slope, audit.plane_rms_mm),
                         "ok");
  constexpr double kLowest_mm = 10, kHighest_mm = 1000;  // faces of fingers
  const double height_mm = audit.y_mm[1] - audit.y_mm[0];
  rows += row("coverage",
              text("x %.1f to %.1f mm, y %.1f to %.1f mm; |x| up to %.1f mm low, %.1f mm high", audit.x_mm[0],
                   audit.x_mm[1], audit.y_mm[0], audit.y_mm[1], audit.half_width_mm[0], audit.half_width_mm[1]),
              height_mm >= kLowest_mm && height_mm <= kHighest_mm
                  ? "ok"
                  : "PROBLEM: not the size of a finger's face; are these millimetres?");
  // A touch further than this from all training points is extrapolated.
  constexpr double kGap_mm = 10;
  return rows + row("", text("largest gap: %.1f mm from its centre to the nearest contact point", audit.largest_gap_mm),
                    audit.largest_gap_mm <= kGap_mm ? "ok" : "PROBLEM: touches there are extrapolated");
}

}  // namespace

std::string audit_table(const RecordingAudit& audit) {
  std::string table = row("question", "found", "verdict");
  table += row("size",
               text("%zu rows, %zu recordings, %zu contact points, %.1f pushes per recording", audit.rows,
                    audit.recordings, audit.contact_points, audit.pushes_per_recording),
               "ok");
  table += markers_row(audit);
  table += row("repeated rows", text("%.1f %% of the rows repeat the row before exactly", 100 * audit.repeated),
               audit.repeated < 0.01 ? "ok" : "PROBLEM: they count twice");
  table +=
      row("random split", text("%.1f %% of its test rows have an exact copy in the training set", 100 * audit.leaked),
          audit.leaked < 0.01 ? "ok" : "PROBLEM: leakage; split by contact point (surface_node)");
  table += row("rest",
               text("the plate has moved %.2f mm or more in every row, %.1f mm at most", audit.smallest_motion_mm,
                    audit.largest_motion_mm),
               audit.largest_motion_mm < 0.5 || audit.largest_motion_mm > 200
                   ? "PROBLEM: a touched finger does not move like this; are these millimetres?"
               : audit.smallest_motion_mm < 0.1 ? "ok"
                                                : "PROBLEM: no row shows the finger at rest");
  table += row("rotation",
               text("changes from row to row: %.1f deg (median), %.1f deg (95 %%), %.1f deg (99 %%)",
                    audit.change_deg[0], audit.change_deg[1], audit.change_deg[2]),
               audit.change_deg[1] < 2 ? "ok" : "PROBLEM: flips between the two poses of a square seen face-on");
  table += outlier_row(audit);
  table += row("direction",
               text("the plate's motion into the finger follows the pen's: correlation %.2f", audit.motion_follows_pen),
               audit.motion_follows_pen > 0.8 ? "ok" : "PROBLEM: axes or units are wrong");
  return table + truth_rows(audit) + face_rows(audit);
}

void plot_audit(const RecordingAudit& audit, const RecordedMotion& motion, const std::filesystem::path& svg) {
  Gnuplot plot(svg);
  plot.line("set terminal svg size 1100,800 dynamic background '#ffffff' font 'sans-serif,12'");
  plot.line("$points << E");
  for (const RecordingAudit::Point& point : audit.points) {
    plot.line(text("%g %g %zu %g", static_cast<double>(point.place_mm.x()), static_cast<double>(point.place_mm.y()),
                   point.rows, static_cast<double>(point.largest_motion_mm)));
  }
  plot.line("E\n$rows << E");
  for (std::size_t row = 0; row < motion.poses.size(); ++row) {
    const PlateMotion& plate = motion.poses[row].plates[kTopPlate];
    const Vec3f rotation = plate.rotation_rad * static_cast<float>(180 / std::numbers::pi);
    plot.line(text("%zu %g %g %g %g %d", row, static_cast<double>(plate.displacement_mm.norm()),
                   static_cast<double>(rotation.x()), static_cast<double>(rotation.y()),
                   static_cast<double>(rotation.z()), motion.recording[row] == motion.recording[0]));
  }
  plot.line("E\nset multiplot layout 2,2; set grid");
  plot.line(
      "set title 'Contact points (size: rows)'; set xlabel 'x, mm'; set ylabel 'y, mm'; set size ratio -1; set xtics "
      "20; set cblabel 'largest motion of the plate, mm'");
  plot.line("plot $points using 1:2:(0.4+sqrt($3)/25.0):4 with points pt 7 ps variable palette title '' ");
  plot.line(
      "set size noratio; set xtics autofreq; set title 'First recording: rotation of the plate'; set xlabel 'row'; set "
      "ylabel 'deg'");
  plot.line(
      "plot for [c=3:5] $rows using ($6 == 1 ? $1 : NaN):c with linespoints pt 7 ps 0.3 title word('x y z', c-2)");
  plot.line("set title 'How far the plate has moved'; set xlabel 'mm'; set ylabel 'rows'; set xrange [0:20]");
  plot.line("set boxwidth 0.5; set style fill solid 0.5");
  plot.line("plot $rows using (floor($2*2)/2.0+0.25):(1) smooth frequency with boxes title ''");
  plot.line("set title 'Rows per contact point'; set xlabel 'y, mm'; set xrange [*:*]; set boxwidth; ");
  plot.line("plot $points using 2:3 with impulses lw 2 title ''");
  plot.line("unset multiplot");
  plot.finish();
}

}  // namespace finsight::host
