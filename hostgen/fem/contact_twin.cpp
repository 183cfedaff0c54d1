#include "hostgen/fem/contact_twin.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

#include "firmware/model/model.h"

namespace finsight::host {

namespace {

constexpr int kUnknowns = 6;
using Unknowns = Eigen::Matrix<double, kUnknowns, 1>;
using Slope = Eigen::Matrix<double, kPoseDims, kUnknowns>;
enum : int { kX_mm, kY_mm, kNormal_n, kAcross, kAlong, kRadius_mm };  // friction as shares of the normal force

const Unknowns kStep = {0.2, 0.2, 0.02, 0.02, 0.02, 0.5};  // of the difference quotients
const Unknowns kScale = {5, 5, 1, 0.3, 0.3, 4};            // how far one step of the search may well go
constexpr double kSmallestRadius_mm = 0.5;                 // that of a push's patch would have no derivative
constexpr int kLongestSearch = 25;
constexpr double kGiveUpDamping = 1e4, kWorthwhile = 0.01;  // standard deviations of the noise

FaceContact contact_of(const Unknowns& at) {
  return {.centre_mm = at.head<2>(),
          .radius_mm = at[kRadius_mm],
          .pressure = Pressure::kEven,
          .friction = at.segment<2>(kAcross),
          .follow = 0};
}

class Search {
 public:
  Search(FingerStatics& finger, const FingerSpec& spec, const Scene& scene, const FemState& of)
      : finger_(finger), spec_(spec), scene_(scene), noise_(pose_noise(spec.noise)), wanted_(motion(of)) {
    at_ << of.point_mm.head<2>().cast<double>(), static_cast<double>(of.force_n), 0, 0, kSmallestRadius_mm;
    at_ = within(at_);
  }

  ContactTwin run() {
    if (!finger_.begin({contact_of(at_)}) || !finger_.press(at_[kNormal_n])) return best_;
    take();
    for (int i = 0; i < kLongestSearch; ++i) {
      const double before = best_.distance;
      if (!step() || before - best_.distance < kWorthwhile) break;
    }
    return best_;
  }

 private:
  static PoseVectorOf<double> motion(const FemState& state) {
    return pose_vector({.plates = state.plates}).cast<double>();
  }

  PoseVectorOf<double> missing(const FemState& state) const { return (wanted_ - motion(state)).cwiseQuotient(noise_); }

  void take() {
    best_.state = finger_.state();
    best_.distance = missing(best_.state).norm();
  }

  Unknowns within(Unknowns at) const {
    at[kY_mm] = std::clamp(at[kY_mm], spec_.touch_y_mm[0], spec_.touch_y_mm[1]);
    const double half_mm = spec_.half_width.at(at[kY_mm]) - spec_.touch_edge_mm;
    at[kX_mm] = std::clamp(at[kX_mm], -half_mm, half_mm);
    at[kNormal_n] = std::clamp(at[kNormal_n], 0.5 * spec_.force_n[0], 1.25 * spec_.force_n[1]);
    const double friction = at.segment<2>(kAcross).norm();
    if (friction > scene_.friction) at.segment<2>(kAcross) *= scene_.friction / friction;
    at[kRadius_mm] =
        std::clamp(at[kRadius_mm], kSmallestRadius_mm, std::max(kSmallestRadius_mm, scene_.patch_radius_mm));
    return at;
  }

  /// How the plates move with each unknown, in standard deviations of the noise; nothing where the finger buckles.
  std::optional<Slope> slope() {
    std::vector<FingerStatics::OtherLoad> loads;
    for (int k = 0; k < kUnknowns; ++k) {
      Unknowns there = at_;
      there[k] += kStep[k];
      loads.push_back({{contact_of(there)}, there[kNormal_n]});
    }
    const std::vector<FemState> states = finger_.nearby(loads);
    if (states.empty()) return std::nullopt;
    Slope slope;
    for (int k = 0; k < kUnknowns; ++k) {
      slope.col(k) = (missing(best_.state) - missing(states[static_cast<std::size_t>(k)])) / kStep[k];
    }
    return slope;
  }

  /// One step of Levenberg and Marquardt from the present state, which is best_. False if none leads nearer.
  bool step() {
    const std::optional<Slope> J = slope();
    if (!J) return false;
    for (; damping_ < kGiveUpDamping; damping_ *= 10) {
      Eigen::Matrix<double, kUnknowns, kUnknowns> A = J->transpose() * *J;
      A.diagonal() += damping_ * kScale.cwiseAbs2().cwiseInverse();
      const Unknowns next = within(at_ + A.ldlt().solve(J->transpose() * missing(best_.state)));
      if (!finger_.press({contact_of(next)}, next[kNormal_n])) continue;
      if (missing(finger_.state()).norm() < best_.distance) {
        at_ = next;
        damping_ *= 0.2;
        take();
        return true;
      }
      if (!finger_.press({contact_of(at_)}, at_[kNormal_n])) return false;
    }
    return false;
  }

  FingerStatics& finger_;
  const FingerSpec& spec_;
  const Scene& scene_;
  const PoseVectorOf<double> noise_, wanted_;
  Unknowns at_;
  double damping_ = 1;
  ContactTwin best_{.distance = std::numeric_limits<double>::infinity()};
};

}  // namespace

ContactTwin closest_contact(FingerStatics& finger, const FingerSpec& spec, const Scene& scene, const FemState& of) {
  return Search(finger, spec, scene, of).run();
}

double largest_share_refused(double distance) {
  constexpr double kOneInThousand = 3.0902;  // a standard normal number exceeds it once in a thousand times
  return 0.5 * std::erfc((kOneInThousand - distance) / std::numbers::sqrt2);
}

}  // namespace finsight::host
