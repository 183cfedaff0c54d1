// What --registers writes: every published block, for comparing replays.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "firmware/settings/atomic_file.h"
#include "firmware/types.h"

namespace finsight {

using RegisterWords = std::array<std::uint16_t, kMeasurementRegisters>;

/// "r0,r1,..." and "0,1,...": how every CSV file names and lists the words of a block.
std::string csv_names_of_registers();
std::string csv_of_registers(const RegisterWords& words);

/// Keeps the blocks in memory, so that the frame loop does not wait for a disk, and writes them when the loop has
/// ended. All of the memory is there from the start: add() does not allocate.
class RegisterLog {
 public:
  /// 72 minutes at 60 frames/s, 25 MB.
  static constexpr std::size_t kMaxBlocks = 1 << 18;

  /// Creates the file already, so that a path that cannot be written is reported before the work. An empty path:
  /// nothing is kept or written. Throws std::system_error.
  explicit RegisterLog(const std::filesystem::path& file, std::size_t max_blocks = kMaxBlocks);
  void add(const RegisterImage& image);
  /// Once. Returns how many blocks had no room. Throws std::system_error.
  std::size_t write();

 private:
  std::optional<AtomicFile> file_;
  std::vector<RegisterWords> blocks_;
  std::size_t used_ = 0, left_out_ = 0;
};

}  // namespace finsight
