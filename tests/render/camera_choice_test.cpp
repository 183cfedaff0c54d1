#include "hostgen/render/camera_choice.h"

#include <doctest/doctest.h>

#include <cmath>

#include "firmware/input_error.h"

using namespace finsight;
using namespace finsight::host;

namespace {

FingerSpec spec() { return read_finger_spec(FINSIGHT_SOURCE_DIR "/hostgen/fingers/srm.toml"); }

CameraChoice choice(double focal_mm = 2.2, double f_number = 4) {
  return {.sensor = known_sensors()[0], .binning = 1, .focal_mm = focal_mm, .f_number = f_number};
}

}  // namespace

TEST_CASE("camera choice: field of view and pixels per marker are those of a thin lens") {
  const CameraView view = camera_view(spec(), choice());
  const CameraChoice& made = view.choice;
  const double image_mm = made.focal_mm * made.focus_mm / (made.focus_mm - made.focal_mm);
  CHECK(view.lens.fx == doctest::Approx(image_mm / 0.003));
  CHECK(view.across_deg == doctest::Approx(2 * std::atan(1280 * 0.003 / 2 / image_mm) * 180 / std::numbers::pi));
  for (const MarkerView& marker : view.markers) {
    CHECK(marker.side_px * marker.distance_mm == doctest::Approx(8 * view.lens.fx));
  }
}

TEST_CASE("camera choice: nearest and furthest marker are equally sharp, and a smaller aperture makes both sharper") {
  const CameraView open = camera_view(spec(), choice(2.2, 2)), narrow = camera_view(spec(), choice(2.2, 8));
  CHECK(open.markers[kTopPlate].blur_px == doctest::Approx(open.markers[kLowPlate].blur_px));
  CHECK(open.markers[kTopPlate].blur_px == doctest::Approx(4 * narrow.markers[kTopPlate].blur_px));
  CHECK(open.sharp_from_mm > narrow.sharp_from_mm);
  CHECK(open.sharp_to_mm < narrow.sharp_to_mm);
}

TEST_CASE("camera choice: depth is known worse than place across, the top plate worse than the low one") {
  const CameraView view = camera_view(spec(), choice());
  for (const MarkerView& marker : view.markers) {
    CHECK(marker.lost == 0);
    CHECK(marker.corner_px > 0.002);
    CHECK(marker.corner_px < 0.3);
    CHECK(marker.depth_mm > marker.lateral_mm);
  }
  CHECK(view.markers[kTopPlate].depth_mm > view.markers[kLowPlate].depth_mm);
}

TEST_CASE(
    "camera choice: a lens that is too long loses markers from view, and one longer than the distance is refused") {
  const CameraView view = camera_view(spec(), choice(2.2));
  for (const MarkerView& marker : view.markers) CHECK(marker.in_view);
  CHECK(!camera_view(spec(), choice(8)).markers[kLowPlate].in_view);
  CHECK_THROWS_AS(camera_view(spec(), choice(90)), InputError);
}
