// Fixed schedules of the Newton solver over a motion: time per frame against the distance to the converged shape.
#pragma once

#include <array>

#include "hostgen/hard_cases/motions.h"
#include "hostgen/hard_cases/shape_distance.h"

namespace finsight::host {

struct ScheduleResult {
  double us_per_frame = 0;               ///< median
  std::array<double, 2> quartiles_us{};  ///< of a frame's time: the lower and the upper
  ShapeDistance distance;                ///< the worst of all frames, the mean of their means
};
/// S: float or double.
template <class S>
ScheduleResult run_schedule(const ShapeModel& model, const MountModel& mount, const PlateMotionPath& motion,
                            const Shapes& converged, int factorisations, int chord_steps);

/// The published way: as many iterations per frame as it takes, each of `iteration_us`. `soft`: of
/// make_soft_shape_model().
ScheduleResult run_published(const ShapeModel& soft, const MountModel& mount, const PlateMotionPath& motion,
                             const Shapes& converged, double iteration_us);

/// The fine mesh's shapes where the coarse mesh has its nodes: every node goes with the tetrahedron of the fine mesh
/// that holds it, or the nearest one. Shapes and result: [3 * nodes] per frame.
Shapes shapes_at_nodes(const ShapeModel& fine, const Shapes& fine_shapes, const ShapeModel& coarse);

}  // namespace finsight::host
