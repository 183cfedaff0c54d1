#include "hostgen/pack/tensor_file.h"

#include <doctest/doctest.h>

#include <cstring>

#include "hostgen/util/common.h"
#include "tests/model/scratch_folder.h"

using namespace finsight;
using host::TensorFile;

namespace {

TensorFile example() {
  TensorFile file;
  file.metadata = {{"b", "a \"quoted\" text"}, {"a", "1"}};
  file.add<std::uint8_t>("bytes", {3}, std::vector<std::uint8_t>{1, 2, 3});
  file.add<double>("doubles", {1, 2}, std::vector<double>{0.5, -2});
  file.add<std::uint16_t>("words", {1}, std::vector<std::uint16_t>{0x1234});
  file.add<float>("floats", {}, std::vector<float>{1.5f});
  file.add<std::int64_t>("empty", {0, 7}, std::vector<std::int64_t>{});
  return file;
}

}  // namespace

TEST_CASE("tensor file: writes exactly the bytes of the format") {
  const std::string header = R"({"__metadata__":{"a":"1","b":"a \"quoted\" text"},)"
                             R"("doubles":{"dtype":"F64","shape":[1,2],"data_offsets":[0,16]},)"
                             R"("empty":{"dtype":"I64","shape":[0,7],"data_offsets":[16,16]},)"
                             R"("floats":{"dtype":"F32","shape":[],"data_offsets":[16,20]},)"
                             R"("words":{"dtype":"U16","shape":[1],"data_offsets":[20,22]},)"
                             R"("bytes":{"dtype":"U8","shape":[3],"data_offsets":[22,25]}})";
  const std::string bytes = example().bytes();
  std::uint64_t length = 0;
  std::memcpy(&length, bytes.data(), 8);
  CHECK(length % 8 == 0);
  REQUIRE(length >= header.size());
  CHECK(length < header.size() + 8);
  CHECK(bytes.substr(8, header.size()) == header);
  CHECK(bytes.substr(8 + header.size(), length - header.size()) == std::string(length - header.size(), ' '));
  const unsigned char data[] = {0, 0, 0,    0, 0, 0,    0xe0, 0x3f, 0,    0, 0, 0, 0,
                                0, 0, 0xc0, 0, 0, 0xc0, 0x3f, 0x34, 0x12, 1, 2, 3};
  CHECK(bytes.substr(8 + length) == std::string(reinterpret_cast<const char*>(data), sizeof data));
}

TEST_CASE("tensor file: the same tensors give the same bytes") { CHECK(example().bytes() == example().bytes()); }

TEST_CASE("tensor file: the strict reader gets back what was written") {
  const test::ScratchFolder folder;
  example().write(folder / "deep/er/file.st");
  const SafetensorsFile file = SafetensorsFile::open(folder / "deep/er/file.st");
  CHECK(file.all_metadata() == example().metadata);
  CHECK(file.tensor<double>("doubles", {1, 2})[1] == -2);
  CHECK(file.tensor<float>("floats", {})[0] == 1.5f);
  CHECK(file.tensor<std::uint16_t>("words", {1})[0] == 0x1234);
  CHECK(file.tensor<std::uint8_t>("bytes", {-1})[2] == 3);
  CHECK(file.tensor<std::int64_t>("empty", {0, 7}).empty());
}
