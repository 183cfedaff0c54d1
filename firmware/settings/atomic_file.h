// Files that are there as a whole or not at all; and files that grow, of which all that was written stays.
#pragma once

#include <cstddef>
#include <filesystem>
#include <string>
#include <string_view>

namespace finsight {

/// A file that gets its name only when it is complete and on the disk: readers, and the next start after a power cut,
/// find the old file or the new one, never half of it. It is written beside its place as NAME.part<process id>. All
/// functions throw std::system_error naming the file.
class AtomicFile {
 public:
  /// Creates the folder if it is missing. Writes the file that a link leads to; refuses what is no ordinary file.
  explicit AtomicFile(std::filesystem::path file);
  ~AtomicFile();  ///< removes what was not committed
  AtomicFile(const AtomicFile&) = delete;
  AtomicFile& operator=(const AtomicFile&) = delete;

  void write(std::string_view bytes);
  /// Syncs the file, renames it, and syncs the folder. Nothing may be written afterwards.
  void commit();

 private:
  void flush();
  [[noreturn]] void fail(const char* what) const;

  std::filesystem::path file_;
  std::string temporary_, buffer_;
  int descriptor_ = -1;
};

/// A file that has its name from the start and grows: after a kill, or on a full disk, all that was written is there.
/// Throws std::system_error naming the file.
class GrowingFile {
 public:
  explicit GrowingFile(std::filesystem::path file);  ///< that does not exist yet
  ~GrowingFile();
  GrowingFile(const GrowingFile&) = delete;
  GrowingFile& operator=(const GrowingFile&) = delete;

  void write(std::string_view bytes);  ///< at once, without a buffer
  void sync();

 private:
  std::filesystem::path file_;
  int descriptor_ = -1;
};

/// The whole of a file at once.
void write_file_atomically(const std::filesystem::path& file, std::string_view bytes);

/// Gives a file that another program wrote, or that was checked first, its final name, with the same guarantee.
void replace_file(const std::filesystem::path& from, const std::filesystem::path& to);

/// Puts the names in a folder on the disk: of files that were created or renamed in it.
void sync_folder(const std::filesystem::path& folder);

}  // namespace finsight
