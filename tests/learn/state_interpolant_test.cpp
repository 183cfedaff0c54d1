#include "hostgen/learn/state_interpolant.h"

#include <doctest/doctest.h>

#include <cmath>

#include "tests/learn/synthetic_finger.h"

using namespace finsight;
using namespace finsight::host;

namespace {

double plate_error_sq(const TouchSample& a, const TouchSample& b) {
  double sum = 0;
  for (int p = 0; p < kPlates; ++p) sum += (a.numbers.segment<3>(6 * p) - b.numbers.segment<3>(6 * p)).squaredNorm();
  return sum;
}

}  // namespace

TEST_CASE("state interpolant: reproduces the computed states") {
  const FemDataset dataset = test::synthetic_dataset();
  const StateInterpolant interpolant(dataset.states);
  for (const FemState& state : dataset.states) {
    const TouchSample truth = touch_sample(state);
    const TouchSample found = interpolant.at(state.point_mm.x(), state.point_mm.y(), state.force_n);
    CHECK((found.numbers - truth.numbers).norm() < 1e-3f);
    CHECK((found.point_mm - truth.point_mm).norm() < 1e-3f);
    CHECK((found.displacement_mm - truth.displacement_mm).norm() < 1e-3f);
    CHECK(found.force_n == truth.force_n);
  }
}

TEST_CASE("state interpolant: is close to the true finger between points and forces and below the lowest force") {
  const StateInterpolant interpolant(test::synthetic_dataset().states);
  for (const double x : {-13.0, 2.0, 11.0}) {
    for (const double y : {22.0, 47.0, 71.0, 95.0}) {
      for (const double force : {0.4, 1.7, 3.1, 5.5}) {
        const TouchSample truth = touch_sample(test::synthetic_state(x, y, force));
        const TouchSample found = interpolant.at(x, y, force);
        CHECK((found.numbers - truth.numbers).norm() < 0.02f + 0.02f * truth.numbers.norm());
        CHECK((found.point_mm - truth.point_mm).norm() < 1e-2f);
      }
    }
  }
}

TEST_CASE("state interpolant: without force there is no motion") {
  const TouchSample rest = StateInterpolant(test::synthetic_dataset().states).at(3, 50, 0);
  CHECK(rest.numbers.norm() == 0);
  CHECK(rest.displacement_mm.norm() == 0);
}

TEST_CASE("state interpolant: the leave-one-out error equals refitting without each point") {
  const FemDataset dataset = test::synthetic_dataset(5, 2);
  double error_sq = 0;
  for (const FemState& left_out : dataset.states) {
    std::vector<FemState> others;
    for (const FemState& state : dataset.states) {
      if (state.path != left_out.path) others.push_back(state);
    }
    const StateInterpolant refitted(others);
    error_sq += plate_error_sq(refitted.at(left_out.point_mm.x(), left_out.point_mm.y(), left_out.force_n),
                               touch_sample(left_out));
  }
  const double expected_mm = std::sqrt(error_sq / double(dataset.states.size() * kPlates));
  CHECK(expected_mm > 0.01);
  CHECK(StateInterpolant(dataset.states).leave_one_out_mm() == doctest::Approx(expected_mm).epsilon(1e-3));
}

TEST_CASE("state interpolant: invalid states are not used, and a path that ends early limits the force there") {
  FemDataset dataset = test::synthetic_dataset();
  const Vec3f place = dataset.states[32 * 5].point_mm;
  for (FemState& state : dataset.states) {
    if (state.path != 32 || state.force_n < 3) continue;
    state.outcome = Outcome::kPushedTooFar;
    state.plates[0].displacement_mm.setConstant(NAN);
  }
  const StateInterpolant interpolant(dataset.states);
  CHECK(interpolant.highest_force_n(place.x() + 0.5, place.y() - 0.5) == doctest::Approx(2.25));
  CHECK(interpolant.highest_force_n(0, 20) == doctest::Approx(6));
  CHECK(interpolant.at(place.x(), place.y(), 2).numbers.allFinite());
}

TEST_CASE("state interpolant: copes with two paths at one contact point") {
  FemDataset dataset = test::synthetic_dataset();
  const FemDataset copy = dataset;
  for (int k = 0; k < 5; ++k) {
    dataset.states.push_back(copy.states[std::size_t(k)]);
    dataset.states.back().path = 99;
  }
  const FemState& state = dataset.states[1];
  const TouchSample found = StateInterpolant(dataset.states).at(state.point_mm.x(), state.point_mm.y(), state.force_n);
  CHECK((found.numbers - touch_sample(state).numbers).norm() < 1e-2f);
}

TEST_CASE("state interpolant: too few points are refused") {
  FemDataset dataset = test::synthetic_dataset();
  dataset.states.resize(5 * 9);  // nine contact points
  CHECK_THROWS_AS(StateInterpolant{dataset.states}, std::runtime_error);
  CHECK_THROWS_AS(StateInterpolant{std::vector<FemState>{}}, std::runtime_error);
}
