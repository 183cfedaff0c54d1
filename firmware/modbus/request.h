// What a Modbus request gets. Bytes in, bytes out: the same for every transport.
#pragma once

#include <chrono>
#include <cstddef>
#include <cstdint>
#include <span>

#include "firmware/modbus/control.h"
#include "firmware/types.h"

namespace finsight {

inline constexpr std::size_t kLargestPdu = 253;  ///< function code and data (Modbus Application Protocol, section 4.1)

/// What a request is answered from: the latest block, and commands and settings.
struct DeviceView {
  RegisterImage image;
  Control& control;
  std::int64_t now_ns;  ///< steady clock; the image's age is that of this moment
};
inline DeviceView view_now(TripleBuffer<RegisterImage>& latest, Control& control) {
  DeviceView view{latest.read(), control, steady_now_ns()};
  set_age(view.image, view.now_ns);
  if (control.is_stalled(view.image, view.now_ns)) mark_stalled(view.image);
  return view;
}

/// Carries out functions 3, 4, 6, 16 and 23 and identification (43/14); anything else, and what is wrong in those, gets
/// the exception that the Modbus Application Protocol V1.1b3 names. Returns the length of the reply, from 2 on.
/// `request` has 1...253 bytes of any content.
std::size_t answer_request(std::span<const std::uint8_t> request, const DeviceView& device, const ClientAccess& access,
                           std::span<std::uint8_t, kLargestPdu> reply);

}  // namespace finsight
