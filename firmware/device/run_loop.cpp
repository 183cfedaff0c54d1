#include "firmware/device/run_loop.h"

#include <utility>

#include "firmware/device/supervisor.h"

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
bool run(Source<Sample>& source, Device device, int timeout_ms, const std::atomic<bool>& stop) {
  Supervisor supervisor;
  supervisor.ready();
  std::uint32_t openings = 0;
  while (!stop && !device.commands.reset_is_due()) {
    Sample sample;
    const bool has_frame = source.next(sample, timeout_ms);
    if (!has_frame && source.ended()) return true;
    const std::int64_t now_ns = steady_now_ns();
    device.health.begin_turn(now_ns);
    device.commands.poll();
    if (device.outputs.trigger_rises()) device.commands.trigger();
    const CameraCounts counts = source.counts();
    device.loop.set_warnings(warnings_of(counts));
    const RegisterImage& image = has_frame ? device.loop.step(sample) : device.loop.step_without_frame(now_ns);
    device.server.publish(image);
    // A search for a missing camera is a sign of life, too: a restart would not find it, only disconnect the clients.
    const std::uint32_t before = std::exchange(openings, counts.openings);
    if (has_frame || openings != before) supervisor.alive(now_ns, has_frame);
    if (!device.outputs.set(image, device.loop.state().settings)) return false;
    if (has_frame) {
      device.log.add(image);
      record(device.recorder, sample, image);
    }
    if (device.page) {
      device.page->publish(device.loop, image, has_frame ? picture_of(sample) : nullptr, steady_now_ns() - now_ns);
    }
    const LoopState& state = device.loop.state();
    device.health.note(image, has_frame, now_ns, steady_now_ns(),
                       {state.frames, state.dropped_frames, counts.losses, counts.broken, counts.rate_hz});
  }
  return true;
}

}  // namespace

bool run_loop(Device device, int timeout_ms, const std::atomic<bool>& stop) {
  return std::visit([&](const auto& source) { return run(*source, device, timeout_ms, stop); }, device.source);
}

}  // namespace finsight
