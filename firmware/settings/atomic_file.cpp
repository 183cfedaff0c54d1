#include "firmware/settings/atomic_file.h"

#include <fcntl.h>
#include <unistd.h>

#include <cerrno>
#include <cstdio>
#include <system_error>
#include <utility>

namespace finsight {

namespace {

constexpr std::size_t kBufferBytes = 64 * 1024;

[[noreturn]] void throw_errno(const std::filesystem::path& file, const char* what) {
  throw std::system_error(errno, std::generic_category(), file.string() + ": " + what);
}

std::filesystem::path folder_of(const std::filesystem::path& file) {
  return file.has_parent_path() ? file.parent_path() : ".";
}

/// Opens an existing file or folder and waits until it is on the disk.
void sync(const std::filesystem::path& path, int flags) {
  const int descriptor = ::open(path.c_str(), flags | O_CLOEXEC);
  if (descriptor < 0) throw_errno(path, "cannot be opened");
  const int result = ::fsync(descriptor), error = errno;
  ::close(descriptor);
  errno = error;
  // EINVAL: a file system that keeps no names in memory, such as some network ones.
  if (result != 0 && errno != EINVAL) throw_errno(path, "cannot be synced");
}

/// Where a link leads, so that it stays one. Devices and pipes are never replaced.
std::filesystem::path followed(std::filesystem::path file) {
  std::error_code none;  // of a file that is not there yet
  if (std::filesystem::is_symlink(file, none)) file = std::filesystem::weakly_canonical(file);
  if (std::filesystem::exists(file, none) && !std::filesystem::is_regular_file(file, none)) {
    errno = std::filesystem::is_directory(file, none) ? EISDIR : EINVAL;
    throw_errno(file, "is no ordinary file, and is not replaced");
  }
  return file;
}

void write_all(int descriptor, std::string_view bytes, const std::filesystem::path& file) {
  while (!bytes.empty()) {
    const ssize_t written = ::write(descriptor, bytes.data(), bytes.size());
    if (written < 0 && errno == EINTR) continue;
    if (written <= 0) throw_errno(file, "cannot be written");
    bytes.remove_prefix(static_cast<std::size_t>(written));
  }
}

void rename_durably(const std::filesystem::path& from, const std::filesystem::path& to) {
  if (::rename(from.c_str(), to.c_str()) != 0) throw_errno(to, "cannot be renamed");
  sync_folder(folder_of(to));
}

}  // namespace

AtomicFile::AtomicFile(std::filesystem::path file)
    : file_(followed(std::move(file))), temporary_(file_.string() + ".part" + std::to_string(getpid())) {
  std::filesystem::create_directories(folder_of(file_));
  descriptor_ = ::open(temporary_.c_str(), O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0644);
  if (descriptor_ < 0) fail("cannot be created");
}

AtomicFile::~AtomicFile() {
  if (descriptor_ < 0) return;
  ::close(descriptor_);
  ::unlink(temporary_.c_str());
}

void AtomicFile::fail(const char* what) const { throw_errno(file_, what); }

void AtomicFile::write(std::string_view bytes) {
  if (buffer_.size() + bytes.size() > kBufferBytes) flush();
  if (bytes.size() < kBufferBytes) {
    buffer_.append(bytes);
  } else {
    write_all(descriptor_, bytes, file_);
  }
}

void AtomicFile::flush() {
  write_all(descriptor_, buffer_, file_);
  buffer_.clear();
}

void AtomicFile::commit() {
  flush();
  if (::fsync(descriptor_) != 0) fail("cannot be synced");
  rename_durably(temporary_, file_);
  ::close(std::exchange(descriptor_, -1));
}

GrowingFile::GrowingFile(std::filesystem::path file) : file_(std::move(file)) {
  descriptor_ = ::open(file_.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, 0644);
  if (descriptor_ < 0) throw_errno(file_, "cannot be created");
}

GrowingFile::~GrowingFile() { ::close(descriptor_); }

void GrowingFile::write(std::string_view bytes) { write_all(descriptor_, bytes, file_); }

void GrowingFile::sync() {
  if (::fsync(descriptor_) != 0) throw_errno(file_, "cannot be synced");
}

void write_file_atomically(const std::filesystem::path& file, std::string_view bytes) {
  AtomicFile out(file);
  out.write(bytes);
  out.commit();
}

void replace_file(const std::filesystem::path& from, const std::filesystem::path& to) {
  sync(from, O_RDONLY);
  rename_durably(from, to);
}

void sync_folder(const std::filesystem::path& folder) { sync(folder, O_RDONLY | O_DIRECTORY); }

}  // namespace finsight
