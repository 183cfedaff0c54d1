// Area touch: what the build measured, the paper's table 2, shapes at the touched point, errors over the face.
#include <nlohmann/json.hpp>

#include "hostgen/accuracy/areas.h"
#include "hostgen/accuracy/touch_map.h"
#include "hostgen/learn/shape_at_touch.h"
#include "hostgen/learn/touch_comparison.h"

namespace finsight::host {

using nlohmann::json;

namespace {

json errors_json(const AxisErrors& errors) { return {{"rmse_mm", errors.rmse_mm}, {"r2", errors.r2}}; }

json table2_json(const FingerSpec& spec, const FemDataset& dataset, bool quick) {
  json table;
  for (const MethodScore& method : compare_methods(spec, dataset, {.seed = 1, .steps = quick ? 1000 : 40000})) {
    json row = errors_json(method.random_clean);
    row["random_noisy"] = errors_json(method.random_noisy);
    row["held_out_clean"] = errors_json(method.held_out_clean);
    row["held_out_noisy"] = errors_json(method.held_out_noisy);
    row["train_s"] = method.train_s;
    row["predict_us"] = method.predict_us;
    table[method.name] = row;
  }
  return table;
}

json shape_json(const Model& model, const FingerSpec& spec, const FemDataset& dataset, const FemDataset& unseen,
                bool quick) {
  const ShapeAtTouch shape = measure_shape_at_touch(spec, model, dataset, quick ? 60 : 600, 1);
  json figures = {{"touch_point_mm",
                   {{"energy_clean", shape.energy_clean.touch_point_mm},
                    {"energy_noisy", shape.energy_noisy.touch_point_mm},
                    {"contact_aware_clean", shape.contact_aware_clean.touch_point_mm},
                    {"contact_aware_noisy", shape.contact_aware_noisy.touch_point_mm}}},
                  {"front_mm",
                   {{"energy_clean", shape.energy_clean.front_mm},
                    {"energy_noisy", shape.energy_noisy.front_mm},
                    {"contact_aware_clean", shape.contact_aware_clean.front_mm},
                    {"contact_aware_noisy", shape.contact_aware_noisy.front_mm}}},
                  {"states", shape.states}};
  figures["unseen_states"] = unseen.states.size();
  for (const TierAtTouch& tier : measure_tiers_at_touch(spec, model, unseen, 1)) {
    figures["tiers"].push_back({{"tier", tier.tier},
                                {"touch_point_clean_mm", tier.clean.touch_point_mm},
                                {"touch_point_noisy_mm", tier.noisy.touch_point_mm},
                                {"front_clean_mm", tier.clean.front_mm},
                                {"front_noisy_mm", tier.noisy.front_mm},
                                {"all_clean_mm", tier.clean.all_mm},
                                {"all_noisy_mm", tier.noisy.all_mm},
                                {"us_per_frame", tier.us_per_frame},
                                {"quartiles_us", tier.quartiles_us},
                                {"contact_map_share", tier.contact_map_share}});
  }
  return figures;
}

}  // namespace

json measure_touch(const json& built, const Model& model, const FingerSpec* spec, const FemDataset* dataset,
                   bool quick) {
  json figures = {{"touch", built}};
  if (!spec || !dataset) {
    figures["touch"]["table2"] = {{"why", "no --spec and --dataset were given"}};
    figures["shape"] = {{"why", "no --spec and --dataset were given"}};
    return figures;
  }
  figures["touch"]["table2"] = table2_json(*spec, *dataset, quick);
  // The pack's network and maps were trained on every point of the set, so other states test them.
  const FemDataset unseen = unseen_states(*spec, make_mesh(*spec), *dataset, quick ? 17 : 43, quick ? 4 : 8);
  figures["shape"] = shape_json(model, *spec, *dataset, unseen, quick);
  figures["touch"].update(map_touches(model, *spec, unseen, quick ? 10 : 100));
  return figures;
}

}  // namespace finsight::host
