// One function per subcommand, each in <name>_command.cpp beside this file.
#pragma once

namespace CLI {
class App;
}

namespace finsight::host {

void add_mesh_command(CLI::App& app);
void add_dataset_command(CLI::App& app);
void add_merge_command(CLI::App& app);  // in dataset_command.cpp
void add_build_command(CLI::App& app);
void add_inspect_command(CLI::App& app);
void add_camera_command(CLI::App& app);
void add_render_command(CLI::App& app);
void add_figure_command(CLI::App& app);
void add_plc_command(CLI::App& app);
void add_report_command(CLI::App& app);
void add_attack_command(CLI::App& app);
void add_page_cost_command(CLI::App& app);
void add_import_recordings_command(CLI::App& app);
void add_audit_command(CLI::App& app);
void add_train_command(CLI::App& app);
void add_force_command(CLI::App& app);
void add_identify_command(CLI::App& app);
void add_calibrate_command(CLI::App& app);
void add_mount_command(CLI::App& app);
void add_jig_command(CLI::App& app);
void add_new_command(CLI::App& app);
void add_probe_command(CLI::App& app);
void add_fit_command(CLI::App& app);
void add_verify_command(CLI::App& app);

}  // namespace finsight::host
