#include "hostgen/learn/scene_touches.h"

#include <algorithm>
#include <cmath>
#include <set>

#include "firmware/geometry/so3.h"
#include "hostgen/fem/scene_contacts.h"
#include "hostgen/learn/response_surface.h"
#include "hostgen/learn/touch_samples.h"
#include "hostgen/util/common.h"

namespace finsight::host {

namespace {

// Of the touches that are trained on.
constexpr double kOtherShare = 0.15;
// Of a path's largest force: fingers that are softer than the spec's bend as if they were pushed harder, and must not
// meet the end of what was learnt.
constexpr double kBeyondForce = 1.25;

/// Loads of contacts as the linear response and statics see them.
struct Loads {
  PoseVectorOf<double> linear = PoseVectorOf<double>::Zero();
  Eigen::Vector3d point_mm = Eigen::Vector3d::Zero();
  Eigen::Vector3d force_n = Eigen::Vector3d::Zero(), moment_nmm = Eigen::Vector3d::Zero();  ///< at rest; finger frame
};

class Neighbourhood {
 public:
  Neighbourhood(const PushedFinger& finger, const LinearResponse& response, const DatasetPlan& plan,
                const std::vector<FemState>& states)
      : finger_(finger),
        response_(response),
        plan_(plan),
        surface_(states, finger.spec.noise),
        paths_(load_paths(finger.spec, plan)),
        scenes_(other_scenes(finger.spec, plan)) {
    scenes_.insert(scenes_.begin(), finger.spec.scene(plan.scene));
    const FingerSpec& spec = finger.spec;
    std::set<std::int32_t> paths;
    for (const FemState& state : states) {
      if (state.valid()) paths.insert(state.path);
    }
    spacing_mm_ = spacing_mm(spec, static_cast<int>(paths.size()));
  }

  /// `state` after a change of its contacts by about as much as neighbouring states differ.
  TouchSample near(const FemState& state, Random& random) const {
    const FingerSpec& spec = finger_.spec;
    const Scene& scene = scenes_[state.scene];
    const double state_n = static_cast<double>(state.force_n);
    const double step_n = (spec.force_n[1] - spec.force_n[0]) / std::max(1, plan_.forces - 1);
    const double lowest_n = state_n < spec.force_n[0] + 0.5 * step_n ? 0 : state_n - 0.5 * step_n;
    const bool goes_beyond = state.step == plan_.forces - 1 && random.uniform() < 0.5;
    const double highest_n = goes_beyond ? kBeyondForce * state_n : state_n + 0.5 * step_n;
    const double force_n = random.uniform(lowest_n, highest_n);

    const LoadPath& path = paths_.at(static_cast<std::size_t>(state.path));
    const std::vector<FaceContact>& contacts = path.contacts_at(state.step);
    // Paths whose contacts change lie among each other.
    const double distance_mm = path.contacts.size() > 1 ? 0.5 * spacing_mm_ : spacing_mm_;
    std::vector<FaceContact> changed;
    for (const FaceContact& contact : contacts) {
      changed.push_back(vary(spec, scene, contact, distance_mm, random));
    }
    // The face turns about as the plates do. That only has to be near: what the force is called, is what it is.
    const Eigen::Vector3d turn =
        0.5 * (state.plates[kTopPlate].rotation_rad + state.plates[kMiddlePlate].rotation_rad).cast<double>();
    const Loads before = loads(contacts, state_n, turn);
    const Loads after = loads(changed, force_n, turn * force_n / state_n);
    TouchSample sample = between(state, before, after, force_n);
    sample.explained = state.scene == 0;
    sample.on_face = !scene.elsewhere;
    return sample;
  }

 private:
  Loads loads(const std::vector<FaceContact>& contacts, double normal_n, const Eigen::Vector3d& turn) const {
    Loads sum;
    for (const FaceContact& contact : contacts) {
      const double share_n = contact.share * normal_n;
      const Eigen::Matrix3d R = so3_exp(Eigen::Vector3d(contact.follow * turn));
      for (const PressureSpot& spot : pressure_spots(finger_, contact, share_n)) {
        const Eigen::Vector3d force_n = spot_force_n(contact, spot, share_n, R);
        sum.linear += response_.of(spot.at, force_n);
        sum.point_mm += contact.share * spot.share * spot.at.at_mm;
        sum.force_n += force_n;
        sum.moment_nmm += spot.at.at_mm.cross(force_n);
      }
    }
    return sum;
  }

  /// What is known exactly about `state`, changed by what the linear response and the surface say of the difference.
  TouchSample between(const FemState& state, const Loads& before, const Loads& after, double force_n) const {
    const PoseVector linear = state.linear + (after.linear - before.linear).cast<float>();
    TouchSample sample = touch_sample(state);
    sample.numbers += surface_.poses(linear) - surface_.poses(state.linear);
    sample.point_mm += (after.point_mm - before.point_mm).cast<float>();
    sample.displacement_mm += surface_.displacement_mm(linear) - surface_.displacement_mm(state.linear);
    sample.force_n = static_cast<float>(force_n);
    const Eigen::Matrix3d axes = face_axes(finger_.at(sample.point_mm.head<2>().cast<double>()).inward);
    const Eigen::Vector3d change_n = after.force_n - before.force_n;
    sample.force_vector_n += (axes.transpose() * change_n).cast<float>();
    // The forces' own places give the moment at rest; the touched point's displacement adds to their arm.
    const Eigen::Vector3d moved_before = (state.contact_mm - state.point_mm).cast<double>(),
                          moved_after = sample.displacement_mm.cast<double>();
    const Eigen::Vector3d moment_nmm = state.moment_nmm.cast<double>() + after.moment_nmm - before.moment_nmm +
                                       moved_after.cross(after.force_n) - moved_before.cross(before.force_n);
    sample.moment_nm = (moment_nmm / kNmmPerNm).cast<float>();
    return sample;
  }

  const PushedFinger& finger_;
  const LinearResponse& response_;
  const DatasetPlan& plan_;
  ResponseSurface surface_;
  const std::vector<LoadPath> paths_;
  std::vector<Scene> scenes_;  ///< the plan's, then the others
  double spacing_mm_ = 0;      ///< of the paths
};

}  // namespace

TouchSource touches_of_scene(const PushedFinger& finger, const LinearResponse& response, const DatasetPlan& plan) {
  return [&finger, &response, plan](const std::vector<FemState>& states, const std::vector<FemState>& others,
                                    std::size_t count, Random& random) {
    const Scene& scene = finger.spec.scene(plan.scene);
    std::vector<FemState> all = states;
    all.insert(all.end(), others.begin(), others.end());
    const Neighbourhood neighbourhood(finger, response, plan, all);
    std::vector<TouchSample> touches;
    touches.reserve(count);
    const std::size_t of_scene =
        others.empty() ? count : count - static_cast<std::size_t>(kOtherShare * static_cast<double>(count));
    // Of frictionless points a StateInterpolant can tell from neighbouring states; others have more to vary.
    if (!contacts_change(scene) && !scene.elsewhere) {
      touches = draw_touches(finger.spec, StateInterpolant(states), of_scene, random);
    }
    while (touches.size() < count) {
      if (interrupted()) throw Interrupted();
      const std::vector<FemState>& from = touches.size() < of_scene ? states : others;
      const FemState& state = from[random.index(from.size())];
      if (state.valid()) touches.push_back(neighbourhood.near(state, random));
    }
    return touches;
  };
}

}  // namespace finsight::host
