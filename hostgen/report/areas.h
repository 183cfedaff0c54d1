// What the report measures, one function per area. Each returns the figures of its area under the keys of results.json.
#pragma once

#include <filesystem>
#include <nlohmann/json_fwd.hpp>

#include "firmware/model/model.h"

namespace finsight::host {

/// Time per frame of the shape stage against the distance to the converged shape, for fixed schedules and the map, over
/// motions at 60 frames/s; plots speed_error.svg into `folder`. `bench`: the program bench's figures, which become part
/// of the result. `quick`: fewer motions and schedules.
nlohmann::json measure_solver(const Model& model, const nlohmann::json& bench, const std::filesystem::path& folder,
                              bool quick);

/// The table of hard cases on this model. `quick`: a short random walk.
nlohmann::json measure_hard_cases(const Model& model, bool quick);

/// The training truth: `built`, its figures from hostgen build, with the comparison with CalculiX on three loads per kind
/// of element and the table of locking over mesh sizes. `quick`: coarse mesh, one load. Without ccx the difference is null.
nlohmann::json measure_fem(const std::filesystem::path& spec, const nlohmann::json& built, bool quick);

/// A client's time for one read of 40 registers over loopback, alone and beside a client that sends what is refused.
nlohmann::json measure_modbus(bool quick);

/// Whole-frame time (pixels to registers) over a rendered session.
nlohmann::json measure_vision(const Model& model, const std::filesystem::path& session, bool quick);

}  // namespace finsight::host
