#include "hostgen/learn/scene_touches.h"

#include "hostgen/learn/touch_samples.h"
#include "hostgen/util/common.h"

namespace finsight::host {

namespace {

// Of the touches that are trained on.
constexpr double kOtherShare = 0.15;

const FemState& one_of(const FemState& state, Random& random) {
  const std::size_t i = random.index(state.nearby.size() + 1);
  return i == 0 ? state : state.nearby[i - 1];
}

/// Shares of two loads together: to first order, their shares of everything that they cause.
TouchSample between(const FemState& state, Random& random) {
  const TouchSample a = touch_sample(one_of(state, random)), b = touch_sample(one_of(state, random));
  const auto share = static_cast<float>(random.uniform());
  const auto blend = [share](const auto& of_a, const auto& of_b) { return ((1 - share) * of_a + share * of_b).eval(); };
  TouchSample sample;
  sample.numbers = blend(a.numbers, b.numbers);
  sample.point_mm = blend(a.point_mm, b.point_mm);
  sample.displacement_mm = blend(a.displacement_mm, b.displacement_mm);
  sample.force_n = (1 - share) * a.force_n + share * b.force_n;
  sample.force_vector_n = blend(a.force_vector_n, b.force_vector_n);
  sample.moment_nm = blend(a.moment_nm, b.moment_nm);
  return sample;
}

}  // namespace

TouchSource touches_of_scene(const FingerSpec& spec, const DatasetPlan& plan) {
  std::vector<Scene> scenes = other_scenes(spec, plan);
  scenes.insert(scenes.begin(), spec.scene(plan.scene));
  return [&spec, scenes](const std::vector<FemState>& states, const std::vector<FemState>& others, std::size_t count,
                         Random& random) {
    // The plan's scene, then the others: each of them as often, however many states a set holds of it.
    std::vector<std::vector<const FemState*>> by_scene(scenes.size());
    for (const std::vector<FemState>* part : {&states, &others}) {
      for (const FemState& state : *part) {
        if (state.valid()) by_scene[state.scene].push_back(&state);
      }
    }
    std::erase_if(by_scene, [](const auto& some) { return some.empty(); });
    const std::size_t of_others =
        by_scene.size() > 1 ? static_cast<std::size_t>(kOtherShare * static_cast<double>(count)) : 0;
    const std::size_t of_scene = count - of_others;
    std::vector<TouchSample> touches;
    touches.reserve(count);
    if (!contacts_change(scenes[0]) && !scenes[0].elsewhere) {
      touches = draw_touches(spec, StateInterpolant(states), of_scene, random);
    }
    while (touches.size() < count) {
      if (interrupted()) throw Interrupted();
      const std::size_t scene = touches.size() < of_scene ? 0 : 1 + random.index(by_scene.size() - 1);
      const FemState& state = *by_scene[scene][random.index(by_scene[scene].size())];
      touches.push_back(between(state, random));
      touches.back().explained = state.scene == 0;
      touches.back().on_face = !scenes[state.scene].elsewhere;
    }
    return touches;
  };
}

}  // namespace finsight::host
