#include "hostgen/recordings/pen_distance.h"

#include <limits>
#include <map>

#include "firmware/model/plate_prior.h"
#include "firmware/shape/shape_stage.h"
#include "hostgen/recordings/audit.h"
#include "hostgen/util/common.h"
#include "hostgen/util/statistics.h"

namespace finsight::host {

namespace {

Vec3f node_at(std::span<const float> node_mm, std::int32_t node) {
  return Eigen::Map<const Vec3f>(node_mm.data() + 3 * static_cast<std::size_t>(node));
}

/// A point of the face: a node and the offset from it.
struct SurfacePoint {
  std::int32_t node = 0;
  Vec3f rest_mm = Vec3f::Zero();
};

SurfacePoint surface_point(const ShapeModel& shape, const Vec3f& place_mm) {
  SurfacePoint point;
  float nearest_sq = std::numeric_limits<float>::infinity();
  for (const std::int32_t node : shape.front_nodes) {
    const Vec3f at = node_at(shape.rest_mm, node);
    const float distance_sq = (at - place_mm).head<2>().squaredNorm();
    if (distance_sq >= nearest_sq) continue;
    nearest_sq = distance_sq;
    point = {node, Vec3f(place_mm.x(), place_mm.y(), at.z())};
  }
  return point;
}

}  // namespace

PenDistance measure_pen_distance(const RecordedMotion& motion, const Model& model, std::size_t max_rows) {
  const std::vector<bool> outlier = find_outliers(motion);
  std::map<int, SurfacePoint> points;
  for (const RecordingAudit::Point& point : audit_recordings(motion).points) {
    points[point.surface_node] = surface_point(model.shape, point.place_mm);
  }
  std::vector<std::size_t> rows;
  for (std::size_t row = 0; row < outlier.size(); ++row) {
    if (!outlier[row]) rows.push_back(row);
  }
  const std::size_t count = std::min(max_rows, rows.size());

  // Every row on its own: the chosen rows are far apart in time.
  ShapeStage stage(model, {.tier = ShapeSettings::Tier::kMapAndNewton, .factorisations = 2, .chord_steps = 1});
  PenDistance result{.rows = count};
  std::vector<double> distances;
  Progress progress("shapes of recorded poses", count);
  for (std::size_t k = 0; k < count; ++k) {
    if (interrupted()) throw Interrupted();
    const std::size_t row = rows[k * rows.size() / count];
    PlatePoses poses = motion.poses[row];
    complete_from_prior(model.prior, poses);
    const FingerShape& shape = stage.solve(poses);
    const SurfacePoint& point = points.at(motion.surface_node[row]);
    const Vec3f moved_mm = node_at(shape.node_mm, point.node) - node_at(model.shape.rest_mm, point.node);
    distances.push_back(static_cast<double>((point.rest_mm + moved_mm - motion.pen_mm[row]).norm()));
    result.mean_mm += distances.back() / static_cast<double>(count);
    result.rest_mean_mm +=
        static_cast<double>((point.rest_mm - motion.pen_mm[row]).norm()) / static_cast<double>(count);
    progress.advance();
  }
  result.error_95_mm = quantile(std::move(distances), 0.95);
  return result;
}

}  // namespace finsight::host
