// Plate motions -> the positions of all nodes by regression, without a solve: the first tier, the start after a gap and
// the answer when the solve fails.
#pragma once

#include <Eigen/Core>
#include <span>
#include <vector>

#include "firmware/model/model.h"

namespace finsight {

class ShapeMap {
 public:
  /// Views the model, which must outlive it. Throws InputError if the map's sizes do not fit the shape.
  ShapeMap(const ShapeMapModel& map, const ShapeModel& shape);

  /// Writes [3 * nodes] positions. The nodes of the plates come out only nearly rigid (RigidPlates::place mends that).
  /// Does not allocate.
  void evaluate(const Eigen::Matrix<float, 18, 1>& numbers, std::span<float> node_mm) const;

  struct Measures {
    float rms_mm = 0, front_rms_mm = 0;  ///< RMS displacement of all nodes, and of the front face's
    float largest_mm = 0;                ///< largest displacement of any node
  };
  /// What evaluate()'s shape measures, without making the shape: 40 microseconds. Does not allocate.
  Measures measure(const Eigen::Matrix<float, 18, 1>& numbers) const;

 private:
  void coefficients(const Eigen::Matrix<float, 18, 1>& numbers, std::span<float> out) const;
  void prepare_measures(const ShapeModel& shape);

  ShapeMapModel map_;
  std::span<const float> rest_mm_;
  // For measure(). A node's displacement is linear in the coefficients, so the mean of its square is a quadratic form.
  std::vector<float> all_form_, front_form_;  // [rank, rank]
  // Nodes by the most that they can be displaced, largest first: per node that bound, and its part of the basis.
  std::vector<float> node_bound_, node_basis_;  // [nodes], [nodes, rank, 3]
  std::vector<float> coefficient_scale_;        // [rank]: one over the size that a coefficient has
  mutable std::vector<float> coefficients_;     // [rank]
};

}  // namespace finsight
