// A fuzzer's input as a file that never touches a disk.
#pragma once

#include <sys/mman.h>
#include <unistd.h>

#include <cstdlib>
#include <string>

/// A file in memory; `path` opens it.
class MemoryFile {
 public:
  MemoryFile(const void* bytes, std::size_t size) : fd_(memfd_create("pack", MFD_CLOEXEC)) {
    if (fd_ < 0 || write(fd_, bytes, size) != static_cast<ssize_t>(size)) std::abort();
  }
  ~MemoryFile() { close(fd_); }
  MemoryFile(const MemoryFile&) = delete;
  MemoryFile& operator=(const MemoryFile&) = delete;
  std::string path() const { return "/proc/self/fd/" + std::to_string(fd_); }

 private:
  int fd_;
};
