// The paper's table 2: its network and the methods it was compared with, by its random split and by contact point.
#pragma once

#include <string>
#include <vector>

#include "hostgen/fem/dataset.h"
#include "hostgen/util/statistics.h"

namespace finsight::host {

struct MethodScore {
  std::string name;  ///< lr, svm, knn, dt, mlp
  AxisErrors random_clean, random_noisy, held_out_clean, held_out_noisy;
  double train_s = 0;     ///< on the random split
  double predict_us = 0;  ///< per touch, many at a time
};

struct ComparisonPlan {
  std::uint64_t seed = 1;
  int steps = 20000;  ///< Adam steps of the network
};

/// Linear regression, support-vector regression (radial basis), five nearest neighbours, a decision tree, and the
/// paper's network (18-512-256-3), each trained on the noise-free plate numbers of the valid states, z-scored. Tested
/// on noise-free numbers and on numbers with the spec's noise: random split 7:1:2 of the states, and a fifth of the
/// contact points held out. All valid states count, also those below the spec's threshold. Shows progress. Throws
/// Interrupted, and std::runtime_error for fewer than 50 valid states.
std::vector<MethodScore> compare_methods(const FingerSpec& spec, const FemDataset& dataset, const ComparisonPlan& plan);

}  // namespace finsight::host
