// Samples for the shape map: plate motions of finite-element states, with and without pose noise, and the shapes that
// the firmware's solver converges to for them.
#pragma once

#include <Eigen/Core>

#include "firmware/model/model.h"
#include "hostgen/fem/dataset.h"

namespace finsight::host {

struct ShapeSamples {
  Eigen::MatrixXf poses;            ///< [samples, 18]
  Eigen::MatrixXf displacement_mm;  ///< [samples, 3 * nodes]
  int failed = 0;                   ///< solves that did not converge; left out
};

/// Every valid state once clean and `noisy_copies` times with the spec's pose noise. Solved on all cores with progress.
/// Throws Interrupted.
ShapeSamples converged_shapes(const FingerSpec& spec, const ShapeModel& shape, const MountModel& mount,
                              const FemDataset& dataset, int noisy_copies, std::uint64_t seed);

}  // namespace finsight::host
