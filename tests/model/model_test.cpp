// Model::open: what it reads from a good pack; names, types, shapes and texts that it refuses.
#include "firmware/model/model.h"

#include <doctest/doctest.h>

#include <optional>

#include "tests/model/hostile_pack.h"

using namespace finsight;
using namespace finsight::test;
using host::TensorFile;

namespace {

template <class T>
bool same(std::span<const T> found, const std::vector<T>& expected) {
  return std::equal(found.begin(), found.end(), expected.begin(), expected.end());
}

/// The tensors of a tiny model, one of them replaced, or left out if there is no replacement.
TensorFile tensors_with(const std::string& name, std::optional<TensorFile::Entry> replacement) {
  const TensorFile good = host::pack_tensors(TinyModel().views());
  TensorFile changed;
  changed.metadata = good.metadata;
  bool found = false;
  for (const TensorFile::Entry& entry : good.entries()) {
    if (entry.name != name) changed.add(entry);
    found |= entry.name == name;
  }
  REQUIRE(found);
  if (replacement) changed.add(*replacement);
  return changed;
}

template <class T>
TensorFile::Entry zeros(const std::string& name, std::vector<std::int64_t> shape) {
  std::size_t bytes = sizeof(T);
  for (const std::int64_t length : shape) bytes *= static_cast<std::size_t>(length);
  return {name, dtype_of<T>(), std::move(shape), std::vector<std::byte>(bytes)};
}

}  // namespace

TEST_CASE("model: gives back every part of the pack") {
  const ScratchFolder folder;
  const TinyModel tiny;
  tiny.write(folder / "pack");
  Model opened = Model::open(folder / "pack");
  const Model model = std::move(opened);  // views must survive a move

  CHECK(model.finger_name == "tiny");
  CHECK(model.scene == "grasp");
  CHECK(model.spec_sha256 == std::string(64, 'a'));
  CHECK(model.hostgen_version == "0.0.0");
  CHECK(model.rated_deformation_mm == 10);
  CHECK(model.shape.nodes == 42);
  CHECK(model.shape.tets == 72);
  CHECK(same(model.shape.rest_mm, tiny.rest_mm));
  CHECK(same(model.shape.tet_nodes, tiny.tet_nodes));
  CHECK(same(model.shape.node_kind, tiny.node_kind));
  CHECK(same(model.shape.free_index, tiny.free_index));
  CHECK(same(model.shape.front_nodes, tiny.front_nodes));
  CHECK(model.shape.cholesky.blocks == 27);
  CHECK(same(model.shape.cholesky.order, tiny.order));
  CHECK(same(model.shape.cholesky.pattern_start, tiny.pattern_start));
  CHECK(same(model.shape.cholesky.pattern_row, tiny.pattern_row));
  CHECK(same(model.shape.cholesky.supernode_start, tiny.supernode_start));
  CHECK(same(model.shape.cholesky.rows_start, tiny.rows_start));
  CHECK(same(model.shape.cholesky.rows, tiny.rows));
  CHECK(model.shape_map.rank == 2);
  CHECK(same(model.shape_map.scale, tiny.map_scale));
  CHECK(same(model.shape_map.weights, tiny.map_weights));
  CHECK(same(model.shape_map.basis, tiny.map_basis));
  CHECK(model.contact_map.rank == 2);
  CHECK(same(model.contact_map.scale, tiny.map_scale));
  CHECK(same(model.contact_map.weights, tiny.map_weights));
  CHECK(same(model.contact_map.basis, tiny.contact_basis));
  CHECK(same(model.touch.scale, tiny.touch_scale));
  CHECK(same(model.touch.input_mean, tiny.input_mean));
  CHECK(same(model.touch.input_scale, tiny.input_scale));
  CHECK(same(model.touch.output_mean, tiny.output_mean));
  CHECK(same(model.touch.output_scale, tiny.output_scale));
  CHECK(same(model.touch.radius_curve, tiny.radius_curve));
  CHECK(same(model.touch.radius_inputs, tiny.radius_inputs));
  for (std::size_t i = 0; i < TinyModel::kRadiusLayers; ++i) {
    CHECK(model.touch.radius[i].inputs == TouchModel::kRadiusWidths[i]);
    CHECK(model.touch.radius[i].outputs == TouchModel::kRadiusWidths[i + 1]);
    CHECK(same(model.touch.radius[i].weights, tiny.radius_weights[i]));
    CHECK(same(model.touch.radius[i].bias, tiny.radius_bias[i]));
  }
  CHECK(same(model.touch.seen_factor, tiny.seen_factor));
  CHECK(model.touch.first.inputs * model.touch.first.outputs == static_cast<int>(tiny.first_weights.size()));
  CHECK(same(model.touch.first.weights, tiny.first_weights));
  CHECK(same(model.touch.first.bias, tiny.first_bias));
  for (std::size_t i = 0; i < TouchModel::kRounded; ++i) {
    CHECK(model.touch.middle[i].inputs * model.touch.middle[i].outputs == static_cast<int>(tiny.weights[i].size()));
    CHECK(same(model.touch.middle[i].weights, tiny.weights[i]));
    CHECK(same(model.touch.middle[i].scale, tiny.weight_scale[i]));
    CHECK(same(model.touch.middle[i].bias, tiny.bias[i]));
  }
  CHECK(model.touch.last.inputs * model.touch.last.outputs == static_cast<int>(tiny.last_weights.size()));
  CHECK(same(model.touch.last.weights, tiny.last_weights));
  CHECK(same(model.touch.last.bias, tiny.last_bias));
  CHECK(model.touch.threshold_mm == 2);
  CHECK(model.touch.range_mm == 40);
  CHECK(same(model.prior.mean, tiny.prior_mean));
  CHECK(same(model.prior.covariance, tiny.prior_covariance));
  CHECK(same(model.prior.noise, tiny.prior_noise));
  CHECK(model.mount.marker_id == std::array{3, 1, 4});
  CHECK(model.mount.marker_size_mm == 8);
  CHECK(model.mount.T_finger_camera.matrix() == tiny.parts.mount.T_finger_camera.matrix());
  for (std::size_t p = 0; p < 3; ++p) {
    CHECK(model.mount.T_finger_marker[p].matrix() == tiny.parts.mount.T_finger_marker[p].matrix());
  }
  CHECK(model.self_test.cases == 2);
  CHECK(same(model.self_test.poses, tiny.test_poses));
  CHECK(same(model.self_test.shape_mm, tiny.test_shape_mm));
  CHECK(same(model.self_test.touch, tiny.test_touch));
  CHECK(same(model.self_test.registers, tiny.test_registers));
  CHECK(same(model.self_test.contact_shape_mm, tiny.test_contact_shape_mm));
  CHECK(same(model.self_test.contact_registers, tiny.test_contact_registers));
}

TEST_CASE("model: refuses every tensor that is missing, by name") {
  const ScratchFolder folder;
  const TensorFile tensors = host::pack_tensors(TinyModel().views());
  for (const TensorFile::Entry& entry : tensors.entries()) {
    const std::string bytes = host::sealed_bytes(tensors_with(entry.name, std::nullopt));
    const std::string reason = "tensor '" + entry.name + "': found nothing, expected a tensor of this name";
    CHECK(refusal(folder, bytes) == doctest::Contains(reason.c_str()));
  }
}

TEST_CASE("model: an older pack without a contact map opens") {
  const ScratchFolder folder;
  TinyModel tiny;
  tiny.has_contact_map = false;
  const TensorFile tensors = host::pack_tensors(tiny.views());
  for (const TensorFile::Entry& entry : tensors.entries()) CHECK(entry.name.find("contact") == std::string::npos);
  const Model model = tiny.open();
  CHECK_FALSE(model.contact_map);
  CHECK(model.self_test.contact_shape_mm.empty());
  CHECK(same(model.self_test.shape_mm, tiny.test_shape_mm));
}

TEST_CASE("model: refuses every tensor of another type, by name") {
  const ScratchFolder folder;
  const TensorFile tensors = host::pack_tensors(TinyModel().views());
  for (const TensorFile::Entry& entry : tensors.entries()) {
    const std::string bytes =
        host::sealed_bytes(tensors_with(entry.name, zeros<std::int64_t>(entry.name, entry.shape)));
    const std::string reason = "tensor '" + entry.name + "': found I64 [";
    CHECK(refusal(folder, bytes) == doctest::Contains(reason.c_str()));
  }
}

TEST_CASE("model: refuses tensors of another shape, with what was found and expected") {
  struct Hostile {
    TensorFile::Entry tensor;
    const char* reason;
  };
  const Hostile all[] = {
      {zeros<float>(tensor::kRest, {126}), "found F32 [126], expected F32 [42, 3]"},
      {zeros<float>(tensor::kRest, {41, 3}), "found F32 [41, 3], expected F32 [42, 3]"},
      {zeros<std::int32_t>(tensor::kTets, {71, 4}), "found I32 [71, 4], expected I32 [72, 4]"},
      {zeros<std::uint8_t>(tensor::kNodeKind, {43}), "found U8 [43], expected U8 [42]"},
      {zeros<std::int32_t>(tensor::kFrontNodes, {0}), "found length 0, expected 1 to 42 along dimension 0"},
      {zeros<std::int32_t>(tensor::kFrontNodes, {}), "found too few dimensions"},
      {zeros<std::int32_t>(tensor::kFrontNodes, {43}), "found length 43"},
      {zeros<std::int32_t>(tensor::kOrder, {26}), "found I32 [26], expected I32 [27]"},
      {zeros<std::int32_t>(tensor::kPatternStart, {27}), "found I32 [27], expected I32 [28]"},
      {zeros<std::int32_t>(tensor::kSupernodeStart, {1}), "found length 1, expected 2 to 28"},
      {zeros<std::int32_t>(tensor::kSupernodeStart, {29}), "found length 29, expected 2 to 28"},
      {zeros<std::int32_t>(tensor::kRowsStart, {27}), "found I32 [27], expected I32 [28]"},
      {zeros<float>(tensor::kShapeMap.weights, {0, 190}), "found length 0, expected 1 to 64"},
      {zeros<float>(tensor::kShapeMap.weights, {2, 189}), "expected F32 [2, 190]"},
      {zeros<float>(tensor::kShapeMap.basis, {3, 126}), "found F32 [3, 126], expected F32 [2, 126]"},
      {zeros<float>(tensor::kContactMap.weights, {65, 190}), "found length 65, expected 1 to 64"},
      {zeros<float>(tensor::kContactMap.basis, {2, 123}), "found F32 [2, 123], expected F32 [2, 126]"},
      {zeros<float>(tensor::kSelfTestContactShape, {1, 126}), "found F32 [1, 126], expected F32 [2, 126]"},
      {zeros<float>(tensor::kTouchFirst.weights, {8, 21}), "found F32 [8, 21], expected F32 [8, 23]"},
      {zeros<std::int8_t>(tensor::kTouchWeights[1], {8, 9}), "found I8 [8, 9], expected I8 [8, 8]"},
      {zeros<float>(tensor::kTouchLast.weights, {22, 9}), "found F32 [22, 9], expected F32 [22, 8]"},
      {zeros<float>(tensor::kTouchLast.bias, {12}), "found F32 [12], expected F32 [22]"},
      {zeros<float>(tensor::kTouchFirst.bias, {5000}), "found length 5000, expected 1 to 4096"},
      {zeros<float>(tensor::kTouchBias[2], {0}), "found length 0, expected 1 to 4096"},
      {zeros<float>(tensor::kPriorCovariance, {324}), "expected F32 [18, 18]"},
      {zeros<float>(tensor::kCameraPose, {3, 4}), "expected F32 [4, 4]"},
      {zeros<std::int32_t>(tensor::kMarkerIds, {4}), "expected I32 [3]"},
      {zeros<float>(tensor::kSelfTestPoses, {0, 18}), "found length 0, expected 1 to 64"},
      {zeros<std::uint16_t>(tensor::kSelfTestRegisters, {2, 47}), "expected U16 [2, 85]"},
  };
  const ScratchFolder folder;
  for (const Hostile& hostile : all) {
    CAPTURE(hostile.reason);
    const doctest::String message =
        refusal(folder, host::sealed_bytes(tensors_with(hostile.tensor.name, hostile.tensor)));
    CHECK(message == doctest::Contains(hostile.reason));
    CHECK(message == doctest::Contains(hostile.tensor.name.c_str()));
  }
}

TEST_CASE("model: refuses a tensor that it does not know") {
  const ScratchFolder folder;
  TensorFile tensors = host::pack_tensors(TinyModel().views());
  tensors.add(zeros<float>("surprise", {1}));
  CHECK(refusal(folder, host::sealed_bytes(tensors)) ==
        doctest::Contains("tensor 'surprise': found an unknown tensor"));
}

TEST_CASE("model: refuses metadata that is missing or wrong, by key") {
  struct Hostile {
    const char* key;
    std::optional<std::string> value;
    const char* reason;
  };
  const Hostile all[] = {
      {meta::kFormat, std::nullopt, "is not a Finsight model pack"},
      {meta::kFormat, "1", "format version: found 1, expected 9"},
      {meta::kFinger, std::nullopt, "metadata 'finger': found nothing"},
      {meta::kScene, std::nullopt, "metadata 'scene': found nothing"},
      {meta::kFinger, "", "metadata 'finger': found \"0 bytes\", expected 1 to 64 printable"},
      {meta::kFinger, "two\nlines", "1 to 64 printable"},
      {meta::kFinger, std::string(65, 'x'), "1 to 64 printable"},
      {meta::kSpecSha256, std::string(64, 'g'), "64 lower-case hexadecimal digits"},
      {meta::kSpecSha256, "abc", "64 lower-case hexadecimal digits"},
      {meta::kHostgenVersion, std::nullopt, "metadata 'hostgen_version'"},
      {meta::kNodes, std::nullopt, "metadata 'nodes'"},
      {meta::kNodes, "43", "expected F32 [43, 3]"},
      {meta::kNodes, "-42", "metadata 'nodes': found \"-42\", expected a number from 4 to 50000"},
      {meta::kNodes, "42.0", "metadata 'nodes'"},
      {meta::kNodes, " 42", "metadata 'nodes'"},
      {meta::kNodes, "99999999999999999999", "metadata 'nodes'"},
      {meta::kTetCount, "200001", "expected a number from 1 to 200000"},
      {meta::kMarkerSize, "0", "metadata 'marker_size_mm'"},
      {meta::kMarkerSize, "nan", "metadata 'marker_size_mm'"},
      {meta::kThreshold, "-1", "metadata 'touch_threshold_mm'"},
      {meta::kThreshold, "inf", "metadata 'touch_threshold_mm'"},
      {meta::kThreshold, "2mm", "metadata 'touch_threshold_mm'"},
      {meta::kRange, std::nullopt, "metadata 'touch_range_mm'"},
      {meta::kRange, "1.5", "metadata 'touch_range_mm'"},
      {meta::kExplainedAboveUnknown_g, std::nullopt, "metadata 'touch_explained_above_unknown_g'"},
      {meta::kRatedDeformation, "", "metadata 'rated_deformation_mm'"},
      {meta::kRatedDeformation, "1e30", "metadata 'rated_deformation_mm'"},
  };
  const ScratchFolder folder;
  for (const Hostile& hostile : all) {
    CAPTURE(hostile.reason);
    TensorFile tensors = host::pack_tensors(TinyModel().views());
    tensors.metadata.erase(hostile.key);
    if (hostile.value) tensors.metadata[hostile.key] = *hostile.value;
    CHECK(refusal(folder, host::sealed_bytes(tensors)) == doctest::Contains(hostile.reason));
  }
}

TEST_CASE("model: plate numbers are displacement and rotation, plate by plate") {
  PlatePoses poses;
  for (int p = 0; p < kPlates; ++p) {
    poses.plates[static_cast<std::size_t>(p)].displacement_mm = Vec3f(0, 1, 2).array() + static_cast<float>(6 * p);
    poses.plates[static_cast<std::size_t>(p)].rotation_rad = Vec3f(3, 4, 5).array() + static_cast<float>(6 * p);
  }
  for (int i = 0; i < kPoseDims; ++i) CHECK(pose_vector(poses)[i] == static_cast<float>(i));
}
