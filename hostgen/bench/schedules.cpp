#include "hostgen/bench/schedules.h"

#include <Eigen/LU>
#include <algorithm>
#include <limits>
#include <stdexcept>

#include "firmware/shape/newton.h"
#include "firmware/shape/soft_newton.h"
#include "hostgen/util/common.h"
#include "hostgen/util/statistics.h"
#include "hostgen/util/stopwatch.h"

namespace finsight::host {

namespace {

Eigen::Vector3d rest_of(const ShapeModel& model, int node) {
  return Eigen::Map<const Eigen::Vector3f>(&model.rest_mm[3 * static_cast<std::size_t>(node)]).cast<double>();
}

/// A node's place in a tetrahedron.
struct Place {
  int tet = 0;
  Eigen::Vector4d weight = Eigen::Vector4d::Zero();
};

// The tetrahedron in which the smallest barycentric coordinate is largest: the one that holds the point, or the one
// that it is least outside of.
Place place_in(const ShapeModel& fine, const std::vector<Eigen::Matrix3d>& inverse_edges,
               const Eigen::Vector3d& point) {
  Place best;
  double best_smallest = -std::numeric_limits<double>::infinity();
  for (int t = 0; t < fine.tets; ++t) {
    Eigen::Vector4d weight;
    weight.tail<3>() = inverse_edges[static_cast<std::size_t>(t)] * (point - rest_of(fine, fine.tet_nodes[4 * t]));
    weight[0] = 1 - weight.tail<3>().sum();
    if (weight.minCoeff() > best_smallest) {
      best_smallest = weight.minCoeff();
      best = {t, weight};
    }
  }
  return best;
}

}  // namespace

template <class S>
ScheduleResult run_schedule(const ShapeModel& model, const MountModel& mount, const PlateMotionPath& motion,
                            const Shapes& converged, int factorisations, int chord_steps) {
  NewtonSolver<S> solver(model, mount);
  std::vector<double> us;
  ScheduleResult result;
  for (std::size_t k = 0; k < motion.frames.size(); ++k) {
    if (interrupted()) throw Interrupted();
    ProcessorStopwatch watch;
    const bool ok = solver.solve(motion.frames[k], factorisations, chord_steps).ok;
    us.push_back(watch.lap_us());
    if (!ok) throw std::runtime_error("bench: " + motion.name + ": frame " + std::to_string(k) + " has no shape");
    const ShapeDistance d = shape_distance(solver.node_mm(), std::span<const double>(converged[k]));
    result.distance.worst_mm = std::max(result.distance.worst_mm, d.worst_mm);
    result.distance.mean_mm += d.mean_mm / static_cast<double>(motion.frames.size());
  }
  result.us_per_frame = quantile(us, 0.5);
  result.quartiles_us = {quantile(us, 0.25), quantile(us, 0.75)};
  return result;
}
template ScheduleResult run_schedule<float>(const ShapeModel&, const MountModel&, const PlateMotionPath&, const Shapes&,
                                            int, int);
template ScheduleResult run_schedule<double>(const ShapeModel&, const MountModel&, const PlateMotionPath&,
                                             const Shapes&, int, int);

ScheduleResult run_published(const ShapeModel& soft, const MountModel& mount, const PlateMotionPath& motion,
                             const Shapes& converged, double iteration_us) {
  SoftNewtonSolver<double> solver(soft, mount);
  std::vector<double> us;
  ScheduleResult result;
  for (std::size_t k = 0; k < motion.frames.size(); ++k) {
    if (interrupted()) throw Interrupted();
    us.push_back(solver.converge(motion.frames[k]).steps * iteration_us);
    const ShapeDistance d = shape_distance(solver.node_mm(), std::span<const double>(converged[k]));
    result.distance.worst_mm = std::max(result.distance.worst_mm, d.worst_mm);
    result.distance.mean_mm += d.mean_mm / static_cast<double>(motion.frames.size());
  }
  result.us_per_frame = quantile(us, 0.5);
  result.quartiles_us = {quantile(us, 0.25), quantile(us, 0.75)};
  return result;
}

Shapes shapes_at_nodes(const ShapeModel& fine, const Shapes& fine_shapes, const ShapeModel& coarse) {
  std::vector<Eigen::Matrix3d> inverse_edges;
  for (int t = 0; t < fine.tets; ++t) {
    Eigen::Matrix3d edges;
    for (int c = 0; c < 3; ++c) {
      edges.col(c) = rest_of(fine, fine.tet_nodes[4 * t + c + 1]) - rest_of(fine, fine.tet_nodes[4 * t]);
    }
    inverse_edges.push_back(edges.inverse());
  }
  std::vector<Place> places(static_cast<std::size_t>(coarse.nodes));
  parallel_for(places.size(), [&](std::size_t node) {
    places[node] = place_in(fine, inverse_edges, rest_of(coarse, static_cast<int>(node)));
  });
  Shapes shapes;
  for (const std::vector<double>& shape : fine_shapes) {
    std::vector<double>& at_nodes = shapes.emplace_back();
    for (const Place& place : places) {
      Eigen::Vector3d at = Eigen::Vector3d::Zero();
      for (int c = 0; c < 4; ++c) {
        at += place.weight[c] * Eigen::Map<const Eigen::Vector3d>(
                                    &shape[3 * static_cast<std::size_t>(fine.tet_nodes[4 * place.tet + c])]);
      }
      at_nodes.insert(at_nodes.end(), at.begin(), at.end());
    }
  }
  return shapes;
}

}  // namespace finsight::host
