// Plots by Debian's gnuplot, run as a program.
#pragma once

#include <cstdio>
#include <filesystem>
#include <string>

namespace finsight::host {

/// One SVG; it appears under its name when finish() was called. Throws std::runtime_error if gnuplot is missing or
/// fails.
class Gnuplot {
 public:
  explicit Gnuplot(const std::filesystem::path& svg);
  ~Gnuplot();
  Gnuplot(const Gnuplot&) = delete;
  Gnuplot& operator=(const Gnuplot&) = delete;
  void line(const std::string& command);
  void finish();

 private:
  std::filesystem::path target_, temporary_;
  std::FILE* pipe_ = nullptr;
};

}  // namespace finsight::host
