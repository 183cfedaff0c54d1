// The checks of Model::open beyond types and shapes of the tensors, one function per part. All throw InputError naming
// the tensor or the key of the metadata, what was found and what was expected. Only for this folder.
#pragma once

#include "firmware/model/model.h"

namespace finsight {

/// Version, header checksum and every tensor's CRC-32; returns the header checksum.
std::uint32_t check_integrity(const SafetensorsFile& file);

/// Indices in range, tets positively oriented, every free node in a tet, a base and three plates.
void check_mesh(const SafetensorsFile& file, const ShapeModel& shape);
/// The plan is a valid elimination of exactly the couplings of the mesh (call after check_mesh).
void check_plan(const SafetensorsFile& file, const ShapeModel& shape);

void check_mount(const SafetensorsFile& file, const MountModel& mount);
void check_prior(const SafetensorsFile& file, const PlatePrior& prior);
void check_self_test_values(const SafetensorsFile& file, const SelfTestModel& self_test);

/// Every value of a tensor within [lowest, highest].
void check_range(const SafetensorsFile& file, const char* name, std::span<const float> values, float lowest,
                 float highest);

}  // namespace finsight
