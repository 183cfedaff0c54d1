#include "firmware/model/plate_prior.h"

namespace finsight {

void complete_from_prior(const PlatePrior& prior, const std::array<bool, kPlates>& seen, PoseVector& numbers) {
  if (seen[0] && seen[1] && seen[2]) return;
  // Conditioning on the seen numbers one after the other needs no factorisation, only rank-1 updates of fixed size.
  // Double, because the variances of millimetres and radians lie six orders of magnitude apart.
  using Matrix = Eigen::Matrix<double, kPoseDims, kPoseDims, Eigen::RowMajor>;
  using Vector = PoseVectorOf<double>;
  Matrix covariance =
      Eigen::Map<const Eigen::Matrix<float, kPoseDims, kPoseDims, Eigen::RowMajor>>(prior.covariance.data())
          .cast<double>();
  Vector mean = Eigen::Map<const PoseVector>(prior.mean.data()).cast<double>();
  for (int i = 0; i < kPoseDims; ++i) {
    if (!seen[static_cast<std::size_t>(i / 6)]) continue;
    const Vector row = covariance.row(i).transpose();
    const Vector gain = row / row[i];
    mean += gain * (static_cast<double>(numbers[i]) - mean[i]);
    covariance.noalias() -= gain * row.transpose();
  }
  for (int i = 0; i < kPoseDims; ++i) {
    if (!seen[static_cast<std::size_t>(i / 6)]) numbers[i] = static_cast<float>(mean[i]);
  }
}

void complete_from_prior(const PlatePrior& prior, PlatePoses& poses) {
  PoseVector numbers = pose_vector(poses);
  complete_from_prior(prior, poses.seen, numbers);
  for (std::size_t p = 0; p < kPlates; ++p) {
    if (poses.seen[p]) continue;
    poses.plates[p].displacement_mm = numbers.segment<3>(6 * static_cast<int>(p));
    poses.plates[p].rotation_rad = numbers.segment<3>(6 * static_cast<int>(p) + 3);
  }
}

}  // namespace finsight
