#include "hostgen/util/statistics.h"

#include <doctest/doctest.h>

#include "hostgen/util/random.h"

using namespace finsight::host;

TEST_CASE("statistics: measurements that err alike tell no more of a share than one of them") {
  std::vector<GroupCount> single, alike;
  for (int i = 0; i < 100; ++i) {
    const double inside = i < 30;
    single.push_back({inside, 1});
    alike.push_back({10 * inside, 10});
  }
  CHECK(share_error(single) == doctest::Approx(std::sqrt(0.3 * 0.7 / 99)).epsilon(1e-9));
  CHECK(share_error(alike) == doctest::Approx(share_error(single)).epsilon(1e-9));
  CHECK(share_error({}) == 0);
  CHECK(share_error({{3, 4}}) == 0);
  CHECK(share_error({{0, 0}, {0, 0}}) == 0);
}

TEST_CASE("statistics: the standard error of a share is how much the share differs from draw to draw") {
  Random random(1);
  constexpr int kDraws = 2000, kGroups = 50;
  double sum = 0, square = 0, stated = 0;
  for (int draw = 0; draw < kDraws; ++draw) {
    std::vector<GroupCount> groups;
    double inside = 0, all = 0;
    for (int g = 0; g < kGroups; ++g) {
      const double share = random.uniform(0.2, 1);
      GroupCount group{0, 1.0 + static_cast<double>(random.index(9))};
      for (int i = 0; i < group.all; ++i) group.inside += random.uniform() < share;
      inside += group.inside;
      all += group.all;
      groups.push_back(group);
    }
    sum += inside / all;
    square += inside / all * (inside / all);
    stated += share_error(groups) / kDraws;
  }
  const double mean = sum / kDraws, deviation = std::sqrt(square / kDraws - mean * mean);
  CHECK(stated / deviation == doctest::Approx(1).epsilon(0.03));
  CHECK(stated / std::sqrt(mean * (1 - mean) / (5 * kGroups)) > 1.2);  // what independent ones would have
}
