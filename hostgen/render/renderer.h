// What the camera would see of the three markers: pictures from plate motions.
#pragma once

#include <cstdint>
#include <vector>

#include "firmware/types.h"
#include "hostgen/finger/spec.h"
#include "hostgen/random.h"
#include "hostgen/render/lens.h"

namespace finsight::host {

/// How the picture is spoiled. Grey levels 0 ... 255, lengths in pixels.
struct PictureQuality {
  double blur_px = 0.6;            ///< standard deviation of the lens's blur
  double read_noise = 1.5;         ///< standard deviation, grey levels
  double shot_noise = 0.15;        ///< standard deviation is this times the square root of the grey level
  double white = 205, black = 28;  ///< grey of lit paper and of ink
  double plate = 105;              ///< grey of a plate beside its paper
  double background = 70;          ///< grey of the finger's inside
  double vignetting = 0.35;        ///< share of the light lost in the corner of the picture
  double light_gradient = 0.25;    ///< relative difference of the light from left to right
};

/// Each plate is the rectangle that the spec gives it, seen from its lower side: the marker, one module of white paper
/// around it, and the plate itself beside the paper. Pixels are areas (centres at whole numbers, OpenCV's convention).
class Renderer {
 public:
  Renderer(const FingerSpec& spec, const CameraIntrinsics& camera, const PictureQuality& quality, std::uint64_t seed);
  /// Grey picture, width * height bytes. The same seed and call order give the same bytes.
  void render(const std::array<PlateMotion, kPlates>& plates, std::vector<std::uint8_t>& grey);

 private:
  /// A plate's lower face, in the marker's frame and in grey levels.
  struct Face {
    float half_width_mm = 0, half_height_mm = 0, module_mm = 0;
    std::array<float, 2 + 64> tone{};  ///< by area: outside, plate, 8 x 8 modules with the paper's border
    template <int N>
    std::array<int, N> areas(const Eigen::Array<float, N, 1>& u_mm, const Eigen::Array<float, N, 1>& v_mm) const;
  };
  /// A part of the picture: [first, last) in pixels.
  struct Box {
    int first_x = 0, last_x = 0, first_y = 0, last_y = 0;
    int width() const { return last_x - first_x; }
    int height() const { return last_y - first_y; }
  };

  void prepare_rays();
  void prepare_light(Random& random);
  Box bounds(const Face& face, const Eigen::Isometry3d& T_camera_marker) const;
  void draw_plate(const Face& face, const Eigen::Isometry3d& T_camera_marker);
  void draw_row(const Face& face, const Box& box, int y);
  void blur_layer(const Box& box, std::vector<float>& layer);
  void quantise(std::vector<std::uint8_t>& grey);

  FingerSpec spec_;
  CameraIntrinsics camera_;
  PictureQuality quality_;
  Random noise_;
  Lens lens_;
  std::array<Face, kPlates> faces_;
  std::vector<Eigen::Vector2f> corner_ray_;  ///< [height + 1, width + 1] rays at the pixels' corners; NaN where none
  std::vector<float> light_;                 ///< [height, width] share of the full light
  std::vector<float> background_;            ///< [height, width] grey levels
  std::vector<float> noise_table_;
  std::vector<float> blur_weights_;  ///< the middle one, then one side's

  // Workspace of one picture
  std::vector<float> picture_;                 ///< [height, width] grey levels
  std::vector<float> cover_, tone_, blurred_;  ///< one plate's layer, [box]: share of the pixel, grey level times share
  std::vector<Eigen::Vector2f> upper_mm_, lower_mm_;  ///< where the corners of a row of pixels see the plate
};

}  // namespace finsight::host
