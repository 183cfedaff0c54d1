#include "hostgen/render/scenes.h"

#include <doctest/doctest.h>

using namespace finsight;
using namespace finsight::host;

namespace {

constexpr double kFramesPerSecond = 60;
constexpr std::size_t kFrames = 90;

/// The top plate moves by 1 mm per frame along x.
std::vector<FemState> moving() {
  std::vector<FemState> states(kFrames);
  for (std::size_t k = 0; k < kFrames; ++k) states[k].plates[kTopPlate].displacement_mm.x() = static_cast<float>(k);
  return states;
}

SceneMaker maker(const std::vector<FemState>& states, SessionEvent event, double exposure_s = 0) {
  return {states, kFramesPerSecond, exposure_s, 640, event};
}

}  // namespace

TEST_CASE("scenes: without exposure time a frame is one scene, its state") {
  const auto states = moving();
  const auto scenes = maker(states, SessionEvent::kNone).exposure(7);
  REQUIRE(scenes.size() == 1);
  CHECK(scenes[0].plates[kTopPlate].displacement_mm.x() == 7);
  CHECK(scenes[0].light == 1);
}

TEST_CASE("scenes: an exposure is centred on the frame's time and has the right length") {
  const auto states = moving();
  const auto scenes = maker(states, SessionEvent::kNone, 0.5 / kFramesPerSecond).exposure(7);
  REQUIRE(scenes.size() > 2);
  double mean = 0;
  for (const auto& scene : scenes) {
    mean += static_cast<double>(scene.plates[kTopPlate].displacement_mm.x()) / static_cast<double>(scenes.size());
  }
  CHECK(mean == doctest::Approx(7));
  const float first = scenes.front().plates[kTopPlate].displacement_mm.x();
  const float last = scenes.back().plates[kTopPlate].displacement_mm.x();
  CHECK(last - first == doctest::Approx(0.5 * (1 - 1.0 / static_cast<double>(scenes.size()))));
}

TEST_CASE("scenes: events happen in the middle third and nowhere else") {
  const auto states = moving();
  for (std::size_t frame = 0; frame < kFrames; ++frame) {
    CAPTURE(frame);
    const bool is_middle = frame >= kFrames / 3 && frame < 2 * kFrames / 3;
    CHECK((maker(states, SessionEvent::kLightOff).exposure(frame)[0].light < 0.1F) == is_middle);
    CHECK(maker(states, SessionEvent::kFrozenCamera).is_frozen(frame) == is_middle);
    CHECK_FALSE(maker(states, SessionEvent::kNone).is_frozen(frame));
    const auto covered = maker(states, SessionEvent::kCoveredMarkers).exposure(frame)[0].covered;
    CHECK((covered[0] || covered[1] || covered[2]) == is_middle);
    CHECK((maker(states, SessionEvent::kDefocused).exposure(frame)[0].blur_px > 2) == is_middle);
    CHECK((maker(states, SessionEvent::kSwapped).exposure(frame)[0].sticker[kTopPlate] == kLowPlate) == is_middle);
    CHECK((maker(states, SessionEvent::kKnocked).exposure(frame)[0].knock.linear()(0, 2) > 0.03) == is_middle);
  }
}

TEST_CASE("scenes: markers are covered one after the other, then all") {
  const auto states = moving();
  std::vector<std::array<bool, kPlates>> phases;
  for (std::size_t frame = kFrames / 3; frame < 2 * kFrames / 3; ++frame) {
    const auto covered = maker(states, SessionEvent::kCoveredMarkers).exposure(frame)[0].covered;
    if (phases.empty() || phases.back() != covered) phases.push_back(covered);
  }
  const std::vector<std::array<bool, kPlates>> wanted = {
      {true, false, false}, {false, true, false}, {false, false, true}, {true, true, true}};
  CHECK(phases == wanted);
}

TEST_CASE("scenes: a shaken finger swings most at its top, both ways, in the middle third") {
  const FingerSpec spec = read_finger_spec(FINSIGHT_SOURCE_DIR "/hostgen/fingers/srm.toml");
  std::vector<FemState> states(kFrames);
  shake(spec, kFramesPerSecond, states);
  float least = 0, most = 0, most_low = 0;
  for (std::size_t k = 0; k < kFrames; ++k) {
    const float z = states[k].plates[kTopPlate].displacement_mm.z();
    if (k < kFrames / 3 || k >= 2 * kFrames / 3) CHECK(z == 0);
    least = std::min(least, z);
    most = std::max(most, z);
    most_low = std::max(most_low, states[k].plates[kLowPlate].displacement_mm.z());
  }
  CHECK(least < -1.5F);
  CHECK(most > 1.5F);
  CHECK(most_low < 0.4F * most);
}
