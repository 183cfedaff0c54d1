// What a camera that somebody thinks of buying would see of a finger.
#pragma once

#include <array>
#include <string>
#include <vector>

#include "hostgen/finger/spec.h"

namespace finsight::host {

/// From the makers' data sheets.
struct Sensor {
  std::string name;
  int width_px = 0, height_px = 0;
  double pixel_um = 0;
  bool global_shutter = false;  ///< else rows are exposed one after the other
  bool colour = false;          ///< the usual one; grey is interpolated from pixels behind colour filters
};
const std::vector<Sensor>& known_sensors();

struct CameraChoice {
  Sensor sensor;
  int binning = 1;  ///< pixels of the sensor along one of the image's
  double focal_mm = 0, f_number = 0;
  double focus_mm = 0;  ///< from the lens; 0: where the nearest and the furthest marker are equally sharp
};

/// What the camera would see of one plate at rest.
struct MarkerView {
  double distance_mm = 0;  ///< along the line of sight
  double side_px = 0;      ///< of the marker
  double blur_px = 0;      ///< diameter of a point's image by defocus alone
  bool in_view = false;    ///< over the plate's whole working range, with its white margin
  double corner_px = 0;    ///< RMS error of a corner, along one axis, in rendered pictures of that blur and light
  double lost = 0;         ///< share of those pictures in which its corners could not be found
  double lateral_mm = 0, depth_mm = 0, tilt_deg = 0;  ///< standard deviations of one frame by these corners alone
};

struct CameraView {
  CameraChoice choice;  ///< with the focus
  Lens lens;            ///< a pinhole
  double across_deg = 0, up_deg = 0;
  double sharp_from_mm = 0, sharp_to_mm = 0;  ///< defocus below two pixels; infinite if there is no end
  std::array<MarkerView, kPlates> markers;
};

/// Looks along the spec's line of sight. Pictures are rendered with noise for pixels that hold 1000 electrons per
/// square micrometre, lit to 80 %, 5 electrons of read noise, diffraction, and a lens that blurs by half a pixel of 3
/// um; colour filters add half a pixel. Corners are those of the firmware. The same input gives the same numbers.
/// Throws InputError for a focus or markers within the focal length.
CameraView camera_view(const FingerSpec& spec, CameraChoice choice);

}  // namespace finsight::host
