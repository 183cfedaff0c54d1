#include "firmware/shape/shape_stage.h"

#include <doctest/doctest.h>

#include <limits>
#include <tuple>

#include "firmware/geometry/so3.h"
#include "firmware/input_error.h"
#include "firmware/shape/newton.h"
#include "firmware/shape/shape_map.h"
#include "firmware/shape/shape_measures.h"
#include "hostgen/fem/shape_model.h"
#include "tests/count_allocations.h"
#include "tests/model/tiny_model.h"
#include "tests/shape/finger_motion.h"
#include "tests/shape/frame_mesh.h"

using namespace finsight;
using test::Bend;
using Tier = ShapeSettings::Tier;

namespace {

/// A small finger with a shape map that is right for slight bends: how the nodes move per millimetre of the
/// top plate.
struct Finger {
  Finger() : mesh(test::frame_mesh(4, 12, 5)), data(host::make_shape_model(mesh)), mount(test::mount_of(mesh)) {
    weights[1 + 2] = 1;  // of the displacement z of the top plate
    const PlatePoses poses = slope(1);
    const std::vector<double> bent = converged(poses);
    const double top_z_mm = static_cast<double>(poses.plates[kTopPlate].displacement_mm.z());
    for (std::size_t i = 0; i < bent.size(); ++i)
      basis.push_back(static_cast<float>((bent[i] - static_cast<double>(data.rest_mm[i])) / top_z_mm));
  }
  PlatePoses slope(double mm) const { return Bend{mm, 0, 0}.poses(mount); }
  /// Where every node is once the solver has converged.
  std::vector<double> converged(const PlatePoses& poses) const {
    NewtonSolver<double> solver(data.view(), mount);
    REQUIRE(solver.converge(poses, 1e-9, 100).ok);
    return {solver.node_mm().begin(), solver.node_mm().end()};
  }
  host::TetMesh mesh;
  host::ShapeModelData data;
  MountModel mount;
  Cholesky<float> cholesky{data.view().cholesky};
  Elements<float> elements{data.view(), &cholesky};
  std::vector<float> scale = std::vector<float>(kPoseDims, 1.0f);
  std::vector<float> weights = std::vector<float>(ShapeMapModel::kFeatures, 0.0f), basis;
};

const Finger& finger() {
  static const Finger the_finger;
  return the_finger;
}

PlatePoses slope(double mm) { return finger().slope(mm); }

/// The contact map pushes one free node of the front face a tenth further in than the shape map bends it.
struct Dimple {
  Dimple() : basis(finger().basis), scale(finger().scale) {
    const auto& front = finger().data.front_nodes;
    const auto& kind = finger().data.node_kind;
    const auto is_free = [&](std::int32_t n) { return kind[static_cast<std::size_t>(n)] == 0; };
    std::vector<std::int32_t> free_front;
    std::copy_if(front.begin(), front.end(), std::back_inserter(free_front), is_free);
    node = static_cast<std::size_t>(free_front.at(free_front.size() / 2));
    basis[3 * node + 2] += 0.1f;
    for (float& factor : scale) factor = 0.2f;  // trained up to 5 mm
    weights = finger().weights;
    weights[1 + 2] = 5;
  }
  ShapeMapModel view() const { return {1, scale, weights, basis}; }
  std::size_t node;
  std::vector<float> basis, scale, weights;
};

const Dimple& dimple() {
  static const Dimple the_dimple;
  return the_dimple;
}

ShapeStage stage_of(Tier tier) {
  const Finger& f = finger();
  return {{f.data.view(), {1, f.scale, f.weights, f.basis}, f.mount, dimple().view()}, {.tier = tier}};
}

double distance(const FingerShape& shape, const std::vector<double>& expected) {
  double largest = 0;
  for (std::size_t i = 0; i < expected.size(); ++i)
    largest = std::max(largest, std::abs(static_cast<double>(shape.node_mm[i]) - expected[i]));
  return largest;
}

/// All plates 300 mm too low: plausible numbers, but the way there leads through the base.
PlatePoses below_base() {
  PlatePoses poses = slope(0);
  for (PlateMotion& plate : poses.plates) plate.displacement_mm.y() = -300;
  return poses;
}

std::vector<float> copy(const FingerShape& shape) { return {shape.node_mm.begin(), shape.node_mm.end()}; }

}  // namespace

TEST_CASE("shape stage: every tier starts from the map and says who answered") {
  const PlatePoses poses = slope(2);
  const std::vector<double> expected = finger().converged(poses);
  for (const auto& [tier, source, iterations, largest_error_mm] :
       {std::tuple{Tier::kMap, ShapeSource::kMap, 0, 0.1}, std::tuple{Tier::kContact, ShapeSource::kContactMap, 0, 0.3},
        std::tuple{Tier::kMapAndNewton, ShapeSource::kNewton, 2, 1e-3},
        std::tuple{Tier::kNewton, ShapeSource::kNewton, 2, 1e-3}}) {
    ShapeStage stage = stage_of(tier);
    const FingerShape& shape = stage.solve(poses);
    CHECK(shape.source == source);
    CHECK(shape.iterations == iterations);
    CHECK(shape.quality == Quality::kFresh);
    CHECK_FALSE(shape.fallback);
    CHECK(distance(shape, expected) < largest_error_mm);
  }
}

TEST_CASE("shape stage: the plates are exactly rigid in every tier") {
  const PlatePoses poses = Bend{4, 2, 10}.poses(finger().mount);
  for (const Tier tier : {Tier::kMap, Tier::kContact, Tier::kMapAndNewton, Tier::kNewton}) {
    ShapeStage stage = stage_of(tier);
    const FingerShape& shape = stage.solve(poses);
    double gap_mm = 0;
    for (std::size_t node = 0; node < finger().mesh.node_mm.size(); ++node) {
      const int plate = finger().data.node_kind[node] - 2;
      if (plate < 0) continue;
      const PlateMotion& motion = poses.plates[static_cast<std::size_t>(plate)];
      const Vec3f centre = finger().mount.T_finger_marker[static_cast<std::size_t>(plate)].translation();
      const Eigen::Matrix3f R = so3_exp(motion.rotation_rad);
      const Vec3f rest(&finger().data.rest_mm[3 * node]), found(&shape.node_mm[3 * node]);
      const Vec3f expected = R * (rest - centre) + centre + motion.displacement_mm;
      gap_mm = std::max(gap_mm, static_cast<double>((found - expected).norm()));
    }
    CHECK(gap_mm < 1e-4);
  }
}

TEST_CASE("shape stage: measures its displacements") {
  ShapeStage stage = stage_of(Tier::kNewton);
  const FingerShape& shape = stage.solve(slope(3));
  double all = 0, front = 0, largest = 0;
  int nodes = 0, front_nodes = 0;
  for (std::size_t i = 0; i < finger().data.rest_mm.size(); i += 3, ++nodes) {
    const Vec3f rest(&finger().data.rest_mm[i]), moved(&shape.node_mm[i]);
    const double u = static_cast<double>((moved - rest).norm());
    all += u * u;
    largest = std::max(largest, u);
    if (rest.z() != 0) continue;
    front += u * u;
    ++front_nodes;
  }
  CHECK(largest > 2);
  CHECK(static_cast<double>(shape.largest_mm) == doctest::Approx(largest).epsilon(1e-5));
  CHECK(static_cast<double>(shape.rms_mm) == doctest::Approx(std::sqrt(all / nodes)).epsilon(1e-5));
  CHECK(static_cast<double>(shape.front_rms_mm) == doctest::Approx(std::sqrt(front / front_nodes)).epsilon(1e-5));
}

TEST_CASE("shape stage: every answer is fresh, whenever its poses were measured; without poses it is invalid") {
  ShapeStage stage = stage_of(Tier::kNewton);
  CHECK(stage.solve(PlatePoses{}).quality == Quality::kInvalid);
  PlatePoses poses = slope(1);
  CHECK(stage.solve(poses).quality == Quality::kFresh);
  poses.seen[kMiddlePlate] = false;  // completed by the prior, but of this moment
  CHECK(stage.solve(poses).quality == Quality::kFresh);
  poses.seen[kMiddlePlate] = true;
  poses.quality = Quality::kHeld;
  CHECK(stage.solve(poses).quality == Quality::kFresh);
  poses.quality = Quality::kInvalid;
  CHECK(stage.solve(poses).quality == Quality::kInvalid);
}

TEST_CASE("shape stage: the newton tier follows the last shape, map+newton takes every frame by itself") {
  ShapeStage following = stage_of(Tier::kNewton), alone = stage_of(Tier::kMapAndNewton);
  const PlatePoses last = Bend{6, 0, 15}.poses(finger().mount);
  for (int k = 1; k <= 10; ++k) {
    following.solve(Bend{0.6 * k, 0, 1.5 * k}.poses(finger().mount));
    alone.solve(Bend{0.6 * k, 0, 1.5 * k}.poses(finger().mount));
  }
  ShapeStage fresh_following = stage_of(Tier::kNewton), fresh_alone = stage_of(Tier::kMapAndNewton);
  const auto same = [&](ShapeStage& a, ShapeStage& b) {
    const FingerShape &one = a.solve(last), &other = b.solve(last);
    return std::equal(one.node_mm.begin(), one.node_mm.end(), other.node_mm.begin());
  };
  CHECK(same(alone, fresh_alone));
  CHECK_FALSE(same(following, fresh_following));
}

TEST_CASE("shape stage: a gap makes the next solve start from the map, with the same answer as a new stage") {
  for (const bool by_reset : {true, false}) {
    ShapeStage stage = stage_of(Tier::kNewton), fresh = stage_of(Tier::kNewton);
    for (int k = 1; k <= 10; ++k) stage.solve(Bend{-0.6 * k, 0, 1.5 * k}.poses(finger().mount));
    if (by_reset) {
      stage.reset();
    } else {
      stage.solve(PlatePoses{});
    }
    const FingerShape& after = stage.solve(slope(3));
    const FingerShape& first = fresh.solve(slope(3));
    CHECK(std::equal(after.node_mm.begin(), after.node_mm.end(), first.node_mm.begin()));
  }
}

TEST_CASE("shape stage: poses that cannot be keep the last shape, flagged") {
  ShapeStage stage = stage_of(Tier::kNewton);
  const FingerShape& shape = stage.solve(slope(2));
  const std::vector<float> last = copy(shape);
  PlatePoses bad = slope(2);
  bad.plates[kLowPlate].rotation_rad.z() = std::numeric_limits<float>::quiet_NaN();
  stage.solve(bad);
  CHECK(shape.fallback);
  CHECK(shape.iterations == 0);
  CHECK(copy(shape) == last);
}

TEST_CASE("shape stage: plates where no finger has them are flagged, and it recovers at once") {
  for (const Tier tier : {Tier::kMap, Tier::kContact, Tier::kMapAndNewton, Tier::kNewton}) {
    ShapeStage stage = stage_of(tier);
    stage.solve(slope(2));
    for (int k = 0; k < 20; ++k) {
      const FingerShape& shape = stage.solve(below_base());
      CHECK(shape.fallback);
      CHECK(finger().elements.smallest_determinant(shape.node_mm) > 0);
    }
    const FingerShape& shape = stage.solve(slope(2));
    CHECK_FALSE(shape.fallback);
    CHECK(shape.quality == Quality::kFresh);
    CHECK(distance(shape, finger().converged(slope(2))) < (tier == Tier::kMap       ? 0.1
                                                           : tier == Tier::kContact ? 0.3
                                                                                    : 1e-3));
  }
}

TEST_CASE("shape stage: a shape wound into a wrong minimum is left when the map knows a better one") {
  ShapeStage stage = stage_of(Tier::kNewton);
  for (int degree = 0; degree <= 360; degree += 3) {
    PlatePoses poses = slope(0);
    poses.plates[kTopPlate].rotation_rad.y() = static_cast<float>(degree * M_PI / 180);
    stage.solve(poses);
  }
  for (int k = 0; k < 3; ++k) stage.solve(slope(1));
  CHECK(distance(stage.solve(slope(1)), finger().converged(slope(1))) < 1e-3);
}

TEST_CASE("shape stage: a map that turns elements inside out never goes out, in any tier") {
  const Finger& f = finger();
  const Elements<float>& elements = f.elements;
  std::vector<float> weights = f.weights, basis = f.basis, raw(f.data.rest_mm.size());
  weights[0] = 1;  // at rest already
  for (std::size_t i = 0; i < basis.size(); i += 2) basis[i] += 30;
  const ShapeMapModel map{1, f.scale, weights, basis};
  ShapeMap(map, f.data.view()).evaluate(pose_vector(slope(2)), raw);
  REQUIRE(elements.smallest_determinant(raw) < 0);
  for (const Tier tier : {Tier::kMap, Tier::kMapAndNewton, Tier::kNewton}) {
    ShapeStage stage({f.data.view(), map, f.mount}, {.tier = tier});
    for (const PlatePoses& poses : {slope(2), below_base(), below_base(), slope(2)}) {
      const FingerShape& shape = stage.solve(poses);
      CHECK(shape.source == (tier == Tier::kMap ? ShapeSource::kMap : ShapeSource::kNewton));
      CHECK(elements.smallest_determinant(shape.node_mm) > 0);
      if (tier == Tier::kMap) CHECK(shape.fallback);
    }
  }
}

TEST_CASE("shape stage: before the first shape an answer is invalid") {
  for (const Tier tier : {Tier::kMap, Tier::kContact, Tier::kNewton}) {
    ShapeStage stage = stage_of(tier);
    PlatePoses bad = slope(2);
    bad.plates[kLowPlate].displacement_mm.x() = std::numeric_limits<float>::infinity();
    const FingerShape& shape = stage.solve(bad);
    CHECK(shape.quality == Quality::kInvalid);
    CHECK(shape.source == ShapeSource::kRest);
    CHECK(shape.node_mm.size() == finger().data.rest_mm.size());
    CHECK(shape.largest_mm == 0);
  }
}

TEST_CASE("shape stage: solve does not allocate, in any tier, whatever happens") {
  std::vector<PlatePoses> all = {slope(1), PlatePoses{}, slope(25), slope(-25), below_base(), slope(1)};
  all.back().plates[0].displacement_mm.x() = std::numeric_limits<float>::quiet_NaN();
  for (const Tier tier : {Tier::kMeasures, Tier::kMap, Tier::kContact, Tier::kMapAndNewton, Tier::kNewton}) {
    ShapeStage stage = stage_of(tier);
    const long before = test::allocations;
    for (const PlatePoses& poses : all) stage.solve(poses);
    const long after = test::allocations;
    CHECK(after == before);
  }
}

TEST_CASE("shape stage: the measures alone are those of the map's shape") {
  ShapeStage measures = stage_of(Tier::kMeasures), map = stage_of(Tier::kMap);
  for (const double mm : {0.5, 2.0, -1.0}) {
    const FingerShape& alone = measures.solve(slope(mm));
    const FingerShape& whole = map.solve(slope(mm));
    CHECK(alone.node_mm.empty());
    CHECK(alone.source == ShapeSource::kMap);
    CHECK(alone.quality == Quality::kFresh);
    // The stage moves the plates of a whole shape exactly, the map nearly so.
    CHECK(alone.rms_mm == doctest::Approx(whole.rms_mm).epsilon(0.01));
    CHECK(alone.front_rms_mm == doctest::Approx(whole.front_rms_mm).epsilon(0.01));
    CHECK(alone.largest_mm == doctest::Approx(whole.largest_mm).epsilon(0.02));
  }
  CHECK(measures.solve(PlatePoses{}).quality == Quality::kInvalid);
}

TEST_CASE("shape stage: the contact tier's shape has the contact map's dimple, and it is measured") {
  ShapeStage contact = stage_of(Tier::kContact), map = stage_of(Tier::kMap);
  for (const double mm : {0.5, 2.0, -1.0}) {
    const FingerShape& dented = contact.solve(slope(mm));
    const FingerShape& plain = map.solve(slope(mm));
    CHECK(dented.source == ShapeSource::kContactMap);
    const float top_z_mm = slope(mm).plates[kTopPlate].displacement_mm.z();
    for (std::size_t i = 0; i < plain.node_mm.size(); ++i) {
      const float expected_mm = i == 3 * dimple().node + 2 ? 0.1f * top_z_mm : 0;
      CHECK(dented.node_mm[i] - plain.node_mm[i] == doctest::Approx(expected_mm).epsilon(1e-3));
    }
    const ShapeMeasures expected =
        measure_shape<float>(finger().data.rest_mm, finger().data.front_nodes, dented.node_mm);
    CHECK(dented.front_rms_mm == expected.front_rms_mm);
    CHECK(dented.largest_mm == expected.largest_mm);
  }
}

TEST_CASE("shape stage: beyond the contact map's training, and where its shape is unusable, the shape map answers") {
  ShapeStage contact = stage_of(Tier::kContact), map = stage_of(Tier::kMap);
  const PlatePoses near = slope(4), far = slope(8);
  REQUIRE(near.plates[kTopPlate].displacement_mm.norm() < 5);
  REQUIRE(far.plates[kTopPlate].displacement_mm.norm() > 6.3f);
  CHECK(contact.solve(near).source == ShapeSource::kContactMap);
  CHECK(contact.solve(far).source == ShapeSource::kMap);
  CHECK_FALSE(contact.solve(far).fallback);
  CHECK(copy(contact.solve(far)) == copy(map.solve(far)));

  const Finger& f = finger();
  std::vector<float> torn = dimple().basis;
  torn[3 * dimple().node + 2] += 50;  // turns elements inside out
  const ShapeMapModel torn_map = {1, dimple().scale, dimple().weights, torn};
  ShapeStage bad({f.data.view(), {1, f.scale, f.weights, f.basis}, f.mount, torn_map}, {.tier = Tier::kContact});
  const FingerShape& shape = bad.solve(slope(2));
  CHECK(shape.source == ShapeSource::kMap);
  CHECK_FALSE(shape.fallback);
  CHECK(copy(shape) == copy(map.solve(slope(2))));
}

TEST_CASE("shape stage: where no touch explains the plates the contact tier answers by the shape map") {
  ShapeStage contact = stage_of(Tier::kContact), map = stage_of(Tier::kMap);
  const PlatePoses poses = slope(2);
  CHECK(contact.solve(poses).source == ShapeSource::kContactMap);
  const FingerShape& unexplained = contact.solve(poses, pose_vector(poses), false);
  CHECK(unexplained.source == ShapeSource::kMap);
  CHECK_FALSE(unexplained.fallback);
  CHECK(copy(unexplained) == copy(map.solve(poses)));
}

TEST_CASE("shape stage: the contact tier needs a pack with a contact map, and says so") {
  test::TinyModel tiny;
  tiny.has_contact_map = false;
  const Model without = tiny.open(), with = test::TinyModel().open();
  CHECK_THROWS_WITH_AS(ShapeStage(without, {.tier = Tier::kContact}),
                       doctest::Contains("pack: contact map: found none, expected one for tier \"contact\""),
                       InputError);
  CHECK_NOTHROW(ShapeStage(without, {.tier = Tier::kMap}));
  CHECK_NOTHROW(ShapeStage(with, {.tier = Tier::kContact}));

  const PlatePoses rest = seen_poses(std::vector<float>(kPoseDims, 0.0F));
  CHECK(ShapeStage(with, {.tier = Tier::kBest}).solve(rest).source == ShapeSource::kContactMap);
  CHECK(ShapeStage(without, {.tier = Tier::kBest}).solve(rest).source == ShapeSource::kNewton);
}
