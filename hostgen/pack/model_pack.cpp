#include "hostgen/pack/model_pack.h"

#include <array>
#include <charconv>

#include "hostgen/util/common.h"

namespace finsight::host {

namespace {

/// The shortest decimal that reads back as the same float.
std::string decimal(float value) {
  std::array<char, 32> text{};
  const auto [end, error] = std::to_chars(text.data(), text.data() + text.size(), value);
  return {text.data(), end};
}

std::vector<float> row_major(const Eigen::Isometry3f& T) {
  std::vector<float> values(16);
  Eigen::Map<Eigen::Matrix<float, 4, 4, Eigen::RowMajor>>(values.data()) = T.matrix();
  return values;
}

void add_shape(TensorFile& tensors, const ShapeModel& shape) {
  const auto list = [&](const char* name, std::span<const std::int32_t> values) {
    tensors.add(name, {static_cast<std::int64_t>(values.size())}, values);
  };
  tensors.add(tensor::kRest, {shape.nodes, 3}, shape.rest_mm);
  tensors.add(tensor::kTets, {shape.tets, 4}, shape.tet_nodes);
  tensors.add(tensor::kNodeKind, {shape.nodes}, shape.node_kind);
  list(tensor::kFrontNodes, shape.front_nodes);
  list(tensor::kOrder, shape.cholesky.order);
  list(tensor::kPatternStart, shape.cholesky.pattern_start);
  list(tensor::kPatternRow, shape.cholesky.pattern_row);
  list(tensor::kSupernodeStart, shape.cholesky.supernode_start);
  list(tensor::kRowsStart, shape.cholesky.rows_start);
  list(tensor::kRows, shape.cholesky.rows);
}

void add_shape_map(TensorFile& tensors, const tensor::MapNames& names, const ShapeMapModel& map, std::int64_t nodes) {
  tensors.add(names.scale, {kPoseDims}, map.scale);
  tensors.add(names.weights, {map.rank, ShapeMapModel::kFeatures}, map.weights);
  tensors.add(names.basis, {map.rank, 3 * nodes}, map.basis);
}

void add_layer(TensorFile& tensors, const tensor::LayerNames& names, const DenseFloat& layer) {
  tensors.add(names.weights, {layer.outputs, layer.inputs}, layer.weights);
  tensors.add(names.bias, {layer.outputs}, layer.bias);
}

void add_touch(TensorFile& tensors, const TouchModel& touch) {
  tensors.add(tensor::kTouchScale, {kPoseDims}, touch.scale);
  tensors.add(tensor::kTouchInputMean, {TouchModel::kInputs}, touch.input_mean);
  tensors.add(tensor::kTouchInputScale, {TouchModel::kInputs}, touch.input_scale);
  tensors.add(tensor::kTouchOutputMean, {TouchModel::kOutputs}, touch.output_mean);
  tensors.add(tensor::kTouchOutputScale, {TouchModel::kOutputs}, touch.output_scale);
  tensors.add(tensor::kTouchRadiusCurve, {static_cast<std::int64_t>(touch.radius_curve.size() / 3), 3},
              touch.radius_curve);
  tensors.add(tensor::kTouchRadiusInputs, {TouchModel::kRadiusFeatures, 2}, touch.radius_inputs);
  for (std::size_t i = 0; i < touch.radius.size(); ++i) add_layer(tensors, tensor::kTouchRadius[i], touch.radius[i]);
  tensors.add(tensor::kTouchSeenFactor, {TouchModel::kSeenPatterns}, touch.seen_factor);
  tensors.add(tensor::kTouchFaceAxes, {3, 3}, touch.face_axes);
  tensors.add(tensor::kTouchPerG, {kPoseDims, 3}, touch.per_g);
  tensors.add(tensor::kTouchPerGChange, {kPoseDims, 3, kBentFeatures}, touch.per_g_change);
  add_layer(tensors, tensor::kTouchFirst, touch.first);
  add_layer(tensors, tensor::kTouchLast, touch.last);
  for (std::size_t i = 0; i < TouchModel::kRounded; ++i) {
    const DenseInt8& layer = touch.middle[i];
    tensors.add(tensor::kTouchWeights[i], {layer.outputs, layer.inputs}, layer.weights);
    tensors.add(tensor::kTouchWeightScale[i], {layer.outputs}, layer.scale);
    tensors.add(tensor::kTouchBias[i], {layer.outputs}, layer.bias);
  }
}

void add_mount(TensorFile& tensors, const MountModel& mount) {
  std::vector<float> markers;
  for (const Eigen::Isometry3f& T : mount.T_finger_marker) {
    const std::vector<float> values = row_major(T);
    markers.insert(markers.end(), values.begin(), values.end());
  }
  tensors.add(tensor::kMarkerPoses, {kPlates, 4, 4}, markers);
  tensors.add(tensor::kCameraPose, {4, 4}, row_major(mount.T_finger_camera));
  tensors.add(tensor::kMarkerIds, {kPlates}, std::vector<std::int32_t>(mount.marker_id.begin(), mount.marker_id.end()));
}

void add_self_test(TensorFile& tensors, const SelfTestModel& self_test, std::int64_t nodes, bool has_contact_map) {
  tensors.add(tensor::kSelfTestPoses, {self_test.cases, kPoseDims}, self_test.poses);
  tensors.add(tensor::kSelfTestShape, {self_test.cases, 3 * nodes}, self_test.shape_mm);
  tensors.add(tensor::kSelfTestTouch, {self_test.cases, 7}, self_test.touch);
  tensors.add(tensor::kSelfTestRegisters, {self_test.cases, kMeasurementRegisters}, self_test.registers);
  if (!has_contact_map) return;
  tensors.add(tensor::kSelfTestContactShape, {self_test.cases, 3 * nodes}, self_test.contact_shape_mm);
  tensors.add(tensor::kSelfTestContactRegisters, {self_test.cases, kMeasurementRegisters}, self_test.contact_registers);
}

}  // namespace

TensorFile pack_tensors(const PackViews& views) {
  TensorFile tensors;
  tensors.metadata = views.notes;
  tensors.metadata[meta::kFormat] = std::string(meta::kFormatVersion);
  tensors.metadata[meta::kFinger] = views.finger_name;
  tensors.metadata[meta::kScene] = views.scene;
  tensors.metadata[meta::kSpecSha256] = views.spec_sha256;
  tensors.metadata[meta::kHostgenVersion] = views.hostgen_version;
  tensors.metadata[meta::kNodes] = std::to_string(views.shape.nodes);
  tensors.metadata[meta::kTetCount] = std::to_string(views.shape.tets);
  tensors.metadata[meta::kMarkerSize] = decimal(views.mount.marker_size_mm);
  tensors.metadata[meta::kThreshold] = decimal(views.touch.threshold_mm);
  tensors.metadata[meta::kRange] = decimal(views.touch.range_mm);
  tensors.metadata[meta::kExplainedAbove] = decimal(views.touch.explained_above);
  tensors.metadata[meta::kExplainedAboveUnknown_g] = decimal(views.touch.explained_above_unknown_g);
  tensors.metadata[meta::kStiffnessTolerance] = decimal(views.touch.stiffness_tolerance);
  tensors.metadata[meta::kMarkerTolerance_mm] = decimal(views.touch.marker_tolerance_mm);
  tensors.metadata[meta::kMarkerTolerance_rad] = decimal(views.touch.marker_tolerance_rad);
  tensors.metadata[meta::kTouchTolerance_mm] = decimal(views.touch.touch_tolerance_mm);
  tensors.metadata[meta::kNoisePer_mm] = decimal(views.touch.noise_per_mm);
  tensors.metadata[meta::kRatedDeformation] = decimal(views.rated_deformation_mm);

  add_shape(tensors, views.shape);
  add_shape_map(tensors, tensor::kShapeMap, views.shape_map, views.shape.nodes);
  if (views.contact_map) add_shape_map(tensors, tensor::kContactMap, views.contact_map, views.shape.nodes);
  add_touch(tensors, views.touch);
  tensors.add(tensor::kPriorMean, {kPoseDims}, views.prior.mean);
  tensors.add(tensor::kPriorCovariance, {kPoseDims, kPoseDims}, views.prior.covariance);
  tensors.add(tensor::kPriorNoise, {kPoseDims}, views.prior.noise);
  add_mount(tensors, views.mount);
  add_self_test(tensors, views.self_test, views.shape.nodes, bool{views.contact_map});
  return tensors;
}

std::string sealed_bytes(TensorFile tensors) {
  for (const TensorFile::Entry& entry : tensors.entries()) {
    tensors.metadata[meta::kTensorCrc + entry.name] = checksum_text(crc32(entry.data));
  }
  // The header's own checksum counts its digits as zeros, so they can be put in afterwards.
  const std::string zeros = checksum_text(0);
  std::string key = "\"";
  key.append(meta::kChecksum).append("\":\"");
  tensors.metadata[meta::kChecksum] = zeros;
  std::string file = tensors.bytes();
  std::uint64_t header_length = 0;
  std::memcpy(&header_length, file.data(), sizeof header_length);
  const std::string_view header(file.data() + sizeof header_length, header_length);
  const std::string checksum = checksum_text(header_checksum(header));
  return file.replace(file.find(key + zeros) + key.size(), zeros.size(), checksum);
}

void write_model_pack(const std::filesystem::path& file, const PackViews& views) {
  std::filesystem::path candidate = file;
  candidate += ".new";
  write_file_atomically(candidate, sealed_bytes(pack_tensors(views)));
  try {
    Model::open(candidate);
  } catch (...) {
    std::filesystem::remove(candidate);
    throw;
  }
  replace_file(candidate, file);
}

}  // namespace finsight::host
