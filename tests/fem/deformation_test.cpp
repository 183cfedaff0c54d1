#include "hostgen/fem/deformation.h"

#include <doctest/doctest.h>

#include "tests/fem/box_mesh.h"

using namespace finsight;
using namespace finsight::host;

namespace {

/// States of three mesh nodes of which the first two are the front face; both move by `mm` along z, the third far more.
FemDataset states_of(const std::vector<std::pair<int, std::vector<float>>>& paths) {
  FemDataset dataset{.spec_sha256 = "", .states = {}, .node_displacement_mm = {}, .mesh_nodes = 3};
  for (const auto& [path, levels_mm] : paths) {
    for (std::size_t k = 0; k < levels_mm.size(); ++k) {
      FemState state;
      state.path = path;
      state.force_n = static_cast<float>(k + 1);
      state.point_mm = Vec3f(static_cast<float>(path), 7, 0);
      dataset.states.push_back(state);
      const float u = levels_mm[k];
      dataset.node_displacement_mm.insert(dataset.node_displacement_mm.end(), {0, 0, u, 0, 0, -u, 99, 0, 0});
    }
  }
  return dataset;
}

const std::vector<std::int32_t> kFront = {0, 1};

}  // namespace

TEST_CASE("deformation: points where a higher force deforms less are counted, with the worst drop and where it is") {
  const FemDataset dataset = states_of({{0, {1, 2, 3}}, {1, {1, 3, 2.5F, 2.75F}}, {2, {2, 2}}, {3, {1, 0.875F, 4}}});
  const DeformationRise rise = measure_deformation_rise({}, dataset, kFront);
  CHECK(rise.contact_points == 4);
  CHECK(rise.not_monotone == 3);  // a level that stays does not rise
  CHECK(rise.worst_drop_mm == doctest::Approx(0.5));
  CHECK(rise.worst_point_mm.x() == 1);
  const std::string text = deformation_text(rise, 5);
  CHECK_MESSAGE(text.find("at 1 of 4 points; worst drop 100 per mille, of a touch at (1, 7)") != std::string::npos,
                text);
}

TEST_CASE("deformation: the order of the states does not matter, and those that are not valid do not count") {
  FemDataset dataset = states_of({{0, {1, 2, 3, 0.5F}}, {1, {1}}});
  dataset.states[3].outcome = Outcome::kPushedTooFar;
  dataset.states[4].outcome = Outcome::kPushedTooFar;
  std::swap(dataset.states[0], dataset.states[2]);
  for (std::size_t i = 0; i < 9; ++i) std::swap(dataset.node_displacement_mm[i], dataset.node_displacement_mm[18 + i]);
  const DeformationRise rise = measure_deformation_rise({}, dataset, kFront);
  CHECK(rise.contact_points == 1);
  CHECK(rise.not_monotone == 0);
  CHECK(rise.worst_drop_mm == 0);
}

TEST_CASE("deformation: zero without force, which does not count as a drop") {
  FemDataset dataset = states_of({{0, {0, 1, 2}}, {1, {0, 2, 2}}});
  for (FemState& state : dataset.states) state.force_n -= 1;
  CHECK(measure_deformation_rise({}, dataset, kFront).not_monotone == 1);
}

TEST_CASE("deformation: states of paths whose contacts change are not compared") {
  const DeformationRise rise =
      measure_deformation_rise({.name = "rubs", .friction = 0.5}, states_of({{0, {1, 2, 0.5F}}}), kFront);
  CHECK(rise.contact_points == 0);
  CHECK(rise.not_monotone == 0);
  CHECK(deformation_text(rise, 5).find("contacts change") != std::string::npos);
}

TEST_CASE("deformation: it rises with force at every point of a finger") {
  const TetMesh mesh = test::small_finger_mesh();
  const FemDataset dataset = make_dataset(test::small_finger_spec(), mesh, {.points = 9, .forces = 5});
  const DeformationRise rise = measure_deformation_rise({}, dataset, mesh.front_nodes);
  CHECK(rise.contact_points == 9);
  CHECK(rise.not_monotone == 0);
}
