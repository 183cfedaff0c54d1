#include <doctest/doctest.h>
#include <unistd.h>

#include <fstream>

#include "firmware/input_error.h"
#include "firmware/ports/camera.h"

using namespace finsight;
namespace fs = std::filesystem;

namespace {

constexpr std::int64_t kMs = 1'000'000;
constexpr int kFrames = 5;

/// Time that passes only while the caller sleeps or works.
struct Time {
  std::int64_t now_ns = 1000 * kMs;
  ReplayClock clock() {
    return {.now_ns = [this] { return now_ns; },
            .sleep_until_ns = [this](std::int64_t until_ns) { now_ns = std::max(now_ns, until_ns); }};
  }
};

/// A session of five tiny frames at 50 per second (20 ms each); every pixel of frame k is k.
struct Session {
  fs::path path = fs::temp_directory_path() / ("finsight_replay_" + std::to_string(getpid()));
  SessionInfo info{.lens = {4, 2, 3, 3, 2, 1},
                   .frames_per_second = 50,
                   .marker_dictionary = "DICT_4X4_50",
                   .marker_id = {0, 1, 2},
                   .marker_size_mm = 8,
                   .description = ""};
  Session() {
    fs::create_directories(path);
    write_info();
    Y4mWriter writer(path / kSessionFrames, 4, 2, 50);
    for (std::uint8_t k = 0; k < kFrames; ++k) writer.write(std::vector<std::uint8_t>(8, k).data());
    writer.finish();
  }
  ~Session() { fs::remove_all(path); }
  void write_info() const { std::ofstream(path / kSessionInfo) << session_info_toml(info); }
  ReplaySettings settings(Time& time) const { return {.path = path, .recording = "", .clock = time.clock()}; }
};

std::unique_ptr<Camera> open(const ReplaySettings& settings) {
  return open_session_camera(settings, read_session_info(settings.path));
}

}  // namespace

TEST_CASE("replay: at recorded speed frame k comes k periods after the first call, stamped with that time") {
  const Session session;
  Time time;
  const auto camera = open(session.settings(time));
  time.now_ns += 7000 * kMs;  // the model's self-test; the recording must not start before it is asked for
  const std::int64_t start_ns = time.now_ns;
  for (std::uint32_t k = 0; k < kFrames; ++k) {
    Frame frame;
    REQUIRE(camera->next(frame, 100));
    CHECK(time.now_ns == start_ns + k * 20 * kMs);
    CHECK(frame.exposure_ns == time.now_ns);
    CHECK(frame.sequence == k);
    CHECK(frame.width_px == 4);
    CHECK(frame.height_px == 2);
    CHECK(frame.stride_bytes == 4);
    REQUIRE(frame.grey != nullptr);
    CHECK(frame.grey[7] == k);
    time.now_ns += 15 * kMs;  // the loop's work, within the period
  }
  Frame frame;
  CHECK_FALSE(camera->next(frame, 100));
  CHECK(camera->ended());
  CHECK(camera->error().empty());
}

TEST_CASE("replay: a late caller gets the newest frame, and the sequence shows what it missed") {
  const Session session;
  Time time;
  const auto camera = open(session.settings(time));
  Frame frame;
  REQUIRE(camera->next(frame, 100));
  const std::int64_t start_ns = time.now_ns;
  time.now_ns += 65 * kMs;  // frames 1, 2 and 3 are exposed in this time
  REQUIRE(camera->next(frame, 100));
  CHECK(frame.sequence == 3);
  CHECK(frame.grey[0] == 3);
  CHECK(frame.exposure_ns == start_ns + 60 * kMs);
  CHECK(time.now_ns == start_ns + 65 * kMs);  // it did not have to wait
  REQUIRE(camera->next(frame, 100));
  CHECK(frame.sequence == 4);
}

TEST_CASE("replay: when the wait exceeds the time-out there is no frame, and the frame comes later") {
  const Session session;
  Time time;
  const auto camera = open(session.settings(time));
  Frame frame;
  REQUIRE(camera->next(frame, 0));
  const std::int64_t start_ns = time.now_ns;
  CHECK_FALSE(camera->next(frame, 0));
  CHECK_FALSE(camera->next(frame, 15));
  CHECK(time.now_ns == start_ns + 15 * kMs);
  CHECK_FALSE(camera->ended());
  REQUIRE(camera->next(frame, 15));
  CHECK(frame.sequence == 1);
  CHECK(frame.exposure_ns == start_ns + 20 * kMs);
}

TEST_CASE("replay: a repeated session continues its sequence, also when the caller sleeps past its end") {
  const Session session;
  Time time;
  ReplaySettings settings = session.settings(time);
  settings.repeat = true;
  const auto camera = open(settings);
  for (std::uint32_t k = 0; k < 3 * kFrames; ++k) {
    Frame frame;
    REQUIRE(camera->next(frame, 100));
    CHECK(frame.sequence == k);
    CHECK(frame.grey[0] == k % kFrames);
  }
  time.now_ns += 1000 * kMs;
  Frame frame;
  REQUIRE(camera->next(frame, 100));
  CHECK(frame.sequence == 14 + 50);
  CHECK(frame.grey[0] == (14 + 50) % kFrames);
  CHECK_FALSE(camera->ended());
}

TEST_CASE("replay: at full speed every frame comes, however late, exposed now") {
  const Session session;
  Time time;
  ReplaySettings settings = session.settings(time);
  settings.recorded_speed = false;
  const auto camera = open(settings);
  Frame frame;
  for (std::uint32_t k = 0; k < kFrames; ++k) {
    REQUIRE(camera->next(frame, 0));
    CHECK(frame.sequence == k);
    CHECK(frame.exposure_ns == time.now_ns);
    time.now_ns += 500 * kMs;
  }
  CHECK_FALSE(camera->next(frame, 0));
  CHECK(camera->ended());
}

TEST_CASE("replay: sessions that contradict themselves or have no frame are refused on opening") {
  Session session;
  Time time;
  const auto refused = [&] { CHECK_THROWS_AS(open(session.settings(time)), InputError); };
  const SessionInfo good = session.info;
  session.info.lens.width_px = 5;
  session.write_info();
  refused();
  session.info = good;
  session.info.frames_per_second = 60;
  session.write_info();
  refused();
  session.info = good;
  session.write_info();
  CHECK_NOTHROW(open(session.settings(time)));
  std::ofstream(session.path / kSessionFrames) << "YUV4MPEG2 W4 H2 F50:1 Ip A1:1 Cmono\n";
  refused();
  std::ofstream(session.path / kSessionFrames) << "YUV4MPEG2 W4 H2 F50:1 Ip A1:1 Cmono\nFRAME\n1234567";
  refused();
  fs::remove(session.path / kSessionFrames);
  refused();
}

TEST_CASE("replay: a recording that breaks off ends with an error and without an exception") {
  const Session session;
  const fs::path file = session.path / kSessionFrames;
  fs::resize_file(file, fs::file_size(file) - 3);
  for (const bool late : {false, true}) {  // the cut frame is read, or passed on the way to a later one
    CAPTURE(late);
    Time time;
    ReplaySettings settings = session.settings(time);
    settings.repeat = true;
    const auto camera = open(settings);
    Frame frame;
    for (int k = 0; k < kFrames - 1; ++k) REQUIRE(camera->next(frame, 100));
    CHECK(camera->error().empty());
    if (late) time.now_ns += 200 * kMs;
    CHECK_FALSE(camera->next(frame, 100));
    CHECK(camera->ended());
    CHECK(camera->error().find("frame 4 at byte") != std::string::npos);
    CHECK_FALSE(camera->next(frame, 100));
  }
}

TEST_CASE("replay: a file that is emptied while it repeats is an error, not an endless loop") {
  const Session session;
  Time time;
  ReplaySettings settings = session.settings(time);
  settings.repeat = true;
  settings.recorded_speed = false;
  const auto camera = open(settings);
  Frame frame;
  REQUIRE(camera->next(frame, 0));
  std::ofstream(session.path / kSessionFrames, std::ios::trunc) << "";
  for (int k = 0; k < 10 && !camera->ended(); ++k) camera->next(frame, 0);
  CHECK(camera->ended());
}

TEST_CASE("replay: recorded plate motions become poses at 60 per second with only the top plate seen") {
  const fs::path file = fs::temp_directory_path() / ("finsight_poses_" + std::to_string(getpid()) + ".csv");
  std::ofstream(file) << "recording,frame,marker_tx_mm,marker_ty_mm,marker_tz_mm,marker_qx,marker_qy,marker_qz,"
                         "marker_qw,touch_x_mm,touch_y_mm,touch_z_mm,surface_node\n"
                         "a,0,0,0,0,0,0,0,1,0,0,0,1\n"
                         "a,1,1,0,0,0,0,0,1,0,0,0,1\n"
                         "b,0,9,0,0,0,0,0,1,0,0,0,1\n";
  Time time;
  const std::int64_t start_ns = time.now_ns;
  const auto camera =
      open_pose_replay({.path = file, .recording = "a", .recorded_speed = true, .repeat = true, .clock = time.clock()});
  for (std::uint32_t k = 0; k < 5; ++k) {
    Observation seen;
    REQUIRE(camera->next(seen, 100));
    CHECK(seen.sequence == k);
    CHECK(seen.poses.seen_count() == 1);
    CHECK(seen.poses.plates[kTopPlate].displacement_mm.z() == static_cast<float>(k % 2));
    CHECK(seen.exposure_ns == start_ns + (k * 1'000'000'000LL + 30) / 60);
  }
  CHECK_THROWS_AS(open_pose_replay({.path = file, .recording = "c"}), InputError);
  fs::remove(file);
}
