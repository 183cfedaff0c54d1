#include "hostgen/calibrate/calibration_report.h"

#include <algorithm>
#include <cmath>
#include <cstdio>

#include "hostgen/util/gnuplot.h"

namespace finsight::host {

namespace {

template <class... Values>
std::string text(const char* format, Values... values) {
  char buffer[256];
  std::snprintf(buffer, sizeof buffer, format, values...);
  return buffer;
}

}  // namespace

std::string view_table(const std::vector<BoardView>& views) {
  std::size_t widest = 7;
  for (const BoardView& view : views) widest = std::max(widest, view.name.size());
  const int width = static_cast<int>(widest);
  std::string table = text("%-*s %8s %8s %8s  ", width, "image", "corners", "edge px", "off px") + "result\n";
  for (const BoardView& view : views) {
    const bool has_corners = !view.sight.id.empty();
    table += view.name + std::string(widest - view.name.size(), ' ') + text(" %8zu ", view.sight.id.size());
    table += has_corners ? text("%8.1f ", view.sight.edge_px) : text("%8s ", "-");
    table += view.rms_px > 0 ? text("%8.3f  ", view.rms_px) : text("%8s  ", "-");
    table += (view.rejected.empty() ? "used" : "rejected: " + view.rejected) + "\n";
  }
  return table;
}

std::string calibration_text(const LensCalibration& calibration, const Coverage& coverage) {
  std::string out =
      text("%zu views of %dx%d pixels, %zu corners, %.3f pixels from the model (RMS)\n", calibration.views,
           calibration.lens.width_px, calibration.lens.height_px, calibration.corners, calibration.rms_px);
  const LensNumbers numbers = lens_numbers(calibration.lens);
  out += "          value   std. dev.\n";
  for (std::size_t i = 0; i < kLensNumbers; ++i) {
    const char* format = i < 4 ? "%s %12.3f %11.3f px\n" : "%s %12.5f %11.5f\n";
    out += text(format, kLensNames[i], numbers[i], calibration.sigma[i]);
  }
  out += "views in every ninth of the image:\n";
  for (std::size_t row = 0; row < 3; ++row) {
    const int* of_row = &coverage.views[3 * row];
    out += text("%5d %5d %5d\n", of_row[0], of_row[1], of_row[2]);
  }
  out += text("views whose left side is nearer by %.0f degrees or more: %d, right: %d, upper: %d, lower: %d\n",
              kTiltDeg, coverage.tilted[0], coverage.tilted[1], coverage.tilted[2], coverage.tilted[3]);
  if (!coverage.no_lens.empty()) {
    out += "the lens model folds over in these corners of the image, where markers cannot be measured:";
    for (const std::string& corner : coverage.no_lens)
      out += (&corner == coverage.no_lens.data() ? " " : ", ") + corner;
    out += "\n";
  }
  const std::vector<std::string> lines = advice(coverage);
  if (lines.empty()) return out + "nothing is missing\n";
  out += "to do better:\n";
  for (const std::string& line : lines) out += "  " + line + "\n";
  return out;
}

void plot_calibration(const LensCalibration& calibration, const std::vector<BoardView>& views,
                      const std::filesystem::path& svg) {
  const Lens& lens = calibration.lens;
  Gnuplot plot(svg);
  plot.line("$corners << E");
  for (const BoardView& view : views) {
    if (!view.rejected.empty()) continue;
    for (std::size_t i = 0; i < view.residual_px.size(); ++i) {
      const Vec2f at = view.sight.corner_px[i], off = kPlotScale * view.residual_px[i];
      plot.line(text("%g %g %g %g", static_cast<double>(at.x()), static_cast<double>(at.y()),
                     static_cast<double>(off.x()), static_cast<double>(off.y())));
    }
  }
  plot.line("E");
  plot.line(text("set title 'Corners of %zu views; lines: distance from the model, %d times'", calibration.views,
                 kPlotScale));
  plot.line(text("set xrange [0:%d]; set yrange [%d:0]; set size ratio -1; set grid", lens.width_px, lens.height_px));
  plot.line(text("set xtics %g; set ytics %g; set format '%%.0f'", lens.width_px / 3.0, lens.height_px / 3.0));
  plot.line("plot $corners with vectors nohead lc 1 title '', $corners with points pt 7 ps 0.25 lc 2 title ''");
  plot.finish();
}

}  // namespace finsight::host
