#include "hostgen/probe/probe.h"

#include <doctest/doctest.h>

#include <sstream>

#include "firmware/input_error.h"
#include "firmware/settings/toml_table.h"
#include "tests/fem/box_mesh.h"
#include "tests/model/scratch_folder.h"

using namespace finsight;
using namespace finsight::host;

namespace {

const std::filesystem::path kFingers = FINSIGHT_SOURCE_DIR "/hostgen/fingers";

constexpr double kUnhurried_s = 7200;  // an emulated or busy processor must not change what is found

FingerSpec column() {
  FingerSpec spec = test::small_finger_spec();
  spec.threshold_mm = 0.5;
  return spec;
}

}  // namespace

TEST_CASE("probe: every place is pushed up to the spec's force, or up to what it bears") {
  FingerSpec spec = column();
  const Probe gentle = probe_finger(spec, test::small_finger_mesh(), kUnhurried_s);
  REQUIRE(gentle.places.size() == 3);
  for (const ProbedPlace& place : gentle.places) {
    CHECK(place.end == Outcome::kEquilibrium);
    CHECK(place.borne_n() == doctest::Approx(0.4));
    CHECK(place.states.back().front_rms_mm > 0);
  }
  CHECK(gentle.factor_mb > 0);
  spec.force_n = {1, 40};
  const Probe rough = probe_finger(spec, test::small_finger_mesh(), kUnhurried_s);
  for (const ProbedPlace& place : rough.places) {
    CAPTURE(place.point_mm.y());
    CHECK(place.end != Outcome::kEquilibrium);
    CHECK(place.borne_n() >= kWeakestPush_n);
    CHECK(place.borne_n() < place.failed_n);
    CHECK(place.failed_n < 2.01 * place.borne_n());  // the limit is between
  }
}

TEST_CASE("probe: ends when its time is over, and proposes nothing from nothing") {
  const Probe probe = probe_finger(column(), test::small_finger_mesh(), 0);
  for (const ProbedPlace& place : probe.places) {
    CHECK(place.cut_short);
    CHECK(place.states.empty());
    CHECK(place.end == Outcome::kEquilibrium);
  }
  CHECK_NOTHROW(check_worth_building(column(), probe));
  CHECK(proposal_text(column(), probe).starts_with("# nothing"));
}

TEST_CASE("probe: a finger that no pack can come of is refused, with the number to change") {
  FingerSpec spec = column();
  const Probe probe = probe_finger(spec, test::small_finger_mesh(), kUnhurried_s);
  CHECK_NOTHROW(check_worth_building(spec, probe));
  spec.threshold_mm = 50;
  CHECK_THROWS_WITH_AS(check_worth_building(spec, probe),
                       doctest::Contains("touch.threshold_mm: found 50 mm, but none of 3 probed places moves a plate"),
                       InputError);
  Probe nothing = probe;
  for (ProbedPlace& place : nothing.places) {
    place.states.clear();
    place.end = Outcome::kNotConverged;
    place.failed_n = 0.05;
  }
  CHECK_THROWS_WITH_AS(check_worth_building(spec, nothing), doctest::Contains("numerical"), InputError);
  for (ProbedPlace& place : nothing.places) place.end = Outcome::kNoEquilibrium;
  CHECK_THROWS_WITH_AS(check_worth_building(spec, nothing), doctest::Contains("buckles"), InputError);
}

TEST_CASE("probe: a finger whose plates move less than the camera tells gets no numbers, but what would help") {
  FingerSpec spec = column();
  Probe probe = probe_finger(spec, test::small_finger_mesh(), kUnhurried_s);
  for (ProbedPlace& place : probe.places) {
    for (FemState& state : place.states) {
      for (PlateMotion& plate : state.plates) plate = {};
    }
  }
  const std::string text = proposal_text(spec, probe);
  CHECK(text.find("[touch]") == std::string::npos);
  CHECK(text.find("a softer finger") != std::string::npos);
}

TEST_CASE("probe: what it proposes for the paper's finger is a spec, and near what was chosen by hand") {
  const FingerSpec spec = read_finger_spec(kFingers / "srm.toml");
  Probe probe = probe_finger(spec, make_mesh(spec, MeshSize::kCoarse), kUnhurried_s);
  const std::string text = proposal_text(spec, probe);
  CAPTURE(text);
  const test::ScratchFolder folder;
  TomlTable proposed = TomlTable::parse_file(folder.write("proposed.toml", text));
  TomlTable touch = proposed.table("touch");
  const std::vector<double> force_n = touch.numbers("force_n", 2, 0, 100);
  CHECK(force_n[0] <= 1);
  CHECK(force_n[1] > 3);
  CHECK(force_n[1] <= 6);
  const double threshold_mm = touch.number("threshold_mm", 0, 100);
  CHECK(threshold_mm > 0.5);
  CHECK(threshold_mm <= 2);
  CHECK(touch.number("rated_deformation_mm", 0.01, 100) == doctest::Approx(6).epsilon(0.5));
  TomlTable plates = proposed.table("plates");
  for (std::size_t p = 0; p < kPlates; ++p) {
    TomlTable plate = plates.table(kPlateNames[p]);
    const double inward_mm = plate.table("range").number("inward_mm", 0, 100);
    CHECK(inward_mm == doctest::Approx(spec.plates[p].range.inward_mm).epsilon(0.5));
    TomlTable noise = plate.table("noise");
    // Made from the same picture size and corner noise as the spec's, by another way.
    CHECK(noise.number("lateral_mm", 0, 10) == doctest::Approx(spec.noise[p].lateral_mm).epsilon(0.6));
    CHECK(noise.number("depth_mm", 0, 10) == doctest::Approx(spec.noise[p].depth_mm).epsilon(0.6));
  }

  // Places that were pushed with none of the forces that are proposed still tell how far plates move under them, and
  // those that were not tried count for nothing.
  for (ProbedPlace& place : probe.places) {
    place.states.erase(place.states.begin(), place.states.end() - 1);
    place.states.back().force_n = 4.19F;
  }
  probe.places[4].states.clear();
  probe.places[4].end = Outcome::kEquilibrium;
  const std::string other = proposal_text(spec, probe);
  CAPTURE(other);
  CHECK(other.find("from 8 of 9 places") != std::string::npos);
  CHECK(other.find(", 4.1]") != std::string::npos);
  CHECK(other.find("inward_mm = 0,") == std::string::npos);
  CHECK(other.find("= -0") == std::string::npos);
}
