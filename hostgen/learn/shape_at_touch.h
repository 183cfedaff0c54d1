// Shape errors where the finger is touched: the paper's energy method against the contact-aware map.
#pragma once

#include <array>
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
  double all_mm = 0;          ///< of all nodes
};
struct ShapeAtTouch {
  ShapeErrors energy_clean, energy_noisy, contact_aware_clean, contact_aware_noisy;
  std::size_t states = 0;  ///< compared, each once clean and once noisy
};

/// Fits a contact map to four fifths of the contact points and tests it, as tier kContact of the firmware, on at most
/// `max_states` states spread over the remaining fifth. The energy method is solved to its minimum for the same poses.
/// Shows progress. Throws Interrupted, and std::runtime_error if the fifth holds no valid state.
ShapeAtTouch measure_shape_at_touch(const FingerSpec& spec, const Model& model, const FemDataset& dataset,
                                    std::size_t max_states, std::uint64_t seed);

/// Errors of one shape tier of the firmware with this pack.
struct TierAtTouch {
  std::string tier;  ///< as in board files
  ShapeErrors clean, noisy;
  double us_per_frame = 0;  ///< median time of the shape stage, reset before every frame
  std::array<double, 2> quartiles_us{};
  double contact_map_share = 0;  ///< share of noisy frames that the contact map answered (register 43)
};
/// Tests the tiers map, map+newton, newton and, if the pack has a contact map, contact, on valid states that the pack
/// was not trained on, each once clean and once with the spec's noise.
std::vector<TierAtTouch> measure_tiers_at_touch(const FingerSpec& spec, const Model& model, const FemDataset& unseen,
                                                std::uint64_t seed);

/// Solves states of about `points` frictionless points with `forces` forces each; where `dataset` holds such points, too,
/// only those that are at least 1 mm away from all of them. Uses all cores, shows progress; throws Interrupted.
FemDataset unseen_states(const FingerSpec& spec, const TetMesh& mesh, const FemDataset& dataset, int points,
                         int forces);

}  // namespace finsight::host
