// hostgen force SESSION: contact forces of recorded images.
#include <CLI/CLI.hpp>
#include <cstdio>
#include <memory>

#include "firmware/input_error.h"
#include "firmware/ports/camera.h"
#include "firmware/settings/measured_mount.h"
#include "firmware/settings/settings.h"
#include "firmware/vision/observer.h"
#include "hostgen/commands/commands.h"
#include "hostgen/fem/contact_forces.h"
#include "hostgen/util/common.h"

namespace finsight::host {

namespace {

namespace fs = std::filesystem;

struct ForceOptions {
  fs::path session, spec, pack, mount, output;
  int every = 6;
};

struct Frames {
  double per_second = 0;
  std::vector<std::size_t> number;  ///< in the session
  std::vector<PlatePoses> poses;
};

/// Plate poses as the firmware estimates them, of every `every`th frame. Markers are followed through all.
Frames estimate_poses(const ForceOptions& options, const Model& model) {
  const SessionInfo info = read_session_info(options.session);
  check_markers(info, options.session, model.mount.marker_id, static_cast<double>(model.mount.marker_size_mm),
                options.pack.string());
  const MountModel mount =
      options.mount.empty() ? model.mount
                            : corrected_mount(model.mount, read_measured_mount(TomlTable::parse_file(options.mount)));
  Observer observer(mount, model.prior, info.lens);
  const auto camera = open_session_camera({.path = options.session, .recording = "", .recorded_speed = false}, info);
  Frames frames;
  frames.per_second = info.frames_per_second;
  Frame frame;
  for (std::size_t number = 0; camera->next(frame, 0); ++number) {
    if (interrupted()) throw Interrupted();
    const PlatePoses poses = observer.observe(frame, {}).poses;
    if (number % static_cast<std::size_t>(options.every) != 0 || poses.quality != Quality::kFresh) continue;
    frames.number.push_back(number);
    frames.poses.push_back(poses);
  }
  if (!camera->error().empty()) throw InputError(options.session.string(), camera->error());
  return frames;
}

std::string frame_name(std::size_t number) {
  char name[32];
  std::snprintf(name, sizeof name, "frame_%06zu.vtu", number);
  return name;
}

void write_frame(const fs::path& file, const TetMesh& mesh, const ContactForces& found, const Eigen::Vector3d& inward) {
  std::vector<ForceArrow> arrows;
  for (const Contact& contact : found.contacts) {
    arrows.push_back(
        {contact.point_mm.cast<double>(), contact.displacement_mm.cast<double>(), contact.force_n * inward});
  }
  write_vtu(file, mesh, &found.node_displacement_mm, arrows);
}

std::string csv_rows(std::size_t number, double time_s, const ContactForces& found) {
  std::string rows;
  char line[320];
  for (std::size_t i = 0; i < found.contacts.size(); ++i) {
    const Contact& c = found.contacts[i];
    std::snprintf(line, sizeof line, "%zu,%.6f,%zu,%.3f,%.3f,%.3f,%.4f,%.4f,%.4f,%.2f,%.2f,%d,%d,%.4f,%.4f,%.4f\n",
                  number, time_s, i, static_cast<double>(c.point_mm.x()), static_cast<double>(c.point_mm.y()),
                  static_cast<double>(c.point_mm.z()), c.force_n, c.uncertainty.lowest_force_n,
                  c.uncertainty.highest_force_n, c.uncertainty.position_95_mm, c.uncertainty.extent_95_mm,
                  found.explained ? 1 : 0, found.converged ? 1 : 0, found.total.force_n, found.total.lowest_n,
                  found.total.highest_n);
    rows += line;
  }
  return rows;
}

/// The list by which ParaView plays the frames in time.
std::string collection(const Frames& frames) {
  std::string text = "<?xml version=\"1.0\"?>\n<VTKFile type=\"Collection\" version=\"0.1\">\n<Collection>\n";
  for (const std::size_t number : frames.number) {
    text += "<DataSet timestep=\"" + std::to_string(static_cast<double>(number) / frames.per_second) + "\" file=\"" +
            frame_name(number) + "\"/>\n";
  }
  return text + "</Collection>\n</VTKFile>\n";
}

void run(const ForceOptions& options) {
  const Model model = Model::open(options.pack);
  const FingerSpec spec = read_finger_spec(options.spec);
  check_made_from(spec, model.spec_sha256, options.pack);
  const Frames frames = estimate_poses(options, model);
  if (frames.poses.empty()) throw InputError(options.session.string(), "no frame shows a marker of this finger");
  const TetMesh mesh = make_mesh(spec);
  ContactForceSolver solver(spec, mesh);
  fs::create_directories(options.output);
  std::string csv =
      "frame,time_s,contact,point_x_mm,point_y_mm,point_z_mm,force_n,lowest_force_n,highest_force_n,position_95_mm,"
      "extent_95_mm,"
      "explained,converged,total_force_n,lowest_total_n,highest_total_n\n";
  std::size_t touched = 0, unexplained = 0, not_converged = 0;
  {
    Progress progress("contact forces", frames.poses.size());
    for (std::size_t i = 0; i < frames.poses.size(); ++i) {
      if (interrupted()) throw Interrupted();
      const ContactForces found = solver.gauss_newton(frames.poses[i]);
      touched += !found.contacts.empty();
      unexplained += found.converged && !found.explained;
      not_converged += !found.converged;
      write_frame(options.output / frame_name(frames.number[i]), mesh, found, solver.inward());
      csv += csv_rows(frames.number[i], static_cast<double>(frames.number[i]) / frames.per_second, found);
      progress.advance();
    }
  }
  write_file_atomically(options.output / "contacts.csv", csv);
  write_file_atomically(options.output / "force.pvd", collection(frames));
  std::printf(
      "%s: %zu frames, touched in %zu; in %zu pushes on the face do not explain the plates (explained = 0); in %zu the "
      "solver did not converge (converged = 0), and nothing is known\n",
      options.output.c_str(), frames.poses.size(), touched, unexplained, not_converged);
}

}  // namespace

void add_force_command(CLI::App& app) {
  const auto options = std::make_shared<ForceOptions>();
  CLI::App* command = app.add_subcommand(
      "force",
      "estimate contact forces of a session: frames for ParaView (force.pvd) and contacts.csv, which says of every "
      "contact what else it could be (95 %): a push position_95_mm away, or a pressure that extends over extent_95_mm; "
      "and of all contacts together between "
      "which forces their sum is");
  command->add_option("session", options->session, "session folder (hostgen render and boards record them)")
      ->required();
  command->add_option("--spec", options->spec, "finger spec (TOML)")->required();
  command->add_option("--pack", options->pack, "model pack made from it")->required();
  command->add_option("--mount", options->mount,
                      "where camera and markers of this device are (TOML, from hostgen mount)");
  command->add_option("-o,--output", options->output, "folder to write")->required();
  command->add_option("--every", options->every, "use every Nth frame")
      ->check(CLI::Range(1, 100000))
      ->capture_default_str();
  command->callback([options] { run(*options); });
}

}  // namespace finsight::host
