// The JSON of requests.
#pragma once

#include <nlohmann/json.hpp>
#include <string>

namespace finsight::page {

/// The JSON of a request's body; discarded (is_discarded()) if it is none or is nested too deeply.
nlohmann::json json_body(const std::string& body);

}  // namespace finsight::page
