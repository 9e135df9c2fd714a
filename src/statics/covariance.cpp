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
  const std::vector<double> values = column_compliances(machine);
  out.value = Eigen::Map<const Eigen::VectorXd>(values.data(), std::ssize(values));
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
  out += ",value\n";
  for (std::size_t i = 0; i < of.keys.size(); ++i) {
    const auto k = static_cast<Eigen::Index>(i);
    out += of.keys[i];
    for (const double value : values.row(k)) out += fmt::format(",{:.6g}", value);
    out += fmt::format(",{:.12g}\n", of.value[k] * scale[k]);
  }
  return out;
}

Result<Eigen::MatrixXd> read_covariance(const Keyed& of, const std::string& path, const std::string& hint) {
  POLYPOD_ASSIGN(text, files::read(path));
  const Eigen::Index n = std::ssize(of.keys);
  const auto bad = [&](int line, const std::string& what) { return fail("CA153", what, Place{path, line, 1}, hint); };
  Eigen::MatrixXd out(n, n + 1);  // the last column: the values
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
      if (column > n) return bad(number, fmt::format("more than {} numbers and a value", n));
      const std::string key = column < n ? of.keys[static_cast<std::size_t>(column)] : "value";
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
    if (column != n + 1) return bad(number, fmt::format("{} columns for {} parameters and a value", column, n));
  }
  const Eigen::VectorXd values = out.col(n);
  out.conservativeResize(n, n);
  constexpr double kRounded = 1e-4;  // of the largest: six digits are written
  const double largest = n > 0 ? out.diagonal().cwiseAbs().maxCoeff() : 0;
  if (n > 0 && (out.diagonal().minCoeff() < 0 || (out - out.transpose()).cwiseAbs().maxCoeff() > kRounded * largest))
    return bad(2, "these numbers are no covariance: it is symmetric, with variances not below 0");
  constexpr double kSame = 1e-9;      // twelve digits are written
  constexpr double kNothing = 1e-14;  // mm, deg, um/N, rad/Nm
  for (Eigen::Index k = 0; k < n; ++k) {
    const double here = of.value[k] / of.unit[k];
    if (std::abs(here - values[k]) <= kSame * std::max(std::abs(here), std::abs(values[k])) + kNothing) continue;
    return fail("CA154",
                fmt::format("{} is {:g} in the machine, and {:g} in the one that this covariance is of",
                            of.keys[static_cast<std::size_t>(k)], here, values[k]),
                Place{path, static_cast<int>(k) + 2, 1}, hint);
  }
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
