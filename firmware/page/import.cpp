#include "firmware/page/import.h"

#include <cmath>
#include <functional>
#include <system_error>
#include <utility>
#include <vector>

#include "firmware/calibrate/lens_calibration.h"
#include "firmware/input_error.h"
#include "firmware/settings/atomic_file.h"
#include "firmware/settings/measured_fit.h"
#include "firmware/settings/settings.h"
#include "firmware/settings/state_text.h"

namespace finsight::page {

namespace {

using nlohmann::json;
namespace fs = std::filesystem;

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
  if (!file.contains("zero") || file["zero"].is_null()) return zero;
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

Import checked(const json& file, const Identity& identity, const MountModel& mount, std::uint32_t model_checksum,
               const RuntimeSettings& settings) {
  Import import;
  if (file.contains("lens") && !file["lens"].is_null()) {
    if (identity.width_px == 0) refuse("lens", "a lens", "none: this device has no pictures");
    import.lens = lens_text(read_lens_text(text_in(file, "lens"), "lens", identity.width_px, identity.height_px));
  }
  MeasuredMount measured = poses_of(mount);
  if (file.contains("mount") && !file["mount"].is_null()) {
    measured = read_measured_mount(TomlTable::parse_text(text_in(file, "mount"), "mount"));
    corrected_mount(mount, measured);
    import.mount = measured_mount_toml(measured);
  }
  if (file.contains("fit") && !file["fit"].is_null()) {
    const FitValues fit = read_measured_fit(TomlTable::parse_text(text_in(file, "fit"), "fit"));
    check_fit(fit, model_checksum, "fit");
    import.fit = measured_fit_toml(fit);
  }
  const Zero zero = zero_in(file);
  if (zero.pose && import.mount.empty()) refuse("mount", "nothing", "the mount that the zero was measured with");
  import.state = state_text(settings, zero.pose, zero.g, model_checksum, measured);
  return import;
}

/// Files of the import, and where they belong.
std::vector<std::pair<fs::path, std::string>> files_of(const fs::path& folder, const Import& import) {
  std::vector<std::pair<fs::path, std::string>> files;
  for (const auto& [name, text] : {std::pair{kMeasuredLens, &import.lens},
                                   {kMeasuredMount, &import.mount},
                                   {kMeasuredFit, &import.fit},
                                   {kImportedState, &import.state}}) {
    if (!text->empty()) files.emplace_back(folder / name, *text);
  }
  return files;
}

fs::path former_of(const fs::path& file) { return file.string() + ".former"; }
fs::path fresh_of(const fs::path& file) { return file.string() + ".import"; }

}  // namespace

json export_file(const Identity& identity, const json& settings, const json& about,
                 const std::optional<PublishedFrame>& frame) {
  json file = {{"finsight_export", 1},
               {"model_name", identity.model_name},
               {"pack_checksum", identity.pack_checksum},
               {"settings", settings},
               {"lens", json()},
               {"mount", about.value("mount", json())},
               {"fit", about.value("fit", json())},
               {"zero", json()}};
  if (about.contains("lens")) {
    const json& lens = about["lens"];
    LensNumbers numbers{};
    for (std::size_t i = 0; i < numbers.size(); ++i) numbers[i] = lens.at(kLensNames[i]).get<double>();
    file["lens"] = lens_text(make_lens(identity.width_px, identity.height_px, numbers));
  }
  if (frame && frame->has_zero) {
    for (std::size_t p = 0; p < kPlates; ++p) file["zero"][kPlateNames[p]] = frame->zero[p];
    if (frame->has_zero_g) file["zero"]["gravity_g"] = frame->zero_g;
  }
  return file;
}

std::optional<Refusal> read_import(const json& file, const Identity& identity, SettingsWords words,
                                   const MountModel& mount, std::uint32_t model_checksum, Import& import) {
  if (!file.is_object() || file.value("finsight_export", json()) != 1) {
    return Refusal{400, "This is not a file that the page has exported."};
  }
  const json checksum = file.value("pack_checksum", json());
  if (checksum != identity.pack_checksum) {
    const json name = file.value("model_name", json());
    return Refusal{409, "pack_checksum: found " + shown(checksum) + " (model " + shown(name) + "), expected \"" +
                            identity.pack_checksum + "\" (" + identity.model_name +
                            "): the file is of a device with another model pack."};
  }
  if (auto refusal = apply_settings(file.value("settings", json()), words)) return refusal;
  const RuntimeSettings settings = settings_of(words);
  if (!are_valid(settings)) return Refusal{400, "settings: an \"on\" threshold is not above its \"off\" threshold."};
  try {
    import = checked(file, identity, mount, model_checksum, settings);
  } catch (const InputError& error) {
    return Refusal{400, std::string(error.what()) + "."};
  }
  return std::nullopt;
}

std::optional<Refusal> store_import(const fs::path& folder, const Import& import,
                                    const std::function<std::optional<Refusal>()>& restart) {
  const auto files = files_of(folder, import);
  std::vector<bool> had(files.size());
  std::error_code ignored;
  try {  // what can fail comes first; then only names change
    for (const auto& [file, text] : files) write_file_atomically(fresh_of(file), text);
  } catch (const std::system_error& error) {
    for (const auto& [file, text] : files) fs::remove(fresh_of(file), ignored);
    return Refusal{500, std::string("It cannot be stored: ") + error.what() + "."};
  }
  for (std::size_t i = 0; i < files.size(); ++i) {
    const fs::path& file = files[i].first;
    had[i] = fs::exists(file, ignored);
    if (had[i]) fs::rename(file, former_of(file), ignored);
    fs::rename(fresh_of(file), file, ignored);
  }
  const auto refusal = restart();
  if (!refusal) return std::nullopt;
  for (std::size_t i = 0; i < files.size(); ++i) {
    const fs::path& file = files[i].first;
    fs::remove(file, ignored);
    if (had[i]) fs::rename(former_of(file), file, ignored);
  }
  return refusal;
}

}  // namespace finsight::page
