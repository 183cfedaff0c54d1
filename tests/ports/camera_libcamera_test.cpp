// The camera port with libcamera's own virtual camera, which shows the images that tests/system/virtual_camera.py
// made: run it from there. FINSIGHT_VIRTUAL_FRAMES names the folder with the images as 0.pgm, 1.pgm, ...
#include <doctest/doctest.h>

#include <chrono>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <set>

#include "firmware/input_error.h"
#include "firmware/ports/camera.h"

using namespace finsight;
namespace fs = std::filesystem;

namespace {

constexpr int kWidth = 640, kHeight = 480, kTimeoutMs = 5000;

LiveCameraSettings settings() {
  return {.name = "Finger0", .width_px = kWidth, .height_px = kHeight, .frames_per_second = 60};
}

struct Image {
  std::vector<std::uint8_t> grey;
};

std::vector<Image> images() {
  const char* folder = std::getenv("FINSIGHT_VIRTUAL_FRAMES");
  REQUIRE_MESSAGE(folder, "run by tests/system/virtual_camera.py");
  std::vector<Image> result;
  for (int i = 0; fs::exists(fs::path(folder) / (std::to_string(i) + ".pgm")); ++i) {
    std::ifstream in(fs::path(folder) / (std::to_string(i) + ".pgm"), std::ios::binary);
    std::string magic, width, height, most;
    in >> magic >> width >> height >> most;
    in.get();
    Image image{std::vector<std::uint8_t>(kWidth * kHeight)};
    in.read(reinterpret_cast<char*>(image.grey.data()), kWidth * kHeight);
    REQUIRE(in);
    result.push_back(std::move(image));
  }
  return result;
}

/// Mean difference in grey levels.
double difference(const Frame& frame, const Image& image) {
  long sum = 0;
  for (int y = 0; y < kHeight; ++y) {
    for (int x = 0; x < kWidth; ++x)
      sum += std::abs(frame.grey[y * frame.stride_bytes + x] - image.grey[y * kWidth + x]);
  }
  return static_cast<double>(sum) / (kWidth * kHeight);
}

std::int64_t now_ns() { return steady_replay_clock().now_ns(); }

std::size_t open_files() {
  const auto files = fs::directory_iterator("/proc/self/fd");
  return static_cast<std::size_t>(std::distance(begin(files), end(files)));
}

long resident_kb() {
  std::ifstream in("/proc/self/status");
  for (std::string word; in >> word;) {
    if (word == "VmRSS:") {
      long kb = 0;
      in >> kb;
      return kb;
    }
  }
  return 0;
}

std::string refusal(const LiveCameraSettings& wrong) {
  try {
    open_libcamera(wrong, [](const std::string&) {});
  } catch (const InputError& error) {
    return error.what();
  }
  return "";
}

bool says(const std::string& text, const char* part) { return text.find(part) != std::string::npos; }

}  // namespace

TEST_SUITE("virtual camera" * doctest::skip(std::getenv("FINSIGHT_VIRTUAL_FRAMES") == nullptr)) {
  TEST_CASE("libcamera: every image of the camera comes, in its order and grey level for grey level") {
    const std::vector<Image> shown = images();
    REQUIRE(shown.size() >= 2);
    const auto camera = open_libcamera(settings(), [](const std::string&) {});
    std::set<std::size_t> seen;
    std::uint32_t last_sequence = 0;
    std::int64_t last_ns = 0;
    for (int k = 0; k < 100; ++k) {
      Frame frame;
      REQUIRE(camera->next(frame, kTimeoutMs));
      REQUIRE(frame.width_px == kWidth);
      REQUIRE(frame.height_px == kHeight);
      std::size_t best = 0;
      for (std::size_t i = 1; i < shown.size(); ++i) {
        if (difference(frame, shown[i]) < difference(frame, shown[best])) best = i;
      }
      REQUIRE(difference(frame, shown[best]) < 1);  // JPEG of quality 100
      seen.insert(best);
      if (k > 0) CHECK(frame.sequence > last_sequence);
      CHECK(frame.exposure_ns > last_ns);
      CHECK(frame.exposure_ns <= now_ns());
      CHECK(frame.exposure_ns > now_ns() - 1'000'000'000);
      last_sequence = frame.sequence;
      last_ns = frame.exposure_ns;
    }
    CHECK(seen.size() == shown.size());
    CHECK(!camera->ended());
    CHECK(camera->error() == "");
  }

  TEST_CASE("libcamera: a late caller gets a new frame, and the gap in the sequence shows the ones that it missed") {
    const auto camera = open_libcamera(settings(), [](const std::string&) {});
    Frame frame;
    REQUIRE(camera->next(frame, kTimeoutMs));
    const std::uint32_t first = frame.sequence;
    steady_replay_clock().sleep_until_ns(now_ns() + 200'000'000);
    REQUIRE(camera->next(frame, kTimeoutMs));
    CHECK(frame.sequence > first + 1);
  }

  TEST_CASE("libcamera: a name, mode or control that does not exist is refused, listing those that do") {
    LiveCameraSettings wrong = settings();
    wrong.name = "nobody";
    CHECK(says(refusal(wrong), "Finger0"));
    wrong = settings();
    wrong.width_px = 333;
    CHECK(says(refusal(wrong), "NV12"));
    wrong = settings();
    wrong.exposure_us = 1000;
    CHECK(says(refusal(wrong), "exposure_us"));
    wrong = settings();
    wrong.gain = 2;
    CHECK(says(refusal(wrong), "gain"));
  }

  TEST_CASE("libcamera: a camera that is kept open delivers, and so does a second one after it") {
    for (int i = 0; i < 2; ++i) {
      const auto camera = open_live_camera(settings(), [](const std::string&) {});
      Frame frame;
      CHECK(camera->next(frame, kTimeoutMs));
    }
  }

  TEST_CASE("libcamera: two thousand reopenings leak neither memory nor files") {
    // The sanitizer's allocator keeps growing for some hundreds of openings, by a few KB each.
    constexpr int kWarmUp = 1000, kReopenings = 2000;
    std::size_t files = 0;
    long memory_kb = 0;
    for (int i = 0; i < kReopenings; ++i) {
      const auto camera = open_libcamera(settings(), [](const std::string&) {});
      Frame frame;
      REQUIRE(camera->next(frame, kTimeoutMs));
      if (i == kWarmUp) files = open_files(), memory_kb = resident_kb();
      if (i == kReopenings - 1) {
        CHECK(open_files() <= files);
        const long more_kb = resident_kb() - memory_kb;
        MESSAGE(memory_kb << " KB resident after " << kWarmUp << " openings, " << more_kb << " KB more after "
                          << i + 1);
        CHECK(more_kb < 2500);
      }
    }
  }
}
