#include "firmware/modbus/diagnostics.h"

#include <algorithm>
#include <cmath>
#include <string_view>

#include "firmware/modbus/block_writer.h"

namespace finsight {

namespace {

constexpr int kFaultStride = address_of("fault_2_code") - address_of("fault_1_code");
static_assert(address_of("fault_8_code") == address_of("fault_1_code") + 7 * kFaultStride);

std::uint32_t seconds(std::int64_t ns) {
  return static_cast<std::uint32_t>(std::clamp<std::int64_t>(ns / kNsPerS, 0, 0xFFFF'FFFF));
}

void write_fault(BlockWriter& block, int index, const FaultRecord& fault, std::int64_t started_ns) {
  // All eight look alike; a row of the first is moved to the others' addresses.
  const auto moved = [&](RegisterRow row) {
    row.address += index * kFaultStride;
    return row;
  };
  block.count(moved(row_named("fault_1_code")), fault.code);
  block.count(moved(row_named("fault_1_began")), fault.code ? seconds(fault.began_ns - started_ns) : 0);
  const bool has_ended = fault.code == 0 || fault.ended_ns != 0;
  block.measured(moved(row_named("fault_1_lasted")), seconds(fault.ended_ns - fault.began_ns), has_ended);
}

}  // namespace

void LoopHealth::note_fault(std::uint16_t code, std::int64_t now_ns) {
  FaultRecord& last = faults.front();
  const bool stands = last.code != 0 && last.ended_ns == 0;
  if (stands && last.code == code) return;
  if (stands) last.ended_ns = now_ns;
  if (code == 0) return;
  std::shift_right(faults.begin(), faults.end(), 1);
  faults.front() = {code, now_ns, 0};
  ++faults_counted;
}

void LoopHealth::mark_stalled(std::int64_t since_ns) {
  note_fault(value_named("fault", "stalled"), since_ns);
  frame_rate_hz = 0;
  load = std::numeric_limits<float>::quiet_NaN();
}

void write_diagnostics(const ServerCounts& counts, const LoopHealth& health, const DeviceIdentity& identity,
                       float processor_temperature_degc, std::int64_t started_ns, std::int64_t now_ns,
                       bool low_word_first, std::span<std::uint16_t, kDiagnosticsRegisters> words) {
  std::ranges::fill(words, std::uint16_t{0});
  BlockWriter block(words, kDiagnosticsAddress, low_word_first);
  const auto exceptions = [&](Exception code) { return counts.exceptions[static_cast<std::size_t>(code)]; };
  block.count(row_named("uptime"), seconds(now_ns - started_ns));
  block.count(row_named("connections"), counts.open);
  block.count(row_named("connections_accepted"), counts.accepted);
  block.count(row_named("connections_refused"), counts.refused);
  block.count(row_named("connections_replaced"), counts.replaced);
  block.count(row_named("requests"), counts.requests);
  block.count(row_named("exceptions_function"), exceptions(Exception::kIllegalFunction));
  block.count(row_named("exceptions_address"), exceptions(Exception::kIllegalAddress));
  block.count(row_named("exceptions_value"), exceptions(Exception::kIllegalValue));
  block.count(row_named("exceptions_locked"), exceptions(Exception::kLocked));
  block.count(row_named("exceptions_busy"), exceptions(Exception::kBusy));
  block.count(row_named("wrong_keys"), counts.wrong_keys);
  block.count(row_named("wrong_key_client"), counts.wrong_key_client);
  block.measured(row_named("frame_rate"), static_cast<double>(health.frame_rate_hz), true);
  block.count(row_named("frames_processed"), health.frames);
  block.count(row_named("frames_dropped"), health.dropped);
  block.measured(row_named("processor_temperature"), static_cast<double>(processor_temperature_degc), true);
  block.measured(row_named("loop_load"), 1000 * static_cast<double>(health.load), true);
  block.count(row_named("loop_longest"),
              static_cast<std::uint32_t>(std::clamp<std::int64_t>(health.longest_ns / 100'000, 0, 0xFFFF)));
  block.count(row_named("camera_losses"), health.camera_losses);
  block.count(row_named("calibration_date"), identity.calibration_date);
  block.count(row_named("pack_checksum"), identity.model_checksum);
  block.text(row_named("model_name"), identity.model_name);
  block.text(row_named("serial_number"), identity.serial_number);
  block.text(row_named("firmware_version"), FINSIGHT_VERSION);
  block.count(row_named("faults_counted"), health.faults_counted & 0xFFFF);
  for (int i = 0; i < kFaultEntries; ++i) {
    write_fault(block, i, health.faults[static_cast<std::size_t>(i)], started_ns);
  }
  block.count(row_named("pictures_broken"), health.pictures_broken);
  block.measured(row_named("camera_rate"), static_cast<double>(health.camera_rate_hz), true);
  block.count(row_named("image_made"), identity.image_made);
  block.count(row_named("image_slot"), identity.image_slot);
}

}  // namespace finsight
