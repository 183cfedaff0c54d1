// A tar archive (POSIX.1-1988, ustar), given out piece by piece.
#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <string>
#include <vector>

namespace finsight::page {

/// A file of the archive: one on the disk, with the length that it had when the download began, as a recording may
/// still grow; or a text in memory.
struct TarPart {
  std::string name;  ///< at most 99 characters
  std::filesystem::path file = {};
  std::uintmax_t bytes = 0;  ///< of the file
  std::string text = {};     ///< without a file
};

/// Gives the next bytes, at most as many as there is room for; 0 at the end.
std::function<std::int64_t(char*, std::size_t)> tar_of(std::vector<TarPart> parts);

}  // namespace finsight::page
