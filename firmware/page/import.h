// A device's settings, lens, mount, fit and zero as one file: out of one device, into it again or into one with the
// same pack.
#pragma once

#include <functional>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>

#include "firmware/model/model.h"
#include "firmware/page/request_guard.h"
#include "firmware/page/settings_change.h"
#include "firmware/published/block.h"

namespace finsight::page {

/// Of the device, for export and import.
struct Identity {
  std::string pack_checksum, model_name;  ///< checksum_text()
  int width_px = 0, height_px = 0;        ///< of the pictures; 0: there are none
};

/// `about`: of the block, with lens, mount and fit. `frame`: with the zero, if there is one.
nlohmann::json export_file(const Identity& identity, const nlohmann::json& settings, const nlohmann::json& about,
                           const std::optional<PublishedFrame>& frame);

/// What is to be stored, as text; empty: the file has none.
struct Import {
  std::string lens, mount, fit, state;
};
/// Reads what export_file() wrote. Any JSON whatever; a refusal names the field, what was found and what was expected.
/// `words`: the settings now, for those that the file does not name. `mount`: of the model.
std::optional<Refusal> read_import(const nlohmann::json& file, const Identity& identity, SettingsWords words,
                                   const MountModel& mount, std::uint32_t model_checksum, Import& import);

/// Stores all of it in `folder` and restarts finsightd, which then uses it; or leaves everything as it was and says
/// why. What was there stays as the former one.
std::optional<Refusal> store_import(const std::filesystem::path& folder, const Import& import,
                                    const std::function<std::optional<Refusal>()>& restart);

}  // namespace finsight::page
