// One touch that wanders over the finger's face with changing force: what a rendered session shows.
#pragma once

#include <array>
#include <cstdint>
#include <string>
#include <utility>
#include <vector>

#include "hostgen/fem/dataset.h"

namespace finsight::host {

/// Where and how hard the finger is touched at any time. The point wanders over the whole touchable face along slow
/// sine waves; the force comes in presses of about four seconds, each from nothing to at most the spec's largest force
/// and back (the first reaches it), with a pause of half a second between them.
class TouchPlan {
 public:
  /// How the point moves. The paper's four paths (its figure 7) run around the middle of the face twice, under 60 % of
  /// the spec's largest force.
  enum class Path { kWander, kFast, kCircle, kSquare, kEight, kStar, kRest };
  /// `seconds` > 0. kFast: three times as fast as kWander. kRest: nothing touches the finger.
  TouchPlan(const FingerSpec& spec, double seconds, std::uint64_t seed, Path path = Path::kWander);
  /// On the undeformed front face.
  Vec3f point_mm(double time_s) const;
  /// 0 before the start, between presses and after the end; up to the spec's largest in the lower half of the face, up
  /// to half of it at the upper end, where the finger gives way most.
  double force_n(double time_s) const;

 private:
  struct Wave {
    double share, cycle_rad_per_s, phase_rad;
  };
  using Waves = std::array<Wave, 2>;  // their shares add up to 1
  static double wander(const Waves& waves, double time_s);
  double bearable(double time_s) const;

  Eigen::Vector2d on_path(double time_s) const;

  FingerSpec spec_;
  Path path_;
  double seconds_;
  double press_s_;  // from one press to the next
  std::vector<double> press_largest_n_;
  Waves across_, along_, strength_;
};

/// "wander", "fast", "circle", "square", "eight", "star", "rest".
const std::vector<std::pair<std::string, TouchPlan::Path>>& touch_paths();

/// What presses the finger in one frame.
struct TouchLoad {
  Vec3f point_mm = Vec3f::Zero();
  double force_n = 0;     ///< that acts
  double bends_as_n = 0;  ///< force under which an elastic finger would be as it is
};
std::vector<TouchLoad> planned_loads(const TouchPlan& plan, int frames, double frames_per_second);
/// Weights that are put on a place one after the other, from two seconds after the start on, each within half a second;
/// all stay equally long, the last two seconds without any if there are several.
std::vector<TouchLoad> weight_loads(const Vec3f& point_mm, const std::vector<double>& force_n, int frames,
                                    double frames_per_second);

/// Finite-element states of the finger under these loads, one per frame, `path` being the frame's number. Every fourth
/// frame is solved, on all cores, and the others are interpolated smoothly. The same loads give the same states
/// whatever the number of cores. Shows progress.
std::vector<FemState> make_touch_path(const FingerSpec& spec, const TetMesh& mesh, const std::vector<TouchLoad>& loads);
inline std::vector<FemState> make_touch_path(const FingerSpec& spec, const TetMesh& mesh, const TouchPlan& plan,
                                             int frames, double frames_per_second) {
  return make_touch_path(spec, mesh, planned_loads(plan, frames, frames_per_second));
}

/// States at every `step`-th frame -> states of the first `frames` frames: Catmull-Rom splines through every number of
/// a state. Needs at least one state beyond the last frame or at it. Where neither neighbouring state is touched, the
/// finger is exactly at rest.
std::vector<FemState> interpolated(const std::vector<FemState>& keys, int step, int frames);

}  // namespace finsight::host
