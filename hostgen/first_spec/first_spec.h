// A first spec for a surface from CAD: what can be guessed from its shape, to be checked by a person.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "hostgen/finger/surface_finger.h"
#include "hostgen/first_spec/plate_guess.h"

namespace finsight::host {

struct FirstSpec {
  std::string toml;
  SurfaceFinger finger;            ///< placed in the finger frame; its plates' boxes are those that were found
  std::vector<PlateGuess> plates;  ///< top, middle, low; fewer if there are not that many
  double marker_size_mm = 0;
  Eigen::Vector3d camera_mm = Eigen::Vector3d::Zero();  ///< looks along +y
  std::vector<std::string> notes;                       ///< what was guessed and how sure it is, and what is missing
};

/// The surface as it lies in its file, in the units that give a usual finger; unchecked. Throws InputError if the file
/// cannot be read.
SurfaceFinger read_as_drawn(const std::filesystem::path& surface_file);

/// The finger stands along the surface's longest side, on the wider of its two ends; its front is the largest face that
/// looks to one side; plates are level undersides with room for a marker that a camera below the base sees. `spec_file`
/// is where the TOML will be written: it names the surface relative to that. Throws InputError if the file cannot be
/// read or its surface bounds no solid.
FirstSpec propose_spec(const std::filesystem::path& surface_file, const std::filesystem::path& spec_file);

}  // namespace finsight::host
