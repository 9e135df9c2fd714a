// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/control/online.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <complex>
#include <deque>
#include <limits>
#include <numbers>

#include "polypod/core/random.hpp"
#include "polypod/core/units.hpp"
#include "polypod/cutting/force.hpp"
#include "polypod/machining/accept.hpp"
#include "polypod/machining/tilted.hpp"
#include "polypod/machining/yielding.hpp"
#include "polypod/statics/compliance.hpp"

namespace polypod::control {
namespace {

using machining::Job;
using machining::PassMove;

constexpr double kInfinite = std::numeric_limits<double>::infinity();
constexpr int kDirections = 32;        // of machining::yield_step
constexpr double kNoCut = 1e-6;        // m, thinner layers are no cut
constexpr double kThinChip = 20e-6;    // m, for which forces are taken to grow in proportion
constexpr double kVertical = 1e-6;     // share of the length below which a move goes down
constexpr double kAside = 0.1e-3;      // m, by which a tip is moved to see what the force does
constexpr std::size_t kSeeEvery = 50;  // cycles between two looks at stiffness and damping of the cut
constexpr double kSettles = 0.2;       // s, of a rapid move
constexpr int kRimStrips = 3;          // at each rim, that say whether there is a wall

/// A commanded move with the programmed one that it is judged against.
struct Commanded {
  gcode::Move move;
  const gcode::Move* meant = nullptr;
  int line = 0;
  bool transition = false;
  std::vector<std::pair<double, Vec3>> expected;  ///< force over the way, N, in W
};

Vec3 expected_at(const Commanded& c, double s) {
  if (c.expected.empty()) return Vec3::Zero();
  const auto after = std::lower_bound(c.expected.begin(), c.expected.end(), s,
                                      [](const auto& item, double at) { return item.first < at; });
  if (after == c.expected.begin()) return after->second;
  if (after == c.expected.end()) return c.expected.back().second;
  const auto& [s0, f0] = *(after - 1);
  const double t = after->first > s0 ? (s - s0) / (after->first - s0) : 1;
  return (1 - t) * f0 + t * after->second;
}

/// What stiffness and damping the cut shows: the extremes along the normal.
struct Seen {
  double compliance = 0, stiffness_low = 0, stiffness_high = 0, damping_low = 0, damping_high = 0;
  std::size_t count = 0;
};

class Run {
 public:
  Run(const Job& job, const OnlineOptions& options, bool online, bool look)
      : job_(job),
        options_(options),
        online_(online),
        look_(look),
        stock_(job.stock),
        probe_(job.machine, machining::cutting_orientation(job)),
        corrector_(options.limits, options.sensor.weight_removed, options.period),
        random_(options.seed) {}

  Result<OnlineOutcome> go(const std::vector<Commanded>& way, const std::function<bool(double)>& progress) {
    double total = 0, done = 0;
    for (const Commanded& c : way) total += c.move.length();
    for (const Commanded& c : way) {
      if (!progress(done / std::max(total, 1e-9))) return fail("MC299", "cancelled");
      done += c.move.length();
      if (c.move.kind == gcode::MoveKind::rapid || !c.move.start_known) {
        POLYPOD_TRY(rapid(c));
      } else {
        POLYPOD_TRY(feed(c, progress, (done - c.move.length()) / std::max(total, 1e-9)));
      }
      if (out_.stopped) break;
    }
    finish();
    return out_;
  }
  [[nodiscard]] const Seen& seen() const { return seen_; }
  [[nodiscard]] bool plunged() const { return plunged_; }

 private:
  Status compliance(const Commanded& c, const Vec3& p_W) {
    const Vec3 p = job_.X_MW * p_W;
    Mat3 C_M;
    if (!probe_.at(p, C_M)) {
      return fail("MC210",
                  fmt::format("the machine cannot reach x {:.3f} y {:.3f} z {:.3f} mm in M: {}", units::to_mm(p.x()),
                              units::to_mm(p.y()), units::to_mm(p.z()), probe_.why()),
                  {{}, c.line, 1}, "move the workpiece origin");
    }
    if (job_.measured) {
      if (!job_.measured->map.covers(p)) {
        return fail("MC211", "no compliance is known there: in M " + job_.measured->map.why_not(p), {{}, c.line, 1},
                    "measure there too");
      }
      C_M = job_.measured->map.at(p);
    }
    C_ = job_.X_MW.R.transpose() * C_M * job_.X_MW.R;
    return {};
  }

  Status rapid(const Commanded& c) {
    tip_ = c.move.end;
    POLYPOD_TRY(compliance(c, tip_));
    const auto cycles = static_cast<int>(std::lround(kSettles / options_.period));
    for (int k = 0; k < cycles; ++k) control(Vec3::Zero(), Vec3::Zero(), c);
    return {};
  }

  /// The force in each direction of the plane at the tip; the deepest cut, m.
  double look_around(const Vec3& tip, const cutting::ProfileForce& force, double radius, double ahead) {
    double deepest = 0;
    for (int j = 0; j < kDirections; ++j) {
      const double angle = 2 * std::numbers::pi * j / kDirections;
      const Eigen::Vector2d d(std::cos(angle), std::sin(angle));
      machining::ForceAlong& out = around_[static_cast<std::size_t>(j)];
      out = {d, Vec3::Zero(), Vec3::Zero()};
      cutting::look_ahead(stock_, tip, radius, d, ahead, profile_);
      if (!(profile_.max_depth > kNoCut)) continue;
      deepest = std::max(deepest, profile_.max_depth);
      out.edge = options_.real_force * in_W(force.mean_force(profile_, 0), d);
      out.chip = (options_.real_force * in_W(force.mean_force(profile_, kThinChip), d) - out.edge) / kThinChip;
    }
    return deepest;
  }
  static Vec3 in_W(const Vec3& f, const Eigen::Vector2d& d) {
    return {f.x() * d.x() - f.y() * d.y(), f.x() * d.y() + f.y() * d.x(), f.z()};
  }

  Status feed(const Commanded& c, const std::function<bool(double)>& progress, double share) {
    const double length = c.move.length();
    if (!(length > 0) || !(c.move.feed > 0)) return {};
    const cutting::Cutter& cutter = job_.cutter_of(c.move.tool);
    const cutting::ProfileForce force(cutter, job_.material);
    const double radius = cutter.radius(), ahead = machining::look_ahead_length(stock_, radius);
    const double teeth = c.move.spindle_speed * cutter.teeth * options_.period;  // a cycle
    const double steps = std::max(1.0, std::ceil(length / (c.move.feed * options_.period) - 1e-9));
    if (steps > 1e8) return fail("MC205", "more than 1e8 cycles in one move", {{}, c.line, 1}, "check its feed");
    const Vec3 d3 = c.meant->direction(0);
    const bool vertical = std::hypot(d3.x(), d3.y()) < kVertical;
    for (double k = 1; k <= steps; ++k) {
      const double s = length * k / steps;
      const Vec3 command = c.move.point(s);
      POLYPOD_TRY(compliance(c, command));
      const Vec3 shifted = command + shift_;
      const Mat3 C_real = options_.real_compliance * C_;
      Vec3 f = Vec3::Zero(), at = shifted;
      const double deepest = vertical || !(teeth > 0) ? 0 : look_around(tip_, force, radius, ahead);
      if (deepest > kNoCut) {
        const machining::Yielded y = machining::yield_step(tip_, shifted, C_real, around_, teeth);
        f = y.force;
        at = y.tip;
      }
      Vec3 from = tip_, to = at;
      if (std::abs(to.z() - from.z()) < kNoCut) from.z() = to.z() = 0.5 * (to.z() + from.z());
      const double volume = stock_.cut_step(from, to, radius, false);
      if (vertical && volume > 0) plunged_ = true;
      tip_ = at;
      if (deepest > kNoCut) judge(c, cutter, radius, ahead, force);
      control(f, expected_at(c, s), c);
      if (out_.stopped) return {};
      if (static_cast<std::int64_t>(k) % 1024 == 0 && !progress(share)) return fail("MC299", "cancelled");
    }
    return {};
  }

  void judge(const Commanded& c, const cutting::Cutter& cutter, double radius, double ahead,
             const cutting::ProfileForce& force) {
    const gcode::Move& meant = *c.meant;
    const double s = meant.nearest(tip_);
    const Vec3 d = meant.direction(s), off = tip_ - meant.point(s);
    const Eigen::Vector2d feed = Eigen::Vector2d(d.x(), d.y()).normalized();
    cutting::look_ahead(stock_, tip_, radius, feed, ahead, profile_);
    constexpr int kBins = cutting::EngagementProfile::kBins;
    bool left = false, right = false;
    for (int j = 0; j < kRimStrips; ++j) {
      left = left || profile_.depth[j] > 0.1 * profile_.max_depth;
      right = right || profile_.depth[kBins - 1 - j] > 0.1 * profile_.max_depth;
    }
    ++out_.cycles;
    if (off.norm() > out_.distance && !c.transition) {
      out_.distance = off.norm();
      out_.distance_line = c.line;
    }
    if (c.transition) return;
    if (c.meant != judged_move_) {
      flush();
      judged_move_ = c.meant;
    }
    const Vec3 to_left(-feed.y(), feed.x(), 0);
    side_ += left && !right ? 1 : -1;
    lefts_.push_back(off.dot(to_left));
    if (!look_ || out_.cycles % kSeeEvery != 0 || !(c.move.feed > 0)) return;
    // What the force along the normal does where the tip moves aside, and where its way turns.
    const double per_tooth = c.move.feed / (c.move.spindle_speed * cutter.teeth);
    const auto normal_force = [&](const Vec3& tip, const Eigen::Vector2d& along) {
      cutting::look_ahead(stock_, tip, radius, along, ahead, profile_);
      if (!(profile_.max_depth > kNoCut)) return 0.0;
      return options_.real_force * in_W(force.mean_force(profile_, per_tooth), along).dot(to_left);
    };
    const double K =
        -(normal_force(tip_ + kAside * to_left, feed) - normal_force(tip_ - kAside * to_left, feed)) / (2 * kAside);
    const double turn = 2 * std::numbers::pi / kDirections;
    const auto turned = [&](double by) {
      return Eigen::Vector2d(feed.x() * std::cos(by) - feed.y() * std::sin(by),
                             feed.x() * std::sin(by) + feed.y() * std::cos(by));
    };
    const double B = -(normal_force(tip_, turned(turn)) - normal_force(tip_, turned(-turn))) / (2 * turn * c.move.feed);
    const double C = to_left.dot(C_ * to_left);
    if (seen_.count == 0) seen_ = {C, K, K, B, B, 0};
    seen_.compliance = std::max(seen_.compliance, C);
    seen_.stiffness_low = std::min(seen_.stiffness_low, K);
    seen_.stiffness_high = std::max(seen_.stiffness_high, K);
    seen_.damping_low = std::min(seen_.damping_low, B);
    seen_.damping_high = std::max(seen_.damping_high, B);
    ++seen_.count;
  }

  /// The errors of one move, on the side where most of it cuts a wall.
  void flush() {
    for (const double e : lefts_) {
      const double normal = side_ > 0 ? -e : e;
      out_.normal.add(normal);
      squares_ += normal * normal;
    }
    lefts_.clear();
    side_ = 0;
  }
  void finish() {
    flush();
    if (out_.normal.count > 0) out_.rms = std::sqrt(squares_ / static_cast<double>(out_.normal.count));
  }

  /// Sensor and controller, all in the axes of W, whose z is that of M.
  void control(const Vec3& force, const Vec3& expected, const Commanded& c) {
    const double time = static_cast<double>(cycle_++) * options_.period;
    if (!online_) return;
    const ForceSensor& sensor = options_.sensor;
    Vec3 reading = force - sensor.weight * Vec3::UnitZ();
    for (int i = 0; i < 3; ++i) reading[i] += sensor.noise * random_.normal();
    line_.push_back({reading, expected});
    const auto delay = static_cast<std::size_t>(std::lround(sensor.delay / options_.period));
    std::optional<Vec3> value = Vec3(-sensor.weight_removed * Vec3::UnitZ());  // before the first reading comes: no cut
    Vec3 meant = Vec3::Zero();
    if (line_.size() > delay) {
      value = line_.front()[0];
      meant = line_.front()[1];
      line_.pop_front();
    }
    if (options_.lost_at && time >= *options_.lost_at) value.reset();
    shift_ = corrector_.step(value, meant, C_);
    out_.largest_shift = std::max(out_.largest_shift, shift_.norm());
    if (corrector_.tripped() && !out_.stopped) {
      out_.stopped = fmt::format("{} after {:.3f} s", corrector_.why(), time);
      out_.stopped_line = c.line;
    }
  }

  const Job& job_;
  const OnlineOptions& options_;
  bool online_, look_;
  cutting::Stock stock_;
  statics::Probe probe_;
  OnlineCorrector corrector_;
  Random random_;
  std::array<machining::ForceAlong, kDirections> around_;
  cutting::EngagementProfile profile_;
  std::deque<std::array<Vec3, 2>> line_;
  Mat3 C_ = Mat3::Zero();
  Vec3 tip_ = Vec3::Zero(), shift_ = Vec3::Zero();
  const gcode::Move* judged_move_ = nullptr;
  std::vector<double> lefts_;
  std::int64_t side_ = 0;
  double squares_ = 0;
  std::size_t cycle_ = 0;
  bool plunged_ = false;
  Seen seen_;
  OnlineOutcome out_;
};

std::complex<double> loop_at(const OnlineLoop& l, const OnlineLimits& limits, double period, double cycles, double w) {
  const std::complex<double> back = std::exp(std::complex<double>(0, -w * period));
  const double a = std::exp(-2 * std::numbers::pi * limits.cutoff * period);
  const std::complex<double> P = l.cut_stiffness + l.cut_damping * (1.0 - back) / period;
  return l.model_compliance * (1 - a) / (1.0 - a * back) *
         std::exp(std::complex<double>(0, -w * period * (cycles + 1))) * P / (1.0 + l.compliance * P);
}

OnlineMargin margin_at(const OnlineLoop& l, const OnlineLimits& limits, double period, double cycles) {
  constexpr int kPoints = 1 << 14;
  OnlineMargin out;
  const double stiff = 1 + l.compliance * l.cut_stiffness, damped = l.compliance * l.cut_damping / period;
  if (!(stiff + 2 * std::min(0.0, damped) > 0)) {  // the cut alone does not stay where it is
    out.largest = kInfinite;
    return out;
  }
  double largest_real = 0;
  std::complex<double> before = loop_at(l, limits, period, cycles, 0);
  const auto meets = [&](double real, double w) {
    if (real <= largest_real) return;
    largest_real = real;
    out.frequency = w / (2 * std::numbers::pi);
  };
  meets(before.real(), 0);
  out.largest = std::abs(before);
  for (int k = 1; k <= kPoints; ++k) {
    const double w = std::numbers::pi / period * k / kPoints;
    const std::complex<double> now = loop_at(l, limits, period, cycles, w);
    out.largest = std::max(out.largest, std::abs(now));
    if ((now.imag() > 0) != (before.imag() > 0)) {
      const double t = before.imag() / (before.imag() - now.imag());
      meets(before.real() + t * (now.real() - before.real()), w);
    }
    before = now;
  }
  meets(before.real(), std::numbers::pi / period);
  out.gain = largest_real > 0 ? 1 / largest_real : kInfinite;
  return out;
}

}  // namespace

OnlineCorrector::OnlineCorrector(const OnlineLimits& limits, double weight_removed, double period)
    : limits_(limits),
      weight_(weight_removed),
      period_(period),
      share_(1 - std::exp(-2 * std::numbers::pi * limits.cutoff * period)) {}

Vec3 OnlineCorrector::step(const std::optional<Vec3>& force, const Vec3& expected, const Mat3& C) {
  const double way = limits_.rate * period_;
  if (!force || !force->allFinite()) {
    lost_ += period_;
    if (lost_ > limits_.hold + 0.5 * period_ && !tripped_) {
      tripped_ = true;
      why_ = "the sensor gives no force";
    }
  } else {
    lost_ = 0;
    filtered_ += share_ * (*force + weight_ * Vec3::UnitZ() - expected - filtered_);
  }
  if (tripped_) {
    const double size = shift_.norm();
    shift_ *= size > way ? 1 - way / size : 0;
    return shift_;
  }
  if (lost_ > 0) return shift_;
  Vec3 target = -(C * filtered_);
  const double size = target.norm();
  if (size > limits_.size) {
    target *= limits_.size / size;
    beyond_ += period_;
    if (beyond_ > limits_.hold + 0.5 * period_) {
      tripped_ = true;
      why_ = "the shift asked for is larger than its limit";
    }
  } else {
    beyond_ = 0;
  }
  const Vec3 change = target - shift_;
  shift_ += change.norm() > way ? Vec3(change * (way / change.norm())) : change;
  return shift_;
}

OnlineMargin online_margin(const OnlineLoop& loop, const ForceSensor& sensor, const OnlineLimits& limits,
                           double period) {
  constexpr double kLongest = 1;  // s
  const double given = std::round(sensor.delay / period);
  OnlineMargin out = margin_at(loop, limits, period, 0);
  out.delay = out.gain > 1 ? kInfinite : 0;
  for (double d = 1; d <= given || (d * period <= kLongest && std::isinf(out.delay) && !(out.largest < 1)); ++d) {
    const OnlineMargin here = margin_at(loop, limits, period, d);
    if (!(here.gain > 1) && std::isinf(out.delay)) out.delay = d * period;
    if (d > given) continue;
    if (here.gain < out.gain) {
      out.gain = here.gain;
      out.frequency = here.frequency;
    }
    out.largest = std::max(out.largest, here.largest);
  }
  return out;
}

const char* name_of(OnlineMethod method) {
  constexpr std::array<const char*, 4> kNames{"none", "off-line", "on-line", "both"};
  return kNames[static_cast<std::size_t>(method)];
}

namespace {
using Progress = std::function<bool(double)>;
Progress says(const OnlineOptions& options, OnlineMethod method) {
  return
      [&options, what = name_of(method)](double share) { return !options.progress || options.progress(what, share); };
}

Status short_enough(const gcode::Program& program, const gcode::Interpretation& interpretation,
                    const OnlineOptions& options) {
  double seconds = 0;
  for (const gcode::Move& move : interpretation.moves) {
    if (move.kind != gcode::MoveKind::rapid && move.start_known && move.feed > 0) seconds += move.length() / move.feed;
  }
  if (seconds > options.time_limit) {
    return fail("LC130",
                fmt::format("the feed moves of the program take {:.0f} s; the loop is simulated for {:g} s at most",
                            seconds, options.time_limit),
                {program.path}, "--time-limit-s gives more; a part of the program shows the same");
  }
  return {};
}

int line_of(const gcode::Program& program, const gcode::Move& move) {
  return program.blocks[static_cast<std::size_t>(move.block)].line;
}
}  // namespace

Result<OnlineLook> look_online(const Job& job, const gcode::Program& program,
                               const gcode::Interpretation& interpretation, const machining::Correction& correction,
                               const OnlineOptions& options) {
  POLYPOD_TRY(short_enough(program, interpretation, options));
  std::vector<Commanded> programmed;
  for (const gcode::Move& move : correction.programmed)
    programmed.push_back({move, &move, line_of(program, move), false, {}});
  OnlineLook out;
  Run run(job, options, false, true);
  POLYPOD_ASSIGN(outcome, run.go(programmed, says(options, OnlineMethod::none)));
  out.outcome = std::move(outcome);
  out.outcome.method = OnlineMethod::none;
  const Seen& seen = run.seen();
  if (seen.count == 0) return tl::unexpected(machining::cuts_nothing(job, program, interpretation));
  // Of the extremes those with the least margin.
  out.margin.gain = kInfinite;
  bool first = true;
  for (const double K : {seen.stiffness_low, seen.stiffness_high}) {
    for (const double B : {seen.damping_low, seen.damping_high}) {
      const OnlineLoop loop{options.real_compliance * seen.compliance, seen.compliance, K, B};
      const OnlineMargin margin = online_margin(loop, options.sensor, options.limits, options.period);
      out.loops.push_back(loop);
      if (!first && margin.gain >= out.margin.gain) continue;
      out.loop = loop;
      out.margin = margin;
      first = false;
    }
  }
  out.stable_enough = out.margin.gain >= options.least_margin;
  if (run.plunged())
    out.not_judged.emplace_back("plunges into material: the force of the cutter's end is not in this loop");
  return out;
}

Result<OnlineResult> simulate_online(const Job& job, const gcode::Program& program,
                                     const gcode::Interpretation& interpretation, const OnlineOptions& options) {
  POLYPOD_TRY(short_enough(program, interpretation, options));
  machining::CorrectOptions correct_options;
  correct_options.keep_samples = true;
  correct_options.progress = options.progress;
  POLYPOD_ASSIGN(correction, machining::correct(job, program, interpretation, correct_options));
  std::vector<Commanded> programmed, corrected;
  for (const gcode::Move& move : correction.programmed)
    programmed.push_back({move, &move, line_of(program, move), false, {}});
  for (std::size_t i = 0; i < correction.commanded.size(); ++i) {
    const gcode::Move& meant = correction.programmed[static_cast<std::size_t>(correction.source[i])];
    corrected.push_back(
        {correction.commanded[i].move, &meant, line_of(program, meant), correction.commanded[i].transition, {}});
  }
  for (const machining::Sample& s : correction.after.samples)
    corrected[static_cast<std::size_t>(s.move)].expected.emplace_back(s.s, s.force);

  POLYPOD_ASSIGN(look, look_online(job, program, interpretation, correction, options));
  OnlineResult out{look.loop, look.margin, look.stable_enough, {look.outcome}, look.not_judged};
  for (const OnlineMethod method : {OnlineMethod::offline, OnlineMethod::online, OnlineMethod::both}) {
    const bool online = method != OnlineMethod::offline, offline = method != OnlineMethod::online;
    OnlineOutcome outcome;
    if (online && !out.stable_enough) {
      outcome.refused = true;
    } else {
      Run one(job, options, online, false);
      POLYPOD_ASSIGN(ran, one.go(offline ? corrected : programmed, says(options, method)));
      outcome = std::move(ran);
    }
    outcome.method = method;
    out.outcomes.push_back(std::move(outcome));
  }
  return out;
}

}  // namespace polypod::control
