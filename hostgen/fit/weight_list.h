// weights.csv: which weight hung at which hole in which recording.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

namespace finsight::host {

struct ListedWeight {
  std::string session;  ///< name of the recording's folder
  int hole = 0;
  double mass_g = 0;
};

/// Rows session,hole,mass_g below a line with these names; holes 1 to `holes`. Throws InputError with file:line,
/// column, found and expected; also for a session that is listed twice.
std::vector<ListedWeight> read_weights(const std::filesystem::path& file, int holes);

/// The row of a session's folder. Throws InputError naming both if there is none.
const ListedWeight& listed(const std::vector<ListedWeight>& weights, const std::filesystem::path& session,
                           const std::filesystem::path& file);

}  // namespace finsight::host
