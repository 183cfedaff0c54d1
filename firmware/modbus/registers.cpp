#include "firmware/modbus/registers.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <limits>
#include <numbers>
#include <string_view>

namespace finsight {

namespace {

constexpr std::uint16_t kMapVersion = 2;
constexpr std::uint16_t kTestConstant = 0x1234;
constexpr std::uint32_t kLongTestConstant = 0x12345678;

/// The index of a row by its name; a name that is not in the table does not compile.
consteval std::size_t row(std::string_view name) {
  for (std::size_t i = 0; i < std::size(kMeasurementTable); ++i) {
    if (kMeasurementTable[i].name == name) return i;
  }
  throw "no register of that name";
}

/// Puts values into the block as their rows say.
class BlockWriter {
 public:
  BlockWriter(RegisterImage& image, bool low_word_first) : image_(image), low_word_first_(low_word_first) {}

  /// Bits, codes and counters: any value is a valid one.
  void count(std::size_t row, std::uint32_t value) {
    if (kMeasurementTable[row].type == RegisterType::kUint32) {
      put_pair(kMeasurementTable[row].address, value);
    } else {
      put(kMeasurementTable[row].address, std::min<std::uint32_t>(value, 0xFFFF));
    }
  }

  /// Measured values: one code of each type means "not valid", so a saturated value stops before it.
  void measured(std::size_t row, double value, bool valid) {
    const int address = kMeasurementTable[row].address;
    const RegisterType type = kMeasurementTable[row].type;
    valid = valid && std::isfinite(value);
    const double counts = valid ? std::round(value / kMeasurementTable[row].scale) : 0;
    if (type == RegisterType::kInt16) {
      put(address, valid ? static_cast<std::int64_t>(std::clamp(counts, -32767.0, 32767.0)) : -32768);
    } else if (type == RegisterType::kUint16) {
      put(address, valid ? static_cast<std::int64_t>(std::clamp(counts, 0.0, 65534.0)) : 65535);
    } else {
      // One NaN for all processors: x86 and ARM differ in the sign of those that they compute.
      const float mirror = valid ? static_cast<float>(value) : std::numeric_limits<float>::quiet_NaN();
      put_pair(address, std::bit_cast<std::uint32_t>(mirror));
    }
  }

  /// Three consecutive rows: x, y, z.
  void measured(std::size_t first_row, const Vec3f& value, double factor, bool valid) {
    for (int axis = 0; axis < 3; ++axis) {
      measured(first_row + static_cast<std::size_t>(axis), factor * static_cast<double>(value[axis]), valid);
    }
  }

 private:
  void put(int address, std::int64_t word) {
    image_.words[static_cast<std::size_t>(address)] = static_cast<std::uint16_t>(word);
  }
  void put_pair(int address, std::uint32_t bits) {
    put(low_word_first_ ? address + 1 : address, bits >> 16);
    put(low_word_first_ ? address : address + 1, bits & 0xFFFF);
  }

  RegisterImage& image_;
  bool low_word_first_;
};

// A NaN that slipped through a stage must not be announced as valid by a status bit.
bool is_valid(const Touch& touch) {
  return touch.quality != Quality::kInvalid && touch.point_mm.allFinite() && touch.contact_mm.allFinite() &&
         std::isfinite(touch.force_n);
}

bool is_valid(const FingerShape& shape) {
  return shape.quality != Quality::kInvalid && std::isfinite(shape.front_rms_mm) && std::isfinite(shape.largest_mm) &&
         std::isfinite(shape.rms_mm);
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
  set(kCameraFault, state.camera_fault);
  set(kSolverFallback, shape.fallback);
  set(kSettingsUnsaved, state.settings_unsaved);
  set(kOverload, state.limits.overload);
  set(kAnyFault, state.camera_fault || state.fault != FaultCode::kNone);
  return word;
}

void write_touch(BlockWriter& block, const Touch& touch) {
  const bool valid = is_valid(touch);
  block.measured(row("touch_x"), touch.point_mm, 1, valid);
  block.measured(row("touch_uncertainty"), touch.radius_68_mm, valid);
  block.measured(row("force"), touch.force_n, valid);
  block.measured(row("force_uncertainty"), touch.force_sigma_n, valid);
  block.measured(row("touch_x_float"), touch.point_mm, 1, valid);
  block.measured(row("force_float"), touch.force_n, valid);
  block.measured(row("contact_x"), touch.contact_mm, 1, valid);
}

void write_shape(BlockWriter& block, const FingerShape& shape, double rated_deformation_mm) {
  const bool valid = is_valid(shape);
  const double deformation_mm = shape.front_rms_mm;
  block.measured(row("deformation_level"), 1000 * deformation_mm / rated_deformation_mm,
                 valid && rated_deformation_mm > 0);
  block.measured(row("largest_displacement"), shape.largest_mm, valid);
  block.measured(row("rms_displacement"), shape.rms_mm, valid);
  block.measured(row("deformation_float"), deformation_mm, valid);
  block.count(row("iterations"), static_cast<std::uint32_t>(std::max(shape.iterations, 0)));
  block.count(row("shape_source"), static_cast<std::uint32_t>(shape.source));
}

/// Nanoseconds to the milliseconds of registers 3 and 4; an exposure at 0 means that there was none yet.
void write_time_since(BlockWriter& block, std::size_t row, std::int64_t exposure_ns, std::int64_t now_ns) {
  block.measured(row, static_cast<double>(now_ns - exposure_ns) * 1e-6, exposure_ns != 0);
}

constexpr double kCountsPerN = 100;  // of the thresholds of contact

/// Reached at `on`, left below `off`; a value that is no number leaves it.
bool is_reached(bool before, double value, std::uint16_t on, std::uint16_t off) { return value >= (before ? off : on); }

}  // namespace

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
  constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
  const double force = is_valid(touch) ? kCountsPerN * static_cast<double>(touch.force_n) : kNan;
  const double level = is_valid(shape) && rated_deformation_mm > 0 ? 1000.0 * static_cast<double>(shape.front_rms_mm) /
                                                                         static_cast<double>(rated_deformation_mm)
                                                                   : kNan;
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
  BlockWriter block(image, state.settings[kWordOrder] != 0);
  block.count(row("status"), status_word(poses, shape, touch, state));
  block.count(row("fault"), static_cast<std::uint32_t>(state.fault));
  block.count(row("heartbeat"), state.heartbeat);
  write_time_since(block, row("latency"), state.exposure_ns, state.published_ns);
  write_touch(block, touch);
  write_shape(block, shape, state.rated_deformation_mm);
  block.measured(row("top_plate_x"), top.displacement_mm, 1, poses_valid);
  block.measured(row("top_plate_rotation_x"), top.rotation_rad, kDegreesPerRadian, poses_valid);
  block.measured(row("temperature_float"), 0, false);  // no board with a thermometer yet
  block.count(row("frame_counter"), state.frame_counter);
  block.count(row("dropped_frames"), state.dropped_frames);
  block.count(row("model_checksum"), state.model_checksum);
  block.count(row("map_version"), kMapVersion);
  block.count(row("test_constant"), kTestConstant);
  block.count(row("test_constant_long"), kLongTestConstant);
  block.count(row("limits"), unsigned{state.limits.contact} | unsigned{state.limits.gentle} << 1 |
                                 unsigned{state.limits.overload} << 2);
}

RegisterImage empty_block() {
  RegisterImage image;
  encode_registers(PlatePoses{}, FingerShape{}, Touch{}, LoopState{}, image);
  return image;
}

void set_age(RegisterImage& image, std::int64_t now_ns) {
  BlockWriter block(image, false);  // the age is a single word
  write_time_since(block, row("age"), image.exposure_ns, now_ns);
}

void mark_stalled(RegisterImage& image) {
  std::uint16_t& status = image.words[row("status")];
  std::uint16_t& fault = image.words[row("fault")];
  status = static_cast<std::uint16_t>((status & ~(kReady | kTouchValid | kShapeValid)) | kAnyFault);
  fault = static_cast<std::uint16_t>(FaultCode::kStalled);
}

}  // namespace finsight
