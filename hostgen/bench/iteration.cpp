#include "hostgen/bench/iteration.h"
#include "hostgen/util/stopwatch.h"

#include <Eigen/CholmodSupport>
#include <Eigen/SparseCholesky>
#include <algorithm>
#include <memory>
#include <stdexcept>
#include <string>
#include <vector>

#include "firmware/shape/elements.h"
#include "firmware/shape/flush_denormals.h"
#include "firmware/shape/free_step.h"

namespace finsight::host {

namespace {

/// Derivatives at a fixed shape, for free nodes that are numbered in the order of elimination.
template <class S>
struct Derivatives {
  Derivatives(const ShapeModel& model, std::span<const double> node_mm)
      : cholesky(model.cholesky), elements(model, &cholesky), plates_rest(3 * model.nodes), gradient(3 * model.nodes) {
    for (const double coordinate : node_mm) x.push_back(static_cast<S>(coordinate));
    free_offset.resize(static_cast<std::size_t>(model.cholesky.blocks));
    for (int i = 0; i < model.nodes; ++i) {
      if (model.free_index[i] >= 0) free_offset[static_cast<std::size_t>(model.free_index[i])] = 3 * i;
    }
  }
  void compute() { elements.gradient_and_hessian(x, plates_rest, gradient, cholesky.values()); }

  Cholesky<S> cholesky;
  Elements<S> elements;
  std::vector<S> x, plates_rest, gradient;
  std::vector<std::int32_t> free_offset;  // 3 * node of each free node
};

[[noreturn]] void fail(const std::string& who) { throw std::runtime_error("bench: " + who + " refuses the Hessian"); }

/// The Hessian as a sparse matrix (lower triangle, in the order of free nodes): which of Cholesky::values() goes where.
class SparseHessian {
 public:
  explicit SparseHessian(const ShapeModel& model) {
    const CholeskyPlan& plan = model.cholesky;
    std::vector<Eigen::Triplet<double>> entries;  // the value is the number of its source, exact in a double
    for (int column = 0; column < plan.blocks; ++column) {
      for (std::int32_t k = plan.pattern_start[column]; k < plan.pattern_start[column + 1]; ++k) {
        const int a = plan.order[plan.pattern_row[k]], b = plan.order[column];
        for (int r = 0; r < 3; ++r) {
          for (int c = 0; c < 3; ++c) add(entries, 3 * a + r, 3 * b + c, 9 * k + 3 * r + c, a == b);
        }
      }
    }
    matrix.resize(3 * plan.blocks, 3 * plan.blocks);
    matrix.setFromTriplets(entries.begin(), entries.end());
    for (int i = 0; i < matrix.nonZeros(); ++i) source_.push_back(static_cast<std::size_t>(matrix.valuePtr()[i]));
  }
  void fill(std::span<const double> values) {
    for (std::size_t i = 0; i < source_.size(); ++i) matrix.valuePtr()[i] = values[source_[i]];
  }

  Eigen::SparseMatrix<double> matrix;

 private:
  // The lower triangle of the whole matrix; a stored block can lie in its upper one.
  static void add(std::vector<Eigen::Triplet<double>>& entries, int row, int column, int source, bool diagonal) {
    if (diagonal && row < column) return;
    entries.emplace_back(std::max(row, column), std::min(row, column), source);
  }
  std::vector<std::size_t> source_;
};

template <class Solver>
Iteration sparse_iteration(const ShapeModel& model, std::span<const double> node_mm, const std::string& name) {
  struct Work {
    Work(const ShapeModel& shape, std::span<const double> at)
        : derivatives(shape, at), hessian(shape), right(3 * shape.cholesky.blocks) {
      solver.analyzePattern(hessian.matrix);
    }
    Derivatives<double> derivatives;
    SparseHessian hessian;
    Solver solver;
    Eigen::VectorXd right, step;
    std::vector<double> node_step;
  };
  const auto work = std::make_shared<Work>(model, node_mm);
  work->node_step.resize(node_mm.size());
  return [work, name] {
    Work& w = *work;
    IterationTime time;
    ProcessorStopwatch watch;
    w.derivatives.compute();
    w.hessian.fill(w.derivatives.cholesky.values());
    time.derivatives_us = watch.lap_us();
    w.solver.factorize(w.hessian.matrix);
    if (w.solver.info() != Eigen::Success) fail(name);
    time.factor_us = watch.lap_us();
    for (std::size_t i = 0; i < w.derivatives.free_offset.size(); ++i) {
      for (int d = 0; d < 3; ++d) w.right[3 * i + d] = -w.derivatives.gradient[w.derivatives.free_offset[i] + d];
    }
    w.step = w.solver.solve(w.right);
    for (std::size_t i = 0; i < w.derivatives.free_offset.size(); ++i) {
      for (int d = 0; d < 3; ++d) w.node_step[w.derivatives.free_offset[i] + d] = w.step[3 * i + d];
    }
    time.solve_us = watch.lap_us();
    if (!(w.derivatives.elements.longest_step(w.derivatives.x, w.node_step) > 0)) fail(name);
    time.step_us = watch.lap_us();
    return time;
  };
}

}  // namespace

template <class S>
Iteration our_iteration(const ShapeModel& model, std::span<const double> node_mm) {
  struct Work {
    Work(const ShapeModel& shape, std::span<const double> at)
        : derivatives(shape, at), solution(3 * shape.cholesky.blocks), node_step(at.size()) {}
    Derivatives<S> derivatives;
    std::vector<S> solution, node_step;
  };
  const auto work = std::make_shared<Work>(model, node_mm);
  return [work] {
    const FlushDenormals flush;
    Work& w = *work;
    IterationTime time;
    ProcessorStopwatch watch;
    w.derivatives.compute();
    time.derivatives_us = watch.lap_us();
    if (!solve_free_step<S>(w.derivatives.cholesky, true, w.derivatives.free_offset, w.derivatives.gradient, w.solution,
                            w.node_step)) {
      fail("our Cholesky");
    }
    time.factor_us = watch.lap_us();  // the solve is part of it
    if (!(w.derivatives.elements.longest_step(w.derivatives.x, w.node_step) > 0)) fail("our step bound");
    time.step_us = watch.lap_us();
    return time;
  };
}

template Iteration our_iteration<float>(const ShapeModel&, std::span<const double>);
template Iteration our_iteration<double>(const ShapeModel&, std::span<const double>);

Iteration eigen_iteration(const ShapeModel& model, std::span<const double> node_mm) {
  return sparse_iteration<Eigen::SimplicialLDLT<Eigen::SparseMatrix<double>>>(model, node_mm, "Eigen");
}

Iteration cholmod_iteration(const ShapeModel& model, std::span<const double> node_mm) {
  return sparse_iteration<Eigen::CholmodSupernodalLLT<Eigen::SparseMatrix<double>>>(model, node_mm, "CHOLMOD");
}

}  // namespace finsight::host
