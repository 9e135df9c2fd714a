// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "remedies.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <set>
#include <unordered_map>

#include "corrector.hpp"
#include "polypod/core/units.hpp"
#include "polypod/gcode/unroll.hpp"

namespace polypod::machining {
namespace {

// Remedies are tried out where a correction takes no longer than this many points, and until all tries together have
// taken this many.
constexpr std::size_t kTryRemediesBelow = 200'000, kMostTried = 2'000'000;

}  // namespace

bool is_quick(const Job& job, const Correction& c) {
  return cost_of(job, c) <= kTryRemediesBelow;
}

Result<std::optional<OtherSwitch>> other_unrolled(const Job& job, const CorrectOptions& options) {
  if (options.other == nullptr) return std::nullopt;
  OtherSwitch other;
  other.block_delete = !job.block_delete;
  other.fixed = true;
  const gcode::Understood& at = *options.other;
  const auto here = [&](Error error) { return tl::unexpected(at_switch(std::move(error), other.block_delete)); };
  CorrectOptions its = options;
  its.other = nullptr;
  its.again = true;
  its.keep_samples = its.keep_stock = false;
  if (options.progress) {
    its.progress = [&](const char*, double share) {
      return options.progress("correcting with the other position of block delete", share);
    };
  }
  Result<Correction> c = correct(job, at.program, at.interpretation, its);
  if (!c && !says_that_nothing_is_cut(c.error())) return here(std::move(c.error()));
  if (!c) {
    POLYPOD_ASSIGN(position, OtherPosition::of(job, at.program, at.interpretation, {}));
    POLYPOD_ASSIGN(p, predict_way(job, at.program, way_as_programmed(at.program, position.moves()), {}));
    if (const Status free = no_rapid_cuts(job, at.program, p.pass); !free) return here(free.error());
    other.cuts = false;
    other.within_tolerance = true;
    return other;
  }
  other.distance_before = c->largest_before;
  other.distance_after = c->largest_after;
  other.within_tolerance = c->within_tolerance;
  other.reason = c->reason;
  other.steep = c->after.steep;
  other.slow = c->after.slow;
  other.plunges = c->after.plunges;
  return other;
}

std::vector<std::string> remedies_for(const Job& job, const gcode::Program& program, const Accepted& accepted,
                                      const CorrectOptions& options, const Correction& result) {
  std::vector<std::string> out;
  for (const std::vector<NotJudged>* moves : {&result.before.not_judged, &result.after.not_judged}) {
    for (const NotJudged& m : *moves) {
      if (!m.remedy.empty() && std::find(out.begin(), out.end(), m.remedy) == out.end()) out.push_back(m.remedy);
    }
  }
  if (!is_quick(job, result)) return out;
  CorrectOptions quiet = options;
  quiet.keep_samples = quiet.verify = false;  // a first look; whoever follows the advice is told the whole
  // What holds after a few rounds is advice; a program on which many do not help is answered before long.
  constexpr int kRounds = 3;
  quiet.rounds = std::min(quiet.rounds, kRounds);
  std::size_t tried = 0;
  if (options.progress) {
    quiet.progress = [&](const char*, double) {
      return options.progress("trying what would help", std::min(0.99, double(tried) / kMostTried));
    };
  }
  const auto holds = [&](const Result<Correction>& c) {
    if (c) tried += static_cast<std::size_t>(c->rounds + 1) * cost_of(job, *c);
    return c && c->within_tolerance;
  };
  // A yes that leaves something out is advised as one.
  const auto but_for = [](const Correction& c) { return c.all_judged() ? "" : ", apart from what is then not judged"; };
  const bool fixed = result.other_switch && result.other_switch->fixed;
  Job wider = job;
  // The smallest of these that does: how far the failed try was off says little of what would do.
  constexpr double kWidest = 10, kWide = 500;  // times the tolerance, or um: nobody asked for more
  const double asked = units::to_um(job.tolerance);
  const double most =
      std::min(std::max(kWidest * asked, kWide), 2 * std::max(asked, units::to_um(result.largest_after)));
  const bool judged = result.before.not_judged.empty();  // else no tube is wide enough
  for (double um = asked; judged && um < most && tried < kMostTried;) {
    um = std::ceil(um * 1.25);
    wider.tolerance = units::from_um(um);
    const Result<Correction> in_wider = Corrector(wider, program, accepted, quiet).run();
    if (!holds(in_wider)) continue;
    if (fixed) {
      const Result<std::optional<OtherSwitch>> other = other_unrolled(wider, quiet);
      if (!other || !(*other)->within_tolerance) continue;
    }
    out.push_back(fmt::format("a tube of {:g} um: --tolerance {:g}{}", units::to_um(wider.tolerance),
                              units::to_um(wider.tolerance), but_for(*in_wider)));
    break;
  }
  std::unordered_map<int, bool> within;  // by line: of its first move
  for (const MoveOutcome& m : result.moves) within.emplace(m.line, m.within);
  std::vector<bool> which(result.programmed.size(), false);
  std::string lines;
  std::size_t named = 0;
  std::set<int> told;  // a cycle has many moves in one line, a subprogram is called again
  for (std::size_t i = 0; i < result.programmed.size(); ++i) {
    const int line = program.blocks[static_cast<std::size_t>(result.programmed[i].block)].line;
    const auto at = within.find(line);
    if (at == within.end() || at->second) continue;
    which[i] = true;
    if (!told.insert(line).second) continue;
    if (named++ < 8) lines += fmt::format("{}{}", lines.empty() ? "" : ", ", line);
  }
  if (named == 0) return out;
  if (fixed && !result.other_switch->within_tolerance) {
    out.push_back(
        fmt::format("`polypod correct` with block_delete = {} in the job says what would help in that position",
                    result.other_switch->block_delete));
    return out;
  }
  if (named > 8) lines += fmt::format(" and {} more", named - 8);
  lines = (named == 1 ? "line " : "lines ") + lines;
  // What bends in a corner comes from the move before it, too.
  std::vector<bool> before = which, all(which.size(), true);
  for (std::size_t i = 0; i + 1 < which.size(); ++i) before[i] = which[i] || which[i + 1];
  struct Slower {
    const std::vector<bool>& moves;
    std::string where;
    std::vector<double> factors;
  };
  for (const Slower& slower :
       {Slower{which, lines, {0.75, 0.5, 0.25, 0.1}}, Slower{before, lines + " and the moves before them", {0.5, 0.2}},
        Slower{all, "the whole program", {0.2}}}) {
    for (const double factor : slower.factors) {
      if (tried >= kMostTried) {
        out.push_back(fmt::format(
            "perhaps a smaller feed, less depth or width in {}: not tried out, for each try takes long", lines));
        return out;
      }
      Corrector corrector(job, program, accepted, quiet);
      corrector.scale_feeds(slower.moves, factor);
      const Result<Correction> with = corrector.run();
      if (!holds(with)) continue;
      double feed = 0;
      for (std::size_t i = 0; i < which.size(); ++i) {
        if (slower.moves[i]) feed = std::max(feed, result.programmed[i].feed);
      }
      out.push_back(fmt::format("a smaller feed in {}: {:.0f} % of it, {:.4g} mm/min where it is largest{}",
                                slower.where, 100 * factor, units::to_mm_per_min(feed * factor), but_for(*with)));
      return out;
    }
  }
  out.push_back(
      fmt::format("less depth or width, or a stiffer place: no smaller feed of those that were tried would do, in {} "
                  "or in the whole "
                  "program (down to a tenth and a fifth)",
                  lines));
  return out;
}

}  // namespace polypod::machining
