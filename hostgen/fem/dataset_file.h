// What making a training set and putting shards together share.
#pragma once

#include "hostgen/fem/dataset.h"

namespace finsight::host {

/// Those of the plan's scene, of the others or of the kept touches: where such a state belongs.
std::vector<FemState>& states_of_scene(FemDataset& dataset, std::uint8_t scene);
/// Adds the states of `part` behind those of `whole`.
void append(const FemDataset& part, FemDataset& whole);
/// Throws InputError unless both belong to the same spec, mesh and plan.
void check_same_plan(const FemDataset& expected, const FemDataset& found, const std::filesystem::path& file);

}  // namespace finsight::host
