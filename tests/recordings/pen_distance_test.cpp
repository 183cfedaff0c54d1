#include "hostgen/recordings/pen_distance.h"

#include <doctest/doctest.h>

#include "tests/model/tiny_model.h"
#include "tests/recordings/synthetic_recordings.h"

using namespace finsight;
using namespace finsight::host;

TEST_CASE("pen distance: a finger that does not move is as far from the pen as its rest shape") {
  const Model model = test::TinyModel().open();
  RecordedMotion motion;
  for (int row = 0; row < 40; ++row) {
    PlatePoses poses;
    poses.seen[kTopPlate] = true;
    poses.quality = Quality::kFresh;
    motion.poses.push_back(poses);
    const float* node = &model.shape.rest_mm[3 * std::size_t(model.shape.front_nodes[0])];
    motion.pen_mm.push_back(Vec3f(node[0], node[1], node[2] + 0.5f));
    motion.recording.push_back("a");
    motion.surface_node.push_back(3);
    motion.line.push_back(row + 2);
  }
  const PenDistance still = measure_pen_distance(motion, model, 10);
  CHECK(still.rows == 10);
  CHECK(still.rest_mean_mm == doctest::Approx(0.5));
  CHECK(still.mean_mm == doctest::Approx(0.5).epsilon(0.2));  // the prior gives the unseen plates a small motion
  CHECK(measure_pen_distance(motion, model, 1000).rows == 40);
}
