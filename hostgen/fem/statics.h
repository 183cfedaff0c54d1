// Hyperelastic statics of the touched finger: compressible neo-Hookean (Abaqus form: mu/2 (J^-2/3 I1 - 3) + K/2
// (J-1)^2), ten-node tetrahedra (Element::kSelective), base fixed, plates stiffened, forces on the front face. It is
// the truth that everything is trained and judged on, and shares with the firmware's shape solver only the corners of
// its mesh: elements, energy and loads are others.
#pragma once

#include <chrono>
#include <memory>
#include <optional>
#include <vector>

#include "hostgen/fem/contact.h"
#include "hostgen/fem/dataset.h"
#include "hostgen/fem/pushed_finger.h"

namespace finsight::host {

/// Motions of the plates (mm, rad) for an acceleration field of 1 g along the finger's x, y and z, as gravity is one.
using MotionPerG = Eigen::Matrix<double, kPoseDims, 3, Eigen::RowMajor>;

/// One finger under load; keeps its state, so that a path of neighbouring loads is cheap. Not thread-safe; make one per
/// thread from a shared finger.
class FingerStatics {
 public:
  FingerStatics(const FingerSpec& spec, const TetMesh& mesh);
  explicit FingerStatics(std::shared_ptr<const PushedFinger> finger);
  ~FingerStatics();
  FingerStatics(const FingerStatics&) = delete;
  FingerStatics& operator=(const FingerStatics&) = delete;

  /// Back to the undeformed finger. What follows does not depend on anything before.
  void reset();
  /// Equilibrium under `force_n` along the inward normal of the undeformed front face, applied at `point_mm` of the
  /// undeformed front face (shared among the nodes of the triangle that holds it; z is ignored and taken from the face;
  /// a point off the face stands for the nearest of its edge). Starts from the present state; splits the step where
  /// Newton needs it. False if no equilibrium was found that the present one leads to without a jump (the finger
  /// buckles or snaps through, or gives way without end; or the solver fails: see buckled()): the state is then the one
  /// before the call. Throws Interrupted, as everything that solves here.
  bool load(const Vec3f& point_mm, double force_n);
  /// Back to the undeformed finger, which these contacts are about to touch. It bends under its weight in an
  /// acceleration of `felt_g` (add_weight()); false if it does not bear that. Throws std::invalid_argument as
  /// ContactLoad does.
  bool begin(const std::vector<FaceContact>& contacts, const Eigen::Vector3d& felt_g = Eigen::Vector3d::Zero());
  /// After begin(): equilibrium under their normal forces that sum to `normal_n`, with what friction adds; as load()
  /// does.
  bool press(double normal_n);
  /// After begin(): the same with other contacts, from the present state on.
  bool press(const std::vector<FaceContact>& contacts, double normal_n);
  /// Another load than the present one.
  struct OtherLoad {
    std::vector<FaceContact> contacts;
    double normal_n = 0;
  };
  /// After begin(): the states that loads near the present one lead to, to first order in their difference, by one
  /// factorisation for all of them. Empty if the tangent is not positive definite. The present state stays.
  std::vector<FemState> nearby(const std::vector<OtherLoad>& loads);
  /// How an acceleration on top of the present load moves the plates, to first order; nothing if the tangent is not
  /// positive definite. The present state stays.
  std::optional<MotionPerG> motion_per_g();
  /// From this time on, load() and press() fail after the step that they are at: for those who must be done soon.
  void give_up_at(std::chrono::steady_clock::time_point deadline);
  /// Why the last load() or press() failed: the finger buckles, snaps through or gives way, since at the last state
  /// that was reached it has lost two thirds of its stiffness against the softest motion, or what lies beyond is a
  /// jump away. Else no step of the load converged, however short (the failure is numerical), or time was over.
  bool buckled() const;
  /// The present state; `path` and `front_node` are left 0. Not valid if the touched point has moved more than 20 mm.
  FemState state() const;
  /// Of the present load: a body vector.
  const std::vector<double>& nodal_forces() const;
  /// [3 * mesh nodes] displacement of the mesh's (corner) nodes, mm.
  std::vector<double> node_displacement_mm() const;
  /// The same for all nodes of the quadratic mesh, mesh nodes first.
  std::vector<double> quadratic_displacement_mm() const;
  /// The cost of all loads up to now.
  EquilibriumCost cost() const;

 private:
  struct Solver;
  std::unique_ptr<Solver> solver_;
};

}  // namespace finsight::host
