// From the bytes of a Modbus request to those of its response, for every transport.
#pragma once

#include <chrono>
#include <cstddef>
#include <cstdint>
#include <span>

#include "firmware/modbus/control.h"
#include "firmware/types.h"

namespace finsight {

inline constexpr std::size_t kMaxPdu = 253;  ///< function code and data (Modbus Application Protocol, section 4.1)

/// What a request is answered from: the latest measurements, and commands and settings.
struct DeviceView {
  RegisterImage image;
  Control& control;
  std::int64_t now_ns;                ///< steady clock; the age in the image is that at this time
  std::int64_t stalled_since_ns = 0;  ///< of the image, if it is stalled
};
/// For a client's thread: the latest image with its age; marked as stalled if it is too old.
inline DeviceView view_now(TripleBuffer<RegisterImage>& latest, Control& control) {
  DeviceView view{latest.read(), control, steady_now_ns()};
  set_age(view.image, view.now_ns);
  view.stalled_since_ns = control.stalled_since_ns(view.image, view.now_ns);
  if (view.stalled_since_ns != 0) mark_stalled(view.image, control.settings_copy());
  return view;
}

/// Carries out functions 3, 4, 6, 16 and 23 and identification (43/14). Other functions and invalid requests get the
/// exception that the Modbus Application Protocol V1.1b3 names. Returns the length of the response, 2 or more.
/// `request` has 1 to 253 bytes of any content.
std::size_t answer_request(std::span<const std::uint8_t> request, const DeviceView& device, const ClientAccess& access,
                           std::span<std::uint8_t, kMaxPdu> reply);

}  // namespace finsight
