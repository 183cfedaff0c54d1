#include "firmware/calibrate/charuco_board.h"

#include <doctest/doctest.h>

#include <opencv2/core.hpp>
#if CV_VERSION_MAJOR == 4 && CV_VERSION_MINOR <= 6
#include <opencv2/aruco/charuco.hpp>
#else
#include <opencv2/objdetect/charuco_detector.hpp>
#endif

#include "firmware/input_error.h"
#include "hostgen/calibrate/board_png.h"
#include "hostgen/calibrate/grey_image.h"
#include "tests/calibrate/board_painter.h"
#include "tests/model/scratch_folder.h"
#include "tests/random.h"

using namespace finsight;
using namespace finsight::host;

namespace {

constexpr int kPixelsPerModule = 10;

/// OpenCV's own drawing, ten pixels per module, without a margin.
cv::Mat drawn_by_opencv(const CharucoBoard& board) {
  const cv::Size size(8 * kPixelsPerModule * board.columns, 8 * kPixelsPerModule * board.rows);
  cv::Mat image;
#if CV_VERSION_MAJOR == 4 && CV_VERSION_MINOR <= 6
  cv::aruco::CharucoBoard::create(board.columns, board.rows, 1, 0.75F,
                                  cv::aruco::getPredefinedDictionary(cv::aruco::DICT_4X4_50))
      ->draw(size, image);
#else
  cv::aruco::CharucoBoard({board.columns, board.rows}, 1, 0.75F,
                          cv::aruco::getPredefinedDictionary(cv::aruco::DICT_4X4_50))
      .generateImage(size, image);
#endif
  return image;
}

std::string refusal(const CharucoBoard& board) {
  try {
    board.check();
  } catch (const InputError& error) {
    return error.what();
  }
  return "accepted";
}

}  // namespace

TEST_CASE("charuco board: is the one that OpenCV draws") {
  for (const CharucoBoard& board : {CharucoBoard{10, 7}, CharucoBoard{5, 9}, CharucoBoard{7, 3}}) {
    const cv::Mat theirs = drawn_by_opencv(board);
    const GreyImage ours = board.modules();
    int different = 0, black = 0;
    for (int y = 0; y < 8 * board.rows; ++y) {
      for (int x = 0; x < 8 * board.columns; ++x) {
        const int half = kPixelsPerModule / 2;
        const int theirs_grey = theirs.at<std::uint8_t>(kPixelsPerModule * y + half, kPixelsPerModule * x + half);
        different += *ours.view().at(x + 4, y + 4) != theirs_grey;
        black += theirs_grey == 0;
      }
    }
    CHECK(different == 0);
    CHECK(black > 8 * 8 * board.columns * board.rows / 2);
  }
}

TEST_CASE(
    "charuco board: boards that OpenCV's versions draw differently, or that the dictionary does not fill, are "
    "refused") {
  CHECK(refusal({10, 7}) == "accepted");
  CHECK(refusal({8, 6}).find("rows: found 8x6, expected an odd number") != std::string::npos);
  CHECK(refusal({15, 9}).find("50 markers") != std::string::npos);
  CHECK(refusal({2, 7}).find("3 or more") != std::string::npos);
}

TEST_CASE("charuco board: its corners are found to a tenth of a pixel, near and far, tilted and rolled") {
  const Lens camera = test::calibrated_camera();
  const test::BoardPainter painter(camera);
  const CharucoBoard board;
  BoardFinder finder(board);
  struct Case {
    double across, down, lower_deg, right_deg, depth, roll_deg;
    std::size_t fewest;
  };
  for (const Case& c :
       {Case{0.5, 0.5, 0, 0, 13, 0, 54}, Case{0.5, 0.5, 35, 0, 14, 0, 54}, Case{0.4, 0.6, -20, 30, 14, 45, 50},
        Case{0.5, 0.5, 0, 0, 5, 0, 12}, Case{0.5, 0.5, 10, 0, 17, 90, 50}, Case{0.15, 0.2, 0, 25, 12, 10, 15}}) {
    const Eigen::Isometry3d pose =
        test::board_at(camera, c.across, c.down, c.lower_deg, c.right_deg, c.depth, c.roll_deg);
    const GreyImage image = painter.paint(pose, 7);
    const BoardSight sight = finder.find(image.view());
    CAPTURE(c.depth);
    CAPTURE(c.roll_deg);
    CHECK(sight.id.size() >= c.fewest);
    double sum = 0, worst = 0;
    for (std::size_t i = 0; i < sight.id.size(); ++i) {
      const Eigen::Vector2d at = board.corner(sight.id[i]);
      const Eigen::Vector3d place = pose * Eigen::Vector3d(at.x(), at.y(), 0);
      const double off =
          (pixel_from_ray(camera, place.head<2>() / place.z()) - sight.corner_px[i].cast<double>()).norm();
      sum += off * off;
      worst = std::max(worst, off);
    }
    CHECK(std::sqrt(sum / static_cast<double>(sight.id.size())) < 0.1);
    CHECK(worst < 0.25);
    CHECK(sight.edge_px > 1.2);
    CHECK(sight.edge_px < 3);
  }
}

#if CV_VERSION_MAJOR == 4 && CV_VERSION_MINOR <= 6
// Why BoardFinder is not OpenCV's: if this fails with a newer version, OpenCV's will do.
TEST_CASE("charuco board: corners are more and nearer to the truth than those of OpenCV 4.6") {
  const Lens lens = test::calibrated_camera();
  const test::BoardPainter painter(lens);
  const CharucoBoard board;
  BoardFinder finder(board);
  const auto dictionary = cv::aruco::getPredefinedDictionary(cv::aruco::DICT_4X4_50);
  const auto theirs = cv::aruco::CharucoBoard::create(board.columns, board.rows, 1, 0.75F, dictionary);
  for (const auto& [blur_px, noise] : {std::pair{0.7, 1.5}, {1.5, 4.0}}) {
    std::size_t corners[2] = {};
    double sum_sq[2] = {};
    std::uint64_t seed = 1;
    for (const Eigen::Isometry3d& pose : test::good_views(lens)) {
      const GreyImage image = painter.paint(pose, seed++, blur_px, noise);
      const auto add = [&](int method, int id, const Eigen::Vector2d& found) {
        const Eigen::Vector2d at = board.corner(id);
        const Eigen::Vector3d place = pose * Eigen::Vector3d(at.x(), at.y(), 0);
        sum_sq[method] += (pixel_from_ray(lens, place.head<2>() / place.z()) - found).squaredNorm();
        ++corners[method];
      };
      const BoardSight sight = finder.find(image.view());
      for (std::size_t i = 0; i < sight.id.size(); ++i) add(0, sight.id[i], sight.corner_px[i].cast<double>());
      const cv::Mat grey(image.height_px, image.width_px, CV_8UC1, const_cast<std::uint8_t*>(image.grey.data()));
      std::vector<std::vector<cv::Point2f>> markers;
      std::vector<int> marker_ids, ids;
      std::vector<cv::Point2f> found;
      cv::aruco::detectMarkers(grey, dictionary, markers, marker_ids);
      if (marker_ids.empty()) continue;
      cv::aruco::interpolateCornersCharuco(markers, marker_ids, grey, theirs, found, ids);
      for (std::size_t i = 0; i < ids.size(); ++i) add(1, ids[i], {found[i].x, found[i].y});
    }
    const auto rms_px = [&](int method) { return std::sqrt(sum_sq[method] / static_cast<double>(corners[method])); };
    MESSAGE("blur " << blur_px << " px: " << corners[0] << " corners, " << rms_px(0)
                    << " px off; OpenCV: " << corners[1] << ", " << rms_px(1) << " px");
    CHECK(corners[0] > 0.95 * static_cast<double>(corners[1]));
    CHECK(rms_px(0) < 0.5 * rms_px(1));
  }
}
#endif

TEST_CASE("charuco board: blur shows in the width of its edges, also when it is in one direction only") {
  const Lens camera = test::calibrated_camera();
  const test::BoardPainter painter(camera);
  BoardFinder finder(CharucoBoard{});
  const Eigen::Isometry3d pose = test::board_at(camera, 0.5, 0.5, 0, 0, 6);  // squares far larger than the blur
  // Without noise, which would make the steepest step steeper.
  const double sharp_px = finder.find(painter.paint(pose, 1, 0.7, 0).view()).edge_px;
  const double soft_px = finder.find(painter.paint(pose, 1, 2, 0).view()).edge_px;
  CHECK(sharp_px == doctest::Approx(std::hypot(1, 2.5 * 0.7)).epsilon(0.04));
  CHECK(soft_px == doctest::Approx(std::hypot(1, 2.5 * 2)).epsilon(0.04));
  GreyImage moved = painter.paint(test::board_at(camera, 0.5, 0.5, 0, 0, 7), 1, 0.7);
  const GreyImage still = moved;
  for (int y = 0; y < moved.height_px; ++y) {
    for (int x = 6; x < moved.width_px; ++x) {
      int sum = 0;
      for (int i = 0; i < 6; ++i) sum += *still.view().at(x - i, y);
      moved.grey[static_cast<std::size_t>(y * moved.width_px + x)] = static_cast<std::uint8_t>(sum / 6);
    }
  }
  CHECK(finder.find(moved.view()).edge_px > 5);
}

TEST_CASE("charuco board: without a board, and with another board, no corner is found") {
  const Lens camera = test::calibrated_camera();
  const test::BoardPainter painter(camera);
  const GreyImage image = painter.paint(test::board_at(camera, 0.5, 0.5, 0, 0), 3);
  const BoardSight other = BoardFinder(CharucoBoard{7, 9}).find(image.view());
  CHECK(other.id.size() < 4);
  CHECK(other.markers > 25);
  test::Random random(5);
  GreyImage noise = image;
  for (std::uint8_t& grey : noise.grey) grey = static_cast<std::uint8_t>(256 * random.uniform());
  CHECK(BoardFinder(CharucoBoard{}).find(noise.view()).id.empty());
}

TEST_CASE("charuco board: the printed files show it at its size") {
  const test::ScratchFolder folder;
  const CharucoBoard board;
  const std::string png = board_png(board, 8);
  const GreyImage image = read_png(folder.write("board.png", png));
  // Half a square of margin: 11 x 8 squares of 8 mm at 24 pixels per millimetre.
  CHECK(image.width_px == 11 * 8 * 24);
  CHECK(image.height_px == 8 * 8 * 24);
  const std::size_t at = png.find("pHYs");
  REQUIRE(at != std::string::npos);
  CHECK(png.substr(at + 4, 9) == std::string("\0\0\x5d\xc0\0\0\x5d\xc0\1", 9));  // 24000 per metre
  GreyImage small{image.width_px / 3, image.height_px / 3, {}};
  for (int y = 0; y < small.height_px; ++y) {
    for (int x = 0; x < small.width_px; ++x) small.grey.push_back(*image.view().at(3 * x + 1, 3 * y + 1));
  }
  CHECK(BoardFinder(board).find(small.view()).id.size() == 54);

  const std::string svg = board_svg(board, 12.5);
  CHECK(svg.find("width=\"137.5mm\" height=\"100mm\" viewBox=\"0 0 88 64\"") != std::string::npos);
  const GreyImage modules = board.modules();
  std::vector<int> painted(modules.grey.size());
  int x = 0, y = 0, width = 0;
  for (std::size_t run = svg.find('M'); run != std::string::npos; run = svg.find('M', run + 1)) {
    REQUIRE(std::sscanf(svg.c_str() + run, "M%d %dh%dv1", &x, &y, &width) == 3);
    for (int i = 0; i < width; ++i) ++painted[static_cast<std::size_t>(y * modules.width_px + x + i)];
  }
  int different = 0;
  for (std::size_t i = 0; i < painted.size(); ++i) different += painted[i] != (modules.grey[i] == 0 ? 1 : 0);
  CHECK(different == 0);
}
