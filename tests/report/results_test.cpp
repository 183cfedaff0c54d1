#include "hostgen/report/results.h"

#include <doctest/doctest.h>

#include <fstream>
#include <nlohmann/json.hpp>

#include "firmware/input_error.h"
#include "hostgen/report/areas.h"
#include "hostgen/report/build_figures.h"
#include "tests/model/tiny_model.h"

using namespace finsight;
using namespace finsight::host;
using nlohmann::json;
using test::ScratchFolder;

namespace {

/// The keys that other programs read, from the design; a dot separates the levels of nested objects.
constexpr const char* kPromised[] = {"machine",
                                     "commit",
                                     "profile",
                                     "mesh.nodes",
                                     "mesh.tets",
                                     "mesh.min_dihedral_deg",
                                     "solver.iteration_ms",
                                     "solver.published_iteration_ms",
                                     "solver.ratio_to_published",
                                     "solver.ratio_to_eigen",
                                     "solver.ratio_to_cholmod",
                                     "solver.growth_exponent",
                                     "speed_error",
                                     "hard_cases.total",
                                     "hard_cases.non_finite",
                                     "hard_cases.inverted_unflagged",
                                     "hard_cases.worst_iterations",
                                     "fem.states",
                                     "fem.failed",
                                     "fem.seconds",
                                     "fem.calculix_max_diff_mm",
                                     "touch.random_clean.rmse_mm",
                                     "touch.random_clean.r2",
                                     "touch.held_out_clean.rmse_mm",
                                     "touch.held_out_clean.r2",
                                     "touch.held_out_noisy.rmse_mm",
                                     "touch.held_out_noisy.r2",
                                     "touch.quantisation_loss_mm",
                                     "touch.coverage_68",
                                     "touch.coverage_95",
                                     "touch.force_rmse_n",
                                     "touch.table2.lr.rmse_mm",
                                     "touch.table2.lr.r2",
                                     "touch.table2.svm.rmse_mm",
                                     "touch.table2.svm.r2",
                                     "touch.table2.knn.rmse_mm",
                                     "touch.table2.knn.r2",
                                     "touch.table2.dt.rmse_mm",
                                     "touch.table2.dt.r2",
                                     "touch.table2.mlp.rmse_mm",
                                     "touch.table2.mlp.r2",
                                     "shape.touch_point_mm.energy_clean",
                                     "shape.touch_point_mm.energy_noisy",
                                     "shape.touch_point_mm.contact_aware_clean",
                                     "shape.touch_point_mm.contact_aware_noisy",
                                     "real.random.r2",
                                     "real.by_contact_point.r2",
                                     "real.pen_distance_mm",
                                     "fingers.2.p99_ms",
                                     "fingers.2.dropped",
                                     "force.gauss_newton_s",
                                     "force.lbfgs_s",
                                     "force.front_mean_mm",
                                     "vision.lab.touch_mm_above_4",
                                     "vision.lab.touch_mm_above_7",
                                     "vision.lab.false_valid",
                                     "vision.lab.flips_per_1000",
                                     "vision.factory.touch_mm_above_4",
                                     "vision.factory.touch_mm_above_7",
                                     "vision.factory.false_valid",
                                     "vision.factory.flips_per_1000",
                                     "vision.worst.touch_mm_above_4",
                                     "vision.worst.touch_mm_above_7",
                                     "vision.worst.false_valid",
                                     "vision.worst.flips_per_1000",
                                     "vision.frame_ms_p50",
                                     "vision.frame_ms_p99",
                                     "modbus.read_us_p50",
                                     "modbus.read_us_p99",
                                     "modbus.hostile_worst_ms",
                                     "page.loop_cost_us",
                                     "page.dropped",
                                     "appliance.boot_s",
                                     "appliance.slot_mb",
                                     "appliance.security_score"};

json::json_pointer pointer(std::string name) {
  std::replace(name.begin(), name.end(), '.', '/');
  return json::json_pointer("/" + name);
}

/// Nulls without a reason beside them or beside an enclosing object.
std::string nulls_without_reason(const json& object, const std::string& prefix = "") {
  if (object.contains("why")) {
    CHECK(object["why"].get<std::string>().size() > 10);
    return "";
  }
  std::string names;
  for (const auto& [key, value] : object.items()) {
    if (value.is_null()) names += prefix + key + " ";
    if (value.is_object()) names += nulls_without_reason(value, prefix + key + ".");
  }
  return names;
}

/// Reasons where nothing is null.
std::string idle_reasons(const json& object, const std::string& prefix = "") {
  std::string names;
  if (object.contains("why") && object.dump().find("null") == std::string::npos) names += prefix + "why ";
  for (const auto& [key, value] : object.items())
    if (value.is_object()) names += idle_reasons(value, prefix + key + ".");
  return names;
}

const json kModbus = {{"modbus", {{"read_us_p50", 41.5}, {"read_us_p99", 60.0}, {"hostile_worst_ms", 1.5}}}};

}  // namespace

TEST_CASE("results: a new file has every promised key, null with a reason") {
  const ScratchFolder folder;
  const Results results(folder / "results.json");
  for (const char* name : kPromised) {
    CAPTURE(name);
    REQUIRE(results.all().contains(pointer(name)));
    const json& value = results.all()[pointer(name)];
    CHECK((value.is_null() || value == json::array()));
  }
  // Machine, commit and profile are written with the first area.
  CHECK(nulls_without_reason(results.all()) == "commit machine profile ");
  CHECK(idle_reasons(results.all()) == "");
}

TEST_CASE("results: a measured area has its figures, the command that measured them, and no reason for nulls") {
  const ScratchFolder folder;
  Results results(folder / "results.json");
  results.measured("modbus", kModbus, "quick");
  const json& all = results.all();
  CHECK(all["modbus"] == kModbus["modbus"]);
  CHECK(all["profile"] == "quick");
  CHECK(all["machine"].get<std::string>().find("Linux") != std::string::npos);
  CHECK(all["measured"]["modbus"]["profile"] == "quick");
  CHECK(all["measured"]["modbus"]["command"] == "scripts/report --quick modbus");
  CHECK(all["measured"]["modbus"]["date"].get<std::string>().starts_with("20"));
  CHECK_FALSE(all["measured"].contains("solver"));
  CHECK(nulls_without_reason(all) == "");
  results.measured("modbus", kModbus, "full");
  CHECK(all["measured"]["modbus"]["command"] == "scripts/report modbus");
}

TEST_CASE("results: figures, dates and reasons survive the next run, which measures another area") {
  const ScratchFolder folder;
  const json touch = {{"touch",
                       {{"random_clean", {{"rmse_mm", {1.0, 2.0, 3.0}}, {"r2", {0.7, 0.8, 0.9}}}},
                        {"coverage_68", 0.7},
                        {"extra", "kept"}}}};
  json before;
  {
    Results first(folder / "results.json");
    first.measured("modbus", kModbus, "full");
    first.measured("touch", touch, "full");
    first.write();
    before = first.all();
  }
  Results second(folder / "results.json");
  CHECK(second.all() == before);
  second.measured("solver", {{"speed_error", json::array({{{"tier", "map"}}})}}, "quick");
  second.write();
  const Results third(folder / "results.json");
  CHECK(third.all() == second.all());
  CHECK(third.all()["modbus"] == before["modbus"]);
  CHECK(third.all()["measured"]["modbus"] == before["measured"]["modbus"]);
  CHECK(third.all()["touch"] == before["touch"]);
  CHECK(third.all()["speed_error"].size() == 1);
  CHECK(third.all()["profile"] == "quick");
}

TEST_CASE("results: what an area leaves null keeps the area's own reason, or the table's") {
  const ScratchFolder folder;
  Results results(folder / "results.json");
  results.measured("touch", {{"touch", {{"coverage_68", 0.7}, {"why", "only the coverage was asked for"}}}}, "full");
  CHECK(results.all()["touch"]["why"] == "only the coverage was asked for");
  CHECK(results.all()["touch"]["random_clean"]["r2"].is_null());
  CHECK(results.all()["touch"]["table2"]["why"] == "area touch was not measured");
}

TEST_CASE("results: a file of an older version gets the keys that it lacks") {
  const ScratchFolder folder;
  const auto file = folder.write("results.json", R"({"modbus": {"read_us_p50": 40}, "own": 1})");
  const Results results(file);
  CHECK(results.all()["modbus"]["read_us_p50"] == 40);
  CHECK(results.all()["modbus"]["hostile_worst_ms"].is_null());
  CHECK(results.all()["own"] == 1);
  CHECK(results.all()["solver"].contains("why"));
  CHECK(nulls_without_reason(results.all()) == "commit machine profile ");
}

TEST_CASE("results: a damaged file is refused and stays as it is") {
  const ScratchFolder folder;
  for (const char* text : {"", "{\"modbus\": {", "[1, 2]", "null", "\x89PNG"}) {
    const auto file = folder.write("results.json", text);
    CHECK_THROWS_WITH_AS(Results{file}, doctest::Contains("results.json: is not JSON; delete it to start over"),
                         InputError);
    CHECK(std::filesystem::file_size(file) == std::string_view(text).size());
  }
}

TEST_CASE("results: the solver's and the build's own figures leave no null without a reason") {
  const ScratchFolder folder;
  const Model model = test::TinyModel().open();
  Results results(folder / "results.json");
  const json bench = {{"solver", {{"why", "not measured here"}}}};
  results.measured("solver", measure_solver(model, bench, true), "quick");
  const TouchTraining touch;
  write_build_figures(folder / "pack.safetensors",
                      {.profile = "quick", .fem_states = 420, .fem_failed = 1, .fem_seconds = 60, .touch = &touch});
  const json built = read_build_figures(folder / "pack.safetensors");
  results.measured("fem", {{"fem", built["fem"]}}, "quick");
  results.measured("touch", {{"touch", built["touch"]}}, "quick");

  const json& all = results.all();
  CHECK(all["mesh"]["tets"] == 72);
  CHECK(all["speed_error"].size() == 2 * 10);
  for (const json& row : all["speed_error"]) {
    for (const char* key :
         {"tier", "mesh_tets", "factorisations", "chords", "scalar", "motion", "us_per_frame", "worst_mm", "mean_mm"}) {
      CAPTURE(key);
      REQUIRE(row.contains(key));
      CHECK_FALSE(row[key].is_null());
    }
    CHECK(row["mean_mm"].get<double>() <= row["worst_mm"].get<double>());
  }
  CHECK(all["fem"]["states"] == 420);
  CHECK(all["touch"]["held_out_noisy"].contains("r2"));
  CHECK(nulls_without_reason(all) == "");
  CHECK(idle_reasons(all) == "");
}
