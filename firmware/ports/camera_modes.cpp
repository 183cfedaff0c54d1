#include "firmware/ports/camera_modes.h"

#include <cstdio>

namespace finsight {

namespace {

constexpr double kReached = 0.95;  // 59.94 is 60

std::string rate_text(double frames_per_second) {
  if (frames_per_second == 0) return "frame rate not told";
  char text[32];
  std::snprintf(text, sizeof text, "up to %.3g/s", frames_per_second);
  return text;
}

}  // namespace

std::optional<ChosenFormat> choose_format(std::span<const OfferedFormat> offered, double frames_per_second) {
  if (offered.empty()) return std::nullopt;
  const auto reaches = [&](const OfferedFormat& format) {
    return format.most_frames_per_second == 0 || format.most_frames_per_second >= kReached * frames_per_second;
  };
  const auto is_better = [&](const OfferedFormat& a, const OfferedFormat& b) {
    if (reaches(a) != reaches(b)) return reaches(a);
    if (!reaches(a) && a.most_frames_per_second != b.most_frames_per_second) {
      return a.most_frames_per_second > b.most_frames_per_second;
    }
    return a.layout.rank < b.layout.rank;
  };
  ChosenFormat chosen;
  for (std::size_t i = 1; i < offered.size(); ++i) {
    if (is_better(offered[i], offered[chosen.index])) chosen.index = i;
  }
  const OfferedFormat& best = offered[chosen.index];
  chosen.why = best.name + ", " + rate_text(best.most_frames_per_second) + ": ";
  if (!reaches(best)) {
    chosen.why += "the fastest, none reaches the wanted rate";
  } else if (offered.size() == 1) {
    chosen.why += "the only one";
  } else {
    chosen.why += "keeps the picture best of those that reach the wanted rate";
  }
  if (best.layout.is_jpeg) chosen.why += "; compressed, which costs accuracy";
  for (std::size_t i = 0; i < offered.size(); ++i) {
    if (i == chosen.index) continue;
    chosen.why += "; not " + offered[i].name + " (" + rate_text(offered[i].most_frames_per_second) + ")";
  }
  return chosen;
}

bool FrameRateMeter::note(std::uint32_t sequence, std::int64_t exposure_ns) {
  const auto frames = static_cast<std::int32_t>(sequence - first_sequence_);
  const std::int64_t time_ns = exposure_ns - first_ns_;
  const bool is_complete = has_first_ && frames > 0 && time_ns >= kWindowNs;
  if (is_complete) rate_hz_ = static_cast<double>(frames) * 1e9 / static_cast<double>(time_ns);
  if (is_complete || !has_first_ || frames < 0 || time_ns < 0) {
    has_first_ = true;
    first_sequence_ = sequence;
    first_ns_ = exposure_ns;
  }
  return is_complete;
}

}  // namespace finsight
