#include "hostgen/calibrate/board_png.h"

#include <algorithm>
#include <cmath>

#include "hostgen/calibrate/grey_image.h"

namespace finsight::host {

std::string board_png(const CharucoBoard& board, double square_mm) {
  constexpr double kDotsPerMm = 600 / 25.4;
  const GreyImage modules = board.modules();
  const int scale =
      std::max(1, static_cast<int>(std::lround(kDotsPerMm * square_mm / CharucoBoard::kModulesPerSquare)));
  GreyImage large{modules.width_px * scale, modules.height_px * scale, {}};
  for (int y = 0; y < large.height_px; ++y) {
    for (int x = 0; x < large.width_px; ++x) large.grey.push_back(*modules.view().at(x / scale, y / scale));
  }
  return png_bytes(large,
                   static_cast<std::uint32_t>(std::lround(1000 * scale * CharucoBoard::kModulesPerSquare / square_mm)));
}

}  // namespace finsight::host
