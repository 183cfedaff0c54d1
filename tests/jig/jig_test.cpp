#include "hostgen/jig/jig.h"

#include <doctest/doctest.h>

#include <cmath>

#include "firmware/input_error.h"
#include "hostgen/finger/mesh.h"
#include "hostgen/util/common.h"
#include "hostgen/util/run_program.h"
#include "tests/model/scratch_folder.h"

using namespace finsight;
using namespace finsight::host;
using Eigen::Vector3d;

namespace {

const std::filesystem::path kFingers = FINSIGHT_SOURCE_DIR "/hostgen/fingers";

struct Fixture {
  static constexpr const char* names[2] = {"srm.toml", "bowed.toml"};
  static const std::vector<FingerSpec>& all_specs() {
    static const std::vector<FingerSpec> specs = {read_finger_spec(kFingers / names[0]),
                                                  read_finger_spec(kFingers / names[1])};
    return specs;
  }
  static const std::vector<Jig>& all_jigs() {
    static const std::vector<Jig> jigs = {make_jig(all_specs()[0]), make_jig(all_specs()[1])};
    return jigs;
  }
  const std::vector<FingerSpec>& specs = all_specs();
  const std::vector<Jig>& jigs = all_jigs();
};

/// Finger frame -> as printed.
Vector3d as_printed(const Jig& jig, const Vector3d& at) {
  Vector3d place = jig.fit.T_finger_jig.inverse() * at;
  place.z() -= jig.fit.print_bed_z_mm;
  return place;
}

bool inside(const Jig& jig, const Vector3d& at_finger) {
  return winding_number(jig.surface, as_printed(jig, at_finger)) > 0.5;
}

}  // namespace

TEST_CASE_FIXTURE(Fixture, "jig: one closed solid that faces outward and does not cut itself") {
  for (const Jig& jig : jigs) CHECK_NOTHROW(check_bounds_a_solid(jig.surface, "jig.stl"));
}

TEST_CASE_FIXTURE(Fixture,
                  "jig: a pin of 3 mm goes straight through every hole to its place on the face, and touches nothing") {
  for (const Jig& jig : jigs) {
    REQUIRE(jig.fit.holes.size() == 9);
    for (const JigHole& hole : jig.fit.holes) {
      CAPTURE(hole.number);
      for (double back_mm = 0.5; back_mm < 20; back_mm += 1.5) {
        const Vector3d on_axis = hole.contact_mm - back_mm * hole.inward;
        CHECK_FALSE(inside(jig, on_axis));
        const Vector3d across = hole.inward.unitOrthogonal();
        for (int turn = 0; turn < 6; ++turn) {
          const Vector3d rim = Eigen::AngleAxisd(turn * 3.14159265 / 3, hole.inward) * (kJigPinMm / 2 * across);
          CHECK_FALSE(inside(jig, on_axis + rim));
        }
      }
      // ... and there is a wall around it.
      const Vector3d middle =
          hole.contact_mm +
          (jig.fit.slab_z_mm - 6 - (jig.fit.T_finger_jig.inverse() * hole.contact_mm).z()) * hole.inward;
      CHECK(inside(jig, middle + (kJigBoreMm / 2 + 0.2) * Vector3d::UnitX()));
    }
  }
}

TEST_CASE_FIXTURE(Fixture, "jig: nothing of the finger is in it, its cheeks lie beside the base and hook behind it") {
  for (std::size_t f = 0; f < jigs.size(); ++f) {
    CAPTURE(names[f]);
    const Jig& jig = jigs[f];
    const TetMesh mesh = make_mesh(specs[f], MeshSize::kCoarse);
    double beside_mm = 1e9, behind_mm = 1e9;
    for (std::size_t n = 0; n < mesh.node_mm.size(); n += 3) {
      const auto& node = mesh.node_mm[n];
      const Vector3d at(node[0], node[1], node[2]);
      // Seat and hooks touch the base; a hair's breadth away from them it must be free.
      const Vector3d towards_middle = Vector3d(0, at.y(), 0) - at;
      CHECK_FALSE(inside(jig, at + 0.05 * towards_middle.normalized()));
      if (at.y() > 1e-6) continue;
      const double side = at.x() > 0 ? 1 : -1;
      const Vector3d inner(at.x(), 0.5 * jig.fit.clip_mm, at.z());
      for (double out_mm = 0; out_mm < 3; out_mm += 0.1) {
        if (!inside(jig, inner + out_mm * side * Vector3d::UnitX())) continue;
        beside_mm = std::min(beside_mm, out_mm);
        break;
      }
    }
    const Eigen::Isometry3d T = jig.fit.T_finger_jig;
    for (double up_mm = 0; up_mm < 3; up_mm += 0.05) {
      Vector3d corner(jig.fit.right_mm - 0.6, 0, jig.fit.back_z_mm + up_mm);  // jig's frame
      const Eigen::Matrix3d R = T.linear();
      corner.y() = (jig.fit.base_y_mm + 0.5 * jig.fit.clip_mm - R.row(1) * corner) / R(1, 1);
      const Vector3d at = T * corner;
      if (inside(jig, at)) behind_mm = std::min(behind_mm, up_mm);
    }
    CHECK(beside_mm < 1);
    CHECK(behind_mm < 1.5);
  }
}

TEST_CASE_FIXTURE(Fixture, "jig: printed as it lies, nothing hangs over by more than 45 degrees") {
  for (const Jig& jig : jigs) {
    double on_bed_mm2 = 0;
    for (std::size_t t = 0; t < jig.surface.triangle.size(); ++t) {
      const Vector3d twice = jig.surface.twice_area(t);
      const auto corner = jig.surface.corners(t);
      const double lowest = std::min({corner[0].z(), corner[1].z(), corner[2].z()});
      const double highest = std::max({corner[0].z(), corner[1].z(), corner[2].z()});
      CHECK(lowest > -1e-9);
      if (highest < 1e-9) {
        on_bed_mm2 += 0.5 * twice.norm();
        continue;
      }
      CAPTURE(jig.surface.middle(t).transpose());
      CHECK(-twice.normalized().z() <= std::sqrt(0.5) + 1e-9);
    }
    CHECK(on_bed_mm2 > 1000);
  }
}

TEST_CASE_FIXTURE(Fixture,
                  "jig: every hole has a number of its own in the outer face, above it and read from outside") {
  for (const Jig& jig : jigs) {
    for (const JigHole& hole : jig.fit.holes) {
      // Seven bars, as a reader sees them: up along y, to the right along -x.
      const auto groove = [&](double right_mm, double up_mm) {
        Vector3d at = as_printed(jig, hole.contact_mm) + Vector3d(-right_mm, kJigBoreMm / 2 + 1.2 + up_mm, 0);
        at.z() = 0.15;
        return winding_number(jig.surface, at) < 0.5;
      };
      const std::array<bool, 7> bars = {groove(0.05, 4.5), groove(-1, 3.55), groove(1, 3.55),  groove(0.05, 2.5),
                                        groove(-1, 1.55),  groove(1, 1.55),  groove(0.05, 0.5)};
      constexpr std::array<int, 10> kBars = {0b1110111, 0b0010010, 0b1011101, 0b1011011, 0b0111010,
                                             0b1101011, 0b1101111, 0b1010010, 0b1111111, 0b1111011};
      int seen = 0;
      for (const bool bar : bars) seen = 2 * seen + bar;
      CAPTURE(hole.number);
      CHECK(seen == kBars[static_cast<std::size_t>(hole.number)]);
    }
  }
}

TEST_CASE_FIXTURE(Fixture, "jig: an independent checker (admesh) finds nothing to mend in the file") {
  if (std::system("command -v admesh >/dev/null") != 0) {
    MESSAGE("skipped: admesh is not installed");
    return;
  }
  for (const Jig& jig : jigs) {
    const TemporaryFolder folder;
    write_stl(folder.path() / "jig.stl", jig.surface);
    run_program({"admesh", "jig.stl"}, folder.path(), std::chrono::seconds(20), "admesh");
    const std::string log = read_file(folder.path() / "log");
    CAPTURE(log);
    for (const char* line :
         {"Number of parts       :     1", "Degenerate facets     :     0", "Edges fixed           :     0",
          "Facets removed        :     0", "Facets added          :     0", "Facets reversed       :     0",
          "Backwards edges       :     0", "Normals fixed         :     0"}) {
      CHECK_MESSAGE(log.find(line) != std::string::npos, line);
    }
    CHECK(log.find("All facets connected.") != std::string::npos);
  }
}

TEST_CASE_FIXTURE(Fixture, "jig: the drawing shows every hole and how it hangs") {
  const test::ScratchFolder folder;
  draw_jig(folder / "jig.svg", specs[0], jigs[0]);
  const std::string text = read_file(folder / "jig.svg");
  for (const JigHole& hole : jigs[0].fit.holes) {
    char x[32];
    std::snprintf(x, sizeof x, ">%.2f<", hole.contact_mm.x());
    CHECK(text.find(x) != std::string::npos);
  }
  CHECK(text.find("gravity") != std::string::npos);
  CHECK(text.ends_with("</svg>\n"));
}

TEST_CASE("jig: refuses a finger whose touches begin at its base") {
  FingerSpec spec = read_finger_spec(kFingers / "srm.toml");
  spec.touch_y_mm = {0, 5};
  CHECK_THROWS_WITH_AS(make_jig(spec), doctest::Contains("between the base and the lowest guide"), InputError);
}
