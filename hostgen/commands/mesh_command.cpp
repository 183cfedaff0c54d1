#include <CLI/CLI.hpp>
#include <cstdio>
#include <map>
#include <memory>

#include "firmware/input_error.h"
#include "hostgen/commands/commands.h"
#include "hostgen/commands/mesh_report.h"
#include "hostgen/finger/mesh.h"
#include "hostgen/finger/surface_finger.h"
#include "hostgen/util/common.h"

namespace finsight::host {

namespace {

struct MeshOptions {
  std::filesystem::path spec, output;
  std::string size = "default";
};

/// A refused finger is shown as it was read.
FingerSpec read_or_show(const MeshOptions& options) try {
  return read_finger_spec(options.spec);
} catch (const InputError&) {
  if (const auto finger = read_surface_unchecked(options.spec)) {
    check_writable(options.output, {options.spec, finger->source.file});
    write_surface_vtu(options.output, *finger);
    std::fprintf(stderr, "hostgen: %s shows the surface with the boxes, as far as it was understood\n",
                 options.output.c_str());
  }
  throw;
}

void run(const MeshOptions& options) {
  const FingerSpec spec = read_or_show(options);
  check_writable(options.output, {spec.file, spec.surface_file});
  const TetMesh mesh = make_mesh(spec, kMeshSizes.at(options.size));
  write_vtu(options.output, mesh);
  std::printf("%s: %zu nodes, %zu tetrahedra, smallest dihedral angle %.2f deg\n", options.output.c_str(),
              mesh.node_mm.size(), mesh.tets.size(), mesh.min_dihedral_deg);
  std::printf("%s", mesh_advice(mesh).c_str());
  std::map<int, int> tets_of_region;
  for (const int region : mesh.region) ++tets_of_region[region];
  static constexpr const char* kRegions[] = {"body", "top plate", "middle plate", "low plate"};
  for (const auto& [region, tets] : tets_of_region) std::printf("region %d %s: %d\n", region, kRegions[region], tets);
  std::printf("touched face: %zu nodes, base: %zu nodes\n", mesh.front_nodes.size(), mesh.base_nodes.size());
}

}  // namespace

void add_mesh_command(CLI::App& app) {
  const auto options = std::make_shared<MeshOptions>();
  CLI::App* command =
      app.add_subcommand("mesh", "mesh a finger and write it for ParaView; the surface of a finger that is refused");
  command->add_option("spec", options->spec, "finger spec (TOML)")->required();
  command->add_option("-o,--output", options->output, "file to write (.vtu)")->required();
  command
      ->add_option(
          "--size", options->size,
          "coarse, default, medium, fine or finest: of a finger given by dimensions about 1,700, 3,500, 6,000, "
          "16,000 or 58,000 tetrahedra; a surface of many triangles has more")
      ->check(CLI::IsMember(kMeshSizes));
  command->callback([options] { run(*options); });
}

}  // namespace finsight::host
