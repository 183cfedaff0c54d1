// The last pictures in which something was wrong, kept for whoever looks later.
#pragma once

#include <cstdint>
#include <deque>
#include <mutex>
#include <nlohmann/json.hpp>
#include <string>

#include "firmware/page/device.h"

namespace finsight::page {

/// Thread-safe. Asks for pictures only while something is wrong.
class BadPictures {
 public:
  static constexpr std::size_t kMost = 8;

  /// Looks at the newest frame and keeps a picture of what is wrong, once for each kind of it in half a minute. To be
  /// called many times a second.
  void look(Device& device, std::int64_t now_ns);
  /// [{"id", "ago_s", "fault", "hidden": ["low"]}]; the newest first.
  nlohmann::json list(std::int64_t now_ns);
  std::string jpeg(int id);  ///< empty: there is none of that number

 private:
  struct Kept {
    int id = 0;
    std::int64_t at_ns = 0;
    std::uint16_t fault = 0;
    unsigned hidden = 0;  ///< bits: plates
    std::string jpeg;
  };
  bool is_kept(std::uint16_t fault, unsigned hidden, std::int64_t now_ns);

  std::int64_t bad_since_ns_ = 0;  ///< 0: all is well
  std::uint64_t wanted_ = 0;       ///< a picture of this frame or a later one; 0: none
  std::mutex mutex_;               ///< over what follows
  std::deque<Kept> kept_;          ///< the newest first
  int next_id_ = 1;
};

}  // namespace finsight::page
