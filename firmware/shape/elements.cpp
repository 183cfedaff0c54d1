#include "firmware/shape/elements.h"

#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <limits>
#include <string>

#include "firmware/input_error.h"

// Legend: x positions, F deformation gradient, B inverse of the undeformed edges, g gradient, H Hessian, J det F.

namespace finsight {

namespace {

// What a step leaves of a determinant at least: all of it would allow no compression, none would allow flat elements,
// whose energy is infinite.
constexpr double kMinDeterminant = 0.1;

Eigen::Vector3d rest_point(const ShapeModel& model, int node) {
  return {model.rest_mm[3 * node], model.rest_mm[3 * node + 1], model.rest_mm[3 * node + 2]};
}

Eigen::Matrix3d rest_edges(const ShapeModel& model, const std::array<int, 4>& tet) {
  Eigen::Matrix3d edges;
  for (int c = 0; c < 3; ++c) edges.col(c) = rest_point(model, tet[c + 1]) - rest_point(model, tet[0]);
  return edges;
}

// The first t in [0, 1] with c0 + c1 t + c2 t^2 + c3 t^3 <= 0, where c0 > 0; 1 if there is none. The cubic is monotone
// between its stationary points, so one interval with a change of sign is bisected; the end that is still positive is
// returned.
double first_root(const double c[4]) {
  const auto value = [&](double t) { return c[0] + t * (c[1] + t * (c[2] + t * c[3])); };
  double stations[3] = {1, 1, 1};
  const double discriminant = c[2] * c[2] - 3 * c[1] * c[3];
  if (discriminant > 0) {  // the roots of c1 + 2 c2 t + 3 c3 t^2, without cancellation
    const double q = -(c[2] + std::copysign(std::sqrt(discriminant), c[2]));
    const double first = q / (3 * c[3]), second = c[1] / q;
    if (first > 0 && first < 1) stations[0] = first;
    if (second > 0 && second < 1) stations[1] = second;
    if (stations[0] > stations[1]) std::swap(stations[0], stations[1]);
  }
  double low = 0;
  for (const double high : stations) {
    if (!(value(high) > 0)) {
      double bad = high;
      for (int k = 0; k < 30; ++k) {
        const double middle = (low + bad) / 2;
        (value(middle) > 0 ? low : bad) = middle;
      }
      return low;
    }
    low = high;
  }
  return 1;
}

}  // namespace

template <class S>
Elements<S>::Elements(const ShapeModel& model, const Cholesky<S>* cholesky) {
  std::vector<std::array<int, 4>> tets;
  for (int t = 0; t < model.tets; ++t) {
    std::array<int, 4> tet;
    std::copy_n(model.tet_nodes.begin() + 4 * t, 4, tet.begin());
    if (!(rest_edges(model, tet).determinant() > 0))
      throw InputError("shape model", "tet_nodes", "tetrahedron " + std::to_string(t) + " inverted or flat at rest",
                       "a positive volume");
    for (int a = 0; a < 4; ++a)
      for (int b = 0; b < a; ++b)
        mean_edge_mm_ += (rest_point(model, tet[a]) - rest_point(model, tet[b])).norm() / (6 * model.tets);
    const auto order = [&](int node) {  // elimination position; fixed nodes after all free ones
      const int free = model.free_index[node];
      if (free >= model.cholesky.blocks)
        throw InputError("shape model", "cholesky", std::to_string(model.cholesky.blocks) + " blocks",
                         "one for free node " + std::to_string(free));
      if (free < 0) return model.cholesky.blocks + node;
      return cholesky ? cholesky->position(free) : free;
    };
    std::sort(tet.begin(), tet.end(), [&](int a, int b) { return order(a) < order(b); });
    const auto same_body = [&](int node) { return model.node_kind[node] == model.node_kind[tet[0]]; };
    if (model.free_index[tet[0]] >= 0 || !std::all_of(tet.begin(), tet.end(), same_body)) tets.push_back(tet);
  }
  for (std::size_t t = 0; t < tets.size(); t += kWidth)
    add_batch(model, cholesky, std::span(tets).subspan(t, std::min<std::size_t>(kWidth, tets.size() - t)));
}

template <class S>
void Elements<S>::add_batch(const ShapeModel& model, const Cholesky<S>* cholesky,
                            std::span<const std::array<int, 4>> tets) {
  Batch& batch = batches_.emplace_back();
  for (auto& blocks : batch.destination) blocks.fill(kNowhere);
  for (int lane = 0; lane < kWidth; ++lane) {
    const bool repeated = lane >= static_cast<int>(tets.size());
    const std::array<int, 4>& tet = repeated ? tets.back() : tets[lane];
    const Eigen::Matrix3d inverse = rest_edges(model, tet).inverse();
    for (int i = 0; i < 9; ++i) batch.B[i][lane] = static_cast<S>(inverse(i / 3, i % 3));
    batch.weight[lane] = repeated ? 0 : 1;
    for (int a = 0; a < 4; ++a) batch.offset[a][lane] = 3 * tet[a];
    if (cholesky && !repeated) add_targets(model, *cholesky, tet, lane, batch);
  }
  batch.couplings_end = static_cast<std::int32_t>(couplings_.size());
}

template <class S>
void Elements<S>::add_targets(const ShapeModel& model, const Cholesky<S>& cholesky, const std::array<int, 4>& tet,
                              int lane, Batch& batch) {
  for (int k = 0; k < 10; ++k) {
    const int row = tet[kElementBlocks[k][0]], column = tet[kElementBlocks[k][1]];
    if (model.free_index[column] < 0) continue;
    if (model.free_index[row] >= 0) {
      const auto place = cholesky.place(model.free_index[row], model.free_index[column]);
      batch.destination[lane][k] = static_cast<std::int32_t>(9 * place.index);
    } else if (model.node_kind[row] >= 2) {
      couplings_.push_back({9 * k * kWidth + lane, 3 * column, 3 * row});
    }
  }
}

template <class S>
void Elements<S>::gather(const Batch& batch, std::span<const S> x, V F[9]) {
  V points[12];
  for (int a = 0; a < 4; ++a)
    for (int d = 0; d < 3; ++d)
      for (int lane = 0; lane < kWidth; ++lane) points[3 * a + d][lane] = x[batch.offset[a][lane] + d];
  deformation_gradient(points, batch.B, F);
}

template <class S>
void Elements<S>::scatter(const Batch& batch, const V g[12], std::span<S> gradient) {
  for (int a = 0; a < 4; ++a)
    for (int lane = 0; lane < kWidth; ++lane)
      for (int d = 0; d < 3; ++d) gradient[batch.offset[a][lane] + d] += g[3 * a + d][lane];
}

// A tetrahedron's numbers lie a vector apart. Where four of them come side by side first, they are added to a block
// four at a time: a third of the memory accesses. Alters H.
template <class S>
void Elements<S>::scatter_blocks(const Batch& batch, V H[90], std::span<S> blocks) {
  constexpr bool kByFour = kWidth % 4 == 0;
  using Four = simd::FourOf<S>;
  if constexpr (kByFour) {
    for (int k = 0; k < 90; k += 9) {
      simd::transpose_by_four(H + k);
      simd::transpose_by_four(H + k + 4);
    }
  }
  const S* numbers = reinterpret_cast<const S*>(H);
  for (int lane = 0; lane < kWidth; ++lane) {
    const S* from = numbers + (kByFour ? lane % 4 * kWidth + lane / 4 * 4 : lane);
    for (int k = 0; k < 10; ++k, from += 9 * kWidth) {
      if (batch.destination[lane][k] == kNowhere) continue;
      S* to = blocks.data() + batch.destination[lane][k];
      if constexpr (kByFour) {
        simd::store_four(to, Four(simd::load_four(to) + simd::load_four(from)));
        simd::store_four(to + 4, Four(simd::load_four(to + 4) + simd::load_four(from + 4 * kWidth)));
        to[8] += numbers[(9 * k + 8) * kWidth + lane];
      } else {
        for (int i = 0; i < 9; ++i) to[i] += from[i * kWidth];
      }
    }
  }
}

template <class S>
double Elements<S>::energy(std::span<const S> x) const {
  double sum = 0;
  for (const Batch& batch : batches_) {
    V F[9], C[9];
    gather(batch, x, F);
    cofactors(F, C);
    const V J = determinant(F, C);
    const V psi = batch.weight * element_energy(F);
    for (int lane = 0; lane < kWidth; ++lane) {
      if (!(J[lane] > 0)) return std::numeric_limits<double>::infinity();
      sum += static_cast<double>(psi[lane]);
    }
  }
  return sum;
}

template <class S>
void Elements<S>::gradient(std::span<const S> x, std::span<S> g) const {
  std::fill(g.begin(), g.end(), S(0));
  for (const Batch& batch : batches_) {
    V F[9], element_g[12];
    gather(batch, x, F);
    element_gradient(F, batch.B, batch.weight, element_g);
    scatter(batch, element_g, g);
  }
}

template <class S>
void Elements<S>::gradient_and_hessian(std::span<const S> x, std::span<const S> plate_step, std::span<S> g,
                                       std::span<S> blocks) const {
  std::fill(g.begin(), g.end(), S(0));
  std::fill(blocks.begin(), blocks.end(), S(0));
  std::int32_t coupling = 0;
  for (const Batch& batch : batches_) {
    V F[9], element_g[12], element_H[90];
    gather(batch, x, F);
    element_hessian(F, batch.B, batch.weight, element_g, element_H);
    scatter(batch, element_g, g);
    const S* H = reinterpret_cast<const S*>(element_H);
    for (; coupling < batch.couplings_end; ++coupling) {
      const S* from = H + couplings_[coupling].source;
      const S* step = plate_step.data() + couplings_[coupling].plate_offset;
      S* to = g.data() + couplings_[coupling].free_offset;
      for (int c = 0; c < 3; ++c)
        to[c] += from[c * kWidth] * step[0] + from[(3 + c) * kWidth] * step[1] + from[(6 + c) * kWidth] * step[2];
    }
    scatter_blocks(batch, element_H, blocks);
  }
}

// Most tetrahedra are far from any root: a bound on the cubic over [0, 1] tells so for a whole vector. The exact root
// is computed for the others.
template <class S>
S Elements<S>::longest_step(std::span<const S> x, std::span<const S> step) const {
  const V zero{};
  double longest = 1;
  for (const Batch& batch : batches_) {
    V F[9], dF[9], c[4];
    gather(batch, x, F);
    gather(batch, step, dF);
    determinant_cubic(F, dF, c);
    c[0] *= simd::splat<V>(1 - kMinDeterminant);
    // In this order of operands a NaN stays one.
    const V lowest = c[0] + simd::smaller(zero, c[1]) + simd::smaller(zero, c[2]) + simd::smaller(zero, c[3]);
    for (int lane = 0; lane < kWidth; ++lane) {
      if (lowest[lane] > 0) continue;  // not for NaN
      const double cubic[4] = {static_cast<double>(c[0][lane]), static_cast<double>(c[1][lane]),
                               static_cast<double>(c[2][lane]), static_cast<double>(c[3][lane])};
      longest = std::min(longest, first_root(cubic));
    }
  }
  return static_cast<S>(longest);
}

template <class S>
S Elements<S>::smallest_determinant(std::span<const S> x) const {
  S smallest = std::numeric_limits<S>::max();
  for (const Batch& batch : batches_) {
    V F[9], C[9];
    gather(batch, x, F);
    cofactors(F, C);
    const V J = determinant(F, C);
    for (int lane = 0; lane < kWidth; ++lane)
      if (!(J[lane] >= smallest)) smallest = J[lane];  // takes NaN, and then keeps it
    if (std::isnan(smallest)) return smallest;
  }
  return smallest;
}

template class Elements<float>;
template class Elements<double>;

}  // namespace finsight
