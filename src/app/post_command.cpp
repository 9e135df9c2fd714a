// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <memory>
#include <numbers>
#include <optional>
#include <set>

#include "commands.hpp"
#include "corrected_program.hpp"
#include "messages.hpp"
#include "polypod/core/files.hpp"
#include "polypod/core/text.hpp"
#include "polypod/core/units.hpp"
#include "polypod/families/serial/carried_arm.hpp"
#include "polypod/kinematics/any_machine.hpp"
#include "polypod/kinematics/joint_speed.hpp"
#include "polypod/machine/assumed.hpp"
#include "polypod/machining/accept.hpp"
#include "polypod/machining/check.hpp"
#include "polypod/machining/job.hpp"
#include "polypod/machining/unrolling.hpp"
#include "polypod/post/write.hpp"

namespace polypod::app {
namespace {

constexpr config::Range kTolerance_um{0.01, 1e4};
constexpr config::Range kAxisTolerance_deg{1e-4, 10};
constexpr config::Range kTurnSpeed{1, 1e6};  // deg/min
constexpr config::Range kRapid{1e-3, 1e6};   // mm/min
constexpr config::Range kBlend_mm{0, 100};
constexpr config::Range kPart{0, 1e6};
constexpr config::Range kAngle_deg{-3600, 3600};
constexpr config::Range kRotation_deg{-360, 360};
constexpr double kFarthest_mm = 1e6;
constexpr std::size_t kShownProblems = 20;

struct Options {
  std::string file, job, machine, output, origin = "0,0,0", to = "ngc", config = "auto", c = "0", branch,
                                          feed = "per-minute", joint_speeds, start_joints, external;
  std::vector<std::string> sets;
  double tolerance = 10, axis_tolerance = 0.1, turn_speed = 1800, rapid = 6000, blend = 0.1, rotation = 0;
  int part = 0;
  bool allow_problems = false, dat = false;
};

Result<post::Dialect> dialect_of(const std::string& to) {
  if (to == "ngc") return post::Dialect::ngc;
  if (to == "krl") return post::Dialect::krl;
  if (to == "rapid") return post::Dialect::rapid;
  if (to == "urscript") return post::Dialect::urscript;
  return fail("PO130", fmt::format("--to {}: there is no such language", to), {}, "give ngc, krl, rapid or urscript");
}

/// Where the data list of the program goes; empty where none is asked for. KUKA's controllers find it by its name.
Result<std::string> data_file_of(const Options& o, post::Dialect dialect) {
  if (!o.dat) return std::string();
  if (dialect != post::Dialect::krl)
    return fail("PO130", fmt::format("--dat: --to {} has no data list", o.to), {}, "it serves --to krl");
  std::filesystem::path file = o.output;
  if (file.extension() != ".src") {
    return fail("PO130",
                fmt::format("--dat: {} does not end in .src, and the data list has the name of the program", o.output),
                {}, "give -o NAME.src");
  }
  return file.replace_extension(".dat").string();
}

/// Machine and place of the work, from a job or from the options.
Result<machining::Job> placed(const Options& o, const Context& context) {
  if (!o.job.empty()) {
    POLYPOD_TRY(refuse(context, {"--machine", "--origin", "--rotation", "--set"}, "the job says it; give --job alone"));
    return machining::read_job(o.job, machining::JobFor::motion);
  }
  if (o.machine.empty()) {
    return fail("AP123", "for which machine, and where is the work?", {}, "give --job JOB, or --machine and --origin");
  }
  POLYPOD_ASSIGN(origin, numbers_of(o.origin, "--origin"));
  if (origin.size() != 3 ||
      std::any_of(origin.begin(), origin.end(), [](double x) { return std::abs(x) > kFarthest_mm; })) {
    return fail("PO130", fmt::format("--origin {}: not three numbers of at most 1e6 mm", o.origin), {},
                "give x,y,z in mm");
  }
  machining::Job job;
  POLYPOD_ASSIGN(machine, machine_of(o.machine, o.sets));
  job.machine = std::move(machine);
  job.machine_name = o.machine;
  job.X_MW.p = units::from_mm(1) * Vec3(origin[0], origin[1], origin[2]);
  job.X_MW.R = rotation_z(units::from_deg(o.rotation));
  return job;
}

/// The path in the frame of G54, whose origin the job becomes: offsets of the others count from it.
void take_frame_of_g54(machining::Job& job) {
  const Vec3 g54 = job.work_offsets[0];
  job.X_MW.p += job.X_MW.R * g54;
  for (std::size_t i = 0; i < job.work_offsets.size(); ++i) job.work_offsets[i] -= g54;
}

Result<post::Path> path_of(const Options& o, const machining::Job& given, const machining::Job& job) {
  post::ProgramOptions options;
  options.unroll = machining::unroll_options(job);
  options.block_delete_said = !o.job.empty();
  options.accept = [&](const gcode::Understood& understood) {
    return machining::known_offsets(given, understood.program, understood.interpretation);
  };
  return post::read_path(o.file, options);
}

post::PlanOptions plan_place(const machining::Job& job) {
  post::PlanOptions p;
  p.origin = job.X_MW.p;
  p.rotation = machining::rotation_of(job.X_MW);
  return p;
}

/// One number a joint that moves in this configuration, in SI; what the job says where the option does not. A job says
/// one a joint of its machine; where the configuration locks one, those of the job cannot be told apart from it.
Result<std::vector<double>> by_joint(const std::string& text, const std::string& option,
                                     const machine::AnyMachine& machine, const std::vector<double>& of_job) {
  const auto joints = static_cast<std::size_t>(kinematics::joint_count(machine));
  if (text.empty()) return of_job.size() == joints ? of_job : std::vector<double>{};
  POLYPOD_ASSIGN(values, numbers_of(text, option));
  if (values.size() != joints) {
    return fail("AP201", fmt::format("{} {}: {} numbers for {} joints", option, text, values.size(), joints), {},
                "give one for each joint that moves, in the order of `polypod info`");
  }
  for (std::size_t i = 0; i < joints; ++i) {
    const bool turns = kinematics::joint_kind(machine, static_cast<int>(i)) == machine::JointKind::revolute;
    values[i] = turns ? units::from_deg(values[i]) : units::from_mm(values[i]);
  }
  return values;
}

/// Whether the machine has one that moves.
bool has_external_axis(const post::Configuration& configuration) {
  const auto axis = machine::CarriedArm::on_external_axis(configuration.machine);
  return axis && axis->moves();
}

/// What the robot's controller is told of an external axis.
Status set_external(const std::string& said, const post::Configuration& configuration, post::PlanOptions& p) {
  const auto axis = machine::CarriedArm::on_external_axis(configuration.machine);
  if (!axis || !axis->moves()) {
    if (said.empty()) return {};
    return fail("PO130",
                fmt::format("--external-axis {}: {}", said,
                            axis ? "the machine file locks it" : "no joint of this machine carries a robot"),
                {}, "leave --external-axis out");
  }
  if (said.empty() || said == "free" || said == "follows") {
    p.external = said == "follows" ? post::External::linear : post::External::chosen;
    return {};
  }
  if (said.find_first_not_of("0123456789.+-eE") != std::string::npos) {
    return fail("PO130", fmt::format("--external-axis {}: neither free, nor follows, nor a number", said), {},
                "give free, follows, or where the axis stands, in mm or deg");
  }
  const bool turns = axis->axis().kind == machine::JointKind::revolute;
  const machine::JointRange range = axis->range();
  const auto user = [turns](double v) { return turns ? units::to_deg(v) : units::to_mm(v); };
  POLYPOD_ASSIGN(at, number_of(said, "--external-axis", {user(range.min), user(range.max)}, turns ? "deg" : "mm"));
  p.external = post::External::stands;
  p.external_at = turns ? units::from_deg(at) : units::from_mm(at);
  return {};
}

Result<post::PlanOptions> plan_options(const Options& o, const machining::Job& job,
                                       const post::Configuration& configuration, post::Dialect dialect,
                                       const Context& context) {
  post::PlanOptions p = plan_place(job);
  p.tolerance = units::from_um(o.tolerance);
  p.axis_tolerance = units::from_deg(o.axis_tolerance);
  p.turn_speed = units::from_per_min(units::from_deg(o.turn_speed));
  p.rapid_speed = units::from_mm_per_min(o.rapid);
  // Joints that the command line gives say the posture themselves.
  p.branch = o.branch.empty() && !context.given("--start-joints") ? job.posture : o.branch;
  POLYPOD_ASSIGN(speeds, by_joint(o.joint_speeds, "--joint-speeds", configuration.machine, job.joint_speeds));
  for (const double speed : speeds) {
    if (speed > 0) continue;
    return fail("AP201", fmt::format("--joint-speeds {}: not all are above 0", o.joint_speeds), {},
                "give one number above 0 for each joint that moves");
  }
  p.joint_speeds = speeds.empty() ? kinematics::speed_limits(configuration.machine) : std::move(speeds);
  POLYPOD_ASSIGN(start, by_joint(o.start_joints, "--start-joints", configuration.machine, job.start_joints));
  if (!start.empty()) {
    p.start_joints.emplace(static_cast<Eigen::Index>(start.size()));
    for (std::size_t i = 0; i < start.size(); ++i) (*p.start_joints)[static_cast<Eigen::Index>(i)] = start[i];
  }
  if (o.c == "free") {
    p.c.reset();
  } else {
    if (o.c.find_first_not_of("0123456789.+-eE") != std::string::npos)
      return fail("PO130", fmt::format("--c {}: neither free nor a number", o.c), {}, "give free, or C in deg");
    POLYPOD_ASSIGN(c, number_of(o.c, "--c", kAngle_deg, "deg"));
    p.c = units::from_deg(c);
  }
  if (dialect != post::Dialect::ngc) POLYPOD_TRY(set_external(o.external, configuration, p));
  post::set_for(dialect, p);
  p.progress = progress_line(context, "planning");
  return p;
}

/// The lines of the rapids that end at a place that is not known whole: nothing of them can be judged; and that of a
/// first cut, of which nothing says where it starts.
std::set<int> not_judged(const post::Path& path) {
  std::set<int> out;
  bool first = true;
  for (const post::Step& s : path.steps) {
    if (!s.moves()) continue;
    if (!s.placed() || (first && s.kind != post::StepKind::rapid)) out.insert(s.line);
    first = first && !s.placed();
  }
  return out;
}

/// The answer where the plan has no problems, with what could not be judged or is left out.
std::string yes(const post::Path& path, const machine::AnyMachine& machine, bool without_speeds,
                bool correction_unknown) {
  const std::set<int> unknown = not_judged(path);
  const bool assumed = machine::limits_are_assumed(machine);
  std::string out = fmt::format(
      "yes{}: every move is within reach and limits",
      unknown.empty() && !assumed && !without_speeds && !correction_unknown ? "" : ", apart from what was not judged");
  if (assumed) out += fmt::format("; not judged: limits of the joints, {}", machine::kAssumedLimits);
  if (without_speeds) out += "; not judged: speeds of joints, see the notes";
  if (correction_unknown) out += "; not judged: whether the correction was made for this machine, see the notes";
  if (!unknown.empty())
    out += fmt::format("; not judged: the {} {}, see the notes", unknown.size() == 1 ? "way of line" : "ways of lines",
                       fmt::join(unknown, ", "));
  for (const post::LeftOut& l : path.left_out)
    out += fmt::format("; not written: the retract of line {}, see the notes", l.line);
  return out;
}

std::vector<std::string> own_notes(const Options& o, const Context& context, const post::Path& path,
                                   const post::Plan& plan, const post::PlanOptions& with, bool ngc,
                                   bool external_axis) {
  std::vector<std::string> out;
  const auto header = post::correction_header(path);
  const bool corrected = header && header->corrected;
  std::set<int> tools;
  bool turned = false, modes = false, lengths = false;
  std::optional<double> c;
  if (!plan.moves.empty() && plan.moves.front().kind != post::StepKind::rapid) {
    out.push_back(
        fmt::format("line {}: nothing says where this first cut starts (FROM, or RAPID before it): its end is judged, "
                    "and not the way to it",
                    path.steps[static_cast<std::size_t>(plan.moves.front().step)].line));
  }
  if (std::string joints = machining::without_speed(with.joint_speeds); !joints.empty())
    out.push_back(std::move(joints));
  std::set<int> long_ways;  // lines that turn the tool about its axis by half a turn or more
  for (const post::Step& s : path.steps) {
    if (s.moves() && s.tool != 0) tools.insert(s.tool);
    if (s.moves() && s.angles) {
      constexpr double kHalfTurn = std::numbers::pi - 1e-6;
      if (c && std::abs(s.angles->z() - *c) > kHalfTurn) long_ways.insert(s.line);
      c = s.angles->z();
    }
    turned = turned || (s.moves() && s.turned);
    modes = modes || s.path_mode;
    lengths = lengths || s.length_offset;
  }
  if (path.program && tools.size() > 1) {
    out.push_back(
        fmt::format("{} tools: reach and limits are judged with the one tool of the machine file", tools.size()));
  }
  if (path.program && !turned && !plan.sets_c && !plan.moves.empty() && ngc)
    out.emplace_back("the program commands X, Y and Z alone: rotary axes, if there are any, must stand at 0");
  if (plan.chorded > 0) {
    out.push_back(fmt::format("{} {} written as chords, off by up to {:.1f} um{}", plan.chorded,
                              plan.chorded == 1 ? "arc or helix is" : "arcs and helices are",
                              units::to_um(plan.chord_error),
                              corrected ? ", which the tube of the correction does not count" : ""));
  }
  if (!ngc && !long_ways.empty()) {
    out.push_back(fmt::format(
        "{} C by half a turn or more; this language says where a move ends and the controller takes the shorter way "
        "there, of half a turn either: put points between",
        long_ways.size() == 1
            ? fmt::format("line {} turns", *long_ways.begin())
            : fmt::format("{} lines, the first of them {}, turn", long_ways.size(), *long_ways.begin())));
  }
  if (modes && context.given("--corner-blend")) {
    out.push_back(
        fmt::format("the path modes of the program (G61, G61.1, G64) are replaced by {}{}",
                    o.blend > 0 ? fmt::format("--corner-blend {:g} mm", o.blend) : "exact stop (--corner-blend 0)",
                    corrected ? ": the correction was made for its own" : ""));
  }
  if (path.program && !modes && ngc && !context.given("--corner-blend"))
    out.emplace_back("the program says no path mode (G61, G64): that of the controller counts");
  if (path.program && !lengths && ngc)
    out.emplace_back("the program has no G43 and no G49: the tool length in force on the controller counts");
  if (!ngc && external_axis && with.external != post::External::linear) {
    out.emplace_back(
        "`check` judges collisions with the external axis as it follows the moves, not as it stands here: "
        "--external-axis follows writes that");
  }
  if (with.rotation != 0 && ngc) {
    out.push_back(fmt::format("G54 of the controller must be turned too: G10 L2 P1 X Y Z R{:g}, with the origin",
                              units::to_deg(with.rotation)));
  }
  return out;
}

Json range_json(double min, double max) {
  return {{"min", min}, {"max", max}};
}

/// What the command answers.
struct Answer {
  const post::Configuration& configuration;
  const post::Path& path;
  const post::Plan& plan;
  const post::Written& written;
  bool writes;            ///< whether the program was written to its file
  std::string data_file;  ///< beside it; empty: none
  std::vector<std::string> notes;
  bool without_speeds;      ///< of some joints no largest speed is known
  bool correction_unknown;  ///< whether a corrected program is for this machine and these joints
};

Json joint_ranges_json(const Answer& answer) {
  Json out = Json::array();
  for (std::size_t i = 0; i < answer.plan.joints.size(); ++i) {
    const bool turns =
        kinematics::joint_kind(answer.configuration.machine, static_cast<int>(i)) == machine::JointKind::revolute;
    const auto user = [&](double x) { return turns ? units::to_deg(x) : units::to_mm(x); };
    out.push_back({{"joint", i + 1},
                   {"unit", turns ? "deg" : "mm"},
                   {"min", user(answer.plan.joints[i].min)},
                   {"max", user(answer.plan.joints[i].max)}});
  }
  return out;
}

Json answer_json(const Options& o, const Answer& answer) {
  const post::Plan& plan = answer.plan;
  Json problems = Json::array(), left_out = Json::array(), rotary = Json::object();
  for (const post::PlanProblem& p : plan.problems)
    problems.push_back({{"line", p.line}, {"kind", p.kind}, {"detail", p.detail}});
  for (const post::LeftOut& l : answer.path.left_out) left_out.push_back({{"line", l.line}, {"text", l.text}});
  for (std::size_t i = 0; i < 3; ++i) {
    rotary[std::string(1, "ABC"[i])] = range_json(units::to_deg(plan.turned_min[i]), units::to_deg(plan.turned_max[i]));
  }
  Json out{
      {"ok", plan.ok()},
      {"written", answer.writes},
      {"lines_out", answer.written.lines},
      {"moves", answer.written.moves},
      {"branch", plan.branch},
      {"configuration", answer.configuration.name},
      {"to", o.to},
      {"points_inserted", plan.inserted},
      {"tip_error_um", units::to_um(plan.chord_error)},
      {"axis_error_deg", units::to_deg(plan.axis_error)},
      {"problems", problems},
      {"not_judged", not_judged(answer.path)},
      {"left_out", left_out},
      {"time_s", plan.time},
      {"length_mm", units::to_mm(plan.length)},
      {"rotary_deg", rotary},
      {"joint_speed_percent", plan.speed_joint > 0 ? Json(100 * plan.speed_share) : Json()},
      {"joint_speed_at", plan.speed_joint > 0 ? Json{{"joint", plan.speed_joint}, {"line", plan.speed_line}} : Json()},
      {"joint_ranges", joint_ranges_json(answer)},
      {"notes", answer.notes}};
  if (!answer.data_file.empty()) out["data_file"] = answer.data_file;
  return out;
}

/// Two digits of what is below 10 %, so that a slow joint does not seem to stand.
std::string percent(double share) {
  const double whole = 9.95;
  return 100 * share < whole ? fmt::format("{:.2g}", 100 * share) : fmt::format("{:.0f}", 100 * share);
}

void print_answer(const Options& o, const Answer& answer) {
  const post::Plan& plan = answer.plan;
  fmt::print("{}: {} lines, {} moves, {} points inserted\n", answer.configuration.name, answer.written.lines,
             answer.written.moves, plan.inserted);
  if (!plan.branch.empty()) fmt::print("posture        {}\n", plan.branch);
  if (o.to != "ngc" && has_external_axis(answer.configuration) && !plan.joints.empty()) {
    const bool turns = kinematics::joint_kind(answer.configuration.machine, 0) == machine::JointKind::revolute;
    const auto user = [turns](double v) { return turns ? units::to_deg(v) : units::to_mm(v); };
    fmt::print("external axis  joint 1 from {:.1f} to {:.1f} {}\n", user(plan.joints[0].min), user(plan.joints[0].max),
               turns ? "deg" : "mm");
  }
  fmt::print("tool tip       off arcs written as chords by up to {:.1f} um (tolerance {:g} um)\n",
             units::to_um(plan.chord_error), o.tolerance);
  fmt::print("tool axis      off the shortest turn between two points by up to {:.3f} deg (tolerance {:g} deg)\n",
             units::to_deg(plan.axis_error), o.axis_tolerance);
  fmt::print("time {:.1f} s (G0 at {:g} mm/min, no acceleration), path length {:.1f} mm\n", plan.time, o.rapid,
             units::to_mm(plan.length));
  if (plan.speed_joint > 0) {
    fmt::print("joint speeds   up to {} % of a limit in a cut (joint {}, line {})\n", percent(plan.speed_share),
               plan.speed_joint, plan.speed_line);
  }
  for (std::size_t i = 0; i < plan.problems.size() && i < kShownProblems; ++i) {
    const post::PlanProblem& p = plan.problems[i];
    fmt::print("  {}:{}: {}: {}\n", o.file, p.line, p.kind, p.detail);
  }
  if (plan.problems.size() > kShownProblems)
    fmt::print("  and {} more (--json lists all)\n", plan.problems.size() - kShownProblems);
  for (const std::string& note : answer.notes) fmt::print("note: {}\n", note);
  if (plan.ok()) {
    fmt::print("{}\n",
               yes(answer.path, answer.configuration.unlocked, answer.without_speeds, answer.correction_unknown));
  } else if (answer.writes) {
    fmt::print("no: the machine cannot take every move\n");
  } else {
    fmt::print(
        "no: the machine cannot take every move; nothing was written (move the workpiece {}, or "
        "--allow-problems)\n",
        o.job.empty() ? "with --origin" : "in the job");
  }
  if (answer.writes) fmt::print("wrote {}{}\n", o.output, answer.data_file.empty() ? "" : " and " + answer.data_file);
}

}  // namespace

Command post_command() {
  auto o = std::make_shared<Options>();
  return {
      "post", "A CL file or a program for a machine: G-code, KUKA KRL, ABB RAPID, URScript",
      "polypod post part.cl --machine lola50 --origin 0,-1300,0 -o part.ngc",
      [o](Arguments& a) {
        a.positional("FILE", o->file, "An APT CL file, or a G-code program");
        a.option("--job", o->job,
                 "The job file: machine, origin and rotation of the workpiece, work offsets, cutters, block delete");
        a.option("--machine", o->machine, "Without a job: a machine file or a name of `polypod machines`");
        a.option("--set", o->sets, "key=value: override a parameter of --machine (repeatable)");
        a.option("--origin", o->origin, "Without a job: x,y,z of the workpiece origin in M, mm (default: that of M)");
        a.option(
            "--rotation", o->rotation, kRotation_deg,
            "Without a job: the rotation of the workpiece about z of M, deg (default 0), as rotation_deg of a job");
        a.option("-o,--output", o->output, "The program", true);
        a.option("--to", o->to, "ngc (G-code of LinuxCNC, the default), krl, rapid or urscript");
        a.option(
            "--config", o->config,
            "Which machine tool the machine is programmed as: auto (as its file says), vertical-ab (joint 6 locked), "
            "horizontal-ab (joint 4 locked), vertical-ac or six (all six joints)");
        a.option(
            "--c", o->c,
            "six: C in deg, the rotation about the tool axis (default 0), or `free`: chosen along the program; not "
            "for programs that command C");
        a.option("--external-axis", o->external,
                 "krl and rapid, of an arm on a rail or a turntable (the first row of its file): `free`, chosen along "
                 "the program (the default), `follows`, moved as little as each move asks for (as `correct` moves it: "
                 "the default of corrected programs), or where it stands, mm or deg");
        a.option(
            "--branch", o->branch,
            "Posture at the first point (default: that of a corrected program, else that of the job, else the first in "
            "which the program fits)");
        a.option(
            "--joint-speeds", o->joint_speeds,
            "Largest speed of each joint that moves, deg/s (mm/s): no cut may need more (default: those of the job, "
            "else not judged)");
        a.option("--start-joints", o->start_joints,
                 "Where the joints are before the program, deg (mm): its posture is taken (default: those of the job)");
        a.option("--tolerance", o->tolerance, kTolerance_um,
                 "How far chords may be off an arc that is not written as one, um (default 10)");
        a.option("--axis-tolerance", o->axis_tolerance, kAxisTolerance_deg,
                 "How far the tool axis may be off the shortest turn from point to point; points are inserted, deg "
                 "(default 0.1)");
        a.option("--feed", o->feed, "ngc: per-minute (G94, the default) or inverse-time (G93)");
        a.option("--turn-speed", o->turn_speed, kTurnSpeed,
                 "Speed of a cut that only turns the tool, deg/min (default 1800)");
        a.option("--rapid", o->rapid, kRapid,
                 "Speed of rapids of robots, and that G0 is counted with, mm/min (default 6000)");
        a.option(
            "--corner-blend", o->blend, kBlend_mm,
            "How far the controller may round corners, mm: P of G64, C_DIS, zone, r (0: exact stop, G61). Default: the "
            "path modes of the program; 0.1 where it has none");
        a.option("--part", o->part, kPart, "Robots: moves in a subprogram (default 0: no subprograms)");
        a.flag("--dat", o->dat,
               "krl: base, tool and the start in a data list, OUT with .dat in place of .src, where the panel of the "
               "controller can change them");
        a.flag("--allow-problems", o->allow_problems,
               "Write the program even if a move is out of reach or beyond a limit");
      },
      [o](const Context& context) -> Result<int> {
        POLYPOD_ASSIGN(dialect, dialect_of(o->to));
        const bool ngc = dialect == post::Dialect::ngc;
        if (o->feed != "per-minute" && o->feed != "inverse-time") {
          return fail("PO130", fmt::format("--feed {}: there is no such feed mode", o->feed), {},
                      "give per-minute or inverse-time");
        }
        if (ngc) {
          POLYPOD_TRY(refuse(context, {"--part"}, "it serves --to krl, rapid and urscript"));
          POLYPOD_TRY(refuse(context, {"--external-axis"}, "it serves --to krl and rapid"));
        } else {
          POLYPOD_TRY(refuse(context, {"--feed"}, "it serves --to ngc"));
        }
        POLYPOD_ASSIGN(data_file, data_file_of(*o, dialect));
        std::vector<std::string> outputs{o->output};
        if (o->dat) outputs.push_back(data_file);
        POLYPOD_TRY(check_files({o->file, o->job, o->machine}, outputs, context.json));
        POLYPOD_ASSIGN(given, placed(*o, context));
        machining::Job job = given;
        take_frame_of_g54(job);
        const machine::AnyMachine& machine = job.machine;
        POLYPOD_ASSIGN(configuration, post::configure(machine, o->config));
        if (configuration.rotary != post::Rotary::abc) {
          POLYPOD_TRY(refuse(context, {"--c"}, "it serves machines with A, B and C (--config six)"));
        }
        if (!ngc && kinematics::is_serial(machine) == false) {
          return fail("PO121",
                      fmt::format("--to {}: {} is no arm, so no robot's controller moves it", o->to, job.machine_name),
                      {}, "use --to ngc");
        }
        POLYPOD_ASSIGN(plan_with, plan_options(*o, job, configuration, dialect, context));
        POLYPOD_ASSIGN(path, path_of(*o, given, job));
        if (context.given("--c") && path.c_line > 0) {
          return fail("PO129", fmt::format("the program commands C itself, so --c {} cannot act", o->c),
                      Place{path.file, path.c_line, 1}, "leave --c out, or the C words of the program");
        }
        const HoldSaid said{o->config,
                            o->branch,
                            o->c,
                            o->external,
                            context.given("--c"),
                            context.given("--external-axis"),
                            context.given("--start-joints"),
                            o->allow_problems};
        POLYPOD_ASSIGN(program, CorrectedProgram::of(path, given, job));
        POLYPOD_TRY(program.take_hold(configuration, said, plan_with));
        POLYPOD_ASSIGN(plan, program.plan(configuration, plan_with, said));
        plan_with.progress(1);
        post::WriteOptions write_with;
        write_with.name = std::filesystem::path(o->output).stem().string();
        write_with.inverse_time = o->feed == "inverse-time";
        write_with.turn_speed = plan_with.turn_speed;
        write_with.rapid_speed = plan_with.rapid_speed;
        write_with.blend = units::from_mm(o->blend);
        write_with.moves_per_part = o->part;
        write_with.data_list = o->dat;
        write_with.origin = plan_with.origin;
        write_with.rotation = plan_with.rotation;
        write_with.blend_overrides = context.given("--corner-blend");
        write_with.header = {
            fmt::format("{} for {}, {}, by polypod post", std::filesystem::path(o->file).filename().string(),
                        machine::name_of(machine), configuration.name),
            fmt::format("workpiece origin in M {}{}", machining::place_in_words(job.X_MW),
                        plan.branch.empty() ? "" : ", posture " + plan.branch)};
        POLYPOD_ASSIGN(written, post::write(dialect, configuration, path, plan, write_with));
        const bool writes = plan.ok() || o->allow_problems;
        if (writes) POLYPOD_TRY(files::write_whole(o->output, written.text));
        if (writes && o->dat) POLYPOD_TRY(files::write_whole(data_file, written.data));
        std::vector<std::string> notes = path.notes;
        notes.insert(notes.end(), plan.notes.begin(), plan.notes.end());
        notes.insert(notes.end(), written.notes.begin(), written.notes.end());
        if (program.holds() && plan_with.keep_branch && !plan.ok()) {
          notes.push_back(fmt::format("the program is judged in the posture {}, that of its header", plan_with.branch));
        }
        if (!program.not_judged().empty()) notes.push_back(program.not_judged());
        const auto own = own_notes(*o, context, path, plan, plan_with, ngc, has_external_axis(configuration));
        notes.insert(notes.end(), own.begin(), own.end());
        const Answer answer{configuration,
                            path,
                            plan,
                            written,
                            writes,
                            data_file,
                            std::move(notes),
                            !machining::without_speed(plan_with.joint_speeds).empty(),
                            !program.not_judged().empty()};
        if (context.json)
          print_json(answer_json(*o, answer));
        else
          print_answer(*o, answer);
        return plan.ok() ? kDone : kAnswerIsNo;
      }};
}

}  // namespace polypod::app
