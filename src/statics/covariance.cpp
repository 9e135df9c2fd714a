// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/statics/covariance.hpp"

#include <fmt/format.h>

#include <charconv>
#include <cmath>
#include <sstream>

#include "polypod/core/files.hpp"
#include "polypod/core/text.hpp"
#include "polypod/core/units.hpp"
#include "polypod/statics/compliance.hpp"

namespace polypod::statics {
namespace {

constexpr std::string_view kTurns = ".compliance_rad_per_Nm", kStretches = ".compliance_um_per_N";

/// "stage 1 leg 2" as "stage[1].leg[2]".
std::string as_key(const std::string& name) {
  std::istringstream words(name);
  std::string word, out;
  while (words >> word) {
    const bool number = word.find_first_not_of("0123456789") == std::string::npos;
    out += number ? "[" + word + "]" : (out.empty() ? "" : ".") + word;
  }
  return out;
}

}  // namespace

Keyed keyed_compliances(const machine::AnyMachine& machine) {
  Keyed out;
  out.keys = column_names(machine);
  const std::vector<bool> turns = column_turns(machine);
  out.unit.resize(std::ssize(turns));
  for (std::size_t i = 0; i < turns.size(); ++i) {
    out.keys[i] = as_key(out.keys[i]).append(turns[i] ? kTurns : kStretches);
    out.unit[static_cast<Eigen::Index>(i)] = turns[i] ? 1 : units::from_um(1);
  }
  return out;
}

std::string covariance_csv(const Keyed& of, const Eigen::MatrixXd& covariance) {
  const Eigen::VectorXd scale = of.unit.cwiseInverse();
  const Eigen::MatrixXd values = scale.asDiagonal() * covariance * scale.asDiagonal();
  std::string out = "parameter";
  for (const std::string& key : of.keys) out += "," + key;
  out += '\n';
  for (std::size_t i = 0; i < of.keys.size(); ++i) {
    out += of.keys[i];
    for (const double value : values.row(static_cast<Eigen::Index>(i))) out += fmt::format(",{:.6g}", value);
    out += '\n';
  }
  return out;
}

Result<Eigen::MatrixXd> read_covariance(const Keyed& of, const std::string& path, const std::string& hint) {
  POLYPOD_ASSIGN(text, files::read(path));
  const Eigen::Index n = std::ssize(of.keys);
  const auto bad = [&](int line, const std::string& what) { return fail("CA153", what, Place{path, line, 1}, hint); };
  Eigen::MatrixXd out(n, n);
  std::istringstream lines(text);
  std::string line, cell;
  for (Eigen::Index row = -1; row < n; ++row) {
    const auto number = static_cast<int>(row) + 2;
    if (!std::getline(lines, line)) return bad(number, fmt::format("the covariance of {} parameters ends here", n));
    if (!line.empty() && line.back() == '\r') line.pop_back();
    std::istringstream cells(line);
    std::getline(cells, cell, ',');
    if (row >= 0 && cell != of.keys[static_cast<std::size_t>(row)])
      return bad(number, fmt::format("{} where {} must stand", one_line(cell), of.keys[static_cast<std::size_t>(row)]));
    Eigen::Index column = 0;
    for (; std::getline(cells, cell, ','); ++column) {
      if (column >= n) return bad(number, fmt::format("more than {} numbers", n));
      const std::string& key = of.keys[static_cast<std::size_t>(column)];
      if (row < 0) {
        if (cell != key) return bad(1, fmt::format("{} where {} must stand", one_line(cell), key));
        continue;
      }
      double value = 0;
      const auto [end, code] = std::from_chars(cell.data(), cell.data() + cell.size(), value);
      if (code != std::errc{} || end != cell.data() + cell.size() || !std::isfinite(value))
        return bad(number, fmt::format("\"{}\" is not a finite number", one_line(cell)));
      out(row, column) = value;
    }
    if (column != n) return bad(number, fmt::format("{} columns for {} parameters", column, n));
  }
  constexpr double kRounded = 1e-4;  // of the largest: six digits are written
  const double largest = n > 0 ? out.diagonal().cwiseAbs().maxCoeff() : 0;
  if (n > 0 && (out.diagonal().minCoeff() < 0 || (out - out.transpose()).cwiseAbs().maxCoeff() > kRounded * largest))
    return bad(2, "these numbers are no covariance: it is symmetric, with variances not below 0");
  return Eigen::MatrixXd(of.unit.asDiagonal() * out * of.unit.asDiagonal());
}

Result<Eigen::MatrixXd> read_covariance(const machine::AnyMachine& machine, const std::string& path) {
  return read_covariance(keyed_compliances(machine), path,
                         "give the machine file of `polypod identify compliance` and what --covariance wrote with it");
}

bool names_compliances(std::string_view text) {
  const std::string_view header = text.substr(0, text.find('\n'));
  const std::size_t begin = header.find(','), end = header.find(',', begin + 1);
  if (begin == std::string_view::npos) return false;
  std::string_view key = header.substr(begin + 1, end == std::string_view::npos ? end : end - begin - 1);
  if (key.ends_with('\r')) key.remove_suffix(1);
  return key.ends_with(kTurns) || key.ends_with(kStretches);
}

}  // namespace polypod::statics
