// How well the shape is known where the finger is touched: the paper's energy method against the contact-aware map.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

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

/// A contact map is fitted on four fifths of the contact points and judged, as tier kContact of the firmware, on at
/// most `most_states` states of the others, spread over them. The energy method is solved to its minimum for the same
/// poses. With progress. Throws Interrupted, and std::runtime_error if a fifth of the contact points holds no valid
/// state.
ShapeAtTouch measure_shape_at_touch(const FingerSpec& spec, const Model& model, const FemDataset& dataset,
                                    std::size_t most_states, std::uint64_t seed);

/// What a tier of the firmware answers with this pack.
struct TierAtTouch {
  std::string tier;  ///< as in board files
  ShapeErrors clean, noisy;
  double us_per_frame = 0;       ///< median of the shape stage's time, each frame as after a gap
  double contact_map_share = 0;  ///< of the noisy frames: answered by the contact map, by register 43
};
/// The tiers map, newton and, if the pack has a contact map, contact, on valid states that the pack was not trained on:
/// each once clean and once with the spec's noise.
std::vector<TierAtTouch> measure_tiers_at_touch(const FingerSpec& spec, const Model& model, const FemDataset& unseen,
                                                std::uint64_t seed);

/// States of about `points` contact points that `dataset` does not hold (none of its own is nearer than 1 mm), `forces`
/// at each. Solved on all cores with progress; throws Interrupted.
FemDataset unseen_states(const FingerSpec& spec, const TetMesh& mesh, const FemDataset& dataset, int points,
                         int forces);

}  // namespace finsight::host
