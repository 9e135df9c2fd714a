// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/pages/study.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include "machine_lines.hpp"
#include "moving_machine.hpp"
#include "polypod/core/units.hpp"
#include "polypod/design/optimize.hpp"
#include "polypod/kinematics/any_machine.hpp"
#include "polypod/kinematics/parts.hpp"
#include "polypod/pages/machine.hpp"
#include "polypod/report/html.hpp"
#include "polypod/report/parallel.hpp"
#include "polypod/report/scene.hpp"
#include "polypod/workspace/surface.hpp"

namespace polypod::pages {
namespace {

using design::Figure;
using design::Goal;
using design::Row;
using design::State;
using design::Study;
using report::number;
using report::Report;
using report::Verdict;
using Entries = std::vector<std::pair<std::string, std::string>>;

constexpr int kDigits = 5;

std::string goal_text(const Goal& g) {
  return fmt::format("{} {}", g.maximise ? "largest" : "smallest", design::info_of(g.figure).name);
}

/// The place of a figure in the order of Study::figures().
std::size_t place_of(const Study& study, Figure figure) {
  const std::vector<Figure> order = study.figures();
  return static_cast<std::size_t>(std::find(order.begin(), order.end(), figure) - order.begin());
}

double value_of(const Study& study, const Row& row, const Goal& g) {
  return row.evaluation.figures[place_of(study, g.figure)].value;
}

const Row* start_of(const StudyPage& page) {
  for (const Row& row : page.rows)
    if (row.phase == design::Phase::start) return &row;
  return nullptr;
}

std::string directions_of(const Study& s) {
  if (s.a_range || s.b_range) {
    std::string out;
    for (const auto& [range, name] : {std::pair{s.a_range, "A"}, std::pair{s.b_range, "B"}}) {
      if (!range) continue;
      out += fmt::format("{}{} from {:g} to {:g} deg", out.empty() ? "every " : " and ", name,
                         units::to_deg((*range)[0]), units::to_deg((*range)[1]));
    }
    return out;
  }
  return s.tilt > 0 ? fmt::format("every tilt up to {:g} deg", units::to_deg(s.tilt)) : "zero tilt (R = 1)";
}

class Page {
 public:
  explicit Page(const StudyPage& page)
      : page_(page),
        study_(page.study),
        report_(fmt::format("Study of {}",
                            page.study.of_cell ? "the cell " + page.study.machine : machine::name_of(page.study.start)),
                subtitle(page.study), facts(page)),
        start_(start_of(page)),
        front_(design::front_of(page.study, page.rows)) {
    if (const auto best = design::best_of(page.study, page.rows)) best_ = &page.rows[*best];
  }

  Result<std::string> html() {
    answer();
    asked();
    tried();
    tradeoffs();
    sensitivities();
    POLYPOD_TRY(machines());
    inputs();
    return report_.to_html();
  }

 private:
  static std::string subtitle(const Study& study) {
    std::string out;
    for (const Goal& g : study.goals) out += (out.empty() ? "" : ", ") + goal_text(g);
    return fmt::format("Wanted: {}; {}", out, study.wants_front() ? "the front of all" : "one machine");
  }

  static Entries facts(const StudyPage& page) {
    Entries out{{"study", page.study.file}, {page.study.of_cell ? "cell" : "machine", page.study.machine}};
    if (!page.study.of_cell) out.emplace_back("tool directions", directions_of(page.study));
    out.emplace_back("seed", std::to_string(page.study.seed));
    if (!page.version.empty()) out.emplace_back("made with", "Polypod " + page.version);
    return out;
  }

  void answer() {
    report_.add_section("The answer");
    report_.add_text(
        study_.of_cell
            ? "This answers for the cells that the search tried, as far as `polypod cell` judges them: not for those "
              "it "
              "did not try, and not for what the page of a cell lists as not judged."
            : "This answers for the machines that the search tried, built as the study says: not for those it did not "
              "try, and not for what is no figure of the study, such as strength, drives, cost and manufacture.");
    if (best_ == nullptr && front_.empty()) {
      why_none();
      known();
      return;
    }
    if (!page_.complete) {
      report_.add_verdict(Verdict::bad, "The search had not ended when this page was made: it may still find better.");
    }
    if (best_ == nullptr) {
      report_.add_verdict(
          Verdict::neutral,
          fmt::format("{} machines are left of which none is better than another in every goal.", front_.size()));
      judged_again();
      known();
      front_table();
      return;
    }
    const design::Value& f = best_->evaluation.objective;
    const bool compared = start_ != nullptr && std::isfinite(start_->evaluation.objective.value);
    report_.add_verdict(
        Verdict::neutral,
        fmt::format(
            "The best machine that was found is row {}, with an objective of {}{}.", best_->row,
            number(f.value, kDigits),
            compared ? fmt::format(" ({} of the start)", number(start_->evaluation.objective.value, kDigits)) : ""));
    judged_again();
    report_.add_text(
        "A search finds good machines and proves nothing about those it did not try: no claim is made that none is "
        "better. Volumes lie between proven bounds. Means are those over the points of the workspace at the study's "
        "resolution, and what is called seen is the most or the least of the poses that were looked at.");
    std::vector<report::KeyFigure> figures{{number(f.value, kDigits), "", "objective", Verdict::neutral}};
    for (const Goal& g : study_.goals) {
      figures.push_back({number(value_of(study_, *best_, g), 4), "", design::info_of(g.figure).name, Verdict::neutral});
    }
    report_.add_key_figures(figures);
    compare();
    known();
  }

  /// What a finer survey says of the best machine or of the points of the front.
  void judged_again() {
    if (!page_.again) {
      if (!study_.holds.empty() && design::may_flatter(study_)) {
        report_.add_verdict(Verdict::bad,
                            "The holds are kept as the search judged them; its answer was not judged on a finer grid.");
      }
      return;
    }
    const std::vector<Row>& rows = page_.again->rows;
    const auto broken =
        std::count_if(rows.begin(), rows.end(), [](const Row& row) { return row.evaluation.state != State::done; });
    if (broken > 0) {
      const auto first =
          std::find_if(rows.begin(), rows.end(), [](const Row& row) { return row.evaluation.state != State::done; });
      report_.add_verdict(
          Verdict::bad, fmt::format("Judged again with resolution {} instead of {}, {} of {} break a hold; row {}: {}. "
                                    "Search with a higher resolution.",
                                    page_.again->resolution, study_.resolution, broken, rows.size(), first->row,
                                    first->evaluation.reason));
      return;
    }
    std::string values;
    const std::vector<Figure> figures = study_.figures();
    for (std::size_t i = 0; rows.size() == 1 && i < figures.size(); ++i) {
      if (!study_.surveys(figures[i])) continue;
      values += fmt::format("{}{} {}", values.empty() ? ": " : ", ", design::info_of(figures[i]).name,
                            number(rows[0].evaluation.figures[i].value, kDigits));
    }
    report_.add_text(fmt::format("Judged again with resolution {} instead of {}{}.{}", page_.again->resolution,
                                 study_.resolution, values, study_.holds.empty() ? "" : " All holds are kept."));
  }

  void why_none() {
    const bool judged = std::any_of(page_.rows.begin(), page_.rows.end(),
                                    [](const Row& row) { return row.evaluation.state == State::violates; });
    report_.add_verdict(Verdict::bad, judged ? "No candidate that was tried keeps all holds."
                                             : "No candidate that was tried could be judged.");
    std::vector<std::string> list;
    for (const design::HoldSummary& h : design::hold_summaries(study_, page_.rows)) {
      if (h.broken == 0) continue;
      list.push_back(h.in_words());
    }
    for (const auto& [reason, count] : design::refusals(page_.rows))
      list.push_back(fmt::format("{} refused: {}", count, reason));
    report_.add_list(list);
    say_start_is_none();
  }

  void say_start_is_none() {
    if (start_ == nullptr || design::start_is_candidate(study_)) return;
    report_.add_text(fmt::format("Row {} is the start, and no candidate: {}.", start_->row, design::kNoCandidate));
  }

  /// Over the workspace where the study asks it; what a pose of the study needs is always checked.
  [[nodiscard]] std::string legs_against_legs() const {
    if (study_.interference) return "checked";
    const bool poses = !study_.duty.poses.empty() || study_.duty.path || study_.duty.pick;
    return poses ? "checked at the poses and along the motion of the study, not over the workspace" : "not checked";
  }

  /// The best against the start.
  void compare() {
    report::Table t;
    t.caption = "The best machine beside the one that the study began with";
    t.columns = {{"", "", -1}, {"start", "", -1}, {"best", "", -1}, {"proven bounds of the best", "", -1}};
    const auto add = [&](const std::string& name, double before, double now, const design::Value* bounds) {
      const bool bounded = bounds != nullptr && bounds->lower < bounds->upper;
      t.rows.push_back({name, start_ != nullptr && std::isfinite(before) ? number(before, kDigits) : std::string(""),
                        number(now, kDigits),
                        bounded
                            ? fmt::format("{} to {}", number(bounds->lower, kDigits), number(bounds->upper, kDigits))
                            : std::string("")});
    };
    constexpr double kNone = std::numeric_limits<double>::quiet_NaN();
    add("objective", start_ != nullptr ? start_->evaluation.objective.value : kNone, best_->evaluation.objective.value,
        nullptr);
    const auto parameters = study_.parameters(best_->varied);
    for (std::size_t i = 0; i < parameters.size(); ++i) {
      const bool known = start_ != nullptr && i < study_.vary.size();
      add(parameters[i].first, known ? start_->varied[i] : kNone, parameters[i].second, nullptr);
    }
    const std::vector<Figure> order = study_.figures();
    for (std::size_t i = 0; i < order.size(); ++i) {
      add(design::info_of(order[i]).name, start_ != nullptr ? start_->evaluation.figures[i].value : kNone,
          best_->evaluation.figures[i].value, &best_->evaluation.figures[i]);
    }
    report_.add_table(t);
    const std::vector<std::string> limits = design::binding(study_, *best_);
    if (!limits.empty()) {
      report_.add_text("What limits it: a hold whose figure is within 1 % of its bound, or the end of a range.");
      report_.add_list(limits);
    }
    if (start_ != nullptr && start_->evaluation.state != State::done) {
      report_.add_text("The start is no solution itself: " + start_->evaluation.reason + ".");
    } else {
      say_start_is_none();
    }
  }

  void front_table() {
    report::Table t;
    t.caption = "The front of those that are done: none of them is better than another in every goal";
    t.columns.push_back({"row", "", 0});
    for (const Goal& g : study_.goals) t.columns.push_back({design::info_of(g.figure).name, "", -1});
    for (const design::Vary& v : study_.vary) t.columns.push_back({v.key, "", -1});
    for (const std::size_t i : front_) {
      const Row& row = page_.rows[i];
      std::vector<report::Cell> cells{static_cast<double>(row.row)};
      for (const Goal& g : study_.goals) cells.emplace_back(number(value_of(study_, row, g), kDigits));
      for (const double x : row.varied) cells.emplace_back(number(x, kDigits));
      t.rows.push_back(std::move(cells));
    }
    constexpr std::size_t kOpen = 30;
    t.folded = t.rows.size() > kOpen;
    report_.add_table(t);
  }

  void asked() {
    report_.add_section("What was asked");
    report::Table vary;
    vary.caption = "What may change";
    vary.columns = {{"parameter", "", -1}, {"from", "", -1}, {"to", "", -1}, {"how", "", -1}};
    for (const design::Vary& v : study_.vary) {
      std::string how = "any number";
      if (v.step > 0) how = fmt::format("steps of {:g}", v.step);
      if (!v.values.empty()) {
        how = "one of";
        for (const double x : v.values) how += fmt::format(" {:g}", x);
      }
      vary.rows.push_back({v.key, number(v.min, kDigits), number(v.max, kDigits), how});
    }
    for (const design::Tie& t : study_.ties) {
      vary.rows.push_back({t.key, std::string(""), std::string(""),
                           fmt::format("{:g} times {}{}", t.factor, t.equals,
                                       t.offset != 0 ? fmt::format(" plus {:g}", t.offset) : "")});
    }
    report_.add_table(vary);
    std::vector<std::string> goals;
    for (const Goal& g : study_.goals) {
      goals.push_back(fmt::format("{}: {}{}", goal_text(g), design::info_of(g.figure).meaning,
                                  study_.wants_front() || study_.goals.size() == 1
                                      ? ""
                                      : fmt::format("; weight {:g}, {} counts as 1", g.weight, number(g.best, 7))));
    }
    report_.add_heading("Goals");
    report_.add_list(goals);
    if (study_.goals.size() > 1 && !study_.wants_front()) {
      report_.add_text(
          "The objective is the sum of weight times value over best where the figure shall be large, and of weight "
          "times best over value where it shall be small.");
    }
    duty();
    if (!study_.robust.empty()) {
      std::string box;
      for (const auto& [key, size] : study_.robust)
        box += fmt::format("{}{} ± {:g}", box.empty() ? "" : ", ", key, size);
      report_.add_text(
          fmt::format("Parameters have tolerances: {}. Every figure is the worst of {} machines, at the middle and at "
                      "the corners of "
                      "their box. Between the corners it may be worse: that is a sample, and no bound.",
                      box, (1U << study_.robust.size()) + 1));
    }
    if (study_.holds.empty()) return;
    std::vector<std::string> holds;
    for (const design::Hold& h : study_.holds) holds.push_back(h.in_words());
    report_.add_heading("What must hold");
    report_.add_list(holds);
  }

  /// Poses, load and motion.
  void duty() {
    const design::Duty& d = study_.duty;
    std::vector<std::string> list;
    if (!d.poses.empty()) list.push_back(fmt::format("{} poses, all of which must be reached", d.poses.size()));
    if (d.load) {
      const Vec6& w = *d.load;
      list.push_back(fmt::format("a load on the tool tip of {:g}, {:g}, {:g} N and {:g}, {:g}, {:g} Nm", w[0], w[1],
                                 w[2], w[3], w[4], w[5]));
    }
    if (d.direction) {
      list.push_back(
          fmt::format("stiffness along {:g}, {:g}, {:g}", (*d.direction)[0], (*d.direction)[1], (*d.direction)[2]));
    }
    if (d.masses) list.push_back("masses as the study gives them, the same for every candidate");
    if (d.path) list.push_back(fmt::format("a path of {:g} mm in the least time", units::to_mm(d.path->length)));
    if (d.pick) list.push_back("a pick-and-place cycle, one way");
    if (list.empty()) return;
    report_.add_heading("What the machine shall do");
    report_.add_list(list);
  }

  void tried() {
    report_.add_section("What was tried");
    report::Table t;
    t.caption = "Candidates by what became of them";
    t.columns = {{"", "", -1}, {"candidates", "", 0}, {"meaning", "", -1}};
    for (const auto& [state, meaning] :
         {std::pair{State::done, "every figure is as exact as was asked, all holds are kept"},
          std::pair{State::dropped, "its bounds prove that it is worse than one found before; never refined"},
          std::pair{State::violates, "breaks a hold"},
          std::pair{State::refused, "no machine, or no workspace to judge"}}) {
      const auto count = std::count_if(page_.rows.begin(), page_.rows.end(),
                                       [&, s = state](const Row& row) { return row.evaluation.state == s; });
      t.rows.push_back({std::string(design::name_of(state)), static_cast<double>(count), std::string(meaning)});
    }
    report_.add_table(t);
    if (page_.starts.size() > 1) {
      report_.add_text(
          "The search for one machine begins several times, each time with a sample of its own over all ranges: " +
          design::in_words(page_.starts, page_.rows) +
          ". Starts that end at different objectives say that there are several local optima.");
    }
    if (study_.wants_front()) return;
    report::LinePlot plot;
    plot.title = "The objective of each candidate in the order of the search";
    plot.x = {"row", "", {}, {}, false, true};
    plot.y = {"objective", "", {}, {}};
    report::Series each{"done", {}, {}, report::Colour::blue, report::LineStyle::points, 1.6};
    report::Series dropped{"dropped", {}, {}, report::Colour::muted, report::LineStyle::points, 1.6};
    report::Series best{"best so far", {}, {}, report::Colour::vermillion, report::LineStyle::solid, 1.5};
    double so_far = -std::numeric_limits<double>::infinity();
    for (const Row& row : page_.rows) {
      const double f = row.evaluation.objective.value;
      if (!std::isfinite(f) || row.phase == design::Phase::start) continue;
      const bool done = row.evaluation.state == State::done;
      if (!done && row.evaluation.state != State::dropped) continue;
      (done ? each : dropped).x.push_back(static_cast<double>(row.row));
      (done ? each : dropped).y.push_back(f);
      if (done) so_far = std::max(so_far, f);
      if (!std::isfinite(so_far)) continue;
      best.x.push_back(static_cast<double>(row.row));
      best.y.push_back(so_far);
    }
    if (best.x.empty()) return;
    plot.series = {dropped, each, best};
    report_.add_figure(plot,
                       "The objective of each candidate, and the best so far. Dropped ones stand at the middle of "
                       "their coarse bounds.");
  }

  void tradeoffs() {
    if (front_.empty()) return;
    report_.add_section("How the goals compete");
    for (std::size_t y = 1; y < study_.goals.size(); ++y)
      for (std::size_t x = 0; x < y; ++x) pair_of_goals(x, y);
    if (best_ != nullptr) front_table();
    if (const auto volume = design::front_volume(study_, page_.rows, front_, page_.reference);
        volume && study_.wants_front()) {
      report_.add_text("How much the front dominates: " + design::in_words(study_, *volume) +
                       ". Fronts compare by their hypervolume where the reference point is the same.");
    }
    if (const auto figure = parallel_figure(page_)) {
      report_.add_figure(*figure,
                         "Each line is a candidate across its parameters and goals. Axes of goals point upwards "
                         "to what is better, and are logarithmic where the values differ by more than 30 times.");
    }
  }

  void pair_of_goals(std::size_t x, std::size_t y) {
    const auto figure = front_figure(page_, x, y);
    if (!figure) return;
    const bool first = x == 0 && y == 1, more = study_.goals.size() > 2;
    report_.add_figure(
        *figure,
        fmt::format(
            "{} against {}.{}", design::info_of(study_.goals[y].figure).name,
            design::info_of(study_.goals[x].figure).name,
            !first ? ""
                   : fmt::format(
                         " On the front no other machine that is done is better in every goal of the "
                         "study{}.{}",
                         more ? "; with more than two goals it is a surface, of which each picture is a side" : "",
                         best_ == nullptr ? ""
                                          : " Machines that were dropped for their objective are not among them, so "
                                            "the front of all may hold more.")));
  }

  /// The machines that the study compares with.
  void known() {
    if (page_.known.rows.empty()) return;
    const design::Answer answer{study_, page_.rows, page_.again};
    report_.add_heading("Beside machines that are known");
    if (const std::string advice = design::advice(answer, page_.known.rows); !advice.empty()) {
      std::string text = advice;
      text.front() = 'A';
      report_.add_verdict(Verdict::bad, text + ".");
    }
    report::Table t;
    t.caption = fmt::format("Machines that the study compares with, judged as candidates are{}",
                            page_.known.resolution == study_.resolution
                                ? std::string()
                                : fmt::format(", with resolution {}", page_.known.resolution));
    t.columns.push_back({"machine", "", -1});
    t.columns.push_back({"where it stands", "", -1});
    const std::vector<Figure> order = study_.figures();
    if (!study_.wants_front()) t.columns.push_back({"objective", "", -1});
    for (const Figure f : order) t.columns.push_back({design::info_of(f).name, "", -1});
    for (const auto& [key, value] : study_.parameters(page_.known.rows.front().varied))
      t.columns.push_back({key, "", -1});
    for (std::size_t k = 0; k < page_.known.rows.size(); ++k) {
      const Row& row = page_.known.rows[k];
      std::vector<report::Cell> cells{study_.compared[k].name, design::in_words(design::standing_of(answer, row))};
      if (!study_.wants_front()) cells.emplace_back(number(row.evaluation.objective.value, kDigits));
      for (const design::Value& v : row.evaluation.figures) cells.emplace_back(number(v.value, kDigits));
      for (const auto& [key, value] : study_.parameters(row.varied)) cells.emplace_back(number(value, kDigits));
      t.rows.push_back(std::move(cells));
    }
    report_.add_table(t);
  }

  void sensitivities() {
    report_.add_section("Which parameters matter");
    global();
    if (page_.sensitivities.empty()) {
      report_.add_text("Too few candidates of the search have figures to say it of them.");
      return;
    }
    if (page_.global.design.groups > 0) report_.add_heading("Among the candidates of the search");
    report::Table t;
    t.caption = "Standardised rank regression coefficients";
    t.columns.push_back({"parameter", "", -1});
    for (const auto& s : page_.sensitivities) t.columns.push_back({s.of, "", 2});
    for (std::size_t i = 0; i < study_.vary.size(); ++i) {
      std::vector<report::Cell> cells{study_.vary[i].key};
      for (const auto& s : page_.sensitivities) cells.emplace_back(s.coefficients[i]);
      t.rows.push_back(std::move(cells));
    }
    std::vector<report::Cell> explained{std::string("R² of the ranks")};
    for (const auto& s : page_.sensitivities) explained.emplace_back(s.share_explained);
    t.rows.push_back(std::move(explained));
    report_.add_table(t);
    report_.add_text(
        "A coefficient near 1 or -1 means that the figure rises or falls with the parameter, near 0 that it hardly "
        "depends on it or that it has its best inside the range. They are taken over the candidates that were tried, "
        "most of which lie near the best, and not evenly over the ranges. Where R² is below about 0.7 the dependence "
        "is not monotonic, and the coefficients say little.");
    if (page_.global.design.groups == 0) {
      report_.add_text(
          "How much each parameter matters over its whole range, `polypod study FOLDER --sensitivity morris` says by "
          "new evaluations; this page then shows it.");
    }
  }

  /// The analysis over the whole ranges, where there was one.
  void global() {
    const design::StudySensitivity& s = page_.global;
    if (s.design.groups == 0) return;
    const bool morris = s.design.method == design::SensitivityMethod::morris;
    report_.add_heading("Over the whole ranges");
    report_.add_text(
        fmt::format("{} from {} new evaluations in {} {} (seed {}), evenly over the ranges and without the holds. "
                    "Intervals are those "
                    "of 95 % by bootstrap.",
                    morris ? "Elementary effects (Morris)" : "Shares of the variance (Sobol)", s.design.points.size(),
                    s.design.groups, morris ? "trajectories" : "samples", s.design.seed));
    for (const design::GlobalSensitivity& of : s.of) {
      report::BarChart bars;
      bars.title = of.of;
      bars.unit = morris ? "" : "of the variance";
      bars.parts = morris ? std::vector<std::string>{"mean size of the effect"}
                          : std::vector<std::string>{"by itself", "together with others"};
      report::Table t;
      t.caption = morris ? fmt::format("Effects on {}: what it changes by over the range of the parameter", of.of)
                         : fmt::format("Shares of the variance of {}", of.of);
      t.columns = {{"parameter", "", -1},
                   {morris ? "mean size (mu*)" : "total share", "", -1},
                   {"95 % interval", "", -1},
                   {morris ? "mean (mu)" : "share by itself", "", -1},
                   {"95 % interval", "", -1}};
      if (morris) t.columns.push_back({"sigma", "", -1});
      bool any = false;
      for (std::size_t i = 0; i < study_.vary.size(); ++i) {
        const design::Estimate &total = of.total[i], &first = of.first[i];
        if (std::isnan(total.value)) continue;
        any = true;
        const double own = std::clamp(first.value, 0.0, std::max(0.0, total.value));
        bars.rows.push_back({study_.vary[i].key, morris ? std::vector<double>{total.value}
                                                        : std::vector<double>{own, std::max(0.0, total.value) - own}});
        const auto interval = [](const design::Estimate& e) {
          return fmt::format("{} to {}", number(e.lower, 3), number(e.upper, 3));
        };
        std::vector<report::Cell> cells{study_.vary[i].key, number(total.value, 3), interval(total),
                                        number(first.value, 3), interval(first)};
        if (morris) cells.emplace_back(number(of.spread[i], 3));
        t.rows.push_back(std::move(cells));
      }
      if (!any) {
        report_.add_text(
            fmt::format("Of {} nothing can be said: too few groups have it, or it does not change.", of.of));
        continue;
      }
      report_.add_figure(bars, fmt::format("How much {} depends on each parameter{}.", of.of,
                                           of.used < s.design.groups
                                               ? fmt::format(", from {} of the {} groups: the others hold a candidate "
                                                             "without this figure",
                                                             of.used, s.design.groups)
                                               : ""));
      report_.add_table(t);
    }
    report_.add_text(
        morris
            ? "A sigma that is large beside mu* says that the effect is not linear, or that it depends on the other "
              "parameters. An interval that holds 0, or intervals that overlap, leave open which parameter matters "
              "more."
            : "The share by itself is what the parameter makes of the variance alone, the total share what it makes "
              "together with the others. Intervals that overlap leave open which parameter matters more; estimates may "
              "lie a little outside of 0 to 1.");
    if (s.without > 0) {
      report_.add_text(
          fmt::format("{} candidates have no figures, and what is said holds for the rest. The first of "
                      "them: {}.",
                      s.without, s.reason));
    }
  }

  /// The machine and its workspace in space, with sliders for its pose and joints.
  Status picture(const machine::AnyMachine& m, const std::string& title, const std::string& caption) {
    report::Scene scene;
    scene.title = title;
    const workspace::Options options = design::workspace_options(study_);
    workspace::SurfaceOptions surface_options;
    constexpr int kInSpace = 30;
    surface_options.resolution = kInSpace;
    if (const auto surface = workspace::surface(m, options, surface_options)) {
      report::Mesh mesh;
      for (const Vec3& p : surface->points)
        mesh.points.push_back({units::to_mm(p.x()), units::to_mm(p.y()), units::to_mm(p.z())});
      mesh.triangles = surface->triangles;
      scene.meshes.push_back(std::move(mesh));
    } else if (surface.error().id == "WS110") {
      return tl::unexpected(surface.error());
    }
    const MachineAt start = machine_at(m, start_pose(m));
    scene.lines = start.lines;
    report::Scene turns = scene;
    add_poses(turns, turns.lines.size(), m, start,
              std::clamp(1.2 * options.directions.tilt, units::from_deg(10), units::from_deg(60)));
    const bool hangs = kinematics::hangs_down(m);
    if (hangs) {
      hang(scene);
      hang(turns);
    }
    report_.add_heading(title);
    report_.add_scene(scene, caption + (hangs ? " The base is above: z of the machine points down." : ""), &turns);
    return {};
  }

  Status machines() {
    if (best_ == nullptr) return {};
    if (study_.of_cell) {
      POLYPOD_ASSIGN(text, design::file_of_row(study_, *best_));
      report_.add_section("The cell");
      report_.add_text("`polypod cell` judges the file below and writes its page.");
      report_.add_code("The best cell as a file", text);
      return {};
    }
    if (!kinematics::task(study_.start).places()) return {};
    report_.add_section("The machine and its workspace");
    const auto machine = design::machine_of_row(study_, *best_);
    if (!machine) return {};
    const std::string caption =
        "The machine and the boundary of its workspace. A workspace that the grid of the picture does not meet is not "
        "drawn.";
    POLYPOD_TRY(picture(study_.start, "The start", caption));
    POLYPOD_TRY(picture(*machine, "The best machine", caption));
    report_.add_code("The best machine as a file", machine::to_toml(*machine));
    return {};
  }

  void inputs() {
    report_.add_section("Inputs");
    if (study_.of_cell) {
      report_.add_definitions({{"evaluations", fmt::format("{} in the database", page_.rows.size())},
                               {"runs of the cycle", std::to_string(study_.runs)}});
      report_.add_code("The cell that the study began with", study_.machine_toml);
      if (!page_.command.empty()) report_.add_code("This page again", page_.command, false);
      return;
    }
    Entries entries{{"evaluations", fmt::format("{} in the database", page_.rows.size())},
                    {"resolution", fmt::format("{} points along the longest side", study_.resolution)},
                    {"gap of a volume's bounds", fmt::format("{:g} of it at most", study_.relative_tolerance)},
                    {"legs against legs", legs_against_legs()}};
    std::string tolerances;
    for (const auto& [key, size] : study_.tolerances)
      tolerances += fmt::format("{}{}={:g}", tolerances.empty() ? "" : ", ", key, size);
    entries.emplace_back("tolerances, mm or deg", tolerances);
    std::string errors;
    for (const auto& [key, size] : study_.errors)
      errors += fmt::format("{}{}={:g}", errors.empty() ? "" : ", ", key, size);
    if (!errors.empty()) entries.emplace_back("known errors, mm or deg", errors);
    report_.add_definitions(entries);
    report_.add_code("The machine that the study began with", study_.machine_toml);
    if (!page_.command.empty()) report_.add_code("This page again", page_.command, false);
  }

  const StudyPage& page_;
  const Study& study_;
  Report report_;
  const Row* start_;
  const Row* best_ = nullptr;
  std::vector<std::size_t> front_;
};

}  // namespace

namespace {
/// Of a goal over more than a decade and a half a linear axis shows the largest values alone.
bool counts_by_ratio(double least, double most) {
  constexpr double kRatio = 30;
  return least > 0 && most > kRatio * least;
}
}  // namespace

Result<report::Figure> front_figure(const StudyPage& page, std::size_t across, std::size_t up) {
  const Study& study = page.study;
  if (study.goals.size() < 2) {
    return fail("QP110", "a front needs two goals", {}, "this study has one: its rows are in the table");
  }
  const Goal &x = study.goals[across], &y = study.goals[up];
  report::LinePlot plot;
  plot.title = fmt::format("{} against {}", design::info_of(y.figure).name, design::info_of(x.figure).name);
  plot.x = {fmt::format("{} ({} is better)", design::info_of(x.figure).name, x.maximise ? "more" : "less"), "", {}, {}};
  plot.y = {fmt::format("{} ({} is better)", design::info_of(y.figure).name, y.maximise ? "more" : "less"), "", {}, {}};
  report::Series tried{"tried", {}, {}, report::Colour::muted, report::LineStyle::points, 1.4};
  report::Series front{"front", {}, {}, report::Colour::blue, report::LineStyle::points, 2.4};
  report::Series start{"start", {}, {}, report::Colour::vermillion, report::LineStyle::points, 4};
  report::Series best{"best", {}, {}, report::Colour::green, report::LineStyle::points, 4};
  const auto add = [&](report::Series& to, const Row& row) {
    const double a = value_of(study, row, x), b = value_of(study, row, y);
    if (!std::isfinite(a) || !std::isfinite(b)) return;
    to.x.push_back(a);
    to.y.push_back(b);
  };
  for (const Row& row : page.rows) {
    if (row.phase == design::Phase::start) add(start, row);
    if (row.evaluation.state == State::done) add(tried, row);
  }
  for (const std::size_t i : design::front_of(study, page.rows)) add(front, page.rows[i]);
  if (const auto at = design::best_of(study, page.rows)) add(best, page.rows[*at]);
  if (front.x.empty()) return fail("QP110", "no row of this study has both goals", {}, "let the search go on");
  // An outlier of what was tried must not press the front into a corner.
  const auto ends = [](const std::vector<double>& values, report::Axis& axis) {
    const auto [least, most] = std::minmax_element(values.begin(), values.end());
    const double air = 0.25 * (*most - *least);
    if (!(air > 0)) return;
    axis.log = counts_by_ratio(*least, *most);
    axis.min = axis.log     ? *least / std::pow(*most / *least, 0.06)
               : *least < 0 ? *least - air
                            : std::max(0.0, *least - air);
    axis.max = axis.log ? *most * std::pow(*most / *least, 0.06) : *most + air;
  };
  ends(front.x, plot.x);
  ends(front.y, plot.y);
  plot.series = {tried, front};
  if (!start.x.empty()) plot.series.push_back(start);
  if (!best.x.empty()) plot.series.push_back(best);
  constexpr std::array kColours{report::Colour::purple, report::Colour::orange, report::Colour::sky,
                                report::Colour::ink};
  for (std::size_t k = 0; k < page.known.rows.size(); ++k) {
    report::Series one{study.compared[k].name, {}, {}, kColours[k % kColours.size()], report::LineStyle::points, 4.5};
    add(one, page.known.rows[k]);
    if (!one.x.empty()) plot.series.push_back(one);
  }
  plot.aspect = 0.5;
  return report::Figure(plot);
}

Result<report::Figure> parallel_figure(const StudyPage& page) {
  const Study& study = page.study;
  constexpr std::size_t kMost = 200, kBest = 10;
  std::vector<std::size_t> done;
  for (std::size_t i = 0; i < page.rows.size(); ++i) {
    const Row& row = page.rows[i];
    if (row.evaluation.state == State::done && row.phase != design::Phase::start) done.push_back(i);
  }
  if (done.empty()) return fail("QP110", "no row of this study is done", {}, "let the search go on");
  std::vector<std::size_t> best = design::front_of(study, page.rows);
  if (!study.wants_front()) {
    std::stable_sort(done.begin(), done.end(), [&](std::size_t a, std::size_t b) {
      return page.rows[a].evaluation.objective.value > page.rows[b].evaluation.objective.value;
    });
    best.assign(done.begin(), done.begin() + static_cast<std::ptrdiff_t>(std::min(kBest, done.size())));
  }
  std::erase_if(best, [&](std::size_t i) { return page.rows[i].phase == design::Phase::start; });
  report::ParallelPlot plot;
  plot.title = "Parallel coordinates of the candidates";
  for (const design::Vary& v : study.vary) plot.axes.push_back({v.key, v.min, v.max, false});
  const bool objective = !study.wants_front() && study.goals.size() > 1;
  const auto line = [&](const Row& row) {
    std::vector<double> out = row.varied;
    for (const Goal& g : study.goals) out.push_back(value_of(study, row, g));
    if (objective) out.push_back(row.evaluation.objective.value);
    return out;
  };
  const std::size_t each = std::max<std::size_t>(1, done.size() / kMost);
  report::ParallelPlot::Group others{"done", report::Colour::muted, 0.7, {}};
  for (std::size_t k = 0; k < done.size(); k += each) others.lines.push_back(line(page.rows[done[k]]));
  report::ParallelPlot::Group chosen{
      study.wants_front() ? "front" : fmt::format("best {}", best.size()), report::Colour::blue, 1.4, {}};
  for (const std::size_t i : best) chosen.lines.push_back(line(page.rows[i]));
  report::ParallelPlot::Group winner{"best", report::Colour::vermillion, 2.4, {}};
  if (const auto at = design::best_of(study, page.rows)) winner.lines.push_back(line(page.rows[*at]));
  const std::size_t n = study.vary.size();
  for (std::size_t k = 0; k < study.goals.size() + (objective ? 1 : 0); ++k) {
    double lo = std::numeric_limits<double>::infinity(), hi = -lo;
    for (const auto* group : {&others, &chosen}) {
      for (const auto& values : group->lines) {
        if (!std::isfinite(values[n + k])) continue;
        lo = std::min(lo, values[n + k]);
        hi = std::max(hi, values[n + k]);
      }
    }
    const bool of_goal = k < study.goals.size();
    plot.axes.push_back({of_goal ? design::info_of(study.goals[k].figure).name : "objective", lo, hi,
                         of_goal && !study.goals[k].maximise, counts_by_ratio(lo, hi)});
  }
  plot.groups = {std::move(others), std::move(chosen)};
  if (!winner.lines.empty()) plot.groups.push_back(std::move(winner));
  return report::Figure(plot);
}

Result<std::string> study_page(const StudyPage& page) {
  return Page(page).html();
}

}  // namespace polypod::pages
