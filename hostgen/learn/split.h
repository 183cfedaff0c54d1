// Which samples train and which test.
#pragma once

#include <cstdint>
#include <vector>

namespace finsight::host {

/// Indices of samples, ascending.
struct Split {
  std::vector<std::size_t> train, test;
};

/// The paper's split: of all samples in random order, 7 tenths train and 2 tenths test. The tenth between them, by
/// which the paper stops its training, belongs to neither.
Split random_split(std::size_t count, std::uint64_t seed);

/// Splits by groups (contact points): whole groups test, one in `folds`, in random order; all others train. The test
/// sets of folds 0 ... folds - 1 hold every sample once. group: of every sample.
Split group_split(const std::vector<int>& group, int folds, int fold, std::uint64_t seed);

}  // namespace finsight::host
