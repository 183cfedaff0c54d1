#include "hostgen/fit/pressed_place.h"

#include <doctest/doctest.h>

#include <utility>

#include "hostgen/finger/jig_holes.h"

using namespace finsight;
using namespace finsight::host;

namespace {

PoseVectorOf<double> numbers_of(const std::array<PlateMotion, kPlates>& plates) {
  return pose_vector(PlatePoses{.plates = plates}).cast<double>();
}

}  // namespace

TEST_CASE("pressed place: motions between the solved ones are those of equilibria, also beside the tip's middle") {
  const FingerSpec spec = read_finger_spec(FINSIGHT_SOURCE_DIR "/hostgen/fingers/srm.toml");
  const PoseVectorOf<double> noise = pose_noise(spec.noise);
  FingerStatics statics(spec, make_mesh(spec));
  const std::vector<JigHole> holes = jig_holes(spec);
  for (const auto& [hole, highest_n] : {std::pair{4, 9.0}, {6, 5.1}, {6, 9.0}}) {  // the last is more than it bears
    const Vec3f hole_mm = holes[static_cast<std::size_t>(hole)].contact_mm.cast<float>();
    const PressedPlace place(statics, hole_mm, highest_n);
    CHECK(place.highest_n() > 3);
    for (const double share : {0.27, 0.52, 0.77, 0.96}) {
      const double force_n = share * place.highest_n();
      statics.reset();
      REQUIRE(statics.load(hole_mm, force_n));
      const PoseVectorOf<double> off = numbers_of(place.plates(force_n)) - numbers_of(statics.state().plates);
      CHECK(off.cwiseQuotient(noise).norm() < 0.5);
    }
  }
}

TEST_CASE("pressed place: a place that gives way under any force bears none") {
  const FingerSpec spec = read_finger_spec(FINSIGHT_SOURCE_DIR "/hostgen/fingers/srm.toml");
  FingerStatics statics(spec, make_mesh(spec));
  CHECK(PressedPlace(statics, jig_holes(spec)[6].contact_mm.cast<float>(), 1e6).highest_n() == 0);
}
