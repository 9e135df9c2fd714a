// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/calibration/certificate.hpp"

#include <fmt/format.h>
#include <openssl/evp.h>

#include <array>
#include <chrono>
#include <cmath>
#include <map>

#include "groups.hpp"
#include "model.hpp"
#include "polypod/core/distributions.hpp"
#include "polypod/core/files.hpp"
#include "polypod/core/units.hpp"
#include "polypod/statics/covariance.hpp"

namespace polypod::calibration {
namespace {

/// "2026-05-04" is a day of the calendar.
bool is_date(const std::string& text) {
  int year = 0, month = 0, day = 0, end = 0;
  if (std::sscanf(text.c_str(), "%4d-%2d-%2d%n", &year, &month, &day, &end) != 3 || end != 10 || text.size() != 10)
    return false;
  const auto wanted = std::chrono::year(year) / std::chrono::month(static_cast<unsigned>(month)) /
                      std::chrono::day(static_cast<unsigned>(day));
  return wanted.ok();
}

/// The texts of one table under these keys, then its end.
Status read_texts(const config::Table& table, const std::vector<std::pair<const char*, std::string*>>& keys) {
  for (const auto& [key, text] : keys) {
    POLYPOD_ASSIGN(value, table.optional_text(key, ""));
    *text = value;
  }
  return {};
}

Status read_temperature(const config::Table& table, Statement& out) {
  constexpr config::Range kTemperature{-60, 100};  // where somebody measures; kelvin are not
  for (const auto& [key, value] :
       {std::pair{"mean_C", &out.temperature_mean}, {"min_C", &out.temperature_min}, {"max_C", &out.temperature_max}}) {
    if (!table.has(key)) continue;
    POLYPOD_ASSIGN(number, table.number(key, kTemperature));
    *value = number;
  }
  const double mean = out.temperature_mean.value_or(out.temperature_min.value_or(0));
  if (out.temperature_min.value_or(mean) > mean || out.temperature_max.value_or(mean) < mean)
    return fail("CA152", "min_C, mean_C and max_C are out of order", table.place());
  return table.finish();
}

/// Rows that were measured, not lost.
bool counts(const RowResidual& r) {
  return !r.lost && !r.untaken;
}

double mean_of(const std::vector<double>& values) {
  double sum = 0;
  for (const double v : values) sum += v;
  return values.empty() ? 0 : sum / double(values.size());
}
double deviation_of(const std::vector<double>& values) {
  const double mean = mean_of(values);
  double sum = 0;
  for (const double v : values) sum += (v - mean) * (v - mean);
  return values.size() < 2 ? 0 : std::sqrt(sum / double(values.size() - 1));
}

/// The rows with a place, by the pose that was commanded, in the order of their first rows.
std::vector<std::vector<std::size_t>> places_by_pose(const AnyMachine& nominal, const std::vector<Measurement>& rows,
                                                     const Calibration& c) {
  const std::vector<std::size_t> pose = poses_of(nominal, rows);
  std::map<std::size_t, std::vector<std::size_t>> sets;
  for (std::size_t i = 0; i < rows.size(); ++i) {
    const Kind kind = rows[i].kind;
    if ((kind != Kind::point && kind != Kind::axis && kind != Kind::pose) || !counts(c.residuals[i])) continue;
    sets[pose[i]].push_back(i);
  }
  std::vector<std::vector<std::size_t>> out;
  for (auto& [number, set] : sets) out.push_back(std::move(set));
  return out;
}

/// Effective degrees of freedom where only the readings have an end of them.
double effective_degrees(double combined, double readings, double degrees) {
  return readings > 0 ? degrees * std::pow(combined / readings, 4) : 0;
}

}  // namespace

Result<Statement> read_statement(const std::string& path) {
  POLYPOD_ASSIGN(table, config::read_file(path));
  Statement out;
  POLYPOD_TRY(read_texts(table, {{"number", &out.number},
                                 {"date", &out.date},
                                 {"customer", &out.customer},
                                 {"operator", &out.operator_name},
                                 {"place", &out.place}}));
  if (table.has("date") && !is_date(out.date))
    return fail("CA152", fmt::format("date = \"{}\" is no day of the calendar", out.date), table.place_of("date"),
                "write it as \"2026-05-04\"");
  POLYPOD_ASSIGN(remarks, table.optional_texts("remarks"));
  out.remarks = remarks;
  POLYPOD_ASSIGN(machine, table.optional_table("machine"));
  if (machine) {
    POLYPOD_TRY(read_texts(*machine, {{"manufacturer", &out.machine_manufacturer},
                                      {"type", &out.machine_type},
                                      {"serial", &out.machine_serial},
                                      {"controller", &out.controller}}));
    POLYPOD_TRY(machine->finish());
  }
  POLYPOD_ASSIGN(instrument, table.optional_table("instrument"));
  if (instrument) {
    POLYPOD_TRY(read_texts(
        *instrument,
        {{"name", &out.instrument_name}, {"serial", &out.instrument_serial}, {"traceability", &out.traceability}}));
    POLYPOD_TRY(instrument->finish());
  }
  POLYPOD_ASSIGN(temperature, table.optional_table("temperature"));
  if (temperature) POLYPOD_TRY(read_temperature(*temperature, out));
  POLYPOD_ASSIGN(systematic, read_systematic(table));
  out.systematic = std::move(systematic);
  POLYPOD_TRY(table.finish());
  return out;
}

std::string sha256(std::string_view bytes) {
  std::array<unsigned char, EVP_MAX_MD_SIZE> digest{};
  unsigned int size = 0;
  if (EVP_Digest(bytes.data(), bytes.size(), digest.data(), &size, EVP_sha256(), nullptr) != 1) return {};
  std::string out;
  for (unsigned int i = 0; i < size; ++i) out += fmt::format("{:02x}", digest[i]);
  return out;
}

Budget budget_at(const AnyMachine& machine, const Calibration& c, const std::vector<Systematic>& systematic,
                 const Stand& stand) {
  Budget out;
  out.stand = stand;
  out.coordinates = pose_coordinates(machine);
  const auto deviation = [&](const Eigen::MatrixXd& covariance) {
    return pose_deviation(machine, stand.X_MT, stand.q, covariance);
  };
  BudgetRow readings{"readings: scatter of instrument and machine", "Student's t", "", 'A', {}, 0, 1, {}, {}, {}};
  readings.degrees = std::max(1.0, c.free_equations);
  readings.contribution = deviation(c.covariance_readings);
  BudgetRow drawing{"drawing: what the readings leave open", "normal", "", 'B', {}, 0, 1, {}, {}, {}};
  drawing.contribution = deviation(c.covariance_drawing);
  out.rows = {std::move(readings), std::move(drawing)};
  const auto S = kinematics::closure_detail::task_rows(kinematics::task(machine), stand.X_MT, 1.0);
  const Eigen::MatrixXd G = S * twist_by_parameters(machine, stand.X_MT, stand.q);
  for (const SystematicEffect& effect : c.systematic) {
    const Systematic& part = systematic[effect.part];
    BudgetRow row;
    row.quantity = std::string(name_of(part.quantity));
    if (part.quantity == Quantity::force_gain) row.quantity = "force gain";
    if (part.quantity == Quantity::temperature)
      row.quantity += part.of_machine ? " of the machine" : " of the instrument";
    if (!effect.component.empty()) row.quantity += " " + effect.component;
    row.distribution = name_of(part.distribution);
    row.unit = unit_of(part.quantity);
    row.source = part.source;
    row.size = for_user(part.quantity, part.size);
    row.divisor = part.divisor;
    const Eigen::VectorXd by_b = G * effect.by_parameter;
    row.sensitivity = by_b * (part.size / row.size);
    row.contribution = by_b.cwiseAbs() * effect.standard_uncertainty;
    out.rows.push_back(std::move(row));
  }
  out.combined = deviation(c.covariance);
  out.degrees = out.k95 = Eigen::VectorXd::Zero(out.combined.size());
  for (Eigen::Index k = 0; k < out.combined.size(); ++k) {
    out.degrees[k] = effective_degrees(out.combined[k], out.rows[0].contribution[k], out.rows[0].degrees);
    out.k95[k] = student_quantile(0.05, std::max(1.0, out.degrees[k]));
  }
  return out;
}

statics::Keyed keyed_parameters(const AnyMachine& machine) {
  statics::Keyed of;
  const std::vector<machine::Parameter> all = kinematics::parameters(machine);
  of.unit.resize(std::ssize(all));
  of.value.resize(std::ssize(all));
  for (const machine::Parameter& p : all) {
    of.unit[std::ssize(of.keys)] = units::from_user(1, p.unit);
    of.value[std::ssize(of.keys)] = p.value;
    of.keys.push_back(machine::key_of(p));
  }
  return of;
}

Result<Eigen::MatrixXd> read_covariance(const AnyMachine& machine, const std::string& path) {
  return statics::read_covariance(keyed_parameters(machine), path,
                                  "give the machine file of `polypod calibrate` and what --covariance wrote with it");
}

bool Region::holds(const Vec3& p) const {
  return !box.isEmpty() && box.contains(p);
}

Region region_of(const AnyMachine& machine, const std::vector<Measurement>& rows) {
  Region out;
  out.coordinates = pose_coordinates(machine);
  for (const Measurement& row : rows) {
    const auto X = pose_of_row(machine, row);
    if (!X) continue;
    const auto c = kinematics::coordinates_of(kinematics::task(machine), *X);
    const Eigen::VectorXd at = Eigen::Map<const Eigen::VectorXd>(c.data(), std::ssize(c));
    out.box.extend(X->p);
    out.low = out.low.size() == 0 ? at : out.low.cwiseMin(at).eval();
    out.high = out.high.size() == 0 ? at : out.high.cwiseMax(at).eval();
  }
  return out;
}

std::optional<Stand> most_uncertain(const AnyMachine& machine, const Calibration& c, const Region& region) {
  std::optional<Stand> out;
  double most = -1;
  bool inside = false;
  for (const Stand& stand : random_stands(machine, kJudgedPoses, kJudgedSeed)) {
    const bool in = region.holds(stand.X_MT.p);
    if (inside && !in) continue;
    const double u = largest_deviation(tip_covariance(machine, stand.X_MT, stand.q, c.covariance));
    if (u <= most && in == inside) continue;
    most = u;
    inside = in;
    out = stand;
  }
  return out;
}

std::vector<PoseAccuracy> pose_accuracy(const AnyMachine& nominal, const std::vector<Measurement>& rows,
                                        const Calibration& c) {
  std::vector<PoseAccuracy> out;
  for (const std::vector<std::size_t>& set : places_by_pose(nominal, rows, c)) {
    if (set.size() < kLeastCycles) continue;
    const auto X = pose_of_row(nominal, rows[set.front()]);
    if (!X) continue;
    PoseAccuracy one;
    one.row = set.front();
    one.cycles = set.size();
    one.command = X->p;
    // Residuals are computed less measured: their mean is the way from the barycentre to the command.
    Vec3 before = Vec3::Zero(), after = Vec3::Zero();
    for (const std::size_t i : set) {
      before += c.residuals[i].before.head<3>() / double(set.size());
      after += c.residuals[i].after.head<3>() / double(set.size());
    }
    std::vector<double> away;
    for (const std::size_t i : set) away.push_back((c.residuals[i].before.head<3>() - before).norm());
    one.accuracy = before.norm();
    one.accuracy_after = after.norm();
    one.repeatability = mean_of(away) + 3 * deviation_of(away);
    one.angles = std::all_of(set.begin(), set.end(), [&](std::size_t i) { return rows[i].kind == Kind::pose; });
    for (int k = 3; one.angles && k < 6; ++k) {
      std::vector<double> turn;
      for (const std::size_t i : set) turn.push_back(c.residuals[i].before[k]);
      one.angle_accuracy = std::max(one.angle_accuracy, std::abs(mean_of(turn)));
      one.angle_repeatability = std::max(one.angle_repeatability, 3 * deviation_of(turn));
    }
    out.push_back(one);
  }
  return out;
}

std::optional<LengthErrors> length_errors(const std::vector<Measurement>& rows, const Calibration& c) {
  LengthErrors out;
  for (std::size_t i = 0; i < rows.size(); ++i) {
    if (rows[i].kind != Kind::distance || !counts(c.residuals[i])) continue;
    out.shortest = out.lengths == 0 ? rows[i].reading : std::min(out.shortest, rows[i].reading);
    out.longest = std::max(out.longest, rows[i].reading);
    out.error_before = std::max(out.error_before, std::abs(c.residuals[i].before[0]));
    out.error_after = std::max(out.error_after, std::abs(c.residuals[i].after[0]));
    ++out.lengths;
  }
  return out.lengths > 0 ? std::optional(out) : std::nullopt;
}

std::vector<LineErrors> line_errors(const AnyMachine& nominal, const std::vector<Measurement>& rows,
                                    const Calibration& c) {
  constexpr std::size_t kLeast = 5;
  constexpr double kStraight = 0.05e-3;  // m
  struct Place {
    Vec3 command, before, after;  // after and before: means of the residuals, in S
    std::size_t row = 0;
  };
  std::vector<Place> places;
  for (const std::vector<std::size_t>& set : places_by_pose(nominal, rows, c)) {
    const auto X = pose_of_row(nominal, rows[set.front()]);
    if (!X) continue;
    Place one{X->p, Vec3::Zero(), Vec3::Zero(), set.front()};
    for (const std::size_t i : set) {
      one.before += c.residuals[i].before.head<3>() / double(set.size());
      one.after += c.residuals[i].after.head<3>() / double(set.size());
    }
    places.push_back(one);
  }
  std::vector<LineErrors> out;
  for (std::size_t first = 0; first + kLeast <= places.size();) {
    const Vec3 start = places[first].command, step = places[first + 1].command - start;
    std::size_t end = first + 1;
    const Vec3 along = step.normalized();
    for (double way = 0; step.norm() > kStraight && end < places.size(); ++end) {
      const Vec3 to = places[end].command - start;
      const double now = along.dot(to);
      if (now <= way + kStraight || (to - now * along).norm() > kStraight) break;
      way = now;
    }
    if (end - first < kLeast) {
      ++first;
      continue;
    }
    LineErrors one;
    one.row = places[first].row;
    one.points = end - first;
    one.from = start;
    one.to = places[end - 1].command;
    const Vec3 line = c.X_SM.R * (one.to - one.from).normalized();
    for (const auto& [mean, error] :
         {std::pair{&Place::before, &LineErrors::error_before}, {&Place::after, &LineErrors::error_after}}) {
      double low = 1e300, high = -1e300;
      for (std::size_t i = first; i < end; ++i) {
        low = std::min(low, line.dot(places[i].*mean));
        high = std::max(high, line.dot(places[i].*mean));
      }
      one.*error = high - low;
    }
    out.push_back(one);
    first = end;
  }
  return out;
}

}  // namespace polypod::calibration
