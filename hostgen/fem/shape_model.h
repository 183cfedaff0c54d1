// TetMesh -> the firmware's shape model: which nodes are free, base or plate, and the plan of its factorisation.
#pragma once

#include "hostgen/fem/cholesky_plan.h"
#include "hostgen/finger/mesh.h"

namespace finsight::host {

/// Owns what a ShapeModel views.
struct ShapeModelData {
  std::vector<float> rest_mm;
  std::vector<std::int32_t> tet_nodes, free_index, front_nodes;
  std::vector<std::uint8_t> node_kind;
  CholeskyPlanData cholesky;
  ShapeModel view() const;
};
ShapeModelData make_shape_model(const TetMesh& mesh);

/// The same mesh for SoftNewtonSolver: the nodes of the plates are free, too.
ShapeModelData make_soft_shape_model(const ShapeModel& shape);

}  // namespace finsight::host
