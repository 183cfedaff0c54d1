// hostgen calibrate FOLDER: images of a ChArUco board -> the lens for the board file.
#include <CLI/CLI.hpp>
#include <cstdio>
#include <memory>

#include "firmware/input_error.h"
#include "hostgen/calibrate/board_png.h"
#include "hostgen/calibrate/board_views.h"
#include "hostgen/calibrate/calibration_report.h"
#include "hostgen/commands/commands.h"
#include "hostgen/commands/options.h"
#include "hostgen/util/common.h"
#include "hostgen/util/output_name.h"

namespace finsight::host {

namespace {

namespace fs = std::filesystem;

struct CalibrateOptions {
  fs::path folder, output, plot, print_board;
  std::string squares = "10x7";
  double square_mm = 8;
  int every = 10;
};

CharucoBoard board_of(const CalibrateOptions& options) {
  CharucoBoard board;
  char rest = 0;
  if (std::sscanf(options.squares.c_str(), "%2dx%2d%c", &board.columns, &board.rows, &rest) != 2) {
    throw InputError("--squares", "board", options.squares, "columns and rows, such as 10x7");
  }
  board.check();
  return board;
}

void print_board(const CalibrateOptions& options, const CharucoBoard& board) {
  check_extension(options.print_board, {".svg", ".png"});
  const bool is_svg = options.print_board.extension() == ".svg";
  write_file_atomically(options.print_board,
                        is_svg ? board_svg(board, options.square_mm) : board_png(board, options.square_mm));
  std::printf("%s: %dx%d squares of %g mm. Print it without scaling, measure a square, and fix it to something flat.\n",
              options.print_board.c_str(), board.columns, board.rows, options.square_mm);
}

void calibrate(const CalibrateOptions& options, const CharucoBoard& board) {
  std::vector<fs::path> used = image_files(options.folder);
  check_writable(options.output, used);
  used.push_back(options.output);
  if (!options.plot.empty()) {
    check_writable(options.plot, used);
    check_extension(options.plot, {".svg"});
  }
  std::vector<BoardView> views = read_board_views(options.folder, board, options.every);
  reject_bad_views(board, views);
  LensCalibration calibration;
  try {
    calibration = calibrate_lens(board, views, options.folder.string(), [] {
      if (interrupted()) throw Interrupted();
    });
  } catch (const InputError&) {
    std::printf("%s", view_table(views).c_str());
    throw;
  }
  const Coverage coverage = coverage_of(calibration, views);
  std::printf("%s%s", view_table(views).c_str(), calibration_text(calibration, coverage).c_str());
  write_file_atomically(options.output, lens_file(calibration, options.folder.string()));
  std::printf("%s: for the key lens in a board file's [source]\n", options.output.c_str());
  if (!options.plot.empty()) plot_calibration(calibration, views, options.plot);
}

void run(const CalibrateOptions& options) {
  const CharucoBoard board = board_of(options);
  if (!options.print_board.empty()) return print_board(options, board);
  if (options.folder.empty() || options.output.empty()) {
    throw InputError("calibrate", "a folder of images and --output are needed, or --print-board; see --help");
  }
  calibrate(options, board);
}

}  // namespace

void add_calibrate_command(CLI::App& app) {
  const auto options = std::make_shared<CalibrateOptions>();
  CLI::App* command = app.add_subcommand(
      "calibrate",
      "find the camera's lens from images of a calibration board (.png, .pgm, .y4m), and say what is missing: ten or "
      "more views that together cover the image, tilted in all directions");
  command->add_option("folder", options->folder, "images, all of the size that finsightd will use; a session too");
  command->add_option("-o,--output", options->output, "file to write (TOML), for the key lens in a board file");
  command->add_option("--plot", options->plot, "draw corners and their distance from the model (SVG; needs gnuplot)");
  command->add_option("--print-board", options->print_board, "only write a board for the printer (.svg or .png)");
  command->add_option("--squares", options->squares, "of the board: columns x rows, an odd number of rows")
      ->capture_default_str();
  command->add_option("--square-mm", options->square_mm, "side of a printed square; the calibration does not need it")
      ->check(between(1.0, 500.0))
      ->capture_default_str();
  command->add_option("--every", options->every, "use every Nth frame of .y4m files")
      ->check(CLI::Range(1, 100000))
      ->capture_default_str();
  command->callback([options] { run(*options); });
}

}  // namespace finsight::host
