#include "firmware/calibrate/charuco_board.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <map>
#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>
#include <optional>

#include "firmware/calibrate/median.h"
#include "firmware/input_error.h"
#include "firmware/vision/aruco_compat.h"

namespace finsight {

namespace {

constexpr int kSquare = CharucoBoard::kModulesPerSquare, kMargin = kSquare / 2;

/// Where squares are in the image, extrapolated from one marker.
struct SeenMarker {
  cv::Matx33d px_from_square;
  double side_px = 0;      ///< of a square; mean
  double shortest_px = 0;  ///< of a square

  Eigen::Vector2d pixel(const Eigen::Vector2d& at) const {
    const cv::Vec3d p = px_from_square * cv::Vec3d(at.x(), at.y(), 1);
    return {p[0] / p[2], p[1] / p[2]};
  }
};

SeenMarker seen_marker(const FoundMarker& found, int column, int row) {
  constexpr float kFirst = 1.0F / 8, kLast = 7.0F / 8;  // of the square
  const auto c = static_cast<float>(column), r = static_cast<float>(row);
  const cv::Point2f square[4] = {
      {c + kFirst, r + kFirst}, {c + kLast, r + kFirst}, {c + kLast, r + kLast}, {c + kFirst, r + kLast}};
  cv::Point2f pixel[4];
  SeenMarker marker;
  marker.shortest_px = 1e9;
  for (std::size_t k = 0; k < 4; ++k) {
    pixel[k] = {found.corners_px[k].x(), found.corners_px[k].y()};
    const double side_px =
        static_cast<double>((found.corners_px[(k + 1) % 4] - found.corners_px[k]).norm()) / (kLast - kFirst);
    marker.side_px += side_px / 4;
    marker.shortest_px = std::min(marker.shortest_px, side_px);
  }
  marker.px_from_square = cv::Matx33d(cv::getPerspectiveTransform(square, pixel));
  return marker;
}

/// The markers by id, without those that were found twice: which one is the board's cannot be told.
std::map<int, FoundMarker> find_markers(MarkerDetector& detector, const ImageView& image) {
  const float longest_px = static_cast<float>(std::max(image.width_px, image.height_px));
  std::map<int, FoundMarker> markers;
  // The detector's windows are made for markers of 24 to 72 pixels: larger ones are found in reduced images.
  for (const int shrink : {1, 2, 4}) {
    std::map<int, int> times;
    const std::vector<FoundMarker>& found = detector.find(image, shrink, {12.0F * shrink, longest_px / 2});
    for (const FoundMarker& marker : found) ++times[marker.id];
    for (const FoundMarker& marker : found) {
      if (times[marker.id] == 1) markers.emplace(marker.id, marker);
    }
  }
  return markers;
}

/// Where an inner corner is and how far it is to the next: by the two markers that meet there, if they agree.
struct Prediction {
  Eigen::Vector2d at_px;
  double side_px, shortest_px;
};

std::optional<Prediction> predict(const CharucoBoard& board, const std::map<int, SeenMarker>& seen, int id,
                                  int& meetings) {
  const Eigen::Vector2d corner = board.corner(id);
  const int column = static_cast<int>(corner.x()), row = static_cast<int>(corner.y());
  const int left = CharucoBoard::is_white(column - 1, row - 1) ? row - 1 : row;  // the white squares lie diagonally
  const auto a = seen.find(board.marker(column - 1, left));
  const auto b = seen.find(board.marker(column, left == row ? row - 1 : row));
  if (a == seen.end() || b == seen.end()) return std::nullopt;
  ++meetings;
  const Eigen::Vector2d by_a = a->second.pixel(corner), by_b = b->second.pixel(corner);
  const double side_px = (a->second.side_px + b->second.side_px) / 2;
  constexpr double kAgreement = 0.2;  // of a square: coarse corners and the lens make 0.1 at most
  if (!((by_a - by_b).norm() < kAgreement * side_px)) return std::nullopt;
  return Prediction{(by_a + by_b) / 2, side_px, std::min(a->second.shortest_px, b->second.shortest_px)};
}

/// The saddle point near the prediction. The window must not reach the markers, one module away.
std::optional<Vec2f> refine(const cv::Mat& image, const Prediction& predicted) {
  const int half = std::clamp(static_cast<int>(predicted.shortest_px / kSquare), 2, 10);
  const Eigen::Vector2d& at = predicted.at_px;
  if (!(at.x() > half + 2 && at.y() > half + 2 && at.x() < image.cols - half - 3 && at.y() < image.rows - half - 3)) {
    return std::nullopt;
  }
  std::vector<cv::Point2f> corner = {{static_cast<float>(at.x()), static_cast<float>(at.y())}};
  cv::cornerSubPix(image, corner, {half, half}, {-1, -1}, {cv::TermCriteria::COUNT + cv::TermCriteria::EPS, 50, 0.002});
  const Vec2f found(corner[0].x, corner[0].y);
  const double moved_px = (found.cast<double>() - at).norm();
  if (!(moved_px < 1 + 0.1 * predicted.side_px)) return std::nullopt;
  return found;
}

/// Width of the edge between a black and a white square in the middle between two corners: contrast over largest slope.
/// A sharp edge has one pixel, a Gaussian blur of standard deviation s has 2.5 s. Nothing at the image's border.
std::optional<double> edge_width_px(const ImageView& image, const Vec2f& a, const Vec2f& b) {
  const Vec2f along = b - a, middle = (a + b) / 2;
  const Vec2f across = Vec2f(-along.y(), along.x()) * (0.9F / kSquare);  // nearly to the marker
  const Vec2f low = middle - across.cwiseAbs(), high = middle + across.cwiseAbs();
  if (!(low.minCoeff() >= 0 && high.x() < static_cast<float>(image.width_px - 1) &&
        high.y() < static_cast<float>(image.height_px - 1))) {
    return std::nullopt;
  }
  float darkest = 255, brightest = 0, steepest = 0, before = 0;
  const int steps = static_cast<int>(std::ceil(2 * across.norm()));  // of half a pixel
  const float step_px = across.norm() / static_cast<float>(steps);
  for (int i = -steps; i <= steps; ++i) {
    const Vec2f at = middle + across * (static_cast<float>(i) / static_cast<float>(steps));
    const float grey = image.sample(at.x(), at.y());
    darkest = std::min(darkest, grey);
    brightest = std::max(brightest, grey);
    if (i > -steps) steepest = std::max(steepest, std::abs(grey - before) / step_px);
    before = grey;
  }
  if (steepest == 0) return std::nullopt;
  return static_cast<double>((brightest - darkest) / steepest);
}

void measure_edges(const ImageView& image, const CharucoBoard& board, BoardSight& sight) {
  std::map<int, Vec2f> by_id;
  for (std::size_t i = 0; i < sight.id.size(); ++i) by_id.emplace(sight.id[i], sight.corner_px[i]);
  const auto median_px = [&](int next, double& square_px) {
    std::vector<double> widths, sides;
    for (const auto& [id, corner] : by_id) {
      const auto other = by_id.find(id + next);
      const bool is_in_row = next > 1 || (id + 1) % board.corners_per_row() != 0;
      if (other == by_id.end() || !is_in_row) continue;
      if (const auto width_px = edge_width_px(image, corner, other->second)) widths.push_back(*width_px);
      sides.push_back(static_cast<double>((other->second - corner).norm()));
    }
    square_px += median(sides) / 2;
    return median(widths);
  };
  const double level_px = median_px(1, sight.square_px);
  sight.edge_px = std::max(level_px, median_px(board.corners_per_row(), sight.square_px));
}

}  // namespace

void CharucoBoard::check() const {
  const std::string size = std::to_string(columns) + "x" + std::to_string(rows);
  if (columns < 3 || rows < 3 || columns > 33 || rows > 33 || columns * rows / 2 > kDictionaryMarkers) {
    throw InputError("board", "squares", size, "3 or more each way, and at most 101 of them (50 markers)");
  }
  if (rows % 2 == 0) {
    throw InputError("board", "rows", size,
                     "an odd number: OpenCV's versions do not agree how boards with an even one look");
  }
}

GreyImage CharucoBoard::modules() const {
  GreyImage image{columns * kSquare + 2 * kMargin, rows * kSquare + 2 * kMargin, {}};
  image.grey.assign(static_cast<std::size_t>(image.width_px * image.height_px), 255);
  const auto paint = [&](int x, int y) {
    image.grey[static_cast<std::size_t>((y + kMargin) * image.width_px + x + kMargin)] = 0;
  };
  for (int y = 0; y < rows * kSquare; ++y) {
    for (int x = 0; x < columns * kSquare; ++x) {
      const int column = x / kSquare, row = y / kSquare, u = x % kSquare - 1, v = y % kSquare - 1;
      if (!is_white(column, row)) {
        paint(x, y);
      } else if (u >= 0 && u < 6 && v >= 0 && v < 6) {
        if (!marker_modules(marker(column, row))[static_cast<std::size_t>(6 * v + u)]) paint(x, y);
      }
    }
  }
  return image;
}

std::string board_svg(const CharucoBoard& board, double square_mm) {
  const GreyImage modules = board.modules();
  char head[512];
  const auto mm = [&](int module_count) { return module_count * square_mm / kSquare; };
  std::snprintf(head, sizeof head,
                "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"%gmm\" height=\"%gmm\" viewBox=\"0 0 %d %d\" "
                "shape-rendering=\"crispEdges\">\n<title>ChArUco board, %dx%d squares of %g mm, DICT_4X4_50</title>\n"
                "<rect width=\"%d\" height=\"%d\" fill=\"white\"/>\n<path d=\"",
                mm(modules.width_px), mm(modules.height_px), modules.width_px, modules.height_px, board.columns,
                board.rows, square_mm, modules.width_px, modules.height_px);
  std::string svg = head;
  for (int y = 0; y < modules.height_px; ++y) {  // each run of black modules is one rectangle
    for (int x = 0, end = 0; x < modules.width_px; x = end + 1) {
      for (end = x; end < modules.width_px && *modules.view().at(end, y) == 0;) ++end;
      if (end == x) continue;
      char run[64];
      std::snprintf(run, sizeof run, "M%d %dh%dv1h-%dz", x, y, end - x, end - x);
      svg += run;
    }
    svg += '\n';
  }
  return svg + "\"/>\n</svg>\n";
}

BoardFinder::BoardFinder(const CharucoBoard& board) : board_(board) { board_.check(); }

BoardSight BoardFinder::find(const ImageView& image) {
  BoardSight sight;
  const std::map<int, FoundMarker> found = find_markers(detector_, image);
  sight.markers = static_cast<int>(found.size());
  std::map<int, SeenMarker> seen;
  for (int row = 0; row < board_.rows; ++row) {
    for (int column = 0; column < board_.columns; ++column) {
      const auto marker = found.find(board_.marker(column, row));
      if (!CharucoBoard::is_white(column, row) || marker == found.end()) continue;
      seen.emplace(marker->first, seen_marker(marker->second, column, row));
    }
  }
  const cv::Mat grey(image.height_px, image.width_px, CV_8UC1, const_cast<std::uint8_t*>(image.pixels),
                     static_cast<std::size_t>(image.stride_bytes));
  for (int id = 0; id < board_.corners(); ++id) {
    const auto predicted = predict(board_, seen, id, sight.meetings);
    const auto corner = predicted ? refine(grey, *predicted) : std::nullopt;
    if (!corner) continue;
    sight.id.push_back(id);
    sight.corner_px.push_back(*corner);
  }
  measure_edges(image, board_, sight);
  return sight;
}

}  // namespace finsight
