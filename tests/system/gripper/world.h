// What the controllers do not see: the finger as finite-element states, an object between the jaws, and drives.
#pragma once

#include <algorithm>
#include <cmath>
#include <string>

#include "hostgen/learn/state_interpolant.h"
#include "tests/system/gripper/controllers.h"

namespace gripper {

/// An object to grasp: a spring that creeps.
struct Object {
  std::string name;
  double size_mm = 40;
  double stiffness_n_per_mm = 5;
  double holds_from_n = 0;  ///< below this force it slips out
  double breaks_at_n = 1e9;
  double creep = 0;  ///< share of its compliance that creep adds, with a time constant of kCreep_s
};
constexpr double kCreep_s = 5;

/// A drive that moves to its target at a limited speed.
class Drive {
 public:
  Drive(double start_mm, double speed_mm_per_s) : at_(start_mm), speed_(speed_mm_per_s) {}
  void advance(double target_mm, double seconds) {
    at_ += std::clamp(target_mm - at_, -speed_ * seconds, speed_ * seconds);
    reached_ = std::abs(target_mm - at_) < 1e-3;
  }
  double at_mm() const { return at_; }
  bool reached() const { return reached_; }

 private:
  double at_, speed_;
  bool reached_ = true;
};

/// One jaw is the finger, the other one is rigid. The object stays where it is; the gripper moves.
class World {
 public:
  World(const finsight::host::StateInterpolant& finger, const Object& object, double x_mm, double y_mm)
      : finger_(finger), object_(object), x_(x_mm), y_(y_mm) {}

  /// Advances time with the jaws `opening_mm` apart and the gripper moved by (arm_x, arm_y).
  void advance(double opening_mm, double arm_x_mm, double arm_y_mm, double seconds) {
    touch_x_mm = x_ - arm_x_mm;
    touch_y_mm = y_ - arm_y_mm;
    squeeze(object_.size_mm - opening_mm);
    if (force_n > 0.05) {
      crept_ += (object_.creep - crept_) * seconds / kCreep_s;
      held_ = held_ || force_n >= object_.holds_from_n;
      if (held_ && force_n < object_.holds_from_n) slipped_n = std::max(slipped_n, object_.holds_from_n - force_n);
    }
    largest_n = std::max(largest_n, force_n);
  }
  bool is_on_the_face() const { return std::abs(touch_x_mm) < 20 && touch_y_mm > 8 && touch_y_mm < 112; }
  bool is_broken() const { return largest_n >= object_.breaks_at_n; }

  double touch_x_mm = 0, touch_y_mm = 0;
  double force_n = 0, largest_n = 0;
  double slipped_n = 0;  ///< how far the force fell below holds_from_n after it had reached it
  finsight::PoseVector plates = finsight::PoseVector::Zero();

 private:
  /// Finds by bisection the force at which finger and object together yield by `depth_mm`.
  void squeeze(double depth_mm) {
    plates.setZero();
    force_n = 0;
    if (depth_mm <= 0 || !is_on_the_face()) return;
    const double compliance = (1 + crept_) / object_.stiffness_n_per_mm;
    double low = 0, high = finger_.highest_force_n(touch_x_mm, touch_y_mm);
    for (int i = 0; i < 30; ++i) {
      const double middle = (low + high) / 2;
      const auto sample = finger_.at(touch_x_mm, touch_y_mm, middle);
      const double yield_mm = static_cast<double>(sample.displacement_mm.z()) + middle * compliance;
      (yield_mm < depth_mm ? low : high) = middle;
    }
    force_n = low;
    plates = finger_.at(touch_x_mm, touch_y_mm, force_n).numbers;
  }

  const finsight::host::StateInterpolant& finger_;
  Object object_;
  double x_, y_;
  double crept_ = 0;
  bool held_ = false;
};

}  // namespace gripper
