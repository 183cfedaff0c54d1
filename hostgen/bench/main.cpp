// bench: how long a Newton iteration takes by several methods, and what fixed schedules cost and err, on several
// meshes.
#include <sched.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <nlohmann/json.hpp>

#include "firmware/input_error.h"
#include "firmware/shape/newton.h"
#include "firmware/shape/soft_newton.h"
#include "hostgen/bench/derivative_operations.h"
#include "hostgen/bench/iteration.h"
#include "hostgen/bench/machine_limit.h"
#include "hostgen/bench/schedules.h"
#include "hostgen/fem/shape_model.h"
#include "hostgen/finger/mesh.h"
#include "hostgen/finger/mount.h"
#include "hostgen/util/common.h"

namespace finsight::host {

namespace {

using nlohmann::json;

struct Options {
  std::filesystem::path spec = "hostgen/fingers/srm.toml", output, counted_program, pack;
  bool quick = false;
};

struct Mesh {
  MeshSize size;
  double min_dihedral_deg;
  ShapeModelData model, soft;
};

Mesh make_bench_mesh(const FingerSpec& spec, MeshSize size) {
  const TetMesh tets = make_mesh(spec, size);
  Mesh mesh{size, tets.min_dihedral_deg, make_shape_model(tets), {}};
  mesh.soft = make_soft_shape_model(mesh.model.view());
  return mesh;
}

/// Libraries may start threads of their own; all methods are measured on one core.
void stay_on_one_core() {
  cpu_set_t core;
  CPU_ZERO(&core);
  CPU_SET(sched_getcpu(), &core);
  if (sched_setaffinity(0, sizeof core, &core) != 0) throw std::runtime_error("bench: cannot stay on one core");
}

/// Of the factor in float: what a factorisation writes and a solve reads twice.
double factor_bytes(const CholeskyPlanData& plan) {
  double entries = 0;
  for (std::size_t s = 0; s + 1 < plan.supernode_start.size(); ++s) {
    const double columns = plan.supernode_start[s + 1] - plan.supernode_start[s];
    const double rows = plan.rows_start[s + 1] - plan.rows_start[s];
    entries += 9 * columns * (columns + rows);
  }
  return entries * sizeof(float);
}

/// A bend that strains every part of the finger.
PlatePoses bench_pose(const MountModel& mount) { return report_motions(mount)[1].frames[40]; }

/// One method on one mesh.
struct Contender {
  std::string way;
  const Mesh& mesh;
  Iteration iteration;
  int per_turn;  ///< iterations, so that the first one of a turn, which finds cold caches, is not the only one
  std::vector<IterationTime> times;
};

void add_contenders(const Mesh& mesh, const MountModel& mount, std::vector<Contender>& contenders) {
  const ShapeModel model = mesh.model.view();
  NewtonSolver<double> solver(model, mount);
  if (!solver.converge(bench_pose(mount), 1e-6, 200).ok) throw std::runtime_error("bench: the pose does not converge");
  const std::span<const double> x = solver.node_mm();
  contenders.push_back({"float", mesh, our_iteration<float>(model, x), 20, {}});
  contenders.push_back({"double", mesh, our_iteration<double>(model, x), 20, {}});
  contenders.push_back({"eigen", mesh, eigen_iteration(model, x), 2, {}});
  contenders.push_back({"cholmod", mesh, cholmod_iteration(model, x), 2, {}});
  contenders.push_back({"published", mesh, published_iteration(mesh.soft.view(), x), 1, {}});
}

json row_of(Contender& contender) {
  std::ranges::sort(contender.times, {}, &IterationTime::sum_us);
  const auto at = [&](double share) {
    return contender.times[static_cast<std::size_t>(share * (contender.times.size() - 1))];
  };
  const IterationTime median = at(0.5);
  const ShapeModelData& data = contender.mesh.model;
  const ShapeModel model = data.view();
  return {{"way", contender.way},
          {"mesh_tets", model.tets},
          {"nodes", model.nodes},
          {"factor_operations", Cholesky<float>(data.cholesky.view()).factor_operations()},
          {"derivative_operations", model.tets * derivative_operations().least_operations()},
          {"factor_mb", factor_bytes(data.cholesky) / 1e6},
          {"derivatives_us", median.derivatives_us},
          {"factor_us", median.factor_us},
          {"solve_us", median.solve_us},
          {"step_us", median.step_us},
          {"sum_us", median.sum_us()},
          {"quartiles_us", {at(0.25).sum_us(), median.sum_us(), at(0.75).sum_us()}}};
}

/// Runs all methods on all meshes in turn, round by round, so that other load on the machine and changes of its clock
/// affect all of them. Processor time counts. The iteration of median length stands for its method: a processor speeds
/// up now and then, and the shortest of all iterations would be that of a method that was in luck.
json measure_iterations(std::span<const Mesh> meshes, const MountModel& mount, int rounds) {
  std::vector<Contender> contenders;
  for (const Mesh& mesh : meshes) add_contenders(mesh, mount, contenders);
  Progress progress("bench: iterations", static_cast<std::size_t>(rounds));
  for (int round = 0; round < rounds; ++round) {
    for (Contender& contender : contenders) {
      if (interrupted()) throw Interrupted();
      for (int i = 0; i < contender.per_turn; ++i) contender.times.push_back(contender.iteration());
    }
    progress.advance();
  }
  json rows = json::array();
  for (Contender& contender : contenders) rows.push_back(row_of(contender));
  return rows;
}

/// Time, or something else of ours, over tets on logarithmic axes: the slope of the least-squares line.
double growth_exponent(const json& iterations, const char* of = "sum_us") {
  std::vector<double> x, y;
  for (const json& row : iterations) {
    if (row["way"] != "float") continue;
    x.push_back(std::log(row["mesh_tets"].get<double>()));
    y.push_back(std::log(row[of].get<double>()));
  }
  const double n = static_cast<double>(x.size());
  double sx = 0, sy = 0, sxx = 0, sxy = 0;
  for (std::size_t i = 0; i < x.size(); ++i) {
    sx += x[i];
    sy += y[i];
    sxx += x[i] * x[i];
    sxy += x[i] * y[i];
  }
  return (n * sxy - sx * sy) / (n * sxx - sx * sx);
}

/// How many iterations the published method takes for a frame of the hard motion, from the frame before.
double published_iterations_per_frame(const Mesh& mesh, const MountModel& mount) {
  const PlateMotionPath motion = report_motions(mount)[1];
  SoftNewtonSolver<double> solver(mesh.soft.view(), mount);
  int steps = 0, frames = 0;
  for (std::size_t k = 0; k <= 40; ++k) {
    const auto outcome = solver.converge(motion.frames[k]);
    if (k > 30) steps += outcome.steps, ++frames;
  }
  return static_cast<double>(steps) / frames;
}

double time_of(const json& iterations, int tets, const std::string& way) {
  for (const json& row : iterations) {
    if (row["mesh_tets"] == tets && row["way"] == way) return row["sum_us"].get<double>();
  }
  throw std::logic_error("bench: " + way + " was not measured");
}

/// Rows of speed_error. `iterations`: of this mesh. Eigen's and CHOLMOD's steps are ours in double, with their factor.
json measure_schedules(const Mesh& mesh, const MountModel& mount, const json& iterations, bool quick) {
  const ShapeModel model = mesh.model.view();
  json rows = json::array();
  const bool is_default = mesh.size == MeshSize::kDefault;
  const auto is_short = [](int factorisations, int chords) {
    return factorisations <= 2 && factorisations + chords <= 3;
  };
  std::vector<std::pair<int, int>> schedules;
  for (int factorisations = 1; factorisations <= 5; ++factorisations) {
    for (int chords = 0; chords <= 2; ++chords) {
      const bool is_basic = is_default ? is_short(factorisations, chords) : factorisations == 1 && chords < 2;
      if (is_basic || !quick) schedules.emplace_back(factorisations, chords);
    }
  }
  std::vector<PlateMotionPath> motions = report_motions(mount);
  if (quick) motions.resize(mesh.size == MeshSize::kDefault ? 2 : 1);
  for (const PlateMotionPath& motion : motions) {
    const auto truth = converged_shapes(model, mount, motion);
    const auto add_row = [&](const char* tier, int factorisations, int chords, const char* scalar,
                             const ScheduleResult& result) {
      rows.push_back({{"tier", tier},
                      {"mesh_tets", model.tets},
                      {"factorisations", factorisations},
                      {"chords", chords},
                      {"scalar", scalar},
                      {"motion", motion.name},
                      {"us_per_frame", result.us_per_frame},
                      {"quartiles_us", result.quartiles_us},
                      {"worst_mm", result.distance.worst_mm},
                      {"mean_mm", result.distance.mean_mm}});
    };
    const double published_us = time_of(iterations, model.tets, "published");
    add_row("published", 0, 0, "double", run_published(mesh.soft.view(), mount, motion, truth, published_us));
    for (const auto& [factorisations, chords] : schedules) {
      const auto add = [&, f = factorisations, c = chords](const char* tier, const char* scalar,
                                                           const ScheduleResult& result) {
        add_row(tier, f, c, scalar, result);
      };
      // On the default mesh the report measures the whole stage, which is float.
      if (!is_default) {
        add("newton", "float", run_schedule<float>(model, mount, motion, truth, factorisations, chords));
      }
      if (!is_default && !is_short(factorisations, chords)) continue;  // they take minutes and tell what float tells
      ScheduleResult result = run_schedule<double>(model, mount, motion, truth, factorisations, chords);
      add("newton", "double", result);
      if (chords > 0) continue;
      for (const char* library : {"eigen", "cholmod"}) {
        result.us_per_frame = factorisations * time_of(iterations, model.tets, library);
        result.quartiles_us.fill(result.us_per_frame);
        add(library, "double", result);
      }
    }
  }
  return rows;
}

/// In place of a figure that was not measured.
json left_out(const char* why) { return json::object({{"why", why}}); }

/// By how much a coarser mesh's converged shape differs from the finest one's.
json measure_meshes(const std::vector<Mesh>& meshes, const MountModel& mount) {
  PlateMotionPath motion = report_motions(mount)[1];
  motion.frames.resize(motion.frames.size() / 2 + 1);  // to the extreme
  const Mesh& finest = meshes.back();
  const auto fine = converged_shapes(finest.model.view(), mount, motion);
  json rows = json::array();
  for (const Mesh& mesh : meshes) {
    if (&mesh == &finest) break;
    const auto shapes = converged_shapes(mesh.model.view(), mount, motion);
    const auto there = shapes_at_nodes(finest.model.view(), fine, mesh.model.view());
    ShapeDistance total;
    for (std::size_t k = 0; k < shapes.size(); ++k) {
      const ShapeDistance d = shape_distance(std::span<const double>(shapes[k]), std::span<const double>(there[k]));
      total.worst_mm = std::max(total.worst_mm, d.worst_mm);
      total.mean_mm += d.mean_mm / static_cast<double>(shapes.size());
    }
    rows.push_back({{"mesh_tets", mesh.model.view().tets},
                    {"than_tets", finest.model.view().tets},
                    {"motion", motion.name},
                    {"worst_mm", total.worst_mm},
                    {"mean_mm", total.mean_mm}});
  }
  return rows;
}

/// Instructions of the parts of one iteration (float, AVX2), counted by valgrind: they do not depend on what else the
/// machine does.
json count_instructions(const Options& options) {
  json counts;
  for (const char* stage : {"derivatives", "factor", "solve", "step"}) {
    const std::string command = "valgrind --tool=callgrind --callgrind-out-file=/dev/null --toggle-collect=stage_" +
                                std::string(stage) + " " + options.counted_program.string() + " " +
                                options.pack.string() + " 2>&1";
    FILE* pipe = popen(command.c_str(), "r");
    std::string said;
    for (int c = 0; pipe && (c = std::fgetc(pipe)) != EOF;) said += static_cast<char>(c);
    const std::size_t at = said.find("Collected : ");
    if (!pipe || pclose(pipe) != 0 || at == std::string::npos)
      throw std::runtime_error("bench: " + command + "\n" + said);
    counts[stage] = std::stoll(said.substr(at + std::string("Collected : ").size()));
  }
  return counts;
}

void run(const Options& options) {
  catch_interrupts();
  const FingerSpec spec = read_finger_spec(options.spec);
  const MountModel mount = mount_of(spec);
  std::vector<Mesh> meshes;
  for (const MeshSize size : {MeshSize::kCoarse, MeshSize::kDefault, MeshSize::kMedium, MeshSize::kFine}) {
    meshes.push_back(make_bench_mesh(spec, size));
  }
  json iterations = measure_iterations(meshes, mount, options.quick ? 5 : 20), speed_error = json::array();
  {
    Progress progress("bench: schedules", meshes.size());
    for (const Mesh& mesh : meshes) {
      const json schedules = measure_schedules(mesh, mount, iterations, options.quick);
      speed_error.insert(speed_error.end(), schedules.begin(), schedules.end());
      progress.advance();
    }
  }
  const double exponent = growth_exponent(iterations),
               operations_exponent = growth_exponent(iterations, "factor_operations");
  if (!options.quick) {  // how it goes on, without schedules: a frame of it would take a tenth of a second
    const Mesh finest = make_bench_mesh(spec, MeshSize::kFinest);
    const json rows = measure_iterations({&finest, 1}, mount, 7);
    iterations.insert(iterations.end(), rows.begin(), rows.end());
  }
  const Mesh& standard = meshes[1];
  const int tets = standard.model.view().tets;
  const double ours_us = time_of(iterations, tets, "float"), published_us = time_of(iterations, tets, "published"),
               double_us = time_of(iterations, tets, "double");
  const MachineLimit limit = measure_machine_limit();
  const double published_steps = published_iterations_per_frame(standard, mount);
  const json result = {
      {"mesh",
       {{"nodes", standard.model.view().nodes}, {"tets", tets}, {"min_dihedral_deg", standard.min_dihedral_deg}}},
      {"solver",
       {{"iteration_ms", ours_us / 1000},
        {"published_iteration_ms", published_us / 1000},
        {"ratio_to_published", published_us / ours_us},
        {"ratio_to_eigen", time_of(iterations, tets, "eigen") / ours_us},
        {"ratio_to_cholmod", time_of(iterations, tets, "cholmod") / ours_us},
        {"double_ratio_to_published", published_us / double_us},
        {"double_ratio_to_eigen", time_of(iterations, tets, "eigen") / double_us},
        {"double_ratio_to_cholmod", time_of(iterations, tets, "cholmod") / double_us},
        {"growth_exponent", exponent},
        {"growth_exponent_operations", operations_exponent},
        {"limit",
         {{"multiply_adds_per_us", limit.multiply_adds_per_us},
          {"cache_bytes_per_us", limit.cache_bytes_per_us},
          {"memory_bytes_per_us", limit.memory_bytes_per_us}}},
        {"published_iterations_per_frame", published_steps},
        {"published_frame_ms", published_steps * published_us / 1000},
        {"iterations", iterations},
        {"instructions",
         options.counted_program.empty() ? left_out("only counted on x86-64") : count_instructions(options)},
        {"mesh_difference", options.quick ? left_out("--quick leaves it out") : measure_meshes(meshes, mount)}}},
      {"speed_error", speed_error}};
  for (const json& row : iterations) {
    std::printf("%6d tets  %-9s  derivatives %9.1f  factor %9.1f  solve %8.1f  step %8.1f  sum %9.1f us\n",
                row["mesh_tets"].get<int>(), row["way"].get<std::string>().c_str(), row["derivatives_us"].get<double>(),
                row["factor_us"].get<double>(), row["solve_us"].get<double>(), row["step_us"].get<double>(),
                row["sum_us"].get<double>());
  }
  std::printf(
      "one iteration at %d tets: %.2f ms, published method %.1f ms: %.0f times; Eigen's LDLT %.1f times, CHOLMOD "
      "%.1f\n",
      tets, ours_us / 1000, published_us / 1000, published_us / ours_us, time_of(iterations, tets, "eigen") / ours_us,
      time_of(iterations, tets, "cholmod") / ours_us);
  std::printf("growth up to 16,000 tets: exponent %.2f; the published method takes %.1f iterations for a frame\n",
              exponent, published_steps);
  if (!options.output.empty()) write_file_atomically(options.output, result.dump(1) + "\n");
}

}  // namespace

}  // namespace finsight::host

int main(int argc, char** argv) {
  using namespace finsight;
  host::Options options;
  CLI::App app("bench: one Newton iteration by several methods, and what fixed schedules cost and err, on one core");
  app.add_option("--spec", options.spec, "finger spec (TOML)")->capture_default_str();
  app.add_option("-o,--output", options.output, "write the figures to this file (JSON)");
  app.add_option("--instructions", options.counted_program, "count instructions too: the program bench_instructions")
      ->check(CLI::ExistingFile);
  app.add_option("--pack", options.pack, "model pack for --instructions")->check(CLI::ExistingFile);
  app.add_flag("--quick", options.quick, "fewer rounds, motions and schedules");
  CLI11_PARSE(app, argc, argv);
  try {
    host::stay_on_one_core();
    host::run(options);
    return 0;
  } catch (const InputError& error) {
    std::fprintf(stderr, "bench: %s\n", error.what());
    return 2;
  } catch (const std::exception& error) {
    std::fprintf(stderr, "%s\n", error.what());
    return 1;
  }
}
