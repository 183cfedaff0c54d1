#include "hostgen/fem/dataset.h"

#include <doctest/doctest.h>

#include <filesystem>
#include <fstream>

#include "firmware/input_error.h"
#include "tests/fem/box_mesh.h"

using namespace finsight;
using namespace finsight::host;

namespace {

FemDataset small_dataset() {
  return make_dataset(test::small_finger_spec(), test::small_finger_mesh(), {.points = 4, .forces = 3});
}

bool same(const FemDataset& a, const FemDataset& b) {
  if (a.states.size() != b.states.size() || a.node_displacement_mm != b.node_displacement_mm) return false;
  for (std::size_t i = 0; i < a.states.size(); ++i) {
    const FemState &x = a.states[i], &y = b.states[i];
    if (x.path != y.path || x.front_node != y.front_node || x.force_n != y.force_n || x.point_mm != y.point_mm ||
        x.contact_mm != y.contact_mm || x.valid != y.valid) {
      return false;
    }
    for (std::size_t p = 0; p < kPlates; ++p) {
      if (x.plates[p].displacement_mm != y.plates[p].displacement_mm ||
          x.plates[p].rotation_rad != y.plates[p].rotation_rad) {
        return false;
      }
    }
  }
  return a.spec_sha256 == b.spec_sha256 && a.mesh_nodes == b.mesh_nodes;
}

}  // namespace

TEST_CASE("dataset: states come path by path from the lowest force up, and again the same") {
  const FemDataset dataset = small_dataset();
  REQUIRE(dataset.states.size() == 12);
  CHECK(dataset.node_displacement_mm.size() == 12 * 3 * dataset.mesh_nodes);
  for (std::size_t i = 0; i < dataset.states.size(); ++i) {
    CHECK(dataset.states[i].path == static_cast<int>(i / 3));
    CHECK(dataset.states[i].force_n == doctest::Approx(0.1 + 0.15 * static_cast<double>(i % 3)));
  }
  CHECK(same(dataset, small_dataset()));
}

TEST_CASE("dataset: what is written is read back") {
  const auto file = std::filesystem::temp_directory_path() / "finsight_dataset_test.safetensors";
  const FemDataset dataset = small_dataset();
  write_dataset(file, dataset);
  CHECK(same(read_dataset(file), dataset));
  std::filesystem::resize_file(file, std::filesystem::file_size(file) - 4);
  CHECK_THROWS_AS(read_dataset(file), InputError);
  std::filesystem::remove(file);
}

TEST_CASE("dataset: a push beyond the limit is marked, with all that follow on its path") {
  FingerSpec spec = test::small_finger_spec();
  spec.force_n = {0.2, 60};
  spec.touch_y_mm = {45, 55};
  const FemDataset dataset = make_dataset(spec, test::small_finger_mesh(), {.points = 2, .forces = 4});
  REQUIRE(dataset.states.size() == 8);
  CHECK(dataset.states[0].valid);
  CHECK_FALSE(dataset.states[3].valid);
  CHECK_FALSE(dataset.states[7].valid);
}
