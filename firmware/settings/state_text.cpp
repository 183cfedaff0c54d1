#include "firmware/settings/state_text.h"

#include <cstdio>

#include "firmware/model/model.h"

namespace finsight {

namespace {

void add_numbers(std::string& text, const PlateMotion& motion) {
  for (int i = 0; i < 6; ++i) {
    char number[32];
    const double value = static_cast<double>(i < 3 ? motion.displacement_mm[i] : motion.rotation_rad[i - 3]);
    std::snprintf(number, sizeof number, "%s%.9g", i ? ", " : "", value);
    text += number;
  }
}

}  // namespace

std::string state_text(const RuntimeSettings& settings, const std::optional<ZeroPose>& zero,
                       const std::optional<Vec3f>& zero_g, std::uint32_t model_checksum, const MeasuredMount& mount) {
  std::string text = "# Written by finsightd when a client saves; without this file the factory settings are used.\n";
  text.append("version = ").append(std::to_string(kStateVersion)).append("\n[settings]\n");
  for (int i = 0; i < kSettingCount; ++i) {
    const std::string value = std::to_string(settings.words[static_cast<std::size_t>(i)]);
    text.append(setting_row(i).name).append(" = ").append(value).append("\n");
  }
  text.append("[zero]\nset = ").append(zero ? "true" : "false").append("\n");
  if (!zero) return text;
  for (std::size_t p = 0; p < kPlates; ++p) {
    text.append(kPlateNames[p]).append(" = [");
    add_numbers(text, (*zero)[p]);
    text.append("]  # mm, rad\n");
  }
  if (zero_g) {
    char line[96];
    const Eigen::Vector3d g = zero_g->cast<double>();
    std::snprintf(line, sizeof line, "gravity_g = [%.9g, %.9g, %.9g]  # when it was measured\n", g.x(), g.y(), g.z());
    text += line;
  }
  text.append("model = \"").append(checksum_text(model_checksum));
  text.append("\"  # that it was measured with, and the mount\n");
  return text.append(measured_mount_toml(mount, "zero.mount."));
}

}  // namespace finsight
