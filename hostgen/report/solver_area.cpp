// Speed against error of the shape stage.
#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <nlohmann/json.hpp>
#include <numbers>
#include <string>
#include <vector>

#include "firmware/shape/shape_stage.h"
#include "hostgen/common.h"
#include "hostgen/report/areas.h"
#include "hostgen/report/gnuplot.h"
#include "hostgen/report/motions.h"

namespace finsight::host {

using nlohmann::json;

namespace {

struct Schedule {
  std::string tier;
  ShapeSettings settings;
};

// Far more steps than it takes: further ones change nothing above rounding.
constexpr ShapeSettings kConverged{ShapeSettings::Tier::kNewton, 10, 5};

std::vector<Schedule> schedules() {
  using Tier = ShapeSettings::Tier;
  std::vector<Schedule> list = {{"map", {Tier::kMap, 1, 0}}, {"map+newton", {Tier::kMapAndNewton, 1, 0}}};
  for (const int factorisations : {1, 2, 3, 5}) list.push_back({"newton", {Tier::kNewton, factorisations, 0}});
  for (const int chords : {1, 2}) list.push_back({"newton", {Tier::kNewton, 1, chords}});
  list.push_back({"converged", kConverged});
  return list;
}

using Shapes = std::vector<std::vector<float>>;

Shapes converged(const Model& model, const PlateMotionPath& motion) {
  ShapeStage stage(model, kConverged);
  Shapes shapes;
  for (const PlatePoses& poses : motion.frames) {
    if (interrupted()) throw Interrupted();
    stage.solve(poses);
    const FingerShape& shape = stage.solve(poses);
    shapes.emplace_back(shape.node_mm.begin(), shape.node_mm.end());
  }
  return shapes;
}

struct Distance {
  double worst_mm = 0, mean_mm = 0;
};

/// Over all nodes of one frame.
Distance distance(std::span<const float> a, std::span<const float> b) {
  Distance d;
  for (std::size_t i = 0; i < a.size(); i += 3) {
    const double dx = a[i] - b[i], dy = a[i + 1] - b[i + 1], dz = a[i + 2] - b[i + 2];
    const double mm = std::sqrt(dx * dx + dy * dy + dz * dz);
    d.worst_mm = std::max(d.worst_mm, mm);
    d.mean_mm += mm / static_cast<double>(a.size() / 3);
  }
  return d;
}

json measure(const Model& model, const Schedule& schedule, const PlateMotionPath& motion, const Shapes& truth) {
  ShapeStage stage(model, schedule.settings);
  stage.solve(motion.frames.front());
  std::vector<double> us;
  Distance total;
  for (std::size_t k = 0; k < motion.frames.size(); ++k) {
    const auto start = std::chrono::steady_clock::now();
    const FingerShape& shape = stage.solve(motion.frames[k]);
    us.push_back(std::chrono::duration<double, std::micro>(std::chrono::steady_clock::now() - start).count());
    const Distance d = distance(shape.node_mm, truth[k]);
    total.worst_mm = std::max(total.worst_mm, d.worst_mm);
    total.mean_mm += d.mean_mm / static_cast<double>(motion.frames.size());
  }
  std::nth_element(us.begin(), us.begin() + static_cast<std::ptrdiff_t>(us.size() / 2), us.end());
  return {{"tier", schedule.tier},
          {"mesh_tets", model.shape.tets},
          {"factorisations", schedule.settings.tier == ShapeSettings::Tier::kMap ? 0 : schedule.settings.factorisations},
          {"chords", schedule.settings.chord_steps},
          {"scalar", "float"},
          {"motion", motion.name},
          {"us_per_frame", us[us.size() / 2]},
          {"worst_mm", total.worst_mm},
          {"mean_mm", total.mean_mm}};
}

void plot(const json& rows, const std::filesystem::path& folder) {
  Gnuplot plot(folder / "speed_error.svg");
  plot.line("set logscale xy; set xlabel 'microseconds per frame'; set ylabel 'worst distance to the converged shape, mm'");
  plot.line("set key outside right; set format y '10^{%T}'; set grid");
  std::string command = "plot";
  std::string data;
  std::vector<std::string> motions;
  for (const json& row : rows) {
    const std::string motion = row["motion"];
    if (motions.empty() || motions.back() != motion) motions.push_back(motion);
  }
  for (const std::string& motion : motions) {
    command += (command == "plot" ? " " : ", ") + ("'-' using 1:2:3 with labels point pt 7 offset 1,0.6 left title '" + motion + "'");
    for (const json& row : rows) {
      if (row["motion"] != motion) continue;
      char line[128];
      std::snprintf(line, sizeof line, "%g %g \"%s %d+%d\"\n", row["us_per_frame"].get<double>(),
                    row["worst_mm"].get<double>(), row["tier"].get<std::string>().c_str(),
                    row["factorisations"].get<int>(), row["chords"].get<int>());
      data += line;
    }
    data += "e\n";
  }
  plot.line(command);
  plot.line(data);
  plot.finish();
}

}  // namespace

json measure_solver(const Model& model, const std::filesystem::path& folder, bool quick) {
  constexpr double kDegree = std::numbers::pi / 180;
  std::vector<PlateMotionPath> motions = {
      bend_and_return(model.mount, "bend 10 mm", 10, 0, 0, 1),
      bend_and_return(model.mount, "bend 30 mm + twist 45 deg", 30, 0, 45 * kDegree, 1)};
  if (!quick) {
    motions.push_back(bend_and_return(model.mount, "the same, 4 times as fast", 30, 0, 45 * kDegree, 4));
    motions.push_back(bend_and_return(model.mount, "bend 20 + sideways 10 mm - twist 30 deg", 20, 10, -30 * kDegree, 1));
  }
  json rows = json::array();
  double one_ms = 0, two_ms = 0;
  Progress progress("shape solver", motions.size() * (schedules().size() + 1));
  for (const PlateMotionPath& motion : motions) {
    const Shapes truth = converged(model, motion);
    progress.advance();
    for (const Schedule& schedule : schedules()) {
      if (interrupted()) throw Interrupted();
      rows.push_back(measure(model, schedule, motion, truth));
      progress.advance();
      if (schedule.tier == "newton" && schedule.settings.chord_steps == 0 && motion.name == motions[0].name) {
        if (schedule.settings.factorisations == 1) one_ms = rows.back()["us_per_frame"].get<double>() / 1000;
        if (schedule.settings.factorisations == 2) two_ms = rows.back()["us_per_frame"].get<double>() / 1000;
      }
    }
  }
  plot(rows, folder);
  return {{"speed_error", rows},
          {"mesh",
           {{"nodes", model.shape.nodes},
            {"tets", model.shape.tets},
            {"why", "the smallest dihedral angle is printed by hostgen build and not kept beside the pack"}}},
          {"solver", {{"iteration_ms", two_ms - one_ms}, {"why", "the published method is not built yet"}}}};
}

}  // namespace finsight::host
