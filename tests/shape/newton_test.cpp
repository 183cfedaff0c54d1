#include "firmware/shape/newton.h"

#include <doctest/doctest.h>

#include <algorithm>
#include <functional>
#include <limits>

#include "firmware/geometry/so3.h"
#include "firmware/input_error.h"
#include "firmware/shape/elements.h"
#include "hostgen/fem/shape_model.h"
#include "hostgen/finger/mesh.h"
#include "hostgen/finger/mount.h"
#include "hostgen/hard_cases/hard_motions.h"
#include "hostgen/hard_cases/shape_distance.h"
#include "tests/count_allocations.h"
#include "tests/shape/finger_motion.h"
#include "tests/shape/frame_mesh.h"
#include "tests/slow_build.h"

using namespace finsight;
using test::Bend;

namespace {

struct Finger {
  explicit Finger(const host::TetMesh& finger_mesh)
      : mesh(finger_mesh), data(host::make_shape_model(mesh)), mount(test::mount_of(mesh)) {}
  host::TetMesh mesh;
  host::ShapeModelData data;
  MountModel mount;
  ShapeModel model() const { return data.view(); }
};

const Finger& finger() {
  static const Finger the_finger(test::frame_mesh());
  return the_finger;
}
const Finger& small_finger() {
  static const Finger the_finger(test::frame_mesh(4, 12, 5));
  return the_finger;
}

template <class S>
double largest_plate_gap(const Finger& f, const NewtonSolver<S>& solver, const PlatePoses& poses) {
  double gap = 0;
  RigidPlates(f.model(), f.mount).for_each_node(plate_motions(poses), [&](int node, const Eigen::Vector3d& position) {
    for (int d = 0; d < 3; ++d)
      gap = std::max(gap, std::abs(static_cast<double>(solver.node_mm()[3 * node + d]) - position[d]));
  });
  return gap;
}

const Bend kHard{30, 0, 45};

}  // namespace

TEST_CASE("newton: stays at rest while the plates do, and its gradient there is zero") {
  NewtonSolver<double> solver(small_finger().model(), small_finger().mount);
  const auto outcome = solver.solve(Bend{}.poses(small_finger().mount), 1, 1);
  CHECK(outcome.ok);
  CHECK(outcome.steps == 2);
  CHECK(outcome.last_step_mm < 1e-12);
  // 6 for every tetrahedron with a free node.
  const auto is_free = [](int node) { return small_finger().model().free_index[node] >= 0; };
  const auto counted = std::ranges::count_if(small_finger().mesh.tets,
                                             [&](const auto& tet) { return std::ranges::any_of(tet, is_free); });
  CHECK(counted > 700);
  CHECK(solver.energy() == doctest::Approx(6.0 * static_cast<double>(counted)).epsilon(1e-12));
}

TEST_CASE("newton: a rigid motion of the whole finger costs nothing and makes no forces; a bend costs energy") {
  const Finger& f = small_finger();
  NewtonSolver<double> solver(f.model(), f.mount);
  const double rest = solver.energy();
  const Elements<double> elements(f.model());
  const Eigen::Matrix3d R = so3_exp(Eigen::Vector3d(0.4, -1.1, 2));
  std::vector<double> moved(solver.node_mm().begin(), solver.node_mm().end());
  for (std::size_t i = 0; i < moved.size(); i += 3) {
    Eigen::Map<Eigen::Vector3d> node(&moved[i]);
    node = (R * node + Eigen::Vector3d(30, -20, 5)).eval();
  }
  CHECK(elements.energy(moved) == doctest::Approx(rest).epsilon(1e-12));
  std::vector<double> force(moved.size());
  elements.gradient(moved, force);
  const auto largest = [](const std::vector<double>& forces) {
    return Eigen::Map<const Eigen::VectorXd>(forces.data(), static_cast<Eigen::Index>(forces.size()))
        .cwiseAbs()
        .maxCoeff();
  };
  CHECK(largest(force) < 1e-10);
  REQUIRE(solver.converge(Bend{10, 5, 10}.poses(f.mount), 1e-9, 100).ok);
  const std::vector<double> bent(solver.node_mm().begin(), solver.node_mm().end());
  elements.gradient(bent, force);
  CHECK(largest(force) > 0.1);  // on the plates, which are held
  CHECK(solver.energy() > rest + 1);
}

TEST_CASE("newton: the converged shape is a minimum: every free node's force is zero, by finite differences") {
  const Finger& f = small_finger();
  const PlatePoses poses = Bend{20, 10, 30}.poses(f.mount);
  NewtonSolver<double> solver(f.model(), f.mount);
  REQUIRE(solver.converge(poses, 1e-10, 200).ok);
  CHECK(largest_plate_gap(f, solver, poses) < 1e-12);
  const Cholesky<double> cholesky(f.model().cholesky);
  const Elements<double> elements(f.model(), &cholesky);
  std::vector<double> x(solver.node_mm().begin(), solver.node_mm().end());
  const double h = 1e-4;
  double largest_force = 0;
  for (int node = 0; node < f.model().nodes; node += 3) {
    if (f.model().free_index[node] < 0) continue;
    for (int d = 0; d < 3; ++d) {
      const double kept = x[3 * node + d];
      x[3 * node + d] = kept + h;
      const double above = elements.energy(x);
      x[3 * node + d] = kept - h;
      const double below = elements.energy(x);
      x[3 * node + d] = kept;
      largest_force = std::max(largest_force, std::abs(above - below) / (2 * h));
    }
  }
  CHECK(largest_force < 1e-5);
}

// Not quadratically: where elements are compressed the clamped Hessian is not the exact one.
TEST_CASE("newton: near the minimum every step leaves less than an eighth of the error") {
  const Finger& f = small_finger();
  const PlatePoses poses = Bend{15, 0, 20}.poses(f.mount);
  NewtonSolver<double> reference(f.model(), f.mount), solver(f.model(), f.mount);
  REQUIRE(reference.converge(poses, 1e-11, 200).ok);
  REQUIRE(solver.converge(poses, 0.3, 200).ok);
  std::vector<double> errors;
  for (int k = 0; k < 5; ++k) {
    errors.push_back(host::shape_distance(solver.node_mm(), reference.node_mm()).worst_mm);
    REQUIRE(solver.solve(poses, 1, 0).ok);
  }
  CAPTURE(errors[0]);
  CAPTURE(errors[1]);
  CAPTURE(errors[2]);
  CAPTURE(errors[3]);
  CHECK(errors[0] > 1e-5);
  for (std::size_t k = 0; k + 1 < errors.size(); ++k)
    if (errors[k] > 1e-9) CHECK(errors[k + 1] < errors[k] / 8);
}

TEST_CASE("newton: one factorisation and one chord step per frame follow a 30 mm bend with 45 degrees of twist") {
  const Finger& f = finger();
  NewtonSolver<double> reference(f.model(), f.mount);
  NewtonSolver<float> solver(f.model(), f.mount);
  double worst = 0;
  for (int frame = 1; frame <= kHard.frames() + 10; ++frame) {
    const PlatePoses poses = kHard.frame(f.mount, frame);
    REQUIRE(reference.converge(poses, 1e-7, 100).ok);
    const auto outcome = solver.solve(poses, 1, 1);
    REQUIRE(outcome.ok);
    CHECK(outcome.steps == 2);
    CHECK(solver.smallest_determinant() > 0);
    worst = std::max(worst, host::shape_distance(solver.node_mm(), reference.node_mm()).worst_mm);
  }
  MESSAGE("worst distance to the converged shape: " << worst << " mm");
  CHECK(worst <= 0.02);
  CHECK(largest_plate_gap(f, solver, kHard.poses(f.mount)) < 1e-4);
  CHECK(host::shape_distance(solver.node_mm(), reference.node_mm()).worst_mm < 1e-4);  // ten frames of rest later
}

TEST_CASE("newton: jumps from rest to the extreme and back split their motion and never invert an element") {
  const Finger& f = small_finger();
  NewtonSolver<float> solver(f.model(), f.mount);
  for (int frame = 0; frame < 40; ++frame) {
    const Bend bend = frame / 5 % 2 == 0 ? Bend{frame % 3 == 0 ? -30.0 : 30.0, 0, 45} : Bend{};
    const auto outcome = solver.solve(bend.poses(f.mount), 1, 1);
    CHECK(outcome.steps <= 2 * NewtonSolver<float>::kMaxFactorisations);
    CHECK(solver.smallest_determinant() > 0);
  }
}

TEST_CASE("newton: impossible poses leave a shape without inverted elements, and the finger comes back") {
  const Finger& f = small_finger();
  NewtonSolver<float> solver(f.model(), f.mount);
  PlatePoses crossed = Bend{}.poses(f.mount), swapped = crossed, flipped = crossed;
  crossed.plates[kTopPlate].displacement_mm = {0, -90, 0};
  swapped.plates[kTopPlate].displacement_mm = {0, -80, 0};
  swapped.plates[kLowPlate].displacement_mm = {0, 80, 0};
  flipped.plates[kMiddlePlate].rotation_rad = {0, 0, 3.14159f};
  for (const PlatePoses& poses : {crossed, swapped, flipped}) {
    for (int frame = 0; frame < 10; ++frame) {
      solver.solve(poses, 1, 1);
      CHECK(solver.smallest_determinant() > 0);
    }
  }
  solver.start_at_rest();
  CHECK(solver.solve(Bend{5, 0, 5}.poses(f.mount), 1, 1).ok);
}

TEST_CASE("newton: poses that are not finite or absurd keep the last shape and report failure") {
  const Finger& f = small_finger();
  NewtonSolver<float> solver(f.model(), f.mount);
  REQUIRE(solver.solve(Bend{5, 2, 5}.poses(f.mount), 1, 1).ok);
  const std::vector<float> before(solver.node_mm().begin(), solver.node_mm().end());
  constexpr float kNan = std::numeric_limits<float>::quiet_NaN(), kInfinity = std::numeric_limits<float>::infinity();
  for (const float bad : {kNan, kInfinity, -kInfinity, 1e30f, -1e5f}) {
    for (int k = 0; k < kPoseDims; ++k) {
      PlatePoses poses = Bend{6, 2, 5}.poses(f.mount);
      PlateMotion& plate = poses.plates[k / 6];
      (k % 6 < 3 ? plate.displacement_mm : plate.rotation_rad)[k % 3] = bad;
      CHECK_FALSE(solver.solve(poses, 1, 1).ok);
      CHECK_FALSE(solver.converge(poses, 1e-3, 10).ok);
    }
  }
  CHECK(std::equal(before.begin(), before.end(), solver.node_mm().begin()));
  CHECK(solver.solve(Bend{6, 2, 5}.poses(f.mount), 1, 1).ok);
}

TEST_CASE("newton: does not start from an inverted or non-finite shape") {
  const Finger& f = small_finger();
  NewtonSolver<float> solver(f.model(), f.mount);
  const PlatePoses rest = Bend{}.poses(f.mount);
  std::vector<float> shape(f.data.rest_mm);
  CHECK(solver.start_from(shape, plate_motions(rest)));
  const int* tet = f.data.tet_nodes.data();  // its first node goes through the opposite face
  while (f.data.free_index[tet[0]] < 0) tet += 4;
  const int free_node = tet[0];
  for (int d = 0; d < 3; ++d) {
    const float face = (shape[3 * tet[1] + d] + shape[3 * tet[2] + d] + shape[3 * tet[3] + d]) / 3;
    shape[3 * free_node + d] += 3 * (face - shape[3 * free_node + d]);
  }
  CHECK_FALSE(solver.start_from(shape, plate_motions(rest)));
  shape[3 * free_node] = std::numeric_limits<float>::quiet_NaN();
  CHECK_FALSE(solver.start_from(shape, plate_motions(rest)));
  CHECK(std::equal(f.data.rest_mm.begin(), f.data.rest_mm.end(), solver.node_mm().begin()));
}

TEST_CASE("newton: solve does not allocate") {
  const Finger& f = small_finger();
  NewtonSolver<float> solver(f.model(), f.mount);
  const PlatePoses near = Bend{5, 2, 5}.poses(f.mount), far = kHard.poses(f.mount);
  PlatePoses bad = near;
  bad.plates[0].rotation_rad.x() = std::numeric_limits<float>::quiet_NaN();
  const long before = test::allocations;
  for (const PlatePoses& poses : {std::cref(near), std::cref(far), std::cref(bad)}) solver.solve(poses, 2, 2);
  solver.converge(near, 1e-3, 20);
  CHECK(test::allocations == before);
}

TEST_CASE("newton: the size of the finger does not matter, metres or micrometres") {
  for (const double scale : {1e-3, 1e3}) {
    const Finger& f = small_finger();
    host::TetMesh scaled_mesh = f.mesh;
    for (auto& node : scaled_mesh.node_mm)
      for (double& coordinate : node) coordinate *= scale;
    const Finger scaled(scaled_mesh);
    NewtonSolver<float> solver(f.model(), f.mount), scaled_solver(scaled.model(), scaled.mount);
    const Bend bend{12, 4, 15};
    for (int frame = 1; frame <= bend.frames(); ++frame) {
      const PlatePoses poses = bend.frame(f.mount, frame);
      PlatePoses scaled_poses = poses;
      for (PlateMotion& plate : scaled_poses.plates) plate.displacement_mm *= static_cast<float>(scale);
      REQUIRE(solver.solve(poses, 1, 1).ok);
      REQUIRE(scaled_solver.solve(scaled_poses, 1, 1).ok);
    }
    std::vector<double> back(scaled_solver.node_mm().begin(), scaled_solver.node_mm().end());
    for (double& coordinate : back) coordinate /= scale;
    CHECK(host::shape_distance(solver.node_mm(), std::span<double>(back)).worst_mm < 1e-3);
  }
}

TEST_CASE("newton: one solve carries no plate further than its bounded steps, and the next ones go on") {
  const Finger& f = small_finger();
  const RigidPlates plates(f.model(), f.mount);
  NewtonSolver<float> solver(f.model(), f.mount);
  const double most_mm = NewtonSolver<float>::kMaxFactorisations * solver.plate_step_mm();
  const PlatePoses far = Bend{60, 0, 0}.poses(f.mount);
  CHECK(solver.is_jump({}, plate_motions(far)));
  CHECK_FALSE(solver.is_jump(plate_motions(far), plate_motions(far)));
  double gap_mm = largest_plate_gap(f, solver, far);
  int frames = 0;
  for (bool ok = false; !ok && frames < 10; ++frames) {
    const auto outcome = solver.solve(far, 1, 1);
    CHECK(outcome.steps <= NewtonSolver<float>::kMaxFactorisations + 1);
    const double left_mm = largest_plate_gap(f, solver, far);
    CHECK(gap_mm - left_mm <= most_mm + 1e-3);
    gap_mm = left_mm;
    ok = outcome.ok;
  }
  CHECK(frames > 1);
  CHECK(gap_mm < 1e-4);
}

TEST_CASE("newton: starts towards a shape that has inverted elements without inverting one") {
  const Finger& f = small_finger();
  NewtonSolver<float> solver(f.model(), f.mount);
  const PlatePoses poses = Bend{5, 0, 0}.poses(f.mount);
  std::vector<float> shape(f.data.rest_mm);
  test::Random random(5);
  for (float& coordinate : shape) coordinate += static_cast<float>(20 * random.normal());
  REQUIRE_FALSE(solver.start_from(shape, plate_motions(poses)));
  solver.start_towards(shape, plate_motions(poses));
  CHECK(solver.smallest_determinant() > 0);
  CHECK_FALSE(std::equal(f.data.rest_mm.begin(), f.data.rest_mm.end(), solver.node_mm().begin()));
  shape[0] = shape[3 * f.model().nodes - 1] = std::numeric_limits<float>::quiet_NaN();
  solver.start_towards(shape, plate_motions(poses));
  CHECK(solver.smallest_determinant() > 0);
}

// Such a tetrahedron has no unknown, but the poses can invert it.
TEST_CASE("newton: a tetrahedron between two plates limits the plates") {
  host::TetMesh mesh = small_finger().mesh;
  const auto& top = mesh.plate_nodes[kTopPlate];
  const auto& middle = mesh.plate_nodes[kMiddlePlate];
  std::array<int, 4> tet{top[0], top[1], middle[0], middle[2]};
  const auto point = [&](int node) { return Eigen::Map<const Eigen::Vector3d>(mesh.node_mm[node].data()); };
  const auto volume = [&] {
    return (point(tet[1]) - point(tet[0])).cross(point(tet[2]) - point(tet[0])).dot(point(tet[3]) - point(tet[0]));
  };
  for (std::size_t i = 0; i < top.size() * middle.size() && std::abs(volume()) < 1; ++i) {
    tet[1] = top[i / middle.size()];
    tet[3] = middle[i % middle.size()];
  }
  REQUIRE(std::abs(volume()) >= 1);
  if (volume() < 0) std::swap(tet[0], tet[1]);
  mesh.tets.push_back(tet);
  mesh.region.push_back(host::kBodyRegion);
  const Finger f(mesh);
  NewtonSolver<float> solver(f.model(), f.mount);
  PlatePoses crossed = Bend{}.poses(f.mount);
  crossed.plates[kTopPlate].displacement_mm.y() = -60;
  for (int frame = 0; frame < 10; ++frame) {
    CHECK_FALSE(solver.solve(crossed, 1, 1).ok);
    CHECK(solver.smallest_determinant() > 0);
  }
}

TEST_CASE("newton: a schedule of another mesh is refused") {
  const Finger other(test::frame_mesh(4, 15, 5));
  ShapeModel model = small_finger().model();
  model.cholesky = other.data.cholesky.view();
  CHECK_THROWS_AS((NewtonSolver<float>(model, small_finger().mount)), InputError);
  model = other.model();
  model.cholesky = small_finger().data.cholesky.view();
  CHECK_THROWS_AS((NewtonSolver<float>(model, other.mount)), InputError);
}

TEST_CASE("elements: the step to the first flat element agrees with bisection on determinants") {
  const Finger& f = small_finger();
  const Cholesky<double> cholesky(f.model().cholesky);
  const Elements<double> elements(f.model(), &cholesky);
  const std::vector<double> rest(f.data.rest_mm.begin(), f.data.rest_mm.end());
  test::Random random(11);
  int shortened = 0;
  for (int i = 0; i < 60; ++i) {
    std::vector<double> step(rest.size(), 0.0);
    const double size = std::exp(random.uniform(-2, 4));
    for (std::size_t k = 0; k < step.size(); ++k)
      if (f.data.free_index[k / 3] >= 0) step[k] = size * random.normal();
    const double longest = elements.longest_step(rest, step);
    REQUIRE(longest > 0);
    // At rest every determinant is 1, so none may be below 0.1 on the way, and one must reach it at the end.
    std::vector<double> x(rest.size());
    const auto smallest_at = [&](double t) {
      for (std::size_t k = 0; k < x.size(); ++k) x[k] = rest[k] + t * step[k];
      return elements.smallest_determinant(x);
    };
    for (int k = 1; k <= 50; ++k) CHECK(smallest_at(longest * k / 50) > 0.1 - 1e-6);
    if (longest < 1) {
      ++shortened;
      CHECK(smallest_at(longest) == doctest::Approx(0.1).epsilon(1e-5));
    }
  }
  CHECK(shortened > 10);
  CHECK(shortened < 60);
}

TEST_CASE("shape model: names what makes a mesh unusable") {
  host::TetMesh orphan = small_finger().mesh, two_plates = orphan, inverted = orphan, at_base = orphan;
  orphan.node_mm.push_back({0, 0, 0});
  CHECK_THROWS_AS(host::make_shape_model(orphan), InputError);
  two_plates.plate_nodes[1].push_back(two_plates.plate_nodes[0][0]);
  CHECK_THROWS_AS(host::make_shape_model(two_plates), InputError);
  at_base.base_nodes.push_back(at_base.plate_nodes[0][0]);
  CHECK_THROWS_AS(host::make_shape_model(at_base), InputError);
  std::swap(inverted.tets[5][0], inverted.tets[5][1]);
  const host::ShapeModelData data = host::make_shape_model(inverted);
  CHECK_THROWS_AS((NewtonSolver<float>(data.view(), small_finger().mount)), InputError);
}

TEST_CASE("newton: follows a bend on every mesh that hostgen makes") {
  const host::FingerSpec spec = host::read_finger_spec(FINSIGHT_SOURCE_DIR "/hostgen/fingers/srm.toml");
  const MountModel mount = host::mount_of(spec);
  std::vector<host::MeshSize> sizes = {host::MeshSize::kCoarse, host::MeshSize::kDefault};
  if (!test::kIsSlow) sizes.insert(sizes.end(), {host::MeshSize::kMedium, host::MeshSize::kFine});
  for (const host::MeshSize size : sizes) {
    const host::ShapeModelData data = host::make_shape_model(host::make_mesh(spec, size));
    CAPTURE(data.view().tets);
    NewtonSolver<float> solver(data.view(), mount);
    NewtonSolver<double> reference(data.view(), mount);
    const host::HardMotion motion = host::HardMotion(mount).go(host::Bend{15, 0, 20}, 40).hold(3);
    for (const PlatePoses& poses : motion.frames) REQUIRE(solver.solve(poses, 1, 1).ok);
    REQUIRE(reference.converge(motion.frames.back(), 1e-6, 200).ok);
    CHECK(host::shape_distance(solver.node_mm(), reference.node_mm()).worst_mm < 1e-3);
    CHECK(solver.smallest_determinant() > 0);
  }
}
