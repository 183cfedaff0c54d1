// hostgen verify SESSION...: recordings of known weights -> is this finger as right as it says? A certificate.
#include <CLI/CLI.hpp>
#include <algorithm>
#include <cstdio>
#include <memory>
#include <nlohmann/json.hpp>

#include "firmware/input_error.h"
#include "firmware/ports/session.h"
#include "firmware/settings/measured_fit.h"
#include "firmware/settings/measured_mount.h"
#include "hostgen/commands/commands.h"
#include "hostgen/fit/session_touches.h"
#include "hostgen/fit/verification.h"
#include "hostgen/util/common.h"
#include "hostgen/util/output_name.h"

namespace finsight::host {

namespace {

namespace fs = std::filesystem;

struct Options {
  std::vector<fs::path> sessions;
  fs::path spec, pack, plan, fit, mount, output;
  std::int64_t date = 0;
  bool quick = false;
};

std::string folder_name(const fs::path& session) {
  return session.has_filename() ? session.filename().string() : session.parent_path().filename().string();
}

/// The plan's series of the recordings that were given, in the recordings' order. `quick`: one is enough.
VerificationPlan planned(VerificationPlan plan, const Options& options) {
  std::vector<PlannedSeries> chosen;
  for (const fs::path& session : options.sessions) {
    const auto series = std::ranges::find(plan.series, folder_name(session), &PlannedSeries::session);
    if (series == plan.series.end()) {
      throw InputError(options.plan.string(), "series", "none of session \"" + folder_name(session) + "\"", "one");
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

LoopSettings device_settings(const Options& options, const Model& model) {
  LoopSettings settings;
  if (!options.mount.empty()) {
    settings.mount = corrected_mount(model.mount, read_measured_mount(TomlTable::parse_file(options.mount)));
  }
  if (!options.fit.empty()) {
    settings.fit = read_measured_fit(TomlTable::parse_file(options.fit));
    check_fit(*settings.fit, model.checksum, options.fit.string());
  }
  return settings;
}

std::string device_commands(const Verification& verification, std::uint16_t day) {
  char text[256];
  std::snprintf(text, sizeof text,
                "finsightctl set HOST verified_on=%d verdict=%s force_expanded_uncertainty=%.2f "
                "touch_expanded_uncertainty=%.2f\nfinsightctl do HOST save",
                day, verification.passed ? "passed" : "failed", std::min(verification.force_expanded_n, 655.0),
                std::min(verification.touch_expanded_mm, 655.0));
  return text;
}

int run(const Options& options) {
  check_extension(options.output, {".html"});
  const FingerSpec spec = read_finger_spec(options.spec);
  const Model model = Model::open(options.pack);
  check_writable(options.output, {spec.file, options.pack, options.plan, options.fit, options.mount});
  const std::vector<JigHole> holes = jig_holes(spec);
  const VerificationPlan plan = planned(read_plan(options.plan, static_cast<int>(holes.size())), options);
  const LoopSettings settings = device_settings(options, model);
  const std::uint16_t day = options.date ? days_of(options.date) : day_today();
  if (day == 0) throw InputError("command line", "--date", std::to_string(options.date), "a day such as 20261123");
  std::vector<std::vector<TouchReading>> readings(options.sessions.size());
  Progress progress("recordings", readings.size());
  parallel_for(readings.size(), [&](std::size_t i) {
    readings[i] = session_touches(options.sessions[i], model, settings);
    progress.advance();
  });
  const Verification verification = verify(plan, holes, readings);
  const std::string commands = device_commands(verification, day);
  fs::path json_file = options.output;
  json_file.replace_extension(".json");
  write_file_atomically(json_file, verification_json(plan, verification, date_of(day)).dump(1) + "\n");
  write_file_atomically(options.output,
                        certificate_html(plan, verification, date_of(day), checksum_text(model.checksum), commands));
  for (const Check& check : verification.checks) {
    const std::string value = check.value ? std::to_string(*check.value) : "not told";
    std::printf("%-42s %10s %-18s %s\n", check.name.c_str(), value.c_str(), check.unit.c_str(),
                !check.limit     ? ""
                : check.passes() ? "passed"
                                 : "FAILED");
  }
  std::printf("%s\n%s: the certificate; the same as figures in %s\nfor the device's registers:\n%s\n",
              verification.passed ? "passed" : "failed", options.output.c_str(), json_file.c_str(), commands.c_str());
  return verification.passed ? 0 : 1;
}

}  // namespace

void add_verify_command(CLI::App& app) {
  const auto options = std::make_shared<Options>();
  CLI::App* command = app.add_subcommand(
      "verify",
      "check one finger with known weights, up and down, like a load cell, and write its certificate. Exit code 1: it "
      "failed");
  command->add_option("sessions", options->sessions, "session folders, one per series of the plan")->required();
  command->add_option("--plan", options->plan, "TOML: finger, [[series]] (session, hole, mass_g) and [limits]")
      ->required();
  command->add_option("--spec", options->spec, "finger spec (TOML) that the pack was made from")->required();
  command->add_option("--pack", options->pack, "model pack of this finger")->required();
  command->add_option("--fit", options->fit, "what hostgen fit measured, if the device uses it");
  command->add_option("--mount", options->mount, "what hostgen mount measured, if the device uses it");
  command->add_option("--date", options->date, "of the recordings, such as 20261123; today unless given");
  command->add_flag("--quick", options->quick, "some of the plan's series, or one: the daily check");
  command->add_option("-o,--output", options->output, "certificate to write (.html); its figures as .json beside it")
      ->required();
  command->callback([options] {
    if (run(*options) != 0) throw CLI::RuntimeError(1);
  });
}

}  // namespace finsight::host
