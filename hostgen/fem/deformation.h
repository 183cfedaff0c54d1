// How much the touched face is deformed, and whether more force deforms it more.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <span>
#include <string>

#include "hostgen/fem/dataset.h"

namespace finsight::host {

/// RMS displacement of the front face's nodes, in mm: the deformation. `displacement_mm`: [3 * nodes].
template <class Scalar>
double front_rms_mm(std::span<const Scalar> displacement_mm, std::span<const std::int32_t> front_nodes) {
  double sum = 0;
  for (const std::int32_t node : front_nodes) {
    const Scalar* u = &displacement_mm[3 * static_cast<std::size_t>(node)];
    for (int d = 0; d < 3; ++d) sum += static_cast<double>(u[d]) * static_cast<double>(u[d]);
  }
  return std::sqrt(sum / std::max(1.0, static_cast<double>(front_nodes.size())));
}
/// Of one state of a set.
double front_rms_mm(const FemDataset& dataset, std::size_t state, std::span<const std::int32_t> front_nodes);

/// Deformation against force, point by point, over the valid states.
struct DeformationRise {
  std::size_t contact_points = 0;  ///< that have a valid state
  std::size_t not_monotone = 0;    ///< those of them where some higher force does not deform more
  double worst_drop_mm = 0;        ///< the furthest that a deformation falls below that of a lower force at its point
  Vec3f worst_point_mm = Vec3f::Zero();  ///< where that is
};
/// Of no point where the contacts of a path change: its states are not to be compared.
DeformationRise measure_deformation_rise(const Scene& scene, const FemDataset& dataset,
                                         std::span<const std::int32_t> front_nodes);
/// One line of it for people; `rated_mm` is the deformation of level 1000 per mille.
std::string deformation_text(const DeformationRise& rise, double rated_mm);

}  // namespace finsight::host
