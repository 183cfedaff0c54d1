// What options of several commands share.
#pragma once

#include <CLI/CLI.hpp>
#include <cmath>
#include <cstdlib>
#include <string>

namespace finsight::host {

/// CLI::Range for floating-point numbers, which lets NaN pass.
inline CLI::Validator between(double low, double high) {
  const CLI::Range range(low, high);
  const auto check = [range](std::string& text) {
    return std::isnan(std::strtod(text.c_str(), nullptr)) ? "found " + text + ", expected a number" : range(text);
  };
  return {check, range.get_description()};
}

}  // namespace finsight::host
