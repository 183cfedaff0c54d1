// The register table as an Add-On Instruction for Rockwell's Logix controllers, in the XML that Studio 5000 exports.
#include <sstream>
#include <vector>

#include "hostgen/plc/plc_files.h"
#include "hostgen/plc/row_text.h"

namespace finsight::host {

namespace {

/// A parameter or a local tag of the instruction.
struct RockwellTag {
  std::string name, type, usage, description, first_value = "0";
};

bool is_real(const RegisterRow& row) { return row.scale != 1 || row.type == RegisterType::kFloat32; }

std::string cdata(const std::string& text) { return std::string("<![CDATA[") + text + "]]>"; }

/// The value that a tag has at first, in both forms of an export.
std::string default_data(const RockwellTag& tag) {
  const bool real = tag.type == "REAL";
  const std::string value = real ? "0.0" : tag.first_value, radix = real ? "Float" : "Decimal";
  return std::string("<DefaultData Format=\"L5K\">") + cdata(real ? "0.00000000e+000" : value) +
         "</DefaultData><DefaultData Format=\"Decorated\"><DataValue DataType=\"" + tag.type + "\" Radix=\"" + radix +
         "\" Value=\"" + value + "\"/></DefaultData>";
}

std::string parameter(const RockwellTag& tag) {
  const std::string radix = tag.type == "REAL" ? "Float" : "Decimal";
  std::string text =
      std::string("<Parameter Name=\"") + tag.name + "\" TagType=\"Base\" DataType=\"" + tag.type + "\" ";
  if (tag.usage.starts_with("InOut")) {
    const std::string size = tag.usage.size() > 6 ? std::string("Dimensions=\"") + tag.usage.substr(6) + "\" " : "";
    return text + size + "Usage=\"InOut\" Radix=\"" + radix +
           "\" Required=\"true\" Visible=\"true\" Constant=\"false\"><Description>" + cdata(tag.description) +
           "</Description></Parameter>\n";
  }
  const bool is_system = tag.name == "EnableIn" || tag.name == "EnableOut", is_input = tag.usage == "Input";
  return text + "Usage=\"" + tag.usage + "\" Radix=\"" + radix + "\" Required=\"false\" Visible=\"" +
         (is_system ? "false" : "true") + "\" ExternalAccess=\"" +
         (is_system || !is_input ? "Read Only" : "Read/Write") + "\"><Description>" + cdata(tag.description) +
         "</Description>" + (is_system ? "" : default_data(tag)) + "</Parameter>\n";
}

std::string type_of(const RegisterRow& row) { return is_real(row) ? "REAL" : "DINT"; }

std::vector<RockwellTag> value_tags(const RegisterTable& table) {
  std::vector<RockwellTag> tags;
  for (const RegisterRow& row : table.measurements) {
    if (is_reserved(row)) continue;
    const std::string at = std::string("register ") + std::to_string(row.address);
    if (is_bits(row)) {
      for (const NamedValue& bit : row.values) {
        tags.push_back({variable_of(row, bit), "BOOL", "Output", at + ", bit " + std::to_string(bit.value)});
      }
      continue;
    }
    tags.push_back({variable_of(row), type_of(row), "Output", at + ": " + full_description(row)});
    if (row.may_be_invalid()) tags.push_back({std::string(row.name) + "_valid", "BOOL", "Output", at + " is valid"});
  }
  return tags;
}

std::vector<RockwellTag> parameters(const RegisterTable& table) {
  std::vector<RockwellTag> tags = {
      {"EnableIn", "BOOL", "Input", "Enable Input - System Defined Parameter"},
      {"EnableOut", "BOOL", "Output", "Enable Output - System Defined Parameter"},
      {"words", "INT", std::string("InOut ") + std::to_string(kMeasurementRegisters),
       std::string("as the Modbus client reads registers 0 to ") + std::to_string(kMeasurementRegisters - 1)},
      {"own", "INT", "InOut 4", "as the Modbus client reads registers 1200 to 1203"},
      {"request", "INT", "InOut 2", "for registers 1000 and 1001, in one write, while write_request is set"},
      {"number", "DINT", "InOut", "the newest number of this PLC: one tag, the same for all instances of the device"},
      {"in_turn", "BOOL", "InOut", "set while one of them is busy, the others wait: one tag for all of them, too"},
      {"low_word_first", "BOOL", "Input", "as register 1019: 1 for CDAB"},
      {"poll_period", "DINT", "Input",
       "ms between two reads; without a new heartbeat for twice as long and 200 ms, not alive", "100"},
      {"max_age", "DINT", "Input", "0.1 ms; results that were older than this when they were read are not used",
       "3000"},
      {"execute", "BOOL", "Input", "a rising edge starts the command"},
      {"command", "DINT", "Input", values_text(table.control.front())},
      {"link_ready", "BOOL", "Input", "own has been read since the connection was opened"},
      {"write_exception", "DINT", "Input", "code of the exception that the write got, for one scan; 0: none"},
      {"first_number", "DINT", "Input", "give every client of the device numbers of its own, 2000 or more", "1"},
      {"last_number", "DINT", "Input", "the last of them", "65535"},
      {"time_limit", "DINT", "Input", "ms for all of a command", "10000"},
      {"write_request", "BOOL", "Output", "write request to registers 1000 and 1001"},
      {"busy", "BOOL", "Output", "until done or error"},
      {"done", "BOOL", "Output", "the command ran, with result 0"},
      {"error", "BOOL", "Output", "it did not"},
      {"error_code", "DINT", "Output", "as register 1203; 65535: no result within time_limit"},
      {"alive", "BOOL", "Output", "new results keep coming; while 0, use no value"},
      {"word_order_is_right", "BOOL", "Output", "by the test constants, registers 39 and 46"}};
  const std::vector<RockwellTag> values = value_tags(table);
  tags.insert(tags.end(), values.begin(), values.end());
  return tags;
}

const RockwellTag kLocalTags[] = {
    {"pair", "INT", "2", ""},          {"long_value", "DINT", "", ""}, {"real_value", "REAL", "", ""},
    {"last_heartbeat", "INT", "", ""}, {"before", "BOOL", "", ""},     {"chosen", "BOOL", "", ""},
    {"is_new", "BOOL", "", ""},        {"taken", "BOOL", "", ""},      {"given", "DINT", "", ""},
    {"sequence", "DINT", "", ""},      {"quiet", "FBD_TIMER", "", ""}, {"timer", "FBD_TIMER", "", ""},
};

std::string local_tag(const RockwellTag& tag) {
  if (tag.type == "FBD_TIMER") {
    return std::string("<LocalTag Name=\"") + tag.name + "\" DataType=\"FBD_TIMER\" ExternalAccess=\"None\"/>\n";
  }
  const std::string radix = tag.type == "REAL" ? "Float" : "Decimal";
  if (!tag.usage.empty()) {
    return std::string("<LocalTag Name=\"") + tag.name + "\" DataType=\"" + tag.type + "\" Dimensions=\"" + tag.usage +
           "\" Radix=\"" + radix + "\" ExternalAccess=\"None\"/>\n";
  }
  return std::string("<LocalTag Name=\"") + tag.name + "\" DataType=\"" + tag.type + "\" Radix=\"" + radix +
         "\" ExternalAccess=\"None\">" + default_data(tag) + "</LocalTag>\n";
}

std::string word(int address) { return std::string("words[") + std::to_string(address) + "]"; }
/// An INT as the unsigned number that it stands for.
std::string unsigned_word(int address) { return std::string("(") + word(address) + " AND 16#FFFF)"; }

/// The lines that join two words; a Logix controller keeps the low word first.
std::string joined(const RegisterRow& row) {
  const std::string first = word(row.address), second = word(row.address + 1);
  return std::string("IF low_word_first THEN pair[0] := ") + first + "; pair[1] := " + second +
         ";\nELSE pair[0] := " + second + "; pair[1] := " + first +
         "; END_IF;\nCOP(pair[0], long_value, 1);\nCOP(pair[0], real_value, 1);\n";
}

std::string converted(const RegisterRow& row) {
  if (row.type == RegisterType::kFloat32) return "real_value";
  if (row.type == RegisterType::kUint32) return "long_value";
  const bool is_signed = row.type == RegisterType::kInt16;
  std::ostringstream text;
  text << (is_signed ? word(row.address) : unsigned_word(row.address));
  if (row.scale != 1) text << " * " << row.scale;
  return text.str();
}

std::string validity(const RegisterRow& row) {
  if (row.type == RegisterType::kFloat32) return "((long_value AND 16#7F80_0000) <> 16#7F80_0000)";
  return std::string("(") + word(row.address) + " <> " + (row.type == RegisterType::kInt16 ? "-32768" : "-1") + ")";
}

std::string assignments(const RegisterTable& table) {
  std::string text;
  for (const RegisterRow& row : table.measurements) {
    if (is_reserved(row)) continue;
    if (is_bits(row)) {
      for (const NamedValue& bit : row.values) {
        text += variable_of(row, bit) + " := alive AND " + word(row.address) + "." + std::to_string(bit.value) + ";\n";
      }
      continue;
    }
    if (words_of(row.type) == 2) text += joined(row);
    const std::string variable = variable_of(row), valid = std::string(row.name) + "_valid";
    if (row.address == address_of("test_constant_long")) {
      text += "word_order_is_right := (" + word(address_of("test_constant")) +
              " = 16#1234) AND (long_value = 16#1234_5678);\n";
    }
    if (row.may_be_invalid()) {
      text += valid + " := alive AND " + validity(row) + ";\nIF " + valid + " THEN " + variable +
              " := " + converted(row) + "; ELSE " + variable + " := 0; END_IF;\n";
    } else {
      text += variable + " := " + converted(row) + ";\n";
    }
  }
  return text + "IF NOT alive THEN any_fault := 1; END_IF;\n";
}

std::string logic(const RegisterTable& table) {
  const std::string heartbeat = word(address_of("heartbeat"));
  return std::string("// ") + kOrigin + "\nquiet.PRE := 2 * poll_period + 200;\nquiet.TimerEnable := " + heartbeat +
         " = last_heartbeat;\nTONR(quiet);\nlast_heartbeat := " + heartbeat + ";\nalive := NOT quiet.DN AND (" +
         word(address_of("test_constant")) + " = 16#1234) AND (" + unsigned_word(address_of("age")) +
         " <= max_age) AND (" + word(address_of("fault")) + " <> " + std::to_string(value_named("fault", "stalled")) +
         ");\n" + assignments(table) +
         R"(IF execute AND NOT before AND NOT busy THEN
  given := command; chosen := 0; busy := 1; done := 0; error := 0; error_code := 0;
  timer.TimerEnable := 0;
  TONR(timer);
END_IF;
before := execute;
is_new := busy AND link_ready AND ((NOT chosen AND NOT in_turn) OR (chosen AND (write_exception = 3)));
IF is_new THEN
  IF number = 0 THEN number := own[1] AND 16#FFFF; END_IF;
  IF (number < first_number) OR (number >= last_number) THEN number := first_number;
  ELSE number := number + 1; END_IF;
  sequence := number;
  in_turn := 1;
  request[0] := given;
  IF sequence > 32767 THEN request[1] := sequence - 65536; ELSE request[1] := sequence; END_IF;
  chosen := 1;
END_IF;
timer.PRE := time_limit;
timer.TimerEnable := busy;
TONR(timer);
taken := busy AND chosen AND NOT is_new AND ((own[1] AND 16#FFFF) = sequence) AND (own[2] = given);
IF taken AND (own[3] <> )" +
         std::to_string(value_named("own_result", "running")) + R"() THEN
  busy := 0;
  error_code := own[3];
  error := own[3] <> 0;
  done := NOT error;
ELSIF busy AND timer.DN THEN
  busy := 0; error := 1; error_code := 65535;
END_IF;
IF chosen AND NOT busy THEN chosen := 0; in_turn := 0; END_IF;
write_request := busy AND chosen AND link_ready AND NOT taken;
)";
}

std::string lines_of(const std::string& code) {
  std::istringstream in(code);
  std::string text, line;
  for (int number = 0; std::getline(in, line); ++number) {
    text += std::string("<Line Number=\"") + std::to_string(number) + "\">" + cdata(line) + "</Line>\n";
  }
  return text;
}

}  // namespace

std::string rockwell_l5x(const RegisterTable& table) {
  constexpr const char* kDate = "2026-01-01T00:00:00.000Z";  // fixed: the same table, the same bytes
  std::string text = R"(<?xml version="1.0" encoding="UTF-8" standalone="yes"?>
<RSLogix5000Content SchemaRevision="1.0" SoftwareRevision="32.00" TargetName="Finsight" TargetType="AddOnInstructionDefinition" TargetRevision="1.0" ContainsContext="true" Owner="Finsight" ExportDate="Thu Jan 01 00:00:00 2026" ExportOptions="References NoRawData L5KData DecoratedData Context Dependencies ForceProtectedEncoding AllProjDocTrans">
<Controller Use="Context" Name="Finsight">
<AddOnInstructionDefinitions Use="Context">
<AddOnInstructionDefinition Use="Target" Name="Finsight" Revision="1.0" ExecutePrescan="false" ExecutePostscan="false" ExecuteEnableInFalse="false" CreatedDate=")";
  text += std::string(kDate) + "\" CreatedBy=\"Finsight\" EditedDate=\"" + kDate +
          "\" EditedBy=\"Finsight\" SoftwareRevision=\"v32.00\">\n<Description>" +
          cdata("Finsight touch sensor: scaled values, alive and commands, from what a Modbus TCP client reads") +
          "</Description>\n<Parameters>\n";
  for (const RockwellTag& tag : parameters(table)) text += parameter(tag);
  text += "</Parameters>\n<LocalTags>\n";
  for (const RockwellTag& tag : kLocalTags) text += local_tag(tag);
  return text + "</LocalTags>\n<Routines>\n<Routine Name=\"Logic\" Type=\"ST\">\n<STContent>\n" +
         lines_of(logic(table)) +
         "</STContent>\n</Routine>\n</Routines>\n</AddOnInstructionDefinition>\n</AddOnInstructionDefinitions>\n"
         "</Controller>\n</RSLogix5000Content>\n";
}

}  // namespace finsight::host
