// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// predict, correct, check
#include <fmt/format.h>

#include <algorithm>
#include <memory>

#include "commands.hpp"
#include "covariance_files.hpp"
#include "measured_problems.hpp"
#include "polypod/core/files.hpp"
#include "polypod/core/text.hpp"
#include "polypod/core/units.hpp"
#include "polypod/kinematics/any_machine.hpp"
#include "polypod/kinematics/by_parameters.hpp"
#include "polypod/machining/accept.hpp"
#include "polypod/machining/check.hpp"
#include "polypod/machining/correct.hpp"
#include "polypod/machining/uncertainty.hpp"
#include "polypod/pages/correction.hpp"

namespace polypod::app {
namespace {

using units::to_mm;
using units::to_um;

Json spread_json(const machining::Spread& s, double scale) {
  if (s.count == 0) return {{"min", 0.0}, {"mean", 0.0}, {"max", 0.0}};
  return {{"min", s.min * scale}, {"mean", s.mean * scale}, {"max", s.max * scale}};
}

std::string spread_text(const machining::Spread& s) {
  if (s.count == 0) return "no point cuts";
  return fmt::format("{:.1f} .. {:.1f} um, mean {:.1f} um", to_um(s.min), to_um(s.max), to_um(s.mean));
}

struct Input {
  machining::Job job;
  gcode::Program program;
  gcode::Interpretation interpretation;
};

constexpr const char* kMeasuredHelp =
    "Measured displacements (the files of identify compliance): the compliance is interpolated from these alone, "
    "without the joints' (repeatable; default: the job's)";

/// `measured`: files in the place of the job's measured compliance, if there are any.
Result<Input> read_input(const std::string& program_path, const std::string& job_path,
                         const std::vector<std::string>& measured) {
  POLYPOD_ASSIGN(job, machining::read_job(job_path));
  if (!measured.empty()) {
    POLYPOD_ASSIGN(compliance, machining::read_measured(measured, {}, &job.machine));
    job.measured = std::move(compliance);
  }
  POLYPOD_ASSIGN(program, gcode::read(program_path));
  POLYPOD_ASSIGN(interpretation, gcode::interpret(program, job.interpret_options()));
  return Input{std::move(job), std::move(program), std::move(interpretation)};
}

constexpr const char* kCovarianceHelp =
    "What `calibrate --covariance` or `identify compliance --covariance` wrote with the job's machine file: U (k = 2), "
    "um, of the tip's place or of the normal error (repeatable: one of each)";

/// Errors: those of covariances_of; AP125 compliances that the job does not use.
Result<Covariances> read_covariances(const machining::Job& job, const std::vector<std::string>& files) {
  POLYPOD_ASSIGN(out, covariances_of(job.machine, files));
  if (job.measured && out.compliances)
    return fail("AP125", "--covariance of compliances, but the compliance is interpolated from measurements", {},
                "leave it out; the measured compliance has a band of its own (map_band_95_um)");
  return out;
}

const Eigen::MatrixXd* pointer_to(const std::optional<Eigen::MatrixXd>& matrix) {
  return matrix ? &*matrix : nullptr;
}

/// "line 30", or that it is the program with the other switch.
std::string where_in_words(const machining::Reach& reach) {
  return reach.line > 0 ? fmt::format("at line {}", reach.line) : "with the other position of block delete";
}

/// An uncertainty in um, to two figures; above 100 um in whole um.
std::string um2(double m) {
  return to_um(m) < 99.5 ? fmt::format("{:.2g}", to_um(m)) : fmt::format("{:.0f}", to_um(m));
}

constexpr const char* kNotInTube = "the tube holds the bend of the machine, not its place";

void add_uncertainty(Json& document, const machining::Uncertainty& u) {
  using kinematics::kCoverageFactor;
  const auto mean_and_max = [](const machining::Spread& s) {
    return Json{{"mean", to_um(s.mean)}, {"max", to_um(s.max)}};
  };
  if (u.compliances) {
    document["compliance_uncertainty_um"] = {{"k", kCoverageFactor},
                                             {"points", u.compliances->across.count},
                                             {"normal", mean_and_max(u.compliances->normal)},
                                             {"across_path", mean_and_max(u.compliances->across)}};
  }
  if (u.reach) {
    document["within_tolerance_with_uncertainty"] = u.reach->within;
    document["reach_with_uncertainty"] = {{"line", u.reach->line > 0 ? Json(u.reach->line) : Json()},
                                          {"distance_um", to_um(u.reach->distance)},
                                          {"U_um", to_um(u.reach->U)},
                                          {"sum_um", to_um(u.reach->total())}};
  }
  if (u.place) {
    document["place_uncertainty_um"] = mean_and_max(u.place->tip);
    document["place_uncertainty_um"].update(
        {{"k", kCoverageFactor}, {"points", u.place->tip.count}, {"line", u.place->line}, {"note", kNotInTube}});
  }
}

/// `reach`: said in one line, where it is not null.
void print_uncertainty(const machining::Uncertainty& u, const machining::Reach* reach) {
  if (u.compliances) {
    fmt::print("compliances    U (k = 2) {} um of the normal error on average, up to {} um (at {} points)\n",
               um2(u.compliances->normal.mean), um2(u.compliances->normal.max), u.compliances->normal.count);
  }
  if (reach != nullptr) {
    fmt::print("               with it the tool may come to {:.1f} um {}: {} the tolerance\n", to_um(reach->total()),
               where_in_words(*reach), reach->within ? "within" : "beyond");
  }
  if (u.place) {
    fmt::print("machine        U (k = 2) {} um of the tip's place on average, up to {} um (line {}): {}\n",
               um2(u.place->tip.mean), um2(u.place->tip.max), u.place->line, kNotInTube);
  }
}

/// Adds what the measured compliance is made of and how far it is known; nothing where the job has none.
void add_map(Json& document, const machining::Job& job, const machining::MapBand& band) {
  if (!job.measured) return;
  const auto mean_and_max = [](const machining::Spread& s) {
    return Json{{"mean", to_um(s.mean)}, {"max", to_um(s.max)}};
  };
  const statics::MeasuredMap& map = job.measured->map;
  document["measured_compliance"] = {{"files", job.measured->files},
                                     {"points", map.size()},
                                     {"correlation_length_mm", to_mm(map.correlation_length())},
                                     {"left_out", job.measured->left_out},
                                     {"unused_columns", job.measured->unused_columns},
                                     {"doubts", problems_json(job.measured->doubts)}};
  document["map_band_95_um"] = mean_and_max(band.normal);
  if (band.joints.count > 0) document["model_difference_um"] = mean_and_max(band.joints);
}

void print_map(const machining::Job& job, const machining::MapBand& band) {
  if (!job.measured) return;
  const statics::MeasuredMap& map = job.measured->map;
  fmt::print("compliance     interpolated from {} measured points, correlation length {:.0f} mm\n", map.size(),
             to_mm(map.correlation_length()));
  if (job.measured->left_out > 0) {
    fmt::print("               {} points do not tell all six compliances and are left out\n", job.measured->left_out);
  }
  print_doubts(job.measured->doubts);
  print_unused(job.measured->unused_columns);
  if (band.normal.count > 0) {
    fmt::print("its band       +- {:.1f} um of the normal error, up to {:.1f} um (95 %, at {} points)\n",
               to_um(band.normal.mean), to_um(band.normal.max), band.normal.count);
  }
  if (band.joints.count > 0) {
    fmt::print("joints' model  deflections {:.1f} um from these, up to {:.1f} um\n", to_um(band.joints.mean),
               to_um(band.joints.max));
  }
}

/// Whether the measured compliance is beyond doubt, so that a yes can rest on it.
bool trusted(const machining::Job& job) {
  return !job.measured || job.measured->doubts.empty();
}

// mm; the range of --step, as that of a job's step_mm
constexpr double kLeastStep = 0.01, kMostStep = 10;

/// "The answer is no" where a rapid goes through material; the figures have been given.
int end(const Status& collision) {
  if (collision) return kDone;
  fmt::print(stderr, "polypod: {}\n", to_string(collision.error()));
  return kAnswerIsNo;
}

Json not_judged_json(const std::vector<machining::NotJudged>& moves, const std::vector<machining::Plunge>& plunges) {
  Json out = Json::array();
  for (const machining::NotJudged& m : moves) out.push_back({{"line", m.line}, {"why", m.why}});
  for (const machining::Plunge& p : plunges) {
    out.push_back({{"line", p.line},
                   {"why", p.why()},
                   {"held_back_um", to_um(p.held_back)},
                   {"remaining_um", to_um(p.remaining)},
                   {"dwell_s", p.dwell},
                   {"dwell_needed_s", p.needed > 0 ? Json(p.needed) : Json()}});
  }
  return out;
}

/// `at`: "" or ", with block delete on"; `shown`: the distance that is printed already, m.
void print_plunges(const std::vector<machining::Plunge>& plunges, const machining::Plunge& within, double shown,
                   const std::string& at = "") {
  if (to_um(within.distance) >= to_um(shown) + 1) {
    fmt::print("plunges        the thrust may leave up to {:.0f} um at the end of line {}, inside the tube{}\n",
               to_um(within.distance), within.line, at);
  }
  if (plunges.empty()) return;
  const auto worst = std::max_element(plunges.begin(), plunges.end(),
                                      [](const auto& a, const auto& b) { return a.distance < b.distance; });
  fmt::print("not judged{}: line {}: {}{}\n", at, worst->line, worst->why(),
             plunges.size() > 1 ? fmt::format("; likewise {} more, see --json", plunges.size() - 1) : "");
}

Json steep_json(const machining::Steep& s) {
  return {{"length_mm", to_mm(s.length)},
          {"line", s.line},
          {"distance_um", to_um(s.distance)},
          {"window_mm", to_mm(s.window)},
          {"largest_within_um", to_um(s.within)},
          {"line_within", s.within > 0 ? Json(s.within_line) : Json()},
          {"elsewhere_on_line_um", to_um(s.elsewhere)}};
}

/// `at`: "" or ", with block delete on".
/// `shown`: the distance that is printed already, m.
void print_steep(const machining::Steep& s, double shown, const std::string& at = "") {
  if (to_um(s.within) >= to_um(shown) + 1) {
    fmt::print(
        "quick changes  where the force changes quickly the bend may differ{}: up to {:.0f} um from the "
        "programmed path, inside the tube (line {})\n",
        at, to_um(s.within), s.within_line);
  }
  if (!(s.distance > 0)) return;
  fmt::print(
      "not judged{}: {:.1f} mm of the cut, where the force changes quickly: the bend lags behind it, and where it "
      "changes "
      "is known to the {:.2f} mm ahead on which the engagement is averaged; the tool may be up to {:.0f} um from the "
      "programmed path there (line {}{})\n",
      at, to_mm(s.length), to_mm(s.window), to_um(s.distance), s.line,
      s.elsewhere > s.distance ? fmt::format("; elsewhere on it {:.1f} um", to_um(s.elsewhere)) : "");
}

/// In um, without the noise that the conversion leaves.
double rounded_um(double m) {
  return std::round(to_um(m) * 1e6) / 1e6;
}

/// The answer of `correct` in one sentence.
std::string answer_in_words(const machining::Correction& c, const std::optional<machining::Reach>& reach) {
  std::string out = c.answer();
  if (c.within_tolerance && reach && !reach->within)
    out.insert(out.find("yes") + 3, " by the compliances as identified");
  return out;
}

/// The answer of `correct` where it is yes, and what it does not hold for.
void print_answer(const machining::Correction& c, const std::optional<machining::Reach>& reach) {
  print_steep(c.after.steep, c.largest_after);
  print_plunges(c.after.plunges, c.after.plunge_within, c.largest_after);
  if (!c.within_tolerance) return;
  fmt::print("{}\n", answer_in_words(c, reach));
  if (!reach) return;
  fmt::print("{} their uncertainty (U {} um, k = 2) {}; the tool may come to {:.1f} um\n",
             reach->within ? "     and" : "     but", um2(reach->U),
             reach->within ? "stays inside the tube, too, nearest to it " + where_in_words(*reach)
                           : "reaches beyond the tube " + where_in_words(*reach),
             to_um(reach->total()));
}

Json short_blocks_json(const machining::ShortBlocks& s) {
  const auto some = [&](Json value) { return s.count > 0 ? std::move(value) : Json(); };
  return {{"count", s.count},
          {"of", s.written},
          {"line", some(s.line)},
          {"line_out", some(s.written_line)},
          {"shortest_mm", some(to_mm(s.length))},
          {"shortest_ms", some(s.time / units::from_ms(1))}};
}

void print_short_blocks(const machining::ShortBlocks& s, bool written) {
  if (s.count == 0) return;
  fmt::print(
      "short blocks   {} of {} blocks that stand for rewritten moves are shorter than [controller] of the job asks, as "
      "the tube does not hold shared corners there (least {:.3f} mm, {:.1f} ms; the first stands for line {}{})\n",
      s.count, s.written, to_mm(s.length), s.time / units::from_ms(1), s.line,
      written ? fmt::format(", in line {} of the corrected program", s.written_line) : "");
}

void print_not_judged(const std::vector<machining::NotJudged>& moves) {
  for (const machining::NotJudged& m : moves) fmt::print("not judged: line {}: {}\n", m.line, m.why);
}

void add_other_switch(Json& document, const std::optional<machining::OtherSwitch>& other, bool trust) {
  if (!other) return;
  document["other_block_delete"] = {{"block_delete", other->block_delete},
                                    {"distance_before_um", to_um(other->distance_before)},
                                    {"distance_after_um", to_um(other->distance_after)},
                                    {"within_tolerance", other->within_tolerance && trust},
                                    {"not_judged", not_judged_json({}, other->plunges)},
                                    {"steep_not_judged", steep_json(other->steep)}};
}

/// Why a distance below the tolerance is beyond it.
std::string kept_free(const machining::Job& job, double distance) {
  const double free = machining::resolution(job);
  if (distance > job.tolerance || distance <= job.tolerance - free) return "";
  return fmt::format(", of which {:.1f} um are kept free for what the cells of the stock leave open", to_um(free));
}

void print_other_switch(const std::optional<machining::OtherSwitch>& other, bool trust) {
  if (!other) return;
  fmt::print("block delete   {}: up to {:.1f} um from the programmed path, {} the tolerance\n",
             other->block_delete ? "on" : "off", to_um(other->distance_after),
             !other->within_tolerance ? "beyond"
             : trust                  ? "within"
                                      : "by a doubtful measurement, not judged against");
  const std::string at = fmt::format(", with block delete {}", other->block_delete ? "on" : "off");
  print_steep(other->steep, other->distance_after, at);
  print_plunges(other->plunges, {}, other->distance_after, at);
}

/// um, the largest tube that makes sense
constexpr double kMostTolerance = 1e5;

void print_modes(const machining::Correction& c) {
  const machining::PathModes& m = c.modes;
  fmt::print("corners        rounded by the controller by up to {:.1f} um, after {:.1f} um\n", to_um(m.corner_before),
             to_um(m.corner_after));
  if (!m.written.empty()) {
    fmt::print("path control   {} was written, which the tolerance needs\n", m.written);
    for (const int line : m.replaced) fmt::print("               it replaces the mode of line {}\n", line);
  }
  fmt::print("time           {:.1f} s, after {:.1f} s\n", m.time_before, m.time_after);
}

void print_outside(const machining::Correction& c) {
  constexpr int kMostOutside = 20;
  int outside = 0;
  for (const machining::MoveOutcome& m : c.moves) {
    if (m.within || ++outside > kMostOutside) continue;
    fmt::print("outside: line {}: {:.1f} um, before {:.1f} um{}{}\n", m.line, to_um(m.distance_after),
               to_um(m.distance_before),
               m.corner_after > 0 ? fmt::format(", its corner {:.1f} um more", to_um(m.corner_after)) : "",
               m.rewritten ? "" : ", as it was");
  }
  if (outside > kMostOutside) fmt::print("outside: {} lines more, see --json\n", outside - kMostOutside);
}

}  // namespace

Command predict_command() {
  struct Options {
    std::string program, job;
    std::vector<std::string> measured, covariances;
    double step_mm = 0;
    bool at_rest = false, again = false;
  };
  auto o = std::make_shared<Options>();
  return {
      "predict", "Deflection of the tool along a program", "polypod predict program.ngc --job job.toml",
      [o](Arguments& a) {
        a.positional("PROGRAM", o->program, "The G-code program");
        a.option("--job", o->job, "The job file: machine, origin, cutter, material, stock, tolerance", true);
        a.options("--measured", o->measured, kMeasuredHelp);
        a.option("--covariance", o->covariances, kCovarianceHelp);
        a.option("--step", o->step_mm, "Longest distance between evaluated points, mm (default: the job's)");
        a.flag("--again", o->again, "Take a program that Polypod has corrected like any other");
        a.flag("--at-rest", o->at_rest, "Force at the commanded point, without the feedback of the bend on the cut");
      },
      [o](const Context& context) -> Result<int> {
        if (o->step_mm != 0 && !(o->step_mm >= kLeastStep && o->step_mm <= kMostStep)) {
          return fail("AP120", fmt::format("--step {:g}: must be {:g} to {:g} mm", o->step_mm, kLeastStep, kMostStep));
        }
        std::vector<std::string> inputs = o->measured;
        inputs.insert(inputs.end(), {o->program, o->job});
        inputs.insert(inputs.end(), o->covariances.begin(), o->covariances.end());
        POLYPOD_TRY(check_files(inputs, {}, context.json));
        POLYPOD_ASSIGN(in, read_input(o->program, o->job, o->measured));
        POLYPOD_ASSIGN(known, read_covariances(in.job, o->covariances));
        machining::PredictOptions options;
        options.bend = o->at_rest ? machining::Bend::at_rest : machining::Bend::equilibrium;
        options.step = units::from_mm(o->step_mm);
        options.again = o->again;
        options.progress = progress_line(context, "predicting");
        POLYPOD_ASSIGN(p, machining::predict(in.job, in.program, in.interpretation, options));
        POLYPOD_ASSIGN(band, machining::force_band(in.job, in.program, in.interpretation, p, options));
        const machining::MapBand map = machining::map_band(in.job, p);
        const machining::Uncertainty uncertainty =
            machining::uncertainty_of(in.job, p, pointer_to(known.compliances), pointer_to(known.parameters));
        options.progress(1);
        const bool spread = !in.job.material.spread.empty();
        const bool trust = trusted(in.job), within = p.within(in.job) && trust;
        const Status collision = machining::no_rapid_cuts(in.job, in.program, p.pass);
        if (context.json) {
          Json moves = Json::array();
          for (std::size_t i = 0; i < p.moves.size(); ++i) {
            const machining::MovePrediction& m = p.moves[i];
            moves.push_back({{"line", m.line},
                             {"length_mm", to_mm(m.length)},
                             {"points", m.points},
                             {"deflection_um", {{"max", to_um(m.deflection.max)}, {"mean", to_um(m.deflection.mean)}}},
                             {"normal_error_um", spread_json(m.normal, units::kUmPerMetre)},
                             {"vertical_error_um", spread_json(m.vertical, units::kUmPerMetre)},
                             {"distance_max_um", to_um(m.largest_distance)},
                             {"mean_force_N", vector_json(m.mean_force)},
                             {"depth_max_mm", to_mm(m.largest_depth)}});
            if (spread) moves.back()["normal_mean_band_95_um"] = to_um(band.normal_by_move[i]);
          }
          Json document{{"origin_mm", vector_json(in.job.X_MW.p * units::kMmPerMetre)},
                        {"machine", in.job.machine_name},
                        {"model", o->at_rest ? "at rest" : "equilibrium"},
                        {"points", p.deflection.count},
                        {"deflection_um", {{"max", to_um(p.deflection.max)}, {"mean", to_um(p.deflection.mean)}}},
                        {"normal_error_um", spread_json(p.normal, units::kUmPerMetre)},
                        {"vertical_error_um", spread_json(p.vertical, units::kUmPerMetre)},
                        {"distance_max_um", to_um(p.largest_distance)},
                        {"corner_deviation_um", to_um(p.corner)},
                        {"distance_with_corners_um", to_um(p.largest_with_corners)},
                        {"tolerance_um", to_um(in.job.tolerance)},
                        {"within_tolerance", within},
                        {"not_judged", not_judged_json(p.not_judged, p.plunges)},
                        {"all_judged", p.all_judged()},
                        {"steep_not_judged", steep_json(p.steep)},
                        {"time_s", p.time},
                        {"removed_mm3", units::to_mm3(p.pass.removed)},
                        {"moves", moves},
                        {"notes", p.notes}};
          if (spread) {
            document["band_95_um"] = {{"deflection_max", to_um(band.deflection_max)},
                                      {"deflection_mean", to_um(band.deflection_mean)},
                                      {"normal_mean", to_um(band.normal_mean)}};
          }
          add_other_switch(document, p.other_switch, trust);
          if (!collision) document["collision"] = to_string(collision.error());
          add_map(document, in.job, map);
          add_uncertainty(document, uncertainty);
          print_json(document);
          return end(collision);
        }
        const Vec3 origin = in.job.X_MW.p * units::kMmPerMetre;
        fmt::print("{} on {}, origin of W at x {:g} y {:g} z {:g} mm\n", one_line(o->program),
                   one_line(in.job.machine_name), origin.x(), origin.y(), origin.z());
        fmt::print("{} points cut in {} moves, {:.0f} mm3 removed\n", p.deflection.count, p.moves.size(),
                   units::to_mm3(p.pass.removed));
        fmt::print("deflection     up to {:.1f} um, mean {:.1f} um\n", to_um(p.deflection.max),
                   to_um(p.deflection.mean));
        fmt::print("normal error   {}  (+ leaves material, - gouges)\n", spread_text(p.normal));
        fmt::print("vertical error {}\n", spread_text(p.vertical));
        fmt::print("distance       up to {:.1f} um from the programmed path, {} the tolerance of {:g} um{}\n",
                   to_um(p.largest_distance),
                   p.largest_distance > in.job.tolerance - machining::resolution(in.job) ? "beyond"
                   : trust                                                               ? "within"
                           : "by a doubtful measurement, not judged against",
                   to_um(in.job.tolerance), kept_free(in.job, p.largest_distance));
        if (p.corner > 0) {
          fmt::print("corners        the controller rounds them by up to {:.1f} um more{}\n", to_um(p.corner),
                     within ? "" : ", see G64 P in docs/path-modes.md");
        }
        print_steep(p.steep, p.largest_distance);
        print_plunges(p.plunges, p.plunge_within, p.largest_distance);
        print_other_switch(p.other_switch, trust);
        if (spread) {
          fmt::print(
              "coefficients   +- {:.1f} um of the mean normal error, +- {:.1f} um of the largest deflection (95 %)\n",
              to_um(band.normal_mean), to_um(band.deflection_max));
        }
        print_map(in.job, map);
        print_uncertainty(uncertainty, uncertainty.reach && within ? &*uncertainty.reach : nullptr);
        if (!p.moves.empty()) fmt::print("\n  line   length    normal error um     distance um  force N\n");
        constexpr std::size_t kMost = 40;
        for (std::size_t i = 0; i < std::min(kMost, p.moves.size()); ++i) {
          const machining::MovePrediction& m = p.moves[i];
          fmt::print("  {:>4} {:>8.2f}   {:>7.1f} .. {:<7.1f} {:>9.1f} {:>10.1f}\n", m.line, to_mm(m.length),
                     to_um(m.normal.min), to_um(m.normal.max), to_um(m.largest_distance), m.mean_force.norm());
        }
        if (p.moves.size() > kMost) fmt::print("  ... {} more, see --json\n", p.moves.size() - kMost);
        print_not_judged(p.not_judged);
        for (const std::string& note : p.notes) fmt::print("note: {}\n", note);
        return end(collision);
      }};
}

Command correct_command() {
  struct Options {
    std::string program, job, output, report, method = "tube";
    std::vector<std::string> measured, covariances;
    int points = 10;
    std::string tolerance;
    double chord_um = 0;
    bool again = false, allow_outside = false, all = false, verify = false;
  };
  auto o = std::make_shared<Options>();
  return {"correct", "Correct a program so that the bent tool stays in a tube round the programmed path",
          "polypod correct program.ngc --job job.toml -o corrected.ngc --report report.html",
          [o](Arguments& a) {
            a.positional("PROGRAM", o->program, "The G-code program");
            a.option("--job", o->job, "The job file: machine, origin, cutter, material, stock, tolerance", true);
            a.option("-o,--output", o->output, "The corrected program", true);
            a.option("--report", o->report, "An HTML report of what will happen and why");
            a.options("--measured", o->measured, kMeasuredHelp);
            a.option("--covariance", o->covariances, kCovarianceHelp);
            a.option("--tolerance", o->tolerance, "Radius of the tolerance tube, um (default: the job's)");
            a.option("--chord-tolerance", o->chord_um,
                     "How far arcs that are kept as arcs may be off the ideal path, um (default: a tenth of the tube)");
            a.flag("--allow-outside", o->allow_outside,
                   "Write the program even if moves stay outside of the tube: corrected as well as they go");
            a.flag("--verify", o->verify,
                   "Look again with cells half as large and steps half as long before the answer is yes (five times "
                   "the time)");
            a.flag("--correct-all", o->all, "Correct moves inside the tube, too, where it adds no lines");
            a.flag("--again", o->again, "Take a program that Polypod has corrected like any other");
            a.option("--method", o->method,
                     "tube, or mirror: one step at --points points a move, for comparison and written in any case");
            a.option("--points", o->points, "Pieces a move for --method mirror");
          },
          [o](const Context& context) -> Result<int> {
            machining::CorrectOptions options;
            if (o->method == "mirror") {
              options.method = machining::CorrectMethod::mirror;
            } else if (o->method != "tube") {
              return fail("AP121", fmt::format("--method {}: not tube or mirror", o->method));
            }
            if (o->method == "tube") POLYPOD_TRY(refuse(context, {"--points"}, "it serves --method mirror"));
            if (o->points < 1 || o->points > 100000) return fail("AP122", "--points must be 1 to 100000");
            options.mirror_points = o->points;
            double tolerance_um = 0;
            if (!o->tolerance.empty()) {
              POLYPOD_ASSIGN(given, numbers_of(o->tolerance, "--tolerance"));
              if (given.size() != 1 || !(given[0] > 0 && given[0] <= kMostTolerance)) {
                return fail("AP122", fmt::format("--tolerance {}: must be above 0 and at most {:g} um", o->tolerance,
                                                 kMostTolerance));
              }
              tolerance_um = given[0];
            }
            if (!(o->chord_um >= 0 && o->chord_um <= kMostTolerance)) {
              return fail("AP122",
                          fmt::format("--chord-tolerance {:g}: must be 0 to {:g} um", o->chord_um, kMostTolerance));
            }
            options.chord = units::from_um(o->chord_um);
            options.again = o->again;
            options.all = o->all;
            options.verify = o->verify;
            std::vector<std::string> inputs = o->measured;
            inputs.insert(inputs.end(), {o->program, o->job});
            inputs.insert(inputs.end(), o->covariances.begin(), o->covariances.end());
            POLYPOD_TRY(check_files(inputs, {o->output, o->report}, context.json));
            POLYPOD_ASSIGN(in, read_input(o->program, o->job, o->measured));
            POLYPOD_ASSIGN(known, read_covariances(in.job, o->covariances));
            if (tolerance_um > 0) in.job.tolerance = units::from_um(tolerance_um);
            options.keep_samples = !o->report.empty();
            const char* current = "";
            std::function<bool(double)> line;
            options.progress = [&](const char* what, double share) {
              if (what != current) line = progress_line(context, what);
              current = what;
              return line(share);
            };
            POLYPOD_ASSIGN(c, machining::correct(in.job, in.program, in.interpretation, options));
            if (line) line(1);
            if (!trusted(in.job)) {
              c.within_tolerance = c.only_not_judged = false;
              c.reason = "the measured compliance is doubtful: " + in.job.measured->doubts.front().message;
              c.remedies = {in.job.measured->doubts.front().hint};
            }
            const machining::Uncertainty uncertainty =
                machining::uncertainty_of(in.job, c, pointer_to(known.compliances), pointer_to(known.parameters));
            const bool writes =
                c.within_tolerance || o->allow_outside || options.method == machining::CorrectMethod::mirror;
            files::Outputs together;  // program and report appear together or not at all
            if (writes) POLYPOD_TRY(together.add(o->output, c.text));
            if (!o->report.empty()) {
              pages::CorrectionPageOptions page;
              page.version = POLYPOD_VERSION;
              page.output = writes ? o->output : "";
              page.method = options.method;
              page.uncertainty = uncertainty;
              page.command = fmt::format("polypod correct {} --job {} -o {} --report {}", for_shell(o->program),
                                         for_shell(o->job), for_shell(o->output), for_shell(o->report));
              for (const std::string& file : o->measured) page.command += " --measured " + for_shell(file);
              for (const std::string& file : o->covariances) page.command += " --covariance " + for_shell(file);
              if (tolerance_um > 0) page.command += fmt::format(" --tolerance {}", tolerance_um);
              if (o->chord_um > 0) page.command += fmt::format(" --chord-tolerance {}", o->chord_um);
              if (o->allow_outside) page.command += " --allow-outside";
              if (o->all) page.command += " --correct-all";
              if (o->verify) page.command += " --verify";
              if (o->again) page.command += " --again";
              if (o->method == "mirror") page.command += fmt::format(" --method mirror --points {}", o->points);
              POLYPOD_TRY(together.add(o->report, pages::correction_page(in.job, in.program, c, page)));
            }
            POLYPOD_TRY(together.commit());
            const machining::MapBand map = machining::map_band(in.job, c.before);
            if (context.json) {
              Json moves = Json::array(), outside = Json::array();
              for (const machining::MoveOutcome& m : c.moves) {
                moves.push_back({{"line", m.line},
                                 {"rewritten", m.rewritten},
                                 {"segments", m.pieces},
                                 {"transitions", m.transitions},
                                 {"length_mm", to_mm(m.length)},
                                 {"before_um", spread_json(m.normal_before, units::kUmPerMetre)},
                                 {"after_um", spread_json(m.normal_after, units::kUmPerMetre)},
                                 {"distance_before_um", to_um(m.distance_before)},
                                 {"distance_after_um", to_um(m.distance_after)},
                                 {"corner_before_um", to_um(m.corner_before)},
                                 {"corner_after_um", to_um(m.corner_after)},
                                 {"within_tolerance", m.within}});
                if (!m.within) outside.push_back(moves.back());
              }
              std::vector<std::string> notes = c.before.notes;
              for (const std::string& note : c.after.notes) notes.push_back("corrected: " + note);
              Json document{{"origin_mm", vector_json(in.job.X_MW.p * units::kMmPerMetre)},
                            {"machine", in.job.machine_name},
                            {"method", o->method},
                            {"before_um", spread_json(c.before.normal, units::kUmPerMetre)},
                            {"after_um", spread_json(c.after.normal, units::kUmPerMetre)},
                            {"distance_before_um", to_um(c.before.largest_distance)},
                            {"distance_after_um", to_um(c.largest_distance)},
                            {"lines_in", c.lines_in},
                            {"lines_out", c.lines_out},
                            {"moves_rewritten", c.rewritten_moves},
                            {"segments", c.pieces},
                            {"transitions", c.transitions},
                            {"rounds", c.rounds},
                            {"points_checked", c.after.pass.points},
                            {"tolerance_um", rounded_um(c.tolerance)},
                            {"within_tolerance", c.within_tolerance},
                            {"verified_with_finer_cells", c.verified},
                            {"reason", c.reason},
                            {"remedies", c.remedies},
                            {"corner_before_um", to_um(c.modes.corner_before)},
                            {"corner_after_um", to_um(c.modes.corner_after)},
                            {"distance_with_corners_before_um", to_um(c.largest_before)},
                            {"distance_with_corners_after_um", to_um(c.largest_after)},
                            {"path_control", c.modes.written},
                            {"path_control_replaced_in_lines", c.modes.replaced},
                            {"time_before_s", c.modes.time_before},
                            {"time_after_s", c.modes.time_after},
                            {"moves_left_as_they_were", c.left_as_they_were},
                            {"not_judged", not_judged_json(c.after.not_judged, c.after.plunges)},
                            {"all_judged", c.all_judged()},
                            {"answer", answer_in_words(c, uncertainty.reach)},
                            {"short_blocks", short_blocks_json(c.short_blocks)},
                            {"steep_not_judged", steep_json(c.after.steep)},
                            {"written", writes},
                            {"outside", outside},
                            {"moves", moves},
                            {"notes", notes},
                            {"report", o->report}};
              add_other_switch(document, c.other_switch, trusted(in.job));
              add_map(document, in.job, map);
              add_uncertainty(document, uncertainty);
              print_json(document);
            } else {
              fmt::print("normal error before  {}\n", spread_text(c.before.normal));
              fmt::print("normal error after   {}\n", spread_text(c.after.normal));
              fmt::print("largest distance from the programmed path {:.1f} um, after {:.1f} um (tube {:g} um)\n",
                         to_um(c.before.largest_distance), to_um(c.largest_distance), to_um(c.tolerance));
              fmt::print("{} of {} cutting moves rewritten in {} pieces and {} transitions; {} lines became {}\n",
                         c.rewritten_moves, c.moves.size(), c.pieces, c.transitions, c.lines_in, c.lines_out);
              fmt::print("checked at {} points after reading the new program back{}\n", c.after.pass.points,
                         c.verified ? ", and again with finer cells" : "");
              print_modes(c);
              print_short_blocks(c.short_blocks, writes);
              print_other_switch(c.other_switch, trusted(in.job));
              print_map(in.job, map);
              print_uncertainty(uncertainty, nullptr);  // said with the answer
              print_outside(c);
              print_not_judged(c.after.not_judged);
              print_answer(c, uncertainty.reach);
              for (const std::string& note : c.before.notes) fmt::print("note: {}\n", note);
              for (const std::string& note : c.after.notes) fmt::print("note, corrected: {}\n", note);
              if (writes) fmt::print("wrote {}\n", o->output);
              if (!o->report.empty()) fmt::print("report: {}\n", o->report);
            }
            if (!c.within_tolerance) {
              fmt::print(stderr, "polypod: {}\n", c.answer());
              for (const std::string& remedy : c.remedies) fmt::print(stderr, "polypod: what would help: {}\n", remedy);
              if (!writes) {
                fmt::print(
                    stderr,
                    "polypod: no program was written; --allow-outside writes it with these lines as near as they go\n");
              }
              return kAnswerIsNo;
            }
            return kDone;
          }};
}

namespace {

/// The machine and where the work is on it: from a job, or from --machine and --origin.
Result<machining::Job> placed_machine(const Context& context, const std::string& job_path, const std::string& machine,
                                      const std::vector<std::string>& sets, const std::string& origin) {
  if (!job_path.empty()) {
    POLYPOD_TRY(refuse(context, {"--machine", "--origin", "--set"}, "the job says it; give --job alone"));
    return machining::read_job(job_path);
  }
  if (machine.empty() || origin.empty()) {
    return fail("AP123", "where is the work, and on which machine?", {}, "give --job JOB, or --machine and --origin");
  }
  machining::Job job;
  POLYPOD_ASSIGN(m, machine_of(machine, sets));
  POLYPOD_ASSIGN(p, numbers_of(origin, "--origin"));
  if (p.size() != 3) return fail("AP123", fmt::format("--origin {}: not three numbers", origin));
  job.machine = std::move(m);
  job.machine_name = machine;
  job.X_MW.p = units::from_mm(1) * Vec3(p[0], p[1], p[2]);
  return job;
}

}  // namespace

Command check_command() {
  struct Options {
    std::string program, job, machine, origin;
    std::vector<std::string> sets;
    double rapid = 6000;
  };
  auto o = std::make_shared<Options>();
  return {"check", "Does a program fit a machine: reach, limits, branches, time",
          "polypod check program.ngc --job job.toml",
          [o](Arguments& a) {
            a.positional("PROGRAM", o->program, "The G-code program");
            a.option("--job", o->job,
                     "The job file: machine, origin and rotation of the workpiece, work offsets, block delete");
            a.option("--machine", o->machine, "Without a job: a machine file or a name of `polypod machines`");
            a.option("--set", o->sets, "key=value: override a parameter of --machine (repeatable)");
            a.option("--origin", o->origin, "Without a job: x,y,z of the workpiece origin in M, mm");
            a.option("--rapid", o->rapid, "Speed that G0 is counted with, mm/min");
          },
          [o](const Context& context) -> Result<int> {
            if (!(o->rapid > 0)) return fail("AP123", "--rapid must be above 0 mm/min");
            POLYPOD_ASSIGN(job, placed_machine(context, o->job, o->machine, o->sets, o->origin));
            const machine::AnyMachine& m = job.machine;
            POLYPOD_ASSIGN(program, gcode::read(o->program));
            POLYPOD_ASSIGN(interpretation, gcode::interpret(program, job.interpret_options()));
            POLYPOD_TRY(machining::known_offsets(job, program, interpretation));
            machining::CheckOptions options;
            options.rapid_speed = units::from_mm_per_min(o->rapid);
            options.progress = progress_line(context, "checking");
            POLYPOD_ASSIGN(result, machining::check(m, job.X_MW, program, interpretation, options));
            options.progress(1);
            Json problems = Json::array(), ranges = Json::array();
            for (const machining::CheckProblem& p : result.problems) {
              problems.push_back({{"line", p.line}, {"kind", p.kind}, {"detail", p.detail}});
            }
            for (std::size_t i = 0; i < result.joints.size(); ++i) {
              const int joint = static_cast<int>(i);
              const bool turns = kinematics::joint_kind(m, joint) == machine::JointKind::revolute;
              const auto user = [&](double x) { return turns ? units::to_deg(x) : units::to_mm(x); };
              const auto limits = kinematics::joint_range(m, joint);
              ranges.push_back({{"joint", joint + 1},
                                {"unit", turns ? "deg" : "mm"},
                                {"min", user(result.joints[i].min)},
                                {"max", user(result.joints[i].max)},
                                {"limit_min", user(limits.min)},
                                {"limit_max", user(limits.max)}});
            }
            if (context.json) {
              print_json({{"ok", result.ok},
                          {"problems", problems},
                          {"time_s", result.time},
                          {"length_mm", to_mm(result.length)},
                          {"joint_ranges", ranges},
                          {"notes", result.notes}});
            } else {
              fmt::print("{}\n", result.ok ? "the program fits the machine" : "the program does not fit the machine");
              for (const machining::CheckProblem& p : result.problems) {
                fmt::print("  {}:{}: {}: {}\n", o->program, p.line, p.kind, p.detail);
              }
              fmt::print("time {:.1f} s (G0 at {:g} mm/min, no acceleration), way {:.1f} mm\n", result.time, o->rapid,
                         to_mm(result.length));
              for (const Json& r : ranges) {
                fmt::print("  joint {:>2}  {:>9.3f} .. {:<9.3f} {} of {:.3f} .. {:.3f}\n", r["joint"].get<int>(),
                           r["min"].get<double>(), r["max"].get<double>(), r["unit"].get<std::string>(),
                           r["limit_min"].get<double>(), r["limit_max"].get<double>());
              }
              for (const std::string& note : result.notes) fmt::print("note: {}\n", note);
            }
            return result.ok ? kDone : kAnswerIsNo;
          }};
}

}  // namespace polypod::app
