// Tiers newton and map+newton: Newton steps towards the shape of least energy.
#pragma once

#include <optional>
#include <vector>

#include "firmware/shape/map_tier.h"
#include "firmware/shape/newton.h"

namespace finsight {

class NewtonTier final : public ShapeTier {
 public:
  /// With tier kMapAndNewton every frame starts from the map's shape, with kNewton from the last frame's.
  NewtonTier(const ShapeParts& parts, const ShapeSettings& settings);

  /// Follows the plates from the last frame's shape. Starts over from the map's shape when there is no last shape,
  /// after a jump of the plates, after a solve that failed, and where the map's shape costs clearly less energy; tries
  /// a solve from rest after a rough frame, so that a wrong minimum does not last. Falls back to the map's shape,
  /// marked, when the solve fails all the same. At most 2 NewtonSolver::kMaxFactorisations factorisations.
  void solve(const PlateMotions& plates, const PoseVector& motion, bool, FingerShape& shape) override;
  std::span<const float> node_mm() const override { return solver_.node_mm(); }
  void reset() override { last_plates_.reset(); }

 private:
  bool take_steps(const PlateMotions& plates, FingerShape& shape);
  void try_from_rest(const PlateMotions& plates, FingerShape& shape);
  bool is_wrong_minimum() const;

  const bool follows_last_;
  const int factorisations_, chord_steps_;
  NewtonSolver<float> solver_;  // holds the published shape
  MapShape map_;
  std::span<const float> map_mm_;  // the map's shape of this frame
  std::vector<float> kept_mm_;     // the present shape while another is tried
  std::optional<PlateMotions> last_plates_;
  bool was_rough_ = false;  // the last frame needed more than its schedule, failed or strained the finger too much
};

}  // namespace finsight
