#include "hostgen/learn/shape_at_touch.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <utility>

#include "firmware/model/plate_prior.h"
#include "firmware/shape/shape_stage.h"
#include "hostgen/learn/shape_map_training.h"
#include "hostgen/learn/shape_truth.h"
#include "hostgen/learn/split.h"
#include "hostgen/util/statistics.h"
#include "hostgen/util/stopwatch.h"

namespace finsight::host {

namespace {

// Only the given states.
FemDataset subset(const FemDataset& dataset, const std::vector<std::size_t>& states) {
  FemDataset part{
      .spec_sha256 = dataset.spec_sha256, .states = {}, .node_displacement_mm = {}, .mesh_nodes = dataset.mesh_nodes};
  const std::size_t size = 3 * dataset.mesh_nodes;
  for (const std::size_t i : states) {
    part.states.push_back(dataset.states[i]);
    const auto first = dataset.node_displacement_mm.begin() + static_cast<std::ptrdiff_t>(i * size);
    part.node_displacement_mm.insert(part.node_displacement_mm.end(), first, first + static_cast<std::ptrdiff_t>(size));
  }
  return part;
}

std::vector<std::size_t> valid_of(const FemDataset& dataset, const std::vector<std::size_t>& states) {
  std::vector<std::size_t> valid;
  for (const std::size_t i : states) {
    if (dataset.states[i].valid()) valid.push_back(i);
  }
  return valid;
}

std::vector<std::size_t> thinned(const std::vector<std::size_t>& states, std::size_t max_count) {
  std::vector<std::size_t> kept;
  const std::size_t count = std::min(max_count, states.size());
  for (std::size_t k = 0; k < count; ++k) kept.push_back(states[k * states.size() / count]);
  return kept;
}

// Mean distance of shapes to the finite-element shapes of a dataset.
class Distance {
 public:
  Distance(const FemDataset& truth, const ShapeModel& shape) : truth_(truth), shape_(shape) {}

  void add(std::size_t state, std::span<const float> displacement_mm) {
    const auto at = [&](std::int32_t node) {
      const auto first = 3 * static_cast<std::size_t>(node);
      const float* u = &truth_.node_displacement_mm[3 * truth_.mesh_nodes * state + first];
      double sum = 0;
      for (std::size_t d = 0; d < 3; ++d) {
        const double error = static_cast<double>(displacement_mm[first + d]) - static_cast<double>(u[d]);
        sum += error * error;
      }
      return std::sqrt(sum);
    };
    sum_.touch_point_mm += at(truth_.states[state].front_node);
    double front = 0, all = 0;
    for (const std::int32_t node : shape_.front_nodes) front += at(node);
    for (std::int32_t node = 0; node < shape_.nodes; ++node) all += at(node);
    sum_.front_mm += front / static_cast<double>(shape_.front_nodes.size());
    sum_.all_mm += all / shape_.nodes;
    ++count_;
  }

  ShapeErrors mean() const {
    const double count = std::max<double>(1, static_cast<double>(count_));
    return {sum_.touch_point_mm / count, sum_.front_mm / count, sum_.all_mm / count};
  }

 private:
  const FemDataset& truth_;
  const ShapeModel& shape_;
  ShapeErrors sum_;
  std::size_t count_ = 0;
};

// Runs the firmware's shape stage on the samples' poses, reset before every one.
TierAtTouch judge(const char* tier, ShapeStage& stage, const ShapeSamples& samples, const FemDataset& truth,
                  const ShapeModel& shape) {
  Distance clean(truth, shape), noisy(truth, shape);
  std::vector<double> us;
  std::vector<float> displacement_mm(shape.rest_mm.size());
  std::size_t by_contact_map = 0;
  for (std::size_t i = 0; i < samples.state.size(); ++i) {
    const PoseVector numbers = samples.poses.row(static_cast<Eigen::Index>(i)).transpose();
    stage.reset();
    Stopwatch watch;
    const FingerShape& answer = stage.solve(seen_poses({numbers.data(), kPoseDims}));
    us.push_back(watch.lap_us());
    for (std::size_t k = 0; k < displacement_mm.size(); ++k) displacement_mm[k] = answer.node_mm[k] - shape.rest_mm[k];
    (samples.noisy[i] ? noisy : clean).add(samples.state[i], displacement_mm);
    by_contact_map += samples.noisy[i] && answer.source == ShapeSource::kContactMap;
  }
  const auto noisy_frames = std::max<std::ptrdiff_t>(1, std::count(samples.noisy.begin(), samples.noisy.end(), true));
  return {.tier = tier,
          .clean = clean.mean(),
          .noisy = noisy.mean(),
          .us_per_frame = quantile(us, 0.5),
          .quartiles_us = {quantile(us, 0.25), quantile(us, 0.75)},
          .contact_map_share = static_cast<double>(by_contact_map) / static_cast<double>(noisy_frames)};
}

}  // namespace

ShapeAtTouch measure_shape_at_touch(const FingerSpec& spec, const Model& model, const FemDataset& dataset,
                                    std::size_t max_states, std::uint64_t seed) {
  std::vector<int> path;
  for (const FemState& state : dataset.states) path.push_back(state.path);
  const Split split = group_split(path, 5, 0, seed);
  const FemDataset train = subset(dataset, valid_of(dataset, split.train));
  const FemDataset test = subset(dataset, thinned(valid_of(dataset, split.test), max_states));
  if (train.states.empty() || test.states.empty())
    throw std::runtime_error("training set: too few contact points to hold some out");

  const ShapeSamples energy = converged_shapes(spec, model.shape, model.mount, test, 1, seed);
  Distance clean(test, model.shape), noisy(test, model.shape);
  for (std::size_t i = 0; i < energy.state.size(); ++i) {
    const Eigen::VectorXf u = energy.displacement_mm.row(static_cast<Eigen::Index>(i)).transpose();
    (energy.noisy[i] ? noisy : clean).add(energy.state[i], {u.data(), static_cast<std::size_t>(u.size())});
  }

  const ShapeMapData map = fit_contact_map(spec, train, seed + 1);
  ShapeStage stage({model.shape, model.shape_map, model.mount, map.view()}, {.tier = ShapeSettings::Tier::kContact});
  const TierAtTouch contact = judge("contact", stage, energy, test, model.shape);
  return {.energy_clean = clean.mean(),
          .energy_noisy = noisy.mean(),
          .contact_aware_clean = contact.clean,
          .contact_aware_noisy = contact.noisy,
          .states = test.states.size()};
}

std::vector<TierAtTouch> measure_tiers_at_touch(const FingerSpec& spec, const Model& model, const FemDataset& unseen,
                                                std::uint64_t seed) {
  using Tier = ShapeSettings::Tier;
  const ShapeSamples samples = contact_shapes(spec, unseen, 1, seed);
  std::vector<TierAtTouch> tiers;
  for (const auto& [name, tier] : {std::pair{"map", Tier::kMap},
                                   {"map+newton", Tier::kMapAndNewton},
                                   {"newton", Tier::kNewton},
                                   {"contact", Tier::kContact}}) {
    if (tier == Tier::kContact && !model.contact_map) continue;
    ShapeStage stage(model, {.tier = tier});
    tiers.push_back(judge(name, stage, samples, unseen, model.shape));
  }
  return tiers;
}

FemDataset unseen_states(const FingerSpec& spec, const TetMesh& mesh, const FemDataset& dataset, int points,
                         int forces) {
  constexpr float kSamePoint_mm = 1;
  const FemDataset all = make_dataset(spec, mesh, {.points = points, .forces = forces});
  // A frictionless point is no state of a scene with more, wherever it lies.
  const bool are_alike = !contacts_change(spec.scene(dataset.plan.scene));
  const auto is_new = [&](std::size_t i) {
    return !are_alike || std::none_of(dataset.states.begin(), dataset.states.end(), [&](const FemState& known) {
      return (known.point_mm - all.states[i].point_mm).norm() < kSamePoint_mm;
    });
  };
  std::vector<std::size_t> states;
  for (std::size_t i = 0; i < all.states.size(); ++i) {
    if (all.states[i].valid() && is_new(i)) states.push_back(i);
  }
  if (states.empty())
    throw std::runtime_error("training set: its contact points are so dense that no new test point is left");
  return subset(all, states);
}

}  // namespace finsight::host
