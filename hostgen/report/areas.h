// What the report measures, one function per area. Each returns the figures of its area under the keys of results.json.
#pragma once

#include <filesystem>
#include <nlohmann/json_fwd.hpp>

#include "firmware/model/model.h"
#include "hostgen/fem/dataset.h"

namespace finsight::host {

/// Time per frame of the shape stage against the distance to the converged shape, for fixed schedules and the map, over
/// motions at 60 frames/s; plots speed_error.svg into `folder`. `bench`: the program bench's figures, which become part
/// of the result. `quick`: fewer motions and schedules.
nlohmann::json measure_solver(const Model& model, const nlohmann::json& bench, const std::filesystem::path& folder,
                              bool quick);

/// The table of hard cases on this model. `quick`: a short random walk.
nlohmann::json measure_hard_cases(const Model& model, bool quick);

/// A client's time for one read of 40 registers over loopback, alone and beside a client that sends what is refused.
nlohmann::json measure_modbus(bool quick);

/// Whole-frame time (pixels to registers) over a rendered session.
nlohmann::json measure_vision(const Model& model, const std::filesystem::path& session, bool quick);

/// `built`: the figures of the build. With the finger's spec and states also the paper's table 2, and how well the shape is
/// known at the touched point; null without. Plots touch_error.svg and touch_calibration.svg into `folder`.
nlohmann::json measure_touch(const nlohmann::json& built, const Model& model, const FingerSpec* spec,
                             const FemDataset* dataset, const std::filesystem::path& folder, bool quick);

/// Networks on a CSV of recordings, and its audit with a picture, recordings.svg; without a file the reason.
nlohmann::json measure_real(const Model& model, const std::filesystem::path& recordings,
                            const std::filesystem::path& folder, bool quick);

}  // namespace finsight::host
