// A wrong byte or a truncated file is always refused, and the message says where it is.
#include <doctest/doctest.h>

#include <cstring>

#include "firmware/model/checks.h"
#include "tests/model/hostile_pack.h"

using namespace finsight;
using namespace finsight::test;

namespace {

std::string tiny_pack() { return host::sealed_bytes(host::pack_tensors(TinyModel().views())); }

std::size_t header_end(const std::string& pack) {
  std::uint64_t length = 0;
  std::memcpy(&length, pack.data(), sizeof length);
  return sizeof length + length;
}

/// A pack in which one bit at a time is wrong.
class FlippedFile {
 public:
  explicit FlippedFile(std::filesystem::path path) : path_(std::move(path)) {}
  /// What Model::open says with one bit of this byte flipped; another bit for each byte.
  doctest::String refusal(std::size_t at) const {
    flip(at);
    doctest::String message = "accepted";
    try {
      Model::open(path_);
    } catch (const InputError& error) {
      message = error.what();
    }
    flip(at);
    return message;
  }

 private:
  void flip(std::size_t at) const {
    std::fstream file(path_, std::ios::binary | std::ios::in | std::ios::out);
    const auto place = static_cast<std::streamoff>(at);
    const int byte = file.seekg(place).get();
    file.seekp(place).put(static_cast<char>(byte ^ (1 << (at * 5 % 8))));
  }

  std::filesystem::path path_;
};

}  // namespace

TEST_CASE("checksum: is the CRC-32 of IEEE 802.3, and can be continued") {
  const char text[] = "123456789";
  const auto bytes = std::as_bytes(std::span(text, 9));
  CHECK(crc32(bytes) == 0xCBF43926u);
  CHECK(crc32(bytes.subspan(4), crc32(bytes.first(4))) == 0xCBF43926u);
  CHECK(crc32({}) == 0);
  CHECK(checksum_text(0x0CBF4392u) == "0cbf4392");
}

TEST_CASE("checksum: the header's counts its own digits as zeros and everything else") {
  const std::string header = R"({"__metadata__":{"checksum":"12345678","x":"1"}})";
  const std::uint32_t checksum = header_checksum(header);
  const std::string_view with_zeros = R"({"__metadata__":{"checksum":"00000000","x":"1"}})";
  CHECK(checksum == crc32(std::as_bytes(std::span(with_zeros))));
  CHECK(header_checksum(R"({"__metadata__":{"checksum":"87654321","x":"1"}})") == checksum);
  CHECK(header_checksum(R"({"__metadata__":{"checksum":"12345678","x":"2"}})") != checksum);
  CHECK(header_checksum(R"({"x":"1"})") == 0);
  CHECK(header_checksum(R"({"checksum":"123)") == 0);
}

TEST_CASE("integrity: a flipped bit in the data is refused, and the tensor is named") {
  const ScratchFolder folder;
  const std::string good = tiny_pack();
  REQUIRE(refusal(folder, good) == "accepted");
  const SafetensorsFile file = SafetensorsFile::open(folder / "pack");
  const FlippedFile flipped(folder.write("flipped", good));
  for (const std::string& name : file.names()) {
    const auto start = static_cast<std::size_t>(file.raw(name).data() - file.bytes().data());
    const std::string reason = "tensor '" + name + "': found CRC-32 ";
    for (std::size_t i = 0; i < file.raw(name).size(); i += 7) {
      CHECK(flipped.refusal(start + i) == doctest::Contains(reason.c_str()));
    }
    CHECK(flipped.refusal(start + file.raw(name).size() - 1) == doctest::Contains(reason.c_str()));
  }
}

TEST_CASE("integrity: a flipped bit in any byte of the header or its length is refused") {
  const ScratchFolder folder;
  const std::string good = tiny_pack();
  const FlippedFile flipped(folder.write("flipped", good));
  for (std::size_t at = 0; at < header_end(good); ++at) {
    CAPTURE(at);
    CHECK(flipped.refusal(at) != "accepted");
  }
  CHECK_NOTHROW(Model::open(folder / "flipped"));  // each flip was undone
}

TEST_CASE("integrity: a change of the header that is still a good header is refused as damage of the header") {
  const ScratchFolder folder;
  const std::string good = tiny_pack();
  const auto changed = [&](const std::string& from, const std::string& to) {
    std::string bad = good;
    REQUIRE(good.find(from) != std::string::npos);
    return refusal(folder, bad.replace(bad.find(from), from.size(), to));
  };
  CHECK(changed("\"finger\":\"tiny\"", "\"finger\":\"tinz\"") == doctest::Contains("header: found CRC-32 "));
  CHECK(changed("\"touch_threshold_mm\":\"2\"", "\"touch_threshold_mm\":\"3\"") == doctest::Contains("header: found"));
  CHECK(changed("\"crc32.shape.rest_mm\":\"", "\"crc32.shape.rest_xx\":\"") == doctest::Contains("header: found"));
  CHECK(changed("\"checksum\":\"", "\"checksun\":\"") == doctest::Contains("metadata 'checksum': found nothing"));
}

TEST_CASE("integrity: a missing checksum of a tensor is refused") {
  const ScratchFolder folder;
  std::string bytes = tiny_pack();
  const std::string key = "\"crc32.shape.rest_mm\"";
  bytes.replace(bytes.find(key), key.size(), "\"crc33.shape.rest_mm\"");
  const std::string checksum = checksum_text(header_checksum(std::string_view(bytes).substr(8, header_end(bytes) - 8)));
  const std::string before = "\"checksum\":\"";
  bytes.replace(bytes.find(before) + before.size(), 8, checksum);
  CHECK(refusal(folder, bytes) == doctest::Contains("metadata 'crc32.shape.rest_mm': found nothing"));
}

TEST_CASE("integrity: a pack cut short anywhere is refused") {
  const ScratchFolder folder;
  const std::string good = tiny_pack();
  for (std::size_t length = 0; length < good.size(); length += length < 64 ? 1 : 97) {
    CAPTURE(length);
    CHECK(refusal(folder, good.substr(0, length)) != "accepted");
  }
  CHECK(refusal(folder, good.substr(0, good.size() - 1)) == doctest::Contains("pack: "));
  CHECK(refusal(folder, good + "x") == doctest::Contains("all in tensors"));
}
