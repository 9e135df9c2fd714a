// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include <fmt/format.h>

#include <filesystem>
#include <memory>

#include "job_input.hpp"
#include "linuxcnc_commands.hpp"
#include "machine_file.hpp"
#include "online_options.hpp"
#include "polypod/control/force_loop.hpp"
#include "polypod/control/linuxcnc.hpp"
#include "polypod/core/files.hpp"
#include "polypod/core/text.hpp"
#include "polypod/core/units.hpp"
#include "polypod/kinematics/any_machine.hpp"
#include "polypod/machining/accept.hpp"
#include "stages_line.hpp"

namespace polypod::app {
namespace {

namespace fs = std::filesystem;

struct Options {
  std::string machine, out, home;
  std::vector<std::string> sets;
  double slide_speed = 200, turn_speed = 90;
  std::string online, program, method = "both";
  OnlineSettings loop;
};

/// The on-line correction of `machine` for the program and the job.
Result<control::ForceLoop> loop_of(const machine::AnyMachine& machine, const Options& o, const Context& context) {
  if (o.program.empty()) {
    return fail("AP223", "--online needs the program that is to be corrected", {}, "--program FILE");
  }
  std::optional<control::OnlineMethod> method;
  for (const auto one : {control::OnlineMethod::none, control::OnlineMethod::offline, control::OnlineMethod::online,
                         control::OnlineMethod::both})
    if (o.method == control::name_of(one)) method = one;
  if (!method) {
    return fail("AP223", fmt::format("--method is {}; must be none, off-line, on-line or both", one_line(o.method)));
  }
  POLYPOD_TRY(check_files({o.program, o.online}, {}, context.json));
  POLYPOD_ASSIGN(in, read_input(context, o.program, o.online));
  if (machine::to_toml(in.job.machine) != machine::to_toml(machine)) {
    return fail("LC132", "the machine of the job is another than the one that is exported", {o.online},
                "export the job's machine, without --set");
  }
  StagesLine line(context);
  control::OnlineOptions options = o.loop.options(context);
  options.progress = [&](const char* what, double share) { return line(what, share); };
  POLYPOD_ASSIGN(loop, control::force_loop(in.job, in.program, in.interpretation, options, *method));
  line.end();
  loop.options.progress = nullptr;
  if (in.other || machining::has_optional_blocks(in.program))
    loop.not_judged.push_back(fmt::format("the other position of block delete: the margin is with it {}",
                                          in.job.block_delete ? "on" : "off"));
  return loop;
}

/// What the loop is exported with, in words.
std::vector<std::string> notes_of(const control::ForceLoop& loop) {
  std::vector<std::string> out;
  const bool online = loop.method == control::OnlineMethod::online || loop.method == control::OnlineMethod::both;
  const bool corrected = loop.method == control::OnlineMethod::offline || loop.method == control::OnlineMethod::both;
  out.push_back(fmt::format(
      "On-line correction ({}): the gain margin is {}; run {}.", control::name_of(loop.method),
      std::isfinite(loop.margin.gain) ? fmt::format("{:.2g}", loop.margin.gain) : std::string("without a limit"),
      corrected ? "corrected.ngc" : "the program as it is"));
  if (!online)
    out.back() = fmt::format("No on-line correction (method {}); run {}.", control::name_of(loop.method),
                             corrected ? "corrected.ngc" : "the program as it is");
  if (online)
    out.emplace_back(
        "not in this margin: masses and modes of the machine, drives that lag, tooth passing, acceleration of the "
        "command");
  if (corrected) out.push_back("corrected.ngc alone, with the forces of the job: " + loop.answer);
  for (const std::string& n : loop.not_judged) out.push_back("not judged: " + n);
  return out;
}

/// The folder, made where it is not there; removed again where nothing came to stand in it.
class Folder {
 public:
  Folder() = default;
  Folder(Folder&& other) noexcept : made_(std::exchange(other.made_, {})) {}
  Folder(const Folder&) = delete;
  Folder& operator=(const Folder&) = delete;
  Folder& operator=(Folder&&) = delete;
  ~Folder() {
    std::error_code ignored;
    if (!made_.empty()) fs::remove(made_, ignored);  // does nothing where it is not empty
  }
  static Result<Folder> at(const std::string& name, const std::string& ini) {
    std::error_code error;
    Folder out;
    if (fs::is_directory(name, error)) {
      for (const auto& entry : fs::directory_iterator(name, error)) {
        if (entry.path().extension() != ".ini" || entry.path().filename() == ini) continue;
        return fail("AP220",
                    fmt::format("{} holds {} already; a folder is for one configuration", one_line(name),
                                one_line(entry.path().filename().string())),
                    {}, "give another folder, or remove that file");
      }
      return out;
    }
    if (!fs::create_directory(name, error)) {
      return fail("AP221",
                  fmt::format("cannot make the folder {}: {}", one_line(name),
                              error ? error.message() : "there is a file of this name"),
                  {}, "the folder above it must be there, and writable");
    }
    out.made_ = name;
    return out;
  }

 private:
  fs::path made_;
};

Json axis_json(const control::ControllerAxis& axis, const std::string& name) {
  const std::string unit = axis.turns ? "_deg" : "_mm";
  return {{"name", name},
          {"min" + unit, axis.min},
          {"max" + unit, axis.max},
          {"home" + unit, axis.home},
          {"speed_max" + unit + "_per_s", axis.speed},
          {"acceleration_max" + unit + "_per_s2", axis.acceleration}};
}

/// Lets what is there already, and other, appear under its name with a ~ behind; a sentence that says so, or nothing.
Result<std::string> kept_from(const std::string& file, const std::string& text, files::Outputs& outputs) {
  std::error_code none;
  if (!fs::is_regular_file(file, none)) return std::string();
  POLYPOD_ASSIGN(earlier, files::read(file));
  if (earlier == text) return std::string();
  POLYPOD_TRY(outputs.add(file + "~", std::move(earlier)));
  return fmt::format("{} was there already, and other: it is kept as {}~", one_line(file),
                     one_line(fs::path(file).filename().string()));
}

}  // namespace

Command export_linuxcnc_command() {
  auto o = std::make_shared<Options>();
  return {
      "export linuxcnc",
      "A LinuxCNC configuration for a machine, with a kinematics module of its own (for Klipper: controller)",
      "polypod export linuxcnc hexapod-strut -o hexapod",
      [o](Arguments& a) {
        declare_machine(a, o->machine, o->sets);
        a.option("-o,--output", o->out, "The folder of the configuration; made where it is not there", true);
        a.option("--home", o->home,
                 "q1,q2,... in mm or deg: the joints after homing (default: the machine's home; of arms a "
                 "pose with room around it)");
        a.option("--slide-speed", o->slide_speed, {1e-3, 1e5}, "mm/s, of drives along a line at most (default 200)");
        a.option("--turn-speed", o->turn_speed, {1e-3, 1e5}, "deg/s, of drives that turn at most (default 90)");
        a.option("--online", o->online,
                 "A job file: on-line correction by a force sensor for this job and --program, with a component that "
                 "plays the cut; the following options are for it");
        a.option("--program", o->program, "The G-code program that is to be corrected");
        a.option("--method", o->method,
                 "none, off-line, on-line or both: what corrects (default: both; off-line and both run corrected.ngc)");
        o->loop.declare(a);
      },
      [o](const Context& context) -> Result<int> {
        POLYPOD_ASSIGN(m, machine_of(o->machine, o->sets));
        if (const auto no = refused_as_singular(m, context, {"folder"})) return *no;
        control::LinuxcncOptions options;
        options.slide_speed = units::from_mm(o->slide_speed);
        options.turn_speed = units::from_deg(o->turn_speed);
        if (!o->home.empty()) {
          POLYPOD_ASSIGN(values, numbers_of(o->home, "--home"));
          const auto joints = static_cast<std::size_t>(kinematics::joint_count(m));
          if (values.size() != joints) {
            return fail("AP222", fmt::format("--home has {} values; the machine has {} joints", values.size(), joints));
          }
          machine::JointVector q(static_cast<Eigen::Index>(joints));
          for (int i = 0; i < static_cast<int>(joints); ++i) {
            const bool turns = kinematics::joint_kind(m, i) == machine::JointKind::revolute;
            const double value = values[static_cast<std::size_t>(i)];
            q[i] = turns ? units::from_deg(value) : units::from_mm(value);
            const machine::JointRange range = kinematics::joint_range(m, i);
            if (q[i] < range.min - 1e-9 || q[i] > range.max + 1e-9) {
              return fail("AP222", fmt::format("--home: joint {} at {:.6g} is outside of its range {:.6g} to {:.6g}",
                                               i + 1, value, turns ? units::to_deg(range.min) : units::to_mm(range.min),
                                               turns ? units::to_deg(range.max) : units::to_mm(range.max)));
            }
          }
          options.home = q;
        }
        std::optional<control::ForceLoop> loop;
        if (!o->online.empty()) {
          POLYPOD_ASSIGN(found, loop_of(m, *o, context));
          loop = std::move(found);
          options.force = &*loop;
        } else if (const char* alone = o->loop.given(context);
                   alone != nullptr || context.given("--program") || context.given("--method")) {
          return fail("AP223",
                      fmt::format("{} is for on-line correction", alone != nullptr             ? alone
                                                                  : context.given("--program") ? "--program"
                                                                                               : "--method"),
                      {}, "--online JOB gives the job");
        }
        POLYPOD_ASSIGN(made, control::linuxcnc_configuration(m, options));
        if (loop)
          for (std::string& note : notes_of(*loop)) made.notes.push_back(std::move(note));
        POLYPOD_ASSIGN(folder, Folder::at(o->out, made.files.front().name));
        for (auto& file : made.files)
          if (file.name == "machine.toml") file.text = machine_file(m, o->machine);
        std::vector<std::string> names;
        for (const auto& file : made.files) names.push_back((fs::path(o->out) / file.name).string());
        std::vector<std::string> read{o->machine};
        for (const std::string& file : {o->online, o->program})
          if (!file.empty()) read.push_back(file);
        POLYPOD_TRY(check_files(read, names, context.json));
        files::Outputs outputs;
        for (std::size_t i = 0; i < names.size(); ++i) {
          POLYPOD_ASSIGN(earlier, kept_from(names[i], made.files[i].text, outputs));
          if (!earlier.empty()) made.notes.push_back(std::move(earlier));
          POLYPOD_TRY(outputs.add(names[i], made.files[i].text));
        }
        POLYPOD_TRY(outputs.commit());
        if (context.json) {
          Json axes = Json::array(), joints = Json::array(), list = Json::array();
          for (const auto& axis : made.axes) axes.push_back(axis_json(axis, std::string(1, axis.letter)));
          for (std::size_t i = 0; i < made.joints.size(); ++i)
            joints.push_back(axis_json(made.joints[i], fmt::format("q{}", i + 1)));
          for (const std::string& name : names) list.push_back(name);
          Json out = {{"files", list},    {"module", made.module.name}, {"axes", axes},
                      {"joints", joints}, {"stands", made.stands},      {"notes", made.notes}};
          if (loop) {
            out["online"] = {{"method", control::name_of(loop->method)},
                             {"loop", loop_json(loop->loop, loop->margin)},
                             {"not_judged", loop->not_judged}};
          }
          print_json(out);
          return kDone;
        }
        fmt::print("module {}, {} joints\n\n", made.module.name, made.joints.size());
        fmt::print("axis        home         min         max    per s\n");
        const auto row = [](const std::string& name, const control::ControllerAxis& a) {
          fmt::print("{:<4} {:>11.4f} {:>11.4f} {:>11.4f} {:>8.1f} {}\n", name, a.home, a.min, a.max, a.speed,
                     a.turns ? "deg" : "mm");
        };
        for (const auto& axis : made.axes) row(std::string(1, axis.letter), axis);
        for (std::size_t i = 0; i < made.joints.size(); ++i) row(fmt::format("q{}", i + 1), made.joints[i]);
        fmt::print("\n");
        for (const std::string& note : made.notes) fmt::print("{}\n", note);
        fmt::print("\nwrote {}: {}\n", one_line(o->out), [&] {
          std::string all;
          for (const auto& file : made.files) all += (all.empty() ? "" : ", ") + file.name;
          return all;
        }());
        return kDone;
      }};
}

}  // namespace polypod::app
