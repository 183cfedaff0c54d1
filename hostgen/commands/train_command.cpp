// hostgen train --recordings CSV
#include <CLI/CLI.hpp>
#include <cstdio>
#include <memory>

#include "hostgen/commands/commands.h"
#include "hostgen/recordings/recording_training.h"

namespace finsight::host {

namespace {

struct TrainOptions {
  std::filesystem::path recordings, test, pack;
  RecordingTrainingPlan plan;
};

void run(const TrainOptions& options) {
  const RecordedMotion motion = read_recorded_motion(options.recordings, "");
  std::optional<RecordedMotion> test;
  if (!options.test.empty()) test = read_recorded_motion(options.test, "");
  std::optional<Model> pack;
  if (!options.pack.empty()) pack.emplace(Model::open(options.pack));
  const std::vector<RecordingScore> scores =
      train_on_recordings(motion, pack ? &*pack : nullptr, options.plan, test ? &*test : nullptr);
  std::printf("%-12s %-46s %-53s%-14s %s\n", "", "random split 7:1:2 (rows)", "split by contact point (5 folds)",
              "Adam steps", test ? options.test.c_str() : "");
  std::printf("%-12s %-22s %-23s %-22s %-22s %-8s %-14s %s\n", "network", "R2 x y z", "RMSE x y z, mm", "R2 x y z",
              "RMSE x y z, mm", "mean, mm", "", test ? "R2 x y z               RMSE x y z, mm        mean, mm" : "");
  for (const RecordingScore& score : scores) {
    const auto print = [](const AxisErrors& errors) {
      std::printf(" %6.4f %6.4f %6.4f   %5.2f %5.2f %5.2f    ", errors.r2[0], errors.r2[1], errors.r2[2],
                  errors.rmse_mm[0], errors.rmse_mm[1], errors.rmse_mm[2]);
    };
    std::printf("%-11s", score.method.c_str());
    print(score.random);
    print(score.by_point);
    std::printf("%6.2f   %6d-%-6d", score.mean_mm, score.steps[0], score.steps[1]);
    if (test) {
      print(score.other);
      std::printf("%6.2f", score.other_mean_mm);
    }
    std::printf("\n");
  }
  std::printf("%-11s %s\n", "(paper says", "0.9681 0.9415 0.9541    1.78  5.60  1.41    random split only)");
}

}  // namespace

void add_train_command(CLI::App& app) {
  const auto options = std::make_shared<TrainOptions>();
  CLI::App* command = app.add_subcommand(
      "train",
      "train touch networks on real recordings; the paper's random split and a split by contact point, side by side");
  command->add_option("--recordings", options->recordings, "CSV of recorded touches")->required();
  command->add_option("--test", options->test,
                      "CSV of other recordings: networks trained on all of --recordings are judged on them, too");
  command->add_option("--pack", options->pack, "also compare this pack's network, as it is and trained further");
  command
      ->add_option("--steps", options->plan.steps,
                   "Adam steps of each training, at most: it stops where held-out contact points gain nothing more")
      ->check(CLI::Range(100, 1000000))
      ->capture_default_str();
  command->add_option("--seed", options->plan.seed, "of splits and weights")->capture_default_str();
  command->callback([options] { run(*options); });
}

}  // namespace finsight::host
