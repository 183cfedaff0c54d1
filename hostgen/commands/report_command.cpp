// hostgen report: measures, area by area, and writes results.json and plots.
#include <CLI/CLI.hpp>
#include <algorithm>
#include <cstdio>
#include <memory>
#include <nlohmann/json.hpp>

#include "firmware/input_error.h"
#include "hostgen/accuracy/areas.h"
#include "hostgen/commands/commands.h"
#include "hostgen/report/areas.h"
#include "hostgen/report/build_figures.h"
#include "hostgen/report/results.h"
#include "hostgen/util/common.h"

namespace finsight::host {

using nlohmann::json;

namespace {

struct ReportOptions {
  std::filesystem::path pack, spec, folder, dataset, recordings;
  std::vector<std::string> figures;  ///< NAME=FILE
  bool quick = false;
  std::vector<std::string> areas;
};

/// What another program measured, or why it is not there.
json figures_of(const ReportOptions& options, const std::string& name, const char* why) {
  for (const std::string& given : options.figures) {
    if (!given.starts_with(name + "=")) continue;
    const std::filesystem::path file = given.substr(name.size() + 1);
    try {
      return json::parse(read_file(file));
    } catch (const json::exception& error) {
      throw InputError(file.string(), error.what());
    }
  }
  return {{"why", why}};
}

json solver(const ReportOptions& options, const Model& model) {
  json bench = figures_of(options, "bench", "no figures of the program bench were given");
  if (bench.contains("why")) bench = {{"solver", bench}};
  return measure_solver(model, bench, options.quick);
}

json touch(const ReportOptions& options, const Model& model) {
  const json built = read_build_figures(options.pack)["touch"];
  if (options.dataset.empty()) return measure_touch(built, model, nullptr, nullptr, options.quick);
  const FingerSpec spec = read_finger_spec(options.spec);
  const FemDataset dataset = read_dataset(options.dataset);
  check_complete(dataset, spec, make_mesh(spec), options.dataset);
  return measure_touch(built, model, &spec, &dataset, options.quick);
}

json modbus(const ReportOptions& options, const Model&) {
  json figures = measure_modbus(options.quick);
  figures["modbus"]["soak"] = figures_of(options, "soak", "no figures of scripts/lib/soak.py were given");
  const json attacks = figures_of(options, "attack", "no figures of scripts/lib/attack.py were given");
  figures["modbus"].update(attacks.contains("why") ? json{{"attack", attacks}} : attacks);
  return figures;
}

struct Area {
  const char* name;
  json (*measure)(const ReportOptions&, const Model&);
};
/// In the order of the page. scripts/lib/report_run.py brings what other programs measure.
constexpr Area kAreas[] = {
    {"solver", solver},
    {"hard", [](const ReportOptions& o, const Model& model) { return measure_hard_cases(model, o.folder, o.quick); }},
    {"fem", [](const ReportOptions& o,
               const Model&) { return measure_fem(o.spec, read_build_figures(o.pack)["fem"], o.quick); }},
    {"touch", touch},
    {"scene", [](const ReportOptions& o,
                 const Model& model) { return measure_scenes(model, read_finger_spec(o.spec), o.folder, o.quick); }},
    {"fit", [](const ReportOptions& o,
               const Model& model) { return measure_fits(model, read_finger_spec(o.spec), o.folder, o.quick); }},
    {"real",
     [](const ReportOptions& o, const Model& model) { return measure_real(model, o.recordings, o.folder, o.quick); }},
    {"force", [](const ReportOptions& o, const Model&) { return measure_force(read_finger_spec(o.spec), o.quick); }},
    {"vision", [](const ReportOptions& o,
                  const Model& model) { return measure_vision(model, read_finger_spec(o.spec), o.folder, o.quick); }},
    {"modbus", modbus},
    {"page",
     [](const ReportOptions& o, const Model&) {
       return json{{"page", figures_of(o, "page", "no figures of scripts/lib/page_cost.py were given")}};
     }},
    {"fingers",
     [](const ReportOptions& o, const Model&) {
       return json{{"fingers", figures_of(o, "fingers", "no figures of scripts/lib/fingers.py were given")}};
     }},
    {"pictures", [](const ReportOptions& o,
                    const Model& model) { return measure_pictures(model, read_finger_spec(o.spec), o.quick); }},
    {"appliance",
     [](const ReportOptions& o, const Model&) {
       return json{{"appliance", figures_of(o, "appliance", "tests/system/boot has not run on this machine")}};
     }},
};

void run(const ReportOptions& options) {
  const Model model = Model::open(options.pack);
  std::filesystem::create_directories(options.folder);
  Results results(options.folder / "results.json");
  for (const Area& area : kAreas) {
    const bool wanted = options.areas.empty() ||
                        std::find(options.areas.begin(), options.areas.end(), area.name) != options.areas.end();
    if (!wanted) continue;
    std::printf("%s ...\n", area.name);
    std::fflush(stdout);
    results.measured(area.name, area.measure(options, model), options.quick ? "quick" : "full");
    results.write();
  }
  std::printf("%s\n", (options.folder / "results.json").c_str());
}

}  // namespace

void add_report_command(CLI::App& app) {
  const auto options = std::make_shared<ReportOptions>();
  CLI::App* command = app.add_subcommand("report", "measure speed against error; scripts/report prepares and calls it");
  std::vector<std::string> names;
  for (const Area& area : kAreas) names.emplace_back(area.name);
  command->add_option("areas", options->areas, "what to measure; all when none is named")->check(CLI::IsMember(names));
  command->add_option("--spec", options->spec, "finger spec that the pack was made from")->required();
  command->add_option("--pack", options->pack, "model pack")->required();
  command->add_option("--figures", options->figures,
                      "NAME=FILE, what another program measured: bench, attack, soak, page, fingers, appliance");
  command->add_option("--dataset", options->dataset, "the pack's finite-element states, for area touch");
  command->add_option("--recordings", options->recordings, "CSV of recorded touches, for area real");
  command->add_option("-o,--output", options->folder, "folder for results.json and plots")->required();
  command->add_flag("--quick", options->quick, "shorter motions and fewer reads");
  command->callback([options] { run(*options); });
}

}  // namespace finsight::host
