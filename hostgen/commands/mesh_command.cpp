#include <CLI/CLI.hpp>
#include <cstdio>
#include <map>
#include <memory>

#include "hostgen/commands/commands.h"
#include "hostgen/finger/mesh.h"
#include "hostgen/util/common.h"

namespace finsight::host {

namespace {

struct Options {
  std::filesystem::path spec, output;
  std::string size = "default";
};

const std::map<std::string, MeshSize> kSizes = {{"coarse", MeshSize::kCoarse},
                                                {"default", MeshSize::kDefault},
                                                {"medium", MeshSize::kMedium},
                                                {"fine", MeshSize::kFine}};

void run(const Options& options) {
  const FingerSpec spec = read_finger_spec(options.spec);
  check_writable(options.output, {spec.file, spec.surface_file});
  const TetMesh mesh = make_mesh(spec, kSizes.at(options.size));
  write_vtu(options.output, mesh);
  std::printf("%s: %zu nodes, %zu tetrahedra, smallest dihedral angle %.2f deg\n", options.output.c_str(),
              mesh.node_mm.size(), mesh.tets.size(), mesh.min_dihedral_deg);
  std::map<int, int> tets_of_region;
  for (const int region : mesh.region) ++tets_of_region[region];
  static constexpr const char* kRegions[] = {"body", "top plate", "middle plate", "low plate"};
  for (const auto& [region, tets] : tets_of_region) std::printf("region %d %s: %d\n", region, kRegions[region], tets);
  std::printf("touched face: %zu nodes, base: %zu nodes\n", mesh.front_nodes.size(), mesh.base_nodes.size());
}

}  // namespace

void add_mesh_command(CLI::App& app) {
  const auto options = std::make_shared<Options>();
  CLI::App* command = app.add_subcommand("mesh", "mesh a finger and write it for ParaView");
  command->add_option("spec", options->spec, "finger spec (TOML)")->required();
  command->add_option("-o,--output", options->output, "file to write (.vtu)")->required();
  command
      ->add_option("--size", options->size,
                   "coarse, default, medium or fine: about 1,700, 3,500, 6,000 or 16,000 tetrahedra")
      ->check(CLI::IsMember(kSizes));
  command->callback([options] { run(*options); });
}

}  // namespace finsight::host
