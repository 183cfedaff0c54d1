#include "hostgen/fem/information.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <functional>
#include <memory>
#include <optional>

#include "firmware/model/model.h"
#include "hostgen/fem/statics.h"
#include "hostgen/util/common.h"
#include "hostgen/util/random.h"
#include "hostgen/util/statistics.h"

namespace finsight::host {

namespace {

constexpr double kFirm_mm = 4;
constexpr double kUnknown_g = 1;  // spread of gravity along each axis, where it is not known

/// One contact as numbers.
struct Numbers {
  double x_mm = 0, y_mm = 0, normal_n = 1, across_n = 0, along_n = 0, radius_mm = 0;
};

/// A number that is not known: how far it spreads in a scene, and the step of its difference quotient.
struct Unknown {
  std::string name;
  std::size_t contact;
  double Numbers::*number;
  double spread, step;
};

FaceContact contact_of(const Numbers& n, double total_n) {
  return {.centre_mm = {n.x_mm, n.y_mm},
          .radius_mm = n.radius_mm,
          .pressure = Pressure::kEven,
          .friction = Eigen::Vector2d(n.across_n, n.along_n) / n.normal_n,
          .follow = 0,
          .share = n.normal_n / total_n};
}

std::optional<PoseVectorOf<double>> motion(FingerStatics& statics, const std::vector<Numbers>& contacts) {
  double total_n = 0;
  for (const Numbers& n : contacts) total_n += n.normal_n;
  std::vector<FaceContact> load;
  for (const Numbers& n : contacts) load.push_back(contact_of(n, total_n));
  statics.begin(load);
  if (!statics.press(total_n)) return std::nullopt;
  const FemState state = statics.state();
  if (!state.valid()) return std::nullopt;
  PlatePoses poses;
  poses.plates = state.plates;
  return pose_vector(poses).cast<double>();
}

/// The standard deviations of the unknowns around these contacts; nothing where they do not bend the finger enough.
std::optional<Eigen::VectorXd> deviations(FingerStatics& statics, const FingerSpec& spec,
                                          const std::vector<Numbers>& contacts, const std::vector<Unknown>& unknowns,
                                          bool gravity_is_known) {
  const auto here = motion(statics, contacts);
  if (!here) return std::nullopt;
  if (plate_motion_mm(*here) < kFirm_mm) return std::nullopt;
  const auto count = static_cast<Eigen::Index>(unknowns.size()), all = count + (gravity_is_known ? 0 : 3);
  const PoseVectorOf<double> noise = pose_noise(spec.noise);
  Eigen::MatrixXd slope(kPoseDims, all);
  Eigen::VectorXd prior = Eigen::VectorXd::Constant(all, 1 / (kUnknown_g * kUnknown_g));
  if (!gravity_is_known) {
    const std::optional<MotionPerG> per_g = statics.motion_per_g();
    if (!per_g) return std::nullopt;
    slope.rightCols<3>() = noise.cwiseInverse().asDiagonal() * *per_g;
  }
  for (Eigen::Index k = 0; k < count; ++k) {
    const Unknown& unknown = unknowns[static_cast<std::size_t>(k)];
    std::vector<Numbers> changed = contacts;
    changed[unknown.contact].*unknown.number += unknown.step;
    const auto there = motion(statics, changed);
    if (!there) return std::nullopt;
    slope.col(k) = ((*there - *here) / unknown.step).cwiseQuotient(noise);
    prior[k] = 1 / (unknown.spread * unknown.spread);
  }
  Eigen::MatrixXd information = slope.transpose() * slope;
  information.diagonal() += prior;
  const Eigen::MatrixXd covariance = information.llt().solve(Eigen::MatrixXd::Identity(all, all));
  return covariance.diagonal().head(count).cwiseSqrt().eval();
}

std::vector<Unknown> of_contact(const FingerSpec& spec, std::size_t contact, bool with_friction) {
  const double half_y_mm = 0.5 * (spec.touch_y_mm[1] - spec.touch_y_mm[0]);
  const double force_n = spec.force_n[1] - spec.force_n[0], of_uniform = 1 / std::sqrt(3.0);
  const std::string suffix = contact == 0 ? "" : "_2";
  const Scene& scene = spec.scene("grasp");
  std::vector<Unknown> unknowns = {
      {"x_mm" + suffix, contact, &Numbers::x_mm, of_uniform * spec.half_width.at(spec.touch_y_mm[0]), 0.5},
      {"y_mm" + suffix, contact, &Numbers::y_mm, of_uniform * half_y_mm, 0.5},
      {"normal_n" + suffix, contact, &Numbers::normal_n, 0.5 * of_uniform * force_n, 0.05}};
  if (!with_friction) return unknowns;
  const double friction_n = 0.5 * scene.friction * 0.5 * (spec.force_n[0] + spec.force_n[1]);
  unknowns.push_back({"across_n" + suffix, contact, &Numbers::across_n, friction_n, 0.05});
  unknowns.push_back({"along_n" + suffix, contact, &Numbers::along_n, friction_n, 0.05});
  unknowns.push_back({"radius_mm" + suffix, contact, &Numbers::radius_mm, 0.5 * of_uniform * scene.patch_radius_mm, 1});
  return unknowns;
}

}  // namespace

std::vector<InformationLimit> information_limits(const FingerSpec& spec, int places) {
  const auto finger = std::make_shared<const PushedFinger>(spec, make_mesh(spec));
  const std::vector<Vec3f> at = touch_points(spec, places);
  struct Kind {
    std::string name;
    std::size_t contacts;
    bool with_friction, gravity_is_known = true;
  };
  std::vector<InformationLimit> limits;
  for (const Kind& kind : {Kind{"one push", 1, false}, Kind{"one patch with friction", 1, true},
                           Kind{"one patch with friction, and gravity", 1, true, false}, Kind{"two pushes", 2, false},
                           Kind{"two patches with friction", 2, true}}) {
    std::vector<Unknown> unknowns;
    for (std::size_t c = 0; c < kind.contacts; ++c) {
      for (Unknown& unknown : of_contact(spec, c, kind.with_friction)) unknowns.push_back(std::move(unknown));
    }
    std::vector<std::optional<Eigen::VectorXd>> found(at.size());
    parallel_for(at.size(), [&](std::size_t i) {
      Random random(31 * i + 5);
      FingerStatics statics(finger);
      std::vector<Numbers> contacts;
      for (std::size_t c = 0; c < kind.contacts; ++c) {
        Numbers n{.x_mm = 0.8 * static_cast<double>(at[i].x()),
                  .y_mm = static_cast<double>(at[i].y()),
                  .normal_n = random.uniform(2, spec.force_n[1]) / static_cast<double>(kind.contacts)};
        if (c == 1)
          n.y_mm += (n.y_mm > 0.5 * (spec.touch_y_mm[0] + spec.touch_y_mm[1]) ? -1 : 1) * random.uniform(20, 40);
        if (kind.with_friction) n.radius_mm = random.uniform(2, 8);
        contacts.push_back(n);
      }
      found[i] = deviations(statics, spec, contacts, unknowns, kind.gravity_is_known);
    });
    InformationLimit limit{.name = kind.name};
    for (std::size_t k = 0; k < unknowns.size(); ++k) {
      std::vector<double> values;
      for (const auto& one : found) {
        if (one) values.push_back((*one)[static_cast<Eigen::Index>(k)]);
      }
      limit.states = values.size();
      limit.deviations.emplace_back(unknowns[k].name, quantile(std::move(values), 0.5));
    }
    limits.push_back(limit);
  }
  return limits;
}

}  // namespace finsight::host
