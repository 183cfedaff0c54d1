// From the bytes of a Modbus request to those of its response, for every transport.
#pragma once

#include <chrono>
#include <cstddef>
#include <cstdint>
#include <deque>
#include <span>

#include "firmware/modbus/control.h"
#include "firmware/types.h"

namespace finsight {

inline constexpr std::size_t kMaxPdu = 253;  ///< function code and data (Modbus Application Protocol, section 4.1)

class ServedFingers;

/// What a request to one finger is answered from: the latest measurements, and commands and settings.
struct DeviceView {
  RegisterImage image;
  Control& control;
  std::int64_t now_ns;                ///< steady clock; the age in the image is that at this time
  std::int64_t stalled_since_ns = 0;  ///< of the image, if it is stalled
  ServedFingers* all = nullptr;       ///< the device's fingers; null: this one alone
};
/// For a client's thread: the latest image with its age; marked as stalled if it is too old.
inline DeviceView view_now(TripleBuffer<RegisterImage>& latest, Control& control,
                           std::int64_t now_ns = steady_now_ns()) {
  DeviceView view{latest.read(), control, now_ns};
  set_age(view.image, view.now_ns);
  view.stalled_since_ns = control.stalled_since_ns(view.image, view.now_ns);
  if (view.stalled_since_ns != 0) mark_stalled(view.image, control.settings_copy());
  return view;
}

/// The fingers of a device as one client's thread sees them. Finger i has the unit id that is i above the first one's.
class ServedFingers {
 public:
  /// `first`: what each serves until something is published for it. The controls must outlive it.
  ServedFingers(std::span<Control* const> controls, const RegisterImage& first) {
    for (Control* control : controls) fingers_.emplace_back(*control, first);
  }
  std::size_t count() const { return fingers_.size(); }
  /// Wait-free, from one thread at a time for each finger.
  void publish(std::size_t finger, const RegisterImage& image) noexcept { fingers_[finger].latest.publish(image); }
  // For the client's thread.
  Control& control(std::size_t finger) const { return fingers_[finger].control; }
  DeviceView view(std::size_t finger, std::int64_t now_ns = steady_now_ns()) {
    DeviceView view = view_now(fingers_[finger].latest, fingers_[finger].control, now_ns);
    view.all = this;
    return view;
  }

 private:
  struct Finger {
    Finger(Control& its_control, const RegisterImage& first) : control(its_control), latest(first) {}
    Control& control;
    TripleBuffer<RegisterImage> latest;
  };
  std::deque<Finger> fingers_;  // its elements stay where they are
};

/// Carries out functions 3, 4, 6, 16 and 23 and identification (43/14). Other functions and invalid requests get the
/// exception that the Modbus Application Protocol V1.1b3 names. Returns the length of the response, 2 or more.
/// `request` has 1 to 253 bytes of any content.
std::size_t answer_request(std::span<const std::uint8_t> request, const DeviceView& device, const ClientAccess& access,
                           std::span<std::uint8_t, kMaxPdu> reply);

}  // namespace finsight
