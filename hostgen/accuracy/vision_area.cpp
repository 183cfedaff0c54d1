// From rendered pixels to touches: errors and times by preset, joint plate estimate against one marker at a time.
#include <algorithm>
#include <cmath>
#include <ctime>
#include <limits>
#include <nlohmann/json.hpp>
#include <numeric>

#include "firmware/loop/frame_loop.h"
#include "firmware/touch/touch_stage.h"
#include "hostgen/accuracy/areas.h"
#include "hostgen/render/scenes.h"
#include "hostgen/render/touch_path.h"
#include "hostgen/util/common.h"
#include "hostgen/util/gnuplot.h"
#include "hostgen/util/statistics.h"

namespace finsight::host {

using nlohmann::json;

namespace {

constexpr double kFramesPerSecond = 60;
constexpr std::uint64_t kVisionSeed = 4242;  // not used by any training or tuning
// A rotation error above this counts as a flip to the square's mirror pose; noise tilts by a degree or two.
constexpr double kFlipDeg = 6;

constexpr double kPoseSmoothing_ms = 33.3;     // two frames
constexpr double kBands_mm[] = {2, 4, 7, 12};  // lower limits, of the largest plate motion; the last band is open

/// Errors of the touches of one band of plate motion.
struct Band {
  std::vector<double> errors_mm;
  double force_sq = 0, level_sq = 0;
  std::size_t inside = 0, inside_twice = 0, levels = 0;

  json figures(double from_mm) const {
    if (errors_mm.empty()) return {{"from_mm", from_mm}, {"touches", 0}};
    const auto count = static_cast<double>(errors_mm.size());
    return {{"from_mm", from_mm},
            {"touches", errors_mm.size()},
            {"touch_mm", std::accumulate(errors_mm.begin(), errors_mm.end(), 0.0) / count},
            {"touch_95_mm", quantile(errors_mm, 0.95)},
            {"force_rmse_n", std::sqrt(force_sq / count)},
            {"level_rmse_permille", levels ? json(std::sqrt(level_sq / static_cast<double>(levels))) : json()},
            {"coverage_68", static_cast<double>(inside) / count},
            {"coverage_95", static_cast<double>(inside_twice) / count}};
  }
};

/// The errors of one method from corners to touches.
class MethodScore {
 public:
  /// `level_permille`: the deformation level of this frame, NaN if the method has none.
  void add(const PlatePoses& poses, const Touch& touch, double level_permille, const FemState& truth, double rated_mm) {
    ++frames_;
    bool flipped = false;
    for (std::size_t p = 0; p < kPlates; ++p) {
      const double off_rad = static_cast<double>((poses.plates[p].rotation_rad - truth.plates[p].rotation_rad).norm());
      flipped |= poses.seen[p] && off_rad * 180 / std::numbers::pi > kFlipDeg;
    }
    const auto motion_mm = static_cast<double>(plate_motion_mm(truth.plates));
    flips_ += flipped;
    const bool touched = truth.force_n > 0;
    firm_ += touched && motion_mm >= 4;
    if (touch.quality != Quality::kFresh) return;
    ++valid_;
    const double error_mm = static_cast<double>((touch.point_mm - truth.point_mm).norm());
    const double radius_mm = static_cast<double>(touch.radius_68_mm);
    false_valid_ += !touched || error_mm > 3 * radius_mm;
    if (!touched) return;
    std::size_t b = 0;
    while (b + 1 < std::size(kBands_mm) && motion_mm >= kBands_mm[b + 1]) ++b;
    Band& band = bands_[b];
    band.errors_mm.push_back(error_mm);
    band.inside += error_mm <= radius_mm;
    band.inside_twice += error_mm <= 2 * radius_mm;
    band.force_sq += std::pow(static_cast<double>(touch.force_n - truth.force_n), 2);
    if (!std::isfinite(level_permille)) return;
    band.level_sq += std::pow(level_permille - 1000 * static_cast<double>(truth.front_rms_mm) / rated_mm, 2);
    ++band.levels;
  }
  json figures() const {
    const auto share = [](std::size_t part, std::size_t of) { return of ? json(double(part) / double(of)) : json(); };
    json bands = json::array();
    for (std::size_t b = 0; b < std::size(kBands_mm); ++b) bands.push_back(bands_[b].figures(kBands_mm[b]));
    return {{"touch_mm_2_to_4", mean_mm(0, 1)},
            {"touch_mm_above_4", mean_mm(1, std::size(kBands_mm))},
            {"touch_mm_above_7", mean_mm(2, std::size(kBands_mm))},
            {"by_plate_motion", bands},
            {"false_valid", share(false_valid_, valid_)},
            {"flips_per_1000", frames_ ? json(1000.0 * double(flips_) / double(frames_)) : json()},
            {"coverage_68", share(sum(&Band::inside), touches())},
            {"coverage_95", share(sum(&Band::inside_twice), touches())},
            {"firm_touches_published", share(touches() - bands_[0].errors_mm.size(), firm_)},
            {"frames", frames_}};
  }

 private:
  std::size_t touches() const {
    std::size_t count = 0;
    for (const Band& band : bands_) count += band.errors_mm.size();
    return count;
  }
  std::size_t sum(std::size_t Band::*part) const {
    std::size_t count = 0;
    for (const Band& band : bands_) count += band.*part;
    return count;
  }
  json mean_mm(std::size_t first, std::size_t last) const {
    double sum = 0, count = 0;
    for (std::size_t b = first; b < last; ++b) {
      sum = std::accumulate(bands_[b].errors_mm.begin(), bands_[b].errors_mm.end(), sum);
      count += static_cast<double>(bands_[b].errors_mm.size());
    }
    return count > 0 ? json(sum / count) : json();
  }
  std::array<Band, std::size(kBands_mm)> bands_;
  std::size_t frames_ = 0, flips_ = 0, valid_ = 0, false_valid_ = 0, firm_ = 0;
};

Frame frame_of(const std::vector<std::uint8_t>& grey, const Lens& camera, std::size_t number) {
  return {.grey = grey.data(),
          .width_px = camera.width_px,
          .height_px = camera.height_px,
          .stride_bytes = camera.width_px,
          .exposure_ns = steady_now_ns(),
          .sequence = static_cast<std::uint32_t>(number)};
}

/// Processor time of this thread: without the time in which other programs, or other guests of the host, had its core.
double thread_cpu_ms() {
  timespec now{};
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &now);
  return 1e3 * static_cast<double>(now.tv_sec) + 1e-6 * static_cast<double>(now.tv_nsec);
}

/// A method from corners to touches.
class Method {
 public:
  Method(const Model& model, const Lens& lens, PoseMethod method)
      : stage_(model.mount, model.prior, lens, method), touch_(model) {
    touch_.use_tolerances(0, 0, 0);  // the pictures are of the finger that the pack was made for
  }

  const PlatePoses& add(const MarkerCorners& corners, double level_permille, const FemState& truth, double rated_mm) {
    const double before_ms = thread_cpu_ms();
    const PlatePoses& poses = stage_.estimate(corners);
    estimate_us_.push_back(1e3 * (thread_cpu_ms() - before_ms));
    score_.add(poses, touch_.locate(poses), level_permille, truth, rated_mm);
    return poses;
  }
  json figures() const {
    json figures = score_.figures();
    figures["estimate_us_p50"] = quantile(estimate_us_, 0.5);
    figures["estimate_us_p99"] = quantile(estimate_us_, 0.99);
    return figures;
  }

 private:
  PoseStage stage_;
  TouchStage touch_;
  MethodScore score_;
  std::vector<double> estimate_us_;  ///< corners to plates
};

/// One preset at one image size. The frame loop gives level and times; the stages, run beside it, the rest.
json run_preset(const Model& model, const FingerSpec& spec, const Lens& lens, const std::string& preset,
                const std::vector<FemState>& states, Progress& progress) {
  constexpr double kNoLevel = std::numeric_limits<double>::quiet_NaN();
  constexpr std::size_t kLevelRegister = 11, kStatusRegister = 0;
  const ImageQuality quality = image_preset(preset);
  Renderer renderer(spec, lens, quality, kVisionSeed);
  const SceneMaker scenes(states, kFramesPerSecond, quality.exposure_s, lens.width_px, SessionEvent::kNone);
  FrameLoop loop(model, lens, {.shape = {}, .runtime = {}, .fit = FitValues{}});
  MarkerStage markers(model, lens);
  Method joint(model, lens, PoseMethod::kJoint), alone(model, lens, PoseMethod::kPublished);
  PoseFilter filter(kPoseSmoothing_ms);
  TouchStage smoothed_touch(model);
  smoothed_touch.use_tolerances(0, 0, 0);
  MethodScore smoothed_score;
  std::vector<std::uint8_t> grey;
  std::size_t seen = 0;
  std::vector<double> cpu_ms;
  for (std::size_t k = 0; k < states.size(); ++k) {
    if (interrupted()) throw Interrupted();
    renderer.render(scenes.exposure(k), grey);
    const Frame frame = frame_of(grey, lens, k);
    const double cpu_before_ms = thread_cpu_ms();
    const RegisterImage& registers = loop.step(frame);
    cpu_ms.push_back(thread_cpu_ms() - cpu_before_ms);
    const double level = registers.words[kStatusRegister] & kShapeValid ? registers.words[kLevelRegister] : kNoLevel;
    const MarkerCorners& corners = markers.find(frame);
    const PlatePoses& poses = joint.add(corners, level, states[k], spec.rated_deformation_mm);
    seen += static_cast<std::size_t>(poses.seen_count());
    PlatePoses smoothed = poses;
    filter.apply(smoothed, static_cast<std::int64_t>(1e9 * static_cast<double>(k) / kFramesPerSecond));
    smoothed_score.add(smoothed, smoothed_touch.locate(smoothed), kNoLevel, states[k], spec.rated_deformation_mm);
    alone.add(corners, kNoLevel, states[k], spec.rated_deformation_mm);
    progress.advance();
  }
  json figures = joint.figures();
  figures["one_by_one"] = alone.figures();
  figures["smoothed_33_ms"] = smoothed_score.figures();
  figures["markers_seen"] = double(seen) / double(kPlates * states.size());
  const StageTimes& times = loop.times();
  for (const auto& [stage, spent] : {std::pair{"shape", &times.shape}, {"touch", &times.touch}}) {
    figures[std::string(stage) + "_ms_p50"] = spent->percentile_us(0.5) / 1000;
    figures[std::string(stage) + "_ms_p99"] = spent->percentile_us(0.99) / 1000;
  }
  figures["frame_ms_p50"] = times.frame.percentile_us(0.5) / 1000;
  figures["frame_ms_p99"] = times.frame.percentile_us(0.99) / 1000;
  figures["frame_cpu_ms_p50"] = quantile(cpu_ms, 0.5);
  figures["frame_cpu_ms_p99"] = quantile(cpu_ms, 0.99);
  figures["poses_ms_p50"] = times.poses.percentile_us(0.5) / 1000;
  figures["poses_ms_p99"] = times.poses.percentile_us(0.99) / 1000;
  return figures;
}

/// One row per method from corners to plates.
json method_rows(const std::string& preset, const json& figures) {
  json rows = json::array();
  for (const auto& [method, of] : {std::pair{"joint estimate", figures},
                                   {"IPPE, each marker alone", figures["one_by_one"]},
                                   {"joint, smoothed over 33 ms", figures["smoothed_33_ms"]}}) {
    json row = {{"preset", preset}, {"method", method}};
    for (const char* key : {"touch_mm_2_to_4", "touch_mm_above_4", "touch_mm_above_7", "false_valid", "flips_per_1000",
                            "coverage_68", "coverage_95", "estimate_us_p50", "estimate_us_p99"}) {
      row[key] = of.value(key, json());
    }
    rows.push_back(row);
  }
  return rows;
}

/// One of the paper's four paths (its figure 7), and where the firmware sees it in images of preset lab.
struct FollowedPath {
  std::string name;
  TouchPlan::Path kind;
  std::vector<Vec3f> truth_mm, found_mm;
};

void follow(FollowedPath& path, const Model& model, const FingerSpec& spec, const TetMesh& mesh, double seconds) {
  const int frames = static_cast<int>(seconds * kFramesPerSecond);
  const Lens& camera = spec.cameras[0];
  const ImageQuality quality = image_preset("lab");
  const auto states =
      make_touch_path(spec, mesh, TouchPlan(spec, seconds, kVisionSeed, path.kind), frames, kFramesPerSecond);
  const SceneMaker scenes(states, kFramesPerSecond, quality.exposure_s, camera.width_px, SessionEvent::kNone);
  Renderer renderer(spec, camera, quality, kVisionSeed);
  MarkerStage markers(model, camera);
  PoseStage poses(model, camera);
  TouchStage touch(model);
  touch.use_tolerances(0, 0, 0);
  std::vector<std::uint8_t> grey;
  for (std::size_t k = 0; k < states.size(); ++k) {
    if (interrupted()) throw Interrupted();
    renderer.render(scenes.exposure(k), grey);
    const Touch& found = touch.locate(poses.estimate(markers.find(frame_of(grey, camera, k))));
    if (found.quality != Quality::kFresh || states[k].force_n == 0) continue;
    path.truth_mm.push_back(states[k].point_mm);
    path.found_mm.push_back(found.point_mm);
  }
}

/// Draws what was found over the truth; returns the errors, a row a path.
json draw_paths(const std::vector<FollowedPath>& paths, const std::filesystem::path& folder) {
  json rows = json::array();
  Gnuplot plot(folder / "paths.svg");
  plot.line("set term svg size 1000,1000; set multiplot layout 2,2");
  plot.line("set size ratio -1; set xlabel 'x, mm'; set ylabel 'y, mm'; set grid");
  for (const FollowedPath& path : paths) {
    std::vector<double> errors_mm;
    plot.line("$path << E");
    for (std::size_t k = 0; k < path.truth_mm.size(); ++k) {
      const Vec3f &truth = path.truth_mm[k], &found = path.found_mm[k];
      errors_mm.push_back(static_cast<double>((found - truth).norm()));
      char line[120];
      std::snprintf(line, sizeof line, "%.3f %.3f %.3f %.3f", static_cast<double>(truth.x()),
                    static_cast<double>(truth.y()), static_cast<double>(found.x()), static_cast<double>(found.y()));
      plot.line(line);
    }
    plot.line("E\nplot $path using 1:2 with lines lw 4 lc rgb '#bbbbbb' title '" + path.name +
              "', '' using 3:4 with lines lw 1 lc rgb '#c00000' title 'found'");
    const double sum = std::accumulate(errors_mm.begin(), errors_mm.end(), 0.0);
    rows.push_back({{"path", path.name},
                    {"touches", errors_mm.size()},
                    {"touch_mm", errors_mm.empty() ? json() : json(sum / static_cast<double>(errors_mm.size()))},
                    {"touch_95_mm", errors_mm.empty() ? json() : json(quantile(errors_mm, 0.95))}});
  }
  plot.line("unset multiplot");
  plot.finish();
  return rows;
}

json measure_paths(const Model& model, const FingerSpec& spec, const TetMesh& mesh, const std::filesystem::path& folder,
                   bool quick) {
  std::vector<FollowedPath> paths;
  for (const auto& [name, kind] : touch_paths()) {
    if (kind >= TouchPlan::Path::kCircle && kind <= TouchPlan::Path::kStar) paths.push_back({name, kind, {}, {}});
  }
  parallel_for(paths.size(), [&](std::size_t i) { follow(paths[i], model, spec, mesh, quick ? 2 : 8); });
  return draw_paths(paths, folder);
}

}  // namespace

json measure_vision(const Model& model, const FingerSpec& spec, const std::filesystem::path& folder, bool quick) {
  const double seconds = quick ? 1.2 : 16;
  const int frames = static_cast<int>(seconds * kFramesPerSecond);
  const TetMesh mesh = make_mesh(spec);
  const auto states = make_touch_path(spec, mesh, TouchPlan(spec, seconds, kVisionSeed), frames, kFramesPerSecond);
  const std::size_t sizes = quick ? 1 : spec.cameras.size();  // the larger one first
  json vision;
  const std::vector<std::string> presets = {"lab", "factory", "worst"};
  Progress progress("rendered images to touches", presets.size() * sizes * states.size());
  for (const std::string& preset : presets) {
    for (std::size_t size = 0; size < sizes; ++size) {
      const Lens& camera = spec.cameras[size];
      const json figures = run_preset(model, spec, camera, preset, states, progress);
      if (size == 0) {
        vision[preset] = figures;
        for (json& row : method_rows(preset, figures)) vision["methods"].push_back(std::move(row));
      }
      vision[preset][std::to_string(camera.width_px) + "x" + std::to_string(camera.height_px)] = figures;
    }
  }
  for (const char* key : {"frame_ms_p50", "frame_ms_p99", "frame_cpu_ms_p50", "frame_cpu_ms_p99", "poses_ms_p50"})
    vision[key] = vision["lab"][key];
  vision["image"] = std::to_string(spec.cameras[0].width_px) + "x" + std::to_string(spec.cameras[0].height_px);
  vision["paths"] = measure_paths(model, spec, mesh, folder, quick);
  vision["corners"] = measure_corners(spec, quick);
  return {{"vision", vision}};
}

}  // namespace finsight::host
