#include "hostgen/calibrate/grey_image.h"

#include <png.h>

#include <charconv>
#include <span>
#include <stdexcept>

#include "firmware/input_error.h"
#include "firmware/model/model.h"
#include "hostgen/util/common.h"

namespace finsight::host {

namespace {

void check_size(const std::filesystem::path& file, std::int64_t width_px, std::int64_t height_px) {
  const auto possible = [](std::int64_t side_px) { return side_px >= 1 && side_px <= kLargestSide_px; };
  if (possible(width_px) && possible(height_px)) return;
  throw InputError(file.string(), "size", std::to_string(width_px) + " x " + std::to_string(height_px),
                   "1 to " + std::to_string(kLargestSide_px) + " pixels each way");
}

/// The next number of a PGM header: after spaces and comments, and with one space behind it. `at` moves past that.
std::int64_t header_number(const std::string& bytes, std::size_t& at, const std::filesystem::path& file) {
  constexpr const char* kSpaces = " \t\r\n\v\f";
  while ((at = bytes.find_first_not_of(kSpaces, at)) != std::string::npos && bytes[at] == '#') {
    at = bytes.find('\n', at);
  }
  std::int64_t number = 0;
  if (at != std::string::npos) {
    const auto [end, error] = std::from_chars(bytes.data() + at, bytes.data() + bytes.size(), number);
    at = static_cast<std::size_t>(end - bytes.data());
    if (error == std::errc() && at < bytes.size() && std::string(kSpaces).find(bytes[at]) != std::string::npos) {
      ++at;
      return number;
    }
  }
  throw InputError(file.string(), "header of a PGM file", "something else", "P5, width, height and largest grey level");
}

void append_big_endian(std::string& bytes, std::uint32_t value) {
  for (const int shift : {24, 16, 8, 0}) bytes += static_cast<char>(value >> shift & 0xFF);
}

std::string encoded(int width_px, int height_px, png_uint_32 format, const std::uint8_t* pixels) {
  png_image png{};
  png.version = PNG_IMAGE_VERSION;
  png.width = static_cast<png_uint_32>(width_px);
  png.height = static_cast<png_uint_32>(height_px);
  png.format = format;
  png_alloc_size_t size = PNG_IMAGE_PNG_SIZE_MAX(png);
  std::string bytes(size, '\0');
  if (!png_image_write_to_memory(&png, bytes.data(), &size, 0, pixels, 0, nullptr)) {
    throw std::runtime_error(std::string("PNG: ") + png.message);
  }
  bytes.resize(size);
  return bytes;
}

}  // namespace

GreyImage read_png(const std::filesystem::path& file) {
  const std::string bytes = read_file(file);
  png_image png{};
  png.version = PNG_IMAGE_VERSION;
  const auto refuse = [&] { throw InputError(file.string(), std::string("no PNG image: ") + png.message); };
  if (!png_image_begin_read_from_memory(&png, bytes.data(), bytes.size())) refuse();
  struct Freed {
    png_image& png;
    ~Freed() { png_image_free(&png); }
  } freed{png};
  check_size(file, png.width, png.height);
  png.format = PNG_FORMAT_GRAY;
  GreyImage image{static_cast<int>(png.width), static_cast<int>(png.height), {}};
  image.grey.resize(PNG_IMAGE_SIZE(png));
  const png_color black{};  // behind what is transparent
  if (!png_image_finish_read(&png, &black, image.grey.data(), 0, nullptr)) refuse();
  return image;
}

GreyImage read_pgm(const std::filesystem::path& file) {
  const std::string bytes = read_file(file);
  if (!bytes.starts_with("P5")) throw InputError(file.string(), "no binary PGM image (P5)");
  std::size_t at = 2;
  const std::int64_t width_px = header_number(bytes, at, file), height_px = header_number(bytes, at, file);
  const std::int64_t white = header_number(bytes, at, file);
  check_size(file, width_px, height_px);
  if (white != 255) throw InputError(file.string(), "largest grey level", std::to_string(white), "255");
  const auto pixels = static_cast<std::size_t>(width_px * height_px);
  if (bytes.size() - at < pixels) {
    throw InputError(file.string(), "pixels", std::to_string(bytes.size() - at) + " bytes", std::to_string(pixels));
  }
  const auto first = bytes.begin() + static_cast<std::ptrdiff_t>(at);
  return {
      static_cast<int>(width_px), static_cast<int>(height_px), {first, first + static_cast<std::ptrdiff_t>(pixels)}};
}

std::string png_bytes(const GreyImage& image, std::uint32_t pixels_per_metre) {
  std::string bytes = encoded(image.width_px, image.height_px, PNG_FORMAT_GRAY, image.grey.data());
  // libpng's simple interface does not write pHYs, the chunk with the printed size. It follows the header: 8 bytes of
  // signature and 25 of IHDR.
  std::string chunk = "pHYs";
  append_big_endian(chunk, pixels_per_metre);
  append_big_endian(chunk, pixels_per_metre);
  chunk += '\1';  // per metre
  const std::uint32_t checksum = crc32(std::as_bytes(std::span(chunk)));
  std::string whole;
  append_big_endian(whole, static_cast<std::uint32_t>(chunk.size() - 4));
  whole += chunk;
  append_big_endian(whole, checksum);
  return bytes.insert(33, whole);
}

std::string colour_png_bytes(int width_px, int height_px, std::span<const std::uint8_t> rgb) {
  return encoded(width_px, height_px, PNG_FORMAT_RGB, rgb.data());
}

}  // namespace finsight::host
