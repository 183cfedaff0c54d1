#include "hostgen/fit/session_touches.h"

#include <doctest/doctest.h>

#include "firmware/input_error.h"
#include "firmware/ports/session.h"
#include "firmware/settings/atomic_file.h"
#include "tests/loop/feeder.h"
#include "tests/model/scratch_folder.h"

using namespace finsight;
using namespace finsight::host;

namespace {

/// Of a finger that begins as it is in `first` and is touched then.
std::filesystem::path session(const test::ScratchFolder& folder, const char* name, const PlatePoses& first) {
  const Lens camera = test::camera_640x480();
  const std::filesystem::path path = folder.path() / name;
  std::filesystem::create_directories(path);
  Y4mWriter writer(path / kSessionFrames, camera.width_px, camera.height_px, 60);
  const test::Images resting(camera, first), touching(camera, test::touched());
  for (int frame = 0; frame < Zeroing::kFrames + 6; ++frame) writer.write(resting.next().grey);
  for (int frame = 0; frame < 6; ++frame) writer.write(touching.next().grey);
  writer.finish();
  const MountModel& mount = test::model().mount;
  const SessionInfo info{.lens = camera,
                         .frames_per_second = 60,
                         .marker_dictionary = "DICT_4X4_50",
                         .marker_id = mount.marker_id,
                         .marker_size_mm = static_cast<double>(mount.marker_size_mm),
                         .description = "a touch"};
  write_file_atomically(path / kSessionInfo, session_info_toml(info));
  return path;
}

float motion_mm(const SessionTouches& touches) { return touches.readings.back().plate_motion_mm; }

}  // namespace

TEST_CASE("session touches: what an earlier touch has left in the finger is not taken for its rest, unless it is far") {
  const test::ScratchFolder folder;
  const std::filesystem::path untouched = session(folder, "first", test::touched(0)),
                              again = session(folder, "again", test::touched(0.1F));
  const SessionTouches first = session_touches(untouched, test::model(), {}, std::nullopt);
  const SessionTouches own = session_touches(again, test::model(), {}, std::nullopt);
  const SessionTouches shared = session_touches(again, test::model(), {}, first.zero);
  CHECK(motion_mm(shared) == doctest::Approx(motion_mm(first)).epsilon(0.01));
  CHECK(motion_mm(own) < 0.93F * motion_mm(first));
  CHECK(first.left_mm == 0);
  CHECK(shared.left_mm == doctest::Approx(0.52).epsilon(0.1));
  const SessionTouches far = session_touches(again, test::model(), {}, first.zero, 0.1F);
  CHECK(motion_mm(far) == motion_mm(own));
}

TEST_CASE("session touches: what takes its time does so by the recording's clock, however fast it is read") {
  const test::ScratchFolder folder;
  const std::filesystem::path path = session(folder, "first", test::touched(0));
  LoopSettings creeping;
  creeping.fit.emplace();
  const double elastic_n = session_touches(path, test::model(), creeping, std::nullopt).readings.back().force_n;
  creeping.fit->creep_share = 1;
  creeping.fit->creep_s = 0.05F;
  const double late_n = session_touches(path, test::model(), creeping, std::nullopt).readings.back().force_n;
  // Six frames of 1/60 s with a time constant of 0.05 s / 2: all but a fiftieth of the creep is over.
  CHECK(late_n == doctest::Approx(elastic_n / 2).epsilon(0.1));
}

TEST_CASE("session touches: a recording that begins with a touch is refused by its name") {
  const test::ScratchFolder folder;
  CHECK_THROWS_WITH_AS(session_touches(session(folder, "pressed", test::touched()), test::model(), {}, std::nullopt),
                       doctest::Contains("pressed: does not begin with an untouched finger"), InputError);
}
