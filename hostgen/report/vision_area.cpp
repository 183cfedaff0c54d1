// From rendered pixels to touches: errors and times by preset, joint plate estimate against one marker at a time.
#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>

#include "firmware/frame_loop.h"
#include "firmware/touch/touch_stage.h"
#include "hostgen/common.h"
#include "hostgen/render/scenes.h"
#include "hostgen/render/touch_path.h"
#include "hostgen/report/areas.h"

namespace finsight::host {

using nlohmann::json;

namespace {

constexpr double kFramesPerSecond = 60;
constexpr std::uint64_t kSeed = 4242;  // of no session that anything was trained or tuned on
// A rotation that is further off than this is taken for the other pose of its square: noise tilts by a degree or two.
constexpr double kFlipDeg = 6;

/// The errors of one way from corners to touches.
class Score {
 public:
  void add(const PlatePoses& poses, const Touch& touch, const FemState& truth) {
    ++frames_;
    bool flipped = false;
    double motion_mm = 0;
    for (std::size_t p = 0; p < kPlates; ++p) {
      const double off_rad = static_cast<double>((poses.plates[p].rotation_rad - truth.plates[p].rotation_rad).norm());
      flipped |= poses.seen[p] && off_rad * 180 / std::numbers::pi > kFlipDeg;
      motion_mm = std::max(motion_mm, static_cast<double>(truth.plates[p].displacement_mm.norm()));
    }
    flips_ += flipped;
    if (truth.force_n > 0 && motion_mm >= 4) ++firm_;
    if (touch.quality != Quality::kFresh) return;
    ++valid_;
    const double error_mm = static_cast<double>((touch.point_mm - truth.point_mm).norm());
    const double radius_mm = static_cast<double>(touch.radius_68_mm);
    false_valid_ += truth.force_n == 0 || error_mm > 3 * radius_mm;
    if (truth.force_n == 0) return;
    if (motion_mm >= 4) above_4_.push_back(error_mm);
    if (motion_mm >= 7) above_7_.push_back(error_mm);
    if (motion_mm < 4) below_4_.push_back(error_mm);
    inside_ += error_mm <= radius_mm;
    inside_twice_ += error_mm <= 2 * radius_mm;
    force_sq_ += std::pow(static_cast<double>(touch.force_n - truth.force_n), 2);
    ++touches_;
  }
  json figures() const {
    const auto share = [](std::size_t part, std::size_t of) { return of ? json(double(part) / double(of)) : json(); };
    return {{"touch_mm_2_to_4", mean(below_4_)},
            {"touch_mm_above_4", mean(above_4_)},
            {"touch_mm_above_7", mean(above_7_)},
            {"false_valid", share(false_valid_, valid_)},
            {"flips_per_1000", frames_ ? json(1000.0 * double(flips_) / double(frames_)) : json()},
            {"coverage_68", share(inside_, touches_)},
            {"coverage_95", share(inside_twice_, touches_)},
            {"force_rmse_n", touches_ ? json(std::sqrt(force_sq_ / double(touches_))) : json()},
            {"firm_touches_published", share(above_4_.size(), firm_)},
            {"frames", frames_}};
  }

 private:
  static json mean(const std::vector<double>& values) {
    double sum = 0;
    for (const double value : values) sum += value;
    return values.empty() ? json() : json(sum / double(values.size()));
  }
  std::vector<double> below_4_, above_4_, above_7_;
  std::size_t frames_ = 0, flips_ = 0, valid_ = 0, false_valid_ = 0, inside_ = 0, inside_twice_ = 0, touches_ = 0,
              firm_ = 0;
  double force_sq_ = 0;
};

/// One preset at one picture size. The loop gives the times, the stages beside it what registers do not hold.
json run_preset(const Model& model, const FingerSpec& spec, const CameraIntrinsics& camera, const std::string& preset,
                const std::vector<FemState>& states, Progress& progress) {
  const PictureQuality quality = picture_preset(preset);
  const CameraModel lens = camera_model(camera);
  Renderer renderer(spec, camera, quality, kSeed);
  const SceneMaker scenes(states, kFramesPerSecond, quality.exposure_s, SessionEvent::kNone);
  FrameLoop loop(model, lens, LoopSettings{});
  MarkerStage markers(model, lens);
  PoseStage joint(model.mount, model.prior, lens), alone(model.mount, model.prior, lens, PoseMethod::kPublished);
  TouchStage touch(model);
  Score joint_score, alone_score;
  std::vector<std::uint8_t> grey;
  std::size_t seen = 0;
  for (std::size_t k = 0; k < states.size(); ++k) {
    if (interrupted()) throw Interrupted();
    renderer.render(scenes.exposure(k), grey);
    const Frame frame{.grey = grey.data(),
                      .width_px = camera.width_px,
                      .height_px = camera.height_px,
                      .stride_bytes = camera.width_px,
                      .poses = nullptr,
                      .exposure_ns = steady_now_ns(),
                      .sequence = static_cast<std::uint32_t>(k)};
    loop.step(frame);
    const MarkerCorners& corners = markers.find(frame);
    const PlatePoses& poses = joint.estimate(corners);
    seen += static_cast<std::size_t>(poses.seen_count());
    joint_score.add(poses, touch.locate(poses), states[k]);
    const PlatePoses& single = alone.estimate(corners);
    alone_score.add(single, touch.locate(single), states[k]);
    progress.advance();
  }
  json figures = joint_score.figures();
  figures["one_by_one"] = alone_score.figures();
  figures["markers_seen"] = double(seen) / double(kPlates * states.size());
  const StageTimes& times = loop.times();
  figures["frame_ms_p50"] = times.frame.percentile_us(0.5) / 1000;
  figures["frame_ms_p99"] = times.frame.percentile_us(0.99) / 1000;
  figures["poses_ms_p50"] = times.poses.percentile_us(0.5) / 1000;
  figures["poses_ms_p99"] = times.poses.percentile_us(0.99) / 1000;
  return figures;
}

}  // namespace

json measure_vision(const Model& model, const FingerSpec& spec, bool quick) {
  const double seconds = quick ? 4 : 24;
  const int frames = static_cast<int>(seconds * kFramesPerSecond);
  const auto states = make_touch_path(spec, make_mesh(spec), TouchPlan(spec, seconds, kSeed), frames, kFramesPerSecond);
  const std::size_t sizes = quick ? 1 : spec.cameras.size();  // the larger one first
  json vision;
  const auto presets = picture_presets();
  Progress progress("rendered pictures to touches", presets.size() * sizes * states.size());
  for (const std::string& preset : presets) {
    for (std::size_t size = 0; size < sizes; ++size) {
      const CameraIntrinsics& camera = spec.cameras[size];
      const json figures = run_preset(model, spec, camera, preset, states, progress);
      if (size == 0) vision[preset] = figures;
      vision[preset][std::to_string(camera.width_px) + "x" + std::to_string(camera.height_px)] = figures;
    }
  }
  for (const char* key : {"frame_ms_p50", "frame_ms_p99", "poses_ms_p50"}) vision[key] = vision["lab"][key];
  vision["picture"] = std::to_string(spec.cameras[0].width_px) + "x" + std::to_string(spec.cameras[0].height_px);
  vision["corners"] = measure_corners(spec, quick);
  return {{"vision", vision}};
}

}  // namespace finsight::host
