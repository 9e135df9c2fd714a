// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "covariance_files.hpp"

#include <fmt/format.h>

#include "polypod/calibration/certificate.hpp"
#include "polypod/core/files.hpp"
#include "polypod/core/text.hpp"
#include "polypod/statics/covariance.hpp"

namespace polypod::app {
namespace {

/// Whether the machine file is the one that was written together with this covariance; `command` wrote both.
Status belongs(const machine::AnyMachine& machine, const std::vector<std::string>& sets, const std::string& file,
               const std::string& key, const char* command) {
  const std::string hint =
      fmt::format("give the machine file that `polypod {} -o` wrote together with --covariance, as it is", command);
  if (!sets.empty())
    return fail("CA154",
                fmt::format("--set makes another machine than the one that was {}",
                            key == kComplianceUncertainty ? "identified" : "calibrated"),
                {}, hint);
  POLYPOD_ASSIGN(bytes, files::read(file));
  const machine::Provenance& provenance = machine::provenance_of(machine);
  const auto said = provenance.find(key);
  if (said != provenance.end() && said->second.find(calibration::sha256(bytes)) != std::string::npos) return {};
  return fail("CA154",
              fmt::format("{} does not name this covariance (its SHA-256 is not in [provenance] {})",
                          one_line(machine::name_of(machine)), key),
              Place{file, 1, 1}, hint);
}

}  // namespace

Result<Eigen::MatrixXd> parameter_covariance(const machine::AnyMachine& machine, const std::vector<std::string>& sets,
                                             const std::string& file) {
  POLYPOD_ASSIGN(covariance, calibration::read_covariance(machine, file));
  POLYPOD_TRY(belongs(machine, sets, file, "uncertainty", "calibrate"));
  return covariance;
}

Result<Covariances> covariances_of(const machine::AnyMachine& machine, const std::vector<std::string>& files) {
  Covariances out;
  for (const std::string& file : files) {
    POLYPOD_ASSIGN(text, files::read(file));
    const bool compliances = statics::names_compliances(text);
    std::optional<Eigen::MatrixXd>& one = compliances ? out.compliances : out.parameters;
    if (one)
      return fail("AP124",
                  fmt::format("--covariance {}: a second covariance of {}", file,
                              compliances ? "compliances" : "calibrated parameters"),
                  {}, "give at most one that `calibrate` wrote and one that `identify compliance` wrote");
    if (compliances) {
      POLYPOD_ASSIGN(covariance, statics::read_covariance(machine, file));
      POLYPOD_TRY(belongs(machine, {}, file, kComplianceUncertainty, "identify compliance"));
      one = std::move(covariance);
    } else {
      POLYPOD_ASSIGN(covariance, parameter_covariance(machine, {}, file));
      one = std::move(covariance);
    }
  }
  return out;
}

Json covariance_json(const statics::Keyed& of, const Eigen::MatrixXd& covariance) {
  const Eigen::VectorXd scale = of.unit.cwiseInverse();
  return {{"keys", of.keys}, {"matrix", matrix_json(scale.asDiagonal() * covariance * scale.asDiagonal())}};
}

}  // namespace polypod::app
