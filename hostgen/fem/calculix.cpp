#include "hostgen/fem/calculix.h"

#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <sstream>
#include <stdexcept>

#include "hostgen/fem/statics.h"
#include "hostgen/util/common.h"
#include "hostgen/util/run_program.h"

namespace finsight::host {

namespace {

using namespace std::chrono_literals;
constexpr auto kTimeLimit = 30min;

/// Nodes of an element that CalculiX sees.
std::size_t nodes_of(Element element) { return element == Element::kC3D4 ? 4 : kTetNodes; }
std::size_t nodes_of(const QuadraticMesh& mesh) {
  return mesh.element == Element::kC3D4 ? mesh.corner_nodes : mesh.node_mm.size();
}

// One element set and material per region: the soft body and each plate.
void write_materials(const FingerSpec& spec, const QuadraticMesh& mesh, std::ostringstream& out) {
  std::vector<int> regions = mesh.region;
  std::sort(regions.begin(), regions.end());
  regions.erase(std::unique(regions.begin(), regions.end()), regions.end());
  const std::vector<NeoHookean> material = tet_materials(spec, regions);
  for (std::size_t r = 0; r < regions.size(); ++r) {
    out << "*ELEMENT, TYPE=" << (mesh.element == Element::kC3D4 ? "C3D4" : "C3D10") << ", ELSET=R" << regions[r]
        << "\n";
    for (std::size_t t = 0; t < mesh.tets.size(); ++t) {
      if (mesh.region[t] != regions[r]) continue;
      out << t + 1;
      for (std::size_t a = 0; a < nodes_of(mesh.element); ++a) out << ", " << mesh.tets[t][a] + 1;
      out << "\n";
    }
    // Its energy is C10 (J^(-2/3) I1 - 3) + 1/D1 (J - 1)^2.
    out << "*MATERIAL, NAME=M" << regions[r] << "\n*HYPERELASTIC, NEO HOOKE\n"
        << material[r].mu_mpa / 2 << ", " << 2 / material[r].bulk_mpa << "\n"
        << "*SOLID SECTION, ELSET=R" << regions[r] << ", MATERIAL=M" << regions[r] << "\n";
  }
}

/// The last displacements in CalculiX's .dat file (it prints every increment), [3 * nodes].
std::vector<double> read_displacements(const std::filesystem::path& file, std::size_t nodes) {
  std::vector<double> displacement(3 * nodes);
  std::size_t found = 0;
  std::istringstream in(read_file(file));
  for (std::string line; std::getline(in, line);) {
    std::size_t node = 0;
    double u[3];
    if (line.find("displacements") != std::string::npos) found = 0;
    if (std::sscanf(line.c_str(), "%zu %lf %lf %lf", &node, &u[0], &u[1], &u[2]) != 4) continue;
    if (node < 1 || node > nodes) throw std::runtime_error("ccx: node " + std::to_string(node) + " does not exist");
    std::copy_n(u, 3, displacement.begin() + 3 * static_cast<std::ptrdiff_t>(node - 1));
    ++found;
  }
  if (found != nodes) {
    throw std::runtime_error("ccx wrote " + std::to_string(found) + " displacements of " + std::to_string(nodes));
  }
  return displacement;
}

}  // namespace

bool calculix_present() {
  const char* path = std::getenv("PATH");
  std::istringstream folders(path ? path : "");
  for (std::string folder; std::getline(folders, folder, ':');) {
    if (std::filesystem::exists(std::filesystem::path(folder) / "ccx")) return true;
  }
  return false;
}

std::string calculix_deck(const PushedFinger& finger, std::span<const double> force_n) {
  const QuadraticMesh& mesh = finger.mesh;
  std::ostringstream out;
  out.precision(13);  // CalculiX reads twenty characters of a number, and refuses a node or a load with more
  out << "*NODE, NSET=ALL\n";
  for (std::size_t i = 0; i < nodes_of(mesh); ++i) {
    const Eigen::Vector3d& at = mesh.node_mm[i];
    out << i + 1 << ", " << at.x() << ", " << at.y() << ", " << at.z() << "\n";
  }
  write_materials(finger.spec, mesh, out);
  out << "*BOUNDARY\n";
  for (std::size_t i = 0; i < nodes_of(mesh); ++i) {
    if (mesh.fixed[i]) out << i + 1 << ", 1, 3\n";
  }
  // Its own tolerance of half a per cent would be all the difference that there is; so small ones need more iterations.
  out << "*STEP, NLGEOM, INC=1000\n*STATIC\n1., 1.\n"
         "*CONTROLS, PARAMETERS=FIELD\n1e-9, 1e-9, , , 1e-9\n"
         "*CONTROLS, PARAMETERS=TIME INCREMENTATION\n10, 20, 21, 30, 25, 4, , 5\n"
         "*CLOAD\n";
  for (std::size_t i = 0; i < nodes_of(mesh); ++i) {
    const int unknown = finger.body.unknown_of_node()[i];
    if (unknown == finger.body.free_nodes()) continue;  // the base carries it at once
    for (std::size_t k = 0; k < 3; ++k) {
      const double part_n = force_n[3 * static_cast<std::size_t>(unknown) + k];
      if (part_n != 0) out << i + 1 << ", " << k + 1 << ", " << part_n << "\n";
    }
  }
  out << "*NODE PRINT, NSET=ALL\nU\n*END STEP\n";
  return out.str();
}

CalculixComparison compare_with_calculix(const FingerSpec& spec, const TetMesh& mesh, Element element,
                                         const LoadCase& load) {
  const auto shared = std::make_shared<const PushedFinger>(spec, mesh, element);
  FingerStatics finger(shared);
  finger.begin(load.contacts);
  if (!finger.press(load.force_n)) throw std::runtime_error("no equilibrium of a load that CalculiX is to solve");
  const TemporaryFolder folder;
  write_file_atomically(folder.path() / "finger.inp", calculix_deck(*shared, finger.nodal_forces()));
  run_program({"ccx", "-i", "finger"}, folder.path(), kTimeLimit, "calculix-ccx");
  const std::vector<double> theirs = read_displacements(folder.path() / "finger.dat", nodes_of(shared->mesh));

  const std::vector<double> ours = finger.quadratic_displacement_mm();
  CalculixComparison result;
  for (std::size_t i = 0; i < theirs.size(); i += 3) {
    const Eigen::Map<const Eigen::Vector3d> a(&ours[i]), b(&theirs[i]);
    result.largest_mm = std::max(result.largest_mm, a.norm());
    result.difference_mm = std::max(result.difference_mm, (a - b).norm());
  }
  return result;
}

}  // namespace finsight::host
