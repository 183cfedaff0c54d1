#include <doctest/doctest.h>

#include <atomic>
#include <stdexcept>
#include <thread>
#include <vector>

#include "firmware/ports/camera.h"

using namespace finsight;

namespace {

constexpr std::int64_t kMs = 1'000'000;
constexpr int kPeriodMs = 20;

/// What happens to the fake hardware, and what was done to it. The opening thread only touches what is atomic.
struct Hardware {
  std::int64_t now_ns = 1'000'000 * kMs;  // passes only while somebody sleeps
  std::atomic<bool> plugged_in{true};
  bool silent = false;  // the camera exists and delivers nothing
  std::atomic<int> period_ms{kPeriodMs};
  std::uint32_t broken = 0;         // pictures, since the camera was opened
  std::int64_t delay_ns = 3 * kMs;  // from a frame's exposure to its delivery
  std::atomic<int> open{0}, openings{0}, attempts{0};
  std::vector<std::string> reports;  // written by the opening thread, read when it is done
  std::atomic<int> reported{0};

  ReplayClock clock() {
    return {.now_ns = [this] { return now_ns; },
            .sleep_until_ns = [this](std::int64_t until_ns) { now_ns = std::max(now_ns, until_ns); }};
  }
};

/// Gives a frame every period, numbered from 7 after every opening; ends when it is unplugged.
class FakeCamera : public Camera {
 public:
  explicit FakeCamera(Hardware& hardware) : hardware_(hardware) {
    ++hardware_.open;
    ++hardware_.openings;
  }
  ~FakeCamera() override { --hardware_.open; }

  bool next(Frame& frame, int timeout_ms) override {
    if (ended()) return false;
    hardware_.now_ns += (hardware_.silent ? timeout_ms : hardware_.period_ms.load()) * kMs;
    if (hardware_.silent) return false;
    frame.exposure_ns = hardware_.now_ns - hardware_.delay_ns;
    frame.sequence = sequence_++;
    return true;
  }
  bool ended() const override { return !hardware_.plugged_in; }
  std::string error() const override { return ended() ? "it was unplugged" : ""; }
  CameraCounts counts() const override { return {.broken = hardware_.broken}; }

 private:
  Hardware& hardware_;
  std::uint32_t sequence_ = 7;
};

std::unique_ptr<Camera> live(Hardware& hardware) {
  const auto open = [&hardware]() -> std::unique_ptr<Camera> {
    ++hardware.attempts;
    if (!hardware.plugged_in) throw std::runtime_error("no camera");
    return std::make_unique<FakeCamera>(hardware);
  };
  LiveCameraSettings settings;
  settings.frames_per_second = 1000.0 / kPeriodMs;
  settings.stall_ms = 200;
  return keep_open(
      open, settings,
      [&hardware](const std::string& message) {
        hardware.reports.push_back(message);
        ++hardware.reported;
      },
      hardware.clock());
}

/// Calls next() until a frame comes; the opening thread takes some real time.
bool frame_within(Camera& camera, Frame& frame, int asks) {
  for (int i = 0; i < asks; ++i) {
    if (camera.next(frame, 100)) return true;
  }
  return false;
}

}  // namespace

TEST_CASE("live camera: frames come through as they are, and nothing is late or lost") {
  Hardware hardware;
  const auto camera = live(hardware);
  Frame frame;
  REQUIRE(frame_within(*camera, frame, 20));
  const std::uint32_t first = frame.sequence;
  for (std::uint32_t k = 1; k < 50; ++k) {
    REQUIRE(camera->next(frame, 100));
    CHECK(frame.sequence == first + k);
    CHECK(frame.exposure_ns == hardware.now_ns - hardware.delay_ns);
  }
  CHECK(camera->counts().late == 0);
  CHECK(camera->counts().losses == 0);
  CHECK(camera->error() == "");
}

TEST_CASE("live camera: a frame that comes two frame times after its exposure counts as late") {
  Hardware hardware;
  const auto camera = live(hardware);
  Frame frame;
  REQUIRE(frame_within(*camera, frame, 20));
  hardware.delay_ns = 41 * kMs;
  for (int k = 0; k < 3; ++k) CHECK(camera->next(frame, 100));
  hardware.delay_ns = 39 * kMs;
  CHECK(camera->next(frame, 100));
  CHECK(camera->counts().late == 3);
}

TEST_CASE(
    "live camera: without a camera at the start there is no frame and an error; one that appears later is found") {
  Hardware hardware;
  hardware.plugged_in = false;
  const auto camera = live(hardware);
  Frame frame;
  CHECK(!frame_within(*camera, frame, 50));
  CHECK(camera->error() == "no camera");
  CHECK(!camera->ended());
  hardware.plugged_in = true;
  CHECK(frame_within(*camera, frame, 200));
  CHECK(camera->error() == "");
}

TEST_CASE("live camera: attempts to open a missing camera become rarer, down to one every second") {
  Hardware hardware;
  hardware.plugged_in = false;
  const auto camera = live(hardware);
  const std::int64_t start_ns = hardware.now_ns;
  Frame frame;
  while (hardware.now_ns < start_ns + 60'000 * kMs) camera->next(frame, 100);
  // 0.1 + 0.2 + 0.4 + 0.8 s are four waits, then 1 s each: 1.5 s + 58 * 1 s.
  CHECK(hardware.attempts >= 58);
  CHECK(hardware.attempts <= 64);
  CHECK(camera->counts().openings + 1 >= static_cast<unsigned>(hardware.attempts));  // the last one may not have ended
  CHECK(camera->counts().openings <= static_cast<unsigned>(hardware.attempts));
}

TEST_CASE("live camera: an unplugged camera comes back, and its sequence continues without a gap") {
  Hardware hardware;
  const auto camera = live(hardware);
  Frame frame;
  REQUIRE(frame_within(*camera, frame, 20));
  const std::uint32_t last = frame.sequence;
  hardware.plugged_in = false;
  CHECK(!camera->next(frame, 100));
  CHECK(camera->error() == "it was unplugged");
  CHECK(!frame_within(*camera, frame, 20));
  hardware.plugged_in = true;
  REQUIRE(frame_within(*camera, frame, 200));
  CHECK(frame.sequence == last + 1);
  CHECK(camera->counts().losses == 1);
}

TEST_CASE("live camera: one that stalls is closed and opened again") {
  Hardware hardware;
  const auto camera = live(hardware);
  Frame frame;
  REQUIRE(frame_within(*camera, frame, 20));
  hardware.silent = true;
  for (int i = 0; i < 4; ++i) CHECK(!camera->next(frame, 100));
  CHECK(camera->counts().losses == 1);
  CHECK(camera->error().starts_with("no frame for"));
  hardware.silent = false;
  CHECK(frame_within(*camera, frame, 200));
  CHECK(hardware.openings == 2);
  CHECK(hardware.open == 1);
}

TEST_CASE("live camera: the first frame may take seconds") {
  Hardware hardware;
  hardware.silent = true;
  const auto camera = live(hardware);
  const std::int64_t start_ns = hardware.now_ns;
  Frame frame;
  while (hardware.now_ns < start_ns + 4000 * kMs) camera->next(frame, 100);
  CHECK(camera->counts().losses == 0);
  CHECK(hardware.openings == 1);
}

TEST_CASE("live camera: every change is reported once") {
  Hardware hardware;
  hardware.plugged_in = false;
  {
    const auto camera = live(hardware);
    Frame frame;
    while (hardware.attempts < 5) camera->next(frame, 100);
    hardware.plugged_in = true;
    REQUIRE(frame_within(*camera, frame, 200));
    hardware.plugged_in = false;
    while (hardware.attempts < 15) camera->next(frame, 100);
  }
  CHECK(hardware.reports == std::vector<std::string>{"camera: no camera", "camera is open", "camera: it was unplugged",
                                                     "camera: no camera"});
}

TEST_CASE("live camera: a camera that gives less than half of the wanted frames is called slow, and that is reported") {
  Hardware hardware;
  {
    const auto camera = live(hardware);
    Frame frame;
    REQUIRE(frame_within(*camera, frame, 20));
    CHECK(camera->counts().rate_hz == 0);
    for (int k = 0; k < 102; ++k) REQUIRE(camera->next(frame, 100));
    CHECK(camera->counts().rate_hz == doctest::Approx(50));
    CHECK(!camera->counts().is_slow);
    while (hardware.reported < 2) std::this_thread::yield();
    hardware.period_ms = 50;
    for (int k = 0; k < 102; ++k) REQUIRE(camera->next(frame, 100));
    CHECK(camera->counts().rate_hz == doctest::Approx(20));
    CHECK(camera->counts().is_slow);
    while (hardware.reported < 3) std::this_thread::yield();
  }
  REQUIRE(hardware.reports.size() == 3);
  CHECK(hardware.reports[1] == "camera: gives 50.0 frames/s of the wanted 50.0");
  CHECK(hardware.reports[2].starts_with("camera: gives 2"));  // 20, and the frame that was still fast
  CHECK(hardware.reports[2].ends_with("frames/s of the wanted 50.0, less than half"));
}

TEST_CASE("live camera: broken pictures are counted over all openings, and a warning of them ends") {
  Hardware hardware;
  const auto camera = live(hardware);
  Frame frame;
  REQUIRE(frame_within(*camera, frame, 20));
  hardware.broken = 3;
  for (int k = 0; k < 102; ++k) REQUIRE(camera->next(frame, 100));
  CHECK(camera->counts().broken == 3);
  CHECK(camera->counts().breaks);
  for (int k = 0; k < 102; ++k) REQUIRE(camera->next(frame, 100));
  CHECK(!camera->counts().breaks);
  hardware.plugged_in = false;
  CHECK(!camera->next(frame, 100));
  hardware.broken = 0;
  hardware.plugged_in = true;
  REQUIRE(frame_within(*camera, frame, 200));
  CHECK(camera->counts().broken == 3);
}

TEST_CASE("live camera: after a thousand losses one camera is open, and none at the end") {
  Hardware hardware;
  {
    const auto camera = live(hardware);
    Frame frame;
    for (int i = 0; i < 1000; ++i) {
      hardware.plugged_in = true;
      REQUIRE(frame_within(*camera, frame, 200));
      CHECK(hardware.open == 1);
      hardware.plugged_in = false;
      CHECK(!camera->next(frame, 100));
    }
    CHECK(camera->counts().losses == 1000);
    CHECK(hardware.openings == 1000);
  }
  CHECK(hardware.open == 0);
}
