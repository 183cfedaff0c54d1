// hostgen probe SPEC
#include <CLI/CLI.hpp>
#include <cstdio>
#include <memory>

#include "firmware/input_error.h"
#include "hostgen/commands/commands.h"
#include "hostgen/commands/mesh_report.h"
#include "hostgen/probe/probe.h"
#include "hostgen/util/common.h"

namespace finsight::host {

namespace {

struct ProbeOptions {
  std::filesystem::path spec;
  std::string size = "default";
};

void run(const ProbeOptions& options) {
  const FingerSpec spec = read_finger_spec(options.spec);
  const TetMesh mesh = make_mesh(spec, kMeshSizes.at(options.size));
  print_mesh(mesh);
  const Probe probe = probe_finger(spec, mesh, kProbeLimit_s, [](double factor_mb) {
    std::printf("a factor of this mesh takes %.0f MB, one per thread (%zu); two minutes at most\n", factor_mb,
                usable_cores());
    std::fflush(stdout);
  });
  std::printf("probed in %.0f s; %.1f s of processor time per place\n\n%s\n", probe.seconds, probe.place_cpu_s,
              probe_text(probe).c_str());
  const std::string proposal = proposal_text(spec, probe);
  std::printf("# proposed for %s\n%s", options.spec.c_str(), proposal.c_str());
  std::fflush(stdout);
  try {
    check_worth_building(spec, probe);
  } catch (const InputError& error) {
    if (proposal.find("[touch]") == std::string::npos) throw;
    std::printf("\n# needed: as it stands, %s\n", error.what());
  }
}

}  // namespace

void add_probe_command(CLI::App& app) {
  const auto options = std::make_shared<ProbeOptions>();
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
