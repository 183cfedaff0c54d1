#include "hostgen/calibrate/board_views.h"

#include <doctest/doctest.h>

#include <fstream>

#include "firmware/input_error.h"
#include "firmware/ports/session.h"
#include "hostgen/calibrate/grey_image.h"
#include "tests/calibrate/board_painter.h"
#include "tests/model/scratch_folder.h"

using namespace finsight;
using namespace finsight::host;

namespace {

const Lens kCamera = test::calibrated_camera();
const CharucoBoard kBoard;

void write(const test::ScratchFolder& folder, const std::string& name, const GreyImage& image) {
  folder.write(name, png_bytes(image, 1000));
}

std::string pgm_bytes(const GreyImage& image) {
  return "P5\n" + std::to_string(image.width_px) + " " + std::to_string(image.height_px) + "\n255\n" +
         std::string(image.grey.begin(), image.grey.end());
}

std::string reason(const std::vector<BoardView>& views, const std::string& name) {
  for (const BoardView& view : views) {
    if (view.name == name) return view.rejected;
  }
  return "not in the list";
}

std::string refusal(const std::filesystem::path& folder) {
  try {
    read_board_views(folder, kBoard, 1);
  } catch (const InputError& error) {
    return error.what();
  }
  return "accepted";
}

bool says(const std::string& text, const char* part) { return text.find(part) != std::string::npos; }

}  // namespace

TEST_CASE("board views: each rejected image has its reason") {
  const test::ScratchFolder folder;
  const test::BoardPainter painter(kCamera);
  const auto at = [&](double across, double lower_deg) { return test::board_at(kCamera, across, 0.5, lower_deg, 0); };
  write(folder, "a.png", painter.paint(at(0.4, 20), 1));
  folder.write("b.PGM", pgm_bytes(painter.paint(at(0.6, -20), 2)));
  write(folder, "c_again.png", painter.paint(at(0.402, 20), 3));
  write(folder, "d_blurred.png", painter.paint(test::board_at(kCamera, 0.5, 0.5, 0, 0, 8), 4, 2.6));
  write(folder, "e_nothing.png", {640, 480, std::vector<std::uint8_t>(640 * 480, 120)});
  write(folder, "f_corner.png", painter.paint(at(-0.1, 0), 5));
  Lens large = kCamera;
  large.width_px = 800;
  write(folder, "g_large.png", test::BoardPainter(large).paint(at(0.5, 30), 6));
  folder.write("h_cut.png", png_bytes(painter.paint(at(0.5, 0), 7), 1).substr(0, 5000));
  folder.write("i_text.pgm", "no image");
  const test::BoardPainter other(kCamera, CharucoBoard{7, 9});
  write(folder, "j_other.png", other.paint(at(0.5, 0), 8));
  folder.write("notes.txt", "not looked at");

  std::vector<BoardView> views = read_board_views(folder.path(), kBoard, 1);
  CHECK(views.size() == 10);
  reject_bad_views(kBoard, views);
  CHECK(reason(views, "a.png") == "");
  CHECK(reason(views, "b.PGM") == "");
  CHECK(reason(views, "c_again.png") == "shows what a.png shows");
  CHECK(says(reason(views, "d_blurred.png"), "blurred: edges are"));
  CHECK(reason(views, "e_nothing.png") == "no board");
  CHECK(says(reason(views, "f_corner.png"), "corners, fewer than 12"));
  CHECK(reason(views, "g_large.png") == "800x480 pixels, most images have 640x480");
  CHECK(says(reason(views, "h_cut.png"), "cannot be read: "));
  CHECK(says(reason(views, "i_text.pgm"), "no binary PGM"));
  CHECK(says(reason(views, "j_other.png"), "markers, but not as on a board of 10x7 squares"));
  CHECK(used_views(views).size() == 2);
}

TEST_CASE("board views: every Nth frame of a video is used, and what was read before a cut-off is kept") {
  const test::ScratchFolder folder;
  const test::BoardPainter painter(kCamera);
  {
    Y4mWriter writer(folder / "frames.y4m", 640, 480, 30);
    for (int frame = 0; frame < 6; ++frame) {
      writer.write(painter.paint(test::board_at(kCamera, 0.35 + 0.05 * frame, 0.5, 0, 0), 1).grey.data());
    }
    writer.finish();
  }
  std::filesystem::resize_file(folder / "frames.y4m", std::filesystem::file_size(folder / "frames.y4m") - 1000);
  std::vector<BoardView> views = read_board_views(folder.path(), kBoard, 2);
  CHECK(views.size() == 4);  // 0, 2, 4, and that the rest is cut
  CHECK(views[1].name == "frames.y4m 2");
  CHECK(says(views[3].rejected, "cannot be read: "));
  views = read_board_views(folder.path(), kBoard, 1);
  CHECK(views.size() == 6);
  CHECK(says(views[5].rejected, "cannot be read: "));
  CHECK(views[4].sight.id.size() == 54);
}

TEST_CASE("board views: a video without frames is a view that says so") {
  const test::ScratchFolder folder;
  std::ofstream(folder / "empty.y4m") << "YUV4MPEG2 W640 H480 F30:1 Ip A1:1 Cmono\n";
  const std::vector<BoardView> views = read_board_views(folder.path(), kBoard, 1);
  REQUIRE(views.size() == 1);
  CHECK(says(views[0].rejected, "frames: found none"));
}

TEST_CASE("board views: a long video is thinned out until few enough views are left") {
  std::vector<BoardView> views;
  for (int i = 0; i < 300; ++i) {
    BoardView view;
    view.name = std::to_string(i);
    view.width_px = 640;
    view.height_px = 480;
    view.sight.markers = 35;
    view.sight.square_px = 40;
    view.sight.edge_px = 2;
    for (int id = 0; id < kBoard.corners(); ++id) {
      view.sight.id.push_back(id);
      view.sight.corner_px.push_back((20 * kBoard.corner(id)).cast<float>() + Vec2f(static_cast<float>(3 * i), 0));
    }
    views.push_back(view);
  }
  reject_bad_views(kBoard, views);
  const std::vector<BoardView*> used = used_views(views);
  CHECK(used.size() <= static_cast<std::size_t>(kMaxViews));
  CHECK(used.size() > 20);
  CHECK(reason(views, "1") == "shows what 0 shows");
}

TEST_CASE("board views: folders without images are refused") {
  const test::ScratchFolder folder;
  CHECK(says(refusal(folder.path()), "images: found none, expected files ending in .png, .pgm or .y4m"));
  CHECK(says(refusal(folder / "none"), "none: is no folder"));
  CHECK(says(refusal(folder.write("file.png", "")), "is no folder"));
  std::filesystem::create_directory(folder / "folder.png");
  const std::vector<BoardView> views = read_board_views(folder.path(), kBoard, 1);
  CHECK(says(reason(views, "folder.png"), "cannot be read: "));
}
