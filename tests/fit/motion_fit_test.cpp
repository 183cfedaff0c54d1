#include "hostgen/fit/motion_fit.h"

#include <doctest/doctest.h>

#include "firmware/geometry/so3.h"
#include "hostgen/render/virtual_finger.h"

using namespace finsight;
using namespace finsight::host;

namespace {

const FingerSpec& srm() {
  static const FingerSpec spec = read_finger_spec(FINSIGHT_SOURCE_DIR "/hostgen/fingers/srm.toml");
  return spec;
}

/// A row of holes in the middle of the face, and one further up.
std::vector<JigHole> holes() {
  const std::vector<JigHole> all = jig_holes(srm());
  return {all[3], all[4], all[5], all[7]};
}

const MotionBasis& basis() {
  static const MotionBasis solved = motion_basis(srm(), holes());
  return solved;
}

using Numbers = PoseVectorOf<double>;

/// Weights of 3 N on a finger of half as much stiffness again.
template <class Seen>
std::vector<SeenMotion> weigh(const std::vector<PressedPlace>& places, const Seen& seen) {
  std::vector<SeenMotion> motions;
  for (std::size_t hole = 0; hole < places.size(); ++hole) motions.push_back({hole, seen(places[hole].motion(2))});
  return motions;
}

/// How far corrected motions are from those of the pack's finger, at most; mm at an arm of 10 mm.
double off_mm(const MotionFit& fit, const std::vector<SeenMotion>& seen) {
  double worst = 0;
  for (std::size_t i = 0; i < seen.size(); ++i) {
    const Numbers off =
        seen[i].motion + fit.correction * seen[i].motion - basis().holes[seen[i].hole].motion(fit.force_n[i]);
    for (int p = 0; p < kPlates; ++p) {
      worst = std::max({worst, off.segment<3>(6 * p).norm(), 10 * off.segment<3>(6 * p + 3).norm()});
    }
  }
  return worst;
}

double amount(const MotionFit& fit, const std::string& name) {
  for (std::size_t k = 0; k < basis().deviations.size(); ++k) {
    if (basis().deviations[k].name == name) return fit.amount[k];
  }
  FAIL("no deviation is called " << name);
  return 0;
}

}  // namespace

TEST_CASE("motion fit: the pack's own finger is left as it is, and its forces are found") {
  const MotionFit fit = fit_motions(basis(), weigh(basis().holes, [](const Numbers& motion) { return motion; }));
  CHECK(fit.correction.norm() < 0.01);
  for (const double force_n : fit.force_n) CHECK(force_n == doctest::Approx(2).epsilon(0.02));
}

TEST_CASE("motion fit: a camera that is turned against the finger is turned back") {
  const Eigen::Matrix3d R = so3_exp(Eigen::Vector3d(0.005, -0.015, 0.01));
  const std::vector<SeenMotion> seen = weigh(basis().holes, [&](const Numbers& motion) {
    Numbers turned;
    for (int k = 0; k < 2 * kPlates; ++k) turned.segment<3>(3 * k) = R * motion.segment<3>(3 * k);
    return turned;
  });
  const MotionFit none{.correction = MotionChange::Zero(), .amount = {}, .sigma = {}, .force_n = {2, 2, 2, 2}};
  const MotionFit fit = fit_motions(basis(), seen);
  CHECK(off_mm(none, seen) > 0.08);
  CHECK(off_mm(fit, seen) < 0.03);
}

TEST_CASE("motion fit: a finger with another wall moves as the pack's once it is fitted") {
  FingerStatics statics(with_walls(srm(), 0.2, 0, 0), make_mesh(with_walls(srm(), 0.2, 0, 0)));
  std::vector<PressedPlace> places;
  for (const JigHole& hole : holes()) places.emplace_back(statics, hole.contact_mm.cast<float>(), 6);
  const std::vector<SeenMotion> seen = weigh(places, [](const Numbers& motion) { return motion; });
  const MotionFit fit = fit_motions(basis(), seen);
  MotionFit none = fit;
  none.correction.setZero();
  CHECK(off_mm(fit, seen) < 0.4 * off_mm(none, seen));
  CHECK(amount(fit, "front wall thicker") == doctest::Approx(0.2).epsilon(0.5));
}

TEST_CASE("motion fit: one weight tells less than four") {
  const std::vector<SeenMotion> seen = weigh(basis().holes, [](const Numbers& motion) { return motion; });
  const MotionFit one = fit_motions(basis(), std::span(seen).first(1)), four = fit_motions(basis(), seen),
                  none = fit_motions(basis(), {});
  CHECK(none.correction.isZero());
  for (std::size_t k = 0; k < basis().deviations.size(); ++k) {
    CHECK(none.sigma[k] == doctest::Approx(basis().deviations[k].usual));
    CHECK(one.sigma[k] <= 1.001 * none.sigma[k]);
    CHECK(four.sigma[k] <= 1.001 * one.sigma[k]);
  }
}
