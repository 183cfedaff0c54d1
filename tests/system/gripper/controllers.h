// Two gripper controllers, written as a PLC programmer would write them in Structured Text: inputs read over Modbus,
// outputs to position drives, and a CASE over a step number, called once per PLC cycle. They know nothing of the finger
// or the object.
#pragma once

#include <cmath>

namespace gripper {

/// Outputs of FB_Finsight (hostgen/plc/Finsight.st) under their names there, and of the drives.
struct Inputs {
  bool alive = false;        ///< the heartbeat changes
  bool any_fault = false;    ///< status bit 15
  bool touch_valid = false;  ///< status bit 1
  bool gentle = false;       ///< register 44, bit 1: the level has reached setting 1012
  bool overload = false;     ///< status bit 14
  bool level_valid = false;
  float touch_x_mm = 0, touch_y_mm = 0, touch_uncertainty_mm = 0;
  float level_permille = 0;
  bool in_position = true;  ///< both drives have reached their targets
};

struct Outputs {
  float opening_mm = 0;              ///< of the jaws
  float arm_x_mm = 0, arm_y_mm = 0;  ///< of the whole gripper, along the finger's axes
  bool done = false, error = false;
};

/// Closes, reads where the object touches the finger, opens, moves there and closes again, until the touch is near the
/// centre of the face; gives up after five moves.
class Regrasp {
 public:
  static constexpr float kCentre_x_mm = 0, kCentre_y_mm = 60;
  static constexpr float kNear_mm = 2;          // 5 mm are required; the reading has an error of 2 to 3 mm
  static constexpr float kClosing_mm = 0.1F;    // per cycle
  static constexpr float kFirm_permille = 250;  // the touch is located better the more the finger is bent
  static constexpr float kClosest_mm = 2;
  static constexpr int kReadings = 12;
  static constexpr int kMaxMoves = 5;

  Outputs out;
  int moves = 0;

  void cycle(const Inputs& in) {
    if (in.any_fault || !in.alive) return;  // stay where we are
    switch (step_) {
      case 0:  // close until the touch is firm
        out.opening_mm -= kClosing_mm;
        if (in.touch_valid && (in.level_permille >= kFirm_permille || in.overload)) go_to(1);
        if (out.opening_mm < kClosest_mm) fail();  // no object
        break;
      case 1:  // stand still and average some readings
        if (++count_ > 6 && in.touch_valid) {
          sum_x_ += in.touch_x_mm;
          sum_y_ += in.touch_y_mm;
          ++readings_;
        }
        if (readings_ == kReadings) go_to(2);
        if (count_ > 60) fail();
        break;
      case 2: {  // near enough?
        const float x = sum_x_ / kReadings - kCentre_x_mm, y = sum_y_ / kReadings - kCentre_y_mm;
        if (std::hypot(x, y) <= kNear_mm) {
          out.done = true;
          go_to(9);
        } else if (moves == kMaxMoves) {
          fail();
        } else {
          ++moves;
          move_x_ = x;
          move_y_ = y;
          out.opening_mm += 8;
          go_to(3);
        }
        break;
      }
      case 3:  // open first, then move
        if (in.in_position && ++count_ > 3) {
          out.arm_x_mm += move_x_;
          out.arm_y_mm += move_y_;
          go_to(4);
        }
        break;
      case 4:
        if (in.in_position && ++count_ > 3) go_to(0);
        break;
      default:  // 9: finished
        break;
    }
  }

 private:
  void fail() {
    out.error = true;
    go_to(9);
  }
  void go_to(int step) {
    step_ = step;
    count_ = 0;
    if (step == 1) {
      readings_ = 0;
      sum_x_ = sum_y_ = 0;
    }
  }
  int step_ = 0, count_ = 0, readings_ = 0;
  float sum_x_ = 0, sum_y_ = 0, move_x_ = 0, move_y_ = 0;
};

/// Closes until the device reports that the object is gripped (setting 1012, gentle_on, is the recipe's level) and
/// keeps its grip while the object yields: closes again below gentle_off, and opens a little if the level exceeds the
/// recipe's.
class GentleGrasp {
 public:
  static constexpr float kFast_mm = 0.12F, kSlow_mm = 0.015F;  // per cycle
  static constexpr float kNearlyThere = 0.7F;                  // share of the recipe's level from which to close slowly
  static constexpr float kClosest_mm = 2;

  Outputs out;
  explicit GentleGrasp(float level_permille) : level_(level_permille) {}

  void cycle(const Inputs& in) {
    if (in.any_fault || !in.alive || !in.level_valid) return;
    switch (step_) {
      case 0:  // close
        out.opening_mm -= in.level_permille < kNearlyThere * level_ ? kFast_mm : kSlow_mm;
        if (in.gentle) step_ = 1;
        if (out.opening_mm < kClosest_mm) {  // no object
          out.error = true;
          step_ = 9;
        }
        break;
      case 1:  // hold
        out.done = true;
        if (!in.gentle) out.opening_mm -= kSlow_mm;
        if (in.level_permille > 1.15F * level_) out.opening_mm += kSlow_mm;
        break;
      default:  // 9: failed
        break;
    }
  }

 private:
  float level_;
  int step_ = 0;
};

}  // namespace gripper
