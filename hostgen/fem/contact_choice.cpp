// "Gain" of a place: by how much a push there lowers the misfit if the other pushes are adjusted to it.
#include "hostgen/fem/contact_choice.h"

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <Eigen/QR>
#include <algorithm>
#include <cmath>
#include <vector>

#include "hostgen/fem/nonnegative_least_squares.h"

namespace finsight::host {

namespace {

using Eigen::Index;
using Eigen::Matrix2Xd;
using Eigen::MatrixXd;
using Eigen::VectorXd;

constexpr Index kMaxContacts = 5;
// chi-squared at 99 % for three numbers (two coordinates and a force), and at 95 % for the two coordinates.
constexpr double kWorthAContact = 11.34, kAsGood = 5.99;
constexpr double kEqual = 0.01;  // misfits nearer than this are equal
constexpr int kMaxMoves = 20, kMaxRefinements = 10, kHalvings = 4;
constexpr double kLongestMove_mm = 3;    // of one refinement
constexpr double kDifference_mm = 0.25;  // for derivatives with respect to position

MatrixXd responses(const PushResponse& response, const Matrix2Xd& places_mm) {
  MatrixXd columns(response.at_grid.rows(), places_mm.cols());
  for (Index i = 0; i < places_mm.cols(); ++i) columns.col(i) = response.at(places_mm.col(i));
  return columns;
}

/// What pushes `others` (columns) cannot explain: of the goal, and of every column of `J`.
struct Unexplained {
  VectorXd product, square;  ///< per column of J: with the goal, and with itself

  Unexplained(const MatrixXd& J, const VectorXd& goal, const MatrixXd& others) {
    const MatrixXd left = beside(others, J);
    product = left.transpose() * goal;
    square = left.colwise().squaredNorm();
    // A place that has the same effect as the others leaves only rounding errors.
    square = (square.array() > 1e-9 * J.colwise().squaredNorm().transpose().array()).select(square, 0.0);
  }
  static MatrixXd beside(const MatrixXd& others, const MatrixXd& J) {
    if (others.cols() == 0) return J;
    const Eigen::HouseholderQR<MatrixXd> qr(others);
    const MatrixXd Q = qr.householderQ() * MatrixXd::Identity(J.rows(), others.cols());
    return J - Q * (Q.transpose() * J);
  }
  double force(Index j) const { return square[j] > 0 ? std::max(0.0, product[j]) / square[j] : 0; }
  double gain(Index j) const { return force(j) * std::max(0.0, product[j]); }
  Index best() const {
    Index best = 0;
    for (Index j = 1; j < product.size(); ++j) {
      if (gain(j) > gain(best)) best = j;
    }
    return best;
  }
};

Matrix2Xd without(const Matrix2Xd& places, Index index) {
  Matrix2Xd others(2, places.cols() - 1);
  others << places.leftCols(index), places.rightCols(places.cols() - 1 - index);
  return others;
}

Matrix2Xd with(const Matrix2Xd& places, const Eigen::Vector2d& place) {
  Matrix2Xd more(2, places.cols() + 1);
  more << places, place;
  return more;
}

/// The forces at these places that explain the goal best; places that would have to pull are left out.
ContactChoice contacts_at(const PushResponse& response, const VectorXd& goal, const Matrix2Xd& places) {
  ContactChoice choice;
  choice.misfit = goal.squaredNorm();
  if (places.cols() == 0) return choice;
  const MatrixXd columns = responses(response, places);
  const VectorXd force = nonnegative_least_squares(columns, goal);
  choice.misfit = (columns * force - goal).squaredNorm();
  std::vector<Index> kept;
  for (Index i = 0; i < force.size(); ++i) {
    if (force[i] > 0) kept.push_back(i);
  }
  choice.place_mm = places(Eigen::all, kept);
  choice.force_n = force(kept);
  return choice;
}

/// [numbers, 3 * contacts] derivatives of what the contacts cause with respect to their x, y and force.
MatrixXd derivatives(const PushResponse& response, const ContactChoice& choice) {
  MatrixXd M(response.at_grid.rows(), 3 * choice.force_n.size());
  for (Index i = 0; i < choice.force_n.size(); ++i) {
    const Eigen::Vector2d place = choice.place_mm.col(i);
    for (Index axis = 0; axis < 2; ++axis) {
      const Eigen::Vector2d step = kDifference_mm * Eigen::Vector2d::Unit(axis);
      M.col(3 * i + axis) =
          choice.force_n[i] * (response.at(place + step) - response.at(place - step)) / (2 * kDifference_mm);
    }
    M.col(3 * i + 2) = response.at(place);
  }
  return M;
}

/// Where nothing is known (off the face), a standard deviation of 30 mm is assumed.
constexpr double kMin = 1.0 / (30 * 30);

/// Inverse of the contacts' information.
MatrixXd covariance(const MatrixXd& M) {
  return (M.transpose() * M + kMin * MatrixXd::Identity(M.cols(), M.cols())).inverse();
}

/// Moves every contact in turn to the place of the grid where it explains most, until no contact moves any more.
ContactChoice moved(const PushResponse& response, const VectorXd& goal, ContactChoice choice) {
  for (int move = 0; move < kMaxMoves; ++move) {
    bool better = false;
    for (Index i = 0; i < choice.force_n.size() && !better; ++i) {
      const Matrix2Xd others = without(choice.place_mm, i);
      const Index best = Unexplained(response.at_grid, goal, responses(response, others)).best();
      ContactChoice next = contacts_at(response, goal, with(others, response.grid_mm.col(best)));
      better = next.misfit < choice.misfit - kEqual;
      if (better) choice = std::move(next);
    }
    if (!better) break;
  }
  return choice;
}

/// The two places of a part of the grid where pushes, beside `others`, explain most together.
Matrix2Xd best_pair(const PushResponse& response, const VectorXd& goal, const Matrix2Xd& others) {
  constexpr Index kEvery = 3;
  const Matrix2Xd places = response.grid_mm(Eigen::all, Eigen::seq(0, Eigen::last, kEvery));
  const MatrixXd J = response.at_grid(Eigen::all, Eigen::seq(0, Eigen::last, kEvery));
  const MatrixXd left = Unexplained::beside(responses(response, others), J);
  const VectorXd product = left.transpose() * goal;
  const MatrixXd square = left.transpose() * left;
  double best_gain = -1;
  Index best_a = 0, best_b = 0;
  for (Index b = 0; b < square.cols(); ++b) {
    for (Index a = 0; a < b; ++a) {
      const double determinant = square(a, a) * square(b, b) - square(a, b) * square(a, b);
      const double force_a = product[a] * square(b, b) - product[b] * square(a, b);
      const double force_b = product[b] * square(a, a) - product[a] * square(a, b);
      if (force_a <= 0 || force_b <= 0 || determinant <= 1e-6 * square(a, a) * square(b, b)) continue;
      const double gain = (force_a * product[a] + force_b * product[b]) / determinant;
      if (gain <= best_gain) continue;
      best_gain = gain;
      best_a = a;
      best_b = b;
    }
  }
  Matrix2Xd pair(2, 2);
  pair << places.col(best_a), places.col(best_b);
  return pair;
}

/// Adds the best place to the others; and, since two pushes may have looked like one between them, also tries to put
/// two in the place of each.
ContactChoice with_one_more(const PushResponse& response, const VectorXd& goal, const ContactChoice& choice) {
  const auto settled = [&](const Matrix2Xd& places) {
    return refined_contacts(response, goal, moved(response, goal, contacts_at(response, goal, places)));
  };
  const Index best_place = Unexplained(response.at_grid, goal, responses(response, choice.place_mm)).best();
  ContactChoice best = settled(with(choice.place_mm, response.grid_mm.col(best_place)));
  for (Index i = 0; i < choice.force_n.size(); ++i) {
    const Matrix2Xd others = without(choice.place_mm, i), pair = best_pair(response, goal, others);
    ContactChoice split = settled(with(with(others, pair.col(0)), pair.col(1)));
    if (split.misfit < best.misfit) best = std::move(split);
  }
  return best;
}

ContactChoice with_one_less(const PushResponse& response, const VectorXd& goal, const ContactChoice& choice) {
  ContactChoice best;
  for (Index i = 0; i < choice.force_n.size(); ++i) {
    const ContactChoice rest = contacts_at(response, goal, without(choice.place_mm, i));
    ContactChoice less = refined_contacts(response, goal, moved(response, goal, rest));
    if (i == 0 || less.misfit < best.misfit) best = std::move(less);
  }
  return best;
}

/// Pushes that may be spread: each by its place, its force, and its force times the second moments of its spread along
/// the face, x and y. The last two change what it causes by half the second derivatives with respect to position.
struct SpreadPushes {
  static constexpr Index kEach = 5;
  MatrixXd M;      ///< [numbers, kEach * pushes]
  VectorXd known;  ///< information on each that is no measurement's: what fits between the borders of the face

  SpreadPushes(const PushResponse& response, const ContactChoice& choice) {
    const Index count = choice.force_n.size();
    const MatrixXd points = derivatives(response, choice);
    M.resize(points.rows(), kEach * count);
    known.setConstant(M.cols(), kMin);
    for (Index i = 0; i < count; ++i) {
      M.middleCols<3>(kEach * i) = points.middleCols<3>(3 * i);
      for (int axis = 0; axis < 2; ++axis) add_spread(response, choice.place_mm.col(i), choice.force_n[i], i, axis);
    }
  }
  void add_spread(const PushResponse& response, const Eigen::Vector2d& place, double force_n, Index index, int axis) {
    constexpr double kStep_mm = 4, kBeyond_mm = 1000;
    const Eigen::Vector2d step = Eigen::Vector2d::Unit(axis);
    const Eigen::Vector2d low = response.inside(place - kBeyond_mm * step);
    const Eigen::Vector2d high = response.inside(place + kBeyond_mm * step);
    // Near a border, the derivative beside it.
    Eigen::Vector2d middle = place;
    middle[axis] =
        std::clamp(place[axis], low[axis] + kStep_mm, std::max(low[axis], high[axis] - 2 * kStep_mm) + kStep_mm);
    const VectorXd bend =
        (response.at(middle + kStep_mm * step) - 2 * response.at(middle) + response.at(middle - kStep_mm * step)) /
        (kStep_mm * kStep_mm);
    const Index column = kEach * index + 3 + axis;
    M.col(column) = 0.5 * bend;
    const double most_n = force_n * std::max(1.0, (place[axis] - low[axis]) * (high[axis] - place[axis]));
    known[column] = 1 / (most_n * most_n);
  }
};

/// All but the spread. Near by, all contacts move together, to first order; far away, any place of the grid may do as
/// well for this one.
ContactUncertainty point_uncertainty(const PushResponse& response, const VectorXd& goal, const ContactChoice& choice,
                                     Index index, const MatrixXd& near) {
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix2d> place(Eigen::Matrix2d(near.block<2, 2>(3 * index, 3 * index)));
  const double force_n = choice.force_n[index], sigma_n = std::sqrt(near(3 * index + 2, 3 * index + 2));
  ContactUncertainty uncertainty;
  uncertainty.position_95_mm = std::sqrt(kAsGood * place.eigenvalues()[1]);
  uncertainty.lowest_force_n = std::max(0.0, force_n - 2 * sigma_n);
  uncertainty.highest_force_n = force_n + 2 * sigma_n;

  const MatrixXd others = responses(response, without(choice.place_mm, index));
  const Unexplained here(response.at(choice.place_mm.col(index)), goal, others);
  const Unexplained there(response.at_grid, goal, others);
  const double enough = here.gain(0) - kAsGood;
  const VectorXd distance_mm = (response.grid_mm.colwise() - choice.place_mm.col(index)).colwise().norm();
  for (Index j = 0; j < distance_mm.size(); ++j) {
    if (there.square[j] == 0 || there.gain(j) < enough) continue;
    const double margin_n = 2 / std::sqrt(there.square[j]);
    uncertainty.position_95_mm = std::max(uncertainty.position_95_mm, distance_mm[j]);
    uncertainty.lowest_force_n = std::min(uncertainty.lowest_force_n, std::max(0.0, there.force(j) - margin_n));
    uncertainty.highest_force_n = std::max(uncertainty.highest_force_n, there.force(j) + margin_n);
  }
  return uncertainty;
}

}  // namespace

// Gauss-Newton on places and forces; a step that does not help is halved.
ContactChoice refined_contacts(const PushResponse& response, const VectorXd& goal, const ContactChoice& start) {
  ContactChoice choice = contacts_at(response, goal, start.place_mm);
  for (int refinement = 0; refinement < kMaxRefinements && choice.force_n.size() > 0; ++refinement) {
    const MatrixXd M = derivatives(response, choice);
    VectorXd left = goal;
    for (Index i = 0; i < choice.force_n.size(); ++i) left -= choice.force_n[i] * M.col(3 * i + 2);
    const VectorXd step = covariance(M) * (M.transpose() * left);
    Matrix2Xd move(2, choice.force_n.size());
    for (Index i = 0; i < move.cols(); ++i) move.col(i) = step.segment<2>(3 * i);
    const double longest = move.colwise().norm().maxCoeff();
    if (longest > kLongestMove_mm) move *= kLongestMove_mm / longest;
    const double before = choice.misfit;
    for (int halving = 0; halving <= kHalvings; ++halving, move *= 0.5) {
      Matrix2Xd places = choice.place_mm + move;
      for (Index i = 0; i < places.cols(); ++i) places.col(i) = response.inside(places.col(i));
      ContactChoice next = contacts_at(response, goal, places);
      if (next.misfit >= choice.misfit) continue;
      choice = std::move(next);
      break;
    }
    if (choice.misfit > before - kEqual) break;
  }
  return choice;
}

ContactChoice fewest_contacts(const PushResponse& response, const VectorXd& goal, const ContactChoice& start,
                              double noise_inflation) {
  const double worth = kWorthAContact * noise_inflation;
  ContactChoice choice = refined_contacts(response, goal, start);
  while (choice.force_n.size() < kMaxContacts) {
    ContactChoice more = with_one_more(response, goal, choice);
    if (more.misfit > choice.misfit - worth) break;
    choice = std::move(more);
  }
  while (choice.force_n.size() > 0) {
    ContactChoice less = with_one_less(response, goal, choice);
    if (less.misfit >= choice.misfit + worth) break;
    choice = std::move(less);
  }
  return choice;
}

TotalForce total_force(const PushResponse& response, const VectorXd& goal, const ContactChoice& choice) {
  TotalForce total;
  const Index count = choice.force_n.size();
  if (count == 0) return total;
  total.force_n = choice.force_n.sum();
  // As points, and as what they may be if they are spread.
  const MatrixXd near = covariance(derivatives(response, choice));
  const SpreadPushes spread(response, choice);
  const MatrixXd wide = (MatrixXd(spread.M.transpose() * spread.M) + MatrixXd(spread.known.asDiagonal())).inverse();
  const VectorXd change =
      wide * (spread.M.transpose() * (goal - responses(response, choice.place_mm) * choice.force_n));
  VectorXd points = VectorXd::Zero(near.rows()), patches = VectorXd::Zero(wide.rows());
  for (Index i = 0; i < count; ++i) {
    points[3 * i + 2] = 1;
    patches[SpreadPushes::kEach * i + 2] = 1;
  }
  const double as_points_n = 2 * std::sqrt(points.dot(near * points));
  const double spread_n = total.force_n + patches.dot(change),
               as_patches_n = 2 * std::sqrt(patches.dot(wide * patches));
  total.lowest_n = std::max(0.0, std::min(total.force_n - as_points_n, spread_n - as_patches_n));
  total.highest_n = std::max(total.force_n + as_points_n, spread_n + as_patches_n);
  return total;
}

// Points, or what they may be if they are spread: their force's range is that of both.
std::vector<ContactUncertainty> contact_uncertainties(const PushResponse& response, const VectorXd& goal,
                                                      const ContactChoice& choice) {
  constexpr double kSurely = 1.645;  // on one side
  std::vector<ContactUncertainty> uncertainties;
  if (choice.force_n.size() == 0) return uncertainties;
  const MatrixXd near = covariance(derivatives(response, choice));
  const SpreadPushes spread(response, choice);
  const MatrixXd wide = (MatrixXd(spread.M.transpose() * spread.M) + MatrixXd(spread.known.asDiagonal())).inverse();
  const VectorXd change =
      wide * (spread.M.transpose() * (goal - responses(response, choice.place_mm) * choice.force_n));
  for (Index i = 0; i < choice.force_n.size(); ++i) {
    ContactUncertainty uncertainty = point_uncertainty(response, goal, choice, i, near);
    const Index first = SpreadPushes::kEach * i;
    const double force_n = choice.force_n[i] + change[first + 2], sigma_n = std::sqrt(wide(first + 2, first + 2));
    uncertainty.lowest_force_n = std::clamp(force_n - 2 * sigma_n, 0.0, uncertainty.lowest_force_n);
    uncertainty.highest_force_n = std::max(uncertainty.highest_force_n, force_n + 2 * sigma_n);
    double square_mm2 = 0;  // of the corner of an even pressure: three times its second moments
    for (Index k = first + 3; k < first + 5; ++k) {
      const double most = 1 / std::sqrt(spread.known[k]), moment = change[k] + kSurely * std::sqrt(wide(k, k));
      square_mm2 += 3 * std::clamp(moment, 0.0, most) / choice.force_n[i];
    }
    uncertainty.extent_95_mm = change.segment<2>(first).norm() + std::sqrt(square_mm2);
    uncertainties.push_back(uncertainty);
  }
  return uncertainties;
}

}  // namespace finsight::host
