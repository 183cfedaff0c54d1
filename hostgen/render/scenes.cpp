#include "hostgen/render/scenes.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "firmware/geometry/plate_motion.h"

namespace finsight::host {

namespace {

constexpr int kScenesPerExposure = 5;
constexpr double kShake_hz = 12, kShake_mm = 3;
constexpr float kOutOfFocus = 1.0F / 160;  // standard deviation of the blur, of the image's width
constexpr double kKnock_rad = 2 * std::numbers::pi / 180;
constexpr float kDarkness = 0.03F;  // what is left of the light: stray light through the finger

// 0 ... 1 in the middle third, else negative.
double part_of_middle(double frame, std::size_t frames) {
  const double part = 3 * frame / static_cast<double>(frames) - 1;
  return part < 1 ? std::max(part, -1.0) : -1;
}

}  // namespace

const std::vector<std::pair<std::string, SessionEvent>>& session_events() {
  static const std::vector<std::pair<std::string, SessionEvent>> events = {
      {"none", SessionEvent::kNone},          {"covered", SessionEvent::kCoveredMarkers},
      {"light-off", SessionEvent::kLightOff}, {"frozen", SessionEvent::kFrozenCamera},
      {"shaken", SessionEvent::kShaken},      {"defocused", SessionEvent::kDefocused},
      {"swapped", SessionEvent::kSwapped},    {"knocked", SessionEvent::kKnocked}};
  return events;
}

SceneMaker::SceneMaker(const std::vector<FemState>& states, double frames_per_second, double exposure_s, int width_px,
                       SessionEvent event)
    : states_(states),
      frames_per_second_(frames_per_second),
      exposure_frames_(exposure_s * frames_per_second),
      width_px_(static_cast<float>(width_px)),
      event_(event) {}

double SceneMaker::part_of_event(double frame) const {
  return event_ == SessionEvent::kNone ? -1 : part_of_middle(frame, states_.size());
}

bool SceneMaker::is_frozen(std::size_t frame) const {
  return event_ == SessionEvent::kFrozenCamera && frame > 0 && part_of_event(static_cast<double>(frame)) >= 0;
}

// Between two frames the plates move evenly.
std::array<PlateMotion, kPlates> SceneMaker::plates_at(double frame) const {
  const double last = static_cast<double>(states_.size()) - 1, at = std::clamp(frame, 0.0, last);
  const auto k = static_cast<std::size_t>(at);
  const FemState &a = states_[k], &b = states_[std::min(k + 1, states_.size() - 1)];
  const float t = static_cast<float>(at - static_cast<double>(k));
  std::array<PlateMotion, kPlates> plates;
  for (std::size_t p = 0; p < kPlates; ++p) {
    plates[p] = lerp(a.plates[p], b.plates[p], t);
  }
  return plates;
}

std::vector<Renderer::Scene> SceneMaker::exposure(std::size_t frame, double after_s) const {
  const double time = static_cast<double>(frame), part = part_of_event(time);
  Renderer::Scene scene;
  if (event_ == SessionEvent::kLightOff && part >= 0) scene.light = kDarkness;
  if (event_ == SessionEvent::kCoveredMarkers && part >= 0) {
    const auto phase = static_cast<std::size_t>(part * (kPlates + 1));
    for (std::size_t p = 0; p < kPlates; ++p) scene.covered[p] = phase == p || phase == kPlates;
  }
  if (event_ == SessionEvent::kDefocused && part >= 0) scene.blur_px = kOutOfFocus * width_px_;
  if (event_ == SessionEvent::kSwapped && part >= 0) std::swap(scene.sticker[kTopPlate], scene.sticker[kLowPlate]);
  if (event_ == SessionEvent::kKnocked && part >= 0) {
    scene.knock.linear() = Eigen::AngleAxisd(kKnock_rad, Eigen::Vector3d::UnitY()).toRotationMatrix();
  }
  std::vector<Renderer::Scene> scenes;
  const int count = exposure_frames_ > 0 ? kScenesPerExposure : 1;
  for (int k = 0; k < count; ++k) {
    scene.plates = plates_at(time + after_s * frames_per_second_ + exposure_frames_ * ((k + 0.5) / count - 0.5));
    scenes.push_back(scene);
  }
  return scenes;
}

void render_frame(Renderer& renderer, const SceneMaker& scenes, std::size_t frame, double readout_s,
                  std::vector<std::uint8_t>& grey) {
  if (readout_s == 0) return renderer.render(scenes.exposure(frame), grey);
  renderer.render_rolling([&](double after_middle_s) { return scenes.exposure(frame, after_middle_s); }, grey);
}

// A beam's swing grows with the square of the height.
void shake(const FingerSpec& spec, double frames_per_second, std::vector<FemState>& states) {
  const double top_mm = spec.plates[kTopPlate].T_finger_marker.translation().y();
  for (std::size_t frame = 0; frame < states.size(); ++frame) {
    const double part = part_of_middle(static_cast<double>(frame), states.size());
    if (part < 0) continue;
    const double time_s = static_cast<double>(frame) / frames_per_second;
    const double swing_mm =
        kShake_mm * std::sin(std::numbers::pi * part) * std::sin(2 * std::numbers::pi * kShake_hz * time_s);
    for (std::size_t p = 0; p < kPlates; ++p) {
      const double height_mm = spec.plates[p].T_finger_marker.translation().y();
      const double at_plate_mm = swing_mm * std::pow(height_mm / top_mm, 2);
      states[frame].plates[p].displacement_mm.z() += static_cast<float>(at_plate_mm);
      states[frame].plates[p].rotation_rad.x() += static_cast<float>(2 * at_plate_mm / height_mm);
    }
  }
}

}  // namespace finsight::host
