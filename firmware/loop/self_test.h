// Plate poses with the answers that every build of the firmware must give: run by hostgen when it writes a pack, and by
// the board at every start.
#pragma once

#include <array>
#include <vector>

#include "firmware/input_error.h"
#include "firmware/model/model.h"
#include "firmware/shape/shape_stage.h"

namespace finsight {

struct SelfTestAnswer {
  std::vector<float> shape_mm;   ///< [3 * nodes]
  std::array<float, 7> touch{};  ///< point, contact, force
  RegisterImage registers;
};

/// All three plates seen at these 18 numbers, cold start. A pack holds the answers of the default settings and,
/// if it has a contact map, those of tier kContact.
SelfTestAnswer answer_self_test(const Model& model, std::span<const float> numbers, const ShapeSettings& settings = {});

/// Largest differences between two correct builds: they round differently on different processors.
inline constexpr float kSelfTestShapeTolerance_mm = 1e-3F;
inline constexpr float kSelfTestTouchTolerance = 1e-2F;  ///< mm and N
inline constexpr int kSelfTestRegisterTolerance = 1;     ///< counts; bits and codes must be equal

/// This build on this processor gives other answers than the pack expects.
struct SelfTestError : InputError {
  using InputError::InputError;
};

/// Of the pack's answers those of the tier that is to run (chosen_tier()): kContact's, or the default settings' for
/// every other. Throws SelfTestError naming the case, what was found and what was expected.
void check_self_test(const Model& model, ShapeSettings::Tier tier);

}  // namespace finsight
