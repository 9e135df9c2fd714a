// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/calibration/measurement.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <map>

#include <chrono>
#include <optional>

#include "polypod/core/csv.hpp"
#include "polypod/core/units.hpp"

namespace polypod::calibration {
namespace {

using csv::Table;

/// Three columns name_x<suffix>, name_y<suffix>, name_z<suffix>.
std::vector<std::string> three(const std::string& name, const std::string& suffix) {
  return {name + "x" + suffix, name + "y" + suffix, name + "z" + suffix};
}
Result<Vec3> vector_of(const Table& table, const Table::Row& row, const std::vector<std::string>& names) {
  POLYPOD_ASSIGN(x, table.number(row, names[0]));
  POLYPOD_ASSIGN(y, table.number(row, names[1]));
  POLYPOD_ASSIGN(z, table.number(row, names[2]));
  return Vec3(x, y, z);
}

const std::vector<std::string> kPoint = three("", "_mm"), kAnchor = three("anchor_", "_mm"),
                               kPlane = three("plane_", "_mm"), kNormal = three("normal_", "");

Result<Kind> kind_of(const Table& table) {
  if (table.has("distance_mm")) return Kind::distance;
  if (table.has("gauge_mm")) return Kind::gauge;
  if (table.has("contact")) return Kind::contact;
  if (table.has("x_mm")) {
    if (table.has("c_deg")) return Kind::pose;
    return table.has("a_deg") || table.has("b_deg") ? Kind::axis : Kind::point;
  }
  if (const auto near = table.unused(); !near) return tl::unexpected(near.error());  // X_mm for x_mm
  return fail("CA101", "no column says what was measured", Place{table.path, table.header_line, 1},
              "give x_mm,y_mm,z_mm (and a_deg,b_deg,c_deg), distance_mm, gauge_mm or contact");
}

std::vector<std::string> columns_of(Kind kind) {
  const auto with = [](std::vector<std::string> a, const std::vector<std::string>& b) {
    a.insert(a.end(), b.begin(), b.end());
    return a;
  };
  switch (kind) {
    case Kind::point:
      return kPoint;
    case Kind::axis:
      return with(kPoint, {"a_deg", "b_deg"});
    case Kind::pose:
      return with(kPoint, {"a_deg", "b_deg", "c_deg"});
    case Kind::distance:
      return with({"distance_mm"}, kAnchor);
    case Kind::gauge:
      return with({"gauge_mm"}, with(kPlane, kNormal));
    case Kind::contact:
      break;
  }
  return {"contact"};
}

/// Seconds of a number, of hh:mm[:ss], or of a date and such a time (ISO 8601); nothing for other texts.
std::optional<double> seconds_of(const std::string& text) {
  constexpr double kMinute = 60, kHour = 60 * kMinute, kDay = 24 * kHour;
  int year = 0, month = 1, day = 1, hour = 0, minute = 0, used = 0;
  double second = 0;
  double date = 0;
  const char* clock = text.c_str();
  if (std::sscanf(clock, "%4d-%2d-%2d%n", &year, &month, &day, &used) == 3 && used > 0) {
    const std::chrono::year_month_day ymd{std::chrono::year(year), std::chrono::month(static_cast<unsigned>(month)),
                                          std::chrono::day(static_cast<unsigned>(day))};
    if (!ymd.ok()) return std::nullopt;
    date = kDay * static_cast<double>(std::chrono::sys_days(ymd).time_since_epoch().count());
    clock += used;
    if (*clock == 'T' || *clock == ' ') ++clock;
  }
  const int read = std::sscanf(clock, "%2d:%2d:%lf", &hour, &minute, &second);
  if (read < 2) return std::nullopt;
  return date + kHour * hour + kMinute * minute + second;
}

/// When and how warm it was, where the file says so. Errors: ID101.
Status read_conditions(const Table& table, const Table::Row& row, Measurement& m) {
  constexpr double kNone = std::numeric_limits<double>::quiet_NaN();
  POLYPOD_ASSIGN(temperature, table.number(row, "temperature_C", kNone));
  m.temperature = temperature;
  POLYPOD_ASSIGN(seconds, table.number(row, "time_s", kNone));
  m.time = seconds;
  if (const std::string text = table.text(row, "time"); !text.empty() && !table.has("time_s")) {
    if (const auto at = seconds_of(text)) {
      m.time = *at;
    } else {
      POLYPOD_ASSIGN(number, table.number(row, "time"));
      m.time = number;
    }
  }
  return {};
}

Result<Measurement> measurement_of(const AnyMachine& machine, const Table& table, const Table::Row& row, Kind kind) {
  Measurement m;
  m.kind = kind;
  m.place = table.place_of(row);
  const int n = kinematics::joint_count(machine);
  m.q.resize(n);
  for (int i = 0; i < n; ++i) {
    POLYPOD_ASSIGN(value, table.number(row, fmt::format("q{}", i + 1)));
    const bool turns = kinematics::joint_kind(machine, i) == machine::JointKind::revolute;
    m.q[i] = turns ? units::from_deg(value) : units::from_mm(value);
  }
  POLYPOD_ASSIGN(noise, table.number(row, "sigma_um", 0));
  if (!table.text(row, "sigma_um").empty() && !(noise > 0)) {
    return fail("CA102", fmt::format("sigma_um = {:g} must be above 0", noise), m.place);
  }
  m.noise = units::from_um(noise);
  const double mm = units::from_mm(1);
  if (kind == Kind::point || kind == Kind::axis || kind == Kind::pose) {
    POLYPOD_ASSIGN(p, vector_of(table, row, kPoint));
    m.X_SR.p = mm * p;
  }
  if (kind == Kind::axis || kind == Kind::pose) {
    POLYPOD_ASSIGN(a, table.number(row, "a_deg"));
    POLYPOD_ASSIGN(b, table.number(row, "b_deg"));
    POLYPOD_ASSIGN(c, table.number(row, "c_deg", 0));
    m.X_SR.R = rotation_abc(units::from_deg(a), units::from_deg(b), units::from_deg(c));
  }
  if (kind == Kind::distance || kind == Kind::gauge) {
    const bool gauge = kind == Kind::gauge;
    POLYPOD_ASSIGN(p, vector_of(table, row, gauge ? kPlane : kAnchor));
    POLYPOD_ASSIGN(reading, table.number(row, gauge ? "gauge_mm" : "distance_mm"));
    m.anchor_S = mm * p;
    m.reading = units::from_mm(reading);
    if (gauge) {
      POLYPOD_ASSIGN(normal, vector_of(table, row, kNormal));
      if (!(normal.norm() > 0)) return fail("CA102", "the normal of the plane has no length", m.place);
      m.normal_S = normal.normalized();
    } else if (!(reading > 0)) {
      return fail("CA102", fmt::format("distance_mm = {:g} must be above 0", reading), m.place);
    }
  }
  m.contact = table.text(row, "contact");
  POLYPOD_TRY(read_conditions(table, row, m));
  return m;
}

}  // namespace

std::optional<int> joint_far_outside(const AnyMachine& machine, const JointVector& q) {
  for (int i = 0; i < q.size(); ++i) {
    const machine::JointRange range = kinematics::joint_range(machine, i);
    const double span = range.max - range.min;
    if (q[i] < range.min - span || q[i] > range.max + span) return i;
  }
  return {};
}

std::string name_of(Kind kind) {
  static constexpr const char* kNames[] = {"points", "axes", "poses", "distances", "gauge readings", "contacts"};
  return kNames[static_cast<int>(kind)];
}

Result<std::vector<Measurement>> read_measurements(const AnyMachine& machine, const std::string& path) {
  POLYPOD_ASSIGN(table, csv::read(path));
  POLYPOD_ASSIGN(rows, read_measurements(machine, table));
  POLYPOD_TRY(table.unused());
  return rows;
}

Result<std::vector<Measurement>> read_measurements(const AnyMachine& machine, const csv::Table& table) {
  POLYPOD_ASSIGN(kind, kind_of(table));
  std::vector<std::string> needed;
  for (int i = 0; i < kinematics::joint_count(machine); ++i) needed.push_back(fmt::format("q{}", i + 1));
  const std::vector<std::string> columns = columns_of(kind);
  needed.insert(needed.end(), columns.begin(), columns.end());
  POLYPOD_TRY(table.needs(needed));
  std::vector<Measurement> out;
  std::size_t far = 0;
  Status first_far;
  for (const Table::Row& row : table.rows) {
    POLYPOD_ASSIGN(m, measurement_of(machine, table, row, kind));
    if (const auto i = joint_far_outside(machine, m.q); i && far++ == 0) {
      const bool turns = kinematics::joint_kind(machine, *i) == machine::JointKind::revolute;
      const auto user = [&](double x) { return turns ? units::to_deg(x) : units::to_mm(x); };
      const machine::JointRange range = kinematics::joint_range(machine, *i);
      first_far = fail("CA103",
                       fmt::format("q{} = {:g} is far outside of the joint's {:g} to {:g} {}", *i + 1, user(m.q[*i]),
                                   user(range.min), user(range.max), turns ? "deg" : "mm"),
                       m.place, "joints are in mm and deg");
    }
    out.push_back(std::move(m));
  }
  // A few are slips, which calibrate() leaves out and names; many are another unit.
  constexpr std::size_t kFew = 10;
  if (far * kFew > out.size()) return tl::unexpected(first_far.error());
  POLYPOD_TRY(csv::no_row_twice(table));
  return out;
}

Status no_row_twice(const std::vector<Measurement>& rows) {
  std::map<std::pair<std::vector<double>, std::string>, const Place*> seen;
  for (const Measurement& row : rows) {
    std::vector<double> key{static_cast<double>(row.kind), row.reading, row.noise};
    const auto add = [&](const auto& values) {
      for (const double value : values) key.push_back(value);
    };
    add(row.q);
    add(row.X_SR.p);
    add(row.X_SR.R.reshaped());
    add(row.anchor_S);
    add(row.normal_S);
    for (const double condition : {row.time, row.temperature})
      key.push_back(std::isfinite(condition) ? condition : -1e300);
    const auto [it, fresh] = seen.try_emplace({std::move(key), row.contact}, &row.place);
    if (fresh) continue;
    const Place& first = *it->second;
    return fail("ID103",
                first.file == row.place.file ? fmt::format("the row is already in line {}", first.line)
                                             : fmt::format("the row is already in {}:{}", first.file, first.line),
                row.place, "a row that occurs twice would count twice");
  }
  return {};
}

std::string measurements_csv(const AnyMachine& machine, const std::vector<Measurement>& rows) {
  if (rows.empty()) return "";
  const Kind kind = rows.front().kind;
  std::string out;
  for (int i = 0; i < kinematics::joint_count(machine); ++i) out += fmt::format("q{},", i + 1);
  const std::vector<std::string> columns = columns_of(kind);
  for (const std::string& name : columns) out += name + (&name == &columns.back() ? "\n" : ",");
  for (const Measurement& m : rows) {
    for (int i = 0; i < m.q.size(); ++i) {
      const bool turns = kinematics::joint_kind(machine, i) == machine::JointKind::revolute;
      out += fmt::format("{:.12g},", turns ? units::to_deg(m.q[i]) : units::to_mm(m.q[i]));
    }
    // Tenths of a nanometre: far below any instrument.
    const auto mm = [&](const Vec3& p) {
      const Vec3 user = p * units::kMmPerMetre;
      return fmt::format("{:.7f},{:.7f},{:.7f}", user.x(), user.y(), user.z());
    };
    switch (kind) {
      case Kind::point:
        out += mm(m.X_SR.p);
        break;
      case Kind::axis: {
        const Eigen::Vector2d ab = angles_ab(m.X_SR.R.col(2));
        out += fmt::format("{},{:.8f},{:.8f}", mm(m.X_SR.p), units::to_deg(ab.x()), units::to_deg(ab.y()));
        break;
      }
      case Kind::pose: {
        const Vec3 abc = angles_abc(m.X_SR.R);
        out += fmt::format("{},{:.8f},{:.8f},{:.8f}", mm(m.X_SR.p), units::to_deg(abc.x()), units::to_deg(abc.y()),
                           units::to_deg(abc.z()));
        break;
      }
      case Kind::distance:
        out += fmt::format("{:.7f},{}", units::to_mm(m.reading), mm(m.anchor_S));
        break;
      case Kind::gauge:
        out += fmt::format("{:.7f},{},{:.9g},{:.9g},{:.9g}", units::to_mm(m.reading), mm(m.anchor_S), m.normal_S.x(),
                           m.normal_S.y(), m.normal_S.z());
        break;
      case Kind::contact:
        out += m.contact;
        break;
    }
    out += '\n';
  }
  return out;
}

}  // namespace polypod::calibration
