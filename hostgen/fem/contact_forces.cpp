// Letters: q forces of the candidates, B their unit loads (columns), f internal forces, K tangent, u displacements,
// y = A u - b the plates' errors (plate_errors.h), W = K^-1 A^T, J = W^T B = A K^-1 B the errors' derivative by the
// forces.
//
// K is factored in single precision. A finger is so soft in its bending beside the stiffness of its plates that this
// alone leaves its softest motions wrong by a tenth. Products with K in double precision put that right.
#include "hostgen/fem/contact_forces.h"

#include <LBFGS.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <ctime>
#include <limits>
#include <stdexcept>

#include "hostgen/common.h"
#include "hostgen/fem/equilibrium.h"
#include "hostgen/fem/plate_errors.h"
#include "hostgen/fem/statics.h"

namespace finsight::host {

namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;
using Body = std::vector<double>;  // a vector of the ElasticBody

constexpr int kNumbers = PlateErrors::kNumbers;
constexpr int kMostFactors = 10, kMostChords = 6;  // of one estimate; with one factor
constexpr double kSlow = 0.5, kFar_mm = 0.3;       // a chord that shrinks less or goes further needs a new factor
constexpr double kStill_mm = 1e-3;                 // no node moves further in the last step
constexpr int kChoices = 3;                        // factors with which the number of contacts is chosen
constexpr double kFarCaution = 100;                // of the first step: as if the noise were ten times itself
constexpr double kSmallestJ = 0.05;                // volume ratio below which an element is as good as inverted
constexpr int kHalvings = 6;
constexpr double kNoiseAlone = 42.3;  // chi-squared at 99.9 % for 18 numbers

class ProcessorTime {
 public:
  double seconds() const { return static_cast<double>(std::clock() - start_) / CLOCKS_PER_SEC; }

 private:
  std::clock_t start_ = std::clock();
};

double largest(const Body& v) {
  double most = 0;
  for (const double x : v) most = std::max(most, std::abs(x));
  return most;
}

}  // namespace

struct ContactForceSolver::Problem {
  Problem(const FingerSpec& finger, const TetMesh& tets, int count, int starts);

  void prepare_starts(int points);
  void add_load(const FacePoint& at, double force_n, Body& load) const;
  void add_load(const ContactChoice& choice, Body& load) const;
  Body load(const VectorXd& q) const;
  VectorXd along_candidates(const Body& w) const;
  VectorXd response_at(const FacePoint& at) const;
  Eigen::Vector3d displacement(int node) const;
  Eigen::Vector3d displacement(const FacePoint& at) const;
  bool press(Equilibrium& solver, const Body& target, ElasticState& from_rest) const;
  void blend_starts();
  Body times_tangent(const Body& w) const;
  void solve_with_tangent(Body& b);
  bool linearise();
  void solve_roughly(Body& b);
  bool chord(ContactChoice& choice, VectorXd& goal, double caution);
  bool iterate(ContactChoice& choice, VectorXd& goal, const ProcessorTime& time, ContactForces& result);

  const FingerSpec spec;
  const QuadraticMesh mesh;
  const ElasticBody body;
  const std::vector<FacePoint> candidates;
  Eigen::Matrix3Xd candidates_mm;
  PlateErrors errors;
  Equilibrium equilibrium;
  ElasticState rest, state;
  std::vector<ElasticState> starts;
  // Of the latest linearisation, and the latest step.
  MatrixXd W;
  PushResponse response;  ///< J
  MatrixXd soft;          ///< [body, numbers] motions that span the softest ones, and the inverse of their stiffness
  MatrixXd compliance;
  Body step;
};

namespace {

std::vector<FacePoint> face_points(const QuadraticMesh& mesh, const std::vector<Vec3f>& points) {
  std::vector<FacePoint> found;
  for (const Vec3f& point : points) found.push_back(face_point(mesh, point.x(), point.y()));
  return found;
}

}  // namespace

ContactForceSolver::Problem::Problem(const FingerSpec& finger, const TetMesh& tets, int count, int start_points)
    : spec(finger),
      mesh(make_quadratic(tets)),
      body(mesh, tet_materials(finger, mesh.region)),
      candidates(face_points(mesh, touch_points(finger, count))),
      candidates_mm(3, count),
      errors(finger, mesh, body),
      equilibrium(body),
      rest(body),
      state(body),
      step(body.vector_size()) {
  body.stresses(rest.u, rest.u, rest.stress);
  state = rest;
  for (Index j = 0; j < count; ++j) candidates_mm.col(j) = candidates[static_cast<std::size_t>(j)].at_mm;
  response.grid_mm = candidates_mm.topRows<2>();
  response.at_grid.resize(kNumbers, count);
  response.at = [this](const Eigen::Vector2d& place) { return response_at(face_point(mesh, place.x(), place.y())); };
  response.inside = [this](const Eigen::Vector2d& place) {
    const double y = std::clamp(place.y(), spec.touch_y_mm[0], spec.touch_y_mm[1]);
    const double half = spec.half_width.at(y) - spec.touch_edge_mm;
    return Eigen::Vector2d(std::clamp(place.x(), -half, half), y);
  };
  prepare_starts(start_points);
}

// Higher forces of a path are not tried once one found no equilibrium.
void ContactForceSolver::Problem::prepare_starts(int points) {
  constexpr int kForces = 3;
  const std::vector<FacePoint> places = face_points(mesh, touch_points(spec, points));
  std::vector<std::vector<ElasticState>> found(places.size());
  finsight::host::Progress progress("equilibria to start from", places.size());
  parallel_for(places.size(), [&](std::size_t i) {
    Equilibrium solver(body);
    ElasticState at = rest;
    for (int k = 1; k <= kForces; ++k) {
      Body target(body.vector_size());
      add_load(places[i], spec.force_n[1] * k / kForces, target);
      if (!solver.solve(target, at)) break;
      found[i].push_back(at);
    }
    progress.advance();
  });
  for (auto& path : found) std::move(path.begin(), path.end(), std::back_inserter(starts));
}

void ContactForceSolver::Problem::add_load(const FacePoint& at, double force_n, Body& load) const {
  for (std::size_t i = 0; i < at.node.size(); ++i) {
    const int unknown = body.unknown_of_node()[static_cast<std::size_t>(at.node[i])];
    if (unknown == body.free_nodes()) continue;  // carried by the base at once
    Eigen::Map<Eigen::Vector3d>(&load[3 * static_cast<std::size_t>(unknown)]) += force_n * at.weight[i] * at.inward;
  }
}

void ContactForceSolver::Problem::add_load(const ContactChoice& choice, Body& load) const {
  for (Index i = 0; i < choice.force_n.size(); ++i) {
    add_load(face_point(mesh, choice.place_mm(0, i), choice.place_mm(1, i)), choice.force_n[i], load);
  }
}

// B q
Body ContactForceSolver::Problem::load(const VectorXd& q) const {
  Body sum(body.vector_size());
  for (Index j = 0; j < q.size(); ++j) {
    if (q[j] != 0) add_load(candidates[static_cast<std::size_t>(j)], q[j], sum);
  }
  return sum;
}

// B^T w, for a w that is zero at fixed nodes
VectorXd ContactForceSolver::Problem::along_candidates(const Body& w) const {
  VectorXd sums = VectorXd::Zero(candidates_mm.cols());
  for (std::size_t j = 0; j < candidates.size(); ++j) {
    const FacePoint& at = candidates[j];
    for (std::size_t i = 0; i < at.node.size(); ++i) {
      const auto unknown = static_cast<std::size_t>(body.unknown_of_node()[static_cast<std::size_t>(at.node[i])]);
      const Eigen::Map<const Eigen::Vector3d> value(&w[3 * unknown]);
      sums[static_cast<Index>(j)] += at.weight[i] * at.inward.dot(value);
    }
  }
  return sums;
}

// W^T b of a unit load
VectorXd ContactForceSolver::Problem::response_at(const FacePoint& at) const {
  VectorXd sum = VectorXd::Zero(kNumbers);
  for (std::size_t i = 0; i < at.node.size(); ++i) {
    const Index row = 3 * body.unknown_of_node()[static_cast<std::size_t>(at.node[i])];
    sum += at.weight[i] * (W.middleRows<3>(row).transpose() * at.inward);
  }
  return sum;
}

Eigen::Vector3d ContactForceSolver::Problem::displacement(int node) const {
  const auto unknown = static_cast<std::size_t>(body.unknown_of_node()[static_cast<std::size_t>(node)]);
  return Eigen::Map<const Eigen::Vector3d>(&state.u[3 * unknown]);
}

Eigen::Vector3d ContactForceSolver::Problem::displacement(const FacePoint& at) const {
  Eigen::Vector3d sum = Eigen::Vector3d::Zero();
  for (std::size_t i = 0; i < at.node.size(); ++i) sum += at.weight[i] * displacement(at.node[i]);
  return sum;
}

// In ever more even steps.
bool ContactForceSolver::Problem::press(Equilibrium& solver, const Body& target, ElasticState& answer) const {
  answer = rest;
  if (largest(target) == 0) return true;
  for (const int steps : {1, 3, 9}) {
    answer = rest;
    bool good = true;
    for (int k = 1; k <= steps && good; ++k) {
      Body part = target;
      for (double& x : part) x *= static_cast<double>(k) / steps;
      good = solver.solve(part, answer);
    }
    if (good) return true;
  }
  return false;
}

// Displacements, and stresses too: those of a mixture are nearer to an equilibrium's than what its displacements make,
// because rotations of slender walls then do not look like strains.
void ContactForceSolver::Problem::blend_starts() {
  const PlateErrors::Numbers at_rest = errors.at(rest.u);
  MatrixXd motion(kNumbers, static_cast<Index>(starts.size()));
  for (std::size_t s = 0; s < starts.size(); ++s) motion.col(static_cast<Index>(s)) = errors.at(starts[s].u) - at_rest;
  const VectorXd weight = nonnegative_least_squares(motion, -at_rest);
  state = rest;
  for (std::size_t s = 0; s < starts.size(); ++s) {
    const double share = weight[static_cast<Index>(s)];
    if (share == 0) continue;
    for (std::size_t i = 0; i < state.u.size(); ++i) state.u[i] += share * starts[s].u[i];
    for (std::size_t i = 0; i < state.stress.size(); ++i) state.stress[i] += share * starts[s].stress[i];
  }
}

// K w
Body ContactForceSolver::Problem::times_tangent(const Body& w) const {
  Body product(w.size());
  body.times_tangent(state.u, state.stress, w, product);
  std::fill_n(product.end() - 3, 3, 0.0);
  return product;
}

// Conjugate gradients, with the factor of the latest linearise() as preconditioner.
void ContactForceSolver::Problem::solve_with_tangent(Body& b) {
  constexpr int kMostIterations = 20;
  constexpr double kTolerance = 1e-7;
  const auto map = [](Body& v) { return Eigen::Map<VectorXd>(v.data(), static_cast<Index>(v.size())); };
  Body x(b.size()), z = b, d;
  const double goal = kTolerance * map(b).norm();
  double before = 0;
  for (int k = 0; k < kMostIterations && map(b).norm() > goal; ++k) {
    z = b;
    equilibrium.apply_inverse(z);
    const double now = map(b).dot(map(z));
    if (k == 0)
      d = z;
    else
      map(d) = map(z) + now / before * map(d);
    Body Kd = times_tangent(d);
    const double way = now / map(d).dot(map(Kd));
    map(x) += way * map(d);
    map(b) -= way * map(Kd);
    before = now;
  }
  b = std::move(x);
}

// K is symmetric, so a solve per number of the plates serves all candidates. The softest motions, which are wrong, are
// all among the solutions: the best approximation of K^-1 A^T by combinations of them (Ritz) is right.
bool ContactForceSolver::Problem::linearise() {
  if (!equilibrium.linearise(state)) return false;
  const auto size = static_cast<Index>(body.vector_size());
  MatrixXd K_soft(size, kNumbers), right(size, kNumbers);
  soft.resize(size, kNumbers);
  Body w(body.vector_size());
  for (int number = 0; number < kNumbers; ++number) {
    errors.transpose(PlateErrors::Numbers::Unit(number), w);
    right.col(number) = Eigen::Map<const VectorXd>(w.data(), size);
    equilibrium.apply_inverse(w);
    soft.col(number) = Eigen::Map<const VectorXd>(w.data(), size);
    const Body Kw = times_tangent(w);
    K_soft.col(number) = Eigen::Map<const VectorXd>(Kw.data(), size);
  }
  const MatrixXd stiffness = soft.transpose() * K_soft;
  compliance = (0.5 * (stiffness + stiffness.transpose())).completeOrthogonalDecomposition().pseudoInverse();
  W = soft * (compliance * (soft.transpose() * right));
  for (Index j = 0; j < candidates_mm.cols(); ++j) {
    response.at_grid.col(j) = response_at(candidates[static_cast<std::size_t>(j)]);
  }
  return true;
}

// b -> about K^-1 b: by the factor, then what that leaves by the softest motions.
void ContactForceSolver::Problem::solve_roughly(Body& b) {
  const auto size = static_cast<Index>(b.size());
  Body x = b;
  equilibrium.apply_inverse(x);
  const Body Kx = times_tangent(x);
  const VectorXd left = Eigen::Map<const VectorXd>(b.data(), size) - Eigen::Map<const VectorXd>(Kx.data(), size);
  Eigen::Map<VectorXd>(b.data(), size) =
      Eigen::Map<const VectorXd>(x.data(), size) + soft * (compliance * (soft.transpose() * left));
}

// Newton's step du = K^-1 (B q - f) for forces q leads to the errors y + A du = y - W^T f + J q. So the best q are
// those of a linear problem, whatever the forces before were. `caution` 0: as many contacts as before. False if the
// step leaves elements inverted.
bool ContactForceSolver::Problem::chord(ContactChoice& choice, VectorXd& goal, double caution) {
  Body f(body.vector_size());
  body.forces(state.u, f);
  std::fill_n(f.end() - 3, 3, 0.0);
  goal = W.transpose() * Eigen::Map<const VectorXd>(f.data(), W.rows()) - errors.at(state.u);
  choice = caution > 0 ? fewest_contacts(response, goal, choice, caution) : refined_contacts(response, goal, choice);
  std::fill(step.begin(), step.end(), 0.0);
  add_load(choice, step);
  for (std::size_t i = 0; i < step.size(); ++i) step[i] -= f[i];
  solve_roughly(step);
  for (int halving = 0; halving <= kHalvings; ++halving) {
    Body there = state.u;
    for (std::size_t i = 0; i < step.size(); ++i) there[i] += step[i];
    if (body.forces(there, f) > kSmallestJ) {
      state.u = std::move(there);
      return true;
    }
    for (double& x : step) x *= 0.5;
  }
  return false;
}

// From the present state. Chords follow a factor as long as they shrink fast.
bool ContactForceSolver::Problem::iterate(ContactChoice& choice, VectorXd& goal, const ProcessorTime& time,
                                          ContactForces& result) {
  for (int factors = 0; factors < kMostFactors; ++factors) {
    if (factors > 0) {  // the stress before the last step, changed by it to first order: see Equilibrium
      for (std::size_t i = 0; i < step.size(); ++i) state.u[i] -= step[i];
      body.stresses(state.u, step, state.stress);
      for (std::size_t i = 0; i < step.size(); ++i) state.u[i] += step[i];
    }
    if (!linearise()) {
      std::fill(step.begin(), step.end(), 0.0);
      body.stresses(state.u, step, state.stress);
      if (!linearise()) return false;
    }
    double last_mm = std::numeric_limits<double>::infinity();
    for (int chords = 0; chords < kMostChords; ++chords) {
      // Far from the answer, what is left is not noise but bent by the step's length. Later on their number stays, or
      // two answers that are as good could take turns for ever.
      const double caution = chords > 0 || factors > kChoices ? 0 : factors == 0 ? kFarCaution : 1;
      if (!chord(choice, goal, caution)) return false;
      result.curve.push_back({time.seconds(), 0.5 * errors.at(state.u).squaredNorm()});
      const double moved_mm = largest(step);
      if (moved_mm < kStill_mm && factors > 0) return true;  // with the first, weak contacts are not even looked for
      if (moved_mm < kStill_mm || moved_mm > kFar_mm || moved_mm > kSlow * last_mm) break;
      last_mm = moved_mm;
    }
  }
  return false;
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
  VectorXd goal;
  p.blend_starts();
  result.curve.push_back({time.seconds(), 0.5 * p.errors.at(p.state.u).squaredNorm()});
  result.converged = p.iterate(choice, goal, time, result);
  if (!result.converged) {  // from the equilibrium of what was found so far: slower, and surer
    Body target(p.body.vector_size());
    p.add_load(choice, target);
    result.converged = p.press(p.equilibrium, target, p.state) && p.iterate(choice, goal, time, result);
  }
  result.misfit = 2 * result.curve.back().objective;
  result.explained = result.converged && result.misfit < kNoiseAlone;
  for (Index i = 0; i < choice.force_n.size(); ++i) {
    const FacePoint at = face_point(p.mesh, choice.place_mm(0, i), choice.place_mm(1, i));
    result.contacts.push_back({{at.at_mm.cast<float>(), choice.force_n[i]},
                               p.displacement(at).cast<float>(),
                               contact_doubt(p.response, goal, choice, i)});
  }
  result.node_displacement_mm = node_displacement_mm();
  return result;
}

ContactForces ContactForceSolver::lbfgs(const PlatePoses& measured, int iterations) {
  Problem& p = *problem_;
  const ProcessorTime time;
  p.state = p.rest;
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
    const Body target = p.load(force_n);
    if (!p.equilibrium.solve(target, p.state) && !p.press(p.equilibrium, target, p.state)) {
      p.state = p.rest;
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
  result.explained = result.misfit < kNoiseAlone;
  return result;
}

bool ContactForceSolver::press(const std::vector<FaceForce>& forces) {
  Body target(problem_->body.vector_size());
  for (const FaceForce& force : forces) {
    problem_->add_load(face_point(problem_->mesh, force.point_mm.x(), force.point_mm.y()), force.force_n, target);
  }
  return problem_->press(problem_->equilibrium, target, problem_->state);
}

bool ContactForceSolver::press(const VectorXd& candidate_force_n) {
  return problem_->press(problem_->equilibrium, problem_->load(candidate_force_n), problem_->state);
}

// dJ/dq = B^T K^-1 A^T y: one solve with the tangent for all forces (paper, section 2.3).
double ContactForceSolver::objective(const PlatePoses& measured, VectorXd* gradient) {
  Problem& p = *problem_;
  p.errors.set_measured(measured);
  const PlateErrors::Numbers y = p.errors.at(p.state.u);
  if (gradient) {
    Body w(p.body.vector_size());
    p.errors.transpose(y, w);
    if (!p.equilibrium.linearise(p.state)) throw std::runtime_error("contact forces: the finger is at a bifurcation");
    p.solve_with_tangent(w);
    *gradient = p.along_candidates(w);
  }
  return 0.5 * y.squaredNorm();
}

PlatePoses ContactForceSolver::plates() const {
  const Problem& p = *problem_;
  PlatePoses result;
  for (std::size_t i = 0; i < kPlates; ++i) {
    std::vector<Eigen::Vector3d> at_rest, now;
    for (const int node : p.mesh.plate_nodes[i]) {
      at_rest.push_back(p.mesh.node_mm[static_cast<std::size_t>(node)]);
      now.push_back(at_rest.back() + p.displacement(node));
    }
    result.plates[i] = rigid_fit(at_rest, now, p.spec.plates[i].T_finger_marker.translation());
    result.seen[i] = true;
  }
  result.quality = Quality::kFresh;
  return result;
}

std::vector<double> ContactForceSolver::node_displacement_mm() const {
  std::vector<double> displacement;
  for (std::size_t node = 0; node < problem_->mesh.corner_nodes; ++node) {
    const Eigen::Vector3d u = problem_->displacement(static_cast<int>(node));
    displacement.insert(displacement.end(), u.begin(), u.end());
  }
  return displacement;
}

const Eigen::Matrix3Xd& ContactForceSolver::candidates_mm() const { return problem_->candidates_mm; }
Eigen::Vector3d ContactForceSolver::inward() const { return problem_->candidates.front().inward; }

}  // namespace finsight::host
