// Interpolates between finite-element states: any contact point, any force up to the highest computed there.
#pragma once

#include <Eigen/Core>
#include <vector>

#include "firmware/model/plate_prior.h"
#include "hostgen/fem/dataset.h"

namespace finsight::host {

/// What the network learns from: plate numbers and the touch that caused them.
struct TouchSample {
  PoseVector numbers = PoseVector::Zero();
  Vec3f point_mm = Vec3f::Zero();
  Vec3f displacement_mm = Vec3f::Zero();  ///< of the touched point
  float force_n = 0;                      ///< normal
  Vec3f force_vector_n = Vec3f::Zero();   ///< normal, across, along
  Vec3f moment_nm = Vec3f::Zero();        ///< about the finger frame's origin
  bool explained = true;                  ///< by the scene that is trained for
  bool on_face = true;                    ///< else point, displacement, force and moment are not to be learnt
};
TouchSample touch_sample(const FemState& state);

/// Interpolates motion per newton, which changes slowly and has a limit at rest: over the face by a thin-plate spline
/// per force level (exact at the states), between the levels and down to rest by a parabola through the three nearest.
class StateInterpolant {
 public:
  /// Uses the valid states. Every force that is common to 10 or more contact points becomes a level; other forces are
  /// left out. Throws std::runtime_error if no level remains.
  explicit StateInterpolant(const std::vector<FemState>& states);

  /// A touch at (x, y) of the undeformed face with `force_n` up to highest_force_n(x, y).
  TouchSample at(double x_mm, double y_mm, double force_n) const;
  /// The highest force computed at the nearest contact point (paths end early where the finger snaps through).
  double highest_force_n(double x_mm, double y_mm) const;
  /// RMS error of a plate's displacement when each contact point is predicted from the others.
  double leave_one_out_mm() const;

 private:
  static constexpr int kValues = kPoseDims + 3 + 3 + 3 + 1;  // plates, displacement, force, moment per newton; z
  struct Level {
    double force_n = 0;
    Eigen::MatrixX2d points;  // scaled x, y
    Eigen::MatrixXd values;   // [points, kValues]
    Eigen::MatrixXd weights;  // [points + 3, kValues]
    double error_sq_mm2 = 0;  // sum over points and plates of the leave-one-out error
  };
  static void fit(Level& level);
  Eigen::Matrix<double, kValues, 1> evaluate(const Level& level, double x, double y) const;

  std::vector<Level> levels_;                   // ascending force
  std::vector<std::array<double, 3>> highest_;  // x, y, highest force of every contact point
};

}  // namespace finsight::host
