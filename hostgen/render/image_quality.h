// How a rendered image is degraded: by the lens, the light, dirt, motion, the sensor, and compression.
#pragma once

#include <string>
#include <vector>

namespace finsight::host {

/// Grey levels 0 ... 255, lengths in pixels.
struct ImageQuality {
  double blur_px = 0.6;            ///< standard deviation of the lens's blur where it is sharp
  double defocus_px = 0;           ///< further blur of a plate at z: this times |1 - focus_mm / z|
  double focus_mm = 100;           ///< distance at which plates are sharp
  double exposure_s = 0;           ///< plates move during it
  double read_noise = 1.5;         ///< standard deviation, grey levels
  double shot_noise = 0.15;        ///< standard deviation is this times the square root of the grey level
  double white = 205, black = 28;  ///< grey of lit paper and of ink
  double plate = 105;              ///< grey of a plate beside its paper
  double background = 70;          ///< grey of the finger's inside
  double vignetting = 0.35;        ///< share of the light lost in the corner of the image
  double light_gradient = 0.25;    ///< relative difference of the light from left to right
  int hot_spots = 0;               ///< reflections of the LEDs, at fixed places
  int dirt = 0;                    ///< dark specks on the lens
  int beams = 0;                   ///< dark bars of the finger that reach into the image from its sides
  bool srgb = false;               ///< coded as most cameras do (IEC 61966-2-1); levels above are those of light
  int jpeg_quality = 100;          ///< below 100: compressed and decoded as by an MJPEG camera
  double gloss = 0;        ///< what half a ring of LEDs around the lens adds to the grey where glossy paper reflects it
  int clutter = 0;         ///< things behind the plates; every third of them is a marker of another id
  double print_scale = 1;  ///< of the printed markers
  double print_tilt_rad = 0;     ///< of every print on its plate, about the marker's x axis
  double print_bend_per_mm = 0;  ///< curvature of every print across, its middle nearer to the camera
  bool is_misprinted() const { return print_scale != 1 || print_tilt_rad != 0 || print_bend_per_mm != 0; }
  double readout_s = 0;  ///< from the first row to the last, of a rolling shutter
};

/// "lab": a clean finger in good light. "factory": dust, reflections, a lens that is not sharp at all depths, 4 ms of
/// exposure. "worst": little light, 8 ms of exposure, and plenty of each defect. And one trouble each, in the pictures
/// of "lab" coded as sRGB: "coded" (none besides), "jpeg" (quality 70), "clutter", "dim" (a tenth of the light,
/// amplified noise), "defocused" (f/2 at 640 pixels, sharp at the middle of the finger), "misprinted" (1.5 % too small,
/// bent, tilted by 2 degrees), "glare". Throws std::invalid_argument for another name.
ImageQuality image_preset(const std::string& name);
std::vector<std::string> image_presets();

}  // namespace finsight::host
