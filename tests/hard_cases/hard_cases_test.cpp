#include "hostgen/hard_cases/hard_cases.h"

#include <doctest/doctest.h>

#include <cstdio>
#include <set>

#include "hostgen/hard_cases/hard_case.h"
#include "hostgen/hard_cases/hard_motions.h"
#include "tests/hard_cases/cube_finger.h"
#include "tests/random.h"
#include "tests/slow_build.h"

using namespace finsight;
using host::HardCaseResult;

namespace {

void check(const HardCaseResult& result) {
  char line[256];
  std::snprintf(line, sizeof line, "%-72s %6d frames, %4d flagged, %2d steps, %9.2e mm, at the end %9.2e mm%s",
                result.name.c_str(), result.frames, result.flagged, result.max_steps, result.worst_mm, result.end_mm,
                result.end_flagged ? ", flagged" : "");
  MESSAGE(line);
  CAPTURE(result.name);
  CHECK(result.non_finite == 0);
  CHECK(result.inverted_unflagged == 0);
  CHECK(result.inverted == 0);
  CHECK(result.max_steps <= result.allowed_steps);
  CHECK(result.worst_mm <= result.allowed_mm);
  CHECK(result.end_mm <= result.allowed_end_mm);
  CHECK((result.may_end_flagged || !result.end_flagged));
}

constexpr int kWalkFrames = test::kIsSlow ? 1000 : 100000;
const host::TetMesh kMesh = test::kIsSlow ? test::frame_mesh(2, 6, 5) : test::frame_mesh(4, 12, 5);

}  // namespace

TEST_CASE("hard cases: never a shape that is not finite or inverted, bounded work, and back to the truth") {
  const test::CubeFinger finger(kMesh);
  const std::vector<HardCaseResult> results = host::run_hard_cases(finger.parts(), 1000);
  CHECK(results.size() >= 40);
  std::set<std::string> names;
  for (const HardCaseResult& result : results) {
    check(result);
    names.insert(result.name);
  }
  CHECK(names.size() == results.size());
}

TEST_CASE("hard cases: poses at random for a second do not leave a coarse mesh in a wrong minimum") {
  const test::CubeFinger finger(test::frame_mesh(2, 6, 5));
  for (const std::uint64_t seed : {8, 10, 14, 22, 54}) {  // without the try from rest, one ends 0.6 mm off
    CAPTURE(seed);
    host::HardMotion motion(finger.mount);
    motion.bend({10, 3, 15}).bend({-5, 0, 0}).noise(20);
    test::Random random(100 + seed);
    for (PlatePoses& poses : motion.frames)
      for (PlateMotion& plate : poses.plates)
        for (int d = 0; d < 3; ++d) plate.displacement_mm[d] += static_cast<float>(0.3 * random.normal());
    constexpr double kAnyError_mm = 1e9;  // each pose may be one that no finger can take
    check(host::run_hard_case(finger.parts(),
                              {"random poses, seed " + std::to_string(seed), motion.hold(10), kAnyError_mm}));
  }
}

TEST_CASE("hard cases: a long random walk neither drifts nor gets stuck") {
  const test::CubeFinger finger(test::frame_mesh(2, 6, 5));
  check(host::run_random_walk(finger.parts(), kWalkFrames));
}
