// The training truth: finite-element states of the touched finger along load paths.
#pragma once

#include <array>
#include <cstdint>
#include <filesystem>
#include <vector>

#include "hostgen/fem/contact.h"
#include "hostgen/finger/mesh.h"

namespace finsight::host {

/// What became of a load.
enum class Outcome : std::uint8_t {
  kEquilibrium = 0,
  kPushedTooFar = 1,   ///< the touched point has moved more than 20 mm (the paper's limit)
  kNoEquilibrium = 2,  ///< the finger snaps through or buckles: no equilibrium that the state before leads to
  kNotConverged = 3,   ///< numerical: no step towards the load converged, however short
};

/// One equilibrium of the touched finger.
struct FemState {
  std::int32_t path = 0;                 ///< index of the touched point; the group key for honest splits
  std::int32_t front_node = 0;           ///< mesh node nearest to the touched point
  float force_n = 0;                     ///< sum of the normal forces
  Vec3f point_mm = Vec3f::Zero();        ///< touched point (centre of pressure) at rest
  Vec3f contact_mm = Vec3f::Zero();      ///< and where it is now
  Vec3f force_vector_n = Vec3f::Zero();  ///< total force: normal, across, along (face_axes at the point)
  Vec3f moment_nmm = Vec3f::Zero();      ///< of all forces about the finger frame's origin
  float spread_mm = 0;                   ///< RMS distance of the pressure from its centre
  std::array<PlateMotion, kPlates> plates;
  float front_rms_mm = 0;  ///< of touch paths only: RMS displacement of the front face (sets hold every node's)
  std::uint8_t scene = 0;  ///< 0: of the plan; else number of the other one, see other_scenes(); or kFirstKept + kind
  std::int32_t step = 0;   ///< of its path, from 0: see LoadPath::contacts_at()
  Outcome outcome =
      Outcome::kEquilibrium;  ///< after a failure the path's higher forces are not tried and carry the same outcome
  /// Equilibria of other loads that are like this one: contacts moved and turned a little, pressed more or less.
  std::vector<FemState> nearby = {};
  bool valid() const { return outcome == Outcome::kEquilibrium; }
};

/// The weakest push that is tried where a finger does not bear those of its spec.
inline constexpr double kWeakestPush_n = 0.05;

/// For FemState::moment_nmm where moments are told in N m.
inline constexpr double kNmmPerNm = 1000;

/// Which loads make a set, and on which mesh. Sets of the same plan are parts of one and can be merged.
struct DatasetPlan {
  int points = 60;              ///< touched points, spread evenly over the front face: one path of forces each
  int forces = 7;               ///< evenly spaced over the spec's range of forces, or over what the path's place bears
  std::string scene = "probe";  ///< of the spec: what touches there
};

/// What a pack for the plan's scene meets as well and must not take for a touch of it: the common scenes after it, for
/// a scene of the spec's own the last two.
std::vector<Scene> other_scenes(const FingerSpec& spec, const DatasetPlan& plan);

/// Touches that no network learns: what its radius is calibrated on. First those of the plan's scene by kind
/// (draw_kind()), then those of the other scenes on the face, each a kind of its own.
inline constexpr std::uint8_t kFirstKept = 100;
/// Of how many kinds.
int kept_kinds(const DatasetPlan& plan);

/// How many states are sought near each, unless it is kept from learning.
inline constexpr int kNearby = 12;

/// Whether every state of a path has contacts of its own. Where a scene knows nothing but frictionless points, the
/// states of a path share theirs: what lies between them can then be interpolated.
bool contacts_change(const Scene& scene);

/// About how far the places of neighbouring paths of the plan's scene are apart.
double spacing_mm(const FingerSpec& spec, int points);

/// A load path: rising forces at and near one place of the face.
struct LoadPath {
  std::vector<std::vector<FaceContact>> contacts;  ///< of each step, or one for all of them
  std::uint8_t scene = 0;                          ///< see FemState
  Scene of;                                        ///< that one
  double spacing_mm = 0;                           ///< to the paths around it
  const std::vector<FaceContact>& contacts_at(std::int32_t step) const {
    return contacts.size() == 1 ? contacts.front() : contacts.at(static_cast<std::size_t>(step));
  }
};
/// All paths of a plan in their order: `plan.points` of its scene, then some of each other scene, then those that are
/// kept from learning. The same arguments give the same contacts.
std::vector<LoadPath> load_paths(const FingerSpec& spec, const DatasetPlan& plan);
/// How many they are.
std::size_t path_count(const DatasetPlan& plan);

/// States of some or all paths of a plan.
struct FemDataset {
  std::string spec_sha256;
  std::vector<FemState> states;             ///< of the plan's scene, ordered by path, then by force
  std::vector<FemState> others = {};        ///< the same of the other scenes; their paths go on counting
  std::vector<FemState> kept = {};          ///< and of what is not learnt
  std::vector<float> node_displacement_mm;  ///< [states][3 * mesh nodes]: displacement of every (corner) mesh node
  std::size_t mesh_nodes = 0;
  DatasetPlan plan = {};
  std::string mesh_sha256 = {};  ///< of the mesh's nodes and tets

  /// States of each outcome.
  std::size_t count(Outcome outcome) const;
};

/// Those of the plan's scene, then the others', then those that are kept.
std::vector<FemState> all_states(const FemDataset& dataset);

/// Shard `index` (from 0) of `count` holds the paths index, index + count, ...; with `only_scene` those of the plan's
/// scene, from which no pack can be trained.
struct Shard {
  int index = 0, count = 1;
  bool only_scene = false;
};

/// Walks the load paths of a shard on all cores, with progress. Deterministic whatever the number of cores or shards.
/// Every finished path is kept as a file in the folder `resume` (made if needed; empty name: nothing is kept), and
/// taken from there when it is asked for again: an interrupted run resumes where it stopped. Files of another spec,
/// mesh or plan are refused with an InputError.
FemDataset make_dataset(const FingerSpec& spec, const TetMesh& mesh, const DatasetPlan& plan, const Shard& shard = {},
                        const std::filesystem::path& resume = {});

/// Same states, same bytes.
void write_dataset(const std::filesystem::path& file, const FemDataset& dataset);
/// Throws InputError.
FemDataset read_dataset(const std::filesystem::path& file);
/// Puts the shards of one plan together, in any order: the same bytes as one run. Throws InputError naming the file if
/// one belongs to another plan, a path comes twice, or one is missing.
FemDataset merge_datasets(const std::vector<std::filesystem::path>& files);
/// Throws InputError naming `file` unless the set was made from this spec and mesh and holds every path of its plan.
void check_complete(const FemDataset& dataset, const FingerSpec& spec, const TetMesh& mesh,
                    const std::filesystem::path& file);

std::string mesh_sha256(const TetMesh& mesh);

}  // namespace finsight::host
