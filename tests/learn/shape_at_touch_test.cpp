#include "hostgen/learn/shape_at_touch.h"

#include <doctest/doctest.h>

#include "hostgen/fem/shape_model.h"
#include "hostgen/finger/mount.h"
#include "hostgen/learn/shape_map_training.h"
#include "hostgen/learn/shape_truth.h"
#include "tests/fem/box_mesh.h"
#include "tests/model/tiny_model.h"

using namespace finsight;
using namespace finsight::host;

namespace {

/// A column with few states, and a pack with its maps; the pack's touch network is arbitrary.
struct Finger {
  Finger() {
    for (PoseNoise& noise : spec.noise) noise = {0.001, 0.005, 0.0002, 0.0001};
    dataset = make_dataset(spec, mesh, {.points = 40, .forces = 3});
    const test::TinyModel tiny;
    PackViews views = tiny.views();
    const ShapeModelData shape = make_shape_model(mesh);
    views.mount = mount_of(spec);
    views.mount.marker_id = tiny.parts.mount.marker_id;
    views.mount.marker_size_mm = tiny.parts.mount.marker_size_mm;
    const ShapeSamples converged = converged_shapes(spec, shape.view(), views.mount, dataset, 1, 1);
    const ShapeMapData map = fit_shape_map(converged.poses, converged.displacement_mm);
    const ShapeMapData contact_map = fit_contact_map(spec, dataset, 2);
    const std::vector<float> shape_mm(static_cast<std::size_t>(views.self_test.cases) * shape.rest_mm.size());
    views.shape = shape.view();
    views.shape_map = map.view();
    views.contact_map = contact_map.view();
    views.self_test.shape_mm = views.self_test.contact_shape_mm = shape_mm;
    write_model_pack(folder / "pack", views);
  }
  Model open() const { return Model::open(folder / "pack"); }

  test::ScratchFolder folder;
  FingerSpec spec = test::small_finger_spec();
  TetMesh mesh = test::small_finger_mesh();
  FemDataset dataset;
};

const Finger& finger() {
  static const Finger the_finger;
  return the_finger;
}

}  // namespace

TEST_CASE("shape at touch: on points that the pack has not seen, tier contact is nearest to the finite elements") {
  const Model model = finger().open();
  const FemDataset unseen = unseen_states(finger().spec, finger().mesh, finger().dataset, 23, 2);
  const std::vector<TierAtTouch> tiers = measure_tiers_at_touch(finger().spec, model, unseen, 1);
  REQUIRE(tiers.size() == 4);
  const TierAtTouch &map = tiers[0], &corrected = tiers[1], &newton = tiers[2], &contact = tiers[3];
  CHECK(contact.tier == "contact");
  CHECK(contact.contact_map_share > 0.5);
  CHECK(map.contact_map_share == 0);
  for (const TierAtTouch* other : {&map, &corrected, &newton}) {
    CHECK(contact.clean.touch_point_mm < 0.5 * other->clean.touch_point_mm);
    CHECK(contact.noisy.touch_point_mm < other->noisy.touch_point_mm);
    CHECK(contact.clean.front_mm < other->clean.front_mm);
    CHECK(contact.noisy.front_mm < other->noisy.front_mm);
  }
  CHECK(contact.us_per_frame > 0);
}

TEST_CASE("shape at touch: unseen states are valid ones of points that are not in the set") {
  const FemDataset unseen = unseen_states(finger().spec, finger().mesh, finger().dataset, 3, 2);
  REQUIRE(!unseen.states.empty());
  CHECK(unseen.node_displacement_mm.size() == unseen.states.size() * 3 * unseen.mesh_nodes);
  for (const FemState& state : unseen.states) {
    CHECK(state.valid());
    for (const FemState& known : finger().dataset.states) CHECK((known.point_mm - state.point_mm).norm() >= 1);
  }
  const FemDataset all = make_dataset(finger().spec, finger().mesh, {.points = 2, .forces = 1});
  CHECK_THROWS_AS(unseen_states(finger().spec, finger().mesh, all, 2, 1), std::runtime_error);
}

TEST_CASE(
    "shape at touch: on held-out points of the set, too, the contact-aware map beats the converged energy method") {
  const ShapeAtTouch shape = measure_shape_at_touch(finger().spec, finger().open(), finger().dataset, 5, 1);
  CHECK(shape.states == 5);
  CHECK(shape.contact_aware_clean.touch_point_mm < shape.energy_clean.touch_point_mm);
  CHECK(shape.contact_aware_noisy.touch_point_mm < shape.energy_noisy.touch_point_mm);
}
