#include "hostgen/fit/weight_list.h"

#include <doctest/doctest.h>
#include <unistd.h>

#include "firmware/input_error.h"
#include "hostgen/util/common.h"
#include "hostgen/util/gravity.h"

using namespace finsight;
using namespace finsight::host;

namespace {

std::filesystem::path file_of(const std::string& text) {
  const auto file = std::filesystem::temp_directory_path() / ("weights" + std::to_string(getpid()) + ".csv");
  write_file_atomically(file, text);
  return file;
}

std::string refusal(const std::string& text) {
  try {
    read_weights(file_of(text), 9);
  } catch (const InputError& error) {
    return error.what();
  }
  return "";
}

}  // namespace

TEST_CASE("weight list: rows are found by the recording's folder") {
  const auto file = file_of("session,hole,mass_g\r\nlow,1,600\nmiddle,5,300.5\n\n");
  const std::vector<ListedWeight> weights = read_weights(file, 9);
  REQUIRE(weights.size() == 2);
  CHECK(listed(weights, "recordings/middle/", file).hole == 5);
  CHECK(weight_n(listed(weights, "recordings/middle", file).mass_g) == doctest::Approx(2.9469));
  CHECK_THROWS_WITH_AS(listed(weights, "recordings/top", file), doctest::Contains("\"top\""), InputError);
}

TEST_CASE("weight list: what is wrong is named with its line and column") {
  CHECK(refusal("hole,mass\n").find("csv:1: header") != std::string::npos);
  CHECK(refusal("session,hole,mass_g\na,10,300\n").find("csv:2: hole") != std::string::npos);
  CHECK(refusal("session,hole,mass_g\na,1,300g\n").find("csv:2: mass_g") != std::string::npos);
  CHECK(refusal("session,hole,mass_g\na,1,nan\n").find("mass_g") != std::string::npos);
  CHECK(refusal("session,hole,mass_g\na,1\n").find("2 cells") != std::string::npos);
  CHECK(refusal("session,hole,mass_g\na,1,300\na,2,300\n").find("each session once") != std::string::npos);
  CHECK(refusal("session,hole,mass_g\n").find("one per recording") != std::string::npos);
}
