#include "hostgen/learn/shape_truth.h"

#include <algorithm>
#include <optional>
#include <vector>

#include "firmware/shape/newton.h"
#include "hostgen/common.h"
#include "hostgen/learn/touch_samples.h"

namespace finsight::host {

namespace {

/// Displacement of every node at the converged shape, from rest.
std::optional<std::vector<float>> converged_displacement(NewtonSolver<double>& solver, const ShapeModel& shape,
                                                         const PlatePoses& poses) {
  constexpr double kTolerance_mm = 1e-6;
  constexpr int kMostSteps = 200;
  solver.start_at_rest();
  if (!solver.converge(poses, kTolerance_mm, kMostSteps).ok) return std::nullopt;
  std::vector<float> displacement(shape.rest_mm.size());
  for (std::size_t i = 0; i < displacement.size(); ++i) {
    displacement[i] = static_cast<float>(solver.node_mm()[i] - shape.rest_mm[i]);
  }
  return displacement;
}

}  // namespace

ShapeSamples converged_shapes(const FingerSpec& spec, const ShapeModel& shape, const MountModel& mount,
                              const FemDataset& dataset, int noisy_copies, std::uint64_t seed) {
  std::vector<PlateNumbers> numbers;
  Random random(seed);
  for (const FemState& state : dataset.states) {
    if (!state.valid) continue;
    for (int copy = 0; copy <= noisy_copies; ++copy) {
      numbers.push_back(touch_sample(state).numbers);
      if (copy > 0) add_noise(spec.noise, random, numbers.back());
    }
  }

  // Solves in batches, so that a worker's solver serves many samples.
  constexpr std::size_t kBatch = 32;
  std::vector<std::optional<std::vector<float>>> shapes(numbers.size());
  Progress progress("converged shapes", numbers.size());
  parallel_for((numbers.size() + kBatch - 1) / kBatch, [&](std::size_t batch) {
    NewtonSolver<double> solver(shape, mount);
    for (std::size_t i = batch * kBatch; i < std::min(numbers.size(), (batch + 1) * kBatch); ++i) {
      if (interrupted()) throw Interrupted();
      shapes[i] = converged_displacement(solver, shape, seen_poses({numbers[i].data(), 18}));
      progress.advance();
    }
  });

  ShapeSamples samples;
  const auto solved = std::count_if(shapes.begin(), shapes.end(), [](const auto& one) { return one.has_value(); });
  samples.failed = static_cast<int>(shapes.size()) - static_cast<int>(solved);
  samples.poses.resize(solved, 18);
  samples.displacement_mm.resize(solved, static_cast<Eigen::Index>(shape.rest_mm.size()));
  Eigen::Index row = 0;
  for (std::size_t i = 0; i < shapes.size(); ++i) {
    if (!shapes[i]) continue;
    samples.poses.row(row) = numbers[i].transpose();
    samples.displacement_mm.row(row) = Eigen::Map<const Eigen::RowVectorXf>(shapes[i]->data(), samples.displacement_mm.cols());
    ++row;
  }
  return samples;
}

}  // namespace finsight::host
