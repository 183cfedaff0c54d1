// Well-formed packs with values that no finger can have.
#include <doctest/doctest.h>

#include <algorithm>
#include <limits>

#include "tests/model/hostile_pack.h"

using namespace finsight;
using namespace finsight::test;

TEST_CASE("values: refuses a mesh that cannot be solved") {
  const HostileModel all[] = {
      {"not finite", [](TinyModel& t) { t.rest_mm[7] = std::numeric_limits<float>::quiet_NaN(); },
       "'shape.rest_mm': found element 7 not finite"},
      {"far away", [](TinyModel& t) { t.rest_mm[7] = 2000; }, "'shape.rest_mm': found 2000.000000 at element 7"},
      {"node too large", [](TinyModel& t) { t.tet_nodes[9] = 42; },
       "'shape.tet_nodes': found node 42 in tet 2, expected 0 to 41"},
      {"node negative", [](TinyModel& t) { t.tet_nodes[0] = -1; }, "found node -1 in tet 0"},
      {"inside out", [](TinyModel& t) { std::swap(t.tet_nodes[4], t.tet_nodes[5]); }, "found tet 1 flat or inside out"},
      {"flat", [](TinyModel& t) { t.tet_nodes[1] = t.tet_nodes[0]; }, "found tet 0 flat or inside out"},
      {"unknown kind", [](TinyModel& t) { t.node_kind[0] = 5; }, "'shape.node_kind': found kind 5"},
      {"front twice", [](TinyModel& t) { t.front_nodes[1] = t.front_nodes[0]; },
       "'shape.front_nodes': found indices out of order"},
      {"front beyond", [](TinyModel& t) { t.front_nodes.back() = 42; }, "expected ascending, 0 to 41"},
      {"front negative", [](TinyModel& t) { t.front_nodes[0] = -1; }, "expected ascending, 0 to 41"},
  };
  check_refused(all);
}

TEST_CASE("values: refuses a mesh without base or without a plate") {
  const auto without = [](std::uint8_t kind) {
    return [kind](TinyModel& t) {
      std::replace(t.node_kind.begin(), t.node_kind.end(), kind, static_cast<std::uint8_t>(kind == 1 ? 2 : 1));
    };
  };
  const HostileModel all[] = {{"base", without(1), "'shape.node_kind': found no base node"},
                              {"top", without(2), "found no top plate node"},
                              {"middle", without(3), "found no middle plate node"},
                              {"low", without(4), "found no low plate node"}};
  check_refused(all);
}

TEST_CASE("values: refuses a free node that belongs to no tet") {
  const HostileModel all[] = {{"lonely",
                               [](TinyModel& t) {
                                 // Node 36 is free, at the front of the top level.
                                 std::vector<std::int32_t> kept;
                                 for (std::size_t i = 0; i < t.tet_nodes.size(); i += 4) {
                                   const auto tet = t.tet_nodes.begin() + static_cast<std::ptrdiff_t>(i);
                                   if (std::find(tet, tet + 4, 36) == tet + 4) kept.insert(kept.end(), tet, tet + 4);
                                 }
                                 t.tet_nodes = kept;
                               },
                               "'shape.tet_nodes': found free node 36 in no tet"}};
  check_refused(all);
}

TEST_CASE("values: refuses scales that are not positive") {
  const HostileModel all[] = {
      {"map", [](TinyModel& t) { t.map_scale[17] = 0; }, "'map.scale': found 0.000000 at element 17"},
      {"contact map", [](TinyModel& t) { t.contact_basis[3] = std::numeric_limits<float>::quiet_NaN(); },
       "'contact_map.basis': found element 3 not finite"},
      {"touch", [](TinyModel& t) { t.touch_scale[0] = -1; }, "'touch.scale': found -1.000000 at element 0"},
      {"input", [](TinyModel& t) { t.input_scale[2] = 1e30f; }, "'touch.input_scale'"},
      {"output", [](TinyModel& t) { t.output_scale[2] = 0; }, "'touch.output_scale'"},
      {"curve", [](TinyModel& t) { t.radius_curve[3] = 2; },
       "'touch.radius_curve': found plate motion 2.000000 mm at knot 1"},
      {"radius features", [](TinyModel& t) { t.radius_inputs[3] = 1e5F; },
       "'touch.radius_inputs': found 100000.000000 at element 3"},
      {"radius weight", [](TinyModel& t) { t.radius_weights[1][63] = -1e5F; },
       "'touch.radius_weights2': found -100000.000000 at element 63"},
      {"radius bias", [](TinyModel& t) { t.radius_bias[0][8] = 1e5F; },
       "'touch.radius_bias1': found 100000.000000 at element 8"},
      {"radius", [](TinyModel& t) { t.radius_weights[2][8] = std::numeric_limits<float>::quiet_NaN(); },
       "'touch.radius_weights3': found element 8 not finite"},
      {"seen", [](TinyModel& t) { t.seen_factor[4] = 0; }, "'touch.seen_factor': found 0.000000 at element 4"},
      {"axes", [](TinyModel& t) { t.face_axes[0] = 0.5F; },
       "'touch.face_axes': found directions that differ from perpendicular unit vectors by 0.480000"},
      {"exponent", [](TinyModel& t) { t.radius_curve[2] = 1e6f; },
       "'touch.radius_curve': found 1000000.000000 at element 2"},
      {"weights", [](TinyModel& t) { t.weight_scale[1][0] = -0.1f; }, "'touch.weight_scale2'"},
      {"infinite", [](TinyModel& t) { t.bias[2][3] = std::numeric_limits<float>::infinity(); },
       "'touch.bias3': found element 3 not finite"},
      {"not a number", [](TinyModel& t) { t.last_weights[7] = std::numeric_limits<float>::quiet_NaN(); },
       "'touch.last_weights': found element 7 not finite"},
  };
  check_refused(all);
}

TEST_CASE("values: refuses a prior that is not a Gaussian") {
  const HostileModel all[] = {
      {"unsymmetric", [](TinyModel& t) { t.prior_covariance[1] += 1; },
       "'prior.covariance': found an unsymmetric matrix"},
      {"negative", [](TinyModel& t) { t.prior_covariance[19 * 5] = -1; },
       "found a matrix that is not positive definite"},
      {"all zero", [](TinyModel& t) { t.prior_covariance.assign(324, 0); },
       "found a matrix that is not positive definite"},
      {"no noise", [](TinyModel& t) { t.prior_noise[7] = 0; }, "'prior.noise': found 0.000000 at element 7"},
  };
  check_refused(all);
}

TEST_CASE("values: refuses an impossible mount") {
  const HostileModel all[] = {
      {"scaled", [](TinyModel& t) { t.parts.mount.T_finger_camera.linear() *= 1.01f; },
       "'mount.T_finger_camera': found a matrix that is not a rigid motion"},
      {"mirrored", [](TinyModel& t) { t.parts.mount.T_finger_marker[1].linear().col(0) *= -1; },
       "'mount.T_finger_marker': found a matrix that is not a rigid motion"},
      {"projective", [](TinyModel& t) { t.parts.mount.T_finger_camera.matrix()(3, 0) = 0.1f; }, "last row 0 0 0 1"},
      {"far away", [](TinyModel& t) { t.parts.mount.T_finger_marker[2].translation().x() = 1500; },
       "found a translation over 1 m"},
      {"id 50", [](TinyModel& t) { t.parts.mount.marker_id[0] = 50; },
       "'mount.marker_id': found 50, expected distinct ids from 0 to 49"},
      {"id -1", [](TinyModel& t) { t.parts.mount.marker_id[2] = -1; }, "'mount.marker_id': found -1"},
      {"same id", [](TinyModel& t) { t.parts.mount.marker_id[2] = t.parts.mount.marker_id[0]; },
       "'mount.marker_id': found 3 twice"},
  };
  check_refused(all);
}

TEST_CASE("values: refuses a self-test beyond any finger") {
  const HostileModel all[] = {
      {"motion", [](TinyModel& t) { t.test_poses[kPoseDims] = 300; }, "'self_test.poses': found case 1 out of range"},
      {"turn", [](TinyModel& t) { t.test_poses[3] = 4; }, "'self_test.poses': found case 0 out of range"},
      {"shape", [](TinyModel& t) { t.test_shape_mm[1] = -1e6f; }, "'self_test.shape_mm'"},
      {"contact shape", [](TinyModel& t) { t.test_contact_shape_mm[1] = -1e6f; }, "'self_test.contact_shape_mm'"},
  };
  check_refused(all);
}
