// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "testcut_command.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <memory>
#include <optional>

#include "messages.hpp"
#include "polypod/core/csv.hpp"
#include "polypod/core/files.hpp"
#include "polypod/core/text.hpp"
#include "polypod/core/units.hpp"
#include "polypod/machining/testcut.hpp"

namespace polypod::app {
namespace {

using machining::Factor;
using machining::Job;
using machining::TestCut;
using machining::TestCutFit;
using machining::TestCutPlan;
using machining::TestCutReading;
using machining::TestCutStep;
using units::from_mm;
using units::to_mm;
using units::to_um;

struct Options {
  std::string job, output, sheet, measured, widths, center;
  std::vector<std::string> displacements;
  double feed = 0, speed = 0, depth = 0, sigma_um = 5;
  int tool = -1;
};

Json factor_json(const Factor& f) {
  return {{"value", f.value}, {"standard_uncertainty", f.uncertainty}};
}

// ---------------------------------------------------------------------------------------------------- the program

Result<TestCutPlan> plan_of(const Options& o) {
  TestCutPlan plan;
  plan.feed = units::from_mm_per_min(o.feed);
  plan.spindle_speed = units::from_per_min(o.speed);
  plan.depth = from_mm(o.depth);
  plan.tool = o.tool;
  if (!o.widths.empty()) {
    POLYPOD_ASSIGN(widths, numbers_of(o.widths, "--widths"));
    for (const double w : widths) plan.widths.push_back(from_mm(w));
  }
  if (!o.center.empty()) {
    POLYPOD_ASSIGN(center, numbers_of(o.center, "--center"));
    if (center.size() != 2) return fail("AP260", "--center " + o.center + ": not a place", {}, "give x,y in mm");
    plan.x = from_mm(center[0]);
    plan.y = from_mm(center[1]);
  }
  return plan;
}

constexpr const char* kColumns =
    "axis,width_mm,x_mm,y_mm,z_mm,nominal_mm,predicted_mm,measured_mm,sigma_um,depth_mm,feed_mm_per_min,"
    "speed_per_min,center_x_mm,center_y_mm,tool";

std::string sheet_of(const TestCut& cut, const std::vector<double>& predicted) {
  const TestCutPlan& plan = cut.plan;
  std::string out =
      "# Measure the boss along `axis` through x, y at the height z (in G54), and write the size into measured_mm;\n"
      "# the standard uncertainty of the reading into sigma_um, or give it once: --sigma-um. Rows without a size are\n"
      "# left out. The columns after these say how the boss was cut; leave them as they are.\n";
  out += std::string(kColumns) + '\n';
  for (std::size_t i = 0; i < cut.steps.size(); ++i) {
    const TestCutStep& step = cut.steps[i];
    out += fmt::format("{},{:.6g},{:.4f},{:.4f},{:.4f},{:.4f},{:.4f},,,{:.6g},{:.6g},{:.6g},{:.6g},{:.6g},{}\n",
                       step.axis, to_mm(step.width), to_mm(step.at.x()), to_mm(step.at.y()), to_mm(step.at.z()),
                       to_mm(step.nominal), to_mm(predicted[i]), to_mm(plan.depth), units::to_mm_per_min(plan.feed),
                       units::to_per_min(plan.spindle_speed), to_mm(plan.x), to_mm(plan.y), plan.tool);
  }
  return out;
}

Result<int> write_program(const Context& context, const Options& o) {
  if (!context.given("--feed") || !context.given("--speed")) {
    return fail("AP261", "a test cut needs its feed and its spindle speed", {},
                "give --feed (mm/min) and --speed (rev/min) as the programs to come have them");
  }
  POLYPOD_TRY(check_files({o.job}, {o.output, o.sheet}, context.json));
  POLYPOD_ASSIGN(job, machining::read_job(o.job));
  POLYPOD_ASSIGN(plan, plan_of(o));
  POLYPOD_ASSIGN(cut, machining::test_cut(job, plan));
  std::vector<std::string> notes;
  POLYPOD_ASSIGN(predicted, machining::predicted_sizes(job, cut, 1, &notes));
  files::Outputs together;
  POLYPOD_TRY(together.add(o.output, cut.text));
  if (!o.sheet.empty()) POLYPOD_TRY(together.add(o.sheet, sheet_of(cut, predicted)));
  POLYPOD_TRY(together.commit());
  const Vec3 low = cut.block_min, high = cut.block_max;
  if (context.json) {
    Json steps = Json::array();
    for (std::size_t i = 0; i < cut.steps.size(); ++i) {
      const TestCutStep& step = cut.steps[i];
      steps.push_back({{"axis", std::string(1, step.axis)},
                       {"width_mm", to_mm(step.width)},
                       {"at_mm", {to_mm(step.at.x()), to_mm(step.at.y()), to_mm(step.at.z())}},
                       {"nominal_mm", to_mm(step.nominal)},
                       {"predicted_mm", to_mm(predicted[i])}});
    }
    print_json({{"block_mm",
                 {{"min", {to_mm(low.x()), to_mm(low.y()), to_mm(low.z())}},
                  {"max", {to_mm(high.x()), to_mm(high.y()), to_mm(high.z())}}}},
                {"depth_mm", to_mm(cut.plan.depth)},
                {"steps", steps},
                {"notes", notes}});
    return kDone;
  }
  fmt::print("clamp   a block from X{:g} Y{:g} Z{:g} to X{:g} Y{:g} Z0 mm (in G54, top at Z0)\n", to_mm(low.x()),
             to_mm(low.y()), to_mm(low.z()), to_mm(high.x()), to_mm(high.y()));
  fmt::print("cut     {} with F{:.0f}, S{:.0f}, {:g} mm deep\n", one_line(o.output),
             units::to_mm_per_min(cut.plan.feed), units::to_per_min(cut.plan.spindle_speed), to_mm(cut.plan.depth));
  fmt::print("measure the boss at half depth:\n");
  fmt::print("  axis  width of cut mm  through x, y mm        nominal mm  predicted mm\n");
  for (std::size_t i = 0; i < cut.steps.size(); ++i) {
    const TestCutStep& step = cut.steps[i];
    fmt::print("  {:<4}  {:>15.3f}  {:>9.1f}, {:>9.1f}  {:>11.3f}  {:>12.3f}\n", step.axis, to_mm(step.width),
               to_mm(step.at.x()), to_mm(step.at.y()), to_mm(step.nominal), to_mm(predicted[i]));
  }
  fmt::print(
      "the sizes give the product of forces and compliances; readings of a dial gauge under a known force "
      "(--displacements) separate them\n");
  if (!o.sheet.empty())
    fmt::print("then    polypod testcut --job {} --measured {} -o JOB.toml\n", one_line(o.job), one_line(o.sheet));
  return kDone;
}

// ------------------------------------------------------------------------------------------------ what was measured

struct Sheet {
  TestCut cut;
  std::vector<TestCutReading> readings;
  std::vector<std::optional<double>> predicted;  ///< m, of each reading, when the program was written
};

Result<Sheet> read_sheet(const Job& job, const std::string& path, double sigma) {
  POLYPOD_ASSIGN(table, csv::read(path));
  POLYPOD_TRY(table.needs({"axis", "width_mm", "nominal_mm", "measured_mm", "depth_mm", "feed_mm_per_min",
                           "speed_per_min", "center_x_mm", "center_y_mm", "tool"}));
  POLYPOD_TRY(csv::no_row_twice(table));
  TestCutPlan plan;
  std::vector<double> values;
  for (const char* name : {"feed_mm_per_min", "speed_per_min", "depth_mm", "center_x_mm", "center_y_mm", "tool"}) {
    const csv::Table::Row& first = table.rows.front();
    POLYPOD_ASSIGN(value, table.number(first, name));
    for (const csv::Table::Row& row : table.rows) {
      POLYPOD_ASSIGN(same, table.number(row, name));
      if (same != value) {
        return fail("AP262", fmt::format("{} {:g} here and {:g} in the first row", name, same, value),
                    table.place_of(row), "all rows of a sheet are of one test cut");
      }
    }
    values.push_back(value);
  }
  plan.feed = units::from_mm_per_min(values[0]);
  plan.spindle_speed = units::from_per_min(values[1]);
  plan.depth = from_mm(values[2]);
  plan.x = from_mm(values[3]);
  plan.y = from_mm(values[4]);
  if (!(values[5] >= -1 && values[5] <= 1e5)) {
    return fail("AP262", fmt::format("tool {:g}: no number of a tool", values[5]), table.place_of(table.rows.front()));
  }
  plan.tool = static_cast<int>(values[5]);
  for (const csv::Table::Row& row : table.rows) {
    POLYPOD_ASSIGN(width, table.number(row, "width_mm"));
    if (std::find(plan.widths.begin(), plan.widths.end(), from_mm(width)) == plan.widths.end())
      plan.widths.push_back(from_mm(width));
  }
  std::sort(plan.widths.begin(), plan.widths.end());
  Sheet out;
  POLYPOD_ASSIGN(cut, machining::test_cut(job, plan));
  out.cut = std::move(cut);
  for (const csv::Table::Row& row : table.rows) {
    POLYPOD_ASSIGN(width, table.number(row, "width_mm"));
    POLYPOD_ASSIGN(nominal, table.number(row, "nominal_mm"));
    const std::string axis = table.text(row, "axis");
    const auto& steps = out.cut.steps;
    const auto step = std::find_if(steps.begin(), steps.end(), [&](const TestCutStep& s) {
      return axis == std::string(1, s.axis) && s.width == from_mm(width);
    });
    constexpr double kSame = 1e-3;  // mm
    if (step == steps.end() || std::abs(to_mm(step->nominal) - nominal) > kSame) {
      return fail(
          "AP262",
          fmt::format("axis {}, width {:g} mm, nominal {:g} mm: no size of this test cut", axis, width, nominal),
          table.place_of(row), "take the sheet that came with the program, and the same cutter in the job");
    }
    POLYPOD_ASSIGN(row_sigma, table.number(row, "sigma_um", to_um(sigma)));
    if (!(row_sigma > 0)) {
      return fail("AP262", fmt::format("sigma_um {:g}", row_sigma), table.place_of(row), "give a number above 0");
    }
    for (const char* unused : {"x_mm", "y_mm", "z_mm"}) (void)table.text(row, unused);
    std::optional<double> predicted;
    if (!table.text(row, "predicted_mm").empty()) {
      POLYPOD_ASSIGN(value, table.number(row, "predicted_mm"));
      predicted = from_mm(value);
    }
    if (table.text(row, "measured_mm").empty()) continue;
    POLYPOD_ASSIGN(size, table.number(row, "measured_mm"));
    constexpr double kFar = 2;  // mm: no bend of a tool
    if (std::abs(size - nominal) > kFar) {
      return fail("AP263", fmt::format("a size of {:g} mm where {:g} mm were programmed", size, nominal),
                  table.place_of(row), "sizes are in mm, and within 2 mm of what was programmed");
    }
    out.readings.push_back({static_cast<std::size_t>(step - steps.begin()), from_mm(size), units::from_um(row_sigma)});
    out.predicted.push_back(predicted);
  }
  POLYPOD_TRY(table.unused());
  return out;
}

/// What goes into [factors].
struct Told {
  TestCutFit fit;
  std::optional<Factor> compliance, force;  ///< where known forces tell them apart
  machining::Factors factors;
  double other_job = 0;  ///< m, the most that a size of the job is off that of the sheet; 0 where they are the same
};

/// Whether the sheet was foretold by this job as it is now: the largest difference of a size, m.
Result<double> off_the_sheet(const Job& job, const Sheet& sheet) {
  constexpr double kSame = units::from_um(0.5);  // the sheet has four digits behind the point of mm
  POLYPOD_ASSIGN(now, machining::predicted_sizes(job, sheet.cut, 1));
  double most = 0;
  for (std::size_t i = 0; i < sheet.readings.size(); ++i) {
    if (sheet.predicted[i]) most = std::max(most, std::abs(now[sheet.readings[i].step] - *sheet.predicted[i]));
  }
  return most > kSame ? most : 0.0;
}

Result<Told> tell(const Context& context, const Options& o, const Job& job, const Sheet& sheet) {
  Told out;
  const auto progress = progress_line(context, "finding the product of force and compliance");
  POLYPOD_ASSIGN(fit, machining::fit_test_cut(job, sheet.cut, sheet.readings, progress));
  progress(1);
  out.fit = std::move(fit);
  POLYPOD_ASSIGN(other_job, off_the_sheet(job, sheet));
  out.other_job = other_job;
  if (!o.displacements.empty()) {
    POLYPOD_ASSIGN(read, statics::read_displacements(o.displacements));
    POLYPOD_ASSIGN(compliance, machining::compliance_factor(job, read.points));
    if (!out.fit.no && !(compliance.value > 2 * compliance.uncertainty)) {
      out.fit.no = fmt::format(
          "the displacements under known forces are {:.2g} times those of the job's machine, with a standard "
          "uncertainty of {:.2g}: its compliance is not identifiable from them",
          compliance.value, compliance.uncertainty);
      return out;
    }
    out.compliance = compliance;
  }
  const machining::Separated parts = machining::separated(out.fit.product, out.compliance, job.factors);
  if (out.compliance) out.force = parts.force;
  out.factors = parts.factors;
  return out;
}

std::string answer(const Told& t) {
  if (t.fit.no) return "no: " + *t.fit.no;
  const Factor& p = t.fit.product;
  const bool same = std::abs(p.value - 1) < 2 * p.uncertainty;
  return fmt::format("yes: the tool deflects {:.2f} times as much as the job predicts{}{}", p.value,
                     same ? ", which is 1 within its uncertainty" : "",
                     t.other_job > 0 ? "; the job is not as it was when the sheet was written" : "");
}

Json answer_json(const Told& t, const Sheet& sheet) {
  const TestCutFit& fit = t.fit;
  Json sizes = Json::array();
  for (std::size_t i = 0; i < sheet.readings.size(); ++i) {
    const TestCutReading& r = sheet.readings[i];
    const TestCutStep& step = sheet.cut.steps[r.step];
    sizes.push_back({{"axis", std::string(1, step.axis)},
                     {"width_mm", to_mm(step.width)},
                     {"nominal_mm", to_mm(step.nominal)},
                     {"measured_mm", to_mm(r.size)},
                     {"sigma_um", to_um(r.sigma)},
                     {"residual_before_um", to_um(fit.before[i])},
                     {"residual_after_um", to_um(fit.after[i])}});
  }
  const bool told = !fit.no;
  return {{"told", told},
          {"answer", answer(t)},
          {"product", factor_json(fit.product)},
          {"force", t.force ? factor_json(*t.force) : Json()},
          {"compliance", t.compliance ? factor_json(*t.compliance) : Json()},
          {"diameter_error_um",
           {{"value", to_um(fit.diameter.value)}, {"standard_uncertainty", to_um(fit.diameter.uncertainty)}}},
          {"rms_before_um", to_um(fit.rms_before)},
          {"rms_after_um", to_um(fit.rms_after)},
          {"chi_squared", fit.chi_squared},
          {"chi_squared_99", fit.chi_squared_99},
          {"degrees_of_freedom", fit.freedom},
          {"off_the_sheet_um", to_um(t.other_job)},
          {"sizes", sizes},
          {"factors", told ? Json{{"force", t.factors.force},
                                  {"force_uncertainty", t.factors.force_uncertainty},
                                  {"compliance", t.factors.compliance}}
                           : Json()}};
}

void print_answer(const Told& t, const Sheet& sheet) {
  const TestCutFit& fit = t.fit;
  fmt::print("  axis  width of cut mm  nominal mm  measured mm   off um: by the job   with the factor\n");
  for (std::size_t i = 0; i < sheet.readings.size(); ++i) {
    const TestCutReading& r = sheet.readings[i];
    const TestCutStep& step = sheet.cut.steps[r.step];
    fmt::print("  {:<4}  {:>15.3f}  {:>10.3f}  {:>11.4f}  {:>18.1f}  {:>16.1f}\n", step.axis, to_mm(step.width),
               to_mm(step.nominal), to_mm(r.size), to_um(fit.before[i]), to_um(fit.after[i]));
  }
  fmt::print(
      "sizes       {:.1f} um rms off by the job, {:.1f} um with the factor (chi-squared {:.1f}; one factor "
      "explains up to {:.1f})\n",
      to_um(fit.rms_before), to_um(fit.rms_after), fit.chi_squared, fit.chi_squared_99);
  fmt::print("product     {:.3f}, standard uncertainty {:.3f}\n", fit.product.value, fit.product.uncertainty);
  if (t.compliance) {
    fmt::print("compliance  {:.3f}, standard uncertainty {:.3f}\n", t.compliance->value, t.compliance->uncertainty);
    fmt::print("forces      {:.3f}, standard uncertainty {:.3f}\n", t.force->value, t.force->uncertainty);
  }
  fmt::print("cutter      {:+.0f} um larger than in the job, standard uncertainty {:.0f} um\n",
             to_um(fit.diameter.value), to_um(fit.diameter.uncertainty));
  fmt::print("{}\n", answer(t));
  if (t.other_job > 0) {
    fmt::print(
        "note: the job predicts sizes up to {:.1f} um off the predicted_mm of the sheet: another machine, material or "
        "place than when the program was written. The factor is that of the job as it is now\n",
        to_um(t.other_job));
  }
  if (!t.fit.no && !t.compliance) {
    fmt::print(
        "note: sizes give the product alone; it is written as the factor of the forces. Deflections follow from "
        "it, forces only as far as the compliances of the job are right\n");
  }
}

Result<int> evaluate(const Context& context, const Options& o) {
  POLYPOD_TRY(refuse(context, {"--feed", "--speed", "--depth", "--widths", "--center", "--tool", "--sheet"},
                     "it serves the program; the sheet says how the boss was cut"));
  std::vector<std::string> inputs = o.displacements;
  inputs.insert(inputs.end(), {o.job, o.measured});
  POLYPOD_TRY(check_files(inputs, {o.output}, context.json));
  namespace fs = std::filesystem;
  std::error_code ec;
  const auto folder = [&](const std::string& file) {
    return fs::weakly_canonical(fs::absolute(file), ec).parent_path();
  };
  if (!files::is_standard_output(o.output) && folder(o.output) != folder(o.job)) {
    return fail("AP264", "the new job in another folder than " + o.job + ": the files that it names are beside that",
                {o.output}, "write it beside the job");
  }
  POLYPOD_ASSIGN(job, machining::read_job(o.job));
  if (job.measured && !o.displacements.empty()) {
    return fail("AP265", "--displacements, and the job takes its compliance from measured displacements already",
                {o.job}, "leave one of both out");
  }
  POLYPOD_ASSIGN(sheet, read_sheet(job, o.measured, units::from_um(o.sigma_um)));
  POLYPOD_ASSIGN(told, tell(context, o, job, sheet));
  const bool writes = !told.fit.no;
  if (writes) {
    POLYPOD_ASSIGN(text, files::read(o.job));
    const std::string remark = fmt::format(
        "Test cut {}: product of force and compliance {:.4g}, standard uncertainty {:.2g}, from {} sizes;\n{}",
        one_line(fs::path(o.measured).filename().string()), told.fit.product.value, told.fit.product.uncertainty,
        sheet.readings.size(),
        told.compliance ? "compliance from displacements under known forces."
                        : "not separated: the whole of it stands as the factor of the forces.");
    POLYPOD_TRY(files::write_whole(o.output, machining::with_factors(text, told.factors, remark)));
  }
  if (context.json) {
    print_json(answer_json(told, sheet));
  } else {
    print_answer(told, sheet);
    if (writes) fmt::print("wrote {}\n", one_line(o.output));
  }
  return writes ? kDone : kAnswerIsNo;
}

}  // namespace

Command testcut_command() {
  auto o = std::make_shared<Options>();
  return {"testcut", "A test cut whose measured sizes tell how much the tool deflects, and the job that results",
          "polypod testcut --job job.toml --feed 1600 --speed 8000 -o testcut.ngc --sheet testcut.csv",
          [o](Arguments& a) {
            a.option("--job", o->job, "The job file: machine, place of the part, cutter, material", true);
            a.option("-o,--output", o->output, "The program; with --measured the new job, beside the old one", true);
            a.option("--sheet", o->sheet, "A table of the sizes to measure (CSV), for --measured");
            a.option("--feed", o->feed, {1, 1e5}, "Feed, mm/min");
            a.option("--speed", o->speed, {1, 1e6}, "Spindle speed, rev/min, clockwise");
            a.option("--depth", o->depth, {1e-3, 1e3}, "Axial depth, mm (default: a quarter of the diameter)");
            a.option("--widths", o->widths,
                     "Widths of the finishing cut, mm, rising (default: 0.05, 0.2 and 0.5 of the diameter)");
            a.option("--center", o->center, "x,y of the middle of the boss in G54, mm (default: 0,0)");
            a.option("--tool", o->tool, {0, 1e5}, "T number of the cutter (default: none, [cutter] of the job)");
            a.option("--measured", o->measured, "The filled sheet: find the factors in place of writing a program");
            a.options("--displacements", o->displacements,
                      "Displacements of the tool under known forces (files of identify compliance): they separate "
                      "compliance and forces");
            a.option("--sigma-um", o->sigma_um, {1e-3, 1e4},
                     "Standard uncertainty of a size where the sheet says none, um (default: 5)");
          },
          [o](const Context& context) -> Result<int> {
            if (!o->measured.empty()) return evaluate(context, *o);
            POLYPOD_TRY(refuse(context, {"--displacements", "--sigma-um"}, "it serves --measured"));
            return write_program(context, *o);
          }};
}

}  // namespace polypod::app
