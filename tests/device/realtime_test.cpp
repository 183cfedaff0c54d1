#include "firmware/device/realtime.h"

#include <doctest/doctest.h>
#include <sched.h>
#include <sys/resource.h>

#include <atomic>
#include <memory>
#include <mutex>
#include <stdexcept>
#include <thread>
#include <vector>

#include "firmware/ports/camera.h"

using namespace finsight;

namespace {

struct Scheduling {
  int processors = 0, policy = -1;
};

/// Of the calling thread.
Scheduling scheduling() {
  cpu_set_t cpus;
  CPU_ZERO(&cpus);
  sched_getaffinity(0, sizeof cpus, &cpus);
  return {CPU_COUNT(&cpus), sched_getscheduler(0)};
}

int first_processor() {
  cpu_set_t cpus;
  CPU_ZERO(&cpus);
  sched_getaffinity(0, sizeof cpus, &cpus);
  int cpu = 0;
  while (!CPU_ISSET(cpu, &cpus)) ++cpu;
  return cpu;
}

/// On the first processor and, where the system allows it, in real time.
void make_loop_realtime() {
  try {
    make_realtime({.priority = 1, .cpu = first_processor()});
  } catch (const std::runtime_error&) {
    make_realtime({.cpu = first_processor()});
  }
}

/// Starts a thread when it is opened, as libcamera does; it notes how it is scheduled. Lost after one frame.
class ThreadedCamera : public Camera {
 public:
  explicit ThreadedCamera(std::vector<Scheduling>& threads) {
    std::thread([&] { threads.push_back(scheduling()); }).join();
  }
  bool next(Frame& frame, int) override {
    frame.exposure_ns = steady_now_ns();
    return !std::exchange(is_over_, true);
  }
  bool ended() const override { return is_over_; }
  std::string error() const override { return ""; }

 private:
  bool is_over_ = false;
};

}  // namespace

TEST_CASE("real time: a camera's threads share neither processor nor priority with the loop, whenever it is opened") {
  const Scheduling ordinary = scheduling();
  if (ordinary.processors < 2) {
    MESSAGE("one processor: nothing to tell apart");
    return;
  }
  std::vector<Scheduling> threads;
  Scheduling loop;
  std::thread([&] {
    const auto camera = keep_open([&] { return std::make_unique<ThreadedCamera>(threads); }, {.frames_per_second = 60},
                                  [](const std::string&) {}, steady_replay_clock());
    make_loop_realtime();
    loop = scheduling();
    Frame frame;
    for (int frames = 0, tries = 0; frames < 2 && tries < 100; ++tries) frames += camera->next(frame, 100);
  }).join();
  CHECK(loop.processors == 1);
  REQUIRE(threads.size() >= 2);  // opened at the start, and again when it was lost
  for (const Scheduling& thread : threads) {
    CHECK(thread.processors == ordinary.processors);
    CHECK(thread.policy == ordinary.policy);
  }
}

TEST_CASE("real time: the former scheduling can be restored for the next start") {
  const Scheduling ordinary = scheduling();
  Scheduling again;
  std::thread([&] {
    const SchedulingSnapshot before;
    make_loop_realtime();
    before.restore();
    again = scheduling();
  }).join();
  CHECK(again.processors == ordinary.processors);
  CHECK((again.policy & ~SCHED_RESET_ON_FORK) == SCHED_OTHER);
}

TEST_CASE("real time: a setting that the system refuses is named") {
  std::thread([] {
    CHECK_THROWS_WITH_AS(make_realtime({.cpu = 1023}), doctest::Contains("realtime.cpu = 1023: "), std::runtime_error);
  }).join();
}

TEST_CASE("realtime: a processor that this machine does not have is refused before the start") {
  check_realtime({});
  check_realtime({.cpu = first_processor()});
  CHECK_THROWS_WITH_AS(check_realtime({.cpu = 255}), doctest::Contains("realtime: cpu: found 255, expected at most "),
                       InputError);
}

TEST_CASE(
    "realtime: without a priority the frame loop is nicer to itself where it may, and as before after a restore") {
  std::thread([] {
    const int before = ::getpriority(PRIO_PROCESS, 0);
    const SchedulingSnapshot snapshot;
    const bool may = ::setpriority(PRIO_PROCESS, 0, before - 1) == 0 && ::setpriority(PRIO_PROCESS, 0, before) == 0;
    make_realtime({});
    CHECK(::getpriority(PRIO_PROCESS, 0) == (may ? -10 : before));
    snapshot.restore();
    CHECK(::getpriority(PRIO_PROCESS, 0) == before);
  }).join();
}
