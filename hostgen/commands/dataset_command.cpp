// hostgen dataset: the training truth, whole or as a shard for a cluster; hostgen merge: shards -> the whole set.
#include <CLI/CLI.hpp>
#include <cstdio>
#include <memory>

#include "firmware/input_error.h"
#include "hostgen/commands/commands.h"
#include "hostgen/commands/mesh_report.h"
#include "hostgen/fem/dataset.h"
#include "hostgen/fem/deformation.h"
#include "hostgen/util/common.h"

namespace finsight::host {

namespace {

struct DatasetOptions {
  std::filesystem::path spec, output;
  std::string shard, scene, size = "default";
  bool only_scene = false;
  DatasetPlan plan;
};

/// "3/8" is the third of eight.
Shard parse_shard(const std::string& text) {
  int index = 0, count = 0, used = 0;
  if (std::sscanf(text.c_str(), "%d/%d%n", &index, &count, &used) != 2 ||
      static_cast<std::size_t>(used) != text.size() || index < 1 || index > count) {
    throw InputError("command line", "--shard", "'" + text + "'", "i/n with 1 <= i <= n, such as 3/8");
  }
  return {index - 1, count};
}

void print_summary(const std::filesystem::path& file, const FemDataset& dataset) {
  std::printf(
      "%s: %zu states: %zu valid, %zu pushed too far, %zu buckled, %zu not converged; %zu of other scenes, "
      "%zu kept from learning\n",
      file.c_str(), dataset.states.size(), dataset.count(Outcome::kEquilibrium), dataset.count(Outcome::kPushedTooFar),
      dataset.count(Outcome::kNoEquilibrium), dataset.count(Outcome::kNotConverged), dataset.others.size(),
      dataset.kept.size());
}

void run(const DatasetOptions& options) {
  const FingerSpec spec = read_finger_spec(options.spec);
  Shard shard = options.shard.empty() ? Shard{} : parse_shard(options.shard);
  shard.only_scene = options.only_scene;
  if (shard.count > options.plan.points) {
    throw InputError("command line", "--shard", options.shard, "at most one shard per point");
  }
  check_writable(options.output, {spec.file, spec.surface_file});
  const std::filesystem::path resume = options.output.string() + ".paths";
  DatasetPlan plan = options.plan;
  plan.scene = spec.scene(options.scene.empty() ? spec.trained_scene : options.scene).name;
  const TetMesh mesh = make_mesh(spec, kMeshSizes.at(options.size));
  print_mesh(mesh);
  const FemDataset dataset = make_dataset(spec, mesh, plan, shard, resume);
  write_dataset(options.output, dataset);
  std::filesystem::remove_all(resume);
  print_summary(options.output, dataset);
  if (dataset.count(Outcome::kEquilibrium) == 0) {
    throw std::runtime_error(options.output.string() + ": no load reached equilibrium; nothing can be learned from it");
  }
  const DeformationRise rise = measure_deformation_rise(spec.scene(plan.scene), dataset, mesh.front_nodes);
  std::printf("%s\n", deformation_text(rise, spec.rated_deformation_mm).c_str());
}

}  // namespace

void add_dataset_command(CLI::App& app) {
  const auto options = std::make_shared<DatasetOptions>();
  CLI::App* command = app.add_subcommand("dataset", "compute finite-element states of the touched finger");
  command->add_option("spec", options->spec, "finger spec (TOML)")->required();
  command
      ->add_option("-o,--output", options->output,
                   "file to write (.safetensors); an interrupted run keeps finished paths in OUTPUT.paths and "
                   "continues from them when it is started again")
      ->required();
  command->add_option("--points", options->plan.points, "touched points")
      ->check(CLI::Range(1, 5000))
      ->capture_default_str();
  command->add_option("--forces", options->plan.forces, "forces per point, over the spec's range")
      ->check(CLI::Range(1, 200))
      ->capture_default_str();
  command->add_option("--size", options->size, "of the mesh: coarse, default, medium, fine or finest")
      ->check(CLI::IsMember(kMeshSizes))
      ->capture_default_str();
  command->add_option("--scene", options->scene,
                      "which contacts: probe, grasp, two or another of the spec's scenes "
                      "(default: the one that the spec's touch.scene names)");
  CLI::Option* only_scene =
      command->add_flag("--only-scene", options->only_scene,
                        "only touches of the scene: a third to half of the work, but no pack can be "
                        "trained from them, since it must tell other contacts from touches");
  command
      ->add_option("--shard", options->shard, "i/n: only the i-th of n equal parts; hostgen merge puts them together")
      ->excludes(only_scene);  // merged, they would lack the other contacts' paths
  command->callback([options] { run(*options); });
}

void add_merge_command(CLI::App& app) {
  struct MergeOptions {
    std::vector<std::filesystem::path> shards;
    std::filesystem::path output;
  };
  const auto options = std::make_shared<MergeOptions>();
  CLI::App* command = app.add_subcommand("merge", "put the shards of hostgen dataset together");
  command->add_option("shards", options->shards, "all files of --shard 1/n ... n/n, in any order")->required();
  command->add_option("-o,--output", options->output, "file to write (.safetensors)")->required();
  command->callback([options] {
    check_writable(options->output, options->shards);
    const FemDataset dataset = merge_datasets(options->shards);
    write_dataset(options->output, dataset);
    print_summary(options->output, dataset);
  });
}

}  // namespace finsight::host
