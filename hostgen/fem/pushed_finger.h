// A finger under pushes on its front face: loads, equilibria, and what is read from them.
#pragma once

#include <Eigen/Core>
#include <vector>

#include "hostgen/fem/equilibrium.h"
#include "hostgen/fem/quadratic_mesh.h"

namespace finsight::host {

/// A force along the inward normal of the undeformed front face, at a point of it (z is taken from the face).
struct FaceForce {
  Vec3f point_mm = Vec3f::Zero();
  double force_n = 0;
};

/// Per tet of the mesh: the finger's material, stiffened in the plates.
std::vector<NeoHookean> tet_materials(const FingerSpec& spec, const std::vector<int>& region);

/// The rotation nearest to what moves the points `rest` to `now`, whatever else they do (least squares; Kabsch 1976).
Eigen::Matrix3d rigid_rotation(const std::vector<Eigen::Vector3d>& rest, const std::vector<Eigen::Vector3d>& now);

/// What all states of one finger share: mesh, material, symbolic factorisation. Constant after construction: one
/// serves all threads.
class PushedFinger {
 public:
  /// A vector of the ElasticBody.
  using BodyVector = std::vector<double>;

  /// `check_in`: see plan_cholesky().
  PushedFinger(const FingerSpec& spec, const TetMesh& mesh, Element element = Element::kSelective,
               const CheckIn& check_in = {});

  const FingerSpec spec;
  const QuadraticMesh mesh;
  const ElasticBody body;
  const ElasticState rest;

  FacePoint at(const Eigen::Vector2d& place_mm, Side side = Side::kFront) const {
    return side_point(mesh, side, place_mm);
  }
  /// `count` points spread evenly over the part of the face that is touched.
  std::vector<FacePoint> spread_points(int count) const;
  /// The nearest place of that part.
  Eigen::Vector2d inside(const Eigen::Vector2d& place_mm) const;

  BodyVector zero() const { return BodyVector(body.vector_size()); }
  void add_push(const FacePoint& at, double force_n, BodyVector& load) const {
    add_force(at, force_n * at.inward, load);
  }
  /// A force of any direction, in the finger frame.
  void add_force(const FacePoint& at, const Eigen::Vector3d& force_n, BodyVector& load) const;
  /// Adds the weight of all that is not fixed: of things that fall with `g` (times 9.80665 m/s^2), in the finger frame.
  void add_weight(const Eigen::Vector3d& g, BodyVector& load) const;
  /// Of everything, fixed nodes included.
  double mass_kg() const;
  /// Equilibrium under `load`, from rest, in ever more even steps. False if there is none.
  bool press(Equilibrium& solver, const BodyVector& load, ElasticState& answer) const;

  Eigen::Vector3d displacement(const ElasticState& state, int node) const;
  Eigen::Vector3d displacement(const ElasticState& state, const FacePoint& at) const;
  PlatePoses plates(const ElasticState& state) const;
  /// [3 * mesh nodes] of the mesh's (corner) nodes, mm.
  std::vector<double> node_displacement_mm(const ElasticState& state) const;
  /// The same for all nodes of the quadratic mesh, mesh nodes first.
  std::vector<double> quadratic_displacement_mm(const ElasticState& state) const;
};

}  // namespace finsight::host
