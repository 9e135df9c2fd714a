// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/pages/program.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>

#include "polypod/core/excerpt.hpp"
#include "polypod/core/text.hpp"
#include "polypod/core/units.hpp"
#include "polypod/report/html.hpp"
#include "program_film.hpp"

namespace polypod::pages {
namespace {

using gcode::Move;
using gcode::MoveKind;
using report::fixed;
using units::to_mm;
using units::to_mm_per_min;

constexpr const char* kFeed = "mm/min";

bool is_known(const Move& m) {
  return m.start_known && m.known_end[0] && m.known_end[1] && m.known_end[2];
}

/// The box of a move: its ends, and where an arc turns back along an axis.
void extend(Eigen::AlignedBox3d& box, const Move& m) {
  box.extend(m.start);
  box.extend(m.end);
  if (m.kind != MoveKind::arc) return;
  constexpr double kStep = 0.4;  // rad: an axis has a single extreme in it
  constexpr int kMostSteps = 10'000, kHalvings = 50;
  const double length = m.length();
  const int steps = std::clamp(static_cast<int>(std::ceil(m.sweep / kStep)), 1, kMostSteps);
  for (int i = 0; i < steps; ++i) {
    const double from = length * i / steps, to = length * (i + 1) / steps;
    const Vec3 before = m.direction(from), behind = m.direction(to);
    box.extend(m.point(from));
    for (int k = 0; k < 3; ++k) {
      if (before[k] * behind[k] >= 0) continue;
      double low = from, high = to;
      for (int n = 0; n < kHalvings; ++n) {
        const double middle = 0.5 * (low + high);
        (m.direction(middle)[k] * before[k] > 0 ? low : high) = middle;
      }
      box.extend(m.point(low));
    }
  }
}

/// All moves of one line of the program.
struct Line {
  int line = 0;
  std::string text;
  std::size_t moves = 0, unknown = 0;
  bool feeds = false, rapids = false, arcs = false;
  double length = 0, time = 0, feed = 0;
  bool feed_changes = false, time_known = true;
  Vec3 end = Vec3::Zero();
  std::array<bool, 3> end_known{};
};

std::vector<Line> lines_of(const gcode::Understood& u, std::size_t most, std::size_t& all) {
  std::vector<Line> out;
  std::map<int, std::size_t> index;
  for (const Move& m : u.interpretation.moves) {
    const gcode::Block block = u.program.blocks[static_cast<std::size_t>(m.block)];
    const auto [at, fresh] = index.try_emplace(block.line, out.size());
    if (fresh) {
      if (out.size() == most) {
        at->second = most;
      } else {
        constexpr std::size_t kText = 80;  // characters
        out.push_back({block.line, one_line(block.text.substr(0, byte_at(block.text, kText)))});
      }
    }
    if (at->second == most) continue;
    Line& line = out[at->second];
    ++line.moves;
    line.end = m.end;
    line.end_known = m.known_end;
    (m.kind == MoveKind::rapid ? line.rapids : line.feeds) = true;
    line.arcs = line.arcs || m.kind == MoveKind::arc;
    if (!is_known(m)) {
      ++line.unknown;
      continue;
    }
    const double length = m.length();
    line.length += length;
    if (m.kind == MoveKind::rapid) {
      line.time_known = false;
      continue;
    }
    line.feed_changes = line.feed_changes || (line.feed > 0 && line.feed != m.feed);
    line.feed = m.feed;
    if (m.feed > 0) {
      line.time += length / m.feed;
    } else {
      line.time_known = false;
    }
  }
  all = index.size();
  return out;
}

std::string place(const Vec3& p, const std::array<bool, 3>& known) {
  std::string out;
  for (int k = 0; k < 3; ++k) {
    out += fmt::format("{}{} {}", k > 0 ? "  " : "", "XYZ"[k],
                       known[static_cast<std::size_t>(k)] ? fixed(to_mm(p[k]), 3) : std::string("?"));
  }
  return out;
}

report::Table table_of(const gcode::Understood& u) {
  constexpr std::size_t kMost = 1000;
  std::size_t all = 0;
  const std::vector<Line> lines = lines_of(u, kMost, all);
  report::Table table;
  table.columns = {{"line", ""},        {"text", ""},        {"moves", "", 0},   {"kind", ""},
                   {"end", "mm, in W"}, {"length", "mm", 3}, {"feed", kFeed, 1}, {"time", "s", 3}};
  for (const Line& l : lines) {
    const std::string kind = l.feeds && l.rapids ? "feeds and rapids" : l.rapids ? "rapid" : l.arcs ? "arc" : "feed";
    const bool none = l.unknown == l.moves;
    const auto cell = [](bool known, double value, const char* otherwise) {
      return known ? report::Cell(value) : report::Cell(std::string(otherwise));
    };
    table.rows.push_back({fmt::format("{}", l.line), l.text, static_cast<double>(l.moves), kind,
                          place(l.end, l.end_known), cell(!none, to_mm(l.length), "not known"),
                          cell(l.feed > 0 && !l.feed_changes, to_mm_per_min(l.feed), l.feed_changes ? "several" : ""),
                          cell(l.feeds && !none && l.time_known, l.time, "")});
  }
  table.caption = fmt::format(
      "{}A click on a row shows the line in the path, and a click on the path its row.{}",
      all > lines.size() ? fmt::format("The first {} of {} lines that move the tool. ", lines.size(), all) : "",
      u.unrolled ? " Of a line with parameters or of a cycle the text is the plain block that it gives first." : "");
  return table;
}

}  // namespace

ProgramFigures figures_of(const LongVector<Move>& moves) {
  ProgramFigures out;
  Eigen::AlignedBox3d feeds, all;
  for (const Move& m : moves) {
    out.turns = out.turns || m.axes_start != m.axes_end;
    if (!is_known(m)) {
      ++out.unknown;
      continue;
    }
    extend(all, m);
    const double length = m.length();
    if (m.kind == MoveKind::rapid) {
      ++out.rapids;
      out.rapid_length += length;
      continue;
    }
    ++out.feeds;
    out.feed_length += length;
    extend(feeds, m);
    if (!(m.feed > 0)) {
      ++out.without_feed;
      continue;
    }
    out.feed_time += length / m.feed;
    out.least_feed = out.least_feed > 0 ? std::min(out.least_feed, m.feed) : m.feed;
    out.largest_feed = std::max(out.largest_feed, m.feed);
  }
  if (!feeds.isEmpty()) {
    out.low = feeds.min();
    out.high = feeds.max();
  }
  if (!all.isEmpty()) {
    out.low_all = all.min();
    out.high_all = all.max();
  }
  return out;
}

std::string program_page(const gcode::Understood& u, const std::string& version) {
  const ProgramFigures f = figures_of(u.interpretation.moves);
  const auto count = [](std::size_t n) { return fixed(static_cast<double>(n), 0); };
  std::vector<std::pair<std::string, std::string>> facts{{"program", u.program.path}};
  if (!version.empty()) facts.emplace_back("made with", "Polypod " + version);
  report::Report page("The path of the program",
                      "The programmed path of the tool tip, without a machine and without a job", facts);
  page.add_section("The path");
  if (f.feeds + f.rapids == 0) {
    page.add_verdict(report::Verdict::neutral,
                     f.unknown == 0
                         ? std::string("The program moves nothing.")
                         : fmt::format("The program has {} {}, and of none is it known where it begins and ends.",
                                       count(f.unknown), f.unknown == 1 ? "move" : "moves"));
  } else {
    page.add_verdict(report::Verdict::neutral,
                     "Not judged: no machine and no job were given. This is what the program says by itself.");
    std::vector<report::KeyFigure> figures{
        {fixed(to_mm(f.feed_length), 1), "mm", fmt::format("length of {} feed moves", count(f.feeds))},
        {fixed(to_mm(f.rapid_length), 1), "mm", fmt::format("length of {} rapids", count(f.rapids))}};
    if (f.largest_feed > 0) {
      figures.push_back({fixed(f.feed_time, 1), "s", "feed moves at their programmed feeds, without acceleration"});
      figures.push_back({fixed(to_mm_per_min(f.largest_feed), 0), kFeed,
                         f.least_feed == f.largest_feed ? std::string("programmed feed")
                                                        : fmt::format("largest programmed feed; the least is {}",
                                                                      fixed(to_mm_per_min(f.least_feed), 0))});
    }
    page.add_key_figures(figures);
    report::Table box;
    box.columns = {{"box in W", ""}, {"x", "mm"}, {"y", "mm"}, {"z", "mm"}};
    const auto add = [&](const char* name, const Vec3& low, const Vec3& high) {
      std::vector<report::Cell> row{std::string(name)};
      for (int k = 0; k < 3; ++k)
        row.emplace_back(fmt::format("{} to {}", fixed(to_mm(low[k]), 3), fixed(to_mm(high[k]), 3)));
      box.rows.push_back(std::move(row));
    };
    if (f.feeds > 0) add("feed moves", f.low, f.high);
    add("with the rapids", f.low_all, f.high_all);
    page.add_table(box);
  }
  std::vector<std::string> notes = u.interpretation.notes;
  const double dwells = gcode::dwell_time(u.program, false);
  if (dwells > 0) notes.push_back(fmt::format("Dwells (G4) take {:g} s more.", dwells));
  if (f.unknown > 0)
    notes.push_back(fmt::format("{} {} not drawn and not counted, because it is not known where {}.", count(f.unknown),
                                f.unknown == 1 ? "move is" : "moves are", f.unknown == 1 ? "it begins" : "they begin"));
  if (f.without_feed > 0)
    notes.push_back(fmt::format("{} feed moves have no F: they have no time here.", count(f.without_feed)));
  if (f.turns) notes.emplace_back("A, B and C are not drawn: which way they turn the tool is the machine's.");
  page.add_list(notes);
  if (f.feeds + f.rapids > 0) {
    const bool several = f.largest_feed > f.least_feed;
    const auto scene_of = [&](std::size_t points) {
      report::Scene scene;
      scene.title = "The path of the program";
      const auto feed = [](const Move& m) { return to_mm_per_min(m.feed); };
      for (const bool rapid : {true, false}) {
        report::Line3 line = path_of(Pose{}, u.program, u.interpretation.moves, rapid, points,
                                     rapid || !several ? std::function<double(const Move&)>() : feed);
        line.name = rapid ? "rapids" : "feed moves";
        if (!line.points.empty()) scene.lines.push_back(std::move(line));
      }
      if (several) scene.ramp = {"feed", kFeed, to_mm_per_min(f.least_feed), to_mm_per_min(f.largest_feed)};
      return scene;
    };
    constexpr std::size_t kDrawn = 2000, kTurns = 40'000;
    const report::Scene turns = scene_of(kTurns), drawn = scene_of(kDrawn);
    std::size_t shown = 0;
    for (const report::Line3& line : turns.lines) shown += line.points.size();
    page.add_scene(
        drawn,
        fmt::format("The tool tip in the frame W of G54: feed moves {}, rapids thin and grey, straight from end to "
                    "end.{}",
                    several ? "in the colour of their feed" : "blue",
                    shown + kTurns / 10 > kTurns ? " Long paths are drawn through some of their points." : ""),
        &turns);
    page.add_section("Lines of the program");
    page.add_table(table_of(u));
  }
  page.add_section("What this page does not answer");
  page.add_list(
      {"Whether a machine reaches the path, within which limits and how fast: `polypod check PROGRAM --machine NAME`.",
       "Where W lies in a machine, tools, stock, forces, deflection and tolerance: a job says them, and `polypod view "
       "PROGRAM JOB` shows the correction.",
       "How long the program takes: rapids, acceleration, corners and tool changes are the machine's."});
  return page.to_html();
}

}  // namespace polypod::pages
