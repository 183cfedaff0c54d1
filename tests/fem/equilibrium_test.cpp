#include "hostgen/fem/equilibrium.h"

#include <doctest/doctest.h>

#include <cmath>
#include <vector>

#include "tests/fem/box_mesh.h"

using namespace finsight;
using namespace finsight::host;

namespace {

struct Beam {
  QuadraticMesh mesh = make_quadratic(test::box_mesh({{0, 0, 0}, {4, 30, 4}, {1, 8, 1}}));
  ElasticBody body{mesh, std::vector<NeoHookean>(mesh.tets.size(), neo_hookean(10, 0.47))};
  ElasticState rest{body};

  Beam() { body.stresses(rest.u, rest.u, rest.stress); }

  /// `force_n` along axis `axis`, shared by the corner nodes of the beam's end.
  std::vector<double> load(double force_n, std::size_t axis) const {
    std::vector<double> load(body.vector_size());
    for (std::size_t node = 0; node < mesh.corner_nodes; ++node) {
      if (mesh.node_mm[node].y() != 30) continue;
      load[3 * static_cast<std::size_t>(body.unknown_of_node()[node]) + axis] = force_n / 4;
    }
    return load;
  }
  double unbalanced(const std::vector<double>& load, const ElasticState& state) const {
    std::vector<double> force(body.vector_size());
    body.forces(state.u, force);
    double sum = 0, size = 0;
    for (std::size_t i = 0; i < body.solved_size(); ++i) {
      sum += (load[i] - force[i]) * (load[i] - force[i]);
      size += load[i] * load[i];
    }
    return std::sqrt(sum / size);
  }
};

}  // namespace

TEST_CASE("equilibrium: internal forces balance the load to 1e-8, although the factor is in single precision") {
  const Beam beam;
  Equilibrium equilibrium(beam.body);
  ElasticState state = beam.rest;
  double force_n = 0;
  for (int step = 0; step < 4; ++step) {
    force_n += 0.02;
    const auto load = beam.load(force_n, 2);
    REQUIRE(equilibrium.solve(load, state));
    CHECK(beam.unbalanced(load, state) <= 1e-8);
  }
  CHECK(equilibrium.cost().factorisations >= 4);
  CHECK(equilibrium.cost().steps > equilibrium.cost().factorisations);  // chords were taken
}

TEST_CASE("equilibrium: an answer depends on its start alone") {
  const Beam beam;
  Equilibrium used(beam.body), fresh(beam.body);
  ElasticState other = beam.rest, first = beam.rest, second = beam.rest;
  REQUIRE(used.solve(beam.load(0.03, 0), other));
  REQUIRE(used.solve(beam.load(0.02, 2), first));
  REQUIRE(fresh.solve(beam.load(0.02, 2), second));
  CHECK(first.u == second.u);
  CHECK(first.stress == second.stress);
}

TEST_CASE("equilibrium: a straight column under more than its buckling load is refused") {
  const Beam beam;
  Equilibrium equilibrium(beam.body);
  // Euler: pi^2 E I / (4 L^2) = 0.58 N
  ElasticState state = beam.rest;
  CHECK(equilibrium.solve(beam.load(-0.3, 1), state));
  state = beam.rest;
  CHECK_FALSE(equilibrium.solve(beam.load(-1.2, 1), state));
}

TEST_CASE("equilibrium: a load that turns elements inside out at once is refused") {
  const Beam beam;
  Equilibrium equilibrium(beam.body);
  ElasticState state = beam.rest;
  CHECK_FALSE(equilibrium.solve(beam.load(3000, 2), state));
}

TEST_CASE("equilibrium: a column's softest stiffness falls in proportion to its load, to 0 at the buckling load") {
  const Beam beam;
  Equilibrium equilibrium(beam.body);
  const double at_rest = equilibrium.softest_stiffness(beam.rest);
  for (const double force_n : {0.145, 0.29, 0.435}) {
    ElasticState state = beam.rest;
    REQUIRE(equilibrium.solve(beam.load(-force_n, 1), state));
    CHECK(equilibrium.softest_stiffness(state) / at_rest == doctest::Approx(1 - force_n / 0.58).epsilon(0.1));
  }
}

TEST_CASE("equilibrium: a strip too slender for single precision is factored in double, and bends as theory says") {
  // 160 mm long, 0.4 mm thick, its outer half a hundred times stiffer: as a fin-ray's ribs with plates on them.
  const QuadraticMesh mesh = make_quadratic(test::box_mesh({{0, 0, 0}, {4, 160, 0.4}, {1, 80, 1}}));
  std::vector<NeoHookean> material;
  for (const auto& tet : mesh.tets) {
    double y_mm = 0;
    for (std::size_t i = 0; i < 4; ++i) y_mm += mesh.node_mm[static_cast<std::size_t>(tet[i])].y() / 4;
    material.push_back(neo_hookean(y_mm > 80 ? 1000 : 10, 0));
  }
  const ElasticBody body(mesh, material);
  ElasticState state(body);
  body.stresses(state.u, state.u, state.stress);
  constexpr double kForce_n = 1e-8;  // bends it by a thousandth of its length
  std::vector<double> load(body.vector_size());
  for (std::size_t node = 0; node < mesh.corner_nodes; ++node) {
    if (mesh.node_mm[node].y() == 160)
      load[3 * static_cast<std::size_t>(body.unknown_of_node()[node]) + 2] = kForce_n / 4;
  }
  Equilibrium equilibrium(body);
  REQUIRE(equilibrium.solve(load, state));
  CHECK(equilibrium.cost().in_double > 0);
  double end_mm = 0;
  for (std::size_t node = 0; node < mesh.corner_nodes; ++node) {
    if (mesh.node_mm[node].y() == 160)
      end_mm += state.u[3 * static_cast<std::size_t>(body.unknown_of_node()[node]) + 2] / 4;
  }
  const double inertia = 4 * 0.4 * 0.4 * 0.4 / 12, E = 10, half = 80;
  // The inner half carries force and moment, the outer one follows its end and hardly bends.
  const double moment = kForce_n * half, EI = E * inertia;
  const double theory_mm = kForce_n * half * half * half / (3 * EI) + moment * half * half / (2 * EI) +
                           half * (kForce_n * half * half / (2 * EI) + moment * half / EI) +
                           kForce_n * half * half * half / (3 * 100 * EI);
  CHECK(end_mm == doctest::Approx(theory_mm).epsilon(0.03));
}
