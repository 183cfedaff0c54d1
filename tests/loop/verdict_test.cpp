#include "firmware/loop/verdict.h"

#include <doctest/doctest.h>

using namespace finsight;

namespace {

Observation seen(ImageFault fault, int plates = kPlates, bool camera_moved = false) {
  Observation seen{.image_fault = fault};
  for (int p = 0; p < plates; ++p) seen.poses.seen[static_cast<std::size_t>(p)] = true;
  seen.camera_moved = camera_moved;
  return seen;
}

FingerShape shape(bool fallback) {
  FingerShape shape;
  shape.fallback = fallback;
  return shape;
}

}  // namespace

TEST_CASE("verdict: every fault of a frame has its code, and what explains another comes first") {
  struct Case {
    Observation seen;
    bool hold_is_over, fallback;
    FaultCode lasting, expected;
  };
  const Observation good = seen(ImageFault::kNone), moved = seen(ImageFault::kNone, kPlates, true);
  const FaultCode none = FaultCode::kNone, saved = FaultCode::kSavedSettings;
  for (const Case& c : {
           Case{good, false, false, none, none},
           Case{good, false, false, saved, saved},
           Case{good, false, true, saved, FaultCode::kSolverFailed},
           Case{moved, false, true, saved, FaultCode::kCameraMoved},
           Case{moved, true, false, none, FaultCode::kMarkersLost},
           Case{seen(ImageFault::kBlurred, 3), false, false, none, none},
           Case{seen(ImageFault::kBlurred, 2), false, false, none, FaultCode::kBlurred},
           Case{seen(ImageFault::kBlurred, 2), true, false, none, FaultCode::kBlurred},
           Case{seen(ImageFault::kDark, 0), false, false, none, none},
           Case{seen(ImageFault::kDark, 0), true, false, none, FaultCode::kTooDark},
           Case{seen(ImageFault::kBright, 0), true, false, none, FaultCode::kTooBright},
           Case{seen(ImageFault::kMissing, 0), true, true, saved, FaultCode::kCameraLost},
           Case{seen(ImageFault::kFrozen, 0), true, true, saved, FaultCode::kCameraFrozen},
       }) {
    CHECK(fault_of(c.seen, c.hold_is_over, shape(c.fallback), c.lasting) == c.expected);
  }
}
