// Carries out the commands of clients: the link between the registers from 1000 on and the parts of the firmware.
#pragma once

#include <optional>

#include "firmware/device/recorder.h"
#include "firmware/device/saved_state.h"
#include "firmware/device/zero_together.h"
#include "firmware/loop/frame_loop.h"
#include "firmware/modbus/control.h"

namespace finsight {

/// How long a reset waits, so that the client that ordered it can read the result.
constexpr std::int64_t kResultIsShownNs = 500'000'000;

/// After this time another finger's zero counts as not possible: its loop hangs.
constexpr std::int64_t kZeroOfOthersNs = 30'000'000'000;

/// Command 14's link to the device's other fingers; without it there are none.
struct OtherFingers {
  ZeroTogether* zeros = nullptr;
  std::size_t own = 0;  ///< this finger's place among them
};

/// For the frame loop's thread: poll() before every frame. Neither allocates nor waits.
class Commands {
 public:
  /// Without a saver or recorder their commands end as "not configured". `saved` is the state on the disk. Even without
  /// frames the loop calls poll() every `frame_timeout_ns`; if it does not, clients see a stalled device.
  Commands(Control& control, FrameLoop& loop, StateSaver* saver, Recorder* recorder, const SavedState& saved,
           std::int64_t frame_timeout_ns = 100'000'000, OtherFingers others = {});

  void poll();
  /// The command of setting 1021, unless another one is running.
  void trigger();
  bool reset_is_ordered() const { return reset_at_ns_.has_value(); }
  /// A client ordered a reset, and has had the time to read the result.
  bool reset_is_due() const { return reset_at_ns_ && steady_now_ns() >= *reset_at_ns_; }

 private:
  std::optional<CommandResult> start(Command command);
  std::optional<CommandResult> outcome();
  std::optional<CommandResult> record(bool start);
  std::optional<CommandResult> tare(ProcessValues::Tare tare);
  std::optional<bool> zero_outcome();
  std::optional<CommandResult> zero_all_outcome();
  void zero_for_another();
  SavedState current() const { return {settings_, loop_.zeroing().zero(), loop_.gravity().at_zero()}; }

  Control& control_;
  FrameLoop& loop_;
  StateSaver* saver_;
  Recorder* recorder_;
  const std::int64_t frame_timeout_ns_;
  RuntimeSettings settings_;
  SavedState saved_, saving_;
  const OtherFingers others_;
  std::optional<bool> own_zero_;         ///< of command 14, once it is over
  bool is_zeroing_for_another_ = false;  ///< running_ is kZero then
  std::int64_t zero_all_since_ns_ = 0;
  Command running_ = Command::kNone;
  bool is_running_ = false;
  std::optional<CommandResult> done_at_once_;  ///< to be told with the next poll
  bool is_ordered_ = false;                    ///< by a client, who is told the result; not by the trigger
  bool zero_changed_ = false;
  std::optional<std::int64_t> reset_at_ns_;
};

}  // namespace finsight
