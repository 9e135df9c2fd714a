// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// pick, fit
#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>
#include <memory>

#include "commands.hpp"
#include "masses_options.hpp"
#include "messages.hpp"
#include "motion_output.hpp"
#include "polypod/core/figures.hpp"
#include "polypod/core/files.hpp"
#include "polypod/core/units.hpp"
#include "polypod/motion/cycles.hpp"
#include "polypod/pages/motion.hpp"
#include "polypod/workspace/fit.hpp"
#include "survey_options.hpp"

namespace polypod::app {
namespace {

/// "x,y,z;x,y,z" in mm as points in m.
Result<std::vector<Vec3>> points_of(const std::string& text, const std::string& option) {
  std::vector<Vec3> out;
  for (std::size_t start = 0; start < text.size();) {
    const std::size_t end = std::min(text.find(';', start), text.size());
    POLYPOD_ASSIGN(n, numbers_of(text.substr(start, end - start), option));
    if (n.size() != 3) return fail("AP190", fmt::format("{} {}: not points x,y,z;x,y,z", option, text));
    constexpr double kFarthest_mm = 1e7;  // 10 km: beyond it lies a wrong unit
    for (const double x : n) {
      if (std::abs(x) <= kFarthest_mm) continue;
      return fail("AP190", fmt::format("{}: {:g} mm is farther than any machine reaches", option, x), {},
                  "give x,y,z in mm");
    }
    out.emplace_back(units::from_mm(n[0]), units::from_mm(n[1]), units::from_mm(n[2]));
    start = end + 1;
  }
  return out;
}
Result<Vec3> point_of(const std::string& text, const std::string& option) {
  POLYPOD_ASSIGN(points, points_of(text, option));
  if (points.size() != 1) return fail("AP190", fmt::format("{} {}: not one point x,y,z", option, text));
  return points.front();
}

struct DriveUnit {
  const char* name;
  double (*to)(double);
  double (*from)(double);
};
DriveUnit drive_unit(const machine::AnyMachine& m) {
  if (kinematics::joint_kind(m, 0) == machine::JointKind::revolute) return {"deg", units::to_deg, units::from_deg};
  return {"mm", units::to_mm, units::from_mm};
}

const char* force_unit(const machine::AnyMachine& m) {
  return kinematics::joint_kind(m, 0) == machine::JointKind::revolute ? "Nm" : "N";
}

Json peaks_json(const motion::Peaks& p, double (*to)(double), const std::string& unit) {
  return {{"speed_" + unit + "_per_s", to(p.speed)},
          {"acceleration_" + unit + "_per_s2", to(p.acceleration)},
          {"jerk_" + unit + "_per_s3", to(p.jerk)}};
}

/// What is common to a run along a path and a cycle.
Json run_json(const machine::AnyMachine& m, const motion::Run& r) {
  const DriveUnit unit = drive_unit(m);
  Json problems = Json::array();
  for (const motion::Problem& p : r.problems) {
    problems.push_back({{"kind", p.kind},
                        {"detail", p.detail},
                        {"at_mm", vector_json(p.X * units::kMmPerMetre)},
                        {"path_length_mm", units::to_mm(p.s)},
                        {"time_s", p.t}});
  }
  Json drives = Json::array();
  for (int i = 0; i < r.arms; ++i) {
    Json drive = peaks_json(r.drive[i], unit.to, unit.name);
    const std::string suffix = std::string("_") + unit.name;
    drive["start" + suffix] = unit.to(r.samples.front().drive[i].q);
    drive["end" + suffix] = unit.to(r.samples.back().drive[i].q);
    if (r.low[i] <= r.high[i]) {
      drive["min" + suffix] = unit.to(r.low[i]);
      drive["max" + suffix] = unit.to(r.high[i]);
    }
    drives.push_back(drive);
  }
  return {{"ok", r.ok()},
          {"length_mm", units::to_mm(r.length)},
          {"time_s", r.time},
          {"problems", problems},
          {"tool", peaks_json(r.tool, units::to_mm, "mm")},
          {"drives", drives}};
}

/// "x, y, z" of a point, mm.
std::string coordinates(const Vec3& p) {
  const Figures shown(units::to_mm(p.norm()), 2);
  return fmt::format("{}, {}, {}", shown(units::to_mm(p.x())), shown(units::to_mm(p.y())), shown(units::to_mm(p.z())));
}

void print_run(const machine::AnyMachine& m, const motion::Run& r) {
  const DriveUnit unit = drive_unit(m);
  fmt::print("length   {} mm\ntime     {} s\n", figure(units::to_mm(r.length), 1), figure(r.time, 4));
  fmt::print("{:<8} {:>10} {:>10} {:>12} {:>14} {:>14}\n", "", "min", "max", "speed /s", "acceler. /s2", "jerk /s3");
  fmt::print("{:<8} {:>10} {:>10} {:>12} {:>14} {:>14} mm\n", "tool", "", "", figure(units::to_mm(r.tool.speed), 1),
             figure(units::to_mm(r.tool.acceleration), 0), figure(units::to_mm(r.tool.jerk), 0));
  double largest = 0;
  for (int i = 0; i < r.arms; ++i)
    largest = std::max({largest, std::abs(unit.to(r.low[i])), std::abs(unit.to(r.high[i]))});
  const Figures position(largest, 3);
  for (int i = 0; i < r.arms && r.low[i] <= r.high[i]; ++i) {
    const motion::Peaks& p = r.drive[i];
    fmt::print("drive {:<2} {:>10} {:>10} {:>12} {:>14} {:>14} {}\n", i + 1, position(unit.to(r.low[i])),
               position(unit.to(r.high[i])), figure(unit.to(p.speed), 1), figure(unit.to(p.acceleration), 0),
               figure(unit.to(p.jerk), 0), unit.name);
  }
  for (const motion::Problem& p : r.problems) {
    fmt::print("problem  after {:.3f} s at {} mm: {}\n", p.t, coordinates(p.X), p.detail);
  }
}

/// What a motion of this machine is judged by, whatever its speed.
pages::MotionQuestion question_of(const machine::AnyMachine& m, const motion::Run& r, std::string what,
                                  const Context& context, double clearance_mm,
                                  const std::vector<motion::PeakForce>& forces,
                                  const machine::JointVector& force_limits) {
  pages::MotionQuestion out;
  out.what = std::move(what);
  out.judged = pages::limits_of_poses(m);
  if (clearance_mm > 0) {
    out.judged.emplace_back("distance from singular poses");
    out.limits.push_back({"least distance from singular poses", clearance_mm, units::to_mm(r.clearance), "mm",
                          context.given("--singularity-distance")});
  } else {
    out.not_judged.emplace_back("distance from singular poses");
  }
  if (force_limits.size() == 0) out.not_judged.emplace_back("forces of the drives");
  for (std::size_t i = 0; i < forces.size() && force_limits.size() > 0; ++i) {
    const double limit = force_limits[static_cast<Eigen::Index>(i)];
    out.limits.push_back({fmt::format("force of drive {}", i + 1), limit, forces[i].force, force_unit(m), true});
  }
  out.not_judged.emplace_back("deflection, vibration, collisions with workpiece and surroundings");
  return out;
}

/// The three limits of the tool or of the drives beside the largest values met.
void add_limits(pages::MotionQuestion& question, const Context& context, const std::string& whose,
                const std::string& option, const motion::Peaks& limit, const motion::Peaks& met, double (*to)(double),
                const std::string& unit) {
  const auto add = [&](const char* what, double motion::Peaks::*of, const char* per) {
    question.limits.push_back({fmt::format("{} of the {}", what, whose), to(limit.*of), to(met.*of), unit + per,
                               context.given(option + "-" + what)});
  };
  add("speed", &motion::Peaks::speed, "/s");
  add("acceleration", &motion::Peaks::acceleration, "/s²");
  add("jerk", &motion::Peaks::jerk, "/s³");
}

motion::Peaks largest_of_drives(const motion::Run& r) {
  motion::Peaks out;
  for (int i = 0; i < r.arms; ++i) {
    out.speed = std::max(out.speed, r.drive[i].speed);
    out.acceleration = std::max(out.acceleration, r.drive[i].acceleration);
    out.jerk = std::max(out.jerk, r.drive[i].jerk);
  }
  return out;
}

Json question_json(const pages::MotionQuestion& question) {
  Json limits = Json::array();
  for (const pages::MotionLimit& l : question.limits) {
    limits.push_back({{"name", l.name}, {"limit", l.limit}, {"met", l.met}, {"unit", l.unit}, {"given", l.given}});
  }
  return {{"values", limits}, {"judged", question.judged}, {"not_judged", question.not_judged}};
}

void print_question(const pages::MotionQuestion& question) {
  for (const pages::MotionLimit& l : question.limits) print_limit(l);
  fmt::print("judged   {}\n", fmt::join(question.judged, ", "));
  if (!question.not_judged.empty()) fmt::print("not judged: {}\n", fmt::join(question.not_judged, ", "));
}

struct Outputs {
  std::string csv, report;
  void declare(Arguments& a) {
    a.option("--csv", csv, "A row a sample: tool and drives with speed, acceleration and jerk");
    a.option("--report", report, "An HTML page with the curves and a picture");
  }
  [[nodiscard]] Status check(const std::vector<std::string>& inputs, bool json) const {
    return check_files(inputs, {csv, report}, json);
  }
  Status write(const machine::AnyMachine& m, const motion::Run& r, const pages::MotionQuestion& question,
               bool json) const {
    const std::string table = csv.empty() ? "" : pages::motion_csv(m, r);
    const std::string page = report.empty() ? "" : pages::motion_page(m, r, question, POLYPOD_VERSION, command_line());
    files::Outputs together;
    if (!csv.empty()) POLYPOD_TRY(together.add(csv, table));
    if (!report.empty()) POLYPOD_TRY(together.add(report, page));
    POLYPOD_TRY(together.commit());
    for (const std::string* path : {&csv, &report})
      if (!path->empty() && !json) fmt::print("wrote {}\n", *path);
    return {};
  }
};

/// "fits, 12.3 mm from the boundary (there: arm 1 above its largest angle); certain within 12.2 mm".
std::string fit_in_words(const machine::AnyMachine& m, const workspace::PointFit& p) {
  const std::string limit = workspace::limit_label(m, p.limit);
  if (!std::isfinite(p.distance)) {
    return p.fits ? "fits, and no boundary was found"
                  : fmt::format("does not fit: {}; nothing that fits was found", limit);
  }
  if (!p.fits) {
    return fmt::format("does not fit: {}; the nearest point found that fits is {} mm away, at {}", limit,
                       figure(units::to_mm(p.distance), 1), place_text(p.boundary));
  }
  const Figures mm(units::to_mm(p.distance), 1);
  const double step = std::pow(10.0, -mm.decimals());  // what is certain is rounded down
  return fmt::format("fits, {} mm from the boundary found (there: {}), certain within {} mm",
                     mm(units::to_mm(p.distance)), limit, mm(std::floor(units::to_mm(p.certain) / step) * step));
}

}  // namespace

namespace {
// Of tool and drives: mm or deg, to the powers of s.
constexpr config::Range kSpeed{1e-6, 1e9}, kAcceleration{1e-6, 1e12}, kJerk{1e-6, 1e15};
constexpr config::Range kClearance_mm{0, 1e6};
}  // namespace

Command pick_command() {
  struct Options {
    std::string machine, from, to;
    std::vector<std::string> sets;
    double lift = 25, rounding = 15, clearance = 10;
    double tool_speed = 5000, tool_acceleration = 100e3, tool_jerk = 5e6;
    double drive_speed = 0, drive_acceleration = 0, drive_jerk = 0;
    int samples = 400;
    MassesOptions masses;
    Outputs outputs;
  };
  auto o = std::make_shared<Options>();
  return {"pick", "The fastest pick-and-place cycle of a delta (up, over, down) within limits of tool and drives",
          "polypod pick delta-brno --from -152.5,0,550 --to 152.5,0,550 --clearance-height 25",
          [o](Arguments& a) {
            declare_machine(a, o->machine, o->sets);
            a.option("--from", o->from, "x,y,z, mm", true);
            a.option("--to", o->to, "x,y,z, mm", true);
            a.option("--clearance-height", o->lift, {0, 1e6},
                     "Height of the transfer above the higher end, mm (default 25)");
            a.option("--corner-blend", o->rounding, {0, 1e6},
                     "Height over which corners are blended, mm (default 15; 0: stop there)");
            a.option("--tool-speed", o->tool_speed, kSpeed, "mm/s (default 5000)");
            a.option("--tool-acceleration", o->tool_acceleration, kAcceleration, "mm/s2 (default 1e5)");
            a.option("--tool-jerk", o->tool_jerk, kJerk, "mm/s3 (default 5e6)");
            a.option("--drive-speed", o->drive_speed, kSpeed, "deg/s or mm/s (default 12 rad/s, 12 m/s)");
            a.option("--drive-acceleration", o->drive_acceleration, kAcceleration,
                     "deg/s2 or mm/s2 (default 250 rad/s2, m/s2)");
            a.option("--drive-jerk", o->drive_jerk, kJerk, "deg/s3 or mm/s3 (default 2e4 rad/s3, m/s3)");
            o->masses.declare(a);
            a.option("--singularity-distance", o->clearance, kClearance_mm,
                     "Least distance from singular poses, mm (default 10; 0: not checked)");
            a.option("--samples", o->samples, {2, 100000}, "Of tables and curves (default 400)");
            o->outputs.declare(a);
          },
          [o](const Context& context) -> Result<int> {
            POLYPOD_ASSIGN(m, machine_of(o->machine, o->sets));
            POLYPOD_ASSIGN(from, point_of(o->from, "--from"));
            POLYPOD_ASSIGN(to, point_of(o->to, "--to"));
            POLYPOD_TRY(o->outputs.check({o->machine, o->masses.dynamics == o->machine ? "" : o->masses.dynamics},
                                         context.json));
            POLYPOD_ASSIGN(masses, o->masses.read(m, o->machine, context));
            const motion::Cycle cycle{from, to, units::from_mm(o->lift), units::from_mm(o->rounding)};
            motion::MotionLimits limits;
            limits.tool = {units::from_mm(o->tool_speed), units::from_mm(o->tool_acceleration),
                           units::from_mm(o->tool_jerk)};
            const DriveUnit unit = drive_unit(m);
            if (o->drive_speed != 0) limits.drive.speed = unit.from(o->drive_speed);
            if (o->drive_acceleration != 0) limits.drive.acceleration = unit.from(o->drive_acceleration);
            if (o->drive_jerk != 0) limits.drive.jerk = unit.from(o->drive_jerk);
            motion::RunOptions options;
            options.singular = units::from_mm(o->clearance);
            POLYPOD_ASSIGN(plan, motion::plan(m, cycle, limits, options));
            POLYPOD_ASSIGN(r, motion::run(m, cycle, plan, o->samples, options));
            std::vector<motion::PeakForce> forces;
            if (masses.dynamics) {
              motion::LargestForces largest = motion::largest_forces(m, *masses.dynamics, cycle, plan);
              forces = std::move(largest.drives);
              if (const auto t = largest.unknown) {
                r.problems.push_back({*t, *t / plan.time, plan.tool(cycle, *t).p, "drive",
                                      "the forces of the drives are not known here, out of reach or singular"});
              }
            }
            for (std::size_t i = 0; i < forces.size() && masses.force.size() > 0; ++i) {
              const double limit = masses.force[static_cast<Eigen::Index>(i)];
              if (!(forces[i].force > limit)) continue;
              const double t = forces[i].t;
              r.problems.push_back({t, t / plan.time, plan.tool(cycle, t).p, "drive",
                                    fmt::format("drive {} force {:.6g} {} is above {:.6g}", i + 1, forces[i].force,
                                                force_unit(m), limit)});
            }
            pages::MotionQuestion question =
                question_of(m, r, "A pick-and-place cycle", context, o->clearance, forces, masses.force);
            add_limits(question, context, "tool", "--tool", limits.tool, r.tool, units::to_mm, "mm");
            add_limits(question, context, "drives", "--drive", limits.drive, largest_of_drives(r), unit.to, unit.name);
            if (context.json) {
              Json document = run_json(m, r);
              document["limits"] = question_json(question);
              document["forces"] = masses.dynamics ? Json("computed") : Json("not known: " + masses.why_not);
              for (std::size_t i = 0; i < forces.size(); ++i) {
                document["drives"][i]["force_max"] = forces[i].force;
                document["drives"][i]["force_unit"] = force_unit(m);
              }
              document["notes"] = masses.dynamics ? Json::array({in_words(*masses.dynamics)}) : Json::array();
              document["limited_by"] = plan.limited_by;
              document["up_s"] = plan.up;
              document["over_s"] = plan.over;
              document["down_s"] = plan.down;
              document["over_start_s"] = plan.over_start;
              document["down_start_s"] = plan.down_start;
              document["cycles_per_minute"] = 30 / plan.time;
              print_json(document);
            } else {
              print_run(m, r);
              for (std::size_t i = 0; i < forces.size(); ++i) {
                const bool turns = unit.name == std::string_view("deg");
                fmt::print("drive {:<2} {} at most {} {}\n", i + 1, turns ? "torque" : "force",
                           figure(forces[i].force, 2), force_unit(m));
              }
              if (masses.dynamics) fmt::print("note     {}\n", in_words(*masses.dynamics));
              print_question(question);
              fmt::print("limited by {}; there and back {:.0f} times a minute\n", plan.limited_by, 30 / plan.time);
            }
            POLYPOD_TRY(o->outputs.write(m, r, question, context.json));
            return r.ok() ? kDone : kAnswerIsNo;
          }};
}

Command fit_command() {
  struct Options {
    std::string machine, points;
    std::vector<std::string> sets;
    WorkspaceOptions workspace;
  };
  auto o = std::make_shared<Options>();
  return {"fit", "Whether a delta reaches given points, and which rods, height or placement would make it",
          "polypod fit delta-brno --points \"300,0,600;-300,0,600\"",
          [o](Arguments& a) {
            declare_machine(a, o->machine, o->sets);
            a.option("--points", o->points, "x,y,z;x,y,z;..., mm", true);
            o->workspace.declare_limits(a);
          },
          [o](const Context& context) -> Result<int> {
            POLYPOD_ASSIGN(m, machine_of(o->machine, o->sets));
            POLYPOD_ASSIGN(options, o->workspace.options(m, context));
            POLYPOD_ASSIGN(points, points_of(o->points, "--points"));
            options.progress = nullptr;
            POLYPOD_ASSIGN(fit, workspace::fit_points(m, options, points));
            const auto range_json = [](const std::optional<workspace::FitRange>& r) {
              if (!r) return Json();
              return Json{
                  {"min", units::to_mm(r->low)}, {"max", units::to_mm(r->high)}, {"nearest", units::to_mm(r->nearest)}};
            };
            if (context.json) {
              Json list = Json::array();
              for (const workspace::PointFit& p : fit.points) {
                const bool found = std::isfinite(p.distance);
                list.push_back({{"at_mm", vector_json(p.X * units::kMmPerMetre)},
                                {"fits", p.fits},
                                {"margin_mm", found ? Json(units::to_mm(p.fits ? p.distance : -p.distance)) : Json()},
                                {"boundary_at_mm", found ? vector_json(p.boundary * units::kMmPerMetre) : Json()},
                                {"certain_margin_mm", p.fits ? Json(units::to_mm(p.certain)) : Json()},
                                {"limit", workspace::limit_label(m, p.limit)}});
              }
              print_json({{"fits", fit.fits},
                          {"points", list},
                          {"rod_length_mm", range_json(fit.rod_length)},
                          {"base_height_mm", range_json(fit.base_height)},
                          {"placement_mm", fit.placement ? vector_json(*fit.placement * units::kMmPerMetre) : Json()}});
              return fit.fits ? kDone : kAnswerIsNo;
            }
            for (const workspace::PointFit& p : fit.points) {
              const Figures shown(units::to_mm(p.X.norm()), 2);
              for (int k = 0; k < 3; ++k) fmt::print("{:>10} ", shown(units::to_mm(p.X[k])));
              fmt::print(" {}\n", fit_in_words(m, p));
            }
            fmt::print("{}\n", fit.fits ? "the task fits" : "the task does not fit");
            const auto say = [](const char* what, const std::optional<workspace::FitRange>& r) {
              if (!r) {
                fmt::print("{:<12} none makes it fit\n", what);
              } else {
                const Figures mm(units::to_mm(std::max(std::abs(r->low), std::abs(r->high))), 2);
                fmt::print("{:<12} {} .. {} mm, nearest {}\n", what, mm(units::to_mm(r->low)),
                           mm(units::to_mm(r->high)), mm(units::to_mm(r->nearest)));
              }
            };
            say("rods", fit.rod_length);
            say("base by", fit.base_height);
            if (fit.placement) {
              fmt::print("{:<12} {} mm\n", "or base by", coordinates(*fit.placement));
            }
            return fit.fits ? kDone : kAnswerIsNo;
          }};
}

}  // namespace polypod::app
