#include "hostgen/fem/contact_forces.h"

#include <doctest/doctest.h>

#include <algorithm>
#include <cmath>

#include "hostgen/util/random.h"
#include "tests/fem/box_mesh.h"

using namespace finsight;
using namespace finsight::host;
using Eigen::Index;
using Eigen::VectorXd;

namespace {

constexpr int kCandidates = 40;

FingerSpec noisy_spec() {
  FingerSpec spec = test::small_finger_spec();
  for (PoseNoise& noise : spec.noise)
    noise = {.lateral_mm = 0.005, .depth_mm = 0.02, .tilt_rad = 5e-4, .roll_rad = 5e-4};
  return spec;
}

struct Fixture {
  ContactForceSolver solver{noisy_spec(), test::small_finger_mesh(), kCandidates, 8};

  PlatePoses plates_under(const std::vector<FaceForce>& forces) {
    REQUIRE(solver.press(forces));
    return solver.plates();
  }
  double objective_at(const PlatePoses& measured, const VectorXd& force_n) {
    REQUIRE(solver.press(force_n));
    return solver.objective(measured);
  }
  double worst_mm(const ContactForces& found, const std::vector<double>& truth) const {
    double worst = 0;
    for (std::size_t i = 0; i < truth.size(); ++i) {
      worst = std::max(worst, std::abs(truth[i] - found.node_displacement_mm[i]));
    }
    return worst;
  }
};

const std::vector<FaceForce> kTwo = {{{3, 26, 0}, 0.3}, {{-3, 52, 0}, 0.1}};

}  // namespace

TEST_CASE_FIXTURE(Fixture, "contact forces: the adjoint gradient is the objective's derivative") {
  const PlatePoses measured = plates_under(kTwo);
  const VectorXd at = VectorXd::Constant(kCandidates, 0.008);
  REQUIRE(solver.press(at));
  VectorXd gradient;
  solver.objective(measured, &gradient);
  for (Index j = 0; j < kCandidates; j += 7) {
    constexpr double kStep_n = 1e-4;
    const VectorXd step = kStep_n * VectorXd::Unit(kCandidates, j);
    const double slope = (objective_at(measured, at + step) - objective_at(measured, at - step)) / (2 * kStep_n);
    CHECK(gradient[j] == doctest::Approx(slope).epsilon(1e-3));
  }
}

TEST_CASE_FIXTURE(Fixture, "contact forces: Gauss-Newton finds two contacts at once, and the shape") {
  const PlatePoses measured = plates_under(kTwo);
  const std::vector<double> truth = solver.node_displacement_mm();
  const ContactForces found = solver.gauss_newton(measured);
  CHECK(found.converged);
  CHECK(found.explained);
  REQUIRE(found.contacts.size() == 2);
  const std::size_t low = found.contacts[0].point_mm.y() < found.contacts[1].point_mm.y() ? 0 : 1;
  for (std::size_t i = 0; i < 2; ++i) {
    const Contact& contact = found.contacts[i == 0 ? low : 1 - low];
    CHECK((contact.point_mm - kTwo[i].point_mm).norm() < 0.5F);
    CHECK(contact.force_n == doctest::Approx(kTwo[i].force_n).epsilon(0.02));
  }
  CHECK(worst_mm(found, truth) < 0.02);
}

TEST_CASE_FIXTURE(Fixture, "contact forces: what is found is in equilibrium") {
  const ContactForces found = solver.gauss_newton(plates_under(kTwo));
  REQUIRE(solver.press(std::vector<FaceForce>(found.contacts.begin(), found.contacts.end())));
  CHECK(worst_mm(found, solver.node_displacement_mm()) < 5e-3);
}

TEST_CASE_FIXTURE(Fixture, "contact forces: L-BFGS descends, to what Gauss-Newton reaches sooner") {
  const PlatePoses measured = plates_under(kTwo);
  const ContactForces paper = solver.lbfgs(measured, 30), ours = solver.gauss_newton(measured);
  REQUIRE(paper.curve.size() > 10);
  CHECK(paper.curve.back().objective < 0.1 * paper.curve.front().objective);
  for (std::size_t i = 1; i < paper.curve.size(); ++i) CHECK(paper.curve[i].objective <= paper.curve[i - 1].objective);
  CHECK(ours.curve.back().objective < 9);
  CHECK(ours.curve.size() < paper.curve.size());
  CHECK(solver.press(paper.force_n));
  CHECK(solver.objective(measured) == doctest::Approx(paper.curve.back().objective).epsilon(0.01));
}

TEST_CASE_FIXTURE(Fixture, "contact forces: a finger at rest is not touched, a pulled one is not explained") {
  const ContactForces rest = solver.gauss_newton(plates_under({}));
  CHECK(rest.contacts.empty());
  CHECK(rest.explained);
  const ContactForces pulled = solver.gauss_newton(plates_under({{{0, 50, 0}, -0.2}}));
  CHECK(pulled.contacts.empty());
  CHECK_FALSE(pulled.explained);
}

TEST_CASE_FIXTURE(Fixture, "contact forces: one plate of three still finds the push, with more uncertainty") {
  const std::vector<FaceForce> push = {{{-3, 40, 0}, 0.3}};
  PlatePoses measured = plates_under(push);
  const ContactForces all = solver.gauss_newton(measured);
  measured.seen = {true, false, false};
  measured.plates[kLowPlate].displacement_mm.setConstant(5);  // must not count
  const ContactForces one = solver.gauss_newton(measured);
  REQUIRE(all.contacts.size() == 1);
  REQUIRE(one.contacts.size() == 1);
  CHECK(static_cast<double>((one.contacts[0].point_mm - push[0].point_mm).norm()) <=
        one.contacts[0].uncertainty.position_95_mm);
  CHECK(one.contacts[0].uncertainty.position_95_mm > all.contacts[0].uncertainty.position_95_mm);
}

TEST_CASE_FIXTURE(Fixture, "contact forces: a weak touch is found wherever it is") {
  for (const Vec3f& place :
       {Vec3f(0, 20, 0), Vec3f(-4, 27, 0), Vec3f(3, 33, 0), Vec3f(-1, 41, 0), Vec3f(4.5F, 54, 0)}) {
    for (const double force_n : {0.01, 0.02, 0.04}) {
      const ContactForces found = solver.gauss_newton(plates_under({{place, force_n}}));
      CAPTURE(place.y());
      CAPTURE(force_n);
      CHECK(found.explained);
      REQUIRE(found.contacts.size() == 1);
      const Contact& contact = found.contacts[0];
      CHECK(static_cast<double>((contact.point_mm - place).norm()) <= contact.uncertainty.position_95_mm);
      CHECK(contact.uncertainty.lowest_force_n <= force_n);
      CHECK(contact.uncertainty.highest_force_n >= force_n);
    }
  }
}

TEST_CASE_FIXTURE(Fixture, "contact forces: a pressure is within the uncertainty of the push that it looks like") {
  std::vector<FaceForce> line;
  for (int i = 0; i < 7; ++i) line.push_back({{4, 30 + 2.0F * static_cast<float>(i), 0}, 0.04});
  const ContactForces found = solver.gauss_newton(plates_under(line));
  REQUIRE(found.contacts.size() >= 1);
  for (const FaceForce& force : line) {
    bool within = false;
    for (const Contact& contact : found.contacts) {
      const double distance_mm = static_cast<double>((contact.point_mm - force.point_mm).head<2>().norm());
      within = within || distance_mm <= std::max(contact.uncertainty.position_95_mm, contact.uncertainty.extent_95_mm);
    }
    CHECK(within);
  }
}

TEST_CASE_FIXTURE(Fixture, "contact forces: an answer does not depend on what was asked before") {
  const PlatePoses measured = plates_under(kTwo);
  const ContactForces first = solver.gauss_newton(measured);
  solver.gauss_newton(plates_under({{{-3, 20, 0}, 0.2}}));
  const ContactForces again = solver.gauss_newton(measured);
  REQUIRE(first.contacts.size() == again.contacts.size());
  CHECK(first.contacts[0].force_n == again.contacts[0].force_n);
  CHECK(first.node_displacement_mm == again.node_displacement_mm);
}

TEST_CASE("contact forces: a strong push that one leap does not reach is followed from rest in parts") {
  const FingerSpec spec = read_finger_spec(FINSIGHT_SOURCE_DIR "/hostgen/fingers/srm.toml");
  ContactForceSolver solver(spec, make_mesh(spec, MeshSize::kCoarse), 120, 12);
  int in_parts = 0;  // which ones depends on rounding
  for (const FaceForce& push :
       {FaceForce{{-6, 32, 0}, 6}, FaceForce{{12, 56, 0}, 4}, FaceForce{{12, 68, 0}, 6}, FaceForce{{12, 68.5F, 0}, 6},
        FaceForce{{12, 79.5F, 0}, 6}, FaceForce{{12, 80, 0}, 6}}) {
    CAPTURE(push.point_mm.transpose());
    REQUIRE(solver.press({push}));
    const ContactForces found = solver.gauss_newton(solver.plates());
    in_parts += found.in_parts;
    CHECK(found.converged);
    CHECK(found.explained);
    REQUIRE(found.contacts.size() == 1);
    CHECK(static_cast<double>((found.contacts[0].point_mm - push.point_mm).head<2>().norm()) < 1);
    CHECK(found.contacts[0].force_n == doctest::Approx(push.force_n).epsilon(0.02));
    CHECK(found.contacts[0].uncertainty.lowest_force_n <= push.force_n);
    CHECK(found.contacts[0].uncertainty.highest_force_n >= push.force_n);
  }
  CHECK(in_parts >= 2);
}

TEST_CASE_FIXTURE(Fixture,
                  "contact forces: the sum of two is told better than each, and holds the truth as often as it says") {
  const PlatePoses exact = plates_under(kTwo);
  const PoseVectorOf<double> sigma = pose_noise(noisy_spec().noise);
  Random random(3);
  int inside = 0, narrower = 0, compared = 0;
  constexpr int kTrials = 40;
  for (int trial = 0; trial < kTrials; ++trial) {
    PlatePoses noisy = exact;
    for (int p = 0; p < kPlates; ++p) {
      PlateMotion& plate = noisy.plates[static_cast<std::size_t>(p)];
      for (int i = 0; i < 3; ++i) {
        plate.displacement_mm[i] += static_cast<float>(sigma[6 * p + i] * random.normal());
        plate.rotation_rad[i] += static_cast<float>(sigma[6 * p + 3 + i] * random.normal());
      }
    }
    const ContactForces found = solver.gauss_newton(noisy);
    inside += found.total.lowest_n <= 0.4 && found.total.highest_n >= 0.4;
    if (found.contacts.size() != 2) continue;
    double doubt_n = 0;
    for (const Contact& contact : found.contacts) {
      doubt_n += contact.uncertainty.highest_force_n - contact.uncertainty.lowest_force_n;
    }
    ++compared;
    narrower += found.total.highest_n - found.total.lowest_n < doubt_n;
    CHECK(found.total.force_n == doctest::Approx(found.contacts[0].force_n + found.contacts[1].force_n));
  }
  CHECK(inside >= 0.9 * kTrials);
  REQUIRE(compared > 0);
  CHECK(narrower == compared);
}
