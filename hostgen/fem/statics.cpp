#include "hostgen/fem/statics.h"

#include <algorithm>
#include <cassert>
#include <cmath>
#include <functional>
#include <optional>
#include <stdexcept>

namespace finsight::host {
namespace {

// A push beyond this is outside what the finger is made for (paper: 20 mm).
constexpr double kLongestPush_mm = 20;
// States of a path that the next one is extrapolated from: a polynomial of degree 5.
constexpr std::size_t kHistory = 6;
// A step that fails is halved, at most this often.
constexpr int kLoadHalvings = 7;
// Solves of one step with a load that turns with the face.
constexpr int kMaxTurns = 4;
// A finger whose compliance grows by this factor from one step to the next has jumped.
constexpr double kJump = 8;
// Of the stiffness at rest, against the softest motion. Where the default finger buckles, at most 4 % are left in the
// last state before, and up to 32 % where friction that turns with the face no longer settles (of 570 paths); a step
// that is too long for Newton fails with any.
constexpr double kSoftened = 1.0 / 3;

double distance(const std::vector<double>& a, const std::vector<double>& b) {
  double total = 0;
  for (std::size_t i = 0; i < a.size(); ++i) total += (a[i] - b[i]) * (a[i] - b[i]);
  return std::sqrt(total);
}

/// Adds `weight` times `from` to `to`.
void add(const ElasticState& from, double weight, ElasticState& to) {
  for (std::size_t i = 0; i < to.u.size(); ++i) to.u[i] += weight * from.u[i];
  for (std::size_t i = 0; i < to.stress.size(); ++i) to.stress[i] += weight * from.stress[i];
}

}  // namespace

/// Loads lie on curves: load(s). While the touched place stays, s is the force, so that the states of a whole path lie
/// on one curve and can be extrapolated.
struct FingerStatics::Solver {
  using BodyVector = PushedFinger::BodyVector;
  /// Sets the load at `s`; `guess` is the state that is expected there.
  using LoadCurve = std::function<void(double s, const ElasticState& guess, BodyVector& load)>;
  struct Station {
    double s = 0;
    ElasticState state;
  };

  explicit Solver(std::shared_ptr<const PushedFinger> shared)
      : finger(std::move(shared)), equilibrium(finger->body), trial(finger->body) {
    reset();
  }

  void reset() {
    place = FacePoint{};
    contacts.reset();
    force_n = 0;
    present_load = weight = finger->zero();
    compliance = 0;
    history.assign(1, Station{0, finger->rest});
  }

  const ElasticState& state() const { return history.back().state; }

  /// What a walk that fails goes back to.
  struct Snapshot {
    std::vector<Station> history;
    double compliance;
    BodyVector present_load;
    std::optional<ContactLoad> contacts;  // as they were directed when the present force was reached
  };
  Snapshot snapshot() const { return {history, compliance, present_load, contacts}; }
  void return_to(const Snapshot& before) {
    history = before.history;
    compliance = before.compliance;
    present_load = before.present_load;
    contacts.reset();
    if (before.contacts) contacts.emplace(*before.contacts);
  }

  bool hang(const Eigen::Vector3d& felt_g);
  FemState describe(const ContactResult& at, double normal_n, const ElasticState& body) const;
  bool go(const FacePoint& target, double target_force_n);
  bool press(double target_force_n);
  bool press(const std::vector<FaceContact>& target, double target_force_n);
  void extrapolate(double s);
  bool step_to(double s, const LoadCurve& curve);
  bool has_softened();
  bool walk(double from, double to, const LoadCurve& curve);

  std::shared_ptr<const PushedFinger> finger;
  Equilibrium equilibrium;
  FacePoint place;  ///< where the force of `force_n` is applied now
  double force_n = 0;
  std::optional<ContactLoad> contacts;  ///< instead of the place, after begin()
  BodyVector present_load, weight;      ///< the weight is part of the load
  double compliance = 0;         ///< distance of the last two states over the distance of their loads; 0: unknown
  bool jumped = false;           ///< a step since the last that did not fail
  bool buckled = false;          ///< why the last walk failed
  double stiffness_at_rest = 0;  ///< against the softest motion; 0: not asked for yet
  std::chrono::steady_clock::time_point deadline = std::chrono::steady_clock::time_point::max();
  std::vector<Station> history;  ///< the latest states of the present line of loads; the last is the present one
  ElasticState trial;
};

/// Sets `trial` to the polynomial through the history, at s.
void FingerStatics::Solver::extrapolate(double s) {
  std::size_t first = 0;
  // Far outside its sample points, the polynomial is a worse guess than the last state.
  if (std::abs(s - history.back().s) > 1.5 * std::abs(history.back().s - history.front().s)) first = history.size() - 1;
  std::fill(trial.u.begin(), trial.u.end(), 0.0);
  std::fill(trial.stress.begin(), trial.stress.end(), 0.0);
  for (std::size_t i = first; i < history.size(); ++i) {
    double weight = 1;
    for (std::size_t j = first; j < history.size(); ++j) {
      if (j != i) weight *= (s - history[j].s) / (history[i].s - history[j].s);
    }
    add(history[i].state, weight, trial);
  }
}

bool FingerStatics::Solver::step_to(double s, const LoadCurve& curve) {
  extrapolate(s);
  BodyVector load = finger->zero();
  for (int turns = 0; turns == 0 || (turns < kMaxTurns && contacts && contacts->has_turned(trial)); ++turns) {
    curve(s, trial, load);
    if (!equilibrium.solve(load, trial)) return false;
  }
  const double new_compliance = distance(trial.u, history.back().state.u) / distance(load, present_load);
  if (compliance > 0 && new_compliance > kJump * compliance) {
    jumped = true;
    return false;
  }
  jumped = false;
  compliance = new_compliance;
  present_load = std::move(load);
  if (history.size() == kHistory) history.erase(history.begin());
  history.push_back({s, trial});
  return true;
}

bool FingerStatics::Solver::has_softened() {
  if (stiffness_at_rest == 0) stiffness_at_rest = equilibrium.softest_stiffness(finger->rest);
  return equilibrium.softest_stiffness(state()) < kSoftened * stiffness_at_rest;
}

bool FingerStatics::Solver::walk(double from, double to, const LoadCurve& curve) {
  double at = from, step = to - from;
  jumped = buckled = false;
  const double shortest = std::abs(step) / (1 << kLoadHalvings);
  while (at != to) {
    if (std::chrono::steady_clock::now() > deadline) return false;
    // A remainder shorter than half a step is merged into this one.
    const double next = std::abs(to - at) < 1.5 * std::abs(step) ? to : at + step;
    if (step_to(next, curve)) {
      at = next;
      step *= 2;
      continue;
    }
    step = 0.5 * (next - at);
    if (std::abs(step) < shortest) {
      buckled = jumped || has_softened();
      return false;
    }
    history.erase(history.begin(), history.end() - 1);  // the path is less smooth than the extrapolation assumed
  }
  return true;
}

bool FingerStatics::Solver::hang(const Eigen::Vector3d& felt_g) {
  if (felt_g.isZero()) return true;
  finger->add_weight(felt_g, weight);
  const LoadCurve part_of_weight = [&](double s, const ElasticState&, BodyVector& load) {
    for (std::size_t i = 0; i < load.size(); ++i) load[i] = s * weight[i];
  };
  if (!walk(0, 1, part_of_weight)) return false;
  history = {Station{0, history.back().state}};
  compliance = 0;
  return true;
}

bool FingerStatics::Solver::press(double target_force_n) {
  const Snapshot before = snapshot();
  const LoadCurve curve = [&](double s, const ElasticState& guess, BodyVector& load) {
    contacts->forces(s, guess, load);
    for (std::size_t i = 0; i < load.size(); ++i) load[i] += weight[i];
  };
  if (!walk(force_n, target_force_n, curve)) {
    return_to(before);
    return false;
  }
  force_n = target_force_n;
  return true;
}

// One load fades into the other. A change of contacts says little about how much the finger gives way to force.
bool FingerStatics::Solver::press(const std::vector<FaceContact>& target, double target_force_n) {
  ContactLoad next(*finger, target);
  const Snapshot before = snapshot();
  const LoadCurve fade = [&](double s, const ElasticState& guess, BodyVector& load) {
    contacts->forces(target_force_n, guess, load);
    for (std::size_t i = 0; i < load.size(); ++i)
      load[i] = (1 - s) * before.present_load[i] + s * (load[i] + weight[i]);
  };
  contacts.emplace(std::move(next));
  history = {Station{0, history.back().state}};
  if (!walk(0, 1, fade)) {
    return_to(before);
    return false;
  }
  history = {Station{target_force_n, history.back().state}};
  compliance = std::max(compliance, before.compliance);
  force_n = target_force_n;
  return true;
}

bool FingerStatics::Solver::go(const FacePoint& target, double target_force_n) {
  const Snapshot before = snapshot();
  const bool same_place = force_n == 0 || (place.node == target.node && place.weight == target.weight);
  std::vector<double> base = finger->zero(), direction = finger->zero();
  finger->add_push(target, 1, direction);
  double from = force_n, to = target_force_n;
  if (force_n == 0) history.erase(history.begin(), history.end() - 1);
  if (!same_place) {
    finger->add_push(place, 1, base);
    for (std::size_t i = 0; i < base.size(); ++i) {
      base[i] *= force_n;
      direction[i] = target_force_n * direction[i] - base[i];
    }
    from = 0;
    to = 1;
    history = {Station{0, history.back().state}};
  }
  const LoadCurve line = [&](double s, const ElasticState&, BodyVector& load) {
    for (std::size_t i = 0; i < load.size(); ++i) load[i] = base[i] + s * direction[i];
  };
  if (!walk(from, to, line)) {
    return_to(before);
    return false;
  }
  if (!same_place) {
    history = {Station{target_force_n, history.back().state}};
    // A touch that moves along the face changes the load a lot and the shape little. Measured by that, the next change
    // of force would look like a jump.
    compliance = std::max(compliance, before.compliance);
  }
  place = target;
  force_n = target_force_n;
  return true;
}

FingerStatics::FingerStatics(std::shared_ptr<const PushedFinger> finger)
    : solver_(std::make_unique<Solver>(std::move(finger))) {}
FingerStatics::FingerStatics(const FingerSpec& spec, const TetMesh& mesh)
    : FingerStatics(std::make_shared<const PushedFinger>(spec, mesh)) {}
FingerStatics::~FingerStatics() = default;

void FingerStatics::reset() { solver_->reset(); }

bool FingerStatics::load(const Vec3f& point_mm, double force_n) {
  return solver_->go(solver_->finger->at(point_mm.head<2>().cast<double>()), force_n);
}

bool FingerStatics::begin(const std::vector<FaceContact>& contacts, const Eigen::Vector3d& felt_g) {
  ContactLoad load(*solver_->finger, contacts);
  reset();
  if (!solver_->hang(felt_g)) {
    reset();
    return false;
  }
  solver_->contacts.emplace(std::move(load));
  return true;
}

bool FingerStatics::press(double normal_n) {
  assert(solver_->contacts);
  return solver_->press(normal_n);
}

bool FingerStatics::press(const std::vector<FaceContact>& contacts, double normal_n) {
  assert(solver_->contacts);
  return solver_->press(contacts, normal_n);
}

void FingerStatics::give_up_at(std::chrono::steady_clock::time_point deadline) { solver_->deadline = deadline; }

bool FingerStatics::buckled() const { return solver_->buckled; }

/// Of contacts that led to this state of the finger.
FemState FingerStatics::Solver::describe(const ContactResult& at, double normal_n, const ElasticState& body) const {
  FemState state;
  state.force_n = static_cast<float>(normal_n);
  state.point_mm = at.point_mm.cast<float>();
  state.contact_mm = at.contact_mm.cast<float>();
  const Eigen::Matrix3d axes = face_axes(finger->at(at.point_mm.head<2>()).inward);
  state.force_vector_n = (axes.transpose() * at.force_n).cast<float>();
  state.moment_nmm = at.moment_nmm.cast<float>();
  state.spread_mm = static_cast<float>(at.spread_mm);
  if ((at.contact_mm - at.point_mm).norm() > kLongestPush_mm) state.outcome = Outcome::kPushedTooFar;
  state.plates = finger->plates(body).plates;
  return state;
}

FemState FingerStatics::state() const {
  const PushedFinger& finger = *solver_->finger;
  if (solver_->contacts) {
    return solver_->describe(solver_->contacts->result(solver_->state()), solver_->force_n, solver_->state());
  }
  ContactResult at;
  at.point_mm = solver_->place.at_mm;
  at.contact_mm = at.point_mm + finger.displacement(solver_->state(), solver_->place);
  at.force_n = solver_->force_n * solver_->place.inward;
  at.moment_nmm = at.contact_mm.cross(at.force_n);
  return solver_->describe(at, solver_->force_n, solver_->state());
}

// The forces keep the directions that they have where the face stands now.
std::vector<FemState> FingerStatics::nearby(const std::vector<OtherLoad>& loads) {
  assert(solver_->contacts);
  const PushedFinger& finger = *solver_->finger;
  const ElasticState& here = solver_->state();
  std::vector<FemState> found;
  if (loads.empty() || !solver_->equilibrium.linearise(here, Equilibrium::Precision::kDouble)) return found;
  std::vector<ContactLoad> others;
  const auto size = static_cast<Eigen::Index>(finger.body.vector_size());
  Equilibrium::Columns columns(size, static_cast<Eigen::Index>(loads.size()));
  Solver::BodyVector load = finger.zero();
  for (const OtherLoad& other : loads) {
    const auto column = static_cast<Eigen::Index>(others.size());
    others.emplace_back(finger, other.contacts).forces(other.normal_n, here, load);
    for (std::size_t k = 0; k < load.size(); ++k) {
      columns(static_cast<Eigen::Index>(k), column) = load[k] + solver_->weight[k] - solver_->present_load[k];
    }
  }
  solver_->equilibrium.apply_inverse(columns);
  ElasticState there = here;
  for (std::size_t i = 0; i < others.size(); ++i) {
    for (std::size_t k = 0; k < there.u.size(); ++k) {
      there.u[k] = here.u[k] + columns(static_cast<Eigen::Index>(k), static_cast<Eigen::Index>(i));
    }
    found.push_back(solver_->describe(others[i].result(there), loads[i].normal_n, there));
  }
  return found;
}

std::optional<MotionPerG> FingerStatics::motion_per_g() {
  const PushedFinger& finger = *solver_->finger;
  if (!solver_->equilibrium.linearise(solver_->state(), Equilibrium::Precision::kDouble)) return std::nullopt;
  MotionPerG per_g;
  for (int axis = 0; axis < 3; ++axis) {
    Solver::BodyVector half_g = finger.zero();
    finger.add_weight(0.5 * Eigen::Vector3d::Unit(axis), half_g);
    solver_->equilibrium.apply_inverse(half_g);
    ElasticState less = solver_->state(), more = less;
    for (std::size_t k = 0; k < half_g.size(); ++k) {
      less.u[k] -= half_g[k];
      more.u[k] += half_g[k];
    }
    per_g.col(axis) = (pose_vector(finger.plates(more)) - pose_vector(finger.plates(less))).cast<double>();
  }
  return per_g;
}

const std::vector<double>& FingerStatics::nodal_forces() const { return solver_->present_load; }

EquilibriumCost FingerStatics::cost() const { return solver_->equilibrium.cost(); }

std::vector<double> FingerStatics::node_displacement_mm() const {
  return solver_->finger->node_displacement_mm(solver_->state());
}

std::vector<double> FingerStatics::quadratic_displacement_mm() const {
  return solver_->finger->quadratic_displacement_mm(solver_->state());
}

}  // namespace finsight::host
