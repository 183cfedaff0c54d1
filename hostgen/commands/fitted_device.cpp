#include "hostgen/commands/fitted_device.h"

#include "firmware/input_error.h"
#include "firmware/settings/measured_fit.h"
#include "firmware/settings/measured_mount.h"
#include "hostgen/util/common.h"

namespace finsight::host {

void FittedDevice::add_options(CLI::App& command) {
  command.add_option("--spec", spec, "finger spec (TOML) that the pack was made from")->required();
  command.add_option("--pack", pack, "model pack of this finger")->required();
  command.add_option("--mount", mount, "what hostgen mount measured, if the device uses it");
  command.add_option("--smoothing-ms", smoothing_ms, "smoothing_ms of the device's board file, if it is not 0")
      ->check(CLI::Range(0, 1000));
  command.add_option("--date", date, "of the recordings, such as 20261123; today unless given");
}

FingerSpec FittedDevice::read_spec(const Model& model) const {
  FingerSpec found = read_finger_spec(spec);
  check_made_from(found, model.spec_sha256, pack);
  return found;
}

std::optional<FitValues> FittedDevice::read_fit(const Model& model) const {
  if (fit.empty()) return std::nullopt;
  const FitValues found = read_measured_fit(TomlTable::parse_file(fit));
  check_fit(found, model.checksum, fit.string());
  return found;
}

std::uint16_t FittedDevice::day() const {
  const std::uint16_t day = date ? days_of(date) : day_today();
  if (day == 0) throw InputError("command line", "--date", std::to_string(date), "a day such as 20261123");
  return day;
}

std::vector<SessionTouches> FittedDevice::touches(const Model& model, const std::optional<FitValues>& of_device) const {
  for (std::size_t i = 0; i < sessions.size(); ++i) {
    for (std::size_t k = 0; k < i; ++k) {
      if (weakly_canonical(sessions[k]) != weakly_canonical(sessions[i])) continue;
      throw InputError("command line", "sessions", sessions[i].string() + " twice", "each recording once");
    }
  }
  LoopSettings settings;
  settings.fit = of_device;
  settings.smoothing_ms = smoothing_ms;
  if (!mount.empty()) {
    settings.mount = corrected_mount(model.mount, read_measured_mount(TomlTable::parse_file(mount)));
  }
  std::vector<SessionTouches> touches(sessions.size());
  Progress progress("recordings", sessions.size());
  std::optional<ZeroPose> first_zero;
  const auto read = [&](std::size_t i) {
    touches[i] = session_touches(sessions[i], model, settings, first_zero);
    progress.advance();
  };
  read(0);  // the command line asks for one at least
  first_zero = touches[0].zero;
  parallel_for(sessions.size() - 1, [&](std::size_t i) { read(i + 1); });
  return touches;
}

}  // namespace finsight::host
