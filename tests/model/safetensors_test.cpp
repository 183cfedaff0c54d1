// The container, against files written here byte by byte.
#include "firmware/model/safetensors.h"

#include <doctest/doctest.h>
#include <sys/stat.h>

#include <cstring>
#include <limits>

#include "firmware/input_error.h"
#include "tests/model/scratch_folder.h"

using namespace finsight;
using test::ScratchFolder;

namespace {

std::string with_length(std::uint64_t length, const std::string& rest) {
  std::string file(8, '\0');
  std::memcpy(file.data(), &length, 8);
  return file + rest;
}

/// A file of this header and `data_size` bytes 0, 1, 2, ...
std::string file_of(std::string header, std::size_t data_size) {
  header.resize((header.size() + 7) / 8 * 8, ' ');
  std::string data(data_size, '\0');
  for (std::size_t i = 0; i < data_size; ++i) data[i] = static_cast<char>(i);
  return with_length(header.size(), header + data);
}

std::string entry(const std::string& name, const std::string& type, const std::string& shape,
                  const std::string& offsets) {
  return "\"" + name + "\":{\"dtype\":\"" + type + "\",\"shape\":" + shape + ",\"data_offsets\":" + offsets + "}";
}

/// A JSON object of these fields.
std::string object(const std::string& fields) {
  std::string text("{");
  return text.append(fields).append("}");
}

doctest::String refusal(const std::filesystem::path& file, std::size_t limit = std::size_t{64} << 20) {
  try {
    SafetensorsFile::open(file, limit);
  } catch (const InputError& error) {
    return error.what();
  }
  return "accepted";
}

}  // namespace

TEST_CASE("safetensors: reads a file written by another program") {
  // As the reference implementation writes it: no padding needed, tensors in any order of the header.
  const ScratchFolder folder;
  const std::string header =
      object(entry("late", "U8", "[3]", "[8,11]") + ",\"__metadata__\":{\"by\":\"hand\"}," +
             entry("early", "I32", "[2,1]", "[0,8]") + "," + entry("none", "F64", "[0,4]", "[8,8]"));
  const SafetensorsFile file = SafetensorsFile::open(folder.write("a", file_of(header, 11)));
  CHECK(file.names() == std::vector<std::string>{"early", "none", "late"});
  CHECK(file.metadata("by") == "hand");
  CHECK(file.dtype("early") == DType::kI32);
  CHECK(file.shape("early") == std::vector<std::int64_t>{2, 1});
  const auto early = file.tensor<std::int32_t>("early", {-1, 1});
  REQUIRE(early.size() == 2);
  CHECK(early[0] == 0x03020100);
  CHECK(early[1] == 0x07060504);
  CHECK(file.tensor<std::uint8_t>("late", {3})[2] == 10);
  CHECK(file.tensor<double>("none", {0, 4}).empty());
  CHECK(file.has("late"));
  CHECK_FALSE(file.has("__metadata__"));
}

TEST_CASE("safetensors: refuses a tensor of another type or shape, with what it found") {
  const ScratchFolder folder;
  const SafetensorsFile file =
      SafetensorsFile::open(folder.write("a.st", file_of(object(entry("t", "I32", "[2,3]", "[0,24]")), 24)));
  CHECK_THROWS_WITH_AS(file.tensor<float>("t", {2, 3}), doctest::Contains("tensor 't': found I32 [2, 3], expected F32"),
                       InputError);
  CHECK_THROWS_WITH_AS(file.tensor<std::int32_t>("t", {-1, 4}), doctest::Contains("expected I32 [any, 4]"), InputError);
  CHECK_THROWS_WITH_AS(file.tensor<std::int32_t>("t", {6}), doctest::Contains("expected I32 [6]"), InputError);
  CHECK_THROWS_WITH_AS(file.tensor<std::int32_t>("u", {6}), doctest::Contains("tensor 'u': found nothing"), InputError);
  CHECK_THROWS_WITH_AS(file.metadata("k"), doctest::Contains("metadata 'k': found nothing"), InputError);
}

TEST_CASE("safetensors: refuses numbers that are not finite, and says which") {
  const ScratchFolder folder;
  const float floats[] = {1, 2, std::numeric_limits<float>::infinity(), 4};
  const double doubles[] = {std::numeric_limits<double>::quiet_NaN()};
  std::string bytes = file_of(object(entry("d", "F64", "[1]", "[0,8]") + "," + entry("f", "F32", "[4]", "[8,24]")), 0);
  bytes.append(reinterpret_cast<const char*>(doubles), sizeof doubles);
  bytes.append(reinterpret_cast<const char*>(floats), sizeof floats);
  const SafetensorsFile file = SafetensorsFile::open(folder.write("a", bytes));
  CHECK_THROWS_WITH_AS(file.tensor<float>("f", {4}), doctest::Contains("'f': found element 2 not finite"), InputError);
  CHECK_THROWS_WITH_AS(file.tensor<double>("d", {1}), doctest::Contains("'d': found element 0 not finite"), InputError);
}

TEST_CASE("safetensors: refuses hostile headers with the reason") {
  const std::string good = entry("t", "F32", "[2]", "[0,8]");
  std::string deep(100'000, '[');
  struct Hostile {
    std::string header;
    std::size_t data;
    const char* reason;
  };
  const Hostile files[] = {
      {"[]", 0, "not a JSON object"},
      {"{\"t\":", 0, "not a JSON object"},
      {"{} x", 0, "not a JSON object"},
      {"{\"t\":" + deep, 0, "not a JSON object"},
      {"{\"t\":[[[[[1]]]]]}", 0, "deeply nested"},
      {"{\"\xff\":1}", 0, "not a JSON object"},
      {"{\"t\":1e999}", 0, "not a JSON object"},
      {object(good + "," + good), 8, "the key \"t\" twice"},
      {"{\"t\":{\"dtype\":\"F32\",\"dtype\":\"F32\",\"shape\":[2],\"data_offsets\":[0,8]}}", 8, "\"dtype\" twice"},
      {"{\"__metadata__\":{\"a\":\"1\",\"a\":\"2\"}," + good + "}", 8, "the key \"a\" twice"},
      {"{\"__metadata__\":{\"a\":1}," + good + "}", 8, "__metadata__ \"a\": found 1, expected a string"},
      {"{\"__metadata__\":[]," + good + "}", 8, "an object of strings"},
      {"{\"t\":7}", 0, "exactly \"dtype\", \"shape\" and \"data_offsets\""},
      {"{\"t\":{\"dtype\":\"F32\",\"shape\":[2]}}", 8, "exactly \"dtype\""},
      {"{\"t\":{\"dtype\":\"F32\",\"shape\":[2],\"data_offsets\":[0,8],\"more\":1}}", 8, "exactly \"dtype\""},
      {"{\"\":{}}", 0, "tensor name"},
      {"{\"two\\nlines\":{}}", 0, "tensor name"},
      {"{\"" + std::string(200, 'n') + "\":{}}", 0, "tensor name"},
      {object(entry("t", "BF16", "[4]", "[0,8]")), 8, "found \"dtype\" \"BF16\""},
      {object(entry("t", "f32", "[2]", "[0,8]")), 8, "found \"dtype\" \"f32\""},
      {"{\"t\":{\"dtype\":3,\"shape\":[2],\"data_offsets\":[0,8]}}", 8, "found \"dtype\" 3"},
      {object(entry("t", "F32", "2", "[0,8]")), 8, "\"shape\" to be at most 8"},
      {object(entry("t", "F32", "[-2]", "[0,8]")), 8, "non-negative integers"},
      {object(entry("t", "F32", "[2.0]", "[0,8]")), 8, "non-negative integers"},
      {object(entry("t", "F32", "[1,1,1,1,1,1,1,1,2]", "[0,8]")), 8, "\"shape\" to be at most 8"},
      {object(entry("t", "F32", "[18446744073709551615]", "[0,8]")), 8, "non-negative integers"},
      {object(entry("t", "F32", "[99999999999999999999]", "[0,8]")), 8, "non-negative integers"},
      // 2^31 * 2^31 * 4 bytes wrap around to 0, 2^62 * 4 as well.
      {object(entry("t", "F32", "[2147483648,2147483648]", "[0,0]")), 0, "expected too many bytes"},
      {object(entry("t", "F32", "[4611686018427387904]", "[0,0]")), 0, "expected too many bytes"},
      {object(entry("t", "F32", "[3]", "[0,8]")), 8, "found 8 bytes, expected 12 bytes for shape [3]"},
      {object(entry("t", "F32", "[2]", "[-8,0]")), 8, "two non-negative integers"},
      {object(entry("t", "F32", "[2]", "[0,8,8]")), 8, "two non-negative integers"},
      {object(entry("t", "F32", "[2]", "\"08\"")), 8, "two non-negative integers"},
      {object(entry("t", "F32", "[2]", "[8,0]")), 8, "offsets within the 8 bytes"},
      {object(entry("t", "F32", "[2]", "[4,12]")), 8, "offsets within the 8 bytes"},
      {object(entry("t", "F32", "[2]", "[18446744073709551608,0]")), 8, "offsets within the 8 bytes"},
      {object(entry("a", "F32", "[2]", "[0,8]") + "," + entry("b", "F32", "[2]", "[4,12]")), 12,
       "'b': found data at offset 4"},
      {object(entry("a", "F32", "[2]", "[0,8]") + "," + entry("b", "F32", "[2]", "[0,8]")), 8,
       "'b': found data at offset 0"},
      {object(entry("a", "U8", "[2]", "[0,2]") + "," + entry("b", "U8", "[2]", "[3,5]")), 5, "expected offset 2"},
      {object(entry("a", "U8", "[2]", "[1,3]")), 3, "expected offset 0"},
      {object(entry("a", "U8", "[2]", "[0,2]")), 3, "found 3 bytes, expected 2 bytes, all in tensors"},
      {object(entry("a", "U8", "[2]", "[0,2]") + "," + entry("b", "F32", "[1]", "[2,6]")), 6,
       "expected a multiple of 4"},
      {"{}", 1, "found 1 bytes, expected 0 bytes"},
  };
  const ScratchFolder folder;
  for (const Hostile& hostile : files) {
    CAPTURE(hostile.header.substr(0, 200));
    const doctest::String message = refusal(folder.write("hostile", file_of(hostile.header, hostile.data)));
    CHECK(message == doctest::Contains(hostile.reason));
    CHECK(message == doctest::Contains("hostile: "));
    CHECK(std::strchr(message.c_str(), '\n') == nullptr);
  }
}

TEST_CASE("safetensors: refuses wrong lengths before it reads anything else") {
  const ScratchFolder folder;
  const std::string good = file_of(object(entry("t", "F32", "[2]", "[0,8]")), 8);
  const auto refused = [&](const std::string& bytes) { return refusal(folder.write("a", bytes)); };
  REQUIRE(refused(good) == "accepted");
  CHECK(refused("") == doctest::Contains("size: found 0 bytes"));
  CHECK(refused(good.substr(0, 8)) == doctest::Contains("size: found 8 bytes"));
  CHECK(refused(with_length(0, "{}")) == doctest::Contains("header length: found 0"));
  CHECK(refused(with_length(3, "{}")) == doctest::Contains("header length: found 3, expected 2 to 2"));
  CHECK(refused(with_length(~std::uint64_t{0}, "{}      ")) ==
        doctest::Contains("header length: found 18446744073709551615"));
  CHECK(refused(with_length(~std::uint64_t{0} - 7, "{}      ")) == doctest::Contains("header length"));
  const std::string long_header = "{}" + std::string((std::size_t{1} << 20) + 6, ' ');
  CHECK(refused(with_length(long_header.size(), long_header)) == doctest::Contains("expected 2 to 1048576 bytes"));
  for (std::size_t length = 0; length < good.size(); ++length) {
    CAPTURE(length);
    CHECK(refused(good.substr(0, length)) != "accepted");
  }
  CHECK(refusal(folder.write("a", good), good.size()) == "accepted");
  CHECK(refusal(folder.write("a", good), good.size() - 1) == doctest::Contains("size: found"));
}

TEST_CASE("safetensors: refuses paths that are not regular files") {
  const ScratchFolder folder;
  CHECK(refusal(folder / "missing") == doctest::Contains("cannot be opened: No such file"));
  CHECK(refusal(folder.path()) == doctest::Contains("not a regular file"));
  CHECK(refusal("/dev/zero") == doctest::Contains("not a regular file"));
  REQUIRE(mkfifo((folder / "pipe").c_str(), 0600) == 0);
  CHECK(refusal(folder / "pipe") == doctest::Contains("not a regular file"));  // and does not wait for a writer
}
