// hostgen build: finger spec -> mesh -> finite-element states -> learned parts -> model pack.
#include <unistd.h>

#include <CLI/CLI.hpp>
#include <cmath>
#include <cstdio>
#include <ctime>
#include <memory>

#include "firmware/input_error.h"
#include "firmware/loop/self_test.h"
#include "hostgen/commands/commands.h"
#include "hostgen/commands/mesh_report.h"
#include "hostgen/fem/gravity_response.h"
#include "hostgen/fem/shape_model.h"
#include "hostgen/finger/mount.h"
#include "hostgen/learn/scene_touches.h"
#include "hostgen/learn/shape_map_training.h"
#include "hostgen/learn/shape_truth.h"
#include "hostgen/learn/touch_training.h"
#include "hostgen/pack/model_pack.h"
#include "hostgen/probe/probe.h"
#include "hostgen/report/build_figures.h"
#include "hostgen/util/common.h"
#include "hostgen/util/stopwatch.h"

namespace finsight::host {

namespace {

struct BuildOptions {
  std::filesystem::path spec, output, dataset, save_dataset;
  std::string profile = "quick", scene, size = "default";
  int points = 0, forces = 0, training_steps = 0;  // 0: the profile's
  std::uint64_t seed = 1;
};

struct Profile {
  DatasetPlan dataset;
  int training_steps;
};
const std::map<std::string, Profile> kProfiles = {
    {"quick", {{.points = 60, .forces = 7}, 6000}},
    {"full", {{.points = 570, .forces = 21}, 120000}},
};

/// The response to gravity is fitted to three states at each of its places: enough for its 36 features.
constexpr int kFewestGravityPlaces = 30;

// A state with contacts of its own takes longer than one that follows the path, and teaches more.
constexpr int kPointsOfChangingContacts = 2100, kForcesOfChangingContacts = 11;

Profile chosen_profile(const FingerSpec& spec, const BuildOptions& options) {
  Profile profile = kProfiles.at(options.profile);
  const Scene& scene = spec.scene(options.scene.empty() ? spec.trained_scene : options.scene);
  profile.dataset.scene = scene.name;
  if (options.profile == "full" && contacts_change(scene)) {
    profile.dataset.points = kPointsOfChangingContacts;
    profile.dataset.forces = kForcesOfChangingContacts;
  }
  if (options.points) profile.dataset.points = options.points;
  if (options.forces) profile.dataset.forces = options.forces;
  if (options.training_steps) profile.training_steps = options.training_steps;
  return profile;
}

/// Everything that a pack views, while it is being made.
struct Parts {
  FingerSpec spec;
  std::string scene;
  ShapeModelData shape;
  PlatePriorData prior;
  TouchTraining touch;
  ShapeMapData map, contact_map;
};

PackViews views_of(const Parts& parts, const BuildOptions& options) {
  PackViews views;
  views.finger_name = parts.spec.name;
  views.scene = parts.scene;
  views.spec_sha256 = parts.spec.sha256;
  views.hostgen_version = FINSIGHT_VERSION;
  views.rated_deformation_mm = static_cast<float>(parts.spec.rated_deformation_mm);
  views.notes = {{"profile", options.profile}, {"seed", std::to_string(options.seed)}};
  views.mount = mount_of(parts.spec);
  views.prior = parts.prior.view();
  views.shape = parts.shape.view();
  views.shape_map = parts.map.view();
  views.contact_map = parts.contact_map.view();
  views.touch = parts.touch.model.view();
  return views;
}

/// Plate numbers of the self-test: rest, and states spread over the dataset.
std::vector<float> self_test_poses(const FemDataset& dataset) {
  constexpr std::size_t kCases = 4;
  std::vector<float> numbers(kPoseDims, 0.0F);
  std::vector<const FemState*> valid;
  for (const FemState& state : dataset.states) {
    if (state.valid()) valid.push_back(&state);
  }
  for (std::size_t c = 1; c < kCases; ++c) {
    for (const PlateMotion& plate : valid[(valid.size() - 1) * c / (kCases - 1)]->plates) {
      numbers.insert(numbers.end(), {plate.displacement_mm.x(), plate.displacement_mm.y(), plate.displacement_mm.z(),
                                     plate.rotation_rad.x(), plate.rotation_rad.y(), plate.rotation_rad.z()});
    }
  }
  return numbers;
}

/// Writes the pack with the answers that this build of the firmware gives, then opens it again and checks them.
void write_with_self_test(const Parts& parts, const BuildOptions& options, const std::vector<float>& poses) {
  PackViews views = views_of(parts, options);
  const std::size_t cases = poses.size() / kPoseDims;
  std::vector<float> shape_mm(cases * views.shape.rest_mm.size()), contact_shape_mm(shape_mm.size()), touch(cases * 7);
  std::vector<std::uint16_t> registers(cases * kMeasurementRegisters), contact_registers(registers.size());
  views.self_test = {static_cast<int>(cases), poses, shape_mm, touch, registers, contact_shape_mm, contact_registers};

  // The answers need an opened model, so a draft without them is written first.
  const std::filesystem::path draft = options.output.string() + ".draft" + std::to_string(getpid());
  write_model_pack(draft, views);
  {
    const Model model = Model::open(draft);
    std::filesystem::remove(draft);  // stays mapped
    const auto keep = [](const auto& answer, std::size_t c, auto& all) {
      std::copy(answer.begin(), answer.end(), all.begin() + static_cast<std::ptrdiff_t>(c * answer.size()));
    };
    for (std::size_t c = 0; c < cases; ++c) {
      const auto numbers = std::span(poses).subspan(kPoseDims * c, kPoseDims);
      const SelfTestAnswer answer = answer_self_test(model, numbers);
      keep(answer.shape_mm, c, shape_mm);
      keep(answer.touch, c, touch);
      keep(answer.registers.words, c, registers);
      const SelfTestAnswer by_contact = answer_self_test(model, numbers, {.tier = ShapeSettings::Tier::kContact});
      keep(by_contact.shape_mm, c, contact_shape_mm);
      keep(by_contact.registers.words, c, contact_registers);
    }
  }
  write_model_pack(options.output, views);
  const Model model = Model::open(options.output);
  for (const auto tier : {ShapeSettings::Tier::kNewton, ShapeSettings::Tier::kContact}) check_self_test(model, tier);
}

/// The finite-element states: from a file, or computed. An interrupted run keeps finished paths beside the pack and
/// continues from them.
FemDataset truth(const FingerSpec& spec, const TetMesh& mesh, const Profile& profile, const BuildOptions& options) {
  if (!options.dataset.empty()) {
    FemDataset dataset = read_dataset(options.dataset);
    check_complete(dataset, spec, mesh, options.dataset);
    return dataset;
  }
  return make_dataset(spec, mesh, profile.dataset, {}, options.output.string() + ".paths");
}

/// The shape map from what the firmware's solver converges to, the contact map from the states as they are.
void fit_maps(Parts& parts, const FemDataset& dataset, std::uint64_t seed) {
  {
    const ShapeSamples samples =
        converged_shapes(parts.spec, parts.shape.view(), mount_of(parts.spec), dataset, 1, seed);
    parts.map = fit_shape_map(samples.poses, samples.displacement_mm);
    std::printf("shape map: rank %d from %td shapes (%d did not converge)\n", parts.map.rank, samples.poses.rows(),
                samples.failed);
  }
  parts.contact_map = fit_contact_map(parts.spec, dataset, seed + 1);
  std::printf("contact map: rank %d\n", parts.contact_map.rank);
  const std::size_t states = dataset.count(Outcome::kEquilibrium);
  if (states < ShapeMapModel::kFeatures) {
    std::printf(
        "warning: contact map: %zu states are fewer than the %d features of its regression; tier \"contact\" may be "
        "worse than \"map\" where no state is near. More --points help\n",
        states, ShapeMapModel::kFeatures);
  }
}

/// What the work will be like, before it begins; throws InputError if nothing can come of it.
void look_before(const FingerSpec& spec, const TetMesh& mesh, const Profile& profile) {
  const Probe probe = probe_finger(spec, mesh);
  const auto paths = static_cast<double>(path_count(profile.dataset));
  const auto cores = static_cast<double>(usable_cores());
  // Of pushing a place from rest to its highest force, with the states nearby: measured on srm.
  constexpr double kChangeOfContacts = 0.22;
  const bool contacts_differ = contacts_change(spec.scene(profile.dataset.scene));
  const double path_cpu_s = probe.place_cpu_s * (contacts_differ ? kChangeOfContacts * profile.dataset.forces : 1);
  std::printf(
      "%sprobed in %.0f s: %.0f load paths of %.1f s, about %.0f min on %.0f cores, and %.0f MB for each core's "
      "factor\n",
      probe_text(probe).c_str(), probe.seconds, paths, path_cpu_s, std::ceil(paths * path_cpu_s / cores / 60), cores,
      probe.factor_mb);
  std::fflush(stdout);
  check_worth_building(spec, probe);
}

/// The pack's reader would refuse the range after all the work.
void check_moves_plates(const FingerSpec& spec, const FemDataset& dataset) {
  double most_mm = 0;
  for (const FemState& state : dataset.states) {
    if (state.valid()) most_mm = std::max(most_mm, plate_motion_mm(state));
  }
  if (most_mm >= spec.threshold_mm) return;
  throw InputError(spec.file.string(), "touch.threshold_mm",
                   std::to_string(spec.threshold_mm) + " mm, but no state moves a plate further than " +
                       std::to_string(most_mm) + " mm",
                   "a threshold that touches exceed (`hostgen probe` proposes one)");
}

/// How an acceleration moves the plates.
void take_gravity(const Parts& parts, const TetMesh& mesh, int places, TouchTrainingPlan& plan) {
  const GravityResponse response =
      gravity_response(std::make_shared<const PushedFinger>(parts.spec, mesh), parts.spec.scene(parts.scene), places);
  const auto take = [](const auto& numbers, std::vector<float>& into) {
    std::copy_n(numbers.data(), into.size(), into.begin());
  };
  take(response.at_rest.cast<float>().eval(), plan.per_g);
  take(response.change.cast<float>().eval(), plan.per_g_change);
}

void run(const BuildOptions& options) {
  Parts parts;
  parts.spec = read_finger_spec(options.spec);
  const Profile profile = chosen_profile(parts.spec, options);
  std::vector<std::filesystem::path> used = {parts.spec.file, parts.spec.surface_file, options.dataset};
  check_writable(options.output, used);
  used.push_back(options.output);
  if (!options.save_dataset.empty()) check_writable(options.save_dataset, used);
  const TetMesh mesh = make_mesh(parts.spec, kMeshSizes.at(options.size));
  print_mesh(mesh);
  if (options.dataset.empty()) look_before(parts.spec, mesh, profile);
  parts.shape = make_shape_model(mesh);

  BuildFigures figures{.profile = options.profile};
  Stopwatch fem_time;
  const std::clock_t fem_clock = std::clock();
  const FemDataset dataset = truth(parts.spec, mesh, profile, options);
  if (options.dataset.empty()) {
    figures.fem_seconds = fem_time.lap_s();
    figures.fem_cpu_seconds = static_cast<double>(std::clock() - fem_clock) / CLOCKS_PER_SEC;
  }
  figures.fem_states = dataset.states.size();
  figures.fem_too_far = dataset.count(Outcome::kPushedTooFar);
  const std::size_t not_converged = dataset.count(Outcome::kNotConverged);
  figures.fem_failed = dataset.count(Outcome::kNoEquilibrium) + not_converged;
  std::printf("finite elements: %zu states, %zu of them pushed too far, %zu buckled, %zu not converged, %.1f s\n",
              figures.fem_states, figures.fem_too_far, figures.fem_failed - not_converged, not_converged,
              figures.fem_seconds);
  figures.deformation =
      measure_deformation_rise(parts.spec.scene(dataset.plan.scene), dataset, parts.shape.front_nodes);
  figures.rated_deformation_mm = parts.spec.rated_deformation_mm;
  std::printf("%s\n", deformation_text(figures.deformation, figures.rated_deformation_mm).c_str());

  check_moves_plates(parts.spec, dataset);
  if (!options.save_dataset.empty()) write_dataset(options.save_dataset, dataset);
  parts.scene = dataset.plan.scene;

  Stopwatch training_time;
  parts.prior = fit_plate_prior(dataset, parts.spec.noise);
  TouchTrainingPlan plan{.seed = options.seed, .steps = profile.training_steps};
  take_gravity(parts, mesh, std::max(kFewestGravityPlaces, profile.dataset.points / 6), plan);
  parts.touch = train_touch(parts.spec, dataset, parts.prior, plan, touches_of_scene(parts.spec, dataset.plan));
  figures.training_seconds = training_time.lap_s();
  figures.touch = &parts.touch;
  std::printf("%s", parts.touch.log.c_str());

  fit_maps(parts, dataset, options.seed);
  write_with_self_test(parts, options, self_test_poses(dataset));
  write_build_figures(options.output, figures);
  std::filesystem::remove_all(options.output.string() + ".paths");
  std::printf("%s: %ju bytes, self-test passed\n", options.output.c_str(),
              static_cast<std::uintmax_t>(std::filesystem::file_size(options.output)));
}

}  // namespace

void add_build_command(CLI::App& app) {
  const auto options = std::make_shared<BuildOptions>();
  CLI::App* command = app.add_subcommand("build", "make the model pack of a finger");
  command->add_option("spec", options->spec, "finger spec (TOML)")->required();
  command->add_option("-o,--output", options->output, "model pack to write (.safetensors)")->required();
  command
      ->add_option(
          "--profile", options->profile,
          "quick: a few minutes; full: over an hour and a half on two cores, the paper's 570 points with 21 forces "
          "each, or 2,100 with 11 where every force has contacts of its own (scenes with more than frictionless "
          "points)")
      ->check(CLI::IsMember({"quick", "full"}))
      ->capture_default_str();
  command->add_option("--scene", options->scene,
                      "which contacts to train for: probe, grasp, two or another of the spec's "
                      "scenes (default: the one that the spec's touch.scene names)");
  command->add_option("--dataset", options->dataset,
                      "states made earlier by hostgen dataset or merge, instead of the profile's; without it they are "
                      "computed, and an interrupted run continues from OUTPUT.paths");
  command->add_option("--save-dataset", options->save_dataset, "keep the states in this file (.safetensors)");
  command
      ->add_option("--size", options->size,
                   "of the mesh: coarse, default, medium, fine or finest; a dataset needs the size it was made with")
      ->check(CLI::IsMember(kMeshSizes))
      ->capture_default_str();
  command->add_option("--points", options->points, "touched points, instead of the profile's")
      ->check(CLI::Range(10, 5000));
  command->add_option("--forces", options->forces, "forces per point, instead of the profile's")
      ->check(CLI::Range(2, 200));
  command->add_option("--training-steps", options->training_steps, "Adam steps, instead of the profile's")
      ->check(CLI::Range(100, 1000000));
  command->add_option("--seed", options->seed, "of training and noise; same spec and seed, same bytes")
      ->capture_default_str();
  command->callback([options] { run(*options); });
}

}  // namespace finsight::host
