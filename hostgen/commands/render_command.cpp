// hostgen render: finger spec -> a touch that moves over the face -> what the camera would see of it -> session.
#include <unistd.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <map>
#include <memory>
#include <system_error>

#include "firmware/input_error.h"
#include "firmware/ports/session.h"
#include "hostgen/commands/commands.h"
#include "hostgen/commands/options.h"
#include "hostgen/finger/grid.h"
#include "hostgen/finger/jig_holes.h"
#include "hostgen/render/renderer.h"
#include "hostgen/render/scenes.h"
#include "hostgen/render/touch_path.h"
#include "hostgen/render/virtual_finger.h"
#include "hostgen/util/common.h"
#include "hostgen/util/gravity.h"

namespace finsight::host {

namespace {

namespace fs = std::filesystem;

constexpr int kFramesPerSecond = 60;

struct RenderOptions {
  fs::path spec, output;
  std::string size = "640x480", preset = "lab", motion = "wander", event = "none";
  std::optional<std::string> coding;  ///< instead of the preset's
  double seconds = 12, readout_ms = 0;
  std::uint64_t seed = 1;
  std::optional<std::uint64_t> finger;  ///< number of a virtual one
  int hole = 0;                         ///< of the jig; 0: no weight
  std::vector<double> mass_g;
};

template <class Value>
std::vector<std::string> names_of(const std::vector<std::pair<std::string, Value>>& named) {
  std::vector<std::string> names;
  for (const auto& [name, value] : named) names.push_back(name);
  return names;
}

/// `name` is one of them: CLI11 has checked it.
template <class Value>
Value value_of(const std::vector<std::pair<std::string, Value>>& named, const std::string& name) {
  return std::find_if(named.begin(), named.end(), [&](const auto& pair) { return pair.first == name; })->second;
}

const std::map<std::string, std::size_t> kCameraOfSize = {{"1280x720", 0}, {"640x480", 1}};

/// A folder that gets its name only when it is complete. What has the name before is replaced if it is a session too.
class PendingFolder {
 public:
  explicit PendingFolder(fs::path target)
      : target_(target.has_filename() ? std::move(target) : target.parent_path()),
        temporary_(target_.string() + ".part" + std::to_string(getpid())) {
    if (fs::exists(target_) && !fs::exists(target_ / kSessionInfo)) {
      throw InputError(target_.string(), "exists and is not a session, so it is not replaced");
    }
    fs::create_directories(temporary_);
  }
  ~PendingFolder() {
    std::error_code ignored;  // after finish() there is nothing left to remove
    fs::remove_all(temporary_, ignored);
  }
  PendingFolder(const PendingFolder&) = delete;
  PendingFolder& operator=(const PendingFolder&) = delete;

  const fs::path& path() const { return temporary_; }
  void finish() {
    const fs::path before = target_.string() + ".old" + std::to_string(getpid());
    if (fs::exists(target_)) fs::rename(target_, before);
    fs::rename(temporary_, target_);
    fs::remove_all(before);
  }

 private:
  fs::path target_, temporary_;
};

bool is_srgb(const RenderOptions& options) {
  return options.coding ? *options.coding == "srgb" : image_preset(options.preset).srgb;
}

std::string finger_text(const RenderOptions& options) {
  std::string text;
  if (options.finger) text += ", virtual finger " + std::to_string(*options.finger);
  if (options.hole) text += ", weight at hole " + std::to_string(options.hole);
  return text;
}

SessionInfo session_info(const FingerSpec& spec, const Lens& lens, const RenderOptions& options) {
  SessionInfo info{.lens = lens,
                   .frames_per_second = kFramesPerSecond,
                   .marker_dictionary = "DICT_4X4_50",
                   .marker_id = {},
                   .marker_size_mm = spec.marker_size_mm,
                   .description = "rendered: finger " + spec.name + ", preset " + options.preset + ", motion " +
                                  options.motion + ", event " + options.event + ", seed " +
                                  std::to_string(options.seed) + finger_text(options),
                   .gravity_g = Vec3f(0, 0, 0),  // what is rendered has no weight
                   .coding = is_srgb(options) ? Coding::kSrgb : Coding::kLinear,
                   .readout_ms = options.readout_ms,
                   .from_rest = !options.finger && !image_preset(options.preset).is_misprinted()};
  for (int plate = 0; plate < kPlates; ++plate) info.marker_id[plate] = spec.plates[plate].marker_id;
  return info;
}

/// One row per frame: the truth that the images were rendered from. While force_n is 0 the point is where the next
/// touch will be.
std::string truth_csv(const std::vector<FemState>& states) {
  std::string text = "frame,time_s";
  const auto add_names = [&](const std::string& name, const std::string& unit) {
    for (const char axis : {'x', 'y', 'z'}) text += "," + name + "_" + axis + "_" + unit;
  };
  const auto add = [&](double value) {
    char buffer[32];
    std::snprintf(buffer, sizeof buffer, ",%.6f", value);
    text += buffer;
  };
  const auto add_vector = [&](const Vec3f& vector) {
    for (const float value : vector) add(value);
  };
  add_names("point", "mm");
  add_names("contact", "mm");
  text += ",force_n";
  for (const std::string plate : kPlateNames) {
    add_names(plate + "_displacement", "mm");
    add_names(plate + "_rotation", "rad");
  }
  for (std::size_t frame = 0; frame < states.size(); ++frame) {
    const FemState& state = states[frame];
    text += "\n" + std::to_string(frame);
    add(static_cast<double>(frame) / kFramesPerSecond);
    add_vector(state.point_mm);
    add_vector(state.contact_mm);
    add(state.force_n);
    for (const PlateMotion& plate : state.plates) {
      add_vector(plate.displacement_mm);
      add_vector(plate.rotation_rad);
    }
  }
  return text + "\n";
}

void write_images(const fs::path& file, const FingerSpec& spec, const Lens& camera, const std::vector<FemState>& states,
                  const RenderOptions& options) {
  ImageQuality quality = image_preset(options.preset);
  quality.srgb = is_srgb(options);
  quality.readout_s = options.readout_ms / 1000;
  Renderer renderer(spec, camera, quality, 2 * options.seed + 1);
  const SceneMaker scenes(states, kFramesPerSecond, quality.exposure_s, camera.width_px,
                          value_of(session_events(), options.event));
  Y4mWriter writer(file, camera.width_px, camera.height_px, kFramesPerSecond);
  Progress progress("images", states.size());
  std::vector<std::uint8_t> grey;
  for (std::size_t frame = 0; frame < states.size(); ++frame) {
    if (interrupted()) throw Interrupted();
    if (!scenes.is_frozen(frame)) render_frame(renderer, scenes, frame, quality.readout_s, grey);
    writer.write(grey.data());
    progress.advance();
  }
  writer.finish();
}

void print_summary(const std::vector<FemState>& states, const RenderOptions& options) {
  std::ptrdiff_t touched = 0;
  float force_n = 0, motion_mm = 0;
  for (const FemState& state : states) {
    touched += state.force_n > 0;
    force_n = std::max(force_n, state.force_n);
    motion_mm = std::max(motion_mm, plate_motion_mm(state.plates));
  }
  std::printf("%s: %zu frames of %s at %d per second, touched in %td, up to %.1f N and %.1f mm of plate motion\n",
              options.output.c_str(), states.size(), options.size.c_str(), kFramesPerSecond, touched, force_n,
              motion_mm);
}

// Two independent streams of random numbers from one seed: the touch does not depend on the image's size.
std::vector<TouchLoad> wandering(const FingerSpec& spec, const RenderOptions& options, int frames) {
  const TouchPlan plan(spec, options.seconds, 2 * options.seed, value_of(touch_paths(), options.motion));
  return planned_loads(plan, frames, kFramesPerSecond);
}

std::vector<TouchLoad> hung_up(const FingerSpec& spec, const RenderOptions& options, int frames) {
  const std::vector<JigHole> holes = jig_holes(spec);
  const auto hole = std::ranges::find(holes, options.hole, &JigHole::number);
  if (hole == holes.end()) {
    throw InputError("command line", "--hole", std::to_string(options.hole), "1 to " + std::to_string(holes.size()));
  }
  std::vector<double> force_n;
  for (const double mass_g : options.mass_g) force_n.push_back(weight_n(mass_g));
  return weight_loads(hole->contact_mm.cast<float>(), force_n, frames, kFramesPerSecond);
}

/// A touch that wanders is weaker where the finger bears no more; a weight is what it is.
void check_bears_weights(const std::vector<TouchLoad>& loads, const std::vector<FemState>& states, int hole) {
  constexpr double kNearly = 0.98;
  double hung_n = 0, borne_n = 0;
  for (const TouchLoad& load : loads) hung_n = std::max(hung_n, load.force_n);
  for (const FemState& state : states) borne_n = std::max(borne_n, static_cast<double>(state.force_n));
  if (borne_n >= kNearly * hung_n) return;
  throw InputError("command line", "--mass-g", std::to_string(std::lround(hung_n / weight_n(1))),
                   "at most " + std::to_string(static_cast<int>(borne_n / weight_n(1))) +
                       ": the finger does not bear more at hole " + std::to_string(hole));
}

void run(const RenderOptions& options) {
  if (!std::isfinite(options.seconds)) throw InputError("command line", "--seconds", "not a number", "0.1 ... 600");
  const FingerSpec spec = read_finger_spec(options.spec);
  const std::size_t size = kCameraOfSize.at(options.size);
  // Whoever mounts a virtual finger takes its lens for the spec's.
  const Lens& camera = spec.cameras[size];
  std::optional<VirtualFinger> finger;
  if (options.finger) finger = draw_finger(spec, *options.finger);
  const FingerSpec& real = finger ? finger->spec : spec;
  PendingFolder folder(options.output);
  const int frames = std::max(1, static_cast<int>(std::lround(options.seconds * kFramesPerSecond)));
  std::vector<TouchLoad> loads = options.hole ? hung_up(spec, options, frames) : wandering(spec, options, frames);
  if (finger) remember(*finger, kFramesPerSecond, loads);
  // A virtual finger is computed on a mesh that no pack is made from.
  const TetMesh mesh = make_mesh(real, finger ? MeshSize::kMedium : MeshSize::kDefault);
  std::vector<FemState> states = make_touch_path(real, mesh, loads);
  if (options.hole) check_bears_weights(loads, states, options.hole);
  if (value_of(session_events(), options.event) == SessionEvent::kShaken) shake(spec, kFramesPerSecond, states);
  write_images(folder.path() / kSessionFrames, real, real.cameras[size], states, options);
  write_file_atomically(folder.path() / kSessionTruth, truth_csv(states));
  write_file_atomically(folder.path() / kSessionInfo, session_info_toml(session_info(spec, camera, options)));
  folder.finish();
  print_summary(states, options);
}

}  // namespace

void add_render_command(CLI::App& app) {
  const auto options = std::make_shared<RenderOptions>();
  CLI::App* command = app.add_subcommand("render", "make a session: what the camera would see of a wandering touch");
  command->add_option("spec", options->spec, "finger spec (TOML)")->required();
  command->add_option("-o,--output", options->output, "session folder to write")->required();
  command->add_option("--size", options->size, "1280x720 (55 MB per second) or 640x480 (18 MB per second)")
      ->check(CLI::IsMember(kCameraOfSize))
      ->capture_default_str();
  command
      ->add_option(
          "--coding", options->coding,
          "how grey levels stand for light, whatever the preset; by default linear with lab, factory and worst, "
          "srgb with the others")
      ->check(CLI::IsMember({"linear", "srgb"}));
  command->add_option("--preset", options->preset, "quality of the images")
      ->check(CLI::IsMember(image_presets()))
      ->capture_default_str();
  command
      ->add_option("--readout-ms", options->readout_ms,
                   "rows are exposed one after the other, the last one this much later than the first")
      ->check(between(0.0, 50.0))
      ->capture_default_str();
  command->add_option("--motion", options->motion, "how the touch moves over the face")
      ->check(CLI::IsMember(names_of(touch_paths())))
      ->capture_default_str();
  command->add_option("--event", options->event, "what happens in the middle third")
      ->check(CLI::IsMember(names_of(session_events())))
      ->capture_default_str();
  command->add_option("--finger-seed", options->finger,
                      "number of a virtual finger: its walls, stiffness, markers, camera, lens and creep are its own");
  CLI::Option* hole =
      command->add_option("--hole", options->hole, "a weight hangs at this hole of the jig (hostgen jig)")
          ->check(CLI::Range(1, 9));
  command
      ->add_option("--mass-g", options->mass_g,
                   "of that weight, from the third second on; several, with commas, follow each other")
      ->delimiter(',')
      ->check(between(1.0, 2000.0))
      ->needs(hole);
  hole->needs("--mass-g")->excludes("--motion");
  command->add_option("--seconds", options->seconds, "length")->check(between(0.1, 600.0))->capture_default_str();
  command->add_option("--seed", options->seed, "of the touch's path and of the noise")->capture_default_str();
  command->callback([options] { run(*options); });
}

}  // namespace finsight::host
