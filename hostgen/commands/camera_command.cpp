// hostgen camera SPEC: what a camera that somebody thinks of buying would see of a finger.
#include <CLI/CLI.hpp>
#include <cmath>
#include <cstdio>
#include <memory>

#include "firmware/input_error.h"
#include "hostgen/commands/commands.h"
#include "hostgen/commands/options.h"
#include "hostgen/render/camera_choice.h"

namespace finsight::host {

namespace {

constexpr int kUsualWidth_px = 1920;  // binned until the image is no wider: more costs time in every frame

struct CameraOptions {
  std::filesystem::path spec;
  std::string sensor;
  double focal_mm = 0, f_number = 2.8, focus_mm = 0, pixel_um = 0;
  int width_px = 0, height_px = 0, binning = 0;
  bool rolling = false, colour = false;
};

std::vector<std::string> sensor_names() {
  std::vector<std::string> names;
  for (const Sensor& sensor : known_sensors()) names.push_back(sensor.name);
  names.push_back("custom");
  return names;
}

Sensor sensor_of(const CameraOptions& options) {
  for (const Sensor& sensor : known_sensors()) {
    if (sensor.name != options.sensor) continue;
    if (options.width_px > 0 || options.height_px > 0 || options.pixel_um > 0 || options.rolling) {
      throw InputError("command line", "--sensor", sensor.name,
                       "custom with --width, --height, --pixel-um or --rolling: a known sensor has its own");
    }
    Sensor chosen = sensor;
    if (options.colour) chosen.colour = true;
    return chosen;
  }
  if (options.width_px <= 0 || options.height_px <= 0 || !(options.pixel_um > 0)) {
    throw InputError("command line", "--sensor", "custom without its numbers", "--width, --height and --pixel-um too");
  }
  return {"custom", options.width_px, options.height_px, options.pixel_um, !options.rolling, options.colour};
}

void print(const FingerSpec& spec, const CameraView& view) {
  const CameraChoice& choice = view.choice;
  const Sensor& sensor = choice.sensor;
  std::printf("%s: %d x %d pixels of %g um, %s shutter, %s\n", sensor.name.c_str(), sensor.width_px, sensor.height_px,
              sensor.pixel_um, sensor.global_shutter ? "global" : "rolling", sensor.colour ? "colour" : "grey");
  std::printf("image %d x %d (binned %d x %d), lens %g mm f/%g focused at %.0f mm\n", view.lens.width_px,
              view.lens.height_px, choice.binning, choice.binning, choice.focal_mm, choice.f_number, choice.focus_mm);
  std::printf(
      "field of view %.0f x %.0f degrees; sharp (defocus below 2 px) from %.0f mm to %s\n", view.across_deg,
      view.up_deg, view.sharp_from_mm,
      std::isfinite(view.sharp_to_mm) ? (std::to_string(std::lround(view.sharp_to_mm)) + " mm").c_str() : "infinity");
  std::printf("\n%-7s %9s %9s %9s %8s %10s %6s %11s %9s %8s\n", "plate", "distance", "marker", "defocus", "in view",
              "corner", "lost", "lateral", "depth", "tilt");
  for (std::size_t p = 0; p < kPlates; ++p) {
    const MarkerView& marker = view.markers[p];
    std::printf("%-7s %6.1f mm %6.1f px %6.2f px %8s ", kPlateNames[p], marker.distance_mm, marker.side_px,
                marker.blur_px, marker.in_view ? "yes" : "NO");
    if (std::isnan(marker.corner_px)) {
      std::printf("not found in any picture\n");
      continue;
    }
    std::printf("%7.3f px %4.0f %% %8.4f mm %6.3f mm %4.2f deg\n", marker.corner_px, 100 * marker.lost,
                marker.lateral_mm, marker.depth_mm, marker.tilt_deg);
  }
  std::printf(
      "\nStandard deviations of one frame by each marker's corners alone; the pack of finger %s was planned for\n",
      spec.name.c_str());
  for (std::size_t p = 0; p < kPlates; ++p) {
    std::printf("%s%s %.3f mm lateral, %.3f mm depth, %.2f deg tilt", p == 0 ? "  " : ", ", kPlateNames[p],
                spec.noise[p].lateral_mm, spec.noise[p].depth_mm, spec.noise[p].tilt_rad * 180 / 3.14159265358979);
  }
  std::printf("\n");
  if (!sensor.global_shutter) {
    std::printf("Rolling shutter: rows of one image are of different times; see readout_ms in the board file.\n");
  }
}

void run(const CameraOptions& options) {
  const FingerSpec spec = read_finger_spec(options.spec);
  CameraChoice choice{.sensor = sensor_of(options),
                      .binning = options.binning,
                      .focal_mm = options.focal_mm,
                      .f_number = options.f_number,
                      .focus_mm = options.focus_mm};
  if (choice.binning == 0) choice.binning = (choice.sensor.width_px + kUsualWidth_px - 1) / kUsualWidth_px;
  print(spec, camera_view(spec, choice));
}

}  // namespace

void add_camera_command(CLI::App& app) {
  const auto options = std::make_shared<CameraOptions>();
  CLI::App* command = app.add_subcommand(
      "camera", "what a camera would see of a finger: field of view, depth of field, pixels per marker, plate noise");
  command->add_option("spec", options->spec, "finger spec (TOML): where markers and lens are")->required();
  command
      ->add_option("--sensor", options->sensor,
                   "a known sensor, which takes no --width, --height, --pixel-um or --rolling, or custom")
      ->check(CLI::IsMember(sensor_names()))
      ->required();
  command->add_option("--lens", options->focal_mm, "focal length, mm")->check(between(0.5, 100.0))->required();
  command->add_option("--f-number", options->f_number, "focal length over aperture")
      ->check(between(0.7, 32.0))
      ->capture_default_str();
  command
      ->add_option("--focus", options->focus_mm,
                   "distance at which it is sharp, mm; by default nearest and furthest marker are equally sharp")
      ->check(between(5.0, 10000.0));
  command
      ->add_option("--binning", options->binning,
                   "pixels of the sensor along one of the image's; by default such that it is 1920 wide at most")
      ->check(CLI::Range(1, 8));
  command->add_option("--width", options->width_px, "of a custom sensor only, pixels")->check(CLI::Range(16, 8192));
  command->add_option("--height", options->height_px, "of a custom sensor only, pixels")->check(CLI::Range(16, 8192));
  command->add_option("--pixel-um", options->pixel_um, "of a custom sensor only")->check(between(0.5, 20.0));
  command->add_flag("--rolling", options->rolling, "the custom sensor has a rolling shutter");
  command->add_flag("--colour", options->colour, "the colour version of the sensor");
  command->callback([options] { run(*options); });
}

}  // namespace finsight::host
