#include "firmware/device/fault_block.h"

#include "firmware/device/commands.h"

namespace finsight {

const RegisterImage& FaultBlock::next(std::int64_t now_ns) {
  ++state_.heartbeat;
  state_.settings = control_.settings();
  encode_registers(PlatePoses{}, FingerShape{}, Touch{}, state_, image_);
  health_.note(image_, false, now_ns, now_ns, {});
  if (const auto command = control_.take_command()) {
    const bool is_reset = *command == Command::kReset;
    control_.finish(is_reset ? CommandResult::kDone : CommandResult::kNotPossible);
    if (is_reset) reset_at_ns_ = now_ns + kResultIsShownNs;
  }
  return image_;
}

}  // namespace finsight
