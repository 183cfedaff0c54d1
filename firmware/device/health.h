// How the frame loop is doing, for the diagnostics registers.
#pragma once

#include "firmware/modbus/control.h"
#include "firmware/types.h"

namespace finsight {

/// For the frame loop's thread. Neither allocates nor waits.
class Health {
 public:
  explicit Health(Control& control) : control_(control) {}
  struct Counts {
    std::uint32_t frames = 0, dropped = 0, camera_losses = 0, pictures_broken = 0;
    double camera_rate_hz = 0;  ///< 0: not known
  };
  /// Before each turn of the loop: if the block published last is stalled by now, that is a fault until note().
  void begin_turn(std::int64_t now_ns);
  /// After each turn of the loop, which worked from `began_ns` to `ended_ns` (steady clock) and published `image`.
  /// `has_frame`: there was one.
  void note(const RegisterImage& image, bool has_frame, std::int64_t began_ns, std::int64_t ended_ns,
            const Counts& counts);

 private:
  bool note_stall(std::int64_t now_ns);
  static constexpr std::int64_t kWindow_ns = kNsPerS;
  Control& control_;
  LoopHealth health_;
  RegisterImage last_{};
  std::int64_t window_began_ns_ = 0, window_busy_ns_ = 0;
  std::uint32_t window_frames_ = 0;
};

}  // namespace finsight
