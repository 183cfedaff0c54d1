#include "firmware/shape/cholesky.h"

#include <doctest/doctest.h>

#include <Eigen/Cholesky>
#include <Eigen/SparseCholesky>
#include <array>
#include <limits>
#include <set>

#include "firmware/input_error.h"
#include "firmware/shape/elements.h"
#include "hostgen/fem/cholesky_plan.h"
#include "hostgen/fem/shape_model.h"
#include "tests/count_allocations.h"
#include "tests/shape/frame_mesh.h"

using namespace finsight;
using host::CholeskyPlanData;
using host::plan_cholesky;
using test::Random;

namespace {

using Neighbours = std::vector<std::vector<int>>;
using SparseMatrix = Eigen::SparseMatrix<double>;

Neighbours from_edges(int blocks, const std::set<std::pair<int, int>>& edges) {
  Neighbours neighbours(blocks);
  for (const auto& [a, b] : edges) {
    neighbours[a].push_back(b);
    neighbours[b].push_back(a);
  }
  for (auto& list : neighbours) std::sort(list.begin(), list.end());
  return neighbours;
}

Neighbours random_graph(int blocks, double edges_per_block, Random& random) {
  std::set<std::pair<int, int>> edges;
  for (int k = 0; k < blocks * edges_per_block && blocks > 1; ++k) {
    const int a = static_cast<int>(random.uniform() * blocks), b = static_cast<int>(random.uniform() * blocks);
    if (a != b) edges.insert(std::minmax(a, b));
  }
  return from_edges(blocks, edges);
}

// Three-dimensional grid, every block coupled with its 26 neighbours.
Neighbours grid_graph(int nx, int ny, int nz) {
  std::set<std::pair<int, int>> edges;
  const auto at = [&](int x, int y, int z) { return (x * ny + y) * nz + z; };
  for (int x = 0; x < nx; ++x)
    for (int y = 0; y < ny; ++y)
      for (int z = 0; z < nz; ++z)
        for (int k = 0; k < 27; ++k) {
          const int u = x + k / 9 - 1, v = y + k / 3 % 3 - 1, w = z + k % 3 - 1;
          if (u < 0 || v < 0 || w < 0 || u >= nx || v >= ny || w >= nz || k == 13) continue;
          edges.insert(std::minmax(at(x, y, z), at(u, v, w)));
        }
  return from_edges(nx * ny * nz, edges);
}

// A random symmetric positive definite matrix of this pattern: springs between blocks, plus a little on the diagonal.
// Badly conditioned on purpose, like a stiffness matrix.
SparseMatrix random_matrix(const Neighbours& neighbours, double diagonal, Random& random) {
  std::vector<Eigen::Triplet<double>> entries;
  const auto add = [&](int a, int b, const Eigen::Matrix3d& block) {
    for (int r = 0; r < 3; ++r)
      for (int c = 0; c < 3; ++c) entries.emplace_back(3 * a + r, 3 * b + c, block(r, c));
  };
  for (int a = 0; a < static_cast<int>(neighbours.size()); ++a) {
    add(a, a, diagonal * Eigen::Matrix3d::Identity());
    for (const int b : neighbours[a]) {
      if (b < a) continue;
      const Eigen::Matrix3d root = Eigen::Matrix3d::NullaryExpr([&] { return random.normal(); });
      const Eigen::Matrix3d spring = root * root.transpose();
      add(a, a, spring);
      add(b, b, spring);
      add(a, b, -spring);
      add(b, a, -spring);
    }
  }
  const int n = 3 * static_cast<int>(neighbours.size());
  SparseMatrix matrix(n, n);
  matrix.setFromTriplets(entries.begin(), entries.end());
  return matrix;
}

template <class S>
void fill(Cholesky<S>& cholesky, const CholeskyPlan& plan, const SparseMatrix& matrix) {
  for (int j = 0; j < plan.blocks; ++j)
    for (int e = plan.pattern_start[j]; e < plan.pattern_start[j + 1]; ++e)
      for (int k = 0; k < 9; ++k)
        cholesky.values()[9 * e + k] =
            static_cast<S>(matrix.coeff(3 * plan.order[plan.pattern_row[e]] + k / 3, 3 * plan.order[j] + k % 3));
}

// |A x - b| / (|A| |x|): the backward error, which does not depend on how well A is conditioned.
template <class S>
double backward_error(const Neighbours& neighbours, double diagonal, Random& random) {
  const CholeskyPlanData plan = plan_cholesky(neighbours);
  const SparseMatrix matrix = random_matrix(neighbours, diagonal, random);
  Cholesky<S> cholesky(plan.view());
  fill(cholesky, plan.view(), matrix);
  REQUIRE(cholesky.factor());
  const Eigen::VectorXd b = Eigen::VectorXd::NullaryExpr(matrix.rows(), [&] { return random.normal(); });
  Eigen::Matrix<S, Eigen::Dynamic, 1> x = b.cast<S>();
  cholesky.solve({x.data(), static_cast<std::size_t>(x.size())});
  const Eigen::VectorXd y = x.template cast<double>();
  return (matrix * y - b.cast<S>().template cast<double>()).norm() / (matrix.norm() * y.norm());
}

CholeskyPlanData small_plan() {
  Random random(7);
  return plan_cholesky(random_graph(40, 2, random));
}

}  // namespace

TEST_CASE("cholesky: solves random sparse matrices to rounding, in float and double") {
  Random random(1);
  for (const int blocks : {1, 2, 3, 7, 30, 100, 400}) {
    for (const double density : {0.0, 0.5, 1.0, 3.0, 10.0}) {
      CAPTURE(blocks);
      CAPTURE(density);
      const Neighbours neighbours = random_graph(blocks, density, random);
      CHECK(backward_error<double>(neighbours, 1e-3, random) < 1e-14);
      CHECK(backward_error<float>(neighbours, 1e-1, random) < 5e-6);
    }
  }
}

TEST_CASE("cholesky: gives up when it is told to, and factors again when it is not") {
  const CholeskyPlanData plan = small_plan();
  Random random(5), graph(7);
  Cholesky<double> cholesky(plan.view());
  fill(cholesky, plan.view(), random_matrix(random_graph(40, 2, graph), 1, random));
  std::atomic<bool> stop{true};
  cholesky.give_up_when(stop);
  CHECK_FALSE(cholesky.factor());
  stop = false;
  CHECK(cholesky.factor());
}

TEST_CASE("cholesky: agrees with Eigen on the matrix of a solid block") {
  Random random(2);
  const Neighbours neighbours = grid_graph(9, 8, 7);
  const CholeskyPlanData plan = plan_cholesky(neighbours);
  const SparseMatrix matrix = random_matrix(neighbours, 0.1, random);
  Cholesky<double> cholesky(plan.view());
  fill(cholesky, plan.view(), matrix);
  REQUIRE(cholesky.factor());
  const Eigen::SimplicialLLT<SparseMatrix> reference(matrix);
  for (int repeat = 0; repeat < 3; ++repeat) {
    Eigen::VectorXd x = Eigen::VectorXd::NullaryExpr(matrix.rows(), [&] { return random.normal(); });
    const Eigen::VectorXd expected = reference.solve(x);
    cholesky.solve({x.data(), static_cast<std::size_t>(x.size())});
    CHECK((x - expected).norm() < 1e-11 * expected.norm());
  }
}

TEST_CASE("cholesky: solves the Hessian of bent fingers of 1,000 to 19,000 tetrahedra to rounding") {
  for (const auto& [across, up, deep] : {std::array{4, 15, 5}, std::array{8, 27, 6}, std::array{20, 60, 14}}) {
    const host::ShapeModelData data = host::make_shape_model(test::frame_mesh(across, up, deep));
    const ShapeModel model = data.view();
    CAPTURE(model.tets);
    Cholesky<double> cholesky(model.cholesky);
    Cholesky<float> single(model.cholesky);
    const Elements<double> elements(model, &cholesky);
    std::vector<double> x(data.rest_mm.begin(), data.rest_mm.end()), g(x.size()), still(x.size(), 0.0);
    for (std::size_t i = 0; i < x.size(); i += 3) x[i + 2] += 2e-3 * x[i + 1] * x[i + 1];
    elements.gradient_and_hessian(x, still, g, cholesky.values());
    std::copy(cholesky.values().begin(), cholesky.values().end(), single.values().begin());
    std::vector<Eigen::Triplet<double>> entries;
    const CholeskyPlan& plan = model.cholesky;
    for (int j = 0; j < plan.blocks; ++j)
      for (int e = plan.pattern_start[j]; e < plan.pattern_start[j + 1]; ++e)
        for (int k = 0; k < 9; ++k)
          entries.emplace_back(3 * plan.order[plan.pattern_row[e]] + k / 3, 3 * plan.order[j] + k % 3,
                               cholesky.values()[9 * e + k]);
    SparseMatrix half(3 * plan.blocks, 3 * plan.blocks);  // blocks off the diagonal once, those on it whole
    half.setFromTriplets(entries.begin(), entries.end());
    Random random(3);
    const Eigen::VectorXd b = Eigen::VectorXd::NullaryExpr(half.rows(), [&] { return random.normal(); });
    const auto times = [&](const Eigen::VectorXd& y) -> Eigen::VectorXd {
      Eigen::VectorXd result = Eigen::VectorXd::Zero(y.size());
      for (const auto& entry : entries) {
        result[entry.row()] += entry.value() * y[entry.col()];
        if (entry.row() / 3 != entry.col() / 3) result[entry.col()] += entry.value() * y[entry.row()];
      }
      return result;
    };
    REQUIRE(cholesky.factor());
    REQUIRE(single.factor());
    Eigen::VectorXd y = b;
    Eigen::VectorXf z = b.cast<float>();
    cholesky.solve({y.data(), static_cast<std::size_t>(y.size())});
    single.solve({z.data(), static_cast<std::size_t>(z.size())});
    CHECK((times(y) - b).norm() < 1e-14 * half.norm() * y.norm());
    CHECK((times(z.cast<double>()) - b).norm() < 5e-6 * half.norm() * y.norm());
  }
}

TEST_CASE("cholesky: factors a single front, long chains and a star correctly") {
  Random random(3);
  for (const int blocks : {30, 200}) {  // the larger ones are dissected, if that can be done
    std::set<std::pair<int, int>> all, chain, star;
    for (int a = 0; a < blocks; ++a) {
      for (int b = a + 1; b < blocks; ++b) all.insert({a, b});
      if (a > 0) chain.insert({a - 1, a});
      if (a > 0) star.insert({0, a});
    }
    for (const auto& edges : {all, chain, star})
      CHECK(backward_error<double>(from_edges(blocks, edges), 1e-2, random) < 1e-14);
  }
}

TEST_CASE("cholesky: a bar in cross-section by cross-section is dearer than the order of its plan") {
  constexpr int kSide = 9, kLength = 40;
  const CholeskyPlanData plan = plan_cholesky(grid_graph(kLength, kSide, kSide));
  // A front of a cross-section's columns and as many rows below, for each cross-section but the last.
  const double columns = 3 * kSide * kSide;
  const double one_by_one = kLength * columns * columns * columns * (1.0 / 6 + 1.0 / 2 + 1.0 / 2);
  CHECK(Cholesky<float>(plan.view()).factor_operations() < 0.7 * one_by_one);
}

TEST_CASE("cholesky: the same values give the same factor, whatever was factored in between") {
  Random random(4);
  const Neighbours neighbours = grid_graph(5, 5, 5);
  const CholeskyPlanData plan = plan_cholesky(neighbours);
  const SparseMatrix first = random_matrix(neighbours, 0.1, random), second = random_matrix(neighbours, 0.1, random);
  Cholesky<float> cholesky(plan.view());
  const auto solve_for = [&](const SparseMatrix& matrix) {
    fill(cholesky, plan.view(), matrix);
    REQUIRE(cholesky.factor());
    std::vector<float> x(3 * plan.blocks, 1.0f);
    cholesky.solve(x);
    return x;
  };
  const std::vector<float> before = solve_for(first);
  solve_for(second);
  CHECK(solve_for(first) == before);
}

TEST_CASE("cholesky: factor and solve in one call equal the two calls, bit for bit") {
  Random random(21);
  const Neighbours neighbours = grid_graph(6, 5, 4);
  const CholeskyPlanData plan = plan_cholesky(neighbours);
  const SparseMatrix matrix = random_matrix(neighbours, 1e-2, random);
  Cholesky<float> apart(plan.view()), together(plan.view());
  fill(apart, plan.view(), matrix);
  fill(together, plan.view(), matrix);
  std::vector<float> x(3 * neighbours.size()), y;
  for (float& value : x) value = static_cast<float>(random.normal());
  y = x;
  REQUIRE(apart.factor());
  apart.solve(x);
  REQUIRE(together.factor_and_solve(y));
  CHECK(x == y);
  together.solve(y);  // the factor stays for chord steps
  apart.solve(x);
  CHECK(x == y);
  const std::vector<float> before = y;
  together.values()[0] = -1;
  CHECK_FALSE(together.factor_and_solve(y));
  CHECK(y == before);
}

TEST_CASE("cholesky: right-hand sides side by side give what each gives alone, to rounding") {
  Random random(6);
  const Neighbours neighbours = grid_graph(5, 6, 4);
  const CholeskyPlanData plan = plan_cholesky(neighbours);
  const SparseMatrix matrix = random_matrix(neighbours, 0.1, random);
  Cholesky<double> cholesky(plan.view());
  fill(cholesky, plan.view(), matrix);
  REQUIRE(cholesky.factor());
  std::vector<simd::Vector<double>> lanes(static_cast<std::size_t>(matrix.rows()));
  for (auto& row : lanes)
    for (int lane = 0; lane < simd::kLanesOf<double>; ++lane) row[lane] = random.normal();
  const auto right = lanes;
  cholesky.solve(lanes);
  for (int lane = 0; lane < simd::kLanesOf<double>; ++lane) {
    std::vector<double> alone;
    for (const auto& row : right) {
      const double value = row[lane];  // clang cannot bind a reference to a lane
      alone.push_back(value);
    }
    cholesky.solve(alone);
    for (std::size_t i = 0; i < alone.size(); ++i) {
      const double together = lanes[i][lane];
      CHECK(together == doctest::Approx(alone[i]).epsilon(1e-9));
    }
  }
}

TEST_CASE("cholesky: refuses negative and zero pivots, NaN and infinity, and recovers") {
  Random random(5);
  const Neighbours neighbours = grid_graph(6, 5, 4);
  const CholeskyPlanData plan = plan_cholesky(neighbours);
  const SparseMatrix matrix = random_matrix(neighbours, 0.1, random);
  Cholesky<float> cholesky(plan.view());
  const float nan = std::numeric_limits<float>::quiet_NaN(), infinity = std::numeric_limits<float>::infinity();
  for (const float bad : {-1.0f, 0.0f, nan, infinity, -infinity}) {
    for (const int column : {0, plan.blocks / 2, plan.blocks - 1}) {
      for (const int k : {0, 4, 8}) {
        fill(cholesky, plan.view(), matrix);
        cholesky.values()[9 * plan.pattern_start[column] + k] = bad;
        CHECK_FALSE(cholesky.factor());
      }
      fill(cholesky, plan.view(), matrix);
      CHECK(cholesky.factor());
    }
  }
  for (const float bad : {nan, infinity}) {  // off the diagonal it reaches a pivot too
    fill(cholesky, plan.view(), matrix);
    cholesky.values()[9 * (plan.pattern_start[0] + 1) + 5] = bad;
    CHECK_FALSE(cholesky.factor());
  }
}

TEST_CASE("cholesky: flushes denormal numbers inside and leaves them alone outside") {
  Random random(6);
  const CholeskyPlanData plan = small_plan();
  Cholesky<float> cholesky(plan.view());
  for (int j = 0; j < plan.blocks; ++j)
    for (int k = 0; k < 3; ++k) cholesky.values()[9 * plan.pattern_start[j] + 4 * k] = 1e-39f;  // denormal
  CHECK_FALSE(cholesky.factor());
  volatile float small = 1e-30f;
  CHECK(small * 1e-9f > 0);
}

TEST_CASE("cholesky: neither factor nor solve allocates") {
  Random random(8);
  const Neighbours neighbours = grid_graph(6, 6, 6);
  const CholeskyPlanData plan = plan_cholesky(neighbours);
  Cholesky<float> cholesky(plan.view());
  fill(cholesky, plan.view(), random_matrix(neighbours, 0.1, random));
  std::vector<float> x(3 * plan.blocks, 1.0f);
  const long before = test::allocations;
  const bool ok = cholesky.factor();
  cholesky.solve(x);
  CHECK(test::allocations == before);
  CHECK(ok);
}

TEST_CASE("cholesky: finds the place of every coupled pair of blocks, and no other") {
  const Neighbours neighbours = grid_graph(4, 4, 4);
  const CholeskyPlanData plan = plan_cholesky(neighbours);
  const Cholesky<double> cholesky(plan.view());
  for (int a = 0; a < plan.blocks; ++a)
    for (int b = 0; b < plan.blocks; ++b) {
      if (a != b && !std::binary_search(neighbours[a].begin(), neighbours[a].end(), b)) {
        CHECK_THROWS_AS(cholesky.place(a, b), InputError);
        continue;
      }
      const auto place = cholesky.place(a, b);
      const auto start = std::upper_bound(plan.pattern_start.begin(), plan.pattern_start.end(), place.index);
      const int column = plan.order[start - plan.pattern_start.begin() - 1];
      const int row = plan.order[plan.pattern_row[place.index]];
      CHECK(row == (place.transposed ? b : a));
      CHECK(column == (place.transposed ? a : b));
    }
}

TEST_CASE("cholesky: refuses an inconsistent plan") {
  const CholeskyPlanData good = small_plan();
  const auto refused = [&](auto change) {
    CholeskyPlanData bad = good;
    change(bad);
    CHECK_THROWS_AS(Cholesky<float>{bad.view()}, InputError);
  };
  CHECK_NOTHROW(Cholesky<float>{good.view()});
  refused([](auto& plan) { plan = {}; });
  refused([](auto& plan) { plan.order[3] = plan.order[4]; });
  refused([](auto& plan) { plan.order[3] = -1; });
  refused([](auto& plan) { plan.order.pop_back(); });
  refused([](auto& plan) { ++plan.blocks; });
  refused([](auto& plan) { plan.pattern_row[0] = 1; });
  refused([](auto& plan) { std::swap(plan.pattern_row[1], plan.pattern_row[2]); });
  refused([](auto& plan) { plan.pattern_row.back() = plan.blocks; });
  refused([](auto& plan) { plan.pattern_start.back() += 1; });
  refused([](auto& plan) { plan.supernode_start[1] = 0; });
  refused([](auto& plan) { plan.supernode_start.back() -= 1; });
  refused([](auto& plan) { plan.rows_start[1] = -1; });
  refused([](auto& plan) { plan.rows_start.pop_back(); });
  refused([](auto& plan) { plan.rows[0] = 0; });
  refused([](auto& plan) { plan.rows[plan.rows_start[1] - 1] = plan.blocks; });
  // A row that the pattern or a parent needs is missing.
  for (std::size_t missing = 0; missing < good.rows.size(); ++missing)
    refused([&](auto& plan) {
      plan.rows.erase(plan.rows.begin() + static_cast<std::ptrdiff_t>(missing));
      for (auto& start : plan.rows_start)
        if (start > static_cast<int>(missing)) --start;
    });
}

TEST_CASE("plan_cholesky: refuses lists of neighbours that are not symmetric, ascending and in range") {
  CHECK_THROWS_AS(plan_cholesky({{1}, {}}), std::invalid_argument);
  CHECK_THROWS_AS(plan_cholesky({{2}, {}}), std::invalid_argument);
  CHECK_THROWS_AS(plan_cholesky({{0}}), std::invalid_argument);
  CHECK_THROWS_AS(plan_cholesky({{2, 1}, {0}, {0}}), std::invalid_argument);
}

TEST_CASE("plan_cholesky: rows that are adjacent in a front are mostly adjacent in its parent's, too") {
  const CholeskyPlanData plan = plan_cholesky(grid_graph(40, 20, 2));
  double rows = 0, runs = 0;
  for (std::size_t s = 0; s + 1 < plan.supernode_start.size(); ++s) {
    const std::vector<int> own(plan.rows.begin() + plan.rows_start[s], plan.rows.begin() + plan.rows_start[s + 1]);
    if (own.empty()) continue;
    const auto after = std::upper_bound(plan.supernode_start.begin(), plan.supernode_start.end(), own.front());
    const auto parent = after - plan.supernode_start.begin() - 1;
    std::vector<int> front;  // the parent's columns and rows
    for (int c = plan.supernode_start[parent]; c < plan.supernode_start[parent + 1]; ++c) front.push_back(c);
    front.insert(front.end(), plan.rows.begin() + plan.rows_start[parent],
                 plan.rows.begin() + plan.rows_start[parent + 1]);
    const auto place = [&](int row) { return std::lower_bound(front.begin(), front.end(), row) - front.begin(); };
    for (std::size_t k = 0; k < own.size(); ++k) runs += k == 0 || place(own[k]) != place(own[k - 1]) + 1;
    rows += static_cast<double>(own.size());
  }
  CHECK(rows / runs > 8);
}

TEST_CASE("plan_cholesky: supernodes add little arithmetic to the factor of a finger's mesh") {
  const host::ShapeModelData model = host::make_shape_model(test::frame_mesh());
  const CholeskyPlan plan = model.cholesky.view();
  const Cholesky<float> cholesky(plan);
  // The same count for Eigen's own factor of that pattern, which has no supernodes.
  Random random(9);
  Neighbours neighbours(plan.blocks);
  for (int j = 0; j < plan.blocks; ++j)
    for (int e = plan.pattern_start[j] + 1; e < plan.pattern_start[j + 1]; ++e) {
      neighbours[plan.order[j]].push_back(plan.order[plan.pattern_row[e]]);
      neighbours[plan.order[plan.pattern_row[e]]].push_back(plan.order[j]);
    }
  for (auto& list : neighbours) std::sort(list.begin(), list.end());
  const Eigen::SimplicialLLT<SparseMatrix> reference(random_matrix(neighbours, 1, random));
  const SparseMatrix factor = reference.matrixL();
  double operations = 0;
  for (int j = 0; j < factor.cols(); ++j) {
    const double below = factor.outerIndexPtr()[j + 1] - factor.outerIndexPtr()[j];
    operations += below * below / 2;
  }
  MESSAGE("multiply-adds: " << cholesky.factor_operations() / 1e6 << " M, without supernodes " << operations / 1e6);
  CHECK(cholesky.factor_operations() < 2 * operations);
}
