// Zeroing: declares the finger's present pose its rest pose. That absorbs how the camera sits and the set that the
// material has taken.
#pragma once

#include <array>
#include <optional>
#include <utility>

#include "firmware/types.h"

namespace finsight {

/// Measures a zero as the mean of some frames and subtracts it from every measurement.
class Zeroing {
 public:
  static constexpr int kFrames = 60;  ///< averaged at least: noise falls to an eighth
  /// Standard error of a plate's mean place; noisier pictures are averaged for longer.
  static constexpr float kMaxMeanError_mm = 0.06F;
  /// A zero is given up after this many frames if the plates were not all seen often enough.
  static constexpr int kMaxFrames = 240;
  static constexpr float kMaxRotation_rad = 0.15F;  ///< no finger sits in its holder more askew than this
  static constexpr int kBlock = 10;                 ///< frames whose mean tells whether the finger moves
  /// Between the means of two blocks; seven times their noise where a frame's is 0.09 mm, as along the line of sight.
  static constexpr float kMaxMotion_mm = 0.3F;
  static constexpr float kMaxMotion_sigmas = 5;  ///< of that difference by the frames' own noise, where that is more

  /// `furthest_mm`: how far a plate may be from the model's rest; further away it is touched.
  explicit Zeroing(float furthest_mm) : furthest_mm_(furthest_mm) {}

  void begin();
  bool is_running() const { return running_; }
  /// Ends a measurement that is running as failed: no frame comes, or a touch is published.
  void cancel() {
    if (running_) end(false);
  }
  /// Once per measurement, when it is over: whether there is a new zero.
  std::optional<bool> take_outcome() { return std::exchange(outcome_, std::nullopt); }

  /// Makes a frame's measured poses relative to the zero. Returns whether the zero has changed since the last call,
  /// because it was measured or set: whatever was relative to the old one must be forgotten.
  bool apply(PlatePoses& poses);

  const std::optional<ZeroPose>& zero() const { return zero_; }
  void set_zero(const std::optional<ZeroPose>& zero) {
    zero_ = zero;
    has_changed_ = true;
  }

 private:
  void add(const PlatePoses& poses);
  bool is_usable() const;
  float place_variance(std::size_t plate) const;
  bool has_moved() const;
  void end(bool done);

  float furthest_mm_;
  std::optional<ZeroPose> zero_;
  bool has_changed_ = false;
  bool running_ = false;
  int frames_ = 0, tries_ = 0;
  ZeroPose sum_, block_, first_block_;  ///< of all frames; means of this block and of the first one
  ZeroPose last_;
  std::array<float, kPlates> change_sq_{};  ///< sum of squared changes of place from frame to frame
  std::optional<bool> outcome_;
};

}  // namespace finsight
