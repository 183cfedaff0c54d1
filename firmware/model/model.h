// The model pack, opened and checked: constant, typed, read-only views. Everything about one finger that does not
// depend on the frame. hostgen writes it; FrameLoop reads it.
#pragma once

#include <Eigen/Geometry>
#include <array>
#include <cstdint>
#include <filesystem>
#include <string>
#include <string_view>
#include <vector>

#include "firmware/model/safetensors.h"
#include "firmware/types.h"

namespace finsight {

/// Order and layout of the factorisation of the shape solver's Hessian, in 3x3 blocks (one per free node), computed
/// once by hostgen from the mesh alone. Columns and rows of the pattern and of L are elimination positions.
struct CholeskyPlan {
  int blocks = 0;                                 ///< free nodes
  std::span<const std::int32_t> order;            ///< [blocks] free node eliminated at each position
  std::span<const std::int32_t> pattern_start;    ///< [blocks + 1] where each column of pattern_row starts
  std::span<const std::int32_t> pattern_row;      ///< lower rows of each column, ascending, the diagonal first
  std::span<const std::int32_t> supernode_start;  ///< [supernodes + 1] first column of each supernode
  std::span<const std::int32_t> rows_start;       ///< [supernodes + 1] where each supernode's part of rows starts
  std::span<const std::int32_t> rows;             ///< rows below each supernode's diagonal block, ascending
};

/// The mesh and energy of the shape solver (symmetric Dirichlet, uniform sum over tets; paper, section 2.2).
struct ShapeModel {
  int nodes = 0, tets = 0;
  std::span<const float> rest_mm;             ///< [nodes, 3]
  std::span<const std::int32_t> tet_nodes;    ///< [tets, 4] positively oriented
  std::span<const std::uint8_t> node_kind;    ///< [nodes] 0 free, 1 base (fixed), 2 + p: rigid part of plate p
  std::span<const std::int32_t> free_index;   ///< [nodes] index among free nodes, -1 for the others
  std::span<const std::int32_t> front_nodes;  ///< [front]
  CholeskyPlan cholesky;
};

/// Regression from plate motions to a shape: x = rest + basis^T (weights * features(plates)), 20 microseconds.
/// Features: 1, the 18 scaled numbers, their 171 products. Gives the position of every node of the shape model.
struct ShapeMapModel {
  static constexpr int kFeatures = 1 + kPoseDims + kPoseDims * (kPoseDims + 1) / 2;
  int rank = 0;
  std::span<const float> scale;    ///< [kPoseDims] multiplies the PoseVector
  std::span<const float> weights;  ///< [rank, kFeatures]
  std::span<const float> basis;    ///< [rank, 3 * nodes]
  explicit operator bool() const { return rank > 0; }
};

/// A layer of the touch network as it was trained: y = weights x + bias.
struct DenseFloat {
  int inputs = 0, outputs = 0;
  std::span<const float> weights;  ///< [outputs, inputs]
  std::span<const float> bias;     ///< [outputs]
};

/// One that is rounded: y = scale .* (weights x) + bias; int8 weights with one scale per output.
struct DenseInt8 {
  int inputs = 0, outputs = 0;
  std::span<const std::int8_t> weights;  ///< [outputs, inputs]
  std::span<const float> scale;          ///< [outputs]
  std::span<const float> bias;           ///< [outputs]
};

/// Plate motions -> touch. Inputs: direction of the scaled 18 numbers, log of their size, log of each plate's noise and
/// of how much gravity is unknown. Outputs: point x y z and its displacement x y z (mm), force (normal, across, along;
/// N), its moment about the finger frame's origin x y z (N m); then the logarithms of the standard deviations of point,
/// force and moment; then the log-odds that a touch of the scene moved the plates so.
struct TouchModel {
  static constexpr int kInputs = kPoseDims + 2 + kPlates;  // direction, size, noise, gravity
  static constexpr int kMeans = 12;                        // point, displacement, force, moment
  static constexpr int kOutputs = 22;  // the means, a log-sigma each of point, force and moment, the log-odds
  static constexpr int kSeenPatterns = (1 << kPlates) - 1;
  std::span<const float> scale;         ///< [kPoseDims] mm or mm per rad, before taking the direction
  std::span<const float> input_mean;    ///< [kInputs]
  std::span<const float> input_scale;   ///< [kInputs] multiplies (input - mean)
  std::span<const float> output_mean;   ///< [kOutputs]
  std::span<const float> output_scale;  ///< [kOutputs] multiplies the network's output
  /// [knots, 3] plate motion (mm, ascending), a, b: the radius at that motion is exp(a) times the network's to the b,
  /// linear in between, constant beyond.
  std::span<const float> radius_curve;
  /// The radius network (radius_factor()), algebraic_silu() between its layers; it answers the logarithm of a factor of
  /// that radius.
  static constexpr int kRadiusFeatures = 11, kRadiusHidden = 32;
  static constexpr std::array kRadiusWidths = {kRadiusFeatures, kRadiusHidden, kRadiusHidden, 1};
  std::span<const float> radius_inputs;  ///< [kRadiusFeatures, 2] mean, and what multiplies (feature - mean)
  std::array<DenseFloat, kRadiusWidths.size() - 1> radius;
  /// [kSeenPatterns] factors of that radius where only some plates are seen, at seen_index(); the last is 1.
  std::span<const float> seen_factor;
  /// 23 -> 256 -> 256 -> 256 -> 256 -> 22, algebraic_silu() between. The first and the last layer hold 6 % of the
  /// weights; rounded, they would cause nearly all of the error of rounding.
  static constexpr std::size_t kRounded = 3;
  DenseFloat first, last;
  std::array<DenseInt8, kRounded> middle;
  std::span<const float>
      face_axes;              ///< [3, 3] unit vectors in the finger frame: the face's inward normal, across, along
  float threshold_mm = 0;     ///< plate motion below which a touch is invalid
  float range_mm = 0;         ///< plate motion beyond any trained touch: over range, no touch
  float explained_above = 0;  ///< log-odds below which the motion is unexplained, no touch
  float explained_above_unknown_g = 0;  ///< the same where gravity is not known
  std::span<const float> per_g;  ///< [kPoseDims, 3] plate motion for an acceleration of 1 g along x, y and z, at rest
  /// [kPoseDims, 3, kBentFeatures] how that changes as the finger bends: for a unit of each of bent_features().
  std::span<const float> per_g_change;
  /// How much fingers of this spec differ, as standard deviations: their stiffness (relative) and their markers'
  /// places. And by how much the same touch is located differently on them: the radius that holds 68 %.
  float stiffness_tolerance = 0, marker_tolerance_mm = 0, marker_tolerance_rad = 0, touch_tolerance_mm = 0;
  /// Plates of other fingers move a little otherwise under the same touch: each mm of motion counts as so many times
  /// the usual noise (PlatePoses::noise).
  float noise_per_mm = 0;
};

/// Of the plates of a bent finger: their motions, and these times the largest displacement of a plate in mm.
inline constexpr int kBentFeatures = 2 * kPoseDims;
template <class S>
Eigen::Matrix<S, kBentFeatures, 1> bent_features(const PoseVectorOf<S>& bent) {
  Eigen::Matrix<S, kBentFeatures, 1> features;
  features << bent, plate_motion_mm(bent) * bent;
  return features;
}

/// Gaussian over the pose vectors of touched fingers: decides between the two poses of a marker and completes plates
/// that are not seen.
struct PlatePrior {
  std::span<const float> mean;        ///< [kPoseDims]
  std::span<const float> covariance;  ///< [kPoseDims, kPoseDims] symmetric positive definite
  std::span<const float> noise;  ///< [kPoseDims] positive: standard deviation of a measured number, for noise of size 1
};

/// Where markers and camera are when nothing touches the finger.
struct MountModel {
  std::array<Eigen::Isometry3f, kPlates> T_finger_marker;
  Eigen::Isometry3f T_finger_camera;
  std::array<int, kPlates> marker_id{};
  float marker_size_mm = 0;
};

/// Poses with the answers that every build of the firmware must give.
struct SelfTestModel {
  int cases = 0;
  std::span<const float> poses;              ///< [cases, kPoseDims]
  std::span<const float> shape_mm;           ///< [cases, 3 * nodes] positions after the fixed schedule, from rest
  std::span<const float> touch;              ///< [cases, 7] point, contact, force
  std::span<const std::uint16_t> registers;  ///< [cases, kMeasurementRegisters]
  /// The same for the contact tier; empty in a pack without a contact map.
  std::span<const float> contact_shape_mm;
  std::span<const std::uint16_t> contact_registers;
};

class Model {
 public:
  /// Maps the file and checks every tensor (name, type, shape, index range, finiteness, agreement of sizes, checksum)
  /// before the first use. Throws InputError naming the tensor, what was found and what was expected.
  static Model open(const std::filesystem::path& file);

  std::string finger_name, scene, spec_sha256, hostgen_version;
  std::uint32_t checksum = 0;  ///< header_checksum() of the pack; changes with any byte of it; also in the registers
  float rated_deformation_mm = 0;
  MountModel mount;
  PlatePrior prior;
  ShapeModel shape;
  ShapeMapModel shape_map;    ///< to the shapes of the solver
  ShapeMapModel contact_map;  ///< to the finite-element shapes of touched fingers; rank 0 in older packs
  TouchModel touch;
  SelfTestModel self_test;
  const SafetensorsFile& file() const { return file_; }

 private:
  explicit Model(SafetensorsFile file) : file_(std::move(file)) {}
  SafetensorsFile file_;
  std::vector<std::int32_t> free_index_;  // what shape.free_index views
};

/// Names of the tensors, in one place for the reader, the writer and their tests.
namespace tensor {
inline constexpr const char* kRest = "shape.rest_mm";
inline constexpr const char* kTets = "shape.tet_nodes";
inline constexpr const char* kNodeKind = "shape.node_kind";
inline constexpr const char* kFrontNodes = "shape.front_nodes";
inline constexpr const char* kOrder = "cholesky.order";
inline constexpr const char* kPatternStart = "cholesky.pattern_start";
inline constexpr const char* kPatternRow = "cholesky.pattern_row";
inline constexpr const char* kSupernodeStart = "cholesky.supernode_start";
inline constexpr const char* kRowsStart = "cholesky.rows_start";
inline constexpr const char* kRows = "cholesky.rows";
/// The tensors of a shape map.
struct MapNames {
  const char *scale, *weights, *basis;
};
inline constexpr MapNames kShapeMap = {"map.scale", "map.weights", "map.basis"};
inline constexpr MapNames kContactMap = {"contact_map.scale", "contact_map.weights", "contact_map.basis"};
inline constexpr const char* kTouchScale = "touch.scale";
inline constexpr const char* kTouchInputMean = "touch.input_mean";
inline constexpr const char* kTouchInputScale = "touch.input_scale";
inline constexpr const char* kTouchOutputMean = "touch.output_mean";
inline constexpr const char* kTouchOutputScale = "touch.output_scale";
inline constexpr const char* kTouchRadiusCurve = "touch.radius_curve";
inline constexpr const char* kTouchRadiusInputs = "touch.radius_inputs";
inline constexpr const char* kTouchSeenFactor = "touch.seen_factor";
inline constexpr const char* kTouchFaceAxes = "touch.face_axes";              // [3, 3]
inline constexpr const char* kTouchPerG = "touch.motion_per_g";               // [kPoseDims, 3]
inline constexpr const char* kTouchPerGChange = "touch.motion_per_g_change";  // [kPoseDims, 3, kBentFeatures]
/// The tensors of a layer that is not rounded.
struct LayerNames {
  const char *weights, *bias;
};
inline constexpr LayerNames kTouchFirst = {"touch.first_weights", "touch.first_bias"};
inline constexpr LayerNames kTouchLast = {"touch.last_weights", "touch.last_bias"};
inline constexpr LayerNames kTouchRadius[] = {{"touch.radius_weights1", "touch.radius_bias1"},
                                              {"touch.radius_weights2", "touch.radius_bias2"},
                                              {"touch.radius_weights3", "touch.radius_bias3"}};
inline constexpr const char* kTouchWeights[] = {"touch.weights1", "touch.weights2", "touch.weights3"};
inline constexpr const char* kTouchWeightScale[] = {"touch.weight_scale1", "touch.weight_scale2",
                                                    "touch.weight_scale3"};
inline constexpr const char* kTouchBias[] = {"touch.bias1", "touch.bias2", "touch.bias3"};
inline constexpr const char* kPriorMean = "prior.mean";
inline constexpr const char* kPriorCovariance = "prior.covariance";
inline constexpr const char* kPriorNoise = "prior.noise";
inline constexpr const char* kMarkerPoses = "mount.T_finger_marker";  // [3, 4, 4]
inline constexpr const char* kCameraPose = "mount.T_finger_camera";   // [4, 4]
inline constexpr const char* kMarkerIds = "mount.marker_id";          // i32 [3]
inline constexpr const char* kSelfTestPoses = "self_test.poses";
inline constexpr const char* kSelfTestShape = "self_test.shape_mm";
inline constexpr const char* kSelfTestTouch = "self_test.touch";
inline constexpr const char* kSelfTestRegisters = "self_test.registers";
inline constexpr const char* kSelfTestContactShape = "self_test.contact_shape_mm";
inline constexpr const char* kSelfTestContactRegisters = "self_test.contact_registers";
}  // namespace tensor

/// Keys of the pack's metadata. Numbers are written in decimal.
namespace meta {
inline constexpr const char* kFormat = "finsight_pack";  // value kFormatVersion
inline constexpr const char* kFormatVersion = "9";
inline constexpr const char* kFinger = "finger";
inline constexpr const char* kScene = "scene";
inline constexpr const char* kSpecSha256 = "spec_sha256";
inline constexpr const char* kHostgenVersion = "hostgen_version";
inline constexpr const char* kNodes = "nodes";
inline constexpr const char* kTetCount = "tets";
inline constexpr const char* kMarkerSize = "marker_size_mm";
inline constexpr const char* kThreshold = "touch_threshold_mm";
inline constexpr const char* kRange = "touch_range_mm";
inline constexpr const char* kExplainedAbove = "touch_explained_above";
inline constexpr const char* kExplainedAboveUnknown_g = "touch_explained_above_unknown_g";
inline constexpr const char* kStiffnessTolerance = "stiffness_tolerance";
inline constexpr const char* kMarkerTolerance_mm = "marker_tolerance_mm";
inline constexpr const char* kMarkerTolerance_rad = "marker_tolerance_rad";
inline constexpr const char* kTouchTolerance_mm = "touch_tolerance_mm";
inline constexpr const char* kNoisePer_mm = "noise_per_mm";
inline constexpr const char* kRatedDeformation = "rated_deformation_mm";
inline constexpr const char* kTensorCrc = "crc32.";   // + tensor name: CRC-32 of its bytes, 8 hexadecimal digits
inline constexpr const char* kChecksum = "checksum";  // header_checksum(), 8 hexadecimal digits
}  // namespace meta

/// CRC-32 (IEEE 802.3). `seed`: the result for the preceding bytes.
std::uint32_t crc32(std::span<const std::byte> bytes, std::uint32_t seed = 0);
/// A checksum as it is written in the metadata: 8 lower-case hexadecimal digits.
std::string checksum_text(std::uint32_t checksum);
/// CRC-32 of a pack's JSON header (a multiple of 8 bytes, padding included) with the eight digits of
/// "checksum":"........" taken as zeros. The header holds the CRC-32 of every tensor, so this number covers the
/// whole pack. 0 if the header has no such text.
std::uint32_t header_checksum(std::string_view header);

/// The motions of all plates as a PoseVector, which is also the order in every tensor.
PoseVector pose_vector(const PlatePoses& poses);
/// Moves the plates further by `motion`, number by number.
void add_motion(const PoseVector& motion, PlatePoses& poses);
/// The inverse: all plates seen and fresh. numbers: [kPoseDims]
PlatePoses seen_poses(std::span<const float> numbers);

}  // namespace finsight
