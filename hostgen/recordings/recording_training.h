// Networks for recorded touches: the pen's position from the one plate that was recorded.
#pragma once

#include <array>
#include <optional>
#include <string>
#include <vector>

#include "firmware/model/model.h"
#include "firmware/ports/session.h"
#include "hostgen/util/statistics.h"

namespace finsight::host {

/// Errors of one method on rows that it was not trained on.
struct RecordingScore {
  std::string method;
  AxisErrors random;           ///< the paper's split, 7:1:2 over rows; its test set holds copies of training rows
  AxisErrors by_point;         ///< every contact point predicted by a network that has not seen it (five folds)
  double mean_mm = 0;          ///< by_point: mean distance
  std::array<int, 2> steps{};  ///< fewest and most of all its trainings: see the plan
  AxisErrors other;            ///< on the rows of another file, trained on all of this; without one, zeros
  double other_mean_mm = 0;
};

struct RecordingTrainingPlan {
  /// At most. How many are best is tried on contact points that are held out from each training: a thirty-second of
  /// these, then twice as many as long as that makes the held-out points' errors smaller. More only learn the touched
  /// points by heart.
  int steps = 40000;
  std::uint64_t seed = 1;
  std::vector<int> hidden = {512, 256};  ///< of the first two networks; the third has the first of these layers twice
};

/// Trains on all rows but outliers (see find_outliers()), with progress. Rows of the result: "paper", the paper's
/// network (the plate's six numbers three times, z-scored, 18-512-256-3); "direction", ours (direction and log-size);
/// "history", with the plate's motion over the last quarter of a second and one more layer; with a pack also
/// "simulation", the pack's touch network, and "fine-tuned", the same trained further on the recordings.
/// `test`: another file to be judged on, too. Throws InputError if there are fewer than five contact points,
/// Interrupted.
std::vector<RecordingScore> train_on_recordings(const RecordedMotion& motion, const Model* pack,
                                                const RecordingTrainingPlan& plan,
                                                const RecordedMotion* test = nullptr);

}  // namespace finsight::host
