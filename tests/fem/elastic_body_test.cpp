#include "hostgen/fem/elastic_body.h"

#include <doctest/doctest.h>

#include <cmath>
#include <vector>

#include "hostgen/util/random.h"
#include "tests/fem/box_mesh.h"

using namespace finsight;
using namespace finsight::host;

namespace {

struct Beam {
  QuadraticMesh mesh = make_quadratic(test::box_mesh({{0, 0, 0}, {4, 8, 4}, {1, 2, 1}}));
  ElasticBody body{mesh, std::vector<NeoHookean>(mesh.tets.size(), neo_hookean(10, 0.47))};

  /// A displacement of the free nodes of up to `size_mm`, smooth enough to invert nothing; zero for fixed nodes.
  std::vector<double> random_displacement(double size_mm, std::uint64_t seed) const {
    Random random(seed);
    std::vector<double> u(body.vector_size());
    for (std::size_t i = 0; i < body.solved_size(); ++i) u[i] = size_mm * random.uniform(-1, 1);
    return u;
  }
  std::vector<double> forces(const std::vector<double>& u) const {
    std::vector<double> force(body.vector_size());
    REQUIRE(body.forces(u, force) > 0);
    return force;
  }
};

}  // namespace

TEST_CASE("elastic body: at rest there are no forces") {
  const Beam beam;
  for (const double force : beam.forces(std::vector<double>(beam.body.vector_size()))) CHECK(std::abs(force) < 1e-12);
}

TEST_CASE("elastic body: the tangent is the derivative of the forces") {
  const Beam beam;
  const std::vector<double> u = beam.random_displacement(0.15, 3), none(u.size());
  std::vector<double> stress(beam.body.stress_size());
  beam.body.stresses(u, none, stress);
  const CholeskyPlanData& plan = beam.body.plan();
  std::vector<float> blocks(9 * plan.pattern_row.size());
  beam.body.tangent(u, stress, std::span<float>(blocks));

  // Columns of the tangent, gathered from its lower blocks, against central differences.
  constexpr double kStep_mm = 1e-5;
  double largest = 0, worst = 0;
  for (int column_position = 0; column_position < plan.blocks; column_position += 5) {
    for (int component = 0; component < 3; ++component) {
      const int node = plan.order[static_cast<std::size_t>(column_position)];
      std::vector<double> plus = u, minus = u;
      plus[static_cast<std::size_t>(3 * node + component)] += kStep_mm;
      minus[static_cast<std::size_t>(3 * node + component)] -= kStep_mm;
      const std::vector<double> f_plus = beam.forces(plus), f_minus = beam.forces(minus);
      for (int e = plan.pattern_start[column_position]; e < plan.pattern_start[column_position + 1]; ++e) {
        const int row_node = plan.order[static_cast<std::size_t>(plan.pattern_row[e])];
        for (int r = 0; r < 3; ++r) {
          const std::size_t i = static_cast<std::size_t>(3 * row_node + r);
          const double expected = (f_plus[i] - f_minus[i]) / (2 * kStep_mm);
          largest = std::max(largest, std::abs(expected));
          worst = std::max(worst, std::abs(blocks[static_cast<std::size_t>(9 * e + 3 * r + component)] - expected));
        }
      }
    }
  }
  REQUIRE(largest > 1);
  CHECK(worst < 1e-6 * largest);
}

TEST_CASE("elastic body: forces of a uniform stretch balance inside the body") {
  const Beam beam;
  std::vector<double> u(beam.body.vector_size());
  // The gradient of displacement is the same everywhere, and zero on the fixed plane y = 0.
  for (std::size_t node = 0; node < beam.mesh.node_mm.size(); ++node) {
    const auto unknown = static_cast<std::size_t>(beam.body.unknown_of_node()[node]);
    if (unknown == static_cast<std::size_t>(beam.body.free_nodes())) continue;
    const double y = beam.mesh.node_mm[node].y();
    for (std::size_t k = 0; k < 3; ++k) u[3 * unknown + k] = (k == 1 ? 0.05 : 0.02) * y;
  }
  const std::vector<double> force = beam.forces(u);
  int inner = 0;
  for (std::size_t node = 0; node < beam.mesh.node_mm.size(); ++node) {
    const auto& at = beam.mesh.node_mm[node];
    const bool inside = at.x() > 0 && at.x() < 4 && at.y() > 0 && at.y() < 8 && at.z() > 0 && at.z() < 4;
    if (!inside) continue;
    ++inner;
    const auto unknown = static_cast<std::size_t>(beam.body.unknown_of_node()[node]);
    for (std::size_t k = 0; k < 3; ++k) CHECK(std::abs(force[3 * unknown + k]) < 1e-9);
  }
  CHECK(inner > 0);
}
