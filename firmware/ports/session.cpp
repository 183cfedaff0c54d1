#include "firmware/ports/session.h"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <span>

#include "firmware/input_error.h"
#include "firmware/settings/toml_table.h"

namespace finsight {

namespace {

constexpr int kDictionarySize = 50;  // DICT_4X4_50
constexpr int kPinholeNumbers = 4;   // of a lens; the others are its distortion

/// The shortest text that reads back as the same number.
std::string shortest(double value) {
  char text[32];
  return {text, std::to_chars(text, text + sizeof text, value).ptr};
}

std::string list(std::span<const double> values) {
  std::string text;
  for (const double value : values) text += (text.empty() ? "" : ", ") + shortest(value);
  return "[" + text + "]";
}

std::string id_list(const std::array<int, kPlates>& ids) {
  const std::vector<double> numbers(ids.begin(), ids.end());
  return list(numbers);
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

Lens read_lens(TomlTable table, int width_px, int height_px) {
  const std::vector<double> pinhole = table.numbers("fx_fy_cx_cy", kPinholeNumbers, -1e5, 1e5);
  const std::vector<double> distortion = table.numbers("k1_k2_p1_p2_k3", kLensNumbers - kPinholeNumbers, -100, 100);
  LensNumbers numbers;
  std::copy(distortion.begin(), distortion.end(), std::copy(pinhole.begin(), pinhole.end(), numbers.begin()));
  const Lens lens = make_lens(width_px, height_px, numbers);
  if (!(lens.fx > 0 && lens.fy > 0)) {
    throw InputError(table.where("fx_fy_cx_cy"), "fx_fy_cx_cy", shortest(std::min(lens.fx, lens.fy)),
                     "focal lengths above 0 pixels");
  }
  if (!(lens.cx >= 0 && lens.cx < width_px && lens.cy >= 0 && lens.cy < height_px)) {
    throw InputError(table.where("fx_fy_cx_cy"), "fx_fy_cx_cy",
                     "an optical axis at (" + shortest(lens.cx) + ", " + shortest(lens.cy) + ") px",
                     "a point in the image");
  }
  const auto check_side = [&](const char* key, int side_px) {
    if (!table.has(key) || table.integer(key, 1, Y4mReader::kMaxSide) == side_px) return;
    throw InputError(table.where(key), key, std::to_string(table.integer(key, 1, Y4mReader::kMaxSide)),
                     std::to_string(side_px) + ", the size of the images: a calibration holds for one size");
  };
  check_side("width_px", width_px);
  check_side("height_px", height_px);
  table.finish();
  try {
    check_lens_numbers(in_single_precision(lens));  // as the frame loop has it
  } catch (const InputError& error) {
    throw InputError(table.where(), error.what());
  }
  return lens;
}

Coding read_coding(TomlTable& table) {
  return table.choice("coding", {"linear", "srgb"}, "linear") == "srgb" ? Coding::kSrgb : Coding::kLinear;
}

std::string lens_toml(const Lens& lens) {
  const LensNumbers numbers = lens_numbers(lens);
  const std::span<const double> all(numbers);
  return "fx_fy_cx_cy = " + list(all.first(kPinholeNumbers)) +
         "\nk1_k2_p1_p2_k3 = " + list(all.subspan(kPinholeNumbers)) + "\n";
}

double read_readout_ms(TomlTable& table) { return table.number("readout_ms", 0, 100, 0.0); }

SessionInfo read_session_info(const std::filesystem::path& folder) {
  TomlTable table = TomlTable::parse_file(folder / kSessionInfo);
  SessionInfo info;
  info.description = table.text("description", "");
  info.complete = table.flag("complete", true);
  info.coding = read_coding(table);
  info.readout_ms = read_readout_ms(table);
  info.from_rest = table.flag("from_rest", false);
  if (table.has("gravity_g")) {
    const auto g = table.numbers("gravity_g", 3, -100, 100);
    info.gravity_g = Eigen::Vector3d(g[0], g[1], g[2]).cast<float>();
  }
  const auto width_px = static_cast<int>(table.integer("width_px", 1, Y4mReader::kMaxSide));
  const auto height_px = static_cast<int>(table.integer("height_px", 1, Y4mReader::kMaxSide));
  info.frames_per_second = table.number("frames_per_second", 1, 1000);
  info.lens = read_lens(table.table("camera"), width_px, height_px);

  TomlTable markers = table.table("markers");
  info.marker_dictionary = markers.choice("dictionary", {"DICT_4X4_50"});
  info.marker_id = read_marker_ids(markers);
  info.marker_size_mm = markers.number("size_mm", 0.1, 1000);
  markers.finish();
  table.finish();
  return info;
}

void check_markers(const SessionInfo& info, const std::filesystem::path& folder,
                   const std::array<int, kPlates>& marker_id, double marker_size_mm, const std::string& finger) {
  const std::string file = (folder / kSessionInfo).string();
  if (info.marker_id != marker_id) {
    throw InputError(file, "markers.id", id_list(info.marker_id), id_list(marker_id) + " as in " + finger);
  }
  if (std::abs(info.marker_size_mm - marker_size_mm) > 0.001 * marker_size_mm) {
    throw InputError(file, "markers.size_mm", shortest(info.marker_size_mm),
                     shortest(marker_size_mm) + " as in " + finger);
  }
}

namespace {

std::string gravity_toml(const std::optional<Vec3f>& g) {
  if (!g) return "";
  const std::array<double, 3> numbers = {static_cast<double>(g->x()), static_cast<double>(g->y()),
                                         static_cast<double>(g->z())};
  return "\ngravity_g = " + list(numbers) + "  # of things that fall, in the finger frame; the finger does not turn";
}

}  // namespace

std::string session_info_toml(const SessionInfo& info) {
  return "description = " + quoted(info.description) + (info.complete ? "" : "\ncomplete = false") +
         (info.from_rest ? "\nfrom_rest = true  # as in the finger's pack: no zero is needed" : "") +
         gravity_toml(info.gravity_g) + (info.coding == Coding::kSrgb ? "\ncoding = \"srgb\"" : "") +
         (info.readout_ms > 0 ? "\nreadout_ms = " + shortest(info.readout_ms) + "  # from the first row to the last"
                              : "") +
         "\nwidth_px = " + std::to_string(info.lens.width_px) + "\nheight_px = " + std::to_string(info.lens.height_px) +
         "\nframes_per_second = " + shortest(info.frames_per_second) + "\n\n[camera]  # pixels; OpenCV's convention\n" +
         lens_toml(info.lens) +
         "\n[markers]  # top, middle, low plate\ndictionary = " + quoted(info.marker_dictionary) +
         "\nid = " + id_list(info.marker_id) + "\nsize_mm = " + shortest(info.marker_size_mm) + "\n";
}

}  // namespace finsight
