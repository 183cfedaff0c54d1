#include "firmware/ports/session.h"

#include <algorithm>
#include <charconv>
#include <cmath>

#include "firmware/input_error.h"
#include "firmware/settings/toml_table.h"

namespace finsight {

namespace {

constexpr int kDictionarySize = 50;  // DICT_4X4_50

/// The shortest text that reads back as the same number.
std::string shortest(double value) {
  char text[32];
  return {text, std::to_chars(text, text + sizeof text, value).ptr};
}

template <std::size_t N>
std::string list(const std::array<double, N>& values) {
  std::string text;
  for (const double value : values) text += (text.empty() ? "" : ", ") + shortest(value);
  return "[" + text + "]";
}

/// A TOML basic string. Control characters become spaces: a description is one line for people.
std::string quoted(const std::string& text) {
  std::string result = "\"";
  for (const char c : text) {
    if (c == '"' || c == '\\') result += '\\';
    result += static_cast<unsigned char>(c) < 0x20 || c == 0x7f ? ' ' : c;
  }
  return result + "\"";
}

std::array<int, kPlates> read_marker_ids(TomlTable& markers) {
  const std::vector<double> numbers = markers.numbers("id", kPlates, 0, kDictionarySize - 1);
  std::array<int, kPlates> ids{};
  for (int plate = 0; plate < kPlates; ++plate) {
    ids[plate] = static_cast<int>(numbers[plate]);
    const bool repeated = std::count(ids.begin(), ids.begin() + plate, ids[plate]) > 0;
    if (ids[plate] != numbers[plate] || repeated) {
      throw InputError(markers.where("id"), "markers.id", shortest(numbers[plate]), "three different whole numbers");
    }
  }
  return ids;
}

}  // namespace

void read_lens(TomlTable table, SessionInfo& info) {
  const std::vector<double> pinhole = table.numbers("fx_fy_cx_cy", 4, -1e5, 1e5);
  if (!(pinhole[0] > 0 && pinhole[1] > 0)) {
    throw InputError(table.where("fx_fy_cx_cy"), "fx_fy_cx_cy", shortest(std::min(pinhole[0], pinhole[1])),
                     "focal lengths above 0 pixels");
  }
  if (!(pinhole[2] >= 0 && pinhole[2] < info.width_px && pinhole[3] >= 0 && pinhole[3] < info.height_px)) {
    throw InputError(table.where("fx_fy_cx_cy"), "fx_fy_cx_cy",
                     "an optical axis at (" + shortest(pinhole[2]) + ", " + shortest(pinhole[3]) + ") px",
                     "a point in the image");
  }
  std::copy(pinhole.begin(), pinhole.end(), info.fx_fy_cx_cy.begin());
  const std::vector<double> lens = table.numbers("k1_k2_p1_p2_k3", 5, -100, 100);
  std::copy(lens.begin(), lens.end(), info.k1_k2_p1_p2_k3.begin());
  const auto check_side = [&](const char* key, int side_px) {
    if (!table.has(key) || table.integer(key, 1, Y4mReader::kMaxSide) == side_px) return;
    throw InputError(table.where(key), key, std::to_string(table.integer(key, 1, Y4mReader::kMaxSide)),
                     std::to_string(side_px) + ", the size of the images: a calibration holds for one size");
  };
  check_side("width_px", info.width_px);
  check_side("height_px", info.height_px);
  table.finish();
}

std::string lens_toml(const SessionInfo& info) {
  return "fx_fy_cx_cy = " + list(info.fx_fy_cx_cy) + "\nk1_k2_p1_p2_k3 = " + list(info.k1_k2_p1_p2_k3) + "\n";
}

SessionInfo read_session_info(const std::filesystem::path& folder) {
  TomlTable table = TomlTable::parse_file(folder / kSessionInfo);
  SessionInfo info;
  info.description = table.text("description", "");
  info.width_px = static_cast<int>(table.integer("width_px", 1, Y4mReader::kMaxSide));
  info.height_px = static_cast<int>(table.integer("height_px", 1, Y4mReader::kMaxSide));
  info.frames_per_second = table.number("frames_per_second", 1, 1000);

  read_lens(table.table("camera"), info);

  TomlTable markers = table.table("markers");
  info.marker_dictionary = markers.choice("dictionary", {"DICT_4X4_50"});
  info.marker_id = read_marker_ids(markers);
  info.marker_size_mm = markers.number("size_mm", 0.1, 1000);
  markers.finish();
  table.finish();
  return info;
}

std::string session_info_toml(const SessionInfo& info) {
  const auto id = [&](int plate) { return std::to_string(info.marker_id[plate]); };
  return "description = " + quoted(info.description) + "\nwidth_px = " + std::to_string(info.width_px) +
         "\nheight_px = " + std::to_string(info.height_px) +
         "\nframes_per_second = " + shortest(info.frames_per_second) + "\n\n[camera]  # pixels; OpenCV's convention\n" +
         lens_toml(info) + "\n[markers]  # top, middle, low plate\ndictionary = " + quoted(info.marker_dictionary) +
         "\nid = [" + id(kTopPlate) + ", " + id(kMiddlePlate) + ", " + id(kLowPlate) +
         "]\nsize_mm = " + shortest(info.marker_size_mm) + "\n";
}

}  // namespace finsight
