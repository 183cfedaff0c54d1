// Where known weights press a finger: the guide holes of its jig. `hostgen jig` prints them, and whoever reads a
// recording made with the jig finds the contacts here.
#pragma once

#include <Eigen/Core>
#include <vector>

#include "hostgen/finger/spec.h"

namespace finsight::host {

/// The pin that carries the weights, and the free bore of the guides that it slides in.
inline constexpr double kJigPinMm = 3, kJigBoreMm = 3.3;

struct JigHole {
  int number = 0;                                        ///< 1, 2, ...: printed beside the hole
  Eigen::Vector3d contact_mm = Eigen::Vector3d::Zero();  ///< where the pin's end meets the undeformed face
  Eigen::Vector3d inward = Eigen::Vector3d::Zero();      ///< unit vector along which it presses: of all holes the same
};

/// The holes of a finger's jig, in the finger frame: three rows in the middles of the lower, middle and upper third of
/// the touched part, of three holes each, in its middle and two thirds of the way to its sides. Numbers go along x
/// within a row, from the lowest row up. Rows or columns for which there is no room beside each other are left out:
/// there are 9 on most fingers, else 6, 3, 2 or 1. The guides are parallel, so that one way of hanging the jig serves
/// all of them: along the mean of the face's normals at the holes.
std::vector<JigHole> jig_holes(const FingerSpec& spec);
/// Between guides' axes: along a row bore and walls, between rows also the number above each guide.
inline constexpr double kJigSpacingMm = 7, kJigRowSpacingMm = 12;

}  // namespace finsight::host
