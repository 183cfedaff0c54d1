#include "firmware/modbus/registers.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numbers>
#include <optional>
#include <string_view>
#include <utility>

#include "firmware/modbus/block_writer.h"

namespace finsight {

namespace {

// Register 43 publishes these as they are.
static_assert(static_cast<int>(ShapeSource::kRest) == value_named("shape_source", "at_rest"));
static_assert(static_cast<int>(ShapeSource::kMap) == value_named("shape_source", "shape_map"));
static_assert(static_cast<int>(ShapeSource::kNewton) == value_named("shape_source", "newton_solve"));
static_assert(static_cast<int>(ShapeSource::kContactMap) == value_named("shape_source", "contact_aware_map"));

// The process helpers' events and values are numbered as their registers.
static_assert(kOverloadEvent == value_named("events", "overload") &&
              kGripChanged == value_named("events", "grip_changed"));
static_assert(address_of("grip_changed_count") == address_of("contact_made_count") + kGripChanged);
static_assert(address_of("touch_z_net") == address_of("force_net") + kTouchZ);
static_assert(address_of("touch_z_peak") == address_of("force_peak") + kTouchZ);
static_assert(address_of("touch_z_minimum") == address_of("force_minimum") + kTouchZ);

// No status bit may announce a NaN that slipped through a stage as valid.
bool is_valid(const Touch& touch) {
  return touch.quality != Quality::kInvalid && touch.point_mm.allFinite() && touch.contact_mm.allFinite() &&
         std::isfinite(touch.force_n);
}

bool is_valid(const FingerShape& shape) {
  return shape.quality != Quality::kInvalid && std::isfinite(shape.front_rms_mm) && std::isfinite(shape.largest_mm) &&
         std::isfinite(shape.rms_mm);
}

/// Register 11; NaN if it is not valid.
double deformation_level(const FingerShape& shape, double rated_deformation_mm) {
  if (!is_valid(shape) || !(rated_deformation_mm > 0)) return kNan;
  return 1000 * static_cast<double>(shape.front_rms_mm) / rated_deformation_mm;
}

std::uint16_t status_word(const PlatePoses& poses, const FingerShape& shape, const Touch& touch,
                          const LoopState& state) {
  std::uint16_t word = 0;
  const auto set = [&word](StatusBit bit, bool on) {
    if (on) word |= bit;
  };
  set(kReady, state.fault != FaultCode::kSelfTest && (is_valid(shape) || is_valid(touch)));
  set(kTouchValid, is_valid(touch));
  set(kContact, state.limits.contact);
  set(kShapeValid, is_valid(shape) && poses.seen_count() == kPlates);
  set(kHeld, poses.quality == Quality::kHeld || shape.quality == Quality::kHeld || touch.quality == Quality::kHeld);
  set(kTopSeen, poses.seen[kTopPlate]);
  set(kMiddleSeen, poses.seen[kMiddlePlate]);
  set(kLowSeen, poses.seen[kLowPlate]);
  set(kZeroed, state.zeroed);
  set(kOverRange, touch.over_range);
  set(kUnexplained, touch.unexplained);
  set(kCameraFault, state.camera_fault);
  set(kSolverFallback, shape.fallback);
  set(kSettingsUnsaved, state.settings_unsaved);
  set(kOverload, state.limits.overload);
  set(kAnyFault, state.camera_fault || state.fault != FaultCode::kNone);
  return word;
}

std::uint16_t limits_word(const ThresholdState& state) {
  std::uint16_t word = 0;
  if (state.contact) word |= bit_named("limits", "contact");
  if (state.gentle) word |= bit_named("limits", "gentle");
  if (state.overload) word |= bit_named("limits", "overload");
  return word;
}

void write_touch(BlockWriter& block, const Touch& touch) {
  const bool valid = is_valid(touch);
  block.measured(row_named("touch_x"), touch.point_mm, 1, valid);
  block.measured(row_named("touch_uncertainty"), touch.radius_68_mm, valid);
  block.measured(row_named("force"), touch.force_n, valid);
  block.measured(row_named("force_uncertainty"), touch.force_sigma_n, valid);
  block.measured(row_named("touch_x_float"), touch.point_mm, 1, valid);
  block.measured(row_named("force_float"), touch.force_n, valid);
  block.measured(row_named("contact_x"), touch.contact_mm, 1, valid);
  block.measured(row_named("force_normal"), touch.force_vector_n, 1, valid);
  block.measured(row_named("force_normal_uncertainty"), touch.force_vector_sigma_n, 1, valid);
  block.measured(row_named("wrench_force_x"), touch.wrench_force_n, 1, valid);
  block.measured(row_named("wrench_moment_x"), touch.moment_nm, 1, valid);
  block.measured(row_named("wrench_force_x_uncertainty"), touch.wrench_force_sigma_n, 1, valid);
  block.measured(row_named("wrench_moment_x_uncertainty"), touch.moment_sigma_nm, 1, valid);
  block.measured(row_named("force_normal_float"), touch.force_vector_n, 1, valid);
  block.measured(row_named("wrench_moment_x_float"), touch.moment_nm, 1, valid);
}

void write_shape(BlockWriter& block, const FingerShape& shape, double rated_deformation_mm) {
  const bool valid = is_valid(shape);
  block.measured(row_named("deformation_level"), deformation_level(shape, rated_deformation_mm), valid);
  block.measured(row_named("largest_displacement"), shape.largest_mm, valid);
  block.measured(row_named("rms_displacement"), shape.rms_mm, valid);
  block.measured(row_named("deformation_float"), shape.front_rms_mm, valid);
  block.count(row_named("iterations"), static_cast<std::uint32_t>(std::max(shape.iterations, 0)));
  block.count(row_named("shape_source"), static_cast<std::uint32_t>(shape.source));
}

/// Registers 3 and 4. An exposure at 0 means that there has been none yet.
void write_time_since(BlockWriter& block, const RegisterRow& row, std::int64_t exposure_ns, std::int64_t now_ns) {
  block.measured(row, static_cast<double>(now_ns - exposure_ns) * 1e-6, exposure_ns != 0);
}

/// Nothing where the device does not know what day it is.
std::optional<int> days_since_verification(const LoopState& state) {
  const int verified_on = state.settings[kVerifiedOn];
  if (verified_on == 0 || state.today < verified_on) return std::nullopt;
  return state.today - verified_on;
}

/// A device that does not know what day it is cannot tell that a verification is too old.
bool is_verification_due(const LoopState& state) {
  const int every = state.settings[kVerifyEvery];
  if (every == 0) return false;
  return state.settings[kVerdict] != value_named("verdict", "passed") || state.settings[kVerifiedOn] == 0 ||
         days_since_verification(state).value_or(0) > every;
}

void write_fit(BlockWriter& block, const LoopState& state) {
  block.measured(row_named("force_scale"), state.force_scale, true);
  block.measured(row_named("force_scale_uncertainty"), state.force_scale_sigma, true);
  block.measured(row_named("fitted_on"), state.fitted_on, state.fitted_on != 0);
  const auto ago = days_since_verification(state);
  block.measured(row_named("verified_days_ago"), ago.value_or(0), ago.has_value());
}

/// All registers of the process helpers are single words.
BlockWriter process_writer(RegisterImage& image) { return {image.process, kProcessValueAddress, false}; }

/// The order that the block was made in: its test constant shows it.
bool is_low_word_first(const RegisterImage& image) {
  return image.words[address_of("test_constant_long")] == (kLongTestConstant & 0xFFFF);
}

constexpr double kCountsPerN = 100;  // of settings 1010 and 1011

/// A threshold with hysteresis: reached at `on`, left below `off`; NaN leaves it.
bool is_reached(bool before, double value, std::uint16_t on, std::uint16_t off) { return value >= (before ? off : on); }

}  // namespace

std::uint16_t scene_code(const std::string& scene) {
  for (const NamedValue& known : row_named("scene").values) {
    if (scene == known.name) return static_cast<std::uint16_t>(known.value);
  }
  return value_named("scene", "own");
}

bool has_low_word_first(const RuntimeSettings& settings) {
  return settings[kWordOrder] == value_named("word_order", "CDAB");
}

bool are_valid(const RuntimeSettings& settings) {
  for (int i = 0; i < kSettingCount; ++i) {
    const std::uint16_t word = settings.words[static_cast<std::size_t>(i)];
    if (word < setting_row(i).lowest || word > setting_row(i).highest) return false;
  }
  return settings[kContactOn] > settings[kContactOff] && settings[kGentleOn] > settings[kGentleOff] &&
         settings[kOverloadOn] > settings[kOverloadOff];
}

ThresholdState next_threshold_state(const ThresholdState& before, const FingerShape& shape, const Touch& touch,
                                    float rated_deformation_mm, const RuntimeSettings& settings) {
  const double force = is_valid(touch) ? kCountsPerN * static_cast<double>(touch.force_n) : kNan;
  const double level = deformation_level(shape, rated_deformation_mm);
  return {touch.over_range || is_reached(before.contact, force, settings[kContactOn], settings[kContactOff]),
          is_reached(before.gentle, level, settings[kGentleOn], settings[kGentleOff]),
          is_reached(before.overload, level, settings[kOverloadOn], settings[kOverloadOff])};
}

void encode_registers(const PlatePoses& poses, const FingerShape& shape, const Touch& touch, const LoopState& state,
                      RegisterImage& image) {
  constexpr double kDegreesPerRadian = 180 / std::numbers::pi;
  const PlateMotion& top = poses.plates[kTopPlate];
  const bool poses_valid = poses.quality != Quality::kInvalid;
  image.words.fill(0);
  image.exposure_ns = state.exposure_ns;
  BlockWriter block(image.words, 0, has_low_word_first(state.settings));
  block.count(row_named("status"), status_word(poses, shape, touch, state));
  block.count(row_named("fault"), static_cast<std::uint32_t>(state.fault));
  block.count(row_named("heartbeat"), state.heartbeat);
  write_time_since(block, row_named("latency"), state.exposure_ns, state.published_ns);
  write_touch(block, touch);
  write_shape(block, shape, state.rated_deformation_mm);
  block.measured(row_named("top_plate_x"), top.displacement_mm, 1, poses_valid);
  block.measured(row_named("top_plate_rotation_x"), top.rotation_rad, kDegreesPerRadian, poses_valid);
  block.measured(row_named("temperature_float"), 0, false);  // no board measures it yet
  block.count(row_named("frame_counter"), state.frame_counter);
  block.count(row_named("dropped_frames"), state.dropped_frames);
  block.count(row_named("model_checksum"), state.model_checksum);
  block.count(row_named("scene"), state.scene);
  block.count(row_named("map_version"), kMapVersion);
  write_fit(block, state);
  block.count(row_named("warnings"), state.warnings | (is_verification_due(state) ? std::uint32_t{kNotVerified} : 0));
  block.count(row_named("test_constant"), kTestConstant);
  block.count(row_named("test_constant_long"), kLongTestConstant);
  block.count(row_named("limits"), limits_word(state.limits));
}

void encode_process(const ProcessReadings& readings, RegisterImage& image) {
  image.process.fill(0);
  BlockWriter block = process_writer(image);
  std::uint32_t events = 0;
  for (int event = 0; event < kProcessEvents; ++event) {
    events |= std::uint32_t{readings.event[event]} << event;
    block.count((&row_named("contact_made_count"))[event], readings.count[event]);
  }
  block.count(row_named("events"), events);
  std::uint32_t state = 0;
  if (readings.force_tared) state |= bit_named("process_state", "force_tared");
  if (readings.deformation_tared) state |= bit_named("process_state", "deformation_tared");
  if (readings.touch_tared) state |= bit_named("process_state", "touch_tared");
  if (readings.grip_steady) state |= bit_named("process_state", "grip_steady");
  block.count(row_named("process_state"), state);
  block.measured(row_named("lowpass_delay"), readings.lowpass_delay_ms, true);
  for (int value = 0; value < kProcessValues; ++value) {
    block.measured((&row_named("force_net"))[value], readings.net[value], true);
    block.measured((&row_named("force_peak"))[value], readings.peak[value], true);
    block.measured((&row_named("force_minimum"))[value], readings.minimum[value], true);
  }
}

double measured_value(const RegisterImage& image, int address) {
  const RegisterRow& row = measurement_row(address);
  const std::uint16_t word = image.words[static_cast<std::size_t>(address)];
  if (row.type == RegisterType::kInt16) return word == 0x8000 ? kNan : static_cast<std::int16_t>(word) * row.scale;
  return word == 0xFFFF ? kNan : word * row.scale;
}

RegisterImage empty_block() {
  RegisterImage image;
  encode_registers(PlatePoses{}, FingerShape{}, Touch{}, LoopState{}, image);
  encode_process({}, image);
  return image;
}

void set_age(RegisterImage& image, std::int64_t now_ns) {
  BlockWriter block(image.words, 0, false);  // the word order does not concern the age, a single word
  write_time_since(block, row_named("age"), image.exposure_ns, now_ns);
}

void use_word_order(RegisterImage& image, bool low_word_first) {
  if (is_low_word_first(image) == low_word_first) return;
  for (const RegisterRow& row : kRegisterTable.measurements) {
    const auto at = static_cast<std::size_t>(row.address);
    if (words_of(row.type) == 2) std::swap(image.words[at], image.words[at + 1]);
  }
}

void mark_stalled(RegisterImage& image, const RuntimeSettings& settings) {
  std::uint16_t& status = image.words[address_of("status")];
  image.words[address_of("fault")] = static_cast<std::uint16_t>(FaultCode::kStalled);
  status = static_cast<std::uint16_t>((status & ~kReady) | kAnyFault);
  if (settings[kAfterHold] == value_named("after_hold", "keep")) {
    status |= kHeld;
    return;
  }
  constexpr std::uint16_t kOfOldFrame = kTouchValid | kContact | kShapeValid | kHeld | kTopSeen | kMiddleSeen |
                                        kLowSeen | kOverRange | kSolverFallback | kUnexplained | kOverload;
  status = static_cast<std::uint16_t>(status & ~kOfOldFrame);
  image.words[address_of("limits")] = 0;
  BlockWriter block(image.words, 0, is_low_word_first(image));
  for (const RegisterRow& row : kRegisterTable.measurements) {
    const bool is_of_frame = row.may_be_invalid() && row.address < address_of("force_scale");
    if (is_of_frame && row.address != address_of("age")) block.measured(row, 0, false);
  }
  // Peaks and minima stay what they were.
  BlockWriter process = process_writer(image);
  for (int value = 0; value < kProcessValues; ++value) {
    process.measured((&row_named("force_net"))[value], 0, false);
  }
  constexpr int kState = address_of("process_state") - kProcessValueAddress;
  image.process[kState] =
      static_cast<std::uint16_t>(image.process[kState] & ~bit_named("process_state", "grip_steady"));
}

}  // namespace finsight
