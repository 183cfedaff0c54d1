// The register table: one list in code from which the server, the README's tables and the files for PLCs come.
// Addresses, names and scales are part of the interface: rows are added, never changed.
#pragma once

#include <cstddef>
#include <cstdint>
#include <string_view>

#include "firmware/types.h"

namespace finsight {

enum class RegisterType : std::uint8_t { kUint16, kInt16, kUint32, kFloat32 };

constexpr int words_of(RegisterType type) {
  return type == RegisterType::kUint32 || type == RegisterType::kFloat32 ? 2 : 1;
}

struct RegisterRow {
  int address;
  const char* name;
  RegisterType type;
  double scale;  ///< value in `unit` = register * scale
  const char* unit;
  const char* description;
  bool writable = false;
  std::uint16_t lowest = 0, highest = 65535;  ///< what may be written
  std::uint16_t factory = 0;                  ///< of a setting: before anything was saved
};

inline constexpr RegisterRow kMeasurementTable[] = {
    {0, "status", RegisterType::kUint16, 1, "bits",
     "0 ready, 1 touch valid, 2 contact, 3 shape valid (all plates seen), 4 held (not fresh), 5 top plate seen, "
     "6 middle plate seen, 7 low plate seen, 8 zeroed, 9 over-range (moved further than any trained touch), 10 camera "
     "fault, 11 solver fallback, 12 settings unsaved, 14 overload, 15 any fault; 13 reserved, 0"},
    {1, "fault", RegisterType::kUint16, 1, "code",
     "0 none, 1 camera lost, 2 markers lost, 3 solver failed, 4 self-test failed, 5 settings or model refused (safe "
     "mode), 6 failed repeatedly (safe mode), 7 saved settings refused (factory settings in use; "
     "until command 3), 8 stalled (no new result; all values are old), 9 camera frozen (the same image again and "
     "again), 10 image too dark, 11 image too bright, 12 image out of focus, "
     "13 camera moved (mount it again, then zero)"},
    {2, "heartbeat", RegisterType::kUint16, 1, "", "+1 with every published result, wraps"},
    {3, "age", RegisterType::kUint16, 0.1, "ms", "from exposure to the moment of this read; 65535: no result yet"},
    {4, "latency", RegisterType::kUint16, 0.1, "ms", "from exposure to publication; 65535: no result yet"},
    {5, "touch_x", RegisterType::kInt16, 0.01, "mm",
     "touched point of the unbent front face, across; -32768: not valid"},
    {6, "touch_y", RegisterType::kInt16, 0.01, "mm", "touched point, up from the base; -32768: not valid"},
    {7, "touch_z", RegisterType::kInt16, 0.01, "mm", "touched point, into the finger; -32768: not valid"},
    {8, "touch_uncertainty", RegisterType::kUint16, 0.01, "mm", "radius holding 68 % of the errors; 65535: not valid"},
    {9, "force", RegisterType::kUint16, 0.01, "N", "touch force; 65535: not valid"},
    {10, "force_uncertainty", RegisterType::kUint16, 0.01, "N", "standard deviation of the force; 65535: not valid"},
    {11, "deformation_level", RegisterType::kUint16, 1, "permille",
     "of the finger's rated deformation; 65535: not valid"},
    {12, "largest_displacement", RegisterType::kUint16, 0.01, "mm", "of any point of the finger; 65535: not valid"},
    {13, "rms_displacement", RegisterType::kUint16, 0.01, "mm", "over all points of the finger; 65535: not valid"},
    {14, "top_plate_x", RegisterType::kInt16, 0.01, "mm", "top plate's displacement, across; -32768: not valid"},
    {15, "top_plate_y", RegisterType::kInt16, 0.01, "mm", "top plate's displacement, up; -32768: not valid"},
    {16, "top_plate_z", RegisterType::kInt16, 0.01, "mm", "top plate's displacement, inwards; -32768: not valid"},
    {17, "top_plate_rotation_x", RegisterType::kInt16, 0.01, "deg", "top plate's rotation vector; -32768: not valid"},
    {18, "top_plate_rotation_y", RegisterType::kInt16, 0.01, "deg", "top plate's rotation vector; -32768: not valid"},
    {19, "top_plate_rotation_z", RegisterType::kInt16, 0.01, "deg", "top plate's rotation vector; -32768: not valid"},
    {20, "touch_x_float", RegisterType::kFloat32, 1, "mm", "as register 5; NaN: not valid"},
    {22, "touch_y_float", RegisterType::kFloat32, 1, "mm", "as register 6; NaN: not valid"},
    {24, "touch_z_float", RegisterType::kFloat32, 1, "mm", "as register 7; NaN: not valid"},
    {26, "force_float", RegisterType::kFloat32, 1, "N", "as register 9; NaN: not valid"},
    {28, "deformation_float", RegisterType::kFloat32, 1, "mm", "RMS displacement of the front face; NaN: not valid"},
    {30, "temperature_float", RegisterType::kFloat32, 1, "degC", "of the board; NaN: not known"},
    {32, "frame_counter", RegisterType::kUint32, 1, "", "camera's counter of the published frame, wraps"},
    {34, "dropped_frames", RegisterType::kUint16, 1, "", "frames lost since the start, saturates"},
    {35, "iterations", RegisterType::kUint16, 1, "", "steps of the shape solver for this frame"},
    {36, "model_checksum", RegisterType::kUint32, 1, "", "of the model pack: which finger this is"},
    {38, "map_version", RegisterType::kUint16, 1, "", "version of this register table"},
    {39, "test_constant", RegisterType::kUint16, 1, "", "4660 (16#1234), for trying byte order and address base"},
    {40, "contact_x", RegisterType::kInt16, 0.01, "mm", "where the touched point is now, across; -32768: not valid"},
    {41, "contact_y", RegisterType::kInt16, 0.01, "mm", "where the touched point is now, up; -32768: not valid"},
    {42, "contact_z", RegisterType::kInt16, 0.01, "mm", "where the touched point is now, inwards; -32768: not valid"},
    {43, "shape_source", RegisterType::kUint16, 1, "code",
     "0 finger at rest, 1 shape map, 2 Newton solve, 3 contact-aware map"},
    {44, "limits", RegisterType::kUint16, 1, "bits",
     "thresholds with hysteresis: 0 contact, 1 gentle, 2 overload (settings 1010 to 1015)"},
    {45, "reserved_45", RegisterType::kUint16, 1, "", "0"},
    {46, "test_constant_long", RegisterType::kUint32, 1, "",
     "305419896 (16#12345678), for trying the word order of 32-bit values"},
};

/// Commands and settings, behind the measurements.
inline constexpr int kControlAddress = 1000;
enum ControlRegister : int {
  kCommandRegister = 1000,
  kSequenceRegister = 1001,
  kResultSequenceRegister = 1002,
  kResultRegister = 1003,
  kKeyRegister = 1004,
  kRecordingRegister = 1005,
  kFirstSettingRegister = 1010,
};

inline constexpr RegisterRow kControlTable[] = {
    {1000, "command", RegisterType::kUint16, 1, "code",
     "0 none, 1 zero (the finger as it is now is at rest), 2 save settings and zero, 3 clear fault, 4 record a "
     "session, 5 stop recording, 6 reset (starts anew half a second later), 7 factory settings and no zero (unsaved)",
     true, 0, 7},
    {1001, "command_sequence", RegisterType::kUint16, 1, "",
     "a number that is not that of register 1002 starts the command; writing the same again does nothing", true},
    {1002, "result_sequence", RegisterType::kUint16, 1, "",
     "the number of the last command that ended; 0 at the start"},
    {1003, "result", RegisterType::kUint16, 1, "code",
     "of that command: 0 done, 1 not possible now (zero: a plate is missing, moves, or is too far off; record: already "
     "recording), 2 not configured (the board file names no place), 3 failed (disk)"},
    {1004, "write_key", RegisterType::kUint16, 1, "s",
     "writing the device's key unlocks the writes of this client for 30 s; reads as the seconds left", true},
    {1005, "recording", RegisterType::kUint16, 1, "",
     "0 no, 1 a session is being recorded, 2 no: the last one failed (disk)"},
    {1006, "reserved_1006", RegisterType::kUint16, 1, "", "0"},
    {1007, "reserved_1007", RegisterType::kUint16, 1, "", "0"},
    {1008, "reserved_1008", RegisterType::kUint16, 1, "", "0"},
    {1009, "reserved_1009", RegisterType::kUint16, 1, "", "0"},
    {1010, "contact_on", RegisterType::kUint16, 0.01, "N", "force from which there is contact; above contact_off", true,
     1, 10000, 20},
    {1011, "contact_off", RegisterType::kUint16, 0.01, "N", "force below which there is none", true, 0, 9999, 10},
    {1012, "gentle_on", RegisterType::kUint16, 1, "permille",
     "deformation level from which a thing counts as held; above gentle_off", true, 1, 5000, 200},
    {1013, "gentle_off", RegisterType::kUint16, 1, "permille", "level below which it does not", true, 0, 4999, 150},
    {1014, "overload_on", RegisterType::kUint16, 1, "permille",
     "deformation level from which there is overload; above overload_off", true, 1, 5000, 1000},
    {1015, "overload_off", RegisterType::kUint16, 1, "permille", "level below which there is none", true, 0, 4999, 900},
    {1016, "hold_time", RegisterType::kUint16, 1, "ms", "how long the last plates stand in for missing ones", true, 0,
     10000, 200},
    {1017, "after_hold", RegisterType::kUint16, 1, "code",
     "after the hold time: 0 all values are not valid, 1 the last values stay, marked as held; a fault either way",
     true, 0, 1, 0},
    {1018, "output_debounce", RegisterType::kUint16, 1, "ms",
     "how long a digital output's new level must last before it is set; safe levels never wait", true, 0, 1000, 0},
    {1019, "word_order", RegisterType::kUint16, 1, "code",
     "of 32-bit registers: 0 ABCD (high word first), 1 CDAB (low word first)", true, 0, 1, 0},
    {1020, "light", RegisterType::kUint16, 1, "code", "0 off, 1 on", true, 0, 1, 1},
    {1021, "trigger_command", RegisterType::kUint16, 1, "code",
     "the command (as in register 1000) that a rising edge of the trigger input starts; 0 none", true, 0, 5, 0},
};

/// The settings in the order of their registers.
enum Setting : std::uint8_t {
  kContactOn,
  kContactOff,
  kGentleOn,
  kGentleOff,
  kOverloadOn,
  kOverloadOff,
  kHoldTime,
  kAfterHold,
  kOutputDebounce,
  kWordOrder,
  kLight,
  kTriggerCommand,
  kSettingCount
};
inline constexpr int kControlRegisters = kFirstSettingRegister - kControlAddress + kSettingCount;

consteval bool is_gapless(const RegisterRow* rows, std::size_t count, int first, int end) {
  for (std::size_t i = 0; i < count; first += words_of(rows[i++].type)) {
    if (rows[i].address != first) return false;
  }
  return first == end;
}
static_assert(is_gapless(kMeasurementTable, std::size(kMeasurementTable), 0, kMeasurementRegisters));
static_assert(is_gapless(kControlTable, std::size(kControlTable), kControlAddress,
                         kControlAddress + kControlRegisters));

/// Its row; single words only, so the index is the address.
constexpr const RegisterRow& control_row(int address) { return kControlTable[address - kControlAddress]; }
constexpr const RegisterRow& setting_row(int setting) { return control_row(kFirstSettingRegister + setting); }

}  // namespace finsight
