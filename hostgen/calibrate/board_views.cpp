#include "hostgen/calibrate/board_views.h"

#include <algorithm>
#include <map>
#include <set>

#include "firmware/input_error.h"
#include "firmware/ports/session.h"
#include "hostgen/util/common.h"

namespace finsight::host {

namespace {

namespace fs = std::filesystem;

// Blurred corners are still where they were, but motion blur moves them with the shutter, and noise counts for more.
constexpr double kBlurredPx = 5, kBlurredShare = 0.17;  // width of an edge; and of it, in a square

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

BoardView view_of(const std::string& name, const ImageView& image, BoardFinder& finder) {
  BoardView view;
  view.name = name;
  view.width_px = image.width_px;
  view.height_px = image.height_px;
  view.sight = finder.find(image);
  return view;
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

bool lies_on_a_line(const CharucoBoard& board, const std::vector<int>& ids) {
  std::set<int> columns, rows;
  for (const int id : ids) {
    columns.insert(id % board.corners_per_row());
    rows.insert(id / board.corners_per_row());
  }
  return columns.size() < 2 || rows.size() < 2;
}

std::string fault_of(const CharucoBoard& board, const BoardSight& sight) {
  const std::string corners = std::to_string(sight.id.size()) + " corners";
  if (sight.markers == 0) return "no board";
  if (sight.id.empty() && sight.meetings >= 4) {
    return std::to_string(sight.markers) + " markers, but not as on a board of " + std::to_string(board.columns) + "x" +
           std::to_string(board.rows) + " squares";
  }
  if (sight.id.size() < kMinCorners) return "only " + corners + ", fewer than " + std::to_string(kMinCorners);
  if (lies_on_a_line(board, sight.id)) return corners + " in one line";
  if (sight.edge_px > std::min(kBlurredPx, kBlurredShare * sight.square_px)) {
    return "blurred: edges are " + std::to_string(static_cast<int>(sight.edge_px + 0.5)) + " pixels wide";
  }
  return "";
}

using Size = std::pair<int, int>;
std::string text_of(const Size& size) { return std::to_string(size.first) + "x" + std::to_string(size.second); }

void reject_other_sizes(std::vector<BoardView>& views) {
  std::map<Size, int> times;
  for (const BoardView* view : used_views(views)) ++times[{view->width_px, view->height_px}];
  if (times.empty()) return;
  const Size size =
      std::max_element(times.begin(), times.end(), [](auto& a, auto& b) { return a.second < b.second; })->first;
  for (BoardView* view : used_views(views)) {
    const Size other{view->width_px, view->height_px};
    if (other != size) view->rejected = text_of(other) + " pixels, most images have " + text_of(size);
  }
}

/// Mean distance of the corners that both views show; far for views that share less than half of their corners.
double distance_px(const BoardSight& a, const BoardSight& b) {
  double sum = 0;
  std::size_t both = 0;
  for (std::size_t i = 0, j = 0; i < a.id.size() && j < b.id.size();) {  // ids ascend
    if (a.id[i] == b.id[j]) {
      sum += static_cast<double>((a.corner_px[i++] - b.corner_px[j++]).norm());
      ++both;
    } else {
      a.id[i] < b.id[j] ? ++i : ++j;
    }
  }
  return 2 * both < std::max(a.id.size(), b.id.size()) ? 1e9 : sum / static_cast<double>(both);
}

/// Keeps the earlier of two similar views. If too many remain, the threshold rises until few enough do.
void reject_duplicates(std::vector<BoardView>& views) {
  std::vector<BoardView*> kept = used_views(views);
  if (kept.empty()) return;
  for (double nearest_px = 0.015 * kept[0]->width_px;; nearest_px *= 1.3) {
    std::vector<BoardView*> different;
    for (BoardView* view : kept) {
      const auto same = std::find_if(different.begin(), different.end(), [&](const BoardView* other) {
        return distance_px(view->sight, other->sight) < nearest_px;
      });
      if (same == different.end()) {
        different.push_back(view);
      } else {
        view->rejected = "shows what " + (*same)->name + " shows";
      }
    }
    kept = different;
    if (kept.size() <= kMaxViews) return;
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

void reject_bad_views(const CharucoBoard& board, std::vector<BoardView>& views) {
  for (BoardView* view : used_views(views)) view->rejected = fault_of(board, view->sight);
  reject_other_sizes(views);
  reject_duplicates(views);
}

std::vector<BoardView*> used_views(std::vector<BoardView>& views) {
  std::vector<BoardView*> used;
  for (BoardView& view : views) {
    if (view.rejected.empty()) used.push_back(&view);
  }
  return used;
}

}  // namespace finsight::host
