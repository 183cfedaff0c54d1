// hostgen: compiles a finger spec into a model pack, and makes what is needed to try and measure it.
#include <CLI/CLI.hpp>
#include <cstdio>

#include "firmware/input_error.h"
#include "hostgen/commands/commands.h"
#include "hostgen/util/common.h"

int main(int argc, char** argv) {
  using namespace finsight;
  CLI::App app("hostgen: from a finger spec to the model pack that finsightd runs", "hostgen");
  app.set_version_flag("--version", "hostgen " FINSIGHT_VERSION);
  app.require_subcommand(1);
  app.footer("exit codes: 0 done, 1 failed at work or interrupted, 2 bad input or usage");
  host::add_build_command(app);
  host::add_new_command(app);
  host::add_probe_command(app);
  host::add_mesh_command(app);
  host::add_dataset_command(app);
  host::add_merge_command(app);
  host::add_camera_command(app);
  host::add_render_command(app);
  host::add_figure_command(app);
  host::add_inspect_command(app);
  host::add_plc_command(app);
  host::add_report_command(app);
  host::add_attack_command(app);
  host::add_page_cost_command(app);
  host::add_import_recordings_command(app);
  host::add_audit_command(app);
  host::add_train_command(app);
  host::add_force_command(app);
  host::add_identify_command(app);
  host::add_calibrate_command(app);
  host::add_mount_command(app);
  host::add_jig_command(app);
  host::add_fit_command(app);
  host::add_verify_command(app);
  host::catch_interrupts();
  try {
    app.parse(argc, argv);  // runs the subcommand's callback
    return 0;
  } catch (const CLI::RuntimeError& error) {
    return error.get_exit_code();  // a command that has said what failed
  } catch (const CLI::ParseError& error) {
    return app.exit(error) == 0 ? 0 : 2;
  } catch (const InputError& error) {
    std::fprintf(stderr, "hostgen: %s\n", error.what());
    return 2;
  } catch (const std::exception& error) {
    std::fprintf(stderr, "hostgen: %s\n", error.what());
    return 1;
  }
}
