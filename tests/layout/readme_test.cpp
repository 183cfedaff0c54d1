// The README's register tables are the code's.
#include <doctest/doctest.h>

#include <fstream>
#include <iterator>
#include <string>

#include "hostgen/plc/plc_files.h"

using namespace finsight::host;

TEST_CASE("readme: the register tables are those that the server uses") {
  std::ifstream in(FINSIGHT_SOURCE_DIR "/README.md");
  const std::string readme{std::istreambuf_iterator<char>(in), {}};
  for (const std::string& table : {measurements_markdown(), control_markdown()}) {
    CHECK(table.size() > 1000);
    CHECK_MESSAGE(readme.find(table) != std::string::npos, "put this between the markers of README.md:\n" << table);
  }
}
