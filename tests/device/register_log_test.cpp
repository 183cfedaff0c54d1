#include "firmware/device/register_log.h"

#include <doctest/doctest.h>

#include <fstream>

#include "tests/count_allocations.h"
#include "tests/model/scratch_folder.h"

using namespace finsight;

namespace {

RegisterImage block(std::uint16_t heartbeat) {
  RegisterImage image;
  image.words[2] = heartbeat;
  image.words[kMeasurementRegisters - 1] = 65535;
  return image;
}

std::vector<std::string> lines_of(const std::filesystem::path& file) {
  std::ifstream in(file);
  std::vector<std::string> lines;
  for (std::string line; std::getline(in, line);) lines.push_back(line);
  return lines;
}

}  // namespace

TEST_CASE("register log: every block is a line below the names of the registers") {
  const test::ScratchFolder folder;
  RegisterLog log(folder / "log.csv");
  log.add(block(7));
  log.add(block(8));
  CHECK(log.write() == 0);
  const auto lines = lines_of(folder / "log.csv");
  REQUIRE(lines.size() == 3);
  CHECK(lines[0].starts_with("r0,r1,r2,"));
  CHECK(lines[0].ends_with(",r" + std::to_string(kMeasurementRegisters - 1)));
  CHECK(lines[1].starts_with("0,0,7,0,"));
  CHECK(lines[2].starts_with("0,0,8,0,"));
  CHECK(lines[2].ends_with(",65535"));
}

TEST_CASE("register log: adding does not allocate, and blocks without room are counted") {
  const test::ScratchFolder folder;
  RegisterLog log(folder / "log.csv", 1000);
  const long before = test::allocations;
  for (int i = 0; i < 1003; ++i) log.add(block(1));
  CHECK(test::allocations == before);
  CHECK(log.write() == 3);
  CHECK(lines_of(folder / "log.csv").size() == 1001);
}

TEST_CASE("register log: a file that cannot be written is refused before the first block") {
  const test::ScratchFolder folder;
  folder.write("file", "");
  CHECK_THROWS_AS(RegisterLog(folder / "file/log.csv"), std::exception);  // a file is not a folder
}

TEST_CASE("register log: without a file nothing is kept") {
  RegisterLog log("");
  log.add(block(1));
  CHECK(log.write() == 0);
}
