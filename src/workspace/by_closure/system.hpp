// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// The closure and the limits of a machine in first order, over a box of poses and a piece of what follows from them.
#pragma once

#include <array>
#include <limits>
#include <memory>
#include <utility>
#include <vector>

#include "../linear.hpp"
#include "polypod/core/box_number.hpp"
#include "questions.hpp"

namespace polypod::workspace::by_closure {

constexpr double kInfinity = std::numeric_limits<double>::infinity();
constexpr std::size_t kPrescribed = 5;  ///< three of the box, two of the patch
constexpr int kMostUnknowns = BoxDomain::kMost - kPrescribed;

using Matrix = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, 0, kMostUnknowns, kMostUnknowns>;
using Column = Eigen::Matrix<double, Eigen::Dynamic, 1, 0, kMostUnknowns, 1>;
using Slopes = Eigen::Matrix<double, Eigen::Dynamic, 5, 0, kMostUnknowns, 5>;

/// Unknowns u = middle + slope v + du, |du| <= radius.
struct Piece {
  Column middle, radius;
  Slopes slope;
};

/// A box of the prescribed position and a patch of directions.
struct Place {
  Vec3 center, half;
  const Patch* patch = nullptr;
};

/// value + slope v + [-rest, rest].
struct Form {
  double value = 0, rest = 0;
  std::array<double, kPrescribed> slope{};
};
/// The ends of a limit over a place, and what the position adds at most.
double lowest(const Form& f, const Place& at);
double highest(const Form& f, const Place& at);
double by_position(const Form& f, const Place& at);

/// The most that slope v is in a place.
double spread(const BoxDomain& d, const double* slope, Eigen::Index stride = 1);
double spread(const BoxDomain& d, const Slopes& slopes, Eigen::Index row);

/// F = c + A v + B du + [-rest, rest].
struct FirstOrderClosure {
  Matrix B;
  Slopes A;
  Column c, rest;
};

/// What one look at F over a piece says of its core and of its leaves.
struct Look : FirstOrderClosure {
  bool none = false;     ///< no solution of the core
  bool regular = false;  ///< the core's equations can be solved for its unknowns in first order
  bool exists = false;   ///< a solution of the core in `follows` for each v
  std::vector<bool> leaf_none, leaf_regular, leaf_exists;
  Piece narrowed;  ///< holds all solutions of the piece
  Piece follows;   ///< the same in first order, of what is regular
  BoxDomain domain;
  Matrix Y;  ///< inverse of B: of the core, or of all unknowns after solve()
};

/// The unknowns of a pose are the coordinates that follow and the joints. Leaves are joints that one equation alone
/// holds, one to an equation, each limit holding at most one of them; the core is the rest.
class System {
 public:
  System(std::shared_ptr<const Questions> questions, const Options& options);

  /// False where nothing is proven.
  bool begin();

  [[nodiscard]] double lever() const { return lever_; }
  [[nodiscard]] const Vec3& low() const { return low_; }
  [[nodiscard]] const Vec3& high() const { return high_; }
  [[nodiscard]] const Patch& whole() const { return whole_; }
  [[nodiscard]] const Piece& root() const { return root_; }  ///< all that the joints' ranges and the angles allow
  [[nodiscard]] int unknowns() const { return unknowns_; }
  [[nodiscard]] const std::vector<int>& core() const { return core_; }
  /// An unknown and the one equation that holds it.
  [[nodiscard]] const std::vector<std::pair<int, int>>& leaves() const { return leaves_; }
  [[nodiscard]] std::size_t limit_count() const { return limits_; }
  [[nodiscard]] const std::vector<int>& owner() const { return owner_; }  ///< of each limit its leaf, or -1
  [[nodiscard]] bool heeds(std::size_t limit) const { return limit >= 64 || (mask_ >> limit & 1U) != 0; }

  /// F over the place and the piece. `forms`, where asked for, are those of the limits there.
  void look(const Place& at, const Piece& piece, Look& out, std::vector<Form>* forms) const;
  /// The least of the limits that are heeded.
  [[nodiscard]] double least_of(const std::vector<Form>& forms, const Place& at) const;

  /// Newton's method at the middle of a place, from u; `last` is the first order there.
  bool solve(const Place& at, Column& u, Look& last) const;
  /// What the machine's own inverse finds at the middle of a place.
  [[nodiscard]] std::vector<Column> solutions(const Place& at) const;

 private:
  /// The joints' ranges, as far as the limits that are heeded say them; of turning joints else one turn.
  bool hold_joints();
  [[nodiscard]] bool limits_break(std::size_t joint, const Interval& where) const;
  /// A box that certainly holds the tool tip: beyond it some equation has no zero or some limit is broken.
  bool hold_tip();
  void narrow_tip(int axis, double sign);
  [[nodiscard]] bool tip_is_out(int axis, double sign, double beyond) const;
  void find_structure();
  /// How far a turn of 1 rad moves the unknowns, measured by what moves them as far, at home.
  void find_lever();

  /// Pose and joints over a place and a piece, about a domain of their own.
  struct Expressed {
    Expressed(const System& system, const Place& at, const Piece& piece);
    Expressed(const Expressed&) = delete;
    Expressed& operator=(const Expressed&) = delete;
    BoxDomain domain;
    PoseT<BoxNumber> X;
    std::vector<BoxNumber> q;
  };
  void first_order(const machine::ClosureVectorT<BoxNumber>& F, FirstOrderClosure& out) const;
  bool look_at_point(const Place& at, const Piece& point, Look& out) const;
  /// The limits on the solutions in the piece: g - l . F, where l takes the unknowns out of the first order.
  void limits_over(const std::vector<BoxNumber>& g, const Piece& piece, const Look& look,
                   std::vector<Form>& forms) const;
  [[nodiscard]] Pose target(const Place& at) const;
  [[nodiscard]] Column unknowns_of(const Place& at, const Questions::Solved& solved) const;

  std::shared_ptr<const Questions> machine_;
  Options options_;
  Patch whole_;
  LimitBits mask_ = ~LimitBits{0};
  std::vector<int> free_;                       ///< coordinates that follow
  static constexpr int kNone = -1;              // a side of the box that is no coordinate
  std::array<int, 3> box_coordinate_{0, 1, 2};  ///< which coordinates the box is of
  int unknowns_ = 0;
  std::size_t limits_ = 0;
  std::vector<int> core_, core_rows_;
  std::vector<std::pair<int, int>> leaves_;
  std::vector<int> owner_;
  Piece root_;
  Vec3 tip_low_ = Vec3::Zero(), tip_high_ = Vec3::Zero();
  Vec3 low_ = Vec3::Zero(), high_ = Vec3::Zero();
  double lever_ = 1;
};

}  // namespace polypod::workspace::by_closure
