// How long each stage of the frame loop takes: fixed-size histograms, a few nanoseconds per entry.
#pragma once

#include <array>
#include <bit>
#include <cstdint>
#include <string>

#include "firmware/types.h"

namespace finsight {

/// Times from 1 us to 17 s in buckets 1/16 of a power of two wide: a percentile is right within 5 %.
class TimeHistogram {
 public:
  void add(std::int64_t ns) {
    const std::uint64_t us_16 = static_cast<std::uint64_t>(ns > 1000 ? ns / 1000 : 1) * 16;
    const int exponent = 63 - std::countl_zero(us_16) - 4;
    const std::size_t bucket = static_cast<std::size_t>(exponent) * 16 + ((us_16 >> exponent) & 15);
    ++buckets_[bucket < buckets_.size() ? bucket : buckets_.size() - 1];
    ++count_;
    if (ns > worst_ns_) worst_ns_ = ns;
  }
  /// Upper edge of the bucket that holds the given share (0 ... 1) of all entries.
  double percentile_us(double share) const {
    const double wanted = share * static_cast<double>(count_);
    std::uint64_t below = 0;
    for (std::size_t i = 0; i < buckets_.size(); ++i) {
      below += buckets_[i];
      if (below > 0 && static_cast<double>(below) >= wanted) {
        return static_cast<double>(std::uint64_t{1} << (i / 16)) * (17.0 + static_cast<double>(i % 16)) / 16.0;
      }
    }
    return 0;
  }
  double worst_us() const { return static_cast<double>(worst_ns_) / 1000; }
  std::uint64_t count() const { return count_; }

 private:
  std::array<std::uint32_t, 24 * 16> buckets_{};
  std::uint64_t count_ = 0;
  std::int64_t worst_ns_ = 0;
};

struct StageTimes {
  TimeHistogram poses, shape, touch, registers, frame;  ///< frame: all stages together
  /// A table with p50, p99 and worst in microseconds.
  std::string table() const;
};

/// Times the stages of one frame, each from the end of the one before.
class StageClock {
 public:
  /// `counts`: false where there is no frame to time.
  explicit StageClock(bool counts) : counts_(counts) {}
  void lap(TimeHistogram& stage) {
    const std::int64_t now_ns = steady_now_ns();
    if (counts_) stage.add(now_ns - last_ns_);
    last_ns_ = now_ns;
  }
  /// From the start to the last lap.
  void finish(TimeHistogram& frame) const {
    if (counts_) frame.add(last_ns_ - start_ns_);
  }

 private:
  const bool counts_;
  const std::int64_t start_ns_ = steady_now_ns();
  std::int64_t last_ns_ = start_ns_;
};

}  // namespace finsight
