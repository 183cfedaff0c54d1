// hostgen inspect PACK
#include <CLI/CLI.hpp>
#include <cstdio>
#include <memory>

#include "hostgen/commands/commands.h"
#include "hostgen/pack/model_pack.h"

namespace finsight::host {

void add_inspect_command(CLI::App& app) {
  CLI::App* command = app.add_subcommand("inspect", "check a model pack as the firmware does and print what is in it");
  const auto pack = std::make_shared<std::string>();
  command->add_option("pack", *pack, "model pack (.safetensors)")->required();
  command->callback([pack] { std::fputs(describe_model_pack(Model::open(*pack)).c_str(), stdout); });
}

}  // namespace finsight::host
