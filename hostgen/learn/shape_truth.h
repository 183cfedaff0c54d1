// Samples for the shape maps: plate motions of finite-element states, with and without pose noise, with the shapes that
// the firmware's solver converges to for them, or with the shapes that the finite elements have.
#pragma once

#include <Eigen/Core>
#include <vector>

#include "firmware/model/model.h"
#include "hostgen/fem/dataset.h"

namespace finsight::host {

struct ShapeSamples {
  Eigen::MatrixXf poses;            ///< [samples, 18]
  Eigen::MatrixXf displacement_mm;  ///< [samples, 3 * nodes]
  std::vector<std::size_t> state;   ///< [samples] index in the dataset
  std::vector<bool> noisy;          ///< [samples]
  int failed = 0;                   ///< solves that did not converge; left out
};

/// Every valid state once clean and `noisy_copies` times with the spec's pose noise. Solved on all cores with progress.
/// Throws Interrupted.
ShapeSamples converged_shapes(const FingerSpec& spec, const ShapeModel& shape, const MountModel& mount,
                              const FemDataset& dataset, int noisy_copies, std::uint64_t seed);

/// The same samples with the states' own shapes: touched fingers have a dimple that no energy of the plates' motion
/// knows of, but where and how deep it is follows from that motion.
ShapeSamples contact_shapes(const FingerSpec& spec, const FemDataset& dataset, int noisy_copies, std::uint64_t seed);

}  // namespace finsight::host
