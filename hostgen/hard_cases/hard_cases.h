// The hardest motions of a finger and some that no finger makes: named sequences of plate motions for the shape stage,
// each with limits for the answer.
#pragma once

#include <string>
#include <vector>

#include "firmware/shape/shape_tier.h"

namespace finsight::host {

/// Result of one case.
struct HardCaseResult {
  std::string family = {}, name = {};
  int frames = 0;
  int flagged = 0;             ///< frames whose shape is marked as a fallback or invalid
  int non_finite = 0;          ///< frames with a non-finite coordinate or measure
  int inverted = 0;            ///< frames with an inverted tetrahedron
  int inverted_unflagged = 0;  ///< of these, not flagged
  int max_steps = 0;           ///< largest number of solver steps of a frame
  int allowed_steps = 0;
  double worst_mm = 0, allowed_mm = 0;    ///< largest distance of a node to the converged shape, in frames not flagged
  double end_mm = 0, allowed_end_mm = 0;  ///< the same in the last frame, when the motion has stopped
  bool end_flagged = false, may_end_flagged = false;
  std::vector<float> worst_node_mm = {};  ///< [3 * nodes] the shape that was worst_mm off; empty for some cases

  bool good() const {
    return non_finite == 0 && inverted_unflagged == 0 && max_steps <= allowed_steps && worst_mm <= allowed_mm &&
           end_mm <= allowed_end_mm && (!end_flagged || may_end_flagged);
  }
};

/// Runs all cases: bends and twists of every sign, fast ones, jumps, impossible poses, missing plates, NaN and
/// infinity, noise, an inverted start, slivers, other units, float against double, soft handles, and last a random walk
/// of `walk_frames` frames. The same parts give the same results. The converged shape is the one with less energy of
/// the minima found from rest and from the stage's own shape.
std::vector<HardCaseResult> run_hard_cases(const ShapeParts& parts, int walk_frames);

/// The random walk alone.
HardCaseResult run_random_walk(const ShapeParts& parts, int frames);

}  // namespace finsight::host
