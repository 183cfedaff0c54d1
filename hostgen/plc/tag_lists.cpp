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

/// Calls `each` for every register that is not reserved, and for every bit behind its register.
void for_each_tag(const RegisterTable& table,
                  const std::function<void(const RegisterRow&, const NamedValue* bit)>& each) {
  for (const std::span<const RegisterRow> block : table.blocks()) {
    for (const RegisterRow& row : block) {
      if (is_reserved(row)) continue;
      each(row, nullptr);
      if (!is_bits(row)) continue;
      for (const NamedValue& bit : row.values) each(row, &bit);
    }
  }
}

std::string tag_name(const RegisterRow& row, const NamedValue* bit) {
  return bit ? std::string(row.name) + "_" + bit->name : row.name;
}

std::string description_of(const RegisterRow& row, const NamedValue* bit) {
  return bit ? label_of(*bit) + (*bit->note ? std::string(", ") + bit->note : std::string()) : full_description(row);
}

const char* kepware_type(const RegisterRow& row) {
  constexpr const char* kTypes[] = {"Word", "Short", "DWord", "Float", "String"};
  return kTypes[static_cast<std::size_t>(row.type)];
}

std::string kepware_address(const RegisterRow& row, const NamedValue* bit) {
  std::string address = std::to_string(400'001 + row.address);
  if (bit) address.append(".").append(std::to_string(bit->value));
  if (row.type == RegisterType::kText32) address += ".32H";
  return address;
}

/// Ignition's numbers of data types: 1 Int2, 2 Int4, 3 Int8, 4 Float4, 6 Boolean, 7 String.
int ignition_type(const RegisterRow& row, const NamedValue* bit) {
  constexpr int kTypes[] = {2, 1, 3, 4, 7};
  if (bit) return 6;
  return row.scale != 1 ? 4 : kTypes[static_cast<std::size_t>(row.type)];
}

std::string ignition_item(const RegisterRow& row, const NamedValue* bit) {
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
  for_each_tag(table, [&](const RegisterRow& row, const NamedValue* bit) {
    const bool is_scaled = !bit && row.scale != 1;
    text += quoted(tag_name(row, bit)) + "," + quoted(kepware_address(row, bit)) + "," +
            (bit ? "Boolean" : kepware_type(row)) + ",1," + (row.writable ? "R/W" : "RO") + ",100,";
    text += is_scaled ? std::string("Linear,") + std::to_string(kLowestRaw) + "," + std::to_string(kHighestRaw) + "," +
                            scaled(row, kLowestRaw) + "," + scaled(row, kHighestRaw) + ",Double,0,0,"
                      : ",,,,,,,,";
    text += quoted(row.is_number() && !bit ? row.unit : "") + "," + quoted(description_of(row, bit)) + "\r\n";
  });
  return text;
}

std::string ignition_csv(const RegisterTable& table) {
  std::string text =
      "Path,Name,DataType,Enabled,TagType,AccessRights,OPCServer,OPCItemPath,ScaleMode,RawLow,RawHigh,ScaledLow,"
      "ScaledHigh,ClampMode,EngUnit,Documentation\r\n";
  for_each_tag(table, [&](const RegisterRow& row, const NamedValue* bit) {
    const bool is_scaled = !bit && row.scale != 1;
    text += std::string("Finsight/,") + tag_name(row, bit) + "," + std::to_string(ignition_type(row, bit)) +
            ",true,0," + (row.writable ? "1" : "0") + ",Ignition OPC-UA Server," + quoted(ignition_item(row, bit)) +
            ",";
    text += is_scaled ? std::string("1,") + std::to_string(kLowestRaw) + "," + std::to_string(kHighestRaw) + "," +
                            scaled(row, kLowestRaw) + "," + scaled(row, kHighestRaw) + ",0,"
                      : "0,,,,,,";
    text += quoted(row.is_number() && !bit ? row.unit : "") + "," + quoted(description_of(row, bit)) + "\r\n";
  });
  return text;
}

}  // namespace finsight::host
