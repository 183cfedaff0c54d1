// A look at a finger before the long work: nine places, pushed as hard as the spec says or as the finger bears. Says in
// two minutes which numbers of a spec to change, and why.
#pragma once

#include <functional>
#include <string>
#include <vector>

#include "hostgen/fem/dataset.h"
#include "hostgen/fem/pushed_finger.h"

namespace finsight::host {

/// One place of the face, pushed along its normal (scene probe).
struct ProbedPlace {
  Vec3f point_mm = Vec3f::Zero();
  std::vector<FemState> states;         ///< equilibria within 20 mm, from the weakest push up; front_rms_mm is set
  double full_n = 0;                    ///< the force that was wanted
  Outcome end = Outcome::kEquilibrium;  ///< of the lowest force that went wrong, if one did
  double failed_n = 0;                  ///< that force
  bool cut_short = false;               ///< the time was over before all was tried

  /// Whether it is known what it bears, or that it bears nothing.
  bool is_tried() const { return !states.empty() || end != Outcome::kEquilibrium; }
  double borne_n() const { return states.empty() ? 0 : static_cast<double>(states.back().force_n); }
};

/// The furthest that any plate moves: what touch.threshold_mm is compared with.
double plate_motion_mm(const FemState& state);

struct Probe {
  std::vector<ProbedPlace> places;
  double seconds = 0;
  double place_cpu_s = 0;  ///< processor time per place: what matters is how far it is pushed, not in how many states
  double factor_mb = 0;    ///< memory of one factor, every thread has one; 0: there was no time for it
};

/// Leaves half a minute for the step that a place is at then: on a large mesh one takes long.
inline constexpr double kProbeLimit_s = 90;

/// Pushes the places of jig_holes() with an eighth of the spec's highest force, twice as much, and so on up to all of
/// it; where the first fails, with half as much, and so on down to kWeakestPush_n; then between. All cores, progress;
/// the places in an order in which any number of them is spread over the face. Begins no new step of a load after
/// `limit_s`. `planned` is told factor_mb before the first push. Throws Interrupted.
Probe probe_finger(const FingerSpec& spec, const TetMesh& mesh, double limit_s = kProbeLimit_s,
                   const std::function<void(double factor_mb)>& planned = {});

/// Throws InputError naming the field to change if a pack of this finger could not come to be: nowhere an equilibrium,
/// or no plate moves as far as touch.threshold_mm.
void check_worth_building(const FingerSpec& spec, const Probe& probe);

/// A table of the places, for people.
std::string probe_text(const Probe& probe);
/// What the spec should say instead: [touch] and the plates' range and noise, each with its reason, as TOML to paste; a
/// comment that says what is in the way if there is nothing to propose.
std::string proposal_text(const FingerSpec& spec, const Probe& probe);

/// Standard deviations of the plates' motions as the camera of 640x480 measures them all together, if corners scatter
/// by 0.05 pixels and plates move as in the probe.
std::array<PoseNoise, kPlates> expected_noise(const FingerSpec& spec, const Probe& probe);

}  // namespace finsight::host
