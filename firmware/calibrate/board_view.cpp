#include "firmware/calibrate/board_view.h"

#include <algorithm>
#include <map>
#include <set>

namespace finsight {

namespace {

// Blurred corners are still where they were, but motion blur moves them with the shutter, and noise counts for more.
constexpr double kBlurredPx = 5, kBlurredShare = 0.17;  // width of an edge; and of it, in a square

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

BoardView view_of(const std::string& name, const ImageView& image, BoardFinder& finder) {
  BoardView view;
  view.name = name;
  view.width_px = image.width_px;
  view.height_px = image.height_px;
  view.sight = finder.find(image);
  return view;
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

}  // namespace finsight
