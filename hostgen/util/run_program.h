// Runs external programs in a temporary folder with a time limit.
#pragma once

#include <chrono>
#include <filesystem>
#include <string>
#include <vector>

namespace finsight::host {

/// Deleted with its contents, also when an exception is thrown.
class TemporaryFolder {
 public:
  TemporaryFolder();
  ~TemporaryFolder();
  TemporaryFolder(const TemporaryFolder&) = delete;
  TemporaryFolder& operator=(const TemporaryFolder&) = delete;
  const std::filesystem::path& path() const { return path_; }

 private:
  std::filesystem::path path_;
};

/// Runs `command` (a program of PATH and its arguments) in `folder`; what it prints goes to the file "log" there.
/// Throws std::runtime_error with the end of the log if the program is missing (naming its Debian package), fails, needs
/// more processor time than `limit`, or hardly works for five times that (it is killed then), Interrupted on Ctrl-C.
void run_program(const std::vector<std::string>& command, const std::filesystem::path& folder,
                 std::chrono::milliseconds limit, const std::string& debian_package);

}  // namespace finsight::host
