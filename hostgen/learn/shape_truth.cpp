#include "hostgen/learn/shape_truth.h"

#include <algorithm>
#include <optional>
#include <vector>

#include "firmware/shape/newton.h"
#include "hostgen/learn/touch_samples.h"
#include "hostgen/util/common.h"

namespace finsight::host {

namespace {

/// Displacement of every node from rest at the converged shape.
std::optional<std::vector<float>> converged_displacement(NewtonSolver<double>& solver, const ShapeModel& shape,
                                                         const PlatePoses& poses) {
  constexpr double kTolerance_mm = 1e-6;
  constexpr int kMaxSteps = 200;
  solver.start_at_rest();
  if (!solver.converge(poses, kTolerance_mm, kMaxSteps).ok) return std::nullopt;
  std::vector<float> displacement(shape.rest_mm.size());
  for (std::size_t i = 0; i < displacement.size(); ++i) {
    displacement[i] = static_cast<float>(solver.node_mm()[i] - shape.rest_mm[i]);
  }
  return displacement;
}

struct PoseSample {
  PoseVector numbers;
  std::size_t state;
  bool noisy;
};

std::vector<PoseSample> pose_samples(const FingerSpec& spec, const FemDataset& dataset, int noisy_copies,
                                     std::uint64_t seed) {
  std::vector<PoseSample> samples;
  Random random(seed);
  for (std::size_t i = 0; i < dataset.states.size(); ++i) {
    if (!dataset.states[i].valid()) continue;
    for (int copy = 0; copy <= noisy_copies; ++copy) {
      samples.push_back({touch_sample(dataset.states[i]).numbers, i, copy > 0});
      if (copy > 0) add_noise(spec.noise, random, samples.back().numbers);
    }
  }
  return samples;
}

}  // namespace

ShapeSamples converged_shapes(const FingerSpec& spec, const ShapeModel& shape, const MountModel& mount,
                              const FemDataset& dataset, int noisy_copies, std::uint64_t seed) {
  const std::vector<PoseSample> poses = pose_samples(spec, dataset, noisy_copies, seed);
  // In batches, so that one solver serves many samples.
  constexpr std::size_t kBatch = 32;
  std::vector<std::optional<std::vector<float>>> shapes(poses.size());
  Progress progress("converged shapes", poses.size());
  parallel_for((poses.size() + kBatch - 1) / kBatch, [&](std::size_t batch) {
    NewtonSolver<double> solver(shape, mount);
    for (std::size_t i = batch * kBatch; i < std::min(poses.size(), (batch + 1) * kBatch); ++i) {
      if (interrupted()) throw Interrupted();
      shapes[i] = converged_displacement(solver, shape, seen_poses({poses[i].numbers.data(), kPoseDims}));
      progress.advance();
    }
  });

  ShapeSamples samples;
  const auto solved = std::count_if(shapes.begin(), shapes.end(), [](const auto& one) { return one.has_value(); });
  samples.failed = static_cast<int>(shapes.size()) - static_cast<int>(solved);
  samples.poses.resize(solved, kPoseDims);
  samples.displacement_mm.resize(solved, static_cast<Eigen::Index>(shape.rest_mm.size()));
  Eigen::Index row = 0;
  for (std::size_t i = 0; i < shapes.size(); ++i) {
    if (!shapes[i]) continue;
    samples.poses.row(row) = poses[i].numbers.transpose();
    samples.displacement_mm.row(row) =
        Eigen::Map<const Eigen::RowVectorXf>(shapes[i]->data(), samples.displacement_mm.cols());
    samples.state.push_back(poses[i].state);
    samples.noisy.push_back(poses[i].noisy);
    ++row;
  }
  return samples;
}

ShapeSamples contact_shapes(const FingerSpec& spec, const FemDataset& dataset, int noisy_copies, std::uint64_t seed) {
  const std::vector<PoseSample> poses = pose_samples(spec, dataset, noisy_copies, seed);
  const auto size = static_cast<Eigen::Index>(3 * dataset.mesh_nodes);
  ShapeSamples samples;
  samples.poses.resize(static_cast<Eigen::Index>(poses.size()), kPoseDims);
  samples.displacement_mm.resize(samples.poses.rows(), size);
  for (std::size_t i = 0; i < poses.size(); ++i) {
    const auto row = static_cast<Eigen::Index>(i);
    samples.poses.row(row) = poses[i].numbers.transpose();
    samples.displacement_mm.row(row) = Eigen::Map<const Eigen::RowVectorXf>(
        &dataset.node_displacement_mm[poses[i].state * 3 * dataset.mesh_nodes], size);
    samples.state.push_back(poses[i].state);
    samples.noisy.push_back(poses[i].noisy);
  }
  return samples;
}

}  // namespace finsight::host
