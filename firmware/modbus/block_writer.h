// Writes values into a block of registers as their rows of the table say.
#pragma once

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstdint>
#include <limits>
#include <span>
#include <string_view>

#include "firmware/modbus/register_table.h"
#include "firmware/types.h"

namespace finsight {

inline constexpr double kNan = std::numeric_limits<double>::quiet_NaN();

class BlockWriter {
 public:
  /// `words` begin at address `first`.
  BlockWriter(std::span<std::uint16_t> words, int first, bool low_word_first)
      : words_(words), first_(first), low_word_first_(low_word_first) {}

  /// Bits, codes, counters and clients, of which every value is valid.
  void count(const RegisterRow& row, std::uint32_t value) {
    if (row.type == RegisterType::kUint32) {
      put_pair(row.address, value);
    } else {
      put(row.address, std::min<std::uint32_t>(value, 0xFFFF));
    }
  }

  /// Measured values. One value of each type means "not valid"; a saturated value stops short of it.
  void measured(const RegisterRow& row, double value, bool valid) {
    valid = valid && std::isfinite(value);
    const double counts = valid ? std::round(value / row.scale) : 0;
    if (row.type == RegisterType::kInt16) {
      put(row.address, valid ? static_cast<std::int64_t>(std::clamp(counts, -32767.0, 32767.0)) : -32768);
    } else if (row.type == RegisterType::kUint16) {
      put(row.address, valid ? static_cast<std::int64_t>(std::clamp(counts, 0.0, 65534.0)) : 65535);
    } else {
      // The same NaN on all processors: those that x86 and ARM compute differ in their sign.
      const float number = valid ? static_cast<float>(value) : static_cast<float>(kNan);
      put_pair(row.address, std::bit_cast<std::uint32_t>(number));
    }
  }

  /// Three consecutive rows, x, y and z, of which `x_row` is the first.
  void measured(const RegisterRow& x_row, const Vec3f& value, double factor, bool valid) {
    for (int axis = 0; axis < 3; ++axis) {
      measured((&x_row)[axis], factor * static_cast<double>(value[axis]), valid);
    }
  }

  /// ASCII; what has no place is cut off.
  void text(const RegisterRow& row, std::string_view value) {
    for (int i = 0; i < words_of(row.type); ++i) {
      const auto byte = [&](std::size_t at) { return at < value.size() ? static_cast<unsigned char>(value[at]) : 0U; };
      const std::size_t at = 2 * static_cast<std::size_t>(i);
      put(row.address + i, byte(at) << 8 | byte(at + 1));
    }
  }

 private:
  void put(int address, std::int64_t word) {
    words_[static_cast<std::size_t>(address - first_)] = static_cast<std::uint16_t>(word);
  }
  void put_pair(int address, std::uint32_t bits) {
    put(low_word_first_ ? address + 1 : address, bits >> 16);
    put(low_word_first_ ? address : address + 1, bits & 0xFFFF);
  }

  std::span<std::uint16_t> words_;
  int first_;
  bool low_word_first_;
};

}  // namespace finsight
