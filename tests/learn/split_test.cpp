#include "hostgen/learn/split.h"

#include <doctest/doctest.h>

#include <set>

using namespace finsight::host;

TEST_CASE("split: seven tenths train, two tenths test, none does both, and another seed gives another split") {
  const Split split = random_split(1000, 3);
  CHECK(split.train.size() == 700);
  CHECK(split.test.size() == 200);
  std::set<std::size_t> all(split.train.begin(), split.train.end());
  all.insert(split.test.begin(), split.test.end());
  CHECK(all.size() == 900);
  CHECK(*all.rbegin() < 1000);
  CHECK(random_split(1000, 3).test == split.test);
  CHECK(random_split(1000, 4).test != split.test);
}

TEST_CASE("split: groups stay together, and every sample is in one test set") {
  std::vector<int> group;
  for (int i = 0; i < 60; ++i) group.push_back(7 * (i % 13));
  std::vector<int> tested(group.size());
  for (int fold = 0; fold < 5; ++fold) {
    const Split split = group_split(group, 5, fold, 1);
    CHECK(split.train.size() + split.test.size() == group.size());
    std::set<int> trains;
    for (const std::size_t i : split.train) trains.insert(group[i]);
    for (const std::size_t i : split.test) {
      CHECK(!trains.contains(group[i]));
      ++tested[i];
    }
  }
  for (const int times : tested) CHECK(times == 1);
}
