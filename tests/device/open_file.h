// Which file a descriptor belongs to, for tests that watch system calls.
#pragma once

#include <filesystem>
#include <string>
#include <system_error>

namespace finsight::test {

/// Empty for a descriptor that is not open.
inline std::string path_of(int descriptor) {
  std::error_code ignored;
  return std::filesystem::read_symlink("/proc/self/fd/" + std::to_string(descriptor), ignored).string();
}

}  // namespace finsight::test
