#include "hostgen/learn/touch_training.h"

#include <doctest/doctest.h>

#include <cmath>

#include "firmware/model/plate_prior.h"
#include "firmware/touch/touch_stage.h"
#include "hostgen/learn/touch_samples.h"
#include "tests/learn/synthetic_finger.h"

using namespace finsight;
using namespace finsight::host;

namespace {

const PlatePriorData& prior() {
  static const PlatePriorData fitted = fit_plate_prior(test::synthetic_dataset(), test::synthetic_spec().noise);
  return fitted;
}

TouchTraining train(int steps, const FemDataset& dataset = test::synthetic_dataset()) {
  TouchTrainingPlan plan;
  plan.steps = steps;
  plan.batch = 64;
  return train_touch(test::synthetic_spec(), dataset, prior(), plan);
}

const TouchTraining& trained() {
  static const TouchTraining training = train(1200);
  return training;
}

// A new noisy measurement of a touch that is in no dataset.
struct Measured {
  FemState truth;
  PlatePoses poses;
};
Measured measure(Random& random, const std::array<bool, kPlates>& seen) {
  const FingerSpec spec = test::synthetic_spec();
  const double y_mm = random.uniform(spec.touch_y_mm[0], spec.touch_y_mm[1]);
  const double x_mm = random.uniform(-1, 1) * (spec.half_width.at(y_mm) - spec.touch_edge_mm);
  Measured result{test::synthetic_state(x_mm, y_mm, random.uniform(1, 6)), {}};
  PoseVector numbers = touch_sample(result.truth).numbers;
  add_noise(spec.noise, random, numbers);
  complete_from_prior(prior().view(), seen, numbers);
  for (std::size_t p = 0; p < kPlates; ++p) {
    result.poses.plates[p] = {numbers.segment<3>(6 * int(p)), numbers.segment<3>(6 * int(p) + 3)};
  }
  result.poses.seen = seen;
  result.poses.quality = Quality::kFresh;
  return result;
}

struct Statistics {
  double mean_error_mm = 0, mean_radius_mm = 0, inside = 0, inside_twice = 0, contact_mm = 0, force_n = 0;
};
constexpr int kMeasurements = 1000;

Statistics measure_many(const std::array<bool, kPlates>& seen) {
  TouchStage stage(trained().model.view());
  Random random(77);
  Statistics result;
  int count = 0;
  while (count < kMeasurements) {
    const Measured measured = measure(random, seen);
    const Touch& touch = stage.locate(measured.poses);
    if (touch.quality != Quality::kFresh) continue;
    const double error_mm = double((touch.point_mm - measured.truth.point_mm).norm());
    result.mean_error_mm += error_mm / kMeasurements;
    result.mean_radius_mm += double(touch.radius_68_mm) / kMeasurements;
    result.inside += (error_mm <= double(touch.radius_68_mm)) / double(kMeasurements);
    result.inside_twice += (error_mm <= 2 * double(touch.radius_68_mm)) / double(kMeasurements);
    result.contact_mm += double((touch.contact_mm - measured.truth.contact_mm).norm()) / kMeasurements;
    result.force_n += double(std::abs(touch.force_n - measured.truth.force_n)) / kMeasurements;
    ++count;
  }
  return result;
}

}  // namespace

TEST_CASE("touch training: held-out points of a smooth finger are found, and the figures are in order") {
  const TouchTraining& result = trained();
  MESSAGE(result.log);
  CHECK(result.held_out_clean.mean_mm < 3);
  CHECK(result.held_out_from_4_mm.mean_mm < 3.5);
  CHECK(result.held_out_clean.mean_mm <= result.held_out_noisy.mean_mm);
  CHECK(result.held_out_noisy.r2[1] > 0.95);
  CHECK(result.quantisation.mean_mm > 0);
  CHECK(result.quantisation.mean_mm < 0.2);
  CHECK(result.quantisation.worst_mm >= result.quantisation.mean_mm);
  CHECK(result.quantisation.int8_error_mm == doctest::Approx(result.quantisation.float_error_mm).epsilon(0.02));
  CHECK(result.random_noisy.mean_mm >= result.random_clean.mean_mm);
  CHECK(result.bands.size() >= 3);
  CHECK(result.bands.front().mean_mm > result.bands.back().mean_mm);
  CHECK(result.force_bands.size() >= 5);
  CHECK(result.coverage_curve.at(9) == doctest::Approx(result.held_out_noisy.coverage_68));
  CHECK(result.held_out_noisy.touches > 500);
  CHECK(result.random_clean.touches > 20);
  CHECK(std::abs(result.held_out_noisy.coverage_68 - 0.68) < 0.15);
}

TEST_CASE("touch training: the errors of new touches are covered by the published radius") {
  const Statistics all = measure_many({true, true, true});
  CHECK(all.mean_error_mm < 3.5);
  CHECK(all.contact_mm < 4);
  CHECK(all.force_n < 0.5);
  CHECK(all.inside == doctest::Approx(0.68).epsilon(0.15));
  CHECK(all.inside_twice > 0.88);
}

TEST_CASE("touch training: where each state has contacts of its own, states that are held out set the radius") {
  FemDataset alone = test::synthetic_dataset();
  alone.plan.scene = "grasp";
  const TouchTrainingPlan plan{.steps = 300, .batch = 64};
  const auto model = [&](const FemDataset& dataset) {
    return train_touch(test::synthetic_spec(), dataset, prior(), plan).model;
  };
  const TouchModelData by_states = model(alone), by_paths = model(test::synthetic_dataset());
  CHECK(by_states.weights == by_paths.weights);
  CHECK(by_states.radius_curve != by_paths.radius_curve);
  CHECK(by_states.seen_factor != by_paths.seen_factor);
}

TEST_CASE("touch training: touches that are kept from learning fit the radius network and nothing else") {
  FemDataset dataset = test::synthetic_dataset();
  const TouchTrainingPlan plan{.steps = 300, .batch = 64};
  const auto model = [&] { return train_touch(test::synthetic_spec(), dataset, prior(), plan).model; };
  const TouchModelData without = model();
  CHECK(without.radius == TouchModelData{}.radius);
  for (const FemState& state : test::synthetic_dataset(6, 3).states) {
    dataset.kept.push_back(state);
    dataset.kept.back().scene = kFirstKept;
  }
  const TouchModelData with = model();
  CHECK(with.radius != without.radius);
  CHECK(with.weights == without.weights);
  CHECK(with.radius_curve == without.radius_curve);
  CHECK(with.explained_above == without.explained_above);
}

TEST_CASE(
    "touch training: touches of turned fingers are found, with a radius that holds, where gravity is told to be "
    "unknown") {
  TouchTrainingPlan plan{.steps = 2500, .batch = 64};
  for (int p = 0; p < kPlates; ++p) {
    const auto height = static_cast<float>(test::kPlateHeights_mm[p] / test::kPlateHeights_mm[0]);
    plan.per_g[std::size_t(3 * (6 * p))] = 2 * height * height;          // x for 1 g along x
    plan.per_g[std::size_t(3 * (6 * p + 2) + 2)] = 2 * height * height;  // z for 1 g along z
    plan.per_g[std::size_t(3 * (6 * p + 3) + 2)] = 0.045F * height;
  }
  const TouchModelData model = train_touch(test::synthetic_spec(), test::synthetic_dataset(), prior(), plan).model;
  CHECK(model.per_g == plan.per_g);
  const GravityCorrection gravity(model.view(), std::nullopt);
  TouchStage stage(model.view());
  Random random(5);
  struct {
    double located = 0, inside = 0;
  } told, untold;
  for (int i = 0; i < kMeasurements;) {
    const Measured measured = measure(random, {true, true, true});
    PoseVector numbers = pose_vector(measured.poses);
    turn(gravity, 1, random, numbers);
    const PlatePoses poses = seen_poses({numbers.data(), kPoseDims});
    if (plate_motion_mm(poses.plates) < model.threshold_mm) continue;
    ++i;
    for (auto* of : {&told, &untold}) {
      const Touch touch = stage.locate(poses, numbers, {.unknown_g = of == &told ? GravityCorrection::kUnknown_g : 0});
      if (touch.quality != Quality::kFresh) continue;
      const double off_mm = double((touch.point_mm - measured.truth.point_mm).norm());
      ++of->located;
      of->inside += off_mm <= double(touch.radius_68_mm);
    }
  }
  CHECK(told.located > 0.95 * kMeasurements);
  CHECK(told.inside / told.located == doctest::Approx(0.68).epsilon(0.1));
  CHECK(untold.located < 0.5 * kMeasurements);
  CHECK(untold.inside / untold.located < told.inside / told.located - 0.2);
}

TEST_CASE("touch training: plates that are not seen widen the radius") {
  const Statistics all = measure_many({true, true, true}), two = measure_many({true, true, false}),
                   one = measure_many({true, false, false});
  CHECK(two.mean_radius_mm > 1.1 * all.mean_radius_mm);
  CHECK(one.mean_radius_mm > 1.1 * two.mean_radius_mm);
  CHECK(two.inside == doctest::Approx(0.68).epsilon(0.15));
  CHECK(one.inside == doctest::Approx(0.68).epsilon(0.15));
}

TEST_CASE("touch training: the model has the sizes and the threshold that the pack expects") {
  const TouchModel model = trained().model.view();
  CHECK(model.threshold_mm == 2);
  CHECK(model.scale.size() == kPoseDims);
  CHECK(model.input_mean.size() == TouchModel::kInputs);
  CHECK(model.output_scale.size() == TouchModel::kOutputs);
  CHECK(model.first.inputs == TouchModel::kInputs);
  CHECK(model.first.weights.size() == TouchModel::kInputs * 256);
  for (const DenseInt8& layer : model.middle) {
    CHECK(layer.outputs == 256);
    CHECK(layer.weights.size() == 256 * 256);
  }
  CHECK(model.last.outputs == TouchModel::kOutputs);
  CHECK(model.last.weights.size() == TouchModel::kOutputs * 256);
}

TEST_CASE("touch training: same seed, same bytes") {
  const FemDataset few = test::synthetic_dataset(3, 2);
  const TouchTraining a = train(20, few), b = train(20, few);
  CHECK(a.model.first == b.model.first);
  CHECK(a.model.weights == b.model.weights);
  CHECK(a.model.weight_scale == b.model.weight_scale);
  CHECK(a.model.bias == b.model.bias);
  CHECK(a.model.output_mean == b.model.output_mean);
  CHECK(a.model.radius_curve == b.model.radius_curve);
  CHECK(a.log == b.log);
}

TEST_CASE("touch training: a training set without valid states is refused") {
  FemDataset dataset = test::synthetic_dataset();
  for (FemState& state : dataset.states) state.outcome = Outcome::kPushedTooFar;
  CHECK_THROWS_AS(train_touch(test::synthetic_spec(), dataset, prior(), {}), std::runtime_error);
}
