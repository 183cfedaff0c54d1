// What the camera would see of the three markers: images from plate motions.
#pragma once

#include <cstdint>
#include <functional>
#include <span>
#include <vector>

#include "firmware/geometry/lens.h"
#include "firmware/types.h"
#include "hostgen/finger/spec.h"
#include "hostgen/render/image_effects.h"
#include "hostgen/util/random.h"

namespace finsight::host {

/// Each plate is the rectangle that the spec gives it, seen from its lower side: the marker, one module of white paper
/// around it, and the plate itself beside the paper. Pixels are areas (centres at whole numbers, OpenCV's convention).
class Renderer {
 public:
  Renderer(const FingerSpec& spec, const Lens& lens, const ImageQuality& quality, std::uint64_t seed);
  /// Where the plates are at one time, which of them the camera can see, and how much of the light is on; and what is
  /// wrong with the device.
  struct Scene {
    std::array<PlateMotion, kPlates> plates;
    std::array<bool, kPlates> covered{};
    float light = 1;
    std::array<std::size_t, kPlates> sticker = {0, 1, 2};  ///< whose marker is on each plate
    float blur_px = 0;  ///< standard deviation of a further blur, of a lens out of focus
    Eigen::Isometry3d knock = Eigen::Isometry3d::Identity();  ///< camera as it should be -> as it is
  };
  /// Grey image, width * height bytes: the mean of the scenes, which follow each other during the exposure. The same
  /// seed and call order give the same bytes.
  void render(std::span<const Scene> exposure, std::vector<std::uint8_t>& grey);
  void render(const std::array<PlateMotion, kPlates>& plates, std::vector<std::uint8_t>& grey);
  /// Of a rolling shutter: every eight rows show their own scenes, which `exposure` gives for the time from the middle
  /// row's exposure to theirs; the quality's readout_s is that from the first row's to the last's.
  using ExposureAt = std::function<std::vector<Scene>(double after_middle_s)>;
  void render_rolling(const ExposureAt& exposure, std::vector<std::uint8_t>& grey);

 private:
  /// A plate's lower face, in the marker's frame and in grey levels.
  struct Face {
    float half_width_mm = 0, half_height_mm = 0, module_mm = 0;
    std::array<float, 2 + 64> tone{};  ///< by area: outside, plate, 8 x 8 modules with the paper's border
    template <int N>
    std::array<int, N> areas(const Eigen::Array<float, N, 1>& u_mm, const Eigen::Array<float, N, 1>& v_mm) const;
  };
  /// A part of the image: [first, last) in pixels.
  struct Box {
    int first_x = 0, last_x = 0, first_y = 0, last_y = 0;
    int width() const { return last_x - first_x; }
    int height() const { return last_y - first_y; }
  };

  void prepare_rays();
  void prepare_light(Random& random);
  void add_clutter(Random& random);
  void expose(std::span<const Scene> exposure, int first_row, int last_row);
  void finish(float light, std::vector<std::uint8_t>& grey);
  void draw(const Scene& scene);
  void sharpness_at(double z_mm, double further_px);
  Box bounds(const Face& face, const Eigen::Isometry3d& T_camera_marker) const;
  void draw_plate(const Face& face, const Eigen::Isometry3d& T_camera_marker, double further_blur_px);
  void draw_row(const Face& face, const Box& box, int y);
  void add_reflection(const Eigen::Isometry3d& T_camera_marker, const Box& box, int y);
  void blur_layer(const Box& box, std::vector<float>& layer);
  void quantise(std::vector<std::uint8_t>& grey);

  FingerSpec spec_;
  Lens lens_;
  ImageQuality quality_;
  Random noise_;
  double turning_radius_sq_;
  std::array<Face, kPlates> faces_;
  std::vector<Eigen::Vector2f> corner_ray_;  ///< [height + 1, width + 1] rays at pixel corners; NaN beyond the lens
  std::vector<float> light_;                 ///< [height, width] share of the full light
  std::vector<float> background_;            ///< [height, width] grey levels
  std::vector<float> noise_table_;
  ImageFilm film_;
  std::vector<float> blur_weights_;  ///< the centre's, then those of one side; of the plate being drawn

  // Workspace of one image
  int first_row_ = 0, last_row_ = 0;           ///< those that are drawn now
  std::vector<float> image_;                   ///< [height, width] grey levels of one scene
  std::vector<float> exposed_;                 ///< [height, width] their sum over the exposure
  std::vector<float> cover_, tone_, blurred_;  ///< one plate's layer, [box]: share of the pixel, grey level times share
  std::vector<Eigen::Vector2f> upper_mm_, lower_mm_;  ///< where the corners of a row of pixels see the plate
};

}  // namespace finsight::host
