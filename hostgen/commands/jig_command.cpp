// hostgen jig SPEC -o jig.stl
#include <CLI/CLI.hpp>
#include <cstdio>
#include <memory>

#include "hostgen/commands/commands.h"
#include "hostgen/jig/jig.h"
#include "hostgen/util/common.h"
#include "hostgen/util/output_name.h"

namespace finsight::host {

namespace {

struct JigOptions {
  std::filesystem::path spec, output;
};

void run(const JigOptions& options) {
  check_extension(options.output, {".stl"});
  const FingerSpec spec = read_finger_spec(options.spec);
  std::filesystem::path drawing = options.output;
  drawing.replace_extension(".svg");
  for (const std::filesystem::path& file : {options.output, drawing}) {
    check_writable(file, {spec.file, spec.surface_file});
  }
  const Jig jig = make_jig(spec);
  check_bounds_a_solid(jig.surface, options.output.string());
  write_stl(options.output, jig.surface);
  draw_jig(drawing, spec, jig);
  std::printf("%s: %zu triangles, one closed solid; %s: the drawing, 1:1\n", options.output.c_str(),
              jig.surface.triangle.size(), drawing.c_str());
  std::printf("%-5s %9s %9s %9s\n", "hole", "x", "y", "z mm");
  for (const JigHole& hole : jig.fit.holes) {
    std::printf("%-5d %9.2f %9.2f %9.2f\n", hole.number, hole.contact_mm.x(), hole.contact_mm.y(), hole.contact_mm.z());
  }
}

}  // namespace

void add_jig_command(CLI::App& app) {
  const auto options = std::make_shared<JigOptions>();
  CLI::App* command = app.add_subcommand(
      "jig",
      "a jig to print: clips to the finger's base and guides a 3 mm pin that carries weights through numbered holes "
      "over the touched face; beside it a drawing (.svg)");
  command->add_option("spec", options->spec, "finger spec (TOML)")->required();
  command->add_option("-o,--output", options->output, "file to write (.stl, mm, as it is printed)")->required();
  command->callback([options] { run(*options); });
}

}  // namespace finsight::host
