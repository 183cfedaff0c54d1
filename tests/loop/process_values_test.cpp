#include "firmware/loop/process_values.h"

#include <doctest/doctest.h>

#include <cmath>
#include <limits>

#include "tests/count_allocations.h"

using namespace finsight;

namespace {

using Tare = ProcessValues::Tare;

constexpr std::int64_t kPeriod_ns = 16'666'667;

/// A finger with a force and a deformation, one frame every 60th of a second.
struct Finger {
  float force_n = 2, deformation_mm = 1.5F;
  Vec3f point_mm = Vec3f(1, 60, 2);
  Quality touch_quality = Quality::kFresh, quality = Quality::kFresh;
  ThresholdState limits;
  RuntimeSettings settings;
  ProcessValues process;
  std::int64_t now_ns = 1'000'000'000;

  const ProcessReadings& frame() {
    PlatePoses poses;
    poses.quality = quality;
    FingerShape shape;
    shape.front_rms_mm = deformation_mm;
    shape.quality = quality;
    Touch touch;
    touch.force_n = force_n;
    touch.point_mm = point_mm;
    touch.radius_68_mm = 1;
    touch.quality = touch_quality;
    process.update({.exposure_ns = now_ns += kPeriod_ns}, poses, shape, touch, limits, settings);
    return process.readings();
  }
  /// The frame that a tare is ordered for, and whether it was possible.
  bool tare(ProcessValues::Tare which) {
    process.order_tare(which);
    frame();
    return process.take_tare_outcome().value();
  }
  const ProcessReadings& frames(int count) {
    for (int i = 0; i < count; ++i) frame();
    return process.readings();
  }
};

}  // namespace

TEST_CASE("process values: without low-pass and tare they are the measurements, and their peaks follow them") {
  Finger finger;
  CHECK(finger.frame().net == ProcessReadings::Values{2, 1.5F, 1, 60, 2});
  finger.force_n = 5;
  finger.frame();
  finger.force_n = 3;
  const ProcessReadings& readings = finger.frame();
  CHECK(readings.net[kForceValue] == 3);
  CHECK(readings.peak[kForceValue] == 5);
  CHECK(readings.minimum[kForceValue] == 2);
  finger.process.reset_peaks();
  CHECK(finger.frame().peak[kForceValue] == 3);
}

TEST_CASE("process values: what is invalid or held never becomes a peak") {
  Finger finger;
  finger.frame();
  finger.force_n = 100;
  finger.touch_quality = Quality::kInvalid;
  CHECK(std::isnan(finger.frame().net[kForceValue]));
  CHECK(finger.process.readings().peak[kForceValue] == 2);
  CHECK(finger.process.readings().net[kDeformationValue] == 1.5F);
  finger.touch_quality = Quality::kHeld;
  CHECK(finger.frame().peak[kForceValue] == 2);
  finger.touch_quality = Quality::kFresh;
  finger.force_n = std::numeric_limits<float>::quiet_NaN();
  CHECK(finger.frame().peak[kForceValue] == 2);
  CHECK(std::isnan(finger.process.readings().net[kForceValue]));
}

TEST_CASE("process values: a tare counts from the value of the next frame and starts its peaks over") {
  Finger finger;
  finger.frame();
  finger.force_n = 2.25F;
  finger.process.order_tare(Tare::kForce);
  CHECK_FALSE(finger.process.take_tare_outcome());
  const ProcessReadings& readings = finger.frame();
  CHECK(finger.process.take_tare_outcome() == true);
  CHECK_FALSE(finger.process.take_tare_outcome());  // told once
  CHECK(readings.net[kForceValue] == 0);
  CHECK(readings.peak[kForceValue] == 0);
  finger.force_n = 2.75F;
  finger.frame();
  CHECK(readings.net[kForceValue] == 0.5F);
  CHECK(readings.peak[kForceValue] == 0.5F);
  CHECK(readings.minimum[kForceValue] == 0);
  CHECK(readings.force_tared);
  CHECK_FALSE(readings.deformation_tared);
  CHECK(readings.net[kDeformationValue] == 1.5F);
  CHECK(readings.peak[kDeformationValue] == 1.5F);
  finger.process.clear_tare();
  CHECK(finger.frame().net[kForceValue] == 2.75F);
  CHECK_FALSE(readings.force_tared);
}

TEST_CASE("process values: a tare is refused if its value is not fresh in the next frame, and then changes nothing") {
  Finger finger;
  finger.frame();  // fresh; what comes next counts
  for (const Quality quality : {Quality::kHeld, Quality::kInvalid}) {
    finger.touch_quality = quality;
    CHECK_FALSE(finger.tare(Tare::kForce));
    CHECK_FALSE(finger.tare(Tare::kTouch));
  }
  CHECK(finger.tare(Tare::kDeformation));
  finger.touch_quality = Quality::kFresh;
  CHECK(finger.frame().net == ProcessReadings::Values{2, 0, 1, 60, 2});
}

TEST_CASE("process values: a new zero resets tares, peaks and low-pass, and keeps the events") {
  Finger finger;
  finger.settings[kLowpass] = 1;  // 0.1 Hz
  finger.limits.contact = true;
  finger.frame();
  REQUIRE(finger.tare(Tare::kDeformation));
  finger.process.reset();
  finger.deformation_mm = 0.25F;
  const ProcessReadings& readings = finger.frame();
  CHECK(readings.net[kDeformationValue] == 0.25F);
  CHECK(readings.peak[kDeformationValue] == 0.25F);
  CHECK_FALSE(readings.deformation_tared);
  CHECK(readings.count[kContactMade] == 1);
}

TEST_CASE("process values: a steady change comes out of the low-pass as late as the delay says") {
  Finger finger;
  finger.settings[kLowpass] = 10;  // 1.0 Hz: 159.2 ms
  const float mm_per_ms = 0.01F;
  const ProcessReadings& readings = finger.process.readings();
  for (int i = 0; i < 300; ++i) {
    finger.deformation_mm = mm_per_ms * static_cast<float>(finger.now_ns + kPeriod_ns) * 1e-6F;
    finger.frame();
  }
  CHECK(readings.lowpass_delay_ms == doctest::Approx(159.155));
  const float late_ms = (finger.deformation_mm - readings.net[kDeformationValue]) / mm_per_ms;
  CHECK(late_ms == doctest::Approx(readings.lowpass_delay_ms).epsilon(0.001));
  finger.settings[kLowpass] = 0;
  CHECK(finger.frame().net[kDeformationValue] == finger.deformation_mm);
  CHECK(readings.lowpass_delay_ms == 0);
}

TEST_CASE("process values: contact and overload are latched and counted") {
  Finger finger;
  for (int grip = 0; grip < 3; ++grip) {
    finger.limits = {.contact = true, .gentle = true, .overload = grip == 1};
    finger.frames(3);
    finger.limits = {};
    finger.frames(3);
  }
  const ProcessReadings& readings = finger.process.readings();
  CHECK(readings.event[kContactMade]);
  CHECK(readings.count == std::array<std::uint16_t, kProcessEvents>{3, 3, 1, 0});
  finger.process.reset_events();
  finger.frame();
  CHECK_FALSE(readings.event[kContactMade]);
  CHECK(readings.count == std::array<std::uint16_t, kProcessEvents>{});
}

TEST_CASE("process values: a fault during a grip is neither contact lost nor made; what it hid is told after it") {
  Finger finger;
  finger.limits.contact = true;
  finger.frames(3);
  const auto gap = [&](bool contact_after) {
    finger.quality = finger.touch_quality = Quality::kInvalid;
    finger.limits.contact = false;  // not valid, so cleared
    finger.frames(20);
    finger.quality = finger.touch_quality = Quality::kFresh;
    finger.limits.contact = contact_after;
    return finger.frame().count;
  };
  CHECK(gap(true) == std::array<std::uint16_t, kProcessEvents>{1, 0, 0, 0});
  CHECK(gap(false) == std::array<std::uint16_t, kProcessEvents>{1, 1, 0, 0});
}

TEST_CASE("process values: an object that slips in a steady grip is a changed grip") {
  Finger finger;
  finger.limits.contact = true;
  finger.settings[kGripChange] = 30;  // 3 radii of 1 mm
  const ProcessReadings& readings = finger.frames(100);
  CHECK(readings.grip_steady);
  CHECK(readings.count[kGripChanged] == 0);
  finger.point_mm.y() += 4;
  finger.frames(100);
  CHECK(readings.count[kGripChanged] == 1);
  CHECK(readings.grip_steady);  // the new grip is the reference now
}

TEST_CASE("process values: never allocate") {
  Finger finger;
  finger.limits.contact = true;
  const long before = test::allocations;
  finger.frames(100);
  finger.tare(Tare::kForce);
  finger.process.reset();
  CHECK(test::allocations == before);
}
