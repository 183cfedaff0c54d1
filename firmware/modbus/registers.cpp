#include "firmware/modbus/registers.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <limits>
#include <numbers>
#include <sstream>
#include <string_view>

namespace finsight {

namespace {

enum class Type : std::uint8_t { kUint16, kInt16, kUint32, kFloat32 };

const char* name_of(Type type) {
  constexpr std::array<const char*, 4> kNames = {"uint16", "int16", "uint32", "float32"};
  return kNames[static_cast<std::size_t>(type)];
}

constexpr int words_of(Type type) { return type == Type::kUint32 || type == Type::kFloat32 ? 2 : 1; }

struct Row {
  int address;
  const char* name;
  Type type;
  double scale;  // value in `unit` = register * scale
  const char* unit;
  const char* description;
};

// The register table. Addresses, names and scales are part of the interface: rows are added, never changed.
constexpr Row kTable[] = {
    {0, "status", Type::kUint16, 1, "bits",
     "0 ready, 1 touch valid, 2 contact, 3 shape valid (all plates seen), 4 held (not fresh), 5 top plate seen, "
     "6 middle plate seen, 7 low plate seen, 9 over-range (moved further than any trained touch), 10 camera fault, 11 "
     "solver fallback, 15 any fault; others reserved, 0"},
    {1, "fault", Type::kUint16, 1, "code",
     "0 none, 1 camera lost, 2 markers lost, 3 solver failed, 4 self-test failed, 5 settings or model refused (safe "
     "mode), 6 failed repeatedly (safe mode)"},
    {2, "heartbeat", Type::kUint16, 1, "", "+1 with every published result, wraps"},
    {3, "age", Type::kUint16, 0.1, "ms", "from exposure to the moment of this read; 65535: no result yet"},
    {4, "latency", Type::kUint16, 0.1, "ms", "from exposure to publication; 65535: no result yet"},
    {5, "touch_x", Type::kInt16, 0.01, "mm", "touched point of the unbent front face, across; -32768: not valid"},
    {6, "touch_y", Type::kInt16, 0.01, "mm", "touched point, up from the base; -32768: not valid"},
    {7, "touch_z", Type::kInt16, 0.01, "mm", "touched point, into the finger; -32768: not valid"},
    {8, "touch_uncertainty", Type::kUint16, 0.01, "mm", "radius holding 68 % of the errors; 65535: not valid"},
    {9, "force", Type::kUint16, 0.01, "N", "touch force; 65535: not valid"},
    {10, "force_uncertainty", Type::kUint16, 0.01, "N", "standard deviation of the force; 65535: not valid"},
    {11, "deformation_level", Type::kUint16, 1, "permille", "of the finger's rated deformation; 65535: not valid"},
    {12, "largest_displacement", Type::kUint16, 0.01, "mm", "of any point of the finger; 65535: not valid"},
    {13, "rms_displacement", Type::kUint16, 0.01, "mm", "over all points of the finger; 65535: not valid"},
    {14, "top_plate_x", Type::kInt16, 0.01, "mm", "top plate's displacement, across; -32768: not valid"},
    {15, "top_plate_y", Type::kInt16, 0.01, "mm", "top plate's displacement, up; -32768: not valid"},
    {16, "top_plate_z", Type::kInt16, 0.01, "mm", "top plate's displacement, inwards; -32768: not valid"},
    {17, "top_plate_rotation_x", Type::kInt16, 0.01, "deg", "top plate's rotation vector; -32768: not valid"},
    {18, "top_plate_rotation_y", Type::kInt16, 0.01, "deg", "top plate's rotation vector; -32768: not valid"},
    {19, "top_plate_rotation_z", Type::kInt16, 0.01, "deg", "top plate's rotation vector; -32768: not valid"},
    {20, "touch_x_float", Type::kFloat32, 1, "mm", "as register 5; NaN: not valid"},
    {22, "touch_y_float", Type::kFloat32, 1, "mm", "as register 6; NaN: not valid"},
    {24, "touch_z_float", Type::kFloat32, 1, "mm", "as register 7; NaN: not valid"},
    {26, "force_float", Type::kFloat32, 1, "N", "as register 9; NaN: not valid"},
    {28, "deformation_float", Type::kFloat32, 1, "mm", "RMS displacement of the front face; NaN: not valid"},
    {30, "temperature_float", Type::kFloat32, 1, "degC", "of the board; NaN: not known"},
    {32, "frame_counter", Type::kUint32, 1, "", "camera's counter of the published frame, wraps"},
    {34, "dropped_frames", Type::kUint16, 1, "", "frames lost since the start, saturates"},
    {35, "iterations", Type::kUint16, 1, "", "steps of the shape solver for this frame"},
    {36, "model_checksum", Type::kUint32, 1, "", "of the model pack: which finger this is"},
    {38, "map_version", Type::kUint16, 1, "", "version of this register table"},
    {39, "test_constant", Type::kUint16, 1, "", "4660 (16#1234), for trying byte order and address base"},
    {40, "contact_x", Type::kInt16, 0.01, "mm", "where the touched point is now, across; -32768: not valid"},
    {41, "contact_y", Type::kInt16, 0.01, "mm", "where the touched point is now, up; -32768: not valid"},
    {42, "contact_z", Type::kInt16, 0.01, "mm", "where the touched point is now, inwards; -32768: not valid"},
    {43, "shape_source", Type::kUint16, 1, "code", "0 finger at rest, 1 shape map, 2 Newton solve"},
    {44, "reserved_44", Type::kUint16, 1, "", "0"},
    {45, "reserved_45", Type::kUint16, 1, "", "0"},
    {46, "reserved_46", Type::kUint16, 1, "", "0"},
    {47, "reserved_47", Type::kUint16, 1, "", "0"},
};
constexpr std::uint16_t kMapVersion = 1;
constexpr std::uint16_t kTestConstant = 0x1234;

consteval bool table_is_gapless() {
  int next = 0;
  for (const Row& row : kTable) {
    if (row.address != next) return false;
    next += words_of(row.type);
  }
  return next == kMeasurementRegisters;
}
static_assert(table_is_gapless());

/// The index of a row by its name; a name that is not in the table does not compile.
consteval std::size_t row(std::string_view name) {
  for (std::size_t i = 0; i < std::size(kTable); ++i) {
    if (kTable[i].name == name) return i;
  }
  throw "no register of that name";
}

/// Puts values into the block as their rows say.
class BlockWriter {
 public:
  BlockWriter(RegisterImage& image, WordOrder order) : image_(image), order_(order) {}

  /// Bits, codes and counters: any value is a valid one.
  void count(std::size_t row, std::uint32_t value) {
    if (kTable[row].type == Type::kUint32) {
      put_pair(kTable[row].address, value);
    } else {
      put(kTable[row].address, std::min<std::uint32_t>(value, 0xFFFF));
    }
  }

  /// Measured values: one code of each type means "not valid", so a saturated value stops before it.
  void measured(std::size_t row, double value, bool valid) {
    const int address = kTable[row].address;
    const Type type = kTable[row].type;
    valid = valid && std::isfinite(value);
    const double counts = valid ? std::round(value / kTable[row].scale) : 0;
    if (type == Type::kInt16) {
      put(address, valid ? static_cast<std::int64_t>(std::clamp(counts, -32767.0, 32767.0)) : -32768);
    } else if (type == Type::kUint16) {
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
    const bool high_first = order_ == WordOrder::kABCD;
    put(high_first ? address : address + 1, bits >> 16);
    put(high_first ? address + 1 : address, bits & 0xFFFF);
  }

  RegisterImage& image_;
  WordOrder order_;
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
  set(kContact, is_valid(touch) && touch.force_n > 0);
  set(kShapeValid, is_valid(shape) && poses.seen_count() == kPlates);
  set(kHeld, poses.quality == Quality::kHeld || shape.quality == Quality::kHeld || touch.quality == Quality::kHeld);
  set(kTopSeen, poses.seen[kTopPlate]);
  set(kMiddleSeen, poses.seen[kMiddlePlate]);
  set(kLowSeen, poses.seen[kLowPlate]);
  set(kOverRange, touch.over_range);
  set(kCameraFault, state.camera_fault);
  set(kSolverFallback, shape.fallback);
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

}  // namespace

void encode_registers(const PlatePoses& poses, const FingerShape& shape, const Touch& touch, const LoopState& state,
                      RegisterImage& image) {
  constexpr double kDegreesPerRadian = 180 / std::numbers::pi;
  const PlateMotion& top = poses.plates[kTopPlate];
  const bool poses_valid = poses.quality != Quality::kInvalid;
  image.words.fill(0);
  image.exposure_ns = state.exposure_ns;
  BlockWriter block(image, state.word_order);
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
}

void set_age(RegisterImage& image, std::int64_t now_ns) {
  BlockWriter block(image, WordOrder::kABCD);  // the age is a single word: its order does not matter
  write_time_since(block, row("age"), image.exposure_ns, now_ns);
}

std::string register_table_markdown() {
  std::ostringstream text;
  text << "| address | name | type | scale | unit | |\n|---|---|---|---|---|---|\n";
  for (const Row& row : kTable) {
    text << "| " << row.address;
    if (words_of(row.type) == 2) text << "-" << row.address + 1;
    text << " | `" << row.name << "` | " << name_of(row.type) << " | " << row.scale << " | " << row.unit << " | "
         << row.description << " |\n";
  }
  return text.str();
}

std::string register_table_csv() {
  std::ostringstream text;
  text << "address,name,type,scale,unit,description\r\n";
  for (const Row& row : kTable) {
    text << row.address << "," << row.name << "," << name_of(row.type) << "," << row.scale << "," << row.unit << ",\""
         << row.description << "\"\r\n";
  }
  return text.str();
}

}  // namespace finsight
