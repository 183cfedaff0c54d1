// What both methods of estimating contact forces share. Only contact_forces*.cpp include it.
#pragma once

#include <ctime>

#include "hostgen/fem/contact_forces.h"
#include "hostgen/fem/plate_errors.h"
#include "hostgen/fem/plate_response.h"

namespace finsight::host {

class ProcessorTime {
 public:
  double seconds() const { return static_cast<double>(std::clock() - start_) / CLOCKS_PER_SEC; }

 private:
  std::clock_t start_ = std::clock();
};

struct ContactForceSolver::Problem {
  using BodyVector = PushedFinger::BodyVector;

  Problem(const FingerSpec& spec, const TetMesh& mesh, int candidates, int starts);

  const PushedFinger finger;
  const std::vector<FacePoint> candidates;
  Eigen::Matrix3Xd candidates_mm;
  PlateErrors errors;
  Equilibrium equilibrium;
  ElasticState state;

  // Of Gauss-Newton.
  std::vector<ElasticState> starts;
  Eigen::MatrixXd directions;  ///< of the plates' errors, in which forces change them
  PlateResponse tangent{finger.body, equilibrium};
  PushResponse response;   ///< of the tangent
  BodyVector step, force;  ///< the latest step, and the internal forces after it

  void prepare_starts(int points);
  void blend_starts();
  bool linearise();
  Eigen::VectorXd goal() const;
  bool chord(const ContactChoice& choice);
  void grow(const ContactChoice& choice, double times);
  bool follow(const PlatePoses& measured, double from, double to, ContactChoice& choice, Eigen::VectorXd& aim,
              const ProcessorTime& time, ContactForces& result);
  bool approach(const PlatePoses& measured, ContactChoice& choice, Eigen::VectorXd& aim, const ProcessorTime& time,
                ContactForces& result);
  bool iterate(ContactChoice& choice, Eigen::VectorXd& aim, const ProcessorTime& time, ContactForces& result);
};

}  // namespace finsight::host
