#include "firmware/device/run_loop.h"

#include <chrono>
#include <thread>
#include <utility>

#include "firmware/device/log.h"
#include "firmware/settings/measured_fit.h"

namespace finsight {

namespace {

void record(Recorder* recorder, const Frame& frame, const RegisterImage& image) {
  if (recorder) recorder->add(frame, image);
}
void record(Recorder*, const Observation&, const RegisterImage&) {}  // there is no image to record

const Frame* picture_of(const Frame& frame) { return &frame; }
const Frame* picture_of(const Observation&) { return nullptr; }

std::uint16_t warnings_of(const CameraCounts& counts) {
  return static_cast<std::uint16_t>((counts.is_slow ? kCameraSlow : 0) | (counts.breaks ? kPicturesBroken : 0));
}

template <class Sample>
bool run(Source<Sample>& source, FingerAtWork work, SharedDevice& device, int timeout_ms) {
  std::uint32_t openings = 0;
  bool has_ended = false;
  while (!device.stop && !device.is_over && !work.commands.reset_is_due()) {
    Sample sample;
    const bool has_frame = source.next(sample, timeout_ms);
    if (!has_frame && source.ended()) {
      if (!std::exchange(has_ended, true)) {
        if (!source.error().empty()) log_message(work.name, source.error());
        --device.sources;
      }
      if (device.sources <= 0) return true;
      std::this_thread::sleep_for(std::chrono::milliseconds(timeout_ms));
    }
    const std::int64_t now_ns = steady_now_ns();
    work.health.begin_turn(now_ns);
    work.commands.poll();
    if (work.outputs.trigger_rises()) work.commands.trigger();
    const CameraCounts counts = source.counts();
    work.loop.set_warnings(warnings_of(counts));
    work.loop.set_today(day_today());
    const RegisterImage& image = has_frame ? work.loop.step(sample) : work.loop.step_without_frame(now_ns);
    device.server.publish(image, work.finger);
    // A search for a missing camera is a sign of life, too: a restart would not find it, only disconnect the clients.
    const std::uint32_t before = std::exchange(openings, counts.openings);
    if (has_frame || has_ended || openings != before) device.supervisor.alive(now_ns, has_frame, work.finger);
    if (!work.outputs.set(image, work.loop.state().settings)) return false;
    if (has_frame) {
      work.log.add(image);
      record(work.recorder, sample, image);
    }
    if (work.page) {
      work.page->publish(work.loop, image, has_frame ? picture_of(sample) : nullptr, steady_now_ns() - now_ns);
    }
    const LoopState& state = work.loop.state();
    work.health.note(image, has_frame, now_ns, steady_now_ns(),
                     {state.frames, state.dropped_frames, counts.losses, counts.broken, counts.rate_hz});
  }
  device.is_over = true;
  return true;
}

}  // namespace

bool run_loop(FingerAtWork work, SharedDevice& device, int timeout_ms) {
  const bool done = std::visit([&](const auto& source) { return run(*source, work, device, timeout_ms); }, work.source);
  if (!done) device.is_over = true;
  return done;
}

}  // namespace finsight
