#include "firmware/device/recorder.h"

#include <doctest/doctest.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <csignal>
#include <fstream>
#include <mutex>
#include <thread>

#include "firmware/ports/camera.h"
#include "tests/device/open_file.h"
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

constexpr Recorder::Limits kNoLimits = {.longest_s = 100'000, .reserve_mb = 0};

/// What the recorder asks of the system.
struct Watch {
  std::mutex mutex;
  std::vector<std::string> synced, renamed_to;
} watch;
std::atomic<int> delay_of_writes_ms{0};

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
  watch.synced.push_back(test::path_of(fd));
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
  Recorder recorder(folder / "recordings", info(), kNoLimits);
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
    Recorder recorder(folder.path(), info(), kNoLimits);
    recorder.start();
    REQUIRE(settles(recorder));
    add(recorder, 7);
  }
  CHECK(std::filesystem::exists(folder / "session-0001" / kSessionFrames));
  CHECK(read_session_info(folder / "session-0001").complete);
}

TEST_CASE("recorder: a folder that cannot be written is a failure, and the next attempt can succeed") {
  const test::ScratchFolder folder;
  folder.write("recordings", "a file");
  Recorder recorder(folder / "recordings", info(), kNoLimits);
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
  Recorder recorder(folder / "recordings", info(), kNoLimits);
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
  }
  CHECK(watch.renamed_to.back() == (session / kSessionInfo).string());  // says that the recording is complete
  CHECK(watch.synced.front() == (session / kSessionFrames).string());   // ... so it comes after the frames
  CHECK(watch.synced.back() == (folder / "recordings").string());
}

TEST_CASE("recorder: frames that a slow disk cannot take are left out and counted, the others are complete") {
  const test::ScratchFolder folder;
  SessionInfo large = info();  // larger than what is written at once
  large.lens.width_px = large.lens.height_px = 400;
  large.lens.fx = large.lens.fy = 400;
  Recorder recorder(folder.path(), large, kNoLimits);
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

namespace {

/// The frames that a replay of the session delivers; each must be whole.
int replayed_frames(const std::filesystem::path& session) {
  ReplaySettings replay;
  replay.path = session;
  replay.recorded_speed = false;
  const auto camera = open_session_camera(replay, read_session_info(replay.path));
  int frames = 0;
  for (Frame frame; camera->next(frame, 0); ++frames) {
    const std::vector<std::uint8_t> grey(frame.grey, frame.grey + frame.width_px * frame.height_px);
    CHECK(std::ranges::count(grey, grey[0]) == frame.width_px * frame.height_px);
  }
  CHECK(camera->error() == "");
  return frames;
}

}  // namespace

TEST_CASE("recorder: what a kill leaves can be replayed up to the last whole frame") {
  const test::ScratchFolder folder;
  const auto session = folder / "session-0001";
  const pid_t child = fork();
  if (child == 0) {
    Recorder recorder(folder.path(), info(), kNoLimits);
    recorder.start();
    settles(recorder);
    for (std::uint8_t n = 0; n < 20; ++n) {
      add(recorder, n);
      std::this_thread::sleep_for(std::chrono::milliseconds(5));
    }
    std::this_thread::sleep_for(std::chrono::milliseconds(200));
    kill(getpid(), SIGKILL);
  }
  int status = 0;
  waitpid(child, &status, 0);
  REQUIRE(WIFSIGNALED(status));
  CHECK_FALSE(read_session_info(session).complete);
  CHECK(replayed_frames(session) == 20);
  std::filesystem::resize_file(session / kSessionFrames, std::filesystem::file_size(session / kSessionFrames) - 3);
  CHECK(replayed_frames(session) == 19);  // cut within a frame's pixels
  std::filesystem::resize_file(session / kSessionFrames,
                               std::filesystem::file_size(session / kSessionFrames) - (6 + 32 * 16 - 3) + 2);
  CHECK(replayed_frames(session) == 19);  // cut within the line before them
}

TEST_CASE("recorder: a recording ends by itself, complete, at its greatest length and at the disk's reserve") {
  const test::ScratchFolder folder;
  for (const Recorder::Limits limits : {Recorder::Limits{.longest_s = 1, .reserve_mb = 0},
                                        Recorder::Limits{.longest_s = 100, .reserve_mb = 1'000'000'000}}) {
    Recorder recorder(folder.path(), info(), limits);
    CHECK((recorder.mb_left() == 0) == (limits.reserve_mb > 0));
    recorder.start();
    REQUIRE(settles(recorder));
    for (int n = 0; n < 90 && recorder.state() == Recorder::State::kRecording; ++n) {
      add(recorder, static_cast<std::uint8_t>(n));
      std::this_thread::sleep_for(std::chrono::milliseconds(2));
    }
    CHECK(recorder.state() == Recorder::State::kFull);
    CHECK(recorder.seconds() == (limits.reserve_mb > 0 ? 0 : 1));
    recorder.stop();
    REQUIRE(settles(recorder));
    CHECK(recorder.state() == Recorder::State::kFull);
  }
  CHECK(read_session_info(folder / "session-0001").complete);
  CHECK(replayed_frames(folder / "session-0001") == 60);
  CHECK(replayed_frames(folder / "session-0002") == 1);
}

TEST_CASE(
    "recorder: when the disk fails in mid-recording, the recording fails, what was written can be replayed, and the "
    "next one can succeed") {
  const test::ScratchFolder folder;
  Recorder recorder(folder.path(), info(), kNoLimits);
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
  CHECK_FALSE(read_session_info(folder / "session-0001").complete);
  CHECK(replayed_frames(folder / "session-0001") == 192);  // of 32 x 16 pixels in 100,000 bytes
  record(3);
  recorder.stop();
  REQUIRE(settles(recorder));
  CHECK(recorder.state() == Recorder::State::kIdle);
  CHECK(read_session_info(folder / "session-0002").complete);
}
