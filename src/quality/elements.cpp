// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/quality/elements.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <set>

#include "polypod/core/units.hpp"
#include "polypod/kinematics/any_machine.hpp"
#include "polypod/kinematics/forward_near.hpp"

namespace polypod::quality {
namespace {

/// `dh[2].alpha` -> group "dh.alpha", index "[2]", no coordinate; `base.joint[1].x` -> "base.joint", "[1]", 'x'.
struct Name {
  std::string group, index;
  char coordinate = 0;
};

Name parsed(const std::string& whole) {
  Name out;
  // What a machine of another carries in front, "stage[2].machine.", is no number of an element.
  std::size_t start = 0;
  if (whole.starts_with("stage[")) start = std::min(whole.find("].") + 2, whole.size());
  const std::string key = whole.substr(start);
  const std::size_t open = key.find('['), close = key.find(']');
  if (open == std::string::npos || close == std::string::npos) {
    out.group = key;
  } else {
    out.index = key.substr(open, close + 1 - open);
    out.group = key.substr(0, open) + key.substr(close + 1);
  }
  const std::size_t size = out.group.size();
  if (size > 2 && out.group[size - 2] == '.' && out.group[size - 1] >= 'x' && out.group[size - 1] <= 'z') {
    out.coordinate = out.group[size - 1];
    out.group.resize(size - 2);
  }
  out.group = whole.substr(0, start) + out.group;
  return out;
}

/// "base.joint[1,4], base.attachment[1,4]".
std::string joined_name(const std::vector<Element>& all, const std::vector<int>& members) {
  std::vector<std::string> groups;
  std::map<std::string, std::string> indices;
  for (const int e : members) {
    const Element& element = all[static_cast<std::size_t>(e)];
    const std::string index = parsed(element.key).index;
    std::string& list = indices[element.group];
    if (std::find(groups.begin(), groups.end(), element.group) == groups.end()) groups.push_back(element.group);
    if (!index.empty()) list += (list.empty() ? "" : ",") + index.substr(1, index.size() - 2);
  }
  std::string out;
  for (const std::string& group : groups) {
    const std::string& list = indices[group];
    out += (out.empty() ? "" : ", ") + group + (list.empty() ? "" : "[" + list + "]");
  }
  return out;
}

std::vector<machine::Parameter> all_figures(const AnyMachine& machine) {
  std::vector<machine::Parameter> out = kinematics::parameters(machine);
  for (const machine::Parameter& p : machine::settings(machine)) out.push_back(p);
  return out;
}

/// Coordinates and settings that are no element yet. Coordinates of directions have no columns of their own: a
/// direction stays a unit vector.
void add_figures(const AnyMachine& machine, const std::vector<machine::Parameter>& parameters,
                 std::vector<Element>& out) {
  std::set<std::string> known;
  for (const Element& e : out) known.insert({e.key, e.group});
  const std::vector<machine::Parameter> figures = all_figures(machine);
  for (std::size_t k = 0; k < figures.size(); ++k) {
    const machine::Parameter& p = figures[k];
    if (!known.insert(p.key).second) continue;
    Element e{p.key, p.key, {}, p.unit, false, true};
    if (k < parameters.size() && !p.unit.empty()) e.columns = {static_cast<int>(k)};
    out.push_back(std::move(e));
  }
}

}  // namespace

std::vector<Element> elements(const AnyMachine& machine) {
  std::vector<Element> out;
  const std::vector<machine::Parameter> parameters = kinematics::parameters(machine);
  for (std::size_t k = 0; k < parameters.size(); ++k) {
    const Name name = parsed(parameters[k].key);
    const std::string key = name.group + name.index;
    if (name.coordinate != 0 && name.coordinate != 'x') {
      const auto same = std::find_if(out.begin(), out.end(), [&](const Element& e) { return e.key == key; });
      if (same != out.end()) {
        same->columns.push_back(static_cast<int>(k));
        continue;
      }
    }
    out.push_back({key,
                   name.group,
                   {static_cast<int>(k)},
                   parameters[k].unit,
                   name.group != "tool" && name.group != "tool.length" && !parameters[k].unit.empty()});
  }
  for (int i = 0; i < kinematics::joint_count(machine); ++i) {
    const bool turns = kinematics::joint_kind(machine, i) == machine::JointKind::revolute;
    out.push_back({fmt::format("joint[{}]", i + 1),
                   "joint",
                   {static_cast<int>(parameters.size()) + i},
                   turns ? "deg" : "mm",
                   false});
  }
  const bool attached = std::visit(
      []<class M>(const M&) {
        return requires {
          M::kAttachments;
        };
      },
      machine);
  for (const char* platform : {"base", "platform"}) {
    if (!attached) break;
    const std::string joint = std::string(platform) + ".joint", attachment = std::string(platform) + ".attachment";
    std::vector<Element> attachments;
    for (const Element& e : out)
      if (e.group == joint)
        attachments.push_back({attachment + parsed(e.key).index, attachment, e.columns, e.unit, true});
    const auto behind = std::find_if(out.rbegin(), out.rend(), [&](const Element& e) { return e.group == joint; });
    out.insert(behind.base(), attachments.begin(), attachments.end());
  }
  // Single numbers before points, each group in one piece in the order of its first element.
  std::map<std::string, std::size_t> rank;
  for (const Element& e : out) rank.emplace(e.group, rank.size());
  std::stable_sort(out.begin(), out.end(), [&](const Element& a, const Element& b) {
    return std::pair(a.columns.size(), rank[a.group]) < std::pair(b.columns.size(), rank[b.group]);
  });
  add_figures(machine, parameters, out);
  return out;
}

Result<Eigen::VectorXd> figure_shift(const AnyMachine& machine, const Element& figure, double size) {
  const std::vector<machine::Parameter> before = kinematics::parameters(machine);
  const std::vector<machine::Parameter> figures = all_figures(machine);
  const auto at = std::find_if(figures.begin(), figures.end(), [&](const auto& p) { return p.key == figure.key; });
  const double value = at == figures.end() ? 0.0 : at->value;
  POLYPOD_ASSIGN(changed, machine::with_value(machine, machine::key_of({figure.key, 0, figure.unit}),
                                              units::to_user(value + size, figure.unit)));
  const std::vector<machine::Parameter> after = kinematics::parameters(changed);
  Eigen::VectorXd out(static_cast<Eigen::Index>(before.size()));
  for (std::size_t k = 0; k < before.size(); ++k) {
    out[static_cast<Eigen::Index>(k)] = after[k].value - before[k].value;
  }
  return out;
}

namespace {
/// Whether the machine with that figure changed has its tool elsewhere at the joints of home.
bool moves_tool(const AnyMachine& machine, const AnyMachine& changed) {
  constexpr double kSame = 1e-7;  // of the change, 1e-3
  const auto home = kinematics::home_pose(machine);
  if (!home) return false;
  const kinematics::InverseResult inverse = kinematics::inverse(machine, *home);
  const kinematics::Solution* best = inverse.reachable();
  if (best == nullptr) return false;
  const kinematics::ForwardResult there = kinematics::forward_near(changed, best->joints, *home);
  if (there.poses.empty()) return true;
  const Pose X = kinematics::settled(machine, *home, best->joints), &Y = there.poses.front();
  return (X.p - Y.p).norm() > kSame || (X.R - Y.R).norm() > kSame;
}
}  // namespace

Result<Eigen::VectorXd> figure_rate(const AnyMachine& machine, const Element& figure) {
  // Small against any figure, large against the twelve digits that a machine file keeps of it.
  constexpr double kStep = 1e-5;  // m, rad or no unit
  const auto up = figure_shift(machine, figure, kStep), down = figure_shift(machine, figure, -kStep);
  if (up && down && up->isZero() && down->isZero()) {
    // No parameter follows it. What it changes all the same, an orientation that constraints keep, has no columns here.
    constexpr double kSeen = 1e-3;
    const std::vector<machine::Parameter> figures = all_figures(machine);
    const auto at = std::find_if(figures.begin(), figures.end(), [&](const auto& p) { return p.key == figure.key; });
    const auto changed =
        machine::with_value(machine, machine::key_of({figure.key, 0, figure.unit}),
                            units::to_user((at == figures.end() ? 0 : at->value) + kSeen, figure.unit));
    if (changed && moves_tool(machine, *changed)) {
      return fail("QU104",
                  fmt::format("{} moves the tool, and is no error of an element: its constraints keep what it says",
                              figure.key),
                  {}, "compare `polypod fk` with --set and without it");
    }
  }
  if (up && down) return Eigen::VectorXd((*up - *down) / (2 * kStep));
  if (up) return Eigen::VectorXd(*up / kStep);
  if (down) return Eigen::VectorXd(*down / -kStep);
  return fail("QU104", fmt::format("{} cannot be changed: {}", figure.key, up.error().message));
}

namespace {
/// The element's key or its group's, with the unit or without.
bool names(const std::string& key, const Element& e) {
  const auto is = [&](const std::string& name) { return key == name || key == name + "_" + e.unit; };
  return is(e.key) || is(e.group);
}

/// The largest length among the machine's own figures and the ways of its slides, m.
double size_of(const AnyMachine& machine) {
  double out = 0;
  for (int i = 0; i < kinematics::joint_count(machine); ++i) {
    const machine::JointRange range = kinematics::joint_range(machine, i);
    if (kinematics::joint_kind(machine, i) == machine::JointKind::prismatic && std::isfinite(range.max - range.min))
      out = std::max(out, range.max - range.min);
  }
  for (const machine::Parameter& p : all_figures(machine))
    if (p.unit == "mm") out = std::max(out, std::abs(p.value));
  return out;
}

/// An error as large as the machine itself is none to first order, nor one that anybody makes.
Status within_machine(const AnyMachine& machine, const Element& e, double size) {
  constexpr double kHalfTurn = 180;  // deg
  const double most = e.unit == "mm" ? units::to_mm(size_of(machine)) : e.unit == "deg" ? kHalfTurn : 1;
  if (std::abs(size) <= most) return {};
  return fail("QU105",
              fmt::format("{} = {:g}: at most {:.6g}{}{}", e.key, size, most, e.unit.empty() ? "" : " ", e.unit), {},
              "a length may be off by the machine's largest length or way of a slide, an angle by half a turn, any "
              "other number by 1");
}
}  // namespace

Result<std::vector<Sized>> sized(const AnyMachine& machine, const std::vector<std::pair<std::string, double>>& sizes,
                                 bool tolerance) {
  const std::vector<Element> all = elements(machine);
  std::map<int, double> found;
  for (const auto& [key, size] : sizes) {
    if (!std::isfinite(size) || (tolerance && size < 0)) {
      return fail("QU101", fmt::format("{} = {:g} must be a number{}", key, size, tolerance ? " of at least 0" : ""));
    }
    bool known = false;
    for (std::size_t e = 0; e < all.size(); ++e) {
      if (!(key == "all" ? all[e].in_all : names(key, all[e]))) continue;
      known = true;
      POLYPOD_TRY(within_machine(machine, all[e], size));
      if (all[e].figure && all[e].columns.empty()) POLYPOD_TRY(figure_rate(machine, all[e]));
      found[static_cast<int>(e)] += units::from_user(size, all[e].unit);
    }
    if (known) continue;
    std::string groups;
    for (const Element& e : all)
      if (!e.figure && (groups + ",").find(" " + e.group + ",") == std::string::npos)
        groups += (groups.empty() ? " " : ", ") + e.group;
    return fail("QU100", fmt::format("{} has no element \"{}\"", machine::name_of(machine), key), {},
                fmt::format("elements:{}; [i] picks one; all; or a figure that `polypod info` lists", groups));
  }
  std::vector<Sized> out;
  for (const auto& [element, size] : found) out.push_back({element, size});
  return out;
}

std::optional<std::vector<Sized>> one_element_a_joint(const AnyMachine& machine, const std::vector<Sized>& sizes) {
  const std::vector<Element> all = elements(machine);
  const auto named = [&](const std::string& key) {
    return std::any_of(sizes.begin(), sizes.end(), [&](const Sized& s) {
      return s.size != 0 && all[static_cast<std::size_t>(s.element)].key == key;
    });
  };
  std::vector<Sized> out = sizes;
  const auto twice = std::erase_if(out, [&](const Sized& s) {
    const Element& e = all[static_cast<std::size_t>(s.element)];
    const std::string platform = e.group.substr(0, e.group.find('.'));
    return s.size != 0 && e.group == platform + ".attachment" && named(platform + ".joint" + parsed(e.key).index);
  });
  if (twice == 0) return {};
  return out;
}

std::vector<Bar> bars_of(const AnyMachine& machine, const std::vector<std::pair<int, double>>& values) {
  constexpr double kSame = 1e-9;
  const std::vector<Element> all = elements(machine);
  std::vector<std::pair<int, double>> ranked = values;
  std::stable_sort(ranked.begin(), ranked.end(), [](const auto& a, const auto& b) { return a.second > b.second; });
  std::vector<Bar> out;
  for (std::size_t i = 0; i < ranked.size();) {
    const double largest = ranked[0].second, each = ranked[i].second;
    if (!(each > kSame * largest)) break;
    std::vector<int> members;
    for (; i < ranked.size() && each - ranked[i].second <= kSame * largest; ++i) members.push_back(ranked[i].first);
    std::sort(members.begin(), members.end());
    out.push_back({joined_name(all, members), static_cast<int>(members.size()), each});
  }
  // Lines that differ by rounding alone stay in their order.
  const auto rounded = [&](const Bar& bar) { return std::round(bar.total() / (kSame * ranked[0].second)); };
  std::stable_sort(out.begin(), out.end(), [&](const Bar& a, const Bar& b) { return rounded(a) > rounded(b); });
  return out;
}

}  // namespace polypod::quality
