// How well the shape is known where the finger is touched: the paper's energy method against the contact-aware map.
#pragma once

#include <cstdint>

#include "firmware/model/model.h"
#include "hostgen/fem/dataset.h"

namespace finsight::host {

/// Mean distance to the finite-element shape.
struct ShapeErrors {
  double touch_point_mm = 0;  ///< of the front-face node nearest to the touched point
  double front_mm = 0;        ///< of all nodes of the front face
};
struct ShapeAtTouch {
  ShapeErrors energy_clean, energy_noisy, contact_aware_clean, contact_aware_noisy;
  std::size_t states = 0;  ///< that were compared, each once clean and once noisy
};

/// A map of `rank` is fitted on four fifths of the contact points and judged on at most `most_states` states of the
/// others, spread over them. The energy method is solved to its minimum for the same poses. With progress.
/// Throws Interrupted, and std::runtime_error if a fifth of the contact points holds no valid state.
ShapeAtTouch measure_shape_at_touch(const FingerSpec& spec, const ShapeModel& shape, const MountModel& mount,
                                    const FemDataset& dataset, int rank, std::size_t most_states, std::uint64_t seed);

}  // namespace finsight::host
