#include "firmware/device/recorder.h"

#include <doctest/doctest.h>

#include <chrono>
#include <fstream>
#include <thread>

#include "tests/model/scratch_folder.h"

using namespace finsight;

namespace {

SessionInfo info() {
  SessionInfo info;
  info.width_px = 32;
  info.height_px = 16;
  info.frames_per_second = 60;
  info.fx_fy_cx_cy = {30, 30, 16, 8};
  info.marker_dictionary = "DICT_4X4_50";
  info.marker_id = {1, 2, 3};
  info.marker_size_mm = 8;
  return info;
}

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
    CHECK(recorder.is_settled());  // the order is carried out, however long the frames take
    recorder.stop();
    REQUIRE(settles(recorder));
    CHECK(recorder.state() == Recorder::State::kIdle);
    const auto session = folder / "recordings" / ("session-000" + std::to_string(recording));
    const SessionInfo read = read_session_info(session);
    CHECK(read.fx_fy_cx_cy == info().fx_fy_cx_cy);
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

TEST_CASE("recorder: the end of the program ends the recording") {
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

TEST_CASE("recorder: a place that cannot be written is a failure, and the next try may succeed") {
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
