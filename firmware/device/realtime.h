// Real-time scheduling of the frame loop: priority, processor, memory that stays in memory.
#pragma once

#include <sched.h>

#include "firmware/settings/settings.h"

namespace finsight {

/// Applies to the calling thread (the lock to the whole process). Throws std::runtime_error for what the system
/// refuses.
void make_realtime(const RealtimeSettings& settings);

/// The calling thread as it was before make_realtime(), for a start anew: threads inherit their processor.
class SchedulingSnapshot {
 public:
  SchedulingSnapshot();
  void restore() const;

 private:
  cpu_set_t cpus_;
};

}  // namespace finsight
