// Area force: contact forces from plate motions (paper, section 2.3), four touches of known forces.
#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <numeric>
#include <stdexcept>

#include "hostgen/accuracy/areas.h"
#include "hostgen/fem/contact_forces.h"
#include "hostgen/learn/touch_samples.h"
#include "hostgen/util/common.h"

namespace finsight::host {

using nlohmann::json;

namespace {

struct Case {
  std::string name;
  std::vector<FaceForce> forces;
};

/// Uniform pressure on `columns` x `rows` points centred at (x, y).
std::vector<FaceForce> pressure(double x, double y, double width_mm, double height_mm, int columns, int rows,
                                double force_n) {
  const auto at = [](double middle, double size, int index, int count) {
    return static_cast<float>(middle + size * ((index + 0.5) / count - 0.5));
  };
  std::vector<FaceForce> forces;
  for (int row = 0; row < rows; ++row) {
    for (int column = 0; column < columns; ++column) {
      forces.push_back(
          {{at(x, width_mm, column, columns), at(y, height_mm, row, rows), 0}, force_n / (columns * rows)});
    }
  }
  return forces;
}

/// The points are off-centre and on no grid of the solver; "edge" is a line along the face's border.
std::vector<Case> cases(const FingerSpec& spec) {
  const auto border = [&](double y) { return spec.half_width.at(y) - spec.touch_edge_mm; };
  const double low = spec.touch_y_mm[0], reach = spec.touch_y_mm[1] - low, max_n = spec.force_n[1];
  const auto point = [&](double across, double up, double share) {
    const double y = low + up * reach;
    return FaceForce{{static_cast<float>(across * border(y)), static_cast<float>(y), 0}, share * max_n};
  };
  const FaceForce middle = point(0.05, 0.58, 0.67);
  std::vector<FaceForce> edge;
  for (int i = 0; i < 9; ++i) edge.push_back(point(0.95, 0.4 + 0.025 * i, 0.67 / 9));
  return {{"one point", {point(0.15, 0.62, 0.67)}},
          {"two points", {point(-0.46, 0.32, 0.5), point(0.48, 0.79, 0.33)}},
          {"pressure", pressure(middle.point_mm.x(), middle.point_mm.y(), 15, 15, 5, 5, middle.force_n)},
          {"edge", edge}};
}

double mean_front_mm(const TetMesh& mesh, const std::vector<double>& a, const std::vector<double>& b) {
  double sum = 0;
  for (const int node : mesh.front_nodes) {
    const Eigen::Index at = 3 * node;
    sum += (Eigen::Map<const Eigen::Vector3d>(a.data() + at) - Eigen::Map<const Eigen::Vector3d>(b.data() + at)).norm();
  }
  return sum / static_cast<double>(mesh.front_nodes.size());
}

json curve(const ContactForces& found) {
  json points = json::array();
  for (const auto& point : found.curve) points.push_back({point.seconds, point.objective});
  return points;
}

/// Every true point is within the stated uncertainty of some contact.
bool points_within(const std::vector<FaceForce>& truth, const ContactForces& found, bool or_extent) {
  return std::all_of(truth.begin(), truth.end(), [&](const FaceForce& force) {
    return std::any_of(found.contacts.begin(), found.contacts.end(), [&](const Contact& contact) {
      const double distance_mm = static_cast<double>((contact.point_mm - force.point_mm).head<2>().norm());
      return distance_mm <= contact.uncertainty.position_95_mm ||
             (or_extent && distance_mm <= contact.uncertainty.extent_95_mm);
    });
  });
}

double total_n(const std::vector<FaceForce>& forces) {
  return std::accumulate(forces.begin(), forces.end(), 0.0,
                         [](double sum, const FaceForce& force) { return sum + force.force_n; });
}

bool force_within(double true_n, const ContactForces& found) {
  double lowest_n = 0, highest_n = 0;
  for (const Contact& contact : found.contacts) {
    lowest_n += contact.uncertainty.lowest_force_n;
    highest_n += contact.uncertainty.highest_force_n;
  }
  return lowest_n <= true_n && true_n <= highest_n;
}

/// Figures of one draw of the noise; they are averaged over all draws.
json draw_figures(const Case& touch, const std::vector<double>& truth_mm, const TetMesh& mesh,
                  const ContactForces& found) {
  const double true_n = total_n(touch.forces);
  double found_n = 0, position_95_mm = 0, extent_95_mm = 0;
  for (const Contact& contact : found.contacts) {
    found_n += contact.force_n;
    position_95_mm = std::max(position_95_mm, contact.uncertainty.position_95_mm);
    extent_95_mm = std::max(extent_95_mm, contact.uncertainty.extent_95_mm);
  }
  return {{"gauss_newton_s", found.seconds},
          {"front_mm", mean_front_mm(mesh, found.node_displacement_mm, truth_mm)},
          {"force_error_n", std::abs(found_n - true_n)},
          {"contacts", static_cast<double>(found.contacts.size())},
          {"position_95_mm", position_95_mm},
          {"extent_95_mm", extent_95_mm},
          {"explained", found.explained ? 1.0 : 0.0},
          {"truth_within_position_95", points_within(touch.forces, found, false) ? 1.0 : 0.0},
          {"truth_within_uncertainty", points_within(touch.forces, found, true) ? 1.0 : 0.0},
          {"force_within_uncertainty", force_within(true_n, found) ? 1.0 : 0.0}};
}

json run_case(ContactForceSolver& solver, const FingerSpec& spec, const TetMesh& mesh, const Case& touch, bool quick,
              Random& random) {
  const int draws = quick ? 10 : 100;
  if (!solver.press(touch.forces)) throw std::runtime_error("contact forces: no equilibrium for '" + touch.name + "'");
  const std::vector<double> truth_mm = solver.node_displacement_mm();
  const PlatePoses clean = solver.plates();
  json row{{"touch", touch.name}, {"force_n", total_n(touch.forces)}, {"draws", draws}};
  double worst_front_mm = 0, worst_s = 0;
  for (int draw = 0; draw < draws; ++draw) {
    if (interrupted()) throw Interrupted();
    PoseVector noisy = pose_vector(clean);
    add_noise(spec.noise, random, noisy);
    const PlatePoses measured = seen_poses({noisy.data(), kPoseDims});
    const ContactForces found = solver.gauss_newton(measured);
    const json figures = draw_figures(touch, truth_mm, mesh, found);
    for (const auto& [key, value] : figures.items()) row[key] = row.value(key, 0.0) + value.get<double>() / draws;
    worst_front_mm = std::max(worst_front_mm, figures["front_mm"].get<double>());
    worst_s = std::max(worst_s, found.seconds);
    if (draw > 0) continue;
    row["gauss_newton_curve"] = curve(found);
    const ContactForces paper = solver.lbfgs(measured, quick ? 5 : 200);
    row["lbfgs_curve"] = curve(paper);
    row["lbfgs_s"] = paper.curve.back().seconds;
    row["lbfgs_front_mm"] = mean_front_mm(mesh, paper.node_displacement_mm, truth_mm);
    row["lbfgs_force_n"] = paper.force_n.sum();
  }
  row["worst_front_mm"] = worst_front_mm;
  row["worst_gauss_newton_s"] = worst_s;
  return row;
}

}  // namespace

json measure_force(const FingerSpec& spec, bool quick) {
  const TetMesh mesh = make_mesh(spec);
  ContactForceSolver solver(spec, mesh, 570, quick ? 12 : 30);
  Random random(1);
  json rows = json::array();
  const std::vector<Case> touches = cases(spec);
  Progress progress("contact forces", touches.size());
  for (const Case& touch : touches) {
    rows.push_back(run_case(solver, spec, mesh, touch, quick, random));
    progress.advance();
  }
  const auto mean = [&](const char* key) {
    double sum = 0;
    for (const json& row : rows) sum += row[key].get<double>();
    return sum / static_cast<double>(rows.size());
  };
  json force;
  for (const char* key :
       {"gauss_newton_s", "lbfgs_s", "lbfgs_front_mm", "truth_within_uncertainty", "force_within_uncertainty"})
    force[key] = mean(key);
  force["front_mean_mm"] = mean("front_mm");
  force["cases"] = rows;
  return {{"force", force}};
}

}  // namespace finsight::host
