#include "hostgen/fem/deformation.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <sstream>

namespace finsight::host {

double front_rms_mm(const FemDataset& dataset, std::size_t state, std::span<const std::int32_t> front_nodes) {
  const std::size_t numbers = 3 * dataset.mesh_nodes;
  return front_rms_mm(std::span(dataset.node_displacement_mm).subspan(numbers * state, numbers), front_nodes);
}

DeformationRise measure_deformation_rise(const Scene& scene, const FemDataset& dataset,
                                         std::span<const std::int32_t> front_nodes) {
  if (contacts_change(scene)) return {};
  std::map<std::int32_t, std::map<float, std::size_t>> paths;  // valid states by force
  for (std::size_t i = 0; i < dataset.states.size(); ++i) {
    const FemState& state = dataset.states[i];
    if (state.valid()) paths[state.path][state.force_n] = i;
  }
  DeformationRise rise{.contact_points = paths.size()};
  for (const auto& [path, states] : paths) {
    double highest_mm = 0;  // without force
    bool rises = true;
    for (const auto& [force_n, state] : states) {
      const double level_mm = front_rms_mm(dataset, state, front_nodes);
      rises = rises && (level_mm > highest_mm || force_n == 0);
      if (highest_mm - level_mm > rise.worst_drop_mm) {
        rise.worst_drop_mm = highest_mm - level_mm;
        rise.worst_point_mm = dataset.states[state].point_mm;
      }
      highest_mm = std::max(highest_mm, level_mm);
    }
    rise.not_monotone += !rises;
  }
  return rise;
}

std::string deformation_text(const DeformationRise& rise, double rated_mm) {
  if (rise.contact_points == 0) return "deformation level: not compared along the paths, whose contacts change";
  std::ostringstream text;
  text << "deformation level: rises with force at " << rise.contact_points - rise.not_monotone << " of "
       << rise.contact_points << " points";
  if (rise.worst_drop_mm > 0) {
    text << "; worst drop " << 1000 * rise.worst_drop_mm / rated_mm << " per mille, of a touch at ("
         << rise.worst_point_mm.x() << ", " << rise.worst_point_mm.y() << ") mm";
  }
  return text.str();
}

}  // namespace finsight::host
