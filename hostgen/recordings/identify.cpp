#include "hostgen/recordings/identify.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <map>
#include <numeric>
#include <optional>
#include <stdexcept>

#include "firmware/geometry/plate_motion.h"
#include "firmware/input_error.h"
#include "hostgen/fem/statics.h"
#include "hostgen/finger/grid.h"
#include "hostgen/recordings/audit.h"
#include "hostgen/util/common.h"

namespace finsight::host {

namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

struct SpecNumber {
  const char* key;
  double FingerSpec::*value;
};
constexpr SpecNumber kNumbers[] = {{"shape.front_wall_mm", &FingerSpec::front_wall_mm},
                                   {"shape.back_wall_mm", &FingerSpec::back_wall_mm},
                                   {"shape.side_wall_mm", &FingerSpec::side_wall_mm},
                                   {"shape.base_ring_mm", &FingerSpec::base_ring_mm},
                                   {"material.youngs_modulus_mpa", &FingerSpec::youngs_modulus_mpa}};
constexpr auto kCount = static_cast<Index>(std::size(kNumbers));

constexpr double kMinPush_mm = 2;
constexpr double kDifference =
    0.08;  // step of the differences, of a number's logarithm: well above the effect of remeshing
constexpr double kLargestChange = 0.3;  // of a number's logarithm in one iteration
constexpr double kDetermined = 0.25;    // a number whose logarithm scatters more is not identifiable
constexpr double kFirstForce_n = 0.5;   // of a simulated push; the next forces follow by scaling
constexpr int kMaxLoads = 8;

VectorXd numbers_of(const FingerSpec& spec) {
  VectorXd logarithms(kCount);
  for (Index i = 0; i < kCount; ++i) logarithms[i] = std::log(spec.*kNumbers[i].value);
  return logarithms;
}

FingerSpec with_numbers(FingerSpec spec, const VectorXd& logarithms) {
  for (Index i = 0; i < kCount; ++i) spec.*kNumbers[i].value = std::exp(logarithms[i]);
  place_markers(spec);
  return spec;
}

Eigen::Vector3d inward_normal(const FingerSpec& spec) {
  return Eigen::Vector3d(0, -spec.front_z.slope, 1).normalized();
}

using Millimetres = Eigen::Matrix<double, kPoseDims, 1>;

/// Displacements, and rotations as displacements; 0 for plates that were not seen.
Millimetres in_millimetres(const std::array<PlateMotion, kPlates>& plates, const std::array<bool, kPlates>& seen) {
  Millimetres numbers = Millimetres::Zero();
  for (std::size_t p = 0; p < kPlates; ++p) {
    if (!seen[p]) continue;
    const auto at = static_cast<Index>(6 * p);
    numbers.segment<3>(at) = plates[p].displacement_mm.cast<double>();
    numbers.segment<3>(at + 3) = (kMillimetresPerRadian * plates[p].rotation_rad).cast<double>();
  }
  return numbers;
}

/// Plate motions when the point has been pushed in by push_mm. The force follows by scaling: displacement is nearly
/// proportional to it.
std::optional<Millimetres> simulate(FingerStatics& statics, const RecordedPush& push, const Eigen::Vector3d& inward) {
  statics.reset();
  double force_n = kFirstForce_n;
  for (int load = 0; load < kMaxLoads; ++load) {
    if (!statics.load(push.point_mm, force_n)) return std::nullopt;
    const FemState state = statics.state();
    const double moved_mm = (state.contact_mm - state.point_mm).cast<double>().dot(inward);
    if (!(moved_mm > 0)) return std::nullopt;
    const double ratio = push.push_mm / moved_mm;
    // The last few per cent are scaled.
    if (std::abs(ratio - 1) < 0.03) return ratio * in_millimetres(state.plates, push.poses.seen);
    force_n *= std::clamp(ratio, 0.3, 3.0);
  }
  return std::nullopt;
}

/// Errors of all pushes, stacked; `good` is false for a push without equilibrium, and its errors are 0.
struct Residuals {
  VectorXd errors_mm;
  std::vector<bool> good;
};

Residuals residuals(const FingerSpec& spec, const std::vector<RecordedPush>& pushes, const MeshMaker& make) {
  const auto finger = std::make_shared<const PushedFinger>(spec, make(spec));
  const Eigen::Vector3d inward = inward_normal(spec);
  Residuals result{VectorXd::Zero(kPoseDims * static_cast<Index>(pushes.size())), {}};
  std::vector<char> good(pushes.size());
  parallel_for(pushes.size(), [&](std::size_t i) {
    FingerStatics statics(finger);
    const std::optional<Millimetres> simulated = simulate(statics, pushes[i], inward);
    if (!simulated) return;
    good[i] = 1;
    result.errors_mm.segment<kPoseDims>(kPoseDims * static_cast<Index>(i)) =
        *simulated - in_millimetres(pushes[i].poses.plates, pushes[i].poses.seen);
  });
  result.good.assign(good.begin(), good.end());
  return result;
}

/// The errors with those of all other pushes set to 0.
VectorXd common(const VectorXd& errors, const std::vector<bool>& good) {
  VectorXd kept = errors;
  for (std::size_t i = 0; i < good.size(); ++i) {
    if (!good[i]) kept.segment<kPoseDims>(kPoseDims * static_cast<Index>(i)).setZero();
  }
  return kept;
}

std::vector<bool> both(const std::vector<bool>& a, const std::vector<bool>& b) {
  std::vector<bool> result(a.size());
  for (std::size_t i = 0; i < a.size(); ++i) result[i] = a[i] && b[i];
  return result;
}

/// One spec's errors and their derivatives with respect to the logarithms of its numbers.
struct Linearisation {
  Residuals at;
  MatrixXd derivative;
};

/// How many plate numbers of the good pushes were recorded.
double recorded_numbers(const std::vector<RecordedPush>& pushes, const std::vector<bool>& good) {
  double count = 0;
  for (std::size_t i = 0; i < pushes.size(); ++i) {
    for (const bool seen : pushes[i].poses.seen) count += good[i] && seen ? 6 : 0;
  }
  return count;
}

/// Nothing if such a finger cannot be meshed.
std::optional<Residuals> try_residuals(const FingerSpec& spec, const VectorXd& at,
                                       const std::vector<RecordedPush>& pushes, const MeshMaker& make) {
  try {
    return residuals(with_numbers(spec, at), pushes, make);
  } catch (const InputError&) {
    return std::nullopt;
  }
}

/// One-sided differences, to the other side where the finger cannot be meshed.
Linearisation linearise(const FingerSpec& spec, const VectorXd& at, const Residuals& here,
                        const std::vector<RecordedPush>& pushes, const MeshMaker& make, Progress& progress) {
  Linearisation result{here, MatrixXd::Zero(here.errors_mm.size(), kCount)};
  std::vector<VectorXd> difference;
  for (Index i = 0; i < kCount; ++i) {
    if (interrupted()) throw Interrupted();
    for (const double step : {kDifference, -kDifference}) {
      const auto there = try_residuals(spec, at + step * VectorXd::Unit(kCount, i), pushes, make);
      if (!there) continue;
      result.derivative.col(i) = (there->errors_mm - here.errors_mm) / step;
      result.at.good = both(result.at.good, there->good);
      break;
    }
    progress.advance();
  }
  for (Index i = 0; i < kCount; ++i) result.derivative.col(i) = common(result.derivative.col(i), result.at.good);
  result.at.errors_mm = common(here.errors_mm, result.at.good);
  return result;
}

struct Step {
  VectorXd change, sigma;
  std::vector<bool> identifiable;
};

/// The Gauss-Newton step of the identifiable numbers. The others are dropped one by one, the least certain first.
Step best_step(const Linearisation& linear, double numbers) {
  Step step{VectorXd::Zero(kCount), VectorXd::Zero(kCount), std::vector<bool>(static_cast<std::size_t>(kCount), true)};
  while (true) {
    std::vector<Index> free;
    for (Index i = 0; i < kCount; ++i) {
      if (step.identifiable[static_cast<std::size_t>(i)]) free.push_back(i);
    }
    step.change.setZero();
    if (free.empty()) return step;
    const MatrixXd J = linear.derivative(Eigen::all, free);
    const MatrixXd normal = J.transpose() * J + 1e-12 * MatrixXd::Identity(J.cols(), J.cols());
    const VectorXd change = -normal.ldlt().solve(J.transpose() * linear.at.errors_mm);
    const double left = (linear.at.errors_mm + J * change).squaredNorm();
    const double noise_sq = left / std::max(1.0, numbers - static_cast<double>(free.size()));
    // At least 10 micrometres: the mesh is no more accurate than that.
    const VectorXd sigma = (std::max(noise_sq, 1e-4) * normal.inverse().diagonal()).cwiseSqrt();
    Index worst = 0;
    const double most = sigma.maxCoeff(&worst);
    for (std::size_t k = 0; k < free.size(); ++k) {
      step.change[free[k]] = change[static_cast<Index>(k)];
      step.sigma[free[k]] = sigma[static_cast<Index>(k)];
    }
    if (most <= kDetermined) return step;
    step.identifiable[static_cast<std::size_t>(free[static_cast<std::size_t>(worst)])] = false;
  }
}

double rms_mm(const Residuals& residuals, const std::vector<RecordedPush>& pushes, const std::vector<bool>& good) {
  return std::sqrt(common(residuals.errors_mm, good).squaredNorm() / std::max(1.0, recorded_numbers(pushes, good)));
}

}  // namespace

Identification identify_spec(const FingerSpec& spec, const std::vector<RecordedPush>& pushes, const MeshMaker& make,
                             int iterations) {
  const VectorXd start = numbers_of(spec);
  const Residuals first = residuals(spec, pushes, make);
  VectorXd at = start;
  Residuals here = first;
  Step step;
  std::vector<bool> good = first.good;
  Progress progress("fingers with changed numbers", static_cast<std::size_t>((iterations + 1) * kCount));
  for (int iteration = 0; iteration <= iterations; ++iteration) {
    const Linearisation linear = linearise(spec, at, here, pushes, make, progress);
    const double numbers = recorded_numbers(pushes, linear.at.good);
    if (numbers == 0) throw std::runtime_error("identify: the simulated finger has no equilibrium under any push");
    step = best_step(linear, numbers);
    good = both(first.good, linear.at.good);
    if (iteration == iterations) break;
    VectorXd change = step.change.cwiseMax(-kLargestChange).cwiseMin(kLargestChange);
    bool better = false;
    for (int halving = 0; halving < 4 && !better; ++halving, change *= 0.5) {
      const auto there = try_residuals(spec, at + change, pushes, make);
      if (!there) continue;
      const std::vector<bool> shared = both(linear.at.good, there->good);
      better = rms_mm(*there, pushes, shared) < rms_mm(here, pushes, shared);
      if (!better) continue;
      at += change;
      here = *there;
    }
    if (!better || change.cwiseAbs().maxCoeff() < 1e-3)
      iteration = iterations - 1;  // one more linearisation, for the standard deviations
  }
  Identification result;
  result.rms_before_mm = rms_mm(first, pushes, good);
  result.rms_after_mm = rms_mm(here, pushes, good);
  result.changed = at != start;
  result.pushes = pushes.size();
  if (!result.changed) {
    result.why_unchanged = std::ranges::count(step.identifiable, true) == 0
                               ? "the recordings determine none of them"
                               : "no step towards other numbers made the error smaller";
  }
  result.failed = static_cast<std::size_t>(std::count(good.begin(), good.end(), false));
  for (Index i = 0; i < kCount; ++i) {
    const double before = std::exp(start[i]), after = std::exp(at[i]);
    result.numbers.push_back(
        {kNumbers[i].key, before, after, after * step.sigma[i], bool(step.identifiable[static_cast<std::size_t>(i)])});
  }
  return result;
}

namespace {

/// Mean of the rows, relative to rest, whose push differs from `push_mm` by less than a tenth of the largest push.
RecordedPush mean_push(const RecordedMotion& motion, const std::vector<std::size_t>& rows,
                       const std::vector<double>& pushes_mm, std::size_t rest, double push_mm, double width_mm) {
  RecordedPush mean;
  mean.poses = motion.poses[rest];
  double count = 0;
  std::array<Eigen::Matrix<double, 6, 1>, kPlates> sums{};
  for (auto& sum : sums) sum.setZero();
  for (std::size_t i = 0; i < rows.size(); ++i) {
    if (std::abs(pushes_mm[i] - push_mm) > width_mm) continue;
    ++count;
    mean.push_mm += pushes_mm[i];
    for (std::size_t p = 0; p < kPlates; ++p) {
      const PlateMotion &now = motion.poses[rows[i]].plates[p], &before = motion.poses[rest].plates[p];
      sums[p].head<3>() += (now.displacement_mm - before.displacement_mm).cast<double>();
      sums[p].tail<3>() += (now.rotation_rad - before.rotation_rad).cast<double>();
    }
  }
  mean.push_mm /= count;
  for (std::size_t p = 0; p < kPlates; ++p) {
    mean.poses.plates[p].displacement_mm = (sums[p].head<3>() / count).cast<float>();
    mean.poses.plates[p].rotation_rad = (sums[p].tail<3>() / count).cast<float>();
  }
  return mean;
}

}  // namespace

std::vector<RecordedPush> recorded_pushes(const RecordedMotion& motion, const FingerSpec& spec, std::size_t points) {
  const std::vector<bool> outlier = find_outliers(motion);
  const Eigen::Vector3d inward = inward_normal(spec);
  std::map<int, std::vector<std::size_t>> rows_of_point;
  for (std::size_t row = 0; row < outlier.size(); ++row) {
    if (!outlier[row]) rows_of_point[motion.surface_node[row]].push_back(row);
  }
  std::vector<const std::vector<std::size_t>*> all;
  for (const auto& [node, rows] : rows_of_point) all.push_back(&rows);
  std::vector<RecordedPush> pushes;
  for (std::size_t k = 0; k < std::min(points, all.size()); ++k) {
    const std::vector<std::size_t>& rows = *all[k * all.size() / std::min(points, all.size())];
    const std::size_t rest = *std::min_element(rows.begin(), rows.end(), [&](std::size_t a, std::size_t b) {
      return motion.poses[a].plates[kTopPlate].displacement_mm.norm() <
             motion.poses[b].plates[kTopPlate].displacement_mm.norm();
    });
    std::vector<double> pushes_mm;
    for (const std::size_t row : rows) {
      pushes_mm.push_back((motion.pen_mm[row] - motion.pen_mm[rest]).cast<double>().dot(inward));
    }
    const double most_mm = *std::max_element(pushes_mm.begin(), pushes_mm.end());
    if (most_mm < kMinPush_mm) continue;
    for (const double share : {0.5, 0.9}) {
      const bool some = std::any_of(pushes_mm.begin(), pushes_mm.end(),
                                    [&](double push) { return std::abs(push - share * most_mm) <= 0.1 * most_mm; });
      if (!some) continue;
      pushes.push_back(mean_push(motion, rows, pushes_mm, rest, share * most_mm, 0.1 * most_mm));
      pushes.back().point_mm = motion.pen_mm[rest];
    }
  }
  if (pushes.empty()) throw std::runtime_error("identify: no contact point was pushed 2 mm or more");
  return pushes;
}

}  // namespace finsight::host
