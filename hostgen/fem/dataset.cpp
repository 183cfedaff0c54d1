#include "hostgen/fem/dataset.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>

#include "firmware/input_error.h"
#include "hostgen/fem/dataset_file.h"
#include "hostgen/fem/scene_contacts.h"
#include "hostgen/fem/statics.h"
#include "hostgen/util/common.h"

namespace finsight::host {

namespace {

// Fingers are so many times softer or stiffer than their spec's, and bend as it does under more or less force. They
// must not meet the end of what was learnt, and the radii of their touches must hold as well.
constexpr double kStiffness = 1.25;

std::int32_t nearest_front_node(const TetMesh& mesh, const Vec3f& point_mm) {
  std::int32_t nearest = -1;
  double nearest_sq = std::numeric_limits<double>::max();
  for (const int node : mesh.front_nodes) {
    const auto& at = mesh.node_mm[static_cast<std::size_t>(node)];
    const double distance_sq = (Eigen::Map<const Eigen::Vector3d>(at.data()) - point_mm.cast<double>()).squaredNorm();
    if (distance_sq < nearest_sq) {
      nearest_sq = distance_sq;
      nearest = node;
    }
  }
  return nearest;
}

/// A set without states: what its shards and paths have in common.
FemDataset empty_set(const FingerSpec& spec, const TetMesh& mesh, const DatasetPlan& plan) {
  return {.spec_sha256 = spec.sha256,
          .states = {},
          .others = {},
          .kept = {},
          .node_displacement_mm = {},
          .mesh_nodes = mesh.node_mm.size(),
          .plan = plan,
          .mesh_sha256 = mesh_sha256(mesh)};
}

/// The forces of a path: the range; where the finger does not bear the lowest of them, up to what it bears of
/// half of that, a quarter ..., down to kWeakestPush_n. Leaves the finger at the lowest, or at rest.
std::array<double, 2> path_range(FingerStatics& statics, const LoadPath& load, const std::array<double, 2>& range_n) {
  const auto bears = [&](double force_n) {
    statics.begin(load.contacts_at(0));
    return statics.press(force_n) && statics.state().valid();
  };
  if (bears(range_n[0])) return range_n;
  std::array<double, 2> found_n = range_n;
  for (double top_n = range_n[0] / 2; top_n >= kWeakestPush_n; top_n /= 2) {
    if (!bears(top_n)) continue;
    found_n = {std::max(kWeakestPush_n, top_n * range_n[0] / range_n[1]), top_n};
    break;
  }
  statics.begin(load.contacts_at(0));
  return found_n;
}

/// Loads like the state's own, of the path's scene: moved by about as much as neighbouring states of the set differ,
/// and pressed by a force of the range.
std::vector<FingerStatics::OtherLoad> nearby_loads(const FingerSpec& spec, const LoadPath& load, std::int32_t step,
                                                   const std::array<double, 2>& range_n, int count, Random& random) {
  // Paths whose contacts change lie among each other.
  const double distance_mm = load.contacts.size() > 1 ? 0.5 * load.spacing_mm : load.spacing_mm;
  std::vector<FingerStatics::OtherLoad> loads;
  for (int i = 0; i < count; ++i) {
    FingerStatics::OtherLoad other{.contacts = {}, .normal_n = random.uniform(range_n[0], range_n[1])};
    for (const FaceContact& contact : load.contacts_at(step)) {
      other.contacts.push_back(vary(spec, load.of, contact, distance_mm, random));
    }
    loads.push_back(std::move(other));
  }
  return loads;
}

/// Near the present state, which is the path's at `step`; after its last step also up to kStiffness times its force.
/// The finger may then stand there.
std::vector<FemState> states_nearby(FingerStatics& statics, const FingerSpec& spec, const LoadPath& load,
                                    std::int32_t step, int forces, double step_n, Random& random) {
  constexpr double kBeyond = 0.5 * (1 + kStiffness);  // of that range the middle
  const auto force_n = static_cast<double>(statics.state().force_n);
  const std::array<double, 2> around_n = {step == 0 ? 0 : force_n - 0.5 * step_n, force_n + 0.5 * step_n};
  std::vector<FemState> nearby = statics.nearby(nearby_loads(spec, load, step, around_n, kNearby, random));
  if (step + 1 == forces && statics.press(kBeyond * force_n) && statics.state().valid()) {
    const std::array<double, 2> beyond_n = {force_n, kStiffness * force_n};
    for (FemState& state : statics.nearby(nearby_loads(spec, load, step, beyond_n, kNearby, random))) {
      nearby.push_back(state);
    }
  }
  std::erase_if(nearby, [](const FemState& state) { return !state.valid(); });
  return nearby;
}

// A force that finds no equilibrium or pushes too far keeps its place in the set, marked as not valid, with the last
// state that was found; so do the higher forces of its path, which are not tried.
void walk_path(FingerStatics& statics, const FingerSpec& spec, const TetMesh& mesh, const LoadPath& load,
               std::int32_t index, FemDataset& path) {
  Random random(0xa11'0000 + static_cast<std::uint64_t>(index));
  const bool is_kept = load.scene >= kFirstKept;
  const double stiffness = is_kept ? std::exp(random.uniform(-1, 1) * std::log(kStiffness)) : 1;
  const std::array<double, 2> range_n =
      path_range(statics, load, {spec.force_n[0] / stiffness, spec.force_n[1] / stiffness});
  Outcome outcome = Outcome::kEquilibrium;
  for (int k = 0; k < path.plan.forces; ++k) {
    const double force_n = range_n[0] + (range_n[1] - range_n[0]) * k / std::max(1, path.plan.forces - 1);
    const bool same_contacts = k == 0 || load.contacts.size() == 1;
    if (outcome == Outcome::kEquilibrium &&
        !(same_contacts ? statics.press(force_n) : statics.press(load.contacts_at(k), force_n))) {
      outcome = statics.buckled() ? Outcome::kNoEquilibrium : Outcome::kNotConverged;
    }
    FemState state = statics.state();
    if (outcome == Outcome::kEquilibrium) outcome = state.outcome;
    state.path = index;
    state.front_node = nearest_front_node(mesh, state.point_mm);
    state.force_n = static_cast<float>(force_n);
    state.scene = load.scene;
    state.step = k;
    state.outcome = outcome;
    if (load.scene == 0) {
      const std::vector<double> displacement = statics.node_displacement_mm();
      path.node_displacement_mm.insert(path.node_displacement_mm.end(), displacement.begin(), displacement.end());
    }
    // What lies between states of frictionless points is interpolated.
    const bool is_interpolated = load.scene == 0 && !contacts_change(load.of);
    if (state.valid() && !is_interpolated && !is_kept) {
      const double step_n = (range_n[1] - range_n[0]) / std::max(1, path.plan.forces - 1);
      state.nearby = states_nearby(statics, spec, load, k, path.plan.forces, step_n, random);
    }
    states_of_scene(path, load.scene).push_back(std::move(state));
  }
}

/// The scenes that a plan's pack must tell from its own, as every finger has them.
std::vector<Scene> common_others(const DatasetPlan& plan) {
  std::vector<Scene> scenes = common_scenes();
  const auto at = std::ranges::find(scenes, plan.scene, &Scene::name);
  scenes.erase(scenes.begin(), at == scenes.end() ? scenes.end() - 2 : at + 1);
  return scenes;
}

/// The points of a plan that those of its other scenes are counted by: beyond kMost, more points of its own scene tell a
/// network more, while more of what it only tells apart does not.
int counted_points(const DatasetPlan& plan) {
  constexpr int kMost = 700;
  return std::min(plan.points, kMost);
}

/// Points of each of them, relative to those of the plan's scene. Most of two pushes are hard to tell from one, and the
/// more of them are learnt the more are found; a push elsewhere than on the face is told from few.
std::vector<int> points_of_others(const DatasetPlan& plan) {
  constexpr double kOnFace = 0.8, kElsewhere = 0.2;  // all scenes of a kind together
  const std::vector<Scene> others = common_others(plan);
  std::vector<int> points;
  for (const Scene& scene : others) {
    const double share = scene.elsewhere ? kElsewhere : kOnFace;
    const auto alike = static_cast<double>(std::ranges::count(others, scene.elsewhere, &Scene::elsewhere));
    points.push_back(std::max(1, static_cast<int>(std::lround(share * counted_points(plan) / alike))));
  }
  return points;
}

/// Of a kind that is kept from learning: how many errors of a kind lie inside a radius is known only as well as its
/// places are many. Any touch of the scene, or of another scene, differs more than the others do.
int kept_points(const DatasetPlan& plan, int kind) {
  constexpr int kPlanPoints = 10, kMorePoints = 4;  // one in as many; times as many
  const auto one_in = [](int points) { return (points + kPlanPoints - 1) / kPlanPoints; };
  return kind < kAnyTouch ? one_in(plan.points) : kMorePoints * one_in(counted_points(plan));
}

void add_kept_paths(const FingerSpec& spec, const DatasetPlan& plan, std::vector<LoadPath>& paths) {
  std::vector<Scene> scenes(kKindsOfTouch, spec.scene(plan.scene));
  for (const Scene& scene : other_scenes(spec, plan)) {
    if (!scene.elsewhere) scenes.push_back(scene);
  }
  for (std::size_t kind = 0; kind < scenes.size(); ++kind) {
    const int points = kept_points(plan, static_cast<int>(kind));
    const double spacing = spacing_mm(spec, points);
    for (const Vec3f& point_mm : touch_points(spec, points)) {
      Random random(paths.size());
      LoadPath path{.contacts = {},
                    .scene = static_cast<std::uint8_t>(kFirstKept + kind),
                    .of = scenes[kind],
                    .spacing_mm = spacing};
      for (int k = 0; k < plan.forces; ++k) {
        const Eigen::Vector2d near_mm = place_near(spec, point_mm.head<2>().cast<double>(), spacing, random);
        path.contacts.push_back(kind < kKindsOfTouch
                                    ? draw_kind(spec, scenes[kind], static_cast<int>(kind), near_mm, random)
                                    : draw_contacts(spec, scenes[kind], near_mm, random));
      }
      paths.push_back(std::move(path));
    }
  }
}

std::filesystem::path path_file(const std::filesystem::path& folder, std::size_t index) {
  std::string number = std::to_string(index);
  number.insert(0, number.size() < 5 ? 5 - number.size() : 0, '0');
  return folder / (number + ".safetensors");
}

}  // namespace

std::vector<Scene> other_scenes(const FingerSpec& spec, const DatasetPlan& plan) {
  std::vector<Scene> others;
  for (const Scene& scene : common_others(plan)) others.push_back(spec.scene(scene.name));
  return others;
}

int kept_kinds(const DatasetPlan& plan) {
  const std::vector<Scene> others = common_others(plan);
  return kKindsOfTouch + static_cast<int>(std::ranges::count(others, false, &Scene::elsewhere));
}

bool contacts_change(const Scene& scene) {
  const bool has_friction_or_patches = scene.friction > 0 || scene.patch_radius_mm > 0 || scene.line_share > 0;
  return !scene.elsewhere && (has_friction_or_patches || scene.contacts > 1);
}

double spacing_mm(const FingerSpec& spec, int points) {
  const double area_mm2 = 2 * (spec.touch_y_mm[1] - spec.touch_y_mm[0]) * spec.half_width.at(spec.touch_y_mm[0]);
  return std::clamp(std::sqrt(area_mm2 / points), 2.0, 5.0);
}

std::vector<LoadPath> load_paths(const FingerSpec& spec, const DatasetPlan& plan) {
  std::vector<LoadPath> paths;
  const auto add = [&](const Scene& scene, int points, std::size_t number) {
    const double spacing = spacing_mm(spec, points);
    for (const Vec3f& point_mm : touch_points(spec, points)) {
      Random random(paths.size());
      const Eigen::Vector2d place_mm = point_mm.head<2>().cast<double>();
      LoadPath path{.contacts = {}, .scene = static_cast<std::uint8_t>(number), .of = scene, .spacing_mm = spacing};
      if (contacts_change(scene)) {
        for (int k = 0; k < plan.forces; ++k) {
          const Eigen::Vector2d near_mm = place_near(spec, place_mm, spacing, random);
          path.contacts.push_back(draw_contacts(spec, scene, near_mm, random));
        }
      } else {
        path.contacts.push_back(draw_contacts(spec, scene, place_mm, random));
      }
      paths.push_back(std::move(path));
    }
  };
  add(spec.scene(plan.scene), plan.points, 0);
  const std::vector<Scene> others = other_scenes(spec, plan);
  const std::vector<int> points = points_of_others(plan);
  for (std::size_t k = 0; k < others.size(); ++k) add(others[k], points[k], k + 1);
  add_kept_paths(spec, plan, paths);
  return paths;
}

std::size_t path_count(const DatasetPlan& plan) {
  const std::vector<int> others = points_of_others(plan);
  int paths = std::accumulate(others.begin(), others.end(), plan.points);
  for (int kind = 0; kind < kept_kinds(plan); ++kind) paths += kept_points(plan, kind);
  return static_cast<std::size_t>(paths);
}

std::size_t FemDataset::count(Outcome outcome) const {
  return static_cast<std::size_t>(
      std::count_if(states.begin(), states.end(), [=](const FemState& state) { return state.outcome == outcome; }));
}

FemDataset make_dataset(const FingerSpec& spec, const TetMesh& mesh, const DatasetPlan& plan, const Shard& shard,
                        const std::filesystem::path& resume) {
  const FemDataset empty = empty_set(spec, mesh, plan);
  const std::vector<LoadPath> loads = load_paths(spec, plan);
  std::vector<std::size_t> indices;
  const auto first = static_cast<std::size_t>(shard.index), stride = static_cast<std::size_t>(shard.count);
  const std::size_t end = shard.only_scene ? static_cast<std::size_t>(plan.points) : loads.size();
  for (std::size_t i = first; i < end; i += stride) indices.push_back(i);
  const auto finger = std::make_shared<const PushedFinger>(spec, mesh);
  std::vector<FemDataset> paths(indices.size(), empty);
  {
    Progress progress("finite-element load paths", indices.size());
    parallel_for(indices.size(), [&](std::size_t slot) {
      const std::size_t i = indices[slot];
      const std::filesystem::path file = path_file(resume, i);
      if (!resume.empty() && std::filesystem::exists(file)) {
        try {
          paths[slot] = read_dataset(file);
          check_same_plan(empty, paths[slot], file);
        } catch (const InputError& error) {
          throw InputError(resume.string(), std::string("is left from another run (") + error.what() +
                                                "); delete the folder to start over");
        }
      } else {
        // One solver per thread, started afresh for each path.
        thread_local std::shared_ptr<const PushedFinger> owner;
        thread_local std::unique_ptr<FingerStatics> statics;
        if (owner != finger) {
          statics = std::make_unique<FingerStatics>(finger);
          owner = finger;
        }
        walk_path(*statics, spec, mesh, loads[i], static_cast<std::int32_t>(i), paths[slot]);
        if (!resume.empty()) write_dataset(file, paths[slot]);
      }
      progress.advance();
    });
  }
  FemDataset dataset = empty;
  for (const FemDataset& path : paths) append(path, dataset);
  return dataset;
}

}  // namespace finsight::host
