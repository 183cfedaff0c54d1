// hostgen figure SESSION: one frame of a session as a picture of the sensor at work.
#include <CLI/CLI.hpp>
#include <cstdio>
#include <memory>

#include "firmware/input_error.h"
#include "firmware/ports/camera.h"
#include "firmware/settings/settings.h"
#include "firmware/shape/shape_stage.h"
#include "firmware/touch/touch_stage.h"
#include "firmware/vision/observer.h"
#include "hostgen/calibrate/grey_image.h"
#include "hostgen/commands/commands.h"
#include "hostgen/render/figure.h"
#include "hostgen/util/common.h"
#include "hostgen/util/output_name.h"

namespace finsight::host {

namespace {

namespace fs = std::filesystem;

struct FigureOptions {
  fs::path session, pack, output;
  int frame = -1;
};

struct NumberedFrame {
  FrameResult result;
  int number = -1;
};

/// Runs the firmware's stages over the session up to the wanted frame; with none wanted, over all of it, and returns
/// the one with the largest force.
NumberedFrame measure(const FigureOptions& options, const Model& model) {
  const SessionInfo info = read_session_info(options.session);
  check_markers(info, options.session, model.mount.marker_id, static_cast<double>(model.mount.marker_size_mm),
                options.pack.string());
  Observer observer(model.mount, model.prior, info.lens);
  ShapeStage shapes(model, {});
  TouchStage touches(model);
  const auto camera = open_session_camera({.path = options.session, .recording = "", .recorded_speed = false}, info);
  NumberedFrame chosen;
  Frame frame;
  for (int number = 0; camera->next(frame, 0); ++number) {
    if (interrupted()) throw Interrupted();
    const PlatePoses poses = observer.observe(frame, {}).poses;
    const FingerShape& shape = shapes.solve(poses);
    const Touch& touch = touches.locate(poses);
    const bool strongest = shape.quality == Quality::kFresh && touch.quality == Quality::kFresh &&
                           touch.force_n > chosen.result.touch.force_n;
    if (options.frame >= 0 ? number != options.frame : !strongest) continue;
    chosen.number = number;
    chosen.result = {{frame.grey, frame.grey + static_cast<std::ptrdiff_t>(frame.stride_bytes) * frame.height_px},
                     frame.width_px,
                     frame.height_px,
                     observer.corners(),
                     {shape.node_mm.begin(), shape.node_mm.end()},
                     touch};
    if (number == options.frame) break;
  }
  if (!camera->error().empty()) throw InputError(options.session.string(), camera->error());
  if (chosen.number < 0) {
    throw InputError(options.session.string(), options.frame >= 0 ? "has no frame " + std::to_string(options.frame)
                                                                  : "shows no touch; --frame takes any frame");
  }
  return chosen;
}

void run(const FigureOptions& options) {
  check_extension(options.output, {".png"});
  check_writable(options.output, {options.pack, options.session / kSessionFrames, options.session / kSessionInfo});
  const Model model = Model::open(options.pack);
  const NumberedFrame frame = measure(options, model);
  const ColourImage figure = draw_figure(model.shape, model.mount.marker_id, frame.result);
  write_file_atomically(options.output, colour_png_bytes(figure.width_px, figure.height_px, figure.rgb));
  const Touch& touch = frame.result.touch;
  std::printf("%s: frame %d, ", options.output.c_str(), frame.number);
  if (touch.quality == Quality::kInvalid) {
    std::printf("no touch\n");
    return;
  }
  std::printf("touch at %.1f %.1f %.1f mm (68 %% within %.1f mm), %.2f N\n", static_cast<double>(touch.point_mm.x()),
              static_cast<double>(touch.point_mm.y()), static_cast<double>(touch.point_mm.z()),
              static_cast<double>(touch.radius_68_mm), static_cast<double>(touch.force_n));
}

}  // namespace

void add_figure_command(CLI::App& app) {
  const auto options = std::make_shared<FigureOptions>();
  CLI::App* command = app.add_subcommand(
      "figure", "draw one frame of a session: the markers found, the reconstructed finger and its touch (PNG)");
  command->add_option("session", options->session, "session folder (hostgen render and boards record them)")
      ->required();
  command->add_option("--pack", options->pack, "model pack of this finger")->required();
  command->add_option("-o,--output", options->output, "file to write (.png)")->required();
  command->add_option("--frame", options->frame, "number of the frame, from 0; the strongest touch when not given")
      ->check(CLI::Range(0, 100000000));
  command->callback([options] { run(*options); });
}

}  // namespace finsight::host
