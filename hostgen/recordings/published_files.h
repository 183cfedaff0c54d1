// The recordings published with the paper (OpenCV YAML files) -> the CSV that read_recorded_motion() reads.
#pragma once

#include <filesystem>
#include <string>

namespace finsight::host {

struct PublishedFiles {
  std::string csv;  ///< the columns of RecordedMotion, lengths to 1e-5 mm, quaternions to 1e-7
  std::size_t files = 0, rows = 0;
  /// Rows in which the three markers are equal to the last digit. The CSV holds the first marker, bc_top.
  std::size_t identical_markers = 0;
};

/// Converts every .yml and .yaml file of `folder`, in the order of their names, one recording per file. A recording has
/// the name of its file without colons ("16:19:22.yml" is 161922). Nothing is filtered. With progress. Throws
/// InputError naming file, point and field; Interrupted.
PublishedFiles convert_published_files(const std::filesystem::path& folder);

}  // namespace finsight::host
