// The register table: the only list of registers, status bits and codes. From it come the enumerations of the firmware,
// and through `hostgen plc` the tables of README.md, the files for PLCs and the names that finsightctl shows.
// Addresses, names, types, scales and values are the interface to clients: add rows and values, never change them.
// Descriptions and notes are prose; no program depends on them.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <string_view>

#include "firmware/modbus/register_row.h"
#include "firmware/modbus/register_values.h"
#include "firmware/types.h"

namespace finsight {

inline constexpr std::uint16_t kMapVersion = 3;
inline constexpr std::uint16_t kTestConstant = 0x1234;
inline constexpr std::uint32_t kLongTestConstant = 0x12345678;

namespace table {

using enum RegisterType;

// One line per row.
// clang-format off
inline constexpr RegisterRow kMeasurements[] = {
    row::bits(0, "status", kStatusBits, ""),
    row::code(1, "fault", kFaults, ""),
    row::count(2, "heartbeat", kUint16, "goes up by 1 with every published result; wraps around"),
    row::measured(3, "age", kUint16, 0.1, "ms", "time from exposure to this read", "no result yet"),
    row::measured(4, "latency", kUint16, 0.1, "ms", "time from exposure to publication", "no result yet"),
    row::measured(5, "touch_x", kInt16, 0.01, "mm", "touched point on the undeformed front face, across the finger"),
    row::measured(6, "touch_y", kInt16, 0.01, "mm", "touched point on the undeformed front face, up from the base"),
    row::measured(7, "touch_z", kInt16, 0.01, "mm", "touched point on the undeformed front face, into the finger"),
    row::measured(8, "touch_uncertainty", kUint16, 0.01, "mm", "radius around the touched point that the true one lies in with 68 % probability"),
    row::measured(9, "force", kUint16, 0.01, "N", "contact force"),
    row::measured(10, "force_uncertainty", kUint16, 0.01, "N", "standard deviation of the force"),
    row::measured(11, "deformation_level", kUint16, 1, "permille", "register 28 relative to the finger's rated deformation"),
    row::measured(12, "largest_displacement", kUint16, 0.01, "mm", "largest displacement of any point of the finger"),
    row::measured(13, "rms_displacement", kUint16, 0.01, "mm", "RMS displacement of all points of the finger"),
    row::measured(14, "top_plate_x", kInt16, 0.01, "mm", "displacement of the top plate, across the finger"),
    row::measured(15, "top_plate_y", kInt16, 0.01, "mm", "displacement of the top plate, up from the base"),
    row::measured(16, "top_plate_z", kInt16, 0.01, "mm", "displacement of the top plate, into the finger"),
    row::measured(17, "top_plate_rotation_x", kInt16, 0.01, "deg", "rotation vector of the top plate, x"),
    row::measured(18, "top_plate_rotation_y", kInt16, 0.01, "deg", "rotation vector of the top plate, y"),
    row::measured(19, "top_plate_rotation_z", kInt16, 0.01, "deg", "rotation vector of the top plate, z"),
    row::measured(20, "touch_x_float", kFloat32, 1, "mm", "register 5 as a float"),
    row::measured(22, "touch_y_float", kFloat32, 1, "mm", "register 6 as a float"),
    row::measured(24, "touch_z_float", kFloat32, 1, "mm", "register 7 as a float"),
    row::measured(26, "force_float", kFloat32, 1, "N", "register 9 as a float"),
    row::measured(28, "deformation_float", kFloat32, 1, "mm", "RMS displacement of the front face"),
    row::measured(30, "temperature_float", kFloat32, 1, "degC", "temperature of the board", "not known"),
    row::count(32, "frame_counter", kUint32, "the camera's number of the published frame; wraps around"),
    row::count(34, "dropped_frames", kUint16, "frames lost since the start; stops at 65535"),
    row::count(35, "iterations", kUint16, "iterations of the shape solver for this frame"),
    row::count(36, "model_checksum", kUint32, "checksum of the model pack; tells which finger this is"),
    row::count(38, "map_version", kUint16, "version of this register table"),
    row::count(39, "test_constant", kUint16, "4660 (16#1234), to check byte order and address base"),
    row::measured(40, "contact_x", kInt16, 0.01, "mm", "where the touched point is now, across the finger"),
    row::measured(41, "contact_y", kInt16, 0.01, "mm", "where the touched point is now, up from the base"),
    row::measured(42, "contact_z", kInt16, 0.01, "mm", "where the touched point is now, into the finger"),
    row::code(43, "shape_source", kShapeSources, "source of the shape"),
    row::bits(44, "limits", kLimitBits, "thresholds with hysteresis (settings 1010 to 1015)"),
    row::bits(45, "warnings", kWarnings, "what works, but not well"),
    row::count(46, "test_constant_long", kUint32, "305419896 (16#12345678), to check the word order of 32-bit values"),
    row::measured(48, "force_normal", kInt16, 0.01, "N", "contact force, into the finger, at right angles to the face at rest"),
    row::measured(49, "force_across", kInt16, 0.01, "N", "contact force, across the finger (x)"),
    row::measured(50, "force_along", kInt16, 0.01, "N", "contact force, along the face, away from the base; a touch a little higher moves the plates almost alike, so register 53 is large"),
    row::measured(51, "force_normal_uncertainty", kUint16, 0.01, "N", "standard deviation of register 48"),
    row::measured(52, "force_across_uncertainty", kUint16, 0.01, "N", "standard deviation of register 49"),
    row::measured(53, "force_along_uncertainty", kUint16, 0.01, "N", "standard deviation of register 50"),
    row::measured(54, "wrench_force_x", kInt16, 0.01, "N", "contact force in the finger frame, x: with the moment, what a wrist sensor at the finger's base would read"),
    row::measured(55, "wrench_force_y", kInt16, 0.01, "N", "contact force in the finger frame, y: with the moment, what a wrist sensor at the finger's base would read"),
    row::measured(56, "wrench_force_z", kInt16, 0.01, "N", "contact force in the finger frame, z: with the moment, what a wrist sensor at the finger's base would read"),
    row::measured(57, "wrench_moment_x", kInt16, 0.001, "Nm", "moment of the contact force about the finger frame's origin, x"),
    row::measured(58, "wrench_moment_y", kInt16, 0.001, "Nm", "moment of the contact force about the finger frame's origin, y"),
    row::measured(59, "wrench_moment_z", kInt16, 0.001, "Nm", "moment of the contact force about the finger frame's origin, z"),
    row::measured(60, "wrench_force_x_uncertainty", kUint16, 0.01, "N", "standard deviation of register 54"),
    row::measured(61, "wrench_force_y_uncertainty", kUint16, 0.01, "N", "standard deviation of register 55"),
    row::measured(62, "wrench_force_z_uncertainty", kUint16, 0.01, "N", "standard deviation of register 56"),
    row::measured(63, "wrench_moment_x_uncertainty", kUint16, 0.001, "Nm", "standard deviation of register 57"),
    row::measured(64, "wrench_moment_y_uncertainty", kUint16, 0.001, "Nm", "standard deviation of register 58"),
    row::measured(65, "wrench_moment_z_uncertainty", kUint16, 0.001, "Nm", "standard deviation of register 59"),
    row::measured(66, "force_normal_float", kFloat32, 1, "N", "register 48 as a float"),
    row::measured(68, "force_across_float", kFloat32, 1, "N", "register 49 as a float"),
    row::measured(70, "force_along_float", kFloat32, 1, "N", "register 50 as a float"),
    row::measured(72, "wrench_moment_x_float", kFloat32, 1, "Nm", "register 57 as a float"),
    row::measured(74, "wrench_moment_y_float", kFloat32, 1, "Nm", "register 58 as a float"),
    row::measured(76, "wrench_moment_z_float", kFloat32, 1, "Nm", "register 59 as a float"),
    row::reserved(78, "reserved_78"),
    row::reserved(79, "reserved_79"),
    row::code(80, "scene", kScenes, "contacts that the model pack was trained for (three plates tell neither a patch's size nor a second contact, so neither is published)"),
    row::number(81, "force_scale", kUint16, 0.001, "", "of this finger: force over what its pack says; 1 where it was not fitted"),
    row::number(82, "force_scale_uncertainty", kUint16, 0.001, "", "relative standard deviation of the force scale"),
    row::measured(83, "fitted_on", kUint16, 1, "d", "day of the fit, counted from 2000-01-01", "never"),
    row::measured(84, "verified_days_ago", kUint16, 1, "d", "days since the verification (1023)", "never, or the device has no date"),
};

inline constexpr RegisterRow kControl[] = {
    row::writable_code(row::code(1000, "command", kCommands, "only together with register 1001, in one write")),
    row::writable(row::count(1001, "command_sequence", kUint16, "number of the command, not used before; the same command with the same number again does nothing"), 1, 65535),
    row::count(1002, "result_sequence", kUint16, "number of the last finished command; 0 after a start"),
    row::code(1003, "result", kResults, "of that command"),
    row::writable(row::number(1004, "write_key", kUint16, 1, "s", "writing the device's key unlocks this client's writes for 30 s, and each of them for another 30 s; reads as the seconds left"), 0, 65535),
    row::code(1005, "recording", kRecordingStates, ""),
    row::writable(row::count(1006, "master_refresh", kUint16, "the master writes any value here at least every master_timeout (1022)"), 0, 65535),
    row::number(1007, "recording_s", kUint16, 1, "s", "length of the running or last recording"),
    row::measured(1008, "recording_mb_left", kUint16, 1, "MB", "room for recordings, down to the disk's reserve", "not configured"),
    row::writable_code(row::code(1009, "exclusive", kSwitch, "on: until this client writes off or its unlock ends, other clients' writes are refused as busy; 1206 is who")),
    row::writable(row::number(1010, "contact_on", kUint16, 0.01, "N", "contact is set at this force; must exceed contact_off"), 1, 10000, 20),
    row::writable(row::number(1011, "contact_off", kUint16, 0.01, "N", "contact is cleared below this force"), 0, 9999, 10),
    row::writable(row::number(1012, "gentle_on", kUint16, 1, "permille", "gentle is set at this deformation level; must exceed gentle_off"), 1, 5000, 200),
    row::writable(row::number(1013, "gentle_off", kUint16, 1, "permille", "gentle is cleared below this deformation level"), 0, 4999, 150),
    row::writable(row::number(1014, "overload_on", kUint16, 1, "permille", "overload is set at this deformation level; must exceed overload_off"), 1, 5000, 1000),
    row::writable(row::number(1015, "overload_off", kUint16, 1, "permille", "overload is cleared below this deformation level"), 0, 4999, 900),
    row::writable(row::number(1016, "hold_time", kUint16, 1, "ms", "how long the last plate poses stand in for missing ones"), 0, 10000, 200),
    row::writable_code(row::code(1017, "after_hold", kAfterHoldCodes, "what happens after the hold time, besides a fault")),
    row::writable(row::number(1018, "output_debounce", kUint16, 1, "ms", "how long a digital output's new level must last before it is set; safe levels are set at once"), 0, 1000, 0),
    row::writable_code(row::code(1019, "word_order", kWordOrders, "of 32-bit registers")),
    row::writable_code(row::code(1020, "light", kSwitch, "the finger's light"), 1),
    row::writable_code(row::code(1021, "trigger_command", std::span(kCommands).first(6), "started by a rising edge of the trigger input")),
    row::writable(row::number(1022, "master_timeout", kUint16, 1, "ms", "fault 14 when register 1006 is not written for so long; 0: never"), 0, 60000, 0),
    row::writable(row::number(1023, "verified_on", kUint16, 1, "d", "day of the last verification (hostgen verify), counted from 2000-01-01; 0: never"), 0, 65535),
    row::writable_code(row::code(1024, "verdict", kVerdicts, "of that verification")),
    row::writable(row::number(1025, "force_expanded_uncertainty", kUint16, 0.01, "N", "of the force, k = 2, by that verification; 0: not known"), 0, 65535),
    row::writable(row::number(1026, "touch_expanded_uncertainty", kUint16, 0.01, "mm", "of the touched point, k = 2, by that verification; 0: not known"), 0, 65535),
    row::writable(row::number(1027, "verify_every", kUint16, 1, "d", "warning not_verified when the last passed verification is older than this; 0: never"), 0, 3650),
};

// Process helpers: settings first, then what the device makes of the measurements. See firmware/loop/process_values.h.
inline constexpr RegisterRow kProcess[] = {
    row::writable(row::number(1100, "lowpass", kUint16, 0.1, "Hz", "cut-off frequency of the low-pass of registers 1120 to 1134; 0: none"), 0, 1000),
    row::writable(row::number(1101, "grip_change", kUint16, 0.1, "", "while an object is held, grip_changed is raised when the touch moves by more than this many of its radii, or the deformation by as many standard deviations of its noise; 0: never"), 0, 1000, 30),
    row::writable(row::number(1102, "gravity_x", kInt16, 0.001, "g", "acceleration of things that fall, with the arm's own, in the finger frame, x; this and the next two only in one write"), 0, 65535),
    row::writable(row::number(1103, "gravity_y", kInt16, 0.001, "g", "the same, y: -1000 where the finger stands upright at rest"), 0, 65535),
    row::writable(row::number(1104, "gravity_z", kInt16, 0.001, "g", "the same, z"), 0, 65535),
    row::reserved(1105, "reserved_1105"),
    row::reserved(1106, "reserved_1106"),
    row::reserved(1107, "reserved_1107"),
    row::reserved(1108, "reserved_1108"),
    row::reserved(1109, "reserved_1109"),
    row::bits(1110, "events", kEvents, "what has happened since command 13; a fault is no event"),
    row::count(1111, "contact_made_count", kUint16, "how often since command 13; wraps around"),
    row::count(1112, "contact_lost_count", kUint16, "how often since command 13; wraps around"),
    row::count(1113, "overload_count", kUint16, "how often since command 13; wraps around"),
    row::count(1114, "grip_changed_count", kUint16, "how often since command 13; wraps around"),
    row::bits(1115, "process_state", kProcessStates, ""),
    row::number(1116, "lowpass_delay", kUint16, 0.1, "ms", "by how much the low-pass delays a steady change, besides the latency"),
    row::reserved(1117, "reserved_1117"),
    row::reserved(1118, "reserved_1118"),
    row::reserved(1119, "reserved_1119"),
    row::measured(1120, "force_net", kInt16, 0.01, "N", "contact force, after low-pass and tare"),
    row::measured(1121, "deformation_net", kInt16, 0.01, "mm", "deformation (register 28), after low-pass and tare"),
    row::measured(1122, "touch_x_net", kInt16, 0.01, "mm", "touched point, after low-pass and tare, across the finger"),
    row::measured(1123, "touch_y_net", kInt16, 0.01, "mm", "touched point, after low-pass and tare, up from the base"),
    row::measured(1124, "touch_z_net", kInt16, 0.01, "mm", "touched point, after low-pass and tare, into the finger"),
    row::measured(1125, "force_peak", kInt16, 0.01, "N", "highest force_net since command 12 or its tare", "none yet"),
    row::measured(1126, "deformation_peak", kInt16, 0.01, "mm", "highest deformation_net since command 12 or its tare", "none yet"),
    row::measured(1127, "touch_x_peak", kInt16, 0.01, "mm", "highest touch_x_net since command 12 or its tare", "none yet"),
    row::measured(1128, "touch_y_peak", kInt16, 0.01, "mm", "highest touch_y_net since command 12 or its tare", "none yet"),
    row::measured(1129, "touch_z_peak", kInt16, 0.01, "mm", "highest touch_z_net since command 12 or its tare", "none yet"),
    row::measured(1130, "force_minimum", kInt16, 0.01, "N", "lowest force_net since command 12 or its tare", "none yet"),
    row::measured(1131, "deformation_minimum", kInt16, 0.01, "mm", "lowest deformation_net since command 12 or its tare", "none yet"),
    row::measured(1132, "touch_x_minimum", kInt16, 0.01, "mm", "lowest touch_x_net since command 12 or its tare", "none yet"),
    row::measured(1133, "touch_y_minimum", kInt16, 0.01, "mm", "lowest touch_y_net since command 12 or its tare", "none yet"),
    row::measured(1134, "touch_z_minimum", kInt16, 0.01, "mm", "lowest touch_z_net since command 12 or its tare", "none yet"),
};
// The newest command is first, also while it runs.
#define FINSIGHT_HISTORY(n, address) \
  row::count(address, "history_" #n "_sequence", kUint16, "number of a command, the newest first; 0: none"), \
  row::code(address + 1, "history_" #n "_command", kCommands, ""), \
  row::code(address + 2, "history_" #n "_result", kHistoryResults, ""), \
  row::client(address + 3, "history_" #n "_client", "that gave it")
inline constexpr RegisterRow kHistory[] = {
    row::count(1200, "commands_given", kUint16, "since the start; wraps around"),
    row::count(1201, "own_sequence", kUint16, "number of the last command of the client that reads this: of its connection, or else of its address; 0: none"),
    row::code(1202, "own_command", kCommands, ""),
    row::code(1203, "own_result", kHistoryResults, ""),
    row::client(1204, "result_client", "that gave the command of register 1002"),
    row::client(1206, "exclusive_client", "that alone may write (register 1009)"),
    row::reserved(1208, "reserved_1208"),
    row::reserved(1209, "reserved_1209"),
    FINSIGHT_HISTORY(1, 1210), FINSIGHT_HISTORY(2, 1215), FINSIGHT_HISTORY(3, 1220), FINSIGHT_HISTORY(4, 1225),
    FINSIGHT_HISTORY(5, 1230), FINSIGHT_HISTORY(6, 1235), FINSIGHT_HISTORY(7, 1240), FINSIGHT_HISTORY(8, 1245),
};
#undef FINSIGHT_HISTORY

// All fingers in one read, in words that stand for the same in every finger's own block, and what they make together.
// Finger 1 faces all others.
#define FINSIGHT_FINGER(n, address) \
  row::bits(address, "finger_" #n "_status", kStatusBits, "register 0 of finger " #n), \
  row::code(address + 1, "finger_" #n "_fault", kFaults, "register 1"), \
  row::count(address + 2, "finger_" #n "_heartbeat", kUint16, "register 2"), \
  row::measured(address + 3, "finger_" #n "_age", kUint16, 0.1, "ms", "register 3, at this read", "no result yet"), \
  row::measured(address + 4, "finger_" #n "_touch_x", kInt16, 0.01, "mm", "register 5"), \
  row::measured(address + 5, "finger_" #n "_touch_y", kInt16, 0.01, "mm", "register 6"), \
  row::measured(address + 6, "finger_" #n "_touch_z", kInt16, 0.01, "mm", "register 7"), \
  row::measured(address + 7, "finger_" #n "_touch_uncertainty", kUint16, 0.01, "mm", "register 8: radius of 68 %"), \
  row::measured(address + 8, "finger_" #n "_force", kUint16, 0.01, "N", "register 9"), \
  row::measured(address + 9, "finger_" #n "_force_uncertainty", kUint16, 0.01, "N", "register 10"), \
  row::measured(address + 10, "finger_" #n "_level", kUint16, 1, "permille", "register 11"), \
  row::bits(address + 11, "finger_" #n "_limits", kLimitBits, "register 44"), \
  row::measured(address + 12, "finger_" #n "_force_normal", kInt16, 0.01, "N", "register 48"), \
  row::measured(address + 13, "finger_" #n "_force_normal_uncertainty", kUint16, 0.01, "N", "register 51"), \
  row::measured(address + 14, "finger_" #n "_force_across", kInt16, 0.01, "N", "register 49"), \
  row::measured(address + 15, "finger_" #n "_force_along", kInt16, 0.01, "N", "register 50")
inline constexpr RegisterRow kGathered[] = {
    row::count(2000, "fingers", kUint16, "of this device, 1 to 4; those that it lacks have status 0 below"),
    row::bits(2001, "gripper_state", kGripperStates, "of all fingers"),
    row::measured(2002, "oldest_age", kUint16, 0.1, "ms", "greatest age of the fingers' results", "a finger has no result yet"),
    row::measured(2003, "force_sum", kUint16, 0.01, "N", "sum of the fingers' forces; one that is ready and touched too lightly to tell counts as 0", "a finger does not tell its force"),
    row::measured(2004, "force_balance", kInt16, 0.01, "N", "normal force of finger 1, less that of all others, which face it; counted as in force_sum", "a finger does not tell its force"),
    row::measured(2005, "force_balance_uncertainty", kUint16, 0.01, "N", "standard deviation of register 2004, of the touches that count", "a finger does not tell its force"),
    row::measured(2006, "touch_centre_x", kInt16, 0.01, "mm", "mean of the valid touches in the direction of finger 1's x; the others face it, so theirs counts negative", "no touch is valid"),
    row::measured(2007, "touch_centre_y", kInt16, 0.01, "mm", "mean of the valid touches, up from the fingers' bases", "no touch is valid"),
    row::reserved(2008, "reserved_2008"),
    row::reserved(2009, "reserved_2009"),
    FINSIGHT_FINGER(1, 2010), FINSIGHT_FINGER(2, 2026), FINSIGHT_FINGER(3, 2042), FINSIGHT_FINGER(4, 2058),
};
#undef FINSIGHT_FINGER

#define FINSIGHT_FAULT(n, address) \
  row::code(address, "fault_" #n "_code", kFaults, "a fault since the start, the newest first; also one that stands"), \
  row::number(address + 1, "fault_" #n "_began", kUint32, 1, "s", "uptime when it began"), \
  row::measured(address + 3, "fault_" #n "_lasted", kUint16, 1, "s", "how long it stood", "it still stands")
inline constexpr RegisterRow kDiagnostics[] = {
    row::number(3000, "uptime", kUint32, 1, "s", "since the firmware started"),
    row::count(3002, "connections", kUint16, "open now"),
    row::count(3003, "connections_accepted", kUint32, "since the start, like all counters here"),
    row::count(3005, "connections_refused", kUint32, "no place was free, or the address is not allowed"),
    row::count(3007, "connections_replaced", kUint32, "closed in favour of a newcomer"),
    row::count(3009, "requests", kUint32, "answered, on all lines"),
    row::count(3011, "exceptions_function", kUint32, "exception 1"),
    row::count(3013, "exceptions_address", kUint32, "exception 2"),
    row::count(3015, "exceptions_value", kUint32, "exception 3"),
    row::count(3017, "exceptions_locked", kUint32, "exception 4"),
    row::count(3019, "exceptions_busy", kUint32, "exception 6"),
    row::count(3021, "wrong_keys", kUint32, "written to register 1004"),
    row::client(3023, "wrong_key_client", "that wrote the last one"),
    row::measured(3025, "frame_rate", kUint16, 0.01, "Hz", "processed frames, over the last second; 0 in a stall", "not known yet"),
    row::count(3026, "frames_processed", kUint32, ""),
    row::count(3028, "frames_dropped", kUint32, "register 34 without its limit"),
    row::measured(3030, "processor_temperature", kInt16, 0.1, "degC", "", "not known"),
    row::measured(3031, "loop_load", kUint16, 1, "permille", "share of the frame time that the frame loop works, over the last second", "not known: just started, or stalled"),
    row::number(3032, "loop_longest", kUint16, 0.1, "ms", "longest frame since the start"),
    row::count(3033, "camera_losses", kUint16, "times that the camera was lost"),
    row::count(3034, "calibration_date", kUint32, "when lens or mount of this device were last measured, as 20261122; 0: not known"),
    row::count(3036, "pack_checksum", kUint32, "as register 36"),
    row::text(3038, "model_name", "the finger's name in its model pack"),
    row::text(3054, "serial_number", "from the board file, or else the board's own"),
    row::text(3070, "firmware_version", ""),
    row::count(3086, "faults_counted", kUint16, "wraps around"),
    FINSIGHT_FAULT(1, 3087), FINSIGHT_FAULT(2, 3091), FINSIGHT_FAULT(3, 3095), FINSIGHT_FAULT(4, 3099),
    FINSIGHT_FAULT(5, 3103), FINSIGHT_FAULT(6, 3107), FINSIGHT_FAULT(7, 3111), FINSIGHT_FAULT(8, 3115),
    row::count(3119, "pictures_broken", kUint32, "that the camera sent and nobody could decode"),
    row::measured(3121, "camera_rate", kUint16, 0.01, "Hz", "frames that the camera gives, taken or not, over the last two seconds", "not known"),
    row::count(3122, "image_made", kUint32, "when the appliance's image was made, as at the end of its version: 2611222207 of 0.1.0-202611222207; 0: the firmware runs in none"),
    row::code(3124, "image_slot", kImageSlots, "that the appliance runs from: another than before means that it has changed its system"),
};
#undef FINSIGHT_FAULT
// clang-format on

}  // namespace table

/// The whole table: of each finger the measurements, and what is read and written under Control's lock; and the block
/// that gathers all fingers.
struct RegisterTable {
  std::span<const RegisterRow> measurements, control, process, history, gathered, diagnostics;
  constexpr std::array<std::span<const RegisterRow>, 6> blocks() const {
    return {measurements, control, process, history, gathered, diagnostics};
  }
};
inline constexpr RegisterTable kRegisterTable = {table::kMeasurements, table::kControl,  table::kProcess,
                                                 table::kHistory,      table::kGathered, table::kDiagnostics};

// Look-ups by name at compile time: a name that is not in the table does not compile.

consteval const RegisterRow& row_named(std::string_view name) {
  for (const std::span<const RegisterRow> block : kRegisterTable.blocks()) {
    for (const RegisterRow& row : block) {
      if (row.name == name) return row;
    }
  }
  throw "no register of that name";
}

consteval int address_of(std::string_view name) { return row_named(name).address; }

/// The number of a register's code or bit.
consteval std::uint16_t value_named(std::string_view register_name, std::string_view name) {
  for (const NamedValue& value : row_named(register_name).values) {
    if (value.name == name) return value.value;
  }
  throw "this register has no bit or code of that name";
}

/// The mask of a register's bit.
consteval std::uint16_t bit_named(std::string_view register_name, std::string_view name) {
  return static_cast<std::uint16_t>(1U << value_named(register_name, name));
}

inline constexpr int kControlAddress = address_of("command");
inline constexpr int kControlRegisters = static_cast<int>(kRegisterTable.control.size());
enum ControlRegister : int {
  kCommandRegister = address_of("command"),
  kSequenceRegister = address_of("command_sequence"),
  kResultSequenceRegister = address_of("result_sequence"),
  kResultRegister = address_of("result"),
  kKeyRegister = address_of("write_key"),
  kRecordingRegister = address_of("recording"),
  kRefreshRegister = address_of("master_refresh"),
  kExclusiveRegister = address_of("exclusive"),
  kFirstSettingRegister = address_of("contact_on"),
};
inline constexpr int kProcessAddress = address_of("lowpass");
inline constexpr int kProcessBlockRegisters = static_cast<int>(kRegisterTable.process.size());
inline constexpr int kGravityRegister = address_of("gravity_x"), kGravityRegisters = 3;
inline constexpr int kProcessSettings = kGravityRegister - kProcessAddress;
inline constexpr int kProcessValueAddress = address_of("events");  ///< from here on they are in RegisterImage::process
static_assert(kProcessRegisters == kProcessAddress + kProcessBlockRegisters - kProcessValueAddress);

/// Settings are numbered through: those of the control block, then those of the process helpers. -1: no setting's
/// address.
constexpr int setting_at(int address) {
  constexpr int kControlSettings = kControlAddress + kControlRegisters - kFirstSettingRegister;
  if (address >= kProcessAddress && address < kProcessAddress + kProcessSettings) {
    return kControlSettings + address - kProcessAddress;
  }
  const int setting = address - kFirstSettingRegister;
  return setting >= 0 && setting < kControlSettings ? setting : -1;
}

consteval std::uint8_t setting_named(std::string_view name) {
  return static_cast<std::uint8_t>(setting_at(address_of(name)));
}

/// A setting's place among the settings.
enum Setting : std::uint8_t {
  kContactOn = setting_named("contact_on"),
  kContactOff = setting_named("contact_off"),
  kGentleOn = setting_named("gentle_on"),
  kGentleOff = setting_named("gentle_off"),
  kOverloadOn = setting_named("overload_on"),
  kOverloadOff = setting_named("overload_off"),
  kHoldTime = setting_named("hold_time"),
  kAfterHold = setting_named("after_hold"),
  kOutputDebounce = setting_named("output_debounce"),
  kWordOrder = setting_named("word_order"),
  kLight = setting_named("light"),
  kTriggerCommand = setting_named("trigger_command"),
  kMasterTimeout = setting_named("master_timeout"),
  kVerifiedOn = setting_named("verified_on"),
  kVerdict = setting_named("verdict"),
  kVerifyEvery = setting_named("verify_every"),
  kLowpass = setting_named("lowpass"),
  kGripChange = setting_named("grip_change"),
  kSettingCount = kControlAddress + kControlRegisters - kFirstSettingRegister + kProcessSettings
};

/// Blocks beside measurements and control: where each begins and how many registers it has.
constexpr int words_in(std::span<const RegisterRow> block) {
  return block.back().address + words_of(block.back().type) - block.front().address;
}
inline constexpr int kHistoryAddress = address_of("commands_given");
inline constexpr int kHistoryRegisters = words_in(kRegisterTable.history);
inline constexpr int kHistoryEntries = 8;
inline constexpr int kMostFingers = 4;
inline constexpr int kGatheredAddress = address_of("fingers");
inline constexpr int kGatheredRegisters = words_in(kRegisterTable.gathered);
inline constexpr int kFingerStride = address_of("finger_2_status") - address_of("finger_1_status");
inline constexpr int kDiagnosticsAddress = address_of("uptime");
inline constexpr int kDiagnosticsRegisters = words_in(kRegisterTable.diagnostics);
inline constexpr int kFaultEntries = 8;

/// The row of commands, settings and process helpers at this address. All of them are single words, so the index
/// follows from it.
constexpr const RegisterRow& control_row(int address) {
  return address >= kProcessAddress ? kRegisterTable.process[static_cast<std::size_t>(address - kProcessAddress)]
                                    : kRegisterTable.control[static_cast<std::size_t>(address - kControlAddress)];
}
constexpr const RegisterRow& setting_row(int setting) {
  constexpr int kFirstOfProcess = setting_at(kProcessAddress);
  return control_row(setting < kFirstOfProcess ? kFirstSettingRegister + setting
                                               : kProcessAddress + setting - kFirstOfProcess);
}

/// The measurement that the word at this address (below kMeasurementRegisters) belongs to.
constexpr const RegisterRow& measurement_row(int address) {
  const RegisterRow* found = nullptr;
  for (const RegisterRow& row : kRegisterTable.measurements) {
    if (row.address <= address) found = &row;
  }
  return *found;
}

// Without gaps and overlaps; values of a register in rising order.
consteval bool is_well_formed(std::span<const RegisterRow> rows, int first, int end) {
  for (const RegisterRow& row : rows) {
    if (row.address != first) return false;
    first += words_of(row.type);
    for (std::size_t i = 1; i < row.values.size(); ++i) {
      if (row.values[i].value <= row.values[i - 1].value) return false;
    }
  }
  return first == end;
}
static_assert(is_well_formed(kRegisterTable.measurements, 0, kMeasurementRegisters));
static_assert(is_well_formed(kRegisterTable.control, kControlAddress, kControlAddress + kControlRegisters));
static_assert(is_well_formed(kRegisterTable.history, kHistoryAddress, kHistoryAddress + kHistoryRegisters));
static_assert(is_well_formed(kRegisterTable.diagnostics, kDiagnosticsAddress,
                             kDiagnosticsAddress + kDiagnosticsRegisters));
static_assert(is_well_formed(kRegisterTable.gathered, kGatheredAddress, kGatheredAddress + kGatheredRegisters));
static_assert(address_of("finger_4_status") == address_of("finger_1_status") + (kMostFingers - 1) * kFingerStride);
static_assert(kDiagnosticsRegisters <= 125 && kGatheredRegisters <= 125);  // one read shows them all
static_assert(is_well_formed(kRegisterTable.process, kProcessAddress, kProcessAddress + kProcessBlockRegisters));

}  // namespace finsight
