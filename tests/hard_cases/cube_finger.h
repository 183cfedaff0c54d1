// What the tests of hard cases bend.
#pragma once

#include <doctest/doctest.h>

#include "firmware/shape/newton.h"
#include "hostgen/fem/shape_model.h"
#include "hostgen/hard_cases/hard_motions.h"
#include "hostgen/learn/shape_map_training.h"
#include "tests/random.h"
#include "tests/shape/finger_motion.h"
#include "tests/shape/frame_mesh.h"

namespace finsight::test {

/// A finger made of cubes with a shape map that knows gentle touches.
struct CubeFinger {
  explicit CubeFinger(const host::TetMesh& mesh) : data(host::make_shape_model(mesh)), mount(mount_of(mesh)) {
    constexpr int kSamples = 400;
    Eigen::MatrixXf poses(kSamples, kPoseDims), displacement(kSamples, static_cast<Eigen::Index>(data.rest_mm.size()));
    NewtonSolver<double> solver(data.view(), mount);
    const host::HardMotion motion(mount);
    Random random(3);
    for (int sample = 0; sample < kSamples; ++sample) {
      const PlatePoses touched =
          motion.poses({random.uniform(-15, 15), random.uniform(-5, 5), random.uniform(-20, 20)});
      poses.row(sample) = pose_vector(touched).transpose();
      for (float& number : poses.row(sample)) number += static_cast<float>(0.005 * random.normal());
      solver.start_at_rest();
      REQUIRE(solver.converge(host_poses(poses.row(sample)), 1e-5, 100).ok);
      for (Eigen::Index i = 0; i < displacement.cols(); ++i)
        displacement(sample, i) = static_cast<float>(solver.node_mm()[static_cast<std::size_t>(i)]) -
                                  data.rest_mm[static_cast<std::size_t>(i)];
    }
    map = host::fit_shape_map(poses, displacement);
  }
  static PlatePoses host_poses(const Eigen::RowVectorXf& numbers) {
    return seen_poses({numbers.data(), static_cast<std::size_t>(numbers.size())});
  }
  ShapeParts parts() const { return {data.view(), map.view(), mount}; }

  host::ShapeModelData data;
  MountModel mount;
  host::ShapeMapData map;
};

}  // namespace finsight::test
