// Values that the stages rely on without checking: mesh, mount, prior, self-test.
#include <Eigen/Cholesky>
#include <algorithm>
#include <functional>
#include <numbers>

#include "firmware/model/checks.h"

namespace finsight {

namespace {

constexpr float kReach_mm = 1000;                    // every coordinate of a finger and its camera
constexpr float kLargestMotion_mm = 200;             // of a plate in the self-test
constexpr double kSmallestTetMm3 = 1e-6;             // the inverse of a flatter one is meaningless in float
constexpr float kMinNoise = 1e-9f, kMaxNoise = 100;  // mm or rad
constexpr int kMarkerIds = 50;                       // DICT_4X4_50
constexpr std::uint8_t kLastKind = 1 + kPlates;

void check_tets(const SafetensorsFile& file, const ShapeModel& shape) {
  const auto node = [&](std::int32_t i) {
    return Eigen::Map<const Vec3f>(shape.rest_mm.data() + 3 * std::ptrdiff_t{i}).cast<double>();
  };
  for (std::size_t t = 0; t < static_cast<std::size_t>(shape.tets); ++t) {
    const auto corner = shape.tet_nodes.subspan(4 * t, 4);
    for (const std::int32_t i : corner) {
      if (i < 0 || i >= shape.nodes) {
        file.refuse(tensor::kTets, "node " + std::to_string(i) + " in tet " + std::to_string(t),
                    "0 to " + std::to_string(shape.nodes - 1));
      }
    }
    const Eigen::Vector3d origin = node(corner[0]);
    Eigen::Matrix3d edges;
    edges << node(corner[1]) - origin, node(corner[2]) - origin, node(corner[3]) - origin;
    if (edges.determinant() < 6 * kSmallestTetMm3) {
      file.refuse(tensor::kTets, "tet " + std::to_string(t) + " flat or inside out", "positively oriented tets");
    }
  }
}

void check_kinds(const SafetensorsFile& file, const ShapeModel& shape) {
  std::array<int, kLastKind + 1> count{};
  for (const std::uint8_t kind : shape.node_kind) {
    if (kind > kLastKind) file.refuse(tensor::kNodeKind, "kind " + std::to_string(kind), "0 to 4");
    ++count[kind];
  }
  constexpr const char* kNames[] = {"free", "base", "top plate", "middle plate", "low plate"};
  for (std::size_t kind = 0; kind < count.size(); ++kind) {
    if (count[kind] == 0) {
      file.refuse(tensor::kNodeKind, std::string("no ") + kNames[kind] + " node", "at least one of each kind");
    }
  }
}

}  // namespace

void check_range(const SafetensorsFile& file, const char* name, std::span<const float> values, float lowest,
                 float highest) {
  const auto outside = [&](float value) { return !(value >= lowest && value <= highest); };
  const auto found = std::find_if(values.begin(), values.end(), outside);
  if (found == values.end()) return;
  file.refuse(name, std::to_string(*found) + " at element " + std::to_string(found - values.begin()),
              std::to_string(lowest) + " to " + std::to_string(highest));
}

void check_mesh(const SafetensorsFile& file, const ShapeModel& shape) {
  check_range(file, tensor::kRest, shape.rest_mm, -kReach_mm, kReach_mm);
  check_kinds(file, shape);
  check_tets(file, shape);

  const auto front = shape.front_nodes;
  const bool ascending = std::adjacent_find(front.begin(), front.end(), std::greater_equal<>()) == front.end();
  if (!ascending || front.front() < 0 || front.back() >= shape.nodes) {
    file.refuse(tensor::kFrontNodes, "indices out of order or range",
                "ascending, 0 to " + std::to_string(shape.nodes - 1));
  }

  // A free node in no tet has no stiffness: the Hessian would be singular.
  std::vector<bool> in_tet(static_cast<std::size_t>(shape.nodes));
  for (const std::int32_t i : shape.tet_nodes) in_tet[static_cast<std::size_t>(i)] = true;
  for (std::size_t i = 0; i < in_tet.size(); ++i) {
    if (!in_tet[i] && shape.free_index[i] >= 0) {
      file.refuse(tensor::kTets, "free node " + std::to_string(i) + " in no tet", "every free node in a tet");
    }
  }
}

void check_mount(const SafetensorsFile& file, const MountModel& mount) {
  for (std::size_t p = 0; p < kPlates; ++p) {
    const int id = mount.marker_id[p];
    const auto same = std::count(mount.marker_id.begin(), mount.marker_id.end(), id);
    if (id < 0 || id >= kMarkerIds || same > 1) {
      file.refuse(tensor::kMarkerIds, std::to_string(id) + (same > 1 ? " twice" : ""), "distinct ids from 0 to 49");
    }
  }
}

void check_prior(const SafetensorsFile& file, const PlatePrior& prior) {
  const Eigen::Matrix<double, kPoseDims, kPoseDims> C =
      Eigen::Map<const Eigen::Matrix<float, kPoseDims, kPoseDims, Eigen::RowMajor>>(prior.covariance.data())
          .cast<double>();
  constexpr double kSymmetry = 1e-6;  // rounding to float of the larger entry
  if ((C - C.transpose()).cwiseAbs().maxCoeff() > kSymmetry * C.cwiseAbs().maxCoeff()) {
    file.refuse(tensor::kPriorCovariance, "an unsymmetric matrix", "a symmetric positive definite one");
  }
  if (C.llt().info() != Eigen::Success) {
    file.refuse(tensor::kPriorCovariance, "a matrix that is not positive definite",
                "a symmetric positive definite one");
  }
  check_range(file, tensor::kPriorNoise, prior.noise, kMinNoise, kMaxNoise);
}

void check_self_test_values(const SafetensorsFile& file, const SelfTestModel& self_test) {
  for (int c = 0; c < self_test.cases; ++c) {
    for (int p = 0; p < kPlates; ++p) {
      const float* plate = self_test.poses.data() + kPoseDims * c + 6 * p;
      const float motion_mm = Eigen::Map<const Vec3f>(plate).norm();
      const float angle_rad = Eigen::Map<const Vec3f>(plate + 3).norm();
      if (motion_mm > kLargestMotion_mm || angle_rad > std::numbers::pi_v<float>) {
        file.refuse(tensor::kSelfTestPoses, "case " + std::to_string(c) + " out of range", "at most 200 mm and pi rad");
      }
    }
  }
  check_range(file, tensor::kSelfTestShape, self_test.shape_mm, -kReach_mm, kReach_mm);
  check_range(file, tensor::kSelfTestContactShape, self_test.contact_shape_mm, -kReach_mm, kReach_mm);
}

}  // namespace finsight
