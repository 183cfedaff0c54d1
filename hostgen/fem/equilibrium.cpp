#include "hostgen/fem/equilibrium.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <cstdio>
#include <cstdlib>

long g_fac,g_step,g_fail;
namespace finsight::host {
namespace {
constexpr double kTolerance = 1e-8;  // of the load's norm
constexpr int kMaxFactorisations = 12, kMaxSteps = 40;
constexpr double kSmallestJ = 0.05;
static const double kWorth = getenv("WORTH")?atof(getenv("WORTH")):7;
static const int kFirst = getenv("FIRST")?atoi(getenv("FIRST")):0;

double dot(std::span<const double> a, std::span<const double> b) {
  double total = 0;
  for (std::size_t i = 0; i < a.size(); ++i) total += a[i] * b[i];
  return total;
}
}  // namespace

Equilibrium::Equilibrium(const ElasticBody& body)
    : body_(body), cholesky_(body.plan().view()), residual_(body.vector_size()), step_(body.vector_size()) {}

double Equilibrium::residual_at(std::span<const double> load, const ElasticState& state) {
  smallest_J_ = body_.forces(state.u, residual_);
  for (std::size_t i = 0; i < residual_.size(); ++i) residual_[i] = load[i] - residual_[i];
  std::fill_n(residual_.end() - 3, 3, 0.0);
  return std::sqrt(dot(residual_, residual_));
}

bool Equilibrium::solve(std::span<const double> load, ElasticState& state) {
  const double goal = kTolerance * std::sqrt(dot(load, load)) + 1e-14;
  const long last_factorisation = cost_.factorisations + kMaxFactorisations, last_step = cost_.steps + kMaxSteps;
  double size = 0; int chord=0; // chords since the factor
  bool refactor = !factored_ || !kFirst;
  bool V=getenv("V");
  while (true) {
    const double residual = residual_at(load, state);
    if(V)printf(" r %.1e ",residual/goal*1e-8);
    if (!(smallest_J_ > kSmallestJ) || !std::isfinite(residual)) {{++g_fail;return false;}}
    if (residual <= goal) break;
    if (cost_.steps >= last_step) {++g_fail;return false;}
    for(;;) {
      if (refactor) {
        if (cost_.factorisations >= last_factorisation) {++g_fail;return false;}
        body_.tangent(state.u, state.stress, cholesky_.values());
        ++cost_.factorisations;++g_fac;
        factored_ = cholesky_.factor();
        if (!factored_) {if(V)printf("P");{++g_fail;return false;}}
      }
      step_ = residual_;
      cholesky_.solve(std::span(step_).first(body_.solved_size()));
      ++cost_.steps;++g_step;
      const double last=size; size = std::sqrt(dot(residual_, step_));
      if(V)printf("%s %.1e ",refactor?"F":"",size);
      if (refactor || last==0) break;
      double theta=size/last*(chord==0?2:1);
      double left=theta<1?std::log(goal/residual)/std::log(theta):1e9;
      if(V)printf("(%.1f)",left);
      if (left<=kWorth) break;
      refactor=true;
    }
    chord=refactor?0:chord+1; refactor=false;
    body_.stresses(state.u, step_, state.stress);
    for (std::size_t i = 0; i < step_.size(); ++i) state.u[i] += step_[i];
  }
  if (V) printf("\n");
  std::fill(step_.begin(), step_.end(), 0.0);
  body_.stresses(state.u, step_, state.stress);
  return true;
}

}  // namespace finsight::host
