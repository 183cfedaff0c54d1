#include "firmware/calibrate/lens_calibration.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <numbers>
#include <opencv2/calib3d.hpp>

#include "firmware/calibrate/median.h"
#include "firmware/input_error.h"
#include "firmware/ports/session.h"
#include "firmware/settings/toml_table.h"

namespace finsight {

namespace {

// A corner or view is an outlier when its distance from the model exceeds this many times the median, and kOutlierPx.
constexpr double kCornerTimes = 5, kViewTimes = 3, kOutlierPx = 0.25;
constexpr double kOutlierShare = 0.2;         // of a view's corners: with more of them the view itself is the outlier
constexpr double kFarthestShare = 1 / 640.0;  // of the image's width, RMS: what no single lens explains
constexpr double kUndetermined = 0.02;  // standard deviation of focal length and principal point, of the focal length

struct Fit {
  cv::Mat matrix = cv::Mat::eye(3, 3, CV_64F), distortion, sigma;
  std::vector<cv::Mat> rotations, translations;
};

Fit fit(const CharucoBoard& board, const std::vector<BoardView*>& views) {
  std::vector<std::vector<cv::Point3f>> places;
  std::vector<std::vector<cv::Point2f>> pixels;
  for (const BoardView* view : views) {
    places.emplace_back();
    pixels.emplace_back();
    for (std::size_t i = 0; i < view->sight.id.size(); ++i) {
      const Eigen::Vector2f at = board.corner(view->sight.id[i]).cast<float>();
      places.back().emplace_back(at.x(), at.y(), 0.0F);
      pixels.back().emplace_back(view->sight.corner_px[i].x(), view->sight.corner_px[i].y());
    }
  }
  Fit result;
  cv::Mat outer_sigma, view_errors;
  cv::calibrateCamera(places, pixels, {views[0]->width_px, views[0]->height_px}, result.matrix, result.distortion,
                      result.rotations, result.translations, result.sigma, outer_sigma, view_errors, 0,
                      {cv::TermCriteria::COUNT + cv::TermCriteria::EPS, 100, 1e-9});
  return result;
}

LensCalibration numbers_of(const Fit& found, const std::vector<BoardView*>& views) {
  const cv::Mat &m = found.matrix, &d = found.distortion;
  LensCalibration calibration;
  calibration.lens = {views[0]->width_px, views[0]->height_px, m.at<double>(0, 0), m.at<double>(1, 1),
                      m.at<double>(0, 2), m.at<double>(1, 2),  d.at<double>(0),    d.at<double>(1),
                      d.at<double>(2),    d.at<double>(3),     d.at<double>(4)};
  for (int i = 0; i < kLensNumbers; ++i) calibration.sigma[static_cast<std::size_t>(i)] = found.sigma.at<double>(i);
  calibration.views = views.size();
  return calibration;
}

/// Poses and residuals of the views, and from them the lens's.
void add_residuals(const CharucoBoard& board, const Fit& found, const std::vector<BoardView*>& views,
                   LensCalibration& calibration) {
  double sum = 0;
  calibration.corners = 0;
  for (std::size_t v = 0; v < views.size(); ++v) {
    BoardView& view = *views[v];
    std::vector<cv::Point3d> places;
    for (const int id : view.sight.id) places.emplace_back(board.corner(id).x(), board.corner(id).y(), 0);
    std::vector<cv::Point2d> pixels;
    cv::projectPoints(places, found.rotations[v], found.translations[v], found.matrix, found.distortion, pixels);
    double view_sum = 0;
    view.residual_px.clear();
    for (std::size_t i = 0; i < pixels.size(); ++i) {
      const Vec2f model(static_cast<float>(pixels[i].x), static_cast<float>(pixels[i].y));
      view.residual_px.push_back(view.sight.corner_px[i] - model);
      view_sum += static_cast<double>(view.residual_px.back().squaredNorm());
    }
    view.rms_px = std::sqrt(view_sum / static_cast<double>(pixels.size()));
    sum += view_sum;
    calibration.corners += pixels.size();
    cv::Matx33d R;
    cv::Rodrigues(found.rotations[v], R);
    for (int i = 0; i < 3; ++i) {
      for (int j = 0; j < 3; ++j) view.T_camera_board.linear()(i, j) = R(i, j);
      view.T_camera_board.translation()[i] = found.translations[v].at<double>(i);
    }
  }
  calibration.rms_px = std::sqrt(sum / static_cast<double>(calibration.corners));
}

/// Removes single corners that were spoilt by glare, dirt or the lens's edge.
bool drop_outlier_corners(const std::vector<BoardView*>& views) {
  std::vector<double> distances;
  for (const BoardView* view : views) {
    for (const Vec2f& off : view->residual_px) distances.push_back(static_cast<double>(off.norm()));
  }
  const auto limit_px = static_cast<float>(std::max(kOutlierPx, kCornerTimes * median(distances)));
  bool any = false;
  for (BoardView* view : views) {
    BoardSight kept = view->sight;
    kept.id.clear();
    kept.corner_px.clear();
    for (std::size_t i = 0; i < view->sight.id.size(); ++i) {
      if (view->residual_px[i].norm() > limit_px) continue;
      kept.id.push_back(view->sight.id[i]);
      kept.corner_px.push_back(view->sight.corner_px[i]);
    }
    const std::size_t before = view->sight.id.size(), after = kept.id.size();
    const auto fewest = std::max<double>(kMinCorners, (1 - kOutlierShare) * static_cast<double>(before));
    if (after == before || static_cast<double>(after) < fewest) continue;
    view->sight = kept;
    any = true;
  }
  return any;
}

bool reject_worst(const std::vector<BoardView*>& views) {
  std::vector<double> errors;
  for (const BoardView* view : views) errors.push_back(view->rms_px);
  const double limit_px = std::max(kOutlierPx, kViewTimes * median(errors));
  BoardView& worst =
      **std::max_element(views.begin(), views.end(), [](auto* a, auto* b) { return a->rms_px < b->rms_px; });
  if (!(worst.rms_px > limit_px)) return false;
  char reason[96];
  std::snprintf(reason, sizeof reason, "outlier: corners %.2f pixels off, at most %.2f", worst.rms_px, limit_px);
  worst.rejected = reason;
  return true;
}

/// The fit returns numbers even when the views do not determine a lens: these are refused.
void check_determined(const LensCalibration& calibration, const std::string& name) {
  const auto& [lens, sigma, rms_px, views, corners] = calibration;
  try {
    check_lens(lens);
  } catch (const InputError& error) {
    throw InputError(name, std::string("the views do not determine a lens: ") + error.what() +
                               "; show the board larger, and tilted to all sides");
  }
  if (rms_px > kFarthestShare * lens.width_px) {
    char off[64];
    std::snprintf(off, sizeof off, "%.2f pixels from the best lens (RMS)", rms_px);
    throw InputError(name, "corners", off,
                     "at most 1/640 of the image's width: is it the board of --squares, flat, and one lens that stayed "
                     "as it was?");
  }
  const double largest = *std::max_element(sigma.begin(), sigma.begin() + 4) / lens.fx;
  if (largest <= kUndetermined) return;
  char found[64];
  std::snprintf(found, sizeof found, "uncertain by %.1f %% of fx", 100 * largest);
  throw InputError(name, "focal length or principal point", found,
                   "at most 2 %: show the board larger, and tilted to all sides");
}

/// Which side of the board is nearer to the camera (left, right, upper, lower as the camera sees it); -1: none by
/// kTiltDeg.
int nearer_side(const Eigen::Isometry3d& T_camera_board) {
  Eigen::Vector3d into = T_camera_board.linear().col(2);
  if (into.z() < 0) into = -into;
  // Depth falls towards where the board's normal points.
  const double right_rad = std::atan2(into.x(), into.z()), lower_rad = std::atan2(into.y(), into.z());
  const bool sideways = std::abs(right_rad) >= std::abs(lower_rad);
  const double tilt_rad = sideways ? right_rad : lower_rad;
  if (std::abs(tilt_rad) < kTiltDeg * std::numbers::pi / 180) return -1;
  return (sideways ? 0 : 2) + (tilt_rad > 0 ? 1 : 0);
}

constexpr std::array<const char*, 9> kNinths = {"upper left",   "upper middle", "upper right",  "middle left", "middle",
                                                "middle right", "lower left",   "lower middle", "lower right"};
constexpr std::array<const char*, 4> kSides = {"left", "right", "upper", "lower"};
constexpr int kWanted = 2;  // views in every ninth, and of every tilt

template <class... Values>
std::string text(const char* format, Values... values) {
  char buffer[256];
  std::snprintf(buffer, sizeof buffer, format, values...);
  return buffer;
}

/// To thousandths of a pixel, and as fine for the coefficients.
double rounded(double value, std::size_t number) {
  const double per_unit = number < 4 ? 1e3 : 1e6;
  return std::round(value * per_unit) / per_unit;
}

}  // namespace

LensCalibration calibrate_lens(const CharucoBoard& board, std::vector<BoardView>& views, const std::string& name,
                               const std::function<void()>& between) {
  for (;;) {
    between();
    const std::vector<BoardView*> used = used_views(views);
    if (used.size() < kMinViews) {
      throw InputError(name, "usable images", std::to_string(used.size()) + " of " + std::to_string(views.size()),
                       "at least " + std::to_string(kMinViews));
    }
    LensCalibration calibration;
    try {
      const Fit found = fit(board, used);
      calibration = numbers_of(found, used);
      add_residuals(board, found, used, calibration);
    } catch (const cv::Exception& error) {
      throw InputError(name, "the views do not determine a lens: " + error.err);
    }
    if (drop_outlier_corners(used) || reject_worst(used)) continue;
    check_determined(calibration, name);
    // If the board is never tilted, focal length and distance cannot be separated, however small the residuals.
    const Coverage coverage = coverage_of(calibration, views);
    if (std::count(coverage.tilted.begin(), coverage.tilted.end(), 0) == 4) {
      throw InputError(name, "tilted views", "none by 12 degrees", "some: show the board tilted to all sides");
    }
    return calibration;
  }
}

std::string lens_file(const LensCalibration& calibration, const std::string& source) {
  LensNumbers numbers = lens_numbers(calibration.lens);
  for (std::size_t i = 0; i < kLensNumbers; ++i) numbers[i] = rounded(numbers[i], i);
  const Lens lens = make_lens(calibration.lens.width_px, calibration.lens.height_px, numbers);
  const LensNumbers& s = calibration.sigma;
  std::string printable = source;  // a comment ends with its line
  std::replace_if(
      printable.begin(), printable.end(), [](char c) { return static_cast<unsigned char>(c) < ' '; }, ' ');
  std::string toml = "# The lens, calibrated from " + printable + "\n";
  toml += text("# %zu views, %zu corners, %.3f pixels from the model (RMS). Standard deviations:\n", calibration.views,
               calibration.corners, calibration.rms_px);
  toml += text("# fx %.3f, fy %.3f, cx %.3f, cy %.3f pixels; k1 %.5f, k2 %.5f, p1 %.5f, p2 %.5f, k3 %.5f\n", s[0], s[1],
               s[2], s[3], s[4], s[5], s[6], s[7], s[8]);
  toml += "# In a board file: lens = \"this file\" under [source], or these lines under [source.lens].\n";
  return toml + lens_text(lens);
}

std::string lens_text(const Lens& lens) {
  return text("width_px = %d\nheight_px = %d\n", lens.width_px, lens.height_px) + lens_toml(lens);
}

Lens read_lens_text(const std::string& text, const std::string& name, int width_px, int height_px) {
  return read_lens(TomlTable::parse_text(text, name), width_px, height_px);
}

Coverage coverage_of(const LensCalibration& calibration, std::vector<BoardView>& views) {
  const Lens& lens = calibration.lens;
  Coverage coverage;
  for (const BoardView* view : used_views(views)) {
    std::array<int, 9> corners{};
    for (const Vec2f& at : view->sight.corner_px) {
      const int column = std::clamp(static_cast<int>(3 * at.x() / static_cast<float>(lens.width_px)), 0, 2);
      const int row = std::clamp(static_cast<int>(3 * at.y() / static_cast<float>(lens.height_px)), 0, 2);
      ++corners[static_cast<std::size_t>(3 * row + column)];
    }
    for (std::size_t ninth = 0; ninth < 9; ++ninth) coverage.views[ninth] += corners[ninth] >= 3;
    const int side = nearer_side(view->T_camera_board);
    if (side >= 0) ++coverage.tilted[static_cast<std::size_t>(side)];
  }
  for (const std::size_t ninth : {0U, 2U, 6U, 8U}) {
    const Eigen::Vector2d corner(ninth % 3 == 0 ? 0 : lens.width_px - 1, ninth < 3 ? 0 : lens.height_px - 1);
    if (!ray_from_pixel(lens, corner).allFinite()) coverage.no_lens.push_back(kNinths[ninth]);
  }
  return coverage;
}

std::vector<std::string> advice(const Coverage& coverage) {
  std::vector<std::size_t> tilts;
  for (std::size_t side = 0; side < 4; ++side) {
    if (coverage.tilted[side] < kWanted) tilts.push_back(side);
  }
  const auto tilted = [](std::size_t side) {
    return std::string(", tilted so that its ") + kSides[side] + " side is nearer to the camera";
  };
  std::vector<std::string> lines;
  std::size_t next = 0;
  for (std::size_t ninth = 0; ninth < 9; ++ninth) {
    if (coverage.views[ninth] >= kWanted) continue;
    // Goes through the missing tilts in turn; if none is missing, any tilt will do.
    const std::string how = tilts.empty() ? ", tilted" : tilted(tilts[next++ % tilts.size()]);
    lines.push_back(std::string("show the board in the ") + kNinths[ninth] + how);
  }
  for (; next < tilts.size(); ++next) lines.push_back("show the board" + tilted(tilts[next]).substr(1));
  return lines;
}

}  // namespace finsight
