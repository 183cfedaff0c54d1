#include "hostgen/plc/plc_files.h"

#include <doctest/doctest.h>

#include <algorithm>
#include <array>
#include <fstream>
#include <iterator>
#include <list>
#include <regex>
#include <sstream>
#include <string>
#include <vector>

#include "firmware/modbus/register_table.h"

using namespace finsight;
using namespace finsight::host;

namespace {

std::string stored(const std::string& name) {
  std::ifstream in(FINSIGHT_SOURCE_DIR "/hostgen/plc/" + name, std::ios::binary);
  return {std::istreambuf_iterator<char>(in), {}};
}

bool contains(const std::string& text, const std::string& part) { return text.find(part) != std::string::npos; }

std::string without(const std::string& text, const std::string& pattern) {
  return std::regex_replace(text, std::regex(pattern), "");
}

/// The table with other prose in every description and note; prose that looks like bits, codes and invalid values.
class RewordedTable {
 public:
  RewordedTable() {
    std::size_t b = 0;
    for (const std::span<const RegisterRow> block : kRegisterTable.blocks()) {
      for (const RegisterRow& row : block) blocks_[b].push_back(reworded(row));
      ++b;
    }
  }
  RegisterTable table() const { return {blocks_[0], blocks_[1], blocks_[2], blocks_[3], blocks_[4], blocks_[5]}; }

 private:
  RegisterRow reworded(RegisterRow row) {
    row.description = "5 brown fox, 7 lazy dog (not known); 65535: no result yet";
    if (row.may_be_invalid()) row.invalid_means = "3 lost";
    std::vector<NamedValue>& values = values_.emplace_back(row.values.begin(), row.values.end());
    for (NamedValue& value : values) value.note = "12 not valid";
    row.values = values;
    return row;
  }

  std::list<std::vector<NamedValue>> values_;
  std::array<std::vector<RegisterRow>, kRegisterTable.blocks().size()> blocks_;
};

}  // namespace

TEST_CASE("plc files: those of the repository are the code's (build/host/hostgen plc --tree . writes them)") {
  CHECK(stored("registers.csv") == registers_csv());
  CHECK(stored("Finsight.st") == structured_text());
  CHECK(stored("Finsight.scl") == siemens_scl());
  CHECK(stored("Finsight.L5X") == rockwell_l5x());
  CHECK(stored("Finsight.kepware.csv") == kepware_csv());
  CHECK(stored("Finsight.ignition.csv") == ignition_csv());
  CHECK(stored("Finsight.node-red.json") == node_red_flow());
}

TEST_CASE("plc files: rewording a description changes comments and nothing else") {
  const RewordedTable reworded;
  const RegisterTable table = reworded.table();
  const std::string st_comment = R"(\(\*[^*]*\*\))", scl_comment = "//[^\n]*", csv_description = "\"[^\"]*\"";
  REQUIRE(structured_text(table) != structured_text());  // the prose is in the comments
  CHECK(without(structured_text(table), st_comment) == without(structured_text(), st_comment));
  REQUIRE(siemens_scl(table) != siemens_scl());
  CHECK(without(siemens_scl(table), scl_comment) == without(siemens_scl(), scl_comment));
  const std::string l5x_description = R"(<Description><!\[CDATA\[[^\]]*)";
  REQUIRE(rockwell_l5x(table) != rockwell_l5x());
  CHECK(without(rockwell_l5x(table), l5x_description) == without(rockwell_l5x(), l5x_description));
  REQUIRE(registers_csv(table) != registers_csv());
  CHECK(without(registers_csv(table), csv_description) == without(registers_csv(), csv_description));
  CHECK(node_red_flow(table) == node_red_flow());
  CHECK(finsightctl_table(table) == finsightctl_table());
}

TEST_CASE("plc files: the CSV file has one line per register, without gap or overlap in any block") {
  std::istringstream csv(registers_csv());
  std::string line;
  REQUIRE(std::getline(csv, line));
  CHECK(line == "address,reference,name,type,scale,unit,access,lowest,highest,factory,description,invalid,values\r");
  int next = 0;
  while (std::getline(csv, line)) {
    CAPTURE(line);
    if (next == kMeasurementRegisters) next = kControlAddress;
    if (next == kControlAddress + kControlRegisters) next = kProcessAddress;
    if (next == kProcessAddress + kProcessBlockRegisters) next = kHistoryAddress;
    if (next == kHistoryAddress + kHistoryRegisters) next = kGatheredAddress;
    if (next == kGatheredAddress + kGatheredRegisters) next = kDiagnosticsAddress;
    const bool is_wide = contains(line, ",uint32,") || contains(line, ",float32,");
    CHECK(line.starts_with(std::to_string(next) + "," + std::to_string(40001 + next) + ","));
    CHECK(line.ends_with("\r"));
    CHECK(std::count(line.begin(), line.end(), '"') == 2);
    CHECK(std::count(line.begin(), line.begin() + static_cast<std::ptrdiff_t>(line.find('"')), ',') == 10);
    CHECK(std::count(line.begin() + static_cast<std::ptrdiff_t>(line.rfind('"')), line.end(), ',') == 2);
    CHECK(std::all_of(line.begin(), line.end(), [](char c) { return c == '\r' || (c >= ' ' && c <= '~'); }));
    next += contains(line, ",text32,") ? 16 : is_wide ? 2 : 1;
  }
  CHECK(next == kDiagnosticsAddress + kDiagnosticsRegisters);
  CHECK(contains(registers_csv(), "5,40006,touch_x,int16,0.01,mm,read,,,,\""));
  CHECK(contains(registers_csv(), "1016,41017,hold_time,uint16,1,ms,read/write,0,10000,200,\""));
  CHECK(contains(registers_csv(), "-32768: not valid\",-32768,\r\n"));
  CHECK(contains(registers_csv(), "\",,0=contact;1=gentle;2=overload\r\n"));
}

TEST_CASE("plc files: finsightctl and Node-RED know names, limits and invalid values") {
  const std::string ctl = finsightctl_table(), flow = node_red_flow();
  CHECK(contains(ctl, "14: \"master_lost\"}),"));
  CHECK(contains(ctl, "Row(5, \"touch_x\", \"int16\", 0.01, \"mm\", True, None, {}),"));
  CHECK(contains(ctl, "Row(1016, \"hold_time\", \"uint16\", 1, \"ms\", False, (0, 10000), {}),"));
  CHECK_FALSE(contains(ctl, "13: \"over_temperature\""));
  CHECK(contains(flow, "touch_x_mm: w[5] === 0x8000 ? null : signed(w[5]) / 100,"));
  CHECK(contains(flow, "overload: bit(0, 14),"));
  CHECK(contains(flow, "\"adr\": \"1004\""));
  CHECK_FALSE(contains(flow, "$"));
}

TEST_CASE("plc files: a PLC's code scales and checks every kind of value") {
  const std::string st = structured_text(), scl = siemens_scl();
  CHECK(contains(st, "  contact := alive AND ((words[0] AND WORD#16#4) <> WORD#16#0);"));
  CHECK(contains(st, "  any_fault := alive AND ((words[0] AND WORD#16#8000) <> WORD#16#0);"));
  CHECK(contains(st, "  limits_gentle := alive AND ((words[44] AND WORD#16#2) <> WORD#16#0);"));
  CHECK(contains(st, "  touch_x_valid := alive AND (words[5] <> WORD#16#8000);"));
  CHECK(contains(st, "touch_x_mm := INT_TO_REAL(WORD_TO_INT(words[5])) * 0.01;"));
  CHECK(contains(st, "  force_valid := alive AND (words[9] <> WORD#16#FFFF);"));
  CHECK(contains(st, "force_n := UINT_TO_REAL(WORD_TO_UINT(words[9])) * 0.01;"));
  CHECK(contains(st, "temperature_real_degc := FC_FinsightReal(pair_30);"));
  CHECK(contains(st, "frame_counter := DWORD_TO_UDINT(pair_32);"));
  CHECK(contains(scl, "#values.touch_x_mm := INT_TO_REAL(WORD_TO_INT(#words[5])) * 0.01;"));
  CHECK(contains(scl, "#pair_20 := SHL(IN := WORD_TO_DWORD(#words[20]), N := 16) OR WORD_TO_DWORD(#words[21]);"));
}

TEST_CASE("plc files: what is declared is assigned, once") {
  const std::string st = structured_text();
  const std::size_t begin = st.find("VAR_OUTPUT", st.find("FB_Finsight\n")), end = st.find("END_VAR", begin);
  std::istringstream lines(st.substr(begin, end - begin));
  std::string line;
  std::getline(lines, line);
  int outputs = 0;
  for (std::vector<std::string> seen; std::getline(lines, line); ++outputs) {
    const std::string name = line.substr(2, line.find(" :") - 2);
    CAPTURE(name);
    CHECK(std::ranges::find(seen, name) == seen.end());
    CHECK(contains(st.substr(end), " " + name + " := "));
    seen.push_back(name);
  }
  CHECK(outputs > 60);
}

TEST_CASE("plc files: in the README's tables a long list of codes stands once, and the others refer to it") {
  const std::string all =
      measurements_markdown() + control_markdown() + process_markdown() + history_markdown() + diagnostics_markdown();
  for (const char* once : {"12 image out of focus", "9 tare deformation", "4 running"}) {
    CAPTURE(once);
    const std::size_t at = all.find(once);
    CHECK(at != std::string::npos);
    CHECK(all.find(once, at + 1) == std::string::npos);
  }
  CHECK(contains(diagnostics_markdown(), "codes as in register 1 |"));
  CHECK(contains(history_markdown(), "codes as in register 1203 |"));
}
