// What single troubles of pictures cost: from rendered pixels to registers, with and without a zero.
#include <cmath>
#include <nlohmann/json.hpp>
#include <numeric>

#include "firmware/calibrate/mount_estimate.h"
#include "firmware/input_error.h"
#include "firmware/loop/frame_loop.h"
#include "hostgen/accuracy/areas.h"
#include "hostgen/accuracy/scene_cases.h"
#include "hostgen/finger/grid.h"
#include "hostgen/render/scenes.h"
#include "hostgen/render/touch_path.h"
#include "hostgen/util/common.h"

namespace finsight::host {

using nlohmann::json;

namespace {

constexpr double kPicturesPerSecond = 60;
constexpr std::uint64_t kPictureSeed = 4343;
constexpr int kZeroFrames = Zeroing::kMaxFrames + 1;
constexpr float kFirmTouch_mm = 4;  // plate motion
// A touch of its own stands still for this many frames. The first and the last share their exposure with the touches
// around it; the second is for the stages that follow markers from frame to frame; the third counts.
constexpr std::size_t kHeldFrames = 4, kShownFrom = 1, kCounts = 2;
constexpr std::uint32_t kBetweenTouches = 60;  // frames that the camera leaves out, so that no plate seems to be flung

struct Picture {
  std::string name;
  ImageQuality quality;
  bool fast = false;  ///< one touch wanders over the face, three times as fast as those of recordings
  bool readout_is_told = true;
};

std::vector<Picture> pictures() {
  std::vector<Picture> made;
  for (const std::string& name : image_presets()) {
    if (name != "factory" && name != "worst") made.push_back({name, image_preset(name)});
  }
  for (const int quality : {60, 75, 90}) {
    made.push_back({"jpeg " + std::to_string(quality), image_preset("coded")});
    made.back().quality.jpeg_quality = quality;
  }
  made.push_back({"fast", image_preset("coded"), true});
  for (const double readout_s : {0.01, 0.02}) {
    for (const bool is_told : {false, true}) {
      const std::string text = "fast, rows over " + std::to_string(std::lround(1000 * readout_s)) + " ms";
      made.push_back({text + (is_told ? ", told" : ""), image_preset("coded"), true, is_told});
      made.back().quality.readout_s = readout_s;
    }
  }
  return made;
}

/// Registers of touches whose plates have moved far enough, against the truth.
class PictureScore {
 public:
  void add(const RegisterImage& image, const FemState& truth) {
    const auto word = [&](std::size_t at) { return image.words[at]; };
    ++frames_;
    const std::uint16_t status = word(address_of("status"));
    constexpr std::uint16_t kSeen[kPlates] = {kTopSeen, kMiddleSeen, kLowSeen};
    for (std::size_t p = 0; p < kPlates; ++p) seen_[p] += (status & kSeen[p]) != 0;
    if (truth.force_n == 0 || plate_motion_mm(truth.plates) < kFirmTouch_mm) return;
    ++firm_;
    if ((status & kTouchValid) == 0) return;
    const std::size_t at = address_of("touch_x");
    const auto mm = [&](std::size_t i) { return static_cast<float>(static_cast<std::int16_t>(word(i))) / 100; };
    const double error_mm = static_cast<double>((Vec3f(mm(at), mm(at + 1), mm(at + 2)) - truth.point_mm).norm());
    const double radius_mm = word(address_of("touch_uncertainty")) / 100.0;
    errors_mm_.push_back(error_mm);
    radius_sum_mm_ += radius_mm;
    inside_ += error_mm <= radius_mm;
    lies_ += error_mm > 3 * radius_mm;
  }
  json figures() const {
    const auto touches = static_cast<double>(errors_mm_.size());
    const auto firm = static_cast<double>(firm_);
    json row = {{"firm_touches", firm_}, {"published", touches / std::max(1.0, firm)}};
    for (std::size_t p = 0; p < kPlates; ++p) {
      row[std::string("recall_") + kPlateNames[p]] = static_cast<double>(seen_[p]) / static_cast<double>(frames_);
    }
    if (errors_mm_.empty()) return row;
    row["touch_mm"] = std::accumulate(errors_mm_.begin(), errors_mm_.end(), 0.0) / touches;
    row["published_radius_mm"] = radius_sum_mm_ / touches;
    row["coverage_68"] = static_cast<double>(inside_) / touches;
    row["lies"] = static_cast<double>(lies_) / firm;
    return row;
  }

 private:
  std::size_t frames_ = 0, firm_ = 0, inside_ = 0, lies_ = 0;
  std::array<std::size_t, kPlates> seen_{};
  std::vector<double> errors_mm_;
  double radius_sum_mm_ = 0;
};

Frame frame_of(const std::vector<std::uint8_t>& grey, const Lens& camera, std::uint32_t number, bool srgb) {
  return {.grey = grey.data(),
          .width_px = camera.width_px,
          .height_px = camera.height_px,
          .stride_bytes = camera.width_px,
          .exposure_ns = 1'000'000'000 + static_cast<std::int64_t>(1e9 / kPicturesPerSecond * number),
          .sequence = number,
          .coding = srgb ? Coding::kSrgb : Coding::kLinear};
}

/// As hostgen mount measures it; nothing where it refuses.
std::optional<MountModel> measured_mount(const Model& model, const Lens& camera, const RestingCornersSum& resting) {
  try {
    return corrected_mount(model.mount,
                           estimate_mount(model.mount, resting.mean(camera, "pictures"), "pictures").mount);
  } catch (const InputError&) {
    return std::nullopt;
  }
}

json measure_picture(const Model& model, const FingerSpec& spec, const Picture& picture,
                     const std::vector<FemState>& states, Progress& progress) {
  const Lens& camera = spec.cameras[1];
  const ImageQuality& quality = picture.quality;
  Renderer renderer(spec, camera, quality, kPictureSeed);
  const SceneMaker scenes(states, kPicturesPerSecond, quality.exposure_s, camera.width_px, SessionEvent::kNone);
  LoopSettings settings;
  settings.rest_is_known = false;
  settings.fit.emplace();  // the pictures are of the finger that the pack was made for
  if (picture.readout_is_told) settings.readout_ms = 1000 * quality.readout_s;
  FrameLoop zeroed(model, camera, settings), unzeroed(model, camera, settings);
  std::vector<std::uint8_t> grey;
  std::uint32_t number = 0;
  json row = {{"picture", picture.name}, {"zero_frames", json()}};
  RestingCornersSum resting;
  zeroed.zeroing().begin();
  for (int k = 0; k < kZeroFrames && zeroed.zeroing().is_running(); ++k) {
    renderer.render(std::array<PlateMotion, kPlates>{}, grey);
    zeroed.step(frame_of(grey, camera, number++, quality.srgb));
    if (const MarkerCorners* corners = zeroed.view().corners) resting.add(*corners);
  }
  const bool is_zeroed = zeroed.zeroing().take_outcome().value_or(false);
  if (is_zeroed) row["zero_frames"] = number;
  const std::optional<MountModel> mount = measured_mount(model, camera, resting);
  settings.mount = mount;
  std::optional<FrameLoop> mounted;
  if (mount) mounted.emplace(model, camera, settings);
  PictureScore with_zero, without_zero, with_mount;
  for (std::size_t k = 0; k < states.size(); ++k) {
    if (interrupted()) throw Interrupted();
    progress.advance();
    const std::size_t held = k % kHeldFrames;
    if (!picture.fast && held == 0) number += kBetweenTouches;
    if (!picture.fast && (held < kShownFrom || held > kCounts)) continue;
    render_frame(renderer, scenes, k, quality.readout_s, grey);
    const Frame frame = frame_of(grey, camera, number++, quality.srgb);
    const bool counts = picture.fast || held == kCounts;
    const auto step = [&](FrameLoop& loop, PictureScore& score) {
      const RegisterImage& image = loop.step(frame);
      if (counts) score.add(image, states[k]);
    };
    if (is_zeroed) step(zeroed, with_zero);
    step(unzeroed, without_zero);
    if (mounted) step(*mounted, with_mount);
  }
  row["zeroed"] = is_zeroed ? with_zero.figures() : json();
  row["unzeroed"] = without_zero.figures();
  row["mounted"] = mounted ? with_mount.figures() : json();
  return row;
}

}  // namespace

json measure_pictures(const Model& model, const FingerSpec& spec, bool quick) {
  const int places = quick ? 20 : 400;
  const double seconds = quick ? 1.2 : 16;
  const SceneCase any{.name = "any", .scenes = {model.scene}, .load = SceneCase::Load::kAny};
  std::vector<FemState> held;
  for (const CaseState& touch : solve_case(spec, any, places)) held.insert(held.end(), kHeldFrames, touch.state);
  const std::vector<FemState> fast =
      make_touch_path(spec, make_mesh(spec), TouchPlan(spec, seconds, kPictureSeed, TouchPlan::Path::kFast),
                      static_cast<int>(seconds * kPicturesPerSecond), kPicturesPerSecond);
  const std::vector<Picture> all = pictures();
  const auto states_of = [&](const Picture& picture) -> const std::vector<FemState>& {
    return picture.fast ? fast : held;
  };
  std::size_t frames = 0;
  for (const Picture& picture : all) frames += states_of(picture).size();
  std::vector<json> rows(all.size());
  Progress progress("pictures as cameras make them", frames);
  parallel_for(all.size(),
               [&](std::size_t i) { rows[i] = measure_picture(model, spec, all[i], states_of(all[i]), progress); });
  return {{"pictures", rows}};
}

}  // namespace finsight::host
