// hostgen plc [FOLDER] [--tree ROOT]
#include <CLI/CLI.hpp>
#include <cstdio>
#include <filesystem>
#include <memory>
#include <stdexcept>

#include "hostgen/commands/commands.h"
#include "hostgen/plc/plc_files.h"
#include "hostgen/util/common.h"

namespace finsight::host {

namespace {

namespace fs = std::filesystem;

/// A file that is there already keeps its permissions: finsightctl is a program.
void write(const fs::path& file, const std::string& text) {
  const fs::file_status before = fs::status(file);
  write_file_atomically(file, text);
  if (fs::exists(before)) fs::permissions(file, before.permissions());
  std::printf("%s\n", file.c_str());
}

void write_plc_files(const fs::path& folder) {
  fs::create_directories(folder);
  write(folder / "registers.csv", registers_csv());
  write(folder / "Finsight.st", structured_text());
  write(folder / "Finsight.scl", siemens_scl());
  write(folder / "Finsight.L5X", rockwell_l5x());
  write(folder / "Finsight.kepware.csv", kepware_csv());
  write(folder / "Finsight.ignition.csv", ignition_csv());
  write(folder / "Finsight.node-red.json", node_red_flow());
}

void rewrite_section(const fs::path& file, const std::string& name, const std::string& content) {
  try {
    write(file, with_section(read_file(file), name, content));
  } catch (const std::runtime_error& error) {
    throw std::runtime_error(file.string() + ": " + error.what());
  }
}

/// Everything in a source tree that is generated from the register table.
void update_tree(const fs::path& root) {
  write_plc_files(root / "hostgen/plc");
  rewrite_section(root / "scripts/finsightctl", "register table", finsightctl_table());
  rewrite_section(root / "hostgen/plc/README.md", "faults", faults_markdown());
  rewrite_section(root / "firmware/modbus/README.md", "measurements", measurements_markdown());
  rewrite_section(root / "firmware/modbus/README.md", "control", control_markdown());
  rewrite_section(root / "firmware/modbus/README.md", "process", process_markdown());
  rewrite_section(root / "firmware/modbus/README.md", "history", history_markdown());
  rewrite_section(root / "firmware/modbus/README.md", "gathered", gathered_markdown());
  rewrite_section(root / "firmware/modbus/README.md", "diagnostics", diagnostics_markdown());
}

}  // namespace

void add_plc_command(CLI::App& app) {
  CLI::App* command = app.add_subcommand("plc",
                                         "Writes the register table for PLCs: registers.csv, Finsight.st, .scl, .L5X, "
                                         ".kepware.csv, .ignition.csv, .node-red.json");
  const auto folder = std::make_shared<std::string>(), root = std::make_shared<std::string>();
  auto* const to_folder = command->add_option("FOLDER", *folder, "folder for the seven files");
  auto* const to_tree = command->add_option(
      "--tree", *root, "instead: a source tree, in which finsightctl's table and the README's are rewritten, too");
  to_folder->excludes(to_tree);
  command->callback([folder, root] {
    if (folder->empty() == root->empty()) throw CLI::ValidationError("plc", "expected FOLDER or --tree ROOT");
    folder->empty() ? update_tree(*root) : write_plc_files(*folder);
  });
}

}  // namespace finsight::host
