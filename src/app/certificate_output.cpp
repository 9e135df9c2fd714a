// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "certificate_output.hpp"

#include <fmt/chrono.h>
#include <fmt/format.h>

#include <algorithm>
#include <charconv>
#include <chrono>
#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <string_view>

#include "polypod/core/files.hpp"
#include "polypod/core/units.hpp"

namespace polypod::app {
namespace {

using calibration::kCoverageFactor;

/// "x_mm" in mm or "a_deg" in deg of what is stored in m or rad.
double for_user(const std::string& coordinate, double value) {
  return coordinate.ends_with("_mm") ? units::to_mm(value) : units::to_deg(value);
}

Json coordinates_json(const std::vector<std::string>& names, const Eigen::VectorXd& values, double factor = 1) {
  Json out = Json::object();
  for (std::size_t i = 0; i < names.size() && static_cast<Eigen::Index>(i) < values.size(); ++i)
    out[names[i]] = for_user(names[i], factor * values[static_cast<Eigen::Index>(i)]);
  return out;
}

/// Null where nothing was given.
Json text_json(const std::string& text) {
  return text.empty() ? Json() : Json(text);
}
Json number_json(const std::optional<double>& value) {
  return value ? Json(*value) : Json();
}

Json budget_json(const calibration::Budget& b) {
  Json rows = Json::array();
  for (const calibration::BudgetRow& row : b.rows) {
    Json one{{"quantity", row.quantity}, {"type", std::string(1, row.type)}, {"distribution", row.distribution}};
    const bool single = row.sensitivity.size() > 0;
    one["size"] = single ? Json(row.size) : Json();
    one["unit"] = single ? Json(row.unit) : Json();
    one["divisor"] = single ? Json(row.divisor) : Json();
    one["standard_uncertainty"] = single ? Json(row.size / row.divisor) : Json();
    one["degrees_of_freedom"] = row.degrees > 0 ? Json(row.degrees) : Json();
    one["sensitivity"] = single ? coordinates_json(b.coordinates, row.sensitivity) : Json();
    one["contribution"] = coordinates_json(b.coordinates, row.contribution);
    one["source"] = text_json(row.source);
    rows.push_back(std::move(one));
  }
  Json degrees = Json::object();
  for (std::size_t i = 0; i < b.coordinates.size(); ++i) {
    const double value = b.degrees[static_cast<Eigen::Index>(i)];
    degrees[b.coordinates[i]] = value > 0 ? Json(value) : Json();
  }
  return {{"pose", whole_pose_for_user(b.stand.X_MT)},
          {"rows", rows},
          {"combined_standard_uncertainty", coordinates_json(b.coordinates, b.combined)},
          {"effective_degrees_of_freedom", degrees},
          {"expanded_uncertainty", coordinates_json(b.coordinates, b.combined, kCoverageFactor)},
          {"k", kCoverageFactor}};
}

Json statement_json(const calibration::Statement& s) {
  return {{"number", text_json(s.number)},
          {"date", text_json(s.date)},
          {"customer", text_json(s.customer)},
          {"operator", text_json(s.operator_name)},
          {"place", text_json(s.place)},
          {"machine",
           {{"manufacturer", text_json(s.machine_manufacturer)},
            {"type", text_json(s.machine_type)},
            {"serial", text_json(s.machine_serial)},
            {"controller", text_json(s.controller)}}},
          {"instrument",
           {{"name", text_json(s.instrument_name)},
            {"serial", text_json(s.instrument_serial)},
            {"traceability", text_json(s.traceability)}}},
          {"temperature_C",
           {{"mean", number_json(s.temperature_mean)},
            {"min", number_json(s.temperature_min)},
            {"max", number_json(s.temperature_max)}}},
          {"remarks", s.remarks}};
}

}  // namespace

std::string today() {
  std::time_t now = std::chrono::system_clock::to_time_t(std::chrono::system_clock::now());
  // Reproducible outputs: https://reproducible-builds.org/specs/source-date-epoch/
  if (const char* epoch = std::getenv("SOURCE_DATE_EPOCH"); epoch != nullptr) {
    const std::string_view text(epoch);
    constexpr long long kMost = 253402300799;  // the last second of the year 9999
    long long seconds = 0;
    const auto [end, code] = std::from_chars(text.data(), text.data() + text.size(), seconds);
    if (code == std::errc{} && end == text.data() + text.size() && seconds >= 0 && seconds <= kMost)
      now = static_cast<std::time_t>(seconds);
  }
  return fmt::format("{:%Y-%m-%d}", fmt::gmtime(now));
}

std::vector<std::string> notes_of(const calibration::Statement& statement) {
  std::vector<std::string> notes;
  const std::vector<calibration::Systematic>& parts = statement.systematic;
  for (std::size_t i = 0; i < parts.size(); ++i) {
    for (std::size_t j = i + 1; j < parts.size(); ++j) {
      const calibration::Systematic &a = parts[i], &b = parts[j];
      if (a.quantity != b.quantity || a.axis != b.axis || a.of_machine != b.of_machine) continue;
      notes.push_back(
          fmt::format("the systematic part \"{}\" is stated in line {} and again in line {}: both count, as "
                      "independent of each other",
                      calibration::name_of(a.quantity), a.place.line, b.place.line));
    }
  }
  if (statement.date > today()) notes.push_back(fmt::format("the date {} is still to come", statement.date));
  return notes;
}

Result<pages::HashedFile> hashed_file(const std::string& role, const std::string& path) {
  if (files::is_standard_input(path)) return pages::HashedFile{role, "standard input", ""};
  std::error_code none;
  if (!std::filesystem::exists(path, none)) {
    for (const machine::CatalogueEntry& entry : machine::catalogue())
      if (entry.name == path) return hashed_bytes(role, path + " (catalogue)", std::string(entry.toml));
  }
  POLYPOD_ASSIGN(bytes, files::read(path));
  return hashed_bytes(role, path, bytes);
}

pages::HashedFile hashed_bytes(const std::string& role, const std::string& name, const std::string& bytes) {
  return {role, name, calibration::sha256(bytes)};
}

pages::Certificate certificate_of(const machine::AnyMachine& nominal, const std::vector<calibration::Measurement>& rows,
                                  const calibration::Calibration& c, const calibration::CalibrationOptions& options,
                                  calibration::Statement statement, bool noise_stated) {
  pages::Certificate out;
  out.statement = std::move(statement);
  if (out.statement.date.empty()) out.statement.date = today();
  out.options = options;
  out.noise_stated = noise_stated;
  out.region = calibration::region_of(nominal, rows);
  if (const auto stand = calibration::most_uncertain(c.machine, c, out.region))
    out.budget = calibration::budget_at(c.machine, c, options.systematic, *stand);
  out.poses = calibration::pose_accuracy(nominal, rows, c);
  out.lengths = calibration::length_errors(rows, c);
  out.lines = calibration::line_errors(nominal, rows, c);
  return out;
}

Json systematic_json(const calibration::Calibration& c, const std::vector<calibration::Systematic>& parts) {
  Json out = Json::array();
  for (const calibration::SystematicEffect& effect : c.systematic) {
    const calibration::Systematic& part = parts[effect.part];
    out.push_back({{"quantity", calibration::name_of(part.quantity)},
                   {"component", effect.component.empty() ? Json() : Json(effect.component)},
                   {"size", calibration::for_user(part.quantity, part.size)},
                   {"unit", calibration::unit_of(part.quantity)},
                   {"distribution", calibration::name_of(part.distribution)},
                   {"divisor", part.divisor},
                   {"standard_uncertainty", calibration::for_user(part.quantity, effect.standard_uncertainty)},
                   {"source", text_json(part.source)}});
  }
  return out;
}

Json certificate_json(const pages::Certificate& c) {
  Json region = Json::object();
  for (std::size_t i = 0; i < c.region.coordinates.size() && c.region.low.size() > 0; ++i) {
    const auto k = static_cast<Eigen::Index>(i);
    region[c.region.coordinates[i]] = {for_user(c.region.coordinates[i], c.region.low[k]),
                                       for_user(c.region.coordinates[i], c.region.high[k])};
  }
  Json poses = Json::array();
  for (const calibration::PoseAccuracy& p : c.poses) {
    Json one{{"cycles", p.cycles},
             {"command_mm", vector_json(p.command * units::kMmPerMetre)},
             {"AP_mm", units::to_mm(p.accuracy)},
             {"AP_calibrated_mm", units::to_mm(p.accuracy_after)},
             {"RP_mm", units::to_mm(p.repeatability)}};
    if (p.angles) {
      one["AP_angle_deg"] = units::to_deg(p.angle_accuracy);
      one["RP_angle_deg"] = units::to_deg(p.angle_repeatability);
    }
    poses.push_back(std::move(one));
  }
  Json lines = Json::array();
  for (const calibration::LineErrors& l : c.lines)
    lines.push_back({{"points", l.points},
                     {"from_mm", vector_json(l.from * units::kMmPerMetre)},
                     {"to_mm", vector_json(l.to * units::kMmPerMetre)},
                     {"E_mm", units::to_mm(l.error_before)},
                     {"E_calibrated_mm", units::to_mm(l.error_after)}});
  Json hashes = Json::array();
  for (const pages::HashedFile& file : c.files)
    hashes.push_back({{"role", file.role}, {"file", file.name}, {"sha256", text_json(file.sha256)}});
  return {{"statement", statement_json(c.statement)},
          {"budget", c.budget ? budget_json(*c.budget) : Json()},
          {"region", region},
          {"pose_accuracy_iso_9283", poses},
          {"length_errors", c.lengths ? Json{{"lengths", c.lengths->lengths},
                                             {"shortest_mm", units::to_mm(c.lengths->shortest)},
                                             {"longest_mm", units::to_mm(c.lengths->longest)},
                                             {"E_mm", units::to_mm(c.lengths->error_before)},
                                             {"E_calibrated_mm", units::to_mm(c.lengths->error_after)}}
                                      : Json()},
          {"line_errors_iso_230_2", lines},
          {"files", hashes}};
}

std::string uncertainty_note(const calibration::Calibration& c, const pages::HashedFile* covariance) {
  std::string pose, parameters;
  const std::vector<std::string> names = calibration::pose_coordinates(c.machine);
  for (std::size_t i = 0; i < names.size(); ++i)
    pose += fmt::format("{}{} {:.2g}", pose.empty() ? "" : ", ", names[i],
                        kCoverageFactor * for_user(names[i], c.verdict.after.mean[static_cast<Eigen::Index>(i)]));
  for (const calibration::Estimate& p : c.parameters)
    parameters += fmt::format("{}{}{} {:.2g}", parameters.empty() ? "" : ", ", p.key,
                              p.unit.empty() ? "" : "_" + p.unit, units::to_user(p.standard_error, p.unit));
  return fmt::format(
      "U (k = 2) of the pose of the tool, mean over the workspace: {}; standard uncertainties of the "
      "parameters, {}: {}{}",
      pose, c.systematic.empty() ? "no systematic parts stated" : "systematic parts (type B) included", parameters,
      covariance == nullptr
          ? std::string()
          : fmt::format("; they hang together as {} says (SHA-256 {})",
                        std::filesystem::path(covariance->name).filename().string(), covariance->sha256));
}

}  // namespace polypod::app
