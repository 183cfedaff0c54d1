// hostgen new FILE.stl -o finger.toml
#include <CLI/CLI.hpp>
#include <cstdio>
#include <memory>

#include "firmware/input_error.h"
#include "hostgen/calibrate/grey_image.h"
#include "hostgen/commands/commands.h"
#include "hostgen/finger/mesh.h"
#include "hostgen/finger/spec.h"
#include "hostgen/first_spec/camera_picture.h"
#include "hostgen/first_spec/first_spec.h"
#include "hostgen/util/common.h"
#include "hostgen/util/output_name.h"

namespace finsight::host {

namespace {

struct NewOptions {
  std::filesystem::path surface, output;
};

/// The lens of the spec's small picture.
Lens usual_lens() {
  return {.width_px = 640,
          .height_px = 480,
          .fx = 490.70,
          .fy = 490.60,
          .cx = 303.5867,
          .cy = 243.6400,
          .k1 = -0.3956,
          .k2 = 0.2259,
          .p1 = 0,
          .p2 = 0,
          .k3 = -0.0912};
}

std::string picture_of(const FirstSpec& first) {
  Eigen::Isometry3d T_finger_camera = Eigen::Isometry3d::Identity();
  T_finger_camera.linear() << 1, 0, 0, 0, 0, 1, 0, -1, 0;
  T_finger_camera.translation() = first.camera_mm;
  std::vector<PicturedMarker> markers;
  for (const PlateGuess& plate : first.plates) {
    PicturedMarker marker{.id = static_cast<int>(markers.size()), .size_mm = first.marker_size_mm};
    marker.T_finger_marker.linear() << 1, 0, 0, 0, 0, -1, 0, 1, 0;
    marker.T_finger_marker.translation() = plate.marker_mm;
    markers.push_back(marker);
  }
  const Lens lens = usual_lens();
  const std::vector<std::uint8_t> grey = camera_picture(first.finger.surface, markers, T_finger_camera, lens);
  std::vector<std::uint8_t> rgb;
  for (const std::uint8_t level : grey) rgb.insert(rgb.end(), 3, level);
  return colour_png_bytes(lens.width_px, lens.height_px, rgb);
}

/// A refused surface is shown as it was read.
FirstSpec propose_or_show(const NewOptions& options) try {
  return propose_spec(options.surface, options.output);
} catch (const InputError&) {
  std::filesystem::path shown = options.output;
  shown.replace_extension(".vtu");
  if (!std::filesystem::exists(shown)) {
    try {
      write_surface_vtu(shown, read_as_drawn(options.surface));
      std::fprintf(stderr, "hostgen: %s shows the surface as it was read\n", shown.c_str());
    } catch (const InputError&) {  // nothing could be read
    }
  }
  throw;
}

void run(const NewOptions& options) {
  check_extension(options.output, {".toml"});
  std::filesystem::path picture = options.output;
  picture.replace_extension(".png");
  for (const std::filesystem::path& file : {options.output, picture}) check_writable(file, {options.surface});
  for (const std::filesystem::path& file : {options.output, picture}) {
    if (!std::filesystem::exists(file)) continue;
    throw InputError(file.string(), "is there already, expected a new name (a spec is written by hand from here on)");
  }
  const FirstSpec first = propose_or_show(options);
  write_file_atomically(options.output, first.toml);
  write_file_atomically(picture, picture_of(first));
  std::printf("%s: a first spec, %zu of 3 plates found; %s: what its camera would see\n", options.output.c_str(),
              first.plates.size(), picture.c_str());
  for (const std::string& note : first.notes) std::printf("note: %s\n", note.c_str());
  try {
    read_finger_spec(options.output);
    std::printf("it can be used as it is; next: hostgen probe %s\n", options.output.c_str());
  } catch (const InputError& error) {
    std::printf("to be mended by hand: %s\n(hostgen mesh %s -o finger.vtu shows what it says)\n", error.what(),
                options.output.c_str());
  }
}

}  // namespace

void add_new_command(CLI::App& app) {
  const auto options = std::make_shared<NewOptions>();
  CLI::App* command =
      app.add_subcommand("new",
                         "write a first spec for a surface from CAD, with base, front, touched part, "
                         "plates, markers and camera as its shape "
                         "suggests them, and beside it a picture of what the camera would see (.png); of "
                         "a surface that is refused, the surface for ParaView (.vtu)");
  command->add_option("surface", options->surface, "closed surface (.stl, .ply or .obj)")->required();
  command->add_option("-o,--output", options->output, "spec to write (.toml); nothing is written over")->required();
  command->callback([options] { run(*options); });
}

}  // namespace finsight::host
