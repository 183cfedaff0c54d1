#include "hostgen/report/build_figures.h"

#include <nlohmann/json.hpp>

#include "firmware/input_error.h"
#include "hostgen/common.h"

namespace finsight::host {

using nlohmann::json;

namespace {

json score_json(const TouchScore& score) {
  return {{"rmse_mm", score.rmse_mm}, {"r2", score.r2}, {"mean_mm", score.mean_mm},
          {"mean_above_4_mm", score.mean_above_4_mm}, {"touches", score.touches}};
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
        {"seconds", figures.fem_seconds},
        {"cpu_seconds", figures.fem_cpu_seconds}}},
      {"touch",
       {{"random_clean", score_json(touch.random_clean)},
        {"held_out_clean", score_json(touch.held_out_clean)},
        {"held_out_noisy", score_json(touch.held_out_noisy)},
        {"quantisation_loss_mm", touch.quantisation_loss_mm},
        {"coverage_68", touch.held_out_noisy.coverage_68},
        {"coverage_95", touch.held_out_noisy.coverage_95},
        {"force_rmse_n", touch.held_out_noisy.force_rmse_n},
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
