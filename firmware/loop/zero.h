// Zeroing: the finger as it is now is the finger at rest. Takes up how the camera sits and what the silicone kept.
#pragma once

#include <array>
#include <optional>

#include "firmware/types.h"

namespace finsight {

/// Where the plates are when nothing touches the finger.
using ZeroPose = std::array<PlateMotion, kPlates>;

/// Measures a zero as the mean of some frames, and takes it off every measurement.
class Zeroing {
 public:
  static constexpr int kFrames = 60;    ///< of the mean: noise falls to an eighth
  static constexpr int kLongest = 240;  ///< frames, after which a finger that is not seen whole is given up
  static constexpr float kLargest_rotation = 0.15F;  ///< radians; more is no way of sitting
  static constexpr float kStill_mm = 0.3F;           ///< what a plate may move meanwhile: five times the noise

  /// `furthest_mm`: what a plate may be from the model's rest; further is a touch.
  explicit Zeroing(float furthest_mm) : furthest_mm_(furthest_mm) {}

  void begin() {
    const std::optional<ZeroPose> zero = zero_;
    *this = Zeroing(furthest_mm_);
    zero_ = zero;
    running_ = true;
  }
  /// No frame comes, or a touch is published: a zero that is being measured is not possible.
  void give_up() {
    if (running_) end(false);
  }
  /// Of the measurement that was begun, once: whether there is a new zero.
  std::optional<bool> take_outcome();

  /// A frame's measured poses; they come back relative to the zero. Returns whether there is a new one since the frame
  /// before.
  bool process(PlatePoses& poses);

  const std::optional<ZeroPose>& zero() const { return zero_; }
  void set_zero(const std::optional<ZeroPose>& zero) { zero_ = zero; }

 private:
  bool observe(const PlatePoses& poses);
  bool is_usable(const PlatePoses& poses) const;
  bool end(bool done);

  float furthest_mm_;
  std::optional<ZeroPose> zero_;
  bool running_ = false;
  int frames_ = 0, tries_ = 0;
  PlatePoses first_;
  ZeroPose sum_;
  std::optional<bool> outcome_;
};

}  // namespace finsight
