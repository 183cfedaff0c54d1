// The register table as lists: Markdown, comma-separated values, Python.
#include <algorithm>
#include <sstream>
#include <stdexcept>
#include <string_view>

#include "hostgen/plc/plc_files.h"
#include "hostgen/plc/row_text.h"

namespace finsight::host {

namespace {

/// "0=none;1=zero".
std::string values_list(const RegisterRow& row) {
  std::string text;
  for (const NamedValue& value : row.values) {
    if (!text.empty()) text += ";";
    text += std::to_string(value.value) + "=" + value.name;
  }
  return text;
}

std::string python_row(const RegisterRow& row) {
  const auto boolean = [](bool value) { return value ? "True" : "False"; };
  std::ostringstream text;
  text << "    Row(" << row.address << ", \"" << row.name << "\", \"" << name_of(row.type) << "\", " << row.scale
       << ", \"" << row.unit << "\", " << boolean(row.may_be_invalid()) << ", ";
  if (row.writable) {
    text << "(" << row.lowest << ", " << row.highest << ")";
  } else {
    text << "None";
  }
  text << ", {";
  std::size_t column = 120;  // so that values begin on a line of their own
  for (const NamedValue& value : row.values) {
    const std::string item = std::to_string(value.value) + ": \"" + value.name + "\"";
    if (&value != &row.values.front()) text << ",";
    if (column + 2 + item.size() > 118) {
      text << "\n       ";
      column = 7;
    }
    text << " " << item;
    column += 2 + item.size();
  }
  text << "}),\n";
  return text.str();
}

}  // namespace

namespace {

/// A long list of codes stands once in the tables, at the first register that has it.
std::string described(const RegisterTable& table, const RegisterRow& row) {
  constexpr std::size_t kLong = 4;
  const auto name = [](const NamedValue& value) { return std::string_view(value.name); };
  if (row.values.size() < kLong) return full_description(row);
  for (const std::span<const RegisterRow> block : table.blocks()) {
    for (const RegisterRow& first : block) {
      if (&first == &row) return full_description(row);
      if (std::ranges::equal(first.values, row.values, {}, name, name)) {
        return full_description(row, "codes as in register " + std::to_string(first.address));
      }
    }
  }
  return full_description(row);
}

std::string block_markdown(const RegisterTable& table, std::span<const RegisterRow> block) {
  std::ostringstream text;
  text << "| address | reference | name | type | scale | unit | |\n|---|---|---|---|---|---|---|\n";
  for (const RegisterRow& row : block) {
    text << "| " << row.address;
    if (words_of(row.type) > 1) text << "-" << row.address + words_of(row.type) - 1;
    text << " | " << reference_of(row) << " | `" << row.name << "` | " << name_of(row.type) << " | " << row.scale
         << " | " << row.unit << " | " << described(table, row) << " |\n";
  }
  return text.str();
}

/// Of a block with registers that may be written.
std::string writable_markdown(const RegisterTable& table, std::span<const RegisterRow> rows) {
  std::ostringstream text;
  text << "| address | reference | name | type | scale | unit | writable values | factory | |\n"
          "|---|---|---|---|---|---|---|---|---|\n";
  for (const RegisterRow& row : rows) {
    if (is_reserved(row)) continue;
    text << "| " << row.address << " | " << reference_of(row) << " | `" << row.name << "` | " << name_of(row.type)
         << " | " << row.scale << " | " << row.unit << " | ";
    if (row.writable) text << row.lowest << " ... " << row.highest;
    text << " | ";
    if (is_setting(row)) text << row.factory;
    text << " | " << described(table, row) << " |\n";
  }
  return text.str();
}

}  // namespace

std::string measurements_markdown(const RegisterTable& table) { return block_markdown(table, table.measurements); }
std::string control_markdown(const RegisterTable& table) { return writable_markdown(table, table.control); }
std::string process_markdown(const RegisterTable& table) { return writable_markdown(table, table.process); }
std::string history_markdown(const RegisterTable& table) { return block_markdown(table, table.history); }
std::string gathered_markdown(const RegisterTable& table) { return block_markdown(table, table.gathered); }
std::string diagnostics_markdown(const RegisterTable& table) { return block_markdown(table, table.diagnostics); }

std::string registers_csv(const RegisterTable& table) {
  std::ostringstream text;
  text << "address,reference,name,type,scale,unit,access,lowest,highest,factory,description,invalid,values\r\n";
  const auto add = [&](const RegisterRow& row) {
    text << row.address << "," << reference_of(row) << "," << row.name << "," << name_of(row.type) << "," << row.scale
         << "," << row.unit << "," << (row.writable ? "read/write" : "read") << ",";
    if (row.writable) text << row.lowest;
    text << ",";
    if (row.writable) text << row.highest;
    text << ",";
    if (is_setting(row)) text << row.factory;
    text << ",\"" << full_description(row) << "\"," << invalid_value(row) << "," << values_list(row) << "\r\n";
  };
  for (const std::span<const RegisterRow> block : table.blocks()) std::ranges::for_each(block, add);
  return text.str();
}

std::string finsightctl_table(const RegisterTable& table) {
  std::string text = "REGISTERS = [\n";
  for (const std::span<const RegisterRow> block : table.blocks()) {
    for (const RegisterRow& row : block) text += python_row(row);
  }
  return text + "]\n";
}

std::string with_section(const std::string& text, const std::string& name, const std::string& content) {
  const auto find = [&text](const std::string& marker, std::size_t from) {
    const std::size_t at = text.find(marker, from);
    if (at == std::string::npos) throw std::runtime_error("no line with \"" + marker + "\"");
    return at;
  };
  const std::size_t begin = text.find('\n', find("BEGIN GENERATED " + name, 0)) + 1;
  const std::size_t end = text.rfind('\n', find("END GENERATED " + name, begin)) + 1;
  return text.substr(0, begin) + content + text.substr(end);
}

}  // namespace finsight::host
