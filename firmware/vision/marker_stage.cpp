#include "firmware/vision/marker_stage.h"

#include <algorithm>
#include <cmath>

#include "firmware/input_error.h"
#include "firmware/vision/aruco_compat.h"
#include "firmware/vision/edge_corners.h"

namespace finsight {
namespace {

// A tilted marker looks smaller, a plate that is pushed towards the camera larger, than at rest.
constexpr float kSmallestSide = 0.5F, kLargestSide = 2.0F;
// OpenCV reads a code reliably from 4 pixels per module; more only costs time, because the corners are found again in
// the full image.
constexpr float kSearchedSidePx = 24;
constexpr int kLargestShrink = 4;
// A followed marker may move this many of its own sizes from one frame to the next: 6 mm, twice what a finger that
// springs back does in 1/60 s.
constexpr float kWindowMargin = 0.75F;
// While a marker is missing and others are followed, the whole image is searched in every eighth frame: a marker that
// comes back is seen within 0.13 s, and the mean frame costs little more.
constexpr int kSearchPeriod = 8;
// Until then its window is tried: noise or a fast move may hide a code for a frame or two.
constexpr int kNotFollowed = kSearchPeriod;

/// How much smaller an image may be searched for a marker with sides of this length.
int shrink_for(float side_px) {
  return static_cast<int>(std::clamp(side_px / kSearchedSidePx, 1.0F, static_cast<float>(kLargestShrink)));
}

void check_mount(const MountModel& mount) {
  for (std::size_t p = 0; p < kPlates; ++p) {
    const int id = mount.marker_id[p];
    const bool taken = std::count(mount.marker_id.begin(), mount.marker_id.end(), id) > 1;
    if (id < 0 || id >= kDictionaryMarkers || taken) {
      throw InputError("mount", "marker_id", std::to_string(id), "three different ids of DICT_4X4_50 (0 ... 49)");
    }
  }
  if (!(mount.marker_size_mm > 0 && mount.marker_size_mm < 1000)) {
    throw InputError("mount", "marker_size_mm", std::to_string(mount.marker_size_mm), "a positive length");
  }
}

/// Length of the marker's side in the image when nothing touches the finger, seen face-on.
float side_at_rest_px(const MountModel& mount, const Lens& camera, std::size_t plate) {
  const Vec3f centre = mount.T_finger_camera.inverse() * mount.T_finger_marker[plate].translation();
  if (!(centre.z() > mount.marker_size_mm) || !centre.allFinite()) {
    throw InputError("mount", "T_finger_marker[" + std::to_string(plate) + "]",
                     std::to_string(centre.z()) + " mm before the camera", "more than the marker's size");
  }
  return mount.marker_size_mm * static_cast<float>(camera.fx) / centre.norm();
}

}  // namespace

MarkerStage::MarkerStage(const MountModel& mount, const Lens& camera) : camera_(camera), marker_id_(mount.marker_id) {
  check_lens(camera);
  check_mount(mount);
  std::array<float, kPlates> side_px;
  for (std::size_t p = 0; p < kPlates; ++p) side_px[p] = side_at_rest_px(mount, camera, p);
  const auto [smallest, largest] = std::minmax_element(side_px.begin(), side_px.end());
  sides_ = {*smallest * kSmallestSide, *largest * kLargestSide};
  shrink_ = shrink_for(*smallest);
  missed_.fill(kNotFollowed);
}

const MarkerCorners& MarkerStage::find(const Frame& frame) {
  corners_.seen.fill(false);
  if (!is_of_camera(frame)) {
    missed_.fill(kNotFollowed);
    return corners_;
  }
  const ImageView image{frame.grey, frame.width_px, frame.height_px, frame.stride_bytes, frame.coding};
  follow(image);

  bool any = false, lost = false, missing = false;
  for (std::size_t p = 0; p < kPlates; ++p) {
    any |= corners_.seen[p];
    missing |= !corners_.seen[p];
    lost |= missed_[p] == 0 && !corners_.seen[p];
  }
  if (missing && (lost || !any || --frames_until_search_ <= 0)) {
    search(image);
    frames_until_search_ = kSearchPeriod;
  }
  for (std::size_t p = 0; p < kPlates; ++p) missed_[p] = corners_.seen[p] ? 0 : std::min(missed_[p] + 1, kNotFollowed);
  return corners_;
}

bool MarkerStage::is_of_camera(const Frame& frame) const {
  return frame.grey && frame.width_px == camera_.width_px && frame.height_px == camera_.height_px &&
         frame.stride_bytes >= frame.width_px;
}

// Each window is asked for its own marker only, so a neighbour that reaches into it cannot count as a second one.
void MarkerStage::follow(const ImageView& image) {
  for (std::size_t p = 0; p < kPlates; ++p) {
    if (missed_[p] >= kNotFollowed) continue;
    const std::array<Vec2f, 4> corners = corners_.corners_px[p];
    Vec2f low = corners[0], high = low;
    float shortest_px = (corners[3] - corners[0]).norm();
    for (std::size_t k = 1; k < 4; ++k) {
      low = low.cwiseMin(corners[k]);
      high = high.cwiseMax(corners[k]);
      shortest_px = std::min(shortest_px, (corners[k] - corners[k - 1]).norm());
    }
    const float margin = kWindowMargin * (high - low).maxCoeff();
    const int left = std::max(0, static_cast<int>(low.x() - margin));
    const int top = std::max(0, static_cast<int>(low.y() - margin));
    const int right = std::min(image.width_px, static_cast<int>(high.x() + margin) + 1);
    const int bottom = std::min(image.height_px, static_cast<int>(high.y() + margin) + 1);
    const ImageView window{image.at(left, top), right - left, bottom - top, image.stride_bytes, image.coding};
    const Vec2f offset(static_cast<float>(left), static_cast<float>(top));
    corners_.seen[p] =
        take(image, detector_.find(window, shrink_for(shortest_px), sides_), offset, p) || take_at(image, p, corners);
  }
}

void MarkerStage::search(const ImageView& image) {
  const std::vector<FoundMarker>& found = detector_.find(image, shrink_, sides_);
  for (std::size_t p = 0; p < kPlates; ++p) {
    if (!corners_.seen[p]) corners_.seen[p] = take(image, found, Vec2f::Zero(), p);
  }
}

bool MarkerStage::take(const ImageView& image, const std::vector<FoundMarker>& found, const Vec2f& offset,
                       std::size_t plate) {
  const FoundMarker* only = nullptr;
  for (const FoundMarker& marker : found) {
    if (marker.id != marker_id_[plate]) continue;
    if (only) return false;
    only = &marker;
  }
  if (!only) return false;
  std::array<Vec2f, 4> corners = only->corners_px;
  for (Vec2f& corner : corners) corner += offset;
  const std::optional<EdgeQuality> edges = refine_corners(image, camera_, corners);
  if (!edges || !detector_.confirm(image, corners, marker_id_[plate])) return false;
  corners_.corners_px[plate] = corners;
  edges_[plate] = *edges;
  return true;
}

bool MarkerStage::find_at(const Frame& frame, std::size_t plate, const std::array<Vec2f, 4>& expected_px) {
  const ImageView image{frame.grey, frame.width_px, frame.height_px, frame.stride_bytes, frame.coding};
  if (corners_.seen[plate] || !is_of_camera(frame) || !take_at(image, plate, expected_px)) return false;
  corners_.seen[plate] = true;
  missed_[plate] = 0;
  return true;
}

/// Where the search sees no square, because a reflection breaks its outline or code, but corners are expected.
bool MarkerStage::take_at(const ImageView& image, std::size_t plate, const std::array<Vec2f, 4>& expected_px) {
  std::array<Vec2f, 4> corners = expected_px;
  const std::optional<EdgeQuality> edges = refine_corners(image, camera_, corners);
  if (!edges || !detector_.confirm_partly(image, corners, marker_id_[plate])) return false;
  corners_.corners_px[plate] = corners;
  edges_[plate] = *edges;
  return true;
}

}  // namespace finsight
