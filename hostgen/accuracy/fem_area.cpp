// How far the training truth can be trusted: against CalculiX, and how much stiffer other elements and meshes are.
#include <cstdio>
#include <nlohmann/json.hpp>

#include "hostgen/accuracy/areas.h"
#include "hostgen/fem/calculix.h"
#include "hostgen/fem/statics.h"

namespace finsight::host {

using nlohmann::json;

namespace {

const char* name_of(Element element) {
  if (element == Element::kSelective) return "selective";
  return element == Element::kC3D4 ? "C3D4" : "C3D10";
}
constexpr Element kOfCalculix[] = {Element::kC3D4, Element::kC3D10};
constexpr Element kElements[] = {Element::kC3D4, Element::kC3D10, Element::kSelective};

void say(const char* what, const char* element, const char* mesh) {
  std::fprintf(stderr, "  %s: %s, %s mesh\n", what, element, mesh);
}

json compare(const FingerSpec& spec, const TetMesh& mesh, const char* mesh_name, bool quick) {
  const double half_mm = spec.half_width.at(80) - spec.touch_edge_mm;
  std::vector<std::pair<const char*, LoadCase>> loads = {{"push", push(0, 70, 1.5)}};
  if (!quick) {
    loads.emplace_back("push", push(half_mm, 80, 1.5));
    loads.emplace_back("push", push(-half_mm / 2, 40, 6));
    loads.emplace_back("friction 0.5",
                       LoadCase{{{.centre_mm = {half_mm / 2, 75}, .friction = {0.4, -0.3}, .follow = 1}}, 2});
    loads.emplace_back("patch", LoadCase{{{.centre_mm = {0, 60}, .radius_mm = 9, .full_force_n = 3}}, 3});
  }
  json rows = json::array();
  for (const Element element : kOfCalculix) {
    for (const auto& [kind, load] : loads) {
      say("CalculiX", name_of(element), mesh_name);
      const CalculixComparison result = compare_with_calculix(spec, mesh, element, load);
      rows.push_back({{"element", name_of(element)},
                      {"load", kind},
                      {"tets", mesh.tets.size()},
                      {"x_mm", load.contacts[0].centre_mm.x()},
                      {"y_mm", load.contacts[0].centre_mm.y()},
                      {"force_n", load.force_n},
                      {"largest_mm", result.largest_mm},
                      {"difference_mm", result.difference_mm}});
    }
  }
  return rows;
}

/// How far half a newton in the middle of the face moves a plate at most, by mesh and element.
json locking(const FingerSpec& spec, bool quick) {
  const std::pair<const char*, MeshSize> sizes[] = {{"coarse", MeshSize::kCoarse},
                                                    {"default", MeshSize::kDefault},
                                                    {"medium", MeshSize::kMedium},
                                                    {"fine", MeshSize::kFine},
                                                    {"finest", MeshSize::kFinest}};
  json rows = json::array();
  for (const auto& [name, size] : sizes) {
    if (quick && size == MeshSize::kMedium) break;
    const TetMesh mesh = make_mesh(spec, size);
    json row = {{"mesh", name}, {"tets", mesh.tets.size()}};
    for (const Element element : kElements) {
      say("locking", name_of(element), name);
      FingerStatics finger(std::make_shared<const PushedFinger>(spec, mesh, element));
      if (!finger.load(Vec3f(0, 70, 0), 0.5)) throw std::runtime_error("no equilibrium under half a newton");
      row[std::string(name_of(element)) + "_mm"] = plate_motion_mm(finger.state().plates);
    }
    rows.push_back(row);
  }
  return rows;
}

}  // namespace

json measure_fem(const std::filesystem::path& spec_file, const json& built, bool quick) {
  const FingerSpec spec = read_finger_spec(spec_file);
  json fem = built;
  fem["locking"] = locking(spec, quick);
  if (!calculix_present()) {
    fem["calculix_max_diff_mm"] = nullptr;
    fem["why"] = "ccx is not installed (Debian: calculix-ccx)";
    return {{"fem", fem}};
  }
  const MeshSize size = quick ? MeshSize::kCoarse : MeshSize::kDefault;
  fem["calculix"] = compare(spec, make_mesh(spec, size), quick ? "coarse" : "default", quick);
  double worst_mm = 0;
  for (const json& row : fem["calculix"]) worst_mm = std::max(worst_mm, row["difference_mm"].get<double>());
  fem["calculix_max_diff_mm"] = worst_mm;
  if (!fem["seconds"].is_null()) fem.erase("why");  // every key has its value
  return {{"fem", fem}};
}

}  // namespace finsight::host
