// hostgen plc FOLDER
#include <CLI/CLI.hpp>
#include <filesystem>
#include <fstream>
#include <memory>

#include "hostgen/commands/commands.h"
#include "hostgen/plc/plc_files.h"

namespace finsight::host {

namespace {

void write_file(const std::filesystem::path& file, const std::string& text) {
  std::ofstream out(file, std::ios::binary);
  out << text;
  out.flush();
  if (!out) throw std::runtime_error(file.string() + ": cannot be written");
  std::printf("%s\n", file.c_str());
}

}  // namespace

void add_plc_command(CLI::App& app) {
  CLI::App* command =
      app.add_subcommand("plc", "Writes the register table for PLCs: registers.csv, Finsight.st, Finsight.scl");
  const auto folder = std::make_shared<std::string>("hostgen/plc");
  command->add_option("FOLDER", *folder, "where to")->capture_default_str();
  command->callback([folder] {
    std::filesystem::create_directories(*folder);
    const std::filesystem::path to = *folder;
    write_file(to / "registers.csv", registers_csv());
    write_file(to / "Finsight.st", structured_text());
    write_file(to / "Finsight.scl", siemens_scl());
  });
}

}  // namespace finsight::host
