// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// What a corrected program says of the compliance for which it was corrected.
#pragma once

#include <optional>
#include <string>
#include <string_view>

#include "polypod/machining/job.hpp"
#include "polypod/machining/simulate.hpp"

namespace polypod::machining {

/// What 100 N along each axis of W do to the tool.
struct DeflectedBy100N {
  Vec3 along = Vec3::Zero();     ///< along that axis, m
  std::optional<Vec3> across{};  ///< 100 N along X towards Y, along X towards Z, along Y towards Z, m; not always known
};

/// How far 100 N along each axis of W deflect the tool where the first cut begins: figures that change with the
/// machine's lengths, tool, compliances and posture, and that can be measured.
struct ComplianceMark {
  Vec3 p = Vec3::Zero();           ///< the tool tip in W, m
  Vec3 axes = Vec3::Zero();        ///< A, B, C, rad
  Vec3 deflection = Vec3::Zero();  ///< along the axis of the force, m
  /// Where the pose leaves a joint free, those with which the machine came there, rad or m; empty: the pose says all.
  machine::JointVector joints = {};
  std::optional<Vec3> across = {};  ///< DeflectedBy100N::across; empty in headers that do not have it

  /// A line of a program's header: "at X10 Y0 Z-2 A0 B15 C0 100 N along X, Y, Z deflect the tool by 32.1, 50, 12 um",
  /// with ", across by 3.2, -1, 0.4 um" where that is known.
  [[nodiscard]] std::string in_words() const;
  /// The same backwards, from a text that holds it; empty for other texts.
  static std::optional<ComplianceMark> from(std::string_view text);
  /// "the joints there are 2118.2235, 12.5, -77 mm or deg", a line of its own; empty without joints.
  [[nodiscard]] std::string joints_in_words(const machine::AnyMachine& machine) const;
  /// The same backwards, for a machine with as many joints; empty for other texts.
  static machine::JointVector joints_from(std::string_view text, const machine::AnyMachine& machine);
  /// Whether another machine deflects so: to 1 % of the largest, apart from the digits that a header has.
  [[nodiscard]] bool same(const DeflectedBy100N& other) const;
  /// "32.10, 50.00, 12.00 um", with what is across where the figures along the axes are the same.
  [[nodiscard]] std::string in_words(const DeflectedBy100N& of, const DeflectedBy100N& beside) const;
};

/// R^T C R 100 N, C of the joints that joints_at gives (statics::compliance_at), R the orientation of W in M; at
/// the start of a move of the job as set up. Empty where there are no such joints or no compliances, and with a
/// measured compliance, which is not the machine's.
std::optional<ComplianceMark> compliance_mark(const Job& job, const gcode::Move& first);
/// The same at a sample that knows its joints (Sample::joint_count), with these.
std::optional<ComplianceMark> compliance_mark(const Job& job, const Sample& sample);

/// "32.10, 50.00, 12.00 um"
std::string um_in_words(const Vec3& d);

/// The pose of the tool there in M, as this job sets it up.
Pose pose_of(const Job& job, const ComplianceMark& mark);
/// The deflections of a mark at the same place on the machine of this job: its tool with A, B and C of the mark; with
/// the joints nearest to `near`, where the pose leaves one free and `near` is given, else those that joints_at gives.
std::optional<DeflectedBy100N> deflections_at(const Job& job, const ComplianceMark& mark,
                                              const machine::JointVector& near);

}  // namespace polypod::machining
