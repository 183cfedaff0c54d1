// hostgen audit CSV
#include <CLI/CLI.hpp>
#include <cstdio>
#include <memory>

#include "hostgen/commands.h"
#include "hostgen/common.h"
#include "hostgen/recordings/audit.h"

namespace finsight::host {

void add_audit_command(CLI::App& app) {
  struct Options {
    std::filesystem::path csv, picture;
  };
  const auto options = std::make_shared<Options>();
  CLI::App* command =
      app.add_subcommand("audit", "say what is wrong with recorded touches before anyone trains on them");
  command->add_option("csv", options->csv, "recordings (import-recordings writes them)")->required();
  command->add_option("-o,--output", options->picture, "picture to write (.svg); NAME-audit.svg here when not given");
  command->callback([options] {
    if (options->picture.empty()) options->picture = options->csv.stem().string() + "-audit.svg";
    check_writable(options->picture, {options->csv});
    const RecordedMotion motion = read_recorded_motion(options->csv, "");
    const RecordingAudit audit = audit_recordings(motion);
    std::fputs(audit_table(audit).c_str(), stdout);
    plot_audit(audit, motion, options->picture);
    std::printf("%s\n", options->picture.c_str());
  });
}

}  // namespace finsight::host
