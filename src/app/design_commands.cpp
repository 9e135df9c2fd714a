// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include <fmt/format.h>
#include <fmt/ranges.h>
#include <unistd.h>

#include <algorithm>
#include <charconv>
#include <cmath>
#include <filesystem>
#include <memory>

#include "commands.hpp"
#include "interrupt.hpp"
#include "messages.hpp"
#include "polypod/core/files.hpp"
#include "polypod/core/text.hpp"
#include "polypod/core/units.hpp"
#include "polypod/design/analyse.hpp"
#include "polypod/design/compared.hpp"
#include "polypod/design/optimize.hpp"
#include "polypod/design/ranks.hpp"
#include "polypod/design/sensitivity.hpp"
#include "polypod/pages/study.hpp"
#include "survey_options.hpp"

namespace polypod::app {
namespace {

using design::Row;
using design::State;
using design::Study;

std::string beside(const std::string& folder, const char* name) {
  return (std::filesystem::path(folder) / name).string();
}

Json values_json(const Study& study, const design::Evaluation& e) {
  Json out = Json::object();
  const std::vector<design::Figure> figures = study.figures();
  for (std::size_t i = 0; i < figures.size(); ++i)
    out[design::info_of(figures[i]).name] = number_json(e.figures[i].value);
  return out;
}

Json row_json(const Study& study, const Row& row) {
  const design::Evaluation& e = row.evaluation;
  Json parameters = Json::object(), bounds = Json::object();
  for (const auto& [key, value] : design::parameters_of(study, row)) parameters[key] = number_json(value);
  const std::vector<design::Figure> figures = study.figures();
  for (std::size_t i = 0; i < figures.size(); ++i) {
    const design::Value& v = e.figures[i];
    if (v.lower < v.upper) bounds[design::info_of(figures[i]).name] = {number_json(v.lower), number_json(v.upper)};
  }
  Json out{{"row", row.row},
           {"state", design::name_of(e.state)},
           {"phase", design::name_of(row.phase)},
           {"parameters", parameters},
           {"values", values_json(study, e)}};
  if (!bounds.empty()) out["bounds"] = bounds;
  if (!study.wants_front()) {
    out["objective"] = number_json(e.objective.value);
    out["objective_lower"] = number_json(e.objective.lower);
    out["objective_upper"] = number_json(e.objective.upper);
  }
  if (!e.reason.empty()) out["reason"] = e.reason;
  return out;
}

Json front_json(const Study& study, const std::vector<Row>& rows, const std::vector<std::size_t>& front) {
  Json out = Json::array();
  for (const std::size_t i : front) out.push_back(row_json(study, rows[i]));
  return out;
}

Json start_json(const Study& study, const std::vector<Row>& rows) {
  for (const Row& row : rows)
    if (row.phase == design::Phase::start) return row_json(study, row);
  return {};
}

Json states_json(const std::vector<Row>& rows) {
  Json out = Json::object();
  for (const State s : {State::done, State::violates, State::dropped, State::refused}) {
    out[design::name_of(s)] =
        std::count_if(rows.begin(), rows.end(), [&](const Row& row) { return row.evaluation.state == s; });
  }
  return out;
}

std::string states_text(const std::vector<Row>& rows) {
  const Json n = states_json(rows);
  return fmt::format("{} done, {} dropped as proven worse, {} break a hold, {} refused", n["done"].get<int>(),
                     n["dropped"].get<int>(), n["violates"].get<int>(), n["refused"].get<int>());
}

std::string shown(double value) {
  return std::isfinite(value) ? fmt::format("{:.6g}", value) : std::string("-");
}

std::string shown3(double value) {
  return std::isfinite(value) ? fmt::format("{:.3g}", value) : std::string("-");
}

void print_robust(const Study& study) {
  if (study.robust.empty()) return;
  std::string box;
  for (const auto& [key, size] : study.robust) box += fmt::format("{}{} ± {:g}", box.empty() ? "" : ", ", key, size);
  fmt::print(
      "each figure is the worst of {} machines: the middle and the corners of {}; between them it may be worse\n",
      (1U << study.robust.size()) + 1, box);
}

/// What the search could not choose by, and why candidates were refused, where there is an answer all the same.
void print_doubts(const Study& study, const std::vector<Row>& rows) {
  const std::vector<std::string> same = design::unchanged_goals(study, rows);
  if (!same.empty()) {
    fmt::print("{} {} the same in all candidates that are done, so nothing is decided by it\n", fmt::join(same, ", "),
               same.size() == 1 ? "is" : "are");
  }
  const auto reasons = design::refusals(rows);
  if (!reasons.empty()) {
    const auto& [reason, count] = reasons.front();
    fmt::print("{} refused{}: {}\n", count, reasons.size() > 1 ? ", for the most frequent reason" : "",
               one_line(reason));
  }
}

/// Of an answer that a finer survey is still to judge.
void print_pending(const Study& study) {
  fmt::print("not judged again yet: {}; the command that searched goes on with it\n",
             study.holds.empty() ? "what a finer survey says of the figures is not known"
                                 : "whether a finer survey finds the holds kept is not known");
}

std::string points_text(std::size_t count) {
  return fmt::format("the front has {} {}", count, count == 1 ? "point" : "points");
}

/// Objective, parameters and figures of a row, one a line; those of the start beside them.
void print_row(const Study& study, const Row& row, const Row* start) {
  const auto line = [&](const std::string& name, const std::string& value, const std::string& of_start,
                        const std::string& rest = "") {
    std::string text = fmt::format("{:<28} {:>14} {:>14}{}", name, value, start != nullptr ? of_start : "", rest);
    text.erase(text.find_last_not_of(' ') + 1);
    fmt::print("{}\n", text);
  };
  const auto number = [&](double value) { return std::isfinite(value) ? shown(value) : std::string(); };
  line("", fmt::format("row {}", row.row), "start");
  const design::Evaluation& e = row.evaluation;
  if (!study.wants_front()) {
    line("objective", shown(e.objective.value), start != nullptr ? number(start->evaluation.objective.value) : "");
  }
  const auto parameters = design::parameters_of(study, row);
  const auto before = start != nullptr ? design::parameters_of(study, *start) : parameters;
  for (std::size_t i = 0; i < parameters.size(); ++i)
    line(parameters[i].first, shown(parameters[i].second), number(before[i].second));
  const std::vector<design::Figure> figures = study.figures();
  for (std::size_t i = 0; i < figures.size(); ++i) {
    const design::Value& v = e.figures[i];
    line(design::info_of(figures[i]).name, shown(v.value),
         start != nullptr ? number(start->evaluation.figures[i].value) : "",
         v.lower < v.upper ? fmt::format("   certainly {} to {}", shown(v.lower), shown(v.upper)) : "");
  }
  print_robust(study);
  if (start != nullptr && start->evaluation.state != State::done) {
    fmt::print("the start is no solution itself: {}\n", one_line(start->evaluation.reason));
  } else if (start != nullptr && !design::start_is_candidate(study)) {
    fmt::print("the start is no candidate: {}\n", design::kNoCandidate);
  }
}

Json binding_json(const Study& study, const Row& row) {
  Json out = Json::array();
  for (const std::string& what : design::binding(study, row)) out.push_back(what);
  return out;
}

/// What limits the best machine. `in_search`: the holds are kept as the search judged them, and no finer survey says
/// so.
void print_binding(const Study& study, const Row& row, bool in_search) {
  const std::vector<std::string> what = design::binding(study, row);
  if (study.holds.empty() && what.empty()) return;
  const bool boxes =
      std::any_of(study.holds.begin(), study.holds.end(), [](const design::Hold& h) { return h.box.has_value(); });
  std::string text =
      what.empty() ? "no bound on a figure and no end of a range" : fmt::format("{}", fmt::join(what, "; "));
  if (boxes) text += "; whether a box just fits is not known";
  fmt::print("{}limited by: {}\n",
             study.holds.empty() ? ""
             : in_search         ? "in the search all holds are kept; "
                                 : "all holds are kept; ",
             text);
}

/// What a finer survey says of the answer.
Json again_json(const Study& study, const design::JudgedAgain& again) {
  Json list = Json::array();
  for (const Row& row : again.rows) {
    const design::Evaluation& e = row.evaluation;
    const bool kept = e.state == State::done;
    list.push_back({{"row", row.row},
                    {"values", values_json(study, e)},
                    {"holds_kept", kept},
                    {"reason", kept ? Json() : Json(e.reason)}});
  }
  return {{"resolution", again.resolution}, {"holds_kept", again.holds_kept()}, {"rows", list}};
}
Json starts_json(const std::vector<design::Start>& starts) {
  Json out = Json::array();
  for (const design::Start& s : starts)
    out.push_back({{"evaluations", s.evaluations}, {"row", s.row}, {"ended_by_itself", s.by_itself}});
  return out;
}

Json hypervolume_json(const Study& study, const design::FrontVolume& volume) {
  Json reference = Json::object(), best = Json::object();
  for (std::size_t i = 0; i < study.goals.size(); ++i) {
    const char* name = design::info_of(study.goals[i].figure).name;
    reference[name] = number_json(volume.reference[i]);
    best[name] = number_json(volume.best[i]);
  }
  return {{"volume", volume.volume}, {"fraction_of_box", volume.share}, {"reference", reference}, {"best", best}};
}

void print_hypervolume(const Study& study, const std::vector<Row>& rows, const std::vector<std::size_t>& front,
                       const std::vector<double>& reference) {
  const auto volume = design::front_volume(study, rows, front, reference);
  if (volume) fmt::print("{}\n", design::in_words(study, *volume));
}

/// By how much a figure changes at most, as a share of what the search found.
double largest_change(const std::vector<const Row*>& before, const design::JudgedAgain& again, std::size_t figure) {
  double out = 0;
  for (std::size_t k = 0; k < before.size(); ++k) {
    const double was = before[k]->evaluation.figures[figure].value, is = again.rows[k].evaluation.figures[figure].value;
    if (std::isfinite(is) && was != 0) out = std::max(out, std::abs(is / was - 1));
  }
  return out;
}

/// `rows`: of the search. Nothing where they do not hold those that were judged again.
void print_again(const Study& study, const std::vector<Row>& rows, const design::JudgedAgain& again) {
  std::vector<const Row*> before;
  for (const Row& row : again.rows) {
    const auto at = std::find_if(rows.begin(), rows.end(), [&](const Row& r) { return r.row == row.row; });
    if (at == rows.end()) return;
    before.push_back(&*at);
  }
  std::vector<std::string> changed;
  const std::size_t count = before.size();
  const bool one = count == 1;
  const std::vector<design::Figure> figures = study.figures();
  for (std::size_t i = 0; i < figures.size(); ++i) {
    if (!study.surveys(figures[i])) continue;
    const char* name = design::info_of(figures[i]).name;
    const double is = again.rows[0].evaluation.figures[i].value;
    if (!one) {
      changed.push_back(fmt::format("{} changes by at most {:.2g} %", name, 100 * largest_change(before, again, i)));
    } else if (std::isfinite(is)) {
      changed.push_back(fmt::format("{} {} ({})", name, shown(is), shown(before[0]->evaluation.figures[i].value)));
    }
  }
  std::vector<std::size_t> broken;
  for (std::size_t k = 0; k < count; ++k)
    if (again.rows[k].evaluation.state != State::done) broken.push_back(k);
  const auto reason = [&](std::size_t k) { return one_line(again.rows[k].evaluation.reason); };
  const std::string verdict = broken.empty() ? study.holds.empty() ? ""
                                               : one               ? "; all holds are kept"
                                                     : fmt::format("; all {} points keep all holds", count)
                              : one ? fmt::format("; no: {}", reason(0))
                                             : fmt::format("; no: {} of {} points break a hold", broken.size(), count);
  fmt::print("judged again with resolution {} instead of {}: {}{}{}\n", again.resolution, study.resolution,
             fmt::join(changed, ", "), verdict, broken.empty() ? "" : ". Search with a higher resolution");
  if (one) return;
  constexpr std::size_t kShown = 5;
  for (std::size_t k = 0; k < std::min(kShown, broken.size()); ++k)
    fmt::print("  row {}: {}\n", again.rows[broken[k]].row, reason(broken[k]));
  if (broken.size() > kShown) fmt::print("  and {} more, see --json\n", broken.size() - kShown);
}

/// The machines that the study compares with.
Json compared_json(const design::Answer& answer, const design::Known& known) {
  Json out = Json::array();
  for (std::size_t k = 0; k < known.rows.size(); ++k) {
    const design::Standing standing = design::standing_of(answer, known.rows[k]);
    Json one = row_json(answer.study, known.rows[k]);
    one.erase("row");
    one.erase("phase");
    one["name"] = answer.study.compared[k].name;
    one["standing"] = design::name_of(standing.is);
    one["is_candidate"] = !standing.outside;
    one["resolution"] = known.resolution;
    if (answer.study.wants_front()) {
      one["dominated_by"] = standing.by > 0 ? Json(standing.by) : Json();
      one["dominated_by_count"] = standing.dominated_by;
      one["dominates"] = standing.dominates;
    }
    out.push_back(std::move(one));
  }
  return out;
}

void print_compared(const design::Answer& answer, const design::Known& known) {
  if (known.rows.empty()) return;
  const Study& study = answer.study;
  fmt::print("machines that are known{}:\n",
             known.resolution == study.resolution ? "" : fmt::format(", with resolution {}", known.resolution));
  const std::vector<design::Figure> figures = study.figures();
  for (std::size_t k = 0; k < known.rows.size(); ++k) {
    const Row& row = known.rows[k];
    std::string values;
    if (!study.wants_front()) values = fmt::format("objective {}", shown(row.evaluation.objective.value));
    for (std::size_t i = 0; i < figures.size(); ++i) {
      values += fmt::format("{}{} {}", values.empty() ? "" : ", ", design::info_of(figures[i]).name,
                            shown(row.evaluation.figures[i].value));
    }
    const auto parameters = study.parameters(row.varied);
    for (std::size_t i = study.vary.size(); i < parameters.size(); ++i)
      values += fmt::format(", {} {} by its tie", parameters[i].first, shown(parameters[i].second));
    fmt::print("  {}: {}; {}\n", one_line(study.compared[k].name), values,
               one_line(design::in_words(design::standing_of(answer, row))));
  }
  const std::string advice = design::advice(answer, known.rows);
  if (!advice.empty()) fmt::print("no: {}\n", advice);
}

Json no_json(const Study& study, const std::vector<Row>& rows) {
  Json holds = Json::array(), refused = Json::array();
  for (const design::HoldSummary& h : design::hold_summaries(study, rows)) {
    holds.push_back(
        {{"hold", h.hold}, {"judged", h.judged}, {"broken", h.broken}, {"nearest", number_json(h.nearest)}});
  }
  for (const auto& [reason, count] : design::refusals(rows)) refused.push_back({{"reason", reason}, {"count", count}});
  return {{"holds", holds}, {"refused", refused}};
}

/// Whether there is an answer that nothing speaks against: something that keeps all holds, in the finer survey as well,
/// and no machine that is known to be better.
bool says_yes(const design::Answer& answer, bool any, const design::Known& known) {
  return any && (!answer.again || answer.again->holds_kept()) && design::advice(answer, known.rows).empty();
}

const Row* start_of(const std::vector<Row>& rows) {
  for (const Row& row : rows)
    if (row.phase == design::Phase::start) return &row;
  return nullptr;
}

/// Why there is no best machine and no front.
void print_why_none(const Study& study, const std::vector<Row>& rows) {
  const bool broken = std::any_of(rows.begin(), rows.end(), [](const Row& row) {
    return row.evaluation.state == State::violates && row.phase != design::Phase::start;
  });
  fmt::print("{}\n", broken ? "no candidate keeps all holds" : "no candidate could be judged");
  if (const Row* start = start_of(rows); start != nullptr && !design::start_is_candidate(study))
    fmt::print("row {} is the start, and no candidate: {}\n", start->row, design::kNoCandidate);
  for (const design::HoldSummary& h : design::hold_summaries(study, rows)) {
    if (h.broken == 0) continue;
    fmt::print("{}\n", one_line(h.in_words()));
  }
  constexpr std::size_t kReasons = 3;
  const auto reasons = design::refusals(rows);
  for (std::size_t i = 0; i < std::min(reasons.size(), kReasons); ++i)
    fmt::print("{} refused: {}\n", reasons[i].second, one_line(reasons[i].first));
}

/// Rows side by side.
void print_table(const Study& study, const std::vector<Row>& rows, const std::vector<std::size_t>& which) {
  std::vector<std::string> head{"row", "state"};
  if (!study.wants_front()) head.emplace_back("objective");
  for (const design::Figure f : study.figures()) head.emplace_back(design::info_of(f).name);
  for (const design::Vary& v : study.vary) head.push_back(v.key);
  for (const design::Tie& t : study.ties) head.push_back(t.key);
  std::vector<std::vector<std::string>> cells{head};
  for (const std::size_t i : which) {
    const Row& row = rows[i];
    const bool is_start = row.phase == design::Phase::start && !design::start_is_candidate(study);
    std::vector<std::string> line{std::to_string(row.row), is_start ? "start" : design::name_of(row.evaluation.state)};
    if (!study.wants_front()) line.push_back(shown(row.evaluation.objective.value));
    for (const design::Value& v : row.evaluation.figures) line.push_back(shown(v.value));
    for (const auto& [key, value] : design::parameters_of(study, row)) line.push_back(shown(value));
    cells.push_back(std::move(line));
  }
  std::vector<std::size_t> width(head.size(), 0);
  for (const auto& line : cells)
    for (std::size_t k = 0; k < line.size(); ++k) width[k] = std::max(width[k], line[k].size());
  for (const auto& line : cells) {
    for (std::size_t k = 0; k < line.size(); ++k) fmt::print("{}{:>{}}", k > 0 ? "  " : "", line[k], width[k]);
    fmt::print("\n");
  }
}

/// What the search has to say in one line, or nothing where stderr is no terminal.
std::function<void(const design::SearchProgress&)> search_line(const Context& context) {
  if (!context.progress) return nullptr;
  return [](const design::SearchProgress& p) {
    const std::string best = p.front > 0                  ? fmt::format("front of {}", p.front)
                             : std::isfinite(p.objective) ? fmt::format("best {:.6g}", p.objective)
                                                          : std::string("none yet");
    fmt::print(stderr, "\r{} {} of {}, {}, about {:.0f} s left\x1b[K", design::name_of(p.phase), p.evaluations, p.most,
               best, p.seconds_left);
    std::fflush(stderr);
  };
}

constexpr const char* kWinner = "winner.toml";

/// A file of this name that no study has written stays.
Status winner_may_appear(const std::string& folder) {
  std::error_code ec;
  const std::string winner = beside(folder, kWinner);
  if (!std::filesystem::exists(winner, ec) || std::filesystem::exists(design::database_of(folder), ec)) return {};
  return fail("AP230", fmt::format("{}: is there already, and the folder holds no study", winner), {},
              "take another folder for -o");
}

Status write_winner(const Study& study, const std::string& folder, const Row& row) {
  POLYPOD_ASSIGN(text, design::file_of_row(study, row));
  return files::write_whole(beside(folder, kWinner), text);
}

}  // namespace

Command optimize_command() {
  struct Options {
    std::string study, folder;
    int seed = 1, threads = 0;
  };
  auto o = std::make_shared<Options>();
  return {
      "optimize", "The best machine of a study, or the front of several goals; every evaluation is kept",
      "polypod optimize examples/jel_optimum/strut_equal.toml -o strut_equal",
      [o](Arguments& a) {
        a.positional("STUDY", o->study, "A study file: what may change, what is wanted, what must hold");
        a.option("-o,--output", o->folder,
                 "A folder for the database and the best machine; one of the same study is gone on with", true);
        a.option("--seed", o->seed, {0, kAnyCount.max}, "Of the search, instead of that of the study");
        a.option("--threads", o->threads, {0, 1024}, "How many threads (default: all; the result is the same)");
      },
      [o](const Context& context) -> Result<int> {
        std::unique_ptr<design::Ranks> ranks;
        if (design::Ranks::started()) {
          POLYPOD_ASSIGN(joined, design::Ranks::join());
          ranks = std::move(joined);
          if (ranks->rank() > 0) {
            POLYPOD_TRY(ranks->serve(std::max(1, o->threads), [] { return interrupted(); }));
            return kDone;
          }
        }
        POLYPOD_TRY(check_files({o->study}, {}, context.json));
        POLYPOD_ASSIGN(text, files::read(o->study));
        POLYPOD_ASSIGN(study, design::study_from_text(text, o->study));
        if (context.given("--seed")) study.seed = static_cast<std::uint64_t>(o->seed);
        POLYPOD_TRY(winner_may_appear(o->folder));
        if (std::filesystem::is_directory(o->folder)) {
          POLYPOD_TRY(check_files({o->study}, {beside(o->folder, kWinner)}, context.json));
        }
        POLYPOD_ASSIGN(store, design::Store::open(o->folder, study, text, POLYPOD_VERSION));
        design::OptimizeOptions options;
        options.threads = o->threads;
        options.version = POLYPOD_VERSION;
        options.cancelled = [] { return interrupted(); };
        options.progress = search_line(context);
        options.better = [&](const Row& row) { return write_winner(study, o->folder, row); };
        std::unique_ptr<design::Crew> crew;
        if (ranks != nullptr) crew = ranks->crew(study, text, std::max(1, o->threads), options.cancelled);
        if (crew == nullptr) crew = design::thread_crew(study, o->threads, options.cancelled);
        options.crew = crew.get();
        POLYPOD_ASSIGN(found, design::optimize(study, store, options));
        if (context.progress) fmt::print(stderr, "\r\x1b[K");
        if (interrupted()) return kBadInput;  // the database keeps what was done
        if (found.best) POLYPOD_TRY(write_winner(study, o->folder, found.rows[*found.best]));
        const std::vector<Row> asked(found.rows.begin(), found.rows.begin() + static_cast<std::ptrdiff_t>(found.asked));
        const bool any = found.best || !found.front.empty();
        POLYPOD_ASSIGN(judged, design::judge_finer(study, store, found, *crew,
                                                   [line = progress_line(context, "judging again")](
                                                       double share) mutable { line(share); }));
        const auto& [again, known] = judged;
        POLYPOD_TRY(store.close());
        const design::Answer answer{study, found.rows, again};
        const bool yes = says_yes(answer, any, known);
        const Row* start = start_of(found.rows);
        if (context.json) {
          Json out({{"best", found.best ? row_json(study, found.rows[*found.best]) : Json()},
                    {"start", start_json(study, found.rows)},
                    {"evaluations", asked.size()},
                    {"others", found.rows.size() - asked.size()},
                    {"computed", found.computed},
                    {"states", states_json(asked)},
                    {"front", front_json(study, found.rows, found.front)},
                    {"complete", found.complete},
                    {"seed", study.seed},
                    {"database", design::database_of(o->folder)},
                    {"winner", found.best ? Json(beside(o->folder, kWinner)) : Json()}});
          if (found.best) out["binding"] = binding_json(study, found.rows[*found.best]);
          if (!found.starts.empty()) out["starts"] = starts_json(found.starts);
          if (const auto volume = design::front_volume(study, found.rows, found.front); volume && !found.best)
            out["hypervolume"] = hypervolume_json(study, *volume);
          if (again) out["judged_again"] = again_json(study, *again);
          if (!known.rows.empty()) out["compared"] = compared_json(answer, known);
          if (!any) out["why_none"] = no_json(study, asked);
          print_json(out);
          return yes ? kDone : kAnswerIsNo;
        }
        fmt::print("{} evaluations of at most {}: {}\n", asked.size(), study.evaluations, states_text(asked));
        if (found.computed < static_cast<std::int64_t>(asked.size())) {
          fmt::print("{} of them were kept from before\n", static_cast<std::int64_t>(asked.size()) - found.computed);
        }
        if (found.rows.size() > asked.size()) {
          fmt::print("{} more are there of another search (evaluations, search), and count\n",
                     found.rows.size() - asked.size());
        }
        if (found.starts.size() > 1) fmt::print("{}\n", design::in_words(found.starts, found.rows));
        if (found.best) {
          print_row(study, found.rows[*found.best], start);
          print_binding(study, found.rows[*found.best], again && !again->holds_kept());
          if (again) print_again(study, found.rows, *again);
          fmt::print("wrote {}\n", beside(o->folder, kWinner));
        } else if (any) {
          fmt::print("{}\n", points_text(found.front.size()));
          print_robust(study);
          print_hypervolume(study, found.rows, found.front, {});
          print_table(study, found.rows, found.front);
          if (again) print_again(study, found.rows, *again);
        } else {
          print_why_none(study, asked);
        }
        if (any) print_doubts(study, asked);
        print_compared(answer, known);
        fmt::print("every evaluation is in {}; `polypod study {}` shows them\n", design::database_of(o->folder),
                   for_shell(o->folder));
        return yes ? kDone : kAnswerIsNo;
      }};
}

namespace {

struct StudyOptions {
  std::string folder, csv, machine, output, report, front_svg, parallel_svg, state, sensitivity;
  std::vector<std::string> where, reference;
  int top = 10, evaluations = 0, seed = 1, threads = 0;
};

Result<std::vector<std::size_t>> chosen_rows(const StudyOptions& o, const Study& study, const std::vector<Row>& rows) {
  std::vector<std::function<bool(const Row&)>> tests;
  for (const std::string& text : o.where) {
    POLYPOD_ASSIGN(c, design::condition_of(study, text));
    tests.push_back(design::test_of(study, c));
  }
  if (!o.state.empty()) {
    bool known = false;
    for (const State s : {State::done, State::violates, State::dropped, State::refused})
      known = known || o.state == design::name_of(s);
    if (!known) {
      return fail("AP231", fmt::format("--state {}: unknown", o.state), {}, "known: done, violates, dropped, refused");
    }
  }
  std::vector<std::size_t> out;
  for (std::size_t i = 0; i < rows.size(); ++i) {
    if (!o.state.empty() && o.state != design::name_of(rows[i].evaluation.state)) continue;
    if (std::all_of(tests.begin(), tests.end(), [&](const auto& test) { return test(rows[i]); })) out.push_back(i);
  }
  return out;
}

/// The best first; of a front, its points first.
void sort_rows(const Study& study, const std::vector<Row>& rows, const std::vector<std::size_t>& front,
               std::vector<std::size_t>& which) {
  std::vector<std::size_t> place(rows.size(), rows.size());
  for (std::size_t i = 0; i < front.size(); ++i) place[front[i]] = i;
  const bool start_counts = design::start_is_candidate(study);
  const auto is_done = [&](const Row& row) {
    return row.evaluation.state == State::done && (start_counts || row.phase != design::Phase::start);
  };
  std::stable_sort(which.begin(), which.end(), [&](std::size_t a, std::size_t b) {
    const design::Evaluation &x = rows[a].evaluation, &y = rows[b].evaluation;
    if (study.wants_front() && place[a] != place[b]) return place[a] < place[b];
    if (is_done(rows[a]) != is_done(rows[b])) return is_done(rows[a]);
    const double u = x.objective.value, v = y.objective.value;
    return std::isnan(v) ? !std::isnan(u) : u > v;
  });
}

/// A figure a goal, NaN where --reference names none.
Result<std::vector<double>> reference_of(const StudyOptions& o, const Study& study) {
  std::vector<double> out(study.goals.size(), std::numeric_limits<double>::quiet_NaN());
  for (const std::string& text : o.reference) {
    POLYPOD_ASSIGN(c, design::condition_of(study, text));
    const auto goal = std::find_if(study.goals.begin(), study.goals.end(),
                                   [&](const design::Goal& g) { return c.name == design::info_of(g.figure).name; });
    if (goal == study.goals.end() || c.is != design::Condition::Is::equal || !study.wants_front()) {
      return fail("AP235", fmt::format("--reference {}: not GOAL=number of a front", text), {},
                  "write volume_mm3=20000, for goals of a study with several of them and without weights");
    }
    out[static_cast<std::size_t>(goal - study.goals.begin())] = c.value;
  }
  return out;
}

/// The row of --machine: a number, or `best`.
Result<const Row*> asked_row(const std::string& text, const Study& study, const std::vector<Row>& rows) {
  if (text == "best") {
    const auto best = design::best_of(study, rows);
    if (best) return &rows[*best];
    return fail("AP232", "--machine best: there is no best row", {}, "give the number of a row of the front");
  }
  std::int64_t number = 0;
  const auto [rest, code] = std::from_chars(text.data(), text.data() + text.size(), number);
  if (code == std::errc{} && rest == text.data() + text.size()) {
    for (const Row& row : rows)
      if (row.row == number) return &row;
  }
  return fail("AP232", fmt::format("--machine {}: there is no such row among {}", text, rows.size()), {},
              "give the number of a row, or `best`");
}

Json sensitivities_json(const Study& study, const std::vector<design::Sensitivity>& list) {
  Json out = Json::array();
  for (const design::Sensitivity& s : list) {
    Json coefficients = Json::object();
    for (std::size_t i = 0; i < study.vary.size(); ++i)
      coefficients[study.vary[i].key] = number_json(s.coefficients[i]);
    out.push_back({{"of", s.of},
                   {"method", "standardised rank regression"},
                   {"coefficients", coefficients},
                   {"r2", s.share_explained},
                   {"rows", s.rows}});
  }
  return out;
}

void print_sensitivities(const Study& study, const std::vector<design::Sensitivity>& list) {
  if (list.empty()) {
    fmt::print("\ntoo few rows for sensitivities\n");
    return;
  }
  fmt::print("\nsensitivities: standardised coefficients of a regression on ranks, over the rows that were tried\n");
  std::size_t width = 0;
  for (const design::Vary& v : study.vary) width = std::max(width, v.key.size());
  fmt::print("{:<{}}", "", width);
  for (const design::Sensitivity& s : list) fmt::print("  {:>18}", s.of);
  fmt::print("\n");
  for (std::size_t i = 0; i < study.vary.size(); ++i) {
    fmt::print("{:<{}}", study.vary[i].key, width);
    for (const design::Sensitivity& s : list)
      fmt::print("  {:>18}", std::isnan(s.coefficients[i]) ? "-" : fmt::format("{:.2f}", s.coefficients[i]));
    fmt::print("\n");
  }
  fmt::print("{:<{}}", "R2 (rows)", width);
  for (const design::Sensitivity& s : list)
    fmt::print("  {:>18}", fmt::format("{:.2f} ({})", s.share_explained, s.rows));
  fmt::print("\n");
}

Json estimate_json(const design::Estimate& e) {
  return {{"value", number_json(e.value)}, {"lower", number_json(e.lower)}, {"upper", number_json(e.upper)}};
}

Json global_json(const Study& study, const design::StudySensitivity& s) {
  const bool morris = s.design.method == design::SensitivityMethod::morris;
  Json list = Json::array();
  for (const design::GlobalSensitivity& of : s.of) {
    Json parameters = Json::object();
    for (std::size_t i = 0; i < study.vary.size(); ++i) {
      Json one{{morris ? "mu_star" : "total", estimate_json(of.total[i])},
               {morris ? "mu" : "first", estimate_json(of.first[i])}};
      if (morris) one["sigma"] = number_json(of.spread[i]);
      parameters[study.vary[i].key] = one;
    }
    list.push_back({{"of", of.of}, {"groups_used", of.used}, {"parameters", parameters}});
  }
  return {{"method", design::name_of(s.design.method)},
          {"evaluations", s.design.points.size()},
          {"groups", s.design.groups},
          {"seed", s.design.seed},
          {"computed", s.computed},
          {"without_figures", s.without},
          {"interval", "95 % by bootstrap over the groups"},
          {"of", list}};
}

/// What the analysis over the whole ranges says.
void print_global(const Study& study, const design::StudySensitivity& s) {
  const bool morris = s.design.method == design::SensitivityMethod::morris;
  fmt::print(
      "\nsensitivities over the whole ranges: {}, {} evaluations in {} {}, seed {}; 95 % intervals by bootstrap\n",
      morris ? "elementary effects (Morris)" : "shares of the variance (Sobol)", s.design.points.size(),
      s.design.groups, morris ? "trajectories" : "samples", s.design.seed);
  std::size_t width = 9;
  for (const design::Vary& v : study.vary) width = std::max(width, v.key.size());
  const auto interval = [](const design::Estimate& e) {
    return std::isnan(e.value) ? std::string("-") : fmt::format("{:.3g} ({:.3g} to {:.3g})", e.value, e.lower, e.upper);
  };
  for (const design::GlobalSensitivity& of : s.of) {
    fmt::print("{}\n", of.of);
    fmt::print("  {:<{}}  {:>32}  {:>32}{}\n", "", width, morris ? "mean size of the effect (mu*)" : "total share",
               morris ? "mean effect (mu)" : "share by itself", morris ? "     sigma" : "");
    for (std::size_t i = 0; i < study.vary.size(); ++i) {
      fmt::print("  {:<{}}  {:>32}  {:>32}{}\n", study.vary[i].key, width, interval(of.total[i]), interval(of.first[i]),
                 morris ? fmt::format("  {:>8}", shown3(of.spread[i])) : "");
    }
    if (of.used < s.design.groups) {
      fmt::print("  from {} of the {} {}: the others hold a candidate without this figure\n", of.used, s.design.groups,
                 morris ? "trajectories" : "samples");
    }
  }
  if (s.without > 0) {
    fmt::print("{} candidates have no figures, the first: {}\n", s.without, one_line(s.reason));
    fmt::print("what is said holds for the part of the ranges in which there are machines that have them\n");
  }
  fmt::print(
      "{}\n",
      morris ? "mu*: what the parameter changes over its range, in the unit of the figure; sigma beside it large: not "
               "linear, or it depends on others"
             : "a share by itself: of the variance over the ranges; in all: with what it does together with others");
}

/// New evaluations over the ranges, kept beside the rows of the search.
Result<std::optional<design::StudySensitivity>> sensitivity_of(const StudyOptions& o, const Context& context) {
  if (o.sensitivity.empty()) {
    POLYPOD_TRY(refuse(context, {"--evaluations", "--seed", "--threads"}, "it serves --sensitivity"));
    return std::optional<design::StudySensitivity>();
  }
  if (o.sensitivity != "morris" && o.sensitivity != "sobol") {
    return fail("AP234", fmt::format("--sensitivity {}: unknown", o.sensitivity), {}, "known: morris, sobol");
  }
  const auto method = o.sensitivity == "sobol" ? design::SensitivityMethod::sobol : design::SensitivityMethod::morris;
  Study study;
  {
    POLYPOD_ASSIGN(read, design::Store::read(o.folder));
    study = read.study();
  }
  const int n = static_cast<int>(study.vary.size());
  const int usual = method == design::SensitivityMethod::morris ? 10 * (n + 1) : 64 * (n + 2);
  POLYPOD_ASSIGN(store, design::Store::open(o.folder, study, "", POLYPOD_VERSION));
  design::SensitivityOptions options;
  options.threads = o.threads;
  options.version = POLYPOD_VERSION;
  options.cancelled = [] { return interrupted(); };
  if (context.progress) {
    options.progress = [](int done, int all) {
      fmt::print(stderr, "\rsensitivity {} of {}\x1b[K", done, all);
      std::fflush(stderr);
    };
  }
  POLYPOD_ASSIGN(out, design::study_sensitivity(study, store, method, o.evaluations > 0 ? o.evaluations : usual,
                                                static_cast<std::uint64_t>(o.seed), options));
  if (context.progress) fmt::print(stderr, "\r\x1b[K");
  POLYPOD_TRY(store.close());
  return std::optional(std::move(out));
}

Status write_study_files(const StudyOptions& o, const Study& study, const std::vector<Row>& rows,
                         const std::vector<std::size_t>& which, const std::vector<design::Sensitivity>& sensitivities,
                         const design::StudySensitivity& global, bool complete, const Row* machine_row,
                         const std::vector<design::Start>& starts, const std::vector<double>& reference,
                         const std::optional<design::JudgedAgain>& again, const design::Known& known) {
  files::Outputs out;
  if (!o.csv.empty()) {
    std::vector<std::size_t> in_order = which;
    std::sort(in_order.begin(), in_order.end(),
              [&](std::size_t a, std::size_t b) { return rows[a].row < rows[b].row; });
    POLYPOD_TRY(out.add(o.csv, design::rows_csv(study, rows, in_order)));
  }
  if (machine_row != nullptr) {
    POLYPOD_ASSIGN(text, design::file_of_row(study, *machine_row));
    POLYPOD_TRY(out.add(o.output, std::move(text)));
  }
  const pages::StudyPage page{study,          rows,   sensitivities, global, complete, POLYPOD_VERSION,
                              command_line(), starts, reference,     again,  known};
  constexpr double kWidth = 960;
  if (!o.front_svg.empty()) {
    POLYPOD_ASSIGN(figure, pages::front_figure(page));
    POLYPOD_TRY(out.add(o.front_svg, report::standalone_svg(figure, kWidth)));
  }
  if (!o.parallel_svg.empty()) {
    POLYPOD_ASSIGN(figure, pages::parallel_figure(page));
    POLYPOD_TRY(out.add(o.parallel_svg, report::standalone_svg(figure, kWidth)));
  }
  if (!o.report.empty()) {
    POLYPOD_ASSIGN(html, pages::study_page(page));
    POLYPOD_TRY(out.add(o.report, std::move(html)));
  }
  return out.commit();
}

}  // namespace

Command study_command() {
  auto o = std::make_shared<StudyOptions>();
  return {
      "study",
      "What a folder of `optimize` holds: the best, the front, sensitivities, tables, pages, any row's machine",
      "polypod study strut_equal --where 'condition<=3' --report page.html",
      [o](Arguments& a) {
        a.positional("FOLDER", o->folder, "The folder that `polypod optimize STUDY -o FOLDER` wrote");
        a.option("--top", o->top, {0, 1e6}, "How many rows are listed, the best first (default 10)");
        a.option("--where", o->where, "NAME>=number: only rows with a parameter, figure or objective so (repeatable)");
        a.option("--state", o->state, "done, violates, dropped or refused: only rows in this state");
        a.option("--reference", o->reference,
                 "GOAL=number: the reference point of a front's hypervolume (repeatable; default: a tenth of its "
                 "span beyond the front)");
        a.option("--csv", o->csv, "Write these rows as a table");
        a.option("--machine", o->machine, "A row's number, or `best`: its machine goes to --output");
        a.option("-o,--output", o->output, "The machine file of --machine");
        a.option("--front-svg", o->front_svg, "The front of the first two goals as a picture");
        a.option("--parallel-svg", o->parallel_svg, "Parallel coordinates of the best rows as a picture");
        a.option("--report", o->report, "An HTML report: what was asked and tried, the best against the start");
        a.option("--sensitivity", o->sensitivity,
                 "morris or sobol: evaluate anew over the whole ranges, and say how much each parameter matters");
        a.option("--evaluations", o->evaluations, {1, 1e7},
                 "Of --sensitivity, at most (default 10 trajectories, or 64 samples)");
        a.option("--seed", o->seed, {0, kAnyCount.max}, "Of --sensitivity (default 1)");
        a.option("--threads", o->threads, {0, 1024}, "Of --sensitivity (default: all; the result is the same)");
      },
      [o](const Context& context) -> Result<int> {
        std::vector<std::string> kept_files = design::files_of(o->folder);
        kept_files.push_back(beside(o->folder, kWinner));
        POLYPOD_TRY(
            check_files(kept_files, {o->csv, o->output, o->front_svg, o->parallel_svg, o->report}, context.json));
        if (o->machine.empty() != o->output.empty()) {
          return fail("AP233", "--machine and --output go together", {}, "write --machine best -o best.toml");
        }
        POLYPOD_ASSIGN(asked, sensitivity_of(*o, context));
        if (interrupted()) return kBadInput;  // the database keeps what was done
        POLYPOD_ASSIGN(store, design::Store::read(o->folder));
        const Study& study = store.study();
        POLYPOD_ASSIGN(kept, design::kept_sensitivity(study, store));
        const design::StudySensitivity& global = asked ? *asked : kept;
        POLYPOD_ASSIGN(rows, store.rows());
        POLYPOD_ASSIGN(complete, store.complete());
        POLYPOD_ASSIGN(starts, design::kept_starts(store));
        POLYPOD_ASSIGN(again, design::kept_again(store));
        POLYPOD_ASSIGN(known, design::kept_compared(store));
        POLYPOD_ASSIGN(reference, reference_of(*o, study));
        POLYPOD_ASSIGN(which, chosen_rows(*o, study, rows));
        const Row* machine_row = nullptr;
        if (!o->machine.empty()) {
          POLYPOD_ASSIGN(row, asked_row(o->machine, study, rows));
          machine_row = row;
        }
        const auto best = design::best_of(study, rows);
        const std::vector<std::size_t> front = design::front_of(study, rows);
        const auto sensitivities = design::sensitivities(study, rows);
        sort_rows(study, rows, front, which);
        POLYPOD_TRY(write_study_files(*o, study, rows, which, sensitivities, global, complete, machine_row, starts,
                                      reference, again, known));
        const bool pending = !again && design::to_be_judged_again(study, complete, best.has_value(), !front.empty());
        const bool any = best || !front.empty();
        const bool yes = rows.empty() || (says_yes({study, rows, again}, any, known) && !pending);
        std::vector<std::size_t> listed = which;
        listed.resize(std::min(listed.size(), static_cast<std::size_t>(o->top)));
        if (context.json) {
          Json list = Json::array();
          for (const std::size_t i : listed) list.push_back(row_json(study, rows[i]));
          Json out({{"rows", rows.size()},
                    {"selected", which.size()},
                    {"states", states_json(rows)},
                    {"complete", complete},
                    {"to_be_judged_again", pending},
                    {"version", store.version()},
                    {"seed", study.seed},
                    {"best", best ? row_json(study, rows[*best]) : Json()},
                    {"start", start_json(study, rows)},
                    {"front", front_json(study, rows, front)},
                    {"sensitivities", sensitivities_json(study, sensitivities)},
                    {"listed", list}});
          if (!starts.empty()) out["starts"] = starts_json(starts);
          if (again) out["judged_again"] = again_json(study, *again);
          if (!known.rows.empty()) out["compared"] = compared_json({study, rows, again}, known);
          const auto volume = design::front_volume(study, rows, front, reference);
          if (volume && study.wants_front()) out["hypervolume"] = hypervolume_json(study, *volume);
          if (global.design.groups > 0) out["global_sensitivities"] = global_json(study, global);
          print_json(out);
          return yes ? kDone : kAnswerIsNo;
        }
        fmt::print("study {} on {}, seed {}, Polypod {}\n", one_line(study.file), one_line(study.machine), study.seed,
                   store.version());
        fmt::print("{} rows: {}; the search {}\n", rows.size(), states_text(rows),
                   complete ? "ended by itself" : "was broken off, or is running");
        if (starts.size() > 1) fmt::print("{}\n", design::in_words(starts, rows));
        if (best) {
          fmt::print("\n");
          print_row(study, rows[*best], start_of(rows));
          print_binding(study, rows[*best], again ? !again->holds_kept() : design::may_flatter(study));
        } else if (front.empty() && !rows.empty()) {
          print_why_none(study, rows);
        }
        if (study.wants_front()) {
          fmt::print("{}\n", points_text(front.size()));
          print_robust(study);
          print_hypervolume(study, rows, front, reference);
        }
        if (again) print_again(study, rows, *again);
        if (pending) print_pending(study);
        if (any) print_doubts(study, rows);
        print_compared({study, rows, again}, known);
        if (!listed.empty()) {
          fmt::print("\n{} of {} rows, the best first\n", listed.size(), which.size());
          print_table(study, rows, listed);
        } else if (which.empty() && !rows.empty()) {
          fmt::print("\nno row is what --where and --state ask for\n");
        }
        print_sensitivities(study, sensitivities);
        if (global.design.groups > 0) print_global(study, global);
        for (const std::string* path : {&o->csv, &o->output, &o->front_svg, &o->parallel_svg, &o->report})
          if (!path->empty()) fmt::print("wrote {}\n", *path);
        return yes ? kDone : kAnswerIsNo;
      }};
}

}  // namespace polypod::app
