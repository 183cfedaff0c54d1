#include "hostgen/learn/shape_at_touch.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>

#include "firmware/shape/shape_map.h"
#include "hostgen/learn/shape_map_training.h"
#include "hostgen/learn/shape_truth.h"
#include "hostgen/learn/split.h"

namespace finsight::host {

namespace {

// The named states alone.
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
    if (dataset.states[i].valid) valid.push_back(i);
  }
  return valid;
}

std::vector<std::size_t> thinned(const std::vector<std::size_t>& states, std::size_t most) {
  std::vector<std::size_t> kept;
  const std::size_t count = std::min(most, states.size());
  for (std::size_t k = 0; k < count; ++k) kept.push_back(states[k * states.size() / count]);
  return kept;
}

// Adds up the distances of shapes to those of a dataset.
class Distance {
 public:
  Distance(const FemDataset& truth, const ShapeModel& shape) : truth_(truth), shape_(shape) {}

  void add(std::size_t state, std::span<const float> displacement_mm, ShapeErrors& errors) const {
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
    errors.touch_point_mm += at(truth_.states[state].front_node);
    double front = 0;
    for (const std::int32_t node : shape_.front_nodes) front += at(node);
    errors.front_mm += front / static_cast<double>(shape_.front_nodes.size());
  }

 private:
  const FemDataset& truth_;
  const ShapeModel& shape_;
};

}  // namespace

ShapeAtTouch measure_shape_at_touch(const FingerSpec& spec, const ShapeModel& shape, const MountModel& mount,
                                    const FemDataset& dataset, int rank, std::size_t most_states, std::uint64_t seed) {
  std::vector<int> path;
  for (const FemState& state : dataset.states) path.push_back(state.path);
  const Split split = group_split(path, 5, 0, seed);
  const FemDataset train = subset(dataset, valid_of(dataset, split.train));
  const FemDataset test = subset(dataset, thinned(valid_of(dataset, split.test), most_states));
  if (train.states.empty() || test.states.empty())
    throw std::runtime_error("training set: too few contact points to hold some out");

  ShapeAtTouch result;
  result.states = test.states.size();
  const Distance distance(test, shape);
  const ShapeSamples energy = converged_shapes(spec, shape, mount, test, 1, seed);
  double clean = 0, noisy = 0;
  for (std::size_t i = 0; i < energy.state.size(); ++i) {
    const Eigen::VectorXf u = energy.displacement_mm.row(static_cast<Eigen::Index>(i)).transpose();
    distance.add(energy.state[i], {u.data(), static_cast<std::size_t>(u.size())},
                 energy.noisy[i] ? result.energy_noisy : result.energy_clean);
    (energy.noisy[i] ? noisy : clean) += 1;
  }

  const ShapeSamples samples = contact_shapes(spec, train, 2, seed + 1);
  const ShapeMapData data = fit_shape_map(samples.poses, samples.displacement_mm, rank);
  const ShapeMap map(data.view(), shape);
  std::vector<float> node_mm(shape.rest_mm.size());
  for (std::size_t i = 0; i < energy.state.size(); ++i) {
    map.evaluate(energy.poses.row(static_cast<Eigen::Index>(i)).transpose(), node_mm);
    for (std::size_t k = 0; k < node_mm.size(); ++k) node_mm[k] -= shape.rest_mm[k];
    distance.add(energy.state[i], node_mm, energy.noisy[i] ? result.contact_aware_noisy : result.contact_aware_clean);
  }
  for (ShapeErrors* errors : {&result.energy_clean, &result.contact_aware_clean}) {
    errors->touch_point_mm /= std::max(1.0, clean);
    errors->front_mm /= std::max(1.0, clean);
  }
  for (ShapeErrors* errors : {&result.energy_noisy, &result.contact_aware_noisy}) {
    errors->touch_point_mm /= std::max(1.0, noisy);
    errors->front_mm /= std::max(1.0, noisy);
  }
  return result;
}

}  // namespace finsight::host
