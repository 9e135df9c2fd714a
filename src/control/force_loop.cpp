// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/control/force_loop.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <optional>

#include "module_text.hpp"
#include "polypod/core/units.hpp"
#include "polypod/cutting/stock.hpp"

namespace polypod::control {
namespace {

using machining::Job;

constexpr double kStep = 0.5e-3;    // m, between two places of the path
constexpr double kPlaces = 4000;    // at most, but for the ends of moves
constexpr double kAside = 0.3e-3;   // m, by which a tip is moved to see what the force does
constexpr double kTurn = 0.2;       // rad, by which its way is turned
constexpr double kNoCut = 1e-6;     // m, thinner layers are no cut
constexpr double kVertical = 1e-6;  // share of the length below which a move goes down

Vec3 in_W(const Vec3& f, const Eigen::Vector2d& d) {
  return {f.x() * d.x() - f.y() * d.y(), f.x() * d.y() + f.y() * d.x(), f.z()};
}

/// Over the way along each programmed move the force that the corrected program is made for.
using Expected = std::vector<std::vector<std::pair<double, Vec3>>>;
Expected expected_of(const machining::Correction& correction) {
  Expected out(correction.programmed.size());
  for (const machining::Sample& sample : correction.after.samples) {
    const auto at = static_cast<std::size_t>(sample.move);
    if (correction.commanded[at].transition) continue;
    const auto source = static_cast<std::size_t>(correction.source[at]);
    const gcode::Move& meant = correction.programmed[source];
    out[source].emplace_back(meant.nearest(sample.command + sample.deflection), sample.force);
  }
  for (auto& one : out)
    std::stable_sort(one.begin(), one.end(), [](const auto& a, const auto& b) { return a.first < b.first; });
  return out;
}
Vec3 at_way(const std::vector<std::pair<double, Vec3>>& over, double s) {
  if (over.empty()) return Vec3::Zero();
  const auto after =
      std::lower_bound(over.begin(), over.end(), s, [](const auto& item, double at) { return item.first < at; });
  if (after == over.begin()) return after->second;
  if (after == over.end()) return over.back().second;
  const auto& [s0, f0] = *(after - 1);
  const double t = after->first > s0 ? (s - s0) / (after->first - s0) : 1;
  return (1 - t) * f0 + t * after->second;
}

/// A cutter that goes `aside` (m) to the left of the path, with a stock of its own.
struct Beside {
  double aside = 0;
  cutting::Stock stock;
  std::optional<Vec3> before;

  void cut_to(const Vec3& p, double radius) {
    stock.cut_step(before.value_or(p), p, radius, false);
    before = p;
  }
};

std::vector<PathForce> path_of(const Job& job, const machining::Correction& correction) {
  std::vector<PathForce> out;
  const Expected expected = expected_of(correction);
  std::array<Beside, 3> lanes{Beside{0, job.stock, {}}, Beside{kAside, job.stock, {}}, Beside{-kAside, job.stock, {}}};
  double total = 0;
  const auto counts = [](const gcode::Move& m) {
    return m.kind != gcode::MoveKind::rapid && m.start_known && m.feed > 0 && m.length() > 0;
  };
  for (const gcode::Move& move : correction.programmed) total += counts(move) ? move.length() : 0;
  const double apart = std::max(kStep, total / kPlaces);
  cutting::EngagementProfile profile;
  for (std::size_t i = 0; i < correction.programmed.size(); ++i) {
    const gcode::Move& move = correction.programmed[i];
    if (!counts(move)) {
      for (Beside& lane : lanes) lane.before.reset();
      continue;
    }
    const cutting::Cutter& cutter = job.cutter_of(move.tool);
    const cutting::ProfileForce force(cutter, job.material);
    const double radius = cutter.radius(), ahead = machining::look_ahead_length(job.stock, radius);
    const double length = move.length(), steps = std::ceil(length / apart - 1e-9);
    const double teeth = move.spindle_speed * cutter.teeth;
    PathForce here;
    for (double k = 0; k <= steps; ++k) {
      const double s = length * k / steps;
      const Vec3 p = move.point(s), d = move.direction(s);
      const bool level = std::hypot(d.x(), d.y()) > kVertical;
      const Eigen::Vector2d feed = level ? Eigen::Vector2d(d.x(), d.y()).normalized() : Eigen::Vector2d::UnitX();
      const Vec3 left = level ? Vec3(-feed.y(), feed.x(), 0) : Vec3::Zero();
      for (Beside& lane : lanes) lane.cut_to(p + lane.aside * left, radius);
      if (!level || !(teeth > 0)) {
        here = {};
      } else if (s + ahead <= length || k == 0) {  // nearer to the end it stays
        struct Parts {
          Vec3 edge = Vec3::Zero(), chip = Vec3::Zero();
        };
        const auto look = [&](const Beside& lane, double turn) {
          Parts parts;
          const Eigen::Vector2d to(feed.x() * std::cos(turn) - feed.y() * std::sin(turn),
                                   feed.x() * std::sin(turn) + feed.y() * std::cos(turn));
          cutting::look_ahead(lane.stock, p + lane.aside * left, radius, to, ahead, profile);
          if (!(profile.max_depth > kNoCut)) return parts;
          parts.edge = job.X_MW.R * in_W(force.mean_force(profile, 0), to);
          parts.chip = (job.X_MW.R * in_W(force.mean_force(profile, move.feed / teeth), to) - parts.edge) / move.feed;
          return parts;
        };
        const Parts on = look(lanes[0], 0), to_left = look(lanes[1], 0), to_right = look(lanes[2], 0);
        const Parts turned_left = look(lanes[0], kTurn), turned_right = look(lanes[0], -kTurn);
        here.edge = on.edge;
        here.chip = on.chip;
        here.edge_off = (to_left.edge - to_right.edge) / (2 * kAside);
        here.chip_off = (to_left.chip - to_right.chip) / (2 * kAside);
        here.edge_turned = (turned_left.edge - turned_right.edge) / (2 * kTurn);
        here.chip_turned = (turned_left.chip - turned_right.chip) / (2 * kTurn);
      }
      here.p_M = job.X_MW * p;
      here.corrected = job.X_MW.R * at_way(expected[i], s);
      here.ends = k == steps;
      out.push_back(here);
    }
  }
  return out;
}

double worst_gain(const OnlineLook& look, const OnlineOptions& options) {
  double out = std::numeric_limits<double>::infinity();
  for (const OnlineLoop& loop : look.loops)
    out = std::min(out, online_margin(loop, options.sensor, options.limits, options.period).gain);
  return out;
}

/// The largest cutoff, in two digits, and the longest delay with which the margin would be enough.
std::string what_would_do(const OnlineLook& look, const OnlineOptions& options) {
  std::string out;
  const auto add = [&](const std::string& text) { out += (out.empty() ? "" : ", or ") + text; };
  OnlineOptions tried = options;
  const auto good = [&](double cutoff) {
    tried.limits.cutoff = cutoff;
    return worst_gain(look, tried) >= options.least_margin;
  };
  constexpr double kLeastCutoff = 0.1;  // Hz
  if (options.limits.cutoff > kLeastCutoff && good(kLeastCutoff)) {
    double low = kLeastCutoff, high = options.limits.cutoff;
    for (int k = 0; k < 7; ++k) {
      const double middle = std::sqrt(low * high);
      (good(middle) ? low : high) = middle;
    }
    const double scale = std::pow(10, std::floor(std::log10(low)) - 1);
    add(fmt::format("--cutoff-hz {:g}", std::floor(low / scale) * scale));
  }
  tried = options;
  const double given = std::round((options.sensor.delay - kLinuxcncDelay) / options.period);
  double best = -1;
  for (double d = 0; d < given; ++d) {  // the margin falls with the delay
    tried.sensor.delay = d * options.period + kLinuxcncDelay;
    if (worst_gain(look, tried) < options.least_margin) break;
    best = d;
  }
  if (best >= 0) add(fmt::format("--delay-ms {:g}", best * options.period / units::from_ms(1)));
  if (!out.empty()) return out + " would do";
  return "no low-pass and no delay would do: the shift alone, at rest, raises the force that it follows too much; a "
         "smaller width or depth of cut, or a stiffer machine, has more margin";
}

std::string three(const Vec3& v) {
  return fmt::format("{{{:.7g}, {:.7g}, {:.7g}}}", v.x() + 0.0, v.y() + 0.0, v.z() + 0.0);
}

std::string replaced(std::string text, std::string_view what, const std::string& by) {
  for (std::size_t at = 0; (at = text.find(what, at)) != std::string::npos; at += by.size())
    text.replace(at, what.size(), by);
  return text;
}

}  // namespace

Result<ForceLoop> force_loop(const Job& job, const gcode::Program& program, const gcode::Interpretation& interpretation,
                             const OnlineOptions& options, OnlineMethod method) {
  const auto unknown = [](const char* what) {
    return fail("LC132", fmt::format("the loop in LinuxCNC does not know {}", what), {},
                "polypod predict and polypod correct judge the program without it");
  };
  if (job.measured) return unknown("a measured compliance: the kinematics module has those of the joints");
  if (job.tool_frame.tilted || job.tool_frame.turns) return unknown("a tilted tool");
  ForceLoop out;
  out.method = method;
  out.options = options;
  machining::CorrectOptions correct_options;
  correct_options.keep_samples = true;
  correct_options.progress = options.progress;
  POLYPOD_ASSIGN(correction, machining::correct(job, program, interpretation, correct_options));
  for (const gcode::Move& move : correction.programmed) {
    if (move.kind != gcode::MoveKind::rapid && job.cutter_of(move.tool).corner_radius > 0)
      return unknown("a cutter with a corner radius");
  }
  out.corrected = correction.text();
  out.answer = correction.answer();
  out.path = path_of(job, correction);
  OnlineOptions here = options;
  here.sensor.delay += kLinuxcncDelay;
  POLYPOD_ASSIGN(look, look_online(job, program, interpretation, correction, here));
  out.loop = look.loop;
  out.margin = look.margin;
  out.not_judged = look.not_judged;
  const bool online = method == OnlineMethod::online || method == OnlineMethod::both;
  if (online && !look.stable_enough) {
    return fail("LC131",
                fmt::format("the gain margin of the on-line correction is {:.2g}, less than {:g}{}: with a delay of "
                            "{:g} ms and {:g} ms of LinuxCNC, and a low-pass of {:g} Hz",
                            look.margin.gain, options.least_margin, look.margin.gain > 1 ? "" : ", so it is unstable",
                            options.sensor.delay / units::from_ms(1), kLinuxcncDelay / units::from_ms(1),
                            options.limits.cutoff),
                {}, what_would_do(look, here));
  }
  return out;
}

std::string force_component(const std::string& name) {
  return replaced(std::string(text_of_force_comp), "MACHINE", name);
}

std::string cut_component(const std::string& name, const ForceLoop& loop) {
  std::string table = fmt::format("#define PLACES {}\nstatic const Place kPlace[PLACES] = {{\n", loop.path.size());
  for (const PathForce& f : loop.path) {
    const Vec3 p = f.p_M * units::to_mm(1);
    // N s/m is 1e-3 N s/mm, and so on.
    table +=
        fmt::format("    {{{{{:.6f}, {:.6f}, {:.6f}}}, {}, {}, {}, {}, {}, {}, {}, {}}},\n", p.x(), p.y(), p.z(),
                    f.ends ? 1 : 0, three(f.edge), three(1e-3 * f.chip), three(1e-3 * f.edge_off),
                    three(1e-6 * f.chip_off), three(f.edge_turned), three(1e-3 * f.chip_turned), three(f.corrected));
  }
  table += "};\n";
  return replaced(replaced(std::string(text_of_cut_comp), "MACHINE", name), "#include_table\n", table);
}

}  // namespace polypod::control
