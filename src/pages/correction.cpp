// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/pages/correction.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cctype>
#include <cmath>
#include <set>

#include "correction_figures.hpp"
#include "path_answers.hpp"
#include "path_film.hpp"
#include "polypod/core/units.hpp"
#include "polypod/kinematics/parts.hpp"
#include "polypod/machining/tilted.hpp"
#include "polypod/report/html.hpp"

namespace polypod::pages {
namespace {

using machining::Correction;
using machining::CorrectMethod;
using machining::Job;
using machining::MoveOutcome;
using machining::Spread;
using report::Cell;
using report::fixed;
using report::KeyFigure;
using report::number;
using report::Report;
using report::Table;
using report::Verdict;
using units::to_mm;
using units::to_um;

constexpr std::size_t kWholeTable = 60;     // moves up to which the table holds all
constexpr std::size_t kWorst = 30;          // and how many of more
constexpr std::size_t kWholeProgram = 400;  // lines up to which the corrected program is shown in full
constexpr std::size_t kHeaderLines = 12;
constexpr const char* kUm = "µm";

using Entries = std::vector<std::pair<std::string, std::string>>;

std::string um(double metres) {
  return fixed(to_um(metres), 1) + " " + kUm;
}

/// An uncertainty, to two figures.
std::string um2(double metres) {
  return number(to_um(metres), 2) + " " + kUm;
}

std::string range_of(const Spread& s) {
  if (s.count == 0) return "–";
  // No-break spaces keep a range on one line of its cell.
  return fmt::format("{}\u00a0…\u00a0{}", fixed(to_um(s.min), 0), fixed(to_um(s.max), 0));
}

/// An input as it was given: no digits that say nothing.
std::string given(double value) {
  const std::string text = fmt::format("{:.6g}", value == 0 ? 0.0 : value);
  return text[0] == '-' ? "−" + text.substr(1) : text;
}

std::string name_of_file(const std::string& path) {
  const std::size_t slash = path.find_last_of('/');
  return slash == std::string::npos ? path : path.substr(slash + 1);
}

std::string vector_mm(const Vec3& v) {
  return fmt::format("x {}, y {}, z {} mm", given(to_mm(v.x())), given(to_mm(v.y())), given(to_mm(v.z())));
}

std::string count(std::size_t n) {
  return fixed(static_cast<double>(n), 0);
}
std::string plural(std::size_t n, const char* one, const char* many) {
  return fmt::format("{} {}", count(n), n == 1 ? one : many);
}

class Page {
 public:
  Page(const Job& job, const gcode::Program& program, const Correction& c, const CorrectionPageOptions& options)
      : job_(job),
        program_(program),
        c_(c),
        options_(options),
        band_(machining::map_band(job, c.before)),
        tracks_(program, c),
        report_(title(), subtitle(), facts()) {}

  std::string html() {
    answer();
    if (!tracks_.stretches.empty()) {
      const Overview view = overview(job_, c_, tracks_);
      const bool in_motion = add_path_film(report_, job_, program_, c_, tracks_, view.factor, &c_.stock_left);
      paths(view);
      if (!in_motion) in_space(view.factor);
      corners();
      errors();
      forces();
      machine_round_the_part();
    }
    moves();
    confidence();
    limits();
    inputs();
    new_program();
    return report_.to_html();
  }

 private:
  [[nodiscard]] std::string title() const { return fmt::format("Correction of {}", name_of_file(program_.path)); }
  [[nodiscard]] std::string subtitle() const {
    return fmt::format(
        "What {} will do when it runs this program, before and after the correction of its static deflection. The "
        "tolerance zone is a cylinder round the programmed path with a sphere at each end, called tube here",
        machine::name_of(job_.machine));
  }
  [[nodiscard]] Entries facts() const {
    Entries out{{"program", program_.path},
                {"job", job_.path},
                {"machine", job_.machine_name},
                {"tolerance", fmt::format("tube of {} {} radius", given(to_um(c_.tolerance)), kUm)},
                {"corrected program", options_.output.empty() ? "not written" : options_.output}};
    if (!options_.version.empty()) out.emplace_back("made with", "Polypod " + options_.version);
    return out;
  }

  [[nodiscard]] bool mirror() const { return options_.method == CorrectMethod::mirror; }

  /// What the uncertainty of the compliances makes of a yes, and what the tube does not hold.
  void with_uncertainty() {
    const auto& reach = options_.uncertainty.reach;
    if (reach && c_.within_tolerance) {
      report_.add_verdict(
          reach->within ? Verdict::good : Verdict::neutral,
          fmt::format("With the uncertainty of the compliances, U (k = 2), the tool comes as far as {} from the "
                      "programmed path {} ({} and U {}): {} the tube.",
                      um(reach->total()), reach->where(), um(reach->distance), um2(reach->U),
                      reach->within ? "still inside" : "beyond"));
    }
    if (const auto& place = options_.uncertainty.place; place && place->tip.count > 0) {
      report_.add_verdict(Verdict::neutral,
                          fmt::format("The tube is compared with the deflection of the machine, not with the "
                                      "uncertainty of its position: by the uncertainty of its calibrated parameters "
                                      "the tip is known to U (k = 2) = {} on average, {} at the most (line {}).",
                                      um2(place->tip.mean), um2(place->tip.max), place->line));
    }
  }

  /// How far the bend may be where the force changes quickly, if that is farther than what is said.
  [[nodiscard]] std::string quick_changes() const {
    const machining::Steep& steep = c_.after.steep;
    if (to_um(steep.within) < to_um(c_.largest_after) + 1) return "";
    return fmt::format(", and may be up to {} {} where the force changes quickly (line {})",
                       fixed(to_um(steep.within), 0), kUm, steep.within_line);
  }

  /// The slow corner that leaves most inside the tube, likewise.
  [[nodiscard]] std::string slow_corners() const {
    const machining::SlowCorners& slow = c_.after.slow;
    if (to_um(slow.within) < to_um(c_.largest_after) + 1) return "";
    return fmt::format(", and may be up to {} {} where the controller slows down (line {})",
                       fixed(to_um(slow.within), 0), kUm, slow.within_line);
  }

  /// The plunge that leaves most inside the tube, if that is more than what is said.
  [[nodiscard]] std::string held_back() const {
    const machining::Plunge& plunge = c_.after.plunge_within;
    if (to_um(plunge.distance) < to_um(c_.largest_after) + 1) return "";
    return fmt::format(", and the thrust may leave up to {} {} at the end of the plunge of line {}",
                       fixed(to_um(plunge.distance), 0), kUm, plunge.line);
  }

  void other_position(const machining::OtherSwitch& other) {
    add_other_position(report_, other, true);
    if (other.fixed) {
      report_.add_verdict(Verdict::neutral,
                          fmt::format("The program that was written is for block delete {}; the switch does not act on "
                                      "it. A job with block_delete = {} gives the one for the other position.",
                                      job_.block_delete ? "on" : "off", !job_.block_delete));
    }
  }

  void short_blocks() {
    const machining::ShortBlocks& s = c_.short_blocks;
    if (s.count == 0) return;
    report_.add_verdict(
        Verdict::neutral,
        fmt::format(
            "{} of {} blocks of rewritten moves are shorter than [controller] of the job asks, because shared corners "
            "would leave the tube there: least {} mm and {} ms. The first is of line {}{}.",
            s.count, s.written, fixed(to_mm(s.length), 3), fixed(s.time / units::from_ms(1), 1), s.line,
            options_.output.empty() ? "" : fmt::format(", in line {} of the corrected program", s.written_line)));
  }

  void answer() {
    report_.add_section("Does the deflected tool stay within the tolerance?");
    const std::string checked = fmt::format("{} of the program that was written were checked, at most 0.1 mm apart{}",
                                            plural(c_.after.pass.points, "point", "points"),
                                            c_.verified ? ", and again with cells half as large" : "");
    if (c_.within_tolerance) {
      const auto& reach = options_.uncertainty.reach;
      const bool sure = !reach || reach->within;
      std::string but = c_.all_judged() ? "" : ", apart from what was not judged";
      if (!sure) but += ", by the compliances as identified";
      report_.add_verdict(
          c_.all_judged() && sure ? Verdict::good : Verdict::neutral,
          fmt::format(
              "Yes{}. The deflected tool stays within {} {} of the programmed path along every cutting move{}: the "
              "largest distance is {}{}{}. {}.",
              but, given(to_um(c_.tolerance)), kUm,
              c_.modes.corner_after > 0 ? ", the corners that the controller rounds counted" : "", um(c_.largest_after),
              quick_changes(), slow_corners() + held_back(), checked));
    } else {
      std::string reason = with_sign(c_.reason);
      if (!reason.empty()) reason.front() = static_cast<char>(std::toupper(static_cast<unsigned char>(reason.front())));
      report_.add_verdict(
          Verdict::bad,
          fmt::format("No{}. {}. {}.{}", c_.only_not_judged ? ", because not all of the cut is judged" : "", reason,
                      checked,
                      options_.output.empty() ? " No corrected program was written."
                                              : " It was written all the same, with these moves as near as they go."));
      outside();
    }
    with_uncertainty();
    add_not_judged(report_, c_.after.steep, "");
    add_not_judged(report_, c_.after.slow, "");
    add_not_judged(report_, c_.after.plunges, "");
    if (c_.other_switch) other_position(*c_.other_switch);
    short_blocks();
    if (c_.largest_after > c_.largest_before) {
      report_.add_verdict(Verdict::bad, "The largest distance is not smaller than that of the program as it is.");
    }
    report_.add_text(
        "This answers for static deflection under the mean cutting force and for the controller's corners alone: not "
        "for "
        "collisions of tool, holder and machine, not for vibration, and not for geometric errors of the machine.");
    if (mirror()) {
      report_.add_verdict(Verdict::neutral,
                          "Made with the one-step mirror at equally spaced points, for comparison; the default method "
                          "finds the command as a fixed point and keeps to the tube.");
    }
    const Verdict good = c_.within_tolerance ? Verdict::good : Verdict::bad;
    std::vector<KeyFigure> figures;
    figures.push_back({fixed(to_um(c_.largest_before), 1), kUm,
                       "largest distance from the path with the controller's corners, as it is",
                       c_.largest_before <= c_.tolerance ? Verdict::good : Verdict::bad});
    figures.push_back({fixed(to_um(c_.largest_after), 1), kUm,
                       fmt::format("largest distance, corrected (tube {} {})", given(to_um(c_.tolerance)), kUm), good});
    if (c_.before.normal.count > 0) {
      figures.push_back({fixed(to_um(c_.before.normal.mean), 1), kUm,
                         fmt::format("mean normal error as it is ({})", range_of(c_.before.normal)), Verdict::neutral});
    }
    if (c_.after.normal.count > 0) {
      figures.push_back({fixed(to_um(c_.after.normal.mean), 1), kUm,
                         fmt::format("mean normal error, corrected ({})", range_of(c_.after.normal)),
                         Verdict::neutral});
    }
    figures.push_back({count(index(c_.rewritten_moves)), "",
                       fmt::format("of {} rewritten", plural(c_.moves.size(), "cutting move", "cutting moves")),
                       Verdict::neutral});
    figures.push_back({fmt::format("{} → {}", count(c_.lines_in), count(c_.lines_out)), "",
                       fmt::format("lines of program: {}, {}", plural(index(c_.pieces), "piece", "pieces"),
                                   plural(index(c_.transitions), "transition", "transitions")),
                       Verdict::neutral});
    if (!mirror()) {
      figures.push_back({fixed(to_um(c_.modes.corner_after), 1), kUm,
                         fmt::format("rounded by the controller at the worst corner, {} before",
                                     fixed(to_um(c_.modes.corner_before), 1)),
                         Verdict::neutral});
      figures.push_back(
          {fixed(c_.modes.time_after, 1), "s",
           fmt::format("with the planner's acceleration, {} before{}{}", fixed(c_.modes.time_before, 1),
                       c_.modes.written.empty() ? "" : "; written: " + c_.modes.written,
                       c_.modes.chords > 0 ? "; as chords: " + plural(index(c_.modes.chords), "arc", "arcs") : ""),
           Verdict::neutral});
    }
    report_.add_key_figures(figures);
    report_.add_text(
        "The normal error lies across the path in the plane: above zero the cutter leaves material on the wall that it "
        "cuts, below zero it gouges. The distance is taken in space, to the programmed move with both its ends; it "
        "decides, with the controller's corners, whether the tube is kept.");
    std::vector<std::string> all = c_.before.notes;
    for (const std::string& note : c_.after.notes) all.push_back("corrected program: " + note);
    if (!all.empty()) {
      report_.add_heading("Look at these before you run it");
      report_.add_list(all);
    }
  }

  /// The moves that stay outside, and what would help.
  void outside() {
    Table table;
    table.caption = "Moves outside of the tube";
    table.columns = {{"line", ""}, {"as it is", kUm, 1}, {"corrected", kUm, 1}, {"its corner", kUm, 1}, {"", ""}};
    constexpr std::size_t kMost = 200;
    for (const MoveOutcome& m : c_.moves) {
      if (m.within || table.rows.size() >= kMost) continue;
      table.rows.push_back({fmt::format("{}", m.line), to_um(m.distance_before), to_um(m.distance_after),
                            to_um(m.corner_after), m.rewritten ? "corrected" : "as it was"});
    }
    if (!table.rows.empty()) report_.add_table(table);
    std::vector<std::string> items;
    for (const machining::NotJudged& m : c_.after.not_judged) {
      items.push_back(fmt::format("not judged: line {}: {}", m.line, with_sign(m.why)));
    }
    for (const std::string& remedy : c_.remedies) items.push_back("what would help: " + with_sign(remedy));
    if (!items.empty()) report_.add_list(items);
  }

  void paths(const Overview& view) {
    report_.add_section("Paths");
    report_.add_figure(view.plot,
                       fmt::format("From above, in the workpiece frame. The deflection of the cutter and its "
                                   "correction are drawn {:g} times larger than they are. The command goes to one side "
                                   "so that the deflected tool comes back to the programmed path.",
                                   view.factor));
  }

  void corners() {
    if (const std::optional<Corner> near = corner(c_, tracks_)) {
      report_.add_heading(near->title);
      report_.add_figure(
          near->plot,
          "Nothing is enlarged here: the green tube is the tolerance, with a sphere at each end. Dots are "
          "the end points of the blocks of the new program.");
    }
  }

  void in_space(double factor) {
    constexpr std::size_t kDrawn = 240, kTurns = 4000;
    const report::Scene drawn = path_scene(c_, tracks_, factor, kDrawn),
                        turns = path_scene(c_, tracks_, factor, kTurns);
    report_.add_scene(
        drawn,
        fmt::format("The same in space, enlarged {:g} times here; a slider enlarges more or less where the "
                    "picture turns, and the colour there is the distance from the programmed path.",
                    factor),
        &turns);
  }

  void errors() {
    report_.add_section("Errors along the path");
    add_error_plots(report_, c_, tracks_, "What the answer rests on:");
    report_.add_figure(error_histogram(c_, tracks_), "Fraction of the checked points in bins of normal error.");
  }

  void forces() {
    report_.add_section("Forces and engagement");
    report_.add_figure(
        force_plot(c_, tracks_, job_.tool_frame.axis()),
        "Mean force per revolution that the material puts on the tool. Normal: across the path, away "
        "from the wall that is being cut. Along the feed: below zero it acts against the feed. Along the "
        "axis: above zero it lifts the tool.");
    report_.add_figure(depth_plot(tracks_),
                       "Largest axial depth at which the cutter is engaged. A sliver that a higher pass left on the "
                       "wall counts with its full height, however thin it is.");
    report_.add_figure(angle_plot(tracks_),
                       "Tooth angles between which the cutter is engaged: 0 deg is the left side of the feed, 90 "
                       "deg the front, 180 deg the right side.");
  }

  void machine_round_the_part() {
    report_.add_section("The machine round the part");
    const PartMap map = part_map(job_, c_, tracks_);
    report_.add_figure_grid(
        3, compliance_panels(job_, map),
        fmt::format("{} of the tool tip in the workpiece frame at z = {} mm, µm per N: Cxy is the displacement "
                    "along x under 1 N along y. Each picture has colours of its own; the lines are the moves that cut.",
                    job_.measured ? "Measured and interpolated compliance" : "Compliance", number(map.z, 4)));
    const JointShares shares = joint_shares(job_, tracks_);
    if (shares.joints.empty()) return;
    report::BarChart bars;
    bars.title = "Contribution of each joint to the normal deflection";
    bars.unit = kUm;
    bars.parts = shares.joints;
    for (const auto& [k, mean] : shares.by_stretch) {
      bars.rows.push_back({fmt::format("line {}", tracks_.stretches[index(k)].line), mean});
    }
    bars.rows.push_back({"all moves", shares.all});
    report_.add_heading("Which joint deflects");
    report_.add_figure(
        bars,
        "Mean deflection across the path of the program as it is, by the joint that causes it. A stiffer joint "
        "or another place of the part helps most where its bar is longest.");
    double total = 0;
    for (const double v : shares.all) total += v;
    Table table;
    table.columns = {{"joint", ""}, {"mean normal deflection", kUm, 1}, {"contribution", "%", 1}};
    for (std::size_t j = 0; j < shares.joints.size(); ++j) {
      table.rows.push_back({shares.joints[j], shares.all[j], total != 0 ? 100 * shares.all[j] / total : 0.0});
    }
    report_.add_table(table);
  }

  [[nodiscard]] std::vector<Cell> row_of(const MoveOutcome& m) const {
    const auto mean = [](const Spread& s) { return s.count == 0 ? Cell("–") : Cell(to_um(s.mean)); };
    return {fmt::format("{}", m.line),
            to_mm(m.length),
            mean(m.normal_before),
            range_of(m.normal_before),
            to_um(m.distance_before),
            mean(m.normal_after),
            range_of(m.normal_after),
            to_um(m.distance_after),
            m.rewritten ? fmt::format("{}{}", m.pieces, m.transitions > 0 ? fmt::format(" + {}", m.transitions) : "")
                        : "kept",
            !m.within  ? "no"
            : m.judged ? "yes"
                       : "in part judged"};
  }

  void moves() {
    if (c_.moves.empty()) return;
    report_.add_section("Moves");
    Table table;
    table.columns = {{"line", ""},          {"length", "mm", 2},        {"as it is", "mean, µm", 1},
                     {"", "range"},         {"distance", "largest", 1}, {"corrected", "mean, µm", 1},
                     {"", "range"},         {"distance", "largest", 1}, {"pieces", "+ transitions"},
                     {"within", "the tube"}};
    std::vector<const MoveOutcome*> chosen;
    for (const MoveOutcome& m : c_.moves) chosen.push_back(&m);
    if (chosen.size() > kWholeTable) {
      std::stable_sort(chosen.begin(), chosen.end(), [](const MoveOutcome* a, const MoveOutcome* b) {
        return a->distance_after > b->distance_after;
      });
      table.caption = fmt::format(
          "The {} of {} cutting moves that come closest to the tube's wall, worst first: normal error, and largest "
          "distance from the move",
          kWorst, count(c_.moves.size()));
      summary_of_moves();
      chosen.resize(kWorst);
    } else {
      table.caption =
          "Every cutting move by its line in the original program: normal error, and largest distance from it";
    }
    for (const MoveOutcome* m : chosen) table.rows.push_back(row_of(*m));
    report_.add_table(table);
  }

  /// How likely the walls are inside, and which input to know better.
  void confidence() {
    if (!options_.confidence) return;
    const machining::Confidence& c = *options_.confidence;
    report_.add_section("How likely are the walls inside?");
    if (c.walls.empty()) {
      report_.add_text("No move that cuts has a wall on one side.");
      return;
    }
    report_.add_text(fmt::format(
        "As far as the given inputs are uncertain, the wall of line {} is the least likely one: it is inside with a "
        "probability of {}. The share of {} draws of the inputs is given, each of which shifts all points of a wall. "
        "The geometry of the machine and what the model leaves out are not in it{}.",
        c.line, c.percent(c.least), count(static_cast<std::size_t>(c.draws)),
        c_.other_switch ? fmt::format("; it holds with block delete {}", job_.block_delete ? "on" : "off") : ""));
    std::vector<const machining::WallConfidence*> walls;
    for (const machining::WallConfidence& w : c.walls) walls.push_back(&w);
    std::stable_sort(walls.begin(), walls.end(),
                     [](const auto* a, const auto* b) { return a->probability < b->probability; });
    constexpr std::size_t kWalls = 20;
    Table table;
    table.caption = walls.size() > kWalls
                        ? fmt::format("The {} of {} walls that are least likely inside", kWalls, count(walls.size()))
                        : "The walls, the least likely one first";
    table.columns = {{"line", ""},
                     {"normal error", "95 % from, µm", 1},
                     {"", "to, µm", 1},
                     {"room", "± µm", 1},
                     {"probability", "that all of it is inside"}};
    for (std::size_t i = 0; i < std::min(kWalls, walls.size()); ++i) {
      const machining::WallConfidence& w = *walls[i];
      table.rows.push_back(
          {std::to_string(w.line), to_um(w.low), to_um(w.high), to_um(w.room), c.percent(w.probability)});
    }
    report_.add_table(table);
    Table inputs;
    inputs.caption =
        "Which input to know better: what it contributes to the variance, a mean over the walls (below 0 where it "
        "cancels another), and the least likely wall if it were known twice as well";
    inputs.columns = {{"input", ""}, {"of the variance", "%", 0}, {"least likely wall", "if known twice as well"}};
    for (const machining::UncertainInput& input : c.inputs) {
      inputs.rows.push_back({input.name, 100 * input.share, c.percent(input.least_if_halved)});
    }
    report_.add_table(inputs);
  }

  void summary_of_moves() {
    double length = 0;
    std::size_t kept = 0, outside_before = 0, outside_after = 0;
    for (const MoveOutcome& m : c_.moves) {
      length += m.length;
      kept += m.rewritten ? 0 : 1;
      outside_before += m.distance_before > c_.tolerance ? 1 : 0;
      outside_after += m.within ? 0 : 1;
    }
    const auto some = [](std::size_t n) { return n == 0 ? std::string("none") : count(n); };
    report_.add_text(
        fmt::format("{} cut along {} mm. As the program is, {} of them leave the tube; corrected, {}. The correction "
                    "keeps the text of {}.",
                    plural(c_.moves.size(), "move", "moves"), fixed(to_mm(length), 0), some(outside_before),
                    some(outside_after), some(kept)));
  }

  void limits() {
    report_.add_section("What the model leaves out");
    std::vector<std::string> items;
    int plunges = 0, rapids = 0;
    double plunged = 0, rammed = 0;
    for (const machining::Incident& incident : c_.after.pass.incidents) {
      if (incident.kind == machining::Incident::Kind::end_cut) {
        ++plunges;
        plunged += incident.volume;
      } else {
        ++rapids;
        rammed += incident.volume;
      }
    }
    if (rapids > 0) {
      items.push_back(
          fmt::format("{} of the corrected program take {} mm³ of material: a collision, or a stock that is "
                      "not what the job says. No force is computed for them.",
                      plural(index(rapids), "rapid move", "rapid moves"), number(units::to_mm3(rammed))));
    }
    if (plunges > 0) {
      items.push_back(fmt::format(
          "{} cut {} mm³ with the end of the cutter as well (plunges and ramps). {} On a plunge the thrust along the "
          "axis is not corrected: the material that it leaves is cut where the tool comes to rest, in a dwell (G4) "
          "that is long enough; where there is none, that is said above if it may lie outside the tube.",
          plural(index(plunges), "move", "moves"), number(units::to_mm3(plunged)),
          job_.material.end ? "The forces of the end are those of the material's own coefficients."
                            : "The material gives no coefficients of the end, so those of its sides are taken: an "
                              "assumption."));
    }
    const auto settle = [&](const machining::PassResult& pass, const char* which) {
      if (pass.not_converged == 0) return;
      items.push_back(
          fmt::format("At {} of {} points of the {} force and deflection did not settle; what is shown there may "
                      "be off by up to {}.",
                      count(pass.not_converged), count(pass.points), which, um(pass.largest_rest)));
    };
    settle(c_.before.pass, "program as it is");
    settle(c_.after.pass, "corrected program");
    if (c_.before.pass.not_converged + c_.after.pass.not_converged == 0) {
      items.push_back("The iteration leaves no rest: force and deflection are in balance at every point.");
    }
    if (c_.transitions > 0) {
      items.push_back(fmt::format(
          "On {} (short blocks that take the load on or off) the tool follows the force of its own motion in steps, at "
          "the programmed feed; where the controller slows down there, it may go on for longer.",
          plural(index(c_.transitions), "transition", "transitions")));
    }
    items.push_back(
        "Forces are means over a revolution, in balance at every point: no vibration, no chatter, no run-out, no "
        "ripple "
        "from tooth to tooth.");
    items.push_back(
        fmt::format("{} Cutter, spindle, workpiece and clamping are taken as rigid; play, friction, {}heat "
                    "and geometric errors are left out.",
                    job_.measured ? "The machine deflects as it did where it was measured, in proportion to the force."
                                  : "Only the joints (or legs) deflect, in proportion to their load.",
                    job_.weights || !options_.weight.empty() ? "" : "weight, "));
    if (!options_.weight.empty()) {
      items.push_back(with_sign(options_.weight));
    } else if (job_.weights) {
      items.emplace_back(
          "The machine's own weight counts, against that at the origin of the workpiece, where the part was touched "
          "off.");
    }
    if (band_.normal.count > 0) {
      items.push_back(fmt::format(
          "The measured compliance is not known exactly: the deflection across the path is uncertain by ± {} on "
          "average and up to {} (95 %). The check against the tube does not count this.",
          um(band_.normal.mean), um(band_.normal.max)));
    }
    if (const auto& band = options_.uncertainty.compliances; band && band->normal.count > 0) {
      items.push_back(fmt::format(
          "The identified compliances are not known exactly: U (k = 2) of the deflection across the path is {} on "
          "average and up to {}, at {} points under the predicted forces.",
          um2(band->normal.mean), um2(band->normal.max), count(band->normal.count)));
    }
    items.push_back(
        fmt::format("The stock is a height map of {} mm squares; the engagement is known to a fraction of "
                    "one. Between checked points, at most 0.1 mm apart, nothing is said.",
                    given(to_mm(job_.stock.cell()))));
    report_.add_list(items);
  }

  void cutter_entries(Entries& out, const std::string& name, const cutting::Cutter& cutter) const {
    const std::string corner =
        cutter.corner_radius > 0 ? fmt::format(", corner radius {} mm", given(to_mm(cutter.corner_radius))) : "";
    out.emplace_back(name,
                     fmt::format("{}{} mm{}, {} teeth, helix {} deg, flute length {} mm",
                                 cutter.name.empty() ? "" : cutter.name + ": ", given(to_mm(cutter.diameter)), corner,
                                 cutter.teeth, given(units::to_deg(cutter.helix)), given(to_mm(cutter.length))));
  }

  /// Which of the two models the answer rests on.
  void compliance_entries(Entries& out) const {
    if (!job_.measured) {
      out.emplace_back("compliance", "that of the joints (or legs)");
      return;
    }
    const statics::MeasuredMap& map = job_.measured->map;
    std::string text = fmt::format("interpolated from {} measured points, correlation length {} mm", map.size(),
                                   fixed(to_mm(map.correlation_length()), 0));
    if (band_.normal.count > 0) {
      text += fmt::format(", band ± {} of the normal error on average, up to {} (95 %)", um(band_.normal.mean),
                          um(band_.normal.max));
    }
    out.emplace_back("compliance", text);
    for (const std::string& file : job_.measured->files) out.emplace_back("measured displacements", file);
    if (band_.joints.count > 0) {
      out.emplace_back("with the joints' compliances", fmt::format("other deflections by {} on average, up to {}",
                                                                   um(band_.joints.mean), um(band_.joints.max)));
    }
  }

  void inputs() {
    report_.add_section("Inputs");
    report_.add_heading("Job");
    Entries job{{"file", job_.path},
                {"origin of W in M", vector_mm(job_.X_MW.p)},
                {"turn of W in M", given(units::to_deg(angles_abc(job_.X_MW.R).z())) + " deg"}};
    for (std::size_t i = 0; i < job_.work_offsets.size(); ++i) {
      if (job_.work_offsets[i].isZero(0)) continue;
      job.emplace_back(fmt::format("origin of G{} in W", 54 + i), vector_mm(job_.work_offsets[i]));
    }
    if (job_.tool_frame.turns)
      job.emplace_back("tool",
                       "a ball that turns in cuts, or cuts in several orientations; normal errors are horizontal");
    if (job_.tool_frame.tilted) {
      job.emplace_back("tool in every cut",
                       machining::orientation_in_words(job_.tool_frame.axes) +
                           "; normal errors lie in the plane square to its axis, vertical ones along it");
    }
    compliance_entries(job);
    job.emplace_back("tolerance (tube radius)", fmt::format("{} {}", given(to_um(c_.tolerance)), kUm));
    job.emplace_back("step between evaluated points", given(to_mm(job_.step)) + " mm");
    job.emplace_back("step of the check", given(to_mm(std::min(job_.step, 0.1e-3))) + " mm");
    job.emplace_back("blocks with /", job_.block_delete ? "skipped" : "run");
    report_.add_definitions(job);
    tools_and_material();
    stock();
    machine();
    if (!options_.command.empty()) report_.add_code("The command that made this page", options_.command, false);
  }

  void tools_and_material() {
    Entries tools;
    cutter_entries(tools, "cutter", job_.cutter);
    for (const auto& [tool, cutter] : job_.cutters) cutter_entries(tools, fmt::format("cutter T{}", tool), cutter);
    std::set<std::string> used;
    for (const Stretch& s : tracks_.stretches) {
      const gcode::Move& move = c_.programmed[index(s.move)];
      if (used.size() >= 8 || !(move.spindle_speed > 0)) continue;
      const double per_tooth = move.feed / (move.spindle_speed * job_.cutter_of(move.tool).teeth);
      used.insert(fmt::format("{} mm/min at {} rev/min, {} mm a tooth", given(units::to_mm_per_min(move.feed)),
                              given(units::to_per_min(move.spindle_speed)), given(to_mm(per_tooth))));
    }
    for (const std::string& cut : used) tools.emplace_back("feed in the cut", cut);
    report_.add_heading("Cutter and feed");
    report_.add_definitions(tools);
    const cutting::Material& m = job_.material;
    report_.add_heading(m.name.empty() ? "Material" : "Material: " + m.name);
    const bool linear = m.exponent == 1;
    const std::string unit = linear ? " N/mm²" : fmt::format(" N/mm^{:g}", 1 + m.exponent);
    // K h^x: the chip thickness counts in mm, so 1 N/m^(1+x) is 1e-3 N/mm / 1000^x.
    const double per_chip = std::pow(1 / units::kMetrePerMm, m.exponent);
    const auto cut = [&](double k) { return given(units::to_N_per_mm(k) / per_chip) + unit; };
    const auto edge = [&](double k) { return given(units::to_N_per_mm(k)) + " N/mm"; };
    report_.add_definitions({{"Ktc (tangential, cutting)", cut(m.ktc)},
                             {"Krc (radial, cutting)", cut(m.krc)},
                             {"Kac (axial, cutting)", cut(m.kac)},
                             {"Kte (tangential, edge)", edge(m.kte)},
                             {"Kre (radial, edge)", edge(m.kre)},
                             {"Kae (axial, edge)", edge(m.kae)},
                             {"exponent of the chip thickness", given(m.exponent)}});
  }

  void stock() {
    const cutting::Stock& s = job_.stock;
    const Vec3 lo = job_.tool_frame.tilted ? Vec3(job_.tool_frame.stock_in_W.min()) : s.min();
    const Vec3 hi = job_.tool_frame.tilted ? Vec3(job_.tool_frame.stock_in_W.max()) : s.max();
    report_.add_heading("Stock");
    report_.add_definitions(
        {{"x", fmt::format("{} … {} mm", given(to_mm(lo.x())), given(to_mm(hi.x())))},
         {"y", fmt::format("{} … {} mm", given(to_mm(lo.y())), given(to_mm(hi.y())))},
         {"z", fmt::format("{} … {} mm", given(to_mm(lo.z())), given(to_mm(hi.z())))},
         {"cells", fmt::format("{} × {} of {} mm", s.columns(), s.rows(), given(to_mm(s.cell())))},
         {"volume", fmt::format("{} mm³", given(units::to_mm3(s.volume())))},
         {"removed, as it is", fmt::format("{} mm³", given(units::to_mm3(c_.before.pass.removed)))},
         {"removed, corrected", fmt::format("{} mm³", given(units::to_mm3(c_.after.pass.removed)))}});
  }

  void machine() {
    report_.add_heading("Machine: " + machine::name_of(job_.machine));
    report_.add_text(machine::description_of(job_.machine));
    Entries compliances;
    for (const machine::Element& element : kinematics::elements(job_.machine)) {
      compliances.emplace_back("compliance of " + element.name,
                               element.turns ? fmt::format("{:.4g} rad/Nm", element.compliance)
                                             : fmt::format("{:.4g} µm/N", units::to_um_per_N(element.compliance)));
    }
    report_.add_definitions(compliances);
    Table sources;
    sources.caption = "Where the machine's numbers come from";
    sources.columns = {{"key", ""}, {"source", ""}};
    for (const auto& [key, source] : machine::provenance_of(job_.machine)) sources.rows.push_back({key, source});
    if (!sources.rows.empty()) report_.add_table(sources);
    report_.add_code("The machine as a file", machine::to_toml(job_.machine));
  }

  void new_program() {
    report_.add_section("The corrected program");
    const gcode::Blocks& blocks = c_.program.blocks;
    std::string text;
    for (std::size_t i = 0; i < std::min(blocks.size(), kHeaderLines); ++i) text += std::string(blocks[i].text) + "\n";
    if (blocks.size() > kHeaderLines) text += "...\n";
    report_.add_code("Its first lines", text, false);
    if (blocks.size() <= kWholeProgram) {
      report_.add_code(fmt::format("All {} lines", blocks.size()), c_.text());
    }
  }

  static std::size_t index(int i) { return static_cast<std::size_t>(i); }

  const Job& job_;
  const gcode::Program& program_;
  const Correction& c_;
  const CorrectionPageOptions& options_;
  machining::MapBand band_;
  Tracks tracks_;
  Report report_;
};

}  // namespace

std::string correction_page(const Job& job, const gcode::Program& program, const Correction& correction,
                            const CorrectionPageOptions& options) {
  return Page(job, program, correction, options).html();
}

}  // namespace polypod::pages
