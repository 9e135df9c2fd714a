// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/pages/check.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include "machine_lines.hpp"
#include "polypod/core/text.hpp"
#include "polypod/core/units.hpp"
#include "polypod/kinematics/any_machine.hpp"
#include "polypod/kinematics/parts.hpp"
#include "polypod/pages/machine.hpp"
#include "polypod/report/html.hpp"
#include "program_film.hpp"

namespace polypod::pages {
namespace {

using machining::CheckProblem;
using machining::CheckResult;
using machining::Job;
using report::fixed;
using report::Verdict;
using units::to_mm;

constexpr double kNone = std::numeric_limits<double>::quiet_NaN();
constexpr std::size_t kShown = 3;    // problems in frames of their own
constexpr std::size_t kTable = 300;  // rows of the table of problems

report::Colour colour_of(int joint) {
  constexpr std::array<report::Colour, 7> kAll{report::Colour::blue,   report::Colour::orange, report::Colour::green,
                                               report::Colour::purple, report::Colour::sky,    report::Colour::ink,
                                               report::Colour::muted};
  return kAll[static_cast<std::size_t>(joint) % kAll.size()];
}

/// Which line runs from when to when, if they are few.
std::vector<report::Span> spans_of(const ProgramWalk& walk) {
  std::vector<report::Span> out;
  for (const ProgramInstant& p : walk.curve) {
    const std::string name = fmt::format("line {}", p.line);
    if (!out.empty() && out.back().name == name) {
      out.back().to = p.time;
      continue;
    }
    if (out.size() >= report::LinePlot::kMostSpans) return {};
    out.push_back({name, p.time, p.time});
  }
  std::erase_if(out, [](const report::Span& s) { return !(s.to > s.from); });
  return out;
}

class Page {
 public:
  Page(const Job& job, const gcode::Program& program, const gcode::Interpretation& interpretation,
       const CheckResult& result, const CheckPageOptions& options)
      : job_(job),
        program_(program),
        moves_(interpretation.moves),
        result_(result),
        options_(options),
        report_("Does the program fit the machine?",
                "The machine on its way along the program, without cutting: reach, limits, branches and time",
                facts()) {
    ProgramWalkOptions how;
    how.rapid_speed = options.rapid_speed;
    how.posture = job.posture;
    how.pictures = pictures_for(job.machine);
    walk_ = walk_program(job.machine, job.X_MW, program, moves_, how);
  }

  std::string html() {
    answer();
    film();
    joints();
    problems();
    inputs();
    return report_.to_html();
  }

 private:
  [[nodiscard]] std::vector<std::pair<std::string, std::string>> facts() const {
    std::vector<std::pair<std::string, std::string>> out{{"program", program_.path},
                                                         {"machine", machine::name_of(job_.machine)}};
    if (!job_.path.empty()) out.emplace_back("job", job_.path);
    const Vec3 p = job_.X_MW.p * units::kMmPerMetre;
    out.emplace_back("origin of W in M", fmt::format("x {:g}, y {:g}, z {:g} mm", p.x(), p.y(), p.z()));
    if (!options_.version.empty()) out.emplace_back("made with", "Polypod " + options_.version);
    return out;
  }

  void answer() {
    report_.add_section("Answer");
    const bool all = result_.not_judged.empty();
    if (result_.ok) {
      report_.add_verdict(all ? Verdict::good : Verdict::neutral,
                          fmt::format("Yes: every point of the program is reached within the limits{}{}.",
                                      options_.with_bodies ? ", and the bodies that are given do not touch" : "",
                                      all ? "" : ", apart from what was not judged"));
    }
    for (std::size_t i = 0; i < std::min(kShown, result_.problems.size()); ++i) {
      const CheckProblem& p = result_.problems[i];
      constexpr std::size_t kLong = 160;  // characters of a detail; the table has it whole
      std::size_t cut = std::string::npos;
      if (p.detail.size() > kLong) {
        for (const char* end : {", ", "; "})
          if (const std::size_t at = p.detail.rfind(end, kLong); at != std::string::npos)
            cut = cut == std::string::npos ? at : std::max(cut, at);
      }
      report_.add_verdict(Verdict::bad, fmt::format("Line {}, {}: {}{}.", p.line, p.kind, p.detail.substr(0, cut),
                                                    cut < p.detail.size() ? " and more, see the table" : ""));
    }
    if (result_.problems.size() > kShown) {
      const std::size_t more = result_.problems.size() - kShown;
      report_.add_text(more == 1 ? std::string("One further problem stands in the table below.")
                                 : fmt::format("{} further problems stand in the table below.", more));
    }
    std::vector<int> unknown;
    for (const CheckProblem& p : result_.not_judged) {
      if (p.kind == "end" || p.kind == "way") {
        unknown.push_back(p.line);
      } else {
        const std::string what = p.line > 0 ? fmt::format("line {}:", p.line) : p.kind;
        report_.add_verdict(Verdict::neutral, fmt::format("Not judged: {} {}.", what, p.detail));
      }
    }
    if (!unknown.empty()) {
      constexpr std::size_t kNamed = 12;
      std::string named;
      for (std::size_t i = 0; i < std::min(kNamed, unknown.size()); ++i)
        named += fmt::format("{}{}", i > 0 ? ", " : "", unknown[i]);
      if (unknown.size() > kNamed) named += fmt::format(" and {} more", unknown.size() - kNamed);
      report_.add_verdict(Verdict::neutral, fmt::format("Not judged: {} {}, where X, Y and Z are not all known.",
                                                        unknown.size() == 1 ? "line" : "lines", named));
    }
    if (!options_.places.empty()) report_.add_list(options_.places);
    report_.add_key_figures({{fixed(result_.time, 1), "s", "time without acceleration", Verdict::neutral},
                             {fixed(to_mm(result_.length), 1), "mm", "path length of the tool", Verdict::neutral},
                             {fixed(double(walk_.moves), 0), "", "moves with known ends", Verdict::neutral},
                             {fixed(double(result_.problems.size()), 0), "", "problems",
                              result_.problems.empty() ? Verdict::good : Verdict::bad}});
    std::vector<std::string> judged{"reach, limits and branches of the joints"};
    std::vector<std::string> beyond;
    const auto part = [&](bool is_judged, std::string words) {
      (is_judged ? judged : beyond).push_back(std::move(words));
    };
    part(result_.fastest_line > 0, "joint speeds in cuts");
    part(result_.hardest_line > 0, "joint accelerations in cuts");
    part(options_.with_bodies, options_.with_bodies ? "the bodies that are given" : "collisions");
    report_.add_text(fmt::format("This answers for {}: not for {}.", listed(judged), [&] {
      beyond.insert(beyond.end(), {"forces", "deflection", "vibration"});
      return listed(beyond);
    }()));
    const auto demand = [&](int line, const char* what, int joint, double share) {
      if (line == 0) return;
      report_.add_text(fmt::format("The {} in cuts are up to {:.1f} % of the job's limits: joint {} in line {}.", what,
                                   100 * share, joint + 1, line));
    };
    demand(result_.fastest_line, "joint speeds", result_.fastest.joint, result_.fastest.share);
    demand(result_.hardest_line, "joint accelerations", result_.hardest.joint, result_.hardest.share);
    if (!result_.notes.empty()) report_.add_list(result_.notes);
  }

  void film() {
    if (!walk_.any()) return;
    report_.add_section("The machine on its way");
    constexpr std::size_t kDrawn = 1500, kTurns = 12000;
    const auto scene_of = [&](std::size_t points) {
      report::Scene scene;
      scene.title = "The machine on its way along the program";
      if (job_.stock.columns() > 0 && !job_.tool_frame.tilted)
        scene.lines.push_back(box_line("stock", job_.stock.min(), job_.stock.max(), job_.X_MW));
      add_way(scene, job_.X_MW, program_, moves_, walk_, points);
      add_film(scene, job_.machine, walk_.pictures, {}, lines_of(program_, moves_));
      if (kinematics::hangs_down(job_.machine)) hang(scene);
      return scene;
    };
    const report::Scene turns = scene_of(kTurns);
    report::Scene drawn = scene_of(kDrawn);
    drawn.frames.clear();
    report_.add_scene(
        drawn,
        fmt::format(
            "{}The machine in M, drawn red where it breaks a limit. {}. The time is that of the feeds and of "
            "rapids at {} mm/min, without acceleration. The cursor in the curves below goes along; a click into "
            "a curve moves the machine there.",
            kinematics::hangs_down(job_.machine) ? "The base is above: z of the machine points down. " : "",
            film_in_words(walk_), fixed(units::to_mm_per_min(options_.rapid_speed), 0)),
        &turns);
  }

  [[nodiscard]] bool turns(int joint) const {
    return kinematics::joint_kind(job_.machine, joint) == machine::JointKind::revolute;
  }
  [[nodiscard]] double user(int joint, double q) const { return turns(joint) ? units::to_deg(q) : to_mm(q); }

  template <class Value>
  report::Series series_of(int joint, Value&& value) const {
    report::Series out{fmt::format("q{}", joint + 1), {}, {}, colour_of(joint), {}, 1.5};
    for (const ProgramInstant& p : walk_.curve) {
      out.x.push_back(p.time);
      out.y.push_back(p.reached ? value(p.q[joint]) : kNone);
    }
    return out;
  }

  void joints() {
    if (result_.joints.empty()) return;
    report_.add_section("Joints");
    const int n = kinematics::joint_count(job_.machine);
    const auto range_of = [&](int i) { return kinematics::joint_range(job_.machine, i); };
    const auto limited = [&](int i) {
      const machine::JointRange r = range_of(i);
      return std::isfinite(r.min) && std::isfinite(r.max) && r.max > r.min;
    };
    report::LinePlot share;
    share.title = "Joints within their ranges";
    share.x = {"time", "s", {}, {}, false};
    share.y = {"place in the range", "%", 0.0, 100.0, false};
    share.spans = spans_of(walk_);
    std::string without;
    for (int i = 0; i < n; ++i) {
      if (!limited(i)) {
        without += fmt::format("{}q{}", without.empty() ? "" : ", ", i + 1);
        continue;
      }
      const machine::JointRange r = range_of(i);
      constexpr double kAll = 100;
      share.series.push_back(series_of(i, [&](double q) { return kAll * (q - r.min) / (r.max - r.min); }));
    }
    if (!share.series.empty()) {
      constexpr double kAll = 100;
      share.levels = {{"lower limit", 0, report::Colour::vermillion},
                      {"upper limit", kAll, report::Colour::vermillion}};
      share.y.min.reset();
      share.y.max.reset();
      report_.add_figure(share, fmt::format("0 % is the lower limit of each joint, 100 % its upper one{}. Gaps: the "
                                            "machine does not get there.",
                                            without.empty() ? "" : "; without limits: " + without));
    }
    for (const bool turning : {false, true}) {
      report::LinePlot plot;
      plot.title = turning ? "Angles of the joints" : "Lengths of the joints";
      plot.x = {"time", "s", {}, {}, false};
      plot.y = {turning ? "angle" : "length", turning ? "deg" : "mm", {}, {}, false};
      plot.spans = share.spans;
      for (int i = 0; i < n; ++i)
        if (turns(i) == turning) plot.series.push_back(series_of(i, [&, i](double q) { return user(i, q); }));
      if (!plot.series.empty())
        report_.add_figure(plot, turning ? "Angles of the joints over the time." : "Joints over the time.");
    }
    report::Table table;
    table.caption = "What each joint takes of its range.";
    table.columns = {{"joint", "", -1},      {"least", "", 3},       {"largest", "", 3},
                     {"lower limit", "", 3}, {"upper limit", "", 3}, {"nearest to a limit", "", 3},
                     {"unit", "", -1}};
    for (int i = 0; i < n; ++i) {
      const machine::JointRange &r = result_.joints[static_cast<std::size_t>(i)], limit = range_of(i);
      const double room = std::min(r.min - limit.min, limit.max - r.max);
      table.rows.push_back({fmt::format("q{}", i + 1), user(i, r.min), user(i, r.max), user(i, limit.min),
                            user(i, limit.max), user(i, room), std::string(turns(i) ? "deg" : "mm")});
    }
    report_.add_table(table);
  }

  void problems() {
    if (result_.problems.empty() && result_.not_judged.empty()) return;
    report_.add_section("What does not fit");
    report::Table table;
    table.columns = {{"line", "", -1}, {"kind", "", -1}, {"where and why", "", -1}};
    const auto add = [&](const std::vector<CheckProblem>& all, const char* before) {
      for (const CheckProblem& p : all)
        if (table.rows.size() < kTable)
          table.rows.push_back({p.line > 0 ? std::to_string(p.line) : "", before + p.kind, p.detail});
    };
    add(result_.problems, "");
    add(result_.not_judged, "not judged: ");
    const std::size_t count = result_.problems.size() + result_.not_judged.size();
    if (count > table.rows.size())
      table.caption = fmt::format("The first {} of {}; the command's JSON has them all", table.rows.size(), count);
    report_.add_table(table);
  }

  void inputs() {
    if (options_.command.empty()) return;
    report_.add_section("Inputs");
    report_.add_text(machine::description_of(job_.machine));
    report_.add_code("The command that made this page", options_.command, false);
  }

  const Job& job_;
  const gcode::Program& program_;
  const LongVector<gcode::Move>& moves_;
  const CheckResult& result_;
  const CheckPageOptions& options_;
  report::Report report_;
  ProgramWalk walk_;
};

}  // namespace

std::string check_page(const Job& job, const gcode::Program& program, const gcode::Interpretation& interpretation,
                       const CheckResult& result, const CheckPageOptions& options) {
  return Page(job, program, interpretation, result, options).html();
}

}  // namespace polypod::pages
