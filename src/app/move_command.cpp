// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <memory>

#include "commands.hpp"
#include "masses_options.hpp"
#include "messages.hpp"
#include "motion_output.hpp"
#include "polypod/core/figures.hpp"
#include "polypod/core/files.hpp"
#include "polypod/core/named_files.hpp"
#include "polypod/core/text.hpp"
#include "polypod/core/units.hpp"
#include "polypod/gcode/unroll.hpp"
#include "polypod/kinematics/free_joints.hpp"
#include "polypod/kinematics/joint_speed.hpp"
#include "polypod/machine/assumed.hpp"
#include "polypod/machine/urdf.hpp"
#include "polypod/machining/accept.hpp"
#include "polypod/machining/job.hpp"
#include "polypod/machining/program_path.hpp"
#include "polypod/machining/unrolling.hpp"
#include "polypod/motion/machine_motion.hpp"
#include "polypod/motion/path_choice.hpp"
#include "polypod/pages/motion.hpp"

namespace polypod::app {
namespace {

// Of tool and drives: mm or deg, to the powers of s; 0: no limit.
constexpr config::Range kSpeed{0, 1e9}, kAcceleration{0, 1e12}, kJerk{0, 1e15};
constexpr config::Range kStep_mm{1e-4, 1e6}, kDistance_mm{0, 1e6};

struct Options {
  std::string machine, file, points, program, job, origin, start;
  std::vector<std::string> sets;
  double speed = 0, step = 1, clearance = 10, condition = 1000, rapid = 6000, blend = 0;
  bool fastest = false;
  double tool_speed = 5000, tool_acceleration = 100e3, tool_jerk = 5e6, turn_speed = 0;
  std::string profile, drive_speed, drive_acceleration, drive_jerk, resolution, delay, goal;
  MassesOptions masses;
  double interval = 0, weight = 0.5;
  bool staggered = false, free_rotation = false, insert = false;
  int samples = 1000;
  std::string csv, report;
};

/// The path, and what it was made of.
struct Asked {
  motion::PosePath path;
  motion::MoveOptions options;
  bool angles = false;
  std::vector<std::string> notes;
  std::optional<motion::RotationChoice> rotation;
  std::optional<motion::Insertion> insertion;
  std::optional<motion::PathQuality> quality;
  std::string no_force;                                ///< why the forces are not known
  bool job_speeds = false, job_accelerations = false;  ///< these limits of the drives are the job's
};

/// "c1,c2,...;c1,c2,..." : poses as --pose has them.
Result<std::vector<motion::TargetPose>> poses_of(const std::string& text, machine::Task task) {
  std::vector<motion::TargetPose> out;
  for (std::size_t start = 0; start < text.size();) {
    const std::size_t end = std::min(text.find(';', start), text.size());
    POLYPOD_ASSIGN(n, numbers_of(text.substr(start, end - start), "--points"));
    if (n.size() < std::min<std::size_t>(3, static_cast<std::size_t>(task.size())) ||
        n.size() > static_cast<std::size_t>(task.size())) {
      std::string names;
      for (int i = 0; i < task.size(); ++i) names += fmt::format("{}{}", i > 0 ? "," : "", machine::name_of(task[i]));
      return fail("AP190", fmt::format("--points {}: not points {};...", text, names));
    }
    constexpr double kFarthest_mm = 1e7;  // 10 km: beyond it lies a wrong unit
    motion::TargetPose pose;
    for (int i = 0; i < static_cast<int>(n.size()); ++i) {
      const double x = n[static_cast<std::size_t>(i)];
      const int k = static_cast<int>(task[i]);
      if (std::abs(x) > kFarthest_mm) {
        return fail("AP190", fmt::format("--points: {:g} mm is farther than any machine reaches", x), {},
                    "give mm, and deg for angles");
      }
      (k < 3 ? pose.p[k] : pose.angles[k - 3]) = k < 3 ? units::from_mm(x) : units::from_deg(x);
    }
    out.push_back(pose);
    start = end + 1;
  }
  return out;
}

bool turns(const machine::AnyMachine& m, int joint) {
  return kinematics::joint_kind(m, joint) == machine::JointKind::revolute;
}

/// One number for all drives, or one each, deg or mm; 0: no limit.
Result<machine::JointVector> of_drives(const machine::AnyMachine& m, const std::string& text, const std::string& option,
                                       config::Range range, double otherwise) {
  const int n = kinematics::joint_count(m);
  machine::JointVector out = machine::JointVector::Constant(n, otherwise);
  if (text.empty()) return out;
  POLYPOD_ASSIGN(numbers, numbers_of(text, option));
  if (numbers.size() != 1 && static_cast<int>(numbers.size()) != n) {
    return fail("AP210", fmt::format("{} {}: the machine has {} drives", option, text, n), {},
                "give one number for all drives, or one a drive");
  }
  for (int i = 0; i < n; ++i) {
    const double x = numbers[numbers.size() == 1 ? 0 : static_cast<std::size_t>(i)];
    POLYPOD_TRY(in_range("AP210", option, x, range));
    out[i] = x == 0 ? motion::kNoLimit : turns(m, i) ? units::from_deg(x) : units::from_mm(x);
  }
  return out;
}

/// What moves, and where the work is on it: of a job, or MACHINE and --origin.
struct Placed {
  machining::Job job;
  std::string file;  ///< of the machine
  [[nodiscard]] const machine::AnyMachine& machine() const { return job.machine; }
};
Result<Placed> placed_of(const Options& o, const Context& context) {
  Placed out;
  if (o.job.empty()) {
    if (o.machine.empty()) {
      return fail("AP215", "which machine?", {}, "give MACHINE, or --program with the --job that names one");
    }
    POLYPOD_ASSIGN(m, machine_of(o.machine, o.sets));
    out.job.machine = std::move(m);
    out.file = o.machine;
    return out;
  }
  POLYPOD_TRY(refuse(context, {"--origin", "--set"}, "the job says it; give --job alone"));
  if (!o.machine.empty()) {
    return fail("AP215", fmt::format("{} and --job {}: which machine?", o.machine, o.job), {},
                "the job names its machine; leave MACHINE out");
  }
  if (o.program.empty()) return fail("AP107", "--job does nothing here", {}, "it serves --program");
  POLYPOD_ASSIGN(job, machining::read_job(o.job, machining::JobFor::motion));
  out.job = std::move(job);
  const std::string beside = machine::file_of_machine(config::beside(o.job, out.job.machine_name));
  std::error_code none;
  out.file = std::filesystem::exists(beside, none) ? beside : out.job.machine_name;
  return out;
}

/// The moves of the program, in M.
Status path_of_program(const machining::Job& job, const Options& o, const Context& context, Asked& out) {
  POLYPOD_TRY(refuse(context, {"--speed"}, "the program has its feeds"));
  Pose X_MW = job.X_MW;
  if (o.job.empty()) {
    if (o.origin.empty()) {
      return fail("AP211", "where is the work on the machine?", {},
                  "give --origin x,y,z: the workpiece origin in M, mm; or --job JOB");
    }
    POLYPOD_ASSIGN(p, numbers_of(o.origin, "--origin"));
    if (p.size() != 3) return fail("AP211", fmt::format("--origin {}: not three numbers", o.origin));
    X_MW.p = units::from_mm(1) * Vec3(p[0], p[1], p[2]);
  }
  POLYPOD_ASSIGN(understood,
                 gcode::understand(o.program, o.job.empty() ? gcode::UnrollOptions{} : machining::unroll_options(job)));
  POLYPOD_TRY(machining::known_offsets(job, understood.program, understood.interpretation));
  POLYPOD_ASSIGN(program, machining::path_of_program(job.machine, X_MW, understood.program, understood.interpretation,
                                                     units::from_mm_per_min(o.rapid), job.block_delete));
  out.path = std::move(program.path);
  out.notes = std::move(program.notes);
  if (!program.left_out.empty()) {
    out.notes.push_back(
        fmt::format("{} left out, the first in line {}: where {} or ends is not known",
                    program.left_out.size() == 1 ? "1 move is" : fmt::format("{} moves are", program.left_out.size()),
                    program.left_out.front(), program.left_out.size() == 1 ? "it begins" : "each begins"));
  }
  const auto blends = [](const gcode::Block& block) {
    return !block.after_end && std::any_of(block.words.begin(), block.words.end(), [](const gcode::Word& word) {
      return word.letter == 'G' && word.value == 64;
    });
  };
  const bool stops = !context.given("--blend");
  for (const gcode::Block& block : understood.program.blocks) {
    if (!stops || !blends(block)) continue;
    out.notes.emplace_back("the program blends its corners (G64); here the tool stops in each, --blend rounds them");
    break;
  }
  if (program.wait > 0) out.notes.push_back(fmt::format("the time holds {:g} s of dwells (G4)", program.wait));
  out.options.law = motion::Law::fastest;
  out.angles = true;
  return {};
}

/// How a path file's times are kept: as the option says, else as the file does.
Result<motion::Profile> profile_of(const std::string& option, const motion::PosePathFile& read) {
  if (option.empty()) return read.profile;
  if (!read.timed) return fail("AP107", "--profile does nothing here: the path file has no times", {}, "leave it out");
  if (option == "linear") return motion::Profile::linear;
  if (option == "smooth") return motion::Profile::smooth;
  if (option == "spline") return motion::Profile::spline;
  return fail("AP216", fmt::format("--profile {}: not known", option), {}, "linear, smooth or spline");
}

/// What the path file, the points or the program say.
Result<Asked> path_of(const machining::Job& job, const Options& o, const Context& context) {
  const machine::AnyMachine& m = job.machine;
  Asked out;
  const machine::Task task = kinematics::task(m);
  const int given = int(!o.file.empty()) + int(!o.points.empty()) + int(!o.program.empty());
  if (given != 1) {
    return fail("AP191", "the path must be given once", {}, "give --path FILE, --points or --program");
  }
  if (o.program.empty()) POLYPOD_TRY(refuse(context, {"--origin", "--rapid"}, "it serves --program"));
  if (o.file.empty()) POLYPOD_TRY(refuse(context, {"--profile"}, "it serves a path file with times"));
  double speed = 0;
  if (!o.program.empty()) {
    POLYPOD_TRY(path_of_program(job, o, context, out));
  } else if (!o.file.empty()) {
    std::vector<std::string> needed;  // x, y and z that the poses prescribe
    for (int i = 0; i < task.size(); ++i) {
      if (!task.is_angle(i)) needed.push_back(fmt::format("{}_mm", machine::name_of(task[i])));
    }
    POLYPOD_ASSIGN(read, motion::read_pose_path(o.file, needed));
    out.path = std::move(read.path);
    speed = read.speed;
    out.angles = read.angles;
    POLYPOD_ASSIGN(profile, profile_of(o.profile, read));
    out.options.profile = profile;
    if (read.timed && o.speed == 0) out.options.law = motion::Law::timed;
    if (read.timed && (o.speed != 0 || o.fastest)) {
      out.notes.emplace_back("the times of the path file are not kept, but for its waits");
    }
    const auto& all = out.path.stretches;
    if (o.speed != 0 && std::all_of(all.begin(), all.end(), [](const motion::Stretch& s) { return s.speed > 0; })) {
      out.notes.emplace_back("every segment has a speed of its own: --speed serves none");
    }
  } else {
    POLYPOD_ASSIGN(points, poses_of(o.points, task));
    std::vector<motion::Stretch> lines;
    for (std::size_t k = 0; k + 1 < points.size(); ++k) {
      POLYPOD_ASSIGN(line, motion::straight(points[k], points[k + 1]));
      lines.push_back(line);
    }
    POLYPOD_ASSIGN(path, motion::pose_path_of(std::move(lines)));
    out.path = std::move(path);
  }
  if (o.fastest) out.options.law = motion::Law::fastest;
  const bool timed = out.options.law == motion::Law::timed;
  if (timed && o.blend > 0) {
    return fail("AP107", "--blend does nothing here: the times of the path say when the tool is in its corners", {},
                "--profile spline has none; --speed and --time-optimal leave the times out");
  }
  if (!timed) POLYPOD_TRY(refuse(context, {"--profile"}, "it serves the times of a path, which are not kept here"));
  if (timed && out.options.profile == motion::Profile::spline) {
    POLYPOD_ASSIGN(spline, motion::splined(out.path));
    const motion::ChordError off = motion::farthest_from_chords(spline);
    out.path = std::move(spline);
    constexpr double kNone = 1e-9;  // rad, m: rounding
    const std::string turned = off.angle > kNone ? fmt::format(", and its angles linear courses by up to {} deg",
                                                               figure(units::to_deg(off.angle), 3))
                                                 : "";
    out.notes.push_back(fmt::format("between its points the spline leaves their straight ways by up to {} mm{}",
                                    figure(units::to_mm(off.length), 3), turned));
  }
  out.options.speed = o.speed != 0 ? units::from_mm(o.speed) : speed;
  // In the least time as well the tip takes no more than the speed that it was given.
  if (out.options.law == motion::Law::fastest) out.path = motion::with_speed(std::move(out.path), out.options.speed);
  return out;
}

Status limits_of(const machining::Job& job, const Options& o, const Context& context, motion::MoveOptions& out) {
  const machine::AnyMachine& m = job.machine;
  const bool assumed = out.law == motion::Law::fastest;
  const auto tool = [&](double value, const char* option) {
    return value == 0 || (!assumed && !context.given(option)) ? motion::kNoLimit : units::from_mm(value);
  };
  out.limits.tool_speed = tool(o.tool_speed, "--tool-speed");
  out.limits.tool_acceleration = tool(o.tool_acceleration, "--tool-acceleration");
  out.limits.tool_jerk = tool(o.tool_jerk, "--tool-jerk");
  if (o.turn_speed > 0) out.limits.turn_speed = units::from_deg(o.turn_speed);
  constexpr double kSpeedOf = 12, kAccelerationOf = 250, kJerkOf = 2e4;  // rad or m, to the powers of s, as `pick`
  const auto usual = [&](double value) { return assumed ? value : motion::kNoLimit; };
  POLYPOD_ASSIGN(speed, of_drives(m, o.drive_speed, "--drive-speed", kSpeed, usual(kSpeedOf)));
  POLYPOD_ASSIGN(acceleration,
                 of_drives(m, o.drive_acceleration, "--drive-acceleration", kAcceleration, usual(kAccelerationOf)));
  POLYPOD_ASSIGN(jerk, of_drives(m, o.drive_jerk, "--drive-jerk", kJerk, usual(kJerkOf)));
  out.limits.drive_speed = speed;
  const std::vector<double> own = job.own_speeds ? job.joint_speeds : kinematics::speed_limits(m);
  if (!own.empty() && !context.given("--drive-speed")) {
    for (Eigen::Index i = 0; i < speed.size(); ++i) {
      const double limit = own[static_cast<std::size_t>(i)];
      if (std::isfinite(limit)) out.limits.drive_speed[i] = limit;
    }
  }
  out.limits.drive_acceleration = acceleration;
  if (!job.joint_accelerations.empty() && !context.given("--drive-acceleration")) {
    for (Eigen::Index i = 0; i < acceleration.size(); ++i) {
      out.limits.drive_acceleration[i] = job.joint_accelerations[static_cast<std::size_t>(i)];
    }
  }
  out.limits.drive_jerk = jerk;
  return {};
}

/// Resolution, delay and interval of the drives, where they are given.
Status actuators_of(const machine::AnyMachine& m, const Options& o, const Context& context, motion::MoveOptions& out) {
  if (!context.given("--interval")) {
    return refuse(context, {"--resolution", "--delay", "--staggered"}, "it serves --interval");
  }
  motion::Actuators a;
  a.interval = units::from_ms(o.interval);
  a.staggered = o.staggered;
  POLYPOD_ASSIGN(resolution, of_drives(m, o.resolution, "--resolution", {0, 1e6}, 0));
  for (double& r : resolution)
    if (!std::isfinite(r)) r = 0;
  a.resolution = resolution;
  a.delay = machine::JointVector::Zero(kinematics::joint_count(m));
  if (!o.delay.empty()) {
    POLYPOD_ASSIGN(delays, numbers_of(o.delay, "--delay"));
    if (delays.size() != 1 && static_cast<int>(delays.size()) != a.delay.size()) {
      return fail("AP210", fmt::format("--delay {}: the machine has {} drives", o.delay, a.delay.size()), {},
                  "give one number for all drives, or one a drive");
    }
    for (int i = 0; i < a.delay.size(); ++i) {
      const double ms = delays[delays.size() == 1 ? 0 : static_cast<std::size_t>(i)];
      POLYPOD_TRY(in_range("AP210", "--delay", ms, {0, 1e6}, "ms"));
      a.delay[i] = units::from_ms(ms);
    }
  }
  out.actuators = a;
  return {};
}

/// What the path leaves open, chosen.
Status choose(const machine::AnyMachine& m, const Options& o, Asked& asked) {
  if (o.free_rotation) {
    if (!kinematics::task(m).holds(machine::Coordinate::c)) {
      return fail("AP212", "--free-rotation: no pose of this machine prescribes a rotation about the tool axis", {},
                  "leave it out");
    }
    asked.rotation = motion::choose_rotation(m, asked.path, asked.options);
    asked.path = asked.rotation->path;
  }
  if (o.insert) {
    asked.insertion = motion::insert_points(m, asked.path, asked.options);
    asked.path = asked.insertion->path;
  }
  return {};
}

Result<motion::Goal> goal_of(const std::string& name) {
  if (name == "sigma_min") return motion::Goal::sigma_min;
  if (name == "determinant") return motion::Goal::determinant;
  if (name == "inverse_condition") return motion::Goal::inverse_condition;
  return fail("AP213", fmt::format("--quality {}: not known", name), {}, "sigma_min, determinant or inverse_condition");
}

/// A number, or null where there is none.
Json number(double x) {
  return std::isfinite(x) ? Json(x) : Json();
}

const char* unit_of(const motion::MoveDrive& d) {
  return d.turns ? "deg" : "mm";
}
double shown(const motion::MoveDrive& d, double x) {
  return d.turns ? units::to_deg(x) : units::to_mm(x);
}

/// What the motion was judged by.
pages::MotionQuestion question_of(const machine::AnyMachine& m, const motion::MoveResult& r, const Asked& asked,
                                  const Context& context) {
  pages::MotionQuestion out;
  const motion::MoveOptions& options = asked.options;
  out.what = options.law == motion::Law::fastest ? "A path in the least time"
             : options.law == motion::Law::timed ? "A path in given times"
                                                 : "A path at constant speed";
  if (machine::limits_are_assumed(m)) {
    out.not_judged.emplace_back("ranges of the joints (the machine file gives none)");
  } else {
    out.judged = pages::limits_of_poses(m);
  }
  if (r.clearance) {
    if (options.singular_distance > 0) {
      out.judged.emplace_back("distance from singular poses");
      out.limits.push_back({"least distance from singular poses", units::to_mm(options.singular_distance),
                            units::to_mm(*r.clearance), "mm", context.given("--singularity-distance")});
    } else {
      out.not_judged.emplace_back("distance from singular poses");
    }
  } else if (options.condition > 0) {
    out.judged.emplace_back("condition number (near-singular poses)");
    out.limits.push_back(
        {"largest condition number", options.condition, r.worst_condition, "", context.given("--condition-max")});
  } else {
    out.not_judged.emplace_back("near-singular poses");
  }
  const auto add = [&](const std::string& name, double limit, double met, const std::string& unit, const char* option,
                       bool known = false) {
    const bool given = known || context.given(option);
    if (std::isfinite(limit)) out.limits.push_back({name, limit, met, unit, given});
    return std::isfinite(limit);
  };
  bool all = add("speed of the tool", units::to_mm(options.limits.tool_speed), units::to_mm(r.tool_speed), "mm/s",
                 "--tool-speed");
  all = add("acceleration of the tool", units::to_mm(options.limits.tool_acceleration),
            units::to_mm(r.tool_acceleration), "mm/s²", "--tool-acceleration") &&
        all;
  all = add("jerk of the tool", units::to_mm(options.limits.tool_jerk), units::to_mm(r.tool_jerk), "mm/s³",
            "--tool-jerk") &&
        all;
  constexpr double kRounding = 1e-9;  // rad/s
  if (!add("turning speed of the tool", units::to_deg(options.limits.turn_speed), units::to_deg(r.turn_speed), "deg/s",
           "--turn-speed") &&
      r.turn_speed > kRounding) {
    out.not_judged.emplace_back("turning speed of the tool");
  }
  const std::vector<double> of_machine = kinematics::speed_limits(m);
  const auto known = [&](std::string_view option, std::size_t drive) {  // by the job or the machine
    if (option == "--drive-speed")
      return asked.job_speeds || (drive < of_machine.size() && std::isfinite(of_machine[drive]));
    return asked.job_accelerations && option == "--drive-acceleration";
  };
  const auto drives = [&](const char* what, const machine::JointVector& limit, double motion::MoveDrive::*met,
                          const char* per, const char* option) {
    bool every = true;
    for (std::size_t i = 0; i < r.drives.size(); ++i) {
      const motion::MoveDrive& d = r.drives[i];
      every = add(fmt::format("{} of drive {}", what, i + 1), shown(d, limit[static_cast<Eigen::Index>(i)]),
                  shown(d, d.*met), fmt::format("{}{}", unit_of(d), per), option, known(option, i)) &&
              every;
    }
    return every;
  };
  all = drives("speed", options.limits.drive_speed, &motion::MoveDrive::speed, "/s", "--drive-speed") && all;
  all = drives("acceleration", options.limits.drive_acceleration, &motion::MoveDrive::acceleration, "/s²",
               "--drive-acceleration") &&
        all;
  all = drives("jerk", options.limits.drive_jerk, &motion::MoveDrive::jerk, "/s³", "--drive-jerk") && all;
  if (!all) out.not_judged.emplace_back("speeds, accelerations and jerks for which no limit is given");
  if (r.moves_at_once)
    out.not_judged.emplace_back("how the tool starts and stops (it has its speed from the first instant to the last)");
  const bool accelerations =
      std::isfinite(options.limits.tool_acceleration) || options.limits.drive_acceleration.array().isFinite().any();
  if (r.jumps.count > 0 && !accelerations) {
    out.not_judged.push_back(
        fmt::format("{} jump{} of speed between stretches, by {:.4g} mm/s and {:.4g} deg/s at most", r.jumps.count,
                    r.jumps.count == 1 ? "" : "s", units::to_mm(r.jumps.speed), units::to_deg(r.jumps.turn)));
  }
  if (options.force.size() > 0) {
    for (std::size_t i = 0; i < r.drives.size(); ++i) {
      out.limits.push_back({fmt::format("force of drive {}", i + 1), options.force[static_cast<Eigen::Index>(i)],
                            r.drives[i].force.value_or(0), r.drives[i].turns ? "Nm" : "N", true});
    }
  } else {
    out.not_judged.emplace_back("forces of the drives");
  }
  out.not_judged.emplace_back("deflection, vibration, collisions with workpiece and surroundings");
  return out;
}

Json question_json(const pages::MotionQuestion& question) {
  Json limits = Json::array();
  for (const pages::MotionLimit& l : question.limits) {
    limits.push_back(
        {{"name", l.name}, {"limit", l.limit}, {"met", number(l.met)}, {"unit", l.unit}, {"given", l.given}});
  }
  return {{"values", limits}, {"judged", question.judged}, {"not_judged", question.not_judged}};
}

const char* law_name(motion::Law law) {
  return law == motion::Law::fastest ? "time-optimal" : law == motion::Law::timed ? "timed" : "constant-speed";
}

Json move_json(const motion::MoveResult& r, const Asked& asked, const pages::MotionQuestion& question) {
  Json problems = Json::array(), violations = Json::array();
  for (const motion::MoveViolation& v : r.violations) {
    const Json at = vector_json(v.p * units::kMmPerMetre);
    problems.push_back({{"kind", v.kind},
                        {"detail", v.detail},
                        {"at_mm", at},
                        {"path_length_mm", units::to_mm(v.length)},
                        {"time_s", number(v.t)}});
    violations.push_back({{"time_s", number(v.t)},
                          {"limit", v.limit},
                          {"kind", v.kind},
                          {"detail", v.detail},
                          {"at_mm", at},
                          {"path_length_mm", units::to_mm(v.length)},
                          {"line", v.line > 0 ? Json(v.line) : Json()}});
  }
  Json drives = Json::array();
  for (const motion::MoveDrive& d : r.drives) {
    const std::string unit = unit_of(d);
    drives.push_back({{"unit", unit},
                      {"position", {{"min", number(shown(d, d.low))}, {"max", number(shown(d, d.high))}}},
                      {"speed_max", shown(d, d.speed)},
                      {"acceleration_max", shown(d, d.acceleration)},
                      {"jerk_max", shown(d, d.jerk)},
                      {"force_max", d.force ? Json(*d.force) : Json()},
                      {"force_unit", d.turns ? "Nm" : "N"},
                      {"speed_" + unit + "_per_s", shown(d, d.speed)},
                      {"acceleration_" + unit + "_per_s2", shown(d, d.acceleration)},
                      {"jerk_" + unit + "_per_s3", shown(d, d.jerk)},
                      {"start_" + unit, shown(d, d.first)},
                      {"end_" + unit, shown(d, d.last)},
                      {"min_" + unit, number(shown(d, d.low))},
                      {"max_" + unit, number(shown(d, d.high))}});
  }
  Json starts = Json::array();
  for (const motion::MoveStart& s : r.starts) {
    starts.push_back({{"branch", s.branch},
                      {"completes", s.completes},
                      {"share_of_path", s.reaches},
                      {"stopped_by", s.stopped_by.empty() ? Json() : Json(s.stopped_by)},
                      {"condition_max", number(s.condition)},
                      {"chosen", s.chosen}});
  }
  Json out = {{"ok", r.ok()},
              {"mode", law_name(asked.options.law)},
              {"length_mm", units::to_mm(r.length)},
              {"time_s", number(r.time)},
              {"problems", problems},
              {"violations", violations},
              {"tool",
               {{"speed_mm_per_s", units::to_mm(r.tool_speed)},
                {"acceleration_mm_per_s2", units::to_mm(r.tool_acceleration)},
                {"jerk_mm_per_s3", units::to_mm(r.tool_jerk)},
                {"turn_deg_per_s", units::to_deg(r.turn_speed)}}},
              {"drives", drives},
              {"branch", r.branch.empty() ? Json() : Json(r.branch)},
              {"starts", starts},
              {"condition_max", number(r.worst_condition)},
              {"limits", question_json(question)}};
  if (asked.options.law == motion::Law::fastest) {
    Json binding = Json::array();
    for (const auto& [name, share] : r.binding) binding.push_back({{"limit", name}, {"share_of_time", share}});
    out["stops"] = r.stops;
    out["limited_by"] = binding;
  }
  out["forces"] = asked.no_force.empty() ? Json("computed") : Json("not known: " + asked.no_force);
  if (r.lowest_frequency) {
    out["natural_frequencies_hz"] = r.frequencies;
    out["lowest_natural_frequency_hz"] = *r.lowest_frequency;
  }
  if (asked.rotation) {
    Json angles = Json::array();
    for (const double a : asked.rotation->angles) angles.push_back(units::to_deg(a));
    out["tool_rotation"] = {{"passes", asked.rotation->passes},
                            {"constant", asked.rotation->constant},
                            {"angles_deg", angles},
                            {"condition_max", number(asked.rotation->condition)}};
  }
  if (asked.insertion) {
    Json points = Json::array();
    for (const motion::InsertedPoint& p : asked.insertion->points) {
      points.push_back({{"line", p.line > 0 ? Json(p.line) : Json()},
                        {"at_mm", vector_json(p.p * units::kMmPerMetre)},
                        {"angles_deg", vector_json(p.angles * units::to_deg(1))}});
    }
    out["inserted_points"] = points;
  }
  if (asked.quality) {
    out["quality"] = {{"f", asked.quality->f},
                      {"integral_mm", asked.quality->integral},
                      {"length_mm", asked.quality->length},
                      {"least", asked.quality->least}};
  }
  if (r.contour) {
    const auto error = [](const motion::PathError& e) {
      return Json{{"max_um", units::to_um(e.largest)},
                  {"mean_um", units::to_um(e.mean)},
                  {"at_its_time_um", units::to_um(e.largest_lag)},
                  {"orientation_max_deg", units::to_deg(e.largest_turn)}};
    };
    out["contour_error"] = {{"compensated", error(r.contour->compensated)},
                            {"uncompensated", error(r.contour->uncompensated)},
                            {"resolution_alone", error(r.contour->coarse)},
                            {"commands", r.contour->commands}};
  }
  out["instants_checked"] = r.checked;
  out["notes"] = r.notes;
  return out;
}

/// "x, y, z" of a point, mm.
std::string coordinates(const Vec3& p) {
  const Figures at(units::to_mm(p.norm()), 2);
  return fmt::format("{}, {}, {}", at(units::to_mm(p.x())), at(units::to_mm(p.y())), at(units::to_mm(p.z())));
}

/// Limits that are the same for several drives, once, with the largest value that was met.
std::vector<pages::MotionLimit> together(const std::vector<pages::MotionLimit>& limits) {
  std::vector<pages::MotionLimit> out;
  for (const pages::MotionLimit& l : limits) {
    const std::size_t drive = l.name.find(" of drive ");
    if (drive == std::string::npos) {
      out.push_back(l);
      continue;
    }
    const std::string name = l.name.substr(0, drive) + " of the drives";
    const auto same = std::find_if(out.begin(), out.end(), [&](const pages::MotionLimit& o) {
      return o.name == name && o.limit == l.limit && o.unit == l.unit;
    });
    if (same == out.end()) {
      out.push_back({name, l.limit, l.met, l.unit, l.given});
    } else {
      same->met = std::max(same->met, l.met);
    }
  }
  return out;
}

void print_move(const motion::MoveResult& r, const Asked& asked, const pages::MotionQuestion& question) {
  fmt::print("length   {} mm\ntime     {}\n", figure(units::to_mm(r.length), 1),
             std::isfinite(r.time) ? figure(r.time, 4) + " s" : "not known");
  if (asked.options.law == motion::Law::fastest && std::isfinite(r.time)) {
    fmt::print("stops    {} on the way\n", r.stops);
    for (const auto& [name, share] : r.binding) fmt::print("limited  {:.0f} % of the time by {}\n", 100 * share, name);
  }
  if (r.starts.size() > 1) {
    const auto complete = std::count_if(r.starts.begin(), r.starts.end(), [](const auto& s) { return s.completes; });
    fmt::print("branch   {} ({} of {} solutions at the start pass the whole path)\n", r.branch, complete,
               r.starts.size());
  }
  fmt::print("{:<8} {:>10} {:>10} {:>12} {:>14} {:>14}\n", "", "min", "max", "speed /s", "acceler. /s2", "jerk /s3");
  fmt::print("{:<8} {:>10} {:>10} {:>12} {:>14} {:>14} mm\n", "tool", "", "", figure(units::to_mm(r.tool_speed), 1),
             figure(units::to_mm(r.tool_acceleration), 0), figure(units::to_mm(r.tool_jerk), 0));
  double largest = 0;
  for (const motion::MoveDrive& d : r.drives)
    if (d.low <= d.high) largest = std::max({largest, std::abs(shown(d, d.low)), std::abs(shown(d, d.high))});
  const Figures position(largest, 3);
  // Each column at the scale of its largest figure, so that rounding shows as 0.
  const auto column = [&](double motion::MoveDrive::*what, bool turns, int digits) {
    double most = 0;
    for (const motion::MoveDrive& d : r.drives)
      if (d.turns == turns) most = std::max(most, shown(d, d.*what));
    return Figures(most, digits);
  };
  for (std::size_t i = 0; i < r.drives.size(); ++i) {
    const motion::MoveDrive& d = r.drives[i];
    if (!(d.low <= d.high)) continue;
    fmt::print("drive {:<2} {:>10} {:>10} {:>12} {:>14} {:>14} {}\n", i + 1, position(shown(d, d.low)),
               position(shown(d, d.high)), column(&motion::MoveDrive::speed, d.turns, 1)(shown(d, d.speed)),
               column(&motion::MoveDrive::acceleration, d.turns, 0)(shown(d, d.acceleration)),
               column(&motion::MoveDrive::jerk, d.turns, 0)(shown(d, d.jerk)), unit_of(d));
  }
  constexpr std::size_t kMostCorners = 5;
  std::size_t corners = 0;
  for (const motion::MoveViolation& v : r.violations) {
    if (v.kind == "corner" && ++corners > kMostCorners) continue;
    const std::string line = v.line > 0 ? fmt::format(" (line {})", v.line) : "";
    if (std::isfinite(v.t)) {
      fmt::print("problem  after {:.3f} s at {} mm{}: {}\n", v.t, coordinates(v.p), line, v.detail);
    } else {
      fmt::print("problem  at {} mm{}: {}\n", coordinates(v.p), line, v.detail);
    }
  }
  if (corners > kMostCorners) {
    fmt::print("problem  {} more corners in which the tool would have to stop (all are in --json)\n",
               corners - kMostCorners);
  }
  for (std::size_t i = 0; i < r.drives.size(); ++i) {
    const motion::MoveDrive& d = r.drives[i];
    if (d.force)
      fmt::print("drive {:<2} {} at most {} {}\n", i + 1, d.turns ? "torque" : "force", figure(*d.force, 2),
                 d.turns ? "Nm" : "N");
  }
  if (r.lowest_frequency) {
    fmt::print("lowest natural frequency {} Hz on the path, {} Hz at its start\n", figure(*r.lowest_frequency, 1),
               figure(r.frequencies.front(), 1));
  }
  if (asked.rotation) {
    if (!asked.rotation->passes) {
      fmt::print("rotation no rotation about the tool axis was found with which the whole path can be passed\n");
    } else if (asked.rotation->constant) {
      fmt::print("rotation {:g} deg about the tool axis\n", units::to_deg(asked.rotation->angles.front()));
    } else {
      std::vector<std::string> angles;
      for (const double a : asked.rotation->angles) angles.push_back(fmt::format("{:g}", units::to_deg(a)));
      fmt::print("rotation about the tool axis at the points: {} deg\n", fmt::join(angles, ", "));
    }
  }
  if (asked.insertion) {
    for (const motion::InsertedPoint& p : asked.insertion->points) {
      fmt::print("inserted at {} mm: A, B, C {:g}, {:g}, {:g} deg\n", coordinates(p.p), units::to_deg(p.angles.x()),
                 units::to_deg(p.angles.y()), units::to_deg(p.angles.z()));
    }
    if (asked.insertion->points.empty()) fmt::print("inserted no point\n");
  }
  if (asked.quality) {
    fmt::print("quality  f = {:.6g} (integral {:.6g} mm over {} mm, least {:.6g})\n", asked.quality->f,
               asked.quality->integral, figure(asked.quality->length, 1), asked.quality->least);
  }
  if (r.contour) {
    const auto say = [](const char* what, const motion::PathError& e) {
      fmt::print("contour  {:<34} at most {} um from the path, mean {} um; at most {} um from where it should be\n",
                 what, figure(units::to_um(e.largest), 2), figure(units::to_um(e.mean), 2),
                 figure(units::to_um(e.largest_lag), 2));
    };
    say("commands earlier by the delay:", r.contour->compensated);
    say("commands not earlier:", r.contour->uncompensated);
    say("resolution alone:", r.contour->coarse);
  }
  for (const std::string& note : r.notes) fmt::print("note     {}\n", note);
  for (const pages::MotionLimit& l : together(question.limits)) {
    if (!std::isfinite(r.time)) break;  // nothing moved that could meet a limit
    print_limit(l);
  }
  fmt::print("judged   {}\n", fmt::join(question.judged, ", "));
  fmt::print("not judged: {}\n", fmt::join(question.not_judged, ", "));
}

/// Angles and ways that the path asks for and the machine does not have, as violations.
void axes_not_there(const machine::AnyMachine& m, const motion::PosePath& path, motion::MoveResult& r) {
  const machine::Task task = kinematics::task(m);
  constexpr double kNoTurn = 1e-9, kNoWay = 1e-9;
  for (int k = 0; k < 3; ++k) {
    // A coordinate that follows from the others may stand in the path, but not go along it.
    for (const motion::Stretch& s : path.stretches) {
      if (task.holds(static_cast<machine::Coordinate>(k))) break;
      if (!(std::abs(s.to[k] - s.from[k]) > kNoWay)) continue;
      motion::MoveViolation v;
      v.p = s.from;
      v.line = s.line;
      v.kind = "axis";
      v.limit = fmt::format("no {}", "xyz"[k]);
      v.detail = fmt::format("{0} from {1} to {2} mm: the poses of this machine do not prescribe {0}", "xyz"[k],
                             figure(units::to_mm(s.from[k]), 3), figure(units::to_mm(s.to[k]), 3));
      r.violations.push_back(v);
      break;
    }
    if (task.holds(static_cast<machine::Coordinate>(3 + k))) continue;
    for (const motion::Stretch& s : path.stretches) {
      const double from = s.angles_from[k], to = s.angles_to[k], most = std::abs(from) > std::abs(to) ? from : to;
      if (!(std::abs(most) > kNoTurn)) continue;
      motion::MoveViolation v;
      v.p = s.from;
      v.line = s.line;
      v.kind = "axis";
      v.limit = fmt::format("no {}", "ABC"[k]);
      v.detail = fmt::format("{} {:g} deg: this machine has no {}", "ABC"[k], units::to_deg(most), "ABC"[k]);
      r.violations.push_back(v);
      break;
    }
  }
}

/// Where x, y or z of the tip follow from what the path prescribes: how far the tip itself goes.
std::optional<std::string> way_of_the_tip(const machine::AnyMachine& m, const motion::MoveResult& r) {
  const machine::Task task = kinematics::task(m);
  std::vector<std::string> follow, given;
  for (int k = 0; k < 3; ++k) {
    if (!task.holds(static_cast<machine::Coordinate>(k))) follow.emplace_back(1, "xyz"[k]);
  }
  if (follow.empty()) return {};
  for (int i = 0; i < task.size(); ++i) given.emplace_back(machine::name_of(task[i]));
  double length = 0, speed = 0;
  for (std::size_t k = 0; k < r.samples.size(); ++k) {
    speed = std::max(speed, r.samples[k].v.norm());
    if (k > 0) length += (r.samples[k].X.p - r.samples[k - 1].X.p).norm();
  }
  return fmt::format(
      "the length and a constant speed are those of what the path prescribes, {}; {} of the tip follow: it goes "
      "about {} mm, at most {} mm/s",
      fmt::join(given, ", "), fmt::join(follow, " and "), figure(units::to_mm(length), 1),
      figure(units::to_mm(speed), 1));
}

}  // namespace

Command move_command() {
  auto o = std::make_shared<Options>();
  return {
      "move", "The tool of any machine along a path or a program: how tool and drives move, and whether they can",
      "polypod move delta-brno --points \"200,-200,450;-200,200,550\" --speed 500",
      [o](Arguments& a) {
        a.positional("MACHINE", o->machine, "A machine file or a name of `polypod machines`; not with --job", false);
        a.option("--set", o->sets, "key=value: override a parameter of the machine (repeatable)");
        a.option("--path", o->file, "A path file (docs/motion.md): points with orientations and times, lines and arcs");
        a.option("--points", o->points, "x,y,z;x,y,z;...: lines, mm; with angles as --pose has them");
        a.option("--program", o->program, "A G-code program, in the least time within its feeds and the limits");
        a.option(
            "--job", o->job,
            "The job file of --program: machine, origin and rotation of the workpiece, work offsets, joint speeds");
        a.option("--origin", o->origin, "x,y,z of the workpiece origin in M, mm, of --program");
        a.option("--rapid", o->rapid, {1e-3, 1e9}, "Largest speed of G0, mm/min (default 6000)");
        a.option("--speed", o->speed, {1e-6, 1e9},
                 "The tip at this constant speed, mm/s, in the least time at most at this (default: the path file's)");
        a.option("--profile", o->profile,
                 "Of a path with times: linear (a constant rate between points), smooth (a stop in each), spline");
        a.flag("--time-optimal", o->fastest, "In the least time within the limits of tool and drives");
        a.option("--blend", o->blend, kDistance_mm,
                 "Corners are rounded by up to this, mm (default 0: the tool stops in them)");
        a.option("--tool-speed", o->tool_speed, kSpeed, "mm/s (planned motion: default 5000; 0: no limit)");
        a.option("--tool-acceleration", o->tool_acceleration, kAcceleration, "mm/s2 (default 1e5; 0: no limit)");
        a.option("--tool-jerk", o->tool_jerk, kJerk, "mm/s3 (default 5e6; 0: no limit)");
        a.option("--turn-speed", o->turn_speed, kSpeed, "Of the tool's orientation, deg/s (default 0: no limit)");
        a.option("--drive-speed", o->drive_speed,
                 "deg/s or mm/s, one number or one a drive (default 12 rad/s, 12 m/s; 0: no limit)");
        a.option("--drive-acceleration", o->drive_acceleration,
                 "deg/s2 or mm/s2 (default 250 rad/s2, m/s2; 0: no limit)");
        a.option("--drive-jerk", o->drive_jerk, "deg/s3 or mm/s3 (default 2e4 rad/s3, m/s3; 0: no limit)");
        o->masses.declare(a);
        a.option("--step", o->step, kStep_mm,
                 "Between judged points of the path, mm, and deg where the tool turns (default 1)");
        a.option("--samples", o->samples, {2, 100000}, "Of tables and curves (default 1000)");
        a.option("--condition-max", o->condition, {0, 1e12},
                 "Poses with a larger condition number are near-singular (default 1000, of heads on linear axes 0; 0: "
                 "not judged)");
        a.option("--singularity-distance", o->clearance, kDistance_mm,
                 "Of deltas: least distance from singular poses, mm (default 10; 0: not checked)");
        a.option("--start", o->start, "Solution of the inverse at the first pose: its number, or `best` conditioned");
        a.option("--interval", o->interval, {1e-3, 1e5},
                 "Between two commands to a drive, ms: the contour error that remains");
        a.option("--resolution", o->resolution, "Smallest step of the drives, deg or mm, one number or one a drive");
        a.option("--delay", o->delay, "Of the drives behind their commands, ms, one number or one a drive");
        a.flag("--staggered", o->staggered,
               "The drives get their commands one after the other, spread over the interval");
        a.flag("--free-rotation", o->free_rotation,
               "Choose the rotation about the tool axis so that the whole path can be passed, well conditioned");
        a.flag("--insert-points", o->insert,
               "Where the path cannot be passed as it turns, turn on the spot at points that are put in");
        a.option("--quality", o->goal,
                 "Quality of the path, JEL (7.1), by sigma_min, determinant or inverse_condition");
        a.option("--weight", o->weight, {0, 1}, "p of JEL (7.1): 1 counts the length alone (default 0.5)");
        a.option("--csv", o->csv, "A row a sample: tool and drives with speed, acceleration and jerk");
        a.option("--report", o->report, "An HTML page with the curves and a picture");
      },
      [o](const Context& context) -> Result<int> {
        POLYPOD_ASSIGN(placed, placed_of(*o, context));
        const machine::AnyMachine& m = placed.machine();
        std::vector<std::string> inputs{o->machine, o->file, o->program, o->job,
                                        o->masses.dynamics == o->machine ? "" : o->masses.dynamics};
        if (!o->job.empty()) {
          for (const std::string& named : config::files_named_by(o->job)) inputs.push_back(named);
        }
        POLYPOD_TRY(check_files(inputs, {o->csv, o->report}, context.json));
        POLYPOD_ASSIGN(asked, path_of(placed.job, *o, context));
        motion::MoveOptions& options = asked.options;
        POLYPOD_TRY(limits_of(placed.job, *o, context, options));
        if (o->blend > 0) {
          const bool curvature = options.law == motion::Law::fastest && options.limits.limits_jerk();
          asked.path = motion::blended(asked.path, units::from_mm(o->blend), curvature);
        }
        options.step = units::from_mm(o->step);
        options.turn_step *= o->step;
        options.samples = o->samples;
        const bool has_clearance = motion::has_clearance(m);
        POLYPOD_TRY(refuse(context, {has_clearance ? "--condition-max" : "--singularity-distance"},
                           has_clearance ? "of deltas --singularity-distance says what is near-singular"
                                         : "--condition-max says what is near-singular, but of deltas"));
        options.condition =
            context.given("--condition-max") || !kinematics::is_head_on_linear_axes(m) ? o->condition : 0;
        if (const std::vector<double>& before = placed.job.start_joints; !before.empty() && o->start.empty())
          options.before = Eigen::Map<const Eigen::VectorXd>(before.data(), std::ssize(before));
        options.singular_distance = units::from_mm(o->clearance);
        if (o->start == "best") {
          options.best_start = true;
        } else if (!o->start.empty()) {
          const auto number = count_of(o->start, "--start", {1, 1000}, "");
          if (!number) return fail("AP216", fmt::format("--start {}: not known", o->start), {}, "a number, or best");
          const int k = *number;
          options.start = static_cast<std::size_t>(k - 1);
        }
        POLYPOD_TRY(actuators_of(m, *o, context, options));
        asked.job_speeds = placed.job.own_speeds;
        asked.job_accelerations = !placed.job.joint_accelerations.empty();
        POLYPOD_ASSIGN(masses, o->masses.read(m, placed.file, context));
        options.dynamics = masses.dynamics;
        options.force = masses.force;
        asked.no_force = masses.why_not;
        if (o->goal.empty()) POLYPOD_TRY(refuse(context, {"--weight"}, "it serves --quality"));
        options.progress = progress_line(context, "moving");
        POLYPOD_TRY(choose(m, *o, asked));
        if (!o->goal.empty()) {
          POLYPOD_ASSIGN(goal, goal_of(o->goal));
          asked.quality = motion::quality_of(m, asked.path, options, goal, o->weight);
        }
        POLYPOD_ASSIGN(r, motion::move(m, asked.path, options));
        options.progress(1);
        if (masses.dynamics) r.notes.push_back(in_words(*masses.dynamics));
        if (const auto said = way_of_the_tip(m, r)) r.notes.push_back(*said);
        r.notes.insert(r.notes.begin(), asked.notes.begin(), asked.notes.end());
        axes_not_there(m, asked.path, r);
        const pages::MotionQuestion question = question_of(m, r, asked, context);
        if (context.json) {
          print_json(move_json(r, asked, question));
        } else {
          print_move(r, asked, question);
        }
        const std::string table = o->csv.empty() ? "" : pages::move_csv(m, r);
        const std::string page =
            o->report.empty() ? "" : pages::move_page(m, asked.path, r, question, POLYPOD_VERSION, command_line());
        files::Outputs together;
        if (!o->csv.empty()) POLYPOD_TRY(together.add(o->csv, table));
        if (!o->report.empty()) POLYPOD_TRY(together.add(o->report, page));
        POLYPOD_TRY(together.commit());
        for (const std::string* path : {&o->csv, &o->report})
          if (!path->empty() && !context.json) fmt::print("wrote {}\n", *path);
        return r.ok() ? kDone : kAnswerIsNo;
      }};
}

}  // namespace polypod::app
