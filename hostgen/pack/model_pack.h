// Writes the model pack: what hostgen computed, in the form that the firmware's Model::open accepts.
#pragma once

#include <filesystem>
#include <map>
#include <string>

#include "firmware/model/model.h"
#include "hostgen/pack/tensor_file.h"

namespace finsight::host {

/// All parts of a pack. The views must stay valid while it is written; shape.free_index is not written (the reader
/// derives it from node_kind).
struct PackViews {
  std::string finger_name, scene, spec_sha256, hostgen_version;
  float rated_deformation_mm = 0;
  std::map<std::string, std::string> notes;  ///< more metadata for people, such as scores; the firmware ignores them
  MountModel mount;
  PlatePrior prior;
  ShapeModel shape;
  ShapeMapModel shape_map, contact_map;  ///< no contact map: a pack as older versions wrote it
  TouchModel touch;
  SelfTestModel self_test;
};

/// The pack's tensors and metadata, without checksums.
TensorFile pack_tensors(const PackViews& views);

/// The bytes of the file with the CRC-32 of every tensor and of the header in its metadata. Same tensors, same bytes.
std::string sealed_bytes(TensorFile tensors);

/// Writes the pack, reads it back with Model::open, and only then gives it its name: `file` is never a pack that the
/// firmware would refuse. Throws InputError (what the firmware refuses) and std::system_error.
void write_model_pack(const std::filesystem::path& file, const PackViews& views);

/// What a person wants to know about a pack, as text.
std::string describe_model_pack(const Model& model);

}  // namespace finsight::host
