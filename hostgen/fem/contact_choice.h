// Which contacts explain what was measured: the sparse, non-negative part of estimating contact forces, for measured
// numbers that are linear in the forces.
#pragma once

#include <Eigen/Core>
#include <functional>
#include <vector>

namespace finsight::host {

/// How the measured numbers, in their standard deviations, change per newton of a push on the face.
struct PushResponse {
  Eigen::Matrix2Xd grid_mm;                                                ///< x, y of places all over the face
  Eigen::MatrixXd at_grid;                                                 ///< [numbers, places]
  std::function<Eigen::VectorXd(const Eigen::Vector2d& place_mm)> at;      ///< anywhere
  std::function<Eigen::Vector2d(const Eigen::Vector2d& place_mm)> inside;  ///< the nearest place that can be touched
};

/// Pushes on the face.
struct ContactChoice {
  Eigen::Matrix2Xd place_mm;
  Eigen::VectorXd force_n;  ///< of each: positive
  double misfit = 0;  ///< squared distance from the goal: about the number of measured numbers if noise alone is left
};

/// The fewest pushes that explain `goal` (in standard deviations of the measurement): one is added as long as that
/// lowers the misfit by more than three numbers that fit noise would (99 %), `noise_inflation` times. Starts from
/// `start`, whose forces do not matter.
ContactChoice fewest_contacts(const PushResponse& response, const Eigen::VectorXd& goal, const ContactChoice& start,
                              double noise_inflation = 1);
/// As many pushes as `start` has or fewer, moved and weighed until they explain `goal` best.
ContactChoice refined_contacts(const PushResponse& response, const Eigen::VectorXd& goal, const ContactChoice& start);

/// What else, at 95 %, could explain the measurement as well as a push of the choice.
struct ContactUncertainty {
  double position_95_mm = 0;                       ///< a point push this far away
  double extent_95_mm = 0;                         ///< an even pressure (line, rectangle) that reaches this far
  double lowest_force_n = 0, highest_force_n = 0;  ///< under either
};
/// Of every push of a choice that explains `goal`.
std::vector<ContactUncertainty> contact_uncertainties(const PushResponse& response, const Eigen::VectorXd& goal,
                                                      const ContactChoice& choice);

/// What the measurement tells of the sum of all forces, at 95 %: more than of each, because a push that is taken for
/// stronger makes its neighbours weaker.
struct TotalForce {
  double force_n = 0, lowest_n = 0, highest_n = 0;
};
TotalForce total_force(const PushResponse& response, const Eigen::VectorXd& goal, const ContactChoice& choice);

}  // namespace finsight::host
