// What a PLC would otherwise have to compute from the measurements: net values, peaks, events. The last stage of a
// frame, between verdict and publication; nothing in the data path depends on it.
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <utility>

#include "firmware/loop/grip_watch.h"
#include "firmware/modbus/registers.h"
#include "firmware/types.h"

namespace finsight {

/// Registers 1110 to 1134. Only fresh values enter filter, peaks and events: what is held is shown as it was, what is
/// invalid is shown as invalid, and a gap is no event.
class ProcessValues {
 public:
  /// Once per frame, also for one that did not come. Never allocates.
  void update(const Observation& seen, const PlatePoses& poses, const FingerShape& shape, const Touch& touch,
              const ThresholdState& limits, const RuntimeSettings& settings);
  const ProcessReadings& readings() const { return readings_; }

  // What clients order; it shows with the next frame.

  enum class Tare { kForce, kDeformation, kTouch };
  /// Takes what counts as zero from the next frame, never from one that may be old; not if the value is not fresh
  /// there.
  void order_tare(Tare tare) { ordered_ = tare; }
  /// Of the tare that was ordered last, once, after its frame: whether it was possible.
  std::optional<bool> take_tare_outcome() { return std::exchange(outcome_, std::nullopt); }
  void clear_tare();
  void reset_peaks();
  void reset_events();

  /// Forgets what was measured from another zero. Events stay: they happened.
  void reset();

 private:
  struct Channel {
    float filtered = 0, offset = 0;
    bool fresh = false;            ///< in this frame
    std::int64_t measured_ns = 0;  ///< when filtered was last fresh; 0: the filter has nothing yet
  };

  bool tare(int first, int count, bool& is_tared);
  void carry_out_tare();
  void forget_peaks(int value);
  void filter(int value, float measured, Quality quality, std::int64_t now_ns);
  void show(int value);
  void note(ProcessEvent event);
  void watch(const Touch& touch, const ThresholdState& limits);

  std::array<Channel, kProcessValues> channels_;
  std::optional<Tare> ordered_;
  std::optional<bool> outcome_;
  bool in_contact_ = false, overloaded_ = false;
  GripWatch grip_;
  ProcessReadings readings_;
};

}  // namespace finsight
