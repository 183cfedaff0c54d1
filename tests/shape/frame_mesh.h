// A finger made of cubes, for the tests of the shape solver: two walls joined by three beams, each beam with a rigid
// plate in its middle. Every cube is cut into six tetrahedra (Kuhn), so no mesh generator is needed.
#pragma once

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <map>
#include <set>
#include <vector>

#include "firmware/types.h"
#include "hostgen/finger/mesh.h"
#include "tests/random.h"

namespace finsight::test {

/// 30 x 120 x 25 mm, `across` cubes wide, `up` high, `deep` deep. The default has 3,312 tets.
inline host::TetMesh frame_mesh(int across = 8, int up = 27, int deep = 6) {
  const auto is_beam = [&](int y) { return y == up - 1 || y == 2 * up / 3 - 1 || y == up / 3 - 1; };
  const auto region_of = [&](int x, int y, int z) {
    if (z > 0 && z < deep - 1 && !is_beam(y)) return -1;
    const bool plate = is_beam(y) && std::abs(2 * x + 1 - across) <= across / 2 && z > 1 && z < deep - 2;
    if (!plate) return host::kBodyRegion;
    return host::kFirstPlateRegion + (y == up - 1 ? kTopPlate : y == up / 3 - 1 ? kLowPlate : kMiddlePlate);
  };
  host::TetMesh mesh;
  std::map<std::array<int, 3>, int> node_at;
  const auto node = [&](std::array<int, 3> at) {
    const auto [entry, is_new] = node_at.try_emplace(at, static_cast<int>(mesh.node_mm.size()));
    if (is_new) mesh.node_mm.push_back({30.0 * at[0] / across - 15, 120.0 * at[1] / up, 25.0 * at[2] / deep});
    return entry->second;
  };
  for (int x = 0; x < across; ++x)
    for (int y = 0; y < up; ++y)
      for (int z = 0; z < deep; ++z) {
        const int region = region_of(x, y, z);
        if (region < 0) continue;
        std::array<int, 3> axes{0, 1, 2};
        do {
          const bool odd = ((axes[0] > axes[1]) != (axes[0] > axes[2])) != (axes[1] > axes[2]);
          std::array<int, 3> at{x, y, z};
          std::array<int, 4> tet{node(at)};
          for (int k = 0; k < 3; ++k) {
            ++at[axes[k]];
            tet[k + 1] = node(at);
          }
          if (odd) std::swap(tet[2], tet[3]);
          mesh.tets.push_back(tet);
          mesh.region.push_back(region);
        } while (std::next_permutation(axes.begin(), axes.end()));
      }
  std::array<std::set<int>, kPlates> plates;
  for (std::size_t t = 0; t < mesh.tets.size(); ++t)
    if (mesh.region[t] >= host::kFirstPlateRegion)
      plates[mesh.region[t] - host::kFirstPlateRegion].insert(mesh.tets[t].begin(), mesh.tets[t].end());
  for (int p = 0; p < kPlates; ++p) mesh.plate_nodes[p].assign(plates[p].begin(), plates[p].end());
  for (int i = 0; i < static_cast<int>(mesh.node_mm.size()); ++i) {
    if (mesh.node_mm[i][1] == 0) mesh.base_nodes.push_back(i);
    if (mesh.node_mm[i][2] == 0) mesh.front_nodes.push_back(i);
  }
  return mesh;
}

}  // namespace finsight::test
