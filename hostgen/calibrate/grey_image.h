// Images from files: PNG (libpng) and PGM, as grey levels.
#pragma once

#include <cstdint>
#include <filesystem>
#include <span>
#include <string>
#include <vector>

#include "firmware/calibrate/grey_image.h"

namespace finsight::host {

/// Sides up to kLargestSide_px; colours become grey. Throws InputError with what is wrong: not a PNG file or one that
/// is truncated, not a binary PGM file (P5) of 8 bits.
GreyImage read_png(const std::filesystem::path& file);
GreyImage read_pgm(const std::filesystem::path& file);
inline constexpr int kLargestSide_px = 8192;

/// A PNG file's bytes, with its resolution for printing in pixels per metre. Throws std::runtime_error.
std::string png_bytes(const GreyImage& image, std::uint32_t pixels_per_metre);
/// The same in colour; rgb: [height, width, 3].
std::string colour_png_bytes(int width_px, int height_px, std::span<const std::uint8_t> rgb);

}  // namespace finsight::host
