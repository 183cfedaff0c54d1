// What is generated from the register table inside files that are otherwise written by hand.
#include <doctest/doctest.h>

#include <fstream>
#include <iterator>
#include <stdexcept>
#include <string>

#include "hostgen/plc/plc_files.h"

using namespace finsight::host;

namespace {

std::string stored(const std::string& file) {
  std::ifstream in(FINSIGHT_SOURCE_DIR "/" + file, std::ios::binary);
  return {std::istreambuf_iterator<char>(in), {}};
}

const char* const kHint = "run build/host/hostgen plc --tree .";

}  // namespace

TEST_CASE("register README: its tables are those of the code") {
  const std::string readme = stored("firmware/modbus/README.md");
  CHECK_MESSAGE(with_section(readme, "measurements", measurements_markdown()) == readme, kHint);
  CHECK_MESSAGE(with_section(readme, "control", control_markdown()) == readme, kHint);
  CHECK_MESSAGE(with_section(readme, "process", process_markdown()) == readme, kHint);
  CHECK_MESSAGE(with_section(readme, "history", history_markdown()) == readme, kHint);
  CHECK_MESSAGE(with_section(readme, "gathered", gathered_markdown()) == readme, kHint);
  CHECK_MESSAGE(with_section(readme, "diagnostics", diagnostics_markdown()) == readme, kHint);
}

TEST_CASE("guide for PLCs: its table of faults is that of the code") {
  const std::string guide = stored("hostgen/plc/README.md");
  CHECK_MESSAGE(with_section(guide, "faults", faults_markdown()) == guide, kHint);
}

TEST_CASE("finsightctl: its register table is that of the code") {
  const std::string program = stored("scripts/finsightctl");
  CHECK_MESSAGE(with_section(program, "register table", finsightctl_table()) == program, kHint);
}

TEST_CASE("generated section: what is between its two lines is replaced, and nothing else") {
  const std::string text = "a\n# BEGIN GENERATED x by y\nold\nold\n# END GENERATED x\nb\n";
  CHECK(with_section(text, "x", "new\n") == "a\n# BEGIN GENERATED x by y\nnew\n# END GENERATED x\nb\n");
  CHECK_THROWS_AS(with_section(text, "z", "new\n"), std::runtime_error);
  CHECK_THROWS_AS(with_section("# BEGIN GENERATED x\n", "x", "new\n"), std::runtime_error);
}
