// Fits dimensions and stiffness of a spec so that the simulated finger moves like the recorded one.
#pragma once

#include <functional>
#include <string>
#include <vector>

#include "firmware/ports/session.h"
#include "hostgen/finger/mesh.h"

namespace finsight::host {

/// A recorded push: the plates' motion when a point of the face had been pushed in by push_mm. Forces were not
/// recorded.
struct RecordedPush {
  Vec3f point_mm = Vec3f::Zero();  ///< on the face at rest
  double push_mm = 0;              ///< displacement of the point along the face's inward normal
  PlatePoses poses;                ///< relative to the same rest as push_mm
};

/// At most `points` contact points, spread over the file's, each at half of its largest push and at nearly all of it;
/// every push is the mean of the rows around it, outliers left out. Throws std::runtime_error if no point was pushed at
/// least 2 mm.
std::vector<RecordedPush> recorded_pushes(const RecordedMotion& motion, const FingerSpec& spec, std::size_t points);

struct IdentifiedNumber {
  std::string key;  ///< as in the spec
  double before = 0, after = 0;
  double sigma = 0;  ///< standard deviation of `after`, if the residuals are independent
  /// False: the pushes do not determine it (to 25 %), and it keeps its value.
  bool identifiable = false;
};
struct Identification {
  std::vector<IdentifiedNumber> numbers;
  /// RMS of the plate numbers' errors, rotations as the motion of a point 28.65 mm from the axis (half a mm per
  /// degree).
  double rms_before_mm = 0, rms_after_mm = 0;
  /// False: every number is the spec's; `why_unchanged` says why in words.
  bool changed = false;
  std::string why_unchanged;
  std::size_t pushes = 0, failed = 0;  ///< compared; left out, because no equilibrium was found
};

using MeshMaker = std::function<TetMesh(const FingerSpec&)>;

/// Fits front, back and side wall, base ring and Young's modulus (Gauss-Newton on their logarithms, derivatives by
/// differences, all cores, progress). Throws std::runtime_error if no push has an equilibrium, Interrupted.
Identification identify_spec(const FingerSpec& spec, const std::vector<RecordedPush>& pushes, const MeshMaker& make,
                             int iterations = 4);

}  // namespace finsight::host
