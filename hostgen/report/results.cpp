#include "hostgen/report/results.h"

#include <sys/utsname.h>

#include <ctime>
#include <fstream>
#include <nlohmann/json.hpp>
#include <sstream>

#include "firmware/input_error.h"
#include "hostgen/util/common.h"

namespace finsight::host {

using nlohmann::json;

namespace {

// Every key that the report promises. "why" gives the reason for nulls beside it; measuring an area removes it.
constexpr const char* kSkeleton = R"({
  "machine": null, "commit": null, "profile": null, "measured": {},
  "mesh": {"nodes": null, "tets": null, "min_dihedral_deg": null, "why": "area solver was not measured"},
  "solver": {"iteration_ms": null, "published_iteration_ms": null, "ratio_to_published": null, "ratio_to_eigen": null,
             "ratio_to_cholmod": null, "growth_exponent": null, "why": "area solver was not measured"},
  "speed_error": [],
  "hard_cases": {"total": null, "non_finite": null, "inverted_unflagged": null, "worst_iterations": null,
                 "why": "area hard was not measured"},
  "fem": {"states": null, "failed": null, "seconds": null, "calculix_max_diff_mm": null,
          "why": "area fem was not measured"},
  "touch": {"random_clean": {"rmse_mm": null, "r2": null}, "held_out_clean": {"rmse_mm": null, "r2": null},
            "held_out_noisy": {"rmse_mm": null, "r2": null}, "quantisation_loss_mm": null, "coverage_68": null,
            "coverage_95": null, "force_rmse_n": null, "table2": {
              "lr": {"rmse_mm": null, "r2": null}, "svm": {"rmse_mm": null, "r2": null},
              "knn": {"rmse_mm": null, "r2": null}, "dt": {"rmse_mm": null, "r2": null},
              "mlp": {"rmse_mm": null, "r2": null}, "why": "area touch was not measured"},
            "why": "area touch was not measured"},
  "shape": {"touch_point_mm": {"energy_clean": null, "energy_noisy": null, "contact_aware_clean": null,
            "contact_aware_noisy": null, "why": "area touch was not measured"}},
  "scene": {"name": null, "worst_coverage_error": null, "worst_lies": null, "why": "area scene was not measured"},
  "fit": {"before": {"force_relative": null}, "after": {"force_relative": null}, "why": "area fit was not measured"},
  "real": {"random": {"r2": null}, "by_contact_point": {"r2": null}, "pen_distance_mm": null,
           "why": "area real was not measured"},
  "force": {"gauss_newton_s": null, "lbfgs_s": null, "front_mean_mm": null, "why": "area force was not measured"},
  "vision": {
    "lab": {"touch_mm_above_4": null, "touch_mm_above_7": null, "false_valid": null, "flips_per_1000": null},
    "factory": {"touch_mm_above_4": null, "touch_mm_above_7": null, "false_valid": null, "flips_per_1000": null},
    "worst": {"touch_mm_above_4": null, "touch_mm_above_7": null, "false_valid": null, "flips_per_1000": null},
    "frame_ms_p50": null, "frame_ms_p99": null, "why": "area vision was not measured"},
  "modbus": {"read_us_p50": null, "read_us_p99": null, "hostile_worst_ms": null, "why": "area modbus was not measured"},
  "pictures": [],
  "page": {"loop_cost_us": null, "dropped": null, "why": "area page was not measured"},
  "fingers": {"1": {"p99_ms": null, "dropped": null}, "2": {"p99_ms": null, "dropped": null},
              "why": "area fingers was not measured"},
  "appliance": {"boot_s": null, "own_start_s": null, "slot_mb": null, "security_score": null,
    "faults": {"injected": null, "recovered": null, "worst_s": null}, "why": "area appliance was not measured"}
})";

// Adds the keys of `wanted` that `have` lacks; existing ones stay. A measured object has lost its "why" and gets it
// back only together with a new key.
void add_missing(json& have, const json& wanted) {
  bool is_new = false;
  for (const auto& [key, value] : wanted.items()) {
    if (key == "why") continue;
    if (!have.contains(key)) {
      have[key] = value;
      is_new = true;
    } else if (value.is_object() && have[key].is_object()) {
      add_missing(have[key], value);
    }
  }
  if (is_new && wanted.contains("why") && !have.contains("why")) have["why"] = wanted["why"];
}

// Objects are merged key by key, everything else is replaced; a measured object loses its "why".
void overwrite(json& have, const json& figures) {
  for (const auto& [key, value] : figures.items()) {
    if (value.is_object() && have.contains(key) && have[key].is_object()) {
      have[key].erase("why");
      overwrite(have[key], value);
    } else {
      have[key] = value;
    }
  }
}

std::string first_line_of(const char* command) {
  std::string line;
  if (FILE* pipe = popen(command, "r")) {
    char text[256];
    if (fgets(text, sizeof text, pipe)) line = text;
    pclose(pipe);
  }
  while (!line.empty() && line.back() == '\n') line.pop_back();
  return line;
}

std::string machine_name() {
  utsname name{};
  uname(&name);
  std::ifstream info("/proc/cpuinfo");
  std::string model = "unknown processor";
  for (std::string line; std::getline(info, line);) {
    if (line.starts_with("model name")) {
      model = line.substr(line.find(':') + 2);
      break;
    }
  }
  return model + ", " + name.machine + ", " + name.sysname + " " + name.release;
}

std::string today() {
  const std::time_t now = std::time(nullptr);
  char text[32];
  std::strftime(text, sizeof text, "%Y-%m-%d %H:%M UTC", std::gmtime(&now));
  return text;
}

}  // namespace

Results::Results(std::filesystem::path file) : file_(std::move(file)), json_(std::make_unique<json>(json::object())) {
  if (std::filesystem::exists(file_)) {
    *json_ = json::parse(read_file(file_), nullptr, false);
    if (!json_->is_object()) throw InputError(file_.string(), "is not JSON; delete it to start over");
  }
  add_missing(*json_, json::parse(kSkeleton));
}

Results::~Results() = default;

void Results::measured(const std::string& area, const json& figures, const std::string& profile) {
  overwrite(*json_, figures);
  (*json_)["machine"] = machine_name();
  (*json_)["commit"] = first_line_of("git describe --always --dirty 2>/dev/null");
  (*json_)["profile"] = profile;
  (*json_)["measured"][area] = {
      {"date", today()},
      {"profile", profile},
      {"commit", (*json_)["commit"]},
      {"command", "scripts/report " + std::string(profile == "quick" ? "--quick " : "") + area}};
}

const json& Results::all() const { return *json_; }

void Results::write() const { write_file_atomically(file_, json_->dump(2) + "\n"); }

}  // namespace finsight::host
