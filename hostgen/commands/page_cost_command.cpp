// hostgen page-cost --folder FOLDER --port P -o FILE
#include <CLI/CLI.hpp>
#include <cstdio>
#include <memory>
#include <nlohmann/json.hpp>
#include <string>

#include "hostgen/commands/commands.h"
#include "hostgen/commands/options.h"
#include "hostgen/report/page_cost.h"
#include "hostgen/util/common.h"

namespace finsight::host {

void add_page_cost_command(CLI::App& app) {
  struct PageCostOptions {
    std::string folder, output;
    int port = 0, rounds = 9, browsers = 3;
    double seconds = 10;
  };
  const auto options = std::make_shared<PageCostOptions>();
  CLI::App* command = app.add_subcommand(
      "page-cost", "what watching browsers cost a firmware on this machine; scripts/report calls it");
  command->add_option("--folder", options->folder, "page.folder of the board file")->required();
  command->add_option("--port", options->port, "of finsight-page")->required()->check(CLI::Range(1, 65535));
  command->add_option("--seconds", options->seconds, "of each turn")->check(between(2.0, 600.0))->capture_default_str();
  command->add_option("--rounds", options->rounds, "of two turns, unwatched and watched")
      ->check(CLI::Range(1, 1000))
      ->capture_default_str();
  command->add_option("--browsers", options->browsers, "that watch")->check(CLI::Range(1, 4))->capture_default_str();
  command->add_option("-o,--output", options->output, "file for the figures (JSON)")->required();
  command->callback([options] {
    const nlohmann::json figures =
        measure_page_cost(options->folder, options->port, options->seconds, options->rounds, options->browsers);
    write_file_atomically(options->output, figures.dump(1) + "\n");
    std::printf("%s\n", figures.dump(1).c_str());
  });
}

}  // namespace finsight::host
