#include "firmware/device/finger.h"

#include <doctest/doctest.h>

#include "firmware/input_error.h"
#include "tests/model/scratch_folder.h"

using namespace finsight;

TEST_CASE("finger: a sensor is not opened without the mount, lens or fit that its settings could not read") {
  const test::ScratchFolder folder;
  Settings settings;
  settings.name = "left";
  settings.pack = folder / "none.safetensors";
  settings.unusable = InputError("mount.toml:2", "camera.turn_deg", "7", "3 numbers");
  CHECK_THROWS_WITH_AS(Sensor(settings, false), "mount.toml:2: camera.turn_deg: found 7, expected 3 numbers",
                       InputError);
}
