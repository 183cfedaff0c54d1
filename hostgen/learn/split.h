// Splits of samples into training and test sets.
#pragma once

#include <cstdint>
#include <vector>

namespace finsight::host {

/// Indices of samples, ascending.
struct Split {
  std::vector<std::size_t> train, test;
};

/// The paper's split: of all samples in random order, seven tenths for training and two tenths for testing. The tenth
/// between them, which the paper uses for early stopping, belongs to neither.
Split random_split(std::size_t count, std::uint64_t seed);

/// Splits by groups (contact points): one in `folds` whole groups, in random order, is the test set; all others train.
/// The test sets of folds 0 ... folds - 1 hold every sample once. group: [samples]
Split group_split(const std::vector<int>& group, int folds, int fold, std::uint64_t seed);

}  // namespace finsight::host
