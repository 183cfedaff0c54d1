#include "firmware/device/page_publisher.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <nlohmann/json.hpp>

#include "firmware/settings/measured_fit.h"
#include "firmware/vision/ippe.h"

namespace finsight {

namespace {

constexpr float kPerMm = 100;            // the shape is in 0.01 mm
constexpr int kFramesBetweenTimes = 30;  // percentiles take some microseconds

std::vector<float> rest_of(const SurfaceMesh& surface, const ShapeModel& shape) {
  std::vector<float> rest_mm;
  for (const std::int32_t node : surface.nodes) {
    for (int axis = 0; axis < 3; ++axis) rest_mm.push_back(shape.rest_mm[static_cast<std::size_t>(3 * node + axis)]);
  }
  return rest_mm;
}

/// Where the markers' corners are in the picture while nothing touches the finger.
nlohmann::json markers_at_rest(const MountModel& mount, const Lens& lens) {
  nlohmann::json markers = nlohmann::json::array();
  for (std::size_t p = 0; p < kPlates; ++p) {
    nlohmann::json corners = nlohmann::json::array();
    for (std::size_t k = 0; k < 4; ++k) {
      const Eigen::Vector3d at =
          mount.T_finger_camera.cast<double>().inverse() *
          (mount.T_finger_marker[p].cast<double>() * marker_corner(static_cast<double>(mount.marker_size_mm), k));
      const Eigen::Vector2d pixel = pixel_from_ray(lens, at.head<2>() / at.z());
      corners.push_back({pixel.x(), pixel.y()});
    }
    markers.push_back({{"plate", kPlateNames[p]}, {"id", mount.marker_id[p]}, {"rest_px", corners}});
  }
  return markers;
}

const char* name_of(Settings::Source source) {
  switch (source) {
    case Settings::Source::kSession:
      return "session";
    case Settings::Source::kPoses:
      return "poses";
    case Settings::Source::kCamera:
      break;
  }
  return "camera";
}

BlockContents contents_of(const Settings& settings, const Model& model, const SurfaceMesh& surface,
                          const std::vector<float>& rest_mm, const std::optional<SessionInfo>& images,
                          const LoopSettings& loop) {
  const MountModel mount = loop.mount.value_or(model.mount);
  std::vector<std::uint8_t> is_front(static_cast<std::size_t>(model.shape.nodes));
  for (const std::int32_t node : model.shape.front_nodes) is_front[static_cast<std::size_t>(node)] = 1;
  std::vector<int> front;
  for (const std::int32_t node : surface.nodes) front.push_back(is_front[static_cast<std::size_t>(node)]);
  nlohmann::json about = {{"firmware_version", FINSIGHT_VERSION},
                          {"finger", model.finger_name},
                          {"pack", settings.pack.filename()},
                          {"pack_checksum", checksum_text(model.checksum)},
                          {"rated_deformation_mm", model.rated_deformation_mm},
                          {"mount_is_measured", settings.mount.has_value()},
                          {"marker_size_mm", mount.marker_size_mm},
                          {"source", name_of(settings.source)},
                          {"surface", {{"rest_mm", rest_mm}, {"triangles", surface.triangles}, {"front", front}}}};
  BlockContents contents{.shape_points = static_cast<int>(surface.nodes.size()), .about = {}};
  if (images) {
    contents.width_px = images->lens.width_px;
    contents.height_px = images->lens.height_px;
    about["frames_per_second"] = images->frames_per_second;
    nlohmann::json lens = {{"width_px", images->lens.width_px}, {"height_px", images->lens.height_px}};
    const LensNumbers numbers = lens_numbers(images->lens);
    for (std::size_t i = 0; i < numbers.size(); ++i) lens[kLensNames[i]] = numbers[i];
    about["lens"] = lens;
    about["markers"] = markers_at_rest(mount, images->lens);
  }
  about["modbus"] = {{"address", settings.modbus.address}, {"port", settings.modbus.port}, {"unit", settings.unit}};
  about["mount"] = measured_mount_toml(poses_of(mount));
  if (loop.fit) about["fit"] = measured_fit_toml(*loop.fit);
  contents.about = about.dump();
  return contents;
}

std::array<float, 6> six_of(const PlateMotion& motion) {
  const Vec3f &d = motion.displacement_mm, &r = motion.rotation_rad;
  return {d.x(), d.y(), d.z(), r.x(), r.y(), r.z()};
}

PublishedTimes times_of(const TimeHistogram& times) {
  return {static_cast<float>(times.percentile_us(0.5)), static_cast<float>(times.percentile_us(0.99)),
          static_cast<float>(times.worst_us())};
}

}  // namespace

SurfaceMesh surface_of(const ShapeModel& shape) {
  // A face of two tetrahedra is inside. The corners of each are those that one sees from outside, anticlockwise, of a
  // positively oriented tetrahedron.
  constexpr int kFaces[4][3] = {{0, 2, 1}, {0, 1, 3}, {0, 3, 2}, {1, 2, 3}};
  std::map<std::array<std::int32_t, 3>, std::array<std::int32_t, 3>> faces;
  for (int t = 0; t < shape.tets; ++t) {
    for (const auto& face : kFaces) {
      std::array<std::int32_t, 3> corners{};
      for (std::size_t k = 0; k < 3; ++k) corners[k] = shape.tet_nodes[static_cast<std::size_t>(4 * t + face[k])];
      std::array<std::int32_t, 3> key = corners;
      std::ranges::sort(key);
      if (const auto found = faces.find(key); found != faces.end()) {
        faces.erase(found);
      } else {
        faces.emplace(key, corners);
      }
    }
  }
  SurfaceMesh surface;
  for (const auto& [key, corners] : faces) surface.nodes.insert(surface.nodes.end(), corners.begin(), corners.end());
  std::ranges::sort(surface.nodes);
  surface.nodes.erase(std::unique(surface.nodes.begin(), surface.nodes.end()), surface.nodes.end());
  for (const auto& [key, corners] : faces) {
    for (const std::int32_t node : corners) {
      const auto at = std::ranges::lower_bound(surface.nodes, node);
      surface.triangles.push_back(static_cast<std::int32_t>(at - surface.nodes.begin()));
    }
  }
  return surface;
}

PagePublisher::PagePublisher(const Settings& settings, const Model& model, const std::optional<SessionInfo>& images,
                             const LoopSettings& loop)
    : surface_(surface_of(model.shape)),
      rest_mm_(rest_of(surface_, model.shape)),
      block_(settings.page->folder, contents_of(settings, model, surface_, rest_mm_, images, loop)),
      has_image_(images.has_value()),
      shape_(rest_mm_.size()) {}

void PagePublisher::note_times(const StageTimes& times) {
  if (--frames_until_times_ > 0) return;
  frames_until_times_ = kFramesBetweenTimes;
  frame_.times = {times_of(times.poses), times_of(times.shape), times_of(times.touch), times_of(times.registers),
                  times_of(times.frame)};
}

void PagePublisher::note_zero(const FrameLoop& loop) {
  const std::optional<ZeroPose>& zero = loop.zeroing().zero();
  const std::optional<Vec3f>& g = loop.gravity().at_zero();
  frame_.has_zero = zero.has_value();
  frame_.has_zero_g = g.has_value();
  if (zero) {
    for (std::size_t p = 0; p < kPlates; ++p) frame_.zero[p] = six_of((*zero)[p]);
  }
  if (g) frame_.zero_g = {g->x(), g->y(), g->z()};
}

void PagePublisher::publish(const FrameLoop& loop, const RegisterImage& registers, const Frame* picture,
                            std::int64_t work_ns) {
  const FrameLoop::View& view = loop.view();
  frame_.exposure_ns = loop.state().exposure_ns;
  frame_.published_ns = loop.state().published_ns;
  frame_.words = registers.words;
  frame_.process = registers.process;
  frame_.has_image = has_image_;
  frame_.work_us = static_cast<float>(work_ns) / 1000;
  for (std::size_t p = 0; p < kPlates; ++p) {
    frame_.marker_found[p] = view.corners && view.corners->seen[p];
    frame_.plate_seen[p] = view.poses.seen[p];
    frame_.reprojection_px[p] = view.poses.reprojection_px[p];
    frame_.plate[p] = six_of(view.poses.plates[p]);
    if (!frame_.marker_found[p]) continue;
    for (std::size_t k = 0; k < 4; ++k) {
      frame_.corners_px[p][k] = {view.corners->corners_px[p][k].x(), view.corners->corners_px[p][k].y()};
    }
  }
  note_zero(loop);
  note_times(loop.times());
  std::span<const std::int16_t> shape;
  if (block_.is_watched() && view.shape.quality != Quality::kInvalid && !view.shape.node_mm.empty()) {
    for (std::size_t i = 0; i < surface_.nodes.size(); ++i) {
      for (std::size_t axis = 0; axis < 3; ++axis) {
        const std::size_t node = static_cast<std::size_t>(surface_.nodes[i]);
        const float moved = (view.shape.node_mm[3 * node + axis] - rest_mm_[3 * i + axis]) * kPerMm;
        shape_[3 * i + axis] = static_cast<std::int16_t>(std::clamp(moved, -32767.0F, 32767.0F));
      }
    }
    shape = shape_;
  }
  block_.publish(frame_, shape, picture && block_.wants_picture(frame_.exposure_ns) ? picture : nullptr);
}

}  // namespace finsight
