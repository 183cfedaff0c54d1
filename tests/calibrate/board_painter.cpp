#include "tests/calibrate/board_painter.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "tests/random.h"

namespace finsight::test {

Lens calibrated_camera() { return {640, 480, 490.7, 489.9, 303.6, 243.6, -0.3956, 0.2259, 0.0008, -0.0005, -0.0912}; }

BoardPainter::BoardPainter(const Lens& camera, const CharucoBoard& board) : camera_(camera), modules_(board.modules()) {
  for (int y = 0; y <= camera.height_px; ++y) {
    for (int x = 0; x <= camera.width_px; ++x) rays_.push_back(ray_from_pixel(camera, {x - 0.5, y - 0.5}));
  }
}

GreyImage BoardPainter::paint(const Eigen::Isometry3d& T_camera_board, std::uint64_t seed, double blur_px,
                              double noise) const {
  Eigen::Matrix3d ray_from_board = T_camera_board.linear();  // the board has no third coordinate
  ray_from_board.col(2) = T_camera_board.translation();
  const Eigen::Matrix3d board_from_ray = ray_from_board.inverse();
  std::vector<Eigen::Vector2d> at;  // in modules of the image of the board
  for (const Eigen::Vector2d& ray : rays_) {
    const Eigen::Vector3d place = board_from_ray * ray.homogeneous();
    const bool ahead = place.z() > 1e-6;  // false for NaN
    at.push_back(ahead ? Eigen::Vector2d(8 * place.head<2>() / place.z() + Eigen::Vector2d(4, 4))
                       : Eigen::Vector2d(-1e6, -1e6));
  }
  std::vector<double> grey;
  const std::size_t row = static_cast<std::size_t>(camera_.width_px) + 1;
  for (int y = 0; y < camera_.height_px; ++y) {
    for (int x = 0; x < camera_.width_px; ++x) {
      const Eigen::Vector2d* corner = &at[static_cast<std::size_t>(y) * row + static_cast<std::size_t>(x)];
      grey.push_back(mean_grey(corner[0], corner[1], corner[row], corner[row + 1]));
    }
  }
  return develop(std::move(grey), seed, blur_px, noise);
}

double BoardPainter::tone(const Eigen::Vector2d& at) const {
  const int x = static_cast<int>(std::floor(at.x())), y = static_cast<int>(std::floor(at.y()));
  if (x < 0 || y < 0 || x >= modules_.width_px || y >= modules_.height_px) return 90;
  return *modules_.view().at(x, y) ? 205 : 28;
}

double BoardPainter::mean_grey(const Eigen::Vector2d& a, const Eigen::Vector2d& b, const Eigen::Vector2d& c,
                               const Eigen::Vector2d& d) const {
  const auto cell = [](const Eigen::Vector2d& v) -> Eigen::Vector2i { return v.array().floor().cast<int>(); };
  if (cell(a) == cell(b) && cell(a) == cell(c) && cell(a) == cell(d)) return tone(a);
  constexpr int kSamples = 61, kGolden = 38;  // a lattice with every row and column taken once
  double sum = 0;
  for (int i = 0; i < kSamples; ++i) {
    const double u = (i + 0.5) / kSamples, v = (i * kGolden % kSamples + 0.5) / kSamples;
    sum += tone((1 - v) * ((1 - u) * a + u * b) + v * ((1 - u) * c + u * d));
  }
  return sum / kSamples;
}

GreyImage BoardPainter::develop(std::vector<double> grey, std::uint64_t seed, double blur_px, double noise) const {
  blur(grey, blur_px, true);
  blur(grey, blur_px, false);
  GreyImage image{camera_.width_px, camera_.height_px, {}};
  Random random(seed);
  for (const double value : grey) {
    // Nearly normal, and quick: the sum of three even ones.
    const double off = random.uniform() + random.uniform() + random.uniform() - 1.5;
    image.grey.push_back(static_cast<std::uint8_t>(std::lround(std::clamp(value + 2 * noise * off, 0.0, 255.0))));
  }
  return image;
}

void BoardPainter::blur(std::vector<double>& grey, double sigma_px, bool level) const {
  const int reach = static_cast<int>(std::ceil(3 * sigma_px)), width = camera_.width_px, height = camera_.height_px;
  std::vector<double> weights, from = grey;
  double sum = 0;
  for (int i = -reach; i <= reach; ++i) {
    weights.push_back(std::exp(-0.5 * i * i / (sigma_px * sigma_px)));
    sum += weights.back();
  }
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x) {
      double value = 0;
      for (int i = -reach; i <= reach; ++i) {
        const int u = level ? std::clamp(x + i, 0, width - 1) : x, v = level ? y : std::clamp(y + i, 0, height - 1);
        value += weights[static_cast<std::size_t>(i + reach)] * from[static_cast<std::size_t>(v * width + u)];
      }
      grey[static_cast<std::size_t>(y * width + x)] = value / sum;
    }
  }
}

Eigen::Isometry3d board_at(const Lens& camera, double across, double down, double lower_deg, double right_deg,
                           double depth, double roll_deg) {
  constexpr double kRad = std::numbers::pi / 180;
  Eigen::Isometry3d pose = Eigen::Isometry3d::Identity();
  pose.linear() = (Eigen::AngleAxisd(right_deg * kRad, Eigen::Vector3d::UnitY()) *
                   Eigen::AngleAxisd(-lower_deg * kRad, Eigen::Vector3d::UnitX()) *
                   Eigen::AngleAxisd(roll_deg * kRad, Eigen::Vector3d::UnitZ()))
                      .toRotationMatrix();
  const Eigen::Vector2d ray = ray_from_pixel(camera, {across * camera.width_px, down * camera.height_px});
  pose.translation() = depth * ray.homogeneous() - pose.linear() * Eigen::Vector3d(5, 3.5, 0);
  return pose;
}

std::vector<Eigen::Isometry3d> good_views(const Lens& camera) {
  std::vector<Eigen::Isometry3d> views;
  const double tilts[4][2] = {{25, 0}, {-25, 0}, {0, 25}, {0, -25}};
  for (int i = 0; i < 15; ++i) {
    const double across = 0.24 + 0.26 * (i % 3), down = 0.24 + 0.26 * (i / 3 % 3);
    views.push_back(board_at(camera, across, down, tilts[i % 4][0], tilts[i % 4][1], 10 + i % 5, 7.0 * (i % 4)));
  }
  return views;
}

}  // namespace finsight::test
