#include "firmware/vision/marker_detector.h"

#include <algorithm>
#include <exception>
#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>
#include <optional>
#include <span>
#include <tuple>

#include "firmware/vision/aruco_compat.h"

namespace finsight {
namespace {

// Lengths are pixels of the searched image.

// Local threshold: a window wider than one module (4 ... 12 pixels here) keeps the black border one solid ring. Two
// windows, because the markers' distances from the camera differ by a factor of two.
constexpr int kWindows[] = {11, 23};
constexpr double kDarker = 7;       // grey levels below the local mean: above the noise, far below the ink's contrast
constexpr double kStraight = 0.04;  // of the perimeter: 16 % of a side, so blurred and bent sides stay four
constexpr float kShortestSide = 0.08F;  // of the perimeter: no side shorter than a third of the mean side
constexpr int kFromBorder = 2;          // the corners' refinement needs pixels outside the square
// A contour has as many points as its longer extents have pixels: for a square on its corner, this much of its length.
constexpr float kPointsPerLength = 0.7F;
constexpr int kSideModules = 6, kSamples = 4;  // along a side; along a module, its outer quarters left out
// Contours run through the centres of the ink's outermost pixels, inside its edge: by this much in 48 pixels.
constexpr double kFromContour = 48.0 / 47;
constexpr double kMinMarkerContrast = 8;  // standard deviation, grey levels; less than that is no marker
constexpr int kWhiteInBorder = 1;         // of 20 border modules, one may be dirty
// Of a marker with a reflection on it. With eleven modules left, two markers of the dictionary still differ, and the
// marker is looked for where it must be.
constexpr int kHiddenModules = 5, kHiddenInBorder = 10, kSaturated = 254;
constexpr double kReflected = 0.15;  // brighter than paper by this share of the contrast
// The white margin of a marker is a square too, one module (0.059 of the perimeter) outside the black one.
constexpr float kSamePlace = 1.0F / 16;  // of the perimeter

using Corners = std::array<cv::Point2f, 4>;

struct Square {
  Corners corners;  ///< clockwise
  float perimeter;
};

/// How a marker reads with its corner `first` at the top left: 16 modules, row by row.
struct KnownCode {
  std::uint16_t code;
  int id;
  std::size_t first;
};

std::vector<KnownCode> known_codes() {
  std::vector<KnownCode> codes;
  for (int id = 0; id < kDictionaryMarkers; ++id) {
    std::array<std::uint8_t, 36> modules = marker_modules(id);
    for (std::size_t first = 0; first < 4; ++first) {
      std::uint16_t code = 0;
      std::array<std::uint8_t, 36> turned{};
      for (std::size_t row = 0; row < kSideModules; ++row) {
        for (std::size_t column = 0; column < kSideModules; ++column) {
          turned[row * kSideModules + column] = modules[column * kSideModules + kSideModules - 1 - row];
        }
      }
      for (std::size_t row = 1; row <= 4; ++row) {
        for (std::size_t column = 1; column <= 4; ++column) {
          code = static_cast<std::uint16_t>(code << 1 | modules[row * kSideModules + column]);
        }
      }
      codes.push_back({code, id, first});
      modules = turned;
    }
  }
  return codes;
}

/// OpenCV takes no pointer to constant pixels, though it only reads them.
cv::Mat mat_of(const ImageView& image) {
  return {image.height_px, image.width_px, CV_8UC1, const_cast<std::uint8_t*>(image.pixels),
          static_cast<std::size_t>(image.stride_bytes)};
}

/// 1 where the image is darker than its surroundings. Gives the number of neighbouring pixels that differ then.
int threshold(const cv::Mat& image, int window, cv::Mat& ink, cv::Mat& differs) {
  cv::adaptiveThreshold(image, ink, 1, cv::ADAPTIVE_THRESH_MEAN_C, cv::THRESH_BINARY_INV, window, kDarker);
  cv::bitwise_xor(ink.colRange(1, ink.cols), ink.colRange(0, ink.cols - 1), differs);
  const int edges = cv::countNonZero(differs);
  cv::bitwise_xor(ink.rowRange(1, ink.rows), ink.rowRange(0, ink.rows - 1), differs);
  return edges + cv::countNonZero(differs);
}

/// The square whose outline a contour is.
std::optional<Square> square_of(const std::vector<cv::Point>& contour, const SideLimits& sides, const cv::Size& size,
                                std::vector<cv::Point>& polygon) {
  const auto points = static_cast<float>(contour.size());
  if (!(points >= kPointsPerLength * 4 * sides.smallest_px && points <= 4 * sides.largest_px)) return std::nullopt;
  cv::approxPolyDP(contour, polygon, kStraight * static_cast<double>(points), true);
  if (polygon.size() != 4 || !cv::isContourConvex(polygon)) return std::nullopt;
  const cv::Point across = polygon[1] - polygon[0], along = polygon[3] - polygon[0];
  if (across.cross(along) < 0) std::swap(polygon[1], polygon[3]);
  Square square{{}, 0};
  float shortest = points;
  for (std::size_t k = 0; k < 4; ++k) {
    const cv::Point& corner = polygon[k];
    if (corner.x < kFromBorder || corner.y < kFromBorder || corner.x >= size.width - kFromBorder ||
        corner.y >= size.height - kFromBorder) {
      return std::nullopt;
    }
    const auto side = static_cast<float>(cv::norm(polygon[(k + 1) % 4] - corner));
    shortest = std::min(shortest, side);
    square.perimeter += side;
    square.corners[k] = corner;
  }
  const bool fits = square.perimeter >= 4 * sides.smallest_px && square.perimeter <= 4 * sides.largest_px;
  return fits && shortest >= kShortestSide * points ? std::optional(square) : std::nullopt;
}

/// Grey levels in the middles of a square's modules and of those around it, `margin` deep, row by row from its first
/// corner. `spread`: by how much the square is larger than its corners say.
void sample_modules(const cv::Mat& image, const Corners& corners, double spread, int margin,
                    std::span<std::uint8_t> samples) {
  const cv::Point2f modules[] = {{0, 0}, {kSideModules, 0}, {kSideModules, kSideModules}, {0, kSideModules}};
  const cv::Matx33d H = cv::getPerspectiveTransform(modules, corners.data());
  const int side = (kSideModules + 2 * margin) * kSamples;
  for (int i = 0; i < side * side; ++i) {
    const auto place = [spread, margin](int sample) {
      const double module = sample / kSamples - margin + 0.25 + (sample % kSamples + 0.5) / (2.0 * kSamples);
      return 0.5 * kSideModules + spread * (module - 0.5 * kSideModules);
    };
    const cv::Vec3d at = H * cv::Vec3d(place(i % side), place(i / side), 1);
    const int x = std::clamp(cvRound(at[0] / at[2]), 0, image.cols - 1);
    const int y = std::clamp(cvRound(at[1] / at[2]), 0, image.rows - 1);
    samples[static_cast<std::size_t>(i)] = image.at<std::uint8_t>(y, x);
  }
}

bool is_border(int row, int column) {
  return row == 0 || row + 1 == kSideModules || column == 0 || column + 1 == kSideModules;
}

/// The code in a square, read from its first corner; nothing without contrast or a black border.
std::optional<std::uint16_t> read_code(const cv::Mat& image, const Corners& corners, double spread) {
  constexpr int kSide = kSideModules * kSamples;
  std::array<std::uint8_t, kSide * kSide> samples;
  sample_modules(image, corners, spread, 0, samples);
  cv::Mat grey(kSide, kSide, CV_8UC1, samples.data());
  cv::Scalar mean, deviation;
  cv::meanStdDev(grey, mean, deviation);
  if (deviation[0] < kMinMarkerContrast) return std::nullopt;
  cv::threshold(grey, grey, 0, 1, cv::THRESH_BINARY | cv::THRESH_OTSU);

  std::uint16_t code = 0;
  int white_in_border = 0;
  for (int row = 0; row < kSideModules; ++row) {
    for (int column = 0; column < kSideModules; ++column) {
      const cv::Rect module(column * kSamples, row * kSamples, kSamples, kSamples);
      const bool white = 2 * cv::countNonZero(grey(module)) > kSamples * kSamples;
      if (is_border(row, column)) {
        white_in_border += white;
      } else {
        code = static_cast<std::uint16_t>(code << 1 | white);
      }
    }
  }
  return white_in_border <= kWhiteInBorder ? std::optional(code) : std::nullopt;
}

/// The marker with its margin, module by module, as a reflection leaves it.
constexpr int kWithMargin = kSideModules + 2;
struct Lit {
  std::array<bool, kWithMargin * kWithMargin> white{}, reflected{};
};

Lit read_lit(const std::array<std::uint8_t, kWithMargin * kWithMargin * kSamples * kSamples>& samples, double middle,
             double brighter) {
  constexpr int kRow = kWithMargin * kSamples;
  Lit lit;
  for (int module = 0; module < kWithMargin * kWithMargin; ++module) {
    int white = 0;
    for (int i = 0; i < kSamples * kSamples; ++i) {
      const int y = module / kWithMargin * kSamples + i / kSamples, x = module % kWithMargin * kSamples + i % kSamples;
      const int level = samples[static_cast<std::size_t>(y * kRow + x)];
      white += level > middle;
      if (level > brighter || level >= kSaturated) lit.reflected[static_cast<std::size_t>(module)] = true;
    }
    lit.white[static_cast<std::size_t>(module)] = 2 * white > kSamples * kSamples;
  }
  return lit;
}

/// Light only adds: what is dark is ink. What is white tells nothing where light is reflected, and
/// what should be ink may be white next to it.
bool agrees(const Lit& lit, std::uint16_t wanted) {
  const auto at = [](int row, int column) { return static_cast<std::size_t>((row + 1) * kWithMargin + column + 1); };
  int hidden = 0, hidden_in_border = 0, white_in_border = 0;
  for (int row = 0, bit = 15; row < kSideModules; ++row) {
    for (int column = 0; column < kSideModules; ++column) {
      const bool is_white = lit.white[at(row, column)];
      const bool wants_white = !is_border(row, column) && (wanted >> bit & 1) != 0;
      const bool is_beside = lit.reflected[at(row - 1, column)] || lit.reflected[at(row + 1, column)] ||
                             lit.reflected[at(row, column - 1)] || lit.reflected[at(row, column + 1)];
      const bool is_hidden = is_white && (lit.reflected[at(row, column)] || (is_beside && !wants_white));
      if (is_border(row, column)) {
        hidden_in_border += is_hidden;
        white_in_border += is_white && !is_hidden;
        continue;
      }
      --bit;
      if (!is_hidden && is_white != wants_white) return false;
      hidden += is_hidden;
    }
  }
  return hidden <= kHiddenModules && hidden_in_border <= kHiddenInBorder && white_in_border <= kWhiteInBorder;
}

/// Whether what a reflection leaves of a square is this code.
bool shows_partly(const cv::Mat& image, const Corners& corners, std::uint16_t wanted) {
  std::array<std::uint8_t, kWithMargin * kWithMargin * kSamples * kSamples> samples;
  sample_modules(image, corners, 1, 1, samples);
  auto sorted = samples;
  std::sort(sorted.begin(), sorted.end());
  const int ink = sorted[sorted.size() / 8];
  // How much of the marker and its margin is paper that nothing is reflected by is not known: its level is tried at
  // several shares.
  for (const std::size_t share : {6U, 7U, 8U, 9U, 10U, 12U}) {
    const int paper = sorted[sorted.size() * share / 16];
    if (paper - ink < 3 * kMinMarkerContrast) continue;
    const double middle = 0.5 * (ink + paper), brighter = paper + kReflected * (paper - ink);
    if (agrees(read_lit(samples, middle, brighter), wanted)) return true;
  }
  return false;
}

Vec2f centre(const FoundMarker& marker) {
  return (marker.corners_px[0] + marker.corners_px[1] + marker.corners_px[2] + marker.corners_px[3]) / 4;
}

float perimeter(const FoundMarker& marker) {
  float sum = 0;
  for (std::size_t k = 0; k < 4; ++k) sum += (marker.corners_px[(k + 1) % 4] - marker.corners_px[k]).norm();
  return sum;
}

/// The same print found twice (by both thresholds, or inner and outer edge of its border) counts once: the larger.
void add_once(const FoundMarker& marker, std::vector<FoundMarker>& found) {
  for (FoundMarker& other : found) {
    if (other.id != marker.id || (centre(other) - centre(marker)).norm() > perimeter(marker) * kSamePlace) continue;
    if (perimeter(marker) > perimeter(other)) other = marker;
    return;
  }
  found.push_back(marker);
}

}  // namespace

struct MarkerDetector::Workspace {
  const std::vector<KnownCode> codes = known_codes();
  cv::Mat reduced, smooth, ink, differs;
  std::vector<std::vector<cv::Point>> contours;
  std::vector<cv::Point> polygon;
  std::vector<Square> squares;
};

MarkerDetector::MarkerDetector(const SearchLimits& limits)
    : limits_(limits), workspace_(std::make_unique<Workspace>()) {
  // One thread: the other cores belong to the server and the recorder, and waking a pool takes longer than a window.
  cv::setNumThreads(1);
  cv::redirectError([](int, const char*, const char*, const char*, int, void*) { return 0; });
}

MarkerDetector::~MarkerDetector() = default;
MarkerDetector::MarkerDetector(MarkerDetector&&) noexcept = default;
MarkerDetector& MarkerDetector::operator=(MarkerDetector&&) noexcept = default;

const std::vector<FoundMarker>& MarkerDetector::find(const ImageView& image, int shrink, const SideLimits& sides) {
  found_.clear();
  squares_read_ = 0;
  try {
    search(image, shrink, sides);
  } catch (const std::exception&) {
    found_.clear();
  }
  return found_;
}

bool MarkerDetector::confirm(const ImageView& image, const std::array<Vec2f, 4>& corners_px, int id) const {
  Corners corners;
  for (std::size_t k = 0; k < 4; ++k) corners[k] = {corners_px[k].x(), corners_px[k].y()};
  try {
    const std::optional<std::uint16_t> code = read_code(mat_of(image), corners, 1);
    return code && std::any_of(workspace_->codes.begin(), workspace_->codes.end(), [&](const KnownCode& known) {
             return known.id == id && known.first == 0 && known.code == *code;
           });
  } catch (const std::exception&) {
    return false;
  }
}

bool MarkerDetector::confirm_partly(const ImageView& image, const std::array<Vec2f, 4>& corners_px, int id) const {
  Corners corners;
  for (std::size_t k = 0; k < 4; ++k) corners[k] = {corners_px[k].x(), corners_px[k].y()};
  try {
    return std::any_of(workspace_->codes.begin(), workspace_->codes.end(), [&](const KnownCode& known) {
      return known.id == id && known.first == 0 && shows_partly(mat_of(image), corners, known.code);
    });
  } catch (const std::exception&) {
    return false;
  }
}

void MarkerDetector::search(const ImageView& image, int shrink, const SideLimits& sides) {
  Workspace& w = *workspace_;
  const cv::Mat whole = mat_of(image);
  cv::Mat searched = whole;
  if (shrink > 1) {
    const cv::Size size(image.width_px / shrink, image.height_px / shrink);
    cv::resize(whole(cv::Rect(0, 0, size.width * shrink, size.height * shrink)), w.reduced, size, 0, 0, cv::INTER_AREA);
    searched = w.reduced;
  }
  w.squares.clear();
  const auto scale = static_cast<float>(shrink);
  const SideLimits here{sides.smallest_px / scale, sides.largest_px / scale};
  for (const int window : kWindows) {
    int edges = threshold(searched, window, w.ink, w.differs);
    if (edges > limits_.noisy_edges) {
      // Noise makes contours everywhere; a mean over less than a module takes most of it away and no edge.
      cv::blur(searched, w.smooth, {3, 3});
      edges = threshold(w.smooth, window, w.ink, w.differs);
    }
    if (edges > limits_.edges) continue;
    cv::findContours(w.ink, w.contours, cv::RETR_LIST, cv::CHAIN_APPROX_NONE);
    for (const auto& contour : w.contours) {
      if (const auto square = square_of(contour, here, w.ink.size(), w.polygon)) w.squares.push_back(*square);
    }
  }
  const auto larger = [](const Square& a, const Square& b) {
    const auto key = [](const Square& s) { return std::tuple(-s.perimeter, s.corners[0].y, s.corners[0].x); };
    return key(a) < key(b);
  };
  std::sort(w.squares.begin(), w.squares.end(), larger);
  squares_read_ = std::min(static_cast<int>(w.squares.size()), limits_.squares);

  for (int i = 0; i < squares_read_; ++i) {
    const Corners& corners = w.squares[static_cast<std::size_t>(i)].corners;
    const std::optional<std::uint16_t> code = read_code(searched, corners, kFromContour);
    if (!code) continue;
    const auto known =
        std::find_if(w.codes.begin(), w.codes.end(), [&](const KnownCode& k) { return k.code == *code; });
    if (known == w.codes.end()) continue;
    FoundMarker marker{known->id, {}};
    const float shift = (scale - 1) / 2;  // centre of a reduced pixel
    for (std::size_t k = 0; k < 4; ++k) {
      marker.corners_px[(k + known->first) % 4] = Vec2f(corners[k].x * scale + shift, corners[k].y * scale + shift);
    }
    add_once(marker, found_);
  }
}

}  // namespace finsight
