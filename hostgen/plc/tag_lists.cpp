// The register table as tags for OPC servers and SCADA systems: Kepware and Ignition.
#include <functional>
#include <sstream>

#include "hostgen/plc/plc_files.h"
#include "hostgen/plc/row_text.h"

namespace finsight::host {

namespace {

constexpr int kLowestRaw = 0, kHighestRaw = 10'000;  // of linear scaling; values beyond it are not clamped

std::string quoted(const std::string& text) {
  std::string result = "\"";
  for (const char c : text) result += c == '"' ? "\"\"" : std::string(1, c);
  return result + "\"";
}

std::string scaled(const RegisterRow& row, int raw) {
  std::ostringstream text;
  text << row.scale * raw;
  return text.str();
}

/// One line: a register, or one of its bits, or, beside a scaled one that may be invalid, its word as it is. Linear
/// scaling takes the invalid value for a measurement, so it has to be compared there.
struct Tag {
  const RegisterRow& row;
  const NamedValue* bit = nullptr;
  bool is_raw = false;
  bool is_scaled() const { return !bit && !is_raw && row.scale != 1; }
};

std::string name_of(const Tag& tag) {
  if (tag.is_raw) return std::string(tag.row.name) + "_raw";
  return tag.bit ? std::string(tag.row.name) + "_" + tag.bit->name : tag.row.name;
}

/// A tag is written by itself. Command and number, and the three numbers of gravity, are only taken together.
bool is_written_alone(const RegisterRow& row) {
  const bool is_order = row.address == address_of("command") || row.address == address_of("command_sequence");
  const bool is_gravity = row.address >= kGravityRegister && row.address < kGravityRegister + kGravityRegisters;
  return row.writable && !is_order && !is_gravity;
}

/// Calls `each` for every tag, without reserved registers.
void for_each_tag(const RegisterTable& table, const std::function<void(const Tag&)>& each) {
  for (const std::span<const RegisterRow> block : table.blocks()) {
    for (const RegisterRow& row : block) {
      if (is_reserved(row)) continue;
      each({row});
      if (row.may_be_invalid() && row.scale != 1) each({row, nullptr, true});
      if (!is_bits(row)) continue;
      for (const NamedValue& bit : row.values) each({row, &bit});
    }
  }
}

std::string description_of(const Tag& tag) {
  const RegisterRow& row = tag.row;
  if (row.writable && !is_written_alone(row)) {
    return full_description(row) + "; read only here: the device takes it only in one write with its neighbours";
  }
  if (tag.bit) return label_of(*tag.bit) + (*tag.bit->note ? std::string(", ") + tag.bit->note : std::string());
  if (tag.is_raw) return std::string(row.name) + " without scaling; " + invalid_value(row) + ": " + row.invalid_means;
  if (!tag.is_scaled() || !row.may_be_invalid()) return full_description(row);
  return std::string(row.description) + "; " + scaled(row, std::stoi(invalid_value(row))) +
         " is no measurement: " + row.invalid_means + ", " + row.name + "_raw is " + invalid_value(row) + " then";
}

/// Of a number.
std::string unit_of(const Tag& tag) { return tag.row.is_number() && !tag.bit && !tag.is_raw ? tag.row.unit : ""; }

const char* kepware_type(const RegisterRow& row) {
  constexpr const char* kTypes[] = {"Word", "Short", "DWord", "Float", "String"};
  return kTypes[static_cast<std::size_t>(row.type)];
}

std::string kepware_address(const Tag& tag) {
  const auto& [row, bit, is_raw] = tag;
  std::string address = std::to_string(400'001 + row.address);
  if (bit) address.append(".").append(std::to_string(bit->value));
  if (row.type == RegisterType::kText32) address += ".32H";
  return address;
}

/// Ignition's numbers of data types: 1 Int2, 2 Int4, 3 Int8, 4 Float4, 6 Boolean, 7 String.
int ignition_type(const Tag& tag) {
  constexpr int kTypes[] = {2, 1, 3, 4, 7};
  if (tag.bit) return 6;
  return tag.is_scaled() ? 4 : kTypes[static_cast<std::size_t>(tag.row.type)];
}

std::string ignition_item(const Tag& tag) {
  const auto& [row, bit, is_raw] = tag;
  constexpr const char* kPrefixes[] = {"HRUS", "HR", "HRUI", "HRF", "HRS"};
  std::string item =
      "[Finsight]" + std::string(kPrefixes[static_cast<std::size_t>(row.type)]) + std::to_string(row.address + 1);
  if (bit) item = "[Finsight]HR" + std::to_string(row.address + 1) + "." + std::to_string(bit->value);
  return row.type == RegisterType::kText32 ? item + ":32" : item;
}

}  // namespace

std::string kepware_csv(const RegisterTable& table) {
  std::string text =
      "Tag Name,Address,Data Type,Respect Data Type,Client Access,Scan Rate,Scaling,Raw Low,Raw High,Scaled Low,Scaled "
      "High,Scaled Data Type,Clamp Low,Clamp High,Eng Units,Description\r\n";
  for_each_tag(table, [&](const Tag& tag) {
    const RegisterRow& row = tag.row;
    text += quoted(name_of(tag)) + "," + quoted(kepware_address(tag)) + "," +
            (tag.bit ? "Boolean" : kepware_type(row)) + ",1," + (is_written_alone(row) ? "R/W" : "RO") + ",100,";
    text += tag.is_scaled() ? std::string("Linear,") + std::to_string(kLowestRaw) + "," + std::to_string(kHighestRaw) +
                                  "," + scaled(row, kLowestRaw) + "," + scaled(row, kHighestRaw) + ",Double,0,0,"
                            : ",,,,,,,,";
    text += quoted(unit_of(tag)) + "," + quoted(description_of(tag)) + "\r\n";
  });
  return text;
}

std::string ignition_csv(const RegisterTable& table) {
  std::string text =
      "Path,Name,DataType,Enabled,TagType,AccessRights,OPCServer,OPCItemPath,ScaleMode,RawLow,RawHigh,ScaledLow,"
      "ScaledHigh,ClampMode,EngUnit,Documentation\r\n";
  for_each_tag(table, [&](const Tag& tag) {
    const RegisterRow& row = tag.row;
    text += "Finsight/," + name_of(tag) + "," + std::to_string(ignition_type(tag)) + ",true,0," +
            (is_written_alone(row) ? "1" : "0") + ",Ignition OPC-UA Server," + quoted(ignition_item(tag)) + ",";
    text += tag.is_scaled() ? std::string("1,") + std::to_string(kLowestRaw) + "," + std::to_string(kHighestRaw) + "," +
                                  scaled(row, kLowestRaw) + "," + scaled(row, kHighestRaw) + ",0,"
                            : "0,,,,,,";
    text += quoted(unit_of(tag)) + "," + quoted(description_of(tag)) + "\r\n";
  });
  return text;
}

}  // namespace finsight::host
