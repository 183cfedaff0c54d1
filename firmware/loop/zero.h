// Zeroing: the finger as it is now is the finger at rest. Takes up how the camera sits and what the silicone kept.
#pragma once

#include <array>
#include <optional>
#include <utility>

#include "firmware/types.h"

namespace finsight {

/// Measures a zero as the mean of some frames, and takes it off every measurement.
class Zeroing {
 public:
  static constexpr int kFrames = 60;                ///< of the mean: noise falls to an eighth
  static constexpr int kMaxFrames = 240;            ///< frames, after which a finger that is not seen whole is given up
  static constexpr float kMaxRotation_rad = 0.15F;  ///< no finger sits in its holder more askew than this
  static constexpr float kMaxMotion_mm = 0.3F;      ///< of a plate meanwhile: five times the noise

  /// `furthest_mm`: what a plate may be from the model's rest; further is a touch.
  explicit Zeroing(float furthest_mm) : furthest_mm_(furthest_mm) {}

  void begin();
  /// No frame comes, or a touch is published: a zero that is being measured is not possible.
  void cancel() {
    if (running_) end(false);
  }
  /// Of the measurement that was begun, once: whether there is a new zero.
  std::optional<bool> take_outcome() { return std::exchange(outcome_, std::nullopt); }

  /// A frame's measured poses, which come back relative to the zero. Returns whether the zero is another one than with
  /// the frame before, measured or set: whatever was relative to it must be forgotten.
  bool apply(PlatePoses& poses);

  const std::optional<ZeroPose>& zero() const { return zero_; }
  void set_zero(const std::optional<ZeroPose>& zero) {
    zero_ = zero;
    has_changed_ = true;
  }

 private:
  void add(const PlatePoses& poses);
  bool is_usable(const PlatePoses& poses) const;
  void end(bool done);

  float furthest_mm_;
  std::optional<ZeroPose> zero_;
  bool has_changed_ = false;
  bool running_ = false;
  int frames_ = 0, tries_ = 0;
  PlatePoses first_;
  ZeroPose sum_;
  std::optional<bool> outcome_;
};

}  // namespace finsight
