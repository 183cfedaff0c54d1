// board_session FOLDER: writes a session in which a camera of a known lens is shown the calibration board in fifteen
// positions, three seconds each; its own session.toml names another lens. For page_attacks.py.
#include <cstdio>
#include <filesystem>
#include <string>

#include "firmware/ports/session.h"
#include "firmware/settings/atomic_file.h"
#include "tests/calibrate/board_painter.h"
#include "tests/random.h"

using namespace finsight;

namespace {

constexpr int kFramesPerSecond = 10, kSecondsPerView = 3;

void write_session(const std::filesystem::path& folder) {
  const Lens camera = test::calibrated_camera();
  std::filesystem::create_directories(folder);
  Y4mWriter writer(folder / kSessionFrames, camera.width_px, camera.height_px, kFramesPerSecond);
  const test::BoardPainter painter(camera);
  test::Random random(1);
  std::uint64_t seed = 0;
  for (const Eigen::Isometry3d& view : test::good_views(camera)) {
    GreyImage image = painter.paint(view, ++seed);
    for (int frame = 0; frame < kFramesPerSecond * kSecondsPerView; ++frame) {
      // A camera that gives the same bytes again counts as frozen.
      for (std::size_t i = 0; i < image.grey.size(); i += 97) {
        image.grey[i] = static_cast<std::uint8_t>(image.grey[i] ^ (random.uniform() < 0.5));
      }
      writer.write(image.grey.data());
    }
  }
  writer.finish();
  const SessionInfo info{.lens = {640, 480, 457, 457, 319.5, 239.5, 0, 0, 0, 0, 0},
                         .frames_per_second = kFramesPerSecond,
                         .marker_dictionary = "DICT_4X4_50",
                         .marker_id = {0, 1, 2},
                         .marker_size_mm = 8,
                         .description = "the calibration board in fifteen positions"};
  write_file_atomically(folder / kSessionInfo, session_info_toml(info));
}

}  // namespace

int main(int argc, char** argv) {
  if (argc != 2) {
    std::fputs("usage: board_session FOLDER\n", stderr);
    return 2;
  }
  try {
    write_session(argv[1]);
  } catch (const std::exception& error) {
    std::fprintf(stderr, "board_session: %s\n", error.what());
    return 1;
  }
}
