#include <doctest/doctest.h>

#include <algorithm>
#include <string>

#include "firmware/settings/settings.h"
#include "tests/model/scratch_folder.h"

using namespace finsight;

namespace {

const std::string kTop = R"(hold_time_ms = 150
[modbus]
port = 1502
[shape]
tier = "map"
[storage]
settings = "/data/settings.toml"
recordings = "/data/recordings"
[page]
folder = "/run/page"
)";

std::string camera(const std::string& name, const std::string& more = "") {
  return "[[finger]]\nname = \"" + name + "\"\npack = \"" + name + ".safetensors\"\n" + more +
         "[finger.source]\nkind = \"camera\"\ncamera = \"usb-" + name +
         "\"\nwidth_px = 640\nheight_px = 480\nframes_per_second = 60\n"
         "[finger.source.lens]\nfx_fy_cx_cy = [457, 457, 319.5, 239.5]\nk1_k2_p1_p2_k3 = [0, 0, 0, 0, 0]\n";
}

std::vector<Settings> read(const std::string& text) {
  const test::ScratchFolder folder;
  return read_fingers(folder.write("board.toml", text));
}

std::string refusal(const std::string& text) {
  try {
    read(text);
  } catch (const InputError& error) {
    return error.what();
  }
  return "";
}

#define CHECK_REFUSED(text, reason) CHECK_MESSAGE(refusal(text).find(reason) != std::string::npos, refusal(text))

std::string replaced(std::string text, const std::string& what, const std::string& by) {
  const std::size_t at = text.find(what);
  REQUIRE(at != std::string::npos);
  return text.replace(at, what.size(), by);
}

}  // namespace

TEST_CASE("fingers: each table says its own, and what it leaves out is that of the file's top") {
  const auto fingers =
      read(kTop + camera("left") + camera("right", "hold_time_ms = 90\nshape = { tier = \"newton\" }\n"));
  REQUIRE(fingers.size() == 2);
  CHECK(fingers[0].name == "left");
  CHECK(fingers[0].pack.filename() == "left.safetensors");
  CHECK(fingers[1].pack.filename() == "right.safetensors");
  CHECK(fingers[0].camera.name == "usb-left");
  CHECK(fingers[1].camera.name == "usb-right");
  CHECK(fingers[0].loop.runtime[kHoldTime] == 150);
  CHECK(fingers[1].loop.runtime[kHoldTime] == 90);
  CHECK(fingers[0].loop.shape.tier == ShapeSettings::Tier::kMap);
  CHECK(fingers[1].loop.shape.tier == ShapeSettings::Tier::kNewton);
  CHECK(fingers[0].modbus.port == 1502);
}

TEST_CASE("fingers: what they store goes under their names") {
  const auto fingers = read(kTop + camera("left") + camera("right"));
  CHECK(fingers[0].saved_state == "/data/settings-left.toml");
  CHECK(fingers[1].saved_state == "/data/settings-right.toml");
  CHECK(fingers[1].recordings == "/data/recordings/right");
  CHECK(fingers[1].page.value().folder == "/run/page/right");
}

TEST_CASE("fingers: a file without such a table is that of one finger, as before") {
  const auto one = read("pack = \"p\"\n" + kTop + "[source]\nkind = \"session\"\npath = \"s\"\n");
  REQUIRE(one.size() == 1);
  CHECK(one[0].name.empty());
  CHECK(one[0].saved_state == "/data/settings.toml");
  CHECK(one[0].recordings == "/data/recordings");
}

TEST_CASE("fingers: two that name one camera are refused, as is one that would take any") {
  const std::string two = kTop + camera("left") + camera("right");
  CHECK_REFUSED(replaced(two, "usb-right", "usb-left"), "usb-left\" of finger \"left\", expected names of two cameras");
  CHECK_REFUSED(replaced(two, "usb-right", ""), "expected names of two cameras");
  CHECK_REFUSED(replaced(two, "usb-right", "usb-left-2"), "neither of which is a part of the other");
}

TEST_CASE("fingers: no page takes the port of Modbus") {
  const std::string two = kTop + camera("left") + camera("right");
  CHECK_REFUSED(replaced(two, "[page]\n", "[page]\nport = 1501\n"),
                "page.port: found 1501, expected a port that leaves 1502");
  CHECK(read(replaced(two, "[page]\n", "[page]\nport = 1503\n")).size() == 2);
}

TEST_CASE("fingers: names must be plain and differ; there are at most four") {
  const std::string left = camera("left");
  CHECK_REFUSED(kTop + left + replaced(camera("right"), "name = \"right\"", "name = \"left\""),
                "\"left\" a second time");
  CHECK_REFUSED(kTop + replaced(left, "name = \"left\"", "name = \"../left\""), "finger.name");
  CHECK_REFUSED(kTop + replaced(left, "name = \"left\"\n", ""), "finger.name: found nothing");
  CHECK_REFUSED(kTop + left + camera("b") + camera("c") + camera("d") + camera("e"),
                "found 5 tables, expected at most 4");
  CHECK(read(kTop + left + camera("b") + camera("c") + camera("d")).size() == 4);
}

TEST_CASE("fingers: what is the board's is refused in a finger, and so is an unknown key") {
  CHECK_REFUSED(kTop + camera("left", "modbus = { port = 7 }\n"), "finger.modbus: found in a finger");
  CHECK_REFUSED(kTop + camera("left", "storage = { settings = \"x\" }\n"), "finger.storage");
  CHECK_REFUSED(kTop + camera("left", "colour = 7\n"), "colour: found an unknown key");
}

TEST_CASE("fingers: no two have the same digital line or processor") {
  const auto gpio = [](const char* line) {
    return std::string("gpio = { chip = \"c\", healthy = { ") + line + " } }\n";
  };
  CHECK_REFUSED(kTop + camera("left", gpio("number = 4")) + camera("right", gpio("number = 4")),
                "line 4, which finger \"left\" has");
  CHECK(read(kTop + camera("left", gpio("number = 4")) + camera("right", gpio("number = 5"))).size() == 2);
  const std::string cpu = "realtime = { cpu = 1 }\n";
  CHECK_REFUSED(kTop + camera("left", cpu) + camera("right", cpu),
                "finger.realtime.cpu: found 1, which finger \"left\"");
}

TEST_CASE("fingers: a digital line is only one output's of a finger, or its trigger") {
  const auto gpio = [](const char* first, const char* second) {
    return std::string("gpio = { chip = \"c\", healthy = { ") + first + " }, " + second + " }\n";
  };
  const std::string twice = gpio("number = 4", "light = { number = 4 }");
  CHECK_REFUSED(kTop + camera("left") + camera("right", twice), "gpio: found line 4 a second time");
  CHECK_REFUSED(kTop + camera("left", gpio("name = \"a\"", "trigger = { name = \"a\" }")), "found line \"a\" a second");
  CHECK_REFUSED("pack = \"p\"\n" + twice + kTop + "[source]\nkind = \"session\"\npath = \"s\"\n",
                "board.toml:2: gpio: found line 4 a second time");
  CHECK(read(kTop + camera("left", gpio("number = 4", "light = { number = 5 }"))).size() == 1);
}

TEST_CASE("fingers: an error is where the finger stands, or the key that is wrong") {
  const std::string left = kTop + camera("left"),
                    no_pack = replaced(camera("right"), "pack = \"right.safetensors\"\n", "");
  const auto line = [](const std::string& text) { return std::to_string(1 + std::ranges::count(text, '\n')); };
  CHECK_REFUSED(left + no_pack, "board.toml:" + line(left) + ": pack: found nothing");
  CHECK_REFUSED(left + "[[finger]]\nname = \"right\"\npack = \"p\"\n",
                "board.toml:" + line(left) + ": source: found nothing");
  const std::string no_modbus = replaced(left, "[modbus]\nport = 1502\n", "");
  CHECK_REFUSED(no_modbus, "board.toml:1: modbus: found nothing");
  const test::ScratchFolder folder;
  const auto board = folder.write("board.toml", left);
  const auto user = folder.write("finsight.toml", camera("left") + no_pack);
  CHECK_THROWS_WITH_AS(read_fingers({board, user}),
                       doctest::Contains(("finsight.toml:" + line(camera("left")) + ": pack").c_str()), InputError);
  const std::string page = replaced(left, "[page]\n", "[page]\nport = 65535\n") + camera("right");
  CHECK_REFUSED(page, "board.toml:10: page.port: found 65535");
}

TEST_CASE("fingers: gravity from elsewhere than at the file's top replaces that entirely") {
  const std::string fixed = "[gravity]\nfrom = \"fixed\"\ndirection_g = [0, -1, 0]\n";
  const auto fingers = read(kTop + fixed + camera("left") + camera("right", "gravity = { from = \"registers\" }\n"));
  CHECK(fingers[0].fixed_g == Vec3f(0, -1, 0));
  CHECK_FALSE(fingers[1].fixed_g);
  CHECK(fingers[1].gravity_max_age_ms == 500);
}

TEST_CASE("fingers: a file beside the board file that cannot be used costs only the finger that needs it") {
  const test::ScratchFolder folder;
  folder.write("bad.toml", "model = 7\n[camera]\nturn_deg = 7\n");
  const auto refusal_of_right = [&](const std::string& text) -> std::string {
    const auto fingers = read_fingers(folder.write("board.toml", text));
    REQUIRE(fingers.size() == 2);
    CHECK_FALSE(fingers[0].unusable);
    return fingers[1].unusable.value().what();
  };
  const auto says = [](const std::string& text, const char* part) { return text.find(part) != std::string::npos; };
  const std::string left = kTop + camera("left");
  CHECK(says(refusal_of_right(left + camera("right", "mount = \"none.toml\"\n")), "none.toml: no such file"));
  CHECK(says(refusal_of_right(left + camera("right", "fit = \"none.toml\"\n")), "none.toml: no such file"));
  CHECK(
      says(refusal_of_right(left + camera("right", "mount = \"bad.toml\"\n")), "bad.toml:3: camera.turn_deg: found 7"));
  CHECK(says(refusal_of_right(left + camera("right", "fit = \"bad.toml\"\n")), "bad.toml:1: model: found 7"));
  std::string lens = camera("right");
  lens = lens.substr(0, lens.find("[finger.source.lens]")) + "lens = \"none.toml\"\n";
  CHECK(says(refusal_of_right(left + lens), "none.toml: no such file"));

  const std::string measured = replaced(left, "[page]\n", "[page]\nmeasured = \"measured\"\n") + camera("right");
  std::filesystem::create_directories(folder / "measured/right");
  for (const char* name : {kMeasuredLens, kMeasuredMount, kMeasuredFit}) {
    const auto file = folder.write(std::string("measured/right/") + name, "broken\n");
    CHECK(says(refusal_of_right(measured), (file.string() + ":").c_str()));
    std::filesystem::remove(file);
  }
}

TEST_CASE("fingers: a wrong table in the board file itself, and an only finger's file, stop everything") {
  const std::string left = kTop + camera("left");
  CHECK_REFUSED(left + camera("right", "mount = 7\n"), "mount: found 7");
  CHECK_REFUSED(left + camera("right", "mount = \"\"\n"), "mount: found \"\", expected a path");
  CHECK_REFUSED(left + camera("right", "mount = { camera = 7 }\n"), "mount.camera: found 7");
  CHECK_REFUSED("pack = \"p\"\nmount = \"none.toml\"\n" + kTop + "[source]\nkind = \"session\"\npath = \"s\"\n",
                "none.toml: no such file");
}

TEST_CASE("fingers: they have the same unit ids on TCP and on the serial line") {
  const auto with = [](const std::string& unit, const std::string& serial) {
    return replaced(kTop, "port = 1502\n",
                    "port = 1502\n" + unit + "[modbus.serial]\ndevice = \"/dev/ttyS1\"\n" + serial) +
           camera("left") + camera("right");
  };
  CHECK(read(with("", ""))[0].modbus.serial.value().unit == 1);
  CHECK(read(with("unit = 7\n", ""))[0].modbus.serial.value().unit == 7);
  CHECK(read(with("unit = 7\n", "unit = 7\n"))[1].modbus.serial.value().unit == 7);
  CHECK_REFUSED(with("", "unit = 2\n"), "board.toml:6: modbus.serial.unit: found 2, expected 1, as with TCP");
  CHECK_REFUSED(with("unit = 247\n", ""), "board.toml:4: modbus.unit: found units 247 to 248 for the fingers");
}

TEST_CASE("fingers: of a file that cannot be used, each finger's outputs still can") {
  const test::ScratchFolder folder;
  const auto gpio = [](int line) {
    return "gpio = { chip = \"c\", healthy = { number = " + std::to_string(line) + " } }\n";
  };
  const auto file =
      folder.write("board.toml", kTop + camera("left", gpio(4) + "colour = 7\n") + camera("right", gpio(5)));
  CHECK_THROWS_AS(read_fingers(file), InputError);
  const auto fingers = read_usable_fingers(file);
  REQUIRE(fingers.size() == 2);
  CHECK(fingers[0].gpio.value().lines[kHealthyOutput].value().number == 4);
  CHECK(fingers[1].gpio.value().lines[kHealthyOutput].value().number == 5);
  CHECK(fingers[1].modbus.port == 1502);
}
