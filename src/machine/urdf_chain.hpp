// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// The tree of links of a URDF file, and a chain of it.
#pragma once

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <map>
#include <memory>
#include <numbers>
#include <optional>
#include <set>
#include <string>
#include <string_view>
#include <vector>

#include "polypod/core/files.hpp"
#include "polypod/core/nearest_word.hpp"
#include "polypod/core/text.hpp"
#include "polypod/core/units.hpp"
#include "polypod/core/xml.hpp"
#include "polypod/machine/arm_of_axes.hpp"
#include "polypod/machine/urdf.hpp"
#include "urdf_joint.hpp"

namespace polypod::machine::urdf {

inline constexpr double kLongest = 1e6;                      // m, as in machine files
inline constexpr double kLargest = 1e6 * units::kRadPerDeg;  // rad, likewise
inline constexpr std::size_t kNamesShown = 12;

using xml::shown;

/// A name that a person is to write: whole, unless nobody would.
inline std::string whole(const std::string& name) {
  constexpr std::size_t kLongestName = 250;
  return name.size() <= kLongestName ? one_line(name) : shown(name);
}

/// "a, b, c", the first few of them.
inline std::string list_of(const std::vector<std::string>& names) {
  std::string out;
  for (std::size_t i = 0; i < std::min(names.size(), kNamesShown); ++i) out += (i > 0 ? ", " : "") + whole(names[i]);
  return names.size() > kNamesShown ? fmt::format("{}, ... ({} in all)", out, names.size()) : out;
}

/// A joint between two links, by its element.
struct Edge {
  const xml::Element* element = nullptr;
  std::string name, type;
  int parent = -1, child = -1;                       ///< links
  std::map<std::string, const xml::Element*> parts;  ///< origin, axis, limit, ...
};

struct Link {
  std::string name;
  const xml::Element* element = nullptr;
  int joint = -1;          ///< that moves it against its parent; -1 of a root
  std::vector<int> below;  ///< joints
};

/// Links and joints of a file, checked to be one tree.
class Tree {
 public:
  Tree(const std::vector<xml::Element>& elements, std::string file) : elements_(elements), file_(std::move(file)) {}

  Status read() {
    POLYPOD_TRY(check_format());
    POLYPOD_TRY(read_links());
    POLYPOD_TRY(read_joints());
    return check_tree();
  }

  [[nodiscard]] const std::string& name() const { return name_; }
  [[nodiscard]] const std::vector<Link>& links() const { return links_; }
  [[nodiscard]] const std::vector<Edge>& joints() const { return joints_; }
  [[nodiscard]] int root() const { return root_; }
  [[nodiscard]] Place place_of(const xml::Element& e) const { return {file_, e.line, e.column}; }
  [[nodiscard]] Place place() const { return place_of(elements_.front()); }
  /// How many elements of this name stand in links.
  [[nodiscard]] int count(std::string_view part) const {
    return static_cast<int>(std::count_if(elements_.begin(), elements_.end(), [&](const xml::Element& e) {
      return e.depth == 3 && e.name == part && elements_[static_cast<std::size_t>(e.parent)].name == "link";
    }));
  }
  [[nodiscard]] std::optional<int> link(const std::string& name) const {
    const auto found = by_name_.find(name);
    if (found == by_name_.end()) return std::nullopt;
    return found->second;
  }
  [[nodiscard]] std::vector<std::string> link_names() const {
    std::vector<std::string> out;
    for (const Link& l : links_) out.push_back(l.name);
    return out;
  }
  /// The joints from `base` down to `tip`; nothing if the tip is not below it.
  [[nodiscard]] std::optional<std::vector<int>> chain(int base, int tip) const {
    std::vector<int> out;
    while (tip != base) {
      const int joint = links_[static_cast<std::size_t>(tip)].joint;
      if (joint < 0) return std::nullopt;
      out.push_back(joint);
      tip = joints_[static_cast<std::size_t>(joint)].parent;
    }
    std::reverse(out.begin(), out.end());
    return out;
  }

 private:
  Status check_format() {
    const xml::Element& root = elements_.front();
    for (const xml::Element& e : elements_) {
      if (e.name.starts_with("xacro:")) return xacro(fmt::format("<{}>", shown(e.name)), place_of(e));
      for (const xml::Attribute& a : e.attributes) {
        if (a.value.find("${") == std::string_view::npos && a.value.find("$(") == std::string_view::npos) continue;
        return xacro(fmt::format("{}=\"{}\"", shown(a.name), shown(a.value)), {file_, a.line, a.column});
      }
    }
    if (root.name != "robot") {
      return fail("MA183", fmt::format("the outermost element is <{}>, but that of URDF is <robot>", shown(root.name)),
                  place(), "a machine file is TOML; SDF and other formats are not read");
    }
    const xml::Attribute* name = root.attribute("name");
    name_ = name != nullptr && !name->value.empty() ? shown(name->value) : "robot";
    return {};
  }
  [[nodiscard]] static Status xacro(const std::string& what, const Place& place) {
    return fail("MA182", fmt::format("{} is of xacro, which makes URDF and is none", what), place,
                "make the URDF file first: xacro arm.urdf.xacro > arm.urdf");
  }

  Result<std::string> text_of(const xml::Element& e, std::string_view key, const char* what) const {
    const xml::Attribute* a = e.attribute(key);
    if (a == nullptr || a->value.empty()) {
      return fail("MA183", fmt::format("{} has no {}=\"...\"", what, key), place_of(e));
    }
    if (a->value.find('&') != std::string_view::npos) {
      return fail("MA183", fmt::format("{}=\"{}\": names with & are not read", key, shown(a->value)),
                  {file_, a->line, a->column});
    }
    return std::string(a->value);
  }

  Status read_links() {
    for (const xml::Element& e : elements_) {
      if (e.depth != 2 || e.name != "link") continue;
      POLYPOD_ASSIGN(name, text_of(e, "name", "a link"));
      if (!by_name_.emplace(name, static_cast<int>(links_.size())).second) {
        return fail("MA183", fmt::format("a second link {}", shown(name)), place_of(e), "give each link its own name");
      }
      links_.push_back({name, &e, -1, {}});
    }
    if (links_.empty()) return fail("MA183", "the robot has no link", place());
    return {};
  }

  Result<int> end_of(const Edge& joint, const char* which) const {
    const auto part = joint.parts.find(which);
    if (part == joint.parts.end()) {
      return fail("MA183", fmt::format("joint {} has no <{}>", shown(joint.name), which), place_of(*joint.element));
    }
    POLYPOD_ASSIGN(name,
                   text_of(*part->second, "link", fmt::format("<{}> of joint {}", which, shown(joint.name)).c_str()));
    const std::optional<int> found = link(name);
    if (!found) {
      return fail("MA184", fmt::format("joint {}: there is no link {}", shown(joint.name), shown(name)),
                  place_of(*part->second),
                  did_you_mean(name, link_names()) + "each link that a joint names must stand in the file");
    }
    return *found;
  }

  Status read_joints() {
    std::set<std::string> names;
    for (std::size_t i = 0; i < elements_.size(); ++i) {
      const xml::Element& e = elements_[i];
      if (e.depth != 2 || e.name != "joint") continue;
      Edge joint;
      joint.element = &e;
      POLYPOD_ASSIGN(name, text_of(e, "name", "a joint"));
      joint.name = name;
      POLYPOD_ASSIGN(type, text_of(e, "type", fmt::format("joint {}", shown(name)).c_str()));
      joint.type = type;
      if (!names.insert(name).second) {
        return fail("MA183", fmt::format("a second joint {}", shown(name)), place_of(e),
                    "give each joint its own name");
      }
      for (std::size_t k = i + 1; k < elements_.size() && elements_[k].depth > 2; ++k) {
        const xml::Element& part = elements_[k];
        if (!joint.parts.emplace(std::string(part.name), &part).second && is_read(part.name)) {
          return fail("MA183", fmt::format("joint {} has a second <{}>", shown(name), shown(part.name)),
                      place_of(part));
        }
      }
      POLYPOD_ASSIGN(parent, end_of(joint, "parent"));
      POLYPOD_ASSIGN(child, end_of(joint, "child"));
      joint.parent = parent;
      joint.child = child;
      joints_.push_back(std::move(joint));
    }
    return {};
  }
  static bool is_read(std::string_view part) {
    return part == "origin" || part == "axis" || part == "limit" || part == "parent" || part == "child" ||
           part == "mimic";
  }

  Status check_tree() {
    for (std::size_t j = 0; j < joints_.size(); ++j) {
      const Edge& joint = joints_[j];
      Link& child = links_[static_cast<std::size_t>(joint.child)];
      if (child.joint >= 0) {
        return fail(
            "MA185",
            fmt::format("link {} is moved by two joints, {} and {}: a closed loop is no chain", shown(child.name),
                        shown(joints_[static_cast<std::size_t>(child.joint)].name), shown(joint.name)),
            place_of(*joint.element), "parallel machines are files of legs, family = \"parallel\"");
      }
      child.joint = static_cast<int>(j);
      links_[static_cast<std::size_t>(joint.parent)].below.push_back(static_cast<int>(j));
    }
    std::vector<std::string> roots;
    for (std::size_t l = 0; l < links_.size(); ++l) {
      if (links_[l].joint >= 0) continue;
      root_ = static_cast<int>(l);
      roots.push_back(links_[l].name);
    }
    if (roots.size() > 1) {
      return fail("MA185", fmt::format("{} links have no parent: {}", roots.size(), list_of(roots)),
                  place_of(*links_[static_cast<std::size_t>(root_)].element),
                  "join them by a joint, or leave out what is not of the arm");
    }
    // From the root every link must be reached; what is not hangs in a loop.
    std::vector<int> reached;
    if (!roots.empty()) reached.push_back(root_);
    std::vector<bool> seen(links_.size(), false);
    for (std::size_t k = 0; k < reached.size(); ++k) {
      const auto l = static_cast<std::size_t>(reached[k]);
      seen[l] = true;
      for (const int joint : links_[l].below) reached.push_back(joints_[static_cast<std::size_t>(joint)].child);
    }
    for (std::size_t l = 0; l < links_.size(); ++l) {
      if (seen[l]) continue;
      return fail("MA185",
                  fmt::format("link {} hangs in a loop of joints that leads back to itself", shown(links_[l].name)),
                  place_of(*joints_[static_cast<std::size_t>(links_[l].joint)].element),
                  "exchange parent and child of one of its joints");
    }
    return {};
  }

  const std::vector<xml::Element>& elements_;
  std::string file_, name_;
  std::vector<Link> links_;
  std::vector<Edge> joints_;
  std::map<std::string, int> by_name_;
  int root_ = -1;
};

inline bool moves(const Edge& joint) {
  return joint.type != "fixed";
}

/// Link `wanted`. Error: MA186.
inline Result<int> named_link(const Tree& tree, const std::string& wanted) {
  if (const std::optional<int> found = tree.link(wanted)) return *found;
  const std::vector<std::string> names = tree.link_names();
  return fail("MA186", fmt::format("there is no link {}", whole(wanted)), tree.place(),
              did_you_mean(wanted, names) + "the links are " + list_of(names));
}

/// The tip, chosen by the rule of arm_from_urdf.
inline Result<int> tip_of(const Tree& tree, int base, const UrdfName& name) {
  if (!name.tip.empty()) return named_link(tree, name.tip);
  std::vector<int> tools, ends;
  std::vector<std::string> choices;
  // Links below the base, those that a moving joint moves.
  std::vector<std::pair<int, bool>> found{{base, false}};
  bool any_moves = false;
  for (std::size_t k = 0; k < found.size(); ++k) {
    const auto [l, moved] = found[k];
    for (const int j : tree.links()[static_cast<std::size_t>(l)].below) {
      const Edge& joint = tree.joints()[static_cast<std::size_t>(j)];
      found.emplace_back(joint.child, moved || moves(joint));
      any_moves = any_moves || moves(joint);
    }
  }
  if (!any_moves) return fail("MA191", "no joint of the file moves", tree.place());
  for (const auto& [l, moved] : found) {
    const Link& link = tree.links()[static_cast<std::size_t>(l)];
    if (!moved) continue;
    if (link.name == "tool0") return l;
    if (link.name.ends_with("_tool0")) tools.push_back(l);
    if (!link.below.empty()) continue;
    ends.push_back(l);
    choices.push_back(link.name);
  }
  if (tools.size() == 1) return tools.front();
  if (ends.size() == 1) return ends.front();
  // Where the way from the base first parts into several that move something or end: the last link that all share.
  int fork = base;
  while (true) {
    std::vector<int> ways;
    for (const int j : tree.links()[static_cast<std::size_t>(fork)].below) {
      const int child = tree.joints()[static_cast<std::size_t>(j)].child;
      const bool leads =
          std::any_of(ends.begin(), ends.end(), [&](int end) { return tree.chain(child, end).has_value(); });
      if (leads) ways.push_back(child);
    }
    if (ways.size() != 1) break;
    fork = ways.front();
  }
  std::vector<std::string> all{tree.links()[static_cast<std::size_t>(fork)].name};
  if (fork == base) all.clear();
  all.insert(all.end(), choices.begin(), choices.end());
  return fail("MA186", fmt::format("the tree has several ends and no link tool0; the tip can be {}", list_of(all)),
              tree.place_of(*tree.links()[static_cast<std::size_t>(fork)].element),
              fmt::format("name the tip: {}#{}", files::is_standard_input(name.file) ? "arm.urdf" : name.file,
                          whole(all.front())));
}

/// An angle of the file: rad, as it stands, or the multiple of 15 deg that it is but for its last digit, of four at
/// least behind the point.
struct Angle {
  double value = 0;    ///< rad
  double written = 0;  ///< the number as it stands
  bool rounded = false;
  std::string_view text;
};
inline std::optional<Angle> angle_of(std::string_view text) {
  constexpr std::size_t kLeastDecimals = 4;
  if (text.starts_with('+')) text.remove_prefix(1);
  Angle out;
  const auto [rest, code] = std::from_chars(text.data(), text.data() + text.size(), out.value);
  if (code != std::errc{} || rest != text.data() + text.size() || !std::isfinite(out.value)) return std::nullopt;
  out.written = out.value;
  const std::size_t point = text.find('.');
  if (point == std::string_view::npos || text.find_first_of("eE") != std::string_view::npos) return out;
  const std::size_t decimals = text.size() - point - 1;
  constexpr double kStep = std::numbers::pi / 12;
  const double multiple = std::round(out.value / kStep) * kStep;
  if (decimals < kLeastDecimals || multiple == 0) return out;
  constexpr double kRounding = 1e-15;
  const double off = std::abs(out.value - multiple);
  if (off > std::pow(10.0, -static_cast<double>(decimals)) + kRounding) return out;
  constexpr double kSaid = 1e-12;  // rad: less is nothing to tell a person
  out.rounded = off > kSaid;
  out.value = multiple;
  return out;
}

/// Three numbers with blanks between them, as angles; nothing where they are not three. Missing ones are 0.
inline std::optional<std::array<Angle, 3>> three_angles(std::string_view rest) {
  std::array<Angle, 3> out;
  for (std::size_t next = 0;; ++next) {
    const std::size_t begin = rest.find_first_not_of(" \t\r\n");
    if (begin == std::string_view::npos) return out;
    rest.remove_prefix(begin);
    const std::string_view word = rest.substr(0, rest.find_first_of(" \t\r\n"));
    rest.remove_prefix(word.size());
    const std::optional<Angle> angle = angle_of(word);
    if (!angle || next == out.size()) return std::nullopt;
    out[next] = *angle;
    out[next].text = word;
  }
}

/// Reads the joints of a chain.
class ChainReader {
 public:
  ChainReader(const Tree& tree, int base, int tip) : tree_(tree), base_(base), tip_(tip) {}

  Result<SerialArm> read() {
    const auto joints = tree_.chain(base_, tip_);
    if (!joints) {
      return fail("MA186", fmt::format("link {} does not lie below link {}", name_of(tip_), name_of(base_)),
                  tree_.place(), "exchange the two, or leave the base out");
    }
    Pose X, X_last;
    int last = base_;
    stands_ = {{base_, X, 0}};
    for (const int j : *joints) {
      const Edge& joint = tree_.joints()[static_cast<std::size_t>(j)];
      POLYPOD_TRY(pass(joint, X));
      stands_.push_back({joint.child, X, static_cast<int>(axes_.size())});
      if (!moves(joint)) continue;
      last = joint.child;
      X_last = X;
    }
    POLYPOD_ASSIGN(flange, flange_behind(last, X_last));
    Pose X_MT = X;
    X_MT.R.col(1) = -X.R.col(1);
    X_MT.R.col(2) = -X.R.col(2);
    // The table counts from the link that carries the first moving joint, the base of the arm as its controller takes
    // it: where it stands is the machine's `base`.
    const Pose X_BM = X_MB_.inverse();
    for (JointAxis& axis : axes_) {
      axis.direction = X_BM.R * axis.direction;
      axis.point = X_BM * axis.point;
    }
    Result<SerialArm> arm = arm_of_axes(axes_, X_BM * X_MT, X_BM * flange.value_or(X));
    if (!arm) {
      arm.error().place = tree_.place();
      arm.error().message += fmt::format(" (from {} to {})", name_of(base_), name_of(tip_));
      return arm;
    }
    arm->X_MB = X_MB_ * arm->X_MB;
    return arm;
  }
  /// A link with its frame in M at joint 0 (those that follow others, too) and how many joints of the chain move it.
  struct Stand {
    int link = 0;
    Pose X;
    int joints = 0;
  };
  /// Behind read(): the links of the chain, and those that fixed joints join to them.
  Result<std::vector<Stand>> links() {
    std::vector<Stand> out = stands_;
    const auto known = [&](int link) {
      return std::any_of(out.begin(), out.end(), [&](const Stand& s) { return s.link == link; });
    };
    for (std::size_t k = 0; k < out.size(); ++k) {
      const Stand at = out[k];
      for (const int j : tree_.links()[static_cast<std::size_t>(at.link)].below) {
        const Edge& joint = tree_.joints()[static_cast<std::size_t>(j)];
        if (moves(joint) || known(joint.child)) continue;
        Pose X = at.X;
        POLYPOD_TRY(pass(joint, X));
        out.push_back({joint.child, X, at.joints});
      }
    }
    return out;
  }
  [[nodiscard]] const std::vector<std::string>& names() const { return names_; }
  /// Of the link that is the flange, if any.
  [[nodiscard]] const std::string& flange() const { return flange_; }
  [[nodiscard]] const std::vector<std::string>& rounded() const { return rounded_; }
  [[nodiscard]] bool has_speeds() const {
    return std::any_of(axes_.begin(), axes_.end(), [](const JointAxis& a) { return a.speed > 0; });
  }

 private:
  /// The frame of tool0, whether the way to the tip leads over it or not: it hangs at the last moving link, on the axis
  /// of its joint, and z is along that. In M at joint 0.
  Result<std::optional<Pose>> flange_behind(int last, const Pose& X_last) {
    if (axes_.empty()) return std::optional<Pose>{};
    std::vector<int> rigid{last}, named;
    for (std::size_t k = 0; k < rigid.size(); ++k) {
      const Link& link = tree_.links()[static_cast<std::size_t>(rigid[k])];
      if (link.name == "tool0") named = {rigid[k]};
      if (link.name == "tool0") break;
      if (link.name.ends_with("_tool0")) named.push_back(rigid[k]);
      for (const int j : link.below) {
        const Edge& joint = tree_.joints()[static_cast<std::size_t>(j)];
        if (joint.type == "fixed") rigid.push_back(joint.child);
      }
    }
    if (named.size() != 1) return std::optional<Pose>{};
    Pose X = X_last;
    const std::vector<int> way = tree_.chain(last, named.front()).value_or(std::vector<int>());
    for (const int j : way) POLYPOD_TRY(pass(tree_.joints()[static_cast<std::size_t>(j)], X));
    constexpr double kOnAxis = 1e-6;  // m, rad
    const JointAxis& axis = axes_.back();
    const Vec3 off = X.p - axis.point;
    if ((off - off.dot(axis.direction) * axis.direction).norm() > kOnAxis) return std::optional<Pose>{};
    if (X.R.col(2).cross(axis.direction).norm() > kOnAxis) return std::optional<Pose>{};
    flange_ = name_of(named.front());
    return std::optional<Pose>{X};
  }

  [[nodiscard]] std::string name_of(int link) const {
    return shown(tree_.links()[static_cast<std::size_t>(link)].name);
  }

  /// What no serial arm can have.
  Status refuse(const Edge& joint) const {
    const std::string name = shown(joint.name);
    static const std::vector<std::string> kTypes{"revolute", "continuous", "prismatic", "fixed"};
    if (joint.type == "floating" || joint.type == "planar") {
      return fail("MA187",
                  fmt::format("joint {} is {}: it has {} freedoms, a joint of an arm one", name, joint.type,
                              joint.type == "planar" ? "two" : "six"),
                  tree_.place_of(*joint.element), "choose a base below it (file.urdf#BASE:TIP), or make it fixed");
    }
    if (std::find(kTypes.begin(), kTypes.end(), joint.type) == kTypes.end()) {
      return fail("MA187", fmt::format("joint {}: there is no type \"{}\"", name, shown(joint.type)),
                  tree_.place_of(*joint.element),
                  did_you_mean(joint.type, kTypes) + "revolute, continuous, prismatic and fixed are read");
    }
    return {};
  }

  Result<UrdfJoint> values_of(const Edge& joint) const {
    std::vector<UrdfValue> values;
    const auto take = [&](const char* element, std::initializer_list<const char*> attributes) {
      const auto part = joint.parts.find(element);
      if (part == joint.parts.end()) return;
      for (const char* attribute : attributes) {
        if (const xml::Attribute* a = part->second->attribute(attribute)) {
          values.push_back({element, attribute, std::string(a->value)});
        }
      }
    };
    take("origin", {"xyz", "rpy"});
    if (moves(joint)) {
      take("axis", {"xyz"});
      take("limit", {"lower", "upper", "effort", "velocity"});
    }
    return joint_by_urdfdom(joint.type, values, tree_.place_of(*joint.element), shown(joint.name));
  }

  [[nodiscard]] tl::unexpected<Error> out_of_range(const Edge& joint, const std::string& what, const char* hint) const {
    return fail("MA190", fmt::format("joint {}: {}", shown(joint.name), what), tree_.place_of(*joint.element), hint);
  }

  Result<Mat3> rotation_of(const Edge& joint) {
    const auto part = joint.parts.find("origin");
    const xml::Attribute* rpy = part == joint.parts.end() ? nullptr : part->second->attribute("rpy");
    if (rpy == nullptr) return Mat3(Mat3::Identity());
    const auto angles = three_angles(rpy->value);
    if (!angles) {
      return fail("MA189",
                  fmt::format("joint {}: rpy=\"{}\" is not three numbers", shown(joint.name), shown(rpy->value)),
                  tree_.place_of(*part->second));
    }
    for (const Angle& angle : *angles) {
      if (!(std::abs(angle.value) <= kLargest)) {
        return out_of_range(joint, fmt::format("rpy=\"{}\" is beyond {:g} rad", shown(rpy->value), kLargest),
                            "angles are in rad");
      }
      if (!angle.rounded) continue;
      const std::string said =
          fmt::format("{} {} = {:g} deg", shown(joint.name), angle.text, units::to_deg(angle.value));
      if (std::find(rounded_.begin(), rounded_.end(), said) == rounded_.end()) rounded_.push_back(said);
    }
    return rotation_abc((*angles)[0].value, (*angles)[1].value, (*angles)[2].value);
  }

  /// One joint further along the chain, X the frame of its parent and then of its child, in M at joint 0.
  Status pass(const Edge& joint, Pose& X) {
    POLYPOD_TRY(refuse(joint));
    POLYPOD_ASSIGN(read, values_of(joint));
    POLYPOD_ASSIGN(R, rotation_of(joint));
    if (!(read.origin.cwiseAbs().maxCoeff() <= kLongest)) {
      return out_of_range(joint, fmt::format("an origin farther than {:g} m", kLongest), "lengths are in m");
    }
    if (moves(joint) && axes_.empty()) X_MB_ = X;
    X = X * Pose{R, read.origin};
    if (!moves(joint)) return {};
    const double length = read.axis.norm();
    constexpr double kShortest = 1e-6;  // of a vector that should have length 1
    if (!(length > kShortest && length <= kLongest)) {
      return out_of_range(
          joint, fmt::format("the axis {:g} {:g} {:g} has no direction", read.axis.x(), read.axis.y(), read.axis.z()),
          "give a unit vector, as in <axis xyz=\"0 0 1\"/>");
    }
    JointAxis axis;
    axis.direction = (X.R * (read.axis / length)).normalized();
    axis.point = X.p;
    axis.kind = joint.type == "prismatic" ? JointKind::prismatic : JointKind::revolute;
    if (joint.type == "continuous") {
      axis.range = {-2 * std::numbers::pi, 2 * std::numbers::pi};
    } else {
      constexpr double kMostTurned = 8 * std::numbers::pi;  // beyond, degrees were meant
      const double most = axis.kind == JointKind::prismatic ? kLongest : kMostTurned;
      if (!(std::abs(read.lower) <= most && std::abs(read.upper) <= most)) {
        return out_of_range(joint, fmt::format("limits {:g} .. {:g} beyond {:g}", read.lower, read.upper, most),
                            "limits are in rad or m; a joint without limits is of type continuous");
      }
      if (!(read.lower < read.upper)) {
        return out_of_range(joint,
                            fmt::format("the lower limit {:g} is not below the upper one {:g}", read.lower, read.upper),
                            "a limit that is left out is 0; joints without limits are of type continuous");
      }
      axis.range = {read.lower, read.upper};
    }
    if (read.velocity > 0 && std::isfinite(read.velocity)) axis.speed = read.velocity;
    POLYPOD_TRY(follow(joint, axis));
    axes_.push_back(axis);
    axis_names_.push_back(joint.name);
    if (axis.follows) {
      names_.push_back(fmt::format("{} follows {}", shown(joint.name), shown(axis_names_[*axis.follows])));
    } else {
      names_.push_back(fmt::format("{} {}", ++drives_, shown(joint.name)));
    }
    return {};
  }

  /// What `mimic` says: the joint has no drive of its own, and its limits and its speed are limits of the one that it
  /// follows.
  Status follow(const Edge& joint, JointAxis& axis) {
    const auto part = joint.parts.find("mimic");
    if (part == joint.parts.end()) return {};
    const xml::Element& mimic = *part->second;
    const Place place = tree_.place_of(mimic);
    const std::string name = shown(joint.name);
    const xml::Attribute* leader = mimic.attribute("joint");
    if (leader == nullptr || leader->value.empty())
      return fail("MA188", fmt::format("joint {}: <mimic> names no joint", name), place,
                  "as in <mimic joint=\"joint_2\" multiplier=\"-1\"/>");
    const auto found = std::find(axis_names_.begin(), axis_names_.end(), leader->value);
    if (found == axis_names_.end()) {
      return fail("MA188",
                  fmt::format("joint {} follows joint {} (mimic), which is not before it on the chain", name,
                              shown(leader->value)),
                  place, "end the chain before it, or make it fixed");
    }
    auto index = static_cast<std::size_t>(found - axis_names_.begin());
    double multiplier = 1, offset = 0;
    for (const auto& [key, value] : {std::pair{"multiplier", &multiplier}, std::pair{"offset", &offset}}) {
      const xml::Attribute* given = mimic.attribute(key);
      if (given == nullptr) continue;
      const std::optional<Angle> number = angle_of(given->value);
      if (!number || !(std::abs(number->written) <= kLargest))
        return fail("MA188", fmt::format("joint {}: {}=\"{}\" of <mimic> is no number", name, key, shown(given->value)),
                    place, fmt::format("a number up to {:g}", kLargest));
      *value = number->written;
    }
    if (axes_[index].follows) {  // which follows another one itself
      offset += multiplier * axes_[index].offset;
      multiplier *= axes_[index].multiplier;
      index = *axes_[index].follows;
    }
    JointAxis& leads = axes_[index];
    if (axis.kind != JointKind::revolute || leads.kind != JointKind::revolute) {
      return fail("MA188",
                  fmt::format("joint {} follows joint {} (mimic), and one of them slides: joints that turn are coupled",
                              name, shown(axis_names_[index])),
                  place, "end the chain before it, or make it fixed");
    }
    const bool limited = joint.type != "continuous";
    if (multiplier != 0 && limited) {
      const double low = (axis.range.min - offset) / multiplier, high = (axis.range.max - offset) / multiplier;
      leads.range.min = std::max(leads.range.min, std::min(low, high));
      leads.range.max = std::min(leads.range.max, std::max(low, high));
    } else if (limited && (offset < axis.range.min || offset > axis.range.max)) {
      leads.range.max = leads.range.min;
    }
    if (multiplier != 0) {
      const double fastest = axis.speed / std::abs(multiplier);
      if (fastest > 0) leads.speed = leads.speed > 0 ? std::min(leads.speed, fastest) : fastest;
    }
    if (!(leads.range.min < leads.range.max)) {
      return fail("MA188",
                  fmt::format("joint {} follows joint {} (mimic), and no angle of that keeps the limits of both", name,
                              shown(axis_names_[index])),
                  place, "correct multiplier, offset or limits; they are in rad");
    }
    axis.follows = index;
    axis.multiplier = multiplier;
    axis.offset = offset;
    return {};
  }

  const Tree& tree_;
  int base_, tip_;
  Pose X_MB_;  // the link that carries the first moving joint
  std::vector<Stand> stands_;
  std::vector<JointAxis> axes_;
  std::vector<std::string> names_, axis_names_, rounded_;
  int drives_ = 0;
  std::string flange_;
};

/// A file opened for one of its chains. The readers refer to what lies before them here.
struct Opened {
  std::vector<xml::Element> elements;
  std::optional<Tree> tree;
  int base = 0, tip = 0;

  [[nodiscard]] std::string link_name(int link) const {
    return shown(tree->links()[static_cast<std::size_t>(link)].name);
  }
};
/// The chain that a name asks for. Errors: MA180 to MA186, MA191.
inline Result<std::unique_ptr<Opened>> open(std::string_view text, const UrdfName& name) {
  auto out = std::make_unique<Opened>();
  POLYPOD_ASSIGN(elements, xml::scan(text, name.file));
  out->elements = std::move(elements);
  out->tree.emplace(out->elements, name.file);
  POLYPOD_TRY(out->tree->read());
  out->base = out->tree->root();
  if (!name.base.empty()) {
    POLYPOD_ASSIGN(chosen, named_link(*out->tree, name.base));
    out->base = chosen;
  }
  POLYPOD_ASSIGN(tip, tip_of(*out->tree, out->base, name));
  out->tip = tip;
  return out;
}

}  // namespace polypod::machine::urdf
