// Settings by name and in their units -> register words.
#pragma once

#include <array>
#include <cstdint>
#include <nlohmann/json.hpp>
#include <optional>
#include <span>

#include "firmware/modbus/register_table.h"
#include "firmware/page/request_guard.h"

namespace finsight::page {

/// The words of all settings. Each block is written as a whole, so that a pair of thresholds may cross its old place.
struct SettingsWords {
  static constexpr int kControl = kControlAddress + kControlRegisters - kFirstSettingRegister;
  static constexpr int kProcess = address_of("grip_change") - kProcessAddress + 1;
  std::array<std::uint16_t, kControl> control{};  ///< from kFirstSettingRegister on
  std::array<std::uint16_t, kProcess> process{};  ///< from kProcessAddress on
  bool changes_control = false, changes_process = false;

  SettingsWords() = default;
  /// As they are now, of the registers' whole blocks.
  SettingsWords(std::span<const std::uint16_t, kControlRegisters> all_control,
                std::span<const std::uint16_t, kProcessBlockRegisters> all_process);
};

/// Puts what is wanted ({"hold_time": 300, "after_hold": "keep"}) into the words. Any JSON whatever; a refusal names
/// the setting, what was found and what was expected, and the words are then not to be used.
std::optional<Refusal> apply_settings(const nlohmann::json& wanted, SettingsWords& words);

}  // namespace finsight::page
