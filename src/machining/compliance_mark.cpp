// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/machining/compliance_mark.hpp"

#include <fmt/format.h>

#include <array>
#include <charconv>
#include <cmath>

#include "polypod/core/units.hpp"
#include "polypod/gcode/header.hpp"
#include "polypod/gcode/writer.hpp"
#include "polypod/kinematics/any_machine.hpp"
#include "polypod/machining/tilted.hpp"
#include "polypod/statics/compliance.hpp"

namespace polypod::machining {
namespace {

constexpr double kForce = 100;  // N
constexpr std::string_view kAcross = ", across by ";
constexpr int kPlaceDigits = 3, kAngleDigits = 4, kDeflectionDigits = 2;

/// The numbers of a text behind each of these, in their order; empty where one is missing.
template <std::size_t n>
std::optional<std::array<double, n>> numbers_behind(std::string_view text,
                                                    const std::array<std::string_view, n>& what) {
  std::array<double, n> out{};
  for (std::size_t i = 0; i < n; ++i) {
    const std::size_t at = text.find(what[i]);
    if (at == std::string_view::npos) return {};
    text.remove_prefix(at + what[i].size());
    const auto [end, code] = std::from_chars(text.data(), text.data() + text.size(), out[i]);
    if (code != std::errc{} || !std::isfinite(out[i])) return {};
    text.remove_prefix(static_cast<std::size_t>(end - text.data()));
  }
  return out;
}

}  // namespace

std::string ComplianceMark::in_words() const {
  const auto mm = [](double x) { return gcode::number(units::to_mm(x), kPlaceDigits); };
  const auto deg = [](double x) { return gcode::number(units::to_deg(x), kAngleDigits); };
  const auto um = [](double x) { return gcode::number(units::to_um(x), kDeflectionDigits); };
  const std::string aside =
      across ? fmt::format("{}{}, {}, {} um", kAcross, um(across->x()), um(across->y()), um(across->z())) : "";
  return fmt::format("at X{} Y{} Z{} A{} B{} C{}{}{}, {}, {} um{}", mm(p.x()), mm(p.y()), mm(p.z()), deg(axes.x()),
                     deg(axes.y()), deg(axes.z()), gcode::kDeflectText, um(deflection.x()), um(deflection.y()),
                     um(deflection.z()), aside);
}

std::optional<ComplianceMark> ComplianceMark::from(std::string_view text) {
  const auto found = numbers_behind<9>(text, {"at X", " Y", " Z", " A", " B", " C", gcode::kDeflectText, ", ", ", "});
  if (!found) return {};
  const std::array<double, 9>& v = *found;
  ComplianceMark out;
  for (int i = 0; i < 3; ++i) {
    const auto k = static_cast<std::size_t>(i);
    out.p[i] = units::from_mm(v[k]);
    out.axes[i] = units::from_deg(v[3 + k]);
    out.deflection[i] = units::from_um(v[6 + k]);
  }
  if (const std::size_t at = text.find(kAcross); at != std::string_view::npos) {
    if (const auto aside = numbers_behind<3>(text.substr(at), {kAcross, ", ", ", "}))
      out.across = Vec3(units::from_um((*aside)[0]), units::from_um((*aside)[1]), units::from_um((*aside)[2]));
  }
  return out;
}

bool ComplianceMark::same(const DeflectedBy100N& other) const {
  constexpr double kShare = 0.01, kWritten = 0.01e-6;  // m, of two digits
  const double most = kShare * deflection.maxCoeff() + kWritten;
  if ((other.along - deflection).cwiseAbs().maxCoeff() > most) return false;
  return !across || !other.across || (*other.across - *across).cwiseAbs().maxCoeff() <= most;
}

std::string ComplianceMark::in_words(const DeflectedBy100N& of, const DeflectedBy100N& beside) const {
  const bool aside = of.across && beside.across && same({beside.along, {}}) && same({of.along, {}});
  return um_in_words(of.along) + (aside ? " and across by " + um_in_words(*of.across) : "");
}

std::string um_in_words(const Vec3& d) {
  return fmt::format("{:.2f}, {:.2f}, {:.2f} um", units::to_um(d.x()), units::to_um(d.y()), units::to_um(d.z()));
}

std::string ComplianceMark::joints_in_words(const machine::AnyMachine& machine) const {
  if (joints.size() == 0) return {};
  std::vector<std::string> values;
  for (int i = 0; i < static_cast<int>(joints.size()); ++i) {
    const bool turns = kinematics::joint_kind(machine, i) == machine::JointKind::revolute;
    values.push_back(gcode::number(turns ? units::to_deg(joints[i]) : units::to_mm(joints[i]), kAngleDigits));
  }
  return fmt::format("{}{} mm or deg", gcode::kJointsText, fmt::join(values, ", "));
}

machine::JointVector ComplianceMark::joints_from(std::string_view text, const machine::AnyMachine& machine) {
  const std::size_t at = text.find(gcode::kJointsText);
  if (at == std::string_view::npos) return {};
  text.remove_prefix(at + gcode::kJointsText.size());
  const int n = kinematics::joint_count(machine);
  machine::JointVector out(n);
  for (int i = 0; i < n; ++i) {
    constexpr std::string_view kComma = ", ";
    if (i > 0) {
      if (!text.starts_with(kComma)) return {};
      text.remove_prefix(kComma.size());
    }
    double value = 0;
    const auto [end, code] = std::from_chars(text.data(), text.data() + text.size(), value);
    if (code != std::errc{} || !std::isfinite(value)) return {};
    text.remove_prefix(static_cast<std::size_t>(end - text.data()));
    const bool turns = kinematics::joint_kind(machine, i) == machine::JointKind::revolute;
    out[i] = turns ? units::from_deg(value) : units::from_mm(value);
  }
  return text.starts_with(" mm") ? out : machine::JointVector();
}

Pose pose_of(const Job& job, const ComplianceMark& mark) {
  return {tool_orientation(job, mark.axes), job.X_MW * mark.p};
}

std::optional<DeflectedBy100N> deflections_at(const Job& job, const ComplianceMark& mark,
                                              const machine::JointVector& near) {
  if (!statics::has_compliance(job.machine)) return {};
  const Pose X_MT = pose_of(job, mark);
  std::optional<machine::JointVector> q;
  if (near.size() > 0) {
    const kinematics::InverseResult inverse = kinematics::inverse_near(job.machine, X_MT, near);
    if (const kinematics::Solution* s = inverse.reachable()) q = s->joints;
  } else {
    q = joints_at(job, X_MT);
  }
  if (!q) return {};
  const std::vector<Mat3> unit = statics::unit_compliances(job.machine, X_MT, *q);
  const std::vector<double> compliances = statics::column_compliances(job.machine);
  Mat3 C = Mat3::Zero();
  for (std::size_t k = 0; k < unit.size(); ++k) C += compliances[k] * unit[k];
  const Mat3 D = kForce * (job.X_MW.R.transpose() * C * job.X_MW.R);
  return DeflectedBy100N{D.diagonal(), Vec3(D(1, 0), D(2, 0), D(2, 1))};
}

std::optional<ComplianceMark> compliance_mark(const Job& job, const gcode::Move& first) {
  if (job.measured) return {};
  ComplianceMark out;
  out.p = first.start;
  if (job.tool_frame.turns) out.axes = first.axes_start;
  if (job.tool_frame.tilted) out.axes = job.tool_frame.axes;
  const std::optional<DeflectedBy100N> found = deflections_at(job, out, {});
  if (!found) return {};
  out.deflection = found->along;
  out.across = found->across;
  return out;
}

std::optional<ComplianceMark> compliance_mark(const Job& job, const Sample& sample) {
  if (job.measured) return {};
  ComplianceMark out;
  out.p = sample.command;
  if (job.tool_frame.turns) out.axes = sample.axes;
  if (job.tool_frame.tilted) out.axes = job.tool_frame.axes;
  out.joints = sample.came_with();
  const std::optional<DeflectedBy100N> found = deflections_at(job, out, out.joints);
  if (!found) return {};
  out.deflection = found->along;
  out.across = found->across;
  return out;
}

}  // namespace polypod::machining
