#include "firmware/page/register_text.h"

#include <doctest/doctest.h>

#include <bit>
#include <set>

using namespace finsight;
using namespace finsight::page;
using nlohmann::json;

namespace {

json value_of(const RegisterRow& row, std::vector<std::uint16_t> words, bool low_word_first = false) {
  return register_value(row, words, low_word_first);
}

}  // namespace

TEST_CASE("register text: numbers are in their unit, and null where they are not valid") {
  CHECK(value_of(row_named("touch_x"), {0xFF9C}) == -1.0);
  CHECK(value_of(row_named("touch_x"), {0x8000}).is_null());
  CHECK(value_of(row_named("force"), {29}).dump() == "0.29");
  CHECK(value_of(row_named("force"), {0xFFFF}).is_null());
  CHECK(value_of(row_named("heartbeat"), {0xFFFF}) == 65535);
  const auto bits = std::bit_cast<std::uint32_t>(2.5F);
  const std::uint16_t high = bits >> 16, low = bits & 0xFFFF;
  CHECK(value_of(row_named("force_float"), {high, low}) == 2.5);
  CHECK(value_of(row_named("force_float"), {low, high}, true) == 2.5);
  CHECK(value_of(row_named("force_float"), {0x7FC0, 0}).is_null());
  CHECK(value_of(row_named("test_constant_long"), {0x1234, 0x5678}) == 305419896);
}

TEST_CASE("register text: bits, codes, clients and texts are in words") {
  CHECK(value_of(row_named("status"), {0x0101}) == json::array({"ready", "zeroed"}));
  CHECK(value_of(row_named("fault"), {12}) == "image_out_of_focus");
  CHECK(value_of(row_named("fault"), {999}) == 999);
  CHECK(value_of(row_named("exclusive_client"), {0xC0A8, 0x0007}) == "192.168.0.7");
  CHECK(value_of(row_named("exclusive_client"), {0, 1}) == "serial line");
  std::vector<std::uint16_t> text(16);
  text[0] = 'F' << 8 | 'S';
  text[1] = 0x0107;  // neither may reach a browser
  CHECK(value_of(row_named("serial_number"), text) == "FS");
}

TEST_CASE("register text: the table has every register once, with the limits of what may be written") {
  const json table = register_table_json();
  std::set<int> addresses;
  for (const json& row : table) addresses.insert(row["address"].get<int>());
  std::size_t rows = 0;
  for (const auto block : kRegisterTable.blocks()) rows += block.size();
  CHECK(table.size() == rows);
  CHECK(addresses.size() == rows);
  const auto hold = std::ranges::find_if(table, [](const json& row) { return row["name"] == "hold_time"; });
  REQUIRE(hold != table.end());
  CHECK((*hold)["highest"] == 10000);
  CHECK((*hold)["factory"] == 200);
  CHECK((*hold)["block"] == "control");
}

TEST_CASE("register text: metrics have what is valid, with unit, help and type") {
  json values;
  std::vector<std::uint16_t> words(kMeasurementRegisters);
  words[0] = 1;
  words[9] = 123;
  words[5] = 0x8000;
  add_values(kRegisterTable.measurements, words, false, values);
  const std::string text = metrics_text(values);
  CHECK(text.find("# HELP finsight_force_N contact force\n# TYPE finsight_force_N gauge\nfinsight_force_N 1.23\n") !=
        std::string::npos);
  CHECK(text.find("touch_x_mm") == std::string::npos);
  CHECK(text.find("finsight_status{bit=\"ready\"} 1\n") != std::string::npos);
  CHECK(text.find("finsight_status{bit=\"zeroed\"} 0\n") != std::string::npos);
  CHECK(text.find("reserved") == std::string::npos);
}
