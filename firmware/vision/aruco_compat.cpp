#include "firmware/vision/aruco_compat.h"

#include <algorithm>
#include <exception>
#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>
#include <stdexcept>
#include <string>

#if CV_VERSION_MAJOR == 4 && CV_VERSION_MINOR <= 6
#include <opencv2/aruco.hpp>
#define FINSIGHT_ARUCO_CONTRIB 1
#elif CV_VERSION_MAJOR == 4 && CV_VERSION_MINOR >= 9
#include <opencv2/objdetect/aruco_detector.hpp>
#define FINSIGHT_ARUCO_CONTRIB 0
#else
#error "OpenCV 4.6 or earlier with the aruco module, or 4.9 or later with objdetect, is needed"
#endif

namespace finsight {
namespace {

using OpenCvCorners = std::vector<std::vector<cv::Point2f>>;

/// Every parameter that decides what is found; defaults differ between versions of OpenCV, so none is left to them.
/// Lengths are pixels of the searched picture.
void set_parameters(cv::aruco::DetectorParameters& p) {
  // Local threshold: a window wider than one module (4 ... 12 pixels here) keeps the black border one solid ring. Two
  // windows, because the markers' distances from the camera differ by a factor of two.
  p.adaptiveThreshWinSizeMin = 11;
  p.adaptiveThreshWinSizeMax = 23;
  p.adaptiveThreshWinSizeStep = 12;
  p.adaptiveThreshConstant = 7;  // grey levels below the local mean: above the noise, far below the ink's contrast
  p.polygonalApproxAccuracyRate = 0.04;  // of the perimeter: 16 % of a side, so blurred and bent sides stay four
  p.minCornerDistanceRate = 0.08;        // of the perimeter: no side shorter than a third of the mean side
  p.minDistanceToBorder = 2;             // the corners' refinement needs pixels outside the square
  // Squares closer than this share of the perimeter are one. The marker's white margin is a square too, one module
  // (0.059 of the perimeter) away, and must stay another one: OpenCV 4.6 keeps only the larger of two. What has to be
  // merged, the same edge found by both thresholds, differs by one or two pixels.
  p.minMarkerDistanceRate = 0.02;
  p.cornerRefinementMethod = cv::aruco::CORNER_REFINE_NONE;  // corners are refined by edge_corners.h
  p.markerBorderBits = 1;
  p.perspectiveRemovePixelPerCell = 8;  // samples along a module ...
  p.perspectiveRemoveIgnoredMarginPerCell =
      0.25;  // ... of which a quarter at either end is left out: corners are coarse
  // Codes have 16 bits and differ in 4 or more; accepting wrong bits would let strangers pass. In the border one module
  // in 16 may be dirty.
  p.errorCorrectionRate = 0;
  p.maxErroneousBitsInBorderRate = 0.0625;
  p.minOtsuStdDev = 8;  // grey levels; less contrast than that is no marker
  p.detectInvertedMarker = false;
  p.useAruco3Detection = false;
#if !FINSIGHT_ARUCO_CONTRIB
  p.minGroupDistance = 0.21F;  // modules; of several squares in one another, also try those this far apart
#endif
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
    if (other.id != marker.id || (centre(other) - centre(marker)).norm() > perimeter(marker) / 16) continue;
    if (perimeter(marker) > perimeter(other)) other = marker;
    return;
  }
  found.push_back(marker);
}

}  // namespace

struct MarkerDetector::OpenCv {
  void limit_sides(const cv::Mat& picture, const SideLimits& sides, float shrink) {
    // OpenCV wants perimeters relative to the picture's longer side.
    const float longer = static_cast<float>(std::max(picture.cols, picture.rows));
    const double smallest = 4 * sides.smallest_px / (shrink * longer);
    const double largest = 4 * sides.largest_px / (shrink * longer);
#if FINSIGHT_ARUCO_CONTRIB
    parameters->minMarkerPerimeterRate = smallest;
    parameters->maxMarkerPerimeterRate = largest;
#else
    cv::aruco::DetectorParameters parameters = detector.getDetectorParameters();
    parameters.minMarkerPerimeterRate = smallest;
    parameters.maxMarkerPerimeterRate = largest;
    detector.setDetectorParameters(parameters);
#endif
  }

  void detect(const cv::Mat& picture) {
#if FINSIGHT_ARUCO_CONTRIB
    cv::aruco::detectMarkers(picture, dictionary, corners, ids, parameters);
#else
    detector.detectMarkers(picture, corners, ids);
#endif
  }

#if FINSIGHT_ARUCO_CONTRIB
  cv::Ptr<cv::aruco::Dictionary> dictionary = cv::aruco::getPredefinedDictionary(cv::aruco::DICT_4X4_50);
  cv::Ptr<cv::aruco::DetectorParameters> parameters = cv::aruco::DetectorParameters::create();
#else
  cv::aruco::ArucoDetector detector{cv::aruco::getPredefinedDictionary(cv::aruco::DICT_4X4_50)};
#endif
  cv::Mat reduced;
  OpenCvCorners corners;
  std::vector<int> ids;
};

MarkerDetector::MarkerDetector() : opencv_(std::make_unique<OpenCv>()) {
  // One thread: the other cores belong to the server and the recorder, and waking a pool takes longer than a window.
  cv::setNumThreads(1);
  cv::redirectError([](int, const char*, const char*, const char*, int, void*) { return 0; });
#if FINSIGHT_ARUCO_CONTRIB
  set_parameters(*opencv_->parameters);
#else
  cv::aruco::DetectorParameters parameters;
  set_parameters(parameters);
  opencv_->detector.setDetectorParameters(parameters);
#endif
}

MarkerDetector::~MarkerDetector() = default;
MarkerDetector::MarkerDetector(MarkerDetector&&) noexcept = default;
MarkerDetector& MarkerDetector::operator=(MarkerDetector&&) noexcept = default;

const std::vector<FoundMarker>& MarkerDetector::find(const GreyView& picture, int shrink, const SideLimits& sides) {
  found_.clear();
  try {
    // OpenCV takes no pointer to constant pixels, though it only reads them.
    const cv::Mat whole(picture.height_px, picture.width_px, CV_8UC1, const_cast<std::uint8_t*>(picture.pixels),
                        static_cast<std::size_t>(picture.stride_bytes));
    cv::Mat searched = whole;
    if (shrink > 1) {
      const cv::Size size(picture.width_px / shrink, picture.height_px / shrink);
      cv::resize(whole(cv::Rect(0, 0, size.width * shrink, size.height * shrink)), opencv_->reduced, size, 0, 0,
                 cv::INTER_AREA);
      searched = opencv_->reduced;
    }
    opencv_->limit_sides(searched, sides, static_cast<float>(shrink));
    opencv_->detect(searched);
    const float scale = static_cast<float>(shrink), shift = (scale - 1) / 2;  // centre of a reduced pixel
    for (std::size_t i = 0; i < opencv_->ids.size(); ++i) {
      FoundMarker marker{opencv_->ids[i], {}};
      for (std::size_t k = 0; k < 4; ++k) {
        const cv::Point2f corner = opencv_->corners[i][k];
        marker.corners_px[k] = Vec2f(corner.x * scale + shift, corner.y * scale + shift);
      }
      add_once(marker, found_);
    }
  } catch (const std::exception&) {
    found_.clear();
  }
  return found_;
}

std::array<std::uint8_t, 36> marker_modules(int id) {
  if (id < 0 || id >= kDictionaryMarkers) {
    throw std::invalid_argument("marker id " + std::to_string(id) + " is not one of DICT_4X4_50 (0 ... 49)");
  }
#if FINSIGHT_ARUCO_CONTRIB
  const cv::Mat codes = cv::aruco::getPredefinedDictionary(cv::aruco::DICT_4X4_50)->bytesList;
#else
  const cv::Mat codes = cv::aruco::getPredefinedDictionary(cv::aruco::DICT_4X4_50).bytesList;
#endif
  const cv::Mat bits = cv::aruco::Dictionary::getBitsFromByteList(codes.row(id), 4);
  std::array<std::uint8_t, 36> modules{};
  for (int row = 0; row < 4; ++row) {
    for (int column = 0; column < 4; ++column) {
      modules[static_cast<std::size_t>((row + 1) * 6 + column + 1)] = bits.at<std::uint8_t>(row, column);
    }
  }
  return modules;
}

}  // namespace finsight
