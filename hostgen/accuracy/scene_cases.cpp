#include "hostgen/accuracy/scene_cases.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <memory>
#include <numbers>
#include <stdexcept>

#include "hostgen/fem/scene_contacts.h"
#include "hostgen/fem/statics.h"
#include "hostgen/render/virtual_finger.h"
#include "hostgen/util/common.h"

namespace finsight::host {

namespace {

using Load = SceneCase::Load;
using Gravity = SceneCase::Gravity;

constexpr int kForces = 2;
constexpr double kTwoApart_mm[] = {20, 60};

/// Two points of the face, that far apart along its length or across it as there is room.
Eigen::Vector2d second_place(const FingerSpec& spec, const Eigen::Vector2d& first_mm, Random& random) {
  const double apart_mm = random.uniform(kTwoApart_mm[0], kTwoApart_mm[1]);
  const double up_mm = spec.touch_y_mm[1] - first_mm.y(), down_mm = first_mm.y() - spec.touch_y_mm[0];
  const double y = up_mm > down_mm ? std::min(apart_mm, up_mm) : -std::min(apart_mm, down_mm);
  const double x = std::sqrt(std::max(0.0, apart_mm * apart_mm - y * y));
  return first_mm + Eigen::Vector2d(first_mm.x() > 0 ? -x : x, y);
}

std::vector<FaceContact> contacts_of(const PushedFinger& finger, const SceneCase& scene_case,
                                     const Eigen::Vector2d& place_mm, Random& random) {
  const FingerSpec& spec = finger.spec;
  FaceContact contact{.centre_mm = place_mm, .full_force_n = spec.force_n[1]};
  const double sign = random.uniform() < 0.5 ? -1 : 1;
  switch (scene_case.load) {
    case Load::kPoint:
      break;
    case Load::kAlong:
      contact.friction = {0, scene_case.friction};
      break;
    case Load::kAgainst:
      contact.friction = {0, -scene_case.friction};
      break;
    case Load::kAcross:
      contact.friction = {sign * scene_case.friction, 0};
      break;
    case Load::kDisc:
      contact.radius_mm = 0.5 * scene_case.diameter_mm;
      contact.pressure = Pressure::kEven;
      break;
    case Load::kLine:
      contact.centre_mm.x() = 0;
      contact.half_length_mm = 2 * spec.half_width.at(place_mm.y());
      break;
    case Load::kTwo: {
      FaceContact second = contact;
      second.centre_mm = finger.inside(second_place(spec, place_mm, random));
      second.share = scene_case.second_share;
      contact.share = 1 - second.share;
      return {contact, second};
    }
    case Load::kSide:
      contact.side = sign > 0 ? Side::kLeft : Side::kRight;
      contact.centre_mm = {0.5 * (spec.front_z.at(place_mm.y()) + spec.back_z.at(place_mm.y())), place_mm.y()};
      break;
    case Load::kBack:
      contact.side = Side::kBack;
      break;
    case Load::kTip:
      contact.side = Side::kTip;
      contact.centre_mm = {place_mm.x(), 0.5 * (spec.front_z.at(spec.height_mm) + spec.back_z.at(spec.height_mm))};
      break;
    case Load::kAny:
      return draw_contacts(spec, spec.scene(scene_case.scenes.front()), place_mm, random);
  }
  return {contact};
}

ShapeMeasures measured(const TetMesh& mesh, const std::vector<double>& displacement_mm) {
  const std::vector<float> rest_mm(displacement_mm.size());
  const std::vector<std::int32_t> front(mesh.front_nodes.begin(), mesh.front_nodes.end());
  return measure_shape<double>(rest_mm, front, displacement_mm);
}

std::array<PlateMotion, kPlates> hanging(FingerStatics& statics, const FaceContact& somewhere,
                                         const Eigen::Vector3d& felt_g) {
  if (!statics.begin({somewhere}, felt_g)) throw std::runtime_error("the finger does not bear its own weight");
  return statics.state().plates;
}

}  // namespace

bool SceneCase::is_contained_in(const std::string& scene) const {
  return std::ranges::find(scenes, scene) != scenes.end();
}

std::vector<SceneCase> scene_cases() {
  constexpr double kDegree = std::numbers::pi / 180;
  const std::vector<std::string> all = {"probe", "grasp", "two"}, objects = {"grasp", "two"}, both = {"two"};
  std::vector<SceneCase> cases = {{.name = "frictionless point", .scenes = all}};
  const auto add = [&](SceneCase added) { cases.push_back(std::move(added)); };
  for (const auto& [friction, text] : {std::pair{0.2, "0.2"}, {0.4, "0.4"}, {0.6, "0.6"}}) {
    for (const auto& [load, where] : {std::pair{Load::kAlong, "away from the base"},
                                      {Load::kAgainst, "towards the base"},
                                      {Load::kAcross, "across"}}) {
      add({.name = std::string("friction ") + text + ", " + where,
           .scenes = objects,
           .load = load,
           .friction = friction});
    }
  }
  // Packs are made with the default mesh.
  add({.name = "frictionless point, fine mesh", .scenes = all, .mesh = MeshSize::kFine});
  add({.name = "friction 0.6, towards the base, fine mesh",
       .scenes = objects,
       .load = Load::kAgainst,
       .friction = 0.6,
       .mesh = MeshSize::kFine});
  for (const int diameter_mm : {5, 10, 20}) {
    add({.name = "disc of " + std::to_string(diameter_mm) + " mm",
         .scenes = objects,
         .load = Load::kDisc,
         .diameter_mm = static_cast<double>(diameter_mm)});
  }
  add({.name = "line across the face", .scenes = objects, .load = Load::kLine});
  add({.name = "Young's modulus x 0.8", .scenes = all, .stiffness = 0.8});
  add({.name = "Young's modulus x 1.25", .scenes = all, .stiffness = 1.25});
  add({.name = "walls 0.3 mm thinner", .wall_mm = -0.3});
  add({.name = "walls 0.3 mm thicker", .wall_mm = 0.3});
  add({.name = "markers 0.5 mm, 1 deg off, zeroed",
       .scenes = all,
       .marker_mm = 0.5 / std::sqrt(3.0),
       .marker_rad = kDegree / std::sqrt(3.0)});
  const double right_angle = 90 * kDegree;
  add({.name = "turned by 90 deg, known", .scenes = all, .gravity = Gravity::kKnown, .turned_rad = right_angle});
  add({.name = "turned by 90 deg, unknown", .scenes = all, .gravity = Gravity::kUnknown, .turned_rad = right_angle});
  add({.name = "turned by 180 deg, known", .scenes = all, .gravity = Gravity::kKnown, .turned_rad = 2 * right_angle});
  add({.name = "turned by 180 deg, unknown",
       .scenes = all,
       .gravity = Gravity::kUnknown,
       .turned_rad = 2 * right_angle});
  add({.name = "3 g, known", .scenes = all, .gravity = Gravity::kKnown, .turned_rad = right_angle, .felt_g = 3});
  add({.name = "3 g, unknown", .gravity = Gravity::kUnknown, .turned_rad = right_angle, .felt_g = 3});
  add({.name = "two points 1:1", .scenes = both, .load = Load::kTwo, .second_share = 0.5});
  add({.name = "two points 2:1", .scenes = both, .load = Load::kTwo, .second_share = 1.0 / 3});
  add({.name = "pushed at a side", .load = Load::kSide});
  add({.name = "pushed at the back", .load = Load::kBack});
  add({.name = "pushed at the tip", .load = Load::kTip});
  add({.name = "a plate came loose", .motion = SceneCase::Motion::kLoosePlate});
  add({.name = "swinging by 2 mm", .motion = SceneCase::Motion::kSwing});
  return cases;
}

FingerSpec spec_of(const FingerSpec& spec, const SceneCase& scene_case) {
  // The sides are open.
  FingerSpec other = with_walls(spec, scene_case.wall_mm, scene_case.wall_mm, 0);
  other.youngs_modulus_mpa *= scene_case.stiffness;
  return other;
}

std::vector<CaseState> solve_case(const FingerSpec& spec, const SceneCase& scene_case, int places) {
  const FingerSpec own = spec_of(spec, scene_case);
  const TetMesh mesh = make_mesh(own, scene_case.mesh);
  const auto finger = std::make_shared<const PushedFinger>(own, mesh);
  const std::vector<Vec3f> at = touch_points(spec, places);
  std::vector<std::vector<CaseState>> found(at.size());
  const bool hangs = scene_case.gravity != Gravity::kNone;
  parallel_for(at.size(), [&](std::size_t i) {
    Random random(7'000'000 + i);
    const Eigen::Vector2d away_mm(random.uniform(-4, 4), random.uniform(-4, 4));
    const Eigen::Vector2d place_mm = finger->inside(at[i].head<2>().cast<double>() + away_mm);
    const std::vector<FaceContact> contacts = contacts_of(*finger, scene_case, place_mm, random);
    FingerStatics statics(finger);
    CaseState solved{.state = {}, .shape = {}, .untouched = {}, .at_zero = {}};
    if (hangs) {
      solved.zero_g = random_direction(random);
      const Eigen::Vector3d axis = solved.zero_g.cross(random_direction(random)).normalized();
      solved.felt_g = scene_case.felt_g * (Eigen::AngleAxisd(scene_case.turned_rad, axis) * solved.zero_g);
      solved.untouched = hanging(statics, contacts.front(), solved.felt_g);
      solved.at_zero = hanging(statics, contacts.front(), solved.zero_g);
    }
    std::array<double, kForces> force_n;
    for (double& f : force_n) f = random.uniform(spec.force_n[0], spec.force_n[1]);
    std::ranges::sort(force_n);
    statics.begin(contacts, solved.felt_g);
    for (const double f : force_n) {
      if (!statics.press(f)) break;
      solved.state = statics.state();
      solved.state.path = static_cast<std::int32_t>(i);
      if (!solved.state.valid()) break;
      solved.shape = measured(mesh, statics.node_displacement_mm());
      found[i].push_back(solved);
    }
  });
  std::vector<CaseState> all;
  for (const auto& part : found) all.insert(all.end(), part.begin(), part.end());
  return all;
}

}  // namespace finsight::host
