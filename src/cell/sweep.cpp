// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/cell/sweep.hpp"

#include <fmt/format.h>

#include "polypod/core/units.hpp"

namespace polypod::cell {

std::optional<double> cost_per_item(const Cost& cost, double throughput_per_min) {
  if (!(cost.running_price > 0) || !(throughput_per_min > 0)) return {};
  return units::from_per_min(cost.running_price) / throughput_per_min;
}

Result<Sweep> sweep(const std::string& file, const std::vector<Override>& overrides, const std::vector<SweepAxis>& axes,
                    const std::function<CellQuestion(const Cell&)>& ask,
                    const std::function<bool(const SweepRow&)>& each) {
  Sweep out;
  out.axes = axes;
  std::vector<std::size_t> at(axes.size(), 0);
  for (bool more = true; more;) {
    SweepRow row;
    std::vector<Override> with = overrides;
    for (std::size_t a = 0; a < axes.size(); ++a) {
      row.values.push_back(axes[a].values[at[a]]);
      with.push_back({axes[a].key, fmt::format("{:.17g}", row.values.back())});
    }
    POLYPOD_ASSIGN(c, read(file, with));
    out.name = c.name;
    CellQuestion asked = ask(c);
    asked.plan = false;
    out.seconds = out.rows.empty() || out.seconds == asked.settings.seconds ? asked.settings.seconds : 0;
    out.seeds = asked.seeds;
    const CellResult r = judge_cell(std::move(c), asked);
    if (!r.study.complete) {
      out.complete = false;
      return out;
    }
    row.simulated = r.simulated();
    row.floor_area = r.layout.floor_area;
    row.problems = r.problems;
    row.not_judged = r.not_judged;
    if (row.simulated) {
      row.throughput = r.study.throughput;
      for (const Outcome& o : r.study.outcomes) row.missed += o.missed / static_cast<double>(r.study.outcomes.size());
      row.cost_per_item = cost_per_item(r.cell.cost, row.throughput.mean);
    }
    if (row.problems.empty() && (!out.best || row.throughput.mean > out.rows[*out.best].throughput.mean))
      out.best = out.rows.size();
    out.rows.push_back(std::move(row));
    if (each && !each(out.rows.back())) {
      out.complete = false;
      return out;
    }
    std::size_t a = axes.size();
    while (a > 0 && ++at[a - 1] == axes[a - 1].values.size()) at[--a] = 0;
    more = a > 0;
  }
  return out;
}

}  // namespace polypod::cell
