// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>

#include "ellipsoid_lines.hpp"
#include "machine_inputs.hpp"
#include "machine_lines.hpp"
#include "parts.hpp"
#include "polypod/core/figures.hpp"
#include "polypod/core/units.hpp"
#include "polypod/kinematics/any_machine.hpp"
#include "polypod/kinematics/parts.hpp"
#include "polypod/pages/machine.hpp"
#include "polypod/pages/quality.hpp"
#include "polypod/quality/singularity.hpp"
#include "polypod/quality/survey_surface.hpp"
#include "polypod/report/html.hpp"
#include "polypod/report/scene.hpp"
#include "polypod/workspace/task_directions.hpp"
#include "quality_section.hpp"
#include "workspace_section.hpp"

namespace polypod::pages {
namespace {

using machine::AnyMachine;
using quality::Extreme;
using quality::Statistics;
using quality::SurveyOptions;
using report::fixed;
using report::number;
using report::Report;
using report::Verdict;
using units::to_deg;
using units::to_mm;

constexpr double kSingularCondition = 1000;  // a direction above counts as near singular
constexpr std::size_t kShown = 14;           // bars in a chart
constexpr std::array kConditioning{QualityValue::condition, QualityValue::sigma_min, QualityValue::determinant};
constexpr std::array kErrors{QualityValue::position, QualityValue::orientation};

std::string shown(double value, int digits = 3) {
  return std::isinf(value) ? "∞" : number(value, digits);
}

/// A point of a survey: x, y, z in mm, or the coordinates of a task without them, in mm and deg.
std::string place(const machine::Task& task, const Vec3& p) {
  if (!task.places()) {
    std::string out;
    for (int k = 0; k < workspace::coordinates_of_points(task); ++k)
      out += (k > 0 ? ", " : "") + fixed(workspace::for_user(task, p)[k], 1);
    return out;
  }
  const int decimals = Figures(to_mm(p.norm()), 1).decimals();
  return fmt::format("{}, {}, {}", fixed(to_mm(p.x()), decimals), fixed(to_mm(p.y()), decimals),
                     fixed(to_mm(p.z()), decimals));
}

/// "x, y, z mm; A, B, C deg", or "z 3.0 mm, A 5.0 deg".
std::string pose_in_words(const AnyMachine& machine, const Pose& X) {
  const machine::Task task = kinematics::task(machine);
  const std::vector<double> c = kinematics::coordinates_of(task, X);
  if (!task.places()) {
    std::string out;
    for (int k = 0; k < task.size(); ++k) {
      const char* unit = workspace::unit_of(task, k);
      out += fmt::format("{}{}\u00a0{}\u00a0{}", k > 0 ? ", " : "", machine::name_of(task[k]),
                         fixed(units::to_user(c[static_cast<std::size_t>(k)], unit), 1), unit);
    }
    return out;
  }
  std::string out = place(task, X.p) + " mm";
  for (std::size_t k = 3; k < c.size(); ++k)
    out += fmt::format("{} {}\u00a0{}", k == 3 ? ";" : ",", "ABC"[k - 3], fixed(to_deg(c[k]), 1));
  return c.size() > 3 ? out + "\u00a0deg" : out;
}

/// A number as it was given.
std::string plain(double value) {
  return fmt::format("{:.6g}", value);
}

/// The middle of the points inside; of a hollow or split workspace the point nearest to it.
Vec3 middle_of(const quality::Survey& survey) {
  Vec3 middle = Vec3::Zero();
  for (const std::size_t i : survey.inside) middle += survey.grid.at(i) / static_cast<double>(survey.inside.size());
  // Of coordinates of different units in spacings.
  const auto away = [&](std::size_t i) {
    const Vec3 off = survey.grid.at(i) - middle;
    if (survey.task.places()) return off.norm() / survey.grid.step[0].norm();
    double out = 0;
    for (int k = 0; k < 3; ++k) {
      const double step = survey.grid.step[static_cast<std::size_t>(k)].norm();
      out = std::hypot(out, step > 0 ? off[k] / step : 0);
    }
    return out;
  };
  const std::size_t nearest = *std::min_element(survey.inside.begin(), survey.inside.end(),
                                                [&](std::size_t a, std::size_t b) { return away(a) < away(b); });
  constexpr double kCell = 1.8;  // spacings: more than half the diagonal of a cell
  return away(nearest) < kCell ? middle : survey.grid.at(nearest);
}

/// Each element and its part of an error.
struct Part {
  int element = 0;
  double position = 0, orientation = 0;  ///< m, rad
};

/// Poses that are worst, the worst first, no two within a fifth of the survey of each other.
std::vector<Extreme> apart(const quality::Survey& survey, const quality::Quantity& q, std::size_t most) {
  std::vector<std::size_t> order(q.worst.size());
  std::iota(order.begin(), order.end(), 0U);
  std::stable_sort(order.begin(), order.end(), [&](std::size_t a, std::size_t b) { return q.worst[a] > q.worst[b]; });
  Vec3 low = survey.grid.at(survey.inside.front()), high = low;
  for (const std::size_t i : survey.inside) {
    low = low.cwiseMin(survey.grid.at(i));
    high = high.cwiseMax(survey.grid.at(i));
  }
  constexpr double kApart = 0.2;
  const Vec3 size = (high - low).cwiseMax(1e-12);
  const auto between = [&](const Pose& a, const Pose& b) {
    if (survey.task.places()) return (a.p - b.p).norm() / size.norm();
    return (workspace::point_of(survey.task, a) - workspace::point_of(survey.task, b)).cwiseQuotient(size).norm();
  };
  std::vector<Extreme> out;
  for (const std::size_t i : order) {
    if (out.size() == most || !(q.worst[i] > kSingularCondition)) break;
    const Pose X = quality::pose_at(survey, i, q.worst_direction[i]);
    const bool near =
        std::any_of(out.begin(), out.end(), [&](const Extreme& e) { return between(e.X_MT, X) < kApart; });
    if (!near) out.push_back({X, q.worst[i]});
  }
  return out;
}

/// A value of two digits.
double rounded(double value) {
  if (!(value > 0) || !std::isfinite(value)) return value;
  const double step = std::pow(10.0, std::floor(std::log10(value)) - 1);
  return std::round(value / step) * step;
}

report::Mesh mesh_of(const workspace::Surface& surface) {
  report::Mesh mesh;
  for (const Vec3& p : surface.points) mesh.points.push_back({to_mm(p.x()), to_mm(p.y()), to_mm(p.z())});
  mesh.triangles = surface.triangles;
  return mesh;
}

/// Colours a surface by bands of a value.
void colour_by(report::Scene& scene, report::Mesh& mesh, const std::vector<double>& values, const Range& range,
               const std::string& unit) {
  constexpr int kBands = 7;
  scene.levels = report::nice_ticks(range.low, range.high, kBands);
  if (scene.levels.empty()) scene.levels = {range.low};
  const std::vector<double>& levels = scene.levels;
  const int decimals =
      levels.size() > 1 ? std::max(0, static_cast<int>(-std::floor(std::log10(levels[1] - levels[0]) + 1e-9))) : 3;
  for (std::size_t k = 0; k <= levels.size(); ++k) {
    const std::string from = k > 0 ? fixed(levels[k - 1], decimals) : "",
                      to = k < levels.size() ? fixed(levels[k], decimals) : "";
    scene.kinds.push_back((k == 0               ? "below " + to
                           : k == levels.size() ? "above " + from
                                                : from + " to " + to) +
                          (unit.empty() ? "" : " " + unit));
  }
  mesh.value = values;
}

/// The errors or tolerances as the user wrote them.
std::string given_of(const QualityPageOptions& page) {
  return fmt::format("{}", fmt::join(page.given, ", "));
}
std::string directions_of(const AnyMachine& machine, const SurveyOptions& options, const quality::Survey& survey) {
  const auto& d = options.workspace.directions;
  if (!survey.task.places()) return "those of the task's coordinates";
  if (kinematics::orientation_follows(machine)) return "the tilt of the tool that follows from its position";
  if (!kinematics::task(machine).turns()) return "the one orientation that the tool has";
  if (survey.orientations.size() == 1) return "tool at zero tilt (R = 1)";
  if (d.is_ranges()) return fmt::format("{} over the ranges of A and B", survey.orientations.size());
  return fmt::format("{}, tilts up to {} deg", survey.orientations.size(), plain(to_deg(d.tilt)));
}
const char* kind_of(const QualityQuestion& question) {
  return question.tolerances ? "tolerances, mm or deg" : "errors, mm or deg";
}

class QualityPart {
 public:
  QualityPart(Report& report, const AnyMachine& machine, const SurveyOptions& options, const QualityQuestion& question,
              const QualityFields& fields, const QualityPageOptions& page)
      : machine_(machine), options_(options), question_(question), fields_(fields), page_(page), report_(report) {
    options_.progress = nullptr;
  }

  Result<Entries> add() {
    POLYPOD_TRY(measure());
    answer();
    error_maps();
    error_histograms();
    parts();
    conditioning();
    near_singular();
    POLYPOD_TRY(in_space());
    return inputs();
  }

 private:
  /// Whether errors turn the tool at all: those of a delta do not.
  [[nodiscard]] bool turns() const {
    constexpr double kRounding = 1e-12;  // rad
    return kinematics::task(machine_) != machine::Task::point || kinematics::orientation_follows(machine_) ||
           worst_turned_.value > kRounding;
  }
  /// What was looked at, in words.
  [[nodiscard]] const char* region() const { return options_.box ? "box" : "workspace"; }
  /// Of places in tables: "mm", or the coordinates' names with their units.
  [[nodiscard]] std::string place_unit() const {
    const machine::Task& task = fields_.survey.task;
    if (task.places()) return "mm";
    std::string out;
    for (int k = 0; k < workspace::coordinates_of_points(task); ++k)
      out += fmt::format("{}{} {}", k > 0 ? ", " : "", machine::name_of(task[k]), workspace::unit_of(task, k));
    return out;
  }
  [[nodiscard]] bool one_direction() const { return fields_.survey.orientations.size() == 1; }
  Status measure() {
    middle_ = middle_of(fields_.survey);
    const quality::ErrorField& errors = fields_.errors;
    worst_ = quality::worst_seen(machine_, fields_.survey, options_, errors.position, errors.anywhere, 0);
    worst_turned_ = quality::worst_seen(machine_, fields_.survey, options_, errors.orientation, errors.anywhere, 1);
    if (!question_.tolerances) return sections();
    if (const auto fewer = quality::one_element_a_joint(machine_, question_.sizes)) {
      POLYPOD_ASSIGN(once, quality::tolerance_field(machine_, fields_.survey, options_, *fewer, question_.tolerance));
      once_ = quality::worst_seen(machine_, fields_.survey, options_, once.position, once.anywhere, 0);
    }
    return sections();
  }

  Status sections() {
    const int coordinates = workspace::coordinates_of_points(fields_.survey.task);
    if (coordinates < 2) return {};
    const bool plane = coordinates < 3;
    for (const int axis : plane ? std::vector{2} : std::vector{1, 0, 2}) {
      auto section = survey_section(machine_, options_, question_, axis, middle_[axis], page_.resolution);
      if (!section && section.error().id == "QP100") continue;  // thinner than the spacing there
      if (!section) return tl::unexpected(section.error());
      sections_.push_back(std::move(*section));
    }
    return {};
  }

  /// The statistics of a value's means as a person reads them.
  [[nodiscard]] Statistics seen(QualityValue value) const {
    const quality::ErrorField& e = fields_.errors;
    const quality::DexterityField& d = fields_.dexterity;
    const std::array<const quality::Quantity*, 5> all{&e.position, &e.orientation, &d.condition, &d.sigma_min,
                                                      &d.determinant};
    const auto k = static_cast<std::size_t>(value);
    const bool error = k < 2;
    Statistics s = quality::statistics_seen(machine_, fields_.survey, options_, *all[k],
                                            error ? e.anywhere : d.anywhere, error ? k : k - 2);
    const double scale = value == QualityValue::position      ? units::kMmPerMetre
                         : value == QualityValue::orientation ? units::kMradPerRad
                                                              : 1;
    for (double* x : {&s.min, &s.mean, &s.max, &s.stddev}) *x *= scale;
    return s;
  }

  /// What the errors come to. `p` and `o`: over the points; `most`, `most_turned`: mm and mrad.
  [[nodiscard]] std::string largest_in_words(const Statistics& p, const Statistics& o, double most,
                                             double most_turned) const {
    if (!std::isfinite(most) || !std::isfinite(most_turned)) {
      return fmt::format(
          "Errors have no bound here: the {0} holds a singular pose, at which the drives do not constrain the "
          "platform (type 2), and they grow towards it. At a point of the {0} the {1} is {2} mm and {3} mrad on "
          "average. Set limits that leave such poses out.",
          region(), question_.tolerances ? "worst case" : "error", shown(p.mean), shown(o.mean));
    }
    if (!question_.tolerances) {
      return fmt::format(
          "With the errors {} the largest error of the tip that was seen is {} mm and that of the orientation {} mrad; "
          "on average over the {} {} mm and {} mrad.",
          given_of(page_), shown(most), shown(most_turned), region(), shown(p.mean), shown(o.mean));
    }
    return fmt::format(
        "The largest error of the tip that was seen, whatever the parts do within {}, is {} mm, and the largest of the "
        "orientation {} mrad: at {} points of the {} and between the worst of them. Each is exact at its pose; poses "
        "that "
        "were not looked at may have more. At a point of the {} the worst case is {} mm and {} mrad on average.",
        given_of(page_), shown(most), shown(most_turned), fields_.survey.inside.size(), region(), region(),
        shown(p.mean), shown(o.mean));
  }

  void answer() {
    const Statistics p = seen(QualityValue::position), o = seen(QualityValue::orientation);
    const double most = to_mm(worst_.value), most_turned = units::kMradPerRad * worst_turned_.value;
    report_.add_section("How far the tool is off");
    if (page_.assumed) {
      report_.add_text(
          "No tolerances were given, so this page shows what 0.01 mm (angles: 0.01 deg) on every element would do. "
          "Errors grow in proportion: with 0.02 they are twice as large.");
    }
    report_.add_verdict(std::isfinite(most) && std::isfinite(most_turned) ? Verdict::neutral : Verdict::bad,
                        largest_in_words(p, o, most, most_turned));
    report_.add_text(
        "This answers for small errors of the geometry, to first order, with the drives at their commanded positions: "
        "not for deflection under forces, backlash, temperature and errors of the controller (polypod budget adds "
        "them), and not for collisions.");
    if (once_) {
      report_.add_text(fmt::format(
          "A joint and its attachment count as two elements here, and their tolerances add up. With one element a "
          "joint the largest error of the tip that was seen is {} mm.",
          shown(to_mm(once_->value))));
    }
    const std::string beyond = beyond_in_words(fields_.survey.beyond, "poses that were looked at");
    if (!beyond.empty()) report_.add_text(beyond);
    if (const auto count = near_singular_count(); count > 0) {
      report_.add_text(fmt::format(
          "{} of {} points have a direction near a singular pose. Errors are of first order and grow without bound "
          "there, so the largest values and the means say more about those points than about the rest: see the maps, "
          "and the poses named below.",
          count, fields_.survey.inside.size()));
    }
    std::vector<report::KeyFigure> figures{{shown(p.mean), "mm", "error of the tip, mean", Verdict::neutral},
                                           {shown(most), "mm", "the largest seen", Verdict::neutral}};
    std::vector<std::string> places{fmt::format("The tip is off most at {}.", pose_in_words(machine_, worst_.X_MT))};
    if (turns()) {
      figures.push_back({shown(o.mean), "mrad", "error of the orientation, mean", Verdict::neutral});
      figures.push_back({shown(most_turned), "mrad", "the largest seen", Verdict::neutral});
      places.push_back(fmt::format("The tool is turned most at {}.", pose_in_words(machine_, worst_turned_.X_MT)));
    } else {
      places.emplace_back(
          "Parallel rods keep the tool from turning in this model: errors of its orientation are none.");
    }
    report_.add_key_figures(figures);
    report_.add_list(places);
    if (turns()) {
      statistics_table(kErrors);
    } else {
      statistics_table(std::array{QualityValue::position});
    }
  }

  template <std::size_t N>
  void statistics_table(const std::array<QualityValue, N>& values) {
    report::Table table;
    table.caption = fmt::format("Over the points of the {}{}", region(),
                                one_direction() ? "" : "; each point counts with the mean over its tool directions");
    table.columns = {{"", ""},
                     {"least seen", ""},
                     {"mean", ""},
                     {"largest seen", ""},
                     {"std. dev.", ""},
                     {"least at", place_unit()},
                     {"largest at", place_unit()}};
    for (const QualityValue value : values) {
      const ValueName name = name_of(value);
      const Statistics s = seen(value);
      table.rows.push_back({std::string(name.words) + (name.unit[0] != 0 ? std::string(", ") + name.unit : ""),
                            shown(s.min), shown(s.mean), shown(s.max), shown(s.stddev),
                            place(fields_.survey.task, s.min_at), place(fields_.survey.task, s.max_at)});
    }
    report_.add_table(table);
  }

  /// One map a section, all with one scale.
  void maps(QualityValue value, const std::string& caption) {
    if (sections_.empty()) return;
    std::vector<double> all;
    for (const QualitySection& s : sections_) {
      const std::vector<double> values = means_within(s, value);
      all.insert(all.end(), values.begin(), values.end());
    }
    const Range range = range_of(std::move(all));
    std::vector<std::pair<std::string, report::Figure>> panels;
    for (const QualitySection& s : sections_) panels.emplace_back(plane_name(s), map_of(s, value, range));
    report_.add_figure_grid(
        3, panels,
        caption +
            (range.cut ? fmt::format(" The colours end at {}; a few per cent lie above.", number(range.high)) : ""));
  }

  void error_maps() {
    if (sections_.empty()) return;
    report_.add_section("Where the errors are");
    report_.add_text(fmt::format(
        "{} through the middle of the workspace, whose boundary is the black line. Dark is small, yellow is "
        "large.",
        sections_.size() == 1 ? "A plane" : "Three planes"));
    const std::string of = question_.tolerances ? "Largest error that the tolerances allow" : "Error";
    maps(QualityValue::position,
         fmt::format("{} of the tip, mm{}.", of, one_direction() ? "" : ", mean over the tool directions"));
    if (!turns()) return;
    maps(QualityValue::orientation,
         fmt::format("{} of the orientation, mrad{}.", of, one_direction() ? "" : ", mean over the tool directions"));
  }

  /// Means, and the worst over the directions where there are several. What is beyond the range is left out.
  report::Histogram histogram(QualityValue value, const quality::Quantity& q, double scale, int& left_out) const {
    const ValueName name = name_of(value);
    report::Histogram out;
    out.title = fmt::format("How often: {}", name.words);
    report::Sample mean{one_direction() ? "at a point" : "mean over the directions", shown_means(fields_, value),
                        report::Colour::blue};
    report::Sample worst{"worst direction", {}, report::Colour::vermillion};
    for (const double v : q.worst) worst.values.push_back(scale * v);
    const double high = std::max(range_of(mean.values).high, range_of(worst.values).high);
    const auto trim = [&](report::Sample& s) {
      return static_cast<int>(std::erase_if(s.values, [&](double v) { return !(v <= high); }));
    };
    left_out = trim(mean);
    left_out = std::max(left_out, trim(worst));
    out.x = {name.words, name.unit, {}, {}, false};
    out.samples.push_back(std::move(mean));
    if (!one_direction()) out.samples.push_back(std::move(worst));
    return out;
  }

  [[nodiscard]] std::string beyond(int left_out) const {
    return left_out == 0
               ? ""
               : fmt::format(" {} of {} points lie beyond the right end.", left_out, fields_.survey.inside.size());
  }

  void error_histograms() {
    report_.add_section("How often errors are so large");
    int far = 0, far_turned = 0;
    const auto position = histogram(QualityValue::position, fields_.errors.position, units::kMmPerMetre, far);
    std::vector<std::pair<std::string, report::Figure>> panels{{"the tip", position}};
    if (turns()) {
      panels.emplace_back("the orientation", histogram(QualityValue::orientation, fields_.errors.orientation,
                                                       units::kMradPerRad, far_turned));
    }
    report_.add_figure_grid(
        2, panels,
        fmt::format("Share of the points of the {}, per cent.", region()) + beyond(std::max(far, far_turned)));
  }

  /// Of tolerances: shares that add up to the worst case; of known errors: what each would do alone.
  [[nodiscard]] std::vector<Part> parts_at(const Pose& X) const {
    std::vector<Part> out;
    const auto q = quality::joints_at(machine_, X);
    if (!q) return out;
    if (question_.tolerances) {
      const auto worst = quality::worst_case(machine_, X, *q, question_.sizes, question_.tolerance);
      if (!worst) return out;
      for (const auto& s : worst->shares) out.push_back({s.element, s.position, s.orientation});
    } else {
      for (const quality::Sized& s : question_.sizes) {
        const Vec6 error = quality::known_error(machine_, X, *q, {s});
        out.push_back({s.element, error.head<3>().norm(), quality::orientation_error(machine_, X, error)});
      }
    }
    return out;
  }

  /// The largest parts as bars, the rest as one.
  [[nodiscard]] report::BarChart bars(const std::vector<Part>& parts, double Part::*of, double scale,
                                      const char* unit) const {
    std::vector<std::pair<int, double>> values;
    for (const Part& part : parts) values.emplace_back(part.element, part.*of);
    const std::vector<quality::Bar> all = quality::bars_of(machine_, values);
    report::BarChart chart;
    chart.title = "Contribution of the elements";
    chart.unit = unit;
    chart.parts = {""};
    for (std::size_t i = 0; i < std::min(kShown, all.size()); ++i) {
      // Known errors add as vectors: a bar is what each of its elements does alone.
      const bool one = all[i].elements == 1, together = question_.tolerances;
      chart.rows.push_back({all[i].name + (one ? "" : fmt::format(" ({})", together ? "together" : "each")),
                            {scale * (together ? all[i].total() : all[i].each)}});
    }
    return chart;
  }

  void parts() {
    const std::vector<Part> at_tip = parts_at(worst_.X_MT), at_turn = parts_at(worst_turned_.X_MT);
    // Where an error is infinite the shares in it are rounding.
    if (at_tip.empty() || at_turn.empty() || !std::isfinite(worst_.value) || !std::isfinite(worst_turned_.value))
      return;
    report_.add_section("Which parts make it");
    report_.add_text(
        question_.tolerances
            ? "At the worst pose, the elements whose tolerance costs most. All contributions add up to the error."
            : "At the worst pose, what each error would do alone. Together they add as vectors.");
    std::vector<std::pair<std::string, report::Figure>> panels{
        {fmt::format("tip, {} mm at {}", shown(to_mm(worst_.value)), pose_in_words(machine_, worst_.X_MT)),
         bars(at_tip, &Part::position, units::kMmPerMetre, "mm")}};
    if (turns()) {
      panels.emplace_back(fmt::format("orientation, {} mrad at {}", shown(units::kMradPerRad * worst_turned_.value),
                                      pose_in_words(machine_, worst_turned_.X_MT)),
                          bars(at_turn, &Part::orientation, units::kMradPerRad, "mrad"));
    }
    report_.add_figure_grid(2, panels,
                            fmt::format("The largest {} bars of {} elements, ranked by their contribution to the "
                                        "largest error; elements with the same contribution have one bar.",
                                        std::min(kShown, at_tip.size()), at_tip.size()));
  }

  void conditioning() {
    report_.add_section("Conditioning");
    std::string about =
        "κ is the ratio of the tool's fastest to its slowest motion for joint speeds of one size; near 1 all "
        "directions "
        "are alike.";
    if (kinematics::task(machine_).turns()) {
      about += fmt::format(
          " It mixes millimetres and radians: angles count as lengths on {}, and another length gives another κ. So "
          "compare machines by the errors above, and poses of one machine by κ.",
          fields_.dexterity.length > 0 ? fmt::format("{} mm", number(to_mm(fields_.dexterity.length)))
                                       : "a length that changes with the pose");
    }
    report_.add_text(about);
    statistics_table(kConditioning);
    for (const QualityValue value : kConditioning) {
      maps(value, fmt::format("{}{}{}.", name_of(value).words, value == QualityValue::determinant ? " |det|" : "",
                              one_direction() ? "" : ", mean over the tool directions"));
    }
    int far = 0;
    const auto plot = histogram(QualityValue::condition, fields_.dexterity.condition, 1, far);
    report_.add_figure(plot, fmt::format("Share of the points of the {}, per cent.", region()) + beyond(far));
  }

  [[nodiscard]] std::string words_at(const Pose& X) const {
    const auto q = quality::joints_at(machine_, X);
    return q ? quality::in_words(X, quality::singularity(machine_, X, *q, question_.length)) : std::string("no joints");
  }

  void near_singular() {
    const quality::Quantity& condition = fields_.dexterity.condition;
    const auto count = near_singular_count();
    const Extreme worst =
        quality::worst_seen(machine_, fields_.survey, options_, condition, fields_.dexterity.anywhere, 0);
    report_.add_section("Near singular");
    if (count == 0 && worst.value <= kSingularCondition) {
      report_.add_verdict(
          Verdict::neutral,
          fmt::format("No pose that was looked at has a κ above {}. The largest is {}, at {}; there the "
                      "machine is {}.",
                      number(kSingularCondition), shown(worst.value), pose_in_words(machine_, worst.X_MT),
                      words_at(worst.X_MT)));
      return;
    }
    report_.add_verdict(
        Verdict::neutral,
        fmt::format("{} of {} points have a tool direction with κ above {}: a singular pose is near, and the means "
                    "above hide it. The worst κ is {}, at {}.",
                    count, condition.worst.size(), number(kSingularCondition), shown(worst.value),
                    pose_in_words(machine_, worst.X_MT)));
    report::Table table;
    table.caption = "The worst of them, no two close together";
    table.columns = {{"pose", ""}, {"κ", ""}, {"what the machine does there", ""}};
    constexpr std::size_t kNamed = 5;
    std::vector<Extreme> named = apart(fields_.survey, condition, kNamed);
    if (named.empty()) named.push_back(worst);  // it lies between the points
    for (const Extreme& e : named)
      table.rows.push_back({pose_in_words(machine_, e.X_MT), shown(e.value), words_at(e.X_MT)});
    report_.add_table(table);
  }

  [[nodiscard]] std::ptrdiff_t near_singular_count() const {
    const std::vector<double>& worst = fields_.dexterity.condition.worst;
    return std::count_if(worst.begin(), worst.end(), [](double v) { return v > kSingularCondition; });
  }

  /// Points near singular, for a picture in space.
  [[nodiscard]] std::vector<report::Line3> singular_points() const {
    report::Line3 line{fmt::format("κ above {}", number(kSingularCondition)), {}, report::Colour::vermillion, 2, true};
    constexpr std::size_t kMost = 400;
    std::vector<std::size_t> found;
    for (std::size_t i = 0; i < fields_.survey.inside.size(); ++i)
      if (fields_.dexterity.condition.worst[i] > kSingularCondition) found.push_back(i);
    const std::size_t every = 1 + found.size() / kMost;
    for (std::size_t k = 0; k < found.size(); k += every) {
      const Vec3 p = fields_.survey.grid.at(fields_.survey.inside[found[k]]);
      line.points.push_back({to_mm(p.x()), to_mm(p.y()), to_mm(p.z())});
    }
    if (line.points.empty()) return {};
    return {line};
  }

  /// A threshold that some of the workspace keeps and some does not.
  [[nodiscard]] double threshold(const std::vector<double>& values) const {
    if (page_.below) return *page_.below;
    constexpr double kGoodCondition = 3, kShare = 0.1;
    const auto share =
        static_cast<double>(std::count_if(values.begin(), values.end(), [](double v) { return v <= kGoodCondition; }));
    const auto all = static_cast<double>(values.size());
    if (page_.region == QualityValue::condition && share > kShare * all && share < (1 - kShare) * all)
      return kGoodCondition;
    std::vector<double> finite = values;
    std::erase_if(finite, [](double v) { return !std::isfinite(v); });
    if (finite.empty()) return std::numeric_limits<double>::infinity();
    std::nth_element(finite.begin(), finite.begin() + static_cast<std::ptrdiff_t>(finite.size() / 2), finite.end());
    return rounded(finite[finite.size() / 2]);
  }

  [[nodiscard]] Result<QualityFields> fields_in_space() const {
    SurveyOptions finer = options_;
    finer.resolution = page_.resolution_in_space;
    return quality_fields(machine_, finer, question_);
  }

  /// The mean error of the tip, mm, at points anywhere: each is a survey of its own. Where the machine has no joints,
  /// as on an arm's border, `otherwise`.
  [[nodiscard]] Result<std::vector<double>> errors_at(const std::vector<Vec3>& points,
                                                      std::vector<double> otherwise) const {
    SurveyOptions options = options_;
    options.workspace.threads = 1;
    for (std::size_t i = 0; i < points.size(); ++i) {
      quality::Survey at;
      at.grid.origin = points[i];
      at.inside = {0};
      at.orientations = fields_.survey.orientations;
      POLYPOD_ASSIGN(errors, errors_of(machine_, options, question_, at));
      if (std::isfinite(errors.position.worst[0])) otherwise[i] = to_mm(errors.position.mean[0]);
    }
    return otherwise;
  }

  Status in_space() {
    if (!fields_.survey.task.places()) return {};
    const auto& points = fields_.survey.grid.points;
    if (*std::min_element(points.begin(), points.end()) < 2) return {};  // a survey of a plane has no room
    POLYPOD_ASSIGN(fine, fields_in_space());
    POLYPOD_ASSIGN(border, quality::survey_border(machine_, fine.survey, options_));
    const std::vector<double> position = shown_means(fine, QualityValue::position);
    constexpr double kAll = std::numeric_limits<double>::infinity();
    POLYPOD_ASSIGN(hull,
                   quality::surface_below(machine_, options_, border, std::vector<double>(position.size(), 0.0), kAll));
    report::Scene scene;
    scene.title = "The workspace, coloured by the error of the tip";
    report::Mesh mesh = mesh_of(hull);
    POLYPOD_ASSIGN(on_border, errors_at(hull.points, quality::values_at(border, position, hull.points)));
    colour_by(scene, mesh, on_border, range_of(on_border), "mm");
    scene.meshes.push_back(std::move(mesh));
    scene.lines = singular_points();
    report_.add_section("Errors in space");
    report::Scene turns = scene;
    const std::vector<report::Line3> machine = machine_at(machine_, start_pose(machine_)).lines;
    turns.lines.insert(turns.lines.begin(), machine.begin(), machine.end());
    constexpr std::size_t kEllipsoids = 40;
    const std::vector<report::Line3> ellipsoids = velocity_ellipsoids(machine_, fine.survey, kEllipsoids);
    turns.lines.insert(turns.lines.end(), ellipsoids.begin(), ellipsoids.end());
    report::Scene with_machine = scene;
    with_machine.title = "The same with the machine";
    with_machine.lines = machine;
    with_machine.max_aspect = 0.95;
    if (kinematics::hangs_down(machine_))
      for (report::Scene* each : {&scene, &turns, &with_machine}) hang(*each);
    report_.add_scene(
        scene,
        std::string("The boundary of the workspace, coloured by the error of the tip.") +
            (ellipsoids.empty() ? ""
                                : " Where it turns, ellipsoids show how fast the tip is in each direction "
                                  "where the joint speeds (m/s and rad/s) have a root of the sum of "
                                  "squares of 1: all at one scale.") +
            (kinematics::hangs_down(machine_) ? " The base is above: z of the machine points down." : ""),
        &turns);
    std::vector<std::pair<std::string, report::Figure>> panels{{"with the machine", with_machine}};
    POLYPOD_TRY(add_region(fine, border, hull, panels));
    report_.add_figure_grid(2, panels, "");
    return {};
  }

  /// Where the value that the user asks about is small.
  Status add_region(const QualityFields& fine, const quality::SurveyBorder& border, const workspace::Surface& hull,
                    std::vector<std::pair<std::string, report::Figure>>& panels) {
    const std::vector<double> values = shown_means(fields_, page_.region);
    const double below = threshold(values);
    const auto count = std::count_if(values.begin(), values.end(), [&](double v) { return v <= below; });
    const ValueName name = name_of(page_.region);
    const std::string what =
        fmt::format("{} at most {}{}{}", name.words, plain(below), name.unit[0] != 0 ? " " : "", name.unit);
    if (count == 0) {
      report_.add_text(fmt::format("Nowhere is the {}.", what));
      return {};
    }
    POLYPOD_ASSIGN(region, quality::surface_below(machine_, options_, border, shown_means(fine, page_.region), below));
    report::Scene scene;
    scene.title = "Where the " + what;
    scene.max_aspect = 0.95;
    scene.meshes.push_back(mesh_of(region));
    report::Mesh whole = mesh_of(hull);
    whole.kind.assign(whole.points.size(), -1);
    whole.opacity = 0.14;
    scene.meshes.push_back(std::move(whole));
    if (kinematics::hangs_down(machine_)) hang(scene);
    panels.emplace_back(
        fmt::format("{}: {} % of the {}{}", what,
                    fixed(100.0 * static_cast<double>(count) / static_cast<double>(values.size()), 1),
                    options_.box ? "points of the box" : "workspace", options_.box ? "" : ", which is pale"),
        scene);
    return {};
  }

  [[nodiscard]] std::string spacing() const {
    const machine::Task& task = fields_.survey.task;
    const auto& step = fields_.survey.grid.step;
    if (task.places()) return number(to_mm(step[0].norm())) + " mm";
    std::string out;
    for (int k = 0; k < workspace::coordinates_of_points(task); ++k) {
      const char* unit = workspace::unit_of(task, k);
      out += fmt::format("{}{} {}", k > 0 ? ", " : "",
                         number(units::to_user(step[static_cast<std::size_t>(k)].norm(), unit)), unit);
    }
    return out;
  }

  [[nodiscard]] Entries inputs() const {
    Entries entries{
        {"tool directions of the errors", directions_of(machine_, options_, fields_.survey)},
        {kind_of(question_), given_of(page_)},
        {fmt::format("points of the {}", region()), fixed(static_cast<double>(fields_.survey.inside.size()), 0)},
        {"spacing", spacing()},
        {"points a side of a section", fixed(page_.resolution, 0)}};
    if (options_.box) {
      const auto& [low, high] = *options_.box;
      entries.emplace_back("box", fmt::format("{} to {} {}", place(fields_.survey.task, low),
                                              place(fields_.survey.task, high), place_unit()));
    }
    if (question_.tolerances) {
      entries.emplace_back("method", question_.tolerance.method == quality::Method::exact
                                         ? "exact: the farthest vertex of the zonotope"
                                         : "search (JEL 5.3): never above exact");
      entries.emplace_back("region of a joint", question_.tolerance.region == quality::Region::box ? "box" : "sphere");
    }
    return entries;
  }

  const AnyMachine& machine_;
  SurveyOptions options_;
  const QualityQuestion& question_;
  const QualityFields& fields_;
  const QualityPageOptions& page_;
  Report& report_;
  Vec3 middle_ = Vec3::Zero();
  Extreme worst_, worst_turned_;
  std::optional<Extreme> once_;  ///< with one element a joint
  std::vector<QualitySection> sections_;
};

}  // namespace

Result<std::string> quality_page(const AnyMachine& machine, const SurveyOptions& options,
                                 const QualityQuestion& question, const QualityFields& fields,
                                 const QualityPageOptions& page) {
  Entries facts{{"machine", page.machine.empty() ? machine::name_of(machine) : page.machine},
                {"family", machine::family_of(machine)},
                {kind_of(question), given_of(page)},
                {"tool directions", directions_of(machine, options, fields.survey)},
                {"points", fixed(static_cast<double>(fields.survey.inside.size()), 0)}};
  for (const std::string& set : page.sets) facts.emplace_back("changed", set);
  if (!page.version.empty()) facts.emplace_back("made with", "Polypod " + page.version);
  Report report("Quality of " + machine::name_of(machine),
                "How far errors of its parts put the tool off, and how well its joints and its tool move each other",
                facts);
  POLYPOD_ASSIGN(inputs, add_quality(report, machine, options, question, fields, page));
  add_inputs(report, machine, inputs, page.command);
  return report.to_html();
}

Result<Entries> add_quality(Report& report, const AnyMachine& machine, const SurveyOptions& options,
                            const QualityQuestion& question, const QualityFields& fields,
                            const QualityPageOptions& page) {
  return QualityPart(report, machine, options, question, fields, page).add();
}

}  // namespace polypod::pages
