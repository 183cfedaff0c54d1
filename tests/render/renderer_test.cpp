#include "hostgen/render/renderer.h"

#include <doctest/doctest.h>

#include <numbers>
#include <numeric>
#include <opencv2/calib3d.hpp>

#include "firmware/geometry/so3.h"
#include "firmware/vision/aruco_compat.h"
#include "firmware/vision/observer.h"

using namespace finsight;
using namespace finsight::host;

namespace {

using Plates = std::array<PlateMotion, kPlates>;
using Image = std::vector<std::uint8_t>;

FingerSpec default_spec() { return read_finger_spec(FINSIGHT_SOURCE_DIR "/hostgen/fingers/srm.toml"); }

/// An undegraded image on an even background.
ImageQuality clean() { return {.blur_px = 0, .read_noise = 0, .shot_noise = 0, .vignetting = 0, .light_gradient = 0}; }

Image rendered(const FingerSpec& spec, const Lens& camera, const ImageQuality& quality, const Plates& plates,
               std::uint64_t seed = 1) {
  Image grey;
  Renderer(spec, camera, quality, seed).render(plates, grey);
  return grey;
}

/// Where OpenCV sees points of a plate's face (u right, v up), when the plate has moved.
std::vector<cv::Point2d> seen_at(const FingerSpec& spec, const Lens& c, int plate, const PlateMotion& motion,
                                 const std::vector<Eigen::Vector2d>& points_mm) {
  const Eigen::Isometry3d& rest = spec.plates[plate].T_finger_marker;
  const Eigen::Matrix3d R = so3_exp(motion.rotation_rad.cast<double>());
  std::vector<cv::Point3d> in_camera;
  for (const Eigen::Vector2d& point : points_mm) {
    const Eigen::Vector3d from_middle = rest.linear() * Eigen::Vector3d(point.x(), point.y(), 0);
    const Eigen::Vector3d in_finger = R * from_middle + rest.translation() + motion.displacement_mm.cast<double>();
    const Eigen::Vector3d seen = spec.T_finger_camera.inverse() * in_finger;
    in_camera.emplace_back(seen.x(), seen.y(), seen.z());
  }
  std::vector<cv::Point2d> pixels;
  cv::projectPoints(in_camera, cv::Vec3d(), cv::Vec3d(), cv::Matx33d(c.fx, 0, c.cx, 0, c.fy, c.cy, 0, 0, 1),
                    std::vector<double>{c.k1, c.k2, c.p1, c.p2, c.k3}, pixels);
  return pixels;
}

/// Area and centroid of a polygon.
Eigen::Vector3d polygon_moments(const std::vector<cv::Point2d>& corners) {
  double twice_area = 0, x = 0, y = 0;
  for (std::size_t i = 0; i < corners.size(); ++i) {
    const cv::Point2d a = corners[i], b = corners[(i + 1) % corners.size()];
    const double cross = a.x * b.y - b.x * a.y;
    twice_area += cross;
    x += (a.x + b.x) * cross;
    y += (a.y + b.y) * cross;
  }
  return {std::abs(twice_area) / 2, x / (3 * twice_area), y / (3 * twice_area)};
}

/// Mean of a 3 x 3 patch.
double grey_at(const Image& grey, int width_px, const cv::Point2d& pixel) {
  double sum = 0;
  for (int dy = -1; dy <= 1; ++dy) {
    for (int dx = -1; dx <= 1; ++dx) {
      sum += grey[static_cast<std::size_t>(std::lround(pixel.y) + dy) * width_px + std::lround(pixel.x) + dx];
    }
  }
  return sum / 9;
}

Plates pushed() {
  Plates plates;
  plates[kTopPlate] = {Vec3f(2.0f, -1.5f, 9.0f), Vec3f(0.2f, 0.05f, -0.1f)};
  plates[kMiddlePlate] = {Vec3f(-1.0f, -0.5f, 4.0f), Vec3f(0.15f, 0.0f, 0.05f)};
  plates[kLowPlate] = {Vec3f(0.3f, 0.1f, 1.0f), Vec3f(0.05f, 0.02f, 0.0f)};
  return plates;
}

}  // namespace

TEST_CASE("renderer: every module of every marker has its grey where OpenCV projects it") {
  const FingerSpec spec = default_spec();
  for (const Lens& camera : spec.cameras) {
    ImageQuality usual = clean();
    usual.blur_px = 0.6;
    usual.read_noise = 1.5;
    usual.shot_noise = 0.15;
    Renderer sharp_renderer(spec, camera, clean(), 1), noisy_renderer(spec, camera, usual, 1);
    for (const Plates& plates : {Plates{}, pushed()}) {
      Image sharp, noisy;
      sharp_renderer.render(plates, sharp);
      noisy_renderer.render(plates, noisy);
      for (int plate = 0; plate < kPlates; ++plate) {
        const auto modules = marker_modules(spec.plates[plate].marker_id);
        const double module_mm = spec.marker_size_mm / 6;
        for (int row = -1; row <= 6; ++row) {
          for (int column = -1; column <= 6; ++column) {
            const bool border = row < 0 || row > 5 || column < 0 || column > 5;
            const double expected = border || modules[row * 6 + column] ? 205 : 28;
            const Eigen::Vector2d middle((column - 2.5) * module_mm, (2.5 - row) * module_mm);
            const cv::Point2d pixel = seen_at(spec, camera, plate, plates[plate], {middle})[0];
            CAPTURE(plate);
            CAPTURE(row);
            CAPTURE(column);
            CHECK(grey_at(sharp, camera.width_px, pixel) == doctest::Approx(expected).epsilon(0.001));
            CHECK(std::abs(grey_at(noisy, camera.width_px, pixel) - expected) < 9);
          }
        }
      }
    }
  }
}

TEST_CASE("renderer: a plate's area and centroid are those of its projected outline, wherever it moves") {
  FingerSpec spec = default_spec();
  const Lens& camera = spec.cameras[0];
  spec.plates[kMiddlePlate].across = {0, 1e-9};  // only the low plate is left: the nearest, far off the axis
  spec.plates[kTopPlate].across = {0, 1e-9};
  ImageQuality white_on_black = clean();
  white_on_black.white = white_on_black.black = white_on_black.plate = 200;
  white_on_black.background = 0;
  const double y_mm = spec.plates[kLowPlate].T_finger_marker.translation().y();
  const PlateSpec& plate = spec.plates[kLowPlate];
  const double half_width_mm = (plate.across[1] - plate.across[0]) / 2 * (spec.half_width.at(y_mm) - spec.side_wall_mm);
  const double depth_mm = spec.back_z.at(y_mm) - spec.back_wall_mm - spec.front_z.at(y_mm) - spec.front_wall_mm;
  const double half_height_mm = (plate.deep[1] - plate.deep[0]) / 2 * depth_mm;
  std::vector<Eigen::Vector2d> outline;
  const std::array<Eigen::Vector2d, 5> corners = {{{-1, -1}, {1, -1}, {1, 1}, {-1, 1}, {-1, -1}}};
  for (int edge = 0; edge < 4; ++edge) {
    for (int i = 0; i < 200; ++i) {
      const Eigen::Vector2d point = corners[edge] + i / 200.0 * (corners[edge + 1] - corners[edge]);
      outline.emplace_back(point.x() * half_width_mm, point.y() * half_height_mm);
    }
  }
  const std::vector<PlateMotion> motions = {{},
                                            {Vec3f(1, 0, 0), Vec3f::Zero()},
                                            {Vec3f(0, 0, 1), Vec3f::Zero()},
                                            {Vec3f(0, -1, 0), Vec3f::Zero()},
                                            {Vec3f(0.3f, 0, 0.2f), Vec3f(0.1f, 0.3f, -0.2f)}};
  for (const double blur_px : {0.0, 1.2}) {
    white_on_black.blur_px = blur_px;
    Renderer renderer(spec, camera, white_on_black, 1);
    for (const PlateMotion& motion : motions) {
      Plates plates;
      plates[kLowPlate] = motion;
      Image grey;
      renderer.render(plates, grey);
      Eigen::Vector3d found = Eigen::Vector3d::Zero();
      for (int y = 0, i = 0; y < camera.height_px; ++y) {
        for (int x = 0; x < camera.width_px; ++x, ++i) found += grey[i] / 200.0 * Eigen::Vector3d(1, x, y);
      }
      const Eigen::Vector3d expected = polygon_moments(seen_at(spec, camera, kLowPlate, motion, outline));
      CAPTURE(motion.displacement_mm.transpose());
      CHECK(found[0] == doctest::Approx(expected[0]).epsilon(0.0005));
      CHECK(std::abs(found[1] / found[0] - expected[1]) < 0.01);
      CHECK(std::abs(found[2] / found[0] - expected[2]) < 0.01);
    }
  }
}

TEST_CASE("renderer: the same seed gives the same bytes, another seed or the next image other noise") {
  const FingerSpec spec = default_spec();
  const Lens& camera = spec.cameras[1];
  Renderer one(spec, camera, {}, 7), same(spec, camera, {}, 7), other(spec, camera, {}, 8);
  Image first, first_again, second, second_again, different;
  one.render(pushed(), first);
  one.render(pushed(), second);
  same.render(pushed(), first_again);
  same.render(pushed(), second_again);
  other.render(pushed(), different);
  CHECK(first == first_again);
  CHECK(second == second_again);
  CHECK(first != second);
  CHECK(first != different);
}

TEST_CASE("renderer: noise has the stated size, mean zero, and no two pixels alike") {
  FingerSpec spec = default_spec();
  const Lens& camera = spec.cameras[1];
  ImageQuality quality = clean();
  quality.read_noise = 3;
  quality.shot_noise = 0.4;
  Renderer noisy(spec, camera, quality, 3);
  const Image truth = rendered(spec, camera, clean(), {}, 3);
  Image grey;
  noisy.render(std::array<PlateMotion, kPlates>{}, grey);
  double sum = 0, sum_sq = 0, neighbours = 0, expected_sq = 0;
  const auto error = [&](std::size_t i) { return static_cast<double>(grey[i]) - truth[i]; };
  for (std::size_t i = 0; i + 1 < grey.size(); ++i) {
    sum += error(i);
    sum_sq += error(i) * error(i);
    neighbours += error(i) * error(i + 1);
    expected_sq += 9 + 0.16 * truth[i] + 1.0 / 6;  // both images are rounded
  }
  const double count = static_cast<double>(grey.size());
  CHECK(std::abs(sum / count) < 0.05);
  CHECK(sum_sq == doctest::Approx(expected_sq).epsilon(0.01));
  CHECK(std::abs(neighbours / sum_sq) < 0.02);
}

TEST_CASE("renderer: the light falls off towards the corners and from right to left") {
  const FingerSpec spec = default_spec();
  const Lens& camera = spec.cameras[0];
  ImageQuality quality = clean();
  quality.vignetting = 0.35;
  quality.light_gradient = 0.25;
  const Image lit = rendered(spec, camera, quality, {}), even = rendered(spec, camera, clean(), {});
  const auto share = [&](int x, int y) {
    const cv::Point2d pixel(x, y);
    return grey_at(lit, camera.width_px, pixel) / grey_at(even, camera.width_px, pixel);
  };
  CHECK(share(640, 100) == doctest::Approx(1 - 0.35 * 260 * 260 / (640.0 * 640 + 360 * 360)).epsilon(0.03));
  CHECK(share(3, 360) == doctest::Approx((1 - 0.35 * 0.76) * 0.875).epsilon(0.03));
  CHECK(share(1276, 360) == doctest::Approx((1 - 0.35 * 0.76) * 1.125).epsilon(0.03));
  CHECK(share(3, 3) == doctest::Approx(0.65 * 0.875).epsilon(0.03));
}

TEST_CASE("renderer: the nearer plate covers the farther one, whichever comes first") {
  FingerSpec spec = default_spec();
  const Lens& camera = spec.cameras[0];
  Plates plates;
  // The middle of the top plate is brought onto the line of sight to the middle of the low one, behind it.
  const Eigen::Vector3d eye = spec.T_finger_camera.translation();
  const Eigen::Vector3d low = spec.plates[kLowPlate].T_finger_marker.translation();
  const Eigen::Vector3d top = spec.plates[kTopPlate].T_finger_marker.translation();
  plates[kTopPlate].displacement_mm = (eye + 1.3 * (low - eye) - top).cast<float>();
  const Image grey = rendered(spec, camera, clean(), plates);
  const double module_mm = spec.marker_size_mm / 6;
  const auto modules = marker_modules(spec.plates[kLowPlate].marker_id);
  for (int i = 0; i < 36; ++i) {
    const Eigen::Vector2d middle((i % 6 - 2.5) * module_mm, (2.5 - i / 6) * module_mm);
    const cv::Point2d pixel = seen_at(spec, camera, kLowPlate, {}, {middle})[0];
    CHECK(grey_at(grey, camera.width_px, pixel) == doctest::Approx(modules[i] ? 205 : 28).epsilon(0.001));
  }
}

TEST_CASE("renderer: plates that cannot be seen leave the background as it is") {
  const FingerSpec spec = default_spec();
  const Lens& camera = spec.cameras[1];
  const float half_turn = static_cast<float>(std::numbers::pi);
  const std::vector<PlateMotion> unseen = {{Vec3f(0, -300, 0), Vec3f::Zero()},        // behind the camera
                                           {Vec3f(0, 0, 0), Vec3f(half_turn, 0, 0)},  // from behind
                                           {Vec3f(3000, 0, 0), Vec3f::Zero()},        // far to one side
                                           {Vec3f(-80, 0, 0), Vec3f::Zero()}};        // just outside the image
  Plates away;
  away.fill(unseen[0]);
  Renderer renderer(spec, camera, clean(), 1);
  Image empty, grey;
  renderer.render(away, empty);
  const auto [darkest, brightest] = std::minmax_element(empty.begin(), empty.end());
  CHECK(*darkest > 40);
  CHECK(*brightest < 100);
  for (const PlateMotion& motion : unseen) {
    Plates plates = away;
    plates[kLowPlate] = motion;
    renderer.render(plates, grey);
    CHECK(grey == empty);
  }
  // A plate that passes through the camera must be drawn without a crash; what it looks like does not matter.
  for (float y = -70; y < -40; y += 0.5f) {
    Plates plates = away;
    plates[kLowPlate] = {Vec3f(12, y, 1), Vec3f(0.6f, 0.3f, 0.1f)};
    renderer.render(plates, grey);
    CHECK(grey.size() == empty.size());
  }
}

TEST_CASE("renderer: an exposure is the mean of its scenes") {
  const FingerSpec spec = default_spec();
  const Lens& camera = spec.cameras[1];
  Renderer::Scene first, second;
  second.plates[kTopPlate].displacement_mm = {3, 0, 1};
  const Image a = rendered(spec, camera, clean(), first.plates), b = rendered(spec, camera, clean(), second.plates);
  Image both;
  const std::array<Renderer::Scene, 2> scenes = {first, second};
  Renderer(spec, camera, clean(), 1).render(scenes, both);
  int largest = 0, changed = 0;
  for (std::size_t i = 0; i < both.size(); ++i) {
    largest = std::max(largest, std::abs(2 * both[i] - a[i] - b[i]));
    changed += a[i] != b[i];
  }
  CHECK(changed > 500);
  CHECK(largest <= 3);  // each of the three was rounded
}

TEST_CASE("renderer: a covered plate is not drawn, and a light that is off leaves darkness") {
  const FingerSpec spec = default_spec();
  Renderer::Scene scene;
  scene.covered = {true, true, true};
  Image grey;
  Renderer(spec, spec.cameras[1], clean(), 1).render({&scene, 1}, grey);
  CHECK(*std::max_element(grey.begin(), grey.end()) < 100);  // nothing but the finger's inside
  scene = {};
  scene.light = 0.03F;
  Renderer(spec, spec.cameras[1], clean(), 1).render({&scene, 1}, grey);
  CHECK(*std::max_element(grey.begin(), grey.end()) <= 7);
}

TEST_CASE("renderer: a plate out of focus has softer edges than one that is in focus") {
  const FingerSpec spec = default_spec();
  const auto steepest = [&](double focus_mm) {
    ImageQuality quality = clean();
    quality.defocus_px = 4;
    quality.focus_mm = focus_mm;
    Renderer::Scene scene;
    scene.covered = {true, true, false};
    Image grey;
    Renderer(spec, spec.cameras[1], quality, 1).render({&scene, 1}, grey);
    int most = 0;
    for (std::size_t i = 0; i + 1 < grey.size(); ++i) most = std::max(most, std::abs(int{grey[i + 1]} - int{grey[i]}));
    return most;
  };
  const double low_mm = (spec.T_finger_camera.inverse() * spec.plates[kLowPlate].T_finger_marker.translation()).z();
  CHECK(steepest(low_mm) > 2 * steepest(2 * low_mm));
}

TEST_CASE("renderer: a rolling shutter shows each row at its own time, and a still finger as any shutter does") {
  const FingerSpec spec = default_spec();
  const Lens& camera = spec.cameras[1];
  ImageQuality quality = clean();
  quality.readout_s = 0.016;
  constexpr float kSpeed_mm_s = 200;
  const auto moved = [](double after_s) {
    Renderer::Scene scene;
    for (PlateMotion& plate : scene.plates) plate.displacement_mm.x() = kSpeed_mm_s * static_cast<float>(after_s);
    return std::vector{scene};
  };
  Image still, rolling;
  Renderer(spec, camera, quality, 1).render_rolling([&](double) { return moved(0); }, still);
  CHECK(still == rendered(spec, camera, quality, Plates{}));
  Renderer(spec, camera, quality, 1).render_rolling(moved, rolling);
  for (const int row : {40, 160, 320, 440}) {
    CAPTURE(row);
    const int band = row / 8 * 8;
    const double after_s = quality.readout_s * ((band + 4.0) / camera.height_px - 0.5);
    const Image then = rendered(spec, camera, quality, moved(after_s)[0].plates);
    const auto at = [&](const Image& image) { return image.begin() + std::ptrdiff_t{row} * camera.width_px; };
    CHECK(std::equal(at(rolling), at(rolling) + camera.width_px, at(then)));
  }
  CHECK(rolling != still);
}

TEST_CASE("renderer: a print that is too small shows a smaller marker, a bent or tilted one another picture") {
  const FingerSpec spec = default_spec();
  const Lens& camera = spec.cameras[1];
  const Image right = rendered(spec, camera, clean(), Plates{});
  const auto dark = [](const Image& image) {
    return std::count_if(image.begin(), image.end(), [](int grey) { return grey < 50; });
  };
  ImageQuality small = clean();
  small.print_scale = 0.9;
  const double share =
      static_cast<double>(dark(rendered(spec, camera, small, Plates{}))) / static_cast<double>(dark(right));
  CHECK(share == doctest::Approx(0.81).epsilon(0.05));
  ImageQuality bent = clean(), tilted = clean();
  bent.print_bend_per_mm = 0.02;
  tilted.print_tilt_rad = 0.05;
  CHECK(rendered(spec, camera, bent, Plates{}) != right);
  CHECK(rendered(spec, camera, tilted, Plates{}) != right);
}

TEST_CASE("renderer: LEDs are reflected by glossy prints, and only there; clutter lies behind the plates") {
  const FingerSpec spec = default_spec();
  const Lens& camera = spec.cameras[1];
  const Image plain = rendered(spec, camera, clean(), Plates{});
  ImageQuality glossy = clean();
  glossy.gloss = 400;
  const Image glare = rendered(spec, camera, glossy, Plates{});
  int brighter = 0, darker = 0;
  for (std::size_t i = 0; i < plain.size(); ++i) {
    brighter += glare[i] > plain[i] + 20;
    darker += glare[i] < plain[i];
  }
  CHECK(brighter > 100);
  CHECK(darker == 0);
  ImageQuality cluttered = clean();
  cluttered.clutter = 24;
  const Image behind = rendered(spec, camera, cluttered, Plates{});
  CHECK(behind != plain);
  const Eigen::Vector3d middle = spec.T_finger_camera.inverse() * spec.plates[1].T_finger_marker.translation();
  const Eigen::Vector2d pixel = pixel_from_ray(camera, middle.head<2>() / middle.z());
  const auto at = static_cast<std::size_t>(std::lround(pixel.y()) * camera.width_px + std::lround(pixel.x()));
  CHECK(behind[at] == plain[at]);
}
