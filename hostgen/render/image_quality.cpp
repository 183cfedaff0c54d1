#include "hostgen/render/image_quality.h"

#include <stdexcept>

namespace finsight::host {

ImageQuality image_preset(const std::string& name) {
  ImageQuality quality;
  if (name == "lab") return quality;
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

std::vector<std::string> image_presets() { return {"lab", "factory", "worst"}; }

}  // namespace finsight::host
