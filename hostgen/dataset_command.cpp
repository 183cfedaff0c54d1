#include <CLI/CLI.hpp>
#include <algorithm>
#include <cstdio>
#include <memory>

#include "hostgen/commands.h"
#include "hostgen/fem/dataset.h"

namespace finsight::host {

namespace {

struct Options {
  std::filesystem::path spec, output;
  DatasetPlan plan;
};

void run(const Options& options) {
  const FingerSpec spec = read_finger_spec(options.spec);
  const FemDataset dataset = make_dataset(spec, make_mesh(spec), options.plan);
  write_dataset(options.output, dataset);
  const auto valid = std::count_if(dataset.states.begin(), dataset.states.end(), [](const FemState& s) { return s.valid; });
  std::printf("%s: %zu states, %zu of them not valid (no equilibrium, or pushed further than the limit)\n",
              options.output.c_str(), dataset.states.size(), dataset.states.size() - static_cast<std::size_t>(valid));
}

}  // namespace

void add_dataset_command(CLI::App& app) {
  const auto options = std::make_shared<Options>();
  CLI::App* command = app.add_subcommand("dataset", "compute finite-element states of the touched finger");
  command->add_option("spec", options->spec, "finger spec (TOML)")->required();
  command->add_option("-o,--output", options->output, "file to write (.safetensors)")->required();
  command->add_option("--points", options->plan.points, "touched points")->check(CLI::Range(1, 5000))->capture_default_str();
  command->add_option("--forces", options->plan.forces, "forces per point, over the spec's range")
      ->check(CLI::Range(1, 200))
      ->capture_default_str();
  command->callback([options] { run(*options); });
}

}  // namespace finsight::host
