// hostgen mount SESSION: a finger at rest -> where its camera and markers really are, for the board file.
#include <CLI/CLI.hpp>
#include <cstdio>
#include <memory>

#include "firmware/settings/settings.h"
#include "hostgen/calibrate/resting_corners.h"
#include "hostgen/commands/commands.h"
#include "hostgen/finger/mount.h"
#include "hostgen/util/common.h"

namespace finsight::host {

namespace {

struct MountOptions {
  std::filesystem::path session, spec, output;
};

std::string mount_file(const MountEstimate& estimate, const FingerSpec& spec, int frames) {
  return "# Where camera and markers of one device are, made by hostgen mount for the finger " + spec.name + ", from " +
         std::to_string(frames) + " frames.\n# In a board file: mount = \"this file\", before the first table.\n" +
         measured_mount_toml(estimate.mount);
}

void run(const MountOptions& options) {
  const FingerSpec spec = read_finger_spec(options.spec);
  check_writable(options.output, {spec.file, spec.surface_file, options.session / kSessionFrames,
                                  options.session / kSessionInfo, options.session / kSessionTruth});
  const MountModel nominal = mount_of(spec);
  const RestingCorners seen = resting_corners(options.session, nominal);
  const MountEstimate estimate = estimate_mount(nominal, seen, options.session.string());
  write_file_atomically(options.output, mount_file(estimate, spec, seen.frames));
  std::printf("%s%s: for the key mount in a board file; zero the finger again with it (command 1)\n",
              mount_text(estimate).c_str(), options.output.c_str());
}

}  // namespace

void add_mount_command(CLI::App& app) {
  const auto options = std::make_shared<MountOptions>();
  CLI::App* command = app.add_subcommand(
      "mount",
      "find where camera and markers of one device really are, from a session of the finger at rest. What all markers "
      "have in common is put down to the camera");
  command->add_option("session", options->session, "session folder: nothing touches the finger, ten frames or more")
      ->required();
  command->add_option("--spec", options->spec, "finger spec (TOML) that the device's model pack was made from")
      ->required();
  command->add_option("-o,--output", options->output, "file to write (TOML), for the key mount in a board file")
      ->required();
  command->callback([options] { run(*options); });
}

}  // namespace finsight::host
