// hostgen report: measures, area by area, and writes results.json and plots.
#include <CLI/CLI.hpp>
#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <memory>
#include <nlohmann/json.hpp>

#include "firmware/input_error.h"
#include "hostgen/commands/commands.h"
#include "hostgen/report/areas.h"
#include "hostgen/report/build_figures.h"
#include "hostgen/report/results.h"
#include "hostgen/util/common.h"

namespace finsight::host {

namespace {

struct Options {
  std::filesystem::path pack, spec, folder, bench, dataset, recordings, soak, attacks, page, appliance;
  bool quick = false;
  std::vector<std::string> areas;
};

/// What another program measured.
nlohmann::json read_figures(const std::filesystem::path& file) {
  try {
    return nlohmann::json::parse(read_file(file));
  } catch (const nlohmann::json::exception& error) {
    throw InputError(file.string(), error.what());
  }
}

nlohmann::json measure(const std::string& area, const Options& options, const Model& model) {
  if (area == "solver") {
    nlohmann::json bench = {{"solver", {{"why", "no figures of the program bench were given"}}}};
    if (!options.bench.empty()) bench = read_figures(options.bench);
    nlohmann::json figures = measure_solver(model, bench, options.quick);
    figures["hard_cases"] = measure_hard_cases(model, options.quick);
    return figures;
  }
  if (area == "modbus") {
    nlohmann::json figures = measure_modbus(options.quick);
    nlohmann::json& soak = figures["modbus"]["soak"];
    soak = {{"why", "no figures of scripts/lib/soak.py were given"}};
    if (!options.soak.empty()) soak = read_figures(options.soak);
    nlohmann::json attacks = {{"attack", {{"why", "no file of scripts/lib/attack.py was given"}}}};
    if (!options.attacks.empty()) attacks = read_figures(options.attacks);
    figures["modbus"].update(attacks);
    return figures;
  }
  if (area == "appliance") {
    if (options.appliance.empty()) return {{"appliance", {{"why", "tests/system/boot has not run on this machine"}}}};
    return {{"appliance", read_figures(options.appliance)}};
  }
  if (area == "page") {
    if (options.page.empty()) return {{"page", {{"why", "no file of scripts/lib/page_cost.py was given"}}}};
    return {{"page", read_figures(options.page)}};
  }
  if (area == "vision") return measure_vision(model, read_finger_spec(options.spec), options.folder, options.quick);
  if (area == "pictures") return measure_pictures(model, read_finger_spec(options.spec), options.quick);
  if (area == "scene") return measure_scenes(model, read_finger_spec(options.spec), options.folder, options.quick);
  if (area == "force") return measure_force(read_finger_spec(options.spec), options.folder, options.quick);
  if (area == "real") return measure_real(model, options.recordings, options.folder, options.quick);
  const nlohmann::json built = read_build_figures(options.pack);  // fem and touch were measured when the pack was made
  if (area == "fem") return measure_fem(options.spec, built[area], options.quick);
  if (area == "touch") {
    if (options.dataset.empty()) {
      return measure_touch(built["touch"], model, nullptr, nullptr, options.folder, options.quick);
    }
    const FingerSpec spec = read_finger_spec(options.spec);
    const FemDataset dataset = read_dataset(options.dataset);
    check_complete(dataset, spec, make_mesh(spec), options.dataset);
    return measure_touch(built["touch"], model, &spec, &dataset, options.folder, options.quick);
  }
  return {{area, built[area]}};
}

void run(const Options& options) {
  const Model model = Model::open(options.pack);
  std::filesystem::create_directories(options.folder);
  Results results(options.folder / "results.json");
  for (const std::string& area : report_areas()) {
    const bool wanted =
        options.areas.empty() || std::find(options.areas.begin(), options.areas.end(), area) != options.areas.end();
    if (!wanted) continue;
    std::printf("%s ...\n", area.c_str());
    std::fflush(stdout);
    double load = 0;
    if (getloadavg(&load, 1) != 1) load = 0;
    results.measured(area, measure(area, options, model), options.quick ? "quick" : "full", load);
    results.write();
  }
  std::printf("%s\n", (options.folder / "results.json").c_str());
}

}  // namespace

void add_report_command(CLI::App& app) {
  const auto options = std::make_shared<Options>();
  CLI::App* command = app.add_subcommand("report", "measure speed against error; scripts/report prepares and calls it");
  command->add_option("areas", options->areas, "what to measure; all when none is named")
      ->check(CLI::IsMember(report_areas()));
  command->add_option("--spec", options->spec, "finger spec that the pack was made from")->required();
  command->add_option("--pack", options->pack, "model pack")->required();
  command->add_option("--bench", options->bench, "figures of the program bench, for area solver");
  command->add_option("--soak", options->soak, "figures of scripts/lib/soak.py, for area modbus");
  command->add_option("--attacks", options->attacks, "figures of scripts/lib/attack.py, for area modbus");
  command->add_option("--appliance", options->appliance, "figures of tests/system/boot, for area appliance");
  command->add_option("--page", options->page, "figures of scripts/lib/page_cost.py, for area page");
  command->add_option("--dataset", options->dataset, "the pack's finite-element states, for area touch");
  command->add_option("--recordings", options->recordings, "CSV of recorded touches, for area real");
  command->add_option("-o,--output", options->folder, "folder for results.json and plots")->required();
  command->add_flag("--quick", options->quick, "shorter motions and fewer reads");
  command->callback([options] { run(*options); });
}

}  // namespace finsight::host
