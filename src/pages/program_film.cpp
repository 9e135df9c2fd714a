// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "program_film.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "moving_machine.hpp"
#include "polypod/core/units.hpp"
#include "polypod/kinematics/any_machine.hpp"
#include "polypod/kinematics/parts.hpp"
#include "polypod/kinematics/posture.hpp"
#include "polypod/machining/tilted.hpp"

namespace polypod::pages {
namespace {

using machine::AnyMachine;
using machine::JointVector;
using report::Point3;
using units::to_mm;

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();
constexpr double kTurnStep = 0.0175;  // rad, as that of machining::check

bool ends_known(const gcode::Move& move) {
  return move.known_end[0] && move.known_end[1] && move.known_end[2];
}

std::size_t index(int i) {
  return static_cast<std::size_t>(i);
}

Point3 in_mm(const Vec3& p) {
  return {to_mm(p.x()), to_mm(p.y()), to_mm(p.z())};
}

double speed_of(const gcode::Move& move, const ProgramWalkOptions& options) {
  return move.kind == gcode::MoveKind::rapid ? options.rapid_speed : move.feed;
}

int steps_of(const gcode::Move& move, double step) {
  const double turn = (move.axes_end - move.axes_start).cwiseAbs().maxCoeff();
  return std::max(
      {1, static_cast<int>(std::ceil(move.length() / step)), static_cast<int>(std::ceil(turn / kTurnStep))});
}

/// Keeps the points of a curve: all where they are few, else what a picture of a thousand pixels can show.
class CurveKeeper {
 public:
  CurveKeeper(std::vector<ProgramInstant>& out, std::size_t points, double time)
      : out_(out), all_(points <= kFew || !(time > 0)), per_bucket_(time / kBuckets) {}
  void add(const ProgramInstant& now) {
    if (all_) {
      if (out_.size() < kMost) out_.push_back(now);
      return;
    }
    const auto bucket = static_cast<std::size_t>(now.time / per_bucket_);
    if (bucket != bucket_) flush();
    bucket_ = bucket;
    held_.push_back(now);
    if (held_.size() >= kHeld) flush();
  }
  void flush() {
    if (held_.empty()) return;
    std::vector<std::size_t> chosen{0, held_.size() - 1};
    for (int i = 0;; ++i) {
      std::size_t low = held_.size(), high = low;
      for (std::size_t k = 0; k < held_.size(); ++k) {
        if (!held_[k].reached || held_[k].q.size() <= i) continue;
        if (low == held_.size() || held_[k].q[i] < held_[low].q[i]) low = k;
        if (high == held_.size() || held_[k].q[i] > held_[high].q[i]) high = k;
      }
      if (low == held_.size()) break;
      chosen.insert(chosen.end(), {low, high});
    }
    const auto lost = std::find_if(held_.begin(), held_.end(), [](const auto& p) { return !p.reached; });
    if (lost != held_.end()) chosen.push_back(static_cast<std::size_t>(lost - held_.begin()));
    std::sort(chosen.begin(), chosen.end());
    chosen.erase(std::unique(chosen.begin(), chosen.end()), chosen.end());
    for (const std::size_t k : chosen) out_.push_back(held_[k]);
    held_.clear();
  }

 private:
  static constexpr std::size_t kFew = 1400, kMost = 100000, kHeld = 20000;
  static constexpr double kBuckets = 700;
  std::vector<ProgramInstant>& out_;
  bool all_;
  double per_bucket_;
  std::size_t bucket_ = 0;
  std::vector<ProgramInstant> held_;
};

}  // namespace

bool ProgramWalk::any() const {
  return std::any_of(pictures.begin(), pictures.end(), [](const ProgramInstant& p) { return p.q.size() > 0; });
}

ProgramWalk walk_program(const AnyMachine& machine, const Pose& X_MW, const gcode::Program& program,
                         const LongVector<gcode::Move>& moves, const ProgramWalkOptions& options) {
  constexpr std::size_t kProblems = 200;  // pictures of where something goes wrong
  ProgramWalk out;
  std::size_t points = 0;
  for (const gcode::Move& move : moves) {
    if (!ends_known(move)) continue;
    points += move.start_known ? index(steps_of(move, options.step)) + 1 : 1;
    if (!move.start_known) continue;
    ++out.moves;
    if (speed_of(move, options) > 0) out.time += move.length() / speed_of(move, options);
  }
  CurveKeeper curve(out.curve, points, out.time);
  const double between = out.time / static_cast<double>(std::max<std::size_t>(1, options.pictures));
  JointVector last;
  double time = 0, next = 0;
  std::size_t wanted = 0, problems = 0;
  bool last_was_wanted = false;
  ProgramInstant now;
  const auto picture = [&](bool asked) {
    if (!out.pictures.empty() && out.pictures.back().time >= now.time) {
      if (!asked || last_was_wanted) return;
      out.pictures.pop_back();
    }
    out.pictures.push_back(now);
    last_was_wanted = asked;
    next = std::max(next, now.time + between);
  };
  for (std::size_t m = 0; m < moves.size(); ++m) {
    const gcode::Move& move = moves[m];
    while (wanted < options.wanted.size() && index(options.wanted[wanted].first) < m) ++wanted;
    if (!ends_known(move)) {
      last.resize(0);
      continue;
    }
    const double length = move.length(), speed = speed_of(move, options);
    const int steps = steps_of(move, options.step);
    const double begin = time;
    bool told = false;
    for (int k = move.start_known ? 0 : steps; k <= steps; ++k) {
      const double to = double(k) / steps;
      const auto visit = [&](double share, bool asked) {
        const Vec3 axes = move.axes_start + share * (move.axes_end - move.axes_start);
        const Pose X{machining::tool_orientation(machine, X_MW, axes), X_MW * move.point(length * share)};
        const bool follows = last.size() > 0;
        const kinematics::InverseResult inverse =
            follows ? kinematics::inverse_near(machine, X, last) : kinematics::inverse(machine, X);
        const kinematics::Solution* best =
            follows ? inverse.reachable() : kinematics::reachable_in(machine, inverse, options.posture);
        now = {
            begin, static_cast<int>(m), length * share, program.blocks[index(move.block)].line, best != nullptr, X, {},
            {}};
        if (move.start_known && speed > 0) now.time = begin + length * share / speed;
        if (best != nullptr) {
          now.q = best->joints;
          last = best->joints;
        } else {
          if (!inverse.solutions.empty()) now.q = inverse.solutions.front().joints;
          now.why =
              inverse.solutions.empty() ? inverse.reason : kinematics::reason_of(machine, inverse, options.posture);
          last.resize(0);
        }
        curve.add(now);
        const bool wrong = !now.reached && !told && problems < kProblems;
        if (wrong) {
          told = true;
          ++problems;
        }
        if (asked || wrong || now.time >= next) picture(asked || wrong);
      };
      while (wanted < options.wanted.size() && index(options.wanted[wanted].first) == m) {
        const double share = length > 0 ? std::clamp(options.wanted[wanted].second / length, 0.0, 1.0) : 0;
        if (share > to) break;
        if (share < to && k > 0) visit(share, true);
        ++wanted;
        if (share >= to || k == 0) {
          visit(to, true);
        }
      }
      visit(to, false);
    }
    if (move.start_known && speed > 0) time = begin + length / speed;
  }
  curve.flush();
  if (!out.pictures.empty()) picture(false);
  return out;
}

std::size_t pictures_for(const AnyMachine& machine) {
  constexpr double kBytes = 900e3, kPerPoint = 8, kPerPicture = 260;
  constexpr std::size_t kLeast = 60, kMost = 400;
  std::size_t points = 0;
  for (const machine::OutlinePart& part : kinematics::outline(machine, kinematics::middle_of_work(machine)))
    if (part.role != machine::OutlinePart::Role::fixed) points += part.points.size();
  return std::clamp(static_cast<std::size_t>(kBytes / (kPerPoint * double(points) + kPerPicture)), kLeast, kMost);
}

void add_film(report::Scene& scene, const AnyMachine& machine, const std::vector<ProgramInstant>& instants,
              const std::vector<FilmColumn>& columns, const std::function<std::string(const ProgramInstant&)>& text) {
  constexpr double kTip = 4.5;  // px
  const auto first =
      std::find_if(instants.begin(), instants.end(), [](const ProgramInstant& p) { return p.q.size() > 0; });
  if (first == instants.end()) return;
  Pose X = kinematics::settled(machine, first->X, first->q);
  JointVector q = first->q;
  const MovingMachine moving(machine, X, q);
  report::Frames frames;
  report::Frames::Column lines{"line", "", {}};
  std::vector<report::Frames::Column> others;
  for (const FilmColumn& c : columns) others.push_back({c.name, c.unit, {}});
  bool numbered = false;
  for (const ProgramInstant& p : instants) {
    std::string note;
    if (p.q.size() > 0) {
      X = kinematics::settled(machine, p.X, p.q);
      q = p.q;
      if (!p.reached && kinematics::violations(machine, X, q) == 0) note = p.why;
    } else {
      note = fmt::format("out of reach, the machine is drawn where it last was: {}", p.why);
    }
    if (!moving.add(frames, p.time, X, q, note)) continue;
    frames.points.back().push_back(in_mm(p.q.size() > 0 ? X.p : p.X.p));
    lines.values.push_back(p.line);
    numbered = numbered || p.line > 0;
    for (std::size_t k = 0; k < columns.size(); ++k) others[k].values.push_back(columns[k].value(p));
    if (text) frames.texts.push_back(text(p));
  }
  constexpr std::size_t kLeast = 2;
  if (frames.at.size() < kLeast) return;
  frames.columns.insert(frames.columns.begin(), others.begin(), others.end());
  if (numbered) frames.columns.insert(frames.columns.begin(), std::move(lines));
  report::Line3 tip{"tool tip", {frames.points.front().back()}, report::Colour::orange, kTip, true};
  tip.moves = true;
  std::vector<report::Line3> all = moving.lines();
  all.push_back(std::move(tip));
  scene.lines.insert(scene.lines.begin(), all.begin(), all.end());
  scene.frames.push_back(std::move(frames));
}

std::function<std::string(const ProgramInstant&)> lines_of(const gcode::Program& program,
                                                           const LongVector<gcode::Move>& moves) {
  return [&](const ProgramInstant& p) {
    constexpr std::size_t kText = 100;  // characters
    const std::string_view text = program.blocks[index(moves[index(p.move)].block)].text;
    return fmt::format("line {}: {}", p.line, text.substr(0, kText));
  };
}

std::string film_in_words(const ProgramWalk& walk) {
  const auto count = [](std::size_t n) { return report::fixed(static_cast<double>(n), 0); };
  const std::size_t pictures = walk.pictures.size();
  if (pictures == 0) return "";
  const double each = static_cast<double>(walk.moves) / static_cast<double>(pictures);
  constexpr double kAll = 0.8;
  return fmt::format("{} pictures of {} moves{}", count(pictures), count(walk.moves),
                     each <= kAll ? "" : fmt::format(": one stands for {} moves", report::number(each, 2)));
}

void thin_out(report::Line3& line, std::size_t points) {
  if (line.points.size() <= points) return;
  const auto finite = [](const Point3& p) { return std::isfinite(p.x + p.y + p.z); };
  Eigen::AlignedBox3d box;
  for (const Point3& p : line.points)
    if (finite(p)) box.extend(Vec3(p.x, p.y, p.z));
  if (box.isEmpty()) return;
  const double size = box.diagonal().norm();
  constexpr double kFirst = 5e-4, kMore = 1.5, kWhole = 0.2;
  const bool tagged = line.tag.size() == line.points.size(), valued = line.value.size() == line.points.size();
  std::vector<std::size_t> kept;
  for (double least = kFirst * size; least < kWhole * size; least *= kMore) {
    kept.clear();
    Vec3 last = Vec3::Constant(kNaN);
    bool gap = false;
    std::size_t at_gap = 0;
    for (std::size_t i = 0; i < line.points.size(); ++i) {
      const Point3& p = line.points[i];
      if (!finite(p)) {
        gap = true;
        at_gap = i;
        continue;
      }
      const Vec3 here(p.x, p.y, p.z);
      if ((here - last).norm() < least) continue;
      // A gap that is shorter than what is left out is none.
      if (gap && !kept.empty()) kept.push_back(at_gap);
      // The stretch to here has the value of its beginning.
      if (valued && !gap && !kept.empty() && kept.back() + 1 < i && line.value[kept.back()] != line.value[i - 1])
        kept.push_back(i - 1);
      gap = false;
      kept.push_back(i);
      last = here;
    }
    if (kept.size() <= points) break;
  }
  report::Line3 out = line;
  out.points.clear();
  out.tag.clear();
  out.value.clear();
  for (const std::size_t i : kept) {
    out.points.push_back(line.points[i]);
    if (valued) out.value.push_back(line.value[i]);
    if (tagged) out.tag.push_back(line.tag[i]);
  }
  line = std::move(out);
}

report::Line3 path_of(const Pose& X_MW, const gcode::Program& program, const LongVector<gcode::Move>& moves, bool rapid,
                      std::size_t points, const std::function<double(const gcode::Move&)>& value) {
  report::Line3 way{rapid ? "rapids" : "path of the tool",
                    {},
                    rapid ? report::Colour::muted : report::Colour::blue,
                    rapid ? 1.0 : 2.0};
  Vec3 end = Vec3::Constant(kNaN);
  double last = kNaN;
  for (const gcode::Move& move : moves) {
    if (!move.start_known || !ends_known(move) || (move.kind == gcode::MoveKind::rapid) != rapid) continue;
    const int line = program.blocks[index(move.block)].line;
    const double now = value ? value(move) : 0;
    const auto put = [&](const Point3& p) {
      way.points.push_back(p);
      way.tag.push_back(line);
      if (value) way.value.push_back(now);
    };
    constexpr double kSame = 1e-9;
    const bool apart = !((move.start - end).norm() < kSame);
    if (apart && !way.points.empty()) put({kNaN, kNaN, kNaN});
    if (apart || now != last) put(in_mm(X_MW * move.start));
    const double length = move.length();
    constexpr double kStep = 0.1;  // rad
    constexpr int kMostSteps = 256;
    const int steps = move.kind == gcode::MoveKind::arc
                          ? std::clamp(static_cast<int>(std::ceil(move.sweep / kStep)), 1, kMostSteps)
                          : 1;
    for (int k = 1; k <= steps; ++k) put(in_mm(X_MW * move.point(length * k / steps)));
    end = move.end;
    last = now;
  }
  thin_out(way, points);
  return way;
}

void add_way(report::Scene& scene, const Pose& X_MW, const gcode::Program& program,
             const LongVector<gcode::Move>& moves, const ProgramWalk& walk, std::size_t points) {
  for (const bool rapid : {true, false}) {
    report::Line3 way = path_of(X_MW, program, moves, rapid, points);
    if (!way.points.empty()) scene.lines.push_back(std::move(way));
  }
  report::Line3 lost{"where the machine does not get", {}, report::Colour::vermillion, 3.5, true};
  for (const ProgramInstant& p : walk.pictures)
    if (!p.reached) lost.points.push_back(in_mm(p.X.p));
  if (!lost.points.empty()) scene.lines.push_back(std::move(lost));
}

report::Line3 box_line(const std::string& name, const Vec3& low, const Vec3& high, const Pose& X_MW) {
  report::Line3 out{name, {}, report::Colour::green, 1.2};
  const auto corner = [&](int k) {
    return in_mm(X_MW * Vec3((k & 1) != 0 ? high.x() : low.x(), (k & 2) != 0 ? high.y() : low.y(),
                             (k & 4) != 0 ? high.z() : low.z()));
  };
  for (const int k : {0, 1, 3, 2, 0, 4, 5, 7, 6, 4}) out.points.push_back(corner(k));
  for (const auto& [a, b] : {std::pair{1, 5}, {3, 7}, {2, 6}}) {
    out.points.push_back({kNaN, kNaN, kNaN});
    out.points.push_back(corner(a));
    out.points.push_back(corner(b));
  }
  return out;
}

}  // namespace polypod::pages
