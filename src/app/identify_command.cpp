// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <filesystem>
#include <memory>

#include "certificate_output.hpp"
#include "commands.hpp"
#include "covariance_files.hpp"
#include "machine_file.hpp"
#include "measured_problems.hpp"
#include "messages.hpp"
#include "polypod/calibration/certificate.hpp"
#include "polypod/core/files.hpp"
#include "polypod/core/units.hpp"
#include "polypod/cutting/identify.hpp"
#include "polypod/cutting/plausibility.hpp"
#include "polypod/pages/calibration.hpp"
#include "polypod/statics/covariance.hpp"
#include "polypod/statics/gain.hpp"
#include "polypod/statics/judge.hpp"
#include "polypod/statics/measured_map.hpp"
#include "quality_files.hpp"

namespace polypod::app {
namespace {

std::string note_of(const statics::Identification& r, const std::vector<statics::MeasuredPoint>& points) {
  std::string files;
  for (const statics::MeasuredPoint& point : points) {
    const std::string name = std::filesystem::path(point.place.file).filename().string();
    if (files.find(name) == std::string::npos) files += (files.empty() ? "" : ", ") + name;
  }
  std::string errors;
  for (std::size_t i = 0; i < r.compliance.size(); ++i)
    errors += (errors.empty() ? "" : ", ") +
              (r.told[i] ? fmt::format("{:.3g}", r.standard_error[i]) : std::string("(not identifiable, as it was)"));
  std::string held;
  for (std::size_t i = 0; i < r.compliance.size(); ++i) {
    if (r.upper_bound[i])
      held += fmt::format("; {} is fixed at 0, with an upper bound (95 %) of {:.3g}", r.joint[i], *r.upper_bound[i]);
  }
  return fmt::format("identified from displacements at {} point{} ({}); residual rms {:.1f} um; standard errors {}{}",
                     points.size(), points.size() == 1 ? "" : "s", files, units::to_um(r.residual_rms), errors, held);
}

/// What the machine file says of the uncertainty of its compliances, under [provenance]: their standard uncertainties,
/// and where their covariance is.
std::string uncertainty_note(const statics::Keyed& of, const statics::Identification& r, bool gain,
                             const pages::HashedFile* covariance) {
  std::string each;
  for (std::size_t i = 0; i < of.keys.size(); ++i) {
    const auto k = static_cast<Eigen::Index>(i);
    each += fmt::format("{}{} {:.2g}", each.empty() ? "" : ", ", of.keys[i],
                        std::sqrt(std::max(0.0, r.covariance(k, k))) / of.unit[k]);
  }
  return fmt::format("standard uncertainties, {}: {}{}",
                     gain ? "the gain of forces and displacements included" : "no gain of forces stated", each,
                     covariance == nullptr ? std::string()
                                           : fmt::format("; they hang together as {} says (SHA-256 {})",
                                                         std::filesystem::path(covariance->name).filename().string(),
                                                         covariance->sha256));
}

/// The relative standard uncertainty that forces and displacements have in common: --force-gain-percent, and the parts
/// force_gain and scale of the file. Errors: CA151 for another part, CA116.
Result<double> gain_of(const std::vector<calibration::Systematic>& parts, double percent) {
  double squares = std::pow(percent / 100, 2);
  for (const calibration::Systematic& part : parts) {
    if (part.quantity != calibration::Quantity::force_gain && part.quantity != calibration::Quantity::scale)
      return fail(
          "CA151", fmt::format("an identification of compliances knows no {}", calibration::name_of(part.quantity)),
          part.place, "it knows force_gain, and scale of the displacements; the others serve `polypod calibrate`");
    squares += std::pow(part.standard_uncertainty(), 2);
  }
  return std::sqrt(squares);
}

/// "Yes: ...", "In part: ...", "No: ...".
std::string in_words(const statics::Verdict& verdict) {
  std::string name(statics::name_of(verdict.answer));
  name[0] = static_cast<char>(name[0] - 'a' + 'A');
  return name + ": " + verdict.why;
}

/// Of the machine's provenance.
const char* compliance_key(const statics::Identification& r) {
  if (r.joint.front().rfind("leg", 0) == 0) return "leg compliance";
  return r.joint.front().rfind("drive", 0) == 0 ? "compliance of drives and rods" : "compliance_rad_per_Nm";
}

constexpr std::size_t kLeastHeldOut = 10;  // two points in each of five parts

Json json_of(const statics::Foretold& f) {
  return {{"prediction_rms_um", units::to_um(f.joints)}, {"map_rms_um", f.map ? Json(units::to_um(*f.map)) : Json()}};
}
std::string in_words(const statics::Foretold& f) {
  return fmt::format("{:.1f} um rms", units::to_um(f.joints)) +
         (f.map ? fmt::format(" (a map without joints: {:.1f} um)", units::to_um(*f.map)) : std::string());
}

/// The exit status; where the answer is no, why, and that no machine was written.
int end(const Context& context, const statics::Verdict& verdict, const statics::Judgement& judgement) {
  if (verdict.answer != statics::Verdict::Answer::no) return kDone;
  for (const Error& e : judgement.errors) print_error(context, e);
  fmt::print(stderr, "polypod: these are no compliances of this machine, and no machine file was written\n");
  return kAnswerIsNo;
}

/// What is implausible about the coefficients and about the least and the largest feed.
std::vector<std::string> notes_of(const cutting::Cutter& cutter, const cutting::Material& material,
                                  const std::vector<cutting::MeasuredForce>& rows) {
  const auto [least, largest] = std::minmax_element(
      rows.begin(), rows.end(), [](const auto& a, const auto& b) { return a.feed_per_tooth < b.feed_per_tooth; });
  std::vector<std::string> notes = cutting::plausibility(cutter, material, least->feed_per_tooth, 0);
  for (const std::string& note : cutting::plausibility(cutter, material, largest->feed_per_tooth, 0)) {
    if (std::find(notes.begin(), notes.end(), note) == notes.end()) notes.push_back(note);
  }
  return notes;
}

/// What the coefficients that decide would change, of their size.
std::string in_words(const cutting::RunoutEffect& r, const std::array<double, 6>& value) {
  std::vector<std::string> parts;
  for (const auto& [k, name] : {std::pair<std::size_t, const char*>{0, "Ktc"}, {1, "Krc"}, {3, "Kte"}, {4, "Kre"}})
    if (value[k] != 0) parts.push_back(fmt::format("{} {:.2g} %", name, 100 * r.change[k] / std::abs(value[k])));
  const std::string changes = fmt::format("{}", fmt::join(parts, ", "));
  if (r.given) {
    return fmt::format("A runout of {:g} um (total indicator reading) is in the intervals: it changes up to {}.",
                       units::to_um(r.reading), changes);
  }
  return fmt::format(
      "No runout was given, and none is in the intervals: {:g} um (total indicator reading) would change up to {}. "
      "Measure it at the cutting edges and give --runout-um.",
      units::to_um(r.reading), changes);
}

/// The noise that the intervals rest on.
std::string noise_in_words(const cutting::CuttingIdentification& r) {
  if (r.noise_stated) {
    return fmt::format(
        "rows count by their sigma_N; the residuals are {:.2g} times as large, and the intervals follow "
        "the residuals",
        r.times_stated);
  }
  std::vector<std::string> parts;
  for (std::size_t k = 0; k < 3; ++k)
    parts.push_back(
        fmt::format("F{} {:.2g} N and {:.2g} % of it", "xyz"[k], r.noise[k].constant, 100 * r.noise[k].share));
  return fmt::format("noise by the residuals (standard deviations, added as squares): {}", fmt::join(parts, "; "));
}

std::string in_words(const cutting::LackOfFit& l) {
  return fmt::format(
      "Lack of fit: the forces do not grow in proportion to the chip; with chips to the power {:.2f} the residual rms "
      "across the axis is {:.2f} N instead of {:.2f} N. A size effect, a runout of which teeth miss small feeds, or "
      "wear: "
      "the intervals do not hold, and the coefficients serve the measured feeds alone.",
      l.exponent, l.residual_rms, l.linear_rms);
}

}  // namespace

Command identify_compliance_command() {
  struct Options {
    std::string machine, out, report, certificate, covariance;
    std::vector<std::string> sets, files, columns;
    double noise_um = 0, gain_percent = 0;
  };
  auto o = std::make_shared<Options>();
  return {
      "identify compliance", "Joint compliances from measured displacements of the tip",
      "polypod identify compliance lola50 displacements.csv",
      [o](Arguments& a) {
        declare_machine(a, o->machine, o->sets);
        a.positional("DATA", o->files,
                     "CSV files: x_mm,y_mm,z_mm,force_N,dx_Fx_um,dy_Fx_um,...,dz_Fz_um[,a_deg,b_deg,c_deg]"
                     "[,q1,...,qn][,sigma_um]; Fx_N,Fy_N,Fz_N in place of force_N; blank where not measured");
        a.option(
            "--noise-um", o->noise_um, {1e-6, 1e6},
            "Standard deviation of one displacement, um, which the residual is compared with; the intervals follow "
            "from the residual itself (default: the column sigma_um, else estimated from the asymmetry of the "
            "cross displacements)");
        a.option(
            "--force-gain-percent", o->gain_percent, {0, 100},
            "Standard uncertainty of the force sensor's gain, which is common to all readings (default: not stated)");
        a.option("--certificate", o->certificate,
                 "Systematic parts, TOML: force_gain, and scale of the displacements, with their distributions");
        declare_columns(a, o->columns);
        a.option("-o,--output", o->out, "The machine with these compliances, as a machine file");
        a.option("--covariance", o->covariance,
                 "With -o: covariance of the compliances, with their names, in (rad/Nm)^2 or (um/N)^2, the gain "
                 "included, CSV; for `predict` and `correct`");
        a.option("--report", o->report, "An HTML page: compliances, residuals and how sure they are");
      },
      [o](const Context& context) -> Result<int> {
        POLYPOD_ASSIGN(m, machine_of(o->machine, o->sets));
        std::vector<std::string> inputs = o->files;
        inputs.insert(inputs.end(), {o->machine, o->certificate});
        POLYPOD_TRY(check_files(inputs, {o->out, o->report, o->covariance}, context.json));
        if (o->out.empty())
          POLYPOD_TRY(refuse(context, {"--covariance"}, "it serves the machine file of -o, which names it"));
        calibration::Statement statement;
        if (!o->certificate.empty()) {
          POLYPOD_ASSIGN(stated, calibration::read_statement(o->certificate));
          statement = std::move(stated);
        }
        POLYPOD_ASSIGN(relative, gain_of(statement.systematic, o->gain_percent));
        POLYPOD_ASSIGN(columns, csv::columns_of(o->columns));
        POLYPOD_ASSIGN(read, statics::read_displacements(o->files, columns));
        const std::vector<statics::MeasuredPoint>& points = read.points;
        std::vector<std::vector<statics::MeasuredPoint>> groups;
        for (auto begin = points.begin(); const std::size_t count : read.of_file) {
          groups.emplace_back(begin, begin + std::ptrdiff_t(count));
          begin += std::ptrdiff_t(count);
        }
        POLYPOD_ASSIGN(given_rms, statics::prediction_rms(m, points));
        POLYPOD_ASSIGN(r, statics::identify_compliance(m, points, units::from_um(o->noise_um)));
        const statics::Judgement judgement = statics::judge(m, points);
        const statics::Verdict verdict = statics::verdict_of(r, judgement);
        const statics::GainEffect gain = statics::add_gain(r, relative);
        const bool refused = verdict.answer == statics::Verdict::Answer::no;
        statics::Keyed keyed = statics::keyed_compliances(m);
        keyed.value = Eigen::Map<const Eigen::VectorXd>(r.compliance.data(), std::ssize(r.compliance));
        files::Outputs together;
        if (!o->out.empty() && !refused) {
          const std::string covariance = statics::covariance_csv(keyed, r.covariance);
          const pages::HashedFile hashed = hashed_bytes("covariance", o->covariance, covariance);
          POLYPOD_ASSIGN(found, statics::with_compliances(m, r.compliance));
          // The key whose numbers change, so that an older source of theirs does not stand beside it.
          machine::note(found, compliance_key(r), note_of(r, points));
          machine::note(found, kComplianceUncertainty,
                        uncertainty_note(keyed, r, relative > 0, o->covariance.empty() ? nullptr : &hashed));
          POLYPOD_TRY(together.add(o->out, machine_file(found, o->machine)));
          if (!o->covariance.empty()) POLYPOD_TRY(together.add(o->covariance, covariance));
        }
        pages::ComplianceChecks checks{given_rms, {}, in_words(verdict), verdict.answer};
        Json left_out = Json::array();
        std::vector<statics::Foretold> foretold;
        if (groups.size() > 1) {
          POLYPOD_ASSIGN(each, statics::leave_one_out(m, groups));
          foretold = each;
        }
        for (std::size_t i = 0; i < foretold.size(); ++i) {
          checks.left_out.emplace_back(o->files[i], foretold[i].joints);
          left_out.push_back(json_of(foretold[i]));
          left_out.back()["file"] = o->files[i];
        }
        // Dealt out, where each part leaves enough; a plane left out is the harder question.
        std::optional<statics::Foretold> dealt;
        if (points.size() >= kLeastHeldOut) {
          POLYPOD_ASSIGN(both, statics::hold_out(m, points));
          dealt = both;
        }
        if (!o->report.empty()) {
          POLYPOD_TRY(together.add(
              o->report, pages::identification_page(m, points, r, checks, {POLYPOD_VERSION, command_line()})));
        }
        POLYPOD_TRY(together.commit());
        static constexpr const char* kAxes = "xyz";
        Json alike = Json::array();
        for (const auto& [a, b] : r.hardly_apart)
          alike.push_back({{"joints", {r.joint[std::size_t(a)], r.joint[std::size_t(b)]}},
                           {"correlation", r.correlation[std::size_t(a)][std::size_t(b)]}});
        Json outliers = Json::array();
        for (const statics::Outlier& x : r.outliers) {
          const statics::MeasuredPoint& p = points[x.point];
          outliers.push_back({{"file", p.place.file},
                              {"line", p.place.line},
                              {"displacement", fmt::format("d{}_F{}", kAxes[x.direction], kAxes[x.force_axis])},
                              {"residual_um", units::to_um(x.residual)}});
        }
        if (context.json) {
          // What slides or stretches is given twice: in m/N among all, in um/N of its own.
          Json um_per_N = Json::array(), unit = Json::array(), upper = Json::array();
          for (const std::optional<double>& bound : r.upper_bound) upper.push_back(bound ? Json(*bound) : Json());
          for (std::size_t i = 0; i < r.compliance.size(); ++i) {
            um_per_N.push_back(r.turns[i] ? Json() : Json(units::to_um_per_N(r.compliance[i])));
            unit.push_back(r.turns[i] ? "rad/Nm" : "m/N");
          }
          const bool all_turn = std::find(r.turns.begin(), r.turns.end(), false) == r.turns.end();
          Json document{{"joint", r.joint},
                        {"compliance_rad_per_Nm", r.compliance},
                        {"unit", unit},
                        {"identifiable", r.told},
                        {"standard_error", r.standard_error},
                        {"half_interval_95", r.half_interval},
                        {"gain_standard_uncertainty", relative > 0 ? Json(relative) : Json()},
                        {"standard_error_readings", gain.standard_error_readings},
                        {"standard_error_gain", gain.standard_error_gain},
                        {"upper_bound_95", upper},
                        {"verdict", statics::name_of(verdict.answer)},
                        {"why", verdict.why},
                        {"errors", problems_json(judgement.errors)},
                        {"doubts", problems_json(judgement.doubts)},
                        {"unused_columns", read.unused_columns},
                        {"r_squared", r.explained},
                        {"signal_rms_um", units::to_um(r.signal_rms)},
                        {"noise_um", r.noise_freedoms > 0 ? Json(units::to_um(r.noise)) : Json()},
                        {"noise_stated", r.noise_stated},
                        {"written", !o->out.empty() && !refused},
                        {"residual_rms_um", units::to_um(r.residual_rms)},
                        {"given_rms_um", units::to_um(given_rms)},
                        {"leave_one_out", left_out},
                        {"hold_out", dealt ? json_of(*dealt) : Json()},
                        {"equations", r.equations},
                        {"points", points.size()},
                        {"condition", r.condition},
                        {"correlation", r.correlation},
                        {"covariance", covariance_json(keyed, r.covariance)},
                        {"highly_correlated", alike},
                        {"misfit_um", r.noise_known() ? Json(units::to_um(r.misfit)) : Json()},
                        {"misfit_limit", r.noise_known() ? Json(r.misfit_limit) : Json()},
                        {"asymmetry_rms_um", r.pairs > 0 ? Json(units::to_um(r.asymmetry_rms)) : Json()},
                        {"symmetric", r.pairs > 0 ? Json(r.symmetric) : Json()},
                        {"outliers", outliers}};
          if (!all_turn) document["compliance_um_per_N"] = um_per_N;
          print_json(document);
          return end(context, verdict, judgement);
        }
        fmt::print("{} point{}, {} equations, residual rms {:.1f} um, condition {:.2f}\n\n", points.size(),
                   points.size() == 1 ? "" : "s", r.equations, units::to_um(r.residual_rms), r.condition);
        for (std::size_t i = 0; i < r.compliance.size(); ++i) {
          if (i == 0 || r.turns[i] != r.turns[i - 1]) {
            fmt::print("           {:>11}   95 % interval\n", r.turns[i] ? "1e-7 rad/Nm" : "um/N");
          }
          if (!r.told[i]) {
            fmt::print("{:<10} {:>11.{}f}   not identifiable from these readings: as the machine file has it\n",
                       r.joint[i],
                       r.turns[i] ? units::to_tenth_urad(r.compliance[i]) : units::to_um_per_N(r.compliance[i]),
                       r.turns[i] ? 2 : 5);
          } else if (r.upper_bound[i]) {
            const double bound =
                r.turns[i] ? units::to_tenth_urad(*r.upper_bound[i]) : units::to_um_per_N(*r.upper_bound[i]);
            fmt::print("{:<10} {:>11}   at most {:.{}f} (95 %, one-sided)\n", r.joint[i], "0", bound,
                       r.turns[i] ? 2 : 5);
          } else if (r.turns[i]) {
            fmt::print("{:<10} {:>11.2f}   +- {:.2f}\n", r.joint[i], units::to_tenth_urad(r.compliance[i]),
                       units::to_tenth_urad(r.half_interval[i]));
          } else {
            fmt::print("{:<10} {:>11.5f}   +- {:.5f}\n", r.joint[i], units::to_um_per_N(r.compliance[i]),
                       units::to_um_per_N(r.half_interval[i]));
          }
        }
        for (std::size_t i = 0; i < r.compliance.size(); ++i) {
          if (r.told[i] && r.compliance[i] == 0)
            fmt::print("{} is fixed at 0, because its best value would be negative; it is not known to be rigid\n",
                       r.joint[i]);
        }
        fmt::print("\nwith the compliances of the given machine the residual rms is {:.1f} um\n",
                   units::to_um(given_rms));
        if (dealt) {
          fmt::print("a fifth of the points at a time predicted from the others: {}\n", in_words(*dealt));
        }
        for (std::size_t i = 0; i < foretold.size(); ++i) {
          fmt::print("{}: predicted from the other files to {}\n",
                     std::filesystem::path(o->files[i]).filename().string(), in_words(foretold[i]));
        }
        if (r.pairs > 0) {
          fmt::print("measured cross displacements differ from symmetry by {:.1f} um rms{}\n",
                     units::to_um(r.asymmetry_rms), r.symmetric ? "" : ": more than noise");
        } else {
          fmt::print("no two cross displacements of a pair were measured, so that symmetry is not judged\n");
        }
        for (const Json& x : alike) {
          fmt::print("{} and {} are highly correlated: their estimates correlate by {:.3f}\n",
                     x["joints"][0].get<std::string>(), x["joints"][1].get<std::string>(),
                     x["correlation"].get<double>());
        }
        for (const Json& x : outliers) {
          fmt::print("outlier, kept in the fit: {}:{} {} is off by {:.0f} um\n", x["file"].get<std::string>(),
                     x["line"].get<int>(), x["displacement"].get<std::string>(), x["residual_um"].get<double>());
        }
        if (relative > 0)
          fmt::print(
              "the gain of forces and displacements, {:.3g} % (one standard uncertainty), is in all intervals; the "
              "residuals do not show it\n",
              100 * relative);
        print_doubts(judgement.doubts);
        print_unused(read.unused_columns);
        fmt::print("{}\n", in_words(verdict));
        for (const std::string* path : {&o->out, &o->covariance, &o->report})
          if (!path->empty() && !(refused && path != &o->report)) fmt::print("wrote {}\n", *path);
        return end(context, verdict, judgement);
      }};
}

Command identify_cutting_command() {
  struct Options {
    std::string cutter, out, name;
    std::vector<std::string> files, columns;
    double runout_um = 0;
  };
  auto o = std::make_shared<Options>();
  return {"identify cutting", "Cutting coefficients from mean forces measured at several feeds",
          "polypod identify cutting --cutter cutter.toml forces.csv -o material.toml",
          [o](Arguments& a) {
            a.positional(
                "DATA", o->files,
                "CSV files: feed_per_tooth_mm,ap_mm,Fx_N,Fy_N,Fz_N[,direction][,ae_mm][,sigma_N]; on the tool, x along "
                "the feed, y to its left, z along the axis");
            a.option("--cutter", o->cutter, "The cutter file", true);
            a.option("-o,--output", o->out, "The material, as a material file");
            a.option("--name", o->name, "Its name");
            a.option("--runout-um", o->runout_um, {0, 1000},
                     "Runout of the cutting edges, total indicator reading: the largest change that it may cause goes "
                     "into the intervals");
            declare_columns(a, o->columns);
          },
          [o](const Context& context) -> Result<int> {
            POLYPOD_ASSIGN(cutter, cutting::read_cutter(o->cutter));
            POLYPOD_TRY(cutting::is_flat(cutter, {o->cutter},
                                         "identify the coefficients with a flat cutter of the same edges"));
            std::vector<std::string> inputs = o->files;
            inputs.push_back(o->cutter);
            POLYPOD_TRY(check_files(inputs, {o->out}, context.json));
            std::vector<cutting::MeasuredForce> rows;
            POLYPOD_ASSIGN(columns, csv::columns_of(o->columns));
            std::vector<std::string> unused;
            for (const std::string& file : o->files) {
              POLYPOD_ASSIGN(more, cutting::read_forces(cutter, file, columns));
              rows.insert(rows.end(), more.cuts.begin(), more.cuts.end());
              for (std::string& name : more.unused_columns) unused.push_back(std::move(name));
            }
            const auto runout =
                context.given("--runout-um") ? std::optional(units::from_um(o->runout_um)) : std::nullopt;
            POLYPOD_ASSIGN(r, cutting::identify_cutting(cutter, rows, runout));
            r.material.name = o->name;
            std::vector<std::string> notes = notes_of(cutter, r.material, rows);
            if (cutter.teeth > 1 && !(r.runout.given && o->runout_um == 0))
              notes.push_back(in_words(r.runout, r.value));
            if (r.lack_of_fit) notes.push_back(in_words(*r.lack_of_fit));
            if (!unused.empty()) notes.push_back(fmt::format("Not read: the columns {}.", fmt::join(unused, ", ")));
            if (!o->out.empty()) {
              const std::string text = cutting::to_toml(r.material);
              POLYPOD_ASSIGN(table, config::parse(text, o->out));
              POLYPOD_TRY(cutting::material_from(table));  // what could not be read again is not written
              POLYPOD_TRY(files::write_whole(o->out, text));
            }
            static constexpr std::array<const char*, 6> kKeys = {"Ktc_N_per_mm2", "Krc_N_per_mm2", "Kac_N_per_mm2",
                                                                 "Kte_N_per_mm",  "Kre_N_per_mm",  "Kae_N_per_mm"};
            const auto user = [](std::size_t k, double x) {
              return k < 3 ? units::to_N_per_mm2(x) : units::to_N_per_mm(x);
            };
            static constexpr std::array<const char*, 3> kForces = {"Fx_N", "Fy_N", "Fz_N"};
            Json outliers = Json::array();
            for (const cutting::ForceOutlier& x : r.outliers) {
              outliers.push_back({{"file", rows[x.row].place.file},
                                  {"line", rows[x.row].place.line},
                                  {"force", kForces[std::size_t(x.axis)]},
                                  {"residual_N", x.residual}});
            }
            if (context.json) {
              Json coefficients = Json::array();
              for (std::size_t k = 0; k < kKeys.size(); ++k) {
                coefficients.push_back({{"key", kKeys[k]},
                                        {"value", user(k, r.value[k])},
                                        {"standard_error", user(k, r.standard_error[k])},
                                        {"half_interval_95", user(k, r.half_interval[k])},
                                        {"change_by_runout", user(k, r.runout.change[k])}});
              }
              Json noise = Json::array();
              for (std::size_t k = 0; k < kForces.size() && !r.noise_stated; ++k)
                noise.push_back(
                    {{"force", kForces[k]}, {"constant_N", r.noise[k].constant}, {"percent", 100 * r.noise[k].share}});
              print_json({{"coefficients", coefficients},
                          {"residual_rms_N", r.residual_rms},
                          {"runout_um", units::to_um(r.runout.reading)},
                          {"runout_given", r.runout.given},
                          {"cuts", rows.size()},
                          {"equations", r.equations},
                          {"condition", r.condition},
                          {"noise", noise},
                          {"noise_stated", r.noise_stated},
                          {"times_stated_noise", r.noise_stated ? Json(r.times_stated) : Json()},
                          {"lack_of_fit", r.lack_of_fit ? Json{{"exponent", r.lack_of_fit->exponent},
                                                               {"residual_rms_N", r.lack_of_fit->residual_rms},
                                                               {"linear_residual_rms_N", r.lack_of_fit->linear_rms}}
                                                        : Json()},
                          {"unused_columns", unused},
                          {"outliers", outliers},
                          {"notes", notes}});
              return kDone;
            }
            fmt::print("{} cuts, {} equations, residual rms {:.2f} N, condition {:.2f}\n\n", rows.size(), r.equations,
                       r.residual_rms, r.condition);
            for (std::size_t k = 0; k < kKeys.size(); ++k) {
              fmt::print("{:<14} {:>10.3f}   +- {:.3f} (95 %)\n", kKeys[k], user(k, r.value[k]),
                         user(k, r.half_interval[k]));
            }
            fmt::print("{}\n", noise_in_words(r));
            for (const Json& x : outliers) {
              fmt::print("outlier, kept in the fit: {}:{} {} is off by {:.1f} N\n", x["file"].get<std::string>(),
                         x["line"].get<int>(), x["force"].get<std::string>(), x["residual_N"].get<double>());
            }
            for (const std::string& note : notes) fmt::print("note: {}\n", note);
            if (!o->out.empty()) fmt::print("wrote {}\n", o->out);
            return kDone;
          }};
}

}  // namespace polypod::app
