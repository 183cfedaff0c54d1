#include "firmware/touch/touch_stage.h"

#include <doctest/doctest.h>

#include <cmath>
#include <limits>

#include "firmware/model/plate_prior.h"
#include "firmware/touch/features.h"
#include "hostgen/learn/touch_network.h"
#include "tests/count_allocations.h"
#include "tests/learn/synthetic_finger.h"
#include "tests/model/tiny_model.h"

using namespace finsight;
using namespace finsight::host;

namespace {

// A network trained for a few steps: it has every part of a real one.
TouchNetwork& trained() {
  static TouchNetwork network = [] {
    const StateInterpolant states(test::synthetic_dataset().states);
    Random random(1);
    const std::vector<TouchSample> touches = draw_touches(test::synthetic_spec(), states, 2000, random);
    static const PlatePriorData prior = fit_plate_prior(test::synthetic_dataset(), test::synthetic_spec().noise);
    TouchTrainingPlan plan;
    plan.steps = 150;
    plan.batch = 64;
    for (int p = 0; p < kPlates; ++p) {
      for (int axis = 0; axis < 3; ++axis)
        plan.per_g[std::size_t(3 * (6 * p + axis) + axis)] = 0.4F * float(kPlates - p);
    }
    TouchNetwork result = train_touch_network(touches, test::synthetic_spec().noise, prior.view(), plan, 1, [] {});
    result.model.threshold_mm = 2;
    result.model.range_mm = 30;
    quantise(result);
    return result;
  }();
  return network;
}

PlatePoses poses_of(const FemState& state) {
  PlatePoses poses;
  poses.plates = state.plates;
  poses.seen = {true, true, true};
  poses.quality = Quality::kFresh;
  return poses;
}

const FemState kPushed = test::synthetic_state(5, 70, 5);

}  // namespace

TEST_CASE("touch stage: the radius curve is linear between its knots and constant beyond them") {
  const std::vector<float> curve = {2, std::log(2.0f), 1, 6, 0, 0.5f};
  CHECK(calibrated_radius_mm(curve, 1, 3) == doctest::Approx(6));
  CHECK(calibrated_radius_mm(curve, 2, 3) == doctest::Approx(6));
  CHECK(calibrated_radius_mm(curve, 4, 3) == doctest::Approx(std::sqrt(2.0) * std::pow(3.0, 0.75)));
  CHECK(calibrated_radius_mm(curve, 6, 4) == doctest::Approx(2));
  CHECK(calibrated_radius_mm(curve, 60, 4) == doctest::Approx(2));
  CHECK(calibrated_radius_mm(std::vector<float>{0, 0, 1}, 5, 3) == doctest::Approx(3));
}

TEST_CASE("touch stage: gives the float network's numbers within the quantisation error") {
  TouchStage stage(trained().model.view());
  double worst_mm = 0, worst_n = 0;
  for (const double x : {-15.0, 0.0, 12.0}) {
    for (const double y : {50.0, 70.0, 90.0}) {
      const FemState state = test::synthetic_state(x, y, 5);
      const Touch& touch = stage.locate(poses_of(state));
      REQUIRE(touch.quality == Quality::kFresh);
      const auto expected = evaluate(trained(), touch_sample(state).numbers, {1, 1, 1}, 0);
      worst_mm = std::max(worst_mm, double((touch.point_mm - expected.head<3>()).norm()));
      worst_n = std::max(worst_n, std::abs(double(touch.force_n - std::max(expected[6], 0.0f))));
      CHECK((touch.contact_mm - expected.head<3>() - expected.segment<3>(3)).norm() < 0.5f);
      const double doubt = std::exp(1 - double(touch.explained));
      const double radius = double(expected.segment<3>(12).array().exp().matrix().norm()) * std::hypot(1, doubt);
      CHECK(std::abs(touch.explained - expected[TouchModel::kOutputs - 1]) < 0.2F);
      CHECK(double(touch.radius_68_mm) == doctest::Approx(radius).epsilon(0.05));
      CHECK((touch.force_vector_n.tail<2>() - expected.segment<2>(7)).norm() < 0.1f);
      CHECK((touch.moment_nm - expected.segment<3>(9)).norm() < 0.01f);
      for (int i = 0; i < 3; ++i) {
        CHECK(double(touch.force_vector_sigma_n[i]) ==
              doctest::Approx(std::exp(double(expected[15 + i]))).epsilon(0.05));
        CHECK(double(touch.moment_sigma_nm[i]) == doctest::Approx(std::exp(double(expected[18 + i]))).epsilon(0.05));
      }
      CHECK(touch.force_sigma_n == touch.force_vector_sigma_n[0]);
    }
  }
  CHECK(worst_mm < 0.5);
  CHECK(worst_mm > 0);  // otherwise it was not the int8 network
  CHECK(worst_n < 0.1);
}

TEST_CASE("touch stage: below the threshold of plate motion the touch is invalid and carries no numbers") {
  TouchStage stage(trained().model.view());
  PlatePoses poses;
  poses.seen = {true, true, true};
  poses.quality = Quality::kFresh;
  poses.plates[kMiddlePlate].displacement_mm = Vec3f(0, 0, 1.999f);
  Touch touch = stage.locate(poses);
  CHECK(touch.quality == Quality::kInvalid);
  CHECK(double(touch.plate_motion_mm) == doctest::Approx(1.999));
  CHECK(touch.point_mm == Vec3f::Zero());
  CHECK(touch.force_n == 0);
  poses.plates[kMiddlePlate].displacement_mm = Vec3f(0, 0, 2.001f);
  CHECK(stage.locate(poses).quality == Quality::kFresh);
  poses.plates[kMiddlePlate] = {};
  CHECK(stage.locate(poses).quality == Quality::kInvalid);  // nothing remains of the previous touch
}

TEST_CASE("touch stage: beyond the trained plate motion it reports over range instead of a touch") {
  TouchStage stage(trained().model.view());
  PlatePoses poses = poses_of(kPushed);
  CHECK_FALSE(stage.locate(poses).over_range);
  poses.plates[kTopPlate].displacement_mm = Vec3f(0, 0, 30.01f);
  const Touch touch = stage.locate(poses);
  CHECK(touch.over_range);
  CHECK(touch.quality == Quality::kInvalid);
  CHECK(touch.point_mm == Vec3f::Zero());
  CHECK_FALSE(stage.locate(poses_of(kPushed)).over_range);
}

TEST_CASE("touch stage: a point off the face, or a meaninglessly large radius, is not a touch") {
  test::TinyModel tiny;
  Model model = tiny.open();
  model.touch = trained().model.view();
  const Touch touch = TouchStage(model.touch).locate(poses_of(kPushed));
  REQUIRE(touch.quality == Quality::kFresh);
  const auto quality = [&](const Vec3f& low_mm, const Vec3f& high_mm) {
    const std::vector<float> corners_mm = {low_mm.x(), low_mm.y(),  low_mm.z(),  500,        500,
                                           500,        high_mm.x(), high_mm.y(), high_mm.z()};
    const std::vector<std::int32_t> front = {0, 2};
    model.shape.rest_mm = corners_mm;
    model.shape.front_nodes = front;
    return TouchStage(model).locate(poses_of(kPushed)).quality;
  };
  const Vec3f nearly = touch.point_mm + Vec3f(0, 1.9F * touch.radius_68_mm, 0),
              beyond = touch.point_mm + Vec3f(0, 2.1F * touch.radius_68_mm, 0), far(40, 90, 40);
  CHECK(quality(nearly, nearly + far) == Quality::kFresh);
  CHECK(quality(beyond, beyond + far) == Quality::kInvalid);
  CHECK(quality(touch.point_mm - far, touch.point_mm + far) == Quality::kFresh);
  std::vector<float> curve(model.touch.radius_curve.begin(), model.touch.radius_curve.end());
  for (std::size_t knot = 1; knot < curve.size(); knot += 3) curve[knot] += 5;
  model.touch.radius_curve = curve;
  CHECK(quality(touch.point_mm - far, touch.point_mm + far) == Quality::kInvalid);
}

TEST_CASE("touch stage: each combination of seen plates has a factor of its own for the radius") {
  CHECK(seen_index({true, false, false}) == 0);
  CHECK(seen_index({true, false, true}) == 4);
  CHECK(seen_index({true, true, true}) == TouchModel::kSeenPatterns - 1);
  std::vector<float> factor(TouchModel::kSeenPatterns, 1);
  factor[seen_index({true, false, true})] = 1.5F;
  TouchModel model = trained().model.view(), widened = model;
  widened.seen_factor = factor;
  PlatePoses poses = poses_of(kPushed);
  CHECK(TouchStage(widened).locate(poses).radius_68_mm == TouchStage(model).locate(poses).radius_68_mm);
  poses.seen[kMiddlePlate] = false;
  CHECK(TouchStage(widened).locate(poses).radius_68_mm ==
        doctest::Approx(1.5F * TouchStage(model).locate(poses).radius_68_mm));
}

TEST_CASE("touch stage: shaking widens the radius and leaves the point") {
  TouchStage stage(trained().model.view());
  const Touch calm = stage.locate(poses_of(kPushed)),
              shaken = stage.locate(poses_of(kPushed), pose_vector(poses_of(kPushed)), {.shaken_mm = 4});
  CHECK(shaken.point_mm == calm.point_mm);
  CHECK(shaken.radius_68_mm == doctest::Approx(std::hypot(calm.radius_68_mm, 3)));
}

TEST_CASE("touch stage: poses without a seen plate tell of no touch") {
  TouchStage stage(trained().model.view());
  PlatePoses poses = poses_of(kPushed);
  poses.seen = {false, false, false};
  CHECK(stage.locate(poses).quality == Quality::kInvalid);
}

TEST_CASE("touch stage: never gives non-finite or absurd numbers") {
  TouchStage stage(trained().model.view());
  for (const float bad : {std::numeric_limits<float>::quiet_NaN(), std::numeric_limits<float>::infinity()}) {
    for (int plate = 0; plate < kPlates; ++plate) {
      PlatePoses poses = poses_of(kPushed);
      poses.plates[std::size_t(plate)].rotation_rad.y() = bad;
      CHECK(stage.locate(poses).quality == Quality::kInvalid);
      poses = poses_of(kPushed);
      poses.plates[std::size_t(plate)].displacement_mm.x() = bad;
      CHECK(stage.locate(poses).quality == Quality::kInvalid);
    }
  }
  for (const float huge : {1e6f, 1e19f, 3e38f}) {
    PlatePoses poses = poses_of(kPushed);
    poses.plates[0].displacement_mm.setConstant(huge);
    const Touch& touch = stage.locate(poses);
    CHECK(touch.point_mm.allFinite());
    CHECK(std::isfinite(touch.radius_68_mm));
    CHECK(std::isfinite(touch.force_n));
  }
}

TEST_CASE("touch stage: the force is never negative") {
  TouchModelData model = trained().model;
  model.output_mean[6] = -1000;
  TouchStage stage(model.view());
  const Touch& touch = stage.locate(poses_of(kPushed));
  CHECK(touch.quality == Quality::kFresh);
  CHECK(touch.force_n == 0);
}

TEST_CASE("touch stage: locate() does not allocate") {
  const PlatePriorData prior = fit_plate_prior(test::synthetic_dataset(), test::synthetic_spec().noise);
  TouchStage stage(trained().model.view());
  PlatePoses poses = poses_of(kPushed), unseen = poses, nothing;
  unseen.seen = {true, false, false};
  const long before = test::allocations;
  float sum = 0;
  for (int i = 0; i < 10; ++i) {
    complete_from_prior(prior.view(), unseen);
    for (const PlatePoses* frame : {&poses, &unseen, &nothing}) sum += stage.locate(*frame).point_mm.y();
  }
  const long after = test::allocations;
  CHECK(after == before);
  CHECK(before > 0);  // the counter works
  CHECK(sum != 0);
}

TEST_CASE("touch stage: a motion that no touch of the scene explains is not a touch") {
  TouchModelData model = trained().model;
  const Touch touch = TouchStage(model.view()).locate(poses_of(kPushed));
  REQUIRE(touch.quality == Quality::kFresh);
  CHECK_FALSE(touch.unexplained);
  model.explained_above = touch.explained + 0.01F;
  const Touch refused = TouchStage(model.view()).locate(poses_of(kPushed));
  CHECK(refused.unexplained);
  CHECK(refused.quality == Quality::kInvalid);
  CHECK(refused.point_mm == Vec3f::Zero());
  CHECK(refused.plate_motion_mm == touch.plate_motion_mm);
  TouchStage of_another_finger(model.view());
  of_another_finger.explain_less_likely(0.02F);
  CHECK(of_another_finger.locate(poses_of(kPushed)).point_mm == touch.point_mm);
}

TEST_CASE("touch stage: the radius network widens the radius, of a fitted finger by how likely its own touches are") {
  TouchModelData model = trained().model;
  model.explained_above = -1000;
  const Touch plain = TouchStage(model.view()).locate(poses_of(kPushed));
  // Of the log-odds alone: half of them is the logarithm of the factor, since large sums pass unchanged.
  constexpr std::size_t kOdds = 3;
  model.output_mean.back() += 2 - plain.explained;
  model.radius_inputs[2 * kOdds + 1] = 1;
  model.radius[0].weights[kOdds] = 1000;
  model.radius[1].weights[0] = 1;
  model.radius[2].weights[0] = 0.0005F;
  TouchStage stage(model.view());
  const Touch wider = stage.locate(poses_of(kPushed));
  CHECK(wider.point_mm == plain.point_mm);
  CHECK(wider.force_sigma_n == plain.force_sigma_n);
  CHECK(wider.radius_68_mm == doctest::Approx(std::exp(1.0) * plain.radius_68_mm));
  stage.explain_less_likely(-1);
  CHECK(stage.locate(poses_of(kPushed)).radius_68_mm == doctest::Approx(std::exp(0.5) * plain.radius_68_mm));
  stage.explain_less_likely(std::numeric_limits<float>::infinity());
  CHECK(std::isfinite(stage.locate(poses_of(kPushed)).radius_68_mm));
  model.explained_above = 0;
  model.output_mean.back() -= 500;
  CHECK(TouchStage(model.view()).locate(poses_of(kPushed)).unexplained);  // the radius is still a number
}

TEST_CASE("touch stage: what else may have moved the plates widens radius and deviations, and may be the explanation") {
  TouchModelData model = trained().model;
  model.marker_tolerance_mm = 0.3F;
  model.marker_tolerance_rad = 0.02F;
  TouchStage stage(model.view());
  const PlatePoses poses = poses_of(kPushed);
  const auto locate = [&](const PoseVector& motion, const Doubt& doubt) { return stage.locate(poses, motion, doubt); };
  const Touch calm = locate(pose_vector(poses), {}), unzeroed = locate(pose_vector(poses), {.is_from_rest = false});
  REQUIRE(calm.quality == Quality::kFresh);
  CHECK(unzeroed.point_mm == calm.point_mm);
  CHECK(unzeroed.force_vector_n == calm.force_vector_n);
  CHECK(unzeroed.radius_68_mm > 1.05F * calm.radius_68_mm);
  CHECK(unzeroed.force_sigma_n > calm.force_sigma_n);
  CHECK(unzeroed.moment_sigma_nm[0] > calm.moment_sigma_nm[0]);
  CHECK(unzeroed.explained >= calm.explained);
  float square = calm.radius_68_mm * calm.radius_68_mm;
  for (int i = 0; i < kPoseDims; ++i) {
    PoseVector moved = pose_vector(poses);
    moved[i] += i % 6 < 3 ? 0.3F : 0.02F;
    square += (locate(moved, {}).point_mm - calm.point_mm).squaredNorm();
  }
  CHECK(unzeroed.radius_68_mm == doctest::Approx(std::sqrt(square)));
}

TEST_CASE("touch stage: where gravity is not known, the network knows that, and has a limit of its own") {
  TouchModelData model = trained().model;
  const PlatePoses poses = poses_of(kPushed);
  const auto locate = [&](float unknown_g) {
    return TouchStage(model.view()).locate(poses, pose_vector(poses), {.unknown_g = unknown_g});
  };
  const Touch calm = locate(0), hanging = locate(kMaxUnknown_g);
  REQUIRE(hanging.quality == Quality::kFresh);
  const auto expected = evaluate(trained(), touch_sample(kPushed).numbers, {1, 1, 1}, kMaxUnknown_g);
  CHECK((hanging.point_mm - expected.head<3>()).norm() < 0.5F);
  CHECK(hanging.radius_68_mm > 1.02F * calm.radius_68_mm);
  CHECK(hanging.force_sigma_n > 1.02F * calm.force_sigma_n);
  CHECK(hanging.moment_sigma_nm[0] > calm.moment_sigma_nm[0]);
  model.explained_above_unknown_g = std::max(calm.explained, hanging.explained) + 0.01F;
  CHECK(locate(kMaxUnknown_g).unexplained);
  CHECK_FALSE(locate(0.1F).unexplained);
}

TEST_CASE("touch stage: the force is only as sure as the finger's stiffness") {
  TouchModelData model = trained().model;
  const Touch exact = TouchStage(model.view()).locate(poses_of(kPushed));
  model.stiffness_tolerance = 0.5F;
  const Touch unsure = TouchStage(model.view()).locate(poses_of(kPushed));
  CHECK(unsure.force_n == exact.force_n);
  CHECK(unsure.radius_68_mm == exact.radius_68_mm);
  CHECK(unsure.force_sigma_n == doctest::Approx(std::hypot(exact.force_sigma_n, 0.5F * exact.force_n)));
}

TEST_CASE("touch stage: on a finger that may be another than the pack's, motion counts as noise") {
  TouchModelData model = trained().model;
  PlatePoses poses = poses_of(kPushed);
  poses.noise = {0.5F, 1, 2};
  const Touch exact = TouchStage(model.view()).locate(poses);
  model.noise_per_mm = 0.3F;
  TouchStage stage(model.view());
  const Touch unsure = stage.locate(poses);
  CHECK(unsure.radius_68_mm > exact.radius_68_mm);
  const float other = 0.3F * exact.plate_motion_mm;
  PlatePoses noisier = poses;
  for (float& noise : noisier.noise) noise = std::hypot(noise, other);
  CHECK((unsure.point_mm - TouchStage(trained().model.view()).locate(noisier).point_mm).norm() < 1e-3F);
  stage.use_tolerances(0, 0, 0);
  CHECK(stage.locate(poses).point_mm == exact.point_mm);
}

TEST_CASE("touch stage: a component of the force that the plates do not tell is not a number") {
  const TouchModelData model = trained().model;
  REQUIRE(TouchStage(model.view()).locate(poses_of(kPushed)).quality == Quality::kFresh);
  const Touch nothing = TouchStage(model.view(), 0).locate(poses_of(kPushed));
  CHECK(nothing.quality == Quality::kFresh);
  CHECK(nothing.point_mm.allFinite());
  CHECK(std::isfinite(nothing.force_n));
  for (const Vec3f* vector : {&nothing.force_vector_n, &nothing.moment_nm, &nothing.wrench_force_n,
                              &nothing.force_vector_sigma_n, &nothing.wrench_force_sigma_n}) {
    CHECK(vector->array().isNaN().all());
  }
}
