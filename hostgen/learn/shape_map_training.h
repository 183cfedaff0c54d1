// Fits shape maps: plate motions -> proper-orthogonal basis by linear and quadratic regression.
#pragma once

#include <Eigen/Core>
#include <vector>

#include "firmware/model/model.h"
#include "hostgen/fem/dataset.h"

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

/// The contact-aware map: fitted to the finite-element shapes of the valid states, at poses with and without the spec's
/// noise.
ShapeMapData fit_contact_map(const FingerSpec& spec, const FemDataset& dataset, std::uint64_t seed);

}  // namespace finsight::host
