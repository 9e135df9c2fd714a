// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <memory>
#include <optional>
#include <utility>

#include "busy_line.hpp"
#include "check_bodies.hpp"
#include "commands.hpp"
#include "job_input.hpp"
#include "machining_output.hpp"
#include "messages.hpp"
#include "polypod/core/files.hpp"
#include "polypod/core/named_files.hpp"
#include "polypod/core/units.hpp"
#include "polypod/kinematics/any_machine.hpp"
#include "polypod/kinematics/joint_speed.hpp"
#include "polypod/kinematics/surplus.hpp"
#include "polypod/machining/accept.hpp"
#include "polypod/machining/check.hpp"
#include "polypod/machining/compliance_mark.hpp"
#include "polypod/machining/made_for.hpp"
#include "polypod/machining/place.hpp"
#include "polypod/machining/tilted.hpp"
#include "polypod/machining/unrolling.hpp"
#include "polypod/pages/check.hpp"

namespace polypod::app {

namespace {

/// The machine and where the work is on it: from a job, or from --machine and --origin.
Result<machining::Job> placed_machine(const Context& context, const std::string& job_path, const std::string& machine,
                                      const std::vector<std::string>& sets, const std::string& origin) {
  if (!job_path.empty()) {
    POLYPOD_TRY(refuse(context, {"--machine", "--origin", "--set"}, "the job says it; give --job alone"));
    return machining::read_job(job_path, machining::JobFor::motion);
  }
  if (machine.empty() || origin.empty()) {
    return fail("AP123", "where is the work, and on which machine?", {}, "give --job JOB, or --machine and --origin");
  }
  machining::Job job;
  POLYPOD_ASSIGN(m, machine_of(machine, sets));
  POLYPOD_ASSIGN(p, numbers_of(origin, "--origin"));
  if (p.size() != 3) return fail("AP123", fmt::format("--origin {}: not three numbers", origin));
  job.machine = std::move(m);
  job.joint_speeds = kinematics::speed_limits(job.machine);
  job.machine_name = machine;
  job.X_MW.p = units::from_mm(1) * Vec3(p[0], p[1], p[2]);
  return job;
}

Json problems_json(const std::vector<machining::CheckProblem>& problems) {
  Json out = Json::array();
  for (const machining::CheckProblem& p : problems) {
    out.push_back({{"line", p.line}, {"kind", p.kind}, {"detail", p.detail}});
  }
  return out;
}

/// The answer, and the lines behind it.
void print_answer(const std::string& program, const machining::CheckResult& result, bool with_bodies) {
  constexpr std::size_t kShown = 3;  // of the moves that were not judged
  fmt::print("the program {} the machine{}{}\n", result.ok ? "fits" : "does not fit",
             result.ok && with_bodies ? ", and the bodies that are given do not touch" : "",
             result.ok && !result.not_judged.empty() ? ", apart from what was not judged" : "");
  for (const machining::CheckProblem& p : result.problems) {
    fmt::print("  {}:{}: {}: {}\n", program, p.line, p.kind, p.detail);
  }
  for (std::size_t i = 0; i < std::min(kShown, result.not_judged.size()); ++i) {
    const machining::CheckProblem& p = result.not_judged[i];
    if (p.line == 0) {
      fmt::print("  not judged: {} {}\n", p.kind, p.detail);
      continue;
    }
    const std::string what = p.kind == "end" ? "the whole move: " : p.kind == "way" ? "its way: " : "";
    fmt::print("  not judged: {}:{}: {}{}\n", program, p.line, what, p.detail);
  }
  if (result.not_judged.size() > kShown) {
    fmt::print("  not judged: {} moves more, see --json\n", result.not_judged.size() - kShown);
  }
}

Json nearest_json(const machining::Job& job, const machining::NearestPlaces& found) {
  Json shift, turn;
  if (found.by_shift) {
    const Vec3 by = found.by_shift->origin - job.X_MW.p;
    shift = {{"shift_mm", rounded_mm(by)},
             {"distance_mm", to_a_millionth(units::to_mm(by.norm()))},
             {"origin_mm", rounded_mm(found.by_shift->origin)}};
  }
  if (found.by_turn) {
    turn = {{"turn_by_deg", to_a_millionth(units::to_deg(found.by_turn->turn - machining::rotation_of(job.X_MW)))},
            {"rotation_deg", to_a_millionth(units::to_deg(found.by_turn->turn))}};
  }
  return {{"by_shift", shift}, {"by_turn", turn}, {"looked_to_mm", units::to_mm(found.looked_to)}};
}

/// `may_turn`: whether the program cuts the same where the part is turned.
std::vector<std::string> nearest_in_words(const Json& nearest, bool may_turn) {
  std::vector<std::string> out;
  const Json &shift = nearest["by_shift"], &turn = nearest["by_turn"];
  if (shift.is_null()) {
    out.push_back(fmt::format("no shift of the part up to {:.0f} mm was found that makes it fit",
                              nearest["looked_to_mm"].get<double>()));
  } else {
    const auto mm = [&](const char* key, int k) {
      return unsigned_zero(fmt::format("{:.1f}", shift[key][static_cast<std::size_t>(k)].get<double>()));
    };
    out.push_back(
        fmt::format("it fits with the part shifted by {:.1f} mm: by {}, {}, {} mm to the origin {}, {}, {} mm",
                    shift["distance_mm"].get<double>(), mm("shift_mm", 0), mm("shift_mm", 1), mm("shift_mm", 2),
                    mm("origin_mm", 0), mm("origin_mm", 1), mm("origin_mm", 2)));
  }
  if (!may_turn) {
    out.emplace_back(
        "it cannot be turned: the program tilts the tool by A and B, which are axes of the machine and do not turn "
        "with "
        "the part");
  } else if (turn.is_null()) {
    out.emplace_back("no rotation of the part about z was found that makes it fit");
  } else {
    out.push_back(fmt::format("it fits with the part turned by {:.1f} deg about its origin, to rotation_deg = {:g}",
                              turn["turn_by_deg"].get<double>(), turn["rotation_deg"].get<double>()));
  }
  if (!shift.is_null() && !turn.is_null()) {
    out.emplace_back("the smallest that a search found; both were checked whole");
  } else if (!shift.is_null() || !turn.is_null()) {
    out.emplace_back("the smallest that a search found; it was checked whole");
  }
  return out;
}

/// A program as the job's controller carries it out, and whether it fits.
struct Judged {
  gcode::Understood understood;
  machining::CheckResult result;
};

Result<Judged> judge(gcode::Program source, const machining::Job& job, const machining::CheckOptions& options) {
  const gcode::UnrollOptions unroll = machining::unroll_options(job);
  POLYPOD_ASSIGN(understood, gcode::understand(std::move(source), unroll));
  POLYPOD_TRY(machining::known_offsets(job, understood.program, understood.interpretation));
  POLYPOD_ASSIGN(result,
                 machining::check(job.machine, job.X_MW, understood.program, understood.interpretation, options));
  return Judged{std::move(understood), std::move(result)};
}

/// Adds what is found with the switch of block delete in its other position, which stands at the controller, not in the
/// program.
Result<gcode::Understood> judge_other_switch(gcode::Program source, const machining::Job& job,
                                             const machining::CheckOptions& options, machining::CheckResult& result) {
  machining::Job other = job;
  other.block_delete = !job.block_delete;
  const char* position = other.block_delete ? "on" : "off";
  Result<Judged> in_other_position = judge(std::move(source), other, options);
  if (!in_other_position) {
    return tl::unexpected(machining::at_switch(std::move(in_other_position.error()), other.block_delete));
  }
  Judged& judged = *in_other_position;
  const auto add = [&](const std::vector<machining::CheckProblem>& found, std::vector<machining::CheckProblem>& known) {
    const std::vector<machining::CheckProblem> before = known;
    for (machining::CheckProblem one : found) {
      const auto same = [&](const auto& k) {
        return k.line == one.line && k.kind == one.kind && k.detail == one.detail;
      };
      if (std::any_of(before.begin(), before.end(), same)) continue;
      one.detail += fmt::format(" (with block delete {})", position);
      known.push_back(std::move(one));
    }
  };
  add(judged.result.problems, result.problems);
  add(judged.result.not_judged, result.not_judged);
  result.ok = result.ok && judged.result.ok;
  gcode::drop_block_delete_note(result.notes);
  result.notes.push_back(
      fmt::format("judged with block delete on and off; time, length and joint ranges are those with it {}",
                  job.block_delete ? "on" : "off"));
  return std::move(judged.understood);
}

/// Where the program does not fit in the posture that it was judged in: whether it does in another one.
Status look_at_postures(Judged& judged, const gcode::Understood* other, const machining::Job& job,
                        machining::CheckOptions options) {
  machining::CheckResult& result = judged.result;
  const gcode::Interpretation& run = judged.understood.interpretation;
  if (result.ok) return {};
  const std::vector<std::string> names = machining::starting_branches(job.machine, job.X_MW, run);
  if (names.size() < 2) return {};
  const std::string judged_in =
      job.posture.empty() ? fmt::format("{}, the first within the limits at the start", names[0]) : job.posture;
  options.stop_at_first = true;
  for (const std::string& name : names) {
    if (name == (job.posture.empty() ? names[0] : job.posture)) continue;
    options.branch = name;
    options.start.clear();
    bool fits = true;
    for (const gcode::Understood* one : {&std::as_const(judged.understood), other}) {
      if (one == nullptr || !fits) continue;
      POLYPOD_ASSIGN(found, machining::check(job.machine, job.X_MW, one->program, one->interpretation, options));
      fits = found.problems.empty();
    }
    if (!fits) continue;
    result.notes.push_back(
        fmt::format("judged in the posture {}; in the posture {} it fits: --branch \"{}\"", judged_in, name, name));
    return {};
  }
  result.notes.push_back(fmt::format("in none of the {} postures at the start does it fit", names.size()));
  return {};
}

/// Of a program that `correct` wrote or looked at: what of this job is other than that for which it did.
std::string correction_note(const gcode::Program& program, const gcode::Interpretation& run,
                            const machining::Job& job) {
  const auto header = gcode::correction_header(program);
  if (!header) return {};
  const auto comes_to = [&](const Vec3& p, double within) {
    return std::any_of(run.moves.begin(), run.moves.end(), [&](const gcode::Move& move) {
      return (move.start - p).norm() < within || (move.end - p).norm() < within;
    });
  };
  const machining::MadeFor made = machining::made_for(*header, job, comes_to);
  if (machining::speaks_of(*header, job) && !header->posture.empty() && !job.posture.empty() &&
      header->posture != job.posture) {
    return fmt::format("line {}: the program was {} for the posture {}; judged in {}, in which `post` refuses it",
                       header->line, header->was(), header->posture, job.posture);
  }
  if (!made.message.empty()) {
    return fmt::format("line {}: {}; its moves are judged as they are written, not the correction", header->line,
                       made.message);
  }
  if (!made.not_judged.empty()) return fmt::format("line {}: {}", header->line, made.not_judged);
  if (!made.unreached) return {};
  return fmt::format(
      "line {}: the program was {} for a machine that comes to its first cut{}; this one does not: its "
      "moves are judged as they are written, not the correction",
      header->line, header->was(), header->posture.empty() ? "" : fmt::format(" in the posture {}", header->posture));
}

/// A program that `correct` wrote for this machine and place is judged as `post` writes it: in the posture of the
/// correction, where the job names none, and with the joints of its first cut, where the pose leaves one free and
/// `start_joints` of the job lead to other deflections there. Whether a posture was taken.
bool take_hold_of_correction(const gcode::Program& source, machining::Job& job, machining::CheckOptions& options) {
  const auto header = gcode::correction_header(source);
  if (!header || !machining::speaks_of(*header, job)) return false;
  const machine::JointVector joints = machining::ComplianceMark::joints_from(header->joints, job.machine);
  const auto same_from_start = [&] {
    const auto mark = machining::ComplianceMark::from(header->compliance);
    if (!mark || job.start_joints.empty()) return false;
    const machine::JointVector start =
        Eigen::Map<const Eigen::VectorXd>(job.start_joints.data(), std::ssize(job.start_joints));
    const auto here = machining::deflections_at(job, *mark, start);
    return here && mark->same(*here);
  };
  if (joints.size() > 0 && !same_from_start()) {
    job.start_joints.assign(joints.begin(), joints.end());
    options.start = job.start_joints;
  }
  if (header->posture.empty() || !job.posture.empty()) return false;
  options.branch = job.posture = header->posture;
  return true;
}

}  // namespace

Command check_command() {
  struct Options {
    std::string program, job, machine, origin, bodies, report, branch;
    std::vector<std::string> sets;
    double rapid = 6000;
    bool nearest = false;
  };
  auto o = std::make_shared<Options>();
  return {
      "check",
      "Does a program fit a machine: reach, limits, branches, joint speeds and accelerations, collisions, time",
      "polypod check program.ngc --job job.toml",
      [o](Arguments& a) {
        a.positional("PROGRAM", o->program, "The G-code program");
        a.option("--job", o->job,
                 "The job file: machine, origin and rotation of the workpiece, work offsets, block delete");
        a.option("--machine", o->machine, "Without a job: a machine file or a name of `polypod machines`");
        a.option("--set", o->sets, "key=value: override a parameter of --machine (repeatable)");
        a.option("--origin", o->origin, "Without a job: x,y,z of the workpiece origin in M, mm");
        a.option("--bodies", o->bodies,
                 "A file of bodies (links, holder, fixtures, table): whether they touch on the way");
        a.option("--branch", o->branch, kBranchHelp);
        a.option("--rapid", o->rapid, "Speed that G0 is counted with, mm/min");
        a.option("--report", o->report, "An HTML page: the machine on its way, its joints beside their limits");
        a.flag("--nearest", o->nearest,
               "Where the program does not fit: the smallest shift, and the smallest rotation, of the part with which "
               "it does");
      },
      [o](const Context& context) -> Result<int> {
        POLYPOD_TRY(in_range("AP123", "--rapid", o->rapid, {0, kAnyNumber.max, true}, "mm/min"));
        std::vector<std::string> inputs{o->program, o->job, o->machine, o->bodies};
        if (!o->job.empty()) {
          for (const std::string& named : config::files_named_by(o->job)) inputs.push_back(named);
        }
        POLYPOD_TRY(check_files(inputs, {o->report}, context.json));
        POLYPOD_ASSIGN(job, placed_machine(context, o->job, o->machine, o->sets, o->origin));
        const machine::AnyMachine& m = job.machine;
        machining::CheckOptions options;
        options.rapid_speed = units::from_mm_per_min(o->rapid);
        options.limits = machining::motion_limits(job);
        options.branch = o->branch.empty() ? job.posture : o->branch;
        if (o->branch.empty() || o->branch == job.posture) options.start = job.start_joints;
        BusyLine reading(context, "reading the program");
        std::function<bool(double)> line;
        options.progress = [&](double share) {
          reading.end();
          if (!line) line = progress_line(context, "checking");
          return line(share);
        };
        BodyNotes body_notes;
        if (!o->bodies.empty()) {
          POLYPOD_TRY(
              refuse(context, {"--nearest"}, "it does not look for places free of collisions; leave out --bodies"));
          POLYPOD_ASSIGN(told, watch_bodies(o->bodies, job, !o->job.empty() && job.cuts, options));
          body_notes = std::move(told);
        }
        POLYPOD_ASSIGN(source, gcode::read(o->program));
        const std::vector<double> start_of_job = job.start_joints;
        const bool as_corrected = o->branch.empty() && take_hold_of_correction(source, job, options);
        const bool optional = machining::has_optional_blocks(source);
        POLYPOD_ASSIGN(judged, optional ? judge(source, job, options) : judge(std::move(source), job, options));
        const gcode::Program& program = judged.understood.program;
        gcode::Interpretation& interpretation = judged.understood.interpretation;
        machining::CheckResult& result = judged.result;
        std::optional<gcode::Understood> other;
        if (optional) {
          POLYPOD_ASSIGN(understood, judge_other_switch(std::move(source), job, options, result));
          other = std::move(understood);
        }
        options.progress(1);
        POLYPOD_TRY(begin_in(o->branch, interpretation, job));
        POLYPOD_TRY(look_at_postures(judged, other ? &*other : nullptr, job, options));
        const std::string posture = posture_at_start(job, interpretation);
        result.notes.insert(result.notes.end(), body_notes.begin(), body_notes.end());
        if (kinematics::leaves_a_joint_free(m)) {
          result.notes.push_back(
              "the pose leaves a joint free: one choice, the nearest to the joints before, was judged");
        }
        if (o->branch.empty() && !start_of_job.empty() && options.start != start_of_job) {
          result.notes.push_back(
              "the joints begin where the correction did, as `post` writes it, not at `start_joints` of the job");
        }
        if (const std::string note = correction_note(program, interpretation, job); !note.empty())
          result.notes.push_back(note);
        if (!o->job.empty() && job.cuts && !interpretation.moves.empty() && !machining::may_cut(job, interpretation)) {
          const Error why = machining::cuts_nothing(job, program, interpretation);
          result.notes.push_back(
              fmt::format("`predict` and `correct` refuse it: {} {}; {}", why.id, why.message, why.hint));
        }
        Json nearest;
        const bool may_turn = machining::may_turn_the_part(m, interpretation);
        if (o->nearest && !result.ok && !interpretation.moves.empty()) {
          machining::NearestOptions search;
          if (other) search.other = &*other;
          search.limits = options.limits;
          search.posture = job.posture;
          search.start = options.start;
          search.progress = progress_line(context, "looking for a place");
          POLYPOD_ASSIGN(found, machining::nearest_places(m, job.X_MW, program, interpretation, search));
          search.progress(1);
          nearest = nearest_json(job, found);
          nearest["may_turn"] = may_turn;
        }
        if (!o->report.empty()) {
          pages::CheckPageOptions page;
          page.version = POLYPOD_VERSION;
          page.command = command_line();
          page.rapid_speed = options.rapid_speed;
          page.with_bodies = !o->bodies.empty();
          if (!nearest.is_null()) page.places = nearest_in_words(nearest, may_turn);
          files::Outputs together;
          POLYPOD_TRY(together.add(o->report, pages::check_page(job, program, interpretation, result, page)));
          POLYPOD_TRY(together.commit());
        }
        const double dwells = gcode::dwell_time(program, job.block_delete);
        const Json problems = problems_json(result.problems), not_judged = problems_json(result.not_judged);
        Json ranges = Json::array();
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
          Json document{{"ok", result.ok},          {"problems", problems},  {"all_judged", result.not_judged.empty()},
                        {"not_judged", not_judged}, {"time_s", result.time}, {"length_mm", units::to_mm(result.length)},
                        {"joint_ranges", ranges},   {"notes", result.notes}};
          if (!posture.empty()) document["posture"] = posture;
          if (dwells > 0) document["dwell_s"] = dwells;
          if (result.fastest_line > 0) {
            document["joint_speed_percent"] = 100 * result.fastest.share;
            document["joint_speed_at"] = {{"joint", result.fastest.joint + 1}, {"line", result.fastest_line}};
          }
          if (result.hardest_line > 0) {
            document["joint_acceleration_percent"] = 100 * result.hardest.share;
            document["joint_acceleration_at"] = {{"joint", result.hardest.joint + 1}, {"line", result.hardest_line}};
          }
          if (!o->report.empty()) document["report"] = o->report;
          if (!o->bodies.empty()) document["bodies"] = {{"file", o->bodies}, {"notes", body_notes}};
          if (o->nearest) document["nearest"] = nearest;
          print_json(document);
        } else {
          print_answer(o->program, result, !o->bodies.empty());
          if (!nearest.is_null()) {
            for (const std::string& words : nearest_in_words(nearest, may_turn)) fmt::print("{}\n", words);
          }
          if (!posture.empty()) {
            fmt::print("posture {}{}\n", posture,
                       as_corrected          ? ", that of the correction"
                       : job.posture.empty() ? ", the first within the limits at the start"
                                             : "");
          }
          fmt::print("time {:.1f} s (G0 at {:g} mm/min, no acceleration{}), path length {:.1f} mm\n", result.time,
                     o->rapid, dwells > 0 ? fmt::format(", without {:g} s of dwells", dwells) : "",
                     units::to_mm(result.length));
          for (const Json& r : ranges) {
            const auto shown = [&](const char* key) {
              return unsigned_zero(fmt::format("{:.3f}", r[key].get<double>()));
            };
            fmt::print("  joint {:>2}  {:>9} .. {:<9} {} of {} .. {}\n", r["joint"].get<int>(), shown("min"),
                       shown("max"), r["unit"].get<std::string>(), shown("limit_min"), shown("limit_max"));
          }
          if (result.fastest_line > 0) {
            constexpr double kMost = 1e4;  // beside a singular pose, where the figure is that of the halving
            fmt::print(
                "joint speeds in cuts {} % of {} (joint {}, line {})\n",
                result.fastest.share > kMost ? "over 1000000" : fmt::format("up to {:.1f}", 100 * result.fastest.share),
                job.own_speeds ? "`joint_speeds`" : "the machine's limits", result.fastest.joint + 1,
                result.fastest_line);
          }
          if (result.hardest_line > 0) {
            fmt::print("joint accelerations in cuts up to {:.1f} % of `joint_accelerations` (joint {}, line {})\n",
                       100 * result.hardest.share, result.hardest.joint + 1, result.hardest_line);
          }
          for (const std::string& note : result.notes) fmt::print("note: {}\n", note);
          if (!o->report.empty()) fmt::print("report: {}\n", o->report);
        }
        return result.ok ? kDone : kAnswerIsNo;
      }};
}

}  // namespace polypod::app
