// Area touch: what the build measured, the paper's table 2, shapes at the touched point, and the plots of them.
#include <nlohmann/json.hpp>

#include "hostgen/learn/shape_at_touch.h"
#include "hostgen/learn/touch_comparison.h"
#include "hostgen/report/areas.h"
#include "hostgen/report/touch_map.h"
#include "hostgen/util/gnuplot.h"

namespace finsight::host {

using nlohmann::json;

namespace {

json errors_json(const AxisErrors& errors) { return {{"rmse_mm", errors.rmse_mm}, {"r2", errors.r2}}; }

json table2_json(const FingerSpec& spec, const FemDataset& dataset, bool quick) {
  json table;
  for (const MethodScore& method : compare_methods(spec, dataset, {.seed = 1, .steps = quick ? 4000 : 40000})) {
    json row = errors_json(method.random_clean);
    row["random_noisy"] = errors_json(method.random_noisy);
    row["held_out_clean"] = errors_json(method.held_out_clean);
    row["held_out_noisy"] = errors_json(method.held_out_noisy);
    row["train_s"] = method.train_s;
    row["predict_us"] = method.predict_us;
    table[method.name] = row;
  }
  return table;
}

json shape_json(const Model& model, const FingerSpec& spec, const FemDataset& dataset, const FemDataset& unseen,
                bool quick) {
  const ShapeAtTouch shape = measure_shape_at_touch(spec, model, dataset, quick ? 60 : 600, 1);
  json figures = {{"touch_point_mm",
                   {{"energy_clean", shape.energy_clean.touch_point_mm},
                    {"energy_noisy", shape.energy_noisy.touch_point_mm},
                    {"contact_aware_clean", shape.contact_aware_clean.touch_point_mm},
                    {"contact_aware_noisy", shape.contact_aware_noisy.touch_point_mm}}},
                  {"front_mm",
                   {{"energy_clean", shape.energy_clean.front_mm},
                    {"energy_noisy", shape.energy_noisy.front_mm},
                    {"contact_aware_clean", shape.contact_aware_clean.front_mm},
                    {"contact_aware_noisy", shape.contact_aware_noisy.front_mm}}},
                  {"states", shape.states}};
  figures["unseen_states"] = unseen.states.size();
  for (const TierAtTouch& tier : measure_tiers_at_touch(spec, model, unseen, 1)) {
    figures["tiers"].push_back({{"tier", tier.tier},
                                {"touch_point_clean_mm", tier.clean.touch_point_mm},
                                {"touch_point_noisy_mm", tier.noisy.touch_point_mm},
                                {"front_clean_mm", tier.clean.front_mm},
                                {"front_noisy_mm", tier.noisy.front_mm},
                                {"us_per_frame", tier.us_per_frame},
                                {"contact_map_share", tier.contact_map_share}});
  }
  return figures;
}

// Plots mean and 95th percentile of the error, and the share of errors inside the published radius.
void plot_touch(const json& touch, const std::filesystem::path& folder) {
  const json& bands = touch.at("by_plate_motion");
  if (bands.empty()) return;
  Gnuplot error(folder / "touch_error.svg");
  error.line("$bands << E");
  for (const json& band : bands) {
    error.line("'from " + std::to_string(band.at("from_mm").get<int>()) + " mm' " + band.at("mean_mm").dump() + " " +
               band.at("error_95_mm").dump());
  }
  error.line(
      "E\nset style data histograms; set style fill solid 0.6; set logscale y; set grid ytics; set yrange [0.1:*]");
  error.line("set xlabel 'plate motion'; set ylabel 'error of the touched point, mm (held-out points, noise)'");
  error.line("plot $bands using 2:xtic(1) title 'mean', '' using 3 title '95 % are smaller'");
  error.finish();

  Gnuplot calibration(folder / "touch_calibration.svg");
  calibration.line("$curve << E");
  double radii = 0;
  for (const json& share : touch.at("coverage_curve")) {
    radii += 0.1;
    calibration.line(std::to_string(radii) + " " + share.dump());
  }
  calibration.line("E\n$bands << E");
  for (const json& band : bands) {
    calibration.line("1 " + band.at("coverage_68").dump() + " " + band.at("from_mm").dump());
    calibration.line("2 " + band.at("coverage_95").dump() + " " + band.at("from_mm").dump());
  }
  calibration.line("E\n$aim << E\n1 0.68\n2 0.95\nE");
  calibration.line(
      "set xlabel 'radius, in published radii'; set ylabel 'share of errors inside'; set grid; set key bottom right");
  calibration.line("set xrange [0:3]; set yrange [0:1]; set cblabel 'plate motion from, mm'");
  calibration.line(
      "plot $curve with lines lw 2 title 'all published touches', $bands using 1:2:3 with points pt 7 palette title "
      "'by plate "
      "motion', $aim using 1:2:(0.03) with yerrorbars pt 1 lc 'black' title 'aim'");
  calibration.finish();
}

}  // namespace

json measure_touch(const json& built, const Model& model, const FingerSpec* spec, const FemDataset* dataset,
                   const std::filesystem::path& folder, bool quick) {
  json figures = {{"touch", built}};
  plot_touch(built, folder);
  if (!spec || !dataset) {
    figures["touch"]["table2"] = {{"why", "no --spec and --dataset were given"}};
    figures["shape"] = {{"why", "no --spec and --dataset were given"}};
    return figures;
  }
  figures["touch"]["table2"] = table2_json(*spec, *dataset, quick);
  // The pack's network and maps were trained on every point of the set, so other states test them.
  const FemDataset unseen = unseen_states(*spec, make_mesh(*spec), *dataset, quick ? 17 : 43, quick ? 4 : 8);
  figures["shape"] = shape_json(model, *spec, *dataset, unseen, quick);
  figures["touch"].update(map_touches(model, *spec, unseen, quick ? 10 : 100));
  return figures;
}

}  // namespace finsight::host
