#include "firmware/loop/stage_times.h"

#include <cstdio>

namespace finsight {

std::string StageTimes::table() const {
  std::string text = "stage      frames      p50 us      p99 us    worst us\n";
  const auto row = [&](const char* name, const TimeHistogram& times) {
    char line[96];
    std::snprintf(line, sizeof line, "%-9s %7llu %11.0f %11.0f %11.0f\n", name,
                  static_cast<unsigned long long>(times.count()), times.percentile_us(0.5), times.percentile_us(0.99),
                  times.worst_us());
    text += line;
  };
  row("poses", poses);
  row("shape", shape);
  row("touch", touch);
  row("registers", registers);
  row("frame", frame);
  return text;
}

}  // namespace finsight
