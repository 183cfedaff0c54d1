#include "firmware/page/import.h"

#include <cmath>
#include <utility>
#include <vector>

#include "firmware/calibrate/lens_calibration.h"
#include "firmware/input_error.h"
#include "firmware/page/settings_change.h"
#include "firmware/settings/measured_fit.h"
#include "firmware/settings/state_text.h"

namespace finsight::page {

namespace {

using nlohmann::json;

constexpr double kLargestZero = 10, kLargestGravity_g = 100;  // as in a saved file

std::string shown(const json& value) { return value.dump(-1, ' ', true, json::error_handler_t::replace); }

[[noreturn]] void refuse(const std::string& field, const std::string& found, const std::string& expected) {
  throw InputError("import", field, found, expected);
}

std::string text_in(const json& file, const char* field) {
  if (!file[field].is_string()) refuse(field, shown(file[field]), "a text");
  return file[field].get<std::string>();
}

template <std::size_t N>
std::array<float, N> numbers_in(const json& table, const std::string& field, const char* name, double largest) {
  std::array<float, N> numbers{};
  const auto found = table.find(name);
  const std::string where = field + "." + name, expected = std::to_string(N) + " numbers";
  if (found == table.end() || !found->is_array() || found->size() != N) {
    refuse(where, found == table.end() ? "nothing" : shown(*found).substr(0, 80), expected);
  }
  for (std::size_t i = 0; i < N; ++i) {
    const json& value = (*found)[i];
    if (!value.is_number() || !(std::abs(value.get<double>()) <= largest)) refuse(where, shown(value), expected);
    numbers[i] = value.get<float>();
  }
  return numbers;
}

struct Zero {
  std::optional<ZeroPose> pose;
  std::optional<Vec3f> g;
};

Zero zero_in(const json& file) {
  Zero zero;
  if (file["zero"].is_null()) return zero;
  const json& table = file["zero"];
  if (!table.is_object()) refuse("zero", shown(table).substr(0, 80), "a table or null");
  zero.pose.emplace();
  for (std::size_t p = 0; p < kPlates; ++p) {
    const auto n = numbers_in<6>(table, "zero", kPlateNames[p], kLargestZero);
    (*zero.pose)[p] = {Vec3f(n[0], n[1], n[2]), Vec3f(n[3], n[4], n[5])};
  }
  if (table.contains("gravity_g")) {
    const auto g = numbers_in<3>(table, "zero", "gravity_g", kLargestGravity_g);
    zero.g = Vec3f(g[0], g[1], g[2]);
  }
  return zero;
}

RuntimeSettings settings_of(const SettingsWords& words) {
  RuntimeSettings settings;
  for (int i = 0; i < kSettingCount; ++i) {
    const int address = setting_row(i).address;
    settings.words[static_cast<std::size_t>(i)] =
        address >= kProcessAddress ? words.process[static_cast<std::size_t>(address - kProcessAddress)]
                                   : words.control[static_cast<std::size_t>(address - kFirstSettingRegister)];
  }
  return settings;
}

/// The names of settings and parts that are not in the file.
std::string absent_in(const json& file) {
  std::string names;
  const auto need = [&](const json& table, const char* name) {
    if (!table.contains(name)) names += (names.empty() ? "" : ", ") + std::string(name);
  };
  for (const char* part : {"settings", "lens", "mount", "fit", "zero"}) need(file, part);
  if (!file.contains("settings")) return names;
  for (int i = 0; i < kSettingCount; ++i) {
    if (setting_row(i).writable) need(file["settings"], setting_row(i).name);
  }
  return names;
}

/// Written as finsightd writes them, then read as its start does: rounding must not carry a number over its limit.
std::vector<PartText> checked(const json& file, const FingerAtStart& finger, const RuntimeSettings& settings) {
  std::vector<PartText> import;
  const auto add = [&](Part part, const std::string& text) {
    check_part(part, text, finger);
    import.push_back({part, text});
  };
  if (!file["lens"].is_null()) add(Part::kLens, lens_text(check_lens_text(text_in(file, "lens"), "lens", finger)));
  MeasuredMount mount = poses_of(finger.mount);
  if (!file["mount"].is_null()) {
    const std::string text = measured_mount_toml(check_mount_text(text_in(file, "mount"), "mount", finger));
    mount = check_mount_text(text, file_of(Part::kMount), finger);
    import.push_back({Part::kMount, text});
  }
  if (!file["fit"].is_null()) add(Part::kFit, measured_fit_toml(check_fit_text(text_in(file, "fit"), "fit", finger)));
  const Zero zero = zero_in(file);
  if (zero.pose && file["mount"].is_null()) refuse("mount", "nothing", "the mount that the zero was measured with");
  const std::string state = state_text(settings, zero.pose, zero.g, finger.model_checksum, mount);
  check_state_text(state, "zero", finger, mount);
  import.push_back({Part::kState, state});
  return import;
}

}  // namespace

json export_file(const json& settings, const json& about, const std::optional<PublishedFrame>& frame) {
  json file = {{"finsight_export", 1},
               {"model_name", about.value("finger", json())},
               {"pack_checksum", about.value("pack_checksum", json())},
               {"settings", settings},
               {"lens", json()},
               {"mount", about.value("mount", json())},
               {"fit", about.value("fit", json())},
               {"zero", json()}};
  if (about.contains("lens")) {
    const json& lens = about["lens"];
    LensNumbers numbers{};
    for (std::size_t i = 0; i < numbers.size(); ++i) numbers[i] = lens.at(kLensNames[i]).get<double>();
    file["lens"] = lens_text(make_lens(lens.at("width_px").get<int>(), lens.at("height_px").get<int>(), numbers));
  }
  if (frame && frame->has_zero) {
    for (std::size_t p = 0; p < kPlates; ++p) file["zero"][kPlateNames[p]] = frame->zero[p];
    if (frame->has_zero_g) file["zero"]["gravity_g"] = frame->zero_g;
  }
  return file;
}

std::optional<Refusal> read_import(const json& file, const FingerAtStart& finger, std::vector<PartText>& import) {
  if (!file.is_object() || file.value("finsight_export", json()) != 1) {
    return Refusal{400, "This is not a file that the page has exported."};
  }
  const std::string own = checksum_text(finger.model_checksum);
  const json checksum = file.value("pack_checksum", json());
  if (checksum != own) {
    const json name = file.value("model_name", json());
    return Refusal{409, "pack_checksum: found " + shown(checksum) + " (model " + shown(name) + "), expected \"" + own +
                            "\" (" + finger.model_name + "): the file is of a device with another model pack."};
  }
  if (file.contains("settings") && !file["settings"].is_object())
    return Refusal{400, "settings: expected {name: value}."};
  if (const std::string absent = absent_in(file); !absent.empty()) {
    return Refusal{400, "The file is not complete: it lacks " + absent + "."};
  }
  SettingsWords words;
  if (auto refusal = apply_settings(file["settings"], words)) return refusal;
  const RuntimeSettings settings = settings_of(words);
  if (!are_valid(settings)) return Refusal{400, "settings: an \"on\" threshold is not above its \"off\" threshold."};
  try {
    import = checked(file, finger, settings);
  } catch (const InputError& error) {
    return Refusal{400, std::string(error.what()) + "."};
  }
  return std::nullopt;
}

}  // namespace finsight::page
