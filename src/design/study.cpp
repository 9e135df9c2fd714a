// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/design/study.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <charconv>
#include <cmath>
#include <filesystem>
#include <map>

#include "polypod/cell/rewrite.hpp"
#include "polypod/core/config.hpp"
#include "polypod/core/files.hpp"
#include "polypod/core/nearest_word.hpp"
#include "polypod/core/units.hpp"
#include "polypod/design/cell_study.hpp"
#include "polypod/kinematics/any_machine.hpp"
#include "polypod/machine/urdf.hpp"
#include "polypod/quality/elements.hpp"
#include "polypod/statics/compliance.hpp"
#include "rounded.hpp"
#include "sets.hpp"

namespace polypod::design {
namespace {

constexpr int kMostEvaluations = 10'000'000;
constexpr std::size_t kMostVaried = 64;
constexpr double kMostSteps = 1e9;

tl::unexpected<Error> with_place(Error error, const Place& place) {
  error.place = place;
  return tl::unexpected<Error>(std::move(error));
}

Result<Vary> read_vary(const config::Table& t) {
  Vary out;
  out.place = t.place();
  POLYPOD_ASSIGN(key, t.text("key"));
  out.key = key;
  if (t.has("values")) {
    for (const char* other : {"min", "max", "step"}) {
      if (!t.has(other)) continue;
      return fail("OP101", fmt::format("{}: values and {} at once", key, other), t.place_of(other),
                  "give a list, or a range with min and max");
    }
    POLYPOD_ASSIGN(values, t.numbers("values"));
    if (values.empty()) return fail("OP101", fmt::format("{}: the list of values is empty", key), t.place_of("values"));
    out.values = values;
    out.min = *std::min_element(values.begin(), values.end());
    out.max = *std::max_element(values.begin(), values.end());
    return t.finish().map([&] { return out; });
  }
  POLYPOD_ASSIGN(min, t.number("min"));
  POLYPOD_ASSIGN(max, t.number("max"));
  POLYPOD_ASSIGN(step, t.optional_number("step", 0, config::kNotNegative));
  out.min = min;
  out.max = max;
  out.step = step;
  if (!(min < max)) {
    return fail("OP101", fmt::format("{}: the range {} to {} is empty", key, number(min), number(max)),
                t.place_of("max"), "max must lie above min; a parameter that shall not change belongs to [[set]]");
  }
  if (t.has("step") && !(step > 0 && step <= max - min)) {
    return fail("OP101",
                fmt::format("{}: the step {} does not lead from {} to {}", key, number(step), number(min), number(max)),
                t.place_of("step"), "a step lies above 0 and is at most max - min");
  }
  if (step > 0 && (max - min) / step > kMostSteps) {
    return fail("OP101", fmt::format("{}: more than {:g} steps", key, kMostSteps), t.place_of("step"));
  }
  return t.finish().map([&] { return out; });
}

Result<Tie> read_tie(const config::Table& t) {
  Tie out;
  out.place = t.place();
  POLYPOD_ASSIGN(key, t.text("key"));
  POLYPOD_ASSIGN(equals, t.text("equals"));
  POLYPOD_ASSIGN(factor, t.optional_number("factor", 1));
  POLYPOD_ASSIGN(offset, t.optional_number("offset", 0));
  out.key = key;
  out.equals = equals;
  out.factor = factor;
  out.offset = offset;
  return t.finish().map([&] { return out; });
}

Result<Figure> read_figure(const config::Table& t) {
  POLYPOD_ASSIGN(name, t.text("figure"));
  std::vector<std::string> known;
  for (const FigureInfo& info : figure_infos()) {
    if (name == info.name) return info.figure;
    known.emplace_back(info.name);
  }
  return fail("OP100", fmt::format("unknown figure \"{}\"", name), t.place_of("figure"),
              did_you_mean(name, known) + fmt::format("known: {}", fmt::join(known, ", ")));
}

Result<Goal> read_goal(const config::Table& t) {
  Goal out;
  out.place = t.place();
  POLYPOD_ASSIGN(figure, read_figure(t));
  POLYPOD_ASSIGN(sense, t.text("sense"));
  POLYPOD_ASSIGN(weight, t.optional_number("weight", 1, config::kPositive));
  POLYPOD_ASSIGN(best, t.optional_number("best", 1, config::kPositive));
  if (sense != "max" && sense != "min") {
    return fail("OP108", fmt::format("sense = \"{}\"", sense), t.place_of("sense"), "write \"max\" or \"min\"");
  }
  out.figure = figure;
  out.maximise = sense == "max";
  out.weight = weight;
  out.best = best;
  out.weighted = t.has("weight");
  return t.finish().map([&] { return out; });
}

Result<Hold> read_hold(const config::Table& t) {
  Hold out;
  out.place = t.place();
  if (t.has("box_mm")) {
    POLYPOD_ASSIGN(n, t.numbers("box_mm", 6));
    for (double& x : n) x = units::from_mm(x);
    out.box = {Vec3(n[0], n[1], n[2]), Vec3(n[3], n[4], n[5])};
    if (!(((*out.box)[1] - (*out.box)[0]).minCoeff() > 0)) {
      return fail("OP106", "box_mm: the first corner does not lie below the second", t.place_of("box_mm"),
                  "write box_mm = [x0, y0, z0, x1, y1, z1] with x0 < x1, y0 < y1, z0 < z1");
    }
    return t.finish().map([&] { return out; });
  }
  POLYPOD_ASSIGN(figure, read_figure(t));
  out.figure = figure;
  for (const auto& [key, bound] : {std::pair{"min", &out.min}, std::pair{"max", &out.max}}) {
    if (!t.has(key)) continue;
    POLYPOD_ASSIGN(value, t.number(key));
    *bound = value;
  }
  if (!out.min && !out.max) {
    return fail("OP106", fmt::format("this hold says nothing of {}", info_of(figure).name), t.place(),
                "give min, max or both");
  }
  return t.finish().map([&] { return out; });
}

/// A figure and one that is never smaller, whatever the machine: a mean and its most, a box and what holds it.
struct Ordered {
  Figure smaller, larger;
};
constexpr std::array<Ordered, 5> kOrdered{{{Figure::largest_box, Figure::volume},
                                           {Figure::condition, Figure::condition_max},
                                           {Figure::sigma_min_least, Figure::sigma_min},
                                           {Figure::tolerance, Figure::tolerance_max},
                                           {Figure::known_error, Figure::known_error_max}}};

bool never_larger(Figure a, Figure b) {
  return a == b || std::any_of(kOrdered.begin(), kOrdered.end(),
                               [&](const Ordered& o) { return o.smaller == a && o.larger == b; });
}

/// What no machine is below.
double least_of(Figure figure) {
  return figure == Figure::condition || figure == Figure::condition_max ? 1 : 0;
}

constexpr double kRounding = 1e-9;

double volume_mm3(const std::array<Vec3, 2>& box) {
  return units::to_mm3((box[1] - box[0]).prod());
}

/// Holds must leave something: of one figure, and of figures of which one is never above the other.
Status agree(const std::vector<Hold>& holds) {
  for (const Hold& upper : holds) {
    if (upper.box || !upper.max) continue;
    const char* name = info_of(upper.figure).name;
    if (*upper.max < least_of(upper.figure)) {
      return fail("OP106",
                  fmt::format("{} must be at most {}, and no machine has less than {}", name, number(*upper.max),
                              number(least_of(upper.figure))),
                  upper.place, "loosen this hold");
    }
    for (const Hold& lower : holds) {
      if (lower.box && never_larger(Figure::largest_box, upper.figure) &&
          volume_mm3(*lower.box) > *upper.max * (1 + kRounding)) {
        return fail("OP106",
                    fmt::format("{} must be at most {} (line {}), and the box of line {} has {:g} mm3 by itself", name,
                                number(*upper.max), upper.place.line, lower.place.line, volume_mm3(*lower.box)),
                    upper.place, "loosen one of the two holds");
      }
      if (lower.box || !lower.min || !never_larger(lower.figure, upper.figure) || *lower.min <= *upper.max) continue;
      const std::string why = lower.figure == upper.figure
                                  ? std::string("nothing is both")
                                  : fmt::format("{} is never above {}", info_of(lower.figure).name, name);
      return fail("OP106",
                  fmt::format("{} must be at least {} (line {}) and{} at most {} (line {}): {}",
                              info_of(lower.figure).name, number(*lower.min), lower.place.line,
                              lower.figure == upper.figure ? std::string() : fmt::format(" {}", name),
                              number(*upper.max), upper.place.line, why),
                  upper.place, "loosen one of the two holds");
    }
  }
  return {};
}

Status judge_goals(const Study& s, const config::Table& table) {
  if (s.vary.empty()) return fail("OP104", "nothing may change", table.place(), "give at least one [[vary]]");
  if (s.goals.empty()) return fail("OP104", "nothing is wanted", table.place(), "give at least one [[goal]]");
  for (std::size_t i = 0; i < s.goals.size(); ++i) {
    const Goal& g = s.goals[i];
    for (std::size_t k = 0; k < i; ++k) {
      if (s.goals[k].figure != g.figure) continue;
      return fail("OP105", fmt::format("{} is a goal twice", info_of(g.figure).name), g.place,
                  "each figure may be one goal");
    }
    if (g.weighted != s.goals.front().weighted) {
      return fail("OP105", fmt::format("some goals have a weight and some have none: {}", info_of(g.figure).name),
                  g.place, "weights on all goals give one best machine, on none a front");
    }
  }
  return agree(s.holds);
}

std::vector<std::string> keys_of(const AnyMachine& machine) {
  std::vector<std::string> out;
  for (const machine::Parameter& p : machine::settings(machine)) out.push_back(machine::key_of(p));
  for (const machine::Parameter& p : kinematics::parameters(machine)) out.push_back(machine::key_of(p));
  return out;
}

/// Whether the machine has this key, whatever value it may take.
Status knows(const Study& s, const std::string& key, double value, const Place& place) {
  if (s.of_cell) return cell_knows(s, key, value, place);
  const std::vector<std::string> known = keys_of(s.start);
  if (std::find(known.begin(), known.end(), key) != known.end()) return {};
  const auto made = machine::from_text(s.machine_toml, s.machine, {{key, number(value)}});
  if (made || (made.error().id != "MA102" && made.error().id != "CF103")) return {};
  return fail("OP102", fmt::format("the machine {} has no parameter {}", s.machine, key), place,
              did_you_mean(key, known) + "`polypod info MACHINE` lists the parameters with their units");
}

/// Each key once; every tie leads to a key that has a value.
Status judge_keys(const Study& s) {
  std::map<std::string, Place> taken;
  const auto take = [&](const std::string& key, const Place& place, const char* as) -> Status {
    const auto [at, fresh] = taken.emplace(s.of_cell ? cell::counted_key(s.machine_toml, key) : key, place);
    if (fresh) return {};
    return fail("OP103", fmt::format("{} is {} here and has its value from line {} already", key, as, at->second.line),
                place, "name each parameter once");
  };
  for (const Vary& v : s.vary) {
    POLYPOD_TRY(take(v.key, v.place, "varied"));
    POLYPOD_TRY(knows(s, v.key, v.min, v.place));
  }
  for (const Tie& t : s.ties) POLYPOD_TRY(take(t.key, t.place, "tied"));
  std::vector<std::string> known = s.of_cell ? std::vector<std::string>() : keys_of(s.start);
  if (s.of_cell) {
    for (const cell::CellNumber& n : cell::numbers_of(s.machine_toml)) known.insert(known.end(), {n.key, n.counted});
  }
  std::vector<std::string> valued = known;
  for (const Vary& v : s.vary) valued.push_back(v.key);
  for (const Tie& t : s.ties) {
    POLYPOD_TRY(knows(s, t.key, t.offset, t.place));
    const bool later = std::any_of(&t, s.ties.data() + s.ties.size(), [&](const Tie& o) { return o.key == t.equals; });
    if (later) {
      return fail("OP103", fmt::format("{} follows {}, which is tied itself, here or further down", t.key, t.equals),
                  t.place, "a tie may follow a varied parameter, a fixed one, or a tie above it");
    }
    if (std::find(valued.begin(), valued.end(), t.equals) == valued.end()) {
      return fail("OP103", fmt::format("{} follows {}, which has no value", t.key, t.equals), t.place,
                  did_you_mean(t.equals, valued) + "a tie follows a parameter that is varied or that the machine has");
    }
    valued.push_back(t.key);
  }
  return {};
}

/// Whether the machine can have this figure at all.
Status has_figure(const Study& s, Figure figure, const Place& place) {
  if (s.of_cell) return {};  // judge_cell_figures
  const machine::Task task = kinematics::task(s.start);
  const char* name = info_of(figure).name;
  const bool anywhere = figure == Figure::footprint || figure == Figure::height;
  if (!task.places() && !anywhere) {
    return fail("OP107", fmt::format("{} needs a machine whose task holds x, y and z", name), place);
  }
  const bool on_compliance =
      figure == Figure::compliance || figure == Figure::stiffness || figure == Figure::deflection;
  if (on_compliance && !statics::has_compliance(s.start)) {
    return fail("OP107", fmt::format("{} needs compliances, and {} has none", name, s.machine), place,
                "give the machine file its compliances, as docs/machine-files.md says");
  }
  if (figure == Figure::deflection && !s.duty.load) {
    return fail("OP107", fmt::format("{} needs a load", name), place,
                "write load_N = [0, 0, -100] at the head of the study");
  }
  const std::string why_not =
      figure == Figure::natural_frequency ? no_frequency(s.start, s.duty)
      : figure == Figure::drive_force     ? no_drive_force(s.start, s.duty, machine::JointKind::prismatic)
      : figure == Figure::drive_torque    ? no_drive_force(s.start, s.duty, machine::JointKind::revolute)
      : figure == Figure::longest_leg     ? no_leg(s.start)
      : figure == Figure::cycle_time      ? no_cycle_time(s.start, s.duty)
                                          : std::string();
  if (!why_not.empty()) {
    return fail("OP107", fmt::format("{}: {}", name, why_not), place, "docs/optimize.md says what each figure needs");
  }
  const bool known = figure == Figure::known_error || figure == Figure::known_error_max;
  if (known && s.errors.empty()) {
    return fail("OP107", fmt::format("{} needs the known errors", name), place,
                "write errors = [\"leg.length[1]=0.01\"] at the head of the study");
  }
  return {};
}

Result<std::vector<std::pair<std::string, double>>> read_sizes(const config::Table& t, const char* key) {
  std::vector<std::pair<std::string, double>> out;
  POLYPOD_ASSIGN(texts, t.optional_texts(key));
  for (const std::string& text : texts) {
    const std::size_t equals = text.rfind('=');
    double value = 0;
    const char* const begin = text.data() + std::min(equals + 1, text.size());
    const char* const end = text.data() + text.size();
    const auto [rest, code] = std::from_chars(begin, end, value);
    if (equals == std::string::npos || equals == 0 || begin == end || code != std::errc{} || rest != end ||
        !std::isfinite(value)) {
      return fail("OP107", fmt::format("{} holds \"{}\", which is no KEY=number", key, text), t.place_of(key),
                  "write KEY=NUMBER, as base.joint=0.01 (mm, angles in deg)");
    }
    out.emplace_back(text.substr(0, equals), value);
  }
  return out;
}

Result<std::optional<std::array<double, 2>>> read_range(const config::Table& t, const char* key) {
  if (!t.has(key)) return std::optional<std::array<double, 2>>();
  POLYPOD_ASSIGN(n, t.numbers(key, 2, {-90, 90}));
  if (!(n[0] <= n[1])) return fail("OP109", fmt::format("{}: the range is empty", key), t.place_of(key));
  return std::optional(std::array<double, 2>{units::from_deg(n[0]), units::from_deg(n[1])});
}

/// The machine's file as text, from beside the study or from the catalogue, with what [[set]] fixes.
Status read_machine(const config::Table& table, const std::string& name, const std::string& kept, Study& s) {
  if (table.has("cell")) return read_cell(table, name, kept, s);
  POLYPOD_ASSIGN(machine, table.text("machine"));
  s.machine = machine;
  POLYPOD_ASSIGN(sets, table.tables("set"));
  POLYPOD_ASSIGN(overrides, overrides_of<machine::Override>(sets));
  if (!kept.empty()) {
    POLYPOD_ASSIGN(again, machine::from_text(kept, s.machine));
    s.start = again;
    s.machine_toml = kept;
    return {};
  }
  std::error_code ec;
  const std::string beside = config::beside(name, s.machine);
  const bool file = std::filesystem::exists(machine::file_of_machine(beside), ec);
  const auto nominal = machine::load(file ? beside : s.machine);
  if (!nominal) {
    // An error inside the machine's file keeps its place there.
    if (!nominal.error().place.file.empty()) return tl::unexpected(nominal.error());
    return with_place(nominal.error(), table.place_of("machine"));
  }
  s.start = *nominal;
  s.machine_toml = machine::to_toml(*nominal);
  for (std::size_t i = 0; i < sets.size(); ++i) {
    POLYPOD_TRY(knows(s, overrides[i].key, 1, sets[i].place_of("key")));
  }
  if (overrides.empty()) return {};
  const auto made = machine::load(file ? beside : s.machine, overrides);
  if (!made) return with_place(made.error(), sets.front().place());
  s.start = *made;
  s.machine_toml = machine::to_toml(*made);
  return {};
}

/// [robust]: the box round a candidate.
Status read_robust(const config::Table& table, Study& s) {
  POLYPOD_ASSIGN(t, table.optional_table("robust"));
  if (!t) return {};
  POLYPOD_ASSIGN(sizes, read_sizes(*t, "tolerances"));
  POLYPOD_TRY(t->finish());
  constexpr std::size_t kMostKeys = 6;  // 64 corners
  if (sizes.empty() || sizes.size() > kMostKeys) {
    return fail(
        "OP141", fmt::format("[robust] has tolerances of {} parameters", sizes.size()), t->place(),
        fmt::format("write tolerances = [\"base.radius_mm=0.5\"], for 1 to {} parameters: a candidate is judged at "
                    "every corner of their box",
                    kMostKeys));
  }
  for (std::size_t i = 0; i < sizes.size(); ++i) {
    const auto& [key, size] = sizes[i];
    POLYPOD_TRY(knows(s, key, 1, t->place_of("tolerances")));
    const bool twice = std::any_of(sizes.begin(), sizes.begin() + static_cast<std::ptrdiff_t>(i),
                                   [&key = key](const auto& other) { return other.first == key; });
    if (size > 0 && !twice) continue;
    return fail("OP141", fmt::format("{}={}: {}", key, size, twice ? "its tolerance is given twice" : "no tolerance"),
                t->place_of("tolerances"), "give each parameter once, with half the width of its range, above 0");
  }
  s.robust = std::move(sizes);
  return {};
}

/// A machine to compare with. What it does not say is that of the start.
Result<Compared> read_compared(const config::Table& t, const Study& s) {
  Compared out;
  out.place = t.place();
  POLYPOD_ASSIGN(name, t.text("name"));
  out.name = name;
  constexpr std::size_t kLongest = 100;
  if (name.find_first_not_of(" \t\r\n") == std::string::npos || name.size() > kLongest) {
    return fail("OP117", fmt::format("a name of {} characters", name.size()), t.place_of("name"),
                fmt::format("name the machine in 1 to {} characters", kLongest));
  }
  const auto same = [&](const Compared& other) { return other.name == name; };
  if (std::any_of(s.compared.begin(), s.compared.end(), same)) {
    return fail("OP117", fmt::format("\"{}\" is the name of two machines to compare with", name), t.place_of("name"),
                "give each a name of its own");
  }
  POLYPOD_ASSIGN(values, read_sizes(t, "values"));
  out.varied = s.of_cell ? std::vector<double>() : s.values_of(s.start);
  const bool whole = !out.varied.empty();
  std::vector<bool> twice(s.vary.size(), false);
  out.varied.resize(s.vary.size(), 0);
  std::vector<bool> given(s.vary.size(), whole);
  for (const auto& [key, value] : values) {
    std::vector<std::string> known;
    for (const Vary& v : s.vary) known.push_back(v.key);
    const auto at = std::find(known.begin(), known.end(), key);
    if (at == known.end()) {
      return fail("OP117", fmt::format("{}: {} is not varied in this study", name, key), t.place_of("values"),
                  did_you_mean(key, known) + fmt::format("varied are {}", fmt::join(known, ", ")));
    }
    const auto i = static_cast<std::size_t>(at - known.begin());
    if (twice[i]) return fail("OP117", fmt::format("{}: {} is given twice", name, key), t.place_of("values"));
    twice[i] = given[i] = true;
    out.varied[i] = value;
  }
  for (std::size_t i = 0; i < given.size(); ++i) {
    if (given[i]) continue;
    return fail(
        "OP117", fmt::format("{}: {} has no value", name, s.vary[i].key), t.place_of("values"),
        "only parameters that `polypod info` gives a value of may be left out: give one for each that is varied");
  }
  return t.finish().map([&] { return out; });
}

template <class T, class Read>
Status read_all(const config::Table& table, const char* key, std::vector<T>& out, const Read& read) {
  POLYPOD_ASSIGN(tables, table.tables(key));
  for (const config::Table& t : tables) {
    POLYPOD_ASSIGN(one, read(t));
    out.push_back(std::move(one));
  }
  return {};
}

Status read_search(const config::Table& table, Study& s) {
  if (!table.has("search")) return {};
  POLYPOD_ASSIGN(search, table.text("search"));
  s.search = search == "models" ? Search::models : search == "evolution" ? Search::evolution : Search::automatic;
  if (s.search != Search::automatic) return {};
  return fail("OP118", fmt::format("unknown search \"{}\"", search), table.place_of("search"),
              did_you_mean(search, {"models", "evolution"}) + "known: models, evolution; without it the study decides");
}

Result<Study> study_of(const config::Table& table, const std::string& name, const std::string& kept) {
  Study s;
  s.file = name;
  POLYPOD_TRY(read_machine(table, name, kept, s));
  POLYPOD_ASSIGN(tilt, table.optional_number("tilt_deg", 0, {0, 90, false, true}));
  POLYPOD_ASSIGN(a_range, read_range(table, "a_range_deg"));
  POLYPOD_ASSIGN(b_range, read_range(table, "b_range_deg"));
  if (table.has("tilt_deg") && (a_range || b_range)) {
    return fail("OP109", "tilt_deg, and a range of A or B as well", table.place_of("tilt_deg"),
                "give a cone of directions, or ranges");
  }
  POLYPOD_ASSIGN(seed, table.optional_integer("seed", 1, 0, 2147483647));
  POLYPOD_ASSIGN(evaluations, table.optional_integer("evaluations", s.evaluations, 1, kMostEvaluations));
  POLYPOD_TRY(read_search(table, s));
  POLYPOD_ASSIGN(resolution, table.optional_integer("resolution", s.resolution, 8, 512));
  POLYPOD_ASSIGN(rel_tol, table.optional_number("rel_tol", s.relative_tolerance, {1e-6, 1}));
  POLYPOD_ASSIGN(interference, table.optional_boolean("interference", false));
  s.tilt = units::from_deg(tilt);
  s.a_range = a_range;
  s.b_range = b_range;
  s.seed = static_cast<std::uint64_t>(seed);
  s.evaluations = evaluations;
  s.resolution = resolution;
  s.relative_tolerance = rel_tol;
  s.interference = interference;
  for (const auto& [key, sizes, tolerance] :
       {std::tuple{"tolerances", &s.tolerances, true}, std::tuple{"errors", &s.errors, false}}) {
    if (!table.has(key)) continue;
    POLYPOD_ASSIGN(read, read_sizes(table, key));
    *sizes = read;
    const auto known = quality::sized(s.start, *sizes, tolerance);
    if (!known) return with_place(known.error(), table.place_of(key));
  }
  POLYPOD_ASSIGN(duty, read_duty(table, s.start));
  s.duty = std::move(duty);
  POLYPOD_TRY(read_robust(table, s));
  POLYPOD_TRY(read_all(table, "vary", s.vary, read_vary));
  POLYPOD_TRY(read_all(table, "tie", s.ties, read_tie));
  POLYPOD_TRY(read_all(table, "goal", s.goals, read_goal));
  POLYPOD_TRY(read_all(table, "hold", s.holds, read_hold));
  POLYPOD_ASSIGN(compared, table.tables("compare"));
  POLYPOD_TRY(table.finish());
  if (s.vary.size() > kMostVaried) {
    return fail("OP104", fmt::format("{} varied parameters are more than {}", s.vary.size(), kMostVaried),
                table.place());
  }
  constexpr int kMostForModels = 2000;  // a step with so many takes longer than what it looks for
  if (s.search == Search::models && evaluations > kMostForModels) {
    return fail("OP118", fmt::format("models of {} evaluations take longer than those", evaluations),
                table.place_of("search"), "write search = \"evolution\", or leave it out");
  }
  POLYPOD_TRY(judge_goals(s, table));
  if (s.goals.size() > 1 && s.goals.front().weighted) {
    POLYPOD_ASSIGN(goals, table.tables("goal"));
    for (const config::Table& t : goals) {
      if (t.has("best")) continue;
      return fail("OP105", "a weighted goal without best", t.place(),
                  "figures of different units add up only as shares: give the value that counts as 1");
    }
  }
  POLYPOD_TRY(judge_keys(s));
  POLYPOD_TRY(judge_cell_figures(s));
  for (const Goal& g : s.goals) POLYPOD_TRY(has_figure(s, g.figure, g.place));
  for (const Hold& h : s.holds) POLYPOD_TRY(has_figure(s, h.box ? Figure::volume : h.figure, h.place));
  for (const config::Table& t : compared) {
    POLYPOD_ASSIGN(one, read_compared(t, s));
    s.compared.push_back(std::move(one));
  }
  return s;
}

}  // namespace

const std::array<FigureInfo, kFigures>& figure_infos() {
  static constexpr std::array<FigureInfo, kFigures> kInfos{{
      {Figure::volume, "volume_mm3", "volume of the workspace, the middle of its proven bounds", false},
      {Figure::largest_box, "largest_box_mm3", "volume of a largest box that is certainly inside", false},
      {Figure::condition, "condition", "mean condition number over the workspace", true},
      {Figure::sigma_min, "sigma_min", "mean least singular value over the workspace", true},
      {Figure::determinant, "determinant", "mean |det J| over the workspace", true},
      {Figure::condition_max, "condition_max", "worst condition number seen in the workspace", true},
      {Figure::sigma_min_least, "sigma_min_least", "least singular value seen in the workspace", true},
      {Figure::tolerance, "tolerance_mm", "mean worst case of the position for the study's tolerances", true},
      {Figure::tolerance_max, "tolerance_max_mm", "largest worst case of the position seen", true},
      {Figure::tolerance_angle, "tolerance_rad", "mean worst case of the orientation", true},
      {Figure::known_error, "known_error_mm", "mean error of the position for the study's known errors", true},
      {Figure::known_error_max, "known_error_max_mm", "largest error of the position seen", true},
      {Figure::throughput, "throughput_per_min", "items put into containers a minute, the mean of the runs", false},
      {Figure::missed, "missed", "items that fall off the end of a belt, the mean of the runs", false},
      {Figure::cost_per_item, "cost_per_item", "price of the cell's hours for an item, in the cell's currency", false},
      {Figure::compliance, "compliance_um_per_N", "largest displacement per force at the middle of the work", false},
      {Figure::footprint, "footprint_mm2", "rectangle along x and y round the machine at home, or round the cell",
       false},
      {Figure::height, "height_mm", "height of the machine at home, tool included", false},
      {Figure::natural_frequency, "natural_frequency_hz", "lowest natural frequency at any of the poses", false, true},
      {Figure::drive_force, "drive_force_N", "largest force of a drive at rest under the load, at any of the poses",
       false, true},
      {Figure::drive_torque, "drive_torque_Nm", "largest torque of a drive at rest under the load, at any of the poses",
       false, true},
      {Figure::stiffness, "stiffness_N_per_um", "smallest stiffness of the tool tip at any of the poses", false, true},
      {Figure::deflection, "deflection_um", "largest deflection of the tool tip under the load, at any of the poses",
       false, true},
      {Figure::longest_leg, "longest_leg_mm", "longest leg between its joints at any of the poses", false, true},
      {Figure::cycle_time, "cycle_time_s", "least time of the study's motion", false},
  }};
  return kInfos;
}

const FigureInfo& info_of(Figure figure) {
  return figure_infos()[static_cast<std::size_t>(figure)];
}

bool Study::surveys(Figure figure) const {
  const FigureInfo& info = info_of(figure);
  return info.of_survey || (info.of_poses && duty.poses.empty());
}

std::optional<std::int64_t> Vary::count() const {
  if (!values.empty()) return static_cast<std::int64_t>(values.size());
  if (step > 0) return static_cast<std::int64_t>(std::floor((max - min) / step + 1e-9)) + 1;
  return {};
}

double Vary::at(double u) const {
  u = std::clamp(u, 0.0, 1.0);
  if (!values.empty()) {
    const auto n = values.size();
    return values[std::min(n - 1, static_cast<std::size_t>(u * static_cast<double>(n)))];
  }
  if (step > 0) return min + step * std::round(u * static_cast<double>(*count() - 1));
  return min + u * (max - min);
}

double Vary::share_of(double value) const {
  if (!values.empty()) {
    const auto nearest = std::min_element(
        values.begin(), values.end(), [&](double a, double b) { return std::abs(a - value) < std::abs(b - value); });
    return (static_cast<double>(nearest - values.begin()) + 0.5) / static_cast<double>(values.size());
  }
  const double last = step > 0 ? min + step * static_cast<double>(*count() - 1) : max;
  return last > min ? std::clamp((value - min) / (last - min), 0.0, 1.0) : 0;
}

std::string Hold::in_words() const {
  if (box) {
    const Vec3 a = (*box)[0] * units::kMmPerMetre, b = (*box)[1] * units::kMmPerMetre;
    return fmt::format("the box {:g}, {:g}, {:g} to {:g}, {:g}, {:g} mm is certainly inside", a.x(), a.y(), a.z(),
                       b.x(), b.y(), b.z());
  }
  std::string out = info_of(figure).name;
  if (min) out += fmt::format(" at least {}", number(*min));
  if (min && max) out += " and";
  if (max) out += fmt::format(" at most {}", number(*max));
  return out;
}

std::vector<Figure> Study::figures() const {
  std::vector<Figure> out;
  const auto add = [&](Figure figure) {
    if (std::find(out.begin(), out.end(), figure) == out.end()) out.push_back(figure);
  };
  for (const Goal& g : goals) add(g.figure);
  for (const Hold& h : holds)
    if (!h.box) add(h.figure);
  return out;
}

std::vector<std::pair<std::string, double>> Study::parameters(const std::vector<double>& varied) const {
  std::vector<std::pair<std::string, double>> out;
  for (std::size_t i = 0; i < vary.size(); ++i) out.emplace_back(vary[i].key, varied[i]);
  for (const Tie& t : ties) {
    const auto found = std::find_if(out.begin(), out.end(), [&](const auto& p) { return p.first == t.equals; });
    double value = 0;
    if (found != out.end()) {
      value = found->second;
    } else if (of_cell) {
      value = cell_number(*this, t.equals).value_or(0);
    } else {  // a parameter of the machine that stays as it is
      for (const auto& list : {machine::settings(start), kinematics::parameters(start)})
        for (const machine::Parameter& p : list)
          if (machine::key_of(p) == t.equals) value = units::to_user(p.value, p.unit);
    }
    out.emplace_back(t.key, rounded(t.factor * value + t.offset));
  }
  return out;
}

Result<AnyMachine> Study::machine_at(const std::vector<double>& varied) const {
  if (of_cell) return fail("OP146", "the study is of a cell, and its candidates are no machines");
  std::vector<machine::Override> overrides;
  for (const auto& [key, value] : parameters(varied)) overrides.push_back({key, number(value)});
  return machine::from_text(machine_toml, machine, overrides);
}

std::vector<double> Study::values_of(const AnyMachine& of) const {
  std::vector<double> out;
  if (of_cell) {
    for (const Vary& v : vary) {
      const std::optional<double> value = cell_number(*this, v.key);
      if (!value) return {};
      out.push_back(*value);
    }
    return out;
  }
  for (const Vary& v : vary) {
    const std::optional<double> value = value_of(of, v.key);
    if (!value) return {};
    out.push_back(*value);
  }
  return out;
}

std::optional<double> Study::value_of(const AnyMachine& of, const std::string& key) {
  for (const auto& list : {machine::settings(of), kinematics::parameters(of)}) {
    for (const machine::Parameter& p : list) {
      if (machine::key_of(p) == key) return units::to_user(p.value, p.unit);
    }
  }
  return std::nullopt;
}

std::string Study::identity() const {
  std::string out = fmt::format("tilt_deg {}\nseed {}\nresolution {}\nrel_tol {}\ninterference {}\n",
                                units::to_deg(tilt), seed, resolution, relative_tolerance, interference);
  for (const auto& [name, range] : {std::pair{"a_range_deg", &a_range}, std::pair{"b_range_deg", &b_range}}) {
    if (*range) out += fmt::format("{} {} {}\n", name, units::to_deg((**range)[0]), units::to_deg((**range)[1]));
  }
  for (const auto& [key, size] : tolerances) out += fmt::format("tolerance {} {}\n", key, size);
  for (const auto& [key, size] : errors) out += fmt::format("error {} {}\n", key, size);
  out += duty.identity;
  for (const auto& [key, size] : robust) out += fmt::format("robust {} {}\n", key, size);
  for (const Vary& v : vary) {
    out += fmt::format("vary {} {} {} {}", v.key, v.min, v.max, v.step);
    for (const double x : v.values) out += fmt::format(" {}", x);
    out += "\n";
  }
  for (const Tie& t : ties) out += fmt::format("tie {} {} {} {}\n", t.key, t.equals, t.factor, t.offset);
  for (const Goal& g : goals) {
    out += fmt::format("goal {} {} {} {} {}\n", info_of(g.figure).name, g.maximise ? "max" : "min", g.weight, g.best,
                       g.weighted);
  }
  for (const Hold& h : holds) out += fmt::format("hold {}\n", h.in_words());
  if (of_cell) return out + fmt::format("runs {}\ncell\n", runs) + machine_toml;
  return out + "machine\n" + machine_toml;
}

Result<Study> study_from_text(std::string_view text, const std::string& name, const std::string& machine_toml) {
  POLYPOD_ASSIGN(table, config::parse(text, name));
  return study_of(table, name, machine_toml);
}

Result<Study> read_study(const std::string& path) {
  POLYPOD_ASSIGN(text, files::read(path));
  return study_from_text(text, path);
}

}  // namespace polypod::design
