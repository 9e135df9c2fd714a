// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <memory>
#include <optional>
#include <tuple>

#include "calibrate_output.hpp"
#include "calibration_options.hpp"
#include "certificate_output.hpp"
#include "commands.hpp"
#include "machine_file.hpp"
#include "messages.hpp"
#include "polypod/calibration/calibrate.hpp"
#include "polypod/core/csv.hpp"
#include "polypod/core/files.hpp"
#include "polypod/core/units.hpp"
#include "polypod/pages/calibration.hpp"
#include "quality_files.hpp"

namespace polypod::app {

Result<Pose> frame_argument(const std::string& text, const char* option) {
  if (text.empty()) return Pose{};
  POLYPOD_ASSIGN(n, numbers_of(text, option));
  if (n.size() != 3 && n.size() != 6) {
    return fail("AP180", fmt::format("{} {}: not three or six numbers", option, text), {}, "x,y,z or x,y,z,A,B,C");
  }
  n.resize(6, 0);
  return Pose{rotation_abc(units::from_deg(n[3]), units::from_deg(n[4]), units::from_deg(n[5])),
              units::from_mm(1) * Vec3(n[0], n[1], n[2])};
}

Result<std::vector<Vec3>> points_of(const std::vector<std::string>& texts, const char* option) {
  std::vector<Vec3> out;
  for (const std::string& text : texts) {
    POLYPOD_ASSIGN(n, numbers_of(text, option));
    if (n.size() != 3) return fail("AP180", fmt::format("{} {}: not three numbers", option, text));
    out.push_back(units::from_mm(1) * Vec3(n[0], n[1], n[2]));
  }
  return out;
}

namespace {

using calibration::Calibration;

constexpr std::array<std::pair<std::string_view, calibration::Loss>, 4> kLosses{{{"auto", calibration::Loss::automatic},
                                                                                 {"huber", calibration::Loss::huber},
                                                                                 {"cauchy", calibration::Loss::cauchy},
                                                                                 {"none", calibration::Loss::none}}};

struct Options {
  std::string machine, out, frame, target, residuals, covariance, targets, corrected, report, join, certificate,
      certificate_report, loss = "auto";
  std::vector<std::string> sets, files, estimate, only, hold, columns;
  double noise_um = 20, noise_deg = 0.002, prior_mm = 0, prior_deg = 0, bound_mm = 0, bound_deg = 0, hold_back = 20;
};

Result<calibration::CalibrationOptions> options_of(const Options& o) {
  calibration::CalibrationOptions out;
  out.only = o.only;
  out.hold = o.hold;
  for (const std::string& what : o.estimate) {
    if (what != "frame" && what != "target" && what != "scale") {
      return fail("AP183", fmt::format("--estimate {}: not frame, target or scale", what));
    }
    (what == "frame" ? out.estimate_frame : what == "target" ? out.estimate_target : out.estimate_scale) = true;
  }
  const auto* loss = std::find_if(kLosses.begin(), kLosses.end(), [&](const auto& l) { return l.first == o.loss; });
  if (loss == kLosses.end()) return fail("AP183", fmt::format("--loss {}: not auto, huber, cauchy or none", o.loss));
  out.loss = loss->second;
  POLYPOD_ASSIGN(X_SM, frame_argument(o.frame, "--frame"));
  POLYPOD_ASSIGN(X_TR, frame_argument(o.target, "--target"));
  out.X_SM = X_SM;
  out.X_TR = X_TR;
  constexpr double kMost_mm = 1e9, kMost_deg = 5e7;  // what calibrate() takes at most
  POLYPOD_TRY(in_range("CA116", "--noise-um", o.noise_um, {0, 1e3 * kMost_mm, true}, "um"));
  POLYPOD_TRY(in_range("CA116", "--noise-deg", o.noise_deg, {0, kMost_deg, true}, "deg"));
  POLYPOD_TRY(in_range("CA116", "--prior-mm", o.prior_mm, {0, kMost_mm}, "mm"));
  POLYPOD_TRY(in_range("CA116", "--prior-deg", o.prior_deg, {0, kMost_deg}, "deg"));
  POLYPOD_TRY(in_range("CA116", "--bound-mm", o.bound_mm, {0, kMost_mm}, "mm"));
  POLYPOD_TRY(in_range("CA116", "--bound-deg", o.bound_deg, {0, kMost_deg}, "deg"));
  POLYPOD_TRY(in_range("CA116", "--validation", o.hold_back, {0, 50}, "%"));
  out.noise_position = units::from_um(o.noise_um);
  out.noise_angle = units::from_deg(o.noise_deg);
  out.prior_length = units::from_mm(o.prior_mm);
  out.prior_angle = units::from_deg(o.prior_deg);
  out.bound_length = units::from_mm(o.bound_mm);
  out.bound_angle = units::from_deg(o.bound_deg);
  out.hold_back = o.hold_back / 100;
  return out;
}

/// Errors: AP107 where an option about angles stands with rows or a machine that have none.
Status check_angles(const Context& context, const machine::AnyMachine& m,
                    const std::vector<calibration::Measurement>& rows) {
  using calibration::Kind;
  if (std::none_of(rows.begin(), rows.end(),
                   [](const auto& r) { return r.kind == Kind::axis || r.kind == Kind::pose; }))
    POLYPOD_TRY(refuse(context, {"--noise-deg"}, "it serves axes and poses; these rows hold no angle"));
  const std::vector<machine::Parameter> parameters = kinematics::parameters(m);
  if (std::all_of(parameters.begin(), parameters.end(), [](const auto& p) { return p.unit == "mm"; }))
    POLYPOD_TRY(refuse(context, {"--prior-deg", "--bound-deg"},
                       "it serves machines with angles or directions; all parameters of this one are lengths"));
  return {};
}

/// What the files hold.
struct ReadRows {
  std::vector<calibration::Measurement> rows;
  std::vector<std::string> unused_columns, not_joined;
};

Result<ReadRows> rows_of(const Options& o, const machine::AnyMachine& m) {
  ReadRows out;
  POLYPOD_ASSIGN(columns, csv::columns_of(o.columns));
  std::vector<csv::Table> tables;
  for (const std::string& file : o.files) {
    POLYPOD_ASSIGN(table, csv::read(file, columns, o.join.empty() ? csv::Absent::refused : csv::Absent::left));
    tables.push_back(std::move(table));
  }
  if (!o.join.empty()) {
    POLYPOD_ASSIGN(one, csv::joined(tables, o.join, out.not_joined));
    tables = {std::move(one)};
  }
  for (const csv::Table& table : tables) {
    auto more = calibration::read_measurements(m, table);
    if (!more && more.error().id == "CA101" && !o.join.empty()) {
      Error error = std::move(more.error());
      error.message = fmt::format("no column of {} says what was measured", fmt::join(o.files, " or "));
      error.place = {};
      error.hint += "; `--columns x_mm=NAME` tells which column is which";
      return tl::unexpected(std::move(error));
    }
    if (!more) return tl::unexpected(std::move(more.error()));
    out.rows.insert(out.rows.end(), std::make_move_iterator(more->begin()), std::make_move_iterator(more->end()));
    POLYPOD_ASSIGN(unused, table.unused());
    for (std::string& name : unused) {
      const bool known =
          std::find(out.unused_columns.begin(), out.unused_columns.end(), name) != out.unused_columns.end();
      if (!known && name != o.join) out.unused_columns.push_back(std::move(name));
    }
  }
  return out;
}

/// What went into the calibration.
Result<std::vector<pages::HashedFile>> hashes_of(const Options& o, const machine::AnyMachine& nominal) {
  std::vector<pages::HashedFile> out;
  std::vector<std::pair<std::string, std::string>> inputs{{"machine, drawing", o.machine}};
  for (const std::string& file : o.files) inputs.emplace_back("readings", file);
  if (!o.certificate.empty()) inputs.emplace_back("statement", o.certificate);
  for (const auto& [role, path] : inputs) {
    POLYPOD_ASSIGN(one, hashed_file(role, path));
    out.push_back(std::move(one));
  }
  if (!o.sets.empty()) out.push_back(hashed_bytes("drawing with --set", o.machine, machine::to_toml(nominal)));
  return out;
}

std::vector<std::string> notes_of(const ReadRows& read, const std::string& join) {
  constexpr std::size_t kMost = 8;
  std::vector<std::string> notes;
  if (!read.unused_columns.empty()) {
    notes.push_back(fmt::format("not read: the columns {}", fmt::join(read.unused_columns, ", ")));
  }
  if (const std::size_t n = read.not_joined.size(); n > 0) {
    const std::vector<std::string> first(read.not_joined.begin(), read.not_joined.begin() + long(std::min(n, kMost)));
    notes.push_back(fmt::format("left out, as not all files have this {}: {}{}", join, fmt::join(first, ", "),
                                n > kMost ? fmt::format(" and {} more", n - kMost) : ""));
  }
  return notes;
}

/// Poses of a file (x_mm, y_mm, z_mm and the angles of the task) as commands for the nominal machine.
Result<std::string> corrected_targets(const machine::AnyMachine& nominal, const machine::AnyMachine& real,
                                      const std::string& path, std::size_t& missed) {
  POLYPOD_ASSIGN(table, csv::read(path));
  POLYPOD_TRY(table.needs({"x_mm", "y_mm", "z_mm"}));
  std::string out = "x_mm,y_mm,z_mm,a_deg,b_deg,c_deg";
  for (int i = 0; i < kinematics::joint_count(nominal); ++i) out += fmt::format(",q{}", i + 1);
  out += ",reached\n";
  for (const csv::Table::Row& row : table.rows) {
    std::vector<double> c;
    for (const char* name : {"x_mm", "y_mm", "z_mm", "a_deg", "b_deg", "c_deg"}) {
      POLYPOD_ASSIGN(value, table.number(row, name, 0));
      c.push_back(c.size() < 3 ? units::from_mm(value) : units::from_deg(value));
    }
    const Pose wanted = kinematics::pose_of(kinematics::task(nominal), c);
    const calibration::CorrectedTarget found = calibration::corrected_target(nominal, real, wanted);
    std::vector<double> numbers = pose_for_user(nominal, found.reached ? found.command : wanted);
    numbers.resize(6, 0);
    for (std::size_t i = 0; i < numbers.size(); ++i) out += fmt::format("{}{:.6f}", i == 0 ? "" : ",", numbers[i]);
    for (int i = 0; i < kinematics::joint_count(nominal); ++i) {
      out += found.reached ? fmt::format(",{:.6f}", joints_for_user(nominal, found.joints)[std::size_t(i)]) : ",";
    }
    out += found.reached ? ",1\n" : ",0\n";
    missed += found.reached ? 0 : 1;
  }
  return out;
}

}  // namespace

Command calibrate_command() {
  auto o = std::make_shared<Options>();
  return {
      "calibrate", "The parameters of a machine from measured poses, points, distances, gauge readings or contacts",
      "polypod calibrate hexapod-strut data.csv -o measured.toml",
      [o](Arguments& a) {
        declare_machine(a, o->machine, o->sets);
        a.positional("DATA", o->files,
                     "CSV files: q1,...,qn and x_mm,y_mm,z_mm[,a_deg,b_deg[,c_deg]], "
                     "distance_mm,anchor_x_mm,..., gauge_mm,plane_x_mm,...,normal_x,... or contact");
        a.option("-o,--output", o->out, "The calibrated machine, as a machine file", true);
        a.option("--estimate", o->estimate,
                 "frame, target, scale: find where the machine stands in the instrument's "
                 "frame, where the target sits on the tool, the instrument's scale (repeatable)");
        a.option("--frame", o->frame, kFrameHelp);
        a.option("--target", o->target, kTargetHelp);
        a.option("--parameter", o->only,
                 "Beginning of a key: identify these only; the others stay as uncertain as before (repeatable)");
        a.option("--fix", o->hold,
                 "Beginning of a key: keep these fixed: they are exact, or linearly dependent on what is estimated, "
                 "which takes their errors (repeatable)");
        a.option("--noise-um", o->noise_um, "Of the instrument, each coordinate (default 20)");
        a.option("--noise-deg", o->noise_deg, "Of the instrument, each angle (default 0.002)");
        a.option("--prior-mm", o->prior_mm,
                 "Lengths are off by about this much (default: 0.1, corrected by what the data show)");
        a.option("--prior-deg", o->prior_deg, "... angles and directions (default: 0.05, likewise)");
        a.option("--bound-mm", o->bound_mm, "Lengths are off by no more than this (default: no bound)");
        a.option("--bound-deg", o->bound_deg, "... angles and directions");
        a.option(
            "--loss", o->loss,
            "What outliers count for: huber, cauchy, none, or auto (default: huber, and cauchy where that leaves less "
            "than half)");
        a.option("--validation", o->hold_back,
                 "Validation set: percent of the poses by which a fit of the others is judged, where enough are left "
                 "(default 20, 0 to 50)");
        declare_columns(a, o->columns);
        a.option("--join", o->join,
                 "A column by which the files are joined, as a name of points: one has the joints, the others what was "
                 "measured");
        a.option("--residuals", o->residuals, "Every row before and after, with signs, CSV");
        a.option("--covariance", o->covariance, "Covariance of the parameters, with their names, CSV");
        a.option("--report", o->report, "An HTML page: residuals, parameters and how sure they are");
        a.option("--certificate", o->certificate,
                 "Who measured what, when and with which instrument, and its systematic parts, TOML");
        a.option(
            "--certificate-report", o->certificate_report,
            "A certificate, HTML to print: results, uncertainty budget, validity; open lines for what is not given");
        a.option("--targets", o->targets, "Poses that the real machine shall take, CSV: x_mm,y_mm,z_mm,a_deg,...");
        a.option("--corrected", o->corrected, "What to ask the nominal controller for, CSV");
      },
      [o](const Context& context) -> Result<int> {
        POLYPOD_ASSIGN(m, machine_of(o->machine, o->sets));
        POLYPOD_ASSIGN(options, options_of(*o));
        if (o->targets.empty() != o->corrected.empty()) {
          return fail("AP183", "--targets and --corrected go together");
        }
        std::vector<std::string> inputs = o->files;
        inputs.insert(inputs.end(), {o->machine, o->targets, o->certificate});
        POLYPOD_TRY(check_files(inputs,
                                {o->out, o->residuals, o->covariance, o->corrected, o->report, o->certificate_report},
                                context.json));
        calibration::Statement statement;
        if (!o->certificate.empty()) {
          POLYPOD_ASSIGN(stated, calibration::read_statement(o->certificate));
          statement = std::move(stated);
          options.systematic = statement.systematic;
        }
        POLYPOD_ASSIGN(read, rows_of(*o, m));
        const std::vector<calibration::Measurement>& rows = read.rows;
        POLYPOD_TRY(calibration::no_row_twice(rows));
        POLYPOD_TRY(check_angles(context, m, rows));
        const bool stated = context.given("--noise-um") ||
                            std::all_of(rows.begin(), rows.end(), [](const auto& r) { return r.noise > 0; });
        if (const auto no = refused_as_singular(m, context, {"parameters", "rank"})) return *no;
        POLYPOD_ASSIGN(c, calibration::calibrate(m, rows, options));
        const bool good = c.verdict.answer != calibration::Answer::no;
        std::size_t missed = 0;
        std::string corrected;
        if (good && !o->targets.empty()) {
          POLYPOD_ASSIGN(text, corrected_targets(m, c.machine, o->targets, missed));
          corrected = text;
        }
        const std::string covariance =
            o->covariance.empty() ? ""
                                  : statics::covariance_csv(calibration::keyed_parameters(c.machine), c.covariance);
        const pages::HashedFile covariance_hash = hashed_bytes("covariance", o->covariance, covariance);
        machine::note(c.machine, "uncertainty",
                      uncertainty_note(c, o->covariance.empty() ? nullptr : &covariance_hash));
        const std::string calibrated = machine_file(c.machine, o->machine);
        std::optional<pages::Certificate> certificate;
        if (!o->certificate.empty() || !o->certificate_report.empty()) {
          POLYPOD_ASSIGN(hashes, hashes_of(*o, m));
          if (good) hashes.push_back(hashed_bytes("machine, calibrated", o->out, calibrated));
          if (good && !o->covariance.empty()) hashes.push_back(covariance_hash);
          certificate = certificate_of(m, rows, c, options, statement, stated);
          certificate->files = std::move(hashes);
          certificate->version = POLYPOD_VERSION;
          certificate->command = command_line();
        }
        // A machine that is no better than its drawing is not written; what shows why it is not, is.
        files::Outputs together;
        std::vector<std::string> written;
        const auto write = [&](const std::string& path, const auto& text) -> Status {
          if (path.empty()) return {};
          written.push_back(path);
          return together.add(path, text());
        };
        if (good) {
          POLYPOD_TRY(write(o->out, [&] { return calibrated; }));
          POLYPOD_TRY(write(o->corrected, [&] { return corrected; }));
          POLYPOD_TRY(write(o->covariance, [&] { return covariance; }));
        }
        POLYPOD_TRY(write(o->residuals, [&] { return residuals_csv(c, rows); }));
        POLYPOD_TRY(write(o->report, [&] {
          return pages::calibration_page(m, rows, c, {POLYPOD_VERSION, command_line()});
        }));
        POLYPOD_TRY(write(o->certificate_report, [&] { return pages::certificate_page(m, rows, c, *certificate); }));
        POLYPOD_TRY(together.commit());
        std::vector<std::string> notes = notes_of(read, o->join);
        for (std::string& note : notes_of(statement)) notes.push_back(std::move(note));
        if (context.json) {
          Json document = calibration_json(m, c, rows, stated);
          document.update({{"unused_columns", read.unused_columns},
                           {"not_joined", read.not_joined},
                           {"notes", notes},
                           {"systematic", systematic_json(c, options.systematic)},
                           {"certificate", certificate ? certificate_json(*certificate) : Json()},
                           {"file", good ? o->out : ""}});
          if (!o->corrected.empty()) document["targets_missed"] = missed;
          print_json(document);
        } else {
          print_calibration(c, rows, stated, options.systematic);
          for (const std::string& note : notes) fmt::print("note: {}\n", note);
          for (const std::string& path : written) fmt::print("wrote {}\n", path);
          if (!good) fmt::print("not written: {}\n", o->out);
          if (missed > 0) fmt::print("{} of the targets are out of the nominal machine's reach\n", missed);
        }
        return missed > 0 || !good ? kAnswerIsNo : kDone;
      }};
}

}  // namespace polypod::app
