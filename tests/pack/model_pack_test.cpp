#include "hostgen/pack/model_pack.h"

#include <doctest/doctest.h>

#include "firmware/input_error.h"
#include "hostgen/util/common.h"
#include "tests/model/scratch_folder.h"
#include "tests/model/tiny_model.h"

using namespace finsight;
using test::ScratchFolder;
using test::TinyModel;

TEST_CASE("model pack: the same parts give the same bytes") {
  const ScratchFolder folder;
  TinyModel().write(folder / "a");
  TinyModel().write(folder / "b");
  CHECK(host::read_file(folder / "a") == host::read_file(folder / "b"));
}

TEST_CASE("model pack: any change of a number, text or tensor changes the checksum") {
  const ScratchFolder folder;
  const auto checksum = [&](const TinyModel& tiny) {
    tiny.write(folder / "a");
    return Model::open(folder / "a").checksum;
  };
  TinyModel tensor_changed, number_changed, note_changed;
  tensor_changed.map_basis[5] += 1e-6f;
  number_changed.parts.touch.threshold_mm = 2.5f;
  note_changed.parts.notes = {{"score", "1"}};
  const std::set<std::uint32_t> different = {checksum(TinyModel()), checksum(tensor_changed), checksum(number_changed),
                                             checksum(note_changed)};
  CHECK(different.size() == 4);
}

TEST_CASE("model pack: a pack that the firmware would refuse is never written under its name") {
  const ScratchFolder folder;
  TinyModel().write(folder / "pack");
  const std::string before = host::read_file(folder / "pack");
  TinyModel bad;
  bad.parts.mount.marker_id = {3, 3, 4};
  CHECK_THROWS_WITH_AS(bad.write(folder / "pack"), doctest::Contains("mount.marker_id"), InputError);
  CHECK(host::read_file(folder / "pack") == before);
  CHECK(std::distance(std::filesystem::directory_iterator(folder.path()), {}) == 1);
}

TEST_CASE("model pack: a note cannot replace the pack's own metadata") {
  const ScratchFolder folder;
  TinyModel tiny;
  tiny.parts.notes = {{meta::kFinger, "another"}, {meta::kChecksum, "ffffffff"}, {"text", "\"checksum\":\"00000000\""}};
  tiny.write(folder / "pack");
  const Model model = Model::open(folder / "pack");
  CHECK(model.finger_name == "tiny");
  CHECK(model.file().metadata("text") == "\"checksum\":\"00000000\"");
}

TEST_CASE("model pack: without a contact map its description says so") {
  TinyModel tiny;
  tiny.has_contact_map = false;
  CHECK(host::describe_model_pack(tiny.open()).find("contact map none") != std::string::npos);
}

TEST_CASE("model pack: its description shows metadata, sizes, tensors, mount, thresholds and self-test") {
  const ScratchFolder folder;
  TinyModel tiny;
  tiny.parts.notes = {{"touch_rmse_mm", "0.25"}};
  tiny.write(folder / "pack");
  const std::string text = host::describe_model_pack(Model::open(folder / "pack"));
  CAPTURE(text);
  for (const char* part : {"finger \"tiny\", scene \"grasp\"",
                           "touch_rmse_mm                0.25",
                           "42 nodes (27 free, 21 on the touched face), 72",
                           "27 supernodes",
                           "shape map   rank 2",
                           "contact map rank 2",
                           "contact_map.basis",
                           "self_test.contact_shape_mm",
                           "23 -> 8 -> 8 -> 8 -> 8 -> 22, int8 weights between",
                           "1 g along x, y, z",
                           "markers 0.3 mm",
                           "touch from 2 to 40 mm",
                           "1000 per mille at 10 mm",
                           "marker 4, 8 mm",
                           "case 1",
                           "shape.rest_mm",
                           "42 x 3",
                           "504 bytes  -15 to 120",
                           "touch.weights1             I8   8 x 8",
                           "touch.first_weights        F32  8 x 23"}) {
    CAPTURE(part);
    CHECK(text.find(part) != std::string::npos);
  }
  CHECK(text.find("crc32.") == std::string::npos);  // one line per tensor is enough
}
