// The same finite-element problem solved by CalculiX (Debian: calculix-ccx), to check our statics against code that we
// did not write.
#pragma once

#include "hostgen/fem/contact.h"

namespace finsight::host {

/// What touches the face, and the sum of its normal forces.
struct LoadCase {
  std::vector<FaceContact> contacts;
  double force_n = 0;
};
/// One frictionless push at a point.
inline LoadCase push(double x_mm, double y_mm, double force_n) {
  return {{{.centre_mm = {x_mm, y_mm}, .full_force_n = force_n, .follow = 0}}, force_n};
}

/// The program `ccx` is there.
bool calculix_present();

/// CalculiX's input for one load: mesh, materials, fixed base, nodal forces, displacements of all nodes as output.
/// `force_n`: a body vector.
std::string calculix_deck(const PushedFinger& finger, std::span<const double> force_n);

struct CalculixComparison {
  double largest_mm = 0;     ///< displacement, ours
  double difference_mm = 0;  ///< largest distance of a node's place in both
};
/// Solves one load with both; CalculiX gets the nodal forces that ours ended with. All nodes of C3D10 are compared, the
/// corners of C3D4. Throws std::runtime_error if either finds no equilibrium.
CalculixComparison compare_with_calculix(const FingerSpec& spec, const TetMesh& mesh, Element element,
                                         const LoadCase& load);

}  // namespace finsight::host
