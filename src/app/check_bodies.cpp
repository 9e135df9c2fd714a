// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "check_bodies.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <memory>

#include "polypod/bodies/bodies.hpp"

namespace polypod::app {

Result<BodyNotes> watch_bodies(const std::string& file, const machining::Job& job, bool job_cuts,
                               machining::CheckOptions& options) {
  POLYPOD_ASSIGN(bodies, bodies::read(file, job.machine));
  BodyNotes notes;
  if (job_cuts) {
    // The largest stands for every tool: what is free for it is free for all.
    cutting::Cutter largest = job.cutter;
    for (const auto& [number, cutter] : job.cutters) {
      largest.diameter = std::max(largest.diameter, cutter.diameter);
      largest.length = std::max(largest.length, cutter.length);
    }
    bodies.all.push_back(bodies::cutter_body(largest.diameter, largest.length, -1, bodies.towards_spindle));
    if (!job.cutters.empty()) {
      notes.emplace_back("bodies: the cutter of every tool is taken as wide and as long as the largest of the job");
    }
    bodies.all.push_back(bodies::stock_body(job.stock.min(), job.stock.max()));
    notes.emplace_back("bodies: the stock is taken as its box before any cut; the cutter may touch it");
  } else {
    notes.emplace_back("bodies: neither cutter nor stock are judged: no job gives them");
  }
  const auto watch = std::make_shared<bodies::Watch>(job.machine, job.X_MW, std::move(bodies));
  const std::vector<std::string> of_watch = watch->notes();
  notes.insert(notes.begin(), of_watch.begin(), of_watch.end());
  options.touches = [watch](const Pose& X_MT, const machine::JointVector& q, bool continues, int tool) {
    const auto pair = watch->to(X_MT, q, continues, tool);
    const auto called = [](const std::string& name) {
      return name == "stock" ? "stock (its box before any cut)" : name;
    };
    return pair ? fmt::format("{} and {} touch", called(pair->first), called(pair->second)) : std::string();
  };
  return notes;
}

}  // namespace polypod::app
