// Which of a camera's formats to take, and whether it keeps the frame rate.
#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <string>

#include "firmware/ports/grey_conversion.h"

namespace finsight {

/// A format that the camera gives in the wanted size.
struct OfferedFormat {
  std::string name;  ///< as libcamera calls it
  GreyLayout layout;
  double most_frames_per_second = 0;  ///< in that size; 0: the camera does not tell
};

struct ChosenFormat {
  std::size_t index = 0;
  std::string why;  ///< for people
};

/// Of those that reach the wanted frame rate, or do not tell theirs, the one that keeps most of the sensor's picture
/// (GreyLayout::rank); if none does, the fastest. Of equals the first. Nothing for an empty list.
std::optional<ChosenFormat> choose_format(std::span<const OfferedFormat> offered, double frames_per_second);

/// What a camera gives, from its own frame counter and time stamps, so that frames which nobody took count too.
class FrameRateMeter {
 public:
  static constexpr std::int64_t kWindowNs = 2'000'000'000;
  explicit FrameRateMeter(double wanted_hz) : wanted_hz_(wanted_hz) {}
  /// For every frame. True when there is a new rate, every two seconds.
  bool note(std::uint32_t sequence, std::int64_t exposure_ns);
  /// The camera was started again: the counter begins anywhere, and the rate is not known.
  void restart() { has_first_ = false, rate_hz_ = 0; }
  double rate_hz() const { return rate_hz_; }  ///< 0: not known yet
  bool is_slow() const { return rate_hz_ > 0 && rate_hz_ < wanted_hz_ / 2; }

 private:
  double wanted_hz_, rate_hz_ = 0;
  bool has_first_ = false;
  std::uint32_t first_sequence_ = 0;
  std::int64_t first_ns_ = 0;
};

}  // namespace finsight
