// The nouns of the data path. Whoever reads this header and FrameLoop::step has read the product.
//
//   Frame -> Observation -> (zero) -> (hold) -> Touch -> FingerShape -> (verdict) -> RegisterImage -> PLC
//
// Units: millimetres, newtons, radians, pixels, nanoseconds. Finger frame: x across the finger, y up from its base,
// z into the finger from the touched (front) face. Every noun has a fixed size or views memory that FrameLoop owns,
// so that no stage allocates.
#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <array>
#include <chrono>
#include <cstdint>
#include <optional>
#include <span>

namespace finsight {

using Vec2f = Eigen::Vector2f;
using Vec3f = Eigen::Vector3f;

/// The three rigid plates that carry a marker each, in the order of the registers and of every array over plates.
inline constexpr int kPlates = 3;
enum Plate : int { kTopPlate = 0, kMiddlePlate = 1, kLowPlate = 2 };
/// As files and messages call them.
inline constexpr std::array<const char*, kPlates> kPlateNames = {"top", "middle", "low"};

/// The motions of all plates as one vector: for each plate (top, middle, low) its displacement x y z in mm, then its
/// rotation vector x y z in radians.
inline constexpr int kPoseDims = 6 * kPlates;
template <class S>
using PoseVectorOf = Eigen::Matrix<S, kPoseDims, 1>;
using PoseVector = PoseVectorOf<float>;

inline constexpr std::int64_t kNsPerMs = 1'000'000, kNsPerS = 1'000'000'000;

/// The clock of every time stamp here: nanoseconds, monotonic, not wall time.
inline std::int64_t steady_now_ns() {
  return std::chrono::duration_cast<std::chrono::nanoseconds>(std::chrono::steady_clock::now().time_since_epoch())
      .count();
}

/// How much a value may be trusted: measured from this frame, repeated from an earlier one, or not to be used.
enum class Quality : std::uint8_t { kInvalid, kHeld, kFresh };

/// One rigid plate's motion away from its rest pose, in the finger frame: a point X of the undeformed plate is now at
/// R (X - c) + c + displacement_mm, where c is the marker's centre at rest and R = exp(rotation_rad).
struct PlateMotion {
  Vec3f displacement_mm = Vec3f::Zero();
  Vec3f rotation_rad = Vec3f::Zero();  ///< rotation vector: axis times angle
};

/// How far the plate has moved that has moved furthest.
inline float plate_motion_mm(const std::array<PlateMotion, kPlates>& plates) {
  float furthest_mm = 0;
  for (const PlateMotion& plate : plates) furthest_mm = std::max(furthest_mm, plate.displacement_mm.norm());
  return furthest_mm;
}
template <class S>
S plate_motion_mm(const PoseVectorOf<S>& plates) {
  S furthest_mm = 0;
  for (int p = 0; p < kPlates; ++p) furthest_mm = std::max(furthest_mm, plates.template segment<3>(6 * p).norm());
  return furthest_mm;
}

struct PlatePoses {
  std::array<PlateMotion, kPlates> plates;
  /// False: that plate's motion is completed from the seen ones by the model's prior.
  std::array<bool, kPlates> seen{};
  std::array<float, kPlates> reprojection_px{};  ///< RMS distance of the corners from their reprojection
  /// Of seen plates: the measurement's standard deviation, relative to the pack's (PlatePrior::noise).
  std::array<float, kPlates> noise{1, 1, 1};
  Quality quality = Quality::kInvalid;

  int seen_count() const { return int{seen[0]} + int{seen[1]} + int{seen[2]}; }
};

/// How grey levels stand for light: in proportion, or by the curve of IEC 61966-2-1, as most cameras code pictures
/// that are made to be looked at. Blurred edges of coded pictures lie elsewhere, and a marker seems larger.
enum class Coding : std::uint8_t { kLinear, kSrgb };

/// What the camera delivers: a grey image, 8 bit, borrowed and valid during one step.
struct Frame {
  const std::uint8_t* grey = nullptr;
  int width_px = 0;
  int height_px = 0;
  int stride_bytes = 0;
  std::int64_t exposure_ns = 0;  ///< middle of the exposure on the steady clock
  std::uint32_t sequence = 0;    ///< camera's frame counter; a gap means dropped frames
  Coding coding = Coding::kLinear;
};

/// The four corners of each plate's marker, clockwise from its top left corner, in distorted image pixels.
struct MarkerCorners {
  std::array<std::array<Vec2f, 4>, kPlates> corners_px;
  std::array<bool, kPlates> seen{};
};

/// What is wrong with an image as such; missing: none came in time.
enum class ImageFault : std::uint8_t { kNone, kMissing, kFrozen, kDark, kBright, kBlurred };

/// How well one rigid motion of the whole finger explains all corners that are seen.
struct RigidMotionFit {
  double size_mm = 0;          ///< length of the 18 numbers (mm, and 28.65 mm per rad): 1 mm per plate is 1.7
  double reprojection_px = 0;  ///< RMS distance of all seen corners from where that motion puts them
  /// Square of the angle (rad) by which they are off on average, less what their scatter makes of it; may be negative.
  double unexplained_sq = 0;
};

/// Where the plates are when nothing touches the finger, as motions from the model's rest.
using ZeroPose = std::array<PlateMotion, kPlates>;

/// What one frame tells about the plates: seen by the vision stages, or recorded and replayed.
struct Observation {
  std::int64_t exposure_ns = 0;  ///< of the frame; the moment of asking where none came
  std::uint32_t sequence = 0;    ///< of the frame
  ImageFault image_fault = ImageFault::kNone;
  PlatePoses poses{};  ///< motions from the model's rest, after FrameLoop's zero from the zero
  std::optional<RigidMotionFit> rigid_motion{};  ///< from the zero; where all plates are seen by a camera
  // What the frames before this one add to it, in FrameLoop's zero.
  bool moved_as_one = false;  ///< the plates of this frame moved as one rigid body, which no touch can cause
  bool camera_moved = false;  ///< they have done so for long: camera or finger were knocked
  float shaken_mm = 0;        ///< see Shake
  /// Standard deviation, along each axis, of an acceleration (gravity included) that bends the finger and that the
  /// poses are not corrected for; in g. See GravityCorrection.
  float unknown_g = 0;
  bool is_from_rest = false;  ///< the poses are relative to this finger's own rest, not to the model's
};

/// Which model made the shape ("model only what a scene needs").
enum class ShapeSource : std::uint8_t { kRest, kMap, kNewton, kContactMap };

/// Where every node of the finger's mesh is.
struct FingerShape {
  std::span<const float> node_mm;  ///< [3 * nodes], x y z of every node; owned by the shape stage
  float front_rms_mm = 0;          ///< RMS displacement of the front face: the deformation
  float largest_mm = 0;            ///< largest displacement of any node
  float rms_mm = 0;                ///< RMS displacement of all nodes
  int iterations = 0;              ///< Newton steps (factorisations and chord steps) used for this frame
  ShapeSource source = ShapeSource::kRest;
  bool fallback = false;  ///< the solve failed and the shape map answered instead
  Quality quality = Quality::kInvalid;
};

/// Where and how hard the finger is touched.
struct Touch {
  Vec3f point_mm = Vec3f::Zero();    ///< the touched point of the undeformed front face
  Vec3f contact_mm = Vec3f::Zero();  ///< where that point is now: point plus its displacement
  float radius_68_mm = 0;            ///< 68 % of the errors of point_mm are smaller
  float force_n = 0;                 ///< normal to the face
  float force_sigma_n = 0;           ///< standard deviation of force_n
  // Of these, components that the plates do not tell are NaN, with their deviations.
  Vec3f force_vector_n = Vec3f::Zero(), force_vector_sigma_n = Vec3f::Zero();  ///< normal, across, along the face
  Vec3f wrench_force_n = Vec3f::Zero(), wrench_force_sigma_n = Vec3f::Zero();  ///< the same in the finger frame
  Vec3f moment_nm = Vec3f::Zero(), moment_sigma_nm = Vec3f::Zero();  ///< of that force about the finger frame's origin
  float plate_motion_mm = 0;  ///< largest displacement of a plate: what decides whether a touch can be located
  bool over_range = false;    ///< the plates moved further than any trained touch moves them
  /// Log-odds, as the network was trained, that a touch of its scene moved the plates so.
  float explained = 0;
  bool unexplained = false;             ///< too low: something else moved them, and this is no touch
  Quality quality = Quality::kInvalid;  ///< invalid below the model's threshold of plate motion and over range
};

/// What a Modbus client reads: 16-bit registers exactly as they go on the wire, and the time that their age counts
/// from.
inline constexpr int kMeasurementRegisters = 85;
inline constexpr int kProcessRegisters = 25;  ///< from 1110 on
struct RegisterImage {
  std::array<std::uint16_t, kMeasurementRegisters> words{};
  std::array<std::uint16_t, kProcessRegisters> process{};
  std::int64_t exposure_ns = 0;
};

}  // namespace finsight
