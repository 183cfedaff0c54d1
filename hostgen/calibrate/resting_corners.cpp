#include "hostgen/calibrate/resting_corners.h"

#include <Eigen/Core>
#include <vector>

#include "firmware/input_error.h"
#include "firmware/ports/camera.h"
#include "firmware/vision/observer.h"
#include "hostgen/util/common.h"

namespace finsight::host {

namespace {

/// Where the markers of a resting finger may seem to be, in place of a pack's prior over how touches move them: each is
/// stuck on a little askew, and a camera that sits askew moves all of them together.
struct RestPrior {
  using Covariance = Eigen::Matrix<float, kPoseDims, kPoseDims>;

  explicit RestPrior(const MountModel& mount) {
    Eigen::Matrix<double, kPoseDims, 6> of_camera;
    Eigen::Vector<double, kPoseDims> own_variance;
    for (int p = 0; p < kPlates; ++p) {
      const Eigen::Vector3d arm_mm =
          (mount.T_finger_marker[static_cast<std::size_t>(p)].translation() - mount.T_finger_camera.translation())
              .cast<double>();
      Eigen::Matrix3d turned;  // turn x arm, as a matrix
      turned << 0, arm_mm.z(), -arm_mm.y(), -arm_mm.z(), 0, arm_mm.x(), arm_mm.y(), -arm_mm.x(), 0;
      of_camera.block<6, 6>(6 * p, 0) << Eigen::Matrix3d::Identity() * kCameraMm, turned * kCameraRad,
          Eigen::Matrix3d::Zero(), Eigen::Matrix3d::Identity() * kCameraRad;
      own_variance.segment<6>(6 * p) << Eigen::Vector3d::Constant(kMarkerMm * kMarkerMm),
          Eigen::Vector3d::Constant(kMarkerRad * kMarkerRad);
    }
    covariance = (of_camera * of_camera.transpose()).cast<float>();
    covariance.diagonal() += own_variance.cast<float>();
    noise = own_variance.cwiseSqrt().cast<float>() / 10;
  }
  PlatePrior view() const {
    return {{mean.data(), kPoseDims}, {covariance.data(), kPoseDims * kPoseDims}, {noise.data(), kPoseDims}};
  }

  Eigen::Vector<float, kPoseDims> mean = Eigen::Vector<float, kPoseDims>::Zero(), noise;
  Covariance covariance;
};

}  // namespace

RestingCorners resting_corners(const std::filesystem::path& session, const MountModel& mount) {
  const SessionInfo info = read_session_info(session);
  check_markers(info, session, mount.marker_id, static_cast<double>(mount.marker_size_mm), "the finger spec");
  const RestPrior prior(mount);
  Observer observer(mount, prior.view(), info.lens);
  const auto camera = open_session_camera({.path = session, .recording = "", .recorded_speed = false}, info);
  RestingCornersSum sum;
  Frame frame;
  while (camera->next(frame, 0)) {
    if (interrupted()) throw Interrupted();
    observer.observe(frame, {}, true);
    sum.add(observer.corners());
  }
  if (!camera->error().empty()) throw InputError(session.string(), camera->error());
  return sum.mean(info.lens, session.string());
}

}  // namespace finsight::host
