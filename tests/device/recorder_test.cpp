#include "firmware/device/recorder.h"

#include <doctest/doctest.h>
#include <sys/resource.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <csignal>
#include <fstream>
#include <mutex>
#include <thread>

#include "tests/model/scratch_folder.h"

using namespace finsight;

namespace {

SessionInfo info() {
  SessionInfo info;
  info.frames_per_second = 60;
  info.lens = {32, 16, 30, 30, 16, 8};
  info.marker_dictionary = "DICT_4X4_50";
  info.marker_id = {1, 2, 3};
  info.marker_size_mm = 8;
  return info;
}

/// What the recorder asks of the system.
struct Watch {
  std::mutex mutex;
  std::vector<std::string> synced, renamed_to;
} watch;
std::atomic<int> delay_of_writes_ms{0};

std::string name_of(int fd) {
  char name[4096];
  const ssize_t length = ::readlink(("/proc/self/fd/" + std::to_string(fd)).c_str(), name, sizeof name);
  return {name, static_cast<std::size_t>(std::max<ssize_t>(length, 0))};
}

}  // namespace

// The linker calls these instead of the system's (--wrap).
extern "C" {
ssize_t __real_write(int fd, const void* bytes, std::size_t count);
int __real_fsync(int fd);
int __real_rename(const char* from, const char* to);
ssize_t __wrap_write(int fd, const void* bytes, std::size_t count) {
  std::this_thread::sleep_for(std::chrono::milliseconds(delay_of_writes_ms));
  return __real_write(fd, bytes, count);
}
int __wrap_fsync(int fd) {
  const std::lock_guard lock(watch.mutex);
  watch.synced.push_back(name_of(fd));
  return __real_fsync(fd);
}
int __wrap_rename(const char* from, const char* to) {
  const std::lock_guard lock(watch.mutex);
  watch.renamed_to.emplace_back(to);
  return __real_rename(from, to);
}
}

namespace {

bool settles(const Recorder& recorder) {
  for (int i = 0; i < 2000 && !recorder.is_settled(); ++i) std::this_thread::sleep_for(std::chrono::milliseconds(5));
  return recorder.is_settled();
}

/// Frame n shows n everywhere and has a stride wider than its rows.
void add(Recorder& recorder, std::uint8_t n) {
  const std::vector<std::uint8_t> grey(40 * 16, n);
  RegisterImage image;
  image.words[2] = n;
  recorder.add(Frame{.grey = grey.data(), .width_px = 32, .height_px = 16, .stride_bytes = 40, .sequence = n}, image);
}

}  // namespace

TEST_CASE("recorder: a recording is a session that can be replayed, with the registers beside it") {
  const test::ScratchFolder folder;
  Recorder recorder(folder / "recordings", info());
  add(recorder, 1);  // nothing is recorded yet
  for (int recording = 1; recording <= 2; ++recording) {
    recorder.start();
    REQUIRE(settles(recorder));
    CHECK(recorder.state() == Recorder::State::kRecording);
    for (std::uint8_t n = 10; n < 15; ++n) add(recorder, n);
    CHECK(recorder.is_settled());  // the order is done, however long the frames take
    recorder.stop();
    REQUIRE(settles(recorder));
    CHECK(recorder.state() == Recorder::State::kIdle);
    const auto session = folder / "recordings" / ("session-000" + std::to_string(recording));
    const SessionInfo read = read_session_info(session);
    CHECK(read.lens == info().lens);
    CHECK(read.description.find("5 frames, 0 left out") != std::string::npos);
    Y4mReader images(session / kSessionFrames);
    std::vector<std::uint8_t> grey;
    for (std::uint8_t n = 10; n < 15; ++n) {
      REQUIRE(images.next(grey));
      CHECK(grey == std::vector<std::uint8_t>(32 * 16, n));
    }
    CHECK_FALSE(images.next(grey));
    std::ifstream registers(session / "registers.csv");
    std::string line;
    std::getline(registers, line);
    std::getline(registers, line);
    CHECK(line.starts_with("10,0,0,10,0,"));
  }
}

TEST_CASE("recorder: the end of the program finishes the recording") {
  const test::ScratchFolder folder;
  {
    Recorder recorder(folder.path(), info());
    recorder.start();
    REQUIRE(settles(recorder));
    add(recorder, 7);
  }
  CHECK(std::filesystem::exists(folder / "session-0001" / kSessionFrames));
  CHECK(std::filesystem::exists(folder / "session-0001" / kSessionInfo));
}

TEST_CASE("recorder: a folder that cannot be written is a failure, and the next attempt can succeed") {
  const test::ScratchFolder folder;
  folder.write("recordings", "a file");
  Recorder recorder(folder / "recordings", info());
  recorder.start();
  REQUIRE(settles(recorder));
  CHECK(recorder.state() == Recorder::State::kFailed);
  std::filesystem::remove(folder / "recordings");
  recorder.start();
  REQUIRE(settles(recorder));
  CHECK(recorder.state() == Recorder::State::kRecording);
}

TEST_CASE("recorder: when a recording is done, every file and its name are on the disk") {
  const test::ScratchFolder folder;
  Recorder recorder(folder / "recordings", info());
  recorder.start();
  REQUIRE(settles(recorder));
  add(recorder, 1);
  {
    const std::lock_guard lock(watch.mutex);
    watch.synced.clear();
    watch.renamed_to.clear();
  }
  recorder.stop();
  REQUIRE(settles(recorder));
  const std::lock_guard lock(watch.mutex);
  const auto is_synced = [&](const std::string& name) {
    return std::ranges::any_of(watch.synced, [&](const std::string& synced) { return synced.starts_with(name); });
  };
  const auto session = folder / "recordings" / "session-0001";
  for (const char* file : {kSessionFrames, kSessionInfo, "registers.csv"}) {
    CAPTURE(file);
    CHECK(is_synced((session / file).string()));
    CHECK(std::ranges::count(watch.renamed_to, (session / file).string()) == 1);
  }
  CHECK(watch.renamed_to.back() == (session / kSessionInfo).string());  // a folder that has it is complete
  CHECK(std::ranges::count(watch.synced, session.string()) >= 3);
  CHECK(watch.synced.back() == (folder / "recordings").string());
}

TEST_CASE("recorder: frames that a slow disk cannot take are left out and counted, the others are complete") {
  const test::ScratchFolder folder;
  SessionInfo large = info();  // larger than what is written at once
  large.lens.width_px = large.lens.height_px = 400;
  Recorder recorder(folder.path(), large);
  recorder.start();
  REQUIRE(settles(recorder));
  delay_of_writes_ms = 20;
  constexpr int kFrames = 60;
  const auto before = std::chrono::steady_clock::now();
  for (std::uint8_t n = 0; n < kFrames; ++n) {
    const std::vector<std::uint8_t> grey(400 * 400, n);
    RegisterImage image;
    image.words[2] = n;
    recorder.add(Frame{.grey = grey.data(), .width_px = 400, .height_px = 400, .stride_bytes = 400, .sequence = n},
                 image);
  }
  CHECK(std::chrono::steady_clock::now() - before < std::chrono::milliseconds(200));  // add() never waits
  recorder.stop();
  delay_of_writes_ms = 0;
  REQUIRE(settles(recorder));
  CHECK(recorder.state() == Recorder::State::kIdle);
  const auto session = folder / "session-0001";
  int kept = 0, left_out = 0;
  REQUIRE(std::sscanf(read_session_info(session).description.c_str(), "recorded by finsightd: %d frames, %d left out",
                      &kept, &left_out) == 2);
  CHECK(left_out > 0);
  CHECK(kept + left_out == kFrames);
  Y4mReader images(session / kSessionFrames);
  std::ifstream registers(session / "registers.csv");
  std::string line;
  std::getline(registers, line);
  std::vector<std::uint8_t> grey;
  for (int k = 0; k < kept; ++k) {
    REQUIRE(images.next(grey));
    REQUIRE(std::getline(registers, line));
    CHECK(line.starts_with(std::to_string(grey[0]) + ",0,0," + std::to_string(grey[0]) + ","));
    CHECK(std::ranges::count(grey, grey[0]) == 400 * 400);
  }
  CHECK_FALSE(images.next(grey));
}

TEST_CASE(
    "recorder: when the disk fails in mid-recording, the recording fails and is removed, and the next one can "
    "succeed") {
  const test::ScratchFolder folder;
  Recorder recorder(folder.path(), info());
  const auto record = [&](int frames) {
    recorder.start();
    REQUIRE(settles(recorder));
    CHECK(recorder.state() == Recorder::State::kRecording);
    for (int k = 0; k < frames && recorder.state() == Recorder::State::kRecording; ++k) {
      add(recorder, static_cast<std::uint8_t>(k));
      std::this_thread::sleep_for(std::chrono::milliseconds(1));
    }
  };
  // A limit on the file's size stands for a full disk.
  rlimit before{};
  getrlimit(RLIMIT_FSIZE, &before);
  const auto handler = std::signal(SIGXFSZ, SIG_IGN);
  const rlimit small{100'000, before.rlim_max};
  setrlimit(RLIMIT_FSIZE, &small);
  record(5000);
  CHECK(recorder.state() == Recorder::State::kFailed);
  setrlimit(RLIMIT_FSIZE, &before);
  std::signal(SIGXFSZ, handler);
  recorder.stop();  // of a recording that has failed: it stays failed
  REQUIRE(settles(recorder));
  CHECK(recorder.state() == Recorder::State::kFailed);
  CHECK(std::filesystem::is_empty(folder.path()));
  record(3);
  recorder.stop();
  REQUIRE(settles(recorder));
  CHECK(recorder.state() == Recorder::State::kIdle);
  CHECK(std::filesystem::exists(folder / "session-0001" / kSessionInfo));
}
