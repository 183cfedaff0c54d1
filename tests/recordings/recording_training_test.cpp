#include "hostgen/recordings/recording_training.h"

#include <doctest/doctest.h>

#include "firmware/input_error.h"
#include "tests/recordings/synthetic_recordings.h"

using namespace finsight;
using namespace finsight::host;

TEST_CASE("recording training: all networks learn a smooth finger, better where the point is known") {
  const auto scores =
      train_on_recordings(test::synthetic_recordings({}, 1), nullptr, {.steps = 1000, .hidden = {24, 24}});
  REQUIRE(scores.size() == 3);
  CHECK(scores[0].method == "paper");
  for (const RecordingScore& score : scores) {
    CAPTURE(score.method);
    CHECK(score.random.r2[1] > 0.5);  // near rest the plates do not determine the touch
    CHECK(score.random.rmse_mm[1] < score.by_point.rmse_mm[1]);
    CHECK(score.mean_mm > 0.2);  // the pen's own noise
  }
}

TEST_CASE("recording training: the plate's recent motion makes up for a noisy tilt") {
  const auto scores = train_on_recordings(test::synthetic_recordings({.rotation_noise_rad = 0.1}, 12), nullptr,
                                          {.steps = 1000, .hidden = {24, 24}});
  REQUIRE(scores[1].method == "direction");
  REQUIRE(scores[2].method == "history");
  CHECK(scores[2].random.rmse_mm[1] < 0.8 * scores[1].random.rmse_mm[1]);
  CHECK(scores[2].by_point.rmse_mm[1] < scores[1].by_point.rmse_mm[1]);
}

TEST_CASE("recording training: stops where contact points that are held out gain nothing more") {
  // Few points and much noise: long training learns them by heart.
  const auto scores = train_on_recordings(test::synthetic_recordings({.rotation_noise_rad = 0.1, .pen_noise_mm = 3}, 1),
                                          nullptr, {.steps = 6400, .hidden = {48, 48}});
  for (const RecordingScore& score : scores) {
    CAPTURE(score.method);
    CHECK(score.steps[0] >= 200);
    CHECK(score.steps[0] < 6400);
    CHECK(score.other_mean_mm == 0);
  }
}

TEST_CASE("recording training: another file is judged by networks that have seen all of the first") {
  const RecordedMotion own = test::synthetic_recordings({}, 1);
  RecordedMotion other = own;
  for (Vec3f& pen : other.pen_mm) pen += Vec3f(30, 0, 0);
  const RecordingTrainingPlan plan{.steps = 3200, .hidden = {24, 24}};
  const auto same = train_on_recordings(own, nullptr, plan, &own),
             moved = train_on_recordings(own, nullptr, plan, &other);
  for (std::size_t m = 0; m < same.size(); ++m) {
    CAPTURE(same[m].method);
    CHECK(same[m].other_mean_mm < same[m].mean_mm);  // its points are known
    CHECK(moved[m].other_mean_mm > 20);
    CHECK(moved[m].mean_mm == same[m].mean_mm);
  }
}

TEST_CASE("recording training: refuses too few contact points to split") {
  RecordedMotion motion = test::synthetic_recordings({}, 1);
  for (int& point : motion.surface_node) point %= 4;
  CHECK_THROWS_AS(train_on_recordings(motion, nullptr, {.steps = 1}), InputError);
}
