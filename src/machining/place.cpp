// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/machining/place.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <atomic>
#include <cmath>
#include <limits>
#include <memory>
#include <mutex>
#include <numbers>
#include <numeric>

#include "polypod/core/parallel.hpp"
#include "polypod/core/units.hpp"
#include "polypod/gcode/unroll.hpp"
#include "polypod/kinematics/any_machine.hpp"
#include "polypod/kinematics/hold.hpp"
#include "polypod/kinematics/parts.hpp"
#include "polypod/kinematics/posture.hpp"
#include "polypod/machining/accept.hpp"
#include "polypod/machining/beginning.hpp"
#include "polypod/machining/check.hpp"
#include "polypod/machining/tilted.hpp"
#include "polypod/motion/dynamics.hpp"
#include "polypod/statics/compliance.hpp"
#include "way.hpp"

namespace polypod::machining {
namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();
// Points of a program that an estimate looks at, about.
constexpr std::size_t kMostPoints = 400;
// Stocks up to this are cut by several predictions at once, bytes.
constexpr std::size_t kLargestParallelStock = 100'000'000;
// Steps of a place's coordinates in a search: x, y, z in m and the turn in rad.
using Coordinates = Eigen::Vector4d;

Coordinates coordinates_of(const Placing& p) {
  return {p.origin.x(), p.origin.y(), p.origin.z(), p.turn};
}
Placing placing_of_coordinates(const Coordinates& c) {
  return {c.head<3>(), c[3]};
}

PlaceFit fit_of_kind(const std::string& kind) {
  if (kind == "limit") return PlaceFit::limit;
  if (kind == "singular") return PlaceFit::singular;
  if (kind == "branch") return PlaceFit::branch;
  if (kind == "speed") return PlaceFit::speed;
  if (kind == "acceleration") return PlaceFit::acceleration;
  return PlaceFit::reach;
}

/// Some poses of a program: the ends of its moves and points between them, in W, and the posture of the first.
struct Poses {
  struct One {
    Vec3 p;     ///< m, in W
    Vec3 axes;  ///< A, B, C, rad
  };
  std::vector<One> poses;
  std::string posture;        ///< empty: the first within the limits
  std::vector<double> start;  ///< as CheckOptions::start
};

Poses poses_of(const gcode::Interpretation& interpretation, std::size_t most) {
  double length = 0;
  for (const gcode::Move& move : interpretation.moves)
    if (move.start_known) length += move.length();
  const double step = std::max(length / static_cast<double>(most), 1e-4);
  Poses all;
  for (const gcode::Move& move : interpretation.moves) {
    if (!(move.known_end[0] && move.known_end[1] && move.known_end[2])) continue;
    const double l = move.start_known ? move.length() : 0;
    const int n = std::max(1, static_cast<int>(std::floor(l / step)));
    for (int k = 1; k <= n; ++k) {
      const double share = double(k) / n;
      all.poses.push_back(
          {l > 0 ? move.point(share * l) : move.end, move.axes_start + share * (move.axes_end - move.axes_start)});
    }
  }
  if (all.poses.size() <= 2 * most) return all;
  // Programs of many short moves: the farthest in 26 directions, and every so many of the rest.
  std::vector<std::size_t> chosen;
  for (int x = -1; x <= 1; ++x)
    for (int y = -1; y <= 1; ++y)
      for (int z = -1; z <= 1; ++z) {
        const Vec3 d(x, y, z);
        const auto farther = [&](const Poses::One& a, const Poses::One& b) { return a.p.dot(d) < b.p.dot(d); };
        chosen.push_back(static_cast<std::size_t>(std::max_element(all.poses.begin(), all.poses.end(), farther) -
                                                  all.poses.begin()));
      }
  const std::size_t stride = all.poses.size() / most + 1;
  for (std::size_t i = 0; i < all.poses.size(); i += stride) chosen.push_back(i);
  std::sort(chosen.begin(), chosen.end());
  chosen.erase(std::unique(chosen.begin(), chosen.end()), chosen.end());
  Poses out;
  for (const std::size_t i : chosen) out.poses.push_back(all.poses[i]);
  return out;
}

/// Whether the machine takes these poses with W at a place, and how near its joints come to the ends of their ranges.
PlaceFit look(const machine::AnyMachine& machine, const Poses& poses, const Pose& X_MW, double* margin = nullptr) {
  const int n = kinematics::joint_count(machine);
  machine::JointVector last;
  const machine::JointVector start = Eigen::Map<const Eigen::VectorXd>(poses.start.data(), std::ssize(poses.start));
  kinematics::HoldOnPath held(machine);
  double least = 0.5;
  for (const Poses::One& one : poses.poses) {
    const Pose X{tool_orientation(machine, X_MW, one.axes), X_MW * one.p};
    const bool follows = last.size() > 0;
    const machine::JointVector& near = follows ? last : start;
    const kinematics::InverseResult inverse =
        near.size() > 0 ? kinematics::inverse_near(machine, X, near) : kinematics::inverse(machine, X);
    if (inverse.solutions.empty()) return PlaceFit::reach;
    const kinematics::Solution* best =
        follows ? inverse.reachable() : kinematics::reachable_in(machine, inverse, poses.posture);
    if (best == nullptr) return PlaceFit::limit;
    if (best->singular) return PlaceFit::singular;
    if (held.next(X, best->joints) != kinematics::HoldOnPath::At::held) return PlaceFit::singular;
    last = best->joints;
    if (margin == nullptr) continue;
    for (int i = 0; i < n; ++i) {
      const machine::JointRange r = kinematics::joint_range(machine, i);
      if (!(r.max > r.min) || !std::isfinite(r.max - r.min)) continue;
      least = std::min(least, std::min(last[i] - r.min, r.max - last[i]) / (r.max - r.min));
    }
  }
  if (margin != nullptr) *margin = std::max(least, 0.0);
  return PlaceFit::fits;
}

/// A program, and what it is with the other position of block delete if that differs.
struct Both {
  const gcode::Program& program;
  const gcode::Interpretation& interpretation;
  const gcode::Understood* other = nullptr;
  MotionLimits limits;
  std::string posture;
  std::vector<double> start;

  [[nodiscard]] bool may_turn(const machine::AnyMachine& machine) const {
    return may_turn_the_part(machine, interpretation) &&
           (other == nullptr || may_turn_the_part(machine, other->interpretation));
  }
  [[nodiscard]] Poses poses() const {
    Poses out = poses_of(interpretation, kMostPoints);
    out.posture = posture;
    out.start = start;
    if (other == nullptr) return out;
    const Poses more = poses_of(other->interpretation, kMostPoints);
    out.poses.insert(out.poses.end(), more.poses.begin(), more.poses.end());
    return out;
  }
};

/// What `check` says of the whole program at a place.
Result<PlaceFit> check_whole(const machine::AnyMachine& machine, const Pose& X_MW, const Both& both) {
  CheckOptions options;
  options.stop_at_first = true;
  options.limits = both.limits;
  options.branch = both.posture;
  options.start = both.start;
  POLYPOD_ASSIGN(checked, check(machine, X_MW, both.program, both.interpretation, options));
  if (checked.problems.empty() && both.other != nullptr) {
    POLYPOD_ASSIGN(other, check(machine, X_MW, both.other->program, both.other->interpretation, options));
    checked = std::move(other);
  }
  if (checked.problems.empty()) return PlaceFit::fits;
  return fit_of_kind(checked.problems.front().kind);
}

/// A cut of the reference prediction: where it is, its force, and the normal of its path, in W, A, B and C, and the
/// programmed move.
struct Cut {
  Vec3 p, force, away, axes;
  const gcode::Move* move;
};

class Search {
 public:
  Search(const Job& job, const gcode::Program& program, const gcode::Interpretation& interpretation,
         const PlaceOptions& options)
      : job_(job),
        program_(program),
        interpretation_(interpretation),
        options_(options),
        both_{program, interpretation, options.other, motion_limits(job), job.posture, job.start_joints},
        poses_(both_.poses()) {}

  Result<PlaceResult> run() {
    out_.by = options_.by;
    out_.start = placing_of(job_);
    if (options_.other != nullptr)
      POLYPOD_TRY(stands_as_set_up(job_, options_.other->program, options_.other->interpretation));
    out_.looked_at = poses_.poses.size();
    POLYPOD_ASSIGN(fit, check_at(out_.start));
    out_.start_fit = fit;
    POLYPOD_TRY(look_at_start());
    if (!reference_) return std::move(out_);
    POLYPOD_TRY(choose_box());
    POLYPOD_TRY(estimate_grid());
    POLYPOD_TRY(judge_grid());
    POLYPOD_TRY(refine());
    POLYPOD_TRY(finish());
    return std::move(out_);
  }

 private:
  Status report(double share, const char* what) const {
    if (!options_.progress || options_.progress(share, what)) return {};
    return fail("MC299", "cancelled");
  }

  Result<PlaceFit> check_at(const Placing& at) const {
    if (const PlaceFit coarse = look(job_.machine, poses_, at.pose()); coarse != PlaceFit::fits) return coarse;
    return check_whole(job_.machine, at.pose(), both_);
  }

  /// What one prediction after the other needs, which with a large stock takes as long to make as a prediction.
  struct Bench {
    Job job;
    cutting::Stock scratch;
  };
  /// A bench of this search's, as long as it is needed: one made before, if it is free.
  class Loan {
   public:
    explicit Loan(const Search& search) : search_(search) {
      {
        const std::lock_guard lock(search_.benches_in_use_);
        if (!search_.benches_.empty()) {
          bench_ = std::move(search_.benches_.back());
          search_.benches_.pop_back();
        }
      }
      if (!bench_) bench_ = std::make_unique<Bench>(Bench{search_.job_, {}});
    }
    Loan(const Loan&) = delete;
    Loan& operator=(const Loan&) = delete;
    ~Loan() {
      const std::lock_guard lock(search_.benches_in_use_);
      search_.benches_.push_back(std::move(bench_));
    }
    Bench* operator->() const { return bench_.get(); }

   private:
    const Search& search_;
    std::unique_ptr<Bench> bench_;
  };

  /// The job as it was, begun where its place asks for it.
  void begin(Job& job) const {
    job.start_joints = job_.start_joints;
    job.posture = job_.posture;
    choose_start(interpretation_, job);
  }

  /// The prediction at a place; none where the machine cannot follow the program, or no compliance is known.
  Result<std::optional<Prediction>> predict_at(const Placing& at, bool keep_samples = false) const {
    PredictOptions options;
    options.keep_samples = keep_samples;
    options.again = options_.again;
    options.one_position = true;
    options.progress = [this](double) { return !stop_; };
    const Loan bench(*this);
    put(bench->job, at.pose());
    begin(bench->job);
    auto prediction = predict_in(bench->job, program_, interpretation_, options, bench->scratch);
    if (!prediction) {
      const std::string& id = prediction.error().id;
      if (id == "MC210" || id == "MC211" || id == "MC212") return std::nullopt;
      return tl::unexpected(prediction.error());
    }
    return std::move(*prediction);
  }

  /// The reference of the forces: the start, or the nearest place within reach. It is an answer where all of `check`
  /// passes, speeds and accelerations of the joints included.
  Status look_at_start() {
    POLYPOD_TRY(report(0, "predicting at the start"));
    std::optional<Placing> at;
    if (out_.start_fit == PlaceFit::fits) {
      at = out_.start;
    } else {
      NearestOptions options;
      options.other = options_.other;
      options.posture = job_.posture;
      options.start = job_.start_joints;
      options.progress = [this](double share) {
        return !options_.progress || options_.progress(share, "looking for a place that fits");
      };
      POLYPOD_ASSIGN(nearest, nearest_places(job_.machine, job_.X_MW, program_, interpretation_, options));
      at = nearest.by_shift ? nearest.by_shift : nearest.by_turn;
    }
    if (!at) return {};
    POLYPOD_ASSIGN(prediction, predict_at(*at, true));
    if (!prediction) {
      if (out_.start_fit == PlaceFit::fits) out_.start_fit = PlaceFit::measured;
      return {};
    }
    POLYPOD_TRY(no_rapid_cuts(job_, program_, prediction->pass));
    take_cuts(*prediction);
    reference_ = at;
    out_.reference = *at;
    const PlacePoint estimated = estimate(*at);
    const JudgedPlace judged{*at, largest_normal_error(*prediction), estimated.error, prediction->largest_distance,
                             estimated.distance};
    if (out_.start_fit == PlaceFit::fits) {
      out_.start_error = judged.error;
      out_.start_distance = judged.distance;
      out_.judged.push_back(judged);
      return {};
    }
    POLYPOD_ASSIGN(fit, check_whole(job_.machine, at->pose(), both_));
    if (fit == PlaceFit::fits) out_.judged.push_back(judged);
    return {};
  }

  /// Of each move the cut with the largest figure, and others at equal distances.
  void take_cuts(const Prediction& prediction) {
    const ToolFrame& frame = job_.tool_frame;
    const auto add = [&](const Sample& s) {
      cuts_.push_back({s.command, s.force, s.away, frame.turns ? s.axes : frame.axes,
                       &interpretation_.moves[static_cast<std::size_t>(s.move)]});
    };
    const auto figure = [&](const Sample& s) {
      return options_.by == PlaceBy::distance ? double(s.distance) : std::abs(double(s.normal));
    };
    std::vector<const Sample*> largest;
    for (const Sample& s : prediction.samples) {
      if (!s.cutting) continue;
      if (largest.empty() || largest.back()->move != s.move) {
        largest.push_back(&s);
      } else if (figure(s) > figure(*largest.back())) {
        largest.back() = &s;
      }
    }
    std::stable_sort(largest.begin(), largest.end(),
                     [&](const Sample* a, const Sample* b) { return figure(*a) > figure(*b); });
    if (largest.size() > kMostPoints / 2) largest.resize(kMostPoints / 2);
    for (const Sample* s : largest) add(*s);
    for (const Sample& s : prediction.few) add(s);
  }

  [[nodiscard]] PlacePoint estimate(const Placing& at) const {
    PlacePoint out;
    out.at = at;
    const Pose X_MW = at.pose();
    out.fit = look(job_.machine, poses_, X_MW, &out.margin);
    if (out.fit != PlaceFit::fits) return out;
    const auto tool_at = [&](const Vec3& axes) { return tool_orientation(job_.machine, X_MW, axes); };
    const Mat3 R = tool_at(job_.tool_frame.axes);
    std::string posture = job_.posture;
    std::vector<double> start = job_.start_joints;
    if (start.empty()) {
      if (const auto beginning = look_ahead(job_.machine, X_MW, interpretation_, posture)) {
        start.assign(beginning->joints.begin(), beginning->joints.end());
        posture = beginning->posture;
      }
    }
    statics::Probe probe(job_.machine, R, posture, start);
    // How far the weight of the machine deflects the tip where the probe stands.
    const auto by_weight = [&](const Vec3& p) -> Vec3 {
      if (!job_.weights) return Vec3::Zero();
      const Pose X = kinematics::settled(job_.machine, Pose{R, p}, probe.joints());
      return motion::weight_twist(job_.machine, *job_.weights, X, probe.joints()).head<3>();
    };
    Mat3 C;
    if (job_.weights && !probe.at(X_MW.p, C)) {  // where it would be taken as known
      out.fit = PlaceFit::limit;
      return out;
    }
    const Vec3 at_origin = by_weight(X_MW.p);
    for (const Cut& cut : cuts_) {
      const Vec3 p = X_MW * cut.p, F = X_MW.R * cut.force, n = X_MW.R * cut.away;
      if (job_.tool_frame.turns) probe.turn_to(tool_at(cut.axes));
      if (!probe.at(p, C)) {
        out.fit = PlaceFit::limit;
        return out;
      }
      if (job_.measured) {
        if (!job_.measured->map.covers(p)) {
          out.fit = PlaceFit::measured;
          return out;
        }
        C = job_.measured->map.at(p);
      }
      const Vec3 deflection = C * F + by_weight(p) - at_origin;
      out.error = std::max(out.error, std::abs(n.dot(deflection)));
      const Vec3 bent = cut.p + X_MW.R.transpose() * deflection;
      out.distance =
          std::max(out.distance, path_error(*cut.move, bent + middle_beside_tip(job_, *cut.move, bent, cut.axes),
                                            cut.away, job_.tool_frame.axis())
                                     .distance);
      out.compliance = std::max(out.compliance, n.dot(C * n));
    }
    return out;
  }

  /// How far the part can go from the reference in a direction, m; by doubling, then halving.
  [[nodiscard]] double way(const Vec3& direction) const {
    const machine::Reach reach = kinematics::reach(job_.machine);
    const double most = (reach.high - reach.low).norm();
    const auto fits = [&](double d) {
      return look(job_.machine, poses_, Placing{reference_->origin + d * direction, reference_->turn}.pose()) ==
             PlaceFit::fits;
    };
    double good = 0, bad = most;
    for (double d = most / 1024; d < most; d *= 1.5) {
      if (!fits(d)) {
        bad = d;
        break;
      }
      good = d;
    }
    for (int i = 0; i < 12; ++i) {
      const double middle = 0.5 * (good + bad);
      (fits(middle) ? good : bad) = middle;
    }
    return good;
  }

  Status choose_box() {
    for (int k = 0; k < 3; ++k) {
      const auto i = static_cast<std::size_t>(k);
      if (options_.box[i]) {
        out_.box[i] = *options_.box[i];
      } else {
        out_.box[i] = {reference_->origin[k] - way(-Vec3::Unit(k)), reference_->origin[k] + way(Vec3::Unit(k))};
      }
      if (!(out_.box[i].max >= out_.box[i].min)) {
        return fail("MC400",
                    fmt::format("the range of {} of the origin is empty: {:g} .. {:g} mm", "xyz"[k],
                                units::to_mm(out_.box[i].min), units::to_mm(out_.box[i].max)),
                    {}, "give the smaller end first");
      }
    }
    out_.turns = options_.turns.value_or(machine::JointRange{-std::numbers::pi, std::numbers::pi});
    if (!both_.may_turn(job_.machine)) {
      const double as_it_is = out_.start.turn;
      constexpr double kSame = 1e-9;  // rad
      const double off = std::remainder(out_.turns.min - as_it_is, 2 * std::numbers::pi);
      if (options_.turns && !(std::abs(off) < kSame && out_.turns.max - out_.turns.min < kSame)) {
        return fail("MC402",
                    fmt::format("the part cannot be turned: the program tilts the tool by A and B, which are axes of "
                                "the machine and do not turn with it; it stands at {:g} deg",
                                units::to_deg(as_it_is)),
                    {program_.path}, "leave the range of rotations out, and post the program anew for a turned part");
      }
      out_.turns = {as_it_is, as_it_is};
      out_.held = true;
    }
    if (!(out_.turns.max >= out_.turns.min)) {
      return fail("MC400",
                  fmt::format("the range of rotations is empty: {:g} .. {:g} deg", units::to_deg(out_.turns.min),
                              units::to_deg(out_.turns.max)),
                  {}, "give the smaller end first");
    }
    return {};
  }

  [[nodiscard]] double figure(const PlacePoint& p) const { return figure_of(p, options_.by); }
  [[nodiscard]] double figure(const JudgedPlace& p) const { return figure_of(p, options_.by); }
  [[nodiscard]] bool whole_turn() const { return out_.turns.max - out_.turns.min > 2 * std::numbers::pi - 1e-9; }
  [[nodiscard]] double low(int k) const { return k < 3 ? out_.box[static_cast<std::size_t>(k)].min : out_.turns.min; }
  [[nodiscard]] double high(int k) const { return k < 3 ? out_.box[static_cast<std::size_t>(k)].max : out_.turns.max; }
  /// Values of coordinate k in the grid, and the step between them.
  [[nodiscard]] int count(int k) const {
    if (!(high(k) > low(k))) return 1;
    if (k == 2) return std::max(2, (options_.resolution + 1) / 2);  // the height changes least
    return k < 2 ? options_.resolution : options_.rotations;
  }
  [[nodiscard]] double step(int k) const {
    const int n = k == 3 && whole_turn() ? count(k) : count(k) - 1;
    return n > 0 ? (high(k) - low(k)) / n : 0;
  }

  [[nodiscard]] Placing grid_place(std::size_t i) const {
    Coordinates c;
    for (int k = 0; k < 4; ++k) {
      const auto n = static_cast<std::size_t>(count(k));
      c[k] = low(k) + step(k) * static_cast<double>(i % n);
      i /= n;
    }
    return placing_of_coordinates(c);
  }

  /// Estimates of many places, in order.
  Result<std::vector<PlacePoint>> estimates(std::size_t count, const std::function<Placing(std::size_t)>& place,
                                            const char* what) const {
    std::vector<PlacePoint> out(count);
    ParallelOptions parallel;
    parallel.threads = options_.threads;
    bool stopped = false;
    parallel.cancelled = [&] { return stopped; };
    parallel.progress = [&](double share) {
      if (what != nullptr && !report(share, what)) stopped = true;
    };
    if (!for_each_in_rounds(count, parallel, [&](std::size_t i) { out[i] = estimate(place(i)); }) || stopped) {
      return fail("MC299", "cancelled");
    }
    return out;
  }

  Status estimate_grid() {
    std::size_t total = 1;
    for (int k = 0; k < 4; ++k) total *= static_cast<std::size_t>(count(k));
    POLYPOD_ASSIGN(grid, estimates(
                             total, [&](std::size_t i) { return grid_place(i); }, "looking at places"));
    grid_ = std::move(grid);
    out_.places = grid_.size();
    for (const PlacePoint& p : grid_) out_.fitting += p.fit == PlaceFit::fits;
    return {};
  }

  /// Fitting places of the grid, the best first, that are no neighbours of each other, and pass the whole check.
  Result<std::vector<PlacePoint>> candidates() {
    std::vector<std::size_t> order;
    for (std::size_t i = 0; i < grid_.size(); ++i)
      if (grid_[i].fit == PlaceFit::fits) order.push_back(i);
    std::stable_sort(order.begin(), order.end(),
                     [&](std::size_t a, std::size_t b) { return figure(grid_[a]) < figure(grid_[b]); });
    std::vector<PlacePoint> out;
    constexpr std::size_t kMostChecks = 200;
    std::size_t checks = 0;
    for (const std::size_t i : order) {
      if (out.size() >= static_cast<std::size_t>(options_.judged) || checks >= kMostChecks) break;
      const Coordinates c = coordinates_of(grid_[i].at);
      const bool near = std::any_of(out.begin(), out.end(), [&](const PlacePoint& o) {
        Coordinates d = (coordinates_of(o.at) - c).cwiseAbs();
        d[3] = std::abs(std::remainder(d[3], 2 * std::numbers::pi));
        for (int k = 0; k < 4; ++k)
          if (d[k] > 1.5 * step(k)) return false;
        return true;
      });
      if (near) continue;
      ++checks;
      POLYPOD_TRY(report(double(out.size()) / options_.judged, "checking the best places"));
      POLYPOD_ASSIGN(fit, check_whole(job_.machine, grid_[i].at.pose(), both_));
      if (fit == PlaceFit::fits) {
        out.push_back(grid_[i]);
      } else if (out_.failed++ == 0) {
        out_.failed_by = fit;
      }
    }
    return out;
  }

  /// `predict` at these places, in order; those where it finds no way are left out.
  Status judge(const std::vector<PlacePoint>& places, const char* what) {
    std::vector<std::optional<JudgedPlace>> judged(places.size());
    std::vector<std::optional<Error>> errors(places.size());
    std::atomic<std::size_t> done{0};
    std::mutex mutex;
    ParallelOptions parallel;
    parallel.threads = job_.stock.layers().size() * sizeof(float) > kLargestParallelStock ? 1 : options_.threads;
    const auto one = [&](std::size_t i) {
      if (stop_) return;
      auto prediction = predict_at(places[i].at);
      if (!prediction) {
        errors[i] = prediction.error();
        stop_ = true;
      } else if (*prediction) {
        judged[i] = JudgedPlace{places[i].at, largest_normal_error(**prediction), places[i].error,
                                (*prediction)->largest_distance, places[i].distance};
      }
      const std::lock_guard lock(mutex);
      if (!report(double(++done) / double(places.size()), what)) stop_ = true;
    };
    for_each_in_rounds(places.size(), parallel, one, 1);
    for (const std::optional<Error>& error : errors)
      if (error && error->id != "MC299") return tl::unexpected(*error);
    if (stop_) return fail("MC299", "cancelled");
    for (const std::optional<JudgedPlace>& j : judged)
      if (j) out_.judged.push_back(*j);
    return {};
  }

  Status judge_grid() {
    POLYPOD_ASSIGN(places, candidates());
    return judge(places, "predicting at the best places");
  }

  /// To what a person writes into a job.
  [[nodiscard]] Coordinates rounded(const Coordinates& c) const {
    Coordinates out = c;
    for (int k = 0; k < 3; ++k) {
      if (high(k) > low(k)) out[k] = std::clamp(std::round(c[k] / options_.finest) * options_.finest, low(k), high(k));
    }
    if (high(3) > low(3)) {
      const double turn = whole_turn() ? std::remainder(c[3], 2 * std::numbers::pi) : c[3];
      const double tenth = units::from_deg(0.1);
      const double grain = std::max(tenth, std::round(options_.finest_turn / tenth) * tenth);
      out[3] = std::round(turn / grain) * grain;
      if (!whole_turn()) out[3] = std::clamp(out[3], low(3), high(3));
    }
    return out;
  }

  /// From a place downhill on the estimates, by steps that halve.
  Result<PlacePoint> downhill(const PlacePoint& from) const {
    PlacePoint best = from;
    Coordinates steps(step(0) / 2, step(1) / 2, step(2) / 2, step(3) / 2);
    constexpr int kMostRounds = 200;
    for (int round = 0; round < kMostRounds; ++round) {
      const Coordinates c = coordinates_of(best.at);
      std::vector<Placing> around;
      for (int k = 0; k < 4; ++k) {
        for (const double sign : {-1.0, 1.0}) {
          Coordinates d = c;
          d[k] += sign * steps[k];
          if (steps[k] == 0) continue;
          if (k < 3 || !whole_turn()) d[k] = std::clamp(d[k], low(k), high(k));
          around.push_back(placing_of_coordinates(rounded(d)));
        }
      }
      // The largest error is a ridge where two cuts are equally bad: along it two coordinates change together.
      for (int k = 0; k < 4; ++k) {
        for (int l = k + 1; l < 4; ++l) {
          for (const int signs : {0, 1, 2, 3}) {
            if (steps[k] == 0 || steps[l] == 0) continue;
            Coordinates d = c;
            d[k] += (signs & 1) != 0 ? steps[k] : -steps[k];
            d[l] += (signs & 2) != 0 ? steps[l] : -steps[l];
            for (const int m : {k, l})
              if (m < 3 || !whole_turn()) d[m] = std::clamp(d[m], low(m), high(m));
            around.push_back(placing_of_coordinates(rounded(d)));
          }
        }
      }
      POLYPOD_ASSIGN(points, estimates(
                                 around.size(), [&](std::size_t i) { return around[i]; }, nullptr));
      const PlacePoint* next = nullptr;
      for (const PlacePoint& p : points) {
        if (p.fit != PlaceFit::fits || !(figure(p) < figure(best))) continue;
        if (next == nullptr || figure(p) < figure(*next)) next = &p;
      }
      if (next != nullptr) {
        best = *next;
        continue;
      }
      bool fine = true;
      for (int k = 0; k < 4; ++k) {
        const double finest = k < 3 ? 10 * options_.finest : 10 * options_.finest_turn;
        if (steps[k] > finest) fine = false;
        steps[k] = steps[k] > finest ? 0.5 * steps[k] : steps[k];
      }
      if (fine) break;
      POLYPOD_TRY(report(double(round) / kMostRounds, "looking closer"));
    }
    return best;
  }

  /// The best places, each led downhill on the estimates; a way to a place that fails the whole check is cut back. The
  /// best of the ends are judged.
  Status refine() {
    const auto better = [&](const JudgedPlace& a, const JudgedPlace& b) { return figure(a) < figure(b); };
    std::stable_sort(out_.judged.begin(), out_.judged.end(), better);
    constexpr std::size_t kStarts = 5, kEnds = 3;
    std::vector<PlacePoint> found;
    for (std::size_t i = 0; i < std::min(kStarts, out_.judged.size()); ++i) {
      const PlacePoint from = estimate(out_.judged[i].at);
      if (from.fit != PlaceFit::fits || !in_box(from.at)) continue;
      POLYPOD_ASSIGN(end, downhill(from));
      const Coordinates a = coordinates_of(from.at), b = coordinates_of(end.at);
      for (const double share : {1.0, 0.9, 0.75, 0.5, 0.25}) {
        const PlacePoint at = estimate(placing_of_coordinates(rounded(a + share * (b - a))));
        if (at.fit != PlaceFit::fits) continue;
        POLYPOD_ASSIGN(fit, check_whole(job_.machine, at.at.pose(), both_));
        if (fit != PlaceFit::fits) continue;
        const auto same = [&](const auto& other) { return coordinates_of(other.at) == coordinates_of(at.at); };
        const bool known =
            std::any_of(found.begin(), found.end(), same) || std::any_of(out_.judged.begin(), out_.judged.end(), same);
        if (!known) found.push_back(at);
        break;
      }
    }
    std::stable_sort(found.begin(), found.end(),
                     [&](const PlacePoint& a, const PlacePoint& b) { return figure(a) < figure(b); });
    if (found.size() > kEnds) found.resize(kEnds);
    POLYPOD_TRY(judge(found, "predicting at what was found"));
    std::stable_sort(out_.judged.begin(), out_.judged.end(), better);
    return {};
  }

  [[nodiscard]] bool in_box(const Placing& at) const {
    const Coordinates c = coordinates_of(at);
    for (int k = 0; k < (whole_turn() ? 3 : 4); ++k)
      if (c[k] < low(k) - 1e-9 || c[k] > high(k) + 1e-9) return false;
    return true;
  }

  Status finish() {
    // A start or a reference beside the box is no answer: only within it the part can stand.
    const auto inside =
        std::find_if(out_.judged.begin(), out_.judged.end(), [&](const JudgedPlace& j) { return in_box(j.at); });
    if (inside == out_.judged.end()) return {};
    out_.best = *inside;
    const Coordinates c = coordinates_of(out_.best->at);
    for (int k = 0; k < (whole_turn() ? 3 : 4); ++k) {
      const double near = 0.02 * (high(k) - low(k));
      if (high(k) > low(k) && (c[k] < low(k) + near || c[k] > high(k) - near)) out_.at_border = true;
    }
    PlaceMap& map = out_.map;
    map.z = c[2];
    map.turn = c[3];
    map.x = out_.box[0];
    map.y = out_.box[1];
    constexpr int kFine = 2;
    map.columns = count(0) > 1 ? kFine * (count(0) - 1) + 1 : 1;
    map.rows = count(1) > 1 ? kFine * (count(1) - 1) + 1 : 1;
    const auto along = [](const machine::JointRange& r, int i, int n) {
      return n > 1 ? r.min + (r.max - r.min) * i / (n - 1) : r.min;
    };
    const auto columns = static_cast<std::size_t>(map.columns);
    const auto map_place = [&](std::size_t i) {
      return Placing{{along(map.x, static_cast<int>(i % columns), map.columns),
                      along(map.y, static_cast<int>(i / columns), map.rows), map.z},
                     map.turn};
    };
    POLYPOD_ASSIGN(points, estimates(columns * static_cast<std::size_t>(map.rows), map_place, "drawing the map"));
    map.points = std::move(points);
    const int turns = count(3) > 1 ? 73 : 1;
    const auto turned = [&](std::size_t i) {
      return Placing{out_.best->at.origin, along(out_.turns, static_cast<int>(i), turns)};
    };
    POLYPOD_ASSIGN(rotations, estimates(static_cast<std::size_t>(turns), turned, "drawing the map"));
    out_.rotations = std::move(rotations);
    return {};
  }

  const Job& job_;
  const gcode::Program& program_;
  const gcode::Interpretation& interpretation_;
  const PlaceOptions& options_;
  Both both_;
  const Poses poses_;
  std::vector<Cut> cuts_;
  std::optional<Placing> reference_;
  std::vector<PlacePoint> grid_;
  mutable std::mutex benches_in_use_;
  mutable std::vector<std::unique_ptr<Bench>> benches_;
  mutable std::atomic<bool> stop_{false};
  PlaceResult out_;
};

/// Evenly spread directions (Fibonacci's spiral).
std::vector<Vec3> directions(int count) {
  std::vector<Vec3> out;
  const double golden = std::numbers::pi * (3 - std::sqrt(5.0));
  for (int i = 0; i < count; ++i) {
    const double z = 1 - 2 * (i + 0.5) / count, r = std::sqrt(1 - z * z);
    out.emplace_back(r * std::cos(golden * i), r * std::sin(golden * i), z);
  }
  for (int k = 0; k < 3; ++k)
    for (const double sign : {-1.0, 1.0}) out.emplace_back(sign * Vec3::Unit(k));
  return out;
}

class Nearest {
 public:
  Nearest(const machine::AnyMachine& machine, const Pose& X_MW, const gcode::Program& program,
          const gcode::Interpretation& interpretation, const NearestOptions& options)
      : machine_(machine),
        start_{X_MW.p, rotation_of(X_MW)},
        options_(options),
        both_{program, interpretation, options.other, options.limits, options.posture, options.start},
        poses_(both_.poses()) {}

  Result<NearestPlaces> run() {
    const machine::Reach reach = kinematics::reach(machine_);
    out_.looked_to = (reach.high - reach.low).norm();
    POLYPOD_TRY(by_shift());
    POLYPOD_TRY(by_turn());
    return out_;
  }

 private:
  [[nodiscard]] bool seems_to_fit(const Placing& at) const {
    return look(machine_, poses_, at.pose()) == PlaceFit::fits;
  }
  Result<bool> fits(const Placing& at) const {
    if (!seems_to_fit(at)) return false;
    POLYPOD_ASSIGN(fit, check_whole(machine_, at.pose(), both_));
    return fit == PlaceFit::fits;
  }
  Status report(double share) const {
    if (!options_.progress || options_.progress(share)) return {};
    return fail("MC299", "cancelled");
  }
  [[nodiscard]] Placing shifted(const Vec3& by) const { return {start_.origin + by, start_.turn}; }

  /// The smallest way in a direction between one that does not and one that seems to fit.
  [[nodiscard]] double smallest(const Vec3& direction, double bad, double good) const {
    while (good - bad > 0.25 * options_.finest) {
      const double middle = 0.5 * (bad + good);
      (seems_to_fit(shifted(middle * direction)) ? good : bad) = middle;
    }
    return good;
  }

  /// A direction near d with a smaller way, by ever smaller turns of it.
  [[nodiscard]] std::pair<Vec3, double> improved(Vec3 d, double way, double bad) const {
    for (double turn = 0.1; turn > 1e-4;) {
      const Vec3 across = d.unitOrthogonal(), other = d.cross(across);
      bool better = false;
      for (const Vec3& side : {across, Vec3(-across), other, Vec3(-other)}) {
        const Vec3 e = (d + turn * side).normalized();
        if (!seems_to_fit(shifted(way * e))) continue;
        const double w = smallest(e, bad, way);
        if (w >= way - 1e-9) continue;
        d = e;
        way = w;
        better = true;
        break;
      }
      if (!better) turn *= 0.5;
    }
    return {d, way};
  }

  Status by_shift() {
    const std::vector<Vec3> all = directions(200);
    double before = 0;
    constexpr double kGrowth = 1.25;
    for (double way = out_.looked_to / 2000; way < out_.looked_to; way *= kGrowth) {
      POLYPOD_TRY(report(0.9 * way / out_.looked_to));
      struct Found {
        Vec3 direction;
        double way;
      };
      std::vector<Found> found;
      for (const Vec3& d : all)
        if (seems_to_fit(shifted(way * d))) found.push_back({d, smallest(d, before, way)});
      std::stable_sort(found.begin(), found.end(), [](const Found& a, const Found& b) { return a.way < b.way; });
      constexpr std::size_t kTried = 4;
      if (found.size() > kTried) found.resize(kTried);
      std::optional<Placing> best;
      double least = kInfinity;
      for (const Found& f : found) {
        const auto [direction, least_way] = improved(f.direction, f.way, 0);
        POLYPOD_ASSIGN(at, written(direction, least_way));
        if (!at || (at->origin - start_.origin).norm() >= least) continue;
        best = at;
        least = (at->origin - start_.origin).norm();
      }
      if (best) {
        out_.by_shift = best;
        return {};
      }
      before = way;
    }
    return {};
  }

  /// A shift to what a person writes, a little longer where rounding or the whole check asks for it.
  Result<std::optional<Placing>> written(const Vec3& direction, double way) const {
    for (int i = 0; i < 12; ++i) {
      const double longer = way + (i == 0 ? 0 : options_.finest * std::pow(2.0, i - 1));
      const Vec3 by = (direction * longer / options_.finest).array().round() * options_.finest;
      const Placing at = shifted(by);
      POLYPOD_ASSIGN(good, fits(at));
      if (good) return at;
    }
    return std::nullopt;
  }

  Status by_turn() {
    if (!both_.may_turn(machine_)) return {};
    const double degree = units::from_deg(1);
    for (int i = 1; i <= 180; ++i) {
      POLYPOD_TRY(report(0.9 + 0.1 * i / 180));
      for (const double sign : {1.0, -1.0}) {
        const auto turned = [&](double by) { return Placing{start_.origin, start_.turn + sign * by}; };
        if (!seems_to_fit(turned(i * degree))) continue;
        double bad = (i - 1) * degree, good = i * degree;
        while (good - bad > 0.25 * options_.finest_turn) {
          const double middle = 0.5 * (bad + good);
          (seems_to_fit(turned(middle)) ? good : bad) = middle;
        }
        const double tenth = units::from_deg(0.1);
        for (int k = 0; k < 12; ++k) {
          const double by = std::ceil(good / tenth - 1e-9) * tenth + k * tenth;
          POLYPOD_ASSIGN(fit, fits(turned(by)));
          if (!fit) continue;
          out_.by_turn = turned(by);
          return {};
        }
      }
    }
    return {};
  }

  const machine::AnyMachine& machine_;
  const Placing start_;
  const NearestOptions& options_;
  Both both_;
  const Poses poses_;
  NearestPlaces out_;
};

}  // namespace

Placing placing_of(const Job& job) {
  return {job.X_MW.p, rotation_of(job.X_MW)};
}

Job placed_at(const Job& job, const Placing& at) {
  Job out = job;
  put(out, at.pose());
  return out;
}

const char* name_of(PlaceFit fit) {
  switch (fit) {
    case PlaceFit::fits:
      return "fits";
    case PlaceFit::reach:
      return "reach";
    case PlaceFit::limit:
      return "limit";
    case PlaceFit::singular:
      return "singular";
    case PlaceFit::branch:
      return "branch";
    case PlaceFit::speed:
      return "speed";
    case PlaceFit::acceleration:
      return "acceleration";
    case PlaceFit::measured:
      break;
  }
  return "not measured";
}

bool PlaceResult::farther_there() const {
  constexpr double kSame = 1e-6;  // m
  return best && start_distance && best->distance > *start_distance + kSame;
}

double figure_of(const PlacePoint& place, PlaceBy by) {
  return by == PlaceBy::distance ? place.distance : place.error;
}
double figure_of(const JudgedPlace& place, PlaceBy by) {
  return by == PlaceBy::distance ? place.distance : place.error;
}

double largest_normal_error(const Prediction& prediction) {
  return std::max(std::abs(prediction.normal.min), std::abs(prediction.normal.max));
}

Result<PlaceResult> best_place(const Job& job, const gcode::Program& program,
                               const gcode::Interpretation& interpretation, const PlaceOptions& options) {
  POLYPOD_TRY(follows_programs(job.machine));
  if (!job.measured) POLYPOD_TRY(statics::needs_compliance(job.machine));
  const auto feeds = [](const gcode::Move& move) { return move.kind != gcode::MoveKind::rapid; };
  if (std::none_of(interpretation.moves.begin(), interpretation.moves.end(), feeds))
    return tl::unexpected(cuts_nothing(job, program, interpretation));
  POLYPOD_TRY(known_offsets(job, program, interpretation));
  return Search(job, program, interpretation, options).run();
}

Result<NearestPlaces> nearest_places(const machine::AnyMachine& machine, const Pose& X_MW,
                                     const gcode::Program& program, const gcode::Interpretation& interpretation,
                                     const NearestOptions& options) {
  POLYPOD_TRY(follows_programs(machine));
  return Nearest(machine, X_MW, program, interpretation, options).run();
}

}  // namespace polypod::machining
