#include "hostgen/fit/pack_error.h"

#include <algorithm>
#include <cmath>

#include "firmware/touch/touch_stage.h"
#include "hostgen/fit/pressed_place.h"
#include "hostgen/util/common.h"

namespace finsight::host {

namespace {

constexpr int kPushes = 10;
constexpr double kBeyondRange = 1.5;  // a soft finger bends under a force as its pack's does under more

std::vector<PackError> errors_at(const PressedPlace& place, const Vec3f& hole_mm, TouchStage& stage) {
  std::vector<PackError> errors;
  for (int i = 1; i <= kPushes; ++i) {
    const double force_n = place.highest_n() * i / kPushes;
    PlatePoses poses{.plates = place.plates(force_n), .quality = Quality::kFresh};
    poses.seen.fill(true);
    const Touch touch = stage.locate(poses);
    if (touch.quality != Quality::kFresh || !(touch.force_n > 0)) continue;
    const auto pack_force_n = static_cast<double>(touch.force_n);
    if (!errors.empty() && pack_force_n <= errors.back().pack_force_n) continue;
    errors.push_back({pack_force_n, touch.point_mm - hole_mm, std::log(force_n / pack_force_n)});
  }
  return errors;
}

}  // namespace

std::vector<std::vector<PackError>> pack_errors(const FingerSpec& spec, const Model& model,
                                                const std::vector<JigHole>& holes) {
  FingerStatics statics(spec, make_mesh(spec));
  TouchStage stage(model);
  Progress progress("the pack's own errors at the holes", holes.size());
  std::vector<std::vector<PackError>> errors;
  for (const JigHole& hole : holes) {
    const Vec3f hole_mm = hole.contact_mm.cast<float>();
    const PressedPlace place(statics, hole_mm, kBeyondRange * spec.force_n[1]);
    errors.push_back(errors_at(place, hole_mm, stage));
    progress.advance();
  }
  return errors;
}

PackError pack_error_at(std::span<const PackError> pushes, double pack_force_n) {
  if (pushes.empty()) return {};
  const auto above = std::ranges::lower_bound(pushes, pack_force_n, {}, &PackError::pack_force_n);
  if (above == pushes.begin()) return pushes.front();
  if (above == pushes.end()) return pushes.back();
  const PackError &right = *above, &left = *std::prev(above);
  const double share = (pack_force_n - left.pack_force_n) / (right.pack_force_n - left.pack_force_n);
  return {pack_force_n, left.touch_mm + static_cast<float>(share) * (right.touch_mm - left.touch_mm),
          left.log_force + share * (right.log_force - left.log_force)};
}

}  // namespace finsight::host
