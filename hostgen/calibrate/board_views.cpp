#include "hostgen/calibrate/board_views.h"

#include <algorithm>
#include <cctype>

#include "firmware/input_error.h"
#include "firmware/ports/session.h"
#include "hostgen/calibrate/grey_image.h"
#include "hostgen/util/common.h"

namespace finsight::host {

namespace {

namespace fs = std::filesystem;

std::string extension(const fs::path& file) {
  std::string text = file.extension().string();
  std::transform(text.begin(), text.end(), text.begin(), [](unsigned char c) { return std::tolower(c); });
  return text;
}

/// How many of a file's frames will be read. Errors in the file are reported when they are read.
std::size_t images_in(const fs::path& file, int every) {
  if (extension(file) != ".y4m") return 1;
  std::size_t frames = 0;
  try {
    for (Y4mReader reader(file); reader.skip();) ++frames;
  } catch (const InputError&) {
  }
  return 1 + frames / static_cast<std::size_t>(every);
}

BoardView unreadable(const std::string& name, const std::exception& error) {
  BoardView view;
  view.name = name;
  view.rejected = std::string("cannot be read: ") + error.what();
  return view;
}

/// Keeps the frames read before the end of a truncated file.
void add_frames(const fs::path& file, int every, BoardFinder& finder, std::vector<BoardView>& views,
                Progress& progress) {
  const std::string name = file.filename().string();
  try {
    Y4mReader reader(file);
    std::vector<std::uint8_t> grey;
    for (int frame = 0;; ++frame) {
      if (interrupted()) throw Interrupted();
      if (frame % every != 0) {
        if (!reader.skip()) return;
        continue;
      }
      if (!reader.next(grey)) {
        if (frame == 0) throw InputError(file.string(), "frames", "none", "one or more");
        return;
      }
      const ImageView image{grey.data(), reader.width_px(), reader.height_px(), reader.width_px()};
      views.push_back(view_of(name + " " + std::to_string(frame), image, finder));
      progress.advance();
    }
  } catch (const InputError& error) {
    views.push_back(unreadable(name, error));
  }
}

void add_image(const fs::path& file, BoardFinder& finder, std::vector<BoardView>& views) {
  const std::string name = file.filename().string();
  try {
    const GreyImage image = extension(file) == ".png" ? read_png(file) : read_pgm(file);
    views.push_back(view_of(name, image.view(), finder));
  } catch (const InputError& error) {
    views.push_back(unreadable(name, error));
  }
}

}  // namespace

std::vector<fs::path> image_files(const fs::path& folder) {
  std::error_code error;
  std::vector<fs::path> files;
  for (const auto& entry : fs::directory_iterator(folder, error)) {
    const std::string kind = extension(entry.path());
    if (kind == ".png" || kind == ".pgm" || kind == ".y4m") files.push_back(entry.path());
  }
  if (error) throw InputError(folder.string(), "is no folder that can be read");
  if (files.empty()) throw InputError(folder.string(), "images", "none", "files ending in .png, .pgm or .y4m");
  std::sort(files.begin(), files.end());
  return files;
}

std::vector<BoardView> read_board_views(const fs::path& folder, const CharucoBoard& board, int every) {
  const std::vector<fs::path> files = image_files(folder);
  BoardFinder finder(board);
  std::vector<BoardView> views;
  std::size_t images = 0;
  for (const fs::path& file : files) images += images_in(file, every);
  Progress progress("images", images);
  for (const fs::path& file : files) {
    if (interrupted()) throw Interrupted();
    if (extension(file) == ".y4m") {
      add_frames(file, every, finder, views, progress);
    } else {
      add_image(file, finder, views);
      progress.advance();
    }
  }
  return views;
}

}  // namespace finsight::host
