#include "firmware/page/settings_change.h"

#include <doctest/doctest.h>

#include "firmware/page/json_body.h"

using namespace finsight;
using namespace finsight::page;
using nlohmann::json;

namespace {

std::string refusal(const json& wanted) {
  SettingsWords words;
  const auto refused = apply_settings(wanted, words);
  return refused ? refused->reason : "";
}

std::uint16_t control_word(const SettingsWords& words, int address) {
  return words.control[static_cast<std::size_t>(address - kFirstSettingRegister)];
}

}  // namespace

TEST_CASE("settings change: values in units and names of codes become words; the others stay") {
  std::array<std::uint16_t, kControlRegisters> control{};
  std::array<std::uint16_t, kProcessBlockRegisters> process{};
  control.fill(7);
  process.fill(8);
  SettingsWords words(control, process);
  CHECK_FALSE(apply_settings({{"contact_on", 0.29}, {"after_hold", "keep"}}, words));
  CHECK(control_word(words, address_of("contact_on")) == 29);
  CHECK(control_word(words, address_of("after_hold")) == 1);
  CHECK(control_word(words, address_of("hold_time")) == 7);
  CHECK(words.changes_control);
  CHECK_FALSE(words.changes_process);
  CHECK_FALSE(apply_settings({{"lowpass", 12.5}}, words));
  CHECK(words.process[0] == 125);
  CHECK(words.process[1] == 8);
  CHECK(words.changes_process);
}

TEST_CASE("settings change: what is no setting or out of its range is refused by name, with the range") {
  CHECK(refusal({{"hold_time", 20000}}) == "hold_time: found 20000, expected 0 to 10000 ms in whole numbers.");
  CHECK(refusal({{"after_hold", "maybe"}}) == "after_hold: found \"maybe\", expected one of invalidate, keep.");
  CHECK(refusal({{"contact_on", 0}}) == "contact_on: found 0, expected 0.01 to 100.0 N in steps of 0.01.");
  CHECK(refusal({{"hold_time", nullptr}}) == "hold_time: found null, expected 0 to 10000 ms in whole numbers.");
  CHECK(refusal({{"hold_time", 1e300}}) != "");
  CHECK(refusal({{"status", 1}}) == "There is no setting \"status\".");
  CHECK(refusal({{"write_key", 1}}) == "There is no setting \"write_key\".");
  for (const json& wanted : {json::object(), json::array(), json(), json("x"), json(1)}) {
    CHECK(refusal(wanted) == "Expected {\"setting\": value, ...}.");
  }
}

TEST_CASE("settings change: what lies between two steps of a setting is refused, not rounded") {
  CHECK(refusal({{"hold_time", 0.4}}) == "hold_time: found 0.4, expected 0 to 10000 ms in whole numbers.");
  CHECK(refusal({{"word_order", 0.7}}) == "word_order: found 0.7, expected one of ABCD, CDAB.");
  CHECK(refusal({{"contact_on", 0.295}}) != "");
  CHECK(refusal({{"lowpass", 12.51}}) == "lowpass: found 12.51, expected 0.0 to 100.0 Hz in steps of 0.1.");
  for (int raw = 1; raw <= 10000; ++raw) CHECK(refusal({{"contact_on", raw / 100.0}}) == "");
  CHECK(refusal({{"contact_on", 0.1 + 0.2}}) == "");
}

TEST_CASE("settings change: a body that is no JSON, or nested too deeply, is no body") {
  CHECK(json_body("{\"a\": [1, 2]}")["a"][1] == 2);
  for (const std::string& body :
       {std::string(), std::string("{"), std::string(100'000, '['), std::string("\xFF"), std::string("{} {}")}) {
    CHECK(json_body(body).is_discarded());
  }
  std::string deep;
  for (int i = 0; i < 50; ++i) deep += "{\"a\":";
  CHECK(json_body(deep + "1" + std::string(50, '}')).is_discarded());
}
