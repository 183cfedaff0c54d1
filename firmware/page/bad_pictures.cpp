#include "firmware/page/bad_pictures.h"

#include "firmware/modbus/register_table.h"
#include "firmware/page/picture.h"

namespace finsight::page {

namespace {

using nlohmann::json;

constexpr std::int64_t kStands_ns = 3 * kNsPerS / 10;  // what passes sooner is no more than a passing shadow
constexpr std::int64_t kAgain_ns = 30 * kNsPerS, kFresh_ns = kNsPerS;

const char* name_of(std::uint16_t fault) {
  for (const NamedValue& value : row_named("fault").values) {
    if (value.value == fault) return value.name;
  }
  return "unknown";
}

}  // namespace

bool BadPictures::is_kept(std::uint16_t fault, unsigned hidden, std::int64_t now_ns) {
  const std::lock_guard guard(mutex_);
  for (const Kept& kept : kept_) {
    if (kept.fault == fault && kept.hidden == hidden && now_ns - kept.at_ns < kAgain_ns) return true;
  }
  return false;
}

void BadPictures::look(Device& device, std::int64_t now_ns) {
  const auto frame = device.frame();
  if (!frame || !frame->has_image || now_ns - frame->published_ns > kFresh_ns) return;
  const std::uint16_t fault = frame->words[address_of("fault")];
  unsigned hidden = 0;
  for (std::size_t p = 0; p < kPlates; ++p) hidden |= frame->plate_seen[p] ? 0U : 1U << p;
  if (fault == 0 && hidden == 0) {
    bad_since_ns_ = 0;
    wanted_ = 0;
    return;
  }
  if (bad_since_ns_ == 0) bad_since_ns_ = now_ns;
  if (now_ns - bad_since_ns_ < kStands_ns || is_kept(fault, hidden, now_ns)) return;
  if (wanted_ == 0) wanted_ = frame->number;
  device.watch();
  const auto picture = device.picture();
  if (!picture || picture->number < wanted_) return;
  wanted_ = 0;
  std::string jpeg = jpeg_of(*picture);
  const std::lock_guard guard(mutex_);
  kept_.push_front({next_id_++, now_ns, fault, hidden, std::move(jpeg)});
  if (kept_.size() > kMost) kept_.pop_back();
}

json BadPictures::list(std::int64_t now_ns) {
  const std::lock_guard guard(mutex_);
  json list = json::array();
  for (const Kept& kept : kept_) {
    json hidden = json::array();
    for (std::size_t p = 0; p < kPlates; ++p) {
      if (kept.hidden >> p & 1U) hidden.push_back(kPlateNames[p]);
    }
    list.push_back({{"id", kept.id},
                    {"ago_s", (now_ns - kept.at_ns) / kNsPerS},
                    {"fault", name_of(kept.fault)},
                    {"hidden", hidden}});
  }
  return list;
}

std::string BadPictures::jpeg(int id) {
  const std::lock_guard guard(mutex_);
  for (const Kept& kept : kept_) {
    if (kept.id == id) return kept.jpeg;
  }
  return "";
}

}  // namespace finsight::page
