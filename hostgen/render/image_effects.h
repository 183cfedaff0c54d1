// What degrades a whole image, whatever it shows: reflections, dirt, dark bars and compression.
#pragma once

#include <cstdint>
#include <vector>

#include "hostgen/render/image_quality.h"
#include "hostgen/util/random.h"

namespace finsight::host {

/// Fixed in the image: a pixel's grey level is what the scene gives it times `transmission` plus `glare`. Both are
/// [height * width]; empty where the quality asks for none.
struct ImageFilm {
  std::vector<float> transmission, glare;
  ImageFilm() = default;
  ImageFilm(const ImageQuality& quality, int width_px, int height_px, Random& random);
};

/// Compresses the image as an MJPEG camera does, at this quality, 1 ... 100, and decodes it again, both by
/// libjpeg-turbo. Throws std::runtime_error.
void through_jpeg(std::vector<std::uint8_t>& grey, int width_px, int height_px, int quality);

}  // namespace finsight::host
