// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/design/cell_study.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <limits>

#include "polypod/cell/judge.hpp"
#include "polypod/cell/rewrite.hpp"
#include "polypod/cell/sweep.hpp"
#include "polypod/core/files.hpp"
#include "polypod/core/nearest_word.hpp"
#include "polypod/core/units.hpp"
#include "sets.hpp"

namespace polypod::design {
namespace {

constexpr const char* kCancelled = "WS110";
constexpr double kInf = std::numeric_limits<double>::infinity();

bool of_cells(Figure f) {
  return f == Figure::throughput || f == Figure::missed || f == Figure::cost_per_item || f == Figure::footprint;
}

bool wants(const Study& s, Figure f) {
  const std::vector<Figure> all = s.figures();
  return std::find(all.begin(), all.end(), f) != all.end();
}

Value exactly(double value) {
  Value out;
  out.value = out.lower = out.upper = value;
  return out;
}

/// Of each figure the mean over the runs.
double figure_of(Figure f, const cell::CellResult& r) {
  if (f == Figure::footprint) return r.layout.floor_area * units::kMmPerMetre * units::kMmPerMetre;
  if (!r.simulated()) return std::numeric_limits<double>::quiet_NaN();
  const double per_min = r.study.throughput.mean;
  if (f == Figure::throughput) return per_min;
  if (f == Figure::cost_per_item) return cell::cost_per_item(r.cell.cost, per_min).value_or(kInf);
  double missed = 0;
  for (const cell::Outcome& o : r.study.outcomes) missed += o.missed;
  return missed / static_cast<double>(r.study.outcomes.size());
}

/// By how much the holds are broken, as shares of their bounds.
double violation_of(const Study& s, const Evaluation& e, std::string& broken) {
  const std::vector<Figure> order = s.figures();
  double out = 0;
  for (const Hold& h : s.holds) {
    const auto at = static_cast<std::size_t>(std::find(order.begin(), order.end(), h.figure) - order.begin());
    const double x = e.figures[at].value;
    if (std::isnan(x)) continue;
    const auto share = [](double by, double bound) { return by > 0 ? by / (bound != 0 ? std::abs(bound) : 1) : 0.0; };
    constexpr double kLot = 1e6;
    double by = 0;
    if (h.min) by += std::min(kLot, share(*h.min - x, *h.min));
    if (h.max) by += std::min(kLot, share(x - *h.max, *h.max));
    if (by > 0 && broken.empty()) broken = fmt::format("not kept: {}: {:.6g}", h.in_words(), x);
    out += by;
  }
  return out;
}

}  // namespace

Status read_cell(const config::Table& table, const std::string& name, const std::string& kept, Study& s) {
  for (const char* key : {"machine", "tilt_deg", "a_range_deg", "b_range_deg", "resolution", "rel_tol", "interference",
                          "tolerances", "errors"}) {
    if (!table.has(key)) continue;
    return fail("OP145", fmt::format("{} says nothing of a cell", key), table.place_of(key),
                "a study of a cell has `cell`, `runs`, `seed`, `evaluations`, [[set]], [[vary]], [[tie]], [[goal]] and "
                "[[hold]]");
  }
  POLYPOD_ASSIGN(file, table.text("cell"));
  constexpr int kMostRuns = 1000;
  POLYPOD_ASSIGN(runs, table.optional_integer("runs", 1, 1, kMostRuns));
  POLYPOD_ASSIGN(sets, table.tables("set"));
  s.of_cell = true;
  s.machine = file;
  s.runs = runs;
  POLYPOD_ASSIGN(overrides, overrides_of<cell::Override>(sets));
  if (!kept.empty()) {
    s.machine_toml = kept;
    const auto again = cell::from_text(kept, file);
    if (!again) return tl::unexpected(again.error());
    return {};
  }
  const std::string path = config::beside(name, file);
  const auto text = files::read(path);
  if (!text) {
    Error error = text.error();
    error.place = table.place_of("cell");
    return tl::unexpected(error);
  }
  POLYPOD_ASSIGN(plain, cell::self_contained(*text, path));
  // What is wrong with the file is said with its place there.
  const auto whole = cell::from_text(*text, path);
  if (!whole) return tl::unexpected(whole.error());
  s.machine_toml = plain;
  for (std::size_t i = 0; i < sets.size(); ++i)
    POLYPOD_TRY(cell_knows(s, overrides[i].key, 1, sets[i].place_of("key")));
  if (overrides.empty()) return {};
  POLYPOD_ASSIGN(set, cell::self_contained(plain, file, overrides));
  const auto made = cell::from_text(set, file);
  if (!made) {
    Error error = made.error();
    error.place = sets.front().place();
    return tl::unexpected(error);
  }
  s.machine_toml = set;
  return {};
}

std::optional<double> cell_number(const Study& s, const std::string& key) {
  return cell::number_at(s.machine_toml, key);
}

Status cell_knows(const Study& s, const std::string& key, double value, const Place& place) {
  if (cell_number(s, key)) return {};
  // An optional number that the file does not give.
  const auto made = cell::from_text(s.machine_toml, s.machine, {{key, number(value)}});
  if (made || (made.error().id != "CE108" && made.error().id != "CF103")) return {};
  std::vector<std::string> known;
  for (const cell::CellNumber& n : cell::numbers_of(s.machine_toml)) known.push_back(n.key);
  return fail("OP102", fmt::format("the cell {} has no number {}", s.machine, key), place,
              did_you_mean(key, known) + "name it as conveyor.A.speed_mm_per_s or task.fill.window_mm[1]");
}

Status judge_cell_figures(const Study& s) {
  const auto judge = [&](Figure f, const Place& place) -> Status {
    const char* name = info_of(f).name;
    if (of_cells(f) != s.of_cell && f != Figure::footprint) {
      return fail("OP107",
                  s.of_cell ? fmt::format("{} is a figure of machines, and the study is of a cell", name)
                            : fmt::format("{} is a figure of cells, and the study is of a machine", name),
                  place,
                  s.of_cell ? "of a cell there are throughput_per_min, missed, cost_per_item and footprint_mm2"
                            : "write cell = \"FILE\" in the place of machine");
    }
    if (!s.of_cell || f != Figure::cost_per_item) return {};
    const auto c = cell::from_text(s.machine_toml, s.machine);
    if (c && c->cost.running_price > 0) return {};
    return fail("OP107", "cost_per_item needs the price of an hour, and the cell has none", place,
                "write running_price_per_hour in [cost] of the cell");
  };
  for (const Goal& g : s.goals) {
    POLYPOD_TRY(judge(g.figure, g.place));
    if (!s.of_cell || g.figure != Figure::missed || g.maximise || s.wants_front()) continue;
    return fail("OP145", "missed is best at 0, and an objective divides by the value of what shall be small", g.place,
                "hold it instead ([[hold]] with max = 0), or give several goals without weights: a front");
  }
  for (const Hold& h : s.holds) {
    if (h.box && s.of_cell) return fail("OP107", "box_mm is a hold on the workspace of a machine", h.place);
    if (!h.box) POLYPOD_TRY(judge(h.figure, h.place));
  }
  return {};
}

Result<std::string> cell_at(const Study& s, const std::vector<double>& varied) {
  std::vector<cell::Override> overrides;
  for (const auto& [key, value] : s.parameters(varied)) overrides.push_back({key, number(value)});
  return cell::self_contained(s.machine_toml, s.machine, overrides);
}

Result<Evaluation> evaluate_cell(const Study& s, const std::vector<double>* varied, const EvaluateOptions& options) {
  const auto begin = std::chrono::steady_clock::now();
  Evaluation out;
  out.figures.resize(s.figures().size());
  const auto done = [&]() -> Evaluation& {
    out.seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
    return out;
  };
  Result<std::string> text = s.machine_toml;
  if (varied != nullptr) text = cell_at(s, *varied);
  Result<cell::Cell> made = text ? cell::from_text(*text, s.machine) : Result<cell::Cell>(tl::unexpected(text.error()));
  if (!made) {
    out.reason = made.error().message;
    return done();
  }
  cell::CellQuestion question = cell::question_of(*made);
  question.settings.progress = [&](double) { return !(options.cancelled && options.cancelled()); };
  question.seeds = s.runs;
  question.plan = false;
  question.only_sound = true;
  const cell::CellResult r = cell::judge_cell(std::move(*made), question);
  if (!r.study.complete || (options.cancelled && options.cancelled())) return fail(kCancelled, "cancelled");
  const std::vector<Figure> order = s.figures();
  for (std::size_t i = 0; i < order.size(); ++i) out.figures[i] = exactly(figure_of(order[i], r));
  std::string broken;
  out.violation = 0;
  for (const cell::Problem& p : r.problems) {
    if (p.kind == "missed" && wants(s, Figure::missed)) continue;
    if (broken.empty()) broken = fmt::format("not ok: {}: {}", p.kind, p.detail);
    out.violation += 1;
  }
  out.violation += violation_of(s, out, broken);
  out.state = out.violation > 0 ? State::violates : State::done;
  out.reason = broken;
  out.objective = objective_of(s, out.figures);
  if (out.state == State::done && !s.wants_front() && !std::isfinite(out.objective.value)) {
    out.state = State::refused;
    out.reason = "nothing was placed within the simulated time";
  }
  return done();
}

}  // namespace polypod::design
