// One line for whoever reads the service's log.
#pragma once

#include <cstdio>
#include <string>

namespace finsight {

inline void log_message(const std::string& message) { std::fprintf(stderr, "finsightd: %s\n", message.c_str()); }

}  // namespace finsight
