// A small valid model pack for tests: a bar of 72 tets, three rows of nodes as plates, a network of random weights. Its
// self-test is only well-formed: tests that serve this pack must fill in the expected answers.
#pragma once

#include <algorithm>
#include <filesystem>
#include <set>
#include <vector>

#include "hostgen/pack/model_pack.h"
#include "tests/model/scratch_folder.h"
#include "tests/random.h"

namespace finsight::test {

/// Owns every array of the pack; change any of them before views(). A bar of 3 x 7 x 2 nodes, 30 x 120 x 20 mm: base at
/// y = 0, touched face at z = 0, plates on the back at y = 120 (top), 80 and 40 mm.
struct TinyModel {
  static constexpr int kAcross = 3, kUp = 7, kDeep = 2;
  static constexpr int kNodes = kAcross * kUp * kDeep, kRank = 2, kHidden = 8, kCases = 2;

  std::vector<float> rest_mm;
  std::vector<std::int32_t> tet_nodes, free_index, front_nodes;
  std::vector<std::uint8_t> node_kind;
  std::vector<std::int32_t> order, pattern_start{0}, pattern_row, supernode_start{0}, rows_start{0}, rows;
  std::vector<float> map_scale, map_weights, map_basis,
      contact_basis;  ///< the contact map has the same scale and weights
  bool has_contact_map = true;
  std::vector<float> touch_scale, input_mean, input_scale, output_mean, output_scale,
      radius_curve = {2, 0.1f, 0.9f, 8, -0.1f, 1},
      radius_inputs = std::vector<float>(2 * TouchModel::kRadiusFeatures, 0.1F),
      seen_factor = {1.3f, 1.4f, 1.1f, 1.2f, 1.1f, 1.2f, 1}, face_axes = {0, 1, 0, -0.28f, 0, 0.96f, 0.96f, 0, 0.28f},
      per_g = std::vector<float>(3 * kPoseDims, 0.01F),
      per_g_change = std::vector<float>(3 * kPoseDims * kBentFeatures, 0.001F);
  std::vector<float> first_weights, first_bias, last_weights, last_bias;
  static constexpr std::size_t kRadiusLayers = TouchModel::kRadiusWidths.size() - 1;
  std::array<std::vector<float>, kRadiusLayers> radius_weights, radius_bias;
  std::array<std::vector<std::int8_t>, TouchModel::kRounded> weights;
  std::array<std::vector<float>, TouchModel::kRounded> weight_scale, bias;
  std::vector<float> prior_mean, prior_covariance, prior_noise;
  std::vector<float> test_poses, test_shape_mm, test_touch, test_contact_shape_mm;
  std::vector<std::uint16_t> test_registers, test_contact_registers;
  host::PackViews parts;  ///< the numbers and texts; views() adds the arrays

  TinyModel() {
    Random random(7);
    make_nodes();
    make_tets();
    make_plan();
    make_map(random);
    make_network(random);
    make_prior(random);
    make_mount();
    make_self_test(random);
    parts.finger_name = "tiny";
    parts.scene = "grasp";
    parts.spec_sha256 = std::string(64, 'a');
    parts.hostgen_version = "0.0.0";
    parts.rated_deformation_mm = 10;
    parts.touch.threshold_mm = 2;
    parts.touch.range_mm = 40;
    parts.touch.explained_above = parts.touch.explained_above_unknown_g = -20;
    parts.touch.stiffness_tolerance = 0.2F;
    parts.touch.marker_tolerance_mm = 0.3F;
    parts.touch.marker_tolerance_rad = 0.02F;
  }

  host::PackViews views() const {
    host::PackViews all = parts;
    const int tets = static_cast<int>(tet_nodes.size() / 4);
    const CholeskyPlan plan{
        static_cast<int>(order.size()), order, pattern_start, pattern_row, supernode_start, rows_start, rows};
    all.shape = {kNodes, tets, rest_mm, tet_nodes, node_kind, free_index, front_nodes, plan};
    all.shape_map = {kRank, map_scale, map_weights, map_basis};
    if (has_contact_map) all.contact_map = {kRank, map_scale, map_weights, contact_basis};
    all.touch.scale = touch_scale;
    all.touch.input_mean = input_mean;
    all.touch.input_scale = input_scale;
    all.touch.output_mean = output_mean;
    all.touch.output_scale = output_scale;
    all.touch.radius_curve = radius_curve;
    all.touch.radius_inputs = radius_inputs;
    for (std::size_t i = 0; i < kRadiusLayers; ++i) {
      all.touch.radius[i] = {TouchModel::kRadiusWidths[i], TouchModel::kRadiusWidths[i + 1], radius_weights[i],
                             radius_bias[i]};
    }
    all.touch.seen_factor = seen_factor;
    all.touch.face_axes = face_axes;
    all.touch.per_g = per_g;
    all.touch.per_g_change = per_g_change;
    all.touch.first = {TouchModel::kInputs, kHidden, first_weights, first_bias};
    all.touch.last = {kHidden, TouchModel::kOutputs, last_weights, last_bias};
    for (std::size_t i = 0; i < TouchModel::kRounded; ++i) {
      all.touch.middle[i] = {kHidden, kHidden, weights[i], weight_scale[i], bias[i]};
    }
    all.prior = {prior_mean, prior_covariance, prior_noise};
    all.self_test = {
        kCases, test_poses, test_shape_mm, test_touch, test_registers, test_contact_shape_mm, test_contact_registers};
    return all;
  }

  /// Whatever moved the plates, the network takes it for this touch.
  void answer_always(const Vec3f& point_mm, float force_n) {
    std::ranges::fill(last_weights, 0.0F);
    std::ranges::fill(last_bias, 0.0F);
    std::copy(point_mm.data(), point_mm.data() + 3, output_mean.begin());
    output_mean[6] = force_n;
  }

  void write(const std::filesystem::path& file) const { host::write_model_pack(file, views()); }

  /// Writes the pack and opens it as the firmware does.
  Model open() const {
    const ScratchFolder folder;  // the model keeps the file mapped after it is removed
    write(folder / "pack");
    return Model::open(folder / "pack");
  }

 private:
  static int node_at(int i, int j, int k) { return (j * kDeep + k) * kAcross + i; }
  /// In [-size, size).
  static std::vector<float> numbers(Random& random, std::size_t count, double size) {
    std::vector<float> values(count);
    for (float& value : values) value = static_cast<float>(random.uniform(-size, size));
    return values;
  }

  void make_nodes() {
    std::int32_t free_nodes = 0;
    for (int j = 0; j < kUp; ++j) {
      for (int k = 0; k < kDeep; ++k) {
        for (int i = 0; i < kAcross; ++i) {
          const float at[] = {15.f * static_cast<float>(i - 1), 20.f * static_cast<float>(j),
                              20.f * static_cast<float>(k)};
          rest_mm.insert(rest_mm.end(), at, at + 3);
          const bool plate = k == 1 && j >= 2 && j % 2 == 0;  // levels 6, 4, 2: top, middle, low
          const int kind = j == 0 ? 1 : plate ? 2 + (6 - j) / 2 : 0;
          node_kind.push_back(static_cast<std::uint8_t>(kind));
          free_index.push_back(kind == 0 ? free_nodes++ : -1);
          if (k == 0) front_nodes.push_back(node_at(i, j, k));
        }
      }
    }
  }

  /// Each box becomes six tets, one per path from its lowest to its highest corner: neighbours share their diagonals.
  void make_tets() {
    for (int j = 0; j + 1 < kUp; ++j) {
      for (int i = 0; i + 1 < kAcross; ++i) {
        std::array<int, 3> axes{0, 1, 2};
        do {
          std::array<int, 3> corner{i, j, 0};
          std::vector<std::int32_t> tet{node_at(i, j, 0)};
          for (const int axis : axes) {
            ++corner[static_cast<std::size_t>(axis)];
            tet.push_back(node_at(corner[0], corner[1], corner[2]));
          }
          const int inversions = (axes[0] > axes[1]) + (axes[1] > axes[2]) + (axes[0] > axes[2]);
          if (inversions % 2 == 1) std::swap(tet[2], tet[3]);
          tet_nodes.insert(tet_nodes.end(), tet.begin(), tet.end());
        } while (std::next_permutation(axes.begin(), axes.end()));
      }
    }
  }

  /// Elimination in the reverse order of the free nodes, one column per supernode.
  void make_plan() {
    const int blocks = static_cast<int>(std::count(node_kind.begin(), node_kind.end(), 0));
    const auto position = [&](std::int32_t node) { return blocks - 1 - free_index[static_cast<std::size_t>(node)]; };
    std::vector<std::set<std::int32_t>> pattern(static_cast<std::size_t>(blocks));
    for (std::size_t t = 0; t < tet_nodes.size(); ++t) {
      for (std::size_t other = t / 4 * 4; other < t / 4 * 4 + 4; ++other) {
        if (free_index[static_cast<std::size_t>(tet_nodes[t])] < 0) continue;
        if (free_index[static_cast<std::size_t>(tet_nodes[other])] < 0) continue;
        const int column = position(tet_nodes[t]), row = position(tet_nodes[other]);
        if (column <= row) pattern[static_cast<std::size_t>(column)].insert(row);
      }
    }
    std::vector<std::set<std::int32_t>> factor = pattern;
    for (int j = 0; j < blocks; ++j) {
      const auto column = static_cast<std::size_t>(j);
      order.push_back(blocks - 1 - j);
      pattern_row.insert(pattern_row.end(), pattern[column].begin(), pattern[column].end());
      pattern_start.push_back(static_cast<std::int32_t>(pattern_row.size()));
      supernode_start.push_back(j + 1);
      factor[column].erase(j);
      rows.insert(rows.end(), factor[column].begin(), factor[column].end());
      rows_start.push_back(static_cast<std::int32_t>(rows.size()));
      if (!factor[column].empty()) {
        auto& parent = factor[static_cast<std::size_t>(*factor[column].begin())];
        parent.insert(factor[column].begin(), factor[column].end());
      }
    }
  }

  void make_map(Random& random) {
    for (int i = 0; i < kPoseDims; ++i) map_scale.push_back(i % 6 < 3 ? 0.1f : 1.f);
    map_weights = numbers(random, kRank * ShapeMapModel::kFeatures, 0.1f);
    for (int r = 0; r < kRank; ++r) map_weights[static_cast<std::size_t>(r * ShapeMapModel::kFeatures)] = 0;  // rest
    map_basis = numbers(random, kRank * 3 * kNodes, 0.1f);
    for (const float value : map_basis) contact_basis.push_back(0.5f * value);
  }

  void make_network(Random& random) {
    for (int i = 0; i < kPoseDims; ++i) touch_scale.push_back(i % 6 < 3 ? 1.f : 20.f);
    input_mean = numbers(random, TouchModel::kInputs, 0.1f);
    input_scale.assign(TouchModel::kInputs, 1.5f);
    output_mean = {0, 60, 0, 0, 0, 2, 3, 0, 0, 0, 0, 0, 0, 0, 0, -1, -1, -1, -3, -3, -3, 0};
    output_scale = {5, 20, 1, 0.5f, 0.5f, 2, 1, 0.3f, 0.3f, 0.05f, 0.05f, 0.05f};
    output_scale.resize(TouchModel::kOutputs, 0.1f);
    first_weights = numbers(random, TouchModel::kInputs * kHidden, 0.6f);
    first_bias = numbers(random, kHidden, 0.1f);
    for (std::size_t i = 0; i < TouchModel::kRounded; ++i) {
      for (const float value : numbers(random, kHidden * kHidden, 127)) {
        weights[i].push_back(static_cast<std::int8_t>(value));
      }
      weight_scale[i].assign(kHidden, 0.01f);
      bias[i] = numbers(random, kHidden, 0.1f);
    }
    last_weights = numbers(random, kHidden * TouchModel::kOutputs, 1.0f);
    last_bias = numbers(random, TouchModel::kOutputs, 0.1f);
    for (std::size_t i = 0; i < kRadiusLayers; ++i) {
      const auto inputs = static_cast<std::size_t>(TouchModel::kRadiusWidths[i]);
      const auto outputs = static_cast<std::size_t>(TouchModel::kRadiusWidths[i + 1]);
      radius_weights[i].assign(inputs * outputs, 0.02F);
      radius_bias[i].assign(outputs, -0.1F);
    }
  }

  /// Plates that move together towards the back, with a little motion of their own.
  void make_prior(Random& random) {
    prior_mean = numbers(random, kPoseDims, 0.01f);
    prior_noise.assign(kPoseDims, 0.01f);
    PoseVector common = PoseVector::Zero();
    for (int p = 0; p < kPlates; ++p) common.segment<6>(6 * p) << 0, -0.5f, 3, 0.05f, 0, 0;
    Eigen::Matrix<float, kPoseDims, kPoseDims> covariance = common * common.transpose();
    for (int i = 0; i < kPoseDims; ++i) covariance(i, i) += i % 6 < 3 ? 0.25f : 0.001f;
    prior_covariance.assign(covariance.data(), covariance.data() + covariance.size());
  }

  void make_mount() {
    MountModel& mount = parts.mount;
    mount.T_finger_camera.setIdentity();  // below the base, looking up
    mount.T_finger_camera.linear() << 1, 0, 0, 0, 0, 1, 0, -1, 0;
    mount.T_finger_camera.translation() << 0, -60, 10;
    for (int p = 0; p < kPlates; ++p) {
      Eigen::Isometry3f& T = mount.T_finger_marker[static_cast<std::size_t>(p)];
      T.setIdentity();  // facing down
      T.linear() << 1, 0, 0, 0, 0, -1, 0, 1, 0;
      T.translation() << 0, 120 - 40 * static_cast<float>(p), 20 - 10 * static_cast<float>(p);
    }
    mount.marker_id = {3, 1, 4};
    mount.marker_size_mm = 8;
  }

  void make_self_test(Random& random) {
    test_poses = numbers(random, kPoseDims * kCases, 0.05f);
    for (int c = 0; c < kCases; ++c) test_shape_mm.insert(test_shape_mm.end(), rest_mm.begin(), rest_mm.end());
    test_contact_shape_mm = test_shape_mm;
    test_touch.assign(7 * kCases, 0);
    test_registers.assign(kMeasurementRegisters * kCases, 0);
    test_contact_registers = test_registers;
  }
};

}  // namespace finsight::test
