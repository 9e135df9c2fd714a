// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// One pass of a cutter that deflects, through the stock, point by point.
#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <map>
#include <string>
#include <vector>

#include "polypod/core/long_vector.hpp"
#include "polypod/cutting/stock.hpp"
#include "polypod/gcode/interpreter.hpp"
#include "polypod/machining/job.hpp"

namespace polypod::machining {

/// How the force at a point and the deflection of the machine are brought together.
enum class Bend {
  /// The tool stands where it is commanded; its force there deflects the machine (SLAV 5.3).
  at_rest,
  /// delta = C(command) F(engagement at command + delta): the deflected cutter takes less or more material, and leaves
  /// what it did not take to later moves.
  equilibrium,
  /// The command is such that the deflected tool stands on the programmed point: x = p - delta, delta = C(x) F(p). This
  /// is the ideal correction; the fixed point is in C alone.
  corrected,
};

/// A point of a pass. All vectors in W, m and N.
struct Sample {
  int move = 0;  ///< index into the moves of the pass
  double s = 0;  ///< arc length along the move, m
  Vec3 command = Vec3::Zero();
  Vec3 deflection = Vec3::Zero();  ///< delta; the deflected tip is command + deflection
  Vec3 weight = Vec3::Zero();      ///< what of it the weight of the machine does, where that counts
  /// At the ends of moves what delta is without chips, by the edges alone: nearly where the controller stops.
  Vec3 without_chips = Vec3::Zero();
  Vec3 force = Vec3::Zero();  ///< mean force on the tool
  /// Unit normal of the path in the plane, to the left of the feed. predict and correct turn it away from the wall that
  /// is cut along most of the move; in a slot, which has two, it stays.
  Vec3 away = Vec3::Zero();
  Vec3 axes = Vec3::Zero();  ///< A, B, C where the tool turns in cuts, rad; else 0
  /// Of a machine whose poses leave joints open (a rail, the C of a vertical head) those that it has come here with,
  /// rad or m, to single precision; none of others, nor of machines with more joints.
  static constexpr std::size_t kMostJoints = 8;
  std::array<float, kMostJoints> joints{};
  std::uint8_t joint_count = 0;
  bool wall_left = false;     ///< only the left side of the cutter meets a wall
  float depth = 0;            ///< largest axial depth of engagement, m
  float entry = 0, exit = 0;  ///< first and last engaged tooth angle, rad
  /// Takes material, or, by the weight of the machine alone, misses what the program would have it take.
  bool cutting = false;
  /// How the deflected tip was judged against the programmed move, m: filled by predict and correct (see PathError).
  float normal = 0, vertical = 0, distance = 0;

  [[nodiscard]] Vec3 bent() const { return command + deflection; }
  [[nodiscard]] machine::JointVector came_with() const {
    return Eigen::Map<const Eigen::VectorXf>(joints.data(), joint_count).cast<double>();
  }
};

/// A move of a pass.
struct PassMove {
  gcode::Move move;
  /// A joint that the correction put in: the command jumps from one deflection to another while the tool should stand.
  /// Its force does not follow the command but the path of the tool (yield_step).
  bool transition = false;
  /// The move that the deflected tool follows, if that is not the commanded one: a corrected command may lean by some
  /// degrees where the deflection changes fast, but chips are cut in the direction in which the deflected tool moves.
  /// Must outlive the pass.
  const gcode::Move* followed = nullptr;
};

/// The moves of a pass where they are kept: commanded ones, or those of a program as they stand. Must outlive it.
class PassMoves {
 public:
  PassMoves(const LongVector<PassMove>& commanded) : commanded_(&commanded) {}  // NOLINT(google-explicit-constructor)
  PassMoves(const LongVector<gcode::Move>& plain) : plain_(&plain) {}           // NOLINT(google-explicit-constructor)
  PassMoves(const std::vector<PassMove>& commanded)                             // NOLINT(google-explicit-constructor)
      : row_(commanded.data()), size_(commanded.size()) {}

  [[nodiscard]] std::size_t size() const {
    return plain_ != nullptr ? plain_->size() : commanded_ != nullptr ? commanded_->size() : size_;
  }
  [[nodiscard]] const gcode::Move& operator[](std::size_t i) const {
    return plain_ != nullptr ? (*plain_)[i] : commanded(i).move;
  }
  [[nodiscard]] bool transition(std::size_t i) const { return plain_ == nullptr && commanded(i).transition; }
  /// The move that the deflected tool follows.
  [[nodiscard]] const gcode::Move& followed(std::size_t i) const {
    if (plain_ != nullptr) return (*plain_)[i];
    const PassMove& move = commanded(i);
    return move.followed != nullptr ? *move.followed : move.move;
  }

 private:
  [[nodiscard]] const PassMove& commanded(std::size_t i) const {
    return commanded_ != nullptr ? (*commanded_)[i] : row_[i];
  }
  const LongVector<PassMove>* commanded_ = nullptr;
  const LongVector<gcode::Move>* plain_ = nullptr;
  const PassMove* row_ = nullptr;
  std::size_t size_ = 0;
};

struct PassOptions {
  Bend bend = Bend::equilibrium;
  double step = 0.5e-3;     ///< m
  int max_iterations = 12;  ///< halvings of the bracket where the equilibrium at a point does not contract
  /// m, of the deflection between two iterations; an iteration leaves about a tenth of the change before it.
  double tolerance = 1e-6;
  /// A move that goes on from the one before within this angle starts where that ended: one point less, rad.
  double smooth_angle = 0.1;
  std::function<bool(double)> progress;  ///< called with the share done; false cancels
};

/// Something on the way that the user should know.
struct Incident {
  enum class Kind {
    rapid_through_stock,
    end_cut  ///< the end of the cutter cuts: a plunge or a ramp
  } kind = Kind::rapid_through_stock;
  int block = 0;
  double volume = 0;  ///< m^3
  // Of a rapid move with those right before it, between which nothing is cut at a feed: however a way is divided into
  // blocks, it goes through the same material.
  int first_block = 0;       ///< of them that goes through material
  double volume_so_far = 0;  ///< m^3
};

/// A move on which force and deflection do not settle.
struct Unsettled {
  int block = 0;
  double rest = 0;  ///< m, what the deflection still moves by from one iteration to the next
};

struct PassResult {
  std::vector<Incident> incidents;
  std::vector<Unsettled> unsettled;
  double removed = 0;             ///< m^3
  std::size_t points = 0;         ///< evaluated
  std::size_t not_converged = 0;  ///< points whose equilibrium still moved by more than the tolerance
  double largest_rest = 0;        ///< m, by how much
};

/// How far ahead of a cutter of this radius the engagement is looked at, m: its force is the mean over that way.
double look_ahead_length(const cutting::Stock& stock, double radius);

/// Sends the cutter along the moves and calls `visit` with every evaluated point of moves that are not rapid: both ends
/// and between them steps of at most `options.step`. `stock` is changed. Errors, with the line of the program:
/// MC200 spindle still in a cut, MC201 feed zero in a cut, MC202 deeper than the edges of the cutter, MC203 the spindle
/// turns backwards, MC204 a tool in another orientation in a cut than the job is set up for (set_up), MC205 more than
/// 2e8 points, MC210 a commanded pose is out of reach or breaks a limit, MC211 it lies outside of what the measured
/// compliance covers, MC299 cancelled. Cost: about 5 us a point, 100 to 400 us with a ball.
Result<PassResult> run_pass(const Job& job, const gcode::Program& program, const PassMoves& moves,
                            cutting::Stock& stock, const PassOptions& options,
                            const std::function<void(const Sample&)>& visit);

}  // namespace polypod::machining
