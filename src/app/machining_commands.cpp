// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// predict, correct
#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <memory>

#include "commands.hpp"
#include "covariance_files.hpp"
#include "job_input.hpp"
#include "json_rows.hpp"
#include "machining_output.hpp"
#include "measured_problems.hpp"
#include "messages.hpp"
#include "polypod/core/files.hpp"
#include "polypod/core/text.hpp"
#include "polypod/core/units.hpp"
#include "polypod/gcode/writer.hpp"
#include "polypod/kinematics/any_machine.hpp"
#include "polypod/machining/accept.hpp"
#include "polypod/machining/confidence.hpp"
#include "polypod/machining/correct.hpp"
#include "polypod/machining/tilted.hpp"
#include "polypod/machining/uncertainty.hpp"
#include "polypod/pages/correction.hpp"
#include "polypod/pages/prediction.hpp"
#include "stages_line.hpp"
#include "vibration_output.hpp"
#include "weight_output.hpp"

namespace polypod::app {
namespace {

using units::to_mm;
using units::to_um;

constexpr const char* kStockLeftHelp =
    "Write the stock that the deflected tool leaves, for the job of the next set-up (kind = \"file\")";

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

constexpr const char* kVibrationOfCorrect =
    "not judged, and not in the answer; polypod predict judges it where the machine has masses";

/// Whether the measured compliance is beyond doubt, so that a yes can rest on it.
bool trusted(const machining::Job& job) {
  return !job.measured || job.measured->doubts.empty();
}

// mm; the range of --step, as that of a job's step_mm
constexpr double kLeastStep = 0.01, kMostStep = 10;

/// "The answer is no" where a rapid goes through material; the figures have been given.
int end(const Context& context, const Status& collision) {
  if (collision) return kDone;
  print_error(context, collision.error());
  return kAnswerIsNo;
}

/// um, the largest tube that makes sense
constexpr double kLeastTolerance = 1e-3, kMostTolerance = 1e5;

void print_stock_left(const std::string& file, const cutting::Stock& stock, bool all_judged,
                      const std::optional<machining::OtherSwitch>& other) {
  fmt::print("wrote {}: the stock that is left{}, {:.0f} mm3{}\n", one_line(file),
             !other                ? ""
             : other->block_delete ? " with block delete off"
                                   : " with block delete on",
             units::to_mm3(stock.volume()),
             all_judged ? "" : ", by the deflections found, of which not all are judged");
}

/// Error: AP127. What a tilted tool leaves is known along that tool alone, and a stock file is along z of W.
Status no_stock_of_a_tilted_tool(const machining::Job& job, const std::string& file) {
  if (file.empty() || !job.tool_frame.tilted) return {};
  return fail("AP127",
              fmt::format("--stock-left, but the tool cuts at {}: what is left is known as heights along the tool, not "
                          "along z of W",
                          machining::orientation_in_words(job.tool_frame.axes)),
              {file}, "leave --stock-left out");
}

/// `tool_axes_deg`, where the tool is tilted.
void add_tool(Json& document, const machining::Job& job) {
  if (job.tool_frame.turns) document["tool_turns"] = true;
  if (job.tool_frame.tilted) document["tool_axes_deg"] = vector_json(job.tool_frame.axes * units::to_deg(1));
}

/// By name; empty where there is none to name.
std::string posture_of_first_cut(const machining::Job& job, const machining::Prediction& p,
                                 const LongVector<gcode::Move>& programmed) {
  if (p.moves.empty()) return {};
  return machining::posture_at_start(job, programmed[static_cast<std::size_t>(p.moves.front().move)]);
}

/// The box of the stock in W, m.
Eigen::AlignedBox3d stock_box(const machining::Job& job) {
  return job.tool_frame.tilted ? job.tool_frame.stock_in_W : Eigen::AlignedBox3d(job.stock.min(), job.stock.max());
}

/// "X -1 .. 101, Y -1 .. 71, Z -21 .. 1 mm", and that it is hollow.
std::string box_in_words(const machining::Job& job) {
  const cutting::Stock& stock = job.stock;
  const Vec3 low = stock_box(job).min() * units::kMmPerMetre, high = stock_box(job).max() * units::kMmPerMetre;
  const auto mm = [](double x) { return gcode::number(x, 3); };
  return fmt::format("X {} .. {}, Y {} .. {}, Z {} .. {} mm{}", mm(low.x()), mm(high.x()), mm(low.y()), mm(high.y()),
                     mm(low.z()), mm(high.z()),
                     stock.hollow() == nullptr || job.tool_frame.tilted ? "" : ", hollow where the other side was cut");
}

int line_of(const Input& in, int move) {
  const gcode::Move& m = in.interpretation.moves[static_cast<std::size_t>(move)];
  return in.program.blocks[static_cast<std::size_t>(m.block)].line;
}

/// What is said of machining::lever_change.
std::string in_words(const machining::LeverChange& levers, int line) {
  if (levers.points == 0)
    return "what the load changes of them is known of serial arms with compliances of joints alone";
  if (!levers.settles) return "no balance under the load was found at some points, where the arm would buckle";
  return fmt::format("the load changes them: up to {:.2f} um of {:.1f} um, {} %, in line {}; not in the deflections",
                     to_um(levers.most), to_um(levers.deflection),
                     levers.deflection > 0 ? fmt::format("{:.2g}", 100 * levers.most / levers.deflection) : "0", line);
}

}  // namespace

Command predict_command() {
  struct Options {
    std::string program, job, report, stock_left, branch;
    std::vector<std::string> measured, covariances;
    double step_mm = 0;
    bool at_rest = false, again = false, levers = false;
    VibrationQuestion vibration;
    WeightQuestion weight;
  };
  auto o = std::make_shared<Options>();
  return {
      "predict", "Deflection of the tool along a program", "polypod predict program.ngc --job job.toml",
      [o](Arguments& a) {
        a.positional("PROGRAM", o->program, "The G-code program");
        a.option("--job", o->job, "The job file: machine, origin, cutter, material, stock, tolerance", true);
        a.option("--branch", o->branch, kBranchHelp);
        a.options("--measured", o->measured, kMeasuredHelp);
        a.option("--covariance", o->covariances, kCovarianceHelp);
        a.option("--step", o->step_mm, "Longest distance between evaluated points, mm (default: the job's)");
        a.option("--report", o->report, "An HTML page: the machine on its way, the deflected path, errors and forces");
        a.option("--stock-left", o->stock_left, kStockLeftHelp);
        a.flag("--again", o->again, "Take a program that Polypod has corrected like any other");
        a.flag("--at-rest", o->at_rest,
               "Force at the commanded point, without the feedback of the deflection on the cut");
        a.flag(
            "--levers", o->levers,
            "How much the load changes the deflections of an arm by turning its levers (the term K_C of its stiffness "
            "under load), which they leave out");
        o->vibration.declare(a);
        o->weight.declare(a);
      },
      [o](const Context& context) -> Result<int> {
        if (context.given("--step"))
          POLYPOD_TRY(in_range("AP120", "--step", o->step_mm, {kLeastStep, kMostStep}, "mm"));
        std::vector<std::string> inputs = o->measured;
        inputs.insert(inputs.end(), {o->program, o->job, o->vibration.dynamics});
        inputs.insert(inputs.end(), o->covariances.begin(), o->covariances.end());
        POLYPOD_TRY(check_files(inputs, {o->stock_left, o->report}, context.json));
        POLYPOD_ASSIGN(in, read_input(context, o->program, o->job, o->measured));
        POLYPOD_TRY(begin_in(o->branch, in.interpretation, in.job));
        POLYPOD_TRY(machining::set_up(in.job, in.program, in.interpretation));
        POLYPOD_TRY(no_stock_of_a_tilted_tool(in.job, o->stock_left));
        const bool corrected = machining::corrected_line(in.program) > 0;
        if (corrected && !o->stock_left.empty()) {
          return fail("AP126",
                      "--stock-left of a corrected program: its blocks do not say which of them are transitions",
                      {o->program}, "write the stock with the correction: polypod correct ... --stock-left FILE");
        }
        POLYPOD_ASSIGN(known, read_covariances(in.job, o->covariances));
        machining::PredictOptions options;
        options.keep_samples = !o->report.empty();
        options.keep_stock = !o->stock_left.empty() || (!o->report.empty() && !in.job.tool_frame.tilted);
        options.bend = o->at_rest ? machining::Bend::at_rest : machining::Bend::equilibrium;
        options.step = units::from_mm(o->step_mm);
        options.again = o->again;
        options.other = in.other_position();
        options.progress = progress_line(context, "predicting");
        POLYPOD_TRY(o->vibration.prepare(in.job, in.interpretation, context));
        POLYPOD_TRY(o->weight.prepare(in.job, o->vibration.dynamics, context));
        POLYPOD_ASSIGN(p, machining::predict(in.job, in.program, in.interpretation, options));
        POLYPOD_ASSIGN(band, machining::force_band(in.job, in.program, in.interpretation, p, options));
        const machining::MapBand map = machining::map_band(in.job, p);
        const machining::LeverChange levers = o->levers ? machining::lever_change(in.job, p) : machining::LeverChange{};
        const machining::Uncertainty uncertainty =
            machining::uncertainty_of(in.job, p, pointer_to(known.compliances), pointer_to(known.parameters));
        options.progress(1);
        POLYPOD_TRY(o->vibration.answer(in.job, in.program, in.interpretation, p, options, context));
        POLYPOD_TRY(o->weight.answer(in.job, p));
        if (corrected) {
          p.notes.insert(
              p.notes.begin(),
              "the program was corrected: distances are from its own commands, which lie beside the path of the "
              "part on purpose; what `polypod correct` said of that path stands in its report");
        }
        const std::string posture = posture_of_first_cut(in.job, p, in.interpretation.moves);
        const bool spread = !in.job.material.spread.empty();
        const bool trust = trusted(in.job), within = o->vibration.within(in.job, p) && trust;
        Status collision = machining::no_rapid_cuts(in.job, in.program, p.pass);
        const bool other_collides = collision && p.other_switch && p.other_switch->collision;
        if (other_collides) collision = tl::unexpected(*p.other_switch->collision);
        const bool leaves = !o->stock_left.empty() && collision;  // after a collision nobody knows what is left
        files::Outputs together;  // the stock and the page appear together or not at all
        if (leaves) POLYPOD_TRY(together.add(o->stock_left, cutting::stock_bytes(p.stock_left)));
        if (!o->report.empty()) {
          pages::PredictionPageOptions page;
          page.version = POLYPOD_VERSION;
          page.command = command_line();
          page.within = within && collision.has_value();
          page.collides = !collision;
          page.with_vibration = o->vibration.counts;
          page.weight = o->weight.in_words();
          page.at_rest = o->at_rest;
          if (!collision) page.against.push_back(to_string(collision.error()));
          if (const std::string why = o->vibration.against(in.job, p); !why.empty()) page.against.push_back(why);
          if (!trust) {
            page.against.push_back("The measured compliance is doubtful: " + in.job.measured->doubts.front().message +
                                   ".");
          }
          POLYPOD_TRY(together.add(
              o->report, pages::prediction_page(in.job, in.program, in.interpretation, p, std::move(p.samples), page)));
        }
        POLYPOD_TRY(together.commit());
        if (context.json) {
          const auto move_row = [&](std::size_t i) -> std::optional<Json> {
            const machining::MovePrediction& m = p.moves[i];
            Json row{{"line", m.line},
                     {"length_mm", to_mm(m.length)},
                     {"points", m.points},
                     {"deflection_um", {{"max", to_um(m.deflection.max)}, {"mean", to_um(m.deflection.mean)}}},
                     {"normal_error_um", spread_json(m.normal, units::kUmPerMetre)},
                     {"vertical_error_um", spread_json(m.vertical, units::kUmPerMetre)},
                     {"distance_max_um", to_um(m.largest_distance)},
                     {"mean_force_N", vector_json(m.mean_force)},
                     {"mean_force_size_N", m.mean_force_size},
                     {"depth_max_mm", to_mm(m.largest_depth)}};
            if (spread) row["normal_mean_band_95_um"] = to_um(band.normal_by_move[i]);
            return row;
          };
          const Vec3 low = stock_box(in.job).min() * units::kMmPerMetre,
                     high = stock_box(in.job).max() * units::kMmPerMetre;
          Json document{{"origin_mm", vector_json(in.job.X_MW.p * units::kMmPerMetre)},
                        {"stock_mm", {{"min", vector_json(low)}, {"max", vector_json(high)}}},
                        {"machine", in.job.machine_name},
                        {"model", o->at_rest ? "at rest" : "equilibrium"},
                        {"points", p.deflection.count},
                        {"deflection_um", {{"max", to_um(p.deflection.max)}, {"mean", to_um(p.deflection.mean)}}},
                        {"normal_error_um", spread_json(p.normal, units::kUmPerMetre)},
                        {"vertical_error_um", spread_json(p.vertical, units::kUmPerMetre)},
                        {"distance_max_um", to_um(p.largest_distance)},
                        {"corner_deviation_um", to_um(p.corner)},
                        {"distance_with_corners_um", to_um(p.largest_with_corners)},
                        {"tolerance_um", rounded_um(in.job.tolerance)},
                        {"within_tolerance", within},
                        {"not_judged", not_judged_json(p.not_judged, p.plunges)},
                        {"all_judged", p.all_judged()},
                        {"not_judged_distance_um", to_um(p.farthest_not_judged().distance)},
                        {"steep_not_judged", steep_json(p.steep)},
                        {"slow_corners_not_judged", slow_corners_json(p.slow)},
                        {"time_s", p.time},
                        {"removed_mm3", units::to_mm3(p.pass.removed)},
                        {"moves", Json::array()},
                        {"notes", p.notes}};
          if (!posture.empty()) document["branch"] = posture;
          if (spread) {
            document["band_95_um"] = {{"deflection_max", to_um(band.deflection_max)},
                                      {"deflection_mean", to_um(band.deflection_mean)},
                                      {"normal_mean", to_um(band.normal_mean)}};
          }
          add_other_switch(document, p.other_switch, trust);
          o->vibration.add_to(document, p);
          o->weight.add_to(document);
          if (!collision) document["collision"] = to_string(collision.error());
          if (!o->report.empty()) document["report"] = o->report;
          if (leaves) {
            document["stock_left"] = o->stock_left;
            document["stock_left_mm3"] = units::to_mm3(p.stock_left.volume());
          }
          add_map(document, in.job, map);
          add_uncertainty(document, uncertainty);
          add_tool(document, in.job);
          if (o->levers) {
            document["levers"] = levers.points == 0 ? Json()
                                                    : Json{{"change_um", to_um(levers.most)},
                                                           {"of_um", to_um(levers.deflection)},
                                                           {"points", levers.points},
                                                           {"balanced", levers.settles}};
            if (levers.move >= 0) document["levers"]["line"] = line_of(in, levers.move);
          }
          print_json(document, {{"moves", p.moves.size(), move_row}});
          return end(context, collision);
        }
        const Vec3 origin = in.job.X_MW.p * units::kMmPerMetre;
        fmt::print("{} on {}, origin of W at x {:g} y {:g} z {:g} mm\n", one_line(o->program),
                   one_line(in.job.machine_name), origin.x(), origin.y(), origin.z());
        fmt::print("stock          {}\n", box_in_words(in.job));
        if (in.job.tool_frame.tilted)
          fmt::print("tool           {} in every cut\n", machining::orientation_in_words(in.job.tool_frame.axes));
        if (in.job.tool_frame.turns)
          fmt::print("tool           a ball that turns in cuts, or cuts in several orientations\n");
        if (!posture.empty()) fmt::print("posture        {} in the first cut\n", posture);
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
          const double tube = in.job.tolerance - machining::resolution(in.job);
          fmt::print("corners        the controller rounds them by up to {:.1f} um more{}{}\n", to_um(p.corner),
                     p.largest_distance <= tube && p.largest_with_corners > tube
                         ? ": with them it is beyond the tolerance"
                         : "",
                     within ? "" : ", see G64 P in docs/path-modes.md");
        }
        print_steep(p.steep, p.largest_distance);
        print_slow_corners(p.slow, p.largest_with_corners);
        print_plunges(p.plunges, p.plunge_within, p.largest_distance);
        print_other_switch(p.other_switch, trust, false);
        o->vibration.print(in.job, p);
        o->weight.print();
        if (spread) {
          fmt::print(
              "coefficients   +- {:.1f} um of the mean normal error, +- {:.1f} um of the largest deflection (95 %)\n",
              to_um(band.normal_mean), to_um(band.deflection_max));
        }
        print_map(in.job, map);
        if (o->levers)
          fmt::print("levers         {}\n", in_words(levers, levers.move >= 0 ? line_of(in, levers.move) : 0));
        print_uncertainty(uncertainty, uncertainty.reach && within ? &*uncertainty.reach : nullptr);
        if (!p.moves.empty()) fmt::print("\n  line   length    normal error um     distance um  mean force N\n");
        constexpr std::size_t kMost = 40;
        for (std::size_t i = 0; i < std::min(kMost, p.moves.size()); ++i) {
          const machining::MovePrediction& m = p.moves[i];
          fmt::print("  {:>4} {:>8.2f}   {:>7} .. {:<7} {:>9.1f} {:>13.1f}\n", m.line, to_mm(m.length),
                     unsigned_zero(fmt::format("{:.1f}", to_um(m.normal.min))),
                     unsigned_zero(fmt::format("{:.1f}", to_um(m.normal.max))), to_um(m.largest_distance),
                     m.mean_force_size);
        }
        if (p.moves.size() > kMost) fmt::print("  ... {} more, see --json\n", p.moves.size() - kMost);
        print_not_judged(p.not_judged);
        for (const std::string& note : p.notes) fmt::print("note: {}\n", note);
        if (leaves) {
          print_stock_left(o->stock_left, p.stock_left, p.all_judged(), p.other_switch);
        } else if (!o->stock_left.empty()) {
          fmt::print("{} was not written: what a collision leaves is not known\n", one_line(o->stock_left));
        }
        if (!o->report.empty()) fmt::print("report: {}\n", o->report);
        return end(context, collision);
      }};
}

Command correct_command() {
  struct Options {
    std::string program, job, output, report, stock_left, branch, method = "tube";
    std::vector<std::string> measured, covariances;
    int points = 10;
    std::string tolerance, dynamics;
    double chord_um = 0;
    bool again = false, allow_outside = false, all = false, verify = false, confidence = false;
    WeightQuestion weight;
  };
  auto o = std::make_shared<Options>();
  return {
      "correct",
      "Correct a program so that the deflected tool stays in the tolerance zone, a tube round the programmed path",
      "polypod correct program.ngc --job job.toml -o corrected.ngc --report report.html",
      [o](Arguments& a) {
        a.positional("PROGRAM", o->program, "The G-code program");
        a.option("--job", o->job, "The job file: machine, origin, cutter, material, stock, tolerance", true);
        a.option("-o,--output", o->output, "The corrected program", true);
        a.option("--report", o->report, "An HTML report of what will happen and why");
        a.option("--stock-left", o->stock_left, kStockLeftHelp);
        a.option("--branch", o->branch, kBranchHelp);
        a.options("--measured", o->measured, kMeasuredHelp);
        a.option("--covariance", o->covariances, kCovarianceHelp);
        a.option("--tolerance", o->tolerance, "Radius of the tolerance tube, um (default: the job's)");
        a.option("--chord-tolerance", o->chord_um,
                 "How far arcs that are kept as arcs may be off the ideal path, um (default: a tenth of the tube)");
        a.flag("--allow-outside", o->allow_outside,
               "Write the program even if moves stay outside of the tube, corrected as far as possible");
        a.flag("--verify", o->verify,
               "Check again with half the cell size and half the step before the answer is yes (five times the time)");
        a.flag("--confidence", o->confidence,
               "How likely each wall is inside the tube, by --covariance of the compliances and spread_95 of the "
               "material, and which input to know better");
        a.flag("--correct-all", o->all, "Correct moves inside the tube, too, where it adds no lines");
        a.flag("--again", o->again, "Take a program that Polypod has corrected like any other");
        a.option("--method", o->method,
                 "tube, or mirror: one step at --points points a move, for comparison and written in any case");
        a.option("--points", o->points, "Pieces a move for --method mirror");
        a.option("--dynamics", o->dynamics,
                 "A file with the table `dynamics`: masses (default: that of the machine file)");
        o->weight.declare(a);
      },
      [o](const Context& context) -> Result<int> {
        machining::CorrectOptions options;
        if (o->method == "mirror") {
          options.method = machining::CorrectMethod::mirror;
        } else if (o->method != "tube") {
          return fail("AP121", fmt::format("--method {}: not tube or mirror", o->method));
        }
        if (o->method == "tube") POLYPOD_TRY(refuse(context, {"--points"}, "it serves --method mirror"));
        if (o->method == "mirror") {
          POLYPOD_TRY(refuse(context, {"--correct-all", "--chord-tolerance", "--allow-outside", "--verify"},
                             "it serves --method tube; the mirror writes every cutting move, whatever the tube"));
        }
        POLYPOD_TRY(in_range("AP122", "--points", o->points, {1, 100000}, "pieces a move"));
        options.mirror_points = o->points;
        double tolerance_um = 0;
        if (!o->tolerance.empty()) {
          const auto given = numbers_of(o->tolerance, "--tolerance");
          if (!given || given->size() != 1)
            return fail("AP122", fmt::format("--tolerance {}: not a number", o->tolerance), {},
                        "one number in um: --tolerance 80");
          POLYPOD_TRY(in_range("AP122", "--tolerance", given->front(), {kLeastTolerance, kMostTolerance}, "um"));
          tolerance_um = given->front();
        }
        if (context.given("--chord-tolerance")) {
          POLYPOD_TRY(in_range("AP122", "--chord-tolerance", o->chord_um, {kLeastTolerance, kMostTolerance}, "um"));
        }
        options.chord = units::from_um(o->chord_um);
        options.again = o->again;
        options.all = o->all;
        options.verify = o->verify;
        std::vector<std::string> inputs = o->measured;
        inputs.insert(inputs.end(), {o->program, o->job, o->dynamics});
        inputs.insert(inputs.end(), o->covariances.begin(), o->covariances.end());
        POLYPOD_TRY(check_files(inputs, {o->output, o->report, o->stock_left}, context.json));
        POLYPOD_ASSIGN(in, read_input(context, o->program, o->job, o->measured, true));
        POLYPOD_TRY(begin_in(o->branch, in.interpretation, in.job));
        POLYPOD_TRY(machining::set_up(in.job, in.program, in.interpretation));
        POLYPOD_TRY(no_stock_of_a_tilted_tool(in.job, o->stock_left));
        POLYPOD_ASSIGN(known, read_covariances(in.job, o->covariances));
        const auto& spread = in.job.material.spread;
        const bool exact = std::all_of(spread.begin(), spread.end(),
                                       [](const std::array<double, 6>& row) { return row == std::array<double, 6>{}; });
        if (o->confidence && !known.compliances && exact) {
          return fail("AP202", "--confidence, but no input is said to be uncertain", {o->job},
                      "give --covariance FILE of identified compliances, or a material with spread_95");
        }
        if (o->confidence) POLYPOD_TRY(machining::force_is_known(in.job));
        if (tolerance_um > 0) in.job.tolerance = units::from_um(tolerance_um);
        options.keep_samples = !o->report.empty();
        options.keep_stock = !o->stock_left.empty() || (!o->report.empty() && !in.job.tool_frame.tilted);
        options.other = in.other_position();
        POLYPOD_TRY(o->weight.prepare(in.job, o->dynamics, context));
        StagesLine line(context);
        options.progress = [&](const char* what, double share) { return line(what, share); };
        POLYPOD_ASSIGN(c, machining::correct(in.job, in.program, in.interpretation, options));
        line.end();
        POLYPOD_TRY(o->weight.answer(in.job, c.before));
        if (!trusted(in.job)) {
          c.within_tolerance = c.only_not_judged = false;
          c.reason = "the measured compliance is doubtful: " + in.job.measured->doubts.front().message;
          c.remedies = {in.job.measured->doubts.front().hint};
        }
        const machining::Uncertainty uncertainty =
            machining::uncertainty_of(in.job, c, pointer_to(known.compliances), pointer_to(known.parameters));
        std::optional<machining::Confidence> confidence;
        if (o->confidence) {
          const auto progress = progress_line(context, "asking how likely it is");
          POLYPOD_ASSIGN(found, machining::confidence_of(in.job, in.program, c,
                                                         known.compliances.value_or(Eigen::MatrixXd(0, 0)), progress));
          progress(1);
          confidence = std::move(found);
        }
        const std::string posture = posture_of_first_cut(in.job, c.before, c.programmed);
        const bool writes =
            c.within_tolerance || o->allow_outside || options.method == machining::CorrectMethod::mirror;
        files::Outputs together;  // program and report appear together or not at all
        if (writes) POLYPOD_TRY(together.add(o->output, c.text()));
        if (!o->report.empty()) {
          pages::CorrectionPageOptions page;
          page.weight = o->weight.in_words();
          page.version = POLYPOD_VERSION;
          page.output = writes ? o->output : "";
          page.method = options.method;
          page.uncertainty = uncertainty;
          page.confidence = confidence;
          page.command = command_line();
          POLYPOD_TRY(together.add(o->report, pages::correction_page(in.job, in.program, c, page)));
        }
        if (writes && !o->stock_left.empty())
          POLYPOD_TRY(together.add(o->stock_left, cutting::stock_bytes(c.stock_left)));
        POLYPOD_TRY(together.commit());
        const machining::MapBand map = machining::map_band(in.job, c.before);
        if (context.json) {
          const auto move_row = [&](std::size_t i) -> std::optional<Json> {
            const machining::MoveOutcome& m = c.moves[i];
            return Json{{"line", m.line},
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
                        {"within_tolerance", m.within && !m.judged ? Json() : Json(m.within)}};
          };
          const auto outside_row = [&](std::size_t i) { return c.moves[i].within ? std::nullopt : move_row(i); };
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
                        {"arcs_as_chords", c.modes.chords},
                        {"time_before_s", c.modes.time_before},
                        {"time_after_s", c.modes.time_after},
                        {"moves_left_as_they_were", c.left_as_they_were},
                        {"not_judged", not_judged_json(c.after.not_judged, c.after.plunges)},
                        {"all_judged", c.all_judged()},
                        {"not_judged_distance_um", to_um(c.after.farthest_not_judged().distance)},
                        {"vibration", {{"judged", false}, {"counted", false}, {"why_not", kVibrationOfCorrect}}},
                        {"answer", answer_in_words(c, uncertainty.reach)},
                        {"short_blocks", short_blocks_json(c.short_blocks)},
                        {"steep_not_judged", steep_json(c.after.steep)},
                        {"slow_corners_not_judged", slow_corners_json(c.after.slow)},
                        {"written", writes},
                        {"stock_left", writes ? o->stock_left : ""},
                        {"outside", Json::array()},
                        {"moves", Json::array()},
                        {"notes", notes},
                        {"report", o->report}};
          o->weight.add_to(document);
          add_other_switch(document, c.other_switch, trusted(in.job));
          add_map(document, in.job, map);
          add_uncertainty(document, uncertainty);
          add_tool(document, in.job);
          if (!posture.empty()) document["branch"] = posture;
          if (confidence) document["confidence"] = confidence_json(*confidence);
          print_json(document, {{"outside", c.moves.size(), outside_row}, {"moves", c.moves.size(), move_row}});
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
          if (!posture.empty()) fmt::print("posture        {} in the first cut\n", posture);
          fmt::print("vibration      {}\n", kVibrationOfCorrect);
          o->weight.print();
          print_short_blocks(c.short_blocks, writes);
          print_other_switch(c.other_switch, trusted(in.job), true);
          print_map(in.job, map);
          print_uncertainty(uncertainty, nullptr);  // said with the answer
          print_outside(c);
          print_not_judged(c.after.not_judged);
          print_answer(c, uncertainty.reach);
          if (confidence) print_confidence(*confidence);
          for (const std::string& note : c.before.notes) fmt::print("note: {}\n", note);
          for (const std::string& note : c.after.notes) fmt::print("note, corrected: {}\n", note);
          if (writes) fmt::print("wrote {}\n", o->output);
          if (writes && !o->stock_left.empty())
            print_stock_left(o->stock_left, c.stock_left, c.all_judged(), c.other_switch);
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

}  // namespace polypod::app
