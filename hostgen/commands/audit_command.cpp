// hostgen audit CSV
#include <CLI/CLI.hpp>
#include <cstdio>
#include <memory>

#include "hostgen/commands/commands.h"
#include "hostgen/recordings/audit.h"
#include "hostgen/util/common.h"
#include "hostgen/util/output_name.h"

namespace finsight::host {

void add_audit_command(CLI::App& app) {
  struct AuditOptions {
    std::filesystem::path csv, image;
  };
  const auto options = std::make_shared<AuditOptions>();
  CLI::App* command =
      app.add_subcommand("audit", "say what is wrong with recorded touches before anyone trains on them");
  command->add_option("csv", options->csv, "recordings (import-recordings writes them)")->required();
  command->add_option("-o,--output", options->image, "image to write (.svg); default: NAME-audit.svg in this folder");
  command->callback([options] {
    if (options->image.empty()) options->image = options->csv.stem().string() + "-audit.svg";
    check_extension(options->image, {".svg"});
    check_writable(options->image, {options->csv});
    const RecordedMotion motion = read_recorded_motion(options->csv, "");
    const RecordingAudit audit = audit_recordings(motion);
    std::fputs(audit_table(audit).c_str(), stdout);
    plot_audit(audit, motion, options->image);
    std::printf("%s\n", options->image.c_str());
  });
}

}  // namespace finsight::host
