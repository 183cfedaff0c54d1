// "Gain" of a place: by how much a push there lowers the misfit if the other pushes are adjusted to it.
#include "hostgen/fem/contact_choice.h"

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <Eigen/QR>
#include <algorithm>
#include <cmath>
#include <numeric>
#include <vector>

namespace finsight::host {

namespace {

using Eigen::Index;
using Eigen::Matrix2Xd;
using Eigen::MatrixXd;
using Eigen::VectorXd;

constexpr Index kMostContacts = 5;
// chi-squared at 99 % for three numbers (two coordinates and a force), and at 95 % for the two coordinates.
constexpr double kWorthAContact = 11.34, kAsGood = 5.99;
constexpr double kEqual = 0.01;  // misfits nearer than this are equal
constexpr int kMostMoves = 20, kMostRefinements = 10, kHalvings = 4;
constexpr double kLongestMove_mm = 3;    // of one refinement
constexpr double kDifference_mm = 0.25;  // for derivatives by the place

MatrixXd responses(const PushResponse& response, const Matrix2Xd& places_mm) {
  MatrixXd columns(response.at_grid.rows(), places_mm.cols());
  for (Index i = 0; i < places_mm.cols(); ++i) columns.col(i) = response.at(places_mm.col(i));
  return columns;
}

/// What pushes `others` (columns) cannot explain: of the goal, and of every column of `J`.
struct Unexplained {
  VectorXd product, square;  ///< per column of J: with the goal, and with itself

  Unexplained(const MatrixXd& J, VectorXd goal, const MatrixXd& others) : square(J.colwise().squaredNorm()) {
    if (others.cols() > 0) {
      const Eigen::HouseholderQR<MatrixXd> qr(others);
      const MatrixXd Q = qr.householderQ() * MatrixXd::Identity(J.rows(), others.cols());
      goal -= Q * (Q.transpose() * goal);
      const VectorXd whole = square;
      square -= (Q.transpose() * J).colwise().squaredNorm().transpose();
      // A place that does what the others do has nothing left but rounding.
      square = (square.array() > 1e-9 * whole.array()).select(square, 0.0);
    }
    product = J.transpose() * goal;
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

/// [numbers, 3 * contacts] derivatives of what the contacts cause by their x, y and force.
MatrixXd derivatives(const PushResponse& response, const ContactChoice& choice) {
  MatrixXd M(response.at_grid.rows(), 3 * choice.force_n.size());
  for (Index i = 0; i < choice.force_n.size(); ++i) {
    const Eigen::Vector2d place = choice.place_mm.col(i);
    for (Index axis = 0; axis < 2; ++axis) {
      const Eigen::Vector2d way = kDifference_mm * Eigen::Vector2d::Unit(axis);
      M.col(3 * i + axis) =
          choice.force_n[i] * (response.at(place + way) - response.at(place - way)) / (2 * kDifference_mm);
    }
    M.col(3 * i + 2) = response.at(place);
  }
  return M;
}

/// Inverse of the contacts' information; what is not known at all (beside the face) counts as known to 30 mm.
MatrixXd covariance(const MatrixXd& M) {
  constexpr double kLeast = 1.0 / (30 * 30);
  return (M.transpose() * M + kLeast * MatrixXd::Identity(M.cols(), M.cols())).inverse();
}

/// Every contact in turn goes to the place of the grid where it explains most, until none wants to move.
ContactChoice moved(const PushResponse& response, const VectorXd& goal, ContactChoice choice) {
  for (int move = 0; move < kMostMoves; ++move) {
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

ContactChoice with_one_more(const PushResponse& response, const VectorXd& goal, const ContactChoice& choice) {
  const Index best = Unexplained(response.at_grid, goal, responses(response, choice.place_mm)).best();
  const Matrix2Xd places = with(choice.place_mm, response.grid_mm.col(best));
  return refined_contacts(response, goal, moved(response, goal, contacts_at(response, goal, places)));
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

/// Radius of the largest disc of the grid, even pressure on which gains `enough`.
double largest_spread_mm(const PushResponse& response, const VectorXd& goal, const VectorXd& distance_mm,
                         const MatrixXd& others, double enough) {
  std::vector<Index> nearest(static_cast<std::size_t>(distance_mm.size()));
  std::iota(nearest.begin(), nearest.end(), Index{0});
  std::stable_sort(nearest.begin(), nearest.end(), [&](Index a, Index b) { return distance_mm[a] < distance_mm[b]; });
  MatrixXd pressure(response.at_grid.rows(), distance_mm.size());  // column k: on the k + 1 nearest places
  VectorXd sum = VectorXd::Zero(pressure.rows());
  for (Index k = 0; k < pressure.cols(); ++k) {
    sum += response.at_grid.col(nearest[static_cast<std::size_t>(k)]);
    pressure.col(k) = sum / static_cast<double>(k + 1);
  }
  const Unexplained left(pressure, goal, others);
  double largest_mm = 0;
  for (Index k = 0; k < pressure.cols(); ++k) {
    if (left.gain(k) >= enough) largest_mm = std::max(largest_mm, distance_mm[nearest[static_cast<std::size_t>(k)]]);
  }
  return largest_mm;
}

}  // namespace

VectorXd nonnegative_least_squares(const MatrixXd& A, const VectorXd& b) {
  const Index n = A.cols();
  VectorXd x = VectorXd::Zero(n);
  std::vector<Index> passive;  // free columns; the others are held at zero
  VectorXd pull = A.transpose() * b;
  const double nothing = n == 0 ? 0 : 1e-10 * pull.cwiseAbs().maxCoeff();
  const auto solve = [&] { return VectorXd(MatrixXd(A(Eigen::all, passive)).colPivHouseholderQr().solve(b)); };
  for (Index round = 0; round < 3 * n; ++round) {
    for (const Index j : passive) pull[j] = 0;
    Index enter = 0;
    if (pull.maxCoeff(&enter) <= nothing) break;
    passive.push_back(enter);
    VectorXd best = solve();
    while (best.minCoeff() <= 0) {
      // Goes towards it as far as nothing turns negative; what reached zero is held there.
      double way = 1;
      for (std::size_t k = 0; k < passive.size(); ++k) {
        const double from = x[passive[k]], to = best[static_cast<Index>(k)];
        if (to <= 0) way = std::min(way, from / (from - to));
      }
      std::vector<Index> still;
      for (std::size_t k = 0; k < passive.size(); ++k) {
        const double from = x[passive[k]], to = best[static_cast<Index>(k)];
        const bool held = to <= 0 && from / (from - to) <= way;
        x[passive[k]] = held ? 0 : from + way * (to - from);
        if (!held) still.push_back(passive[k]);
      }
      passive = std::move(still);
      if (passive.empty()) break;
      best = solve();
    }
    for (std::size_t k = 0; k < passive.size(); ++k) x[passive[k]] = best[static_cast<Index>(k)];
    pull = A.transpose() * (b - A * x);
  }
  return x;
}

// Gauss-Newton on places and forces; a step that does not help is halved.
ContactChoice refined_contacts(const PushResponse& response, const VectorXd& goal, const ContactChoice& start) {
  ContactChoice choice = contacts_at(response, goal, start.place_mm);
  for (int refinement = 0; refinement < kMostRefinements && choice.force_n.size() > 0; ++refinement) {
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
                              double caution) {
  const double worth = kWorthAContact * caution;
  ContactChoice choice = refined_contacts(response, goal, start);
  while (choice.force_n.size() < kMostContacts) {
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

// Near by, all contacts move together, to first order; far away, any place of the grid may do as well for this one.
ContactDoubt contact_doubt(const PushResponse& response, const VectorXd& goal, const ContactChoice& choice,
                           Index index) {
  const MatrixXd near = covariance(derivatives(response, choice));
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix2d> place(Eigen::Matrix2d(near.block<2, 2>(3 * index, 3 * index)));
  const double force_n = choice.force_n[index], sigma_n = std::sqrt(near(3 * index + 2, 3 * index + 2));
  ContactDoubt doubt;
  doubt.reach_mm = std::sqrt(kAsGood * place.eigenvalues()[1]);
  doubt.lowest_force_n = std::max(0.0, force_n - 2 * sigma_n);
  doubt.highest_force_n = force_n + 2 * sigma_n;

  const MatrixXd others = responses(response, without(choice.place_mm, index));
  const Unexplained here(response.at(choice.place_mm.col(index)), goal, others);
  const Unexplained there(response.at_grid, goal, others);
  const double enough = here.gain(0) - kAsGood;
  const VectorXd distance_mm = (response.grid_mm.colwise() - choice.place_mm.col(index)).colwise().norm();
  for (Index j = 0; j < distance_mm.size(); ++j) {
    if (there.square[j] == 0 || there.gain(j) < enough) continue;
    const double margin_n = 2 / std::sqrt(there.square[j]);
    doubt.reach_mm = std::max(doubt.reach_mm, distance_mm[j]);
    doubt.lowest_force_n = std::min(doubt.lowest_force_n, std::max(0.0, there.force(j) - margin_n));
    doubt.highest_force_n = std::max(doubt.highest_force_n, there.force(j) + margin_n);
  }
  doubt.spread_mm = largest_spread_mm(response, goal, distance_mm, others, enough);
  return doubt;
}

}  // namespace finsight::host
