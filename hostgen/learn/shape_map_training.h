// Fits a shape map: plate motions -> proper-orthogonal basis by linear and quadratic regression.
#pragma once

#include <Eigen/Core>
#include <vector>

#include "firmware/model/model.h"

namespace finsight::host {

/// Owns what a ShapeMapModel views.
struct ShapeMapData {
  int rank = 0;
  std::vector<float> scale, weights, basis;
  ShapeMapModel view() const;
};

/// poses: [samples, 18]; displacement_mm: [samples, 3 * nodes]. `rank` basis vectors from the singular vectors of the
/// displacements; weights by ridge regression. Zero motion maps to zero displacement exactly.
ShapeMapData fit_shape_map(const Eigen::MatrixXf& poses, const Eigen::MatrixXf& displacement_mm, int rank = 20);

}  // namespace finsight::host
