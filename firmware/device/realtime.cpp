#include "firmware/device/realtime.h"

#include <sys/mman.h>
#include <sys/resource.h>
#include <sys/sysinfo.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <stdexcept>
#include <string>

#include "firmware/input_error.h"

namespace finsight {

namespace {

constexpr int kNiceOfFrameLoop = -10;

void require(int result, const std::string& what) {
  if (result != 0) throw std::runtime_error(what + ": " + std::strerror(errno));
}

}  // namespace

void check_realtime(const RealtimeSettings& settings) {
  const int processors = get_nprocs_conf();
  if (settings.cpu < processors) return;
  throw InputError(
      "realtime", "cpu", std::to_string(settings.cpu),
      "at most " + std::to_string(processors - 1) + ": this machine has " + std::to_string(processors) + " processors");
}

void spread_over_processors(std::span<Settings> fingers) {
  cpu_set_t usable;
  CPU_ZERO(&usable);
  sched_getaffinity(0, sizeof usable, &usable);
  const auto has_processor = [](const Settings& finger) { return finger.realtime.cpu >= 0; };
  const auto count = static_cast<std::size_t>(CPU_COUNT(&usable));
  if (fingers.size() < 2 || count < fingers.size() || std::ranges::any_of(fingers, has_processor)) return;
  std::size_t left = fingers.size();
  for (int cpu = CPU_SETSIZE - 1; cpu >= 0 && left > 0; --cpu) {
    if (CPU_ISSET(cpu, &usable)) fingers[--left].realtime.cpu = cpu;
  }
}

void make_realtime(const RealtimeSettings& settings) {
  if (settings.lock_memory) require(mlockall(MCL_CURRENT | MCL_FUTURE), "realtime.lock_memory");
  if (settings.cpu >= 0) {
    cpu_set_t cpus;
    CPU_ZERO(&cpus);
    CPU_SET(settings.cpu, &cpus);
    require(sched_setaffinity(0, sizeof cpus, &cpus), "realtime.cpu = " + std::to_string(settings.cpu));
  }
  if (settings.priority > 0) {
    // Threads that this one starts do not become real-time.
    const sched_param parameters{.sched_priority = settings.priority};
    require(sched_setscheduler(0, SCHED_FIFO | SCHED_RESET_ON_FORK, &parameters),
            "realtime.priority = " + std::to_string(settings.priority));
  } else {
    // Before the server's thread and whatever else runs, where the system allows it; where it does not, no harm is
    // done.
    ::setpriority(PRIO_PROCESS, 0, kNiceOfFrameLoop);
  }
}

SchedulingSnapshot::SchedulingSnapshot() {
  CPU_ZERO(&cpus_);
  sched_getaffinity(0, sizeof cpus_, &cpus_);
  nice_ = ::getpriority(PRIO_PROCESS, 0);
}

void SchedulingSnapshot::restore() const {
  sched_setaffinity(0, sizeof cpus_, &cpus_);
  const sched_param parameters{};
  sched_setscheduler(0, SCHED_OTHER | SCHED_RESET_ON_FORK, &parameters);
  ::setpriority(PRIO_PROCESS, 0, nice_);
}

}  // namespace finsight
