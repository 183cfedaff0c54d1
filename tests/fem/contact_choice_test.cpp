#include "hostgen/fem/contact_choice.h"

#include <doctest/doctest.h>

#include <algorithm>
#include <cmath>
#include <utility>
#include <vector>

#include "firmware/types.h"
#include "hostgen/util/random.h"

using namespace finsight::host;
using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;
using finsight::kPoseDims;

namespace {

/// A strip, 60 mm long and 4 mm wide, seen by as many smooth functions of the place as there are plate numbers, in
/// standard deviations of a measurement.
struct Strip {
  PushResponse response;
  Random random{7};

  Strip() {
    response.at = [](const Eigen::Vector2d& place) {
      VectorXd numbers(kPoseDims);
      for (Index i = 0; i < kPoseDims; ++i) {
        const double peak = 30 * std::exp(-std::pow((place.y() - 4.0 * static_cast<double>(i) + 4) / 12, 2));
        numbers[i] = peak * (1 + (i % 2 ? 0.1 : -0.1) * place.x());
      }
      return numbers;
    };
    response.inside = [](const Eigen::Vector2d& place) {
      return Eigen::Vector2d(std::clamp(place.x(), -2.0, 2.0), std::clamp(place.y(), 0.0, 60.0));
    };
    response.grid_mm.resize(2, 3 * 31);
    response.at_grid.resize(kPoseDims, 3 * 31);
    for (Index k = 0; k < 3 * 31; ++k) {
      response.grid_mm.col(k) << 2.0 * static_cast<double>(k % 3 - 1), 2.0 * static_cast<double>(k / 3);
      response.at_grid.col(k) = response.at(response.grid_mm.col(k));
    }
  }
  /// Pushes (y, force) on the middle line.
  VectorXd measured(const std::vector<std::pair<double, double>>& pushes) {
    VectorXd goal(kPoseDims);
    for (double& x : goal) x = random.normal();
    for (const auto& push : pushes) goal += push.second * response.at(Eigen::Vector2d(0, push.first));
    return goal;
  }
};

}  // namespace

TEST_CASE("contact choice: noise alone is no contact, one push is one, two are two") {
  Strip strip;
  CHECK(fewest_contacts(strip.response, strip.measured({}), {}).force_n.size() == 0);
  const ContactChoice one = fewest_contacts(strip.response, strip.measured({{20.7, 2}}), {});
  REQUIRE(one.force_n.size() == 1);
  CHECK(one.place_mm(1, 0) == doctest::Approx(20.7).epsilon(0.03));
  CHECK(one.force_n[0] == doctest::Approx(2).epsilon(0.05));
  const ContactChoice two = fewest_contacts(strip.response, strip.measured({{20.7, 2}, {45.2, 1}}), {});
  REQUIRE(two.force_n.size() == 2);
  CHECK(two.force_n.sum() == doctest::Approx(3).epsilon(0.05));
  CHECK(two.place_mm.row(1).sum() == doctest::Approx(65.9).epsilon(0.03));
}

TEST_CASE("contact choice: it does not matter where the search starts") {
  Strip strip;
  const VectorXd goal = strip.measured({{12.3, 1}, {50.1, 1.5}});
  ContactChoice bad;
  bad.place_mm.resize(2, 4);
  bad.place_mm << 0, 1, -1, 2, 3, 30, 31, 60;
  const ContactChoice cold = fewest_contacts(strip.response, goal, {});
  const ContactChoice warm = fewest_contacts(strip.response, goal, bad);
  REQUIRE(cold.force_n.size() == warm.force_n.size());
  CHECK(cold.misfit == doctest::Approx(warm.misfit).epsilon(1e-3));
}

TEST_CASE("contact choice: pulls are never an explanation, and no push leaves the face") {
  Strip strip;
  const ContactChoice pull = fewest_contacts(strip.response, strip.measured({{20, -2}}), {});
  CHECK(pull.force_n.size() == 0);
  CHECK(pull.misfit > 100);
  const ContactChoice beyond = fewest_contacts(strip.response, strip.measured({{64, 2}}), {});
  REQUIRE(beyond.force_n.size() > 0);
  CHECK(beyond.place_mm.row(1).maxCoeff() <= 60);
}

TEST_CASE("contact uncertainty: contains the truth 95 times in 100, and grows when the push is weak") {
  Strip strip;
  double mean_reach_mm[2] = {};
  for (const int weak : {0, 1}) {
    int inside = 0, force_inside = 0, found = 0;
    for (int round = 0; round < 300; ++round) {
      const double y = strip.random.uniform(10, 50), force_n = weak ? 0.15 : 1.0;
      const VectorXd goal = strip.measured({{y, force_n}});
      const ContactChoice choice = fewest_contacts(strip.response, goal, {});
      if (choice.force_n.size() != 1) continue;
      const ContactUncertainty uncertainty = contact_uncertainties(strip.response, goal, choice)[0];
      ++found;
      inside += (choice.place_mm.col(0) - Eigen::Vector2d(0, y)).norm() <= uncertainty.position_95_mm;
      force_inside += uncertainty.lowest_force_n <= force_n && force_n <= uncertainty.highest_force_n;
      mean_reach_mm[weak] += uncertainty.position_95_mm / 300;
    }
    CHECK(found > 250);
    CHECK(inside >= 0.95 * found);
    CHECK(force_inside >= 0.95 * found);
  }
  CHECK(mean_reach_mm[1] > 3 * mean_reach_mm[0]);
}

TEST_CASE("contact choice: two pushes near each other are told apart, although one between them looks much the same") {
  Strip strip;
  int two = 0;
  for (int round = 0; round < 100; ++round) {
    const double y = strip.random.uniform(15, 35);
    const ContactChoice found = fewest_contacts(strip.response, strip.measured({{y, 1}, {y + 9, 1}}), {});
    two += found.force_n.size() == 2;
    CHECK(found.misfit < 60);
  }
  CHECK(two >= 95);
}

TEST_CASE("contact uncertainty: a weaker push is compatible with a wider pressure") {
  Strip strip;
  VectorXd goal = 2 * strip.response.at(Eigen::Vector2d(0, 30));
  const auto extent_95_mm = [&] {
    return contact_uncertainties(strip.response, goal, fewest_contacts(strip.response, goal, {}))[0].extent_95_mm;
  };
  const double sharp_mm = extent_95_mm();
  goal *= 0.1;
  CHECK(extent_95_mm() > 1.5 * sharp_mm);
}

TEST_CASE("contact uncertainty: the spread of an even pressure is within it 95 times in 100, and so is its force") {
  Strip strip;
  int inside = 0, force_inside = 0, found = 0;
  for (int round = 0; round < 300; ++round) {
    const double half_mm = strip.random.uniform(1, 4), y = strip.random.uniform(15, 45);
    VectorXd goal = strip.measured({});
    for (int i = 0; i < 9; ++i) goal += 1.0 / 9 * strip.response.at(Eigen::Vector2d(0, y + half_mm * (i - 4) / 4));
    const ContactChoice choice = fewest_contacts(strip.response, goal, {});
    if (choice.force_n.size() != 1) continue;
    const ContactUncertainty uncertainty = contact_uncertainties(strip.response, goal, choice)[0];
    ++found;
    inside += std::abs(choice.place_mm(1, 0) - y) + half_mm <= uncertainty.extent_95_mm;
    force_inside += uncertainty.lowest_force_n <= 1 && 1 <= uncertainty.highest_force_n;
  }
  CHECK(found > 200);
  CHECK(inside >= 0.95 * found);
  CHECK(force_inside >= 0.95 * found);
}
