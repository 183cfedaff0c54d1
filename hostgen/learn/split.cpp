#include "hostgen/learn/split.h"

#include <algorithm>
#include <map>
#include <numeric>

#include "hostgen/util/random.h"

namespace finsight::host {

namespace {

std::vector<std::size_t> shuffled(std::size_t count, std::uint64_t seed) {
  Random random(seed);
  std::vector<std::size_t> order(count);
  std::iota(order.begin(), order.end(), std::size_t{0});
  for (std::size_t i = count; i > 1; --i) std::swap(order[i - 1], order[random.index(i)]);
  return order;
}

}  // namespace

Split random_split(std::size_t count, std::uint64_t seed) {
  const std::vector<std::size_t> order = shuffled(count, seed);
  const auto at = [&](std::size_t tenths) { return order.begin() + static_cast<std::ptrdiff_t>(count * tenths / 10); };
  Split split{{order.begin(), at(7)}, {at(8), order.end()}};
  std::sort(split.train.begin(), split.train.end());
  std::sort(split.test.begin(), split.test.end());
  return split;
}

Split group_split(const std::vector<int>& group, int folds, int fold, std::uint64_t seed) {
  std::map<int, std::size_t> place;
  for (const int name : group) place[name] = 0;
  const std::vector<std::size_t> order = shuffled(place.size(), seed);
  std::size_t next = 0;
  for (auto& [name, number] : place) number = order[next++];
  Split split;
  for (std::size_t i = 0; i < group.size(); ++i) {
    const bool tests = place[group[i]] % static_cast<std::size_t>(folds) == static_cast<std::size_t>(fold);
    (tests ? split.test : split.train).push_back(i);
  }
  return split;
}

}  // namespace finsight::host
