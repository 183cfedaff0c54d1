#include "hostgen/plc/plc_files.h"

#include <doctest/doctest.h>

#include <algorithm>
#include <fstream>
#include <iterator>
#include <sstream>
#include <vector>

#include "firmware/modbus/register_table.h"

using namespace finsight;
using namespace finsight::host;

namespace {

std::string stored(const std::string& name) {
  std::ifstream in(FINSIGHT_SOURCE_DIR "/hostgen/plc/" + name, std::ios::binary);
  return {std::istreambuf_iterator<char>(in), {}};
}

bool says(const std::string& text, const std::string& part) { return text.find(part) != std::string::npos; }

}  // namespace

TEST_CASE("plc files: those of the repository are the code's (build/host/hostgen plc writes them)") {
  CHECK(stored("registers.csv") == registers_csv());
  CHECK(stored("Finsight.st") == structured_text());
  CHECK(stored("Finsight.scl") == siemens_scl());
}

TEST_CASE("plc files: the CSV file has one line per register, without gap or overlap in either block") {
  std::istringstream csv(registers_csv());
  std::string line;
  REQUIRE(std::getline(csv, line));
  CHECK(line == "address,name,type,scale,unit,access,lowest,highest,factory,description\r");
  int next = 0;
  while (std::getline(csv, line)) {
    CAPTURE(line);
    if (next == kMeasurementRegisters) next = kControlAddress;
    const bool is_wide = says(line, ",uint32,") || says(line, ",float32,");
    CHECK(line.substr(0, line.find(',')) == std::to_string(next));
    CHECK(line.ends_with("\"\r"));
    CHECK(std::count(line.begin(), line.end(), '"') == 2);
    CHECK(std::count(line.begin(), line.begin() + static_cast<std::ptrdiff_t>(line.find('"')), ',') == 9);
    CHECK(std::all_of(line.begin(), line.end(), [](char c) { return c == '\r' || (c >= ' ' && c <= '~'); }));
    next += is_wide ? 2 : 1;
  }
  CHECK(next == kControlAddress + kControlRegisters);
  CHECK(says(registers_csv(), "5,touch_x,int16,0.01,mm,read,,,,\""));
  CHECK(says(registers_csv(), "1016,hold_time,uint16,1,ms,read/write,0,10000,200,\""));
}

TEST_CASE("plc files: a PLC's code scales and checks every kind of value") {
  const std::string st = structured_text(), scl = siemens_scl();
  CHECK(says(st, "  contact := (words[0] AND WORD#16#4) <> WORD#16#0;"));
  CHECK(says(st, "  any_fault := (words[0] AND WORD#16#8000) <> WORD#16#0;"));
  CHECK(says(st, "  limits_gentle := (words[44] AND WORD#16#2) <> WORD#16#0;"));
  CHECK(says(st, "  touch_x_valid := words[5] <> WORD#16#8000;"));
  CHECK(says(st, "touch_x_mm := INT_TO_REAL(WORD_TO_INT(words[5])) * 0.01;"));
  CHECK(says(st, "  force_valid := words[9] <> WORD#16#FFFF;"));
  CHECK(says(st, "force_n := UINT_TO_REAL(WORD_TO_UINT(words[9])) * 0.01;"));
  CHECK(says(st, "temperature_real_degc := FC_FinsightReal(pair_30);"));
  CHECK(says(st, "frame_counter := DWORD_TO_UDINT(pair_32);"));
  CHECK(says(scl, "#values.touch_x_mm := INT_TO_REAL(WORD_TO_INT(#words[5])) * 0.01;"));
  CHECK(says(scl, "#pair_20 := SHL(IN := WORD_TO_DWORD(#words[20]), N := 16) OR WORD_TO_DWORD(#words[21]);"));
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
    CHECK(says(st.substr(end), " " + name + " := "));
    seen.push_back(name);
  }
  CHECK(outputs > 60);
}
