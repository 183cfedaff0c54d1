// Checksums: a flipped bit anywhere in a pack is found before any of its numbers is used.
#include <array>
#include <cstring>

#include "firmware/input_error.h"
#include "firmware/model/checks.h"

namespace finsight {

namespace {

constexpr std::array<std::uint32_t, 256> kCrcTable = [] {
  std::array<std::uint32_t, 256> table{};
  for (std::uint32_t i = 0; i < 256; ++i) {
    std::uint32_t value = i;
    for (int bit = 0; bit < 8; ++bit) value = (value >> 1) ^ (value & 1 ? 0xEDB88320u : 0u);
    table[i] = value;
  }
  return table;
}();

std::span<const std::byte> bytes_of(std::string_view text) { return std::as_bytes(std::span(text)); }

std::string_view header_of(const SafetensorsFile& file) {
  std::uint64_t length = 0;
  std::memcpy(&length, file.bytes().data(), sizeof length);
  return {reinterpret_cast<const char*>(file.bytes().data()) + sizeof length, length};
}

}  // namespace

std::uint32_t crc32(std::span<const std::byte> bytes, std::uint32_t seed) {
  std::uint32_t crc = ~seed;
  for (const std::byte byte : bytes) crc = (crc >> 8) ^ kCrcTable[(crc ^ std::to_integer<std::uint32_t>(byte)) & 0xFF];
  return ~crc;
}

std::string checksum_text(std::uint32_t checksum) {
  constexpr char kDigits[] = "0123456789abcdef";
  std::string text;
  for (int shift = 28; shift >= 0; shift -= 4) text += kDigits[(checksum >> shift) & 15];
  return text;
}

std::uint32_t header_checksum(std::string_view header) {
  std::string key = "\"";
  key.append(meta::kChecksum).append("\":\"");
  const std::string_view zeros = "00000000";
  const std::size_t found = header.find(key);
  if (found == std::string_view::npos || found + key.size() + zeros.size() > header.size()) return 0;
  const std::size_t digits = found + key.size();
  std::uint32_t crc = crc32(bytes_of(header.substr(0, digits)));
  crc = crc32(bytes_of(zeros), crc);
  return crc32(bytes_of(header.substr(digits + zeros.size())), crc);
}

std::uint32_t check_integrity(const SafetensorsFile& file) {
  if (!file.all_metadata().contains(meta::kFormat)) throw InputError(file.path(), "is not a Finsight model pack");
  if (const std::string& version = file.metadata(meta::kFormat); version != meta::kFormatVersion) {
    throw InputError(file.path(), "format version", version.substr(0, 60), meta::kFormatVersion);
  }
  // The header first: it holds the tensors' checksums.
  const std::uint32_t checksum = header_checksum(header_of(file));
  if (const std::string& stored = file.metadata(meta::kChecksum); stored != checksum_text(checksum)) {
    throw InputError(file.path(), "header", "CRC-32 " + checksum_text(checksum),
                     stored.substr(0, 60) + " (damaged file)");
  }
  for (const std::string& name : file.names()) {
    const std::string& stored = file.metadata(meta::kTensorCrc + name);
    const std::string actual = checksum_text(crc32(file.raw(name)));
    if (stored != actual) file.refuse(name, "CRC-32 " + actual, stored.substr(0, 60) + " (damaged file)");
  }
  return checksum;
}

}  // namespace finsight
