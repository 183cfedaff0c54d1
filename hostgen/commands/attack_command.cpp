// hostgen attack --port P --process PID -o FILE
#include <CLI/CLI.hpp>
#include <cstdio>
#include <memory>
#include <nlohmann/json.hpp>
#include <string>

#include "hostgen/commands/commands.h"
#include "hostgen/commands/options.h"
#include "hostgen/report/attack.h"
#include "hostgen/util/common.h"

namespace finsight::host {

void add_attack_command(CLI::App& app) {
  struct AttackOptions {
    int port = 0, process = 0;
    double seconds = 10;
    std::string output;
  };
  const auto options = std::make_shared<AttackOptions>();
  CLI::App* command = app.add_subcommand(
      "attack", "a lawful Modbus client beside attackers of a firmware on this machine; scripts/report calls it");
  command->add_option("--port", options->port, "of the firmware")->required()->check(CLI::Range(1, 65535));
  command->add_option("--process", options->process, "its process id")->required();
  command->add_option("--seconds", options->seconds, "of each attack")->check(between(1.0, 3600.0));
  command->add_option("-o,--output", options->output, "file for the figures (JSON)")->required();
  command->callback([options] {
    const nlohmann::json figures = measure_attacks(options->port, options->process, options->seconds);
    write_file_atomically(options->output, figures.dump(1) + "\n");
    std::printf("%s\n", figures.dump(1).c_str());
  });
}

}  // namespace finsight::host
