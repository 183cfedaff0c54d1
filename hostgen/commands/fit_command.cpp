// hostgen fit SESSION...: recordings of known weights -> what this finger does otherwise than its pack, for the board
// file.
#include <CLI/CLI.hpp>
#include <cstdio>
#include <memory>

#include "firmware/settings/measured_fit.h"
#include "hostgen/commands/commands.h"
#include "hostgen/commands/fitted_device.h"
#include "hostgen/fit/weight_fit.h"
#include "hostgen/fit/weight_list.h"
#include "hostgen/util/common.h"
#include "hostgen/util/gravity.h"

namespace finsight::host {

namespace {

namespace fs = std::filesystem;

struct FitOptions {
  FittedDevice device;
  fs::path weights, output;
};

/// Those that the weights tell something of.
void print_motions(const MotionFit& fit, const std::vector<Deviation>& deviations) {
  constexpr double kTold = 0.7;  // of the usual deviation
  std::printf("by how it moves:\n");
  for (std::size_t k = 0; k < deviations.size(); ++k) {
    const Deviation& one = deviations[k];
    if (fit.sigma[k] > kTold * one.usual) continue;
    std::printf("  %-32s %+6.2f +- %.2f %s\n", one.name.c_str(), fit.amount[k], fit.sigma[k], one.unit.c_str());
  }
}

void print_fit(const WeightFit& fit, const FitBasis& basis) {
  std::printf("recording             hole  weight N  held s  pack's N  force off %%  touch off mm (across, up)\n");
  for (const WeightHold& hold : fit.holds) {
    std::printf("%-20s  %4d  %8.2f  %6.1f  %8.2f  %+11.1f  %+6.2f %+6.2f\n", hold.name.c_str(), hold.hole, hold.force_n,
                hold.lasted_s, hold.pack_force_n, 100 * hold.force_error, static_cast<double>(hold.touch_error_mm.x()),
                static_cast<double>(hold.touch_error_mm.y()));
  }
  const FitValues& values = fit.values;
  std::printf("force scale %.3f +- %.3f; a force is right to %.1f %% (unfitted: %.0f %%)\n",
              static_cast<double>(values.force_scale), static_cast<double>(values.force_scale_sigma),
              100 * static_cast<double>(values.force_sigma), 100 * static_cast<double>(basis.force_tolerance));
  if (values.creep_share > 0) {
    std::printf("creep %.1f %% +- %.1f %%, with a time constant of %.0f s\n",
                100 * static_cast<double>(values.creep_share), 100 * fit.creep_share_sigma,
                static_cast<double>(values.creep_s));
  }
  std::printf("touches: 68 %% of the offsets that remain are within %.2f mm (unfitted: %.2f mm)\n",
              static_cast<double>(values.touch_radius_mm), static_cast<double>(basis.touch_tolerance_mm));
  if (values.explained_lower > 0) {
    std::printf("this finger's touches are unlike the pack's: what it calls unexplained is less likely by %.1f\n",
                static_cast<double>(values.explained_lower));
  }
  print_motions(fit.motions, basis.motions.deviations);
  for (const std::string& untold : fit.untold) std::printf("not told: %s\n", untold.c_str());
}

void run(const FitOptions& options) {
  const FittedDevice& device = options.device;
  const Model model = Model::open(device.pack);
  const FingerSpec spec = device.read_spec(model);
  check_writable(options.output, {spec.file, device.pack, options.weights, device.mount});
  const std::vector<ListedWeight> weights = read_weights(options.weights, static_cast<int>(jig_holes(spec).size()));
  const std::uint16_t day = device.day();
  std::vector<WeightRecord> records;
  for (const fs::path& session : device.sessions) {
    const ListedWeight& row = listed(weights, session, options.weights);
    records.push_back({.name = row.session, .hole = row.hole, .force_n = weight_n(row.mass_g), .readings = {}});
  }
  std::vector<SessionTouches> touches = device.touches(model, weighing(model.touch));
  for (std::size_t i = 0; i < records.size(); ++i) {
    records[i].readings = std::move(touches[i].readings);
    records[i].left_mm = static_cast<double>(touches[i].left_mm);
  }
  FitBasis basis = fit_basis(spec, model);
  check_weights(basis, records);
  basis.motions = motion_basis(spec, basis.holes);
  const WeightFit fit = fit_weights(basis, records, day);
  write_file_atomically(options.output, "# What one finger does otherwise than its pack, made by hostgen fit from " +
                                            std::to_string(records.size()) +
                                            " recordings.\n# In a board file: fit = \"this file\", before the first "
                                            "table.\n" +
                                            measured_fit_toml(fit.values));
  print_fit(fit, basis);
  std::printf("%s: for the key fit in a board file\n", options.output.c_str());
}

}  // namespace

void add_fit_command(CLI::App& app) {
  const auto options = std::make_shared<FitOptions>();
  CLI::App* command = app.add_subcommand(
      "fit",
      "find force scale, creep, motions and touch offset of one finger from recordings of known weights at the holes "
      "of its jig. Each begins with the untouched finger for two seconds; hold one weight in each row of holes for a "
      "minute to tell creep");
  command->add_option("sessions", options->device.sessions, "session folders, one per weight; three to nine tell most")
      ->required();
  command->add_option("--weights", options->weights, "CSV: session,hole,mass_g")->required();
  options->device.add_options(*command);
  command->add_option("-o,--output", options->output, "file to write (TOML), for the key fit in a board file")
      ->required();
  command->callback([options] { run(*options); });
}

}  // namespace finsight::host
