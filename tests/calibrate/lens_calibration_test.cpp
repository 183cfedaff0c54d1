#include "firmware/calibrate/lens_calibration.h"

#include <doctest/doctest.h>

#include "firmware/input_error.h"
#include "firmware/settings/settings.h"
#include "hostgen/calibrate/calibration_report.h"
#include "tests/calibrate/board_painter.h"
#include "tests/model/scratch_folder.h"
#include "tests/random.h"

using namespace finsight;
using namespace finsight::host;

namespace {

const Lens kCamera = test::calibrated_camera();
const CharucoBoard kBoard;

/// What is seen of the board from a pose, without images: exact corners with noise.
BoardView seen_from(const Eigen::Isometry3d& T_camera_board, test::Random& random, double noise_px = 0.05) {
  BoardView view;
  view.name = "view";
  view.width_px = kCamera.width_px;
  view.height_px = kCamera.height_px;
  for (int id = 0; id < kBoard.corners(); ++id) {
    const Eigen::Vector2d on_board = kBoard.corner(id);
    const Eigen::Vector3d place = T_camera_board * Eigen::Vector3d(on_board.x(), on_board.y(), 0);
    const Eigen::Vector2d ray = place.head<2>() / place.z();
    const Eigen::Vector2d at = pixel_from_ray(kCamera, ray);
    const bool inside = at.minCoeff() > 5 && at.x() < kCamera.width_px - 6 && at.y() < kCamera.height_px - 6;
    if (!inside || (ray_from_pixel(kCamera, at) - ray).norm() > 1e-3) continue;
    view.sight.id.push_back(id);
    const Eigen::Vector2d off(noise_px * random.normal(), noise_px * random.normal());
    view.sight.corner_px.push_back((at + off).cast<float>());
  }
  return view;
}

std::vector<BoardView> good_sights(std::uint64_t seed) {
  test::Random random(seed);
  std::vector<BoardView> views;
  for (const Eigen::Isometry3d& pose : test::good_views(kCamera)) views.push_back(seen_from(pose, random));
  return views;
}

/// The lens from good_sights(1), and these views with what the calibration adds.
struct Calibrated {
  std::vector<BoardView> views = good_sights(1);
  LensCalibration calibration = calibrate_lens(kBoard, views, "views");
};
const Calibrated& calibrated() {
  static const Calibrated once;
  return once;
}

std::string refusal(std::vector<BoardView>& views) {
  try {
    calibrate_lens(kBoard, views, "images");
  } catch (const InputError& error) {
    return error.what();
  }
  return "accepted";
}

bool says(const std::string& text, const std::string& part) { return text.find(part) != std::string::npos; }

}  // namespace

TEST_CASE("lens calibration: images of a board give the lens that drew them, within the standard deviations") {
  const test::BoardPainter painter(kCamera);
  BoardFinder finder(kBoard);
  std::vector<BoardView> views;
  for (const Eigen::Isometry3d& pose : test::good_views(kCamera)) {
    BoardView view;
    view.name = std::to_string(views.size());
    view.width_px = kCamera.width_px;
    view.height_px = kCamera.height_px;
    view.sight = finder.find(painter.paint(pose, views.size()).view());
    views.push_back(view);
  }
  reject_bad_views(kBoard, views);
  const LensCalibration calibration = calibrate_lens(kBoard, views, "images");
  MESSAGE(calibration_text(calibration, coverage_of(calibration, views)));
  CHECK(calibration.views == 15);
  CHECK(calibration.rms_px < 0.08);
  const LensNumbers found = lens_numbers(calibration.lens), truth = lens_numbers(kCamera);
  for (std::size_t i = 0; i < kLensNumbers; ++i) {
    CAPTURE(kLensNames[i]);
    CHECK(std::abs(found[i] - truth[i]) < 5 * calibration.sigma[i]);
  }
  CHECK(calibration.sigma[0] < 1);
  // What counts: where the lens sees what, over all of the image.
  double worst_px = 0;
  for (int y = 10; y < 480; y += 20) {
    for (int x = 10; x < 640; x += 20) {
      const Eigen::Vector2d at(x, y);
      worst_px = std::max(worst_px, (pixel_from_ray(calibration.lens, ray_from_pixel(kCamera, at)) - at).norm());
    }
  }
  MESSAGE("farthest pixel: " << worst_px);
  CHECK(worst_px < 0.6);
}

TEST_CASE("lens calibration: the standard deviations are those of the numbers") {
  constexpr int kTimes = 6;
  std::array<double, kLensNumbers> squares{};
  for (int i = 0; i < kTimes; ++i) {
    std::vector<BoardView> views = good_sights(static_cast<std::uint64_t>(100 + i));
    const LensCalibration calibration = calibrate_lens(kBoard, views, "views");
    for (std::size_t n = 0; n < kLensNumbers; ++n) {
      const double error = lens_numbers(calibration.lens)[n] - lens_numbers(kCamera)[n];
      squares[n] += std::pow(error / calibration.sigma[n], 2) / kTimes;
    }
  }
  for (std::size_t n = 0; n < kLensNumbers; ++n) {
    CAPTURE(kLensNames[n]);
    CHECK(squares[n] > 0.15);  // of six errors in units of their deviation, 1 on average
    CHECK(squares[n] < 3);
  }
}

TEST_CASE("lens calibration: a view that the others do not explain is rejected, and the rest is as without it") {
  std::vector<BoardView> views = good_sights(1), without = good_sights(1);
  without.erase(without.begin() + 4);
  for (std::size_t i = 0; i < views[4].sight.corner_px.size(); ++i) {  // a bent board
    const float bend = 3 * std::sin(static_cast<float>(i));
    views[4].sight.corner_px[i] += Vec2f(bend, -bend);
  }
  const LensCalibration calibration = calibrate_lens(kBoard, views, "views");
  CHECK(says(views[4].rejected, "outlier: corners"));
  CHECK(calibration.views == 14);
  CHECK(calibration.lens == calibrate_lens(kBoard, without, "views").lens);
}

TEST_CASE("lens calibration: a single bad corner costs itself, not its view") {
  std::vector<BoardView> views = good_sights(1);
  const std::size_t corners = views[4].sight.id.size();
  views[4].sight.corner_px[7].x() += 2;
  const LensCalibration calibration = calibrate_lens(kBoard, views, "views");
  CHECK(calibration.views == 15);
  CHECK(views[4].sight.id.size() == corners - 1);
  CHECK(calibration.rms_px < 0.08);
}

TEST_CASE("lens calibration: views that do not determine a lens are refused") {
  test::Random random(3);
  std::vector<BoardView> views;
  CHECK(says(refusal(views), "images: usable images: found 0 of 0, expected at least 6"));
  for (int i = 0; i < 8; ++i) {  // far, small, and all face-on
    views.push_back(seen_from(test::board_at(kCamera, 0.45 + 0.01 * i, 0.5, 0, 0, 60), random));
  }
  CHECK(says(refusal(views), "images: "));
  views = good_sights(1);
  for (std::size_t i = 0; i < 10; ++i) views[i].rejected = "blurred";
  CHECK(says(refusal(views), "found 5 of 15, expected at least 6"));
}

TEST_CASE("lens calibration: corners that no lens explains, and a board that was never tilted, are refused") {
  test::Random random(4);
  std::vector<BoardView> views;
  for (const Eigen::Isometry3d& pose : test::good_views(kCamera)) views.push_back(seen_from(pose, random, 4));
  CHECK(says(refusal(views), "pixels from the best lens"));
  views.clear();
  for (int i = 0; i < 12; ++i) {
    views.push_back(seen_from(test::board_at(kCamera, 0.3 + 0.03 * i, 0.4 + 0.02 * (i % 5), 3, -3, 9 + i), random));
  }
  CHECK(says(refusal(views), "tilt"));
}

TEST_CASE("lens calibration: coverage counts ninths of the image and tilts, and the advice says what is missing") {
  std::vector<BoardView> views = calibrated().views;
  const LensCalibration calibration = calibrated().calibration;
  CHECK(advice(coverage_of(calibration, views)).empty());

  // Only views to the upper right, with the lower or the right side nearer.
  for (BoardView& view : views) {
    const Eigen::Vector3d into = view.T_camera_board.linear().col(2);
    if (into.x() < -0.2 || into.y() < -0.2) view.rejected = "left out";
    std::erase_if(view.sight.corner_px, [](const Vec2f& at) { return at.x() < 214 && at.y() > 320; });
  }
  const Coverage coverage = coverage_of(calibration, views);
  CHECK(coverage.views[6] == 0);
  CHECK(coverage.tilted[0] == 0);
  CHECK(coverage.tilted[2] == 0);
  CHECK(coverage.tilted[1] >= 2);
  CHECK(coverage.tilted[3] >= 2);
  const std::vector<std::string> lines = advice(coverage);
  REQUIRE(lines.size() >= 2);
  CHECK(says(lines[0], "show the board in the lower left, tilted so that its left side is nearer"));
  CHECK(says(lines[1], "upper side is nearer"));

  const std::string shown = view_table(views) + calibration_text(calibration, coverage);
  CHECK(says(shown, "rejected: left out"));
  CHECK(says(shown, "to do better:\n  show the board in the lower left"));

  LensCalibration folding = calibration;
  folding.lens.k2 = 0;
  folding.lens.k3 = 0;
  folding.lens.k1 = -0.45;  // without the higher coefficients it turns back before the corners
  const Coverage folded = coverage_of(folding, views);
  CHECK(folded.no_lens.size() == 4);
  CHECK(
      says(calibration_text(folding, folded), "cannot be measured: upper left, upper right, lower left, lower right"));
}

TEST_CASE("lens calibration: a tilt is counted for the side that is nearer") {
  LensCalibration calibration;
  calibration.lens.width_px = 640;
  calibration.lens.height_px = 480;
  const std::array<std::array<double, 2>, 4> tilts = {{{0, -20}, {0, 20}, {-20, 0}, {20, 0}}};
  for (std::size_t side = 0; side < 4; ++side) {
    std::vector<BoardView> views(1);
    views[0].T_camera_board = test::board_at(kCamera, 0.5, 0.5, tilts[side][0], tilts[side][1], 13, 90);
    const double z_at[4] = {(views[0].T_camera_board * Eigen::Vector3d(5, 7, 0)).z(),
                            (views[0].T_camera_board * Eigen::Vector3d(5, 0, 0)).z(),
                            (views[0].T_camera_board * Eigen::Vector3d(0, 3.5, 0)).z(),
                            (views[0].T_camera_board * Eigen::Vector3d(10, 3.5, 0)).z()};
    // Rolled by a right angle, the board's own lower side is the left one in the image, and so on.
    CHECK(std::min_element(z_at, z_at + 4) - z_at == static_cast<std::ptrdiff_t>(side));
    const Coverage coverage = coverage_of(calibration, views);
    for (std::size_t other = 0; other < 4; ++other) CHECK(coverage.tilted[other] == (other == side ? 1 : 0));
  }
}

TEST_CASE("lens calibration: its file is what a board file takes, for this image size only") {
  const LensCalibration calibration = calibrated().calibration;
  const test::ScratchFolder folder;
  folder.write("lens.toml", lens_file(calibration, "images\nof mine"));
  const auto board = [&](const std::string& size, const std::string& more) {
    return folder.write("board.toml", "pack = \"p\"\n[source]\nkind = \"camera\"\n" + size +
                                          "frames_per_second = 60\n" + more + "[modbus]\n");
  };
  const std::string text = lens_file(calibration, "images");
  CHECK(text.substr(text.find("k1_k2")).size() < 80);  // decimals that mean something
  const std::string vga = "width_px = 640\nheight_px = 480\n";
  const Lens named = read_settings(board(vga, "lens = \"lens.toml\"\n")).lens;
  CHECK(named.fx == doctest::Approx(calibration.lens.fx).epsilon(1e-5));
  CHECK(named.k3 == doctest::Approx(calibration.lens.k3).epsilon(1e-4));
  const Lens pasted = read_settings(board(vga, "[source.lens]\n" + lens_file(calibration, "images"))).lens;
  CHECK(pasted.cy == named.cy);
  CHECK_THROWS_WITH_AS(read_settings(board("width_px = 1280\nheight_px = 480\n", "lens = \"lens.toml\"\n")),
                       doctest::Contains("lens.toml:5: width_px: found 640, expected 1280, the size of the images"),
                       InputError);
  CHECK_THROWS_WITH_AS(read_settings(board(vga, "lens = \"none.toml\"\n")),
                       doctest::Contains("none.toml: no such file"), InputError);
  CHECK_THROWS_WITH_AS(read_settings(board(vga, "lens = 7\n")),
                       doctest::Contains("source.lens: found 7, expected a table"), InputError);
  // What a device's owner says takes the place of the board's.
  const auto user = folder.write("finsight.toml", "[source]\nlens = \"lens.toml\"\n");
  const std::string own = "[source.lens]\nfx_fy_cx_cy = [1, 1, 1, 1]\nk1_k2_p1_p2_k3 = [0, 0, 0, 0, 0]\n";
  CHECK(read_settings({board(vga, own), user}).lens.fx == named.fx);
}
