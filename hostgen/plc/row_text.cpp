#include "hostgen/plc/row_text.h"

#include <algorithm>
#include <cctype>
#include <string_view>

namespace finsight::host {

const char* name_of(RegisterType type) {
  constexpr const char* kNames[] = {"uint16", "int16", "uint32", "float32", "text32"};
  return kNames[static_cast<std::size_t>(type)];
}

std::string invalid_value(const RegisterRow& row) {
  if (!row.may_be_invalid()) return "";
  return is_float(row) ? "NaN" : row.type == RegisterType::kInt16 ? "-32768" : "65535";
}

std::string variable_of(const RegisterRow& row) {
  std::string name = row.name;
  if (is_float(row)) name = name.substr(0, name.size() - std::string_view("_float").size()) + "_real";
  if (!row.is_number() || *row.unit == '\0') return name;
  std::string unit = row.unit;
  std::ranges::transform(unit, unit.begin(), [](unsigned char c) { return std::tolower(c); });
  return name + "_" + unit;
}

std::string variable_of(const RegisterRow& row, const NamedValue& bit) {
  return row.address == address_of("status") ? bit.name : std::string(row.name) + "_" + bit.name;
}

std::string label_of(const NamedValue& value) {
  std::string label = value.name;
  std::ranges::replace(label, '_', ' ');
  return label;
}

std::string values_text(const RegisterRow& row) {
  std::string text;
  for (const NamedValue& value : row.values) {
    if (!text.empty()) text += ", ";
    text += std::to_string(value.value) + " " + label_of(value);
    if (*value.note) text += std::string(" (") + value.note + ")";
  }
  return text;
}

std::string full_description(const RegisterRow& row) { return full_description(row, values_text(row)); }

std::string full_description(const RegisterRow& row, const std::string& values) {
  std::string text = row.description;
  if (!text.empty() && !values.empty()) text += ": ";
  text += values;
  if (row.may_be_invalid()) text += "; " + invalid_value(row) + ": " + row.invalid_means;
  return text;
}

}  // namespace finsight::host
