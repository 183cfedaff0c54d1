#include "hostgen/fem/contact.h"

#include <doctest/doctest.h>

#include <cmath>

#include "hostgen/fem/scene_contacts.h"
#include "hostgen/fem/statics.h"
#include "tests/fem/box_mesh.h"

using namespace finsight;
using namespace finsight::host;

namespace {

const std::shared_ptr<const PushedFinger>& column() {
  static const auto finger = std::make_shared<const PushedFinger>(test::small_finger_spec(), test::small_finger_mesh());
  return finger;
}

FemState pressed(const FaceContact& contact, double normal_n) {
  FingerStatics statics(column());
  statics.begin({contact});
  REQUIRE(statics.press(normal_n));
  return statics.state();
}

double sum_along(const std::vector<double>& nodal, int axis) {
  double sum = 0;
  for (std::size_t i = static_cast<std::size_t>(axis); i + 3 < nodal.size(); i += 3) sum += nodal[i];
  return sum;
}

}  // namespace

TEST_CASE("contact: a point without friction is the push that FingerStatics::load() applies") {
  FingerStatics pushed(column());
  REQUIRE(pushed.load(Vec3f(2, 40, 0), 0.3));
  const FemState one = pushed.state(), other = pressed({.centre_mm = {2, 40}, .follow = 0}, 0.3);
  CHECK((one.contact_mm - other.contact_mm).norm() < 1e-5);
  CHECK((one.force_vector_n - other.force_vector_n).norm() < 1e-6);
  CHECK((one.moment_nmm - other.moment_nmm).norm() < 1e-4);
  CHECK(other.spread_mm == 0);
}

TEST_CASE("contact: normal and tangential forces of a dead load are what was asked for") {
  const FemState state =
      pressed({.centre_mm = {-1, 35}, .radius_mm = 3, .full_force_n = 0.4, .friction = {0.5, -0.2}, .follow = 0}, 0.3);
  CHECK(double(state.force_vector_n[0]) == doctest::Approx(0.3));
  CHECK(double(state.force_vector_n[1]) == doctest::Approx(0.15));
  CHECK(double(state.force_vector_n[2]) == doctest::Approx(-0.06));
}

TEST_CASE("contact: across is the finger's x and along leads away from the base") {
  const Eigen::Matrix3d axes = face_axes(Eigen::Vector3d(0, -0.28, 0.96));
  CHECK((axes.col(1) - Eigen::Vector3d::UnitX()).norm() < 1e-12);
  CHECK(axes.col(2).y() > 0.9);
  CHECK(axes.determinant() == doctest::Approx(1));
}

TEST_CASE("contact: a force that follows keeps its angle to the face, a dead one its angle to the base") {
  FaceContact contact{.centre_mm = {0, 50}, .follow = 1};
  const FemState follows = pressed(contact, 0.4);
  contact.follow = 0;
  const FemState dead = pressed(contact, 0.4);
  CHECK(double(dead.force_vector_n[2]) == doctest::Approx(0).epsilon(1e-6));
  // Bent back, the face looks up: a force at right angles to it points down.
  const double turned_rad = double(follows.plates[kTopPlate].rotation_rad.x());
  REQUIRE(turned_rad > 0.05);
  CHECK(std::asin(-double(follows.force_vector_n[2]) / 0.4) == doctest::Approx(turned_rad).epsilon(0.1));
  CHECK(double(follows.force_vector_n.norm()) == doctest::Approx(0.4));
}

TEST_CASE("contact: the moment is that of the nodal forces on the deformed finger") {
  FingerStatics statics(column());
  statics.begin({{.centre_mm = {2, 45}, .radius_mm = 3, .full_force_n = 0.3, .friction = {0.3, 0.3}}});
  REQUIRE(statics.press(0.3));
  const std::vector<double> moved_mm = statics.quadratic_displacement_mm();
  Eigen::Vector3d moment_nmm = Eigen::Vector3d::Zero();
  for (std::size_t i = 0; i < column()->mesh.node_mm.size(); ++i) {
    const int unknown = column()->body.unknown_of_node()[i];
    if (unknown == column()->body.free_nodes()) continue;
    const Eigen::Map<const Eigen::Vector3d> force_n(&statics.nodal_forces()[3 * static_cast<std::size_t>(unknown)]);
    moment_nmm += (column()->mesh.node_mm[i] + Eigen::Map<const Eigen::Vector3d>(&moved_mm[3 * i])).cross(force_n);
  }
  CHECK((statics.state().moment_nmm.cast<double>() - moment_nmm).norm() < 1e-4);
  CHECK(sum_along(statics.nodal_forces(), 0) == doctest::Approx(0.09).epsilon(0.02));
}

TEST_CASE("contact: pressure falls to the edge as contact mechanics says") {
  // RMS radius over radius: sqrt(2/5) for Hertz, sqrt(1/2) for even pressure, sqrt(2/3) for a rigid flat end.
  const std::pair<Pressure, double> known[] = {
      {Pressure::kRound, std::sqrt(0.4)}, {Pressure::kEven, std::sqrt(0.5)}, {Pressure::kFlatEnd, std::sqrt(2.0 / 3)}};
  for (const auto& [pressure, share] : known) {
    const FemState state =
        pressed({.centre_mm = {0, 35}, .radius_mm = 4, .full_force_n = 0.2, .pressure = pressure, .follow = 0}, 0.2);
    CHECK(double(state.spread_mm) == doctest::Approx(4 * share).epsilon(0.03));
  }
}

TEST_CASE("contact: a round patch grows with the cube root of its force, a line with the square root") {
  const auto spread_mm = [](const FaceContact& contact, double force_n) {
    double sum = 0;
    for (const PressureSpot& spot : pressure_spots(*column(), contact, force_n)) {
      sum += spot.share * std::pow(spot.at.at_mm.y() - 35, 2);
    }
    return std::sqrt(sum);
  };
  const FaceContact disc{.centre_mm = {0, 35}, .radius_mm = 4, .full_force_n = 0.8};
  CHECK(spread_mm(disc, 0.1) == doctest::Approx(spread_mm(disc, 0.8) / 2).epsilon(1e-6));
  FaceContact line = disc;
  line.half_length_mm = 3;
  CHECK(spread_mm(line, 0.2) == doctest::Approx(spread_mm(line, 0.8) / 2).epsilon(1e-6));
}

TEST_CASE("contact: what lies beside the face carries nothing, and a contact beside it is refused") {
  const FemState state = pressed(
      {.centre_mm = {0, 40}, .half_length_mm = 30, .full_force_n = 0.2, .pressure = Pressure::kEven, .follow = 0}, 0.2);
  CHECK(double(state.force_vector_n[0]) == doctest::Approx(0.2));
  CHECK(double(state.spread_mm) == doctest::Approx(12 / std::sqrt(12.0)).epsilon(0.1));  // as wide as the face
  CHECK_THROWS_AS(ContactLoad(*column(), {{.centre_mm = {60, 40}}}), std::invalid_argument);
}

TEST_CASE("scene contacts: kinds of touch differ by friction and patch, as far as the scene has them") {
  const FingerSpec spec = read_finger_spec(FINSIGHT_SOURCE_DIR "/hostgen/fingers/srm.toml");
  const Eigen::Vector2d place_mm(3, 60);
  Random random(2);
  for (int k = 0; k < 10 * kAnyTouch; ++k) {
    const int kind = k % kAnyTouch;
    CAPTURE(kind);
    const FaceContact contact = draw_kind(spec, spec.scene("grasp"), kind, place_mm, random).at(0);
    const Eigen::Vector2d& friction = contact.friction;
    const bool rubs = kind >= 1 && kind <= 9, is_patch = kind >= 10 && kind <= 12, is_line = kind >= 13;
    CHECK(friction.norm() == doctest::Approx(rubs ? 0.2 * ((kind - 1) / 3 + 1) : 0));
    if (rubs && kind % 3 == 1) CHECK(friction.y() > 0.98 * friction.norm());
    if (rubs && kind % 3 == 2) CHECK(friction.y() < -0.98 * friction.norm());
    if (rubs && kind % 3 == 0) CHECK(std::abs(friction.x()) > 0.98 * friction.norm());
    if (is_patch) CHECK(contact.radius_mm >= 4 * (kind - 10));
    if (is_patch) CHECK(contact.radius_mm <= 4 * (kind - 9));
    if (!is_patch && !is_line) CHECK(contact.radius_mm == 0);
    CHECK((contact.half_length_mm > spec.half_width.at(60)) == is_line);
    CHECK((contact.angle_rad != 0) == (kind == 14));
    CHECK(contact.follow == 1);
    CHECK(contact.centre_mm == (is_line ? Eigen::Vector2d(0, 60) : place_mm));

    const FaceContact point = draw_kind(spec, spec.scene("probe"), kind, place_mm, random).at(0);
    CHECK(point.friction.norm() == 0);
    CHECK(point.radius_mm == 0);
    CHECK(point.half_length_mm == 0);
    const std::vector<FaceContact> two = draw_kind(spec, spec.scene("two"), kind, place_mm, random);
    REQUIRE(two.size() == 2);
    CHECK(two[0].share + two[1].share == doctest::Approx(1));
  }
}

TEST_CASE("scene contacts: the last kind of touch is any of the scene") {
  const FingerSpec spec = read_finger_spec(FINSIGHT_SOURCE_DIR "/hostgen/fingers/srm.toml");
  Random random(2), same(2);
  for (int i = 0; i < 20; ++i) {
    const FaceContact contact = draw_kind(spec, spec.scene("grasp"), kAnyTouch, {3, 60}, random).at(0);
    const FaceContact drawn = draw_contacts(spec, spec.scene("grasp"), {3, 60}, same).at(0);
    CHECK(contact.friction == drawn.friction);
    CHECK(contact.radius_mm == drawn.radius_mm);
    CHECK(contact.half_length_mm == drawn.half_length_mm);
  }
}

TEST_CASE("scene contacts: stay within the scene's numbers and are the same for the same seed") {
  const FingerSpec spec = read_finger_spec(FINSIGHT_SOURCE_DIR "/hostgen/fingers/srm.toml");
  for (const Scene& scene : common_scenes()) {
    Random random(5), same(5);
    int lines = 0, sliding = 0, turning = 0;
    double most_friction = 0;
    constexpr int kDraws = 400;
    for (int i = 0; i < kDraws; ++i) {
      const std::vector<FaceContact> contacts = draw_contacts(spec, scene, {3, 60}, random);
      REQUIRE(contacts.size() == static_cast<std::size_t>(scene.contacts));
      CHECK(contacts[0].friction == draw_contacts(spec, scene, {3, 60}, same)[0].friction);
      for (const FaceContact& contact : contacts) {
        most_friction = std::max(most_friction, contact.friction.norm());
        sliding += contact.friction.norm() > 0.9999 * scene.friction;
        turning += contact.follow == 1;
        lines += contact.half_length_mm > 0;
        if (contact.half_length_mm > spec.half_width.at(contact.centre_mm.y())) CHECK(std::abs(contact.angle_rad) <= 0.3);
        if (contact.half_length_mm == 0) CHECK(contact.radius_mm <= scene.patch_radius_mm);
        const FaceContact other = vary(spec, scene, contact, 4, random);
        CHECK(other.friction.norm() <= 1.25 * scene.friction + 1e-12);
        CHECK(other.side == contact.side);
        if (contact.side == Side::kFront) CHECK(std::abs(other.centre_mm.y() - 60) <= 60);
        CHECK((other.half_length_mm > 0) == (contact.half_length_mm > 0));
      }
      same = random;
    }
    CHECK(most_friction <= scene.friction * (1 + 1e-12));
    CHECK(most_friction >= 0.95 * scene.friction);
    if (scene.friction > 0 && !scene.elsewhere) {
      CHECK(std::abs(double(sliding) / (kDraws * scene.contacts) - 0.425) < 0.06);
      CHECK(std::abs(double(turning) / (kDraws * scene.contacts) - 0.75) < 0.06);
    }
    CHECK((lines > 0) == (scene.line_share > 0));
    if (scene.contacts < 2) continue;
    const std::vector<FaceContact> two = draw_contacts(spec, scene, {0, 60}, random);
    CHECK(two[0].share + two[1].share == doctest::Approx(1));
  }
}
