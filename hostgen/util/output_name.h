// What an output file may be called.
#pragma once

#include <algorithm>
#include <filesystem>
#include <string>
#include <vector>

#include "firmware/input_error.h"

namespace finsight::host {

/// Throws InputError unless the name ends in one of `allowed`, such as ".png".
inline void check_extension(const std::filesystem::path& output, const std::vector<std::string>& allowed) {
  const std::string extension = output.extension().string();
  if (std::find(allowed.begin(), allowed.end(), extension) != allowed.end()) return;
  std::string names;
  for (const std::string& name : allowed) names += (names.empty() ? "" : " or ") + name;
  throw InputError(output.string(), "file name", "\"" + output.filename().string() + "\"",
                   "a name that ends in " + names);
}

}  // namespace finsight::host
