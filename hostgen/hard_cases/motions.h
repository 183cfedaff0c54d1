// Motions of the three plates for measuring the shape solver: smooth bends and twists at 60 frames/s.
#pragma once

#include <string>
#include <vector>

#include "firmware/model/model.h"

namespace finsight::host {

struct PlateMotionPath {
  std::string name;
  std::vector<PlatePoses> frames;
};

/// A cantilever-like bend of the finger: the tip is displaced by bend_mm inwards and sideways_mm across and turned by
/// twist_rad about the finger's axis; plates follow with the square of their height.
PlatePoses bent_plates(const MountModel& mount, double bend_mm, double sideways_mm, double twist_rad);

/// From rest to the extreme and back to rest, ease-in and ease-out, at `speed` times 25 mm/s (37 deg/s).
PlateMotionPath bend_and_return(const MountModel& mount, const std::string& name, double bend_mm, double sideways_mm,
                                double twist_rad, double speed);

/// The report's motions: a calm bend, a hard one, the hard one four times as fast, a noisy one.
std::vector<PlateMotionPath> report_motions(const MountModel& mount);

using Shapes = std::vector<std::vector<double>>;  ///< of every frame, [3 * nodes] in mm

/// The converged shapes of a motion, each solved from the one before. Throws std::runtime_error if a frame does not
/// converge.
Shapes converged_shapes(const ShapeModel& model, const MountModel& mount, const PlateMotionPath& motion);

}  // namespace finsight::host
