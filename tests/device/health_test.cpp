#include "firmware/device/health.h"

#include <doctest/doctest.h>

#include <array>
#include <span>
#include <string>

#include "firmware/device/identity.h"
#include "tests/count_allocations.h"
#include "tests/model/scratch_folder.h"
#include "tests/model/tiny_model.h"

using namespace finsight;

namespace {

constexpr std::int64_t kMs = 1'000'000;

class Diagnosed {
 public:
  /// One turn of the loop that works for 5 of every 20 ms.
  void turn(std::uint16_t fault, std::int64_t wait_ms = 15) {
    now_ns_ += wait_ms * kMs;
    health_.begin_turn(now_ns_);
    image_.words[address_of("fault")] = fault;
    image_.exposure_ns = now_ns_;
    health_.note(image_, true, now_ns_, now_ns_ + 5 * kMs, {++frames_, 70000, 2});
    now_ns_ += 5 * kMs;
  }
  std::uint32_t read(int address, int words = 1) {
    std::array<std::uint16_t, 2> read{};
    const std::span<std::uint16_t> span(read.data(), static_cast<std::size_t>(words));
    control.read(address, span, {}, now_ns_, control.stalled_since_ns(image_, now_ns_));
    return words == 2 ? std::uint32_t{read[0]} << 16 | read[1] : read[0];
  }
  /// No turn for so long.
  void hang(std::int64_t ms) { now_ns_ += ms * kMs; }
  std::string text(int address) {
    std::array<std::uint16_t, 16> words{};
    control.read(address, words, {}, now_ns_);
    std::string text;
    for (const std::uint16_t word : words) text += {static_cast<char>(word >> 8), static_cast<char>(word)};
    return text.c_str();
  }
  Control control;

 private:
  Health health_{control};
  RegisterImage image_;
  std::int64_t now_ns_ = steady_now_ns();
  std::uint32_t frames_ = 0;
};

}  // namespace

TEST_CASE("health: frame rate, load and counters of the loop are readable") {
  Diagnosed device;
  CHECK(device.read(3025) == 65535);
  CHECK(device.read(3031) == 65535);
  for (int i = 0; i < 60; ++i) device.turn(0);
  CHECK(device.read(3000, 2) == 1);  // 1.2 s
  CHECK(device.read(3025) == 5000);
  CHECK(device.read(3026, 2) == 60);
  CHECK(device.read(3028, 2) == 70000);
  CHECK(device.read(3031) == 250);
  CHECK(device.read(3032) == 50);
  CHECK(device.read(3033) == 2);
}

TEST_CASE("health: the last eight faults are listed with their times, the newest first, and stalls among them") {
  Diagnosed device;
  device.control.set_stale_after(300 * kMs);
  for (std::uint16_t fault = 1; fault <= 9; ++fault) {
    for (int i = 0; i < 100; ++i) device.turn(fault == 8 ? 12 : fault);  // 2 s each
    for (int i = 0; i < 50; ++i) device.turn(0);
  }
  CHECK(device.read(3086) == 9);
  CHECK(device.read(3087) == 9);
  CHECK(device.read(3087 + 1, 2) == 24);
  CHECK(device.read(3087 + 3) == 2);
  CHECK(device.read(3091) == 12);
  CHECK(device.read(3115) == 2);
  CHECK(device.read(3115 + 1, 2) == 3);
  device.turn(2, 5300);  // nothing for 5 s
  device.turn(2);
  CHECK(device.read(3087) == 2);
  CHECK(device.read(3087 + 3) == 65535);  // it stands
  CHECK(device.read(3091) == 8);
  CHECK(device.read(3091 + 1, 2) == 27);
  CHECK(device.read(3091 + 3) == 5);
  CHECK(device.read(3086) == 11);
}

TEST_CASE("health: a stall is in the list from its first moment, and no frames are counted while it stands") {
  Diagnosed device;
  device.control.set_stale_after(300 * kMs);
  for (int i = 0; i < 100; ++i) device.turn(0);  // 2 s
  CHECK(device.read(3025) == 5000);
  device.hang(290);
  CHECK(device.read(3025) == 5000);
  CHECK(device.read(3086) == 0);
  device.hang(5000);
  CHECK(device.read(3025) == 0);
  CHECK(device.read(3031) == 65535);  // how much it works is not known
  CHECK(device.read(3086) == 1);
  CHECK(device.read(3087) == 8);
  CHECK(device.read(3087 + 1, 2) == 2);
  CHECK(device.read(3087 + 3) == 65535);  // it stands
  device.turn(0);
  CHECK(device.read(3086) == 1);
  CHECK(device.read(3087) == 8);
  CHECK(device.read(3087 + 1, 2) == 2);
  CHECK(device.read(3087 + 3) == 5);
}

TEST_CASE("health: noting it does not allocate") {
  Diagnosed device;
  const long before = test::allocations;
  for (int i = 0; i < 200; ++i) device.turn(i / 10 % 2 ? 3 : 0);
  CHECK(test::allocations == before);
}

TEST_CASE("identity: model, serial number and calibration date come from pack and board file") {
  const Model model = test::TinyModel().open();
  Settings settings;
  settings.serial_number = "FS-0042";
  settings.calibration_date = 20261122;
  Diagnosed device;
  device.control.identify(identity_of(settings, &model));
  CHECK(device.text(3038) == model.finger_name);
  CHECK(device.text(3054) == "FS-0042");
  CHECK(device.text(3070) == FINSIGHT_VERSION);
  CHECK(device.read(3034, 2) == 20261122);
  CHECK(device.read(3036, 2) == model.checksum);
}

TEST_CASE("identity: which version of the image runs, and from which slot") {
  const test::ScratchFolder folder;
  Diagnosed device;
  device.control.identify(identity_of({}, nullptr, folder / "missing"));
  CHECK(device.read(3122, 2) == 0);
  CHECK(device.read(3124) == 0);
  device.control.identify(identity_of({}, nullptr, folder.write("image", "0.1.0-202611222207 b\n")));
  CHECK(device.read(3122, 2) == 2'611'222'207);
  CHECK(device.read(3124) == 2);
}

TEST_CASE("identity: without a date in the board file, it is the day on which the newest measured file was written") {
  const test::ScratchFolder folder;
  Settings settings;
  CHECK(identity_of(settings, nullptr).calibration_date == 0);
  settings.measured_files = {folder.write("lens.toml", "a"), folder.write("mount.toml", "b"), folder / "missing.toml"};
  using namespace std::chrono;
  std::filesystem::last_write_time(settings.measured_files[0],
                                   file_clock::from_sys(sys_days(2025y / 3 / 7) + 23h + 0s));
  std::filesystem::last_write_time(settings.measured_files[1], file_clock::from_sys(sys_days(2024y / 12 / 31) + 0s));
  CHECK(identity_of(settings, nullptr).calibration_date == 20250307);
}
