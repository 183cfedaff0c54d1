// What `hostgen build` measured while it made a pack, kept beside the pack (as PACK.build.json without the pack's own
// ending) because times do not belong in a file whose bytes must be the same on every machine.
#pragma once

#include <filesystem>
#include <nlohmann/json_fwd.hpp>
#include <string>

#include "hostgen/fem/deformation.h"
#include "hostgen/learn/touch_training.h"

namespace finsight::host {

struct BuildFigures {
  std::string profile;
  std::size_t fem_states = 0, fem_too_far = 0, fem_failed = 0;
  double fem_seconds = 0, fem_cpu_seconds = 0;  ///< 0: the states were read from a file
  DeformationRise deformation = {};
  double rated_deformation_mm = 0;
  double training_seconds = 0;
  const TouchTraining* touch = nullptr;
};

std::filesystem::path build_figures_path(const std::filesystem::path& pack);
void write_build_figures(const std::filesystem::path& pack, const BuildFigures& figures);
/// Keys "profile", "fem" and "touch" as in results.json. Throws InputError if the file is missing.
nlohmann::json read_build_figures(const std::filesystem::path& pack);

}  // namespace finsight::host
