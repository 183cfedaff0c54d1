// The measures of the shape map's shape without the shape itself: all that the registers need.
#pragma once

#include <span>
#include <vector>

#include "firmware/model/model.h"
#include "firmware/shape/shape_measures.h"

namespace finsight {

class MapMeasures {
 public:
  /// The sizes of the two must fit (ShapeMap's constructor checks them).
  MapMeasures(const ShapeMapModel& map, const ShapeModel& shape);

  /// coefficients: [rank], ShapeMap's. 40 microseconds; does not allocate.
  ShapeMeasures measure(std::span<const float> coefficients) const;

 private:
  // A node's displacement is linear in the coefficients, so the mean of its square is a quadratic form.
  std::vector<float> all_form_, front_form_;  // [rank, rank]
  // Nodes by an upper bound on their displacement, largest first: per node that bound, and its part of the basis.
  std::vector<float> node_bound_, node_basis_;  // [nodes], [nodes, rank, 3]
  std::vector<float> coefficient_scale_;        // [rank]: one over the size that a coefficient has
};

}  // namespace finsight
