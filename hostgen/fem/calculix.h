// The same finite-element problem solved by CalculiX (Debian: calculix-ccx), to check our statics against code that we
// did not write.
#pragma once

#include "hostgen/fem/quadratic_mesh.h"

namespace finsight::host {

struct LoadCase {
  Vec3f point_mm = Vec3f::Zero();  ///< on the undeformed front face
  double force_n = 0;
};

/// The program `ccx` is there.
bool calculix_present();

/// CalculiX's input for one load: mesh, materials, fixed base, nodal forces, displacements of all nodes as output.
std::string calculix_deck(const FingerSpec& spec, const QuadraticMesh& mesh, const LoadCase& load);

struct CalculixComparison {
  double largest_mm = 0;     ///< displacement, ours
  double difference_mm = 0;  ///< largest distance of a node's place in both
};
/// Solves one load with both. All nodes of C3D10 are compared, the corners of C3D4. Throws std::runtime_error if either
/// finds no equilibrium.
CalculixComparison compare_with_calculix(const FingerSpec& spec, const TetMesh& mesh, Element element,
                                         const LoadCase& load);

}  // namespace finsight::host
