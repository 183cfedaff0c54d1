#include "hostgen/fem/dataset.h"

#include <doctest/doctest.h>

#include <algorithm>
#include <filesystem>
#include <fstream>

#include "firmware/input_error.h"
#include "hostgen/fem/scene_contacts.h"
#include "hostgen/util/common.h"
#include "tests/fem/box_mesh.h"
#include "tests/model/scratch_folder.h"

using namespace finsight;
using namespace finsight::host;

namespace {

const DatasetPlan kPlan = {.points = 4, .forces = 3};

FemDataset small_dataset(const Shard& shard = {}, const std::filesystem::path& resume = {}) {
  return make_dataset(test::small_finger_spec(), test::small_finger_mesh(), kPlan, shard, resume);
}

/// What an InputError of `work` says; empty if there is none.
template <class Work>
std::string refusal(const Work& work) {
  try {
    work();
  } catch (const InputError& error) {
    return error.what();
  }
  return "";
}

bool same(const FemState& x, const FemState& y) {
  if (x.scene != y.scene || x.path != y.path || x.front_node != y.front_node || x.force_n != y.force_n ||
      x.point_mm != y.point_mm || x.contact_mm != y.contact_mm || x.force_vector_n != y.force_vector_n ||
      x.moment_nmm != y.moment_nmm || x.outcome != y.outcome || x.step != y.step) {
    return false;
  }
  for (std::size_t p = 0; p < kPlates; ++p) {
    if (x.plates[p].displacement_mm != y.plates[p].displacement_mm ||
        x.plates[p].rotation_rad != y.plates[p].rotation_rad) {
      return false;
    }
  }
  return std::ranges::equal(x.nearby, y.nearby, [](const FemState& i, const FemState& j) { return same(i, j); });
}

bool same(const FemDataset& a, const FemDataset& b) {
  const std::vector<FemState> all_a = all_states(a), all_b = all_states(b);
  if (a.states.size() != b.states.size() || a.node_displacement_mm != b.node_displacement_mm) return false;
  if (all_a.size() != all_b.size()) return false;
  for (std::size_t i = 0; i < all_a.size(); ++i) {
    if (!same(all_a[i], all_b[i])) return false;
  }
  return a.spec_sha256 == b.spec_sha256 && a.mesh_sha256 == b.mesh_sha256 && a.mesh_nodes == b.mesh_nodes &&
         a.plan.points == b.plan.points && a.plan.forces == b.plan.forces;
}

}  // namespace

TEST_CASE("dataset: states come path by path from the lowest force up, and are the same every time") {
  const FemDataset dataset = small_dataset();
  REQUIRE(dataset.states.size() == 12);
  CHECK(dataset.node_displacement_mm.size() == 12 * 3 * dataset.mesh_nodes);
  for (std::size_t i = 0; i < dataset.states.size(); ++i) {
    CHECK(dataset.states[i].path == static_cast<int>(i / 3));
    CHECK(dataset.states[i].force_n == doctest::Approx(0.1 + 0.15 * static_cast<double>(i % 3)));
  }
  CHECK(same(dataset, small_dataset()));
}

TEST_CASE("dataset: beside the scene it holds what a pack for the scene must not take for a touch of it") {
  const FemDataset dataset = small_dataset();
  const std::vector<Scene> others = other_scenes(test::small_finger_spec(), kPlan);
  REQUIRE(others.size() == 3);
  CHECK(others[0].name == "grasp");
  CHECK(others[2].elsewhere);
  const int scenes[] = {1, 1, 2, 2, 3};  // of the paths: fewer elsewhere
  REQUIRE(dataset.others.size() == 15);
  for (std::size_t i = 0; i < 15; ++i) {
    CHECK(dataset.others[i].scene == scenes[i / 3]);
    CHECK(dataset.others[i].path == static_cast<int>(4 + i / 3));
  }
  CHECK(path_count(kPlan) == 9 + kAnyTouch + 3 * 4);  // and those that are kept from learning
  CHECK(other_scenes(test::small_finger_spec(), {.scene = "grasp"}).size() == 2);
}

TEST_CASE("dataset: touches of every kind, and of every other scene on the face, are kept from learning") {
  const FemDataset dataset = small_dataset();
  CHECK(kept_kinds(kPlan) == kKindsOfTouch + 2);
  CHECK(kept_kinds({.scene = "grasp"}) == kKindsOfTouch + 1);
  REQUIRE(dataset.kept.size() == 3 * (kAnyTouch + 3 * 4));
  std::vector<int> states(static_cast<std::size_t>(kept_kinds(kPlan)), 0);
  for (const FemState& state : dataset.kept) {
    REQUIRE(state.scene >= kFirstKept);
    ++states.at(state.scene - kFirstKept);
    CHECK(state.path >= 9);
    CHECK(state.nearby.empty());
  }
  for (std::size_t kind = 0; kind < states.size(); ++kind) CHECK(states[kind] == (kind < kAnyTouch ? 3 : 12));
  // Pushed as hard as fingers must be that are up to a quarter softer or stiffer.
  const auto [weakest, strongest] = std::ranges::minmax(dataset.kept, {}, &FemState::force_n);
  CHECK(weakest.force_n >= 0.1 / 1.25);
  CHECK(weakest.force_n < 1.1 * 0.1 / 1.25);
  CHECK(strongest.force_n <= 0.4 * 1.25);
  CHECK(strongest.force_n > 0.9 * 0.4 * 1.25);
  const std::vector<LoadPath> paths = load_paths(test::small_finger_spec(), {.points = 4, .scene = "grasp"});
  const LoadPath& sliding = paths.at(paths.size() - 2 * 4 - kAnyTouch + 8);
  for (int k = 0; k < 7; ++k) {
    CHECK(sliding.contacts_at(k)[0].friction.norm() == doctest::Approx(0.6));
    CHECK(sliding.contacts_at(k)[0].friction.y() < -0.5);  // towards the base
  }
}

TEST_CASE("dataset: beyond 700 points only the plan's scene gets more paths, and each kind of its touches that is kept") {
  const auto paths = [](int points) { return path_count({.points = points, .forces = 1, .scene = "grasp"}); };
  CHECK(paths(2100) == paths(700) + 1400 + kAnyTouch * 140);
  CHECK(paths(700) > paths(600) + 300);
  CHECK(load_paths(test::small_finger_spec(), {.points = 710, .forces = 1, .scene = "grasp"}).size() == paths(710));
}

TEST_CASE("dataset: where a scene has more than frictionless points every state has contacts of its own") {
  const FingerSpec spec = test::small_finger_spec();
  CHECK_FALSE(contacts_change(spec.scene("probe")));
  const std::vector<LoadPath> probe = load_paths(spec, kPlan);
  CHECK(probe[0].contacts.size() == 1);
  CHECK(&probe[0].contacts_at(0) == &probe[0].contacts_at(2));
  CHECK(probe[4].contacts.size() == 3);  // of the other scenes, grasp
  CHECK(probe[8].contacts.size() == 1);  // elsewhere

  const DatasetPlan plan = {.points = 4, .forces = 3, .scene = "grasp"};
  const std::vector<LoadPath> grasp = load_paths(spec, plan);
  CHECK(grasp[0].contacts.size() == 3);
  CHECK(grasp[0].contacts_at(0)[0].centre_mm != grasp[0].contacts_at(1)[0].centre_mm);
  CHECK(load_paths(spec, plan)[0].contacts_at(1)[0].centre_mm == grasp[0].contacts_at(1)[0].centre_mm);
  const FemDataset dataset = make_dataset(spec, test::small_finger_mesh(), plan);
  CHECK(dataset.states[4].step == 1);
  CHECK(std::abs(double(dataset.states[0].point_mm.y() - dataset.states[1].point_mm.y())) > 1e-3);
}

TEST_CASE("dataset: near each state lie others, unless they can be interpolated") {
  const FingerSpec spec = test::small_finger_spec();
  const FemDataset grasp =
      make_dataset(spec, test::small_finger_mesh(), {.points = 4, .forces = 3, .scene = "grasp"});
  std::vector<FemState> learnt = grasp.states;
  learnt.insert(learnt.end(), grasp.others.begin(), grasp.others.end());
  for (const FemState& state : learnt) {
    REQUIRE(state.valid());
    CHECK(state.nearby.size() > kNearby / 2);
    const float step_n = 0.15F, highest_n = state.step == 2 ? 1.25F * state.force_n : state.force_n + 0.5F * step_n;
    for (const FemState& other : state.nearby) {
      CHECK(other.force_n <= highest_n);
      CHECK(other.force_n >= (state.step == 0 ? 0 : state.force_n - 0.5F * step_n));
      CHECK((other.plates[kTopPlate].displacement_mm - state.plates[kTopPlate].displacement_mm).norm() > 1e-4F);
    }
  }
  const FemDataset probe = small_dataset();
  CHECK(probe.states[0].nearby.empty());
  CHECK_FALSE(probe.others[0].nearby.empty());
}

TEST_CASE("dataset: what is written is read back") {
  const auto file = std::filesystem::temp_directory_path() / "finsight_dataset_test.safetensors";
  const FemDataset dataset =
      make_dataset(test::small_finger_spec(), test::small_finger_mesh(), {.points = 4, .forces = 3, .scene = "grasp"});
  write_dataset(file, dataset);
  CHECK(same(read_dataset(file), dataset));
  std::filesystem::resize_file(file, std::filesystem::file_size(file) - 4);
  CHECK_THROWS_AS(read_dataset(file), InputError);
  std::filesystem::remove(file);
}

TEST_CASE("dataset: a push beyond the limit is marked, with all that follow on its path") {
  FingerSpec spec = test::small_finger_spec();
  spec.force_n = {0.2, 60};
  spec.touch_y_mm = {45, 55};
  const FemDataset dataset = make_dataset(spec, test::small_finger_mesh(), {.points = 2, .forces = 4});
  REQUIRE(dataset.states.size() == 8);
  CHECK(dataset.states[0].valid());
  CHECK_FALSE(dataset.states[3].valid());
  CHECK_FALSE(dataset.states[7].valid());
  CHECK(dataset.states[3].outcome != Outcome::kEquilibrium);
  CHECK(dataset.count(Outcome::kEquilibrium) < 8);
  CHECK(dataset.count(Outcome::kEquilibrium) + dataset.count(Outcome::kPushedTooFar) +
            dataset.count(Outcome::kNoEquilibrium) ==
        8);
}

TEST_CASE("dataset: a place that does not bear the spec's forces is pushed with those that it bears") {
  FingerSpec spec = test::small_finger_spec();
  spec.force_n = {20, 40};
  spec.touch_y_mm = {45, 55};
  const FemDataset dataset = make_dataset(spec, test::small_finger_mesh(), {.points = 2, .forces = 3});
  REQUIRE(dataset.count(Outcome::kEquilibrium) == 6);
  for (std::size_t path = 0; path < 2; ++path) {
    const FemState *lowest = &dataset.states[3 * path], *highest = &dataset.states[3 * path + 2];
    CHECK(highest->force_n < 20);
    CHECK(highest->force_n >= 0.05F);
    CHECK(lowest->force_n == doctest::Approx(highest->force_n / 2));
    CHECK(highest->plates[0].displacement_mm.norm() > lowest->plates[0].displacement_mm.norm());
  }
}

TEST_CASE("dataset: shards in any order make the same bytes as one run") {
  const test::ScratchFolder folder;
  write_dataset(folder / "whole", small_dataset());
  std::vector<std::filesystem::path> shards;
  for (int i = 0; i < 3; ++i) {
    shards.insert(shards.begin(), folder / ("shard" + std::to_string(i)));
    write_dataset(shards.front(), small_dataset({.index = i, .count = 3}));
  }
  write_dataset(folder / "merged", merge_datasets(shards));
  CHECK(read_file(folder / "merged") == read_file(folder / "whole"));
  // A shard alone is not a training set.
  CHECK_NOTHROW(
      check_complete(read_dataset(folder / "merged"), test::small_finger_spec(), test::small_finger_mesh(), "m"));
  CHECK(refusal([&] {
          check_complete(read_dataset(shards[0]), test::small_finger_spec(), test::small_finger_mesh(), "s");
        }).find("path 0 of 36 is missing") != std::string::npos);
}

TEST_CASE("dataset: touches of the scene alone are those of the whole set, and no training set") {
  const test::ScratchFolder folder;
  const FemDataset whole = small_dataset();
  write_dataset(folder / "touches", small_dataset({.only_scene = true}));
  const FemDataset touches = read_dataset(folder / "touches");
  REQUIRE(touches.states.size() == whole.states.size());
  for (std::size_t i = 0; i < whole.states.size(); ++i) {
    CHECK(touches.states[i].path == whole.states[i].path);
    CHECK(touches.states[i].contact_mm == whole.states[i].contact_mm);
  }
  CHECK(touches.node_displacement_mm == whole.node_displacement_mm);
  CHECK(touches.others.empty());
  CHECK(touches.kept.empty());
  CHECK(refusal([&] {
          check_complete(touches, test::small_finger_spec(), test::small_finger_mesh(), "t");
        }).find("path 4 of 36 is missing") != std::string::npos);
}

TEST_CASE("dataset: what cannot be merged is refused with the file and the reason") {
  const test::ScratchFolder folder;
  const auto a = folder / "a", b = folder / "b", other = folder / "other";
  write_dataset(a, small_dataset({.index = 0, .count = 2}));
  write_dataset(b, small_dataset({.index = 1, .count = 2}));
  FingerSpec spec = test::small_finger_spec();
  spec.sha256 = "fedcba9876543210";
  write_dataset(other, make_dataset(spec, test::small_finger_mesh(), kPlan, {.index = 1, .count = 2}));
  CHECK(refusal([&] { merge_datasets({a}); }).find("path 1 of 36 is missing") != std::string::npos);
  CHECK(refusal([&] { merge_datasets({a, b, a}); }).find("path 0 is in") != std::string::npos);
  const std::string foreign = refusal([&] { merge_datasets({a, other}); });
  CHECK(foreign.find(other.string()) != std::string::npos);
  CHECK(foreign.find("spec_sha256") != std::string::npos);
}

TEST_CASE("dataset: an interrupted run resumes from the paths that it finished") {
  const test::ScratchFolder folder;
  const FemDataset whole = small_dataset({}, folder / "paths");
  const auto kept = folder / "paths" / "00002.safetensors";
  REQUIRE(std::filesystem::exists(kept));
  // A kept path is taken as it is, not computed again: a mark in it comes back.
  FemDataset marked = read_dataset(kept);
  marked.states[1].contact_mm.x() = 123;
  write_dataset(kept, marked);
  std::filesystem::remove(folder / "paths" / "00001.safetensors");
  FemDataset again = small_dataset({}, folder / "paths");
  CHECK(again.states[7].contact_mm.x() == 123);
  again.states[7].contact_mm = whole.states[7].contact_mm;
  CHECK(same(again, whole));
  // Paths of another plan are not mixed in.
  CHECK(refusal([&] {
          make_dataset(test::small_finger_spec(), test::small_finger_mesh(), {.points = 4, .forces = 2}, {},
                       folder / "paths");
        }).find("forces") != std::string::npos);
}
