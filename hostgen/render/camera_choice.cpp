#include "hostgen/render/camera_choice.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

#include "firmware/input_error.h"
#include "firmware/vision/edge_corners.h"
#include "firmware/vision/plate_estimator.h"
#include "hostgen/finger/mount.h"
#include "hostgen/finger/plate_motion.h"
#include "hostgen/render/renderer.h"

namespace finsight::host {

namespace {

constexpr double kSharp_px = 2;
constexpr double kWavelength_um = 0.55;
constexpr double kLensBlur_um = 1.5, kColourBlur_px = 0.5;
constexpr double kElectronsPerSquare_um = 1000, kReadNoise_electrons = 5, kLit = 0.8;
constexpr int kImages = 12;
constexpr std::uint64_t kSeed = 5;
constexpr double kCoarse_px = 1.5;  // error of a detector's corners

using Corners = std::array<Eigen::Vector2d, 4>;

/// A point's image by defocus alone: its diameter on the sensor, in mm, for points that are infinitely far.
double defocus_mm(const CameraChoice& choice) {
  return choice.focal_mm / choice.f_number * choice.focal_mm / (choice.focus_mm - choice.focal_mm);
}

Lens pinhole(const CameraChoice& choice) {
  const double pixel_mm = choice.binning * choice.sensor.pixel_um / 1000;
  const double image_mm = choice.focal_mm * choice.focus_mm / (choice.focus_mm - choice.focal_mm);
  Lens lens;
  lens.width_px = choice.sensor.width_px / choice.binning;
  lens.height_px = choice.sensor.height_px / choice.binning;
  lens.fx = lens.fy = image_mm / pixel_mm;
  lens.cx = 0.5 * (lens.width_px - 1);
  lens.cy = 0.5 * (lens.height_px - 1);
  return lens;
}

ImageQuality quality_of(const CameraChoice& choice) {
  const double pixel_um = choice.binning * choice.sensor.pixel_um;
  const double electrons = kElectronsPerSquare_um * std::pow(pixel_um, 2);
  // A Gaussian like the middle of the diffraction disc; a disc's standard deviation is a quarter of its diameter.
  const double diffraction_px = 0.42 * kWavelength_um * choice.f_number / pixel_um;
  const double filters_px = choice.sensor.colour ? kColourBlur_px / choice.binning : 0;
  ImageQuality quality;
  quality.blur_px = std::hypot(diffraction_px, kLensBlur_um / pixel_um, filters_px);
  quality.defocus_px = 1000 * defocus_mm(choice) / pixel_um / 4;
  quality.focus_mm = choice.focus_mm;
  quality.white = kLit * 255;
  quality.read_noise = 255 * kReadNoise_electrons * choice.binning / electrons;
  quality.shot_noise = std::sqrt(255 / electrons);
  return quality;
}

Corners corners_of(const FingerSpec& spec, const Lens& lens, std::size_t plate, const PlateMotion& motion,
                   double size_mm) {
  const Eigen::Isometry3d pose = T_camera_marker(spec, plate, motion);
  Corners corners;
  for (std::size_t k = 0; k < 4; ++k) {
    const Eigen::Vector3d corner = pose * marker_corner(size_mm, k);
    corners[k] = pixel_from_ray(lens, corner.head<2>() / corner.z());
  }
  return corners;
}

/// The marker with its margin, at rest and at half and all of the working range, either way sideways.
bool stays_in_view(const FingerSpec& spec, const Lens& lens, std::size_t plate) {
  const WorkingRange& range = spec.plates[plate].range;
  for (const double part : {0.0, 0.5, 1.0}) {
    for (const double side : {-1.0, 1.0}) {
      PlateMotion motion;
      motion.displacement_mm =
          Eigen::Vector3d(side * part * range.sideways_mm, 0, part * range.inward_mm).cast<float>();
      for (const Eigen::Vector2d& corner : corners_of(spec, lens, plate, motion, spec.marker_size_mm * 4 / 3)) {
        if (!(corner.x() > 0 && corner.y() > 0 && corner.x() < lens.width_px - 1 && corner.y() < lens.height_px - 1)) {
          return false;
        }
      }
    }
  }
  return true;
}

/// RMS error along one axis and share of markers lost, in rendered pictures of the finger slightly moved.
void measure_corners(const FingerSpec& spec, CameraView& view) {
  Renderer renderer(spec, view.lens, quality_of(view.choice), kSeed);
  Random random(kSeed);
  std::array<double, kPlates> squares{};
  std::array<int, kPlates> found{};
  std::vector<std::uint8_t> grey;
  for (int n = 0; n < kImages; ++n) {
    std::array<PlateMotion, kPlates> motions;
    for (PlateMotion& motion : motions) {
      for (float& part : motion.displacement_mm) part = static_cast<float>(random.uniform(-0.5, 0.5));
      for (float& part : motion.rotation_rad) part = static_cast<float>(random.uniform(-0.05, 0.05));
    }
    renderer.render(motions, grey);
    for (std::size_t p = 0; p < kPlates; ++p) {
      const Corners truth = corners_of(spec, view.lens, p, motions[p], spec.marker_size_mm);
      std::array<Vec2f, 4> corners;
      for (std::size_t k = 0; k < 4; ++k) {
        const double angle = random.uniform(-std::numbers::pi, std::numbers::pi);
        corners[k] = (truth[k] + kCoarse_px * Eigen::Vector2d(std::cos(angle), std::sin(angle))).cast<float>();
      }
      if (!refine_corners({grey.data(), view.lens.width_px, view.lens.height_px, view.lens.width_px}, view.lens,
                          corners)) {
        continue;
      }
      ++found[p];
      for (std::size_t k = 0; k < 4; ++k) squares[p] += (corners[k].cast<double>() - truth[k]).squaredNorm() / 8;
    }
  }
  for (std::size_t p = 0; p < kPlates; ++p) {
    view.markers[p].lost = 1 - static_cast<double>(found[p]) / kImages;
    view.markers[p].corner_px = std::sqrt(squares[p] / found[p]);  // not a number if none was found
  }
}

/// What the corners' errors make of the plates'.
void measure_plates(const FingerSpec& spec, CameraView& view) {
  std::vector<float> mean(kPoseDims, 0), covariance(kPoseDims * kPoseDims, 0), noise(kPoseDims, 1);
  for (std::size_t i = 0; i < kPoseDims; ++i) covariance[i * (kPoseDims + 1)] = 1;  // asked for, but not used here
  const PlateEstimator estimator(mount_of(spec), {mean, covariance, noise}, view.lens.fx);
  for (std::size_t p = 0; p < kPlates; ++p) {
    MarkerView& marker = view.markers[p];
    PlateSight sight;
    sight.seen[p] = true;
    sight.corner_sigma_px = marker.corner_px;
    const Eigen::Isometry3d pose = T_camera_marker(spec, p, {});
    for (std::size_t k = 0; k < 4; ++k) {
      const Eigen::Vector3d corner = pose * marker_corner(spec.marker_size_mm, k);
      sight.rays[p][k] = corner.head<2>() / corner.z();
    }
    const Eigen::Matrix<double, 6, 6> found = estimator.covariance_of_corners(sight, p, PlateEstimator::Vector::Zero());
    const Eigen::Matrix3d R = spec.T_finger_camera.linear().transpose();
    const Eigen::Matrix3d place = R * found.topLeftCorner<3, 3>() * R.transpose();
    const Eigen::Matrix3d turn = R * found.bottomRightCorner<3, 3>() * R.transpose();
    marker.lateral_mm = std::sqrt((place(0, 0) + place(1, 1)) / 2);
    marker.depth_mm = std::sqrt(place(2, 2));
    marker.tilt_deg = std::sqrt((turn(0, 0) + turn(1, 1)) / 2) * 180 / std::numbers::pi;
  }
}

}  // namespace

const std::vector<Sensor>& known_sensors() {
  static const std::vector<Sensor> sensors = {
      {"OV9281", 1280, 800, 3.0, true, false},   {"OV7251", 640, 480, 3.0, true, false},
      {"OV2311", 1600, 1300, 3.0, true, false},  {"MT9V034", 752, 480, 6.0, true, false},
      {"AR0144", 1280, 800, 3.0, true, false},   {"AR0234", 1920, 1200, 3.0, true, false},
      {"IMX296", 1456, 1088, 3.45, true, false}, {"IMX219", 3280, 2464, 1.12, false, true},
      {"OV5647", 2592, 1944, 1.4, false, true},  {"IMX477", 4056, 3040, 1.55, false, true},
      {"IMX708", 4608, 2592, 1.4, false, true},  {"OV2710", 1920, 1080, 3.0, false, true},
  };
  return sensors;
}

CameraView camera_view(const FingerSpec& spec, CameraChoice choice) {
  CameraView view;
  double nearest_mm = std::numeric_limits<double>::infinity(), furthest_mm = 0;
  for (std::size_t p = 0; p < kPlates; ++p) {
    view.markers[p].distance_mm = T_camera_marker(spec, p, {}).translation().z();
    nearest_mm = std::min(nearest_mm, view.markers[p].distance_mm);
    furthest_mm = std::max(furthest_mm, view.markers[p].distance_mm);
  }
  if (choice.focus_mm == 0) choice.focus_mm = 2 / (1 / nearest_mm + 1 / furthest_mm);
  if (!(std::min(nearest_mm, choice.focus_mm) > choice.focal_mm)) {
    throw InputError("command line", "--lens", std::to_string(choice.focal_mm) + " mm",
                     "a focal length below the distance of the nearest marker and of the focus");
  }
  view.choice = choice;
  view.lens = pinhole(choice);
  check_lens(view.lens);
  const auto degrees = [&](int size_px) {
    return 2 * std::atan(size_px / (2 * view.lens.fx)) * 180 / std::numbers::pi;
  };
  view.across_deg = degrees(view.lens.width_px);
  view.up_deg = degrees(view.lens.height_px);
  const double defocus_px = 1000 * defocus_mm(choice) / (choice.binning * choice.sensor.pixel_um);
  view.sharp_from_mm = choice.focus_mm / (1 + kSharp_px / defocus_px);
  view.sharp_to_mm =
      defocus_px > kSharp_px ? choice.focus_mm / (1 - kSharp_px / defocus_px) : std::numeric_limits<double>::infinity();
  for (std::size_t p = 0; p < kPlates; ++p) {
    MarkerView& marker = view.markers[p];
    marker.side_px = spec.marker_size_mm * view.lens.fx / marker.distance_mm;
    marker.blur_px = defocus_px * std::abs(1 - choice.focus_mm / marker.distance_mm);
    marker.in_view = stays_in_view(spec, view.lens, p);
  }
  measure_corners(spec, view);
  measure_plates(spec, view);
  return view;
}

}  // namespace finsight::host
