#include "firmware/page/measured_files.h"

#include <fstream>
#include <iterator>
#include <system_error>
#include <utility>

#include "firmware/calibrate/lens_calibration.h"
#include "firmware/input_error.h"
#include "firmware/ports/session.h"
#include "firmware/settings/atomic_file.h"
#include "firmware/settings/measured_fit.h"
#include "firmware/settings/state_text.h"
#include "firmware/vision/marker_stage.h"

namespace finsight::page {

namespace {

namespace fs = std::filesystem;

/// Renames of files that can be taken back. Throws std::system_error where one fails.
class Renames {
 public:
  void rename(const fs::path& from, const fs::path& to) {
    if (!fs::exists(from)) return;
    fs::rename(from, to);
    done_.emplace_back(from, to);
  }
  void undo() {
    std::error_code ignored;
    for (auto it = done_.rbegin(); it != done_.rend(); ++it) fs::rename(it->second, it->first, ignored);
    done_.clear();
  }

 private:
  std::vector<std::pair<fs::path, fs::path>> done_;
};

fs::path with(fs::path file, const char* ending) { return file += ending; }
fs::path former_of(const fs::path& file) { return with(file, ".former"); }
fs::path before_of(const fs::path& file) { return with(file, ".before"); }
fs::path fresh_of(const fs::path& file) { return with(file, ".new"); }

std::string text_of(const fs::path& file) {
  std::ifstream in(file, std::ios::binary);
  return {std::istreambuf_iterator<char>(in), {}};
}

/// Renames files and restarts finsightd, or leaves them as they were.
std::optional<Refusal> exchange(const fs::path& folder, const std::function<void(Renames&)>& change,
                                const Restart& restart) {
  Renames renames;
  std::optional<Refusal> refusal;
  try {
    change(renames);
    if (fs::exists(folder)) sync_folder(folder);
    refusal = restart();
  } catch (const std::system_error& error) {
    refusal = Refusal{500, std::string("It cannot be stored: ") + error.what() + "."};
  }
  if (refusal) renames.undo();
  return refusal;
}

}  // namespace

FingerAtStart finger_at_start(const Settings& settings) {
  const Model model = Model::open(settings.pack);
  FingerAtStart finger{.model_name = model.finger_name,
                       .model_checksum = model.checksum,
                       .mount = model.mount,
                       .furthest_mm = model.touch.threshold_mm};
  if (settings.source == Settings::Source::kCamera) {
    finger.width_px = settings.camera.width_px;
    finger.height_px = settings.camera.height_px;
  } else if (settings.source == Settings::Source::kSession) {
    const Lens lens = read_session_info(settings.replay.path).lens;
    finger.width_px = lens.width_px;
    finger.height_px = lens.height_px;
  }
  return finger;
}

Lens check_lens_text(const std::string& text, const std::string& name, const FingerAtStart& finger) {
  if (finger.width_px == 0) throw InputError(name, "lens", "a lens", "none: this device has no pictures");
  return read_lens_text(text, name, finger.width_px, finger.height_px);
}

MeasuredMount check_mount_text(const std::string& text, const std::string& name, const FingerAtStart& finger) {
  MeasuredMount measured = read_measured_mount(TomlTable::parse_text(text, name));
  const MountModel mount = corrected_mount(finger.mount, measured);
  // The loop refuses markers that are not in front of the camera; whatever lens it has.
  constexpr Lens kAny{.width_px = 640, .height_px = 480, .fx = 640, .fy = 640, .cx = 320, .cy = 240};
  const MarkerStage stage(mount, kAny);
  return measured;
}

FitValues check_fit_text(const std::string& text, const std::string& name, const FingerAtStart& finger) {
  FitValues fit = read_measured_fit(TomlTable::parse_text(text, name));
  check_fit(fit, finger.model_checksum, name);
  return fit;
}

void check_state_text(const std::string& text, const std::string& name, const FingerAtStart& finger,
                      const MeasuredMount& mount) {
  const ZeroBasis basis{finger.model_checksum, mount, finger.furthest_mm};
  const LoadedState state = read_state(TomlTable::parse_text(text, name), name, &basis);
  if (!state.problem.empty()) throw InputError("import", state.problem);
}

void check_part(Part part, const std::string& text, const FingerAtStart& finger) {
  if (part == Part::kLens) check_lens_text(text, file_of(part), finger);
  if (part == Part::kMount) check_mount_text(text, file_of(part), finger);
  if (part == Part::kFit) check_fit_text(text, file_of(part), finger);
}

std::optional<Refusal> store_parts(const fs::path& folder, const std::vector<PartText>& parts, const Restart& restart) {
  const auto change = [&](Renames& renames) {
    for (const auto& [part, text] : parts) write_file_atomically(fresh_of(folder / file_of(part)), text);
    for (const auto& [part, text] : parts) {  // what can fail came first; now only names change
      const fs::path file = folder / file_of(part);
      if (text_of(file) == text) continue;  // the former one is still another
      renames.rename(former_of(file), before_of(file));
      renames.rename(file, former_of(file));
      renames.rename(fresh_of(file), file);
    }
  };
  auto refusal = exchange(folder, change, restart);
  std::error_code ignored;
  for (const auto& [part, text] : parts) {
    fs::remove(fresh_of(folder / file_of(part)), ignored);
    if (!refusal) fs::remove(before_of(folder / file_of(part)), ignored);
  }
  return refusal;
}

std::optional<Refusal> bring_back(const fs::path& folder, Part part, const std::function<FingerAtStart()>& finger,
                                  const Restart& restart) {
  const fs::path file = folder / file_of(part), former = former_of(file);
  std::error_code ignored;
  const bool has_former = fs::exists(former, ignored);
  if (!has_former && !fs::exists(file, ignored)) {
    return Refusal{409, "Nothing has been measured on this page before."};
  }
  try {
    if (has_former) check_part(part, text_of(former), finger());
  } catch (const InputError& error) {
    return Refusal{409, std::string("The former one cannot be used: ") + error.what() + "."};
  }
  const auto change = [&](Renames& renames) {
    renames.rename(file, before_of(file));
    renames.rename(former, file);
    renames.rename(before_of(file), former);
  };
  return exchange(folder, change, restart);
}

}  // namespace finsight::page
