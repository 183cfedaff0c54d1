#include "hostgen/fem/calculix.h"

#include <doctest/doctest.h>

#include "tests/fem/box_mesh.h"

using namespace finsight;
using namespace finsight::host;

TEST_CASE("calculix: both solvers agree on three loads, with linear and with quadratic elements") {
  if (!calculix_present()) {
    MESSAGE("skipped: ccx is not installed (Debian: apt-get install calculix-ccx)");
    return;
  }
  const FingerSpec spec = test::small_finger_spec();
  const TetMesh mesh = test::small_finger_mesh();
  for (const Element element : {Element::kC3D4, Element::kC3D10}) {
    for (const LoadCase& load : {push(0, 54, 0.6), push(5, 40, 1.5), push(-3, 25, 4)}) {
      CAPTURE(static_cast<int>(element));
      CAPTURE(load.force_n);
      const CalculixComparison result = compare_with_calculix(spec, mesh, element, load);
      CHECK(result.largest_mm > (element == Element::kC3D4 ? 0.3 : 1));
      CHECK(result.difference_mm < 1e-5);
    }
  }
}

TEST_CASE("calculix: both solvers agree on the paper's finger, with linear and with quadratic elements") {
  if (!calculix_present()) {
    MESSAGE("skipped: ccx is not installed (Debian: apt-get install calculix-ccx)");
    return;
  }
  const FingerSpec spec = read_finger_spec(FINSIGHT_SOURCE_DIR "/hostgen/fingers/srm.toml");
  const TetMesh mesh = make_mesh(spec, MeshSize::kCoarse);
  for (const Element element : {Element::kC3D4, Element::kC3D10}) {
    for (const LoadCase& load : {push(0, 70, 1.5), push(19, 80, 1.5), push(-10, 40, 6)}) {
      CAPTURE(static_cast<int>(element));
      CAPTURE(load.force_n);
      const CalculixComparison result = compare_with_calculix(spec, mesh, element, load);
      CHECK(result.largest_mm > 0.5);
      CHECK(result.difference_mm < 1e-5);
    }
  }
}

TEST_CASE("calculix: both solvers agree on friction, on a patch and on a line") {
  if (!calculix_present()) {
    MESSAGE("skipped: ccx is not installed (Debian: apt-get install calculix-ccx)");
    return;
  }
  const FingerSpec spec = read_finger_spec(FINSIGHT_SOURCE_DIR "/hostgen/fingers/srm.toml");
  const TetMesh mesh = make_mesh(spec, MeshSize::kCoarse);
  const LoadCase rubbed{{{.centre_mm = {8, 75}, .friction = {0.4, -0.3}, .follow = 1}}, 2};
  const LoadCase patch{{{.centre_mm = {-5, 60}, .radius_mm = 9, .full_force_n = 3, .follow = 0.5}}, 3};
  const LoadCase line{{{.centre_mm = {0, 80},
                        .half_length_mm = 40,
                        .radius_mm = 2,
                        .angle_rad = 0.1,
                        .pressure = Pressure::kEven,
                        .friction = {0.2, 0}}},
                      2};
  for (const LoadCase& load : {rubbed, patch, line}) {
    const CalculixComparison result = compare_with_calculix(spec, mesh, Element::kC3D10, load);
    CHECK(result.largest_mm > 0.5);
    CHECK(result.difference_mm < 1e-5);
  }
}

TEST_CASE("calculix: the deck holds the whole load, along the inward normal") {
  const PushedFinger finger(test::small_finger_spec(), test::small_finger_mesh());
  PushedFinger::BodyVector force_n = finger.zero();
  finger.add_push(finger.at({1, 33}), 2, force_n);
  const std::string deck = calculix_deck(finger, force_n);
  const std::string loads = deck.substr(deck.find("*CLOAD\n") + 7);
  double along[4] = {};
  for (std::size_t at = 0; at < loads.find("*NODE PRINT"); at = loads.find('\n', at) + 1) {
    int node = 0, axis = 0;
    double force_n = 0;
    REQUIRE(std::sscanf(loads.c_str() + at, "%d, %d, %lf", &node, &axis, &force_n) == 3);
    along[axis] += force_n;
  }
  CHECK(along[1] == doctest::Approx(0));
  CHECK(along[2] == doctest::Approx(0));
  CHECK(along[3] == doctest::Approx(2));
}
