// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/cell/reach.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <set>

#include "common.hpp"
#include "polypod/core/units.hpp"

namespace polypod::cell {
namespace {

using machine::JointVector;

double heading_to(const Machine& m, const Vec3& at, double given) {
  if (std::isfinite(given)) return given;
  const Vec3 d = at - m.X_CM.p;
  return std::atan2(d.y(), d.x());
}

/// A machine's inverse at a pose of the tool in C, near to known joints.
std::optional<JointVector> joints_at(const Machine& m, const Pose& X_CT, const JointVector& near, Pose& X_MT,
                                     std::string& why) {
  X_MT = in_machine(m, X_CT);
  // A machine that is told no angle keeps its own.
  if (!kinematics::task(m.model).turns()) X_MT.R.setIdentity();
  const kinematics::InverseResult found =
      near.size() > 0 ? kinematics::inverse_near(m.model, X_MT, near) : kinematics::inverse(m.model, X_MT);
  const kinematics::Solution* best = found.reachable();
  if (best == nullptr) {
    why = kinematics::reason_of(m.model, found);
    return std::nullopt;
  }
  return best->joints;
}

}  // namespace

Stand stand_at(const Machine& m, const JointVector& home, const Vec3& at, double pitch, double heading, double roll,
               double clearance) {
  Stand out;
  out.at = at;
  const Pose X_CT = tool_pose(at, pitch, heading_to(m, at, heading), roll);
  Pose raised = X_CT;
  raised.p.z() += clearance;
  const auto above = joints_at(m, raised, home, out.X_above, out.why);
  if (!above) {
    out.why = fmt::format("{:.0f} mm above it: {}", units::to_mm(clearance), out.why);
    return out;
  }
  out.above = *above;
  JointVector last = *above;
  constexpr int kSteps = 10;
  constexpr double kLargestStep = 0.6;  // rad or m in a tenth of the way: more is a jump to another posture
  for (int k = 1; k <= kSteps && clearance > 0; ++k) {
    Pose X = X_CT;
    X.p.z() += clearance * (kSteps - k) / kSteps;
    const auto q = joints_at(m, X, last, out.X_at, out.why);
    if (!q) {
      out.why = fmt::format("on the straight way to it: {}", out.why);
      return out;
    }
    if ((*q - last).cwiseAbs().maxCoeff() > kLargestStep) {
      out.why = "the straight way to it changes the posture";
      return out;
    }
    last = *q;
  }
  out.joints = last;
  if (!(clearance > 0)) out.X_at = out.X_above;
  constexpr double kRamp = 0.1;  // s to the speed of the straight way
  out.straight = clearance > 0 ? std::max(trapezoid_time(clearance, m.straight_speed, m.straight_speed / kRamp),
                                          joint_time(m, out.above, out.joints))
                               : 0;
  out.ok = true;
  return out;
}

double trapezoid_time(double d, double v, double a) {
  if (!(d > 0)) return 0;
  return d * a >= v * v ? d / v + v / a : 2 * std::sqrt(d / a);
}

double joint_time(const Machine& machine, const JointVector& from, const JointVector& to) {
  double out = 0;
  for (Eigen::Index j = 0; j < from.size() && j < to.size(); ++j) {
    const auto k = static_cast<std::size_t>(j);
    out =
        std::max(out, trapezoid_time(std::abs(to[j] - from[j]), machine.joint_speed[k], machine.joint_acceleration[k]));
  }
  return out;
}

std::vector<JointVector> stops(const Machine& machine, const JointVector& home, const JointVector& from,
                               const JointVector& to) {
  if (!machine.folds || home.size() != to.size() || from.size() != to.size()) return {to};
  std::vector<JointVector> out;
  JointVector last = from;
  const auto go = [&](const JointVector& next) {
    if ((next - last).cwiseAbs().maxCoeff() > 1e-12) out.push_back(next);
    last = next;
  };
  JointVector in = home, turned = home;
  in[0] = from[0];
  turned[0] = to[0];
  go(in);
  go(turned);
  go(to);
  return out;
}

double way_time(const Machine& machine, const JointVector& home, const JointVector& from, const JointVector& to) {
  double out = 0;
  JointVector last = from;
  for (const JointVector& next : stops(machine, home, from, to)) {
    out += joint_time(machine, last, next);
    last = next;
  }
  return out;
}

Pose tool_pose(const Vec3& at, double pitch, double heading, double roll) {
  const Vec3 axis(std::cos(pitch) * std::cos(heading), std::cos(pitch) * std::sin(heading), -std::sin(pitch));
  const Vec3 z = -axis, y(-std::sin(heading), std::cos(heading), 0);
  Pose out;
  out.p = at;
  out.R.col(0) = y.cross(z);
  out.R.col(1) = y;
  out.R.col(2) = z;
  out.R = Eigen::AngleAxisd(roll, axis).toRotationMatrix() * out.R;
  return out;
}

double PickTable::time(std::size_t slot, double along, double across) const {
  const std::vector<double>& t = times[slot];
  const auto locate = [](double x, double lo, double hi, int n, int& i) {
    const double u = hi > lo ? std::clamp((x - lo) / (hi - lo), 0.0, 1.0) * (n - 1) : 0.0;
    i = std::min(static_cast<int>(u), std::max(0, n - 2));
    return u - i;
  };
  int i = 0, j = 0;
  const double u = locate(along, low, high, columns, i), v = locate(across, across_low, across_high, rows, j);
  const auto node = [&](int c, int r) {
    return t[static_cast<std::size_t>(std::min(r, rows - 1) * columns + std::min(c, columns - 1))];
  };
  return (1 - v) * ((1 - u) * node(i, j) + u * node(i + 1, j)) +
         v * ((1 - u) * node(i, j + 1) + u * node(i + 1, j + 1));
}

std::optional<std::pair<double, double>> across_range(const Cell& cell, int conveyor) {
  std::optional<std::pair<double, double>> out;
  const auto widen = [&](double low, double high) {
    out = out ? std::pair{std::min(out->first, low), std::max(out->second, high)} : std::pair{low, high};
  };
  std::set<int> seen;
  const auto visit = [&](const auto& self, int at) -> std::optional<std::pair<double, double>> {
    if (!seen.insert(at).second) return std::nullopt;
    std::optional<std::pair<double, double>> range;
    const auto add = [&](double low, double high) {
      range = range ? std::pair{std::min(range->first, low), std::max(range->second, high)} : std::pair{low, high};
    };
    for (const Source& s : cell.sources)
      if (s.conveyor == at) add(s.across_low, s.across_high);
    for (const Spot& s : cell.spots)
      if (s.kind == Spot::Kind::pour && s.conveyor == at) add(s.across_low, s.across_high);
    const Conveyor& here = cell.conveyors[static_cast<std::size_t>(at)];
    for (std::size_t k = 0; k < cell.conveyors.size(); ++k) {
      const Conveyor& c = cell.conveyors[k];
      if (c.onto != here.name) continue;
      const auto before = self(self, static_cast<int>(k));
      if (!before) continue;
      for (const double drop : {c.drop - c.drop_spread, c.drop + c.drop_spread}) {
        for (const double side : {before->first, before->second}) {
          const Vec3 d = c.point(c.length + drop, side) - here.at;
          const double across = -std::sin(here.heading) * d.x() + std::cos(here.heading) * d.y();
          add(across, across);
        }
      }
    }
    return range;
  };
  const auto range = visit(visit, conveyor);
  if (range) widen(range->first, range->second);
  return out;
}

bool has_cycles(const Machine& machine) {
  return motion::has_cycles(machine.model);
}

motion::MotionLimits limits_of(const Machine& m) {
  return {{m.tool_speed, m.tool_acceleration, m.tool_jerk}, {m.drive_speed, m.drive_acceleration, m.drive_jerk}};
}

namespace {

/// Times between belt and slots; false where something is out of reach (a problem then says so).
void pick_table(const Cell& cell, const Task& task, const JointVector& home, PickTable& out, Motions& all) {
  std::vector<Problem>& problems = all.problems;
  const Machine& m = cell.machines[static_cast<std::size_t>(task.machine)];
  const Conveyor& belt = cell.conveyors[static_cast<std::size_t>(task.from_conveyor)];
  const Spot& spot = cell.spots[static_cast<std::size_t>(task.to)];
  const auto range = across_range(cell, task.from_conveyor);
  constexpr double kAlong = 0.040, kAcross = 0.030;  // m between nodes at most
  static constexpr int kMost = 12;
  out.low = task.window_low;
  out.high = task.window_high;
  out.across_low = range ? range->first : 0;
  out.across_high = range ? range->second : 0;
  const auto count = [](double length, double step) {
    return length > 1e-9 ? std::min(kMost, static_cast<int>(std::ceil(length / step)) + 1) : 1;
  };
  out.columns = count(out.high - out.low, kAlong);
  out.rows = count(out.across_high - out.across_low, kAcross);
  std::vector<Vec3> ends;
  for (const Vec3& slot : spot.slots) ends.emplace_back(slot.x(), slot.y(), task.release);
  ends.push_back(m.home);
  const motion::MotionLimits limits = limits_of(m);
  const bool cycles = has_cycles(m);
  constexpr const char* kNoCycle = "MO105";  // too near to each other for its blends
  int roughly = 0;
  const auto rough = [&](const Vec3& from, const Vec3& to) {
    ++roughly;
    return 2 * trapezoid_time((to - from).norm(), m.tool_speed, m.tool_acceleration);
  };
  bool said = false;
  const auto complain = [&](const Vec3& at, const std::string& why) {
    if (said) return;
    problems.push_back({"reach", fmt::format("{} ({}) cannot pick on {} at {}: {}", m.name, task.name, belt.name,
                                             place_text(at), why)});
    said = true;
  };
  for (std::size_t e = 0; e < ends.size(); ++e) {
    std::vector<double> times;
    Stand end;
    if (!cycles) {
      end = stand_at(m, home, ends[e], std::numbers::pi / 2, spot.heading, 0, m.lift);
      if (!end.ok) {
        problems.push_back(
            {"reach", fmt::format("{} ({}) cannot reach {}: {}", m.name, task.name, place_text(ends[e]), end.why)});
        said = true;
      }
    }
    for (int r = 0; r < out.rows; ++r) {
      for (int c = 0; c < out.columns; ++c) {
        const double along =
            out.columns > 1 ? out.low + (out.high - out.low) * c / (out.columns - 1) : (out.low + out.high) / 2;
        const double across =
            out.rows > 1 ? out.across_low + (out.across_high - out.across_low) * r / (out.rows - 1) : out.across_low;
        Vec3 at = belt.point(along, across);
        at.z() += cell.items[0].height;
        ++all.judged;
        double time = kInfinity;
        if (cycles) {
          const Pose X_MC = m.X_CM.inverse();
          const motion::Cycle cycle{X_MC * at, X_MC * ends[e], m.lift, m.blend};
          const Result<motion::Plan> plan = motion::plan(m.model, cycle, limits);
          if (plan)
            time = plan->time;
          else if (plan.error().id == kNoCycle)
            time = rough(at, ends[e]);
          else
            complain(at, fmt::format("{} (on the way to {}; places of the reason are in the machine's own frame)",
                                     plan.error().message, place_text(ends[e])));
        } else if (end.ok) {
          const Stand pick =
              stand_at(m, home, at, std::numbers::pi / 2, std::numeric_limits<double>::quiet_NaN(), 0, m.lift);
          if (pick.ok)
            time = end.straight + way_time(m, home, end.above, pick.above) + pick.straight;
          else
            complain(at, pick.why);
        }
        times.push_back(time);
        all.out_of_reach += std::isfinite(time) ? 0 : 1;
      }
    }
    out.times.push_back(std::move(times));
    double home_time = kInfinity;
    if (cycles && e + 1 < ends.size()) {
      const Pose X_MC = m.X_CM.inverse();
      const Result<motion::Plan> plan = motion::plan(m.model, {X_MC * ends[e], X_MC * m.home, m.lift, m.blend}, limits);
      if (plan) {
        home_time = plan->time;
      } else {
        home_time = rough(ends[e], m.home);
        if (plan.error().id != kNoCycle)
          problems.push_back({"reach", fmt::format("{} ({}) cannot go from {} to its place of waiting: {}", m.name,
                                                   task.name, place_text(ends[e]), plan.error().message)});
      }
    } else if (end.ok) {
      home_time = end.straight + way_time(m, home, end.above, home);
    }
    out.home_times.push_back(home_time);
  }
  if (roughly > 0)
    all.assumed.push_back(
        fmt::format("{} ({}): {} way{} too short for the clearance height and the corner blends: twice "
                    "the time of a straight one is taken",
                    m.name, task.name, roughly, roughly == 1 ? "" : "s"));
}

/// How far a container leans, rad, at a stand when it was upright at another.
double lean(const Machine& m, const Stand& taken, const Stand& there) {
  const Vec3 axis = (m.X_CM * there.X_at).R * ((m.X_CM * taken.X_at).R.transpose() * Vec3::UnitZ());
  return std::acos(std::clamp(axis.z(), -1.0, 1.0));
}

/// Containers stand upright where they are put, and are upside down enough where they are emptied.
void upright(const Cell& cell, const Task& task, Motions& out) {
  constexpr double kUpright = 0.02;  // rad: a tin of 120 mm then leans by 2 mm
  const auto m = static_cast<std::size_t>(task.machine);
  const Machine& machine = cell.machines[m];
  const auto first = [&](int spot) -> const Stand* {
    for (const Stand& s : out.stands[m][static_cast<std::size_t>(spot)])
      if (s.ok) return &s;
    return nullptr;
  };
  const Stand* from = first(task.from);
  if (from == nullptr) return;
  const std::string& name = cell.containers[0].name;
  const auto called = [&](int spot) { return cell.spots[static_cast<std::size_t>(spot)].name; };
  if (const Stand* to = first(task.to); to != nullptr && lean(machine, *from, *to) > kUpright) {
    out.problems.push_back(
        {"tilt", fmt::format("{} ({}) puts the {} from {} into {} tilted by {:.0f} deg: pitch_deg and roll_deg of both "
                             "must agree",
                             machine.name, task.name, name, called(task.from), called(task.to),
                             units::to_deg(lean(machine, *from, *to)))});
  }
  if (task.via < 0) return;
  if (const Stand* via = first(task.via); via != nullptr && !(lean(machine, *from, *via) > std::numbers::pi / 2)) {
    out.problems.push_back({"tilt", fmt::format("{} ({}) tilts the {} at {} by {:.0f} deg, and nothing falls out: more "
                                                "than 90 deg are needed; turn the tool by roll_deg",
                                                machine.name, task.name, name, called(task.via),
                                                units::to_deg(lean(machine, *from, *via)))});
  }
}

}  // namespace

Motions motions(const Cell& cell) {
  Motions out;
  for (const Machine& m : cell.machines) {
    JointVector home = m.home_joints;
    if (home.size() == 0) {
      Pose X_MT;
      std::string why;
      const auto q = joints_at(
          m,
          tool_pose(m.home, std::numbers::pi / 2, heading_to(m, m.home, std::numeric_limits<double>::quiet_NaN()), 0),
          {}, X_MT, why);
      if (q)
        home = *q;
      else {
        out.problems.push_back(
            {"reach", fmt::format("{} cannot reach its home {}: {}", m.name, place_text(m.home), why)});
        home = JointVector::Zero(kinematics::joint_count(m.model));
      }
    } else {
      const kinematics::ForwardResult poses = kinematics::forward(m.model, home);
      if (poses.poses.empty() || kinematics::violations(m.model, poses.poses[0], home) != 0) {
        out.problems.push_back(
            {"reach", fmt::format("{} cannot stand in its home: its joints there are out of limits", m.name)});
      }
    }
    out.home.push_back(home);
    out.stands.emplace_back(cell.spots.size());
  }
  out.picks.resize(cell.tasks.size());
  for (std::size_t t = 0; t < cell.tasks.size(); ++t) {
    const Task& task = cell.tasks[t];
    const auto mi = static_cast<std::size_t>(task.machine);
    const Machine& m = cell.machines[mi];
    if (task.from_conveyor >= 0) {
      pick_table(cell, task, out.home[mi], out.picks[t], out);
      const double mass = m.hand_mass + cell.items[0].mass;
      if (m.payload > 0 && mass > m.payload) {
        out.problems.push_back(
            {"payload", fmt::format("{} carries {:.2f} kg, {} may carry {:.2f} kg", m.name, mass, m.name, m.payload)});
      }
      continue;
    }
    for (const int spot : {task.from, task.via, task.to}) {
      if (spot < 0) continue;
      const Spot& s = cell.spots[static_cast<std::size_t>(spot)];
      std::vector<Stand>& stands = out.stands[mi][static_cast<std::size_t>(spot)];
      if (!stands.empty()) continue;
      for (std::size_t k = 0; k < s.slots.size(); ++k) {
        stands.push_back(stand_at(m, out.home[mi], s.slots[k], s.pitch, s.heading, s.roll, s.clearance));
        ++out.judged;
        if (stands.back().ok) continue;
        ++out.out_of_reach;
        out.problems.push_back({"reach", fmt::format("{} ({}) cannot reach {} {}at {}: {}", m.name, task.name, s.name,
                                                     s.slots.size() > 1 ? fmt::format("slot {} ", k + 1) : "",
                                                     place_text(s.slots[k]), stands.back().why)});
      }
    }
    upright(cell, task, out);
    const Container& c = cell.containers[0];
    const double mass = m.hand_mass + c.mass + (cell.items.empty() ? 0 : c.capacity * cell.items[0].mass);
    if (m.payload > 0 && mass > m.payload) {
      const std::string text =
          fmt::format("{} carries {:.2f} kg with a full {}, and may carry {:.2f} kg", m.name, mass, c.name, m.payload);
      if (std::none_of(out.problems.begin(), out.problems.end(), [&](const Problem& p) { return p.detail == text; }))
        out.problems.push_back({"payload", text});
    }
  }
  return out;
}

}  // namespace polypod::cell
