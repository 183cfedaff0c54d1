#include "firmware/vision/aruco_compat.h"

#include <opencv2/core.hpp>
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
