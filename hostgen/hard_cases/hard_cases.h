// What no finger does, and the hardest of what it does: named sequences of plate motions for the shape stage, each with
// what may come out.
#pragma once

#include <string>
#include <vector>

#include "firmware/shape/shape_tier.h"

namespace finsight::host {

/// What came out of one case.
struct HardCaseResult {
  std::string name;
  int frames = 0;
  int flagged = 0;             ///< frames whose shape is marked as a fallback or invalid
  int non_finite = 0;          ///< frames with a coordinate or a measure that is not finite
  int inverted = 0;            ///< frames with an inverted tetrahedron
  int inverted_unflagged = 0;  ///< those of them that are not flagged
  int most_steps = 0;          ///< largest number of solver steps of a frame
  int allowed_steps = 0;
  double worst_mm = 0, allowed_mm = 0;    ///< largest distance of a node to the converged shape, frames not flagged
  double end_mm = 0, allowed_end_mm = 0;  ///< the same after the last frame, where the motion has come to rest
  bool end_flagged = false, may_end_flagged = false;

  bool good() const {
    return non_finite == 0 && inverted_unflagged == 0 && most_steps <= allowed_steps && worst_mm <= allowed_mm &&
           end_mm <= allowed_end_mm && (!end_flagged || may_end_flagged);
  }
};

/// Runs all cases: bends and twists of every sign, fast ones, jumps, impossible poses, missing plates, numbers that are
/// none, noise, an inverted start, slivers, other units, float against double, soft handles, and last a random walk of
/// `walk_frames` frames. The same parts give the same results. Converged means: of the minima found from rest and from
/// the stage's own shape the one with less energy.
std::vector<HardCaseResult> run_hard_cases(const ShapeParts& parts, int walk_frames);

/// The random walk alone.
HardCaseResult run_random_walk(const ShapeParts& parts, int frames);

}  // namespace finsight::host
