// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "watch_command.hpp"

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <chrono>
#include <cmath>
#include <cstring>
#include <filesystem>
#include <memory>
#include <thread>

#include "interrupt.hpp"
#include "job_input.hpp"
#include "json_rows.hpp"
#include "messages.hpp"
#include "polypod/control/watch.hpp"
#include "polypod/core/files.hpp"
#include "polypod/core/text.hpp"
#include "polypod/core/units.hpp"
#include "polypod/kinematics/any_machine.hpp"
#include "polypod/machine/assumed.hpp"
#include "polypod/machining/accept.hpp"
#include "polypod/machining/recorded.hpp"
#include "polypod/pages/watch.hpp"

namespace polypod::app {
namespace {

namespace fs = std::filesystem;
using control::Watch;
using control::WatchPart;
using machining::RecordedCut;
using units::to_deg;
using units::to_um;

struct Options {
  std::string record, machine, calibrated, job, program, ran, measured, report;
  double warn_um = 0, warn_deg = 0.1, shift_ms = 0, shift_range_s = 5;
  bool follow = false;
};

constexpr config::Range kWarn_um{1e-3, 1e6}, kWarn_deg{1e-6, 360};
constexpr config::Range kShift_ms{-1e7, 1e7};
constexpr config::Range kShiftRange_s{0.1, 100};
/// Rows of the table of lines in the text.
constexpr std::size_t kLines = 30;

struct Subject {
  machine::AnyMachine machine;
  std::optional<machine::AnyMachine> calibrated;
  std::string name;
  double acceleration = 0, velocity = 0;  ///< of the exported configuration; 0: not known
};

Result<Subject> subject_of(const Options& o) {
  Subject out;
  std::error_code none;
  out.name = o.machine;
  if (o.machine.empty()) {
    if (o.job.empty()) {
      return fail("AP270", "watch needs the machine that made the record", {},
                  "give --machine: a file, a name of `polypod machines`, or the folder of the configuration");
    }
    POLYPOD_ASSIGN(job, machining::read_job(o.job));
    out.machine = job.machine;
    out.name = job.machine_name;
  } else if (fs::is_directory(o.machine, none)) {
    POLYPOD_ASSIGN(exported, control::exported_machine(o.machine));
    out.machine = std::move(exported.machine);
    out.acceleration = exported.acceleration;
    out.velocity = exported.velocity;
  } else {
    POLYPOD_ASSIGN(machine, machine_of(o.machine, {}));
    out.machine = std::move(machine);
  }
  if (!o.calibrated.empty()) {
    POLYPOD_ASSIGN(machine, machine_of(o.calibrated, {}));
    if (kinematics::joint_count(machine) != kinematics::joint_count(out.machine)) {
      return fail("AP271",
                  fmt::format("--calibrated {} has {} joints, --machine has {}", one_line(o.calibrated),
                              kinematics::joint_count(machine), kinematics::joint_count(out.machine)),
                  {}, "give the same machine with the parameters that `polypod calibrate` found");
    }
    out.calibrated = std::move(machine);
  }
  return out;
}

std::string um(double metres, int digits = 1) {
  return unsigned_zero(fmt::format("{:.{}f}", to_um(metres), digits));
}

// --------------------------------------------------------------------------------------------------- a record whole

struct Judgement {
  std::vector<control::RecordRow> record;
  Watch watch;
  std::optional<RecordedCut> cut;
  std::optional<Input> input;
  std::size_t rows = 0;
  double seconds = 0;
  std::vector<std::string> not_judged, notes;
  std::vector<std::string> no;  ///< reasons
  bool judged = false;          ///< there was a limit
  std::string by;               ///< what the deviation is made of

  [[nodiscard]] bool ok() const { return judged && no.empty(); }
  [[nodiscard]] std::string answer() const {
    if (!judged) return "not judged: no limit was given (--warn-um, or --job with --program)";
    if (!no.empty()) {
      std::string out = "no: ";
      for (std::size_t i = 0; i < no.size(); ++i) out += (i > 0 ? "; " : "") + no[i];
      return out;
    }
    return yes;
  }
  std::string yes;
};

std::string share(double of_one) {
  return unsigned_zero(fmt::format("{:.1f}", 100 * of_one));
}

void judge(const Options& o, const machine::AnyMachine& machine, Judgement& j) {
  const Watch& w = j.watch;
  j.judged = o.warn_um > 0 || j.cut.has_value();
  if (w.no_pose > 0) {
    const std::string what =
        fmt::format("the joints of {} rows (the first after {:.3f} s) are no pose of the machine: {}", w.no_pose,
                    w.no_pose_time, w.no_pose_why);
    if (j.judged) j.no.push_back(what);
    j.not_judged.push_back(what);
  }
  if (w.not_measured > 0) {
    j.not_judged.push_back(fmt::format("{} of {} rows lie outside of the measurement", w.not_measured, j.rows));
  }
  std::vector<std::string> yes;
  if (o.warn_um > 0) {
    if (!w.warnings.empty()) {
      const auto& worst = *std::max_element(w.warnings.begin(), w.warnings.end(),
                                            [](const auto& a, const auto& b) { return a.largest < b.largest; });
      j.no.push_back(
          fmt::format("the deviation ({}) grows beyond {:g} um {} times, first at line {} after {:.3f} s; "
                      "largest {} um at line {}",
                      j.by, o.warn_um, w.warnings.size(), w.warnings.front().line, w.warnings.front().from,
                      um(worst.largest), worst.largest_line));
      if (w.warnings.size() == 1) {
        j.no.back() = fmt::format(
            "the deviation ({}) grows beyond {:g} um at line {} after {:.3f} s; largest {} um at "
            "line {}",
            j.by, o.warn_um, w.warnings.front().line, w.warnings.front().from, um(worst.largest), worst.largest_line);
      }
    } else if (w.judged == 0) {
      j.no.emplace_back("no row could be judged");
    }
    yes.push_back(fmt::format("the deviation ({}) stays within {:g} um", j.by, o.warn_um));
    if (kinematics::task(machine).turns() && !j.record.empty() && !j.record.front().oriented)
      j.not_judged.emplace_back("orientation of the tool: the record has no angles");
    if (machine::limits_are_assumed(machine))
      j.not_judged.push_back(fmt::format("ranges of the joints: {}", machine::kAssumedLimits));
    if (to_deg(w.turn_largest) > o.warn_deg) {
      j.no.push_back(
          fmt::format("the tool is turned from its command by up to {:.3g} deg, at line {} after {:.3f} s "
                      "(limit {:g} deg, --warn-deg)",
                      to_deg(w.turn_largest), w.turn_line, w.turn_time, o.warn_deg));
    }
  }
  if (j.cut) {
    const RecordedCut& c = *j.cut;
    const machining::Job& job = j.input->job;
    if (!c.to_the_end) {
      j.not_judged.push_back(
          fmt::format("the record ends at line {} of the program: what comes after is not judged", c.last_line));
    }
    for (const machining::NotJudged& n : c.cut.not_judged) {
      j.not_judged.push_back(fmt::format("line {}: {}", n.line, n.why));
    }
    if (c.cut.steep.distance > 0) {
      j.not_judged.push_back(fmt::format("line {}: {:.1f} mm where the force changes quickly; up to {} um there",
                                         c.cut.steep.line, units::to_mm(c.cut.steep.length),
                                         um(c.cut.steep.distance, 0)));
    }
    for (const machining::Plunge& p : c.cut.plunges) {
      j.not_judged.push_back(fmt::format("line {}: {}", p.line, p.why()));
    }
    const double tube = job.tolerance - machining::resolution(job);
    if (c.cut.largest_distance > tube) {
      const auto worst = std::max_element(c.cut.moves.begin(), c.cut.moves.end(), [](const auto& a, const auto& b) {
        return a.largest_distance < b.largest_distance;
      });
      j.no.push_back(
          fmt::format("on the recorded way the deflected tool leaves the tube of {:g} um: {} um from the "
                      "programmed path at line {}",
                      to_um(job.tolerance), um(c.cut.largest_distance), (*worst).line));
    } else if (!c.cut.not_judged.empty()) {
      j.no.emplace_back("not all of the cut is judged");
    }
    yes.push_back(
        fmt::format("on the recorded way the deflected tool stays within {} um of the programmed path (tube "
                    "{:g} um)",
                    um(c.cut.largest_distance), to_um(job.tolerance)));
  }
  j.yes = "yes" + std::string(j.not_judged.empty() ? "" : ", apart from what was not judged") + ": ";
  for (std::size_t i = 0; i < yes.size(); ++i) j.yes += (i > 0 ? "; " : "") + yes[i];
}

Result<Judgement> judgement_of(const Context& context, const Options& o, const Subject& subject) {
  Judgement j;
  std::vector<std::string> unused;
  POLYPOD_ASSIGN(rows, control::read_record(subject.machine, o.record, &unused));
  for (const std::string& name : unused) j.notes.push_back("column " + one_line(name) + " of the record is not used");
  j.rows = rows.size();
  j.seconds = rows.back().time - rows.front().time;
  control::WatchOptions options;
  options.calibrated = subject.calibrated ? &*subject.calibrated : nullptr;
  options.warn = units::from_um(o.warn_um);
  options.shift_range = o.shift_range_s;
  if (context.given("--shift-ms")) options.shift = units::from_ms(o.shift_ms);
  const auto progress = progress_line(context, "watching");
  options.progress = progress;
  if (!o.measured.empty()) {
    unused.clear();
    POLYPOD_ASSIGN(measured, control::read_measured_tips(o.measured, &unused));
    for (const std::string& name : unused)
      j.notes.push_back("column " + one_line(name) + " of the measurement is not used");
    options.measured = std::move(measured);
  }
  std::optional<Input> ran;
  if (!o.program.empty()) {
    POLYPOD_ASSIGN(input, read_input(context, o.program, o.job));
    j.input = std::move(input);
    if (!o.ran.empty()) {
      POLYPOD_ASSIGN(other, read_input(context, o.ran, o.job));
      ran = std::move(other);
    }
    if (machining::has_optional_blocks(j.input->program)) {
      j.notes.push_back(
          fmt::format("judged with block delete {}, as in the job", j.input->job.block_delete ? "on" : "off"));
    }
    options.bends = [&](const std::vector<control::WatchPoint>& points) -> Result<std::vector<control::ExpectedBend>> {
      const machining::Job& job = j.input->job;
      const Pose X_WM = job.X_MW.inverse();
      std::vector<machining::RecordedTip> tips;
      for (const control::WatchPoint& p : points) {
        if (!p.known) continue;
        tips.push_back({p.time, p.line, X_WM * Vec3(p.command + p.drives + p.geometry)});
      }
      machining::RecordedOptions judged;
      judged.planner = job.controller.planner;
      if (subject.acceleration > 0) judged.planner.acceleration = subject.acceleration;
      if (subject.velocity > 0) judged.planner.velocity = subject.velocity;
      judged.progress = progress_line(context, "cutting on the recorded way");
      const Input& as_run = ran ? *ran : *j.input;
      POLYPOD_ASSIGN(cut, machining::judge_recorded(job, j.input->program, j.input->interpretation, as_run.program,
                                                    as_run.interpretation, tips, judged));
      judged.progress(1);
      j.notes.insert(j.notes.end(), cut.notes.begin(), cut.notes.end());
      std::vector<control::ExpectedBend> out;
      for (const machining::RecordedPoint& p : cut.points) {
        if (!out.empty() && !(p.time > out.back().time)) continue;  // two moves meet
        out.push_back({p.time, job.X_MW.R * p.deflection});
      }
      j.cut = std::move(cut);
      return out;
    };
  }
  POLYPOD_ASSIGN(watch, control::watch(subject.machine, rows, options));
  progress(1);
  j.watch = std::move(watch);
  j.record = std::move(rows);
  j.by = !o.measured.empty()  ? "measured"
         : subject.calibrated ? "by the joints and the calibrated machine"
                              : "by the joints";
  if (o.measured.empty() && j.cut)
    j.by += subject.calibrated ? ", with the modelled deflection" : " and the modelled deflection";
  judge(o, subject.machine, j);
  return j;
}

Json gain_json(const machining::Gain& g) {
  return {{"length_mm", units::to_mm(g.length)}, {"mean_deflection_um", to_um(g.mean_deflection)},
          {"mean_left_um", to_um(g.mean_left)},  {"rms_deflection_um", to_um(g.rms_deflection)},
          {"rms_left_um", to_um(g.rms_left)},    {"removed_mean", g.removed_mean()},
          {"removed_rms", g.removed_rms()}};
}

Json cut_json(const Judgement& j) {
  if (!j.cut) return {};
  const RecordedCut& c = *j.cut;
  Json lines = Json::array(), corners = Json::array();
  for (const auto& [line, g] : c.gain_by_line) {
    Json one = {{"line", line}};
    one.update(gain_json(g));
    lines.push_back(one);
  }
  for (const machining::RecordedCorner& k : c.corners) {
    corners.push_back({{"line", k.line},
                       {"turn_deg", to_deg(k.turn)},
                       {"cutting", k.cutting},
                       {"predicted_um", to_um(k.predicted)},
                       {"bound", k.bound},
                       {"recorded_um", to_um(k.recorded)}});
  }
  return {{"tolerance_um", to_um(j.input->job.tolerance)},
          {"distance_um", to_um(c.cut.largest_distance)},
          {"normal_error_um",
           {{"min", to_um(c.cut.normal.min)}, {"mean", to_um(c.cut.normal.mean)}, {"max", to_um(c.cut.normal.max)}}},
          {"deflection_um", {{"mean", to_um(c.cut.deflection.mean)}, {"max", to_um(c.cut.deflection.max)}}},
          {"gain", gain_json(c.gain)},
          {"gain_by_line", lines},
          {"corners", corners},
          {"points", c.points.size()},
          {"pieces", c.pieces},
          {"to_the_end", c.to_the_end}};
}

Json answer_json(const Options& o, const Subject& subject, const Judgement& j) {
  const Watch& w = j.watch;
  Json lines = Json::array(), parts = Json::array(), warnings = Json::array(), follow = Json::array();
  for (const control::WatchLine& l : w.lines) {
    lines.push_back({{"line", l.line},
                     {"from_s", l.from},
                     {"seconds", l.seconds},
                     {"points", l.points},
                     {"not_judged", l.not_judged},
                     {"largest_um", to_um(l.largest)},
                     {"at_s", l.at},
                     {"rms_um", to_um(l.rms)},
                     {"across_um", to_um(l.across)},
                     {"along_um", to_um(l.along)}});
  }
  for (const WatchPart& p : w.parts) {
    parts.push_back({{"name", p.name},
                     {"given", p.given},
                     {"rms_um", to_um(p.rms)},
                     {"largest_um", to_um(p.largest)},
                     {"rms_left_um", p.rms_left ? Json(to_um(*p.rms_left)) : Json()}});
  }
  for (const control::WatchWarning& x : w.warnings) {
    warnings.push_back({{"from_s", x.from},
                        {"to_s", x.to},
                        {"line", x.line},
                        {"first_um", to_um(x.first)},
                        {"largest_um", to_um(x.largest)},
                        {"largest_line", x.largest_line}});
  }
  for (const double q : joints_for_user(subject.machine, w.follow)) follow.push_back(q);
  Json measurement;
  if (!o.measured.empty()) {
    measurement = {
        {"shift_ms", w.shift / units::from_ms(1)},
        {"shift_estimated", w.shift_estimated},
        {"shift_standard_uncertainty_ms", w.shift_estimated ? Json(w.shift_uncertainty / units::from_ms(1)) : Json()},
        {"rows_not_covered", w.not_measured},
        {"rms_um", to_um(w.measured_rms)},
        {"left_rms_um", to_um(w.left_rms)},
        {"left_largest_um", to_um(w.left_largest)},
        {"left_mean_um", {to_um(w.left_mean.x()), to_um(w.left_mean.y()), to_um(w.left_mean.z())}}};
  }
  return {
      {"rows", j.rows},
      {"seconds", j.seconds},
      {"deviation", j.by},
      {"deviation_um",
       {{"largest", to_um(w.largest)}, {"rms", to_um(w.rms)}, {"line", w.largest_line}, {"time_s", w.largest_time}}},
      {"turn_largest_deg", to_deg(w.turn_largest)},
      {"judged_rows", w.judged},
      {"lines", lines},
      {"parts", parts},
      {"measurement", measurement},
      {"joint_following", {{"time_s", w.follow_time}, {"joints", follow}}},
      {"warn_um", o.warn_um > 0 ? Json(o.warn_um) : Json()},
      {"warnings", warnings},
      {"cut", cut_json(j)},
      {"not_judged", j.not_judged},
      {"notes", j.notes},
      {"ok", j.judged ? Json(j.ok()) : Json()},
      {"answer", j.answer()}};
}

const char* needs(const std::string& part) {
  return part == "geometry" ? "--calibrated" : "--job with --program";
}

void print_parts(const Options& o, const Subject& subject, const Judgement& j) {
  const Watch& w = j.watch;
  const bool measured = !o.measured.empty();
  if (measured) {
    fmt::print("clocks      record = instrument {:+.3f} ms{}\n", w.shift / units::from_ms(1),
               w.shift_estimated ? fmt::format(" (estimated, standard uncertainty {:.2g} ms; a constant lag behind the "
                                               "joints cannot be separated from it)",
                                               w.shift_uncertainty / units::from_ms(1))
                                 : " (given)");
    fmt::print("\nexplained by        rms um   largest um   rms um left of the measured {}\n", um(w.measured_rms));
  } else {
    fmt::print("\nmade of             rms um   largest um\n");
  }
  for (const WatchPart& p : w.parts) {
    if (!p.given) {
      fmt::print("  {:<14}  not given ({})\n", p.name, needs(p.name));
      continue;
    }
    fmt::print("  {:<14}  {:>8}  {:>10}{}\n", p.name, um(p.rms), um(p.largest),
               measured ? fmt::format("  {:>10}", um(*p.rms_left)) : std::string());
  }
  if (measured) {
    fmt::print("  {:<14}  {:>8}  {:>10}   mean x {} y {} z {} um\n", "remains", um(w.left_rms), um(w.left_largest),
               um(w.left_mean.x()), um(w.left_mean.y()), um(w.left_mean.z()));
  }
  if (w.follow.size() > 0) {
    std::string joints;
    const std::vector<double> q = joints_for_user(subject.machine, w.follow);
    for (std::size_t i = 0; i < q.size(); ++i) joints += fmt::format("{}q{} {:+.3g}", i > 0 ? ", " : "", i + 1, q[i]);
    fmt::print("where the drives are farthest ({:.3f} s) the joints are off their command by {} (mm or deg)\n",
               w.follow_time, joints);
  }
  if (w.turn_largest > 0)
    fmt::print("the tool is turned from its command by up to {:.2g} deg\n", to_deg(w.turn_largest));
}

void print_cut(const Judgement& j) {
  if (!j.cut) return;
  const RecordedCut& c = *j.cut;
  fmt::print("\nthe recorded way as the deflected tool cuts it ({} points, {} pieces)\n", c.points.size(), c.pieces);
  fmt::print("  normal error {} .. {} um, mean {} um; largest distance from the programmed path {} um (tube {:g} um)\n",
             um(c.cut.normal.min), um(c.cut.normal.max), um(c.cut.normal.mean), um(c.cut.largest_distance),
             to_um(j.input->job.tolerance));
  fmt::print("  deflection along the normal, mean {} um, of which {} um are left: {} % removed\n",
             um(c.gain.mean_deflection), um(c.gain.mean_left), share(c.gain.removed_mean()));
  fmt::print("  deflection across the path, rms {} um, of which {} um are left: {} % removed\n",
             um(c.gain.rms_deflection), um(c.gain.rms_left), share(c.gain.removed_rms()));
  if (c.corners.empty()) return;
  fmt::print("\n  corner after line   turn deg   rounded um: predicted   recorded\n");
  std::size_t shown = 0;
  for (const machining::RecordedCorner& k : c.corners) {
    if (shown++ == kLines) {
      fmt::print("  ... {} more (--json has all)\n", c.corners.size() - kLines);
      break;
    }
    fmt::print("  {:>17}   {:>8.1f}   {:>21}   {:>8}{}\n", k.line, to_deg(k.turn),
               (k.bound ? "at most " : "") + um(k.predicted), um(k.recorded), k.cutting ? "" : "   (rapids)");
  }
}

void print_answer(const Options& o, const Subject& subject, const Judgement& j) {
  const Watch& w = j.watch;
  const auto lines =
      std::count_if(w.lines.begin(), w.lines.end(), [](const control::WatchLine& l) { return l.line > 0; });
  fmt::print("record      {} rows over {:.3f} s, {} lines of the program\n", j.rows, j.seconds, lines);
  fmt::print("deviation   {}: largest {} um at line {} after {:.3f} s, rms {} um\n", j.by, um(w.largest),
             w.largest_line, w.largest_time, um(w.rms));
  print_parts(o, subject, j);
  fmt::print("\n  line     from s  seconds   largest um    rms um   across um   along um\n");
  std::size_t shown = 0;
  for (const control::WatchLine& l : w.lines) {
    if (shown++ == kLines) {
      fmt::print("  ... {} more lines (--json has all)\n", w.lines.size() - kLines);
      break;
    }
    if (l.points == 0) {
      fmt::print("  {:>4} {:>10.3f} {:>8.3f}   not judged\n", l.line, l.from, l.seconds);
      continue;
    }
    fmt::print("  {:>4} {:>10.3f} {:>8.3f}   {:>10}  {:>8}  {:>10}  {:>9}\n", l.line, l.from, l.seconds, um(l.largest),
               um(l.rms), um(l.across), um(l.along));
  }
  print_cut(j);
  fmt::print("\n");
  for (const std::string& n : j.not_judged) fmt::print("not judged: {}\n", n);
  for (const std::string& n : j.notes) fmt::print("note: {}\n", n);
  fmt::print("{}\n", j.answer());
}

Result<int> whole(const Context& context, const Options& o) {
  POLYPOD_TRY(
      check_files({o.record, o.machine, o.calibrated, o.job, o.program, o.ran, o.measured}, {o.report}, context.json));
  POLYPOD_ASSIGN(subject, subject_of(o));
  POLYPOD_ASSIGN(j, judgement_of(context, o, subject));
  if (!o.report.empty()) {
    pages::WatchPageOptions page;
    page.record = o.record;
    page.machine = subject.name;
    page.warn = units::from_um(o.warn_um);
    page.judged = j.judged;
    page.ok = j.ok();
    page.answer = j.answer();
    page.not_judged = j.not_judged;
    page.version = POLYPOD_VERSION;
    page.command = command_line();
    page.moving = &subject.machine;
    page.rows = &j.record;
    POLYPOD_TRY(files::write_whole(
        o.report, pages::watch_page(j.watch, j.input ? &j.input->job : nullptr, j.cut ? &*j.cut : nullptr, page)));
  }
  if (context.json) {
    print_json(answer_json(o, subject, j));
  } else {
    print_answer(o, subject, j);
    if (!o.report.empty()) fmt::print("report: {}\n", one_line(o.report));
  }
  return j.judged && !j.ok() ? kAnswerIsNo : kDone;
}

// ------------------------------------------------------------------------------------------------ a record that grows

/// Lines of a file as they come. At the end of a regular file it waits for more; a pipe ends.
class Growing {
 public:
  static Result<std::unique_ptr<Growing>> open(const std::string& path) {
    auto out = std::make_unique<Growing>();
    out->path_ = path;
    out->file_ = path == "-" ? ::dup(0) : ::open(path.c_str(), O_RDONLY | O_CLOEXEC);
    struct stat is {};
    if (out->file_ < 0 || ::fstat(out->file_, &is) != 0 || S_ISDIR(is.st_mode)) {
      return fail("FI100", fmt::format("cannot read {}: {}", one_line(path),
                                       out->file_ < 0 ? std::strerror(errno) : "it is no file"));
    }
    out->regular_ = S_ISREG(is.st_mode);
    return out;
  }
  Growing() = default;
  Growing(const Growing&) = delete;
  Growing& operator=(const Growing&) = delete;
  ~Growing() {
    if (file_ >= 0) ::close(file_);
  }
  /// The next whole line; nothing at the end of a pipe, and when the user ends. Errors: LC126 the file became shorter.
  Result<std::optional<std::string>> next() {
    for (;;) {
      if (const auto end = kept_.find('\n', from_); end != std::string::npos) {
        std::string line = kept_.substr(from_, end - from_);
        from_ = end + 1;
        return std::optional(std::move(line));
      }
      kept_.erase(0, from_);
      from_ = 0;
      if (interrupted()) return std::optional<std::string>();
      if (kept_.size() > kLongest) return fail("LC126", "a row without an end", {path_}, "give a record");
      char bytes[1 << 16];
      const ssize_t n = ::read(file_, bytes, sizeof bytes);
      if (n > 0) {
        read_ += n;
        kept_.append(bytes, static_cast<std::size_t>(n));
        continue;
      }
      if (n < 0 && errno == EINTR) continue;
      if (n < 0) return fail("FI100", fmt::format("cannot read {}: {}", one_line(path_), std::strerror(errno)));
      if (!regular_) return std::optional<std::string>();
      struct stat is {};
      if (::fstat(file_, &is) != 0 || is.st_size < read_) {
        return fail("LC126", "the record became shorter while it was watched", {path_},
                    "watch the record of one run, and begin anew with the next");
      }
      std::this_thread::sleep_for(std::chrono::milliseconds(20));
    }
  }

 private:
  static constexpr std::size_t kLongest = 1 << 20;
  std::string path_, kept_;
  std::size_t from_ = 0;
  int file_ = -1;
  bool regular_ = false;
  off_t read_ = 0;
};

Result<int> followed(const Context& context, const Options& o) {
  POLYPOD_TRY(refuse(context,
                     {"--job", "--program", "--ran", "--measured", "--shift-ms", "--shift-range-s", "--report"},
                     "a record that is whole; --follow compares joints and command as the rows come"));
  if (!(o.warn_um > 0)) {
    return fail("AP272", "--follow warns of nothing without a limit", {}, "give --warn-um, in um");
  }
  POLYPOD_ASSIGN(subject, subject_of(o));
  POLYPOD_ASSIGN(file, Growing::open(o.record));
  std::optional<control::RecordReader> reader;
  control::LiveWatch live(subject.machine, subject.calibrated ? &*subject.calibrated : nullptr,
                          units::from_um(o.warn_um), units::from_deg(o.warn_deg));
  std::FILE* log = context.json ? stderr : stdout;
  Json warnings = Json::array();
  bool oriented = true;
  for (;;) {
    POLYPOD_ASSIGN(line, file->next());
    if (!line) break;
    if (!reader) {
      POLYPOD_ASSIGN(made, control::RecordReader::of(subject.machine, *line, o.record));
      reader = std::move(made);
      continue;
    }
    if (line->empty()) continue;
    POLYPOD_ASSIGN(row, reader->row(*line));
    oriented = oriented && row.oriented;
    const control::LiveWatch::Seen seen = live.see(row);
    if (seen.begins) {
      const std::string what = seen.point.known ? fmt::format("deviation {} um (limit {:g} um)",
                                                              um(seen.point.deviation().norm()), o.warn_um)
                                                : seen.why;
      const double turn = to_deg(seen.point.turn);
      const std::string turn_too =
          turn > o.warn_deg ? fmt::format(", turned by {:.3g} deg (limit {:g} deg)", turn, o.warn_deg) : "";
      fmt::print(log, "warning: line {} after {:.3f} s: {}{}\n", row.line, row.time, what, turn_too);
      std::fflush(log);
      warnings.push_back({{"line", row.line},
                          {"from_s", row.time},
                          {"first_um", seen.point.known ? Json(to_um(seen.point.deviation().norm())) : Json()}});
    }
    if (seen.ends) {
      fmt::print(log, "back within {:g} um at line {} after {:.3f} s; it was up to {} um\n", o.warn_um, row.line,
                 row.time, um(seen.largest));
      std::fflush(log);
    }
  }
  const bool ok = live.stretches() == 0 && live.rows() > 0;
  const std::string not_judged = !oriented && kinematics::task(subject.machine).turns()
                                     ? "; not judged: orientation of the tool, for which the record has no angles"
                                     : "";
  const std::string turned = to_deg(live.turn_largest()) > o.warn_deg
                                 ? fmt::format(", turned by {:.3g} deg", to_deg(live.turn_largest()))
                                 : "";
  const std::string answer =
      live.rows() == 0 ? std::string("no: no row came")
      : ok ? fmt::format("yes: in {} rows the deviation by the joints stays within {:g} um; largest {} um{}",
                         live.rows(), o.warn_um, um(live.largest()), not_judged)
           : fmt::format(
                 "no: in {} rows the deviation by the joints grows beyond {:g} um (or {:g} deg) {} times; largest {} "
                 "um{}{}",
                 live.rows(), o.warn_um, o.warn_deg, live.stretches(), um(live.largest()), turned,
                 live.no_pose() > 0 ? fmt::format(", {} rows are no pose", live.no_pose()) : "");
  if (context.json) {
    print_json({{"rows", live.rows()},
                {"rows_without_pose", live.no_pose()},
                {"largest_um", to_um(live.largest())},
                {"turned_deg", to_deg(live.turn_largest())},
                {"warn_um", o.warn_um},
                {"warn_deg", o.warn_deg},
                {"warnings", warnings},
                {"ok", ok},
                {"answer", answer}});
  } else {
    fmt::print("{}\n", answer);
  }
  std::fflush(stdout);
  return ok ? kDone : kAnswerIsNo;
}

}  // namespace

Command watch_command() {
  auto o = std::make_shared<Options>();
  return {"watch", "What a record says of the machine: the tip by its joints beside the command, and what explains it",
          "polypod watch record.csv --machine hexapod-strut --warn-um 20",
          [o](Arguments& a) {
            a.positional("RECORD", o->record, "The record, CSV: time_s,line,x_mm,y_mm,z_mm,a_deg,b_deg,c_deg,q1,...");
            a.option("--machine", o->machine,
                     "The machine of the controller: a file, a name, or the folder of `export linuxcnc` (default: the "
                     "job's)");
            a.option("--calibrated", o->calibrated, "The machine as it really is: what the geometry explains");
            a.option("--job", o->job, "The job file, with --program: what the compliance explains");
            a.option("--program", o->program, "The program that was meant: the deflected tip against its tube");
            a.option("--ran", o->ran, "The program that ran, if that is a correction of --program (default: the same)");
            a.option("--measured", o->measured, "What an instrument measured: time_s,x_mm,y_mm,z_mm of the tip, in M");
            a.option("--shift-ms", o->shift_ms, kShift_ms,
                     "Time of the record less time of the instrument, ms (default: estimated)");
            a.option("--shift-range-s", o->shift_range_s, kShiftRange_s,
                     "How far the shift is looked for, s to each side (default: 5)");
            a.option("--warn-um", o->warn_um, kWarn_um, "Warn, with exit status 1, where the deviation is more, um");
            a.option("--warn-deg", o->warn_deg, kWarn_deg,
                     "The same for the orientation of the tool, deg, where --warn-um is given (default 0.1)");
            a.option("--report", o->report, "A page with curves (HTML)");
            a.flag("--follow", o->follow, "Watch a record that grows: warn as rows come, until Ctrl-C");
          },
          [o](const Context& context) -> Result<int> {
            if (o->follow) return followed(context, *o);
            if (context.given("--program") != context.given("--job")) {
              return fail("AP273", "--job and --program go together", {},
                          "the job says how the program cuts; both are needed for the deflection");
            }
            if (!o->ran.empty() && o->program.empty())
              return fail("AP273", "--ran without --program", {}, "give the program that was meant as --program");
            if (o->measured.empty())
              POLYPOD_TRY(refuse(context, {"--shift-ms", "--shift-range-s"}, "it serves --measured"));
            if (context.given("--shift-ms"))
              POLYPOD_TRY(refuse(context, {"--shift-range-s"}, "it serves the estimation of the time shift"));
            return whole(context, *o);
          }};
}

}  // namespace polypod::app
