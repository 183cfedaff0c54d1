#include "hostgen/fem/shape_model.h"

#include <algorithm>
#include <numeric>
#include <set>
#include <span>
#include <string>

#include "firmware/input_error.h"

namespace finsight::host {

namespace {

constexpr std::uint8_t kFree = 0, kBase = 1, kFirstPlate = 2;

std::vector<std::uint8_t> node_kinds(const TetMesh& mesh) {
  std::vector<std::uint8_t> kind(mesh.node_mm.size(), kFree);
  for (int p = 0; p < kPlates; ++p)
    for (const int node : mesh.plate_nodes[p]) {
      if (kind.at(node) != kFree)
        throw InputError("mesh", "plate_nodes", "node " + std::to_string(node) + " in two plates", "one");
      kind[node] = static_cast<std::uint8_t>(kFirstPlate + p);
    }
  for (const int node : mesh.base_nodes) {
    if (kind.at(node) != kFree)
      throw InputError("mesh", "base_nodes", "node " + std::to_string(node) + " of a plate",
                       "no rigid plate at the base");
    kind[node] = kBase;
  }
  return kind;
}

// Free nodes that share a tetrahedron, in numbers of free nodes. tet_nodes: four per tetrahedron.
std::vector<std::vector<int>> couplings(std::span<const std::int32_t> tet_nodes,
                                        const std::vector<std::int32_t>& free_index, int free_nodes) {
  std::vector<std::set<int>> found(free_nodes);
  for (std::size_t t = 0; t < tet_nodes.size(); t += 4)
    for (const int a : tet_nodes.subspan(t, 4))
      for (const int b : tet_nodes.subspan(t, 4))
        if (a != b && free_index[a] >= 0 && free_index[b] >= 0) found[free_index[a]].insert(free_index[b]);
  std::vector<std::vector<int>> neighbours;
  for (const auto& set : found) neighbours.emplace_back(set.begin(), set.end());
  return neighbours;
}

// Tetrahedra in the order in which the factorisation first needs them: neighbours in memory are neighbours in the mesh.
std::vector<int> tets_by_elimination(const TetMesh& mesh, const std::vector<std::int32_t>& free_index,
                                     const CholeskyPlanData& plan) {
  std::vector<int> position(plan.order.size());
  for (std::size_t k = 0; k < plan.order.size(); ++k) position[plan.order[k]] = static_cast<int>(k);
  std::vector<int> first(mesh.tets.size(), plan.blocks), order(mesh.tets.size());
  for (std::size_t t = 0; t < mesh.tets.size(); ++t)
    for (const int node : mesh.tets[t])
      if (free_index[node] >= 0) first[t] = std::min(first[t], position[free_index[node]]);
  std::iota(order.begin(), order.end(), 0);
  std::stable_sort(order.begin(), order.end(), [&](int a, int b) { return first[a] < first[b]; });
  return order;
}

}  // namespace

ShapeModel ShapeModelData::view() const {
  ShapeModel model;
  model.nodes = static_cast<int>(node_kind.size());
  model.tets = static_cast<int>(tet_nodes.size() / 4);
  model.rest_mm = rest_mm;
  model.tet_nodes = tet_nodes;
  model.node_kind = node_kind;
  model.free_index = free_index;
  model.front_nodes = front_nodes;
  model.cholesky = cholesky.view();
  return model;
}

ShapeModelData make_shape_model(const TetMesh& mesh) {
  ShapeModelData model;
  model.node_kind = node_kinds(mesh);
  std::vector<char> used(mesh.node_mm.size(), 0);
  for (const auto& tet : mesh.tets)
    for (const int node : tet) used.at(node) = 1;
  int free_nodes = 0;
  for (std::size_t i = 0; i < mesh.node_mm.size(); ++i) {
    if (!used[i]) throw InputError("mesh", "node " + std::to_string(i) + " belongs to no tetrahedron");
    for (const double coordinate : mesh.node_mm[i]) model.rest_mm.push_back(static_cast<float>(coordinate));
    model.free_index.push_back(model.node_kind[i] == kFree ? free_nodes++ : -1);
  }
  model.front_nodes.assign(mesh.front_nodes.begin(), mesh.front_nodes.end());
  const std::span<const std::int32_t> tet_nodes(mesh.tets.front().data(), 4 * mesh.tets.size());
  model.cholesky = plan_cholesky(couplings(tet_nodes, model.free_index, free_nodes));
  for (const int t : tets_by_elimination(mesh, model.free_index, model.cholesky))
    model.tet_nodes.insert(model.tet_nodes.end(), mesh.tets[t].begin(), mesh.tets[t].end());
  return model;
}

ShapeModelData make_soft_shape_model(const ShapeModel& shape) {
  ShapeModelData model;
  model.rest_mm.assign(shape.rest_mm.begin(), shape.rest_mm.end());
  model.tet_nodes.assign(shape.tet_nodes.begin(), shape.tet_nodes.end());
  model.front_nodes.assign(shape.front_nodes.begin(), shape.front_nodes.end());
  model.node_kind.assign(shape.node_kind.begin(), shape.node_kind.end());
  int free_nodes = 0;
  for (const std::uint8_t kind : model.node_kind) model.free_index.push_back(kind == kBase ? -1 : free_nodes++);
  model.cholesky = plan_cholesky(couplings(model.tet_nodes, model.free_index, free_nodes));
  return model;
}

}  // namespace finsight::host
