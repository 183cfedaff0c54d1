// Registers in words and numbers: as JSON for browsers, as text for Prometheus.
#pragma once

#include <cstdint>
#include <map>
#include <nlohmann/json.hpp>
#include <span>
#include <string>

#include "firmware/modbus/register_table.h"

namespace finsight::page {

/// The words of one block of the register table; empty: not read.
using BlockWords = std::span<const std::uint16_t>;

/// Value of a row whose first word is words[0], in the row's unit: a number, a text, an array of the names of bits that
/// are set, or null where it is not valid. `low_word_first`: of 32-bit registers.
nlohmann::json register_value(const RegisterRow& row, BlockWords words, bool low_word_first);

/// The table itself: for each row its block, address, name, type, kind, scale, unit, description, values and limits.
nlohmann::json register_table_json();

/// Every row of `block` by name; rows that the words do not reach are left out.
void add_values(std::span<const RegisterRow> block, BlockWords words, bool low_word_first, nlohmann::json& values);

/// The numbers of add_values() in Prometheus' text form; those that are not valid are left out.
std::string metrics_text(const nlohmann::json& values);

}  // namespace finsight::page
