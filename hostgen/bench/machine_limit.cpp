#include "hostgen/bench/machine_limit.h"

#include <algorithm>
#include <vector>

#include "firmware/shape/simd.h"
#include "hostgen/util/stopwatch.h"

namespace finsight::host {

namespace {

using V = simd::Vector<float>;
constexpr int kLanes = simd::kLanesOf<float>;

/// Makes the compiler believe that this is needed.
void keep(const V& value) { asm volatile("" : : "m"(value)); }

// As many sums as the factorisation's kernel keeps in registers. The factor is below one, so that nothing overflows.
double multiply_adds_per_us() {
  constexpr int kSums = 12, kTurns = 100'000;
  V sum[kSums] = {};
  V factor = simd::splat<V>(0.999), addend = simd::splat<V>(0.5);
  asm volatile("" : "+m"(factor), "+m"(addend));
  const V a = factor, b = addend;
  ProcessorStopwatch watch;
  for (int turn = 0; turn < kTurns; ++turn) {
#pragma GCC unroll 12
    for (int k = 0; k < kSums; ++k) sum[k] = sum[k] * a + b;
  }
  const double us = watch.lap_us();
  for (const V& one : sum) keep(one);
  return static_cast<double>(kSums) * kTurns * kLanes / us;
}

double bytes_per_us(const std::vector<float>& numbers) {
  constexpr std::size_t kSums = 8;
  V sum[kSums] = {};
  ProcessorStopwatch watch;
  for (std::size_t i = 0; i + kSums * kLanes <= numbers.size(); i += kSums * kLanes) {
#pragma GCC unroll 8
    for (std::size_t k = 0; k < kSums; ++k) sum[k] += simd::load(&numbers[i + k * kLanes]);
  }
  const double us = watch.lap_us();
  for (const V& one : sum) keep(one);
  return static_cast<double>(numbers.size() * sizeof(float)) / us;
}

}  // namespace

MachineLimit measure_machine_limit() {
  const std::vector<float> small(512 * 1024 / sizeof(float), 1.0f), large(64 * 1024 * 1024 / sizeof(float), 1.0f);
  MachineLimit limit;
  for (int k = 0; k < 20; ++k) {
    limit.multiply_adds_per_us = std::max(limit.multiply_adds_per_us, multiply_adds_per_us());
    for (int again = 0; again < 20; ++again) {
      limit.cache_bytes_per_us = std::max(limit.cache_bytes_per_us, bytes_per_us(small));
    }
    limit.memory_bytes_per_us = std::max(limit.memory_bytes_per_us, bytes_per_us(large));
  }
  return limit;
}

}  // namespace finsight::host
