// Whether a held object slips, turns or gives way: touch and deformation are compared with what they were when the grip
// came to rest.
#pragma once

#include "firmware/types.h"

namespace finsight {

class GripWatch {
 public:
  static constexpr int kFrames = 30;  ///< half a second at 60 frames/s: the grip must be steady for so long
  /// Of what is compared with the reference, a mean over about so many frames. A single frame's noise is no change.
  static constexpr float kMeanFrames = 8;
  static constexpr float kLeastDeviation_mm = 0.01F;  ///< of the deformation: one count of its register

  /// To be called with every frame whose poses are fresh. True: in this frame the grip has changed. That is told once;
  /// the next comparison is with the grip that it changes to. `changes`: how many radii of the touch, or deviations of
  /// the deformation's noise, are a change; 0: never. Never allocates.
  bool update(bool in_contact, const Touch& touch, float deformation_mm, float changes);
  /// There is a reference to compare with.
  bool is_steady() const { return is_steady_; }
  void reset() { *this = GripWatch(); }

 private:
  /// Sums over a part of the frames that become the reference.
  struct Sums {
    int frames = 0, touches = 0;
    double deformation = 0, deformation_sq = 0;
    Vec3f point_mm = Vec3f::Zero();

    void add(const Touch& touch, float deformation_mm);
    double mean() const { return deformation / frames; }
    double variance() const;
    Vec3f mean_point() const { return point_mm / static_cast<float>(touches); }
  };

  void collect(const Touch& touch, float deformation_mm);
  void take_reference();
  bool has_changed(const Touch& touch, float deformation_mm, float changes);

  Sums first_, second_;  ///< halves of the window
  bool is_steady_ = false, has_touch_ = false;
  float deformation_mm_ = 0, deviation_mm_ = 0;  ///< of the reference
  Vec3f point_mm_ = Vec3f::Zero();
  float recent_deformation_mm_ = 0;
  Vec3f recent_point_mm_ = Vec3f::Zero();
};

}  // namespace finsight
