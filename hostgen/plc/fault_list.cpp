// What to do about each fault, for people at the machine.
#include <algorithm>
#include <iterator>
#include <sstream>

#include "hostgen/plc/plc_files.h"
#include "hostgen/plc/row_text.h"

namespace finsight::host {

namespace {

struct Advice {
  std::uint16_t fault;
  const char* cause;
  const char* values;  ///< what happens to the measurements
  const char* ends;    ///< by itself, or by what
  const char* remedy;
};

constexpr const char* kHeldThenInvalid = "held for setting 1016, then not valid";

constexpr Advice kAdvice[] = {
    {value_named("fault", "camera_lost"), "no image comes: cable, plug, power, or the camera itself", kHeldThenInvalid,
     "by itself, with the next image", "check the cable; the device looks for the camera all the time"},
    {value_named("fault", "markers_lost"), "no marker is seen: covered, dirty, light off, finger missing",
     kHeldThenInvalid, "by itself, when a marker is seen",
     "light on (1020)? Clean the finger's inside; look at the picture on the device's page"},
    {value_named("fault", "solver_failed"), "the shape could not be solved in this frame",
     "from the shape map, marked as held", "by itself, mostly with the next frame",
     "if it lasts, the finger is bent beyond its range or damaged"},
    {value_named("fault", "self_test_failed"), "model and firmware do not belong together, or memory is faulty",
     "never valid", "by a restart that succeeds", "install model and firmware again"},
    {value_named("fault", "settings_or_model_refused"), "a file of settings or the model is missing or wrong",
     "never valid", "by a restart that succeeds", "the device's log names file, line and key"},
    {value_named("fault", "failed_repeatedly"), "the firmware ended several times in a row", "never valid",
     "by a restart that succeeds", "read the device's log; send it to us"},
    {value_named("fault", "saved_settings_refused"),
     "the saved settings or the saved zero are damaged, or belong to another finger or mount",
     "valid, with factory settings or without a zero", "command 3 (clear)", "set, zero and save again, then clear"},
    {value_named("fault", "stalled"), "no new result comes, though the device answers",
     "not valid, in the same answer; held where setting 1017 says keep", "by itself, or by the watchdog's restart",
     "read the diagnostics (3000 on) and the log"},
    {value_named("fault", "camera_frozen"), "the camera sends the same image again and again", kHeldThenInvalid,
     "by itself, when images change", "switch the camera off and on"},
    {value_named("fault", "image_too_dark"), "light off or failed", kHeldThenInvalid, "by itself", "light on (1020)?"},
    {value_named("fault", "image_too_bright"), "light from outside, or the exposure was changed", kHeldThenInvalid,
     "by itself", "shade the finger; check the board file's exposure"},
    {value_named("fault", "image_out_of_focus"), "lens dirty, loose or wet", "from the markers that are seen",
     "by itself", "clean and fasten the lens"},
    {value_named("fault", "camera_moved"), "camera or finger were knocked in their holder",
     "touch and force not valid; the shape is wrong", "by itself, when they stand as before",
     "fasten them, correct the mount (set-up on the device's page, or `hostgen mount`), then command 1 (zero) and 2 (save)"},
    {value_named("fault", "master_lost"), "the master has not written register 1006 in time (setting 1022)", "go on",
     "by itself, when 1006 is written", "let the PLC write 1006 again; on exception 4 the key first"},
};
static_assert([] {
  for (const NamedValue& fault : row_named("fault").values) {
    if (fault.value != 0 && std::ranges::count(kAdvice, fault.value, &Advice::fault) != 1) return false;
  }
  return std::size(kAdvice) + 1 == row_named("fault").values.size();
}());

}  // namespace

std::string faults_markdown(const RegisterTable& table) {
  std::ostringstream text;
  text << "| fault | name | cause | touch, force and shape | ends | what to do |\n|---|---|---|---|---|---|\n";
  for (const Advice& advice : kAdvice) {
    const auto& faults = table.measurements[1].values;
    const auto fault = std::ranges::find(faults, advice.fault, &NamedValue::value);
    text << "| " << advice.fault << " | " << label_of(*fault) << " | " << advice.cause << " | " << advice.values
         << " | " << advice.ends << " | " << advice.remedy << " |\n";
  }
  return text.str();
}

}  // namespace finsight::host
