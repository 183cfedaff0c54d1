// `hostgen inspect`: a pack as text.
#include <algorithm>
#include <cmath>
#include <cstdarg>
#include <cstdio>
#include <numbers>

#include "hostgen/pack/model_pack.h"

namespace finsight::host {

namespace {

/// printf to the end of a string.
__attribute__((format(printf, 2, 3))) void print(std::string& text, const char* format, ...) {
  char line[512];
  std::va_list arguments;
  va_start(arguments, format);
  std::vsnprintf(line, sizeof line, format, arguments);
  va_end(arguments);
  text += line;
}

void describe_notes(std::string& text, const SafetensorsFile& file) {
  for (const auto& [key, value] : file.all_metadata()) {
    if (!key.starts_with(meta::kTensorCrc)) print(text, "  %-28s %s\n", key.c_str(), value.c_str());
  }
}

template <class T>
std::string value_range(std::span<const std::byte> bytes) {
  const std::span values(reinterpret_cast<const T*>(bytes.data()), bytes.size() / sizeof(T));
  if (values.empty()) return "empty";
  const auto [lowest, highest] = std::minmax_element(values.begin(), values.end());
  std::string text;
  print(text, "%.6g to %.6g", static_cast<double>(*lowest), static_cast<double>(*highest));
  return text;
}

std::string value_range(const SafetensorsFile& file, const std::string& name) {
  switch (file.dtype(name)) {
    case DType::kF32:
      return value_range<float>(file.raw(name));
    case DType::kF64:
      return value_range<double>(file.raw(name));
    case DType::kI8:
      return value_range<std::int8_t>(file.raw(name));
    case DType::kU8:
      return value_range<std::uint8_t>(file.raw(name));
    case DType::kU16:
      return value_range<std::uint16_t>(file.raw(name));
    case DType::kI32:
      return value_range<std::int32_t>(file.raw(name));
    case DType::kI64:
      return value_range<std::int64_t>(file.raw(name));
  }
  return "";
}

void describe_tensors(std::string& text, const SafetensorsFile& file) {
  for (const std::string& name : file.names()) {
    std::string shape;
    for (const std::int64_t length : file.shape(name)) shape += (shape.empty() ? "" : " x ") + std::to_string(length);
    print(text, "  %-26s %-4s %-14s %8zu bytes  %s\n", name.c_str(), dtype_name(file.dtype(name)), shape.c_str(),
          file.raw(name).size(), value_range(file, name).c_str());
  }
}

void describe_shape(std::string& text, const Model& model) {
  const ShapeModel& shape = model.shape;
  const CholeskyPlan& plan = shape.cholesky;
  std::int64_t factor_blocks = 0;
  for (std::size_t s = 0; s + 1 < plan.supernode_start.size(); ++s) {
    const std::int64_t columns = plan.supernode_start[s + 1] - plan.supernode_start[s];
    factor_blocks += columns * (columns + 1) / 2 + columns * (plan.rows_start[s + 1] - plan.rows_start[s]);
  }
  print(text, "  mesh        %d nodes (%d free, %zu on the touched face), %d tetrahedra\n", shape.nodes, plan.blocks,
        shape.front_nodes.size(), shape.tets);
  print(text, "  factor      %zu supernodes, %zu blocks in the matrix, %lld in its factor (3x3 each)\n",
        plan.supernode_start.size() - 1, plan.pattern_row.size(), static_cast<long long>(factor_blocks));
  print(text, "  shape map   rank %d, %d features\n", model.shape_map.rank, ShapeMapModel::kFeatures);
  if (model.contact_map) {
    print(text, "  contact map rank %d, %d features\n", model.contact_map.rank, ShapeMapModel::kFeatures);
  } else {
    text += "  contact map none: made by an older hostgen; tier \"contact\" needs one\n";
  }
}

void describe_touch(std::string& text, const Model& model) {
  print(text, "  network     %d -> %d", model.touch.first.inputs, model.touch.first.outputs);
  for (const DenseInt8& layer : model.touch.middle) print(text, " -> %d", layer.outputs);
  print(text, " -> %d", model.touch.last.outputs);
  print(text,
        ", int8 weights between\n  thresholds  touch from %.3g to %.3g mm of plate motion, 1000 per mille at %.3g mm\n",
        static_cast<double>(model.touch.threshold_mm), static_cast<double>(model.touch.range_mm),
        static_cast<double>(model.rated_deformation_mm));
}

void describe_tolerance(std::string& text, const TouchModel& touch) {
  constexpr double kDegreesPerRadian = 180 / std::numbers::pi;
  Eigen::Vector3d top_mm;  // displacement for 1 g along each axis
  for (int axis = 0; axis < 3; ++axis) {
    const auto at = [&](std::size_t i) {
      return static_cast<double>(touch.per_g[3 * i + static_cast<std::size_t>(axis)]);
    };
    top_mm[axis] = std::hypot(at(0), at(1), at(2));
  }
  print(text, "  gravity     1 g along x, y, z moves the top plate by %.2f, %.2f, %.2f mm\n", top_mm.x(), top_mm.y(),
        top_mm.z());
  print(text,
        "  tolerances  stiffness %.3g %%, markers %.3g mm and %.3g deg (standard deviations); each mm of motion counts "
        "as %.3g times the noise\n",
        100 * static_cast<double>(touch.stiffness_tolerance), static_cast<double>(touch.marker_tolerance_mm),
        kDegreesPerRadian * static_cast<double>(touch.marker_tolerance_rad), static_cast<double>(touch.noise_per_mm));
}

void describe_pose(std::string& text, const char* name, const Eigen::Isometry3f& T) {
  const Vec3f at = T.translation(), x = T.linear().col(0), z = T.linear().col(2);
  print(text, "  %-11s at %7.2f %7.2f %7.2f mm, x %6.3f %6.3f %6.3f, z %6.3f %6.3f %6.3f", name,
        static_cast<double>(at.x()), static_cast<double>(at.y()), static_cast<double>(at.z()),
        static_cast<double>(x.x()), static_cast<double>(x.y()), static_cast<double>(x.z()), static_cast<double>(z.x()),
        static_cast<double>(z.y()), static_cast<double>(z.z()));
}

void describe_mount(std::string& text, const MountModel& mount) {
  constexpr const char* kNames[kPlates] = {"top", "middle", "low"};
  describe_pose(text, "camera", mount.T_finger_camera);
  text += '\n';
  for (std::size_t p = 0; p < kPlates; ++p) {
    describe_pose(text, kNames[p], mount.T_finger_marker[p]);
    print(text, ", marker %d, %.3g mm\n", mount.marker_id[p], static_cast<double>(mount.marker_size_mm));
  }
}

void describe_self_test(std::string& text, const Model& model) {
  for (int c = 0; c < model.self_test.cases; ++c) {
    float motion_mm = 0;
    for (int p = 0; p < kPlates; ++p) {
      motion_mm =
          std::max(motion_mm, Eigen::Map<const Vec3f>(model.self_test.poses.data() + kPoseDims * c + 6 * p).norm());
    }
    const float* touch = model.self_test.touch.data() + 7 * c;
    print(text, "  case %-3d    plates move up to %5.2f mm -> touch at %6.2f %6.2f %6.2f mm, %5.2f N\n", c,
          static_cast<double>(motion_mm), static_cast<double>(touch[0]), static_cast<double>(touch[1]),
          static_cast<double>(touch[2]), static_cast<double>(touch[6]));
  }
}

}  // namespace

std::string describe_model_pack(const Model& model) {
  const SafetensorsFile& file = model.file();
  std::string text;
  print(text, "%s: finger \"%s\", scene \"%s\", %zu bytes, checksum %s, all checks passed\n", file.path().c_str(),
        model.finger_name.c_str(), model.scene.c_str(), file.bytes().size(), checksum_text(model.checksum).c_str());
  text += "\nmetadata\n";
  describe_notes(text, file);
  text += "\nmodel\n";
  describe_shape(text, model);
  describe_touch(text, model);
  describe_tolerance(text, model.touch);
  text += "\nmount (finger frame)\n";
  describe_mount(text, model.mount);
  text += "\nself-test\n";
  describe_self_test(text, model);
  text += "\ntensors\n";
  describe_tensors(text, file);
  return text;
}

}  // namespace finsight::host
