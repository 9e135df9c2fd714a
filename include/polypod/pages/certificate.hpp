// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// The certificate of a calibration as a page that prints on A4.
#pragma once

#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "polypod/calibration/certificate.hpp"

namespace polypod::pages {

/// A file as it was read or written.
struct HashedFile {
  std::string role, name, sha256;  ///< "readings", "data.csv"; sha256 empty: the bytes are not known any more
};

/// What the certificate shows; everything is computed already.
struct Certificate {
  calibration::Statement statement;  ///< with its date
  calibration::CalibrationOptions options;
  bool noise_stated = false;
  std::optional<calibration::Budget> budget;
  calibration::Region region;
  std::vector<calibration::PoseAccuracy> poses;
  std::optional<calibration::LengthErrors> lengths;
  std::vector<calibration::LineErrors> lines;
  std::vector<HashedFile> files;
  std::string version, command;  ///< of Polypod; the command line that makes this page again
};

/// One self-contained HTML file, without a script: numbered sections, GUM table, U (k = 2) of the tip over three levels
/// of the workspace, validity region, figures of ISO 9283, ISO 230-2 and ISO 10360-2 where the rows have their form,
/// hashes, assumptions, lines for what is not given and for signatures. The same input gives the same bytes. Cost: some
/// thousand poses of the map.
std::string certificate_page(const machine::AnyMachine& nominal, const std::vector<calibration::Measurement>& rows,
                             const calibration::Calibration& c, const Certificate& certificate);

}  // namespace polypod::pages
