// Speed against error of the shape stage.
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "firmware/shape/shape_measures.h"
#include "firmware/shape/shape_stage.h"
#include "hostgen/hard_cases/motions.h"
#include "hostgen/hard_cases/shape_distance.h"
#include "hostgen/report/areas.h"
#include "hostgen/util/common.h"
#include "hostgen/util/statistics.h"
#include "hostgen/util/stopwatch.h"

namespace finsight::host {

using nlohmann::json;

namespace {

struct Schedule {
  std::string tier;
  ShapeSettings settings;
};

std::vector<Schedule> schedules(bool quick) {
  using Tier = ShapeSettings::Tier;
  std::vector<Schedule> list = {
      {"measures", {Tier::kMeasures, 1, 0}}, {"map", {Tier::kMap, 1, 0}}, {"map+newton", {Tier::kMapAndNewton, 1, 0}}};
  for (int factorisations = 1; factorisations <= 5; ++factorisations) {
    for (int chords = 0; chords <= 2; ++chords) {
      const bool is_basic = factorisations == 1 || (chords == 0 && factorisations != 4);
      if (is_basic || !quick) list.push_back({"newton", {Tier::kNewton, factorisations, chords}});
    }
  }
  list.push_back({"converged", {Tier::kNewton, 10, 5}});
  return list;
}

/// Errors of the three measures of a shape without nodes: the largest and the mean.
ShapeDistance measures_distance(const ShapeModel& model, const FingerShape& shape, const std::vector<double>& truth) {
  const ShapeMeasures wanted = measure_shape<double>(model.rest_mm, model.front_nodes, truth);
  const float off[] = {std::abs(shape.rms_mm - wanted.rms_mm), std::abs(shape.front_rms_mm - wanted.front_rms_mm),
                       std::abs(shape.largest_mm - wanted.largest_mm)};
  return {double(std::max({off[0], off[1], off[2]})), double(off[0] + off[1] + off[2]) / 3};
}

json measure(const Model& model, const Schedule& schedule, const PlateMotionPath& motion, const Shapes& truth) {
  ShapeStage stage(model, schedule.settings);
  stage.solve(motion.frames.front());
  std::vector<double> us;
  ShapeDistance total;
  for (std::size_t k = 0; k < motion.frames.size(); ++k) {
    ProcessorStopwatch watch;
    const FingerShape& shape = stage.solve(motion.frames[k]);
    us.push_back(watch.lap_us());
    const ShapeDistance d = shape.node_mm.empty() ? measures_distance(model.shape, shape, truth[k])
                                                  : shape_distance(shape.node_mm, std::span<const double>(truth[k]));
    total.worst_mm = std::max(total.worst_mm, d.worst_mm);
    total.mean_mm += d.mean_mm / static_cast<double>(motion.frames.size());
  }
  return {{"tier", schedule.tier},
          {"mesh_tets", model.shape.tets},
          {"factorisations", takes_newton_steps(schedule.settings.tier) ? schedule.settings.factorisations : 0},
          {"chords", schedule.settings.chord_steps},
          {"scalar", "float"},
          {"motion", motion.name},
          {"us_per_frame", quantile(us, 0.5)},
          {"quartiles_us", {quantile(us, 0.25), quantile(us, 0.75)}},
          {"worst_mm", total.worst_mm},
          {"mean_mm", total.mean_mm}};
}

}  // namespace

json measure_solver(const Model& model, const json& bench, bool quick) {
  std::vector<PlateMotionPath> motions = report_motions(model.mount);
  if (quick) motions.resize(2);
  json rows = json::array();
  const std::vector<Schedule> list = schedules(quick);
  Progress progress("shape stage", motions.size() * (list.size() + 1));
  for (const PlateMotionPath& motion : motions) {
    const Shapes truth = converged_shapes(model.shape, model.mount, motion);
    progress.advance();
    for (const Schedule& schedule : list) {
      if (interrupted()) throw Interrupted();
      rows.push_back(measure(model, schedule, motion, truth));
      progress.advance();
    }
  }
  json figures = {{"mesh", {{"nodes", model.shape.nodes}, {"tets", model.shape.tets}}}};
  if (!bench.contains("mesh")) figures["mesh"]["why"] = "measured by the program bench";
  figures.update(bench, true);
  for (const json& row : bench.value("speed_error", json::array())) rows.push_back(row);
  figures["speed_error"] = rows;
  return figures;
}

}  // namespace finsight::host
