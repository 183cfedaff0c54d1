// The service's log: one line per message, to standard error.
#pragma once

#include <cstdio>
#include <string>

namespace finsight {

inline void log_message(const std::string& message) { std::fprintf(stderr, "finsightd: %s\n", message.c_str()); }

}  // namespace finsight
