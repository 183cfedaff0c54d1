// The sessions that finsightd has recorded.
#pragma once

#include <filesystem>
#include <functional>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>

#include "firmware/page/request_guard.h"

namespace finsight::page {

class Recordings {
 public:
  explicit Recordings(std::filesystem::path folder) : folder_(std::move(folder)) {}

  /// [{"name", "bytes", "complete", "changed_s"}]; the newest first.
  nlohmann::json list() const;
  /// The whole session as a tar file, piece by piece; null if there is none of that name.
  std::function<std::int64_t(char*, std::size_t)> tar(const std::string& name) const;
  /// `is_recording`: what finsightd does now; nothing: that is not known. What it writes is not deleted.
  std::optional<Refusal> remove(const std::string& name, std::optional<bool> is_recording) const;
  /// A folder's name as the recorder makes them; nothing else is ever looked up.
  static bool is_name(const std::string& name);

 private:
  const std::filesystem::path folder_;  ///< empty: there are none
};

}  // namespace finsight::page
