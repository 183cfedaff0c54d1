#include "firmware/page/json_body.h"

#include <stdexcept>

namespace finsight::page {

using nlohmann::json;

namespace {

constexpr int kDeepest = 8;

}  // namespace

json json_body(const std::string& body) {
  const auto too_deep = [](int depth, json::parse_event_t, json&) {
    if (depth > kDeepest) throw std::length_error("too deep");
    return true;
  };
  try {
    return json::parse(body, too_deep, false);
  } catch (const std::length_error&) {
    return json(json::value_t::discarded);
  }
}

}  // namespace finsight::page
