#include "firmware/page/register_text.h"

#include <array>
#include <bit>
#include <cmath>

namespace finsight::page {

namespace {

using nlohmann::json;

constexpr std::array<const char*, 6> kBlockNames = {"measurements", "control",  "process",
                                                    "history",      "gathered", "diagnostics"};

const char* name_of(RegisterType type) {
  switch (type) {
    case RegisterType::kInt16:
      return "int16";
    case RegisterType::kUint32:
      return "uint32";
    case RegisterType::kFloat32:
      return "float32";
    case RegisterType::kText32:
      return "text";
    case RegisterType::kUint16:
      break;
  }
  return "uint16";
}

const char* name_of(RegisterKind kind) {
  switch (kind) {
    case RegisterKind::kCode:
      return "code";
    case RegisterKind::kBits:
      return "bits";
    case RegisterKind::kReserved:
      return "reserved";
    case RegisterKind::kClient:
      return "client";
    case RegisterKind::kText:
      return "text";
    case RegisterKind::kNumber:
      break;
  }
  return "number";
}

std::uint32_t long_word(BlockWords words, bool low_word_first) {
  const std::uint32_t first = words[0], second = words[1];
  return low_word_first ? second << 16 | first : first << 16 | second;
}

json number(const RegisterRow& row, BlockWords words, bool low_word_first) {
  // Twelve digits: 0.01 * 29 is 0.29, not 0.29000000000000004.
  const auto scaled = [&](double raw) {
    return row.scale == 1 ? json(static_cast<std::int64_t>(raw)) : json(std::round(raw * row.scale * 1e9) / 1e9);
  };
  switch (row.type) {
    case RegisterType::kUint16:
      if (row.may_be_invalid() && words[0] == 0xFFFF) return nullptr;
      return scaled(words[0]);
    case RegisterType::kInt16:
      if (row.may_be_invalid() && words[0] == 0x8000) return nullptr;
      return scaled(static_cast<std::int16_t>(words[0]));
    case RegisterType::kUint32:
      return scaled(long_word(words, low_word_first));
    case RegisterType::kFloat32: {
      const float value = std::bit_cast<float>(long_word(words, low_word_first));
      return std::isfinite(value) ? json(value) : json(nullptr);
    }
    case RegisterType::kText32:
      break;
  }
  return nullptr;
}

std::string text(BlockWords words) {
  std::string text;
  for (const std::uint16_t word : words.first(words_of(RegisterType::kText32))) {
    for (const int byte : {word >> 8, word & 0xFF}) {
      if (byte >= ' ' && byte <= '~') text += static_cast<char>(byte);
    }
  }
  return text;
}

std::string client(std::uint32_t address) {
  if (address == 0) return "";
  if (address == 1) return "serial line";
  return std::to_string(address >> 24) + "." + std::to_string(address >> 16 & 0xFF) + "." +
         std::to_string(address >> 8 & 0xFF) + "." + std::to_string(address & 0xFF);
}

}  // namespace

json register_value(const RegisterRow& row, BlockWords words, bool low_word_first) {
  switch (row.kind) {
    case RegisterKind::kReserved:
      return words[0];
    case RegisterKind::kText:
      return text(words);
    case RegisterKind::kClient:
      return client(long_word(words, low_word_first));
    case RegisterKind::kCode:
      for (const NamedValue& value : row.values) {
        if (value.value == words[0]) return value.name;
      }
      return words[0];
    case RegisterKind::kBits: {
      json set = json::array();
      for (const NamedValue& bit : row.values) {
        if (words[0] >> bit.value & 1) set.push_back(bit.name);
      }
      return set;
    }
    case RegisterKind::kNumber:
      break;
  }
  return number(row, words, low_word_first);
}

json register_table_json() {
  json rows = json::array();
  const auto blocks = kRegisterTable.blocks();
  for (std::size_t b = 0; b < kBlockNames.size(); ++b) {
    for (const RegisterRow& row : blocks[b]) {
      json entry = {{"block", kBlockNames[b]},   {"address", row.address},        {"name", row.name},
                    {"type", name_of(row.type)}, {"kind", name_of(row.kind)},     {"scale", row.scale},
                    {"unit", row.unit},          {"description", row.description}};
      if (row.invalid_means) entry["invalid"] = row.invalid_means;
      if (row.writable) {
        entry["lowest"] = row.lowest;
        entry["highest"] = row.highest;
        if (setting_at(row.address) >= 0) entry["factory"] = row.factory;
      }
      for (const NamedValue& value : row.values) {
        entry["values"].push_back({{"value", value.value}, {"name", value.name}, {"note", value.note}});
      }
      rows.push_back(std::move(entry));
    }
  }
  return rows;
}

void add_values(std::span<const RegisterRow> block, BlockWords words, bool low_word_first, json& values) {
  const int first = block.front().address;
  for (const RegisterRow& row : block) {
    const std::size_t at = static_cast<std::size_t>(row.address - first);
    if (at + static_cast<std::size_t>(words_of(row.type)) > words.size()) return;
    if (row.kind != RegisterKind::kReserved) values[row.name] = register_value(row, words.subspan(at), low_word_first);
  }
}

std::string metrics_text(const json& values) {
  std::string lines;
  for (const std::span<const RegisterRow> block : kRegisterTable.blocks()) {
    for (const RegisterRow& row : block) {
      const auto value = values.find(row.name);
      if (row.kind != RegisterKind::kNumber || value == values.end() || !value->is_number()) continue;
      std::string name = std::string("finsight_") + row.name;
      if (*row.unit) name += std::string("_") + row.unit;
      std::string help = *row.description ? row.description : row.name;
      lines += "# HELP " + name + " " + help + "\n# TYPE " + name + " gauge\n" + name + " " + value->dump() + "\n";
    }
  }
  const auto flags = values.find("status");
  if (flags == values.end()) return lines;
  lines += "# HELP finsight_status Bits of register 0.\n# TYPE finsight_status gauge\n";
  for (const NamedValue& bit : row_named("status").values) {
    const bool is_set = std::ranges::find(*flags, json(bit.name)) != flags->end();
    lines += std::string("finsight_status{bit=\"") + bit.name + "\"} " + (is_set ? "1" : "0") + "\n";
  }
  return lines;
}

}  // namespace finsight::page
