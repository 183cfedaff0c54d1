// In a program of its own, because Ctrl-C is never forgotten.
#include <doctest/doctest.h>

#include <csignal>

#include "hostgen/fem/statics.h"
#include "hostgen/util/common.h"
#include "tests/fem/box_mesh.h"

using namespace finsight;
using namespace finsight::host;

TEST_CASE("interrupt: Ctrl-C ends a state within one front of a factor, and the analysis of a mesh") {
  catch_interrupts();
  const PushedFinger finger(test::small_finger_spec(), test::small_finger_mesh());
  Equilibrium equilibrium(finger.body);
  ElasticState state = finger.rest;
  PushedFinger::BodyVector load = finger.zero();
  finger.add_push(finger.at({0, 40}), 0.2, load);
  REQUIRE(equilibrium.solve(load, state));
  REQUIRE(equilibrium.linearise(state));
  FingerStatics statics(test::small_finger_spec(), test::small_finger_mesh());
  std::raise(SIGINT);
  CHECK_THROWS_AS(equilibrium.solve(load, state), Interrupted);
  CHECK_THROWS_AS(equilibrium.linearise(state), Interrupted);
  CHECK_THROWS_AS(statics.load(Vec3f(0, 40, 0), 0.1), Interrupted);
  // Nor is a mesh analysed to its end.
  CHECK_THROWS_AS(PushedFinger(test::small_finger_spec(), test::small_finger_mesh()), Interrupted);
}
