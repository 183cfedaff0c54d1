#include <doctest/doctest.h>
#include <unistd.h>

#include <filesystem>
#include <fstream>
#include <iterator>
#include <set>

#include "firmware/input_error.h"
#include "firmware/settings/settings.h"

using namespace finsight;
namespace fs = std::filesystem;

namespace {

const std::string kCamera = R"(pack = "p"
[source]
kind = "camera"
camera = "Finger"
width_px = 640
height_px = 480
frames_per_second = 60
[source.lens]
fx_fy_cx_cy = [400, 401, 320, 240]
k1_k2_p1_p2_k3 = [0.1, 0, 0, 0, 0]
[modbus]
)";
const std::string kGpio = R"(pack = "p"
[source]
kind = "session"
path = "s"
[modbus]
[gpio]
chip = "/dev/gpiochip0"
contact = { name = "GPIO17", safe = "active" }
healthy = { number = 3, active_low = true }
)";

Settings read(const std::string& text) {
  const fs::path file = fs::temp_directory_path() / ("finsight_board_files_" + std::to_string(getpid()) + ".toml");
  std::ofstream(file) << text;
  struct Removed {
    fs::path file;
    ~Removed() { fs::remove(file); }
  } removed{file};
  return read_settings(file);
}

/// `text` with the first `from` replaced.
std::string with(std::string text, const std::string& from, const std::string& to) {
  const std::size_t at = text.find(from);
  REQUIRE(at != std::string::npos);
  return text.replace(at, from.size(), to);
}

std::string refusal(const std::string& text) {
  try {
    read(text);
  } catch (const InputError& error) {
    return error.what();
  }
  return "accepted";
}

bool says(const std::string& text, const char* part) { return text.find(part) != std::string::npos; }

}  // namespace

TEST_CASE("board files: every board file can be read, and so can the alternatives that the replay board explains") {
  std::set<std::string> boards;
  for (const auto& entry : fs::directory_iterator(fs::path(FINSIGHT_SOURCE_DIR) / "boards")) {
    const fs::path file = entry.path() / "board.toml";
    if (!fs::exists(file)) continue;
    CAPTURE(file.string());
    CHECK_NOTHROW(read_settings(file));
    boards.insert(entry.path().filename());
  }
  for (const char* board : {"replay", "qemu-virt", "rpi4", "generic-uefi-arm64"}) CHECK(boards.contains(board));
}

TEST_CASE("board files: with what scripts/image adds, every board of the image has its page on the local link") {
  const fs::path boards = fs::path(FINSIGHT_SOURCE_DIR) / "boards";
  for (const char* board : {"qemu-virt", "rpi4", "generic-uefi-arm64"}) {
    CAPTURE(board);
    std::string text;
    for (const fs::path& file :
         {boards / board / "board.toml", boards / "image/realtime.toml", boards / "image/page.toml"}) {
      std::ifstream in(file);
      text.append(std::istreambuf_iterator<char>(in), {});
    }
    const Settings settings = read(text);
    REQUIRE(settings.page);
    CHECK(settings.page->local_link_only);
    CHECK(settings.page->updates == "/data/updates");
    CHECK(settings.realtime.cpu == 1);
  }
}

TEST_CASE("board files: the comments of the replay board are a board file of their own") {
  std::ifstream in(fs::path(FINSIGHT_SOURCE_DIR) / "boards/replay/board.toml");
  std::string text = "pack = \"p\"\n";
  bool alternatives = false;
  for (std::string line; std::getline(in, line);) {
    alternatives = alternatives || line == "# [source]";
    // Comments that are not TOML are prose.
    if (alternatives && (line.starts_with("# [") || line.find(" = ") != std::string::npos))
      text += line.substr(2) + "\n";
  }
  const Settings settings = read(text + "[modbus]\n");
  CHECK(settings.source == Settings::Source::kCamera);
  CHECK(settings.camera.exposure_us == 2000);
  CHECK(settings.camera.gain == 1.0);
  REQUIRE(settings.gpio);
  for (const auto& line : settings.gpio->lines) CHECK(line);
}

TEST_CASE("board files: a camera's keys are read; omitted exposure and gain are automatic") {
  const Settings settings = read(kCamera);
  CHECK(settings.source == Settings::Source::kCamera);
  CHECK(settings.camera.name == "Finger");
  CHECK(settings.camera.width_px == 640);
  CHECK(settings.camera.height_px == 480);
  CHECK(settings.camera.frames_per_second == 60);
  CHECK(!settings.camera.exposure_us);
  CHECK(!settings.camera.gain);
  CHECK(!settings.camera.readout_ms);
  CHECK(read(with(kCamera, "[source.lens]", "readout_ms = 12\n[source.lens]")).camera.readout_ms == 12);
  CHECK(settings.lens.width_px == 640);
  CHECK(settings.lens.fy == 401);
  CHECK(settings.lens.k1 == 0.1);
}

TEST_CASE("board files: an impossible camera is refused with line and key") {
  CHECK(says(refusal(with(kCamera, "width_px = 640", "width_px = 4")), "width_px"));
  CHECK(says(refusal(with(kCamera, "width_px = 640", "width_px = 4")), ".toml:5"));
  CHECK(says(refusal(with(kCamera, "frames_per_second = 60", "")), "frames_per_second"));
  CHECK(says(refusal(with(kCamera, "frames_per_second = 60", "frames_per_second = 60\ngain = -1")), "gain"));
  CHECK(says(refusal(with(kCamera, "frames_per_second = 60", "frames_per_second = 60\nexposure_us = 0.5")),
             "exposure_us"));
  CHECK(says(refusal(with(kCamera, "camera = \"Finger\"", "path = \"x\"")), "path"));
  CHECK(says(refusal(with(kCamera, "[400, 401", "[0, 401")), "fx_fy_cx_cy"));
  CHECK(says(refusal(with(kCamera, "320, 240]", "3200, 240]")), "an optical axis at (3200, 240) px"));
  CHECK(says(refusal(with(kCamera, "[source.lens]", "[source.lense]")), "lens"));
}

TEST_CASE("board files: lines are read by name or number, with their polarity and safe level") {
  const Settings settings = read(kGpio);
  REQUIRE(settings.gpio);
  CHECK(settings.gpio->chip == "/dev/gpiochip0");
  CHECK(settings.gpio->consumer == "finsight");
  const auto& lines = settings.gpio->lines;
  REQUIRE(lines[kContactOutput]);
  CHECK(lines[kContactOutput]->name == "GPIO17");
  CHECK(lines[kContactOutput]->safe_active);
  CHECK(!lines[kOverloadOutput]);
  REQUIRE(lines[kHealthyOutput]);
  CHECK(lines[kHealthyOutput]->number == 3);
  CHECK(lines[kHealthyOutput]->active_low);
  CHECK(!lines[kHealthyOutput]->safe_active);
  CHECK(!read(kCamera).gpio);
}

TEST_CASE("board files: ambiguous or incomplete outputs are refused") {
  CHECK(says(refusal(with(kGpio, ", safe = \"active\"", "")), "safe"));
  CHECK(says(refusal(with(kGpio, "safe = \"active\"", "safe = \"high\"")), "\"active\" \"inactive\""));
  CHECK(says(refusal(with(kGpio, "number = 3", "name = \"x\", number = 3")), "either a name or a number"));
  CHECK(says(refusal(with(kGpio, "number = 3, ", "")), "either a name or a number"));
  CHECK(says(refusal(with(kGpio, "GPIO17", "")), "name"));
  CHECK(says(refusal(with(kGpio, "active_low = true", "safe = \"active\"")), "safe"));
  CHECK(says(refusal(with(kGpio, "number = 3", "number = -1")), "number"));
  CHECK(says(refusal(with(kGpio, "healthy =", "helthy =")), "helthy"));
  CHECK(says(refusal(kGpio.substr(0, kGpio.find("contact ="))), "contact, overload, healthy, light or trigger"));
  CHECK(says(refusal(with(kGpio, "chip = \"/dev/gpiochip0\"\n", "")), "chip"));
}

TEST_CASE("board files: without [page] there is no page; with it, its keys are read and checked") {
  CHECK(!read(kCamera).page);
  const Settings settings =
      read(kCamera + "[page]\nport = 8080\nallow = [\"10.0.0.0/8\"]\nnames = [\"finger.lan\"]\nfolder = \"/tmp/p\"\n");
  REQUIRE(settings.page);
  CHECK(settings.page->address == "127.0.0.1");
  CHECK(settings.page->port == 8080);
  CHECK(settings.page->allow.size() == 1);
  CHECK(settings.page->folder == "/tmp/p");
  CHECK(says(refusal(kCamera + "[page]\nport = 0\n"), "page.port"));
  CHECK(says(refusal(kCamera + "[page]\naddress = \"finger\"\n"), "page.address"));
  CHECK(says(refusal(kCamera + "[page]\nallow_writes = [\"all\"]\n"), "page.allow_writes"));
  CHECK(says(refusal(kCamera + "[page]\ncolour = \"red\"\n"), "colour"));
}
