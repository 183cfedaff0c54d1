#include "firmware/settings/settings.h"

#include <doctest/doctest.h>

#include <algorithm>

#include "firmware/input_error.h"
#include "tests/model/scratch_folder.h"

using namespace finsight;

namespace {

/// Every key, and none at its default.
const std::string kFull = R"(pack = "finger.safetensors"
hold_time_ms = 150
smoothing_ms = 40
lowpass_hz = 2.5
grip_change = 4.5
[source]
kind = "poses"
path = "/data/touches.csv"
recording = "161922"
speed = "full"
repeat = true
[shape]
tier = "map+newton"
factorisations = 2
chord_steps = 3
[modbus]
address = "0.0.0.0"
port = 15020
max_clients = 7
max_per_address = 1
reserve = []
idle_limit_s = 5
word_order = "CDAB"
unit = 9
allow = ["10.1.0.0/16", "10.2.0.3"]
allow_writes = ["10.2.0.3"]
write_key = 4711
[device]
serial_number = "FS-0042"
calibration_date = "2026-11-22"
[storage]
settings = "state.toml"
recordings = "/data/recordings"
record_max_s = 30
record_reserve_mb = 7
[modbus.serial]
device = "/dev/ttyS1"
baud = 9600
parity = "odd"
stop_bits = 2
unit = 42
rs485 = true
)";

const std::string kMin = R"(pack = "p"
[source]
kind = "session"
path = "s"
[modbus]
)";

Settings read(const std::string& text) {
  const test::ScratchFolder folder;
  return read_settings(folder.write("board.toml", text));
}

std::string replaced(std::string text, const std::string& line, const std::string& by) {
  const std::size_t at = text.find(line + "\n");
  REQUIRE(at != std::string::npos);
  return text.replace(at, line.size(), by);
}

/// Checks that the full settings with one line changed are refused with the file, that line's number and `reason`.
void check_refused(const std::string& line, const std::string& by, const std::string& reason) {
  CAPTURE(by);
  const auto end = kFull.begin() + static_cast<std::ptrdiff_t>(kFull.find(line + "\n"));
  const std::string place = "board.toml:" + std::to_string(std::count(kFull.begin(), end, '\n') + 1) + ": ";
  CHECK_THROWS_WITH_AS(read(replaced(kFull, line, by)), doctest::Contains((place + reason).c_str()), InputError);
}

constexpr const char* kBoard =
    "pack = \"model.safetensors\"\n[source]\nkind = \"session\"\npath = \"/recorded\"\nrepeat = true\n[modbus]\nport = "
    "502\n";

/// The message about a valid board file with this user's file.
std::string user_refusal(const std::string& user) {
  const test::ScratchFolder folder;
  const auto board = folder.write("board.toml", kBoard);
  try {
    read_settings({board, folder.write("user.toml", user)});
  } catch (const InputError& error) {
    return error.what();
  }
  return "";
}

}  // namespace

TEST_CASE("settings: every key arrives") {
  const test::ScratchFolder folder;
  const Settings settings = read_settings(folder.write("board.toml", kFull));
  CHECK(settings.pack == folder / "finger.safetensors");  // relative to the file
  CHECK(settings.loop.runtime[kHoldTime] == 150);
  CHECK(settings.loop.smoothing_ms == 40);
  CHECK(settings.loop.runtime[kLowpass] == 25);
  CHECK(settings.loop.runtime[kGripChange] == 45);
  CHECK(settings.record_max_s == 30);
  CHECK(settings.record_reserve_mb == 7);
  CHECK(settings.source == Settings::Source::kPoses);
  CHECK(settings.replay.path == "/data/touches.csv");
  CHECK(settings.replay.recording == "161922");
  CHECK_FALSE(settings.replay.recorded_speed);
  CHECK(settings.replay.repeat);
  CHECK(settings.loop.shape.tier == ShapeSettings::Tier::kMapAndNewton);
  CHECK(settings.loop.shape.factorisations == 2);
  CHECK(settings.loop.shape.chord_steps == 3);
  CHECK(settings.modbus.address == "0.0.0.0");
  CHECK(settings.modbus.port == 15020);
  CHECK(settings.modbus.max_clients == 7);
  CHECK(settings.modbus.max_per_address == 1);
  CHECK(settings.modbus.reserve.empty());
  CHECK(read(replaced(kFull, "reserve = []", "reserve = [\"10.1.0.9\", \"10.2.0.3\", \"10.1.0.9\"]")).modbus.reserve ==
        std::vector<std::uint32_t>{0x0A010009, 0x0A020003});
  CHECK(settings.serial_number == "FS-0042");
  CHECK(settings.calibration_date == 20261122);
  CHECK(settings.modbus.idle_limit_s == 5);
  REQUIRE(settings.modbus.serial);
  CHECK(settings.modbus.serial->device == "/dev/ttyS1");
  CHECK(settings.modbus.serial->baud == 9600);
  CHECK(settings.modbus.serial->parity == 'O');
  CHECK(settings.modbus.serial->stop_bits == 2);
  CHECK(settings.modbus.serial->unit == 42);
  CHECK(settings.modbus.serial->rs485);
  CHECK(settings.loop.runtime[kWordOrder] == 1);
  CHECK(settings.modbus.unit == 9);
  REQUIRE(settings.modbus.allow.size() == 2);
  CHECK(settings.modbus.allow[0].contains(0x0A01FFFF));
  CHECK(settings.modbus.allow[1].contains(0x0A020003));
  CHECK(settings.modbus.allow_writes.size() == 1);
  CHECK(settings.write_key == 4711);
  CHECK(settings.saved_state == folder / "state.toml");
  CHECK(settings.recordings == "/data/recordings");
}

TEST_CASE("settings: the key of a device can stand in a file of its own, and without a usable one nobody can write") {
  const test::ScratchFolder folder;
  const auto board = folder.write("board.toml", replaced(kFull, "write_key = 4711", "write_key_file = \"key\""));
  for (const char* useless : {"", "0\n", "65536\n", "-3\n", "abc\n"}) {
    folder.write("key", useless);
    CHECK(read_settings(board).write_key == kNoWriteKey);
  }
  folder.write("key", "815\n");
  CHECK(read_settings(board).write_key == 815);
  const auto user = folder.write("user.toml", "[modbus]\nwrite_key = 7\n");
  CHECK(read_settings({board, user}).write_key == 7);
}

TEST_CASE("settings: every choice is known") {
  using Tier = ShapeSettings::Tier;
  for (const auto& [name, tier] : {std::pair{"measures", Tier::kMeasures},
                                   {"map", Tier::kMap},
                                   {"contact", Tier::kContact},
                                   {"newton", Tier::kNewton},
                                   {"best", Tier::kBest}}) {
    const Settings settings = read(replaced(kFull, "tier = \"map+newton\"", std::string("tier = \"") + name + "\""));
    CHECK(settings.loop.shape.tier == tier);
  }
  CHECK(read(replaced(kFull, "speed = \"full\"", "speed = \"recorded\"")).replay.recorded_speed);
  CHECK(read(replaced(kFull, "word_order = \"CDAB\"", "word_order = \"ABCD\"")).loop.runtime[kWordOrder] == 0);
  CHECK(read(kMin).source == Settings::Source::kSession);
  CHECK(read(kMin).loop.shape.tier == Tier::kBest);
  const auto parity = [](const std::string& name) {
    return read(replaced(kFull, "parity = \"odd\"", "parity = \"" + name + "\"")).modbus.serial->parity;
  };
  CHECK(parity("even") == 'E');
  CHECK(parity("none") == 'N');
}

TEST_CASE("settings: an omitted key has the default of the part that uses it") {
  const Settings settings = read(kMin), parts;
  CHECK(settings.loop.runtime == parts.loop.runtime);
  CHECK(settings.loop.shape.tier == parts.loop.shape.tier);
  CHECK(settings.loop.shape.factorisations == parts.loop.shape.factorisations);
  CHECK(settings.loop.shape.chord_steps == parts.loop.shape.chord_steps);
  CHECK(settings.replay.recorded_speed == parts.replay.recorded_speed);
  CHECK(settings.replay.repeat == parts.replay.repeat);
  CHECK(settings.replay.recording == "");
  CHECK(settings.modbus.address == parts.modbus.address);
  CHECK(settings.modbus.port == parts.modbus.port);
  CHECK(settings.modbus.max_clients == parts.modbus.max_clients);
  CHECK(settings.modbus.idle_limit_s == parts.modbus.idle_limit_s);
  CHECK_FALSE(settings.modbus.serial);

  const auto line = [](const std::string& more) {
    return *read(kMin + "[modbus.serial]\ndevice = \"/dev/x\"\n" + more).modbus.serial;
  };
  const SerialSettings standard;
  CHECK(line("").baud == standard.baud);
  CHECK(line("").parity == standard.parity);
  CHECK(line("").stop_bits == standard.stop_bits);
  CHECK(line("").unit == standard.unit);
  CHECK(line("").rs485 == standard.rs485);
  CHECK(line("parity = \"none\"").stop_bits == 2);  // as the standard wants it
}

TEST_CASE("settings: a wrong type is refused with file, line, key, what was found and what is expected") {
  check_refused("pack = \"finger.safetensors\"", "pack = 3", "pack: found 3, expected a text");
  check_refused("hold_time_ms = 150", "hold_time_ms = 0.5",
                "hold_time_ms: found 0.5, expected a whole number from 0 to 10000");
  check_refused("kind = \"poses\"", "kind = true", "source.kind: found true, expected a text");
  check_refused("path = \"/data/touches.csv\"", "path = []", "source.path: found []");
  check_refused("recording = \"161922\"", "recording = 161922", "source.recording: found 161922, expected a text");
  check_refused("speed = \"full\"", "speed = 1", "source.speed: found 1, expected a text");
  check_refused("repeat = true", "repeat = 1", "source.repeat: found 1, expected true or false");
  check_refused("tier = \"map+newton\"", "tier = {}", "shape.tier: found a table, expected a text");
  check_refused("factorisations = 2", "factorisations = \"2\"", "shape.factorisations: found '2'");
  check_refused("chord_steps = 3", "chord_steps = 3.0", "shape.chord_steps: found 3.0, expected a whole number");
  check_refused("address = \"0.0.0.0\"", "address = 0.0", "modbus.address: found 0.0, expected a text");
  check_refused("port = 15020", "port = \"any\"", "modbus.port: found 'any', expected a whole number");
  check_refused("max_clients = 7", "max_clients = nan", "modbus.max_clients: found nan");
  check_refused("idle_limit_s = 5", "idle_limit_s = 1979-05-27", "modbus.idle_limit_s: found 1979-05-27");
  check_refused("word_order = \"CDAB\"", "word_order = false", "modbus.word_order: found false, expected a text");
  check_refused("device = \"/dev/ttyS1\"", "device = 1", "modbus.serial.device: found 1, expected a text");
  check_refused("baud = 9600", "baud = \"9600\"", "modbus.serial.baud: found '9600', expected a whole number");
  check_refused("rs485 = true", "rs485 = 1", "modbus.serial.rs485: found 1, expected true or false");
}

TEST_CASE("settings: a value out of its range is refused in the same way") {
  check_refused("pack = \"finger.safetensors\"", "pack = \"\"", "pack: found \"\", expected a path");
  check_refused("kind = \"poses\"", "kind = \"pose\"",
                "source.kind: found \"pose\", expected one of \"session\" \"poses\"");
  check_refused("path = \"/data/touches.csv\"", "path = \"\"", "source.path: found \"\", expected a path");
  check_refused("speed = \"full\"", "speed = \"fast\"", "source.speed: found \"fast\"");
  check_refused("tier = \"map+newton\"", "tier = \"Newton\"", "shape.tier: found \"Newton\"");
  check_refused("address = \"0.0.0.0\"", "address = \"localhost\"",
                "modbus.address: found \"localhost\", expected an IPv4 address");
  check_refused("word_order = \"CDAB\"", "word_order = \"BADC\"", "modbus.word_order: found \"BADC\"");
  check_refused("allow_writes = [\"10.2.0.3\"]", "allow_writes = [\"10.2.0\"]",
                "modbus.allow_writes: found \"10.2.0\", expected an address or a network");
  check_refused("allow_writes = [\"10.2.0.3\"]", "allow_writes = \"10.2.0.3\"",
                "modbus.allow_writes: found '10.2.0.3'");
  check_refused("allow_writes = [\"10.2.0.3\"]", "allow_writes = [3]", "modbus.allow_writes: found [ 3 ]");
  check_refused("reserve = []", "reserve = [\"10.1.0.0/24\"]", "modbus.reserve: found a network, expected addresses");
  check_refused("reserve = []", "reserve = [\"10.2.0.4\"]", "modbus.reserve: an address that `allow` does not");
  check_refused(
      "reserve = []",
      "reserve = [\"10.1.0.1\",\"10.1.0.2\",\"10.1.0.3\",\"10.1.0.4\",\"10.1.0.5\",\"10.1.0.6\",\"10.1.0.7\"]",
      "modbus.reserve: found 7 addresses, expected fewer than max_clients, which is 7");
  check_refused("max_per_address = 1", "max_per_address = 8",
                "modbus.max_per_address: found 8, expected at most max_clients, which is 7");
  CHECK_THROWS_WITH_AS(
      read(replaced(replaced(kFull, "max_clients = 7", "max_clients = 1"), "reserve = []", "reserve = [\"10.1.0.1\"]")),
      doctest::Contains("modbus.reserve: found 1 address, expected fewer than max_clients, which is 1"), InputError);
  check_refused("max_per_address = 1", "max_per_address = 65",
                "modbus.max_per_address: found 65, expected a whole number");
  check_refused("serial_number = \"FS-0042\"", "serial_number = \"F\u00fc\"",
                "device.serial_number: found \"F\u00fc\", expected at most 32 ASCII");
  for (const char* date : {"22.11.2026", "2026-02-30", "2026-1-1", "2026-11-2x", "-026-11-22"}) {
    check_refused("calibration_date = \"2026-11-22\"", std::string("calibration_date = \"") + date + "\"",
                  std::string("device.calibration_date: found \"") + date + "\", expected a date");
  }
  check_refused("device = \"/dev/ttyS1\"", "device = \"ttyS1\"",
                "modbus.serial.device: found \"ttyS1\", expected a device's");
  check_refused("baud = 9600", "baud = 9601", "modbus.serial.baud: found 9601, expected 1200, 2400");
  check_refused("parity = \"odd\"", "parity = \"mark\"", "modbus.serial.parity: found \"mark\"");

  struct Range {
    const char *line, *key;
    std::int64_t lowest, highest;
  };
  for (const Range& range :
       {Range{"hold_time_ms = 150", "hold_time_ms", 0, 10000}, Range{"smoothing_ms = 40", "smoothing_ms", 0, 1000},
        Range{"factorisations = 2", "shape.factorisations", 1, 10}, Range{"chord_steps = 3", "shape.chord_steps", 0, 5},
        Range{"port = 15020", "modbus.port", 0, 65535}, Range{"max_clients = 7", "modbus.max_clients", 1, 64},
        Range{"idle_limit_s = 5", "modbus.idle_limit_s", 1, 86400}, Range{"unit = 9", "modbus.unit", 0, 247},
        Range{"record_max_s = 30", "storage.record_max_s", 1, 65535},
        Range{"record_reserve_mb = 7", "storage.record_reserve_mb", 0, 1000000},
        Range{"write_key = 4711", "modbus.write_key", 1, 65535},
        Range{"stop_bits = 2", "modbus.serial.stop_bits", 1, 2}, Range{"unit = 42", "modbus.serial.unit", 1, 247}}) {
    const std::string line = range.line, name = line.substr(0, line.find('=')) + "= ";
    const std::string expected =
        ", expected a whole number from " + std::to_string(range.lowest) + " to " + std::to_string(range.highest);
    for (const std::int64_t value : {range.lowest, range.highest})
      read(replaced(kFull, line, name + std::to_string(value)));
    for (const std::int64_t value : {range.lowest - 1, range.highest + 1}) {
      check_refused(line, name + std::to_string(value),
                    std::string(range.key) + ": found " + std::to_string(value) + expected);
    }
  }
}

TEST_CASE("settings: unknown keys and tables are refused by name") {
  check_refused("hold_time_ms = 150", "hold_time = 150", "hold_time: found an unknown key");
  check_refused("repeat = true", "repeats = true", "source.repeats: found an unknown key");
  check_refused("tier = \"map+newton\"", "tire = \"map\"", "shape.tire: found an unknown key");
  check_refused("port = 15020", "ports = 15020", "modbus.ports: found an unknown key");
  check_refused("[shape]", "[shapes]", "shapes: found an unknown key");
}

TEST_CASE("settings: a recording can only be chosen from poses") {
  CHECK_THROWS_WITH_AS(read(replaced(kFull, "kind = \"poses\"", "kind = \"session\"")),
                       doctest::Contains("board.toml:9: source.recording: found an unknown key"), InputError);
}

TEST_CASE("settings: a required key that is missing is named") {
  const auto check_missing = [](const std::string& line, const std::string& reason) {
    CHECK_THROWS_WITH_AS(read(replaced(kMin, line, "")), doctest::Contains(reason.c_str()), InputError);
  };
  check_missing("pack = \"p\"", "pack: found nothing, expected a text");
  check_missing("kind = \"session\"", "board.toml:2: source.kind: found nothing, expected a text");
  check_missing("path = \"s\"", "board.toml:2: source.path: found nothing, expected a text");
  check_missing("[modbus]", "modbus: found nothing, expected a table");
  CHECK_THROWS_WITH_AS(read(""), doctest::Contains("board.toml"), InputError);
}

TEST_CASE("settings: a file that is not TOML is refused with the line, one that does not exist with its name") {
  check_refused("repeat = true", "repeat = ", "");
  const test::ScratchFolder folder;
  CHECK_THROWS_WITH_AS(read_settings(folder / "none.toml"), doctest::Contains("none.toml: no such file"), InputError);
  CHECK_THROWS_WITH_AS(read_settings(folder.path()), doctest::Contains("is not a file"), InputError);
}

TEST_CASE("settings: the workstation's board file is valid and names what the demo makes") {
  const std::filesystem::path boards = FINSIGHT_SOURCE_DIR "/boards/replay";
  const Settings settings = read_settings(boards / "board.toml"), parts;
  const std::filesystem::path demo = FINSIGHT_SOURCE_DIR "/build/demo";
  CHECK(settings.pack.lexically_normal() == demo / "srm.safetensors");
  CHECK(settings.source == Settings::Source::kSession);
  CHECK(settings.replay.path.lexically_normal() == demo / "session-640x480");
  CHECK(settings.replay.recorded_speed);
  CHECK(settings.replay.repeat);
  CHECK(settings.modbus.port == 1502);  // 502 needs privileges on a workstation
  CHECK(settings.loop.runtime == parts.loop.runtime);
}

TEST_CASE("settings: the user's values replace the board file's, and its paths start at the user's file") {
  const test::ScratchFolder folder;
  const auto board = folder.write("board.toml", kBoard);
  std::filesystem::create_directory(folder / "esp");
  const auto user = folder.write("esp/user.toml",
                                 "pack = \"finger.safetensors\"\n[modbus]\nword_order = \"CDAB\"\n"
                                 "[network]\nmethod = \"static\"\naddress = \"10.1.2.3/8\"\n");
  const Settings settings = read_settings({board, user});
  CHECK(settings.pack == folder / "esp" / "finger.safetensors");
  CHECK(settings.loop.runtime[kWordOrder] == 1);
  CHECK(settings.modbus.port == 502);
  CHECK(settings.replay.path == "/recorded");
  CHECK(settings.network.address == "10.1.2.3/8");
  CHECK(read_settings(board).pack == folder / "model.safetensors");
}

TEST_CASE("settings: a source of another kind replaces the board's entirely") {
  const test::ScratchFolder folder;
  const auto board = folder.write("board.toml", kBoard);
  const Settings settings =
      read_settings({board, folder.write("user.toml", "[source]\nkind = \"poses\"\npath = \"a.csv\"\n")});
  CHECK(settings.source == Settings::Source::kPoses);
  CHECK_FALSE(settings.replay.repeat);
}

TEST_CASE("settings: an error in the user's file names that file and line") {
  CHECK(user_refusal("") == "");
  CHECK(user_refusal("\n\n[modbsu]\nport = 1\n").find("user.toml:3") != std::string::npos);
  CHECK(user_refusal("[modbus]\nport = 70000\n").find("user.toml:2") != std::string::npos);
  CHECK(user_refusal("[modbus]\n\nprot = 502\n").find("user.toml:3") != std::string::npos);
  CHECK(user_refusal("[network]\nmethod = \"static\"\n").find("network.address") != std::string::npos);
  CHECK(user_refusal("[network]\nmethod = \"static\"\naddress = \"10.0.0.1\"\n").find("prefix length") !=
        std::string::npos);
  CHECK(user_refusal("[network]\nmethod = \"dhcp\"\naddress = \"10.0.0.1/8\"\n").find("user.toml:3") !=
        std::string::npos);
  CHECK(user_refusal("[realtime]\npriority = 99\n").find("user.toml:2") != std::string::npos);
  CHECK(user_refusal("this is not TOML").find("user.toml:1") != std::string::npos);
}

TEST_CASE("settings: addresses that no device can have, and gateways that it cannot reach, are refused") {
  const auto refusal = [](const std::string& address, const std::string& gateway = "") {
    return user_refusal("[network]\nmethod = \"static\"\naddress = \"" + address + "\"\n" +
                        (gateway.empty() ? "" : "gateway = \"" + gateway + "\"\n"));
  };
  for (const char* address : {"10.1.2.3/8", "192.168.0.40/24", "169.254.7.7/16", "10.0.0.0/31", "10.0.0.7/32"}) {
    CHECK(refusal(address) == "");
  }
  for (const char* address : {"0.0.0.0/8", "0.1.2.3/8", "127.0.0.1/8", "224.0.0.5/24", "255.255.255.255/24",
                              "192.168.0.0/24", "192.168.0.255/24", "10.1.2.3/0"}) {
    CAPTURE(address);
    CHECK(refusal(address).find("user.toml:3: network.address: found") != std::string::npos);
  }
  CHECK(refusal("192.168.0.40/24", "192.168.0.1") == "");
  for (const char* gateway :
       {"192.168.1.1", "192.168.0.40", "192.168.0.0", "192.168.0.255", "127.0.0.1", "router", "192.168.0.1/24"}) {
    CAPTURE(gateway);
    CHECK(refusal("192.168.0.40/24", gateway).find("user.toml:4: network.gateway: found") != std::string::npos);
  }
}

TEST_CASE("settings: the network is read whatever the rest is like") {
  const test::ScratchFolder folder;
  const auto board = folder.write("board.toml", kBoard);
  const auto user = folder.write("user.toml",
                                 "[modbus]\nword_order = \"XX\"\n[modbsu]\n"
                                 "[network]\nmethod = \"static\"\naddress = \"10.1.2.3/8\"\n");
  CHECK_THROWS_AS(read_settings({board, user}), InputError);
  CHECK(read_network_settings({board, user}).address == "10.1.2.3/8");
  CHECK(read_network_settings(board).address.empty());
  const auto wrong = folder.write("wrong.toml", "[network]\nmethod = \"static\"\naddress = \"10.1.2\"\n");
  CHECK_THROWS_WITH_AS(read_network_settings({board, wrong}), doctest::Contains("network.address"), InputError);
}

TEST_CASE("settings: the files are read once, for all readers together") {
  const test::ScratchFolder folder;
  const auto board = folder.write("board.toml", kBoard);
  const auto user = folder.write("user.toml", "[network]\nmethod = \"static\"\naddress = \"10.1.2.3/8\"\n");
  const SettingsFiles files(board, user);
  std::filesystem::remove(board);
  std::filesystem::remove(user);
  for (int again = 0; again < 2; ++again) {
    CHECK(read_settings(files).network.address == "10.1.2.3/8");
    CHECK(read_network_settings(files).address == "10.1.2.3/8");
    CHECK(read_usable_settings(files).modbus.port == 502);
  }
}

TEST_CASE("settings: of settings that are refused the valid parts are used") {
  const test::ScratchFolder folder;
  std::string with_outputs = kBoard;
  with_outputs += "[gpio]\nchip = \"/dev/gpiochip0\"\n[gpio.healthy]\nnumber = 3\n";
  const auto board = folder.write("board.toml", with_outputs);
  const auto good_part = folder.write("a.toml", "[modbus]\nport = 1502\nword_order = \"CDAB\"\n[nonsense]\n");
  CHECK(read_usable_settings({board, good_part}).modbus.port == 1502);
  CHECK(read_usable_settings({board, good_part}).loop.runtime[kWordOrder] == 1);
  CHECK(read_usable_settings({board, good_part}).gpio.has_value());
  const auto bad_part = folder.write("b.toml", "[modbus]\nport = 70000\n[gpio]\nchip = 3\n");
  CHECK(read_usable_settings({board, bad_part}).modbus.port == 502);
  CHECK(read_usable_settings({board, bad_part}).gpio->chip == "/dev/gpiochip0");
  const auto bad_modbus = folder.write("d.toml", "[modbus]\nport = 0x10000\n[storage]\nsettings = \"state.toml\"\n");
  CHECK(read_usable_settings({board, bad_modbus}).saved_state == folder / "state.toml");
  const auto device = folder.write("e.toml", "[device]\nserial_number = \"FS-0042\"\n[nonsense]\n");
  CHECK(read_usable_settings({board, device}).serial_number == "FS-0042");
  const auto no_toml = folder.write("c.toml", "port = = 1\n");
  CHECK(read_usable_settings({no_toml, no_toml}).modbus.address == "0.0.0.0");
  CHECK_FALSE(read_usable_settings(folder / "none.toml").gpio.has_value());
}
