// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// What the program will do on the soft machine, before anything is corrected.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "polypod/machining/simulate.hpp"

namespace polypod::gcode {
struct Understood;
}

namespace polypod::machining {

/// Smallest, mean and largest of a number; `count` 0 means that there was none.
struct Spread {
  double min = 0, mean = 0, max = 0;
  std::size_t count = 0;

  void add(double x) {
    min = count == 0 ? x : std::min(min, x);
    max = count == 0 ? x : std::max(max, x);
    ++count;
    mean += (x - mean) / static_cast<double>(count);
  }
};

/// How a deflected tool lies to the move that was programmed.
struct PathError {
  double normal = 0;    ///< m, across the path in the plane; > 0 leaves material, < 0 gouges
  double vertical = 0;  ///< m, along the tool axis
  double distance = 0;  ///< m, to the move as a curve with its ends (the tube and its spheres)
};
/// `away` is the direction of Sample::away. Distance and normal are taken at the nearest point of the move.
/// `axis` is that of the tool, in W.
PathError path_error(const gcode::Move& programmed, const Vec3& bent, const Vec3& away,
                     const Vec3& axis = Vec3::UnitZ());
/// The sample with its judgement.
Sample judged(const Sample& sample, const PathError& error);

struct MovePrediction {
  int move = 0;  ///< index of the programmed move
  int block = 0;
  int line = 0;
  double length = 0;               ///< m
  std::size_t points = 0;          ///< evaluated points that cut
  Spread deflection;               ///< m, |delta|
  Spread normal;                   ///< m
  Spread vertical;                 ///< m
  double largest_distance = 0;     ///< m, from the programmed move, its ends as spheres
  Vec3 mean_force = Vec3::Zero();  ///< N, in W; on arcs what points everywhere cancels
  double mean_force_size = 0;      ///< N, the mean of |F|
  double largest_depth = 0;        ///< m
};

/// A move, or a part of one, of which nothing is known.
struct NotJudged {
  int line = 0;
  std::string why;
  std::string remedy = {};  ///< what would help, if something is known
};

/// A plunge (steeper than 60 deg) at whose end the tool does not come to rest: what the thrust along the axis holds
/// back there need not be cut. How much remains depends on how the controller stops and turns round, so all that is
/// known is a bound: the axial deflection, less what the teeth take during a dwell (G4) after it. A dwell counts from
/// one revolution on. During it each tooth leaves q / (1 + q) of what the last one left, q the deflection over the feed
/// per tooth (the lag of a force in proportion to the chip, tooth by tooth); the edges' share of the thrust stays.
struct Plunge {
  int line = 0;
  double held_back = 0;  ///< m, along the axis, at the end of the move
  double remaining = 0;  ///< m, at most, after the dwell; all of it where there is none of a revolution
  double distance = 0;   ///< m, of that from the programmed end, with what the tool is off to the side
  double dwell = 0;      ///< s, given
  double needed = 0;     ///< s, after which the tube holds what remains; 0: no dwell does
  bool ball = false;     ///< of a ball, of which a dwell is not judged

  /// Why it is not judged, in words.
  [[nodiscard]] std::string why() const;
};

/// Where the force rises or falls quickly, as where a cutter comes out of the stock:
/// - within the length ahead over which the engagement is averaged (look_ahead_length): there the deflection may still
///   be the one of that way before;
/// - within the deflection's own length: a tool whose deflection delta goes back moves faster than its feed and cuts
///   thicker chips. The deflection then follows that of the balance by delta' = (delta_balance - delta) / |delta| along
///   the path, the lag of a force in proportion to the chip (compare yield_step); moves are judged by the balance at
///   the programmed feed.
struct Steep {
  double length = 0;    ///< m of the cut where such a deflection would leave the tube, and the one found does not
  double distance = 0;  ///< m, of the worst of them from the programmed move
  double window = 0;    ///< m, the way ahead there
  int line = 0;
  double elsewhere = 0;  ///< m, the largest distance that was found on that line; no smaller figure denies it
  double within = 0;     ///< m, the farthest of those deflections that stay inside the tube
  int within_line = 0;
};

/// Corners in a cut, and ends of moves that stop in one, where the controller goes slower than the feed: the chips are
/// thinner there, and the tool deflects less. Moves are judged at their feed, since how far a machine with its inertia
/// springs back in the few teeth of such a corner no static model knows. The two ends of it are known: the deflection
/// at the feed, and that at the chips of the slowest place, delta(f) = delta_edges + f (delta - delta_edges) with f the
/// share of the feed per tooth, the way of a tooth period there: f = min(1, (v_c + a T / 4) / v), v_c the speed in the
/// corner (corner), a the acceleration, T the tooth period. Between both the distance is a convex function. In a dwell
/// all chips go, and the edges may, too: the tool rests between its command and delta_edges from it. The nearest of
/// these places to the path is a distance like any other, where the dwell takes a revolution; the farthest is one of
/// these.
struct SlowCorners {
  std::size_t count = 0;  ///< where the tool at such chips would leave the tube, and what was found does not
  double distance = 0;    ///< m, of the worst of them from the programmed moves, with the rounding of the corner
  int line = 0;           ///< of the move that ends or begins there
  double share = 1;       ///< f there
  double within = 0;      ///< m, the farthest of those that stay inside the tube
  int within_line = 0;

  void add(double there, double of_feed, int at_line, double tolerance);
  /// What is not judged, in words; `um`: the symbol of micrometres.
  [[nodiscard]] std::string in_words(const char* um = "um") const;
};

/// A program with the other position of the block delete switch.
struct OtherSwitch {
  bool block_delete = false;  ///< the position that was judged
  bool cuts = true;           ///< false: in this position no move cuts
  bool fixed = false;  ///< the program was unrolled for the job's position, so that the switch does not act on what
                       ///< is written: `distance_after` is of a correction for this position, which is not
  double distance_before = 0;  ///< m, largest distance of the program as it is, corners counted
  double distance_after = 0;   ///< m, the same of the corrected program
  int line = 0;                ///< of the program, where that is
  bool within_tolerance = false;
  Steep steep;                     ///< not judged
  SlowCorners slow;                ///< not judged
  std::vector<Plunge> plunges;     ///< not judged
  std::optional<Error> collision;  ///< MC304: of `predict` only; `correct` ends there
  std::string reason;              ///< why not within, where it is not the distance

  [[nodiscard]] bool not_all_judged() const { return steep.distance > 0 || slow.count > 0 || !plunges.empty(); }
};

/// A place in a cut that is not judged.
struct Unjudged {
  double distance = 0;  ///< m, up to which the tool may be from the programmed path
  int line = 0;
  const char* what = "";   ///< as part of a sentence
  std::size_t places = 0;  ///< that are not judged, with this one; those where the force changes quickly count as one
};

struct Prediction {
  Steep steep;                              ///< not judged
  SlowCorners slow;                         ///< not judged: in the path control modes in force
  LongVector<MovePrediction> moves;         ///< those that cut, in order
  std::vector<NotJudged> not_judged;        ///< moves that cut but that no model covers; they spoil every "yes"
  std::vector<Plunge> plunges;              ///< not judged: what remains there may be outside the tube
  Plunge plunge_within;                     ///< of the other plunges the one that leaves most; line 0: none
  LongVector<Sample> samples;               ///< every evaluated point, if they were asked for
  std::vector<Sample> few;                  ///< at most 200 of the points that cut, at equal distances in their order
  Spread deflection, normal, vertical;      ///< over all points that cut, m
  double largest_distance = 0;              ///< m
  double corner = 0;                        ///< m, by which the controller rounds the worst corner of a cut
  double largest_with_corners = 0;          ///< m, distance with the corners in the path control modes of the program
  double time = 0;                          ///< s, with the planner's acceleration
  std::optional<OtherSwitch> other_switch;  ///< where the program has blocks with /
  LongVector<double> commanded_distance;    ///< m, largest of each commanded move; 0 where it does not cut
  struct Ends {
    bool start = false, end = false;
  };
  LongVector<Ends> commanded_ends;  ///< whether it cuts within a millimetre of its start and of its end
  /// m, of each commanded move that cuts there, how far the tool is from the programmed moves at its start and at its
  /// end without chips; and at most where it comes to rest in a dwell after it.
  struct WithoutChips {
    float start = 0, end = 0, at_rest = 0;
  };
  LongVector<WithoutChips> commanded_without_chips;
  PassResult pass;
  cutting::Stock stock_left;  ///< what the deflected tool leaves, in W, if it was asked for
  std::vector<std::string> notes;

  /// Whether every cut was judged and stays in the tube of the job, corners counted, at both positions of block delete.
  [[nodiscard]] bool within(const Job& job) const;
  /// Whether `within` answers for all of the cut: else for all but steep places, slow corners and plunges
  /// without a dwell.
  [[nodiscard]] bool all_judged() const;
  /// Of these the one where the tool may be farthest from its path; distance 0 where there is none, or none that is
  /// known.
  [[nodiscard]] Unjudged farthest_not_judged() const;
};

struct PredictOptions {
  Bend bend = Bend::equilibrium;
  double step = 0;  ///< m; 0 takes the job's
  bool keep_samples = false;
  bool keep_stock = false;
  bool again = false;  ///< see AcceptOptions
  /// The program unrolled for the other position of block delete; null where it needs no unrolling, or has no blocks
  /// with /.
  const gcode::Understood* other = nullptr;
  bool one_position = false;  ///< only that of the job: the other one is judged elsewhere
  bool beside = false;  ///< a point counts by the nearer of its move and those beside it, as where a record turns from
                        ///< one to the next is not known
  std::function<bool(double)> progress;
};

/// Deflection along a program: at rest under the mean force, or in equilibrium (default). Distances are to the
/// programmed moves, with a sphere at each end. Errors: those of accept and run_pass; MC302 no move cuts.
Result<Prediction> predict(const Job& job, const gcode::Program& program, const gcode::Interpretation& interpretation,
                           const PredictOptions& options = {});

/// MC304 where a rapid goes through more than `job.rapid_volume` of material: with the line of the worst.
Status no_rapid_cuts(const Job& job, const gcode::Program& program, const PassResult& pass);

/// What a verdict keeps free of the tube for what the cells of the stock leave open, m: 2 % of the tolerance. It is no
/// bound: where a cut begins, ends or meets a sliver, cells half as large can show more (CorrectOptions::verify looks).
double resolution(const Job& job);

/// How far a prediction is uncertain because the cutting coefficients are: half of 95 % intervals, m.
struct ForceBand {
  double deflection_mean = 0, deflection_max = 0, normal_mean = 0;
  LongVector<double> normal_by_move;  ///< of each move's mean normal error
};
/// The material's variations one after the other through the whole prediction, their effects as squares. All 0 where
/// the material says nothing of its spread. Cost: one prediction a variation. Errors as predict.
Result<ForceBand> force_band(const Job& job, const gcode::Program& program, const gcode::Interpretation& interpretation,
                             const Prediction& prediction, const PredictOptions& options = {});

/// How far a prediction is uncertain because the measured compliance is, and how far the joints' is from it, both at
/// the forces of the prediction.
struct MapBand {
  /// Half of 95 % intervals of the deflection along the normal n of the path, m: 1.96 sd with
  /// sd^2 = sum_i (n_i F_i sd C_ii)^2 + sum_{i<j} ((n_i F_j + n_j F_i) sd C_ij)^2, entries of C independent, in M.
  Spread normal;
  /// |(C_map - C_joints) F|, m; `count` 0 where the machine has no compliances.
  Spread joints;
};
/// Over `prediction.few`; nothing is counted where the job has no measured compliance. Says how well the compliance
/// itself is known; what one reading would scatter round it is MeasuredMap::noise. Cost: 0.1 ms a point for 90 measured
/// points.
MapBand map_band(const Job& job, const Prediction& prediction);

/// What the load changes of a prediction by turning the levers of an arm (statics::under_load), which its deflections
/// leave out.
struct LeverChange {
  double most = 0;         ///< m, |exact - C F|
  double deflection = 0;   ///< m, |C F| there
  int move = -1;           ///< where
  std::size_t points = 0;  ///< at which it was looked at
  bool settles = true;     ///< false: at some point no balance was found
};
/// Over `prediction.few`. No points where the machine is no serial arm with compliances, or the job has a measured one.
LeverChange lever_change(const Job& job, const Prediction& prediction);

/// What a reader should know of a pass: rapids that touch material, cuts with the end of the cutter whose coefficients
/// are assumed, points whose equilibrium did not settle.
std::vector<std::string> pass_notes(const Job& job, const gcode::Program& program, const PassResult& pass);

/// What is said of machines with a joint that the tool's pose leaves free (kinematics::leaves_a_joint_free).
inline constexpr const char* kOneChoice =
    "the pose leaves a joint free: one choice, the nearest to the joints before, was predicted; with other joints the "
    "machine deflects otherwise";

/// Implausible cutting conditions of moves that cut (cutting::plausibility), each once, with its line.
std::vector<std::string> condition_notes(const Job& job, const LongVector<gcode::Move>& programmed,
                                         const Prediction& prediction);

}  // namespace polypod::machining
