// The published deformation against the finite-element shape, by shape tier.
#pragma once

#include <nlohmann/json_fwd.hpp>

#include "firmware/model/model.h"
#include "hostgen/finger/spec.h"
#include "hostgen/accuracy/scene_cases.h"

namespace finsight::host {

/// Every state once with the spec's noise through each tier that the pack has, by itself. Per tier: `level_bias` and
/// `level_95` of the deformation (register 28; 11 is the same, relative to the rated deformation), relative to the
/// truth; `largest_bias_mm` and `largest_95_mm` of the largest displacement (12); `us`, the median time.
nlohmann::json compare_shapes(const Model& model, const FingerSpec& spec, const std::vector<CaseState>& states);

}  // namespace finsight::host
