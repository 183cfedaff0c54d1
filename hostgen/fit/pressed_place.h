// A finger pressed at one place of its front face by a growing force, solved with the finite elements.
#pragma once

#include <array>
#include <vector>

#include "firmware/model/plate_prior.h"
#include "hostgen/fem/statics.h"

namespace finsight::host {

/// How a place of a finger answers to a normal force: finite-element states of that finger, and what lies between them.
class PressedPlace {
 public:
  /// Solves for forces up to `highest_n`, or up to the tenths of it that the finger bears there, by its spec's own
  /// Young's modulus.
  PressedPlace(FingerStatics& statics, const Vec3f& point_mm, double highest_n);

  const Vec3f& point_mm() const { return point_mm_; }
  /// 0: the place gives way under any force.
  double highest_n() const { return force_n_.empty() ? 0 : force_n_.back(); }
  PoseVectorOf<double> motion(double force_n) const;
  std::array<PlateMotion, kPlates> plates(double force_n) const;

 private:
  bool solve(FingerStatics& statics, double highest_n);

  Vec3f point_mm_;
  std::vector<double> force_n_;
  std::vector<PoseVectorOf<double>> per_newton_;  ///< plate motion over force
};

}  // namespace finsight::host
