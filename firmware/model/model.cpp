#include "firmware/model/model.h"

#include <algorithm>
#include <charconv>
#include <set>

#include "firmware/input_error.h"
#include "firmware/model/checks.h"

namespace finsight {

namespace {

// Far above any finger that a small board can solve at 60 frames/s; they bound the memory that a pack can claim.
constexpr std::int64_t kMaxNodes = 50'000, kMaxTets = 200'000, kMaxRank = 64, kMaxWidth = 4096, kMaxKnots = 64;
constexpr std::int64_t kMaxSelfTests = 64;

constexpr float kSmallestScale = 1e-9f, kLargestScale = 1e9f;
constexpr float kLargestRadiusWeight = 1e4F;  // keeps the network's sums finite
constexpr float kLargestKnot = 1000;          // of the radius curve: mm, or an exponent
constexpr float kLargestPerG = 100;           // mm or rad
constexpr float kLargestPerGChange = 1000;    // of that, per mm or rad

/// Reads tensors and metadata, and refuses tensors that were never asked for.
class PackReader {
 public:
  explicit PackReader(const SafetensorsFile& file) : file_(file) {}

  template <class T>
  std::span<const T> tensor(const char* name, std::initializer_list<std::int64_t> shape) {
    asked_.insert(name);
    return file_.tensor<T>(name, shape);
  }

  /// One length of a tensor's shape, within limits, for tensors whose size a pack may choose.
  std::int64_t length(const char* name, std::size_t dimension, std::int64_t lowest, std::int64_t highest) const {
    const std::vector<std::int64_t> shape = file_.shape(name);
    const std::int64_t found = dimension < shape.size() ? shape[dimension] : -1;
    if (found < lowest || found > highest) {
      file_.refuse(
          name, found < 0 ? "too few dimensions" : "length " + std::to_string(found),
          std::to_string(lowest) + " to " + std::to_string(highest) + " along dimension " + std::to_string(dimension));
    }
    return found;
  }

  template <class T>
  T number(const char* key, T lowest, T highest) const {
    const std::string& text = file_.metadata(key);
    T value{};
    const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
    const bool whole = error == std::errc() && end == text.data() + text.size();
    if (!whole || !(value >= lowest && value <= highest)) {
      refuse(key, text, "a number from " + std::to_string(lowest) + " to " + std::to_string(highest));
    }
    return value;
  }

  std::string name(const char* key) const {
    const std::string& text = file_.metadata(key);
    const auto printable = [](char c) { return c >= ' ' && c <= '~'; };
    if (text.empty() || text.size() > 64 || !std::all_of(text.begin(), text.end(), printable)) {
      refuse(key, std::to_string(text.size()) + " bytes", "1 to 64 printable ASCII characters");
    }
    return text;
  }

  std::string sha256(const char* key) const {
    const std::string& text = file_.metadata(key);
    if (text.size() != 64 || text.find_first_not_of("0123456789abcdef") != std::string::npos) {
      refuse(key, std::to_string(text.size()) + " characters", "64 lower-case hexadecimal digits");
    }
    return text;
  }

  /// Throws for every tensor that nobody asked for.
  void finish() const {
    for (const std::string& name : file_.names()) {
      if (!asked_.contains(name)) file_.refuse(name, "an unknown tensor", "known tensors only");
    }
  }

 private:
  [[noreturn]] void refuse(const std::string& key, const std::string& found, const std::string& expected) const {
    throw InputError(file_.path(), "metadata '" + key + "'", "\"" + found.substr(0, 60) + "\"", expected);
  }

  const SafetensorsFile& file_;
  std::set<std::string> asked_;
};

CholeskyPlan read_plan(PackReader& pack, std::int64_t blocks) {
  CholeskyPlan plan;
  plan.blocks = static_cast<int>(blocks);
  plan.order = pack.tensor<std::int32_t>(tensor::kOrder, {blocks});
  plan.pattern_start = pack.tensor<std::int32_t>(tensor::kPatternStart, {blocks + 1});
  plan.pattern_row = pack.tensor<std::int32_t>(tensor::kPatternRow, {-1});
  const std::int64_t starts = pack.length(tensor::kSupernodeStart, 0, 2, blocks + 1);
  plan.supernode_start = pack.tensor<std::int32_t>(tensor::kSupernodeStart, {starts});
  plan.rows_start = pack.tensor<std::int32_t>(tensor::kRowsStart, {starts});
  plan.rows = pack.tensor<std::int32_t>(tensor::kRows, {-1});
  return plan;
}

/// Fills `free_index` with the index of every free node and -1 for the others.
ShapeModel read_shape(PackReader& pack, std::vector<std::int32_t>& free_index) {
  const auto nodes = pack.number<std::int64_t>(meta::kNodes, 4, kMaxNodes);
  const auto tets = pack.number<std::int64_t>(meta::kTetCount, 1, kMaxTets);
  const std::int64_t front = pack.length(tensor::kFrontNodes, 0, 1, nodes);
  ShapeModel shape;
  shape.nodes = static_cast<int>(nodes);
  shape.tets = static_cast<int>(tets);
  shape.rest_mm = pack.tensor<float>(tensor::kRest, {nodes, 3});
  shape.tet_nodes = pack.tensor<std::int32_t>(tensor::kTets, {tets, 4});
  shape.node_kind = pack.tensor<std::uint8_t>(tensor::kNodeKind, {nodes});
  shape.front_nodes = pack.tensor<std::int32_t>(tensor::kFrontNodes, {front});

  std::int32_t blocks = 0;
  for (const std::uint8_t kind : shape.node_kind) free_index.push_back(kind == 0 ? blocks++ : -1);
  shape.free_index = free_index;
  shape.cholesky = read_plan(pack, blocks);
  return shape;
}

ShapeMapModel read_shape_map(PackReader& pack, const tensor::MapNames& names, std::int64_t nodes) {
  const std::int64_t rank = pack.length(names.weights, 0, 1, kMaxRank);
  ShapeMapModel map;
  map.rank = static_cast<int>(rank);
  map.scale = pack.tensor<float>(names.scale, {kPoseDims});
  map.weights = pack.tensor<float>(names.weights, {rank, ShapeMapModel::kFeatures});
  map.basis = pack.tensor<float>(names.basis, {rank, 3 * nodes});
  return map;
}

/// Older packs have none. If any of its tensors is there, all must be.
bool has_contact_map(const SafetensorsFile& file) {
  const char* const parts[] = {tensor::kContactMap.scale, tensor::kContactMap.weights, tensor::kContactMap.basis,
                               tensor::kSelfTestContactShape, tensor::kSelfTestContactRegisters};
  return std::any_of(std::begin(parts), std::end(parts), [&](const char* name) { return file.has(name); });
}

DenseFloat read_layer(PackReader& pack, const tensor::LayerNames& names, std::int64_t inputs, std::int64_t outputs) {
  return {static_cast<int>(inputs), static_cast<int>(outputs), pack.tensor<float>(names.weights, {outputs, inputs}),
          pack.tensor<float>(names.bias, {outputs})};
}

void read_layers(PackReader& pack, TouchModel& touch) {
  std::int64_t inputs = pack.length(tensor::kTouchFirst.bias, 0, 1, kMaxWidth);
  touch.first = read_layer(pack, tensor::kTouchFirst, TouchModel::kInputs, inputs);
  for (std::size_t i = 0; i < TouchModel::kRounded; ++i) {
    const std::int64_t outputs = pack.length(tensor::kTouchBias[i], 0, 1, kMaxWidth);
    touch.middle[i] = {static_cast<int>(inputs), static_cast<int>(outputs),
                       pack.tensor<std::int8_t>(tensor::kTouchWeights[i], {outputs, inputs}),
                       pack.tensor<float>(tensor::kTouchWeightScale[i], {outputs}),
                       pack.tensor<float>(tensor::kTouchBias[i], {outputs})};
    inputs = outputs;
  }
  touch.last = read_layer(pack, tensor::kTouchLast, inputs, TouchModel::kOutputs);
}

TouchModel read_touch(PackReader& pack) {
  TouchModel touch;
  touch.scale = pack.tensor<float>(tensor::kTouchScale, {kPoseDims});
  touch.input_mean = pack.tensor<float>(tensor::kTouchInputMean, {TouchModel::kInputs});
  touch.input_scale = pack.tensor<float>(tensor::kTouchInputScale, {TouchModel::kInputs});
  touch.output_mean = pack.tensor<float>(tensor::kTouchOutputMean, {TouchModel::kOutputs});
  touch.output_scale = pack.tensor<float>(tensor::kTouchOutputScale, {TouchModel::kOutputs});
  const std::int64_t knots = pack.length(tensor::kTouchRadiusCurve, 0, 1, kMaxKnots);
  touch.radius_curve = pack.tensor<float>(tensor::kTouchRadiusCurve, {knots, 3});
  touch.radius_inputs = pack.tensor<float>(tensor::kTouchRadiusInputs, {TouchModel::kRadiusFeatures, 2});
  for (std::size_t i = 0; i < touch.radius.size(); ++i) {
    touch.radius[i] =
        read_layer(pack, tensor::kTouchRadius[i], TouchModel::kRadiusWidths[i], TouchModel::kRadiusWidths[i + 1]);
  }
  touch.seen_factor = pack.tensor<float>(tensor::kTouchSeenFactor, {TouchModel::kSeenPatterns});
  touch.face_axes = pack.tensor<float>(tensor::kTouchFaceAxes, {3, 3});
  touch.per_g = pack.tensor<float>(tensor::kTouchPerG, {kPoseDims, 3});
  touch.per_g_change = pack.tensor<float>(tensor::kTouchPerGChange, {kPoseDims, 3, kBentFeatures});
  read_layers(pack, touch);
  touch.threshold_mm = pack.number<float>(meta::kThreshold, 0.01f, 50);
  touch.range_mm = pack.number<float>(meta::kRange, touch.threshold_mm, 1000);
  touch.explained_above = pack.number<float>(meta::kExplainedAbove, -1e6F, 1e6F);
  touch.explained_above_unknown_g = pack.number<float>(meta::kExplainedAboveUnknown_g, -1e6F, 1e6F);
  touch.stiffness_tolerance = pack.number<float>(meta::kStiffnessTolerance, 0, 1);
  touch.marker_tolerance_mm = pack.number<float>(meta::kMarkerTolerance_mm, 0, 10);
  touch.marker_tolerance_rad = pack.number<float>(meta::kMarkerTolerance_rad, 0, 1);
  touch.touch_tolerance_mm = pack.number<float>(meta::kTouchTolerance_mm, 0, 100);
  touch.noise_per_mm = pack.number<float>(meta::kNoisePer_mm, 0, 10);
  return touch;
}

/// A row-major 4x4 matrix as a rigid motion; refuses anything else.
Eigen::Isometry3f read_rigid(const SafetensorsFile& file, const char* name, std::span<const float> values) {
  constexpr float kRigidTolerance = 1e-4f, kReach_mm = 1000;
  const Eigen::Matrix4f T = Eigen::Map<const Eigen::Matrix<float, 4, 4, Eigen::RowMajor>>(values.data());
  const Eigen::Matrix3f R = T.topLeftCorner<3, 3>();
  const bool orthonormal = (R.transpose() * R - Eigen::Matrix3f::Identity()).cwiseAbs().maxCoeff() < kRigidTolerance;
  const bool last_row = T.row(3) == Eigen::RowVector4f(0, 0, 0, 1);
  if (!orthonormal || R.determinant() < 0 || !last_row) {
    file.refuse(name, "a matrix that is not a rigid motion", "rotation and translation with last row 0 0 0 1");
  }
  if (T.col(3).head<3>().norm() > kReach_mm) file.refuse(name, "a translation over 1 m", "millimetres within a finger");
  return Eigen::Isometry3f(T);
}

MountModel read_mount(PackReader& pack, const SafetensorsFile& file) {
  MountModel mount;
  const auto markers = pack.tensor<float>(tensor::kMarkerPoses, {kPlates, 4, 4});
  const auto ids = pack.tensor<std::int32_t>(tensor::kMarkerIds, {kPlates});
  for (std::size_t p = 0; p < kPlates; ++p) {
    mount.T_finger_marker[p] = read_rigid(file, tensor::kMarkerPoses, markers.subspan(16 * p, 16));
    mount.marker_id[p] = ids[p];
  }
  mount.T_finger_camera = read_rigid(file, tensor::kCameraPose, pack.tensor<float>(tensor::kCameraPose, {4, 4}));
  mount.marker_size_mm = pack.number<float>(meta::kMarkerSize, 0.5f, 100);
  return mount;
}

SelfTestModel read_self_test(PackReader& pack, std::int64_t nodes, bool with_contact_map) {
  const std::int64_t cases = pack.length(tensor::kSelfTestPoses, 0, 1, kMaxSelfTests);
  SelfTestModel self_test;
  self_test.cases = static_cast<int>(cases);
  self_test.poses = pack.tensor<float>(tensor::kSelfTestPoses, {cases, kPoseDims});
  self_test.shape_mm = pack.tensor<float>(tensor::kSelfTestShape, {cases, 3 * nodes});
  self_test.touch = pack.tensor<float>(tensor::kSelfTestTouch, {cases, 7});
  self_test.registers = pack.tensor<std::uint16_t>(tensor::kSelfTestRegisters, {cases, kMeasurementRegisters});
  if (with_contact_map) {
    self_test.contact_shape_mm = pack.tensor<float>(tensor::kSelfTestContactShape, {cases, 3 * nodes});
    self_test.contact_registers =
        pack.tensor<std::uint16_t>(tensor::kSelfTestContactRegisters, {cases, kMeasurementRegisters});
  }
  return self_test;
}

void check_face_axes(const SafetensorsFile& file, std::span<const float> numbers) {
  constexpr float kTolerance = 1e-3F;
  const Eigen::Map<const Eigen::Matrix3f> axes(numbers.data());
  const float error = (axes.transpose() * axes - Eigen::Matrix3f::Identity()).cwiseAbs().maxCoeff();
  if (error < kTolerance) return;
  file.refuse(tensor::kTouchFaceAxes,
              "directions that differ from perpendicular unit vectors by " + std::to_string(error),
              "three perpendicular unit vectors");
}

/// Plate motions must rise; logarithms of factors and exponents must be within bounds.
void check_radius_curve(const SafetensorsFile& file, std::span<const float> curve) {
  check_range(file, tensor::kTouchRadiusCurve, curve, -kLargestKnot, kLargestKnot);
  for (std::size_t i = 3; i < curve.size(); i += 3) {
    if (curve[i] <= curve[i - 3]) {
      file.refuse(tensor::kTouchRadiusCurve,
                  "plate motion " + std::to_string(curve[i]) + " mm at knot " + std::to_string(i / 3),
                  "more than the knot before");
    }
  }
}

void check_scales(const SafetensorsFile& file, const Model& model) {
  const auto positive = [&](const char* name, std::span<const float> values) {
    check_range(file, name, values, kSmallestScale, kLargestScale);
  };
  positive(tensor::kShapeMap.scale, model.shape_map.scale);
  positive(tensor::kContactMap.scale, model.contact_map.scale);
  positive(tensor::kTouchScale, model.touch.scale);
  positive(tensor::kTouchInputScale, model.touch.input_scale);
  positive(tensor::kTouchOutputScale, model.touch.output_scale);
  check_radius_curve(file, model.touch.radius_curve);
  const auto bounded = [&](const char* name, std::span<const float> values) {
    check_range(file, name, values, -kLargestRadiusWeight, kLargestRadiusWeight);
  };
  bounded(tensor::kTouchRadiusInputs, model.touch.radius_inputs);
  for (std::size_t i = 0; i < model.touch.radius.size(); ++i) {
    bounded(tensor::kTouchRadius[i].weights, model.touch.radius[i].weights);
    bounded(tensor::kTouchRadius[i].bias, model.touch.radius[i].bias);
  }
  positive(tensor::kTouchSeenFactor, model.touch.seen_factor);
  check_face_axes(file, model.touch.face_axes);
  check_range(file, tensor::kTouchPerG, model.touch.per_g, -kLargestPerG, kLargestPerG);
  check_range(file, tensor::kTouchPerGChange, model.touch.per_g_change, -kLargestPerGChange, kLargestPerGChange);
  for (std::size_t i = 0; i < TouchModel::kRounded; ++i) {
    check_range(file, tensor::kTouchWeightScale[i], model.touch.middle[i].scale, 0, kLargestScale);
  }
}

}  // namespace

Model Model::open(const std::filesystem::path& path) {
  Model model(SafetensorsFile::open(path));
  const SafetensorsFile& file = model.file_;
  model.checksum = check_integrity(file);

  // Types, shapes and sizes: after this every span has the length that its comment states.
  PackReader pack(file);
  model.finger_name = pack.name(meta::kFinger);
  model.scene = pack.name(meta::kScene);
  model.spec_sha256 = pack.sha256(meta::kSpecSha256);
  model.hostgen_version = pack.name(meta::kHostgenVersion);
  model.rated_deformation_mm = pack.number<float>(meta::kRatedDeformation, 0.1f, 200);
  model.shape = read_shape(pack, model.free_index_);
  model.shape_map = read_shape_map(pack, tensor::kShapeMap, model.shape.nodes);
  const bool with_contact_map = has_contact_map(file);
  if (with_contact_map) model.contact_map = read_shape_map(pack, tensor::kContactMap, model.shape.nodes);
  model.touch = read_touch(pack);
  model.prior.mean = pack.tensor<float>(tensor::kPriorMean, {kPoseDims});
  model.prior.covariance = pack.tensor<float>(tensor::kPriorCovariance, {kPoseDims, kPoseDims});
  model.prior.noise = pack.tensor<float>(tensor::kPriorNoise, {kPoseDims});
  model.mount = read_mount(pack, file);
  model.self_test = read_self_test(pack, model.shape.nodes, with_contact_map);
  pack.finish();

  // Values that the stages rely on without checking.
  check_mesh(file, model.shape);
  check_plan(file, model.shape);
  check_scales(file, model);
  check_prior(file, model.prior);
  check_mount(file, model.mount);
  check_self_test_values(file, model.self_test);
  return model;
}

void add_motion(const PoseVector& motion, PlatePoses& poses) {
  for (int p = 0; p < kPlates; ++p) {
    PlateMotion& plate = poses.plates[static_cast<std::size_t>(p)];
    plate.displacement_mm += motion.segment<3>(6 * p);
    plate.rotation_rad += motion.segment<3>(6 * p + 3);
  }
}

PlatePoses seen_poses(std::span<const float> numbers) {
  PlatePoses poses;
  for (std::size_t p = 0; p < kPlates; ++p) {
    poses.plates[p].displacement_mm = Eigen::Map<const Vec3f>(&numbers[6 * p]);
    poses.plates[p].rotation_rad = Eigen::Map<const Vec3f>(&numbers[6 * p + 3]);
    poses.seen[p] = true;
  }
  poses.quality = Quality::kFresh;
  return poses;
}

PoseVector pose_vector(const PlatePoses& poses) {
  PoseVector numbers;
  for (int p = 0; p < kPlates; ++p) {
    const PlateMotion& plate = poses.plates[static_cast<std::size_t>(p)];
    numbers.segment<3>(6 * p) = plate.displacement_mm;
    numbers.segment<3>(6 * p + 3) = plate.rotation_rad;
  }
  return numbers;
}

}  // namespace finsight
