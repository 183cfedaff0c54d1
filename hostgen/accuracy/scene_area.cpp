// Area scene: does the published radius hold in what the pack's scene contains, and is what it does not contain found
// out? Every case's states are solved for it and go through the whole firmware, with the spec's noise.
#include <algorithm>
#include <cmath>
#include <map>
#include <nlohmann/json.hpp>

#include "firmware/geometry/so3.h"
#include "firmware/loop/frame_loop.h"
#include "firmware/modbus/register_table.h"
#include "hostgen/accuracy/areas.h"
#include "hostgen/accuracy/scene_cases.h"
#include "hostgen/accuracy/scene_shapes.h"
#include "hostgen/fem/contact_twin.h"
#include "hostgen/fem/information.h"
#include "hostgen/learn/touch_samples.h"
#include "hostgen/util/common.h"
#include "hostgen/util/gnuplot.h"
#include "hostgen/util/random.h"
#include "hostgen/util/statistics.h"

namespace finsight::host {

using nlohmann::json;

namespace {

constexpr int kRepeats = 5;
constexpr int kCurveSteps = 30;  // of a tenth of a radius

/// One state, measured once.
struct Trial {
  std::int32_t place = 0;
  bool is_published = false, is_unexplained = false, has_shape = false;
  Vec3f truth_mm = Vec3f::Zero(), found_mm = Vec3f::Zero();
  double error_mm = 0, radius_mm = 0, plate_motion_mm = 0;
  Eigen::Array<double, 6, 1> wrench_error = Eigen::Array<double, 6, 1>::Zero(), wrench_sigma = wrench_error;
  bool is_lie() const { return is_published && error_mm > 3 * radius_mm; }
};

/// What the camera measures of a finger whose markers are stuck on beside their places.
PlateMotion shown_by_marker(const PlateMotion& plate, const Vec3f& offset_mm, const Eigen::Matrix3f& turned) {
  const Eigen::Matrix3f R = so3_exp(plate.rotation_rad);
  return {plate.displacement_mm + R * offset_mm, so3_log(Eigen::Matrix3f(R * turned))};
}

/// One device on one finger: markers where they are stuck, zeroed.
class Finger {
 public:
  Finger(const Model& model, const FingerSpec& spec, const SceneCase& scene_case, Random& random)
      : spec_(spec), case_(scene_case), random_(random), loop_(model, std::nullopt, settings(model.touch, scene_case)) {
    for (std::size_t p = 0; p < kPlates; ++p) {
      for (int i = 0; i < 3; ++i) {
        offset_mm_[p][i] = static_cast<float>(scene_case.marker_mm * random.normal());
        turn_rad_[p][i] = static_cast<float>(scene_case.marker_rad * random.normal());
      }
    }
  }

  void zero(const CaseState& solved) {
    loop_.gravity().set_felt(solved.zero_g.cast<float>());
    if (case_.gravity == SceneCase::Gravity::kUnknown) loop_.gravity().set_felt(std::nullopt);
    loop_.zeroing().begin();
    while (!loop_.zeroing().take_outcome()) measure(solved.at_zero);
  }

  Trial touch(const CaseState& solved) {
    const FemState& state = solved.state;
    if (case_.gravity == SceneCase::Gravity::kKnown) loop_.gravity().set_felt(solved.felt_g.cast<float>());
    const RegisterImage& image = measure(state.plates);
    const std::uint16_t status = image.words[address_of("status")];
    Trial trial;
    trial.place = state.path;
    trial.is_published = status & kTouchValid;
    trial.is_unexplained = status & kUnexplained;
    trial.has_shape = status & kShapeValid;
    trial.truth_mm = state.point_mm;
    trial.plate_motion_mm = static_cast<double>(plate_motion_mm(state.plates));
    if (!trial.is_published) return trial;
    for (int i = 0; i < 3; ++i)
      trial.found_mm[i] = static_cast<float>(measured_value(image, address_of("touch_x") + i));
    trial.error_mm = static_cast<double>((trial.found_mm - trial.truth_mm).norm());
    trial.radius_mm = measured_value(image, address_of("touch_uncertainty"));
    for (int i = 0; i < 3; ++i) {
      trial.wrench_error[i] =
          measured_value(image, address_of("force_normal") + i) - static_cast<double>(state.force_vector_n[i]);
      trial.wrench_sigma[i] = measured_value(image, address_of("force_normal_uncertainty") + i);
      trial.wrench_error[3 + i] = measured_value(image, address_of("wrench_moment_x") + i) -
                                  static_cast<double>(state.moment_nmm[i]) / kNmmPerNm;
      trial.wrench_sigma[3 + i] = measured_value(image, address_of("wrench_moment_x_uncertainty") + i);
    }
    return trial;
  }

 private:
  // Walls apart, the fingers are the one that the pack was made for: as one is that was fitted.
  static LoopSettings settings(const TouchModel& touch, const SceneCase& scene_case) {
    LoopSettings settings;
    settings.fit.emplace();
    settings.fit->force_sigma = touch.stiffness_tolerance;
    if (scene_case.wall_mm != 0) {
      settings.fit->touch_radius_mm = touch.touch_tolerance_mm;
      settings.fit->noise_per_mm = touch.noise_per_mm;
    }
    settings.shape.tier = ShapeSettings::Tier::kMeasures;
    if (scene_case.gravity != SceneCase::Gravity::kNone) settings.fixed_g.reset();
    return settings;
  }

  const RegisterImage& measure(const std::array<PlateMotion, kPlates>& plates) {
    PlatePoses poses{.plates = plates, .seen = {true, true, true}, .quality = Quality::kFresh};
    for (std::size_t p = 0; p < kPlates; ++p) {
      poses.plates[p] = shown_by_marker(plates[p], offset_mm_[p], so3_exp(turn_rad_[p]));
    }
    PoseVector numbers = pose_vector(poses);
    add_noise(spec_.noise, random_, numbers);
    if (case_.motion == SceneCase::Motion::kLoosePlate) loosen_plate(random_, numbers);
    if (case_.motion == SceneCase::Motion::kSwing) swing(numbers);
    sequence_ += 100;  // frames far apart: nothing is shaken
    Observation seen{
        .exposure_ns = sequence_ * kNsPerS, .sequence = sequence_, .poses = seen_poses({numbers.data(), kPoseDims})};
    return loop_.step(seen);
  }

  void swing(PoseVector& numbers) {
    constexpr double kSwing_mm = 2;
    const double angle = random_.uniform(0, 2 * 3.14159265358979);
    std::array<double, kPlates> height_mm;
    for (std::size_t p = 0; p < kPlates; ++p) height_mm[p] = spec_.plates[p].T_finger_marker.translation().y();
    deflect(height_mm, kSwing_mm * std::cos(angle), kSwing_mm * std::sin(angle), numbers);
  }

  const FingerSpec& spec_;
  const SceneCase& case_;
  Random& random_;
  FrameLoop loop_;
  std::array<Vec3f, kPlates> offset_mm_, turn_rad_;
  std::uint32_t sequence_ = 1;
};

/// Only touches that move a plate far enough for a touch to be published.
bool is_firm(const FingerSpec& spec, const CaseState& solved) {
  return static_cast<double>(plate_motion_mm(solved.state.plates)) >= spec.threshold_mm + 0.2;
}

/// Touches as the pack's scene draws them, at places of their own.
SceneCase any_touch(const std::string& scene) {
  return {.name = "any touch of the scene", .scenes = {scene}, .load = SceneCase::Load::kAny};
}

/// At 200 places, two forces each, one state is a quarter of a percent of a case, and the share inside the radius has a
/// standard error of about two points: the same place errs alike whatever the force and the noise. Whether two pushes
/// are found out is mostly a matter of where they are: at 40 places one pack found 17 % of them, at 60 others 32 %. The
/// fine mesh only confirms the default one, and takes longest.
int places_of(const SceneCase& scene_case, const std::string& scene) {
  if (scene_case.load == SceneCase::Load::kTwo || scene_case.load == SceneCase::Load::kAny) return 400;
  if (scene_case.mesh == MeshSize::kFine) return 100;
  return scene_case.is_contained_in(scene) ? 200 : 40;
}

std::vector<CaseState> firm_states(const FingerSpec& spec, const SceneCase& scene_case, int places) {
  std::vector<CaseState> states = solve_case(spec, scene_case, places);
  std::erase_if(states, [&](const CaseState& solved) { return !is_firm(spec, solved); });
  return states;
}

std::vector<Trial> run_case(const Model& model, const FingerSpec& spec, const SceneCase& scene_case,
                            const std::vector<CaseState>& states) {
  std::vector<Trial> trials;
  Random random(99);
  for (const CaseState& solved : states) {
    for (int k = 0; k < kRepeats; ++k) {
      Finger finger(model, spec, scene_case, random);
      if (scene_case.marker_mm > 0 || scene_case.gravity != SceneCase::Gravity::kNone) finger.zero(solved);
      trials.push_back(finger.touch(solved));
    }
  }
  return trials;
}

struct Summary {
  explicit Summary(const std::vector<Trial>& trials) : count(trials.size()) {
    Eigen::Array<double, 6, 1> square = Eigen::Array<double, 6, 1>::Zero(), told = square;
    for (const Trial& trial : trials) {
      published += trial.is_published;
      unexplained += trial.is_unexplained;
      lies += trial.is_lie();
      if (!trial.is_published) continue;
      errors_mm.push_back(trial.error_mm);
      GroupCount& at_place = at_places[trial.place];
      ++at_place.all;
      at_place.inside += trial.error_mm <= trial.radius_mm;
      for (int k = 0; k < kCurveSteps; ++k) {
        curve[static_cast<std::size_t>(k)] += trial.error_mm <= 0.1 * (k + 1) * trial.radius_mm;
      }
      for (int i = 0; i < 6; ++i) {
        if (std::isnan(trial.wrench_error[i])) continue;
        ++told[i];
        square[i] += trial.wrench_error[i] * trial.wrench_error[i];
        wrench_inside[i] += std::abs(trial.wrench_error[i]) <= trial.wrench_sigma[i];
      }
    }
    for (double& share : curve) share /= std::max(1.0, published);
    wrench_rmse = (square / told.max(1.0)).sqrt();
    wrench_inside /= told.max(1.0);
    wrench_told = told / std::max(1.0, published);
  }

  json figures() const {
    const double of = std::max<double>(1, static_cast<double>(count)), touches = std::max(1.0, published);
    double sum_mm = 0;
    for (const double error : errors_mm) sum_mm += error;
    json row = {
        {"trials", count}, {"published", published / of}, {"unexplained", unexplained / of}, {"lies", lies / of}};
    constexpr double kFewest = 20;  // fewer touches tell no share
    if (published < kFewest) return row;
    std::vector<GroupCount> places;
    for (const auto& [place, counted] : at_places) places.push_back(counted);
    const auto three = [](const auto& numbers, int first) {
      return json::array({numbers[first], numbers[first + 1], numbers[first + 2]});
    };
    row.update({{"touch_mm", sum_mm / touches},
                {"touch_95_mm", quantile(errors_mm, 0.95)},
                {"inside_radius", curve[9]},
                {"inside_radius_error", share_error(places)},
                {"inside_twice", curve[19]},
                {"inside_curve", curve},
                {"force_rmse_n", three(wrench_rmse, 0)},
                {"force_inside", three(wrench_inside, 0)},
                {"force_told", three(wrench_told, 0)},
                {"moment_rmse_nm", three(wrench_rmse, 3)},
                {"moment_inside", three(wrench_inside, 3)}});
    return row;
  }

  std::size_t count;
  double published = 0, unexplained = 0, lies = 0;
  std::vector<double> errors_mm;
  std::map<std::int32_t, GroupCount> at_places;  // published touches, those inside the radius
  std::array<double, kCurveSteps> curve{};
  Eigen::Array<double, 6, 1> wrench_rmse, wrench_inside = Eigen::Array<double, 6, 1>::Zero(),
                                          wrench_told = wrench_inside;
};

struct CaseResult {
  SceneCase scene_case;
  std::vector<Trial> trials;
  Summary summary;
};

/// Where touches were and where they were published, over the face; a line joins the two.
void plot_faces(const std::vector<CaseResult>& results, const FingerSpec& spec, const std::filesystem::path& file) {
  constexpr std::size_t kColumns = 6;
  const std::size_t rows = (results.size() + kColumns - 1) / kColumns;
  Gnuplot plot(file);
  plot.line("set term svg size 1200," + std::to_string(260 * rows) + " font ',10' background 'white'");
  plot.line("set multiplot layout " + std::to_string(rows) + "," + std::to_string(kColumns));
  const double half_mm = spec.half_width.at(spec.touch_y_mm[0]);
  plot.line("unset key; set size ratio -1; set xrange [" + std::to_string(-half_mm - 8) + ":" +
            std::to_string(half_mm + 8) + "]; set yrange [0:" + std::to_string(spec.height_mm) +
            "]; set xtics 20; set ytics 40; set tics font ',7'");
  for (const CaseResult& result : results) {
    plot.line("$lines << E");
    for (std::size_t i = 0; i < result.trials.size(); i += kRepeats) {
      const Trial& trial = result.trials[i];
      if (!trial.is_published) continue;
      const Vec3f away = trial.found_mm - trial.truth_mm;
      plot.line(std::to_string(trial.truth_mm.x()) + " " + std::to_string(trial.truth_mm.y()) + " " +
                std::to_string(away.x()) + " " + std::to_string(away.y()) + " " + (trial.is_lie() ? "1" : "0"));
    }
    plot.line("-999 -999 0 0 0\nE\n$hidden << E");
    for (std::size_t i = 0; i < result.trials.size(); i += kRepeats) {
      const Trial& trial = result.trials[i];
      if (!trial.is_published) plot.line(std::to_string(trial.truth_mm.x()) + " " + std::to_string(trial.truth_mm.y()));
    }
    plot.line("-999 -999\nE\nset title \"" + result.scene_case.name + "\"");
    plot.line(
        "plot $hidden using 1:2 with points pt 6 ps 0.4 lc 'gray', $lines using 1:2:3:4:($5 > 0 ? 0xcc2222 : 0x2255aa) "
        "with vectors nohead lw 1.5 lc rgb variable, $lines using ($1+$3):($2+$4):($5 > 0 ? 0xcc2222 : 0x2255aa) with "
        "points pt 7 ps 0.3 lc rgb variable");
  }
  plot.line("unset multiplot");
  plot.finish();
}

json floor_json(const FingerSpec& spec, bool quick) {
  json rows = json::array();
  for (const InformationLimit& limit : information_limits(spec, quick ? 3 : 30)) {
    json row = {{"unknown", limit.name}, {"states", limit.states}};
    for (const auto& [parameter, deviation] : limit.deviations) row[parameter] = deviation;
    rows.push_back(row);
  }
  return rows;
}

/// Of any touch, for which the aims of forces and moments are set.
json strong_touches_json(std::vector<Trial> trials) {
  std::erase_if(trials, [](const Trial& trial) { return trial.plate_motion_mm < 4; });
  json row = Summary(trials).figures();
  row.update({{"case", "any touch of the scene, from 4 mm of plate motion"}, {"contained", true}});
  return row;
}

double median_radius_mm(const std::vector<Trial>& trials) {
  std::vector<double> radii_mm;
  for (const Trial& trial : trials) {
    if (trial.is_published) radii_mm.push_back(trial.radius_mm);
  }
  return quantile(std::move(radii_mm), 0.5);
}

/// How many of a case's touches the best test of the plates would find: the others are those that one contact of the
/// pack's scene imitates, which would then be published with a touch's usual radius, `radius_mm`. Of at most 48 states.
json imitated_json(const std::string& scene, const FingerSpec& spec, const std::vector<CaseState>& states,
                   double radius_mm) {
  const std::size_t count = std::min<std::size_t>(48, states.size());
  const auto state = [&](std::size_t i) -> const FemState& { return states[i * states.size() / count].state; };
  const auto finger = std::make_shared<const PushedFinger>(spec, make_mesh(spec));
  std::vector<ContactTwin> twins(count);
  parallel_for(count, [&](std::size_t i) {
    FingerStatics statics(finger);
    twins[i] = closest_contact(statics, spec, spec.scene(scene), state(i));
  });
  double found = 0, lies = 0, alike = 0, alike_off_mm = 0;
  for (std::size_t i = 0; i < count; ++i) {
    const double refused = largest_share_refused(twins[i].distance);
    const auto off_mm = static_cast<double>((twins[i].state.point_mm - state(i).point_mm).norm());
    found += refused;
    if (off_mm > 3 * radius_mm) lies += 1 - refused;
    if (refused >= 0.5) continue;
    ++alike;
    alike_off_mm += off_mm;
  }
  const double all = std::max<double>(1, static_cast<double>(count));
  return {{"states", count},
          {"alike", alike / all},
          {"alike_off_mm", alike_off_mm / std::max(alike, 1.0)},
          {"found_at_best", found / all},
          {"lies_at_best", lies / all}};
}

}  // namespace

json measure_scenes(const Model& model, const FingerSpec& spec, const std::filesystem::path& folder, bool quick) {
  std::vector<CaseResult> results;
  json rows = json::array(), shapes = json::array(), imitated = json::array();
  double worst_cover = 0, worst_lies = 0;
  std::vector<SceneCase> cases = scene_cases();
  cases.insert(cases.begin(), any_touch(model.scene));  // the radius of a touch comes from there
  Progress progress("cases", cases.size());
  for (const SceneCase& scene_case : cases) {
    const std::vector<CaseState> states = firm_states(spec, scene_case, quick ? 2 : places_of(scene_case, model.scene));
    std::vector<Trial> trials = run_case(model, spec, scene_case, states);
    const Summary summary(trials);
    json row = summary.figures();
    row["case"] = scene_case.name;
    std::printf("%s\n", row.dump().c_str());
    std::fflush(stdout);
    row["contained"] = scene_case.is_contained_in(model.scene);
    worst_lies = std::max(worst_lies, row["lies"].get<double>());
    if (row["contained"].get<bool>() && summary.published > 0) {
      worst_cover = std::max(worst_cover, std::abs(summary.curve[9] - 0.68));
    }
    rows.push_back(row);
    if (scene_case.load == SceneCase::Load::kAny) rows.push_back(strong_touches_json(trials));
    if (scene_case.load == SceneCase::Load::kTwo) {
      json row_of_two = imitated_json(model.scene, spec, states, median_radius_mm(results.front().trials));
      row_of_two["case"] = scene_case.name;
      imitated.push_back(row_of_two);
    }
    // The figures of a shape are about the nodes of one mesh.
    if (scene_case.is_one_pose() && scene_case.mesh == MeshSize::kDefault) {
      for (json tier : compare_shapes(model, spec, states)) {
        tier["case"] = scene_case.name;
        shapes.push_back(tier);
      }
    }
    results.push_back({scene_case, std::move(trials), summary});
    progress.advance();
  }
  plot_faces(results, spec, folder / "scene_faces.svg");
  return {{"scene",
           {{"name", model.scene},
            {"cases", rows},
            {"shapes", shapes},
            {"floor", floor_json(spec, quick)},
            {"imitated", imitated},
            {"worst_coverage_error", worst_cover},
            {"worst_lies", worst_lies}}}};
}

}  // namespace finsight::host
