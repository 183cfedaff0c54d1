// hostgen import-recordings FOLDER -o CSV
#include <CLI/CLI.hpp>
#include <cstdio>
#include <memory>

#include "hostgen/commands/commands.h"
#include "hostgen/recordings/published_files.h"
#include "hostgen/util/common.h"

namespace finsight::host {

void add_import_recordings_command(CLI::App& app) {
  struct ImportRecordingsOptions {
    std::filesystem::path folder, output;
  };
  const auto options = std::make_shared<ImportRecordingsOptions>();
  CLI::App* command =
      app.add_subcommand("import-recordings", "convert the recordings published with the paper into one CSV");
  command
      ->add_option("folder", options->folder,
                   "folder of their YAML files (data/raw of github.com/ancorasir/VisualPropModel)")
      ->required();
  command->add_option("-o,--output", options->output, "CSV to write")->required();
  command->callback([options] {
    const PublishedFiles files = convert_published_files(options->folder);
    write_file_atomically(options->output, files.csv);
    std::printf("%s: %zu rows of %zu recordings\n", options->output.c_str(), files.rows, files.files);
    std::printf(
        "markers: the three that the files name are identical in %zu of %zu rows; the CSV holds the first, bc_top\n",
        files.identical_markers, files.rows);
  });
}

}  // namespace finsight::host
