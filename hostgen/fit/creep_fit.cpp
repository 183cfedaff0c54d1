#include "hostgen/fit/creep_fit.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace finsight::host {

namespace {

/// Share by which a constant force has bent the finger further after some time.
double crept(double after_s, double creep_s) { return -std::expm1(-after_s / creep_s); }

/// How well one creep explains all long holds: sum of squares of relative forces.
double misfit(const std::vector<ForceSeries>& all, double share, double creep_s) {
  double sum = 0;
  for (const ForceSeries& series : all) {
    double y = 0, yy = 0, mm = 0, ym = 0;
    for (std::size_t i = 0; i < series.force_n.size(); ++i) {
      const double model = 1 + share * crept(series.after_s[i], creep_s);
      y += series.force_n[i];
      yy += series.force_n[i] * series.force_n[i];
      mm += model * model;
      ym += series.force_n[i] * model;
    }
    const double mean = y / static_cast<double>(series.force_n.size());
    sum += (yy - ym * ym / mm) / (mean * mean);
  }
  return sum;
}

/// Nearly of independent noise, other than frames that follow each other.
ForceSeries means_of_seconds(const ForceSeries& hold) {
  ForceSeries means;
  double sum = 0, time = 0, from_s = 0;
  int count = 0;
  for (std::size_t i = 0; i < hold.force_n.size(); ++i) {
    if (count > 0 && hold.after_s[i] >= from_s + 1) {
      means.force_n.push_back(sum / count);
      means.after_s.push_back(time / count);
      sum = time = 0;
      count = 0;
    }
    if (count == 0) from_s = hold.after_s[i];
    sum += hold.force_n[i];
    time += hold.after_s[i];
    ++count;
  }
  return means;
}

}  // namespace

// The best of a grid over both numbers, refined five times.
std::optional<Creep> fit_creep(const std::vector<ForceSeries>& holds) {
  if (holds.empty()) return std::nullopt;
  std::vector<ForceSeries> means;
  std::size_t readings = 0;
  for (const ForceSeries& hold : holds) {
    means.push_back(means_of_seconds(hold));
    readings += means.back().force_n.size();
  }
  Creep best{.share = 0.1, .after_s = 20, .sigma = 0};
  double least = std::numeric_limits<double>::infinity(), share_step = 0.1, time_step = 3;
  constexpr int kSide = 10, kRounds = 6;
  for (int round = 0; round < kRounds; ++round) {
    const Creep middle = best;
    for (int i = -kSide; i <= kSide; ++i) {
      for (int j = -kSide; j <= kSide; ++j) {
        const double share = std::max(0.0, middle.share + share_step * i / kSide);
        const double after_s =
            std::clamp(middle.after_s * std::pow(time_step, static_cast<double>(j) / kSide), 2.0, 90.0);
        const double sum = misfit(means, share, after_s);
        if (sum < least) {
          least = sum;
          best = {.share = share, .after_s = after_s, .sigma = 0};
        }
      }
    }
    share_step /= 2;
    time_step = std::sqrt(time_step);
  }
  const double variance = least / std::max<double>(1, static_cast<double>(readings) - 3);
  constexpr double kStep = 0.01;
  const double curvature = (misfit(means, best.share + kStep, best.after_s) - least) / (kStep * kStep);
  best.sigma = curvature > 0 ? std::sqrt(variance / curvature) : 1;
  return best;
}

double mean_without_creep(const ForceSeries& series, const std::optional<Creep>& creep) {
  double sum = 0;
  for (std::size_t i = 0; i < series.force_n.size(); ++i) {
    const double more = creep ? 1 + creep->share * crept(series.after_s[i], creep->after_s) : 1;
    sum += series.force_n[i] / more;
  }
  return sum / static_cast<double>(series.force_n.size());
}

}  // namespace finsight::host
