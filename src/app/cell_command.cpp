// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// cell
#include "polypod/cell/cell.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>
#include <memory>
#include <numeric>
#include <optional>

#include "commands.hpp"
#include "interrupt.hpp"
#include "messages.hpp"
#include "polypod/core/figures.hpp"
#include "polypod/core/files.hpp"
#include "polypod/core/text.hpp"
#include "polypod/core/units.hpp"
#include "polypod/pages/cell.hpp"

namespace polypod::app {
namespace {

using units::to_mm;

struct Options {
  std::string file, policy, report, events, drawing, sequence;
  std::vector<std::string> sets, sweeps;
  double minutes = 10;
  int seed = 1, seeds = 1;
  bool compare = false;
};

/// Whatever the capitals of the ending.
bool ends_with(const std::string& path, std::string_view ending) {
  if (path.size() < ending.size()) return false;
  return std::equal(ending.begin(), ending.end(), path.end() - static_cast<std::ptrdiff_t>(ending.size()),
                    [](char a, char b) { return a == (b >= 'A' && b <= 'Z' ? b - 'A' + 'a' : b); });
}

Json finite(double value) {
  return std::isfinite(value) ? Json(value) : Json(nullptr);
}
Json estimate_json(const cell::Estimate& e) {
  return {{"mean", e.mean}, {"half_width_95", finite(e.half_width)}};
}
std::string estimate_text(const cell::Estimate& e, int decimals) {
  return std::isfinite(e.half_width) ? fmt::format("{:.{}f} +- {:.{}f}", e.mean, decimals, e.half_width, decimals)
                                     : fmt::format("{:.{}f}", e.mean, decimals);
}

Json points_json(const std::vector<cell::Vec2>& places) {
  Json out = Json::array();
  for (const cell::Vec2& p : places) out.push_back({p.x(), p.y()});
  return out;
}

Json planning_json(const cell::Planning& p) {
  Json methods = Json::array();
  for (const cell::Plan& plan : p.plans) {
    methods.push_back({{"method", plan.method},
                       {"measure", plan.measure},
                       {"score", plan.score},
                       {"best", plan.best ? Json(*plan.best) : Json(nullptr)},
                       {"best_of", plan.best_is},
                       {"not_below", plan.bound ? Json(*plan.bound) : Json(nullptr)},
                       {"places", points_json(plan.places)}});
  }
  return {{"stations", p.stations},
          {"flows", p.flows_given ? "given" : "simulated"},
          {"present_m_per_hour", p.present},
          {"methods", methods}};
}

Json cost_json(const cell::Cell& c, double per_min) {
  const std::optional<double> per_item = cell::cost_per_item(c.cost, per_min);
  Json rows = Json::array();
  for (const cell::CostRow& row : c.cost.rows) {
    rows.push_back({{"name", row.name},
                    {"quantity", row.quantity},
                    {"unit", row.unit},
                    {"price", row.price},
                    {"sum", row.sum()},
                    {"kind", row.kind}});
  }
  return {{"total", c.cost.total()},
          {"reserve", c.cost.reserve()},
          {"currency", c.cost.currency},
          {"with_reserve", c.cost.total() + c.cost.reserve()},
          {"assembly_hours", c.cost.hours},
          {"assembly", c.cost.hours * c.cost.hour_price},
          {"running_per_item", per_item ? Json(*per_item) : Json(nullptr)},
          {"parts", rows}};
}

Json safety_json(const cell::Safety& s) {
  Json guards = Json::array(), hazards = Json::array();
  for (const cell::GuardFigure& g : s.guards) {
    guards.push_back({{"name", g.name},
                      {"kind", g.kind},
                      {"needed_mm", finite(to_mm(g.needed))},
                      {"actual_mm", finite(to_mm(g.actual))},
                      {"stopping_ms", g.stopping > 0 ? Json(g.stopping / units::from_ms(1)) : Json(nullptr)},
                      {"enough", g.enough},
                      {"rule", g.rule},
                      {"note", g.note}});
  }
  for (const cell::Hazard& h : s.hazards) {
    hazards.push_back({{"zone", h.zone},
                       {"kind", h.kind},
                       {"cause", h.cause},
                       {"measure", h.measure},
                       {"gap_mm", h.gap < 0 ? Json(nullptr) : Json(to_mm(h.gap))},
                       {"severity", h.severity},
                       {"frequency", h.frequency},
                       {"avoidance", h.avoidance},
                       {"from_samples", h.sampled}});
  }
  return {{"stopping_ms", s.stopping / units::from_ms(1)},
          {"guards", guards},
          {"hazards", hazards},
          {"assumed", s.assumed},
          {"aid_only", true}};
}

Json layout_json(const cell::Layout& l) {
  Json interlocks = Json::array();
  for (const cell::Conflict& c : l.conflicts) {
    interlocks.push_back({{"first", c.first},
                          {"second", c.second},
                          {"distance_mm", to_mm(c.distance)},
                          {"zone", c.zone.empty() ? Json(nullptr) : Json(c.zone)}});
  }
  return {{"size_mm", vector_json((l.high - l.low) * units::kMmPerMetre)},
          {"floor_area_m2", l.floor_area},
          {"positions", l.positions},
          {"least_distance_mm", finite(to_mm(l.least_distance))},
          {"least_distance_containers_mm", finite(to_mm(l.least_distance_containers))},
          {"interlocks", interlocks}};
}

/// How long the ways take: tables of picks, and where arms stand.
Json times_json(const cell::CellResult& r) {
  Json picks = Json::object(), stands = Json::object();
  for (std::size_t t = 0; t < r.motions.picks.size(); ++t) {
    const cell::PickTable& table = r.motions.picks[t];
    if (table.times.empty()) continue;
    Json rows = Json::array();
    for (const std::vector<double>& row : table.times) {
      Json out = Json::array();
      for (const double time : row) out.push_back(finite(time));
      rows.push_back(out);
    }
    Json home = Json::array();
    for (const double time : table.home_times) home.push_back(finite(time));
    picks[r.cell.tasks[t].name] = {{"along_mm", {to_mm(table.low), to_mm(table.high)}},
                                   {"across_mm", {to_mm(table.across_low), to_mm(table.across_high)}},
                                   {"columns", table.columns},
                                   {"rows", table.rows},
                                   {"s", rows},
                                   {"to_home_s", home}};
  }
  for (std::size_t m = 0; m < r.cell.machines.size(); ++m) {
    const machine::AnyMachine& model = r.cell.machines[m].model;
    Json spots = Json::object();
    for (std::size_t k = 0; k < r.cell.spots.size(); ++k) {
      Json slots = Json::array();
      for (const cell::Stand& s : r.motions.stands[m][k]) {
        if (!s.ok)
          slots.push_back(nullptr);
        else
          slots.push_back({{"above", joints_for_user(model, s.above)}, {"straight_s", s.straight}});
      }
      if (!slots.empty()) spots[r.cell.spots[k].name] = slots;
    }
    stands[r.cell.machines[m].name] = {{"home", joints_for_user(model, r.motions.home[m])}, {"stands", spots}};
  }
  return {{"picks", picks}, {"machines", stands}};
}

/// `KEY=FROM:TO:STEP` as the key and its values.
Result<cell::SweepAxis> axis_of(const std::string& text) {
  constexpr double kMostValues = 200;
  const auto refused = [&](const std::string& why) {
    return fail("AP242", fmt::format("--sweep {}: {}", one_line(text), why), {},
                "as in --sweep conveyor.A.speed_mm_per_s=60:180:20");
  };
  const std::size_t equals = text.find('='), first = text.find(':'), second = text.find(':', first + 1);
  if (equals == std::string::npos || first == std::string::npos || second == std::string::npos || equals > first) {
    return refused("not KEY=FROM:TO:STEP");
  }
  POLYPOD_ASSIGN(from, number_of(text.substr(equals + 1, first - equals - 1), "--sweep", kAnyNumber, ""));
  POLYPOD_ASSIGN(to, number_of(text.substr(first + 1, second - first - 1), "--sweep", kAnyNumber, ""));
  POLYPOD_ASSIGN(step, number_of(text.substr(second + 1), "--sweep", kAnyNumber, ""));
  if (!(step > 0) || !(to >= from)) return refused("the range must rise, and its step be above 0");
  if (!((to - from) / step < kMostValues)) return refused("more than 200 values");
  cell::SweepAxis out{text.substr(0, equals), {}};
  for (int k = 0; from + k * step <= to + 1e-9 * step; ++k) out.values.push_back(from + k * step);
  return out;
}

Result<std::vector<cell::SweepAxis>> axes_of(const std::vector<std::string>& texts) {
  constexpr std::size_t kMostRuns = 2000;
  std::vector<cell::SweepAxis> out;
  std::size_t runs = 1;
  for (const std::string& text : texts) {
    POLYPOD_ASSIGN(axis, axis_of(text));
    for (const cell::SweepAxis& other : out) {
      if (other.key != axis.key) continue;
      return fail("AP242", fmt::format("--sweep {}: the key has its values already", one_line(text)), {},
                  "name each key once");
    }
    runs *= axis.values.size();
    out.push_back(std::move(axis));
    if (runs > kMostRuns)
      return fail("AP242", fmt::format("--sweep: more than {} combinations", kMostRuns), {}, "take larger steps");
  }
  return out;
}

std::string in_words(const std::vector<cell::SweepAxis>& axes, const std::vector<double>& values) {
  std::string out;
  for (std::size_t a = 0; a < axes.size(); ++a)
    out += fmt::format("{}{} = {:g}", out.empty() ? "" : ", ", one_line(axes[a].key), values[a]);
  return out;
}

Json sweep_json(const cell::Sweep& s) {
  const bool one = s.axes.size() == 1;
  Json rows = Json::array(), keys = Json::array();
  for (const cell::SweepAxis& a : s.axes) keys.push_back(a.key);
  for (const cell::SweepRow& row : s.rows) {
    Json out{{"values", row.values},
             {"ok", row.problems.empty()},
             {"throughput_per_min", row.simulated ? estimate_json(row.throughput) : Json(nullptr)},
             {"missed", row.simulated ? Json(row.missed) : Json(nullptr)},
             {"cost_per_item", row.cost_per_item ? Json(*row.cost_per_item) : Json(nullptr)},
             {"floor_area_m2", row.floor_area},
             {"problem", row.problems.empty() ? Json(nullptr) : Json(row.problems.front().detail)}};
    if (one) out["value"] = row.values[0];
    rows.push_back(out);
  }
  Json out{
      {"ok", s.best.has_value()}, {"keys", keys}, {"sweep", rows}, {"best", nullptr}, {"not_judged", Json::array()}};
  if (s.best) out["not_judged"] = s.rows[*s.best].not_judged;
  if (one) out["key"] = s.axes[0].key;
  if (s.best) out["best"] = one ? Json(s.rows[*s.best].values[0]) : Json(s.rows[*s.best].values);
  return out;
}

/// Runs the cell with each combination; the best has no problem and the largest throughput.
Result<int> run_sweep(const Context& context, const Options& o, const std::vector<cell::Override>& overrides,
                      const std::function<cell::CellQuestion(const cell::Cell&)>& ask) {
  POLYPOD_ASSIGN(axes, axes_of(o.sweeps));
  for (const auto& [key, option] : {std::pair{"minutes", "--minutes"}, std::pair{"seed", "--seed"}}) {
    const bool swept = std::any_of(axes.begin(), axes.end(), [&](const cell::SweepAxis& a) { return a.key == key; });
    if (swept) POLYPOD_TRY(refuse(context, {option}, fmt::format("--sweep {} gives it", key)));
  }
  std::size_t combinations = 1, done = 0;
  for (const cell::SweepAxis& a : axes) combinations *= a.values.size();
  const auto progress = progress_line(context, "sweeping");
  const auto question = [&](const cell::Cell& of) {
    cell::CellQuestion out = ask(of);
    out.settings.progress = [](double) { return !interrupted(); };
    return out;
  };
  POLYPOD_ASSIGN(s, cell::sweep(o.file, overrides, axes, question, [&](const cell::SweepRow& row) {
                   if (!progress(static_cast<double>(++done) / static_cast<double>(combinations))) return false;
                   if (!context.json) {
                     fmt::print("{}: {}{}\n", in_words(axes, row.values),
                                row.simulated ? estimate_text(row.throughput, 2) + " items a minute"
                                              : std::string("not simulated"),
                                row.problems.empty() ? ""
                                                     : fmt::format("; {}: {}", row.problems.front().kind,
                                                                   one_line(row.problems.front().detail)));
                   }
                   return true;
                 }));
  if (!s.complete) return kDone;  // Ctrl-C: the program says so
  files::Outputs together;
  if (!o.report.empty())
    POLYPOD_TRY(together.add(o.report, pages::cell_sweep_page(s, POLYPOD_VERSION, command_line())));
  POLYPOD_TRY(together.commit());
  if (context.json) {
    print_json(sweep_json(s));
  } else {
    if (!s.best)
      fmt::print("none of these is ok\n");
    else if (axes.size() == 1)
      fmt::print("best of these: {:g}\n", s.rows[*s.best].values[0]);
    else
      fmt::print("best of these: {}\n", in_words(axes, s.rows[*s.best].values));
    if (s.best)
      for (const std::string& what : s.rows[*s.best].not_judged) fmt::print("not judged {}\n", one_line(what));
    if (!o.report.empty()) fmt::print("wrote {}\n", o.report);
  }
  return s.best ? kDone : kAnswerIsNo;
}

Json document(const cell::CellResult& r) {
  const cell::Cell& c = r.cell;
  Json problems = Json::array();
  for (const cell::Problem& p : r.problems) problems.push_back({{"kind", p.kind}, {"detail", p.detail}});
  Json out{{"ok", r.problems.empty()}, {"problems", problems}, {"not_judged", r.not_judged}, {"assumed", r.assumed}};
  if (!r.simulated()) {
    out["seconds"] = nullptr;
    out["throughput_per_min"] = nullptr;
    out["utilisation"] = Json::object();
  } else {
    const cell::Outcome& o = r.outcome();
    Json use = Json::object(), waiting = Json::object(), stopped = Json::object(), tasks = Json::object(),
         belts = Json::object();
    for (std::size_t m = 0; m < c.machines.size(); ++m) {
      use[c.machines[m].name] = r.study.utilisation[m].mean;
      Json why = Json::object();
      for (const auto& [what, seconds] : o.machines[m].waiting) why[what] = seconds;
      waiting[c.machines[m].name] = why;
      stopped[c.machines[m].name] = o.machines[m].stopped;
    }
    for (std::size_t t = 0; t < c.tasks.size(); ++t) tasks[c.tasks[t].name] = o.done[t];
    for (std::size_t b = 0; b < c.conveyors.size(); ++b)
      belts[c.conveyors[b].name] = {{"running_s", o.belts[b].running}, {"most_items", o.belts[b].most}};
    out["seconds"] = o.seconds;
    out["throughput_per_min"] = r.study.throughput.mean;
    out["utilisation"] = use;
    out["throughput"] = estimate_json(r.study.throughput);
    out["throughput"]["seeds"] = r.study.outcomes.size();
    out["policy"] = r.policy;
    out["working_s"] = o.working;
    out["waiting_s"] = waiting;
    out["stopped_s"] = stopped;
    out["items"] = {{"fed", o.fed},
                    {"placed", o.placed},
                    {"missed", o.missed},
                    {"left", o.left},
                    {"unseen", o.unseen},
                    {"failed_grips", o.failed},
                    {"on_belts", o.remaining},
                    {"not_brought", std::accumulate(o.lost.begin(), o.lost.end(), 0)}};
    out["containers"] = {{"filled", o.filled}, {"emptied", o.emptied}, {"served", o.served}};
    out["tasks"] = tasks;
    out["belts"] = belts;
    out["state"] = o.state;
    out["standstill"] = o.stands_since ? Json{{"since_s", *o.stands_since},
                                              {"why", o.standstill},
                                              {"full", o.full.empty() ? Json(nullptr) : Json(o.full)}}
                                       : Json(nullptr);
    if (!r.study.policies.empty()) {
      Json policies = Json::array(), gains = Json::array(), next = Json::array();
      for (std::size_t k = 0; k < r.study.policies.size(); ++k) {
        policies.push_back({{"policy", r.study.policies[k].first},
                            {"throughput_per_min", estimate_json(r.study.policies[k].second)},
                            {"missed", estimate_json(r.study.missed_by_policy[k].second)}});
      }
      for (const cell::Gain& g : r.study.gains)
        gains.push_back({{"what", g.what}, {"gain_per_min", estimate_json(g.change)}});
      for (const cell::Gain& g : r.study.next_gains)
        next.push_back({{"what", g.what}, {"gain_per_min", estimate_json(g.change)}});
      out["policies"] = policies;
      out["limits"] = {{"gains", gains}, {"when_that_is_twice_as_fast", next}};
    }
  }
  out["cost"] = cost_json(c, r.simulated() ? r.study.throughput.mean : 0);
  out["guard_distance_mm"] = finite(to_mm(r.safety.guard_distance));
  out["guard_needed_mm"] = finite(to_mm(r.safety.guard_needed));
  out["reach"] = {{"judged", r.motions.judged}, {"out_of_reach", r.motions.out_of_reach}};
  out["layout"] = layout_json(r.layout);
  out["safety"] = safety_json(r.safety);
  out["times"] = times_json(r);
  out["planning"] = planning_json(r.planning);
  return out;
}

void print_result(const cell::CellResult& r) {
  const cell::Cell& c = r.cell;
  fmt::print("{}\n", one_line(c.description.empty() ? c.name : c.description));
  fmt::print("reach      {} of {} places judged are in reach\n", r.motions.judged - r.motions.out_of_reach,
             r.motions.judged);
  fmt::print("layout     {:.0f} x {:.0f} mm on the floor, {:.2f} m2; {} positions of machines judged\n",
             to_mm(r.layout.high.x() - r.layout.low.x()), to_mm(r.layout.high.y() - r.layout.low.y()),
             r.layout.floor_area, r.layout.positions);
  if (!r.simulated()) {
    fmt::print("cycle      not simulated: something is out of reach\n");
  } else {
    const cell::Outcome& o = r.outcome();
    fmt::print("cycle      {:.0f} s simulated, policy {}, {} seed{}\n", o.seconds, r.policy, r.study.outcomes.size(),
               r.study.outcomes.size() == 1 ? "" : "s");
    fmt::print("throughput {} items a minute{}: {} placed, {} missed, {} unseen, {} grips failed\n",
               estimate_text(r.study.throughput, r.study.outcomes.size() > 1 ? 2 : 1),
               r.study.outcomes.size() > 1 ? "; in the first run" : "", o.placed, o.missed, o.unseen, o.failed);
    if (std::any_of(c.conveyors.begin(), c.conveyors.end(), [](const cell::Conveyor& b) { return b.outfeed; }))
      fmt::print("outfeed    {} items left the cell\n", o.left);
    if (!c.containers.empty())
      fmt::print("containers {} filled, {} emptied, {} served\n", o.filled, o.emptied, o.served);
    for (std::size_t m = 0; m < c.machines.size(); ++m) {
      std::vector<std::string> waits;
      for (const auto& [what, seconds] : o.machines[m].waiting)
        waits.push_back(fmt::format("{:.0f} s for {}", seconds, one_line(what)));
      fmt::print("{:<10} {:.1f} % busy{}{}\n", c.machines[m].name, 100 * r.study.utilisation[m].mean,
                 waits.empty() ? "" : fmt::format("; waits {}", fmt::join(waits, ", ")),
                 o.machines[m].stopped > 0 ? fmt::format("; {:.0f} s stopped by STOP", o.machines[m].stopped) : "");
    }
    for (std::size_t k = 0; k < r.study.policies.size(); ++k) {
      fmt::print("policy     {:<10} {} items a minute, {} missed\n", r.study.policies[k].first,
                 estimate_text(r.study.policies[k].second, 2), estimate_text(r.study.missed_by_policy[k].second, 1));
    }
    for (const cell::Gain& g : r.study.gains)
      fmt::print("gain       {:<28} {} items a minute\n", g.what, estimate_text(g.change, 2));
    if (!r.study.next_gains.empty() && r.study.next_gains.front().change.mean > 0) {
      fmt::print("next       {}, where {} is twice as fast\n", r.study.next_gains.front().what,
                 r.study.gains.front().what.substr(0, r.study.gains.front().what.find(" 10 %")));
    }
  }
  if (!c.cost.rows.empty()) {
    fmt::print("cost       {:.0f} {}", c.cost.total(), c.cost.currency);
    if (c.cost.budget > 0)
      fmt::print(" and a reserve of {:.0f}: {:.0f} {}", c.cost.reserve(), c.cost.budget, c.cost.currency);
    if (c.cost.hours > 0) fmt::print("; {:.0f} hours of assembly", c.cost.hours);
    if (c.cost.hours > 0 && c.cost.hour_price > 0)
      fmt::print(" at {:.6g}, {:.0f} {} not in the sum", c.cost.hour_price, c.cost.hours * c.cost.hour_price,
                 c.cost.currency);
    if (const auto each = cell::cost_per_item(c.cost, r.simulated() ? r.study.throughput.mean : 0))
      fmt::print("; {:.4g} {} of running cost an item", *each, c.cost.currency);
    fmt::print("\n");
  }
  fmt::print("guards     {} for a stop within {:.0f} ms (ISO 13855; an aid, not an assessment)",
             std::isfinite(r.safety.guard_distance) ? fmt::format("{:.0f} mm", to_mm(r.safety.guard_distance))
                                                    : std::string("no distance in the standard"),
             r.safety.stopping / units::from_ms(1));
  const cell::GuardFigure* farthest = nullptr;
  for (const cell::GuardFigure& g : r.safety.guards)
    if (std::isfinite(g.needed) && (farthest == nullptr || g.needed > farthest->needed)) farthest = &g;
  if (farthest != nullptr && !(farthest->needed <= r.safety.guard_distance + 1e-9))
    fmt::print("; {} needs most, {:.0f} mm ({})", one_line(farthest->name), to_mm(farthest->needed), farthest->rule);
  fmt::print("\n");
  if (!r.layout.gaps.empty()) {
    const cell::Gap& g = r.layout.gaps.front();
    fmt::print(
        "gaps       {:.0f} mm between {} and {} at the narrowest sample; ISO 13854 asks for 25 mm (finger) to 500 mm "
        "(body) where people can be\n",
        std::floor(to_mm(g.distance)), g.mover, g.what);
  }
  for (const std::string& text : r.assumed) fmt::print("assumed    {}\n", one_line(text));
  for (const std::string& text : r.safety.assumed) fmt::print("assumed    {}\n", one_line(text));
  for (const cell::Plan& p : r.planning.plans) {
    const std::string best = !p.best   ? std::string()
                             : p.bound ? fmt::format(", best {:.6g} of {}, proven not below {}", *p.best, p.best_is,
                                                     cell::rounded_down(*p.bound))
                                       : fmt::format(", best {:.4g} of {}", *p.best, p.best_is);
    fmt::print("plan       {:<28} {:.4g}{}\n", p.method, p.score, best);
  }
  for (const std::string& text : r.not_judged) fmt::print("not judged {}\n", one_line(text));
  for (const cell::Problem& p : r.problems) fmt::print("problem    {}: {}\n", p.kind, one_line(p.detail));
  fmt::print("{}\n", !r.problems.empty()    ? "not ok"
                     : r.not_judged.empty() ? "ok"
                                            : "ok, apart from what was not judged");
}

}  // namespace

Command cell_command() {
  auto o = std::make_shared<Options>();
  return {
      "cell", "A robot cell: reach, collisions, cycle, throughput, cost, safety, documentation",
      "polypod cell cells/kozubik/cell.toml --minutes 10 --report cell.html",
      [o](Arguments& a) {
        a.positional("cell", o->file, "A cell file (docs/cell.md)");
        a.option("--minutes", o->minutes, {0, 1e5, true, false}, "Simulated time, min (default: that of the file)");
        a.option("--seed", o->seed, {0, kAnyCount.max}, "Of all random numbers (default: that of the file)");
        a.option("--seeds", o->seeds, {1, 1000},
                 "So many runs, with seeds that follow each other: means with confidence intervals (default 1)");
        a.option("--policy", o->policy, "Which item next: first, nearest or look-ahead (default: that of the file)");
        a.flag("--compare", o->compare, "Compare the policies, and find what limits the cell");
        a.option("--set", o->sets,
                 "KEY=NUMBER: another number of the cell file, as conveyor.A.speed_mm_per_s=150 (repeatable)");
        a.option(
            "--sweep", o->sweeps,
            "KEY=FROM:TO:STEP: runs the cell with each of these numbers, of several keys with each combination, and "
            "names the best (repeatable)");
        a.option("--report", o->report, "An HTML page: the documentation of the cell");
        a.option("--events", o->events, "A CSV file: each event of the first run");
        a.option("--drawing", o->drawing, "Five views with dimensions: an SVG file (.svg) or a DXF file (.dxf)");
        a.option("--sequence", o->sequence,
                 "The sequence for the PLC: Structured Text (.st, IEC 61131-3) or PLCopen XML (.xml)");
      },
      [o](const Context& context) -> Result<int> {
        POLYPOD_TRY(check_files({o->file}, {o->report, o->events, o->drawing, o->sequence}, context.json));
        for (const auto& [option, path, kinds] : {std::tuple{"--drawing", &o->drawing, std::pair{".svg", ".dxf"}},
                                                  std::tuple{"--sequence", &o->sequence, std::pair{".st", ".xml"}}}) {
          if (path->empty() || ends_with(*path, kinds.first) || ends_with(*path, kinds.second)) continue;
          return fail("AP244", fmt::format("{} {}: its ending says no format", option, one_line(*path)), {},
                      fmt::format("end it in {} or {}", kinds.first, kinds.second));
        }
        std::vector<cell::Override> overrides;
        for (const std::string& set : o->sets) {
          const std::size_t equals = set.find('=');
          if (equals == std::string::npos)
            return fail("AP240", fmt::format("--set {}: not KEY=NUMBER", one_line(set)), {},
                        "as in --set conveyor.A.speed_mm_per_s=150");
          overrides.push_back({set.substr(0, equals), set.substr(equals + 1)});
        }
        if (!o->policy.empty() && o->policy != "first" && o->policy != "nearest" && o->policy != "look-ahead") {
          return fail("AP241", fmt::format("--policy {}: not one of them", one_line(o->policy)), {},
                      "first, nearest or look-ahead");
        }
        if (!o->sweeps.empty()) {
          POLYPOD_TRY(refuse(context, {"--events", "--drawing", "--sequence", "--compare"},
                             "it serves one run, without --sweep"));
          if (files::is_standard_input(o->file)) {
            return fail("AP243", "--sweep reads the cell several times, and standard input can be read once", {},
                        "give a file");
          }
        }
        POLYPOD_ASSIGN(c, cell::read(o->file, overrides));
        const auto ask = [&](const cell::Cell& of) {
          cell::CellQuestion question = cell::question_of(of);
          if (context.given("--minutes")) question.settings.seconds = units::to_per_min(o->minutes);
          if (context.given("--seed")) question.settings.seed = static_cast<std::uint64_t>(o->seed);
          if (!o->policy.empty()) question.settings.policy = o->policy;
          question.seeds = o->seeds;
          return question;
        };
        if (!o->sweeps.empty()) return run_sweep(context, *o, overrides, ask);
        cell::CellQuestion question = ask(c);
        question.settings.record = !o->events.empty() || !o->report.empty();
        question.compare = o->compare;
        question.settings.progress = progress_line(context, "simulating");
        const cell::CellResult result = cell::judge_cell(std::move(c), question);
        if (!result.study.complete) return kDone;  // Ctrl-C: the program says so
        files::Outputs together;
        if (!o->report.empty())
          POLYPOD_TRY(together.add(o->report, pages::cell_page(result, POLYPOD_VERSION, command_line())));
        if (!o->events.empty()) POLYPOD_TRY(together.add(o->events, pages::cell_events_csv(result)));
        if (!o->drawing.empty()) {
          POLYPOD_TRY(together.add(
              o->drawing, ends_with(o->drawing, ".dxf") ? pages::cell_dxf(result) : pages::cell_drawing(result)));
        }
        if (!o->sequence.empty()) {
          POLYPOD_TRY(together.add(o->sequence, ends_with(o->sequence, ".xml") ? cell::plcopen_xml(result.cell)
                                                                               : cell::structured_text(result.cell)));
        }
        POLYPOD_TRY(together.commit());
        if (context.json) {
          print_json(document(result));
        } else {
          print_result(result);
          for (const std::string* path : {&o->report, &o->events, &o->drawing, &o->sequence})
            if (!path->empty()) fmt::print("wrote {}\n", *path);
        }
        return result.problems.empty() ? kDone : kAnswerIsNo;
      }};
}

}  // namespace polypod::app
