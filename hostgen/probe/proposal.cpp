// What a spec should say, from what the probe found. Noise: plates' motions m have second moments P in the probe; the
// corners' pixels are J m + noise, so what is left unknown after one picture is (P^-1 + J^T J / sigma^2)^-1.
#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <numbers>

#include "firmware/geometry/so3.h"
#include "hostgen/probe/probe.h"

namespace finsight::host {

namespace {

using Eigen::Isometry3d;
using Eigen::MatrixXd;
using Eigen::Vector3d;
using Eigen::VectorXd;

constexpr double kCorner_px = 0.05;
constexpr double kDegPerRad = 180 / std::numbers::pi;
constexpr double kUsualThreshold_mm = 2;

PoseVectorOf<double> numbers_of(const FemState& state) {
  PoseVectorOf<double> numbers;
  for (int p = 0; p < kPlates; ++p) {
    numbers.segment<3>(6 * p) = state.plates[static_cast<std::size_t>(p)].displacement_mm.cast<double>();
    numbers.segment<3>(6 * p + 3) = state.plates[static_cast<std::size_t>(p)].rotation_rad.cast<double>();
  }
  return numbers;
}

/// [8] pixels of a marker's corners after a motion of its plate.
VectorXd corner_pixels(const FingerSpec& spec, int plate, const Eigen::Matrix<double, 6, 1>& motion) {
  const Isometry3d& rest = spec.plates[static_cast<std::size_t>(plate)].T_finger_marker;
  const Isometry3d T_camera_finger = spec.T_finger_camera.inverse();
  const Eigen::Matrix3d R = so3_exp(Vector3d(motion.tail<3>())) * rest.linear();
  VectorXd pixels(8);
  for (int corner = 0; corner < 4; ++corner) {
    const double half = spec.marker_size_mm / 2;
    const Vector3d on_marker(corner & 1 ? half : -half, corner & 2 ? half : -half, 0);
    const Vector3d at = T_camera_finger * (rest.translation() + motion.head<3>() + R * on_marker);
    pixels.segment<2>(2 * corner) = pixel_from_ray(spec.cameras[1], Eigen::Vector2d(at.head<2>() / at.z()));
  }
  return pixels;
}

/// [24, 18]
MatrixXd corner_derivatives(const FingerSpec& spec) {
  constexpr double kStep = 1e-4;
  MatrixXd J = MatrixXd::Zero(8 * kPlates, kPoseDims);
  for (int p = 0; p < kPlates; ++p) {
    for (int i = 0; i < 6; ++i) {
      const Eigen::Matrix<double, 6, 1> step = kStep * Eigen::Matrix<double, 6, 1>::Unit(i);
      J.block(8 * p, 6 * p + i, 8, 1) = (corner_pixels(spec, p, step) - corner_pixels(spec, p, -step)) / (2 * kStep);
    }
  }
  return J;
}

double up_to(double value, double step) { return std::max(0.0, std::ceil(value / step - 1e-9) * step); }

/// Two significant digits, upwards or downwards.
double two_digits(double value, bool upwards) {
  if (!(value > 0)) return value;
  const double step = std::pow(10.0, std::floor(std::log10(value)) - 1);
  return step * (upwards ? std::ceil(value / step - 1e-6) : std::floor(value / step + 1e-6));
}

struct Scale {
  double highest_n = 0;  ///< that all places but one bear
  std::size_t bear = 0, places = 0, tried = 0;
  double weakest_mm = 0, median_mm = 0;  ///< a plate's motion under that
  double face_mm = 0;                    ///< largest RMS motion of the face under that
};

Scale scale_of(const Probe& probe) {
  Scale scale;
  scale.places = probe.places.size();
  std::vector<double> borne, motion;
  for (const ProbedPlace& place : probe.places) {
    if (place.is_tried()) borne.push_back(place.borne_n());
  }
  scale.tried = borne.size();
  if (borne.empty()) return scale;
  std::ranges::sort(borne);
  scale.highest_n = two_digits(borne[borne.size() > 3 ? 1 : 0], false);
  scale.bear = static_cast<std::size_t>(std::ranges::count_if(borne, [&](double n) { return n >= scale.highest_n; }));
  for (const ProbedPlace& place : probe.places) {
    if (place.states.empty()) continue;
    const double share = std::min(1.0, scale.highest_n / place.borne_n());
    motion.push_back(share * plate_motion_mm(place.states.back()));
    scale.face_mm = std::max(scale.face_mm, share * static_cast<double>(place.states.back().front_rms_mm));
  }
  std::ranges::sort(motion);
  if (!motion.empty()) {
    scale.weakest_mm = motion.front();
    scale.median_mm = motion[motion.size() / 2];
  }
  return scale;
}

WorkingRange range_of(const Probe& probe, std::size_t plate, double highest_n) {
  constexpr double kRoom = 1.1;  // touches between the probed places move plates a little further
  WorkingRange range;
  for (const ProbedPlace& place : probe.places) {
    for (const FemState& state : place.states) {
      // Under less force about as much less: places are seldom pushed with just that.
      const double share = kRoom * std::min(1.0, highest_n / static_cast<double>(state.force_n));
      const Vector3d shift = share * state.plates[plate].displacement_mm.cast<double>();
      const Vector3d turn = share * state.plates[plate].rotation_rad.cast<double>();
      range.inward_mm = std::max(range.inward_mm, shift.z());
      range.sideways_mm = std::max(range.sideways_mm, std::abs(shift.x()));
      range.tilt_rad = std::max({range.tilt_rad, std::abs(turn.x()), std::abs(turn.z())});
      range.turn_rad = std::max(range.turn_rad, std::abs(turn.y()));
    }
  }
  return range;
}

template <class... Values>
std::string text(const char* format, Values... values) {
  char line[400];
  std::snprintf(line, sizeof line, format, values...);
  return line;
}

}  // namespace

std::array<PoseNoise, kPlates> expected_noise(const FingerSpec& spec, const Probe& probe) {
  MatrixXd P = MatrixXd::Zero(kPoseDims, kPoseDims);
  double count = 0;
  for (const ProbedPlace& place : probe.places) {
    for (const FemState& state : place.states) {
      const PoseVectorOf<double> m = numbers_of(state);
      P += m * m.transpose();
      ++count;
    }
  }
  P /= std::max(1.0, count);
  // What the few states do not span may still happen, a little.
  for (int i = 0; i < kPoseDims; ++i) P(i, i) += i % 6 < 3 ? 0.05 * 0.05 : 0.005 * 0.005;
  const MatrixXd J = corner_derivatives(spec), PJ = P * J.transpose();
  const MatrixXd seen = J * PJ + kCorner_px * kCorner_px * MatrixXd::Identity(J.rows(), J.rows());
  const VectorXd left = (P - PJ * seen.ldlt().solve(PJ.transpose())).diagonal().cwiseMax(0);
  std::array<PoseNoise, kPlates> noise;
  for (int p = 0; p < kPlates; ++p) {
    const auto rms = [&](int a, int b) { return std::sqrt(0.5 * (left[6 * p + a] + left[6 * p + b])); };
    noise[static_cast<std::size_t>(p)] = {rms(0, 2), rms(1, 1), rms(3, 5), rms(4, 4)};
  }
  return noise;
}

std::string proposal_text(const FingerSpec& spec, const Probe& probe) {
  const Scale scale = scale_of(probe);
  if (scale.tried == 0) {
    return "# nothing: no place could be pushed in the time. A coarser mesh takes less (--size, a larger "
           "surface.simplify_mm), and so does a touch.force_n that the finger bears\n";
  }
  if (!(scale.highest_n > 0)) {
    return text("# nothing: of %zu places that were tried two or more bear no force at all; see above why\n",
                scale.tried);
  }
  const std::array<PoseNoise, kPlates> noise = expected_noise(spec, probe);
  double blur_mm = 0;
  for (const PoseNoise& one : noise) blur_mm = std::max(blur_mm, std::hypot(one.lateral_mm, one.depth_mm));
  if (4 * blur_mm > scale.median_mm) {
    return text(
        "# nothing: at the median place a plate moves by %.3g mm under %.3g N, less than four times the %.3g mm "
        "to which the camera tells it. What helps: more force, a softer finger, larger markers, a nearer "
        "camera\n",
        scale.median_mm, scale.highest_n, blur_mm);
  }
  const double lowest_n = std::min(
      std::max(kWeakestPush_n, two_digits(std::min(spec.force_n[0], scale.highest_n / 6), true)), scale.highest_n / 2);
  const double threshold_mm =
      two_digits(std::max(4 * blur_mm, std::min(kUsualThreshold_mm, 0.25 * scale.median_mm)), true);
  std::string out = "# each of these keys replaces the one of the same name in the spec\n";
  if (scale.tried < scale.places) {
    out += text("# from %zu of %zu places, there was no time for the others: probe once more with these\n", scale.tried,
                scale.places);
  }
  out += "[touch]\n";
  out += text("force_n = [%.3g, %.3g]  # %zu of %zu places bear %.3g N", lowest_n, scale.highest_n, scale.bear,
              scale.tried, scale.highest_n);
  out += scale.highest_n >= spec.force_n[1] ? " (the spec's, nothing higher was tried)\n"
                                            : "; the spec says " + text("%.3g\n", spec.force_n[1]);
  out += text(
      "threshold_mm = %.3g  # a quarter of the %.2f mm that a plate moves at the median place under that, at most "
      "%g mm, at least four times the noise of %.3f mm; the weakest place moves one by %.2f mm\n",
      threshold_mm, scale.median_mm, kUsualThreshold_mm, blur_mm, scale.weakest_mm);
  out += text("rated_deformation_mm = %.3g  # the face moves by %.2f mm (RMS) at most\n",
              std::max(0.01, two_digits(scale.face_mm, true)), scale.face_mm);
  for (std::size_t p = 0; p < kPlates; ++p) {
    const WorkingRange range = range_of(probe, p, scale.highest_n);
    out += text("\n[plates.%s]\n", kPlateNames[p]);
    out += text(
        "range = { inward_mm = %.3g, sideways_mm = %.3g, tilt_deg = %.3g, turn_deg = %.3g }  # a tenth more than "
        "under those forces\n",
        up_to(range.inward_mm, 0.5), up_to(range.sideways_mm, 0.5), up_to(range.tilt_rad * kDegPerRad, 1),
        up_to(range.turn_rad * kDegPerRad, 1));
    out += text(
        "noise = { lateral_mm = %.2g, depth_mm = %.2g, tilt_deg = %.2g, roll_deg = %.2g }  # all plates together, "
        "corners within %.2f px at 640x480\n",
        noise[p].lateral_mm, noise[p].depth_mm, noise[p].tilt_rad * kDegPerRad, noise[p].roll_rad * kDegPerRad,
        kCorner_px);
  }
  return out;
}

}  // namespace finsight::host
