// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "report_command.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <filesystem>
#include <memory>

#include "busy_line.hpp"
#include "interrupt.hpp"
#include "messages.hpp"
#include "polypod/core/files.hpp"
#include "polypod/core/units.hpp"
#include "polypod/kinematics/any_machine.hpp"
#include "polypod/pages/folder.hpp"
#include "polypod/pages/machine_report.hpp"
#include "quality_files.hpp"
#include "survey_options.hpp"

namespace polypod::app {
namespace {

namespace fs = std::filesystem;

struct Options {
  std::string subject, output;
  std::vector<std::string> sets, errors, tolerances;
  double noise_um = 20;
  SurveyArguments where;
};

constexpr config::Range kNoise_um{1e-3, 1e6};

/// Whether a machine of the catalogue has the name of a folder.
bool in_catalogue(const std::string& name) {
  const auto& all = machine::catalogue();
  return std::any_of(all.begin(), all.end(), [&](const auto& entry) { return entry.name == name; });
}

Result<int> of_folder(const Options& o, const Context& context) {
  const std::string output = o.output.empty() ? (fs::path(o.subject) / "index.html").string() : o.output;
  const fs::path place = fs::path(output).has_parent_path() ? fs::path(output).parent_path() : fs::path(".");
  std::error_code none;
  if (!files::is_standard_output(output) && fs::is_directory(place, none) && !fs::equivalent(place, o.subject, none)) {
    return fail("VW133", fmt::format("{} does not lie in {}: its links would lead nowhere", output, o.subject), {},
                "give -o a name in that folder");
  }
  auto index = pages::folder_page(o.subject, fs::path(output).filename().string(), POLYPOD_VERSION);
  if (!index && in_catalogue(o.subject)) {
    index.error().hint += fmt::format(
        "; for the machine {0} of the catalogue write it to a file first: polypod info {0} -o "
        "{0}.toml",
        o.subject);
  }
  POLYPOD_ASSIGN(found, std::move(index));
  POLYPOD_TRY(check_files({}, {output}, context.json));
  if (!files::is_standard_output(output)) {
    POLYPOD_TRY(pages::may_be_index(output));
  }
  POLYPOD_TRY(files::write_whole(output, found.html));
  if (context.json) {
    print_json({{"output", output}, {"pages", found.pages}, {"others", found.others}});
  } else {
    fmt::print("{}: {} page{} of results, {} other file{}\n", output, found.pages.size(),
               found.pages.size() == 1 ? "" : "s", found.others.size(), found.others.size() == 1 ? "" : "s");
  }
  return kDone;
}

/// "hexapod-strut.html" of "hexapod-strut" and of "machines/hexapod-strut.toml".
std::string page_name(const std::string& machine) {
  return fs::path(machine).stem().string() + ".html";
}

Result<int> of_machine(const Options& o, const Context& context) {
  auto loaded = machine_of(o.subject, o.sets);
  if (!loaded && loaded.error().id == "MA100") loaded.error().message += "; nor is there such a folder";
  POLYPOD_ASSIGN(m, std::move(loaded));
  const std::string output = o.output.empty() ? page_name(o.subject) : o.output;
  POLYPOD_TRY(check_files({o.subject}, {output}, context.json));
  if (o.output.empty()) POLYPOD_TRY(pages::may_be_page(output));
  pages::MachineReportOptions page;
  page.assumed = o.errors.empty() && o.tolerances.empty();
  page.given = !o.errors.empty()       ? o.errors
               : !o.tolerances.empty() ? o.tolerances
                                       : std::vector<std::string>{"all=0.01"};
  POLYPOD_ASSIGN(sizes, sizes_argument(m, o.errors, o.errors.empty() ? page.given : o.tolerances));
  page.question.tolerances = o.errors.empty();
  page.question.sizes = std::move(sizes);
  POLYPOD_ASSIGN(survey, o.where.options(m, context));
  survey.progress = nullptr;  // the page says itself how far it is
  page.survey = std::move(survey);
  constexpr int kLeast = 8;  // of a section
  if (context.given("--resolution")) page.resolution = page.resolution_in_space = std::max(kLeast, o.where.resolution);
  page.noise_position = units::from_um(o.noise_um);
  page.version = POLYPOD_VERSION;
  page.command = command_line();
  page.machine = o.subject;
  page.sets = o.sets;
  std::string current;
  std::function<bool(double)> line;
  std::unique_ptr<BusyLine> busy;  // until the first share of a stage is done
  page.progress = [&](const char* what, double share) {
    if (what != current) {
      current = what;
      line = progress_line(context, what);
      busy = std::make_unique<BusyLine>(context, what);
    }
    if (!(share > 0)) return;
    busy.reset();
    line(share);
  };
  const SingularNote singular(m, context);
  POLYPOD_ASSIGN(made, pages::machine_report(m, page));
  busy.reset();
  if (interrupted()) return kBadInput;
  POLYPOD_TRY(files::write_whole(output, made.html));
  if (context.json) {
    Json parts = Json::array();
    for (const pages::ReportPart& part : made.parts) {
      parts.push_back({{"part", part.name}, {"judged", part.reason.empty()}, {"reason", part.reason}});
    }
    const pages::ReportFigures& f = made.figures;
    Json figures{{"position_error_mm", number_json(units::to_mm(f.error))},
                 {"condition", number_json(f.condition)},
                 {"compliance_um_per_N", number_json(f.compliance)},
                 {"calibrated_um", number_json(units::to_um(f.calibrated))}};
    if (kinematics::task(m).places()) {
      for (const auto& [key, value] : {std::pair{"volume_mm3", f.volume[0]}, std::pair{"volume_lower_mm3", f.volume[1]},
                                       std::pair{"volume_upper_mm3", f.volume[2]}})
        figures[key] = number_json(units::to_mm3(value));
    } else {
      const Region region = region_of(kinematics::task(m), f.volume[0], f.volume[1], f.volume[2]);
      figures.update(measure_json(kinematics::task(m), region));
    }
    print_json(
        singular.in({{"output", output}, {"machine", machine::name_of(m)}, {"parts", parts}, {"figures", figures}}));
    return kDone;
  }
  std::string judged;
  for (const pages::ReportPart& part : made.parts)
    if (part.reason.empty()) judged += (judged.empty() ? "" : ", ") + part.name;
  fmt::print("{}: {}\n", output, judged.empty() ? "the machine alone" : judged);
  if (made.figures.volume[2] == 0) fmt::print("workspace: no point is reached as was asked; this is proven\n");
  for (const pages::ReportPart& part : made.parts)
    if (!part.reason.empty()) fmt::print("not judged, {}: {}\n", part.name, part.reason);
  return kDone;
}

}  // namespace

Command report_command() {
  auto o = std::make_shared<Options>();
  return {"report", "One page of a machine with every question, or an index of the pages of a folder",
          "polypod report hexapod-strut --tilt 20 -o hexapod.html",
          [o](Arguments& a) {
            a.positional("SUBJECT", o->subject,
                         "A folder of results (those within it are not searched), or else a machine file or a name of "
                         "`polypod machines`");
            a.option("-o,--output", o->output, "The page (default: DIR/index.html, or the machine's name with .html)");
            a.option("--set", o->sets, "key=value: override a parameter of the machine (repeatable)");
            a.option("--tolerance", o->tolerances,
                     "KEY=mm (angles deg): of a machine's elements (repeatable, default all=0.01)");
            a.option("--error", o->errors, "KEY=mm (angles deg): a known error instead (repeatable)");
            a.option("--noise-um", o->noise_um, kNoise_um,
                     "Of positions measured for a calibration, each coordinate (default 20)");
            a.option("--rel-tol", o->where.workspace.rel_tol,
                     "Gap between the bounds as a fraction of the volume, 1e-6 to 1 (default 0.01)");
            o->where.declare_region(a);
          },
          [o](const Context& context) -> Result<int> {
            std::error_code none;
            if (!fs::is_directory(o->subject, none)) return of_machine(*o, context);
            POLYPOD_TRY(refuse(context,
                               {"--set", "--tolerance", "--error", "--noise-um", "--rel-tol", "--box", "--resolution",
                                "--tilt", "--a-range", "--b-range", "--interference", "--without",
                                "--singularity-distance", "--max-memory", "--threads"},
                               "it serves the page of a machine, and this is a folder"));
            return of_folder(*o, context);
          }};
}

}  // namespace polypod::app
