// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// The evaluations that a sensitivity analysis takes, kept in the store.
#include <fmt/format.h>

#include <cmath>
#include <cstdio>
#include <set>
#include <unordered_map>

#include "polypod/design/crew.hpp"
#include "polypod/design/sensitivity.hpp"
#include "rounded.hpp"

namespace polypod::design {
namespace {

constexpr const char* kNote = "sensitivity";

std::string key_of(const std::vector<double>& varied) {
  std::string out;
  for (const double x : varied) out += fmt::format("{:.12g} ", x);
  return out;
}

std::vector<double> varied_at(const Study& study, const std::vector<double>& u) {
  std::vector<double> out;
  for (std::size_t i = 0; i < study.vary.size(); ++i) out.push_back(rounded(study.vary[i].at(u[i])));
  return out;
}

using Known = std::unordered_map<std::string, Evaluation>;

void learn(const std::vector<Row>& rows, Known& known) {
  for (const Row& row : rows) known.emplace(key_of(row.varied), row.evaluation);
}

/// What the values at the points of the design say.
StudySensitivity judged(const Study& study, SampleDesign design, const Known& known) {
  StudySensitivity out;
  std::vector<const Evaluation*> at;
  for (const std::vector<double>& u : design.points) {
    const auto found = known.find(key_of(varied_at(study, u)));
    at.push_back(found == known.end() ? nullptr : &found->second);
  }
  std::set<const Evaluation*> without;
  for (const Evaluation* e : at) {
    if (e == nullptr || e->state == State::done || !without.insert(e).second) continue;
    if (out.reason.empty()) out.reason = e->reason;
  }
  out.without = static_cast<int>(without.size());
  constexpr double kNone = std::numeric_limits<double>::quiet_NaN();
  const auto add = [&](const std::string& name, const auto& number) {
    std::vector<double> values;
    for (const Evaluation* e : at) values.push_back(e == nullptr || e->state != State::done ? kNone : number(*e));
    GlobalSensitivity s = global_sensitivity(design, values);
    s.of = name;
    out.of.push_back(std::move(s));
  };
  if (!study.wants_front()) add("objective", [](const Evaluation& e) { return e.objective.value; });
  const std::vector<Figure> figures = study.figures();
  for (std::size_t i = 0; i < figures.size(); ++i)
    add(info_of(figures[i]).name, [i](const Evaluation& e) { return e.figures[i].value; });
  out.design = std::move(design);
  return out;
}

}  // namespace

Result<StudySensitivity> study_sensitivity(const Study& study, Store& store, SensitivityMethod method, int evaluations,
                                           std::uint64_t seed, const SensitivityOptions& options) {
  POLYPOD_ASSIGN(design, sample_design(method, static_cast<int>(study.vary.size()), evaluations, seed));
  POLYPOD_ASSIGN(stored, store.samples());
  Known known;
  learn(stored, known);
  // Holds would end an evaluation early: their figures are computed all the same.
  Study open = study;
  std::erase_if(open.holds, [](const Hold& h) { return h.box.has_value(); });
  for (Hold& h : open.holds) h.min = h.max = std::nullopt;
  std::vector<Row> missing;
  std::set<std::string> asked;
  std::int64_t number = stored.empty() ? 0 : stored.back().row;
  int there = 0;
  for (const std::vector<double>& u : design.points) {
    Row row;
    row.varied = varied_at(study, u);
    const std::string key = key_of(row.varied);
    if (!asked.insert(key).second) continue;
    if (known.contains(key)) {
      ++there;
      continue;
    }
    row.row = ++number;
    row.phase = Phase::sample;
    row.version = options.version;
    missing.push_back(std::move(row));
  }
  int computed = 0;
  bool whole = true;
  if (!missing.empty()) {
    const std::unique_ptr<Crew> crew = thread_crew(open, options.threads, options.cancelled);
    POLYPOD_ASSIGN(worked, crew->work(missing, 0, [&](std::size_t i, Evaluation e) -> Status {
      Row& row = missing[i];
      row.evaluation = std::move(e);
      POLYPOD_TRY(store.add_sample(row));
      known.emplace(key_of(row.varied), row.evaluation);
      ++computed;
      if (options.progress) options.progress(there + computed, static_cast<int>(asked.size()));
      return {};
    }));
    whole = worked;
  }
  const int groups = design.groups;
  StudySensitivity out = judged(study, std::move(design), known);
  out.computed = computed;
  out.complete = whole;
  if (whole) {
    POLYPOD_TRY(store.set_note(kNote, fmt::format("{} {} {}", name_of(method), groups * out.design.each(), seed)));
  }
  return out;
}

Result<StudySensitivity> kept_sensitivity(const Study& study, const Store& store) {
  POLYPOD_ASSIGN(note, store.note(kNote));
  if (note.empty()) return StudySensitivity{};
  const SensitivityMethod method = note.starts_with("sobol") ? SensitivityMethod::sobol : SensitivityMethod::morris;
  int evaluations = 0;
  unsigned long long seed = 0;
  if (std::sscanf(note.c_str(), "%*s %d %llu", &evaluations, &seed) != 2) return StudySensitivity{};
  POLYPOD_ASSIGN(design, sample_design(method, static_cast<int>(study.vary.size()), evaluations, seed));
  POLYPOD_ASSIGN(stored, store.samples());
  Known known;
  learn(stored, known);
  StudySensitivity out = judged(study, std::move(design), known);
  out.complete = true;
  return out;
}

}  // namespace polypod::design
