// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// What `calibrate` says of systematic parts and writes as a certificate.
#pragma once

#include "command.hpp"
#include "polypod/pages/certificate.hpp"

namespace polypod::app {

/// "2026-05-04": the day of SOURCE_DATE_EPOCH if the environment has it, else today, UTC.
std::string today();

/// What may be a slip in a statement: parts that are stated twice, a day that is still to come.
std::vector<std::string> notes_of(const calibration::Statement& statement);

/// The bytes of a file that was read, hashed; of standard input nothing is known any more. A machine of the catalogue
/// stands with its text. Errors: FI100.
Result<pages::HashedFile> hashed_file(const std::string& role, const std::string& path);
/// The same of bytes that will be written.
pages::HashedFile hashed_bytes(const std::string& role, const std::string& name, const std::string& bytes);

/// Budget, region and the figures of ISO 9283, ISO 230-2 and ISO 10360-2. The statement gets its date.
pages::Certificate certificate_of(const machine::AnyMachine& nominal, const std::vector<calibration::Measurement>& rows,
                                  const calibration::Calibration& c, const calibration::CalibrationOptions& options,
                                  calibration::Statement statement, bool noise_stated);

/// JSON `systematic`: each part, and the sizes of its effects over the workspace.
Json systematic_json(const calibration::Calibration& c, const std::vector<calibration::Systematic>& parts);
/// JSON `certificate`.
Json certificate_json(const pages::Certificate& certificate);

/// What the machine file says of its uncertainty, under [provenance]: U (k = 2) of the pose, standard uncertainties of
/// the parameters, and where their covariance is.
std::string uncertainty_note(const calibration::Calibration& c, const pages::HashedFile* covariance);

}  // namespace polypod::app
