// What the page stores under page.measured for finsightd's next start: checked by the readers of that start, and
// exchanged as a whole.
#pragma once

#include <array>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "firmware/model/model.h"
#include "firmware/page/request_guard.h"
#include "firmware/settings/settings.h"

namespace finsight::page {

/// What finsightd starts with beside those files, read from where it reads it: that need not be running.
struct FingerAtStart {
  std::string model_name;
  std::uint32_t model_checksum = 0;
  MountModel mount;                 ///< of the model
  float furthest_mm = 0;            ///< of a zero, see ZeroBasis
  int width_px = 0, height_px = 0;  ///< of the pictures; 0: there are none
};
/// Throws InputError where finsightd cannot start either.
FingerAtStart finger_at_start(const Settings& settings);

enum class Part { kLens, kMount, kFit, kState };
inline constexpr std::array kPartFiles = {kMeasuredLens, kMeasuredMount, kMeasuredFit, kImportedState};
inline const char* file_of(Part part) { return kPartFiles[static_cast<std::size_t>(part)]; }

/// Reads the text of a part as finsightd's start does. Throws InputError naming `name`, what was found and expected.
Lens check_lens_text(const std::string& text, const std::string& name, const FingerAtStart& finger);
MeasuredMount check_mount_text(const std::string& text, const std::string& name, const FingerAtStart& finger);
FitValues check_fit_text(const std::string& text, const std::string& name, const FingerAtStart& finger);
/// `mount`: that finsightd will have. Of a state the zero, too, must be usable.
void check_state_text(const std::string& text, const std::string& name, const FingerAtStart& finger,
                      const MeasuredMount& mount);
/// A lens, mount or fit.
void check_part(Part part, const std::string& text, const FingerAtStart& finger);

/// Makes finsightd start again with what is stored now, or says why it may not.
using Restart = std::function<std::optional<Refusal>()>;
struct PartText {
  Part part;
  std::string text;
};
/// Stores all of it in `folder`, or, where the restart is refused or something fails, leaves everything as it was. What
/// was there stays as NAME.former, unless it is the same.
std::optional<Refusal> store_parts(const std::filesystem::path& folder, const std::vector<PartText>& parts,
                                   const Restart& restart);
/// Exchanges what is stored and the former one, if finsightd would start with that; without a former one the board
/// file's is used again. Changes nothing where the restart is refused.
std::optional<Refusal> bring_back(const std::filesystem::path& folder, Part part,
                                  const std::function<FingerAtStart()>& finger, const Restart& restart);

}  // namespace finsight::page
