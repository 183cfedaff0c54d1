// Real-time scheduling of the frame loop: priority, processor, memory that stays in memory.
#pragma once

#include <sched.h>

#include <span>

#include "firmware/settings/settings.h"

namespace finsight {

/// Throws InputError for a processor that this machine does not have.
void check_realtime(const RealtimeSettings& settings);

/// Where the board file gives none of several fingers a processor, and this program may use enough of them: each gets
/// one of its own, the last ones, because the first serves the hardware.
void spread_over_processors(std::span<Settings> fingers);

/// Applies to the calling thread (the memory lock to the whole process). Throws std::runtime_error naming the setting
/// that the system refuses. Without a priority the thread becomes nice -10 where the system allows it.
void make_realtime(const RealtimeSettings& settings);

/// How the calling thread was scheduled before make_realtime(). It is restored before everything is started again,
/// because new threads inherit the processor of the one that starts them.
class SchedulingSnapshot {
 public:
  SchedulingSnapshot();
  void restore() const;

 private:
  cpu_set_t cpus_;
  int nice_ = 0;
};

}  // namespace finsight
