// The training truth: finite-element states of the touched finger along load paths.
#pragma once

#include <array>
#include <cstdint>
#include <filesystem>
#include <vector>

#include "hostgen/finger/mesh.h"

namespace finsight::host {

/// One equilibrium: the finger touched at one point with one force.
struct FemState {
  std::int32_t path = 0;       ///< index of the touched point; the group key for honest splits
  std::int32_t front_node = 0; ///< mesh node nearest to the touched point
  float force_n = 0;           ///< along the inward normal of the undeformed front face
  Vec3f point_mm = Vec3f::Zero();    ///< touched point at rest
  Vec3f contact_mm = Vec3f::Zero();  ///< and where it is now
  std::array<PlateMotion, kPlates> plates;
  bool valid = true;           ///< false: not converged, snapped through or pushed beyond the limit
};

struct FemDataset {
  std::string spec_sha256;
  std::vector<FemState> states;          ///< ordered by path, then by force
  std::vector<float> node_displacement_mm;  ///< [states][3 * mesh nodes]: displacement of every (corner) mesh node
  std::size_t mesh_nodes = 0;
};

struct DatasetPlan {
  int points = 60;  ///< touched points, spread evenly over the front face
  int forces = 7;   ///< evenly spaced over the spec's range of forces
};

/// Walks all load paths on all cores, with progress. Deterministic whatever the number of cores.
FemDataset make_dataset(const FingerSpec& spec, const TetMesh& mesh, const DatasetPlan& plan);

void write_dataset(const std::filesystem::path& file, const FemDataset& dataset);
/// Throws InputError.
FemDataset read_dataset(const std::filesystem::path& file);

}  // namespace finsight::host
