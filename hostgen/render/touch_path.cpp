#include "hostgen/render/touch_path.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <stdexcept>

#include "hostgen/fem/deformation.h"
#include "hostgen/fem/statics.h"
#include "hostgen/finger/plate_geometry.h"
#include "hostgen/util/common.h"
#include "hostgen/util/random.h"

namespace finsight::host {

namespace {

constexpr double kFullCircle = 2 * std::numbers::pi;
constexpr double kPressSeconds = 4;      // about; presses divide the whole time evenly
constexpr double kPauseShare = 1.0 / 8;  // of a press, half before and half after
constexpr double kRampShare = 1.0 / 5;
constexpr double kLightestTouch_n = 0.01;  // a lighter one moves nothing that a camera can see, and is lost in rounding
constexpr double kTipForceShare = 0.5;  // of the spec's largest force: the higher up, the further the finger gives way
constexpr double kRounds = 2, kPathRadius = 0.8, kPathForceShare = 0.6, kPathRamp_s = 0.5;  // of the paper's paths
constexpr int kKeyStep = 4;         // frames from one solved state to the next: 67 ms, while forces ramp over 0.8 s
constexpr std::size_t kChunk = 12;  // solved states in a row by one worker; not the number of cores, so that it
                                    // does not change the result

// A touch that would push its point further is weakened: beyond 20 mm there are no training states, and near the edges
// the largest force would push by more than that.
constexpr double kLongestPushMm = 15;
constexpr int kWeakenings = 20;

/// 0 at 0, 1 at 1, smooth at both.
double smooth_step(double x) { return 0.5 - 0.5 * std::cos(std::numbers::pi * std::clamp(x, 0.0, 1.0)); }

/// All numbers of a state that change from frame to frame.
using StateNumbers = Eigen::Matrix<float, 8 + kPoseDims, 1>;

StateNumbers numbers_of(const FemState& state) {
  StateNumbers numbers;
  numbers.head<3>() = state.point_mm;
  numbers.segment<3>(3) = state.contact_mm;
  numbers[6] = state.force_n;
  for (int plate = 0; plate < kPlates; ++plate) {
    numbers.segment<3>(7 + 6 * plate) = state.plates[plate].displacement_mm;
    numbers.segment<3>(10 + 6 * plate) = state.plates[plate].rotation_rad;
  }
  numbers[7 + kPoseDims] = state.front_rms_mm;
  return numbers;
}

FemState state_of(const StateNumbers& numbers) {
  FemState state;
  state.point_mm = numbers.head<3>();
  state.contact_mm = numbers.segment<3>(3);
  state.force_n = std::max(numbers[6], 0.0f);  // a spline may undershoot zero a little
  for (int plate = 0; plate < kPlates; ++plate) {
    state.plates[plate] = {numbers.segment<3>(7 + 6 * plate), numbers.segment<3>(10 + 6 * plate)};
  }
  state.front_rms_mm = std::max(numbers[7 + kPoseDims], 0.0f);
  return state;
}

FemState untouched(const Vec3f& point_mm) {
  FemState state;
  state.point_mm = state.contact_mm = point_mm;
  return state;
}

/// The equilibrium under the planned force, or under a weaker one that the finger can bear.
FemState touched(FingerStatics& finger, const TetMesh& mesh, const Vec3f& point_mm, double force_n) {
  for (int attempt = 0; attempt < kWeakenings; ++attempt) {
    const bool found = finger.load(point_mm, force_n);
    const FemState state = finger.state();
    const double push_mm = (state.contact_mm - state.point_mm).norm();
    if (found && push_mm <= 1.01 * kLongestPushMm) break;
    // In proportion to the overshoot, so that the force changes smoothly from frame to frame.
    force_n *= found ? kLongestPushMm / push_mm : 0.9;
  }
  // Without an equilibrium nearby the finger stays in the last one, whose own force is reported.
  FemState state = finger.state();
  state.front_rms_mm = static_cast<float>(front_rms_mm<double>(finger.node_displacement_mm(), mesh.front_nodes));
  return state;
}

}  // namespace

const std::vector<std::pair<std::string, TouchPlan::Path>>& touch_paths() {
  using Path = TouchPlan::Path;
  static const std::vector<std::pair<std::string, Path>> paths = {
      {"wander", Path::kWander}, {"fast", Path::kFast}, {"circle", Path::kCircle}, {"square", Path::kSquare},
      {"eight", Path::kEight},   {"star", Path::kStar}, {"rest", Path::kRest}};
  return paths;
}

TouchPlan::TouchPlan(const FingerSpec& spec, double seconds, std::uint64_t seed, Path path)
    : spec_(spec), path_(path), seconds_(seconds) {
  Random random(seed);
  const double pace = path == Path::kFast ? 3 : 1;
  const long presses = std::max(1L, std::lround(pace * seconds / kPressSeconds));
  press_s_ = seconds / static_cast<double>(presses);
  for (long press = 0; press < presses; ++press) {
    press_largest_n_.push_back(spec.force_n[1] * (press == 0 ? 1.0 : random.uniform(0.6, 1.0)));
  }
  const auto waves = [&](double slow_hz, double fast_hz) {
    const auto wave = [&](double share, double hz) {
      return Wave{share, kFullCircle * pace * hz * random.uniform(0.8, 1.2), random.uniform(0, kFullCircle)};
    };
    return Waves{wave(0.7, slow_hz), wave(0.3, fast_hz)};
  };
  across_ = waves(0.19, 0.43);
  along_ = waves(0.11, 0.29);
  strength_ = waves(0.5, 1.1);
}

double TouchPlan::wander(const Waves& waves, double time_s) {
  double sum = 0;
  for (const Wave& wave : waves) sum += wave.share * std::sin(wave.cycle_rad_per_s * time_s + wave.phase_rad);
  return sum;
}

// -1 ... 1 across and along: the corners of a polygon (a star is one that leaves corners out) one after the other,
// evenly from each to the next; a circle; a figure eight along the finger.
Eigen::Vector2d TouchPlan::on_path(double time_s) const {
  const double turn = kRounds * std::clamp(time_s / seconds_, 0.0, 1.0), angle = kFullCircle * turn;
  if (path_ == Path::kCircle) return {std::sin(angle), std::cos(angle)};
  if (path_ == Path::kEight) return {std::sin(2 * angle), std::cos(angle)};
  const int corners = path_ == Path::kSquare ? 4 : 5, step = path_ == Path::kSquare ? 1 : 2;
  const auto corner = [&](double index) -> Eigen::Vector2d {
    const double at = kFullCircle * (step * index + (path_ == Path::kSquare ? 0.5 : 0.0)) / corners;
    return {std::sin(at), std::cos(at)};
  };
  const double side = turn * corners, from = std::floor(side);
  return corner(from) + (side - from) * (corner(from + 1) - corner(from));
}

Vec3f TouchPlan::point_mm(double time_s) const {
  const auto [lowest_mm, highest_mm] = spec_.touch_y_mm;
  if (path_ != Path::kWander && path_ != Path::kFast && path_ != Path::kRest) {
    const double middle_mm = (lowest_mm + highest_mm) / 2;
    const double radius_mm = kPathRadius * (spec_.half_width.at(middle_mm) - spec_.touch_edge_mm);
    const Eigen::Vector2d at_mm = radius_mm * on_path(time_s) + Eigen::Vector2d(0, middle_mm);
    return front_point_mm(spec_, at_mm.x(), at_mm.y()).cast<float>();
  }
  const double y_mm = lowest_mm + (highest_mm - lowest_mm) * 0.5 * (1 + wander(along_, time_s));
  const double x_mm = (spec_.half_width.at(y_mm) - spec_.touch_edge_mm) * wander(across_, time_s);
  return front_point_mm(spec_, x_mm, y_mm).cast<float>();
}

double TouchPlan::force_n(double time_s) const {
  if (path_ == Path::kRest) return 0;
  if (path_ != Path::kWander && path_ != Path::kFast) {
    return kPathForceShare * spec_.force_n[1] * smooth_step(time_s / kPathRamp_s) *
           smooth_step((seconds_ - time_s) / kPathRamp_s);
  }
  const double press = std::floor(time_s / press_s_);
  if (press < 0 || press >= static_cast<double>(press_largest_n_.size())) return 0;
  const double share = time_s / press_s_ - press;
  const double from_rest = smooth_step((share - kPauseShare / 2) / kRampShare);
  const double to_rest = smooth_step((1 - kPauseShare / 2 - share) / kRampShare);
  // In the middle of each press (where the ramps are over) the force swings between 55 % and all of the press's
  // largest.
  const double swing = 1 - 0.45 * 0.5 * (1 + wander(strength_, time_s)) * smooth_step((share - 0.35) / 0.15);
  return press_largest_n_[static_cast<std::size_t>(press)] * from_rest * to_rest * swing * bearable(time_s);
}

// All of the force in the lower half of the face, less and less towards the tip, so that the push stays in the range
// that the finger is made for.
double TouchPlan::bearable(double time_s) const {
  const auto [lowest_mm, highest_mm] = spec_.touch_y_mm;
  const double height = (static_cast<double>(point_mm(time_s).y()) - lowest_mm) / (highest_mm - lowest_mm);
  return 1 - (1 - kTipForceShare) * std::max(0.0, 2 * height - 1);
}

std::vector<TouchLoad> planned_loads(const TouchPlan& plan, int frames, double frames_per_second) {
  std::vector<TouchLoad> loads;
  for (int frame = 0; frame < frames; ++frame) {
    const double time_s = frame / frames_per_second, force_n = plan.force_n(time_s);
    loads.push_back({plan.point_mm(time_s), force_n, force_n});
  }
  return loads;
}

std::vector<TouchLoad> weight_loads(const Vec3f& point_mm, const std::vector<double>& force_n, int frames,
                                    double frames_per_second) {
  constexpr double kRest_s = 2, kPutOn_s = 0.5;
  std::vector<double> steps_n = {0};
  steps_n.insert(steps_n.end(), force_n.begin(), force_n.end());
  const bool is_taken_off = force_n.size() > 1;
  const double loaded_s = frames / frames_per_second - (is_taken_off ? 2 : 1) * kRest_s;
  const double each_s = loaded_s / static_cast<double>(force_n.size());
  if (is_taken_off) steps_n.push_back(0);
  std::vector<TouchLoad> loads;
  for (int frame = 0; frame < frames; ++frame) {
    const double time_s = frame / frames_per_second - kRest_s;
    double now_n = 0;
    for (std::size_t i = 1; i < steps_n.size(); ++i) {
      const double share = smooth_step((time_s - static_cast<double>(i - 1) * each_s) / kPutOn_s);
      now_n += share * (steps_n[i] - steps_n[i - 1]);
    }
    loads.push_back({point_mm, std::max(now_n, 0.0), std::max(now_n, 0.0)});
  }
  return loads;
}

std::vector<FemState> make_touch_path(const FingerSpec& spec, const TetMesh& mesh,
                                      const std::vector<TouchLoad>& loads) {
  const auto frames = static_cast<int>(loads.size());
  const std::size_t keys = static_cast<std::size_t>((frames + kKeyStep - 2) / kKeyStep) + 1;
  std::vector<FemState> states(keys);
  Progress progress("touch path: finite-element states", keys);
  const auto shared = std::make_shared<const PushedFinger>(spec, mesh);
  parallel_for((keys + kChunk - 1) / kChunk, [&](std::size_t chunk) {
    FingerStatics finger(shared);
    for (std::size_t key = chunk * kChunk; key < std::min(keys, (chunk + 1) * kChunk); ++key) {
      if (interrupted()) throw Interrupted();
      const TouchLoad& load = loads[std::min(key * kKeyStep, loads.size() - 1)];
      // Untouched, the finger is at rest whatever came before.
      const bool is_touched = load.bends_as_n >= kLightestTouch_n;
      if (!is_touched) finger.reset();
      states[key] = is_touched ? touched(finger, mesh, load.point_mm, load.bends_as_n) : untouched(load.point_mm);
      progress.advance();
    }
  });
  std::vector<FemState> path = interpolated(states, kKeyStep, frames);
  for (std::size_t frame = 0; frame < path.size(); ++frame) {
    const TouchLoad& load = loads[frame];
    if (load.force_n != load.bends_as_n) {
      path[frame].force_n *= load.bends_as_n > 0 ? static_cast<float>(load.force_n / load.bends_as_n) : 0;
    }
  }
  return path;
}

std::vector<FemState> interpolated(const std::vector<FemState>& keys, int step, int frames) {
  std::vector<StateNumbers> numbers;
  for (const FemState& key : keys) numbers.push_back(numbers_of(key));
  const auto key = [&](int index) -> const StateNumbers& {
    return numbers[static_cast<std::size_t>(std::clamp(index, 0, static_cast<int>(numbers.size()) - 1))];
  };
  std::vector<FemState> states;
  for (int frame = 0; frame < frames; ++frame) {
    const int k = frame / step;
    const float t = static_cast<float>(frame % step) / static_cast<float>(step);
    const StateNumbers slope0 = (key(k + 1) - key(k - 1)) / 2, slope1 = (key(k + 2) - key(k)) / 2;
    const StateNumbers rise = key(k + 1) - key(k);
    const StateNumbers now =
        key(k) + t * (slope0 + t * (3 * rise - 2 * slope0 - slope1 + t * (slope0 + slope1 - 2 * rise)));
    FemState state = state_of(now);
    if (key(k)[6] == 0 && key(k + 1)[6] == 0) state = untouched(state.point_mm);
    state.path = frame;
    states.push_back(state);
  }
  return states;
}

}  // namespace finsight::host
