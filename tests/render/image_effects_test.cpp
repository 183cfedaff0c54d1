#include "hostgen/render/image_effects.h"

#include <doctest/doctest.h>

#include <algorithm>
#include <cmath>
#include <stdexcept>

using namespace finsight;
using namespace finsight::host;

namespace {

constexpr int kWidth = 64, kHeight = 48;

std::vector<std::uint8_t> texture() {
  std::vector<std::uint8_t> grey;
  for (int y = 0; y < kHeight; ++y) {
    for (int x = 0; x < kWidth; ++x)
      grey.push_back(static_cast<std::uint8_t>(128 + 60 * std::sin(0.3 * x) * std::cos(0.2 * y)));
  }
  return grey;
}

int largest_difference(const std::vector<std::uint8_t>& a, const std::vector<std::uint8_t>& b) {
  int largest = 0;
  for (std::size_t i = 0; i < a.size(); ++i) largest = std::max(largest, std::abs(int{a[i]} - int{b[i]}));
  return largest;
}

}  // namespace

TEST_CASE("image effects: JPEG's rounding changes little at quality 100, more the lower it is, and keeps even areas") {
  const auto original = texture();
  int last = 0;
  for (const int quality : {100, 90, 50, 5}) {
    CAPTURE(quality);
    auto grey = original;
    through_jpeg(grey, kWidth, kHeight, quality);
    const int difference = largest_difference(grey, original);
    CHECK(difference >= last);
    last = difference;
    if (quality == 100) CHECK(difference <= 2);
  }
  CHECK(last > 10);
  std::vector<std::uint8_t> even(kWidth * kHeight, 136);  // 8 above the middle: a whole step of the mean at quality 50
  through_jpeg(even, kWidth, kHeight, 50);
  CHECK(std::all_of(even.begin(), even.end(), [](int level) { return level == 136; }));
}

TEST_CASE("image effects: a clean film is empty; reflections only add light, dirt and bars only take it") {
  Random random(1);
  CHECK(ImageFilm(ImageQuality{}, kWidth, kHeight, random).glare.empty());
  CHECK(ImageFilm(ImageQuality{}, kWidth, kHeight, random).transmission.empty());
  const ImageFilm film(image_preset("worst"), 640, 480, random);
  REQUIRE(film.glare.size() == 640 * 480);
  REQUIRE(film.transmission.size() == 640 * 480);
  const auto [least_glare, most_glare] = std::minmax_element(film.glare.begin(), film.glare.end());
  CHECK(*least_glare >= 0);
  CHECK(*most_glare > 40);
  const auto [least, most] = std::minmax_element(film.transmission.begin(), film.transmission.end());
  CHECK(*least > 0);
  CHECK(*least < 0.2F);
  CHECK(*most == 1);
}

TEST_CASE("image presets: lab, factory and worst are each worse than the one before, and other names are refused") {
  double noise = 0;
  for (const std::string name : {"lab", "factory", "worst"}) {
    CAPTURE(name);
    CHECK(image_preset(name).read_noise > noise);
    noise = image_preset(name).read_noise;
  }
  CHECK_THROWS_AS(image_preset("studio"), std::invalid_argument);
}
