// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/pages/machine.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <map>
#include <optional>

#include "machine_inputs.hpp"
#include "machine_lines.hpp"
#include "moving_machine.hpp"
#include "polypod/core/units.hpp"
#include "polypod/kinematics/any_machine.hpp"
#include "polypod/kinematics/parts.hpp"
#include "polypod/report/html.hpp"
#include "polypod/workspace/surface.hpp"

namespace polypod::pages {
namespace {

using machine::AnyMachine;
using machine::JointVector;

void describe(const AnyMachine& machine, MachineAt& at) {
  at.violations = kinematics::limit_names(machine, kinematics::violations(machine, at.X, at.q));
  at.lines = lines_of(kinematics::outline_at(machine, at.X, at.q));
  const kinematics::Dexterity d = kinematics::dexterity(machine, at.X, at.q);
  at.condition = d.condition;
  at.sigma_min = d.sigma_min;
}

}  // namespace

MachineAt machine_at(const AnyMachine& machine, const Pose& X) {
  MachineAt out;
  out.X = X;
  const kinematics::InverseResult result = kinematics::inverse(machine, X);
  if (result.solutions.empty()) {
    out.reason = kinematics::reason_of(machine, result);
    return out;
  }
  const kinematics::Solution* within = result.reachable();
  out.q = within != nullptr ? within->joints : result.solutions.front().joints;
  out.X = kinematics::settled(machine, X, out.q);
  describe(machine, out);
  return out;
}

MachineAt machine_at(const AnyMachine& machine, const JointVector& q) {
  MachineAt out;
  out.q = q;
  const kinematics::ForwardResult result = kinematics::forward(machine, q);
  if (result.poses.empty()) {
    out.reason = result.reason;
    for (int i = 0; i < static_cast<int>(q.size()); ++i) {
      const machine::JointRange range = kinematics::joint_range(machine, i);
      if (q[i] >= range.min && q[i] <= range.max) continue;
      const bool turns = kinematics::joint_kind(machine, i) == machine::JointKind::revolute;
      const auto user = [&](double x) { return turns ? units::to_deg(x) : units::to_mm(x); };
      out.reason += fmt::format("; q{} is beyond its range of {:.6g} to {:.6g} {}", i + 1, user(range.min),
                                user(range.max), turns ? "deg" : "mm");
    }
    return out;
  }
  out.X = result.poses.front();
  describe(machine, out);
  return out;
}

Pose start_pose(const AnyMachine& machine) {
  const Pose upright =
      kinematics::home_pose(machine).value_or(Pose{Mat3::Identity(), kinematics::middle_of_work(machine)});
  if (kinematics::inverse(machine, upright).reachable() != nullptr) return upright;
  // Places that keep all limits near the middle of the joints' ranges: the best conditioned, above the base if it can.
  constexpr std::array<std::array<double, 6>, 3> kApart{
      {{0, 0.03, 0.06, 0, 0.03, 0.06}, {0, -0.12, 0.12, -0.12, -0.12, 0}, {0, 0.12, -0.12, 0.12, 0.12, 0}}};
  std::optional<Pose> best;
  double least = std::numeric_limits<double>::infinity();
  for (const double share : {0.5, 0.45, 0.55, 0.4, 0.6, 0.35, 0.65, 0.3, 0.7}) {
    for (const auto& apart : kApart) {
      JointVector q(kinematics::joint_count(machine));
      for (Eigen::Index i = 0; i < q.size(); ++i) {
        const machine::JointRange range = kinematics::joint_range(machine, static_cast<int>(i));
        if (!std::isfinite(range.max - range.min)) return upright;
        q[i] = range.min + (share + apart[static_cast<std::size_t>(i) % apart.size()]) * (range.max - range.min);
      }
      for (const Pose& X : kinematics::forward(machine, q).poses) {
        const kinematics::InverseResult found = kinematics::inverse(machine, X);
        const kinematics::Solution* at = found.reachable();
        if (at == nullptr) continue;
        constexpr double kBelow = 100;
        const double condition = kinematics::dexterity(machine, X, at->joints).condition * (X.p.z() < 0 ? kBelow : 1.0);
        if (!(condition < least)) continue;
        least = condition;
        best = X;
      }
    }
  }
  return best.value_or(upright);
}

report::Scene machine_scene(const AnyMachine& machine, const MachineAt& at) {
  report::Scene scene;
  scene.title = fmt::format("{} in space", machine::name_of(machine));
  scene.lines = at.lines;
  if (kinematics::hangs_down(machine)) hang(scene);
  return scene;
}

Result<report::Scene> workspace_scene(const AnyMachine& machine, const workspace::Options& options, const MachineAt& at,
                                      int resolution) {
  workspace::SurfaceOptions how;
  how.resolution = resolution;
  POLYPOD_ASSIGN(surface, workspace::surface(machine, options, how));
  report::Scene scene;
  scene.title = fmt::format("{} and its workspace in space", machine::name_of(machine));
  report::Mesh mesh;
  std::map<std::string, int> kinds;
  for (const Vec3& p : surface.points)
    mesh.points.push_back({units::to_mm(p.x()), units::to_mm(p.y()), units::to_mm(p.z())});
  mesh.triangles = surface.triangles;
  for (const int limit : surface.limit) {
    const std::string name = workspace::limit_kind(machine, limit);
    const auto [it, fresh] = kinds.try_emplace(name, static_cast<int>(scene.kinds.size()));
    if (fresh) scene.kinds.push_back(name);
    mesh.kind.push_back(it->second);
  }
  mesh.opacity = 0.6;
  scene.meshes.push_back(std::move(mesh));
  scene.lines = at.lines;
  if (kinematics::hangs_down(machine)) hang(scene);
  return scene;
}

std::string machine_page(const AnyMachine& machine, const MachinePageOptions& options) {
  std::vector<std::pair<std::string, std::string>> facts{{"machine", machine::name_of(machine)},
                                                         {"family", machine::family_of(machine)}};
  if (!options.version.empty()) facts.emplace_back("made with", "Polypod " + options.version);
  report::Report page(machine::name_of(machine), machine::description_of(machine), facts);
  const MachineAt at = machine_at(machine, start_pose(machine));
  page.add_section("The machine");
  page.add_text(
      "This answers for the limits of the machine that its file names, for a machine at rest that is built as the file "
      "says: not for collisions with workpiece and surroundings, and not for stiffness and accuracy.");
  if (at.lines.empty()) {
    page.add_verdict(report::Verdict::neutral, "The machine takes no pose at its start: " + at.reason + ".");
  }
  const report::Scene drawn = machine_scene(machine, at);
  page.add_scene(drawn, kinematics::hangs_down(machine) ? "The base is above: z of the machine points down."
                                                        : "The machine in M.");
  if (!options.live.empty()) page.make_live(options.live);
  page.add_section("Figures");
  page.add_definitions(figures_of(machine));
  page.add_code("The machine's file", machine::to_toml(machine));
  if (const auto sources = sources_of(machine); !sources.empty()) {
    page.add_heading("Where the numbers come from");
    page.add_definitions(sources);
  }
  return page.to_html();
}

}  // namespace polypod::pages
