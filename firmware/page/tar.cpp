#include "firmware/page/tar.h"

#include <algorithm>
#include <array>
#include <cstdio>
#include <cstring>
#include <fstream>
#include <memory>
#include <utility>

namespace finsight::page {

namespace {

constexpr std::size_t kTarBlock = 512;

/// The head of a file in a tar archive (POSIX.1-1988, ustar).
std::array<char, kTarBlock> tar_head(const std::string& name, std::uintmax_t bytes) {
  std::array<char, kTarBlock> head{};
  std::snprintf(head.data(), 100, "%s", name.c_str());
  std::snprintf(head.data() + 100, 8, "%07o", 0644U);
  std::snprintf(head.data() + 108, 8, "%07o", 0U);
  std::snprintf(head.data() + 116, 8, "%07o", 0U);
  constexpr std::uintmax_t kMostInOctal = (std::uintmax_t{1} << 33) - 1;
  if (bytes <= kMostInOctal) {
    std::snprintf(head.data() + 124, 12, "%011llo", static_cast<unsigned long long>(bytes));
  } else {  // as GNU tar writes it: the top bit, then a big-endian number
    head[124] = static_cast<char>(0x80);
    for (std::size_t i = 0; i < 8; ++i) head[135 - i] = static_cast<char>(bytes >> (8 * i) & 0xFF);
  }
  std::snprintf(head.data() + 136, 12, "%011o", 0U);
  std::memset(head.data() + 148, ' ', 8);
  head[156] = '0';
  std::memcpy(head.data() + 257, "ustar\00000", 8);
  unsigned sum = 0;
  for (const char c : head) sum += static_cast<unsigned char>(c);
  std::snprintf(head.data() + 148, 8, "%06o", sum);
  return head;
}

class Tar {
 public:
  explicit Tar(std::vector<TarPart> parts) : parts_(std::move(parts)) {}

  /// Negative where a file is not what it was when the archive began: half an archive must not look like a whole one.
  std::int64_t more(char* bytes, std::size_t room) {
    std::size_t given = 0;
    while (given < room && fill()) {
      const std::size_t count = std::min(room - given, buffer_.size() - at_);
      std::memcpy(bytes + given, buffer_.data() + at_, count);
      at_ += count;
      given += count;
    }
    return is_broken_ ? -1 : static_cast<std::int64_t>(given);
  }

 private:
  /// Whether there is something in the buffer.
  bool fill() {
    if (at_ < buffer_.size()) return true;
    at_ = 0;
    buffer_.clear();
    if (left_ > 0) {
      const auto count = static_cast<std::size_t>(std::min<std::uintmax_t>(left_, 64 * 1024));
      buffer_.resize(count);
      if (!in_.read(buffer_.data(), static_cast<std::streamsize>(count))) {
        is_broken_ = true;
        buffer_.clear();
        return false;
      }
      left_ -= count;
      if (left_ == 0) buffer_.resize((count + kTarBlock - 1) / kTarBlock * kTarBlock);
      return true;
    }
    if (next_ < parts_.size()) {
      const TarPart& part = parts_[next_++];
      const std::uintmax_t bytes = part.file.empty() ? part.text.size() : part.bytes;
      const auto head = tar_head(part.name, bytes);
      buffer_.assign(head.begin(), head.end());
      if (part.file.empty()) {
        buffer_.insert(buffer_.end(), part.text.begin(), part.text.end());
        buffer_.resize((buffer_.size() + kTarBlock - 1) / kTarBlock * kTarBlock);
        return true;
      }
      in_ = std::ifstream(part.file, std::ios::binary);
      left_ = bytes;
      return true;
    }
    if (std::exchange(is_ended_, true)) return false;
    buffer_.assign(2 * kTarBlock, '\0');
    return true;
  }

  const std::vector<TarPart> parts_;
  std::size_t next_ = 0, at_ = 0;
  std::vector<char> buffer_;
  std::ifstream in_;
  std::uintmax_t left_ = 0;
  bool is_ended_ = false, is_broken_ = false;
};

}  // namespace

std::function<std::int64_t(char*, std::size_t)> tar_of(std::vector<TarPart> parts) {
  const auto tar = std::make_shared<Tar>(std::move(parts));
  return [tar](char* bytes, std::size_t room) { return tar->more(bytes, room); };
}

}  // namespace finsight::page
