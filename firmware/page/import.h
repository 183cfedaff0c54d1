// A device's settings, lens, mount, fit and zero as one file: out of one device, into it again or into one with the
// same pack.
#pragma once

#include <nlohmann/json.hpp>
#include <optional>
#include <string>

#include "firmware/page/measured_files.h"
#include "firmware/page/request_guard.h"
#include "firmware/published/block.h"

namespace finsight::page {

/// `about`: of the block, with lens, mount and fit. `frame`: with the zero, if there is one.
nlohmann::json export_file(const nlohmann::json& settings, const nlohmann::json& about,
                           const std::optional<PublishedFrame>& frame);

/// Reads what export_file() wrote: what is to be stored for `finger`. Any JSON whatever; a refusal names the field,
/// what was found and what was expected. Every setting and part must be there; a part that is null (the other device
/// has no fit, say) stays here as it is, and without a zero this finger is not zeroed. What is taken, finsightd starts
/// with: it has been read as its start does.
std::optional<Refusal> read_import(const nlohmann::json& file, const FingerAtStart& finger,
                                   std::vector<PartText>& import);

}  // namespace finsight::page
