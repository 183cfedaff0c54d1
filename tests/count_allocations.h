// Counts every allocation of a test program, whoever asks for it: operator new, Eigen (which calls malloc), a library.
// Include in one file of a program only: this replaces the global malloc and its relatives.
#pragma once

#include <atomic>
#include <cerrno>
#include <cstddef>

namespace finsight::test {
inline std::atomic<long> allocations{0};
}

#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)  // GCC
#define FINSIGHT_SANITIZER
#elif defined(__has_feature)  // clang
#if __has_feature(address_sanitizer) || __has_feature(thread_sanitizer)
#define FINSIGHT_SANITIZER
#endif
#endif

#ifdef FINSIGHT_SANITIZER

// These sanitizers have a malloc of their own and call this for every allocation.
extern "C" void __sanitizer_malloc_hook(const volatile void*, std::size_t) { ++finsight::test::allocations; }

#else

// The C library's own names of what is replaced.
extern "C" {
void* __libc_malloc(std::size_t);
void* __libc_calloc(std::size_t, std::size_t);
void* __libc_realloc(void*, std::size_t);
void* __libc_memalign(std::size_t, std::size_t);

void* malloc(std::size_t size) {
  ++finsight::test::allocations;
  return __libc_malloc(size);
}
void* calloc(std::size_t count, std::size_t size) {
  ++finsight::test::allocations;
  return __libc_calloc(count, size);
}
void* realloc(void* memory, std::size_t size) {
  ++finsight::test::allocations;
  return __libc_realloc(memory, size);
}
void* memalign(std::size_t alignment, std::size_t size) {
  ++finsight::test::allocations;
  return __libc_memalign(alignment, size);
}
void* aligned_alloc(std::size_t alignment, std::size_t size) { return memalign(alignment, size); }
int posix_memalign(void** memory, std::size_t alignment, std::size_t size) {
  *memory = memalign(alignment, size);
  return *memory ? 0 : ENOMEM;
}
}

#endif
