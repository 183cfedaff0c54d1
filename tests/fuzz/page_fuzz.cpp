// What the page's program parses of a request: the Host and Origin fields, and a body with settings. First byte: which.
#include <cstddef>
#include <cstdint>
#include <cstdlib>
#include <string>

#include "firmware/page/json_body.h"
#include "firmware/page/request_guard.h"
#include "firmware/page/settings_change.h"

using namespace finsight;
using namespace finsight::page;

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  if (size == 0) return 0;
  const std::string text(reinterpret_cast<const char*>(data) + 1, size - 1);
  if (data[0] % 2 == 0) {
    const PageSettings settings;
    Request request;
    request.method = "POST";
    request.host = text.substr(0, text.size() / 2);
    request.origin = text.substr(text.size() / 2);
    const auto refusal = check_request(request, settings);
    // Whatever is let through is of this device and of its own page.
    if (!refusal && (!is_own_host(request.host, {}) ||
                     (!request.origin.empty() && request.origin.find(request.host) == std::string::npos))) {
      std::abort();
    }
    return 0;
  }
  const nlohmann::json body = json_body(text);
  if (body.is_discarded()) return 0;
  SettingsWords words;
  const auto refusal = apply_settings(body, words);
  if (refusal && (refusal->status != 400 || refusal->reason.empty())) std::abort();
  if (refusal) return 0;
  for (std::size_t i = 0; i < words.control.size(); ++i) {
    const RegisterRow& row = control_row(kFirstSettingRegister + static_cast<int>(i));
    if (words.control[i] != 0 && (words.control[i] < row.lowest || words.control[i] > row.highest)) std::abort();
  }
  return 0;
}
