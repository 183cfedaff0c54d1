#include "hostgen/probe/probe.h"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <ctime>

#include "firmware/input_error.h"
#include "hostgen/fem/deformation.h"
#include "hostgen/fem/statics.h"
#include "hostgen/finger/jig_holes.h"
#include "hostgen/util/common.h"
#include "hostgen/util/stopwatch.h"

namespace finsight::host {

namespace {

constexpr int kBetween = 2;           // pushes between the last that was borne and the first that was not
constexpr double kFirstPush = 0.125;  // of the highest: what is far too strong takes long to fail

struct TimeOver {};

class Prober {
 public:
  Prober(const FingerSpec& spec, const TetMesh& mesh, double limit_s)
      : mesh_(mesh),
        full_n_(spec.force_n[1]),
        deadline_(std::chrono::steady_clock::now() + std::chrono::milliseconds(std::lround(1000 * limit_s))),
        finger_(std::make_shared<const PushedFinger>(spec, mesh, Element::kSelective, [this] {
          if (interrupted()) throw Interrupted();
          if (std::chrono::steady_clock::now() > deadline_) throw TimeOver();
        })) {}

  const PushedFinger& finger() const { return *finger_; }

  void push(ProbedPlace& place) {
    if (over(place)) return;
    FingerStatics statics(finger_);
    statics.give_up_at(deadline_);
    FaceContact contact;
    contact.centre_mm = place.point_mm.head<2>().cast<double>();
    statics.begin({contact});
    place.full_n = full_n_;
    double weakest_failure_n = 2 * full_n_;
    for (double force_n = kFirstPush * full_n_; force_n <= full_n_; force_n *= 2) {
      if (over(place)) return;
      if (press(statics, force_n, place)) continue;
      weakest_failure_n = force_n;
      break;
    }
    while (place.states.empty() && weakest_failure_n / 2 >= kWeakestPush_n && !over(place)) {
      weakest_failure_n /= 2;
      statics.begin({contact});
      press(statics, weakest_failure_n, place);
    }
    if (place.states.empty() || place.borne_n() >= full_n_) return;
    double failed_n = place.failed_n;
    for (int k = 0; k < kBetween && !over(place); ++k) {
      const double middle_n = 0.5 * (place.borne_n() + failed_n);
      if (!press(statics, middle_n, place)) failed_n = middle_n;
    }
  }

 private:
  bool over(ProbedPlace& place) {
    place.cut_short = place.cut_short || std::chrono::steady_clock::now() > deadline_;
    return place.cut_short;
  }

  bool press(FingerStatics& statics, double force_n, ProbedPlace& place) {
    FemState state;
    Outcome outcome = Outcome::kNotConverged;
    if (statics.press(force_n)) {
      state = statics.state();
      outcome = state.outcome;
    } else {
      outcome = statics.buckled() ? Outcome::kNoEquilibrium : Outcome::kNotConverged;
    }
    if (outcome == Outcome::kNotConverged && over(place)) return false;  // not tried to the end
    if (outcome != Outcome::kEquilibrium) {
      place.end = outcome;
      place.failed_n = force_n;
      return false;
    }
    const std::vector<double> displacement = statics.node_displacement_mm();
    const std::vector<std::int32_t> front(mesh_.front_nodes.begin(), mesh_.front_nodes.end());
    state.front_rms_mm = static_cast<float>(front_rms_mm<double>(displacement, front));
    place.states.push_back(state);
    return true;
  }

  const TetMesh& mesh_;
  const double full_n_;
  const std::chrono::steady_clock::time_point deadline_;
  const std::shared_ptr<const PushedFinger> finger_;
};

const char* reason(Outcome outcome) {
  switch (outcome) {
    case Outcome::kPushedTooFar:
      return "pushed further than 20 mm";
    case Outcome::kNoEquilibrium:
      return "buckles or snaps through";
    case Outcome::kNotConverged:
      return "numerical: the solver did not converge";
    default:
      return "";
  }
}

double factor_mb(const CholeskyPlan& plan) {
  double bytes = 0;
  for (std::size_t s = 0; s + 1 < plan.supernode_start.size(); ++s) {
    const double columns = 3.0 * (plan.supernode_start[s + 1] - plan.supernode_start[s]);
    bytes += columns * (columns + 3.0 * (plan.rows_start[s + 1] - plan.rows_start[s])) * sizeof(float);
  }
  return bytes / 1e6;
}

/// Every other place, from the base to the tip and back.
std::vector<std::size_t> spread_order(std::size_t count) {
  std::vector<std::size_t> order;
  for (std::size_t i = 0; i < count; i += 2) order.push_back(i);
  for (std::size_t i = count / 2 * 2; i-- > 0;) {
    if (i % 2 == 1) order.push_back(i);
  }
  return order;
}

std::string number_text(double value) {
  char text[32];
  std::snprintf(text, sizeof text, "%.3g", value);
  return text;
}

}  // namespace

double plate_motion_mm(const FemState& state) { return static_cast<double>(plate_motion_mm(state.plates)); }

Probe probe_finger(const FingerSpec& spec, const TetMesh& mesh, double limit_s,
                   const std::function<void(double factor_mb)>& planned) {
  Probe probe;
  Stopwatch watch;
  const std::clock_t clock = std::clock();
  for (const JigHole& hole : jig_holes(spec)) probe.places.emplace_back().point_mm = hole.contact_mm.cast<float>();
  try {
    Prober prober(spec, mesh, limit_s);
    probe.factor_mb = factor_mb(prober.finger().body.plan().view());
    if (planned) planned(probe.factor_mb);
    const std::vector<std::size_t> order = spread_order(probe.places.size());
    Progress progress("probing places", probe.places.size());
    parallel_for(probe.places.size(), [&](std::size_t i) {
      prober.push(probe.places[order[i]]);
      progress.advance();
    });
  } catch (const TimeOver&) {
    for (ProbedPlace& place : probe.places) place.cut_short = true;
  }
  probe.seconds = watch.lap_s();
  probe.place_cpu_s =
      static_cast<double>(std::clock() - clock) / CLOCKS_PER_SEC / static_cast<double>(probe.places.size());
  return probe;
}

void check_worth_building(const FingerSpec& spec, const Probe& probe) {
  const ProbedPlace* most = nullptr;
  std::size_t borne = 0;
  for (const ProbedPlace& place : probe.places) {
    if (place.states.empty()) continue;
    ++borne;
    if (!most || plate_motion_mm(place.states.back()) > plate_motion_mm(most->states.back())) most = &place;
  }
  if (!most) {
    const auto tried = std::ranges::find_if(probe.places, &ProbedPlace::is_tried);
    if (tried == probe.places.end()) return;  // too slow to tell
    const ProbedPlace& first = *tried;
    throw InputError(spec.file.string(), "touch.force_n",
                     "no equilibrium at any of " + std::to_string(probe.places.size()) +
                         " places of the face, even under " + number_text(first.failed_n) + " N (" + reason(first.end) +
                         ")",
                     first.end == Outcome::kNotConverged
                         ? "a mesh that can be solved: `hostgen mesh` tells where its worst angles are; "
                           "surface.simplify_mm takes slivers out"
                         : "a finger that bears touches: is all of it attached to the base, and are youngs_modulus_mpa "
                           "and surface.units right?");
  }
  const double motion_mm = plate_motion_mm(most->states.back());
  if (motion_mm >= spec.threshold_mm) return;
  throw InputError(spec.file.string(), "touch.threshold_mm",
                   number_text(spec.threshold_mm) + " mm, but none of " + std::to_string(borne) +
                       " probed places moves a plate that far: " + number_text(motion_mm) + " mm at most, under " +
                       number_text(most->borne_n()) + " N",
                   "a threshold that touches exceed, or a higher touch.force_n (`hostgen probe` proposes both)");
}

std::string probe_text(const Probe& probe) {
  std::string text = "place (x, y)        borne     plate moves   face moves (RMS)\n";
  char line[200];
  for (const ProbedPlace& place : probe.places) {
    const auto x = static_cast<double>(place.point_mm.x()), y = static_cast<double>(place.point_mm.y());
    if (place.states.empty()) {
      std::snprintf(line, sizeof line, "(%6.1f, %6.1f)     %s", x, y, place.is_tried() ? "nothing" : "not told");
    } else {
      std::snprintf(line, sizeof line, "(%6.1f, %6.1f)  %7.2f N  %9.2f mm  %9.2f mm", x, y, place.borne_n(),
                    plate_motion_mm(place.states.back()), static_cast<double>(place.states.back().front_rms_mm));
    }
    text += line;
    if (place.end != Outcome::kEquilibrium) {
      text += "; " + number_text(place.failed_n) + " N: " + reason(place.end);
    } else if (place.cut_short) {
      text += "; no time for more";
    }
    text += "\n";
  }
  return text;
}

}  // namespace finsight::host
