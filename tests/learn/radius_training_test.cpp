#include "hostgen/learn/radius_training.h"

#include <doctest/doctest.h>

#include <cmath>

#include "hostgen/fem/scene_contacts.h"
#include "hostgen/util/random.h"

using namespace finsight;
using namespace finsight::host;

namespace {

constexpr std::size_t kFriction = 4;  // of RadiusFeatures
constexpr int kEach = 3000;

/// Touches of one kind at a radius of 1 mm; a feature tells the kind, as far as its noise allows.
void add(std::uint8_t kind, double error_mm, float feature, std::vector<TouchTrial>& trials) {
  Random random(kind + 1);
  for (int i = 0; i < kEach; ++i) {
    TouchTrial trial;
    trial.scene = static_cast<std::uint8_t>(kFirstKept + kind);
    trial.plate_motion_mm = 5;
    trial.radius_68_mm = 1;
    for (int axis = 0; axis < 2; ++axis) trial.error_mm[axis] = static_cast<float>(error_mm * random.normal());
    trial.radius_features[kFriction] = feature + 0.7F * static_cast<float>(random.normal());
    trials.push_back(trial);
  }
}

/// Shares of a kind inside the radius, twice and three times that.
std::array<double, 3> shares(const std::vector<TouchTrial>& trials, const TouchModelData& model, std::uint8_t kind) {
  std::array<double, 3> inside{};
  double count = 0;
  for (const TouchTrial& trial : trials) {
    if (trial.scene != kFirstKept + kind) continue;
    ++count;
    const double radii = double(trial.error_mm.norm() / radius_factor(model.view(), trial.radius_features));
    for (int k = 0; k < 3; ++k) inside[std::size_t(k)] += radii <= k + 1;
  }
  for (double& share : inside) share /= count;
  return inside;
}

}  // namespace

TEST_CASE("radius training: kinds that are hardly told apart still have their 68 % each") {
  std::vector<TouchTrial> trials;
  add(0, 0.5, 0, trials);
  add(3, 0.9, 1, trials);
  const TouchModelData unfitted;
  CHECK(shares(trials, unfitted, 0)[0] > 0.85);
  CHECK(shares(trials, unfitted, 3)[0] < 0.5);
  TouchModelData model;
  fit_radius_network(trials, 2, model);
  std::vector<TouchTrial> others;  // of the same kinds
  add(0, 0.5, 0, others);
  add(3, 0.9, 1, others);
  for (const std::uint8_t kind : {0, 3}) {
    CAPTURE(kind);
    CHECK(shares(others, model, kind)[0] == doctest::Approx(0.68).epsilon(0.04));
    CHECK(shares(others, model, kind)[1] == doctest::Approx(0.95).epsilon(0.04));
  }
  TouchModelData again;
  fit_radius_network(trials, 2, again);
  CHECK(again.radius_inputs == model.radius_inputs);
  CHECK(again.radius == model.radius);
}

TEST_CASE("radius training: where another scene is likelier, the radius grows until it holds that one's errors") {
  std::vector<TouchTrial> trials;
  add(0, 0.5, 0, trials);
  TouchModelData alone;
  fit_radius_network(trials, 2, alone);
  add(kKindsOfTouch, 4, 1, trials);
  TouchModelData model;
  fit_radius_network(trials, 2, model);
  const double were = 1 - shares(trials, alone, kKindsOfTouch)[2], are = 1 - shares(trials, model, kKindsOfTouch)[2];
  CHECK(were > 0.4);
  CHECK(are < 0.3 * were);
  CHECK(shares(trials, model, 0)[0] == doctest::Approx(0.68).epsilon(0.04));
}

TEST_CASE("radius training: touches of turned fingers have their 68 % by themselves") {
  constexpr std::size_t kGravity = TouchModel::kRadiusFeatures - 1;
  constexpr std::uint8_t kTurned = 5;
  std::vector<TouchTrial> trials;
  for (const std::uint8_t kind : {0, 1, 2}) add(kind, 0.5, 0, trials);
  add(kTurned, 1.5, 0, trials);
  for (TouchTrial& trial : trials) {
    trial.gravity_is_known = trial.scene != kFirstKept + kTurned;
    trial.radius_features[kGravity] = trial.gravity_is_known ? -4.6F : 0.0F;
  }
  TouchModelData model;
  fit_radius_network(trials, 2, model);
  CHECK(shares(trials, model, 1)[0] == doctest::Approx(0.68).epsilon(0.04));
  CHECK(shares(trials, model, kTurned)[0] == doctest::Approx(0.68).epsilon(0.04));
}

TEST_CASE("radius training: what is not published does not count, and without touches of the scene nothing changes") {
  std::vector<TouchTrial> trials;
  add(0, 0.5, 0, trials);
  TouchModelData model;
  model.explained_above = model.explained_above_unknown_g = -1;
  fit_radius_network(trials, 2, model);
  std::vector<TouchTrial> more = trials;
  for (TouchTrial trial : trials) {
    trial.error_mm *= 5;
    trial.plate_motion_mm = 1;
    more.push_back(trial);
    trial.plate_motion_mm = 5;
    trial.explained = -2;
    more.push_back(trial);
    trial.explained = 0;
    trial.gravity_is_known = false;
    more.push_back(trial);
    trial.gravity_is_known = true;
    trial.radius_68_mm = 0;  // located nowhere
    more.push_back(trial);
    trial.radius_68_mm = 1;
    trial.scene = 0;  // learnt
    more.push_back(trial);
  }
  TouchModelData same;
  same.explained_above = -1;
  same.explained_above_unknown_g = 1;
  fit_radius_network(more, 2, same);
  CHECK(same.radius == model.radius);

  std::vector<TouchTrial> of_others;
  add(kKindsOfTouch, 3, 2, of_others);
  for (const std::vector<TouchTrial>& none : {std::vector<TouchTrial>{}, of_others}) {
    TouchModelData untouched;
    fit_radius_network(none, 2, untouched);
    CHECK(untouched.radius == TouchModelData{}.radius);
  }
}
