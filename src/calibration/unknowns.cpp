// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include <fmt/format.h>

#include <cmath>

#include "model.hpp"

namespace polypod::calibration {

Layout layout_of(const std::vector<Measurement>& rows, std::size_t parameter_count) {
  Layout out;
  for (const Measurement& row : rows) {
    if (row.kind == Kind::contact && out.contact.try_emplace(row.contact, out.count).second) out.count += 3;
  }
  out.frame = out.count;
  out.target = out.frame + 6;
  out.scale = out.target + 6;
  out.parameters = out.scale + 1;
  out.count = out.parameters + static_cast<int>(parameter_count);
  return out;
}

double size_of(const AnyMachine& machine) {
  double size = 0;
  for (const machine::Parameter& p : kinematics::parameters(machine)) {
    if (p.unit == "mm") size = std::max(size, std::abs(p.value));
  }
  return size > 0 ? size : 1.0;
}

Start start_of(const AnyMachine& machine, const Layout& layout, const Pose& X_SM, const Pose& X_TR) {
  constexpr double kOnePercent = 0.01;
  const double length = kOnePercent * size_of(machine);
  Start out{Eigen::VectorXd::Zero(layout.count), Eigen::VectorXd::Constant(layout.count, kOnePercent)};
  for (const auto& [first, X] : {std::pair{layout.frame, &X_SM}, std::pair{layout.target, &X_TR}}) {
    out.x.segment<3>(first) = X->p;
    out.x.segment<3>(first + 3) = rotation_vector(X->R);
    out.scale.segment<3>(first).setConstant(length);
  }
  for (const auto& [name, first] : layout.contact) out.scale.segment<3>(first).setConstant(length);
  int column = layout.parameters;
  for (const machine::Parameter& p : kinematics::parameters(machine)) {
    out.x[column] = p.value;
    if (p.unit == "mm") out.scale[column] = length;
    ++column;
  }
  return out;
}

Identifiability identifiable(const Eigen::MatrixXd& J, const std::vector<int>& order, const Eigen::VectorXd& scale) {
  constexpr double kSame = 1e-8;  // of a column's own length: far above rounding, far below what noise leaves
  Identifiability out;
  const Eigen::Index n = static_cast<Eigen::Index>(order.size());
  Eigen::MatrixXd Q(J.rows(), n), R = Eigen::MatrixXd::Zero(n, n);
  Eigen::Index rank = 0;
  for (const int j : order) {
    Eigen::VectorXd column = scale[j] * J.col(j);
    const double own = column.norm();
    Eigen::VectorXd parts = Eigen::VectorXd::Zero(rank);
    for (int pass = 0; pass < 2; ++pass) {  // once more, for rounding
      const Eigen::VectorXd part = Q.leftCols(rank).transpose() * column;
      column -= Q.leftCols(rank) * part;
      parts += part;
    }
    const double left = column.norm();
    if (left > 1 && left > kSame * own) {
      R.col(rank).head(rank) = parts;
      R(rank, rank) = left;
      Q.col(rank++) = column / left;
      out.kept.push_back(j);
    } else {
      const Eigen::VectorXd y = R.topLeftCorner(rank, rank).triangularView<Eigen::Upper>().solve(parts);
      Eigen::VectorXd tie = Eigen::VectorXd::Zero(J.cols());
      for (Eigen::Index k = 0; k < rank; ++k) {
        const int kept = out.kept[static_cast<std::size_t>(k)];
        tie[kept] = y[k] * scale[kept] / scale[j];
      }
      out.ties[j] = std::move(tie);
    }
  }
  if (rank > 0) {
    Eigen::MatrixXd unit = R.topLeftCorner(rank, rank);
    unit = unit * unit.colwise().norm().cwiseInverse().asDiagonal();
    const Eigen::VectorXd sigma = kinematics::singular_values(unit);
    out.condition = sigma[0] / sigma[rank - 1];
  }
  return out;
}

namespace {

bool begins_with_any(const std::string& key, const std::vector<std::string>& beginnings) {
  return std::any_of(beginnings.begin(), beginnings.end(), [&](const std::string& b) { return key.rfind(b, 0) == 0; });
}

/// As `polypod info` shows it.
std::string full_key(const machine::Parameter& p) {
  return p.unit.empty() ? p.key : p.key + "_" + p.unit;
}

}  // namespace

Result<std::vector<bool>> chosen_parameters(const std::vector<machine::Parameter>& all,
                                            const CalibrationOptions& options) {
  for (const auto* list : {&options.only, &options.hold}) {
    for (const std::string& beginning : *list) {
      const bool known =
          std::any_of(all.begin(), all.end(), [&](const auto& p) { return begins_with_any(full_key(p), {beginning}); });
      if (!known) {
        return fail("CA114", fmt::format("no parameter begins with {}", beginning), {},
                    "`polypod info MACHINE` lists the parameters");
      }
    }
  }
  std::vector<bool> out;
  for (const machine::Parameter& p : all) {
    out.push_back((options.only.empty() || begins_with_any(full_key(p), options.only)) &&
                  !begins_with_any(full_key(p), options.hold));
  }
  return out;
}

std::vector<int> wanted_unknowns(const Layout& layout, const std::vector<bool>& chosen,
                                 const CalibrationOptions& options, bool turns) {
  std::vector<int> out;
  for (int j = 0; j < layout.frame; ++j) out.push_back(j);
  if (options.estimate_frame)
    for (int j = 0; j < 6; ++j) out.push_back(layout.frame + j);
  if (options.estimate_target)
    for (int j = 0; j < (turns ? 6 : 3); ++j) out.push_back(layout.target + j);
  if (options.estimate_scale) out.push_back(layout.scale);
  for (std::size_t i = 0; i < chosen.size(); ++i)
    if (chosen[i]) out.push_back(layout.parameters + static_cast<int>(i));
  return out;
}

machine::Parameter unknown_of(const AnyMachine& machine, const Layout& layout, int j) {
  static constexpr const char* kParts[] = {"x", "y", "z", "a", "b", "c"};
  if (j >= layout.parameters) return kinematics::parameters(machine)[static_cast<std::size_t>(j - layout.parameters)];
  if (j == layout.scale) return {"scale", 0, ""};
  if (j >= layout.frame) {
    const bool target = j >= layout.target;
    const int part = j - (target ? layout.target : layout.frame);
    return {fmt::format("{}.{}", target ? "target" : "frame", kParts[part]), 0, part < 3 ? "mm" : "deg"};
  }
  return {"contact", 0, "mm"};
}

}  // namespace polypod::calibration
