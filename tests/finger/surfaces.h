// Small closed surfaces, and files of them.
#pragma once

#include <cstring>
#include <fstream>
#include <functional>
#include <map>

#include "hostgen/finger/triangle_surface.h"

namespace finsight::test {

/// A box of 12 triangles, facing outward.
inline host::TriangleSurface box_surface(const Eigen::Vector3d& lowest_mm, const Eigen::Vector3d& highest_mm) {
  host::TriangleSurface box;
  for (int i = 0; i < 8; ++i) {
    box.point_mm.emplace_back((i & 1 ? highest_mm : lowest_mm).x(), (i & 2 ? highest_mm : lowest_mm).y(),
                              (i & 4 ? highest_mm : lowest_mm).z());
  }
  for (const auto& [a, b, c, d] :
       {std::array{0, 2, 3, 1}, {4, 5, 7, 6}, {0, 1, 5, 4}, {2, 6, 7, 3}, {0, 4, 6, 2}, {1, 3, 7, 5}}) {
    box.triangle.push_back({a, b, c});
    box.triangle.push_back({a, c, d});
  }
  return box;
}

/// The surface of the filled cells of a grid: cell (i, j, k) lies between lines i and i + 1 of x, and so on.
inline host::TriangleSurface cell_surface(const std::array<std::vector<double>, 3>& lines_mm,
                                          const std::function<bool(int, int, int)>& filled) {
  host::TriangleSurface surface;
  std::map<std::array<int, 3>, int> numbers;
  const auto is_filled = [&](const std::array<int, 3>& cell) {
    for (std::size_t axis = 0; axis < 3; ++axis) {
      if (cell[axis] < 0 || cell[axis] + 1 >= static_cast<int>(lines_mm[axis].size())) return false;
    }
    return filled(cell[0], cell[1], cell[2]);
  };
  const auto number = [&](const std::array<int, 3>& spot) {
    const auto [place, added] = numbers.try_emplace(spot, static_cast<int>(surface.point_mm.size()));
    const auto line = [&](std::size_t axis) { return lines_mm[axis][static_cast<std::size_t>(spot[axis])]; };
    if (added) surface.point_mm.emplace_back(line(0), line(1), line(2));
    return place->second;
  };
  const auto add_face = [&](const std::array<int, 3>& cell, std::size_t axis, int side) {
    std::array<int, 4> quad{};
    for (const auto& [place, u, v] : {std::array{0, 0, 0}, {1, 1, 0}, {2, 1, 1}, {3, 0, 1}}) {
      std::array<int, 3> spot = cell;
      spot[axis] += side;
      spot[(axis + 1) % 3] += u;
      spot[(axis + 2) % 3] += v;
      quad[static_cast<std::size_t>(side ? place : 3 - place)] = number(spot);
    }
    surface.triangle.push_back({quad[0], quad[1], quad[2]});
    surface.triangle.push_back({quad[0], quad[2], quad[3]});
  };
  for (int i = 0; i + 1 < static_cast<int>(lines_mm[0].size()); ++i) {
    for (int j = 0; j + 1 < static_cast<int>(lines_mm[1].size()); ++j) {
      for (int k = 0; k + 1 < static_cast<int>(lines_mm[2].size()); ++k) {
        if (!is_filled({i, j, k})) continue;
        for (std::size_t axis = 0; axis < 3; ++axis) {
          for (const int side : {0, 1}) {
            std::array<int, 3> beside = {i, j, k};
            beside[axis] += 2 * side - 1;
            if (!is_filled(beside)) add_face({i, j, k}, axis, side);
          }
        }
      }
    }
  }
  return surface;
}

/// Both, unconnected.
inline host::TriangleSurface both(host::TriangleSurface a, const host::TriangleSurface& b) {
  const int first = static_cast<int>(a.point_mm.size());
  a.point_mm.insert(a.point_mm.end(), b.point_mm.begin(), b.point_mm.end());
  for (const auto& [i, j, k] : b.triangle) a.triangle.push_back({first + i, first + j, first + k});
  return a;
}

inline host::TriangleSurface turned_inside_out(host::TriangleSurface surface) {
  for (auto& corner : surface.triangle) std::swap(corner[1], corner[2]);
  return surface;
}

inline double volume_mm3(const host::TriangleSurface& surface) {
  double volume = 0;
  for (std::size_t t = 0; t < surface.triangle.size(); ++t) {
    const auto [a, b, c] = surface.corners(t);
    volume += a.dot(b.cross(c)) / 6;
  }
  return volume;
}

inline void write_obj(const std::filesystem::path& file, const host::TriangleSurface& surface) {
  std::ofstream out(file);
  out.precision(17);
  for (const auto& at : surface.point_mm) out << "v " << at.x() << " " << at.y() << " " << at.z() << "\n";
  for (const auto& [a, b, c] : surface.triangle) out << "f " << a + 1 << " " << b + 1 << " " << c + 1 << "\n";
}

inline void write_ascii_ply(const std::filesystem::path& file, const host::TriangleSurface& surface) {
  std::ofstream out(file);
  out << "ply\nformat ascii 1.0\nelement vertex " << surface.point_mm.size()
      << "\nproperty float x\nproperty float y\nproperty float z\nelement face " << surface.triangle.size()
      << "\nproperty list uchar int vertex_indices\nend_header\n";
  for (const auto& at : surface.point_mm) out << at.x() << " " << at.y() << " " << at.z() << "\n";
  for (const auto& [a, b, c] : surface.triangle) out << "3 " << a << " " << b << " " << c << "\n";
}

inline void write_ascii_stl(const std::filesystem::path& file, const host::TriangleSurface& surface) {
  std::ofstream out(file);
  out.precision(9);
  out << "solid finger\n";
  for (std::size_t t = 0; t < surface.triangle.size(); ++t) {
    out << "facet normal 0 0 0\nouter loop\n";
    for (const auto& at : surface.corners(t)) out << "vertex " << at.x() << " " << at.y() << " " << at.z() << "\n";
    out << "endloop\nendfacet\n";
  }
  out << "endsolid finger\n";
}

inline void write_binary_stl(const std::filesystem::path& file, const host::TriangleSurface& surface) {
  std::string bytes(80, ' ');
  const auto add = [&](auto value) {
    char raw[sizeof value];
    std::memcpy(raw, &value, sizeof value);
    bytes.append(raw, sizeof value);
  };
  add(static_cast<std::uint32_t>(surface.triangle.size()));
  for (std::size_t t = 0; t < surface.triangle.size(); ++t) {
    for (int i = 0; i < 3; ++i) add(0.0F);
    for (const auto& at : surface.corners(t)) {
      for (int i = 0; i < 3; ++i) add(static_cast<float>(at[i]));
    }
    add(std::uint16_t{0});
  }
  std::ofstream(file, std::ios::binary) << bytes;
}

}  // namespace finsight::test
