// The paper's method for contact forces (section 2.3): L-BFGS with the adjoint gradient. Letters: q forces of the
// candidates, B their unit loads (columns), K tangent, u displacements, y = A u - b the plates' errors.
#include <LBFGS.h>

#include <limits>
#include <stdexcept>

#include "hostgen/fem/contact_problem.h"
#include "hostgen/util/common.h"

namespace finsight::host {

namespace {

using Eigen::Index;
using Eigen::VectorXd;
using BodyVector = PushedFinger::BodyVector;

// B q
BodyVector load(const PushedFinger& finger, const std::vector<FacePoint>& candidates, const VectorXd& q) {
  BodyVector sum = finger.zero();
  for (Index j = 0; j < q.size(); ++j) {
    if (q[j] != 0) finger.add_push(candidates[static_cast<std::size_t>(j)], q[j], sum);
  }
  return sum;
}

// B^T w, for a w that is zero at fixed nodes
VectorXd along_candidates(const PushedFinger& finger, const std::vector<FacePoint>& candidates, const BodyVector& w) {
  VectorXd sums = VectorXd::Zero(static_cast<Index>(candidates.size()));
  for (std::size_t j = 0; j < candidates.size(); ++j) {
    const FacePoint& at = candidates[j];
    for (std::size_t i = 0; i < at.node.size(); ++i) {
      const auto unknown =
          static_cast<std::size_t>(finger.body.unknown_of_node()[static_cast<std::size_t>(at.node[i])]);
      sums[static_cast<Index>(j)] += at.weight[i] * at.inward.dot(Eigen::Map<const Eigen::Vector3d>(&w[3 * unknown]));
    }
  }
  return sums;
}

// K^-1 b by conjugate gradients with the tangent's factor, which is in single precision, as preconditioner.
void solve_with_tangent(const ElasticBody& body, const ElasticState& state, Equilibrium& factored, BodyVector& b) {
  constexpr int kMaxIterations = 20;
  constexpr double kTolerance = 1e-7;
  const auto map = [](BodyVector& v) { return Eigen::Map<VectorXd>(v.data(), static_cast<Index>(v.size())); };
  BodyVector x(b.size()), z = b, d, Kd(b.size());
  const double goal = kTolerance * map(b).norm();
  double before = 0;
  for (int k = 0; k < kMaxIterations && map(b).norm() > goal; ++k) {
    z = b;
    factored.apply_inverse(z);
    const double now = map(b).dot(map(z));
    if (k == 0)
      d = z;
    else
      map(d) = map(z) + now / before * map(d);
    body.times_tangent(state.u, state.stress, d, Kd);
    std::fill_n(Kd.end() - 3, 3, 0.0);
    const double length = now / map(d).dot(map(Kd));
    map(x) += length * map(d);
    map(b) -= length * map(Kd);
    before = now;
  }
  b = std::move(x);
}

}  // namespace

ContactForces ContactForceSolver::lbfgs(const PlatePoses& measured, int iterations) {
  Problem& p = *problem_;
  const ProcessorTime time;
  p.state = p.finger.rest;
  ContactForces result;
  LBFGSpp::LBFGSParam<double> parameters;
  parameters.max_iterations = iterations;
  parameters.max_linesearch = 30;
  LBFGSpp::LBFGSSolver<double> solver(parameters);
  VectorXd q = VectorXd::Zero(p.candidates_mm.cols());
  result.force_n = q;
  double best = std::numeric_limits<double>::infinity();
  // Forces that the finger cannot bear are only met while a step is being halved: any large number serves.
  constexpr double kUnbearable = 1e12;
  const auto evaluate = [&](const VectorXd& force_n, VectorXd& gradient) {
    if (interrupted()) throw Interrupted();
    const BodyVector target = load(p.finger, p.candidates, force_n);
    if (!p.equilibrium.solve(target, p.state) && !p.finger.press(p.equilibrium, target, p.state)) {
      p.state = p.finger.rest;
      gradient.setZero(force_n.size());
      return kUnbearable;
    }
    const double value = objective(measured, &gradient);
    if (value < best) {
      best = value;
      result.force_n = force_n;
      result.node_displacement_mm = node_displacement_mm();
    }
    result.curve.push_back({time.seconds(), best});
    return value;
  };
  try {
    double value = 0;
    result.converged = solver.minimize(evaluate, q, value) < iterations;
  } catch (const Interrupted&) {
    throw;
  } catch (const std::runtime_error&) {
    result.converged = false;  // its line search found no better point
  }
  result.misfit = 2 * best;
  result.explained = noise_explains(result.misfit, measured);
  return result;
}

bool ContactForceSolver::press(const VectorXd& candidate_force_n) {
  const BodyVector target = load(problem_->finger, problem_->candidates, candidate_force_n);
  return problem_->finger.press(problem_->equilibrium, target, problem_->state);
}

// dJ/dq = B^T K^-1 A^T y: one solve with the tangent for all forces.
double ContactForceSolver::objective(const PlatePoses& measured, VectorXd* gradient) {
  Problem& p = *problem_;
  p.errors.set_measured(measured);
  const PoseVectorOf<double> y = p.errors.at(p.state.u);
  if (gradient) {
    BodyVector w = p.finger.zero();
    p.errors.transpose(y, w);
    if (!p.equilibrium.linearise(p.state)) throw std::runtime_error("contact forces: the finger is at a bifurcation");
    solve_with_tangent(p.finger.body, p.state, p.equilibrium, w);
    *gradient = along_candidates(p.finger, p.candidates, w);
  }
  return 0.5 * y.squaredNorm();
}

const Eigen::Matrix3Xd& ContactForceSolver::candidates_mm() const { return problem_->candidates_mm; }

}  // namespace finsight::host
