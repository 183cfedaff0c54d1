// What several commands say about a mesh.
#pragma once

#include <cstdio>
#include <map>
#include <string>

#include "hostgen/finger/mesh.h"

namespace finsight::host {

inline const std::map<std::string, MeshSize> kMeshSizes = {{"coarse", MeshSize::kCoarse},
                                                           {"default", MeshSize::kDefault},
                                                           {"medium", MeshSize::kMedium},
                                                           {"fine", MeshSize::kFine},
                                                           {"finest", MeshSize::kFinest}};

/// Its size, and where its worst tetrahedra are if they are bad.
inline void print_mesh(const TetMesh& mesh) {
  std::printf("mesh: %zu nodes, %zu tets, smallest dihedral angle %.2f deg\n", mesh.node_mm.size(), mesh.tets.size(),
              mesh.min_dihedral_deg);
  std::printf("%s", mesh_advice(mesh).c_str());
  std::fflush(stdout);
}

}  // namespace finsight::host
