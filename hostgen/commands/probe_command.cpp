// hostgen probe SPEC
#include <CLI/CLI.hpp>
#include <cstdio>
#include <memory>

#include "hostgen/commands/commands.h"
#include "hostgen/commands/mesh_report.h"
#include "hostgen/probe/probe.h"

namespace finsight::host {

namespace {

struct Options {
  std::filesystem::path spec;
  std::string size = "default";
};

void run(const Options& options) {
  const FingerSpec spec = read_finger_spec(options.spec);
  const TetMesh mesh = make_mesh(spec, kMeshSizes.at(options.size));
  print_mesh(mesh);
  const Probe probe = probe_finger(spec, mesh);
  std::printf("probed in %.0f s; %.1f s of processor time per place, %.0f MB per thread for a factor\n\n%s\n",
              probe.seconds, probe.place_cpu_s, probe.factor_mb, probe_text(probe).c_str());
  check_worth_building(spec, probe);
  std::printf("# proposed for %s\n%s", options.spec.c_str(), proposal_text(spec, probe).c_str());
}

}  // namespace

void add_probe_command(CLI::App& app) {
  const auto options = std::make_shared<Options>();
  CLI::App* command = app.add_subcommand(
      "probe",
      "push a finger at nine places before the long work: which forces it bears, how far its plates move, what the "
      "camera could measure; proposes force range, threshold, rated deformation, plates' ranges and noise as TOML");
  command->add_option("spec", options->spec, "finger spec (TOML)")->required();
  command->add_option("--size", options->size, "of the mesh: coarse, default, medium, fine or finest")
      ->check(CLI::IsMember(kMeshSizes))
      ->capture_default_str();
  command->callback([options] { run(*options); });
}

}  // namespace finsight::host
