#include "firmware/loop/verdict.h"

namespace finsight {

FaultCode fault_of(const Observation& seen, bool hold_is_over, const FingerShape& shape, FaultCode lasting) {
  if (seen.image_fault == ImageFault::kFrozen) return FaultCode::kCameraFrozen;
  if (seen.image_fault == ImageFault::kMissing) return FaultCode::kCameraLost;
  if (seen.image_fault == ImageFault::kDark && hold_is_over) return FaultCode::kTooDark;
  if (seen.image_fault == ImageFault::kBright && hold_is_over) return FaultCode::kTooBright;
  if (seen.image_fault == ImageFault::kBlurred && seen.poses.seen_count() < kPlates) return FaultCode::kBlurred;
  if (hold_is_over) return FaultCode::kMarkersLost;
  if (seen.camera_moved) return FaultCode::kCameraMoved;
  return shape.fallback ? FaultCode::kSolverFailed : lasting;
}

}  // namespace finsight
