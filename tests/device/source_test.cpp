#include "firmware/device/source.h"

#include <doctest/doctest.h>

#include <vector>

#include "firmware/input_error.h"
#include "tests/model/scratch_folder.h"
#include "tests/model/tiny_model.h"

using namespace finsight;

namespace {

const Model& model() {
  static const Model the_model = test::TinyModel().open();
  return the_model;
}

SessionInfo session_info() {
  return {.lens = {32, 16, 30, 30, 16, 8},
          .frames_per_second = 60,
          .marker_dictionary = "DICT_4X4_50",
          .marker_id = model().mount.marker_id,
          .marker_size_mm = static_cast<double>(model().mount.marker_size_mm),
          .description = "one dark frame"};
}

/// Settings of a session that holds one frame.
Settings session_settings(const test::ScratchFolder& folder, const SessionInfo& info) {
  folder.write(kSessionInfo, session_info_toml(info));
  Y4mWriter frames(folder / kSessionFrames, 32, 16, 60);
  frames.write(std::vector<std::uint8_t>(32 * 16).data());
  frames.finish();
  Settings settings;
  settings.source = Settings::Source::kSession;
  settings.replay.path = folder / "";
  settings.replay.recorded_speed = false;
  return settings;
}

}  // namespace

TEST_CASE("source: a session is opened with what was read of session.toml once") {
  const test::ScratchFolder folder;
  const Settings settings = session_settings(folder, session_info());
  const auto images = source_images(settings, model());
  REQUIRE(images);
  CHECK(images->lens == session_info().lens);
  CHECK(images->description == "one dark frame");
  std::filesystem::remove(folder / kSessionInfo);  // a second read would fail
  const OpenSource source = open_source(settings, images);
  Frame frame;
  CHECK(std::get<std::unique_ptr<Camera>>(source)->next(frame, 0));
  CHECK(frame.width_px == 32);
}

TEST_CASE("source: a session of another finger's markers is refused") {
  const test::ScratchFolder folder;
  SessionInfo info = session_info();
  info.marker_size_mm *= 1.5;
  const Settings settings = session_settings(folder, info);
  CHECK_THROWS_WITH_AS(source_images(settings, model()), doctest::Contains("markers.size_mm"), InputError);
}

TEST_CASE("source: a session of a rolling shutter is refused at full speed, at which frames have no times") {
  const test::ScratchFolder folder;
  SessionInfo info = session_info();
  info.readout_ms = 12;
  Settings settings = session_settings(folder, info);
  CHECK_THROWS_WITH_AS(source_images(settings, model()), doctest::Contains("readout_ms: found 12"), InputError);
  settings.replay.recorded_speed = true;
  CHECK(source_images(settings, model())->readout_ms == 12);
}

TEST_CASE("source: a camera's images are described by its settings and the model, recorded poses have none") {
  Settings settings;
  settings.source = Settings::Source::kPoses;
  CHECK_FALSE(source_images(settings, model()));
  settings.source = Settings::Source::kCamera;
  settings.lens = session_info().lens;
  settings.camera.frames_per_second = 25;
  const auto images = source_images(settings, model());
  REQUIRE(images);
  CHECK(images->lens == settings.lens);
  CHECK(images->frames_per_second == 25);
  CHECK(images->marker_id == model().mount.marker_id);
}

TEST_CASE("source: rest and gravity are known where the board file or the session say so, and of recorded motions") {
  Settings settings;
  settings.source = Settings::Source::kCamera;
  SessionInfo images = session_info();
  LoopSettings loop;
  complete_from_source(settings, images, loop);
  CHECK_FALSE(loop.rest_is_known);
  CHECK_FALSE(loop.fixed_g);
  CHECK(loop.readout_ms == 0);
  images.readout_ms = 15;
  LoopSettings mounted;
  mounted.mount = MountModel();  // takes a misprint or a reflection for a place: only a zero makes the rest known
  complete_from_source(settings, images, mounted);
  CHECK_FALSE(mounted.rest_is_known);
  CHECK(mounted.readout_ms == 15);
  settings.gravity_max_age_ms = 500;  // a client tells it
  complete_from_source(settings, images, loop);
  CHECK_FALSE(loop.fixed_g);

  settings.gravity_max_age_ms = 0;
  settings.source = Settings::Source::kSession;
  images.gravity_g = Vec3f(0, -1, 0);
  images.from_rest = true;
  complete_from_source(settings, images, loop);
  CHECK(loop.rest_is_known);
  CHECK(loop.fixed_g == Vec3f(0, -1, 0));
  settings.fixed_g = Vec3f(0, 0, 1);  // the board file knows better
  complete_from_source(settings, images, loop);
  CHECK(loop.fixed_g == Vec3f(0, 0, 1));

  settings = {};
  settings.source = Settings::Source::kPoses;
  complete_from_source(settings, std::nullopt, loop);
  CHECK(loop.rest_is_known);
  CHECK(loop.fixed_g == Vec3f(0, 0, 0));
}
