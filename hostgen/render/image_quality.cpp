#include "hostgen/render/image_quality.h"

#include <stdexcept>
#include <utility>

namespace finsight::host {

namespace {

/// One trouble each.
const std::vector<std::pair<std::string, ImageQuality>>& troubles() {
  static const std::vector<std::pair<std::string, ImageQuality>> presets = [] {
    ImageQuality coded;
    coded.srgb = true;
    std::vector<std::pair<std::string, ImageQuality>> made(7, {"", coded});
    const auto set = [&](std::size_t i, const std::string& name) -> ImageQuality& {
      made[i].first = name;
      return made[i].second;
    };
    set(0, "coded");
    set(1, "jpeg").jpeg_quality = 70;
    set(2, "clutter").clutter = 24;
    ImageQuality& dim = set(3, "dim");
    dim.white = 45, dim.black = 6, dim.plate = 23, dim.background = 15;
    dim.read_noise = 4, dim.shot_noise = 0.6;
    ImageQuality& defocused = set(4, "defocused");
    defocused.defocus_px = 1.4, defocused.focus_mm = 88;
    ImageQuality& misprinted = set(5, "misprinted");
    misprinted.print_scale = 0.985, misprinted.print_tilt_rad = 0.035, misprinted.print_bend_per_mm = 0.01;
    set(6, "glare").gloss = 1800;
    return made;
  }();
  return presets;
}

}  // namespace

ImageQuality image_preset(const std::string& name) {
  ImageQuality quality;
  if (name == "lab") return quality;
  for (const auto& [trouble, of_trouble] : troubles()) {
    if (trouble == name) return of_trouble;
  }
  if (name != "factory" && name != "worst") throw std::invalid_argument("no image preset '" + name + "'");
  quality.blur_px = 0.7;
  quality.defocus_px = 1.0;
  quality.exposure_s = 0.004;
  quality.read_noise = 2.5;
  quality.shot_noise = 0.2;
  quality.vignetting = 0.45;
  quality.light_gradient = 0.4;
  quality.hot_spots = 2;
  quality.dirt = 4;
  quality.jpeg_quality = 95;
  if (name == "factory") return quality;
  quality.blur_px = 0.9;
  quality.defocus_px = 1.8;
  quality.exposure_s = 0.008;
  quality.read_noise = 5;
  quality.shot_noise = 0.35;
  quality.white = 130;
  quality.black = 30;
  quality.plate = 75;
  quality.background = 50;
  quality.vignetting = 0.55;
  quality.light_gradient = 0.6;
  quality.hot_spots = 4;
  quality.dirt = 12;
  quality.beams = 2;
  quality.jpeg_quality = 80;
  return quality;
}

std::vector<std::string> image_presets() {
  std::vector<std::string> names = {"lab", "factory", "worst"};
  for (const auto& [name, quality] : troubles()) names.push_back(name);
  return names;
}

}  // namespace finsight::host
