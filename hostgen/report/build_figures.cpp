#include "hostgen/report/build_figures.h"

#include <nlohmann/json.hpp>

#include "firmware/input_error.h"
#include "hostgen/util/common.h"

namespace finsight::host {

using nlohmann::json;

namespace {

json score_json(const TouchScore& score) {
  return {{"rmse_mm", score.rmse_mm},
          {"r2", score.r2},
          {"mean_mm", score.mean_mm},
          {"force_rmse_n", std::vector(score.wrench_rmse.begin(), score.wrench_rmse.begin() + 3)},
          {"moment_rmse_nm", std::vector(score.wrench_rmse.begin() + 3, score.wrench_rmse.end())},
          {"touches", score.touches}};
}

json bands_json(const std::vector<TouchBand>& bands) {
  json all = json::array();
  for (const TouchBand& band : bands) {
    all.push_back({{"from_mm", band.from_mm},
                   {"touches", band.touches},
                   {"mean_mm", band.mean_mm},
                   {"error_95_mm", band.error_95_mm},
                   {"coverage_68", band.coverage_68},
                   {"coverage_95", band.coverage_95}});
  }
  return all;
}

json bands_json(const std::vector<ForceBand>& bands) {
  json all = json::array();
  for (const ForceBand& band : bands) {
    all.push_back({{"from_n", band.from_n},
                   {"touches", band.touches},
                   {"rmse_n", band.rmse_n},
                   {"bias_n", band.bias_n},
                   {"coverage_68", band.coverage_68}});
  }
  return all;
}

json deformation_json(const DeformationRise& rise, double rated_mm) {
  return {{"contact_points", rise.contact_points},
          {"not_monotone", rise.not_monotone},
          {"worst_drop_permille", 1000 * rise.worst_drop_mm / rated_mm}};
}

}  // namespace

std::filesystem::path build_figures_path(const std::filesystem::path& pack) {
  return std::filesystem::path(pack).replace_extension(".build.json");
}

void write_build_figures(const std::filesystem::path& pack, const BuildFigures& figures) {
  const TouchTraining& touch = *figures.touch;
  const json all = {
      {"profile", figures.profile},
      {"fem",
       {{"states", figures.fem_states},
        {"valid", figures.fem_states - figures.fem_too_far - figures.fem_failed},
        {"pushed_too_far", figures.fem_too_far},
        {"failed", figures.fem_failed},
        {"deformation", deformation_json(figures.deformation, figures.rated_deformation_mm)},
        {"seconds", figures.fem_seconds > 0 ? json(figures.fem_seconds) : json()},
        {"cpu_seconds", figures.fem_seconds > 0 ? json(figures.fem_cpu_seconds) : json()},
        {"why", figures.fem_seconds > 0 ? "area fem compares with CalculiX" : "the states were read from a file"}}},
      {"touch",
       {{"random_clean", score_json(touch.random_clean)},
        {"held_out_clean", score_json(touch.held_out_clean)},
        {"held_out_noisy", score_json(touch.held_out_noisy)},
        {"held_out_from_4_mm", score_json(touch.held_out_from_4_mm)},
        {"random_noisy", score_json(touch.random_noisy)},
        {"quantisation_loss_mm", touch.quantisation.mean_mm},
        {"quantisation",
         {{"mean_mm", touch.quantisation.mean_mm},
          {"worst_mm", touch.quantisation.worst_mm},
          {"float_error_mm", touch.quantisation.float_error_mm},
          {"int8_error_mm", touch.quantisation.int8_error_mm}}},
        {"by_plate_motion", bands_json(touch.bands)},
        {"by_force", bands_json(touch.force_bands)},
        {"coverage_curve", touch.coverage_curve},
        {"coverage_68", touch.held_out_noisy.coverage_68},
        {"coverage_95", touch.held_out_noisy.coverage_95},
        {"force_rmse_n", touch.held_out_noisy.wrench_rmse[0]},
        {"training_seconds", figures.training_seconds}}}};
  write_file_atomically(build_figures_path(pack), all.dump(2) + "\n");
}

json read_build_figures(const std::filesystem::path& pack) {
  const std::filesystem::path file = build_figures_path(pack);
  const json all = json::parse(read_file(file), nullptr, false);
  if (!all.is_object() || !all.contains("fem") || !all.contains("touch")) {
    throw InputError(file.string(), "is not what hostgen build writes; build the pack again");
  }
  return all;
}

}  // namespace finsight::host
