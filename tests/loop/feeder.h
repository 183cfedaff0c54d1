#pragma once
// What tests of the frame loop share: a small model with markers, and a loop that is fed a frame every 60th of a
// second.

#include <array>
#include <cstdint>
#include <optional>
#include <vector>

#include "firmware/loop/frame_loop.h"
#include "firmware/model/plate_prior.h"
#include "tests/model/tiny_model.h"
#include "tests/vision/test_finger.h"

namespace finsight::test {

inline constexpr std::int64_t kMs = 1'000'000, kStart = 5000 * kMs, kPeriod = 16'666'667;
inline constexpr std::uint16_t kNoInt16 = 0x8000, kNoUint16 = 0xFFFF;
inline constexpr std::uint16_t kAllSeen = kTopSeen | kMiddleSeen | kLowSeen;

/// The tiny model with markers that a camera sees, and a prior to match.
inline const Model& model() {
  static const Model the_model = [] {
    TinyModel tiny;
    const TestPrior prior;
    tiny.parts.mount = test_mount();
    tiny.prior_mean.assign(prior.view().mean.begin(), prior.view().mean.end());
    tiny.prior_covariance.assign(prior.view().covariance.begin(), prior.view().covariance.end());
    return tiny.open();
  }();
  return the_model;
}

/// A touched finger: its plates bent away by up to 6 mm.
inline PlatePoses touched(float size = 1) {
  std::array<float, kPoseDims> numbers{};
  for (std::size_t p = 0; p < kPlates; ++p) {
    const float y = 0.75f - 0.23f * static_cast<float>(p);
    numbers[6 * p + 1] = -0.6f * size * y;
    numbers[6 * p + 2] = 9 * size * y * y;
    numbers[6 * p + 3] = 0.16f * size * y;
  }
  return seen_poses(numbers);
}

inline LoopSettings holding(int ms) {
  LoopSettings settings;
  settings.runtime[kHoldTime] = static_cast<std::uint16_t>(ms);
  return settings;
}

/// Feeds a loop one frame every 60th of a second.
struct Feeder {
  explicit Feeder(const std::optional<Lens>& camera = std::nullopt, const LoopSettings& settings = {})
      : loop(model(), camera, settings) {}

  const RegisterImage& step(Frame frame) {
    frame.sequence = sequence++;
    frame.exposure_ns = now_ns += kPeriod;
    return loop.step(frame);
  }
  const RegisterImage& step(const PlatePoses& poses) {
    return loop.step(Observation{.exposure_ns = now_ns += kPeriod, .sequence = sequence++, .poses = poses});
  }
  const RegisterImage& step_nothing_seen() { return step(PlatePoses{}); }

  FrameLoop loop;
  std::uint32_t sequence = 0;
  std::int64_t now_ns = kStart;
};

inline bool touch_registers_are_invalid(const RegisterImage& image) {
  return image.words[5] == kNoInt16 && image.words[6] == kNoInt16 && image.words[7] == kNoInt16 &&
         image.words[8] == kNoUint16 && image.words[9] == kNoUint16 && image.words[11] == kNoUint16 &&
         image.words[16] == kNoInt16;
}

inline std::vector<std::uint8_t> painted(const Lens& camera, const PlatePoses& poses, std::uint64_t seed) {
  Paint paint;
  paint.samples = 37;
  return paint_plates(model().mount, camera, poses.plates, paint, seed);
}

inline PlatePoses moved_as_one(const Vec3f& by_mm) {
  PlatePoses poses = touched();
  for (PlateMotion& plate : poses.plates) plate = {by_mm, Vec3f::Zero()};
  return poses;
}

/// One scene again and again, with as much noise of its own in each image as none is frozen.
class Images {
 public:
  Images(const Lens& camera, const PlatePoses& poses) : camera_(camera) {
    for (std::uint64_t seed = 1; seed <= 6; ++seed) grey_.push_back(painted(camera, poses, seed));
  }
  Frame next() const { return frame_of(camera_, grey_[next_++ % grey_.size()]); }

 private:
  Lens camera_;
  std::vector<std::vector<std::uint8_t>> grey_;
  mutable std::size_t next_ = 0;
};

}  // namespace finsight::test
