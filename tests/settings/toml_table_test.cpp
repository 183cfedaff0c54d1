#include "firmware/settings/toml_table.h"

#include <doctest/doctest.h>

#include <cstring>
#include <functional>

#include "firmware/input_error.h"
#include "tests/model/scratch_folder.h"

using namespace finsight;

namespace {

/// The error message of reading this text; "accepted" without one.
doctest::String refusal(const std::string& text, const std::function<void(TomlTable&)>& read) {
  try {
    TomlTable table = TomlTable::parse_text(text, "board.toml");
    read(table);
    table.finish();
  } catch (const InputError& error) {
    return error.what();
  }
  return "accepted";
}

}  // namespace

TEST_CASE("toml table: reads every kind of value") {
  TomlTable table = TomlTable::parse_text(
      "rate = 60.5\nwhole = 7\nport = 1502\non = true\nname = 'left'\nlist = [1, 2.5]\nempty = []\n"
      "[camera]\nkind = 'replay'\n[[output]]\npin = 1\n[[output]]\npin = 2\n",
      "t");
  CHECK(table.number("rate", 0, 100) == 60.5);
  CHECK(table.number("whole", 0, 100) == 7);  // a whole number is a number
  CHECK(table.integer("port", 1, 65535) == 1502);
  CHECK(table.flag("on"));
  CHECK(table.text("name") == "left");
  CHECK(table.numbers("list", 2, 0, 3) == std::vector<double>{1, 2.5});
  CHECK(table.numbers("empty", 0, 0, 3).empty());
  TomlTable camera = table.table("camera");
  CHECK(camera.choice("kind", {"real", "replay"}) == "replay");
  camera.finish();
  std::vector<TomlTable> outputs = table.tables("output");
  REQUIRE(outputs.size() == 2);
  for (std::size_t i = 0; i < 2; ++i) {
    CHECK(outputs[i].integer("pin", 0, 40) == static_cast<int>(i) + 1);
    outputs[i].finish();
  }
  CHECK_NOTHROW(table.finish());
}

TEST_CASE("toml table: a default replaces a missing key, and not a wrong value") {
  TomlTable table = TomlTable::parse_text("n = 'x'\n", "t");
  CHECK_FALSE(table.has("rate"));
  CHECK(table.has("n"));
  CHECK(table.number("rate", 0, 1, 0.5) == 0.5);
  CHECK(table.integer("count", 0, 9, 3) == 3);
  CHECK(table.flag("on", true));
  CHECK(table.text("name", "none") == "none");
  CHECK(table.choice("kind", {"a", "b"}, "b") == "b");
  CHECK_THROWS_AS(table.number("n", 0, 1, 0.5), InputError);
}

TEST_CASE("toml table: refuses missing keys, wrong types and numbers out of range, with line, found and expected") {
  struct Hostile {
    std::string text;
    std::function<void(TomlTable&)> read;
    const char* message;
  };
  const auto number = [](TomlTable& t) { t.number("k", 0, 2.5); };
  const auto integer = [](TomlTable& t) { t.integer("k", -1, 65535); };
  const auto numbers = [](TomlTable& t) { t.numbers("k", 2, 0, 1); };
  const auto sub_table = [](TomlTable& t) { t.table("k"); };
  const auto sub_tables = [](TomlTable& t) { t.tables("k"); };
  const Hostile all[] = {
      {"", number, "board.toml:1: k: found nothing, expected a number from 0 to 2.5"},
      {"\nk = 'one'", number, "board.toml:2: k: found 'one', expected a number from 0 to 2.5"},
      {"k = 2.6", number, "board.toml:1: k: found 2.6, expected a number from 0 to 2.5"},
      {"k = -0.1", number, "found -0.1"},
      {"k = nan", number, "found nan"},
      {"k = inf", number, "found inf"},
      {"k = true", number, "found true"},
      {"k = 1979-05-27", number, "found 1979-05-27"},
      {"k = {a = 1}", number, "found a table"},
      {"k = 7.0", integer, "found 7.0, expected a whole number from -1 to 65535"},
      {"k = 65536", integer, "found 65536"},
      {"k = -2", integer, "found -2"},
      {"k = 9223372036854775807", integer, "found 9223372036854775807"},
      {"k = 1", [](TomlTable& t) { t.flag("k"); }, "found 1, expected true or false"},
      {"k = 1", [](TomlTable& t) { t.text("k"); }, "found 1, expected a text"},
      {"k = 'c'",
       [](TomlTable& t) {
         t.choice("k", {"a", "b"});
       },
       "found \"c\", expected one of \"a\" \"b\""},
      {"k = [1]", numbers, "expected 2 numbers, each from 0 to 1"},
      {"k = [1, 1, 1]", numbers, "expected 2 numbers"},
      {"k = [1, 2]", numbers, "expected 2 numbers"},
      {"k = [1, 'a']", numbers, "expected 2 numbers"},
      {"k = [1, nan]", numbers, "expected 2 numbers"},
      {"k = 1", numbers, "found 1, expected 2 numbers"},
      {"k = ''", [](TomlTable& t) { t.path("k"); }, "found \"\", expected a path"},
      {"k = 1", sub_table, "found 1, expected a table"},
      {"[[k]]", sub_table, "expected a table"},
      {"[k]", sub_tables, "expected an array of tables"},
      {"k = []", sub_tables, "expected an array of tables"},
      {"k = [1, {a = 1}]", sub_tables, "expected an array of tables"},
  };
  for (const Hostile& hostile : all) {
    CAPTURE(hostile.text);
    CHECK(refusal(hostile.text, hostile.read) == doctest::Contains(hostile.message));
  }
}

TEST_CASE("toml table: refuses keys that nobody asked for, in every table") {
  const auto read = [](TomlTable& t) {
    t.integer("known", 0, 9);
    TomlTable camera = t.table("camera");
    camera.text("kind");
    camera.finish();
    for (TomlTable& output : t.tables("output")) {
      output.integer("pin", 0, 9);
      output.finish();
    }
  };
  const std::string good = "known = 1\ncamera.kind = 'x'\n[[output]]\npin = 1\n";
  REQUIRE(refusal(good, read) == "accepted");
  CHECK(refusal("knwon = 1\n" + good, read) ==
        doctest::Contains("board.toml:1: knwon: found an unknown key, expected known keys only"));
  CHECK(refusal("camera.size = 1\n" + good, read) ==
        doctest::Contains("board.toml:1: camera.size: found an unknown key"));
  CHECK(refusal(good + "pni = 1\n", read) == doctest::Contains("board.toml:5: output.pni: found an unknown key"));
  CHECK(refusal(good + "[extra]\n", read) == doctest::Contains("board.toml:5: extra: found an unknown key"));
}

TEST_CASE("toml table: refuses text that is not TOML, with a message of one line that names the place") {
  for (const std::string text : {"a =", "a = 1\na = 2", "[t]\n[t]", "a = 'x", "= 1", "a = 1 b = 2", "\xff\xfe",
                                 "a = \"\\q\"", "a = 1e", "a = [1, 2", "a = 99999999999999999999", "[[a]]\n[a]"}) {
    CAPTURE(text);
    const doctest::String message = refusal(text, [](TomlTable&) {});
    CHECK(message == doctest::Contains("board.toml:"));
    CHECK(std::strchr(message.c_str(), '\n') == nullptr);
  }
  CHECK(refusal("ok = 1\nb = = 2\n", [](TomlTable&) {}) == doctest::Contains("board.toml:2: "));
  CHECK(refusal(std::string(100'000, '['), [](TomlTable&) {}) == doctest::Contains("board.toml:1: "));
  CHECK(refusal("a = " + std::string(100'000, '['), [](TomlTable&) {}) == doctest::Contains("board.toml:1: "));
}

TEST_CASE("toml table: shows a value that is long or has many lines on one short line") {
  const auto read = [](TomlTable& t) { t.number("k", 0, 1); };
  for (const std::string& text :
       {std::string("k = '''\nfirst\nsecond'''"), "k = '" + std::string(5000, 'x') + "'",
        std::string("k = [1,\n2,\n3]"), "k = [" + std::string(5000, '[') + std::string(5000, ']') + "]",
        std::string("k = [{a = 1}, {b = 2}]")}) {
    CAPTURE(text.substr(0, 40));
    const doctest::String message = refusal(text, read);
    CHECK(message != "accepted");
    CHECK(std::strchr(message.c_str(), '\n') == nullptr);
    CHECK(message.size() < 400);
  }
}

TEST_CASE("toml table: takes relative paths from the folder of the file") {
  const test::ScratchFolder folder;
  const auto file = folder.write("board.toml", "near = 'model/pack'\nfar = '/srv/pack'\n");
  TomlTable table = TomlTable::parse_file(file);
  CHECK(table.path("near") == folder.path() / "model/pack");
  CHECK(table.path("far") == "/srv/pack");
  CHECK(table.where("far") == file.string() + ":2");
}

TEST_CASE("toml table: refuses what is not a file") {
  const test::ScratchFolder folder;
  CHECK_THROWS_WITH_AS(TomlTable::parse_file(folder / "missing.toml"), doctest::Contains("missing.toml: no such file"),
                       InputError);
  CHECK_THROWS_AS(TomlTable::parse_file(folder.path()), InputError);
  CHECK_THROWS_AS(TomlTable::parse_file("/dev/zero"), InputError);
  CHECK_NOTHROW(TomlTable::parse_file(folder.write("empty.toml", "")).finish());
  CHECK_NOTHROW(TomlTable::parse_file(folder.write("large.toml", std::string(1 << 20, '\n'))).finish());
  CHECK_THROWS_WITH_AS(TomlTable::parse_file(folder.write("huge.toml", std::string((1 << 20) + 1, '\n'))),
                       doctest::Contains("huge.toml: is larger than 1 MiB"), InputError);
}

TEST_CASE("toml table: a key of very many parts is refused; many numbers with a point are not") {
  std::string deep = "ok = 1\n";
  for (int part = 0; part < 40000; ++part) deep += "a.";
  CHECK_THROWS_WITH_AS(TomlTable::parse_text(deep + "a = 1\n", "deep.toml"), "deep.toml:2: a key of more than 64 parts",
                       InputError);
  std::string many = "x = [";
  for (int k = 0; k < 200; ++k) many += "0.5, ";
  CHECK_NOTHROW(TomlTable::parse_text(many + "1.5]\n", "many.toml"));
}
