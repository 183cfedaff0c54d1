// The table of hard cases, the search for new ones, and the shapes of the worst.
#include <algorithm>
#include <cstdio>
#include <nlohmann/json.hpp>

#include "hostgen/hard_cases/hard_search.h"
#include "hostgen/report/areas.h"
#include "hostgen/util/common.h"

namespace finsight::host {

using nlohmann::json;

namespace {

constexpr int kQuickMotions = 50, kMotions = 10'000, kQuickWalk = 200, kWalk = 100'000;
constexpr std::uint64_t kSearchSeed = 22;
constexpr std::size_t kPictures = 10;

json row_of(const HardCaseResult& result) {
  // A limit that does not judge is infinite, which is null in JSON.
  return {{"family", result.family},
          {"name", result.name},
          {"frames", result.frames},
          {"flagged", result.flagged},
          {"iterations", result.max_steps},
          {"worst_mm", result.worst_mm},
          {"allowed_mm", result.allowed_mm},
          {"end_mm", result.end_mm},
          {"allowed_end_mm", result.allowed_end_mm},
          {"good", result.good()}};
}

/// The worst of each family.
json families_of(const std::vector<HardCaseResult>& results) {
  json rows = json::array();
  for (const HardCaseResult& result : results) {
    if (rows.empty() || rows.back()["family"] != result.family) {
      rows.push_back({{"family", result.family},
                      {"cases", 0},
                      {"frames", 0},
                      {"worst_mm", 0.0},
                      {"end_mm", 0.0},
                      {"iterations", 0},
                      {"flagged", 0},
                      {"bad", 0}});
    }
    json& row = rows.back();
    const auto add = [&](const char* key, int count) { row[key] = row[key].get<int>() + count; };
    const auto keep_larger = [&](const char* key, auto value) {
      row[key] = std::max(row[key].get<decltype(value)>(), value);
    };
    add("cases", 1);
    add("frames", result.frames);
    add("flagged", result.flagged);
    add("bad", !result.good());
    keep_larger("worst_mm", result.worst_mm);
    keep_larger("end_mm", result.end_mm);
    keep_larger("iterations", result.max_steps);
  }
  return rows;
}

json row_of(const FoundCase& found) {
  json row = row_of(found.result);
  row["settling_frames"] = found.settling_frames;
  return row;
}

json search_json(const HardSearch& search) {
  json worst = json::array();
  for (const FoundCase& found : search.worst) worst.push_back(row_of(found));
  return {{"motions", search.motions},
          {"seed", kSearchSeed},
          {"bad", search.bad},
          {"worst", worst},
          {"small", json::array({row_of(search.small)})}};
}

/// The mesh at rest and the shapes that were furthest off, to be drawn; hundredths of a millimetre do.
void write_states(const ShapeModel& shape, std::vector<const HardCaseResult*> results,
                  const std::filesystem::path& file) {
  std::erase_if(results, [](const HardCaseResult* result) { return result->worst_node_mm.empty(); });
  std::stable_sort(results.begin(), results.end(),
                   [](const auto* a, const auto* b) { return a->worst_mm > b->worst_mm; });
  results.resize(std::min(results.size(), kPictures));
  const auto rounded = [](std::span<const float> node_mm) {
    json numbers = json::array();
    for (const float coordinate : node_mm) numbers.push_back(std::lround(100 * coordinate));
    return numbers;
  };
  json states = json::array();
  for (const HardCaseResult* result : results) {
    states.push_back(
        {{"name", result->name}, {"worst_mm", result->worst_mm}, {"node_mm_100", rounded(result->worst_node_mm)}});
  }
  const json all = {{"tet_nodes", std::vector<int>(shape.tet_nodes.begin(), shape.tet_nodes.end())},
                    {"rest_mm_100", rounded(shape.rest_mm)},
                    {"states", states}};
  write_file_atomically(file, all.dump() + "\n");
}

}  // namespace

json measure_hard_cases(const Model& model, const std::filesystem::path& folder, bool quick) {
  const ShapeParts parts{model.shape, model.shape_map, model.mount};
  const std::vector<HardCaseResult> results = run_hard_cases(parts, quick ? kQuickWalk : kWalk);
  const HardSearch search = HardCaseSearch(parts).search(quick ? kQuickMotions : kMotions, kSearchSeed);
  json cases = json::array();
  int non_finite = 0, inverted_unflagged = 0, worst_iterations = 0, bad = 0;
  std::vector<const HardCaseResult*> drawn;
  for (const HardCaseResult& result : results) {
    non_finite += result.non_finite;
    inverted_unflagged += result.inverted_unflagged;
    worst_iterations = std::max(worst_iterations, result.max_steps);
    bad += !result.good();
    cases.push_back(row_of(result));
    drawn.push_back(&result);
  }
  write_states(model.shape, drawn, folder / "hard_states.json");
  return {{"hard_cases",
           {{"total", cases.size()},
            {"bad", bad},
            {"non_finite", non_finite},
            {"inverted_unflagged", inverted_unflagged},
            {"worst_iterations", worst_iterations},
            {"families", families_of(results)},
            {"cases", cases},
            {"search", search_json(search)}}}};
}

}  // namespace finsight::host
