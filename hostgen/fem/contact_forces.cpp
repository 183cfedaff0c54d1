// Letters: q the forces of the pushes, B their unit loads (columns), f internal forces, K tangent, u displacements,
// y = A u - b the plates' errors (plate_errors.h), W = K^-1 A^T, J = W^T B their derivative with respect to q.
#include "hostgen/fem/contact_forces.h"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <limits>

#include "hostgen/fem/contact_problem.h"
#include "hostgen/fem/nonnegative_least_squares.h"
#include "hostgen/util/common.h"
#include "hostgen/util/statistics.h"

namespace finsight::host {

namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;
using BodyVector = PushedFinger::BodyVector;

constexpr Index kMaxDirections = 16;  // the other two, in which a finger hardly moves, would take half the time more
constexpr int kMaxFactors = 10, kMaxChords = 12;  // of one estimate; with one factor
constexpr double kChordsPerFactor = 9;            // that take as long. Measured on the default finger: 36 and 4 ms.
constexpr double kFirstRate = 0.06;               // by which a new factor's second step is shorter than its first
constexpr double kFar_mm = 0.4;     // a step this far bends slender walls so that chords after it would lead astray
constexpr double kStill_mm = 2e-2;  // no node is further from where the steps lead to; noise moves it more
constexpr int kChoices = 3;         // how often convergence may end with other contacts than before
constexpr double kMaxNoiseInflation = 100;  // of the first step: as if the noise were ten times itself
constexpr double kSmallestJ = 0.05;         // volume ratio below which an element is as good as inverted
constexpr int kStepHalvings = 6;

double largest(const BodyVector& v) {
  double most = 0;
  for (const double x : v) most = std::max(most, std::abs(x));
  return most;
}

}  // namespace

ContactForceSolver::Problem::Problem(const FingerSpec& spec, const TetMesh& tets, int count, int start_points)
    : finger(spec, tets),
      candidates(finger.spread_points(count)),
      candidates_mm(3, count),
      errors(spec, finger.mesh, finger.body),
      equilibrium(finger.body),
      state(finger.rest),
      step(finger.zero()),
      force(finger.zero()) {
  for (Index j = 0; j < count; ++j) candidates_mm.col(j) = candidates[static_cast<std::size_t>(j)].at_mm;
  response.grid_mm = candidates_mm.topRows<2>();
  response.at_grid.resize(kPoseDims, count);
  response.at = [this](const Eigen::Vector2d& place) { return tangent.of(finger.at(place)); };
  response.inside = [this](const Eigen::Vector2d& place) { return finger.inside(place); };
  prepare_starts(start_points);
}

// Higher forces of a path are not tried once one found no equilibrium.
void ContactForceSolver::Problem::prepare_starts(int points) {
  constexpr int kForces = 3;
  const std::vector<FacePoint> places = finger.spread_points(points);
  std::vector<std::vector<ElasticState>> found(places.size());
  finsight::host::Progress progress("equilibria to start from", places.size());
  parallel_for(places.size(), [&](std::size_t i) {
    Equilibrium solver(finger.body);
    ElasticState at = finger.rest;
    for (int k = 1; k <= kForces; ++k) {
      BodyVector target = finger.zero();
      finger.add_push(places[i], finger.spec.force_n[1] * k / kForces, target);
      if (!solver.solve(target, at)) break;
      found[i].push_back(at);
    }
    progress.advance();
  });
  for (auto& path : found) std::move(path.begin(), path.end(), std::back_inserter(starts));
}

// Displacements, and stresses too: those of a mixture are nearer to an equilibrium's than what its displacements make,
// because rotations of slender walls then do not look like strains.
void ContactForceSolver::Problem::blend_starts() {
  const PoseVectorOf<double> at_rest = errors.at(finger.rest.u);
  MatrixXd motion(kPoseDims, static_cast<Index>(starts.size()));
  for (std::size_t s = 0; s < starts.size(); ++s) motion.col(static_cast<Index>(s)) = errors.at(starts[s].u) - at_rest;
  const Eigen::SelfAdjointEigenSolver<MatrixXd> known(MatrixXd(motion * motion.transpose()));
  const Index seen = (known.eigenvalues().array() > 0.01 / static_cast<double>(starts.size())).count();
  directions = known.eigenvectors().rightCols(std::min(kMaxDirections, seen));
  const VectorXd weight = nonnegative_least_squares(motion, -at_rest);
  state = finger.rest;
  for (std::size_t s = 0; s < starts.size(); ++s) {
    const double share = weight[static_cast<Index>(s)];
    if (share == 0) continue;
    for (std::size_t i = 0; i < state.u.size(); ++i) state.u[i] += share * starts[s].u[i];
    for (std::size_t i = 0; i < state.stress.size(); ++i) state.stress[i] += share * starts[s].stress[i];
  }
}

bool ContactForceSolver::Problem::linearise() {
  if (!tangent.linearise(state, errors, directions)) return false;
  for (std::size_t j = 0; j < candidates.size(); ++j) {
    response.at_grid.col(static_cast<Index>(j)) = tangent.of(candidates[j]);
  }
  return true;
}

// Newton's step du = K^-1 (B q - f) for forces q leads to the errors y + A du = y - W^T f + J q. So the best q are
// those of a linear problem, J q = W^T f - y, whatever the forces before were.
VectorXd ContactForceSolver::Problem::goal() const { return tangent.of(force) - errors.at(state.u); }

// False if the step leaves elements inverted.
bool ContactForceSolver::Problem::chord(const ContactChoice& choice) {
  std::fill(step.begin(), step.end(), 0.0);
  for (Index i = 0; i < choice.force_n.size(); ++i) {
    finger.add_push(finger.at(choice.place_mm.col(i)), choice.force_n[i], step);
  }
  for (std::size_t i = 0; i < step.size(); ++i) step[i] -= force[i];
  std::fill_n(step.end() - 3, 3, 0.0);
  tangent.solve(step);
  for (int halving = 0; halving <= kStepHalvings; ++halving) {
    BodyVector there = state.u;
    for (std::size_t i = 0; i < step.size(); ++i) there[i] += step[i];
    if (finger.body.forces(there, force) > kSmallestJ) {
      std::fill_n(force.end() - 3, 3, 0.0);
      state.u = std::move(there);
      return true;
    }
    for (double& x : step) x *= 0.5;
  }
  return false;
}

/// How much more a contact must explain than noise would, where `objective` is what the start leaves: it is not more
/// exact than that.
double noise_inflation(double objective) { return std::clamp(2 * objective / kPoseDims, 1.0, kMaxNoiseInflation); }

// From the present state. Chords follow a factor as long as that takes less time than a new one. Contacts are chosen
// when the steps start and, the steps having become still, again, until their number stays; between, they only move.
// Far from the answer, what is left is not noise but bent by the step's length: there only strong contacts are chosen,
// the stronger the more is left.
bool ContactForceSolver::Problem::iterate(ContactChoice& choice, VectorXd& aim, const ProcessorTime& time,
                                          ContactForces& result) {
  finger.body.forces(state.u, force);
  std::fill_n(force.end() - 3, 3, 0.0);
  int choices = 0;
  for (int factors = 0; factors < kMaxFactors; ++factors) {
    if (factors > 0) {  // the stress before the last step, changed by it to first order: see Equilibrium
      for (std::size_t i = 0; i < step.size(); ++i) state.u[i] -= step[i];
      finger.body.stresses(state.u, step, state.stress);
      for (std::size_t i = 0; i < step.size(); ++i) state.u[i] += step[i];
    }
    if (!linearise()) {
      std::fill(step.begin(), step.end(), 0.0);
      finger.body.stresses(state.u, step, state.stress);
      if (!linearise()) return false;
    }
    double last_mm = 0;
    for (int chords = 0; chords < kMaxChords; ++chords) {
      aim = goal();
      if (factors == 0 && chords == 0)
        choice = fewest_contacts(response, aim, choice, noise_inflation(result.curve.back().objective));
      else
        choice = refined_contacts(response, aim, choice);
      if (!chord(choice)) return false;
      result.curve.push_back({time.seconds(), 0.5 * errors.at(state.u).squaredNorm()});
      const double moved_mm = largest(step);
      const double rate = last_mm > 0 ? moved_mm / last_mm : kFirstRate;
      last_mm = moved_mm;
      if (moved_mm < kStill_mm || (rate < 0.7 && moved_mm * rate / (1 - rate) < kStill_mm)) {
        if (choices++ == kChoices) return true;
        aim = goal();
        ContactChoice again = fewest_contacts(response, aim, choice);
        if (again.force_n.size() == choice.force_n.size()) return true;
        choice = std::move(again);
        last_mm = 0;
      } else if (moved_mm > kFar_mm || std::log(kStill_mm / moved_mm) < kChordsPerFactor * std::log(rate)) {
        break;
      }
    }
  }
  return false;
}

/// To the equilibrium under `times` the forces, if there is one near.
void ContactForceSolver::Problem::grow(const ContactChoice& choice, double times) {
  BodyVector target = finger.zero();
  for (Index i = 0; i < choice.force_n.size(); ++i) {
    finger.add_push(finger.at(choice.place_mm.col(i)), times * choice.force_n[i], target);
  }
  ElasticState grown = state;
  std::fill(step.begin(), step.end(), 0.0);
  finger.body.stresses(grown.u, step, grown.stress);
  if (equilibrium.solve(target, grown)) state = std::move(grown);
}

// Towards a share of the measured motion; from the equilibrium under the present forces, grown as the motion grows.
// False: as before.
bool ContactForceSolver::Problem::follow(const PlatePoses& measured, double from, double to, ContactChoice& choice,
                                         VectorXd& aim, const ProcessorTime& time, ContactForces& result) {
  PlatePoses part = measured;
  for (PlateMotion& plate : part.plates) {
    plate.displacement_mm *= static_cast<float>(to);
    plate.rotation_rad *= static_cast<float>(to);
  }
  errors.set_measured(part);
  ElasticState before = state;
  ContactChoice chosen = choice;
  if (from > 0) grow(choice, to / from);
  result.curve.push_back({time.seconds(), 0.5 * errors.at(state.u).squaredNorm()});
  if (iterate(choice, aim, time, result)) return true;
  state = std::move(before);
  choice = std::move(chosen);
  return false;
}

// The measured motion in parts, each smaller where the one before was too large. It follows the finger as it was
// pressed: where it turns far, one leap from a mixture of other states may lead nowhere. With smaller parts it may go
// another way from the start on.
bool ContactForceSolver::Problem::approach(const PlatePoses& measured, ContactChoice& choice, VectorXd& aim,
                                           const ProcessorTime& time, ContactForces& result) {
  double reached = 0;
  for (const double most : {1.0 / 4, 1.0 / 12}) {
    state = finger.rest;
    choice = {};
    reached = 0;
    for (double by = most; reached < 1 && by > most / 10;) {
      const double to = reached + by > 1 - 1e-9 ? 1 : reached + by;
      if (follow(measured, reached, to, choice, aim, time, result)) {
        reached = to;
        by = std::min(most, 2 * by);
      } else {
        by /= 2;
      }
    }
    if (reached == 1) break;
  }
  errors.set_measured(measured);
  return reached == 1;
}

ContactForceSolver::ContactForceSolver(const FingerSpec& spec, const TetMesh& mesh, int candidates, int starts)
    : problem_(std::make_unique<Problem>(spec, mesh, candidates, starts)) {}
ContactForceSolver::~ContactForceSolver() = default;

ContactForces ContactForceSolver::gauss_newton(const PlatePoses& measured) {
  Problem& p = *problem_;
  const ProcessorTime time;
  p.errors.set_measured(measured);
  ContactForces result;
  ContactChoice choice;
  VectorXd aim;
  p.blend_starts();
  result.curve.push_back({time.seconds(), 0.5 * p.errors.at(p.state.u).squaredNorm()});
  result.converged = p.iterate(choice, aim, time, result);
  if (!result.converged) {  // from the equilibrium of what was found so far: slower, and surer
    BodyVector target = p.finger.zero();
    for (Index i = 0; i < choice.force_n.size(); ++i) {
      p.finger.add_push(p.finger.at(choice.place_mm.col(i)), choice.force_n[i], target);
    }
    result.converged = p.finger.press(p.equilibrium, target, p.state) && p.iterate(choice, aim, time, result);
  }
  if (!result.converged) {
    result.in_parts = true;
    result.converged = p.approach(measured, choice, aim, time, result);
  }
  result.misfit = 2 * result.curve.back().objective;
  result.explained = result.converged && noise_explains(result.misfit, measured);
  result.total = total_force(p.response, aim, choice);
  const std::vector<ContactUncertainty> uncertainties = contact_uncertainties(p.response, aim, choice);
  for (Index i = 0; i < choice.force_n.size(); ++i) {
    const FacePoint at = p.finger.at(choice.place_mm.col(i));
    result.contacts.push_back({{at.at_mm.cast<float>(), choice.force_n[i]},
                               p.finger.displacement(p.state, at).cast<float>(),
                               uncertainties[static_cast<std::size_t>(i)]});
  }
  result.node_displacement_mm = node_displacement_mm();
  result.seconds = time.seconds();
  return result;
}

bool ContactForceSolver::noise_explains(double misfit, const PlatePoses& measured) {
  constexpr double kSurely = 3.09;  // 99.9 %
  const auto seen = std::count(measured.seen.begin(), measured.seen.end(), true);
  return seen > 0 && misfit < chi_squared_quantile(static_cast<double>(6 * seen), kSurely);
}

bool ContactForceSolver::press(const std::vector<FaceForce>& forces) {
  Problem& p = *problem_;
  BodyVector target = p.finger.zero();
  for (const FaceForce& force : forces) {
    p.finger.add_push(p.finger.at(force.point_mm.head<2>().cast<double>()), force.force_n, target);
  }
  return p.finger.press(p.equilibrium, target, p.state);
}

PlatePoses ContactForceSolver::plates() const { return problem_->finger.plates(problem_->state); }
std::vector<double> ContactForceSolver::node_displacement_mm() const {
  return problem_->finger.node_displacement_mm(problem_->state);
}
Eigen::Vector3d ContactForceSolver::inward() const { return problem_->candidates.front().inward; }

}  // namespace finsight::host
