// Under a sanitizer, unoptimised or emulated everything takes thirty times as long: long tests do less there.
#pragma once

namespace finsight::test {

#if defined(__has_feature)
#if __has_feature(address_sanitizer)
#define FINSIGHT_SLOW_BUILD
#endif
#endif
#if defined(FINSIGHT_SLOW_BUILD) || defined(__SANITIZE_ADDRESS__) || !defined(__OPTIMIZE__) || defined(__aarch64__)
inline constexpr bool kIsSlow = true;
#else
inline constexpr bool kIsSlow = false;
#endif

}  // namespace finsight::test
