// What a finger that cannot work serves: its fault, and nothing that was measured.
#pragma once

#include <cstdint>
#include <optional>

#include "firmware/device/health.h"
#include "firmware/modbus/control.h"

namespace finsight {

/// Of the commands only reset is carried out.
class FaultBlock {
 public:
  static constexpr int kEvery_ms = 100;  ///< how often next() is to be called

  FaultBlock(Control& control, FaultCode fault) : control_(control), health_(control) { state_.fault = fault; }
  const RegisterImage& next(std::int64_t now_ns);
  /// A client ordered a reset and has had the time to read the result.
  bool reset_is_due(std::int64_t now_ns) const { return reset_at_ns_ && now_ns >= *reset_at_ns_; }

 private:
  Control& control_;
  Health health_;
  LoopState state_;
  RegisterImage image_ = empty_block();
  std::optional<std::int64_t> reset_at_ns_;
};

}  // namespace finsight
