// The names of the bits and codes of registers, for register_table.h. Add values, never change them; the notes are
// prose.
#pragma once

#include "firmware/modbus/register_row.h"

namespace finsight {

inline constexpr NamedValue kStatusBits[] = {
    {0, "ready"},
    {1, "touch_valid"},
    {2, "contact"},
    {3, "shape_valid", "all plates seen"},
    {4, "held", "not from the latest frame"},
    {5, "top_plate_seen"},
    {6, "middle_plate_seen"},
    {7, "low_plate_seen"},
    {8, "zeroed"},
    {9, "over_range", "bent beyond any touch of the training data"},
    {10, "camera_fault"},
    {11, "solver_fallback", "the shape map stands in for the solver"},
    {12, "settings_unsaved"},
    {13, "unexplained", "no touch of the pack's scene (80) moves the plates so: not two contacts nor pushes at a side"},
    {14, "overload"},
    {15, "any_fault"},
};

inline constexpr NamedValue kImageSlots[] = {
    {0, "none", "the firmware runs in no image of an appliance"},
    {1, "a"},
    {2, "b"},
};

inline constexpr NamedValue kFaults[] = {
    {0, "none"},
    {1, "camera_lost"},
    {2, "markers_lost"},
    {3, "solver_failed"},
    {4, "self_test_failed", "safe mode"},
    {5, "settings_or_model_refused", "safe mode"},
    {6, "failed_repeatedly", "safe mode"},
    {7, "saved_settings_refused", "or the saved zero; factory values are in use; cleared by command 3"},
    {8, "stalled", "no new result; no value is valid, or the last ones stay as held ones where setting 1017 says so"},
    {9, "camera_frozen", "repeats the same image"},
    {10, "image_too_dark"},
    {11, "image_too_bright"},
    {12, "image_out_of_focus"},
    {13, "camera_moved", "relative to the finger; correct its mount, then zero"},
    {14, "master_lost", "register 1006 was not written within setting 1022; ends when it is written"},
};

inline constexpr NamedValue kShapeSources[] = {
    {0, "at_rest"},
    {1, "shape_map"},
    {2, "newton_solve"},
    {3, "contact_aware_map"},
};

inline constexpr NamedValue kLimitBits[] = {
    {0, "contact"},
    {1, "gentle", "an object is gripped"},
    {2, "overload"},
};

inline constexpr NamedValue kWarnings[] = {
    {0, "camera_slow", "gives less than half of the wanted frames per second"},
    {1, "pictures_broken", "in the last two seconds; they were left out"},
    {2, "not_verified", "no verification was passed, or it is older than setting 1027"},
};

inline constexpr NamedValue kVerdicts[] = {
    {0, "none"},
    {1, "passed"},
    {2, "failed"},
};

inline constexpr NamedValue kCommands[] = {
    {0, "none"},
    {1, "zero", "the finger's present pose becomes its rest pose"},
    {2, "save", "settings and zero"},
    {3, "clear", "the fault"},
    {4, "record", "a session"},
    {5, "stop", "recording"},
    {6, "reset", "restarts half a second later"},
    {7, "factory", "factory settings and no zero; not saved"},
    {8, "tare_force", "register 1120 counts from its present value"},
    {9, "tare_deformation", "register 1121 counts from its present value"},
    {10, "tare_touch", "registers 1122 to 1124 count from their present values"},
    {11, "clear_tare", "of all values"},
    {12, "reset_peaks", "and minima, registers 1125 to 1134"},
    {13, "reset_events", "and their counters, registers 1110 to 1114"},
    {14, "zero_all", "zero, of all fingers of the device; done when every one is"},
};

inline constexpr NamedValue kResults[] = {
    {0, "done"},
    {1, "not_possible",
     "zero: a plate is missing, moving or too far off; tare: the value is not valid; record: already recording, or no "
     "room"},
    {2, "not_configured", "the board file names no folder or file for it"},
    {3, "failed", "disk error"},
};

inline constexpr NamedValue kHistoryResults[] = {
    {0, "done"}, {1, "not_possible"}, {2, "not_configured"}, {3, "failed"}, {4, "running", "or about to"},
};

inline constexpr NamedValue kRecordingStates[] = {
    {0, "idle"},
    {1, "recording"},
    {2, "failed", "the last recording; disk error; replay takes what was written"},
    {3, "full", "the last recording ended at its greatest length or at the disk's reserve; it is complete"},
};

inline constexpr NamedValue kScenes[] = {
    {0, "own", "a scene of the finger's own spec"},
    {1, "probe", "one push at a point, without friction"},
    {2, "grasp", "one contact with friction, at a point, over a patch or along a line"},
    {3, "two", "two contacts such as those of grasp"},
};

inline constexpr NamedValue kAfterHoldCodes[] = {
    {0, "invalidate", "all values become invalid"},
    {1, "keep", "the last values stay, marked as held"},
};

inline constexpr NamedValue kWordOrders[] = {
    {0, "ABCD", "high word first"},
    {1, "CDAB", "low word first"},
};

inline constexpr NamedValue kSwitch[] = {
    {0, "off"},
    {1, "on"},
};

inline constexpr NamedValue kEvents[] = {
    {0, "contact_made"},
    {1, "contact_lost"},
    {2, "overload", "or over range"},
    {3, "grip_changed"},
};

inline constexpr NamedValue kProcessStates[] = {
    {0, "force_tared"},
    {1, "deformation_tared"},
    {2, "touch_tared"},
    {3, "grip_steady", "gripped, and compared with how it was when it came to rest"},
};

inline constexpr NamedValue kGripperStates[] = {
    {0, "all_ready", "every finger is ready and has no fault"},
    {1, "all_touch_valid"},
    {2, "any_contact"},
    {3, "all_contact"},
    {4, "any_overload", "or over range"},
    {5, "any_held"},
    {15, "any_fault"},
};

}  // namespace finsight
