// hostgen identify CSV SPEC
#include <CLI/CLI.hpp>
#include <algorithm>
#include <cstdio>
#include <memory>

#include "firmware/input_error.h"
#include "hostgen/commands/commands.h"
#include "hostgen/recordings/audit.h"
#include "hostgen/recordings/identify.h"

namespace finsight::host {

namespace {

struct IdentifyOptions {
  std::filesystem::path csv, spec;
  int points = 12, iterations = 4;
};

void print(const Identification& found, const RecordingAudit& audit) {
  std::printf("%-28s %10s %10s %12s\n", "number", "spec", "fitted", "std. dev.");
  for (const IdentifiedNumber& number : found.numbers) {
    if (number.identifiable) {
      std::printf("%-28s %10.3f %10.3f %12.3f\n", number.key.c_str(), number.before, number.after, number.sigma);
    } else {
      std::printf("%-28s %10.3f   not identifiable from these recordings\n", number.key.c_str(), number.before);
    }
  }
  std::printf(
      "plate motion at the recorded push, RMS error (a degree counts as 0.5 mm): %.3f mm before, %.3f mm after\n",
      found.rms_before_mm, found.rms_after_mm);
  if (!found.changed) std::printf("nothing was changed: %s\n", found.why_unchanged.c_str());
  std::printf("%zu pushes; %zu of them left out: the simulated finger finds no equilibrium\n", found.pushes,
              found.failed);
  std::printf(
      "no force was recorded: stiffness alone does not change where a push to a given depth moves the plates\n");
  const auto& residual = audit.pen_residual_mm;
  if (audit.touch_is_computed()) {
    std::printf(
        "the touch columns are a function of the plate's pose (to %.4f mm): they were computed, not measured, so\n"
        "this fits one model to another, and the numbers are not those of the real finger\n",
        std::max({residual[0], residual[1], residual[2]}));
  }
}

void run(const IdentifyOptions& options) {
  const FingerSpec spec = read_finger_spec(options.spec);
  if (spec.surface) {
    throw InputError(options.spec.string(), "surface", "a finger from a file", "[shape], whose numbers can be fitted");
  }
  const RecordedMotion motion = read_recorded_motion(options.csv, "");
  const RecordingAudit audit = audit_recordings(motion);
  const auto pushes = recorded_pushes(motion, spec, static_cast<std::size_t>(options.points));
  print(identify_spec(
            spec, pushes, [](const FingerSpec& changed) { return make_mesh(changed, MeshSize::kCoarse); },
            options.iterations),
        audit);
}

}  // namespace

void add_identify_command(CLI::App& app) {
  const auto options = std::make_shared<IdentifyOptions>();
  CLI::App* command = app.add_subcommand(
      "identify",
      "fit the spec's wall thicknesses, base ring and Young's modulus to recorded pushes, and say which of "
      "them the recordings determine");
  command->add_option("csv", options->csv, "recordings (import-recordings writes them)")->required();
  command->add_option("spec", options->spec, "finger spec (TOML) to start from; it is not changed")->required();
  command->add_option("--points", options->points, "use at most this many contact points, two pushes each")
      ->check(CLI::Range(3, 1000))
      ->capture_default_str();
  command->add_option("--iterations", options->iterations, "of the fit")
      ->check(CLI::Range(1, 20))
      ->capture_default_str();
  command->callback([options] { run(*options); });
}

}  // namespace finsight::host
