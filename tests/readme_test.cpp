// The README's register table is the code's.
#include <doctest/doctest.h>

#include <fstream>
#include <iterator>
#include <string>

#include "firmware/modbus/registers.h"

TEST_CASE("readme: the register table is the one that the server uses") {
  std::ifstream in(FINSIGHT_SOURCE_DIR "/README.md");
  const std::string readme{std::istreambuf_iterator<char>(in), {}};
  const std::string table = finsight::register_table_markdown();
  CHECK(table.size() > 1000);
  CHECK_MESSAGE(readme.find(table) != std::string::npos, "put this between the markers of README.md:\n" << table);
}
