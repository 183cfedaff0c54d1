// Where and how hard the finger is touched, from how its plates moved (paper, section 2.3): the forces on the front
// face whose equilibrium moves the plates as measured. Several contacts at once, and no training.
#pragma once

#include <memory>
#include <vector>

#include "hostgen/fem/contact_choice.h"
#include "hostgen/fem/pushed_finger.h"
#include "hostgen/finger/mesh.h"

namespace finsight::host {

struct Contact : FaceForce {
  Vec3f displacement_mm = Vec3f::Zero();  ///< of the point
  ContactUncertainty uncertainty;         ///< what else it could be
};

struct ContactForces {
  std::vector<Contact> contacts;  ///< L-BFGS answers with forces everywhere instead; see force_n
  Eigen::VectorXd force_n;        ///< of every candidate point
  /// Sum of squares of the plate numbers' errors, each over its standard deviation in the spec: about 18 for noise.
  double misfit = 0;
  TotalForce total;  ///< of all contacts (Gauss-Newton)
  /// Noise alone explains the misfit (99.9 %). Otherwise something other than pushes on the face moved the plates, if
  /// the method has converged; if not, nothing is known.
  bool explained = false;
  bool converged = false;
  bool in_parts = false;  ///< one leap did not converge: the measured motion was followed from rest in parts
  double seconds = 0;     ///< processor time, with the uncertainty (Gauss-Newton)
  struct Progress {
    double seconds = 0;    ///< processor time since the start
    double objective = 0;  ///< half of the misfit
  };
  std::vector<Progress> curve;               ///< after every evaluation; the first is the start
  std::vector<double> node_displacement_mm;  ///< [3 * mesh nodes]
};

/// Not thread-safe. The finger is the one of FingerStatics. Answers do not depend on earlier ones.
class ContactForceSolver {
 public:
  /// `candidates`: how many points of the touched part of the face may carry force, spread evenly; `starts`: at how
  /// many of them equilibria are prepared (three forces each, on all cores) that Gauss-Newton starts from. Throws
  /// Interrupted.
  ContactForceSolver(const FingerSpec& spec, const TetMesh& mesh, int candidates = 570, int starts = 30);
  ~ContactForceSolver();

  /// Gauss-Newton on displacements and forces at once, forces not negative, as few contacts as explain the plates. An
  /// iteration needs one factor of the tangent and 18 solves with it, whatever the number of candidates; it starts from
  /// the mixture of prepared equilibria that moves the plates most like `measured`; where that does not converge, it
  /// follows the measured motion from rest in parts. Plates that are not seen are ignored.
  ContactForces gauss_newton(const PlatePoses& measured);
  /// The paper's method: L-BFGS on the forces with the adjoint gradient, from rest; forces of either sign.
  ContactForces lbfgs(const PlatePoses& measured, int iterations);

  /// The equilibrium under given forces, from rest: what plates(), node_displacement_mm() and objective() are about
  /// until the next estimate. False if there is none.
  bool press(const std::vector<FaceForce>& forces);
  bool press(const Eigen::VectorXd& candidate_force_n);
  PlatePoses plates() const;
  std::vector<double> node_displacement_mm() const;
  /// Half of the misfit, and its gradient by the candidates' forces if asked for.
  double objective(const PlatePoses& measured, Eigen::VectorXd* gradient = nullptr);
  /// [3, candidates] on the undeformed face, and the direction of their forces.
  const Eigen::Matrix3Xd& candidates_mm() const;
  Eigen::Vector3d inward() const;

 private:
  static bool noise_explains(double misfit, const PlatePoses& measured);
  struct Problem;
  std::unique_ptr<Problem> problem_;
};

}  // namespace finsight::host
