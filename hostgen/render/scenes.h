// From touched states to what the camera sees during each exposure, and what happens to it besides.
#pragma once

#include <string>
#include <vector>

#include "hostgen/fem/dataset.h"
#include "hostgen/render/renderer.h"

namespace finsight::host {

/// What happens in the middle third of a session.
enum class SessionEvent {
  kNone,
  kCoveredMarkers,  ///< one marker after the other is covered, then all
  kLightOff,
  kFrozenCamera,  ///< the same image again and again
  kShaken,        ///< the hand jerks: see shake()
};
/// "none", "covered", "light-off", "frozen", "shaken".
const std::vector<std::pair<std::string, SessionEvent>>& session_events();

/// The scenes of every frame of a session.
class SceneMaker {
 public:
  /// `states`: one per frame, which must live as long. exposure_s: around the frame's time; 0: one scene per frame.
  SceneMaker(const std::vector<FemState>& states, double frames_per_second, double exposure_s, SessionEvent event);
  std::vector<Renderer::Scene> exposure(std::size_t frame) const;
  /// The camera gives its last image again.
  bool is_frozen(std::size_t frame) const;

 private:
  std::array<PlateMotion, kPlates> plates_at(double frame) const;
  double part_of_event(double frame) const;

  const std::vector<FemState>& states_;
  double exposure_frames_;
  SessionEvent event_;
};

/// Adds to the plates of the middle third of a session that the finger swings: at 12 Hz, up to 3 mm at the top plate,
/// touched or not.
void shake(const FingerSpec& spec, double frames_per_second, std::vector<FemState>& states);

}  // namespace finsight::host
