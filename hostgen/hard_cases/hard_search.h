// Random search for motions that the shape stage answers badly, and what is left of the worst one when everything that
// does not matter is taken away.
#pragma once

#include <array>
#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include "firmware/shape/shape_tier.h"
#include "hostgen/hard_cases/hard_cases.h"
#include "hostgen/hard_cases/hard_motions.h"

namespace finsight::host {

/// One part of a motion. As text: "bend 30 0 45 in 1", "plates tml 0 -40 0 1.5 0 0 in 5", "lose t for 10",
/// "noise 20 for 30"; plates t, m, l are top, middle, low.
struct HardAct {
  enum class Kind {
    kBend,    ///< to this bend (mm, mm sideways, degrees of twist) in so many frames; in 1 it is a jump
    kPlates,  ///< these plates displaced further (3 mm) and turned further (3 rad) in so many frames
    kLose,    ///< these plates not seen in the next frames
    kNoise,   ///< so many times the camera's noise in the next frames
  } kind = Kind::kBend;
  std::array<double, 6> number = {};  ///< as many as the kind says
  std::array<bool, kPlates> plates = {};
  int frames = 1;
};

/// The acts, then 10 frames to a bend of 10 mm with 15 degrees of twist, which is held for 10 more.
HardMotion make_hard_motion(const MountModel& mount, const std::vector<HardAct>& acts);
std::string text_of(const std::vector<HardAct>& acts);
/// Throws std::invalid_argument for a text that text_of() does not write.
std::vector<HardAct> parse_hard_acts(std::string_view text);

/// worst_mm of the result is the largest distance to the truth in the frames of the last pose, at which the finger
/// arrives in motion and which then stays.
struct FoundCase {
  std::vector<HardAct> acts;
  HardCaseResult result;
  int settling_frames = 0;  ///< of the last pose, that are flagged or further off than 0.02 mm
};
struct HardSearch {
  int motions = 0, bad = 0;
  std::vector<FoundCase> worst;  ///< ten, the worst first: those not held, then by worst_mm
  FoundCase small;               ///< the worst, shrunk to what is about as bad
};

/// Runs motions and judges them by their last pose, whose truth it solves once.
class HardCaseSearch {
 public:
  /// Throws std::runtime_error if the last pose has no shape.
  explicit HardCaseSearch(const ShapeParts& parts);

  FoundCase run(std::vector<HardAct> acts) const;
  /// Motion number k is the same for the same seed, whatever `motions` is.
  HardSearch search(int motions, std::uint64_t seed) const;
  /// What is left of a case when all is taken away that does not make it bad.
  FoundCase shrink(FoundCase found) const;

 private:
  const ShapeParts& parts_;
  std::vector<double> truth_mm_;
};

}  // namespace finsight::host
