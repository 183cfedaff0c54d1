// What the report measures of accuracy, one function per area. Each returns the figures of its area under the keys of
// results.json.
#pragma once

#include <filesystem>
#include <nlohmann/json_fwd.hpp>

#include "firmware/model/model.h"
#include "hostgen/fem/dataset.h"
#include "hostgen/finger/spec.h"

namespace finsight::host {

/// The training truth: `built`, its figures from hostgen build, with the comparison with CalculiX on three loads per
/// kind of element and the table of locking over mesh sizes. `quick`: coarse mesh, one load. Without ccx the difference
/// is null.
nlohmann::json measure_fem(const std::filesystem::path& spec, const nlohmann::json& built, bool quick);

/// Rendered images of one touch path, by preset and image size, through the firmware's stages: touch, force and
/// level errors and coverage by plate motion, flips, false touches, whole-frame time; the joint estimate beside the
/// paper's. The paper's four paths over their truth in paths.svg in `folder`; errors of the corners.
/// `quick`: 4 seconds of the larger images instead of 24 of both.
nlohmann::json measure_vision(const Model& model, const FingerSpec& spec, const std::filesystem::path& folder,
                              bool quick);

/// One row for each trouble that pictures have (image_presets()) and for JPEG of quality 60, 75 and 90: touches of the
/// pack's scene, one picture of each, in 640x480, by registers, from 4 mm of plate motion on, with a zero, without one
/// and with a measured mount. Then rows read over 10 and 20 ms: one frictionless touch that wanders fast. `quick`: 40
/// touches and 1.2 seconds instead of 400 and 16.
nlohmann::json measure_pictures(const Model& model, const FingerSpec& spec, bool quick);

/// Bias (away from the marker's centre) and RMS error (per coordinate) of the corners in rendered images, one row per
/// condition: distance, tilt, blur, noise, light, preset; the firmware's edges beside OpenCV's cornerSubPix.
nlohmann::json measure_corners(const FingerSpec& spec, bool quick);

/// `built`: the figures of the build. With the finger's spec and states also the paper's table 2, how well the shape is
/// known at the touched point, and touch errors over the face and by plate motion on new states; null without.
nlohmann::json measure_touch(const nlohmann::json& built, const Model& model, const FingerSpec* spec,
                             const FemDataset* dataset, bool quick);

/// The pack's touches in every case that a gripper brings (scene_cases.h): share published, errors, coverage, what is
/// unexplained; and what plate motions can tell at best. Plots scene_faces.svg into `folder`.
/// `quick`: a fifth of the states.
nlohmann::json measure_scenes(const Model& model, const FingerSpec& spec, const std::filesystem::path& folder,
                              bool quick);

/// Virtual fingers (render/virtual_finger.h), from number `first` on, before and after a fit with a weight at each hole
/// of the jig: errors of force and touch at so many other places of each, what the device says of them, and drift; and
/// the same with one part of the fit left out each. Plots fit.svg into `folder`.
nlohmann::json measure_fits(const Model& model, const FingerSpec& spec, const std::filesystem::path& folder,
                            int fingers, int places, std::uint64_t first);
/// The fingers of the report: 50, with 12 places each; `quick`: 2, with 6.
nlohmann::json measure_fits(const Model& model, const FingerSpec& spec, const std::filesystem::path& folder,
                            bool quick);

/// Networks on a CSV of recordings, and its audit with an image, recordings.svg; without a file only the reason.
nlohmann::json measure_real(const Model& model, const std::filesystem::path& recordings,
                            const std::filesystem::path& folder, bool quick);

/// Contact forces of four touches (a point, two, a pressure, the edge) from noisy plate motions: Gauss-Newton beside
/// the paper's L-BFGS, and how often the stated uncertainty holds the truth.
/// `quick`: 10 draws of the noise instead of 100, 5 iterations of L-BFGS instead of 200.
nlohmann::json measure_force(const FingerSpec& spec, bool quick);

}  // namespace finsight::host
