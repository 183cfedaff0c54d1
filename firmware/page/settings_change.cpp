#include "firmware/page/settings_change.h"

#include <algorithm>
#include <cmath>
#include <string>

namespace finsight::page {

namespace {

using nlohmann::json;

constexpr double kRounding = 1e-6;  // of decimal fractions: 0.29 is not 29 times 0.01

const RegisterRow* setting_by_name(const std::string& name) {
  for (int i = 0; i < kSettingCount; ++i) {
    if (setting_row(i).name == name) return &setting_row(i);
  }
  return nullptr;
}

/// The raw word for a value in the row's unit, or the name of a code. Nothing: not such a value.
std::optional<std::uint16_t> raw_setting(const RegisterRow& row, const json& value) {
  double raw = 0;
  if (value.is_string() && !row.values.empty()) {
    const auto found = std::ranges::find(row.values, value.get<std::string>(), &NamedValue::name);
    if (found == row.values.end()) return std::nullopt;
    raw = found->value;
  } else if (value.is_number()) {
    const double exact = value.get<double>() / row.scale;
    raw = std::round(exact);
    if (!(std::abs(raw - exact) <= kRounding * std::max(1.0, std::abs(exact)))) return std::nullopt;
  } else {
    return std::nullopt;
  }
  if (!(raw >= row.lowest && raw <= row.highest)) return std::nullopt;
  return static_cast<std::uint16_t>(raw);
}

std::string range_of(const RegisterRow& row) {
  if (!row.values.empty()) {
    std::string names;
    for (const NamedValue& value : row.values) names += (names.empty() ? "" : ", ") + std::string(value.name);
    return "one of " + names;
  }
  const auto number = [&](int raw) {
    return row.scale == 1 ? std::to_string(raw) : json(std::round(raw * row.scale * 1e6) / 1e6).dump();
  };
  const std::string step = row.scale == 1 ? " in whole numbers" : " in steps of " + number(1);
  return number(row.lowest) + " to " + number(row.highest) + (*row.unit ? std::string(" ") + row.unit : "") + step;
}

}  // namespace

SettingsWords::SettingsWords(std::span<const std::uint16_t, kControlRegisters> all_control,
                             std::span<const std::uint16_t, kProcessBlockRegisters> all_process) {
  std::ranges::copy(all_control.last<kControl>(), control.begin());
  std::ranges::copy(all_process.first<kProcess>(), process.begin());
}

std::optional<Refusal> apply_settings(const json& wanted, SettingsWords& words) {
  if (!wanted.is_object() || wanted.empty()) return Refusal{400, "Expected {\"setting\": value, ...}."};
  for (const auto& [name, value] : wanted.items()) {
    const RegisterRow* row = setting_by_name(name);
    if (!row || !row->writable) return Refusal{400, "There is no setting \"" + name + "\"."};
    const auto raw = raw_setting(*row, value);
    if (!raw)
      return Refusal{400, name + ": found " + value.dump(-1, ' ', true, json::error_handler_t::replace) +
                              ", expected " + range_of(*row) + "."};
    const bool is_process = row->address >= kProcessAddress;
    (is_process ? words.process[static_cast<std::size_t>(row->address - kProcessAddress)]
                : words.control[static_cast<std::size_t>(row->address - kFirstSettingRegister)]) = *raw;
    (is_process ? words.changes_process : words.changes_control) = true;
  }
  return std::nullopt;
}

}  // namespace finsight::page
