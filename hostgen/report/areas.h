// What the report measures of speed and stability, one function per area; of accuracy: accuracy/areas.h. Each returns
// the figures of its area under the keys of results.json.
#pragma once

#include <filesystem>
#include <nlohmann/json_fwd.hpp>

#include "firmware/model/model.h"

namespace finsight::host {

/// Time per frame of the shape stage against the distance to the converged shape, for fixed schedules and the map, over
/// motions at 60 frames/s. `bench`: figures of the program bench, added to the result. `quick`: fewer motions and
/// schedules.
nlohmann::json measure_solver(const Model& model, const nlohmann::json& bench, bool quick);

/// The table of hard cases on this model, a random search for new ones with the worst it found, and hard_states.json in
/// `folder`, the shapes of the ten worst cases. `quick`: a short random walk, 50 random motions instead of 10,000.
nlohmann::json measure_hard_cases(const Model& model, const std::filesystem::path& folder, bool quick);

/// Time of one client's read of 48 registers over loopback, alone and beside a client whose requests are refused.
nlohmann::json measure_modbus(bool quick);

}  // namespace finsight::host
