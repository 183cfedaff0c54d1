// Publishes what the commissioning page shows. See firmware/published/block.h.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "firmware/loop/frame_loop.h"
#include "firmware/model/model.h"
#include "firmware/published/block.h"
#include "firmware/settings/settings.h"

namespace finsight {

/// The outer surface of a mesh of tetrahedra.
struct SurfaceMesh {
  std::vector<std::int32_t> nodes;      ///< of the mesh, ascending: the surface's points
  std::vector<std::int32_t> triangles;  ///< [triangles, 3] points; seen from outside, their corners go anticlockwise
};
SurfaceMesh surface_of(const ShapeModel& shape);

class PagePublisher {
 public:
  /// `images`: what the source's images are like; nothing if it has none. `loop`: what the frame loop was made
  /// with. Throws std::system_error if the block cannot be created.
  PagePublisher(const Settings& settings, const Model& model, const std::optional<SessionInfo>& images,
                const LoopSettings& loop);

  /// The frame that `loop` has just processed; `work_ns`: since its arrival. `picture` may be null. Never allocates,
  /// locks or waits.
  void publish(const FrameLoop& loop, const RegisterImage& registers, const Frame* picture, std::int64_t work_ns);

 private:
  void note_times(const StageTimes& times);
  void note_zero(const FrameLoop& loop);

  const SurfaceMesh surface_;
  const std::vector<float> rest_mm_;  ///< of the surface's points, [points, 3]
  BlockWriter block_;
  const bool has_image_;
  PublishedFrame frame_;
  std::vector<std::int16_t> shape_;  ///< [points, 3]
  int frames_until_times_ = 0;
};

}  // namespace finsight
