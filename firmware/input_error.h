// The one exception for bad input: a pack, settings, session, spec, CSV or mesh that cannot be used.
#pragma once

#include <stdexcept>
#include <string>

namespace finsight {

/// Says which file, which field in it, what was found there and what was expected. Thrown only before the frame loop.
class InputError : public std::runtime_error {
 public:
  InputError(const std::string& file, const std::string& field, const std::string& found, const std::string& expected)
      : std::runtime_error(file + ": " + field + ": found " + found + ", expected " + expected) {}
  InputError(const std::string& file, const std::string& what) : std::runtime_error(file + ": " + what) {}
};

}  // namespace finsight
