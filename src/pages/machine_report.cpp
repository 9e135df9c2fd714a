// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/pages/machine_report.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <optional>

#include "machine_inputs.hpp"
#include "parts.hpp"
#include "polypod/calibration/poses.hpp"
#include "polypod/core/units.hpp"
#include "polypod/kinematics/any_machine.hpp"
#include "polypod/kinematics/parts.hpp"
#include "polypod/pages/compliance_map.hpp"
#include "polypod/pages/machine.hpp"
#include "polypod/quality/singularity.hpp"
#include "polypod/statics/judge.hpp"
#include "workspace_section.hpp"

namespace polypod::pages {
namespace {

using machine::AnyMachine;
using report::number;
using report::Report;
using report::Verdict;
using units::to_mm;
using units::to_um;

/// What a plan of measurements would leave uncertain.
struct Plan {
  std::size_t poses = 0;
  double chosen = 0, grid = 0;  ///< m, standard deviation of a predicted position; infinite where parameters stay open
};
struct Plans {
  calibration::Candidates from;
  std::vector<Plan> plans;
};

class MachineReportPage {
 public:
  MachineReportPage(const AnyMachine& machine, const MachineReportOptions& options)
      : machine_(machine),
        options_(options),
        task_(kinematics::task(machine)),
        report_(machine::name_of(machine), machine::description_of(machine), facts()) {
    options_.survey.progress = [this](double share) { said("survey", share); };
  }

  Result<MachineReport> make() {
    POLYPOD_TRY(compute());
    at_a_glance();
    POLYPOD_TRY(workspace_part());
    POLYPOD_TRY(errors_part());
    statics_part();
    calibration_part();
    add_inputs(report_, machine_, asked_, options_.command);
    return MachineReport{report_.to_html(), {workspace_, errors_, statics_, calibration_}, figures_};
  }

 private:
  [[nodiscard]] Entries facts() const {
    Entries out{{"machine", options_.machine.empty() ? machine::name_of(machine_) : options_.machine},
                {"family", machine::family_of(machine_)}};
    for (const std::string& set : options_.sets) out.emplace_back("changed", set);
    if (!options_.version.empty()) out.emplace_back("made with", "Polypod " + options_.version);
    return out;
  }
  void said(const char* what, double share) const {
    if (options_.progress) options_.progress(what, share);
  }
  /// Whether the user ended the work; any other error belongs to the part that has it.
  [[nodiscard]] bool cancelled() const {
    return options_.survey.workspace.cancelled && options_.survey.workspace.cancelled();
  }
  /// The value, or the reason in `part`. Errors: of cancelled work, and of options that do not fit the machine.
  template <typename T>
  Result<std::optional<T>> unless_impossible(Result<T> result, ReportPart& part) const {
    if (result) return std::optional<T>(std::move(*result));
    static constexpr std::array kOfOptions{"WS100", "WS101", "WS104", "WS105", "WS108"};
    const bool of_options = std::find(kOfOptions.begin(), kOfOptions.end(), result.error().id) != kOfOptions.end();
    if (cancelled() || of_options) return tl::unexpected(result.error());
    part.reason = result.error().message;
    if (!result.error().hint.empty()) part.reason += "; " + result.error().hint;
    return std::optional<T>();
  }

  Status compute() {
    said("workspace", 0);
    POLYPOD_ASSIGN(volume, unless_impossible(workspace::volume(machine_, options_.survey.workspace), workspace_));
    volume_ = std::move(volume);
    const quality::PoseIndependentSingularity singular = quality::pose_independent_singularity(machine_);
    if (singular.everywhere() || singular.nearly()) {
      singular_ = "This machine is " + quality::in_words(singular);
      errors_.reason = statics_.reason = calibration_.reason = "the machine is singular, see above";
      return {};
    }
    POLYPOD_ASSIGN(fields, unless_impossible(quality_fields(machine_, options_.survey, options_.question), errors_));
    fields_ = std::move(fields);
    compliance();
    said("calibration", 0);
    POLYPOD_ASSIGN(plans, unless_impossible(plan(), calibration_));
    plans_ = std::move(plans);
    return {};
  }

  /// The map that `polypod map` draws by itself.
  void compliance() {
    if (const Status compliant = statics::needs_compliance(machine_); !compliant) {
      statics_.reason = compliant.error().message + "; " + compliant.error().hint;
      return;
    }
    const std::vector<statics::Plane> planes = statics::planes_of(task_);
    if (planes.empty()) {
      statics_.reason =
          "the task holds one coordinate alone, and a map goes over two; `polypod compliance --pose` answers for one "
          "pose";
      return;
    }
    constexpr int kLonger = 41;
    ComplianceMap map{machine_, planes.front(), 0, {}, {}, {}, {}, {}, statics::middle_coordinates(machine_)};
    const bool of_positions = map.plane.of_positions();
    const Mat3 R_MT = kinematics::pose_of(task_, map.coordinates).R;
    std::optional<statics::Rectangle> rectangle;
    if (of_positions) {
      map.at = kinematics::middle_of_work(machine_)[statics::axes_of(map.plane).normal];
      for (int i = 0; i < task_.size(); ++i)
        if (task_.is_angle(i)) map.angles_deg.push_back(0);
      rectangle = statics::reached_rectangle(machine_, map.plane, map.at, R_MT);
    } else {
      rectangle = statics::reached_rectangle(machine_, {map.plane, map.coordinates});
    }
    if (rectangle) {
      map.rectangle = *rectangle;
      const auto [columns, rows] = grid_counts(*rectangle, kLonger);
      map.map = of_positions
                    ? statics::compliance_map(
                          machine_, statics::plane_grid(map.plane, map.at, map.rectangle, columns, rows), R_MT)
                    : statics::compliance_map(machine_, {map.plane, map.coordinates}, map.rectangle, columns, rows);
    }
    if (!rectangle || reached(map.map) == 0) {
      statics_.reason = fmt::format("nothing is reached of {} with the other angles at 0; `polypod map` draws others",
                                    domain_of(map));
      return;
    }
    map_ = std::move(map);
  }

  /// What positions chosen among candidates, and positions on a grid, tell of the geometry.
  [[nodiscard]] Result<Plans> plan() const {
    calibration::CalibrationOptions how;
    how.noise_position = options_.noise_position;
    constexpr std::size_t kCandidates = 400;
    constexpr std::array<std::size_t, 6> kCounts{10, 15, 20, 30, 50, 100};
    Plans out;
    POLYPOD_ASSIGN(from, calibration::geometry_candidates(machine_, kCandidates, 1, calibration::Kind::point, {}, how));
    out.from = std::move(from);
    for (const std::size_t count : kCounts) {
      said("calibration", static_cast<double>(out.plans.size()) / static_cast<double>(kCounts.size()));
      if (3 * count < out.from.unknowns.size() || count > out.from.equations.size()) continue;
      auto chosen = calibration::choose(out.from.equations, count, calibration::Criterion::determinant);
      if (!chosen) continue;  // fewer equations than unknowns
      std::vector<Eigen::MatrixXd> measured;
      for (const std::size_t i : *chosen) measured.push_back(out.from.equations[i]);
      constexpr double kGridTilt_deg = 20;
      const auto stands = calibration::grid_stands(machine_, out.from.stands, count,
                                                   units::from_deg(task_.turns() ? kGridTilt_deg : 0));
      const auto on_grid =
          calibration::geometry_equations(machine_, stands, calibration::Kind::point, {}, how, out.from);
      const auto predicted = [&](const std::vector<Eigen::MatrixXd>& equations) {
        return how.noise_position * calibration::uncertainty(equations, out.from.equations).reading;
      };
      out.plans.push_back({count, predicted(measured), predicted(on_grid)});
    }
    if (out.plans.empty()) {
      return fail("CA130", fmt::format("{} measured positions do not tell {} unknowns", kCounts.back(),
                                       out.from.unknowns.size()));
    }
    return out;
  }

  void at_a_glance() {
    report_.add_section("At a glance");
    if (!singular_.empty()) report_.add_verdict(Verdict::bad, singular_);
    std::vector<report::KeyFigure> figures;
    if (volume_ && volume_->empty) {
      figures.push_back({"0", "", "workspace, proven: no point is reached as was asked", Verdict::bad});
      figures_.volume = {0, 0, 0};
    } else if (volume_ && (volume_->proven || volume_->reached)) {
      const double error = 50 * (volume_->upper - volume_->lower) / std::max(volume_->volume, 1e-300);
      const auto [size, unit] = task_.places() ? volume_figure(*volume_) : region_figure(task_, *volume_);
      figures.push_back(
          {size, unit,
           fmt::format("workspace, ± {} % {}", number(error, 2), volume_->proven ? "proven" : "(95 % of a sample)"),
           Verdict::neutral});
      figures_.volume = {volume_->volume, volume_->lower, volume_->upper};
    }
    if (fields_) quality_figures(figures);
    if (map_) {
      double most = 0;
      for (const Field& f : fields_of(*map_))
        if (f.kind == Field::Kind::direct) most = std::max(most, extremes_of(f.values).max);
      figures_.compliance = most;
      figures.push_back({number(most), "µm/N",
                         fmt::format("largest direct compliance on a grid over {}, tool at zero tilt", place_of(*map_)),
                         Verdict::neutral});
    }
    if (plans_) {
      const Plan& best = plans_->plans.back();
      figures_.calibrated = best.chosen;
      figures.push_back(
          {number(to_um(best.chosen)), "µm",
           fmt::format("standard deviation of a position after a calibration with {} measured positions", best.poses),
           Verdict::neutral});
    }
    report_.add_key_figures(figures);
    report_.add_text(
        "Each question has its chapters below, which say what they answer for. Tool directions, limits that are "
        "switched "
        "off and a box hold for workspace, errors and conditioning. Compliances are those of a tool at zero tilt in a "
        "plane, and measured positions for a calibration lie anywhere in the reach, both within all limits. The inputs "
        "stand once, at the end.");
    for (const ReportPart* part : {&workspace_, &errors_, &statics_, &calibration_})
      if (!part->reason.empty()) not_judged(*part);
  }

  void quality_figures(std::vector<report::KeyFigure>& figures) {
    const auto seen = [&](const quality::Quantity& of, const auto& anywhere, std::size_t number) {
      return quality::worst_seen(machine_, fields_->survey, options_.survey, of, anywhere, number).value;
    };
    const double worst = seen(fields_->errors.position, fields_->errors.anywhere, 0);
    const double turned = seen(fields_->errors.orientation, fields_->errors.anywhere, 1);
    const double condition = seen(fields_->dexterity.condition, fields_->dexterity.anywhere, 0);
    const bool bounded = std::isfinite(worst) && std::isfinite(turned);
    figures_.error = bounded ? worst : std::numeric_limits<double>::infinity();
    figures_.condition = condition < 1 / quality::kRankLost ? condition : std::numeric_limits<double>::infinity();
    const std::string of = fmt::format("{} {}", options_.question.tolerances ? "tolerances" : "errors", given());
    figures.push_back(
        {bounded ? number(to_mm(worst)) : "∞", "mm",
         fmt::format("{}, with the {}{}",
                     bounded ? "largest error of the tip that was seen" : "errors of the tip have no bound", of,
                     options_.assumed ? " (assumed)" : ""),
         bounded ? Verdict::neutral : Verdict::bad});
    figures.push_back({std::isfinite(figures_.condition) ? number(condition) : "∞", "",
                       "largest condition number κ that was seen", Verdict::neutral});
  }

  void not_judged(const ReportPart& part) {
    report_.add_verdict(Verdict::neutral, fmt::format("Not judged, {}: {}.", part.name, part.reason));
  }
  [[nodiscard]] std::string given() const { return fmt::format("{}", fmt::join(options_.given, ", ")); }

  void asked(const Entries& entries) {
    for (const auto& entry : entries)
      if (std::find(asked_.begin(), asked_.end(), entry) == asked_.end()) asked_.push_back(entry);
  }

  Status workspace_part() {
    if (volume_) {
      WorkspacePageOptions page;
      page.resolution = options_.resolution;
      page.progress = options_.progress;
      const auto add = task_.places() ? add_workspace : add_region;
      POLYPOD_ASSIGN(inputs,
                     unless_impossible(add(report_, machine_, options_.survey.workspace, *volume_, page), workspace_));
      if (inputs) {
        asked(*inputs);
        return {};
      }
      not_judged(workspace_);
    }
    const MachineAt at = machine_at(machine_, start_pose(machine_));
    if (at.lines.empty()) return {};
    report_.add_section("The machine in space");
    report_.add_scene(machine_scene(machine_, at), "The machine at its start.");
    return {};
  }

  Status errors_part() {
    if (!fields_) return {};
    QualityPageOptions page;
    page.given = options_.given;
    page.assumed = options_.assumed;
    page.resolution = options_.resolution;
    page.resolution_in_space = options_.resolution_in_space;
    said("errors", 0);
    POLYPOD_ASSIGN(
        inputs,
        unless_impossible(add_quality(report_, machine_, options_.survey, options_.question, *fields_, page), errors_));
    if (inputs) {
      asked(*inputs);
    } else {
      not_judged(errors_);
    }
    return {};
  }

  void statics_part() {
    if (map_) asked(add_compliance_map(report_, *map_));
  }

  void calibration_part() {
    if (!plans_) return;
    const calibration::Candidates& from = plans_->from;
    const double noise = to_um(options_.noise_position);
    report_.add_section("How well it could be calibrated");
    const Plan& best = plans_->plans.back();
    report_.add_verdict(
        Verdict::neutral,
        fmt::format(
            "Measured positions of the tool tell {} of {} unknowns of the geometry. With {} positions, each "
            "coordinate measured with a standard deviation of {:.6g} µm, the calibrated model predicts a coordinate "
            "of a position with a standard deviation of {} µm on average.",
            from.unknowns.size(), from.total, best.poses, noise, number(to_um(best.chosen))));
    report_.add_text(
        "This answers for the geometry that the machine's file describes, to first order, with the instrument's frame "
        "and target known: not for errors that the model does not hold, such as deflection and temperature.");
    report::LinePlot plot;
    plot.title = "Uncertainty of a predicted position against the number of measured positions";
    plot.x = {"measured positions", "", 0, {}, false};
    plot.y = {"standard deviation", "µm", {}, {}, true};
    report::Series chosen{"chosen", {}, {}, report::Colour::blue, report::LineStyle::solid, 2};
    report::Series grid{"on a grid", {}, {}, report::Colour::orange, report::LineStyle::dashed, 2};
    report::Table table;
    table.columns = {{"measured positions", "", 0}, {"chosen", "µm"}, {"on a grid", "µm"}};
    for (const Plan& p : plans_->plans) {
      for (const auto& [series, value] : {std::pair{&chosen, p.chosen}, std::pair{&grid, p.grid}}) {
        series->x.push_back(static_cast<double>(p.poses));
        series->y.push_back(to_um(value));
      }
      const auto cell = [](double metres) {
        return std::isfinite(metres) ? report::Cell(to_um(metres)) : report::Cell("not all unknowns");
      };
      table.rows.push_back({static_cast<double>(p.poses), cell(p.chosen), cell(p.grid)});
    }
    // A grid may tell next to nothing: the curve of what is chosen keeps its shape.
    constexpr double kRoom = 4;
    const double most = *std::max_element(chosen.y.begin(), chosen.y.end());
    const auto beyond = [&](double y) { return y > kRoom * most; };
    if (std::any_of(grid.y.begin(), grid.y.end(), beyond)) plot.y.max = kRoom * most;
    plot.series = {chosen, grid};
    report_.add_figure(plot,
                       "Positions that are chosen to tell most (polypod poses) beside as many on a regular grid. The "
                       "chosen ones come from a search: a local optimum.");
    report_.add_table(table);
    if (!from.held.empty()) {
      report::Table held;
      held.caption = "Not identifiable from positions: kept at their nominal values, or following from others";
      held.columns = {{"parameter", ""}};
      for (const std::string& key : from.held) held.rows.push_back({key});
      held.folded = true;
      report_.add_table(held);
    }
    asked({{"noise of a measured coordinate", fmt::format("{:.6g} µm", noise)},
           {"candidate positions", fmt::format("{}", from.equations.size())}});
  }

  const AnyMachine& machine_;
  MachineReportOptions options_;
  machine::Task task_;
  Report report_;
  Entries asked_;
  std::optional<workspace::Volume> volume_;
  std::optional<QualityFields> fields_;
  std::optional<ComplianceMap> map_;
  std::optional<Plans> plans_;
  std::string singular_;
  ReportFigures figures_;
  ReportPart workspace_{"workspace", ""}, errors_{"errors and conditioning", ""}, statics_{"statics", ""},
      calibration_{"calibration", ""};
};

}  // namespace

Result<MachineReport> machine_report(const AnyMachine& machine, const MachineReportOptions& options) {
  return MachineReportPage(machine, options).make();
}

}  // namespace polypod::pages
