#include "hostgen/render/renderer.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "firmware/vision/aruco_compat.h"
#include "firmware/vision/observer.h"
#include "hostgen/finger/plate_geometry.h"
#include "hostgen/finger/plate_motion.h"

namespace finsight::host {

namespace {

constexpr int kOutside = 0, kPlateArea = 1, kFirstModule = 2;  // areas of a plate's lower face
constexpr int kPaperModules = 8;                               // marker and one module of white on every side
constexpr std::size_t kNoiseTable = 1 << 18;
constexpr int kSamples = 64;  // per pixel that an edge crosses
constexpr double kNearestMm = 1;
constexpr float kFarMm = 1e6f, kFarthestInverse = 1 / kFarMm;

/// Points in a pixel, 0 ... 1: a Hammersley set. Each column and each row of 1/64 holds one, so that an upright edge is
/// placed to 1/64 px where a square grid of 8 x 8 would place it to 1/8.
struct PixelSamples {
  using Values = Eigen::Array<float, kSamples, 1>;
  Values x, y, xy;
  PixelSamples() {
    for (int i = 0; i < kSamples; ++i) {
      int reversed = 0;
      for (int bit = 0; bit < 6; ++bit) reversed |= ((i >> bit) & 1) << (5 - bit);
      x[i] = (static_cast<float>(i) + 0.5f) / kSamples;
      y[i] = (static_cast<float>(reversed) + 0.5f) / kSamples;
      xy[i] = x[i] * y[i];
    }
  }
};

/// The centre and one side of a symmetric Gaussian whose weights add up to 1.
std::vector<float> blur_weights(double sigma_px) {
  std::vector<double> weights{1};
  double sum = 1;
  for (int i = 1; i <= std::ceil(3 * sigma_px); ++i) {
    weights.push_back(std::exp(-0.5 * i * i / (sigma_px * sigma_px)));
    sum += 2 * weights.back();
  }
  std::vector<float> result;
  for (const double weight : weights) result.push_back(static_cast<float>(weight / sum));
  return result;
}

/// Where the eye sees a print that is bent about its y axis, given where it would see a flat one. The print's middle
/// stands on the plate and its sides bend away from the eye.
Eigen::Vector2f on_bent_print(const Eigen::Vector3f& eye, const Eigen::Vector2f& flat_mm, float bend_per_mm) {
  Eigen::Vector2f seen_mm = flat_mm;
  for (int step = 0; step < 2; ++step) {
    const float height_mm = -0.5F * bend_per_mm * std::min(seen_mm.x() * seen_mm.x(), 100.0F);
    seen_mm = flat_mm + (eye.head<2>() - flat_mm) * (height_mm / eye.z());
  }
  return seen_mm;
}

}  // namespace

/// Which area of the face holds each point (u right, v up, from the marker's centre; finite). Without branches, so that
/// the compiler vectorises it.
template <int N>
std::array<int, N> Renderer::Face::areas(const Eigen::Array<float, N, 1>& u_mm,
                                         const Eigen::Array<float, N, 1>& v_mm) const {
  constexpr int kHalf = kPaperModules / 2;
  const auto module = [&](const Eigen::Array<float, N, 1>& at_mm) -> Eigen::Array<int, N, 1> {
    return (at_mm / module_mm).floor().max(-kHalf - 1).min(kHalf).template cast<int>() + kHalf;
  };
  const Eigen::Array<int, N, 1> column = module(u_mm), row = module(-v_mm);
  std::array<int, N> result;
  for (int i = 0; i < N; ++i) {
    const bool on_face = (int{std::abs(u_mm[i]) <= half_width_mm} & int{std::abs(v_mm[i]) <= half_height_mm}) != 0;
    // Unsigned, a negative number is a large one.
    const bool on_paper = (int{static_cast<unsigned>(column[i]) < kPaperModules} &
                           int{static_cast<unsigned>(row[i]) < kPaperModules}) != 0;
    const int on_plate = on_paper ? kFirstModule + row[i] * kPaperModules + column[i] : kPlateArea;
    result[i] = on_face ? on_plate : kOutside;
  }
  return result;
}

Renderer::Renderer(const FingerSpec& spec, const Lens& lens, const ImageQuality& quality, std::uint64_t seed)
    : spec_(spec), lens_(lens), quality_(quality), noise_(seed), turning_radius_sq_(turning_radius_sq(lens)) {
  for (int plate = 0; plate < kPlates; ++plate) {
    const Eigen::Vector2f half_mm = plate_half_size_mm(spec, plate).cast<float>();
    Face& face = faces_[plate];
    face.half_width_mm = half_mm.x();
    face.half_height_mm = half_mm.y();
    face.module_mm = static_cast<float>(quality.print_scale * spec.marker_size_mm / 6);
    face.tone.fill(static_cast<float>(quality.white));
    face.tone[kOutside] = 0;
    face.tone[kPlateArea] = static_cast<float>(quality.plate);
    const std::array<std::uint8_t, 36> modules = marker_modules(spec.plates[plate].marker_id);
    for (int i = 0; i < 36; ++i) {
      if (!modules[i])
        face.tone[kFirstModule + (i / 6 + 1) * kPaperModules + i % 6 + 1] = static_cast<float>(quality.black);
    }
  }
  prepare_rays();
  prepare_light(noise_);
  if (quality.clutter > 0) add_clutter(noise_);
  noise_table_.resize(kNoiseTable + static_cast<std::size_t>(lens_.width_px));
  for (std::size_t i = 0; i < noise_table_.size(); ++i) {
    noise_table_[i] = i < kNoiseTable ? static_cast<float>(noise_.normal()) : noise_table_[i - kNoiseTable];
  }
  film_ = ImageFilm(quality, lens.width_px, lens.height_px, noise_);
  upper_mm_.resize(static_cast<std::size_t>(lens_.width_px) + 1);
  lower_mm_ = upper_mm_;
}

void Renderer::prepare_rays() {
  constexpr float kNone = std::numeric_limits<float>::quiet_NaN();
  for (int y = 0; y <= lens_.height_px; ++y) {
    for (int x = 0; x <= lens_.width_px; ++x) {
      const Eigen::Vector2d ray = ray_from_pixel(lens_, {x - 0.5, y - 0.5}, 1e-9);
      corner_ray_.push_back(ray.squaredNorm() < turning_radius_sq_ ? Eigen::Vector2f(ray.cast<float>())
                                                                   : Eigen::Vector2f(kNone, kNone));
    }
  }
}

/// Vignetting, a gradient of the light, and the finger's dark inside with a slow texture. All of it is so smooth that
/// the lens's blur would not change it.
void Renderer::prepare_light(Random& random) {
  constexpr int kWaves = 6;
  struct Wave {
    double along_x, along_y, phase;
  };
  std::array<Wave, kWaves> waves;
  for (Wave& wave : waves) {
    const double length_px = lens_.width_px * random.uniform(0.12, 0.5);
    const double direction = random.uniform(0, 2 * std::numbers::pi), cycle = 2 * std::numbers::pi / length_px;
    wave = {cycle * std::cos(direction), cycle * std::sin(direction), random.uniform(0, 2 * std::numbers::pi)};
  }
  const double half_diagonal_sq = 0.25 * (std::pow(lens_.width_px, 2) + std::pow(lens_.height_px, 2));
  for (int y = 0; y < lens_.height_px; ++y) {
    for (int x = 0; x < lens_.width_px; ++x) {
      const double from_middle_x = x - 0.5 * lens_.width_px, from_middle_y = y - 0.5 * lens_.height_px;
      const double radius_sq = (from_middle_x * from_middle_x + from_middle_y * from_middle_y) / half_diagonal_sq;
      const double light =
          (1 - quality_.vignetting * radius_sq) * (1 + quality_.light_gradient * from_middle_x / lens_.width_px);
      double texture = 1;
      for (const Wave& wave : waves) texture += 0.06 * std::sin(wave.along_x * x + wave.along_y * y + wave.phase);
      light_.push_back(static_cast<float>(light));
      background_.push_back(static_cast<float>(light * quality_.background * texture));
    }
  }
}

/// Bright and dark boxes and markers of other ids, turned anyhow, all over the background.
void Renderer::add_clutter(Random& random) {
  const double scale = lens_.width_px / 640.0;
  for (int thing = 0; thing < quality_.clutter; ++thing) {
    std::size_t id = 0;
    do {
      id = random.index(kDictionaryMarkers);
    } while (std::any_of(spec_.plates.begin(), spec_.plates.end(),
                         [&](const PlateSpec& plate) { return plate.marker_id == static_cast<int>(id); }));
    const std::array<std::uint8_t, 36> modules = marker_modules(static_cast<int>(id));
    const bool is_marker = thing % 3 == 0;
    const double side_px = scale * random.uniform(25, 70), angle = random.uniform(0, 2 * std::numbers::pi);
    const double centre_x = random.uniform(0, lens_.width_px), centre_y = random.uniform(0, lens_.height_px);
    const double tone = random.uniform(quality_.black, quality_.white);
    const int reach = static_cast<int>(side_px);
    for (int y = std::max(0, static_cast<int>(centre_y) - reach);
         y < std::min(lens_.height_px, static_cast<int>(centre_y) + reach); ++y) {
      for (int x = std::max(0, static_cast<int>(centre_x) - reach);
           x < std::min(lens_.width_px, static_cast<int>(centre_x) + reach); ++x) {
        const double along = ((x - centre_x) * std::cos(angle) + (y - centre_y) * std::sin(angle)) / side_px + 0.5;
        const double across = ((y - centre_y) * std::cos(angle) - (x - centre_x) * std::sin(angle)) / side_px + 0.5;
        if (!(along >= 0 && along < 1 && across >= 0 && across < 1)) continue;
        const int column = static_cast<int>(8 * along) - 1, row = static_cast<int>(8 * across) - 1;
        const bool on_code = column >= 0 && column < 6 && row >= 0 && row < 6;
        const bool dark = on_code && modules[static_cast<std::size_t>(row * 6 + column)] == 0;
        const double level = is_marker ? (dark ? quality_.black : quality_.white) : tone;
        const std::size_t pixel =
            static_cast<std::size_t>(y) * static_cast<std::size_t>(lens_.width_px) + static_cast<std::size_t>(x);
        background_[pixel] = light_[pixel] * static_cast<float>(level);
      }
    }
  }
}

void Renderer::render(const std::array<PlateMotion, kPlates>& plates, std::vector<std::uint8_t>& grey) {
  const Scene still{.plates = plates};
  render({&still, 1}, grey);
}

void Renderer::render(std::span<const Scene> exposure, std::vector<std::uint8_t>& grey) {
  exposed_.assign(background_.size(), 0);
  expose(exposure, 0, lens_.height_px);
  finish(exposure[0].light, grey);
}

void Renderer::render_rolling(const ExposureAt& exposure, std::vector<std::uint8_t>& grey) {
  constexpr int kBand = 8;
  exposed_.assign(background_.size(), 0);
  float light = 1;
  for (int row = 0; row < lens_.height_px; row += kBand) {
    const double after_middle_s = quality_.readout_s * ((row + 0.5 * kBand) / lens_.height_px - 0.5);
    const std::vector<Scene> scenes = exposure(after_middle_s);
    light = scenes[0].light;
    expose(scenes, row, std::min(row + kBand, lens_.height_px));
  }
  finish(light, grey);
}

/// Adds the scenes' mean to these rows of exposed_.
void Renderer::expose(std::span<const Scene> exposure, int first_row, int last_row) {
  first_row_ = first_row;
  last_row_ = last_row;
  image_.resize(background_.size());
  const std::size_t width = static_cast<std::size_t>(lens_.width_px);
  const float part = 1 / static_cast<float>(exposure.size());
  for (const Scene& scene : exposure) {
    draw(scene);
    for (std::size_t i = first_row * width; i < last_row * width; ++i) exposed_[i] += part * scene.light * image_[i];
  }
}

void Renderer::finish(float light, std::vector<std::uint8_t>& grey) {
  image_.swap(exposed_);
  for (std::size_t i = 0; i < film_.transmission.size(); ++i) image_[i] *= film_.transmission[i];
  for (std::size_t i = 0; i < film_.glare.size(); ++i) image_[i] += light * film_.glare[i];
  quantise(grey);
  if (quality_.jpeg_quality < 100) through_jpeg(grey, lens_.width_px, lens_.height_px, quality_.jpeg_quality);
}

void Renderer::draw(const Scene& scene) {
  std::array<Eigen::Isometry3d, kPlates> marker;
  std::array<int, kPlates> order{};
  for (int plate = 0; plate < kPlates; ++plate) {
    marker[plate] = scene.knock * T_camera_marker(spec_, static_cast<std::size_t>(plate), scene.plates[plate]);
    if (quality_.print_tilt_rad != 0) {
      marker[plate].rotate(Eigen::AngleAxisd(quality_.print_tilt_rad, Eigen::Vector3d::UnitX()));
    }
    order[plate] = plate;
  }
  // From far to near: what is nearer covers what is behind it.
  std::sort(order.begin(), order.end(),
            [&](int a, int b) { return marker[a].translation().z() > marker[b].translation().z(); });
  const std::ptrdiff_t first = std::ptrdiff_t{first_row_} * lens_.width_px,
                       last = std::ptrdiff_t{last_row_} * lens_.width_px;
  std::copy(background_.begin() + first, background_.begin() + last, image_.begin() + first);
  for (const int plate : order) {
    if (scene.covered[plate]) continue;
    Face face = faces_[plate];
    face.tone = faces_[scene.sticker[plate]].tone;
    draw_plate(face, marker[plate], static_cast<double>(scene.blur_px));
  }
}

/// A lens's circle of confusion grows with |1 - focus / z|.
void Renderer::sharpness_at(double z_mm, double further_px) {
  const double defocus_px = quality_.defocus_px * std::abs(1 - quality_.focus_mm / std::max(z_mm, kNearestMm));
  blur_weights_ = blur_weights(std::hypot(quality_.blur_px, defocus_px, further_px));
}

/// The part of the image that the face can reach, blur included; the whole image when part of the face is beyond what
/// the lens can see.
Renderer::Box Renderer::bounds(const Face& face, const Eigen::Isometry3d& T_camera_marker) const {
  constexpr int kSteps = 8;  // distortion bends the edges
  Eigen::Vector2d lowest(1e9, 1e9), highest(-1e9, -1e9);
  for (int i = 0; i <= kSteps; ++i) {
    for (int j = 0; j <= kSteps; ++j) {
      if (i % kSteps != 0 && j % kSteps != 0) continue;
      const Eigen::Vector3d point = T_camera_marker * Eigen::Vector3d(face.half_width_mm * (2.0 * i / kSteps - 1),
                                                                      face.half_height_mm * (2.0 * j / kSteps - 1), 0);
      const Eigen::Vector2d ray = point.head<2>() / point.z();
      if (!(point.z() > kNearestMm && ray.squaredNorm() < turning_radius_sq_)) {
        return {0, lens_.width_px, 0, lens_.height_px};
      }
      const Eigen::Vector2d pixel = pixel_from_ray(lens_, ray);
      lowest = lowest.cwiseMin(pixel);
      highest = highest.cwiseMax(pixel);
    }
  }
  const double margin_px = 2 + static_cast<double>(blur_weights_.size());
  const auto clamped = [](double value, int limit) { return static_cast<int>(std::clamp<double>(value, 0, limit)); };
  return {clamped(lowest.x() - margin_px, lens_.width_px), clamped(highest.x() + margin_px, lens_.width_px),
          clamped(lowest.y() - margin_px, lens_.height_px), clamped(highest.y() + margin_px, lens_.height_px)};
}

/// Draws a plate into a layer of its own, blurs the layer, and lays it over the image.
void Renderer::draw_plate(const Face& face, const Eigen::Isometry3d& T_camera_marker, double further_blur_px) {
  const Eigen::Vector3d place = T_camera_marker.translation();
  const bool seen_from_below = T_camera_marker.linear().col(2).dot(place) < 0;
  sharpness_at(place.z(), further_blur_px);
  Box box = bounds(face, T_camera_marker);
  const int margin = static_cast<int>(blur_weights_.size());
  box.first_y = std::max(box.first_y, first_row_ - margin);
  box.last_y = std::min(box.last_y, last_row_ + margin);
  if (!seen_from_below || box.width() <= 0 || box.height() <= 0) return;
  const std::size_t pixels = static_cast<std::size_t>(box.width()) * static_cast<std::size_t>(box.height());
  cover_.assign(pixels, 0);
  tone_.assign(pixels, 0);

  // A point u, v of the face lies at u X + v Y + t in the camera frame, so [X Y t]^-1 takes a ray to its u, v and 1/z.
  Eigen::Matrix3d face_to_ray = T_camera_marker.linear();
  face_to_ray.col(2) = place;
  const Eigen::Matrix3f ray_to_face = face_to_ray.inverse().cast<float>();
  const Eigen::Vector3f eye = (T_camera_marker.inverse() * Eigen::Vector3d::Zero()).cast<float>();
  const auto bend_per_mm = static_cast<float>(quality_.print_bend_per_mm);
  const auto see_row = [&](int y, std::vector<Eigen::Vector2f>& row_mm) {
    const Eigen::Vector2f* rays = &corner_ray_[static_cast<std::size_t>(y) * (lens_.width_px + 1)];
    for (int x = box.first_x; x <= box.last_x; ++x) {
      const Eigen::Vector3f point = ray_to_face * rays[x].homogeneous();
      const bool ahead = point.z() > kFarthestInverse;  // false for NaN, where the lens has no ray
      row_mm[x] = ahead ? Eigen::Vector2f(point.head<2>() / point.z()) : Eigen::Vector2f::Constant(kFarMm);
      if (bend_per_mm != 0 && ahead) row_mm[x] = on_bent_print(eye, row_mm[x], bend_per_mm);
    }
  };
  see_row(box.first_y, lower_mm_);
  for (int y = box.first_y; y < box.last_y; ++y) {
    std::swap(upper_mm_, lower_mm_);
    see_row(y + 1, lower_mm_);
    draw_row(face, box, y);
    if (quality_.gloss > 0) add_reflection(T_camera_marker, box, y);
  }

  blur_layer(box, cover_);
  blur_layer(box, tone_);
  for (int y = box.first_y, i = 0; y < box.last_y; ++y) {
    if (y < first_row_ || y >= last_row_) {
      i += box.width();
      continue;
    }
    const std::size_t row = static_cast<std::size_t>(y) * lens_.width_px;
    for (int x = box.first_x; x < box.last_x; ++x, ++i) {
      image_[row + x] = image_[row + x] * (1 - cover_[i]) + tone_[i] * light_[row + x];
    }
  }
}

/// One row of pixels of the layer, between the rows of corners upper_mm_ and lower_mm_.
void Renderer::draw_row(const Face& face, const Box& box, int y) {
  static const PixelSamples samples;
  std::size_t i = static_cast<std::size_t>(y - box.first_y) * box.width();
  for (int x = box.first_x; x < box.last_x; ++x, ++i) {
    const Eigen::Vector2f corners[4] = {upper_mm_[x], upper_mm_[x + 1], lower_mm_[x], lower_mm_[x + 1]};
    const Eigen::Vector2f least = corners[0].cwiseMin(corners[1]).cwiseMin(corners[2].cwiseMin(corners[3]));
    const Eigen::Vector2f most = corners[0].cwiseMax(corners[1]).cwiseMax(corners[2].cwiseMax(corners[3]));
    // The corners of the pixel's bounds touch all areas that the pixel can touch if it is smaller than a module.
    const std::array<int, 4> touched =
        face.areas<4>({least.x(), most.x(), least.x(), most.x()}, {least.y(), least.y(), most.y(), most.y()});
    bool uniform = (most - least).maxCoeff() < face.module_mm;
    for (const int area : touched) {
      uniform = uniform && face.tone[area] == face.tone[touched[0]] && (area == kOutside) == (touched[0] == kOutside);
    }
    if (uniform) {
      cover_[i] = touched[0] == kOutside ? 0 : 1;
      tone_[i] = face.tone[touched[0]];
      continue;
    }
    // An edge crosses the pixel. Within it, the map from pixel to face is nearly bilinear.
    const Eigen::Vector2f along_x = corners[1] - corners[0], along_y = corners[2] - corners[0];
    const Eigen::Vector2f along_both = corners[3] - corners[2] - along_x;
    const auto seen_at = [&](int axis) -> PixelSamples::Values {
      return corners[0][axis] + samples.x * along_x[axis] + samples.y * along_y[axis] + samples.xy * along_both[axis];
    };
    int covered = 0;
    float tone = 0;
    for (const int area : face.areas<kSamples>(seen_at(0), seen_at(1))) {
      covered += area != kOutside;
      tone += face.tone[area];
    }
    cover_[i] = static_cast<float>(covered) / kSamples;
    tone_[i] = tone / kSamples;
  }
}

/// LEDs on one half of a ring around the lens, as paper that is neither dull nor a mirror reflects them: the more, the
/// nearer its normal comes to the middle between the directions to LED and lens.
void Renderer::add_reflection(const Eigen::Isometry3d& T_camera_marker, const Box& box, int y) {
  constexpr int kLeds = 6;
  constexpr float kRing_mm = 10, kRoughness = 0.03F;
  const Eigen::Isometry3f pose = T_camera_marker.cast<float>();
  const Eigen::Vector3f normal = pose.linear().col(2);
  std::size_t i = static_cast<std::size_t>(y - box.first_y) * static_cast<std::size_t>(box.width());
  for (int x = box.first_x; x < box.last_x; ++x, ++i) {
    if (cover_[i] == 0) continue;
    const Eigen::Vector3f point = pose * Eigen::Vector3f(upper_mm_[x].x(), upper_mm_[x].y(), 0);
    float reflected = 0;
    for (int led = 0; led < kLeds; ++led) {
      const float angle = std::numbers::pi_v<float> * (static_cast<float>(led) + 0.5F) / kLeds;
      const Eigen::Vector3f source(kRing_mm * std::cos(angle), kRing_mm * std::sin(angle), 0);
      const float along = normal.dot(((source - point).normalized() - point.normalized()).normalized());
      if (along <= 0) continue;
      reflected += std::exp(-(1 / (along * along) - 1) / (kRoughness * kRoughness));
    }
    tone_[i] += cover_[i] * static_cast<float>(quality_.gloss) * reflected / kLeds;
  }
}

/// Separable Gaussian; the layer's margin is empty (or the image's border, which repeats).
void Renderer::blur_layer(const Box& box, std::vector<float>& layer) {
  const int reach = static_cast<int>(blur_weights_.size()) - 1;
  if (reach == 0) return;
  const int width = box.width(), height = box.height();
  blurred_.resize(layer.size());
  for (int y = 0; y < height; ++y) {
    float* to = &blurred_[static_cast<std::size_t>(y) * width];
    const float* from = &layer[static_cast<std::size_t>(y) * width];
    for (int x = 0; x < width; ++x) to[x] = blur_weights_[0] * from[x];
    for (int k = 1; k <= reach; ++k) {
      for (int x = 0; x < width; ++x) {
        to[x] += blur_weights_[k] * (from[std::max(x - k, 0)] + from[std::min(x + k, width - 1)]);
      }
    }
  }
  for (int y = 0; y < height; ++y) {
    const auto row = [&](int at) { return &blurred_[static_cast<std::size_t>(std::clamp(at, 0, height - 1)) * width]; };
    float* to = &layer[static_cast<std::size_t>(y) * width];
    for (int x = 0; x < width; ++x) to[x] = blur_weights_[0] * row(y)[x];
    for (int k = 1; k <= reach; ++k) {
      const float *above = row(y - k), *below = row(y + k);
      for (int x = 0; x < width; ++x) to[x] += blur_weights_[k] * (above[x] + below[x]);
    }
  }
}

/// Grey level (0 ... 255) that stands for this light (0 ... 255).
float srgb_coded(float light) {
  const float linear = light / 255;
  return 255 * (linear <= 0.0031308F ? 12.92F * linear : 1.055F * std::pow(linear, 1 / 2.4F) - 0.055F);
}

/// Shot and read noise, then 8 bits. Every row takes its noise from a random place in a table of normal numbers:
/// drawing a million of them for every image would take longer than everything else.
void Renderer::quantise(std::vector<std::uint8_t>& grey) {
  grey.resize(image_.size());
  const float read_variance = static_cast<float>(quality_.read_noise * quality_.read_noise);
  const float shot_variance = static_cast<float>(quality_.shot_noise * quality_.shot_noise);
  const std::size_t width = static_cast<std::size_t>(lens_.width_px);
  for (std::size_t row = 0; row < image_.size(); row += width) {
    const float* noise = &noise_table_[noise_.index(kNoiseTable)];
    const float* image = &image_[row];
    std::uint8_t* to = &grey[row];
    for (std::size_t x = 0; x < width; ++x) {
      const float level = std::max(image[x], 0.0f);
      const float noisy = level + std::sqrt(read_variance + shot_variance * level) * noise[x];
      const float coded = quality_.srgb ? srgb_coded(std::clamp(noisy, 0.0F, 255.0F)) : noisy;
      to[x] = static_cast<std::uint8_t>(std::clamp(coded + 0.5f, 0.0f, 255.0f));
    }
  }
}

}  // namespace finsight::host
