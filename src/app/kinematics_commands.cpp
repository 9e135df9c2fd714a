// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// machines, info, ik, fk, jacobian
#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <functional>
#include <map>
#include <memory>

#include "commands.hpp"
#include "machine_file.hpp"
#include "messages.hpp"
#include "polypod/bodies/bodies.hpp"
#include "polypod/bodies/from_urdf.hpp"
#include "polypod/core/figures.hpp"
#include "polypod/core/files.hpp"
#include "polypod/core/text.hpp"
#include "polypod/core/units.hpp"
#include "polypod/kinematics/any_machine.hpp"
#include "polypod/kinematics/conventions.hpp"
#include "polypod/kinematics/families.hpp"
#include "polypod/kinematics/free_joints.hpp"
#include "polypod/kinematics/hold.hpp"
#include "polypod/kinematics/joint_speed.hpp"
#include "polypod/kinematics/other_turns.hpp"
#include "polypod/kinematics/parts.hpp"
#include "polypod/kinematics/twist.hpp"
#include "polypod/machine/urdf.hpp"
#include "polypod/motion/masses.hpp"
#include "polypod/quality/singularity.hpp"

namespace polypod::app {
namespace {

struct MachineOptions {
  std::string machine;
  std::vector<std::string> sets;
  std::string pose;
  std::string joints;
  std::string output, bodies;
  double length_mm = 0;
  bool all = false;
  bool free_twist = false;
};

/// Numbers in mm where `length` says so, in deg elsewhere, each at least `width` wide; the unit stands behind the last
/// number that has it: "1.0000, 2.0000 mm, 30.0000 deg".
std::string measured(const std::vector<double>& values, const std::function<bool(std::size_t)>& length, int width = 0) {
  constexpr int kDecimals = 4, kSignificant = 6;
  constexpr double kRounding = 1e-9;  // mm, a hundredth of an atom
  double largest = 0;
  for (std::size_t i = 0; i < values.size(); ++i)
    if (length(i)) largest = std::max(largest, std::abs(values[i]));
  if (largest < kRounding) largest = 0;
  const Figures mm(largest, kDecimals, kSignificant);
  std::string out;
  for (std::size_t i = 0; i < values.size(); ++i) {
    const std::string text =
        unsigned_zero(length(i) ? mm(largest > 0 ? values[i] : 0.0) : fmt::format("{:.{}f}", values[i], kDecimals));
    out += fmt::format("{}{:>{}}", out.empty() ? "" : ", ", text, width);
    if (i + 1 == values.size() || length(i + 1) != length(i)) out += length(i) ? " mm" : " deg";
  }
  return out;
}

/// The coordinates of a task in its order; without one, x, y, z, A, B, C.
std::string pose_in_words(const Json& pose, machine::Task task = machine::Task::pose, int width = 0) {
  return measured(
      pose.get<std::vector<double>>(),
      [&](std::size_t i) { return static_cast<int>(i) >= task.size() || !task.is_angle(static_cast<int>(i)); }, width);
}

std::string joints_in_words(const machine::AnyMachine& m, const machine::JointVector& q) {
  return measured(joints_for_user(m, q), [&](std::size_t i) {
    return kinematics::joint_kind(m, static_cast<int>(i)) != machine::JointKind::revolute;
  });
}

const char* unit_of(const machine::AnyMachine& m, int joint) {
  return kinematics::joint_kind(m, joint) == machine::JointKind::revolute ? "deg" : "mm";
}

Json joint_ranges_json(const machine::AnyMachine& m) {
  Json out = Json::array();
  for (int i = 0; i < kinematics::joint_count(m); ++i) {
    const auto range = kinematics::joint_range(m, i);
    const std::string unit = unit_of(m, i);
    out.push_back({{"joint", i + 1},
                   {"unit", unit},
                   {"min", units::to_user(range.min, unit)},
                   {"max", units::to_user(range.max, unit)}});
    if (const double speed = kinematics::speed_limit(m, i); std::isfinite(speed))
      out.back()["speed_per_s"] = units::to_user(speed, unit);
  }
  return out;
}

/// Whether the machine moves coordinates that its task does not prescribe, as the tilt of a Tricept.
bool moves_more_than_its_task(const machine::AnyMachine& m) {
  const machine::Task task = kinematics::task(m);
  return task.size() < 6 && !task.names_axis() && (task != machine::Task::point || kinematics::orientation_follows(m));
}

void print_whole_pose(const Json& pose) {
  fmt::print("the whole pose x, y, z, A, B, C: {}\n", pose_in_words(pose));
}

Json pose_json(const machine::AnyMachine& m, const Pose& X, double residual, const machine::JointVector& q) {
  Json out{{"pose", pose_for_user(m, X)},
           {"residual", residual},
           {"violations", kinematics::limit_names(m, kinematics::violations(m, X, q))}};
  if (moves_more_than_its_task(m)) out["whole_pose"] = whole_pose_for_user(X);
  return out;
}

std::string in_words(const std::vector<std::string>& violations) {
  return violations.empty() ? "within all limits" : fmt::format("{}", fmt::join(violations, ", "));
}

int print_modes(const Context& context, const machine::AnyMachine& m, const machine::JointVector& q,
                const machine::AssemblyModes& modes) {
  const std::string text = machine::description_of(modes);
  Json poses = Json::array();
  for (std::size_t i = 0; i < modes.poses.size(); ++i) {
    poses.push_back(pose_json(m, modes.poses[i], modes.residuals[i], q));
  }
  if (context.json) {
    print_json({{"poses", poses},
                {"complete", modes.complete()},
                {"found", modes.poses.size()},
                {"statement", text},
                {"method", machine::method_of(modes)},
                {"complex_proven", modes.zeros},
                {"complex_at_infinity", modes.zeros_at_infinity},
                {"paths_unproven", modes.singular_ends},
                {"passes", modes.passes},
                {"boxes", modes.boxes},
                {"newton_starts", modes.starts},
                {"self_motion", modes.moves()}});
  } else {
    fmt::print("{}\n", text);
    for (const Json& p : poses) {
      const auto broken = p["violations"].get<std::vector<std::string>>();
      fmt::print("{}  {}\n", pose_in_words(p["pose"], kinematics::task(m), 10),
                 broken.empty() ? "within all limits" : broken.front() + (broken.size() > 1 ? ", ..." : ""));
      if (p.contains("whole_pose")) print_whole_pose(p["whole_pose"]);
    }
  }
  return modes.poses.empty() ? kAnswerIsNo : kDone;
}

}  // namespace

Command machines_command() {
  return {
      "machines", "List the catalogue of machines", "polypod machines", [](Arguments&) {},
      [](const Context& context) -> Result<int> {
        Json list = Json::array();
        for (const machine::CatalogueEntry& entry : machine::catalogue()) {
          POLYPOD_ASSIGN(m, machine::load(std::string(entry.name)));
          list.push_back(
              {{"name", entry.name}, {"family", machine::family_of(m)}, {"description", machine::description_of(m)}});
        }
        if (context.json) {
          print_json({{"machines", list}});
        } else {
          for (const Json& m : list) {
            fmt::print("{:<18} {:<16} {}\n", m["name"].get<std::string>(), m["family"].get<std::string>(),
                       m["description"].get<std::string>());
          }
        }
        return kDone;
      }};
}

namespace {

/// Which limits home breaks; empty where it keeps them, or where the machine has no home.
std::string home_beyond_limits(const machine::AnyMachine& m) {
  const auto home = kinematics::home_pose(m);
  if (!home) return "";
  const kinematics::InverseResult result = kinematics::inverse(m, *home);
  return result.reachable() != nullptr ? "" : kinematics::reason_of(m, result);
}

/// The masses of the machine's file, a row a part; null where it has none. Errors: those of the table `dynamics`.
Result<Json> masses_json(const machine::AnyMachine& m, const std::string& file) {
  if (files::is_standard_input(file) || !motion::no_dynamics(m).empty()) return Json();
  POLYPOD_ASSIGN(read, motion::read_dynamics(file, m));
  if (!read) return Json();
  Json out = Json::array();
  for (const motion::PartMass& of : motion::part_masses(*read))
    out.push_back({{"part", of.part}, {"mass_kg", of.mass}});
  return out;
}

Json compliances_json(const machine::AnyMachine& m) {
  Json out = Json::array();
  for (const machine::Element& e : kinematics::elements(m))
    out.push_back(
        {{"element", e.name},
         {"compliance", e.turns ? 0.1 * units::to_tenth_urad(e.compliance) : units::to_um_per_N(e.compliance)},
         {"unit", e.turns ? "urad/Nm" : "um/N"}});
  return out;
}
void print_compliances(const Json& compliances) {
  if (std::all_of(compliances.begin(), compliances.end(), [](const Json& c) { return c["compliance"] == 0.0; })) {
    fmt::print("\nno compliances are given: it counts as rigid\n");
    return;
  }
  fmt::print("\ncompliances\n");
  for (const Json& c : compliances)
    fmt::print("  {:<26} {:>14.10g} {}\n", one_line(c["element"].get<std::string>()), c["compliance"].get<double>(),
               c["unit"].get<std::string>());
}

/// The bodies of the URDF file that a machine comes from, written and read again.
Result<bodies::BodiesFile> bodies_of(const std::string& name, const machine::AnyMachine& m, const std::string& output) {
  const std::string file = machine::file_of_machine(name);
  std::error_code ec;
  std::string text;
  if (std::filesystem::exists(file, ec)) {
    POLYPOD_ASSIGN(found, files::read(file));
    text = std::move(found);
  }
  if (text.empty() || !machine::is_urdf(text, name)) {
    return fail("AP201", fmt::format("--bodies: {} is no URDF file", one_line(file)), {},
                "write the bodies of other machines by hand: docs/bodies.md");
  }
  POLYPOD_ASSIGN(out, bodies::file_from_urdf(text, name, output));
  POLYPOD_TRY(files::write_whole(output, out.text));
  if (const auto again = bodies::read(output, m); !again)
    out.notes.push_back("`check --bodies` does not take the file as it is: " + again.error().message);
  return out;
}

}  // namespace

Command info_command() {
  auto o = std::make_shared<MachineOptions>();
  return {"info", "Show a machine: family, joints, parameters, where its numbers come from", "polypod info lola50",
          [o](Arguments& a) {
            declare_machine(a, o->machine, o->sets);
            a.option("-o,--output", o->output, "The machine, with what --set changes, as a machine file");
            a.option("--bodies", o->bodies,
                     "Of a URDF file: the bodies of its links as a file for `check --bodies` (those for collisions, "
                     "else the visual ones)");
          },
          [o](const Context& context) -> Result<int> {
            POLYPOD_ASSIGN(m, machine_of(o->machine, o->sets));
            POLYPOD_TRY(check_files({o->machine}, {o->output, o->bodies}, context.json));
            bodies::BodiesFile bodies;
            if (!o->bodies.empty()) {
              POLYPOD_ASSIGN(file, bodies_of(o->machine, m, o->bodies));
              bodies = std::move(file);
            }
            if (!o->output.empty()) {
              const std::string text = machine_file(m, o->machine);
              POLYPOD_TRY(machine::from_text(text, o->output));  // what could not be read again is not written
              POLYPOD_TRY(files::write_whole(o->output, text));
            }
            Json parameters = Json::object();
            for (const auto& list : {machine::settings(m), kinematics::parameters(m)}) {
              for (const machine::Parameter& p : list)
                parameters[machine::key_of(p)] = units::to_user(p.value, p.unit) + 0.0;  // no -0
            }
            Json document{{"name", machine::name_of(m)},
                          {"family", machine::family_of(m)},
                          {"description", machine::description_of(m)},
                          {"degrees_of_freedom", kinematics::degrees_of_freedom(m)},
                          {"joints", joint_ranges_json(m)},
                          {"parameters", parameters},
                          {"conventions", kinematics::conventions(m)},
                          {"compliances", compliances_json(m)},
                          {"provenance", machine::provenance_of(m)}};
            POLYPOD_ASSIGN(masses, masses_json(m, o->machine));
            document["masses"] = masses;
            const std::optional<machine::Mobility> count = kinematics::mobility(m);
            if (count) {
              document["mobility"] = {{"members", count->members},   {"joints", count->joints},
                                      {"freedoms", count->freedoms}, {"idle", count->idle},
                                      {"passive", count->passive},   {"degrees", count->degrees}};
            }
            const std::string home = home_beyond_limits(m);
            if (!home.empty()) document["home_beyond_limits"] = home;
            if (!o->bodies.empty()) document["bodies"] = {{"count", bodies.count}, {"notes", bodies.notes}};
            const SingularNote singular(m, context);
            if (context.json) {
              document["singular_everywhere"] = singular.everywhere();
              print_json(singular.in(document));
              return kDone;
            }
            const std::string description = one_line(machine::description_of(m));
            const int freedoms = kinematics::degrees_of_freedom(m), drives = kinematics::joint_count(m);
            fmt::print("{} ({}){}{}\n{} degrees of freedom{}\n", one_line(machine::name_of(m)), machine::family_of(m),
                       description.empty() ? "" : ": ", description, freedoms,
                       drives > freedoms ? fmt::format(" in the task, {} joints with drives", drives) : "");
            if (!home.empty()) fmt::print("note: home is not within the limits: {}\n", home);
            if (count) {
              fmt::print("Gruebler: 6 ({} - {} - 1) + {} - {} + {} = {}\n", count->members, count->joints,
                         count->freedoms, count->idle, count->passive, count->degrees);
            }
            fmt::print("\njoints\n");
            for (const Json& j : document["joints"]) {
              const double low = j["min"].get<double>(), high = j["max"].get<double>();
              const Figures shown(high - low, 3);
              const std::string unit = j["unit"].get<std::string>();
              const std::string speed = j.contains("speed_per_s")
                                            ? fmt::format(", up to {:.6g} {}/s", j["speed_per_s"].get<double>(), unit)
                                            : std::string();
              fmt::print("  {:>2}  {:>10} .. {:<10} {}{}\n", j["joint"].get<int>(), shown(low), shown(high), unit,
                         speed);
            }
            for (const Json& said : document["conventions"]) fmt::print("  {}\n", said.get<std::string>());
            fmt::print("\nparameters\n");
            std::size_t longest = 26;
            for (const auto& entry : parameters.items()) longest = std::max(longest, entry.key().size());
            for (const auto& [key, value] : parameters.items())
              fmt::print("  {:<{}} {:>14.10g}\n", key, longest, value.get<double>());
            print_compliances(document["compliances"]);
            if (!masses.empty()) fmt::print("\nmasses\n");
            for (const Json& mass : masses)
              fmt::print("  {:<28} {:>12.10g} kg\n", mass["part"].get<std::string>(), mass["mass_kg"].get<double>());
            const auto sources = machine::provenance_of(m);
            if (!sources.empty()) fmt::print("\nsources\n");
            for (const auto& [key, text] : sources) fmt::print("  {}: {}\n", one_line(key), one_line(text));
            if (!bodies.notes.empty()) fmt::print("\nbodies\n");
            for (const std::string& note : bodies.notes) fmt::print("  note: {}\n", note);
            if (!o->output.empty()) fmt::print("\nwrote {}\n", o->output);
            if (!o->bodies.empty()) fmt::print("\nwrote {} ({} bodies)\n", o->bodies, bodies.count);
            return kDone;
          }};
}

namespace {

/// Turns X about its tool axis to the nearest angle that works, if any; what there is to say about it.
Json turn_freely(const machine::AnyMachine& m, Pose& X) {
  const std::vector<kinematics::TwistRange> ranges = kinematics::twist_ranges(m, X);
  const std::optional<double> gamma = kinematics::nearest_twist(ranges);
  if (gamma) X = kinematics::twisted(X, *gamma);
  Json list = Json::array();
  for (const kinematics::TwistRange& range : ranges) {
    list.push_back({units::to_deg(range.from), units::to_deg(range.to)});
  }
  return {
      {"angle_deg", gamma ? Json(units::to_deg(*gamma)) : Json()}, {"ranges_deg", list}, {"pose", pose_for_user(m, X)}};
}

void print_twist(const Json& twist) {
  if (twist["angle_deg"].is_null()) {
    fmt::print("no rotation about the tool axis keeps all limits\n");
    return;
  }
  std::string ranges;
  for (const Json& range : twist["ranges_deg"]) {
    ranges +=
        fmt::format("{}{:.2f} .. {:.2f}", ranges.empty() ? "" : ", ", range[0].get<double>(), range[1].get<double>());
  }
  fmt::print("rotated by {:.3f} deg about the tool axis to {}; possible: {} deg\n", twist["angle_deg"].get<double>(),
             pose_in_words(twist["pose"]), ranges);
}

/// Whether the branch is not isolated, or the drives do not hold the tool there.
bool singular_at(const machine::AnyMachine& m, const Pose& X, const kinematics::Solution& s) {
  return s.singular || kinematics::hold(m, X, s.joints).control < kinematics::kNoHold;
}

/// Joints as people number them.
std::vector<int> numbered(std::vector<int> joints) {
  for (int& joint : joints) ++joint;
  return joints;
}

/// Which solutions are examples of a continuum, those together that leave the same joints free.
void print_open(const std::vector<std::vector<int>>& open) {
  std::map<std::vector<int>, std::vector<std::size_t>> with;
  for (std::size_t i = 0; i < open.size(); ++i)
    if (!open[i].empty()) with[open[i]].push_back(i + 1);
  for (const auto& [joints, solutions] : with) {
    constexpr std::size_t kShown = 8;
    const bool all = solutions.size() == open.size(), one = solutions.size() == 1;
    const std::string which = all && one ? "the solution is an example"
                              : all      ? "the solutions are examples"
                              : one      ? fmt::format("solution {} is an example", solutions.front())
                              : solutions.size() <= kShown
                                  ? fmt::format("solutions {} are examples", fmt::join(solutions, ", "))
                                  : fmt::format("{} of the solutions are examples", solutions.size());
    fmt::print("{}: {}\n", kinematics::in_words_free(joints), which);
  }
}

std::string in_words(const std::vector<kinematics::OtherTurns>& turns) {
  std::string out;
  for (const auto& [joint, angles] : turns) {
    out += fmt::format("{}joint {} at", out.empty() ? "  or " : ", ", joint + 1);
    for (std::size_t k = 0; k < angles.size(); ++k)
      out += fmt::format("{}{:.4f}", k == 0 ? " " : " or ", units::to_deg(angles[k]));
  }
  return out.empty() ? out : out + " deg\n";
}
Json json_of(const std::vector<kinematics::OtherTurns>& turns) {
  Json out = Json::array();
  for (const auto& [joint, angles] : turns) {
    Json degrees = Json::array();
    for (const double angle : angles) degrees.push_back(units::to_deg(angle));
    out.push_back({{"joint", joint + 1}, {"deg", degrees}});
  }
  return out;
}

constexpr const char* kSearched = "found by a search: there may be other solutions";

}  // namespace

Command ik_command() {
  auto o = std::make_shared<MachineOptions>();
  return {"ik", "Inverse kinematics: joints of a pose, all branches, violated limits",
          "polypod ik lola50 --pose 0,-1300,0,10,-5",
          [o](Arguments& a) {
            declare_machine(a, o->machine, o->sets);
            a.option("--pose", o->pose, "x,y,z[,A,B[,C]] in mm and deg", true);
            a.flag("--free-rotation", o->free_twist,
                   "Rotate about the tool axis (redundant freedom) to the nearest angle that keeps all limits");
          },
          [o](const Context& context) -> Result<int> {
            POLYPOD_ASSIGN(m, machine_of(o->machine, o->sets));
            POLYPOD_ASSIGN(X, pose_argument(m, o->pose));
            if (!kinematics::task(m).turns()) {
              POLYPOD_TRY(refuse(context, {"--free-rotation"}, "it serves machines that can turn their tool"));
            }
            Json twist;
            if (o->free_twist) twist = turn_freely(m, X);
            const kinematics::InverseResult result = kinematics::inverse(m, X);
            const bool reachable = result.reachable() != nullptr;
            Json solutions = Json::array();
            const kinematics::Solution* best = nullptr;
            std::vector<std::vector<int>> open;  // of each solution
            const auto turns_of = [&m](const kinematics::Solution& s) {
              return s.violations == 0 ? kinematics::other_turns(m, s.joints) : std::vector<kinematics::OtherTurns>{};
            };
            for (const kinematics::Solution& s : result.solutions) {
              if (best == nullptr || std::popcount(s.violations) < std::popcount(best->violations)) best = &s;
              Json entry{{"joints", joints_for_user(m, s.joints)},
                         {"branch", kinematics::branch_name(m, s.branch)},
                         {"pose", whole_pose_for_user(kinematics::settled(m, X, s.joints))},
                         {"violations", kinematics::limit_names(m, s.violations)}};
              if (singular_at(m, X, s)) entry["singular"] = true;
              open.push_back(kinematics::free_joints(m, X, s.joints));
              if (!open.back().empty()) entry["free_joints"] = numbered(open.back());
              if (const auto turns = turns_of(s); !turns.empty()) entry["other_turns"] = json_of(turns);
              solutions.push_back(entry);
            }
            const bool more = moves_more_than_its_task(m);
            const bool prescribed =
                !more || best == nullptr ||
                quality::task_prescribes(m, X, best->joints, quality::singularity(m, X, best->joints));
            std::vector<std::string> violations;
            if (best != nullptr) violations = kinematics::limit_names(m, best->violations);
            if (best == nullptr) violations.push_back(result.reason);
            if (context.json) {
              Json document{{"reachable", reachable},
                            {"converged", result.converged},
                            {"violations", violations},
                            {"solutions", solutions}};
              if (o->free_twist) document["tool_rotation"] = twist;
              if (kinematics::searches(m)) document["note"] = kSearched;
              if (more && best != nullptr) document["task_prescribes"] = prescribed;
              print_json(document);
              return reachable ? kDone : kAnswerIsNo;
            }
            if (o->free_twist) print_twist(twist);
            if (result.solutions.empty()) {
              fmt::print("no solution: {}\n", result.reason);
            } else {
              for (const kinematics::Solution& s : result.solutions) {
                fmt::print("{:<32} {}{}\n  {}\n", kinematics::branch_name(m, s.branch),
                           in_words(kinematics::limit_names(m, s.violations)),
                           singular_at(m, X, s) ? " (singular)" : "", joints_in_words(m, s.joints));
                fmt::print("{}", in_words(turns_of(s)));
              }
              if (more) {
                print_whole_pose(whole_pose_for_user(kinematics::settled(m, X, result.solutions.front().joints)));
              }
              print_open(open);
              if (kinematics::searches(m)) fmt::print("{}\n", kSearched);
              if (!prescribed) fmt::print("{}\n", quality::kNotPrescribed);
            }
            return reachable ? kDone : kAnswerIsNo;
          }};
}

Command fk_command() {
  auto o = std::make_shared<MachineOptions>();
  return {
      "fk", "Forward kinematics: the pose of given joints", "polypod fk lola50 --joints 0,-18.8,-2.4,0,21.2",
      [o](Arguments& a) {
        declare_machine(a, o->machine, o->sets);
        a.option("--joints", o->joints, "q1,q2,... in mm or deg", true);
        a.flag("--all", o->all, "Every assembly mode, and whether these are proven to be all");
      },
      [o](const Context& context) -> Result<int> {
        POLYPOD_ASSIGN(m, machine_of(o->machine, o->sets));
        POLYPOD_ASSIGN(values, numbers_of(o->joints, "--joints"));
        const int n = kinematics::joint_count(m);
        if (static_cast<int>(values.size()) != n) {
          return fail("AP103", fmt::format("--joints has {} numbers, but the machine has {} joints", values.size(), n));
        }
        machine::JointVector q(n);
        for (int i = 0; i < n; ++i) {
          const double v = values[static_cast<std::size_t>(i)];
          q[i] = kinematics::joint_kind(m, i) == machine::JointKind::revolute ? units::from_deg(v) : units::from_mm(v);
        }
        if (o->all) {
          if (const auto modes = kinematics::assembly_modes(m, q)) return print_modes(context, m, q, *modes);
        }
        const kinematics::ForwardResult result = o->all ? kinematics::forward_all(m, q) : kinematics::forward(m, q);
        const std::string why = result.poses.empty() ? kinematics::why_no_pose(m, q, result) : "";
        Json poses = Json::array();
        for (std::size_t i = 0; i < result.poses.size(); ++i) {
          poses.push_back(pose_json(m, result.poses[i], result.residuals[i], q));
          if (kinematics::hold(m, result.poses[i], q).control < kinematics::kNoHold) poses.back()["singular"] = true;
        }
        if (context.json) {
          Json document{{"poses", poses}, {"complete", result.complete}};
          if (poses.empty()) document["reason"] = why;
          print_json(document);
        } else {
          for (const Json& p : poses) {
            fmt::print("{}\n  {}\n", pose_in_words(p["pose"], kinematics::task(m)), in_words(p["violations"]));
            if (p.contains("whole_pose")) print_whole_pose(p["whole_pose"]);
            if (p.contains("singular")) {
              fmt::print(
                  "  singular (type 2): the tool can move with all joints locked, so this is one pose of many\n");
            }
          }
          if (poses.empty()) fmt::print("no pose: {}\n", why);
          if (o->all && !poses.empty()) {
            fmt::print("{}\n",
                       result.complete ? "these are all" : "found by a search; that there are no others is not proven");
          }
        }
        return poses.empty() ? kAnswerIsNo : kDone;
      }};
}

Command jacobian_command() {
  auto o = std::make_shared<MachineOptions>();
  return {
      "jacobian", "Jacobian of the tool tip at a pose, its determinant and conditioning",
      "polypod jacobian lola50 --pose 0,-1300,0",
      [o](Arguments& a) {
        declare_machine(a, o->machine, o->sets);
        a.option("--pose", o->pose, "x,y,z[,A,B[,C]] in mm and deg", true);
        a.option("--length", o->length_mm, kLength_mm,
                 "Characteristic length, mm (default: mean distance of platform joints or joint axes from the tip; of "
                 "machines in series 1000)");
      },
      [o](const Context& context) -> Result<int> {
        POLYPOD_ASSIGN(m, machine_of(o->machine, o->sets));
        POLYPOD_ASSIGN(X, pose_argument(m, o->pose));
        if (!kinematics::task(m).turns()) {
          POLYPOD_TRY(
              refuse(context, {"--length"}, "it weighs angles against lengths; this machine does not turn its tool"));
        }
        const kinematics::InverseResult inverse = kinematics::inverse(m, X);
        const kinematics::Solution* s = inverse.reachable();
        if (s == nullptr && !inverse.solutions.empty()) s = &inverse.solutions.front();
        if (s == nullptr) return cannot_take(context, inverse.reason);
        const std::vector<std::string> broken = kinematics::limit_names(m, s->violations);
        const SingularNote singular(m, context);
        // Where A of A dX + B dq = 0 has lost rank there is no matrix that gives dX from dq.
        const quality::Singularity near = quality::singularity(m, X, s->joints);
        const std::string words = near.kind == 0 ? "" : quality::in_words(X, near);
        if (near.control < quality::kRankLost) {
          if (context.json) {
            print_json(singular.in({{"jacobian", Json()},
                                    {"determinant", Json()},
                                    {"condition", Json()},
                                    {"sigma_min", 0.0},
                                    {"characteristic_length_mm", units::to_mm(near.length)},
                                    {"singular", words},
                                    {"joints", joints_for_user(m, s->joints)}}));
          }
          std::fflush(stdout);
          fmt::print(stderr, "polypod: there is no Jacobian at this pose: the tool {}\n", words);
          return kAnswerIsNo;
        }
        const kinematics::JacobianMatrix J = kinematics::jacobian(m, X, s->joints);
        const Eigen::MatrixXd square = kinematics::task_jacobian(kinematics::task(m), J, X);
        const kinematics::Dexterity d = kinematics::dexterity(m, X, s->joints, units::from_mm(o->length_mm));
        const machine::Task task = kinematics::task(m);
        const auto rows_named = [&](const std::vector<std::string>& all) {
          std::vector<std::string> held;
          held.reserve(static_cast<std::size_t>(task.size()));
          for (int i = 0; i < task.size(); ++i) held.push_back(all[static_cast<std::size_t>(task[i])]);
          return held;
        };
        if (context.json) {
          const auto rows = rows_named({"vx_m", "vy_m", "vz_m", "wx_rad", "wy_rad", "wz_rad"});
          Json document{
              {"jacobian", matrix_json(square)}, {"rows", rows},
              {"jacobian_full", matrix_json(J)}, {"joints", joints_for_user(m, s->joints)},
              {"determinant", d.determinant},    {"condition", d.condition},
              {"sigma_min", d.sigma_min},        {"characteristic_length_mm", units::to_mm(d.characteristic_length)}};
          document["violations"] = broken;
          if (!words.empty()) document["singular"] = words;
          print_json(singular.in(document));
          return kDone;
        }
        if (!broken.empty()) fmt::print("beyond the limits of the machine: {}\n", fmt::join(broken, ", "));
        if (!words.empty()) fmt::print("singular, or close to it: it {}\n", words);
        fmt::print("Jacobian (m and rad per rad or m; rows {} in M{})\n",
                   fmt::join(rows_named({"v_x", "v_y", "v_z", "w_x", "w_y", "w_z"}), " "),
                   task.names_axis() ? ", w_x and w_y in the tool's frame, across its axis" : "");
        for (int i = 0; i < square.rows(); ++i) {
          for (int j = 0; j < square.cols(); ++j) fmt::print(" {:>9.4f}", square(i, j));
          fmt::print("\n");
        }
        const bool serial = kinematics::is_serial(m);
        const std::string length =
            !kinematics::task(m).turns()
                ? ""
                : fmt::format(" (angles on {} mm)", figure(units::to_mm(d.characteristic_length), 1));
        constexpr double kBeyondDouble = 1e15, kFewDigits = 1e9;
        const std::string condition = d.condition < kFewDigits      ? fmt::format("{:.4f}", d.condition)
                                      : d.condition < kBeyondDouble ? fmt::format("{:.1g}", d.condition)
                                                                    : "infinite";
        const char* determinant_name = serial && J.cols() > square.rows() ? "sqrt(det(J J^T))"
                                       : serial                           ? "determinant"
                                                                          : "|det|";
        fmt::print("condition {}, smallest singular value {:.6f}{} of the {}{}\n{} {:.6g}{}{}\n", condition,
                   d.sigma_min, serial ? " m/rad" : "",
                   serial ? "tool's speed by the joints' speeds" : "joints' speeds by the tool's speed", length,
                   determinant_name, d.determinant, serial ? "" : " of the inverse of this matrix", length);
        return kDone;
      }};
}

}  // namespace polypod::app
