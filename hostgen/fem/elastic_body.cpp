// Letters: u nodal displacements, g_a gradient of shape function a (undeformed), F = 1 + sum_a u_a g_a^T, J = det F,
// h_a = F^-T g_a, f_a = F g_a, S second Piola-Kirchhoff stress; b, c, v, t, A as in neo_hookean.h. A change du of the
// nodes gives D = sum du_a g_a^T, A = sum du_a h_a^T, t = sum h_a . du_a, F : D = sum f_a . du_a.
#include "hostgen/fem/elastic_body.h"

#include <algorithm>
#include <cassert>
#include <cstring>
#include <limits>
#include <numeric>

#include "firmware/shape/simd.h"

namespace finsight::host {
namespace {

using Pack = simd::Vector<double>;  // one tetrahedron per lane
constexpr auto kLanes = static_cast<std::size_t>(simd::kLanesOf<double>);

// Of the resistance to changes of volume, what the selective element's Gauss points keep. Without any it is too soft;
// with a tenth, srm's default mesh bends by 98 % of what its finest does, 88 % if they keep all (scripts/report fem).
constexpr double kBulkAtGaussPoints = 0.1;

constexpr std::size_t kPairs = kTetNodes * (kTetNodes + 1) / 2;
constexpr std::size_t kStresses = 6;
constexpr int kSymmetric[3][3] = {{0, 1, 2}, {1, 3, 4}, {2, 4, 5}};  // places of a symmetric matrix's entries

/// Index in pattern_row of the block at elimination positions (row, column), row >= column.
std::int32_t find_block(const CholeskyPlanData& plan, int row, int column) {
  const auto from = plan.pattern_row.begin() + plan.pattern_start[static_cast<std::size_t>(column)];
  const auto to = plan.pattern_row.begin() + plan.pattern_start[static_cast<std::size_t>(column) + 1];
  const auto found = std::lower_bound(from, to, row);
  assert(found != to && *found == row);
  return static_cast<std::int32_t>(found - plan.pattern_row.begin());
}

/// Where a point's stresses lie in the caller's array.
std::size_t stress_place(std::size_t batch, std::size_t point) {
  return (batch * kPoints + point) * kStresses * kLanes;
}

}  // namespace

/// A tet per lane, its ten nodes sorted by elimination position (fixed nodes last), so that the block of local nodes
/// (a, b >= a) always belongs to the stored lower half, at row b and column a.
struct ElasticBody::Batch {
  /// What a point stands for.
  struct Share {
    Pack volume, mu, bulk;
  };
  Pack gradient[kPoints][kTetNodes][3];
  Share of_gauss_point, of_middle;
  std::int32_t node[kTetNodes][kLanes];
  std::int32_t block[kPairs][kLanes];  ///< -1: a fixed node takes part

  const Share& share(std::size_t point) const { return point == kMiddle ? of_middle : of_gauss_point; }
  void set_lane(std::size_t lane, const QuadraticMesh& mesh, std::size_t t, const NeoHookean& material,
                const std::vector<int>& unknown_of_node, const std::vector<int>& position,
                const CholeskyPlanData& plan);
  void gather(std::span<const double> u, Pack (&values)[kTetNodes][3]) const;
  void scatter(const Pack (&values)[kTetNodes][3], std::span<double> sums) const;
  template <class Scalar>
  void scatter(std::size_t pair, const Pack (&block_values)[3][3], std::span<Scalar> blocks) const;
  void displacement_gradient(const Pack (&u)[kTetNodes][3], std::size_t g, Pack (&D)[3][3]) const;
  void deform(const Pack (&u)[kTetNodes][3], std::size_t g, NeoHookeanState<Pack>& state) const;
};

void ElasticBody::Batch::set_lane(std::size_t lane, const QuadraticMesh& mesh, std::size_t t,
                                  const NeoHookean& material, const std::vector<int>& unknown_of_node,
                                  const std::vector<int>& position, const CholeskyPlanData& plan) {
  const auto& tet = mesh.tets[t];
  std::array<int, kTetNodes> unknown;
  for (std::size_t a = 0; a < kTetNodes; ++a) unknown[a] = unknown_of_node[static_cast<std::size_t>(tet[a])];
  const auto place = [&](std::size_t a) { return position[static_cast<std::size_t>(unknown[a])]; };
  std::array<std::size_t, kTetNodes> local;
  std::iota(local.begin(), local.end(), 0);
  std::stable_sort(local.begin(), local.end(), [&](std::size_t a, std::size_t b) { return place(a) < place(b); });

  std::array<Eigen::Vector3d, 4> corners;
  for (std::size_t a = 0; a < 4; ++a) corners[a] = mesh.node_mm[static_cast<std::size_t>(tet[a])];
  const TetGradients gradients = tet_gradients(corners, mesh.element);
  const double bulk_at_gauss_points = mesh.element == Element::kSelective ? kBulkAtGaussPoints : 1;
  of_gauss_point.volume[lane] = gradients.volume_mm3 / kGaussPoints;
  of_gauss_point.mu[lane] = material.mu_mpa;
  of_gauss_point.bulk[lane] = bulk_at_gauss_points * material.bulk_mpa;
  of_middle.volume[lane] = gradients.volume_mm3;
  of_middle.mu[lane] = 0;
  of_middle.bulk[lane] = (1 - bulk_at_gauss_points) * material.bulk_mpa;
  std::size_t pair = 0;
  for (std::size_t a = 0; a < kTetNodes; ++a) {
    node[a][lane] = unknown[local[a]];
    for (std::size_t g = 0; g < kPoints; ++g) {
      for (std::size_t i = 0; i < 3; ++i) gradient[g][a][i][lane] = gradients.at[g][local[a]][static_cast<int>(i)];
    }
    for (std::size_t b = a; b < kTetNodes; ++b, ++pair) {
      const int column = place(local[a]), row = place(local[b]);
      block[pair][lane] = row < plan.blocks ? find_block(plan, row, column) : -1;
    }
  }
}

void ElasticBody::Batch::gather(std::span<const double> u, Pack (&values)[kTetNodes][3]) const {
  for (std::size_t a = 0; a < kTetNodes; ++a) {
    for (std::size_t lane = 0; lane < kLanes; ++lane) {
      const double* const from = &u[3 * static_cast<std::size_t>(node[a][lane])];
      for (std::size_t i = 0; i < 3; ++i) values[a][i][lane] = from[i];
    }
  }
}

void ElasticBody::Batch::scatter(const Pack (&values)[kTetNodes][3], std::span<double> sums) const {
  for (std::size_t a = 0; a < kTetNodes; ++a) {
    for (std::size_t lane = 0; lane < kLanes; ++lane) {
      double* const to = &sums[3 * static_cast<std::size_t>(node[a][lane])];
      for (std::size_t i = 0; i < 3; ++i) to[i] += values[a][i][lane];
    }
  }
}

template <class Scalar>
void ElasticBody::Batch::scatter(std::size_t pair, const Pack (&block_values)[3][3], std::span<Scalar> blocks) const {
  for (std::size_t lane = 0; lane < kLanes; ++lane) {
    if (block[pair][lane] < 0) continue;
    Scalar* const to = &blocks[9 * static_cast<std::size_t>(block[pair][lane])];
    for (std::size_t i = 0; i < 9; ++i) to[i] += static_cast<Scalar>(block_values[i / 3][i % 3][lane]);
  }
}

void ElasticBody::Batch::displacement_gradient(const Pack (&u)[kTetNodes][3], std::size_t g, Pack (&D)[3][3]) const {
  for (std::size_t i = 0; i < 3; ++i) {
    for (std::size_t j = 0; j < 3; ++j) {
      D[i][j] = u[0][i] * gradient[g][0][j];
      for (std::size_t a = 1; a < kTetNodes; ++a) D[i][j] += u[a][i] * gradient[g][a][j];
    }
  }
}

void ElasticBody::Batch::deform(const Pack (&u)[kTetNodes][3], std::size_t g, NeoHookeanState<Pack>& state) const {
  displacement_gradient(u, g, state.F);
  for (std::size_t i = 0; i < 3; ++i) state.F[i][i] += 1.0;
  state.mu = share(g).mu;
  state.bulk = share(g).bulk;
  state.evaluate();
}

ElasticBody::ElasticBody(const QuadraticMesh& mesh, const std::vector<NeoHookean>& material, const CheckIn& check_in) {
  assert(material.size() == mesh.tets.size());
  plan_.blocks = static_cast<int>(std::count(mesh.fixed.begin(), mesh.fixed.end(), 0));
  int next = 0;
  for (const std::uint8_t fixed : mesh.fixed) unknown_of_node_.push_back(fixed ? plan_.blocks : next++);
  // Many bodies are solved some hundred times only: more orders would take longer than the best of them saves.
  plan_ = plan_cholesky(neighbours_of_free_nodes(mesh), 1, 1, check_in);

  std::vector<int> position(static_cast<std::size_t>(plan_.blocks) + 1, plan_.blocks);  // of the fixed nodes: last
  for (int p = 0; p < plan_.blocks; ++p)
    position[static_cast<std::size_t>(plan_.order[static_cast<std::size_t>(p)])] = p;

  // Tets in the order in which elimination reaches them: neighbours in a batch write to neighbours in memory.
  std::vector<int> first_position(mesh.tets.size(), plan_.blocks);
  for (std::size_t t = 0; t < mesh.tets.size(); ++t) {
    for (const int node : mesh.tets[t]) {
      const int unknown = unknown_of_node_[static_cast<std::size_t>(node)];
      first_position[t] = std::min(first_position[t], position[static_cast<std::size_t>(unknown)]);
    }
  }
  std::vector<std::size_t> order(mesh.tets.size());
  std::iota(order.begin(), order.end(), 0);
  std::stable_sort(order.begin(), order.end(),
                   [&](std::size_t s, std::size_t t) { return first_position[s] < first_position[t]; });

  batches_.resize((order.size() + kLanes - 1) / kLanes);
  for (std::size_t slot = 0; slot < batches_.size() * kLanes; ++slot) {
    Batch& batch = batches_[slot / kLanes];
    const std::size_t t = order[std::min(slot, order.size() - 1)];
    batch.set_lane(slot % kLanes, mesh, t, material[t], unknown_of_node_, position, plan_);
    if (slot < order.size()) continue;
    // The last tet again, to fill up its batch.
    batch.of_gauss_point.volume[slot % kLanes] = 0;
    batch.of_middle.volume[slot % kLanes] = 0;
  }
}

ElasticBody::~ElasticBody() = default;

std::size_t ElasticBody::stress_size() const { return stress_place(batches_.size(), 0); }

std::vector<std::vector<int>> ElasticBody::neighbours_of_free_nodes(const QuadraticMesh& mesh) const {
  std::vector<std::vector<int>> neighbours(static_cast<std::size_t>(plan_.blocks));
  for (const auto& tet : mesh.tets) {
    for (const int a : tet) {
      const int row = unknown_of_node_[static_cast<std::size_t>(a)];
      if (row == plan_.blocks) continue;
      for (const int b : tet) {
        const int column = unknown_of_node_[static_cast<std::size_t>(b)];
        if (column != row && column != plan_.blocks) neighbours[static_cast<std::size_t>(row)].push_back(column);
      }
    }
  }
  for (auto& list : neighbours) {
    std::sort(list.begin(), list.end());
    list.erase(std::unique(list.begin(), list.end()), list.end());
  }
  return neighbours;
}

double ElasticBody::forces(std::span<const double> u, std::span<double> force) const {
  std::fill(force.begin(), force.end(), 0.0);
  Pack least = simd::splat<Pack>(std::numeric_limits<double>::infinity());
  for (const Batch& batch : batches_) {
    Pack values[kTetNodes][3], out[kTetNodes][3] = {};
    batch.gather(u, values);
    for (std::size_t g = 0; g < kPoints; ++g) {
      NeoHookeanState<Pack> state;
      batch.deform(values, g, state);
      least = simd::smaller(least, state.J);
      Pack P[3][3];
      for (std::size_t i = 0; i < 3; ++i) {
        for (std::size_t j = 0; j < 3; ++j) {
          P[i][j] = batch.share(g).volume * (state.c * state.F[i][j] + state.b * state.inverse[j][i]);
        }
      }
      for (std::size_t a = 0; a < kTetNodes; ++a) {
        const Pack* const g_a = batch.gradient[g][a];
        for (std::size_t i = 0; i < 3; ++i) out[a][i] += P[i][0] * g_a[0] + P[i][1] * g_a[1] + P[i][2] * g_a[2];
      }
    }
    batch.scatter(out, force);
  }
  double smallest_J = least[0];
  for (std::size_t lane = 1; lane < kLanes; ++lane) smallest_J = std::min(smallest_J, least[lane]);
  return smallest_J;
}

void ElasticBody::stresses(std::span<const double> u, std::span<const double> du, std::span<double> stress) const {
  for (std::size_t index = 0; index < batches_.size(); ++index) {
    const Batch& batch = batches_[index];
    Pack values[kTetNodes][3], changes[kTetNodes][3];
    batch.gather(u, values);
    batch.gather(du, changes);
    for (std::size_t g = 0; g < kPoints; ++g) {
      NeoHookeanState<Pack> state;
      batch.deform(values, g, state);
      Pack D[3][3], S[kStresses];
      batch.displacement_gradient(changes, g, D);
      state.stress(D, S);
      std::memcpy(&stress[stress_place(index, g)], S, sizeof(S));
    }
  }
}

template <class Scalar>
void ElasticBody::tangent(std::span<const double> u, std::span<const double> stress, std::span<Scalar> blocks) const {
  std::fill(blocks.begin(), blocks.end(), Scalar(0));
  // Per node and point, the factors of the outer products that make the block of nodes (row, column):
  //   (g_row . S g_col - b h_row . h_col) 1
  //   + h_row (v h_col - 2/3 c f_col)^T + (-2/3 c f_row) h_col^T + (-b h_col) h_row^T
  struct Node {
    Pack g[3], Sg[3], h[3], bh[3], cross[3], right[3];
  };
  for (std::size_t index = 0; index < batches_.size(); ++index) {
    const Batch& batch = batches_[index];
    Pack values[kTetNodes][3];
    Node node[kTetNodes][kPoints];
    batch.gather(u, values);
    for (std::size_t point = 0; point < kPoints; ++point) {
      NeoHookeanState<Pack> state;
      batch.deform(values, point, state);
      Pack S[kStresses];
      std::memcpy(S, &stress[stress_place(index, point)], sizeof(S));
      const Pack& volume = batch.share(point).volume;
      const Pack c = (-2.0 / 3) * volume * state.c, v = volume * state.v(), b = -volume * state.b;
      for (std::size_t a = 0; a < kTetNodes; ++a) {
        const Pack* const g = batch.gradient[point][a];
        Node& n = node[a][point];
        for (std::size_t i = 0; i < 3; ++i) {
          n.g[i] = g[i];
          n.Sg[i] = volume * (S[kSymmetric[i][0]] * g[0] + S[kSymmetric[i][1]] * g[1] + S[kSymmetric[i][2]] * g[2]);
          n.h[i] = state.inverse[0][i] * g[0] + state.inverse[1][i] * g[1] + state.inverse[2][i] * g[2];
          n.bh[i] = b * n.h[i];
          n.cross[i] = c * (state.F[i][0] * g[0] + state.F[i][1] * g[1] + state.F[i][2] * g[2]);
          n.right[i] = v * n.h[i] + n.cross[i];
        }
      }
    }
    std::size_t pair = 0;
    for (std::size_t a = 0; a < kTetNodes; ++a) {
      for (std::size_t b = a; b < kTetNodes; ++b, ++pair) {
        Pack block[3][3] = {};
        for (std::size_t point = 0; point < kPoints; ++point) {
          const Node &row = node[b][point], &column = node[a][point];
          Pack diagonal = row.g[0] * column.Sg[0] + row.h[0] * column.bh[0];
          for (std::size_t i = 1; i < 3; ++i) diagonal += row.g[i] * column.Sg[i] + row.h[i] * column.bh[i];
          for (std::size_t i = 0; i < 3; ++i) {
            for (std::size_t j = 0; j < 3; ++j) {
              block[i][j] += row.h[i] * column.right[j] + row.cross[i] * column.h[j] + column.bh[i] * row.h[j];
            }
            block[i][i] += diagonal;
          }
        }
        batch.scatter(pair, block, blocks);
      }
    }
  }
}

template void ElasticBody::tangent(std::span<const double>, std::span<const double>, std::span<float>) const;
template void ElasticBody::tangent(std::span<const double>, std::span<const double>, std::span<double>) const;

// The derivative of d2W with respect to D: dP = D S + (v t - 2/3 c F : D) F^-T - 2/3 c t F - 2 b sym(A) F^-T.
void ElasticBody::times_tangent(std::span<const double> u, std::span<const double> stress, std::span<const double> w,
                                std::span<double> product) const {
  std::fill(product.begin(), product.end(), 0.0);
  for (std::size_t index = 0; index < batches_.size(); ++index) {
    const Batch& batch = batches_[index];
    Pack values[kTetNodes][3], changes[kTetNodes][3], out[kTetNodes][3] = {};
    batch.gather(u, values);
    batch.gather(w, changes);
    for (std::size_t point = 0; point < kPoints; ++point) {
      NeoHookeanState<Pack> state;
      batch.deform(values, point, state);
      Pack S[kStresses], D[3][3], A[3][3], t = {}, F_D = {};
      std::memcpy(&S, &stress[stress_place(index, point)], sizeof(S));
      batch.displacement_gradient(changes, point, D);
      for (std::size_t i = 0; i < 3; ++i) {
        for (std::size_t j = 0; j < 3; ++j) {
          A[i][j] = D[i][0] * state.inverse[0][j] + D[i][1] * state.inverse[1][j] + D[i][2] * state.inverse[2][j];
          F_D += state.F[i][j] * D[i][j];
        }
        t += A[i][i];
      }
      const Pack along = state.v() * t - (2.0 / 3) * state.c * F_D, with_F = (2.0 / 3) * state.c * t;
      Pack M[3][3];  // what F^-T is multiplied by
      Pack dP[3][3];
      for (std::size_t i = 0; i < 3; ++i) {
        for (std::size_t j = 0; j < 3; ++j) M[i][j] = -state.b * (A[i][j] + A[j][i]);
        M[i][i] += along;
      }
      for (std::size_t i = 0; i < 3; ++i) {
        for (std::size_t j = 0; j < 3; ++j) {
          Pack sum = -with_F * state.F[i][j];
          for (std::size_t k = 0; k < 3; ++k) sum += D[i][k] * S[kSymmetric[k][j]] + M[i][k] * state.inverse[j][k];
          dP[i][j] = batch.share(point).volume * sum;
        }
      }
      for (std::size_t a = 0; a < kTetNodes; ++a) {
        const Pack* const g = batch.gradient[point][a];
        for (std::size_t i = 0; i < 3; ++i) out[a][i] += dP[i][0] * g[0] + dP[i][1] * g[1] + dP[i][2] * g[2];
      }
    }
    batch.scatter(out, product);
  }
}

}  // namespace finsight::host
