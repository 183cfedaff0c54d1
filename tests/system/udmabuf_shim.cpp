// Preloaded (LD_PRELOAD) into a program that uses libcamera's virtual camera, on machines without /dev/udmabuf and
// /dev/dma_heap, containers among them: a "dma-buf" is then simply the memory file that it would have been made from.
// And libcamera reads the virtual camera's settings from one fixed path: FINSIGHT_VIRTUAL_YAML names another file.
#include <fcntl.h>
#include <linux/udmabuf.h>
#include <sys/ioctl.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <unistd.h>

#include <cstdarg>
#include <cstdlib>
#include <cstring>

namespace {

const char* stand_in(const char* path) {
  const char* yaml = std::getenv("FINSIGHT_VIRTUAL_YAML");
  if (path && std::strcmp(path, "/dev/udmabuf") == 0) return "/dev/null";
  if (path && yaml && std::strcmp(path, "/usr/share/libcamera/pipeline/virtual/virtual.yaml") == 0) return yaml;
  return path;
}

int open_stand_in(const char* path, int flags, va_list rest) {
  const mode_t mode = flags & (O_CREAT | O_TMPFILE) ? va_arg(rest, mode_t) : 0;
  return static_cast<int>(syscall(SYS_openat, AT_FDCWD, stand_in(path), flags, mode));
}

}  // namespace

extern "C" {

int stat(const char* path, struct stat* result) noexcept { return fstatat(AT_FDCWD, stand_in(path), result, 0); }
int stat64(const char* path, struct stat64* result) noexcept { return fstatat64(AT_FDCWD, stand_in(path), result, 0); }

int open(const char* path, int flags, ...) {
  va_list rest;
  va_start(rest, flags);
  const int fd = open_stand_in(path, flags, rest);
  va_end(rest);
  return fd;
}

int open64(const char* path, int flags, ...) {
  va_list rest;
  va_start(rest, flags);
  const int fd = open_stand_in(path, flags, rest);
  va_end(rest);
  return fd;
}

int ioctl(int fd, unsigned long request, ...) noexcept {
  va_list rest;
  va_start(rest, request);
  void* argument = va_arg(rest, void*);
  va_end(rest);
  if (request == UDMABUF_CREATE) return fcntl(static_cast<udmabuf_create*>(argument)->memfd, F_DUPFD_CLOEXEC, 0);
  return static_cast<int>(syscall(SYS_ioctl, fd, request, argument));
}

}  // extern "C"
