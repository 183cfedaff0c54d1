// What fitting one finger has found, as a file; `hostgen fit` writes it.
#pragma once

#include <cstdint>
#include <string>

#include "firmware/loop/finger_fit.h"
#include "firmware/settings/toml_table.h"

namespace finsight {

/// Of the days since 2000-01-01 that registers count: 20261123 is 9823. 0 where `date` is no day from then to 2179.
std::uint16_t days_of(std::int64_t date);
/// And back; 0: 0.
std::uint32_t date_of(std::uint16_t days);

/// By the system's clock.
std::uint16_t day_today();

/// Strict: throws InputError like TomlTable, also for values that no finger can have.
FitValues read_measured_fit(TomlTable table);
/// The text that read_measured_fit() reads.
std::string measured_fit_toml(const FitValues& fit);

/// Throws InputError if `fit` was measured with another pack than this one.
void check_fit(const FitValues& fit, std::uint32_t model_checksum, const std::string& where);

}  // namespace finsight
