#include "hostgen/hard_cases/hard_search.h"

#include <doctest/doctest.h>

#include <stdexcept>

#include "tests/hard_cases/cube_finger.h"
#include "tests/slow_build.h"

using namespace finsight;
using namespace finsight::host;

namespace {

const test::CubeFinger& finger() {
  static const test::CubeFinger kFinger(test::frame_mesh(2, 6, 5));
  return kFinger;
}

// What a search of 10,000 motions found worst, and small cases of each kind that were close to a limit once.
constexpr const char* kKept[] = {
    "bend 10 0 -78 in 1",
    "plates t 0 -40 0 0 0 3 in 2; lose tm for 4",
    "bend 30 0 90 in 2; noise 50 for 10; bend -30 0 -90 in 1",
    "plates tml 20 -20 20 2 2 2 in 1; lose tml for 3; bend 0 15 0 in 1",
    "lose tml for 20; bend 35 -15 90 in 3; noise 20 for 20",
};

}  // namespace

TEST_CASE("hard search: a case is the same when it is read from its text") {
  const char* text = "bend 30 -1.5 45 in 1; plates tl 0 -40 0 1.5 0 0 in 5; lose m for 10; noise 20 for 30";
  const std::vector<HardAct> acts = parse_hard_acts(text);
  CHECK(text_of(acts) == text);
  REQUIRE(acts.size() == 4);
  CHECK(acts[1].number[1] == -40);
  CHECK(acts[1].plates == std::array<bool, kPlates>{true, false, true});
  CHECK(make_hard_motion(finger().mount, acts).frames.size() == 1 + 1 + 5 + 5 + 15 + 10 + 10);
  for (const char* wrong : {"jump 1 2 3 in 1", "bend 1 2 in 3", "bend 1 2 3 in 0", "lose t for"}) {
    CAPTURE(wrong);
    CHECK_THROWS_AS(parse_hard_acts(wrong), std::invalid_argument);
  }
}

TEST_CASE("hard search: the acts reach the frames: plates go, are not seen, and are disturbed until the last pose") {
  const std::vector<PlatePoses> frames =
      make_hard_motion(finger().mount, parse_hard_acts("lose t for 6; noise 5 for 2; plates m 0 0 7 0 0 0 in 1"))
          .frames;
  CHECK(frames[0].seen_count() == kPlates);
  CHECK_FALSE(frames[1].seen[kTopPlate]);
  CHECK(frames[4].plates[kLowPlate].displacement_mm.norm() > 0);
  CHECK(frames[5].plates[kMiddlePlate].displacement_mm.z() > 6);
  CHECK(frames[frames.size() - 12].seen_count() == kPlates);
  for (std::size_t k = 1; k <= 11; ++k) {
    CHECK(pose_vector(frames[frames.size() - k]) == pose_vector(make_hard_motion(finger().mount, {}).frames.back()));
  }
}

TEST_CASE("hard search: random motions of every kind hold, and the same seed finds the same") {
  const ShapeParts parts = finger().parts();
  const HardCaseSearch search(parts);
  constexpr int kMotions = test::kIsSlow ? 10 : 300;
  const HardSearch found = search.search(kMotions, 5);
  CHECK(found.bad == 0);
  REQUIRE(found.worst.size() == 10);
  MESSAGE(found.worst[0].result.name << ": " << found.worst[0].result.worst_mm << " mm; small: "
                                     << found.small.result.name << ": " << found.small.result.worst_mm << " mm");
  CHECK(found.worst[0].result.worst_mm > 0);
  CHECK(found.worst[0].result.worst_mm >= found.worst[9].result.worst_mm);
  CHECK(found.small.result.worst_mm >= 0.7 * found.worst[0].result.worst_mm);
  CHECK(found.small.result.frames <= found.worst[0].result.frames);
  const HardSearch again = search.search(kMotions, 5);
  CHECK(again.small.result.name == found.small.result.name);
  CHECK(search.search(kMotions, 6).worst[0].result.name != found.worst[0].result.name);
}

TEST_CASE("hard search: the small cases of earlier searches hold") {
  const ShapeParts parts = finger().parts();
  const HardCaseSearch search(parts);
  for (const char* text : kKept) {
    CAPTURE(text);
    const FoundCase found = search.run(parse_hard_acts(text));
    CAPTURE(found.result.end_mm);
    CHECK(found.result.good());
    CHECK(found.settling_frames <= 2);
  }
}
