// From touched states to what the camera sees during each exposure, including events such as a covered marker.
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
  kDefocused,     ///< the lens is out of focus
  kSwapped,       ///< the markers of top and low plate are on the other's plate
  kKnocked,       ///< the camera is turned by 2 degrees against the finger
};
/// "none", "covered", "light-off", "frozen", "shaken", "defocused", "swapped", "knocked".
const std::vector<std::pair<std::string, SessionEvent>>& session_events();

/// The scenes of every frame of a session.
class SceneMaker {
 public:
  /// `states`: one per frame, which must outlive this object. exposure_s: around the frame's time; 0: one scene per
  /// frame. width_px: of the image.
  SceneMaker(const std::vector<FemState>& states, double frames_per_second, double exposure_s, int width_px,
             SessionEvent event);
  /// `after_s`: of rows that are exposed that much later than the middle one.
  std::vector<Renderer::Scene> exposure(std::size_t frame, double after_s = 0) const;
  /// The camera delivers its last image once more.
  bool is_frozen(std::size_t frame) const;

 private:
  std::array<PlateMotion, kPlates> plates_at(double frame) const;
  double part_of_event(double frame) const;

  const std::vector<FemState>& states_;
  double frames_per_second_, exposure_frames_;
  float width_px_;
  SessionEvent event_;
};

/// A frame whose rows are read over `readout_s`; 0: all at once.
void render_frame(Renderer& renderer, const SceneMaker& scenes, std::size_t frame, double readout_s,
                  std::vector<std::uint8_t>& grey);

/// Makes the finger swing in the middle third of a session, touched or not: at 12 Hz, by up to 3 mm at the top plate.
void shake(const FingerSpec& spec, double frames_per_second, std::vector<FemState>& states);

}  // namespace finsight::host
