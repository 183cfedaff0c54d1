// Samples for the shape maps: plate motions of finite-element states, with and without pose noise, and for each either
// the shape that the firmware's solver converges to or the finite-element shape itself.
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

/// Every valid state once clean and `noisy_copies` times with the spec's pose noise, solved on all cores with progress.
/// Throws Interrupted.
ShapeSamples converged_shapes(const FingerSpec& spec, const ShapeModel& shape, const MountModel& mount,
                              const FemDataset& dataset, int noisy_copies, std::uint64_t seed);

/// The same samples with the finite-element shapes. A touch leaves a dimple that minimising an energy for given plates
/// cannot produce; the plates' motion still determines where it is and how deep.
ShapeSamples contact_shapes(const FingerSpec& spec, const FemDataset& dataset, int noisy_copies, std::uint64_t seed);

}  // namespace finsight::host
