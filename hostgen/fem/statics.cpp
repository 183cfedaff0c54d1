#include "hostgen/fem/statics.h"

#include <Eigen/Geometry>
#include <Eigen/SVD>
#include <algorithm>
#include <cmath>

#include "firmware/geometry/so3.h"

namespace finsight::host {
namespace {

// A push beyond this is outside what the finger is made for (paper: 20 mm).
constexpr double kLongestPush_mm = 20;
// States of a path that the next one is extrapolated from: a polynomial of degree 5.
constexpr std::size_t kHistory = 6;
// A step that fails is halved, at most this often.
constexpr int kHalvings = 7;
// A finger that suddenly moves so many times further per newton than in its last step has jumped.
constexpr double kJump = 8;

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

std::vector<NeoHookean> tet_materials(const FingerSpec& spec, const std::vector<int>& region) {
  std::vector<NeoHookean> material;
  for (const int label : region) {
    const double stiffness = label >= kFirstPlateRegion ? spec.plate_stiffness_ratio : 1;
    material.push_back(neo_hookean(stiffness * spec.youngs_modulus_mpa, spec.poisson_ratio));
  }
  return material;
}

PlateMotion rigid_fit(const std::vector<Eigen::Vector3d>& rest, const std::vector<Eigen::Vector3d>& now,
                      const Eigen::Vector3d& centre) {
  Eigen::Vector3d rest_mean = Eigen::Vector3d::Zero(), now_mean = Eigen::Vector3d::Zero();
  for (std::size_t i = 0; i < rest.size(); ++i) {
    rest_mean += rest[i] / static_cast<double>(rest.size());
    now_mean += now[i] / static_cast<double>(rest.size());
  }
  Eigen::Matrix3d covariance = Eigen::Matrix3d::Zero();
  for (std::size_t i = 0; i < rest.size(); ++i) {
    covariance += (now[i] - now_mean) * (rest[i] - rest_mean).transpose();
  }
  const Eigen::JacobiSVD<Eigen::Matrix3d> svd(covariance, Eigen::ComputeFullU | Eigen::ComputeFullV);
  Eigen::Vector3d signs(1, 1, (svd.matrixU() * svd.matrixV().transpose()).determinant() < 0 ? -1 : 1);
  const Eigen::Matrix3d R = svd.matrixU() * signs.asDiagonal() * svd.matrixV().transpose();
  return {(now_mean + R * (centre - rest_mean) - centre).cast<float>(), so3_log(R).cast<float>()};
}

class StaticsSetup {
 public:
  StaticsSetup(const FingerSpec& spec, const TetMesh& tets, Element element)
      : mesh(make_quadratic(tets, element)), body(mesh, tet_materials(spec, mesh.region)), rest(body) {
    for (std::size_t p = 0; p < kPlates; ++p) marker_centre[p] = spec.plates[p].T_finger_marker.translation();
  }
  const QuadraticMesh mesh;
  const ElasticBody body;
  const ElasticState rest;
  std::array<Eigen::Vector3d, kPlates> marker_centre;
};

std::shared_ptr<const StaticsSetup> make_statics_setup(const FingerSpec& spec, const TetMesh& mesh, Element element) {
  return std::make_shared<const StaticsSetup>(spec, mesh, element);
}

/// The loads between two touches: base + s direction. While the touched point stays, base is zero and s is the force,
/// so that the states of a whole path lie on one line and can be extrapolated.
struct FingerStatics::Solver {
  struct Station {
    double s = 0;
    ElasticState state;
  };

  explicit Solver(std::shared_ptr<const StaticsSetup> shared)
      : setup(std::move(shared)), equilibrium(setup->body), trial(setup->body) {
    reset();
  }

  void reset() {
    place = FacePoint{};
    force_n = 0;
    compliance = 0;
    history.assign(1, Station{0, setup->rest});
  }

  std::vector<double> unit_load(const FacePoint& at) const {
    std::vector<double> load(setup->body.vector_size());
    for (std::size_t i = 0; i < at.node.size(); ++i) {
      const int unknown = setup->body.unknown_of_node()[static_cast<std::size_t>(at.node[i])];
      if (unknown == setup->body.free_nodes()) continue;  // carried by the base at once
      for (int k = 0; k < 3; ++k) load[static_cast<std::size_t>(3 * unknown + k)] += at.weight[i] * at.inward[k];
    }
    return load;
  }
  Eigen::Vector3d displacement(int node) const {
    const int unknown = setup->body.unknown_of_node()[static_cast<std::size_t>(node)];
    return Eigen::Map<const Eigen::Vector3d>(&history.back().state.u[static_cast<std::size_t>(3 * unknown)]);
  }
  Eigen::Vector3d displacement(const FacePoint& at) const {
    Eigen::Vector3d sum = Eigen::Vector3d::Zero();
    for (std::size_t i = 0; i < at.node.size(); ++i) sum += at.weight[i] * displacement(at.node[i]);
    return sum;
  }

  bool go(const FacePoint& target, double target_force_n);
  void extrapolate(double s);
  bool step_to(double s, const std::vector<double>& base, const std::vector<double>& direction);
  bool walk(double from, double to, const std::vector<double>& base, const std::vector<double>& direction);

  std::shared_ptr<const StaticsSetup> setup;
  Equilibrium equilibrium;
  FacePoint place;  ///< where the force of `force_n` is applied now
  double force_n = 0;
  double compliance = 0;         ///< distance of the last two states over the distance of their loads; 0: unknown
  std::vector<Station> history;  ///< the latest states of the present line of loads; the last is the present one
  ElasticState trial;
};

/// Sets `trial` to the polynomial through the history, at s.
void FingerStatics::Solver::extrapolate(double s) {
  std::size_t first = 0;
  // Far outside of what it passes through, a polynomial is worse than the last state.
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

bool FingerStatics::Solver::step_to(double s, const std::vector<double>& base, const std::vector<double>& direction) {
  std::vector<double> load(base);
  double direction_size = 0;
  for (std::size_t i = 0; i < load.size(); ++i) {
    load[i] += s * direction[i];
    direction_size += direction[i] * direction[i];
  }
  extrapolate(s);
  if (!equilibrium.solve(load, trial)) return false;
  const Station& last = history.back();
  const double new_compliance = distance(trial.u, last.state.u) / (std::abs(s - last.s) * std::sqrt(direction_size));
  if (compliance > 0 && new_compliance > kJump * compliance) return false;
  compliance = new_compliance;
  if (history.size() == kHistory) history.erase(history.begin());
  history.push_back({s, trial});
  return true;
}

bool FingerStatics::Solver::walk(double from, double to, const std::vector<double>& base,
                                 const std::vector<double>& direction) {
  double at = from, step = to - from;
  const double shortest = std::abs(step) / (1 << kHalvings);
  while (at != to) {
    // A rest shorter than half a step goes along with this one.
    const double next = std::abs(to - at) < 1.5 * std::abs(step) ? to : at + step;
    if (step_to(next, base, direction)) {
      at = next;
      step *= 2;
      continue;
    }
    step = 0.5 * (next - at);
    if (std::abs(step) < shortest) return false;
    history.erase(history.begin(), history.end() - 1);  // the path is less smooth than its extrapolation believed
  }
  return true;
}

bool FingerStatics::Solver::go(const FacePoint& target, double target_force_n) {
  const std::vector<Station> history_before = history;
  const double compliance_before = compliance;
  const bool same_place = force_n == 0 || (place.node == target.node && place.weight == target.weight);
  std::vector<double> base(setup->body.vector_size()), direction = unit_load(target);
  double from = force_n, to = target_force_n;
  if (force_n == 0) history.erase(history.begin(), history.end() - 1);
  if (!same_place) {
    base = unit_load(place);
    for (std::size_t i = 0; i < base.size(); ++i) {
      base[i] *= force_n;
      direction[i] = target_force_n * direction[i] - base[i];
    }
    from = 0;
    to = 1;
    history = {Station{0, history.back().state}};
  }
  if (!walk(from, to, base, direction)) {
    history = history_before;
    compliance = compliance_before;
    return false;
  }
  if (!same_place) {
    history = {Station{target_force_n, history.back().state}};
    // A touch that moves along the face changes the load much and the shape little. Measured by that, the next change
    // of force would look like a jump.
    compliance = std::max(compliance, compliance_before);
  }
  place = target;
  force_n = target_force_n;
  return true;
}

FingerStatics::FingerStatics(std::shared_ptr<const StaticsSetup> setup)
    : solver_(std::make_unique<Solver>(std::move(setup))) {}
FingerStatics::FingerStatics(const FingerSpec& spec, const TetMesh& mesh)
    : FingerStatics(make_statics_setup(spec, mesh)) {}
FingerStatics::~FingerStatics() = default;

void FingerStatics::reset() { solver_->reset(); }

bool FingerStatics::load(const Vec3f& point_mm, double force_n) {
  return solver_->go(face_point(solver_->setup->mesh, point_mm.x(), point_mm.y()), force_n);
}

FemState FingerStatics::state() const {
  const StaticsSetup& setup = *solver_->setup;
  FemState state;
  state.force_n = static_cast<float>(solver_->force_n);
  const Eigen::Vector3d push = solver_->displacement(solver_->place);
  state.point_mm = solver_->place.at_mm.cast<float>();
  state.contact_mm = (solver_->place.at_mm + push).cast<float>();
  if (push.norm() > kLongestPush_mm) state.outcome = Outcome::kPushedTooFar;
  for (std::size_t p = 0; p < kPlates; ++p) {
    std::vector<Eigen::Vector3d> rest, now;
    for (const int node : setup.mesh.plate_nodes[p]) {
      rest.push_back(setup.mesh.node_mm[static_cast<std::size_t>(node)]);
      now.push_back(rest.back() + solver_->displacement(node));
    }
    state.plates[p] = rigid_fit(rest, now, setup.marker_centre[p]);
  }
  return state;
}

EquilibriumCost FingerStatics::cost() const { return solver_->equilibrium.cost(); }

std::vector<double> FingerStatics::node_displacement_mm() const {
  std::vector<double> displacement = quadratic_displacement_mm();
  displacement.resize(3 * solver_->setup->mesh.corner_nodes);
  return displacement;
}

std::vector<double> FingerStatics::quadratic_displacement_mm() const {
  std::vector<double> displacement;
  for (std::size_t node = 0; node < solver_->setup->mesh.node_mm.size(); ++node) {
    const Eigen::Vector3d u = solver_->displacement(static_cast<int>(node));
    displacement.insert(displacement.end(), u.data(), u.data() + 3);
  }
  return displacement;
}

}  // namespace finsight::host
