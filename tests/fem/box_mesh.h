// A box of tetrahedra, fixed at y = 0 and touched on its face z = lowest: the smallest thing that bends like a finger.
#pragma once

#include <algorithm>
#include <array>
#include <map>

#include "hostgen/finger/mesh.h"

namespace finsight::test {

struct Box {
  std::array<double, 3> lowest_mm{}, size_mm{};
  std::array<int, 3> cells{};
};

/// Six tets per cell (Kuhn's partition), all of the soft body.
inline host::TetMesh box_mesh(const Box& box) {
  host::TetMesh mesh;
  std::map<std::array<int, 3>, int> number;
  const auto node = [&](const std::array<int, 3>& at) {
    const auto [place, added] = number.try_emplace(at, static_cast<int>(mesh.node_mm.size()));
    if (added) {
      std::array<double, 3> position{};
      for (std::size_t i = 0; i < 3; ++i) position[i] = box.lowest_mm[i] + box.size_mm[i] * at[i] / box.cells[i];
      mesh.node_mm.push_back(position);
      if (at[1] == 0) mesh.base_nodes.push_back(place->second);
      if (at[2] == 0) mesh.front_nodes.push_back(place->second);
    }
    return place->second;
  };
  for (int x = 0; x < box.cells[0]; ++x) {
    for (int y = 0; y < box.cells[1]; ++y) {
      for (int z = 0; z < box.cells[2]; ++z) {
        std::array<std::size_t, 3> axes{0, 1, 2};
        bool even = true;
        do {
          std::array<int, 3> at{x, y, z};
          std::array<int, 4> tet{node(at), 0, 0, 0};
          for (std::size_t i = 0; i < 3; ++i) {
            ++at[axes[i]];
            tet[i + 1] = node(at);
          }
          // Going along the axes in an odd order gives a mirrored tet.
          even = (axes[1] == (axes[0] + 1) % 3);
          if (!even) std::swap(tet[2], tet[3]);
          mesh.tets.push_back(tet);
        } while (std::next_permutation(axes.begin(), axes.end()));
      }
    }
  }
  mesh.region.assign(mesh.tets.size(), host::kBodyRegion);
  std::sort(mesh.base_nodes.begin(), mesh.base_nodes.end());
  std::sort(mesh.front_nodes.begin(), mesh.front_nodes.end());
  return mesh;
}

/// A column 12 mm across, 60 mm high and 6 mm deep, whose slices at the heights 20, 35 and 50 mm are the rigid plates.
inline host::TetMesh small_finger_mesh() {
  host::TetMesh mesh = box_mesh({{-6, 0, 0}, {12, 60, 6}, {2, 12, 1}});
  for (std::size_t t = 0; t < mesh.tets.size(); ++t) {
    double y = 0;
    for (const int node : mesh.tets[t]) y += mesh.node_mm[static_cast<std::size_t>(node)][1] / 4;
    for (int p = 0; p < kPlates; ++p) {
      const double lowest = 50 - 15 * p;
      if (y <= lowest || y >= lowest + 5) continue;
      mesh.region[t] = host::kFirstPlateRegion + p;
      mesh.plate_nodes[p].insert(mesh.plate_nodes[p].end(), mesh.tets[t].begin(), mesh.tets[t].end());
    }
  }
  for (std::vector<int>& nodes : mesh.plate_nodes) {
    std::sort(nodes.begin(), nodes.end());
    nodes.erase(std::unique(nodes.begin(), nodes.end()), nodes.end());
  }
  return mesh;
}

inline host::FingerSpec small_finger_spec() {
  host::FingerSpec spec;
  spec.name = "column";
  spec.sha256 = "0123456789abcdef";
  spec.height_mm = 60;
  spec.front_z = {0, 0};
  spec.back_z = {6, 0};
  spec.half_width = {6, 0};
  spec.youngs_modulus_mpa = 10;
  spec.poisson_ratio = 0.47;
  spec.plate_stiffness_ratio = 100;
  spec.touch_y_mm = {15, 55};
  spec.touch_edge_mm = 1;
  spec.force_n = {0.1, 0.4};
  spec.scenes = host::common_scenes();
  spec.trained_scene = "probe";
  for (int p = 0; p < kPlates; ++p) {
    spec.plates[static_cast<std::size_t>(p)].T_finger_marker.translation() = Eigen::Vector3d(0, 50 - 15 * p, 3);
  }
  return spec;
}

}  // namespace finsight::test
