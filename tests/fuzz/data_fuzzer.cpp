// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Any bytes as the files that runs leave and instruments write: tables of displacements, places and forces,
// covariances, and a stock, as it is and with a right beginning and checksum. They are refused with an error, or give
// numbers that are finite.
#include <cmath>
#include <cstdint>
#include <string>

#include "memory_file.hpp"
#include "polypod/calibration/certificate.hpp"
#include "polypod/calibration/measurement.hpp"
#include "polypod/cutting/identify.hpp"
#include "polypod/cutting/stock.hpp"
#include "polypod/statics/covariance.hpp"
#include "polypod/statics/identify.hpp"
#include "require.hpp"

namespace {

using namespace polypod;

using fuzz::require;
using fuzz::require_error;

void check_stock(const std::string& bytes) {
  const fuzz::MemoryFile file(bytes);
  const auto stock = cutting::read_stock(file.path());
  if (!stock) return require_error(stock.error());
  require(std::isfinite(stock->cell()) && stock->cell() > 0 && stock->columns() > 0 && stock->rows() > 0,
          "a stock has cells");
  require(std::isfinite(stock->top()) && std::isfinite(stock->bottom()) && stock->bottom() <= stock->top(),
          "a stock has a height");
  for (const float layer : stock->layers()) {
    require(layer <= static_cast<float>(stock->top()), "heights are numbers, none above the top, -infinity for none");
  }
}

std::string with_checksum(std::string bytes) {
  constexpr char kBegin[] = {'P', 'O', 'L', 'Y', 'S', 'T', 'O', 'K', 1, 0, 0, 0};
  bytes.replace(0, std::min(sizeof kBegin, bytes.size()), kBegin, sizeof kBegin);
  std::uint64_t hash = 14695981039346656037ull;
  for (const char c : bytes) hash = (hash ^ static_cast<unsigned char>(c)) * 1099511628211ull;
  return bytes.append(reinterpret_cast<const char*>(&hash), sizeof hash);
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const std::string bytes(reinterpret_cast<const char*>(data), size);
  check_stock(bytes);
  check_stock(with_checksum(bytes));
  const fuzz::MemoryFile file(bytes);
  const auto points = statics::read_displacements(file.path());
  if (!points) {
    require_error(points.error());
  } else {
    require(!points->empty(), "a table without points is refused");
    for (const statics::MeasuredPoint& point : *points) {
      require(point.X_MT.p.allFinite() && point.X_MT.R.allFinite() && point.displacement.allFinite() && point.force > 0,
              "points are finite");
    }
  }
  static const machine::AnyMachine arm = *machine::load("lola50");
  const auto rows = calibration::read_measurements(arm, file.path());
  if (!rows) {
    require_error(rows.error());
  } else {
    require(!rows->empty(), "a table without rows is refused");
    for (const calibration::Measurement& row : *rows) {
      require(row.q.allFinite() && row.X_SR.p.allFinite() && row.X_SR.R.allFinite() && row.anchor_S.allFinite() &&
                  row.normal_S.allFinite() && std::isfinite(row.reading) && row.noise >= 0,
              "measurements are finite");
    }
  }
  for (const auto& covariance :
       {statics::read_covariance(arm, file.path()), calibration::read_covariance(arm, file.path())}) {
    if (!covariance) {
      require_error(covariance.error());
    } else {
      require(covariance->allFinite() && covariance->diagonal().minCoeff() >= 0, "a covariance is finite");
    }
  }
  statics::names_compliances(bytes);
  const auto forces = cutting::read_forces(cutting::Cutter{"", 8e-3, 4, 0.5, 0.02}, file.path());
  if (!forces) return require_error(forces.error()), 0;
  for (const cutting::MeasuredForce& force : forces->cuts) {
    require(force.mean.allFinite() && force.feed_per_tooth > 0 && force.ap > 0 && force.ae > 0, "forces are finite");
  }
  return 0;
}
