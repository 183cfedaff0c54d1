// Frame -> MarkerCorners.
#pragma once

#include "firmware/geometry/lens.h"
#include "firmware/model/model.h"
#include "firmware/vision/edge_corners.h"
#include "firmware/vision/marker_detector.h"

namespace finsight {

/// Finds the three markers' corners, to about 0.02 pixels in a sharp image. Markers are tracked in a window around
/// their last position, also for some frames in which they are not seen there, and looked for once more where their
/// corners were then. The whole image is searched when one of
/// them is lost, while none is seen, and every eighth frame while one is missing.
class MarkerStage {
 public:
  /// Throws InputError for an impossible lens, for marker ids that DICT_4X4_50 does not have or that are not
  /// all different, and for markers that are not in front of the camera at rest.
  MarkerStage(const MountModel& mount, const Lens& camera);
  MarkerStage(const Model& model, const Lens& camera) : MarkerStage(model.mount, camera) {}

  /// Markers not found, found at two places, with edges that are not straight, or with another code when read at full
  /// size are not seen; neither is any in a frame without an image or of another size than the camera's. Allocates
  /// (OpenCV does), never throws.
  const MarkerCorners& find(const Frame& frame);
  /// Looks once more for a plate that find() did not see, where its corners should be to half a module (a sixth of a
  /// side), in the same frame. Reflections may hide part of its edges and up to five of its sixteen modules. True: it
  /// is seen now.
  bool find_at(const Frame& frame, std::size_t plate, const std::array<Vec2f, 4>& expected_px);
  /// Of the markers that are seen.
  const std::array<EdgeQuality, kPlates>& edges() const { return edges_; }
  const MarkerCorners& last() const { return corners_; }  ///< what find() returned

 private:
  void follow(const ImageView& image);
  void search(const ImageView& image);
  bool is_of_camera(const Frame& frame) const;
  bool take_at(const ImageView& image, std::size_t plate, const std::array<Vec2f, 4>& expected_px);
  bool take(const ImageView& image, const std::vector<FoundMarker>& found, const Vec2f& offset, std::size_t plate);

  Lens camera_;
  std::array<int, kPlates> marker_id_;
  SideLimits sides_;
  int shrink_ = 1;  ///< how much smaller the whole image is searched
  MarkerDetector detector_;
  MarkerCorners corners_{};
  std::array<EdgeQuality, kPlates> edges_{};
  /// Frames since each marker was seen, kNotFollowed where its window is no longer searched.
  std::array<int, kPlates> missed_;
  int frames_until_search_ = 0;
};

}  // namespace finsight
