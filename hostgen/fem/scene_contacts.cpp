#include "hostgen/fem/scene_contacts.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "hostgen/finger/surface_finger.h"

namespace finsight::host {

namespace {

constexpr double kPointShare = 0.25;         // of the round patches: too small for their size to matter
constexpr double kFrictionlessShare = 0.15;  // of the touches in a scene with friction
// Of the touches with friction: an object that slides rubs as much as it can. Were the largest friction the rarest, as
// it is along any one direction of a disc, the network would take it for less.
constexpr double kSlidingShare = 0.5;
// Of the touches with friction: the force turns with the face that it rubs on. One that keeps its direction while the
// finger bends away rubs more and more towards the tip; were all like that, what rubs towards the base would be rare.
constexpr double kTurningShare = 0.75;
constexpr double kWholeWidthShare = 0.5;  // of the lines: longer than the face is wide ...
constexpr double kWholeWidths = 1.5;      // ... by so many times
constexpr double kLevelShare = 0.6;       // of the other lines: across to within kLevel_rad, as all long ones
constexpr double kLevel_rad = 0.3;
constexpr std::array kPressures = {Pressure::kRound, Pressure::kEven, Pressure::kFlatEnd};
constexpr double kShortestLine_mm = 4, kWidestLine_mm = 6;
// A network that never met more than the scene's friction takes all that comes near it for less.
constexpr double kBeyondFriction = 1.25;
// Changes that go with moving a contact by a millimetre.
constexpr double kFrictionPerMm = 0.075, kFollowPerMm = 0.15, kAnglePerMm_rad = 0.075;

Eigen::Vector2d in_disc(double radius, Random& random) {
  const double r = radius * std::sqrt(random.uniform()), angle = random.uniform(0, 2 * std::numbers::pi);
  return {r * std::cos(angle), r * std::sin(angle)};
}

Eigen::Vector2d on_circle(double radius, Random& random) {
  const double angle = random.uniform(0, 2 * std::numbers::pi);
  return {radius * std::cos(angle), radius * std::sin(angle)};
}

double half_width_mm(const FingerSpec& spec, double y_mm) { return spec.half_width.at(y_mm) - spec.touch_edge_mm; }

Eigen::Vector2d on_face(const FingerSpec& spec, const Eigen::Vector2d& place_mm) {
  const double y = std::clamp(place_mm.y(), spec.touch_y_mm[0], spec.touch_y_mm[1]), half = half_width_mm(spec, y);
  return {std::clamp(place_mm.x(), -half, half), y};
}

FaceContact draw_contact(const FingerSpec& spec, const Scene& scene, const Eigen::Vector2d& place_mm, Random& random) {
  FaceContact contact{.centre_mm = place_mm, .full_force_n = spec.force_n[1], .follow = 0};
  if (random.uniform() < scene.line_share) {
    const double face_mm = 2 * spec.half_width.at(place_mm.y());
    const bool whole = random.uniform() < kWholeWidthShare;
    contact.half_length_mm = 0.5 * (whole ? kWholeWidths * face_mm : random.uniform(kShortestLine_mm, face_mm));
    if (whole) contact.centre_mm.x() = 0;
    const bool level = random.uniform() < kLevelShare || whole;
    const double steepest = level ? kLevel_rad : 0.5 * std::numbers::pi;
    contact.angle_rad = random.uniform(-steepest, steepest);
    contact.radius_mm = 0.5 * random.uniform(0, kWidestLine_mm);
    contact.pressure = random.uniform() < 0.5 ? Pressure::kRound : Pressure::kEven;
  } else if (scene.patch_radius_mm > 0 && random.uniform() >= kPointShare) {
    contact.radius_mm = random.uniform(0, scene.patch_radius_mm);
    contact.pressure = kPressures[random.index(kPressures.size())];
  }
  if (scene.friction > 0) {
    if (random.uniform() >= kFrictionlessShare) {
      const bool slides = random.uniform() < kSlidingShare;
      contact.friction = slides ? on_circle(scene.friction, random) : in_disc(scene.friction, random);
    }
    contact.follow = random.uniform() < kTurningShare ? 1 : random.uniform();
  }
  return contact;
}

/// See kKindsOfTouch. `drawn`: of the scene; all kinds but the last take its share alone.
FaceContact contact_of_kind(const FingerSpec& spec, const Scene& scene, int kind, const FaceContact& drawn,
                            const Eigen::Vector2d& place_mm, Random& random) {
  constexpr int kFirstPatch = 10, kLine = 13, kSlantedLine = 14, kThirds = 3;
  constexpr double kAside_rad = 0.15;  // a force points away from the base, towards it or across within this
  if (kind == kAnyTouch) return drawn;
  FaceContact contact{.centre_mm = place_mm, .full_force_n = drawn.full_force_n, .share = drawn.share};
  // A force that does not turn with the face rubs on it.
  contact.follow = scene.friction > 0 ? 1 : drawn.follow;
  if (kind > 0 && kind < kFirstPatch) {
    const double friction = scene.friction * ((kind - 1) / kThirds + 1) / kThirds;
    const double across_rad = random.uniform() < 0.5 ? 0 : std::numbers::pi;
    const double directions_rad[] = {0.5 * std::numbers::pi, -0.5 * std::numbers::pi, across_rad};
    const double angle_rad = directions_rad[(kind - 1) % kThirds] + random.uniform(-kAside_rad, kAside_rad);
    contact.friction = friction * Eigen::Vector2d(std::cos(angle_rad), std::sin(angle_rad));
  } else if (kind >= kFirstPatch && kind < kLine) {
    contact.radius_mm = scene.patch_radius_mm * (kind - kFirstPatch + random.uniform()) / kThirds;
    contact.pressure = kPressures[random.index(kPressures.size())];
  } else if (kind >= kLine && scene.line_share > 0) {
    contact.centre_mm.x() = 0;
    contact.half_length_mm = kWholeWidths * spec.half_width.at(place_mm.y());
    if (kind == kSlantedLine) contact.angle_rad = random.uniform(-kLevel_rad, kLevel_rad);
    contact.radius_mm = 0.5 * random.uniform(0, kWidestLine_mm);
  }
  return contact;
}

/// All of the finger, or more.
Eigen::AlignedBox3d box_mm(const FingerSpec& spec) {
  Eigen::AlignedBox3d box;
  if (spec.surface) {
    for (const Eigen::Vector3d& at : spec.surface->surface.point_mm) box.extend(at);
    return box;
  }
  for (const double y : {0.0, spec.height_mm}) {
    box.extend(Eigen::Vector3d(-spec.half_width.at(y), y, spec.front_z.at(y)));
    box.extend(Eigen::Vector3d(spec.half_width.at(y), y, spec.back_z.at(y)));
  }
  return box;
}

FaceContact draw_elsewhere(const FingerSpec& spec, const Scene& scene, Random& random) {
  constexpr std::array kSides = {Side::kLeft, Side::kRight, Side::kBack, Side::kTip};
  FaceContact contact{.side = kSides[random.index(kSides.size())], .full_force_n = spec.force_n[1], .follow = 0};
  const Eigen::Matrix3d axes = side_axes(contact.side);
  const Eigen::AlignedBox3d box = box_mm(spec);
  Eigen::Vector3d at_mm;
  for (int i = 0; i < 3; ++i) at_mm[i] = random.uniform(box.min()[i], box.max()[i]);
  at_mm.y() = std::clamp(at_mm.y(), spec.touch_y_mm[0], spec.height_mm);
  contact.centre_mm = (axes.transpose() * at_mm).head<2>();
  contact.friction = in_disc(scene.friction, random);
  return contact;
}

}  // namespace

std::vector<FaceContact> draw_contacts(const FingerSpec& spec, const Scene& scene, const Eigen::Vector2d& place_mm,
                                       Random& random) {
  if (scene.elsewhere) return {draw_elsewhere(spec, scene, random)};
  std::vector<FaceContact> contacts = {draw_contact(spec, scene, place_mm, random)};
  if (scene.contacts == 1) return contacts;
  const double away_mm = random.uniform(scene.apart_mm[0], scene.apart_mm[1]);
  // The direction in which the face has room for the second contact; of several tries the one that fits best.
  constexpr int kTries = 30;
  Eigen::Vector2d best = place_mm;
  for (int k = 0; k < kTries; ++k) {
    const double angle = random.uniform(0, 2 * std::numbers::pi);
    const Eigen::Vector2d place = on_face(spec, place_mm + away_mm * Eigen::Vector2d(std::cos(angle), std::sin(angle)));
    if (std::abs((place - place_mm).norm() - away_mm) < std::abs((best - place_mm).norm() - away_mm)) best = place;
  }
  contacts.push_back(draw_contact(spec, scene, best, random));
  contacts[0].share = random.uniform(0.25, 0.75);
  contacts[1].share = 1 - contacts[0].share;
  return contacts;
}

std::vector<FaceContact> draw_kind(const FingerSpec& spec, const Scene& scene, int kind,
                                   const Eigen::Vector2d& place_mm, Random& random) {
  std::vector<FaceContact> contacts = draw_contacts(spec, scene, place_mm, random);
  if (scene.elsewhere) return contacts;
  contacts.front() = contact_of_kind(spec, scene, kind, contacts.front(), place_mm, random);
  return contacts;
}

Eigen::Vector2d place_near(const FingerSpec& spec, const Eigen::Vector2d& place_mm, double distance_mm,
                           Random& random) {
  const Eigen::Vector2d away_mm = distance_mm * Eigen::Vector2d(random.normal(), random.normal());
  return on_face(spec, place_mm + away_mm);
}

FaceContact vary(const FingerSpec& spec, const Scene& scene, const FaceContact& contact, double distance_mm,
                 Random& random) {
  FaceContact other = contact;
  other.centre_mm += distance_mm * Eigen::Vector2d(random.normal(), random.normal());
  if (contact.side == Side::kFront) other.centre_mm = on_face(spec, other.centre_mm);
  if (other.half_length_mm > spec.half_width.at(other.centre_mm.y())) other.centre_mm.x() = contact.centre_mm.x();
  if (other.half_length_mm > 0) other.angle_rad += kAnglePerMm_rad * distance_mm * random.normal();
  if (other.radius_mm > 0 && other.half_length_mm == 0) {
    other.radius_mm = std::clamp(other.radius_mm + distance_mm * random.normal(), 0.0, scene.patch_radius_mm);
  }
  if (scene.friction > 0) {
    other.friction += kFrictionPerMm * distance_mm * Eigen::Vector2d(random.normal(), random.normal());
    const double most = kBeyondFriction * scene.friction;
    if (other.friction.norm() > most) other.friction *= most / other.friction.norm();
    other.follow = std::clamp(other.follow + kFollowPerMm * distance_mm * random.normal(), 0.0, 1.0);
  }
  return other;
}

}  // namespace finsight::host
