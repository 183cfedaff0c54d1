// hostgen verify SESSION...: recordings of known weights -> is this finger as right as it says? A certificate.
#include <CLI/CLI.hpp>
#include <algorithm>
#include <cstdio>
#include <memory>
#include <nlohmann/json.hpp>

#include "firmware/input_error.h"
#include "firmware/settings/measured_fit.h"
#include "firmware/touch/touch_stage.h"
#include "hostgen/commands/commands.h"
#include "hostgen/commands/fitted_device.h"
#include "hostgen/fit/verification.h"
#include "hostgen/util/common.h"
#include "hostgen/util/output_name.h"

namespace finsight::host {

namespace {

namespace fs = std::filesystem;

struct VerifyOptions {
  FittedDevice device;
  fs::path plan, output;
  bool quick = false;
};

/// The plan's series of the recordings that were given, in the recordings' order. `quick`: one is enough.
VerificationPlan planned(VerificationPlan plan, const VerifyOptions& options) {
  std::vector<PlannedSeries> chosen;
  for (const fs::path& session : options.device.sessions) {
    const auto series = std::ranges::find(plan.series, session_name(session), &PlannedSeries::session);
    if (series == plan.series.end()) {
      throw InputError(options.plan.string(), "series", "none of session \"" + session_name(session) + "\"", "one");
    }
    chosen.push_back(*series);
  }
  if (!options.quick && chosen.size() < plan.series.size()) {
    throw InputError("command line", "sessions", std::to_string(chosen.size()),
                     std::to_string(plan.series.size()) + ", as many as the plan has series; --quick takes fewer");
  }
  plan.series = std::move(chosen);
  return plan;
}

std::string device_commands(const nlohmann::json& settings) {
  if (settings.empty()) return "";
  std::string text = "finsightctl set HOST";
  for (const auto& [name, value] : settings.items()) {
    text += " " + name + "=" + (value.is_string() ? value.get<std::string>() : value.dump());
  }
  return text + "\nfinsightctl do HOST save";
}

/// What a device with this fit says of poses, the forces' ages left aside.
PoseReader pose_reader(const Model& model, const std::optional<FitValues>& of_device) {
  const auto stage = std::make_shared<TouchStage>(model);
  const FitValues fit = of_device.value_or(FitValues{});
  if (of_device) stage->use_tolerances(fit.force_sigma, fit.touch_radius_mm, fit.noise_per_mm);
  stage->explain_less_likely(std::numeric_limits<float>::infinity());
  return [stage, fit](const PlatePoses& seen) {
    PlatePoses poses = seen;
    FingerFit(fit).change_motions(poses);
    const Touch touch = stage->locate(poses);
    return ForceAndPlace{static_cast<double>(force_scale_at(fit, touch.point_mm) * touch.force_n), touch.point_mm};
  };
}

std::string fit_in_words(const fs::path& file, const std::optional<FitValues>& fit) {
  if (!fit) return "none";
  char text[80];
  std::snprintf(text, sizeof text, " of %u, force scale %.3f", date_of(fit->fitted_on),
                static_cast<double>(fit->force_scale));
  return file.filename().string() + text;
}

int run(const VerifyOptions& options) {
  check_extension(options.output, {".html"});
  const FittedDevice& device = options.device;
  const Model model = Model::open(device.pack);
  const FingerSpec spec = device.read_spec(model);
  check_writable(options.output, {spec.file, device.pack, options.plan, device.fit, device.mount});
  const std::vector<JigHole> holes = jig_holes(spec);
  const VerificationPlan plan = planned(read_plan(options.plan, static_cast<int>(holes.size())), options);
  const std::uint16_t day = device.day();
  std::vector<std::vector<TouchReading>> readings;
  const std::optional<FitValues> fit = device.read_fit(model);
  for (SessionTouches& touches : device.touches(model, fit)) readings.push_back(std::move(touches.readings));
  const Verification verification = verify(plan, holes, readings,
                                           {.is_quick = options.quick,
                                            .has_turn_told = !device.mount.empty() || !device.fit.empty(),
                                            .read_poses = pose_reader(model, fit),
                                            .R_finger_camera = spec.T_finger_camera.linear()});
  const CertificateHead head{.date = date_of(day),
                             .pack = checksum_text(model.checksum),
                             .fit = fit_in_words(device.fit, fit),
                             .mount = device.mount.empty() ? "as drawn" : device.mount.filename().string(),
                             .is_quick = options.quick};
  const nlohmann::json figures = verification_json(plan, verification, head);
  const std::string commands = device_commands(figures["settings"]);
  fs::path json_file = options.output;
  json_file.replace_extension(".json");
  write_file_atomically(json_file, figures.dump(1) + "\n");
  write_file_atomically(options.output, certificate_html(plan, verification, head, commands));
  for (const Check& check : verification.checks) {
    const std::string value = check.value ? std::to_string(*check.value) : "not told";
    std::printf("%-42s %10s %-18s %s\n", check.name.c_str(), value.c_str(), check.unit.c_str(),
                !check.limit     ? ""
                : check.passes() ? "passed"
                                 : "FAILED");
  }
  for (const MissedWeight& weight : verification.missed) {
    std::printf("not detected: %.2f N at hole %d (%s)\n", weight.force_n, weight.hole, weight.session.c_str());
  }
  std::printf("%s\n%s: the certificate; the same as figures in %s\n", verification.passed ? "passed" : "failed",
              options.output.c_str(), json_file.c_str());
  if (!commands.empty()) std::printf("for the device's registers:\n%s\n", commands.c_str());
  return verification.passed ? 0 : 1;
}

}  // namespace

void add_verify_command(CLI::App& app) {
  const auto options = std::make_shared<VerifyOptions>();
  CLI::App* command = app.add_subcommand(
      "verify",
      "check one finger with known weights, up and down, like a load cell, and write its certificate. Exit code 1: it "
      "failed");
  command->add_option("sessions", options->device.sessions, "session folders, one per series of the plan")->required();
  command->add_option("--plan", options->plan, "TOML: finger, [[series]] (session, hole, mass_g) and [limits]")
      ->required();
  options->device.add_options(*command);
  command->add_option("--fit", options->device.fit, "what hostgen fit measured, if the device uses it");
  command->add_flag("--quick", options->quick, "some of the plan's series, or one: the daily check");
  command->add_option("-o,--output", options->output, "certificate to write (.html); its figures as .json beside it")
      ->required();
  command->callback([options] {
    if (run(*options) != 0) throw CLI::RuntimeError(1);
  });
}

}  // namespace finsight::host
