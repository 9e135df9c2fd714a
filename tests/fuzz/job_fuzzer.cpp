// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Any bytes as a job file: refused with an error, or a job whose numbers are finite and within their ranges.
#include <cmath>
#include <cstdint>
#include <string_view>

#include "memory_file.hpp"
#include "polypod/core/config.hpp"
#include "polypod/machining/job.hpp"
#include "require.hpp"

namespace {

using namespace polypod;

/// Whether the stock is small: large ones are legal, but building one takes longer than a fuzzer waits for.
bool small_stock(const config::Table& job) {
  const auto stock = job.table("stock");
  if (!stock) return true;
  for (const char* key : {"min_mm", "max_mm"}) {
    const auto values = stock->numbers(key);
    if (!values) continue;
    for (const double x : *values) {
      if (std::abs(x) > 150) return false;
    }
  }
  if (const auto contour = stock->points("contour_mm", 2)) {
    for (const std::vector<double>& p : *contour) {
      if (std::abs(p[0]) > 150 || std::abs(p[1]) > 150) return false;
    }
  }
  const auto allowance = stock->optional_number("allowance_mm", 0);
  return !stock->has("cell_mm") && (!allowance || std::abs(*allowance) < 50);
}

/// The smallest cutter makes the cells.
bool small_cutter(const config::Table& table) {
  const auto diameter = table.number("diameter_mm");
  return diameter && *diameter < 3;
}

bool quick(std::string_view text) {
  const auto table = config::parse(text, "fuzz.toml");
  if (!table) return true;
  if (!small_stock(*table)) return false;
  if (const auto cutter = table->table("cutter"); cutter && small_cutter(*cutter)) return false;
  if (const auto tools = table->tables("tool")) {
    for (const config::Table& tool : *tools) {
      if (const auto cutter = tool.table("cutter"); cutter && small_cutter(*cutter)) return false;
    }
  }
  return true;
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using fuzz::require;
  const std::string_view text(reinterpret_cast<const char*>(data), size);
  if (!quick(text)) return 0;
  const fuzz::MemoryFile file(text);
  const auto job = machining::read_job(file.path());
  if (!job) return fuzz::require_error(job.error()), 0;
  require(std::isfinite(job->tolerance) && job->tolerance > 0, "a tolerance is above 0");
  require(job->step >= 0.999e-5 && job->step <= 1.001e-2, "a step is 0.01 to 10 mm");
  require(job->X_MW.p.allFinite() && job->X_MW.R.allFinite(), "the origin is finite");
  for (const Vec3& offset : job->work_offsets) require(offset.allFinite(), "work offsets are finite");
  require(job->cutter.diameter > 0 && job->stock.columns() > 0 && job->stock.rows() > 0, "cutter and stock are there");
  return 0;
}
