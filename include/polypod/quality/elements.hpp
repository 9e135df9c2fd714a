// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// What of a machine may be off: lengths, points, angles, joint readings, by the keys of its parameters.
#pragma once

#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "polypod/core/error.hpp"
#include "polypod/geometry/pose.hpp"
#include "polypod/machine/any_machine.hpp"

namespace polypod::quality {

using machine::AnyMachine;

/// One element: a number, or a point with its three coordinates.
struct Element {
  std::string key;           ///< "base.joint[3]"
  std::string group;         ///< "base.joint"
  std::vector<int> columns;  ///< of [p; q]: the numbers of parameters, or the count of parameters plus that of a joint
  std::string unit;          ///< of a size: "mm", "deg" or "" (no unit)
  bool in_all = true;        ///< part of the key `all`
  /// A figure of `polypod info` that is none of the elements above: one coordinate of a point, or a setting. Without
  /// `columns`, what it changes follows from the machine with the figure changed (figure_shift).
  bool figure = false;
};

/// All elements of a machine, from the keys of its parameters: `leg.length[1]` is one, the three of
/// `base.joint[1].x`, `.y`, `.z` are one, `dh[2].alpha` is `dh.alpha[2]`. Besides
/// - `base.attachment[i]` and `platform.attachment[i]` of hexapods, which have the effect of the joints' own errors
///   (the vectors
/// c
///   and d of JEL (5.5));
/// - `joint[i]`: the reading of a joint: a strut, a slider, a drive's zero.
/// Joint readings, the tool's length and numbers without a unit (directions of rails) are not in `all`.
/// Order: single numbers, then points, group by group: the order of the search of JEL; then, outside of `all`, every
/// other figure of machine::settings and kinematics::parameters under its own key: `base.joint[3].x`, `base.radius`.
std::vector<Element> elements(const AnyMachine& machine);

/// How the parameters p change where a figure grows by `size` (SI). Zero for figures that are limits. Errors: those of
/// machine::with_value.
Result<Eigen::VectorXd> figure_shift(const AnyMachine& machine, const Element& figure, double size);
/// The same for a unit of the figure in first order, from central differences. Errors: QU104 where the figure can be
/// changed neither up nor down.
Result<Eigen::VectorXd> figure_rate(const AnyMachine& machine, const Element& figure);

/// An element and how much it is off, or may be, SI. A point is off by (size, size, size).
struct Sized {
  int element = 0;
  double size = 0;
};

/// The elements that `KEY=size` names, sizes in mm or deg: KEY is a key, a group (all its elements) or `all`, with its
/// unit (`base.joint[3].x_mm`, as `polypod info` lists it) or without. Named twice, the sizes add up. Errors: QU100 (no
/// such element, the message lists the groups), QU101 (a size that is not finite, or below 0 where `tolerance`).
Result<std::vector<Sized>> sized(const AnyMachine& machine, const std::vector<std::pair<std::string, double>>& sizes,
                                 bool tolerance);

/// The same sizes with one element a joint: without attachments whose own joint is among the sizes, too. An attachment
/// acts exactly like its joint, so tolerances of both add up; one that a drawing gives to the joint as a whole must
/// count once. Nothing where no joint counts twice.
std::optional<std::vector<Sized>> one_element_a_joint(const AnyMachine& machine, const std::vector<Sized>& sizes);

/// Elements with the same value, as one bar of a chart.
struct Bar {
  std::string name;  ///< "base.joint[2], base.attachment[2]"
  int elements = 0;
  double each = 0;
  [[nodiscard]] double total() const { return elements * each; }
};
/// Bars of elements and their values, the largest total first; what is below 1e-9 of the largest value is left out, and
/// values that differ by less are the same.
std::vector<Bar> bars_of(const AnyMachine& machine, const std::vector<std::pair<int, double>>& values);

}  // namespace polypod::quality
