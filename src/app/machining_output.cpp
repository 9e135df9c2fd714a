// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "machining_output.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "measured_problems.hpp"
#include "messages.hpp"
#include "polypod/core/units.hpp"
#include "polypod/kinematics/by_parameters.hpp"

namespace polypod::app {
namespace {

using units::to_mm;
using units::to_um;

/// An uncertainty in um, to two figures; above 100 um in whole um.
std::string um2(double m) {
  return to_um(m) < 99.5 ? fmt::format("{:.2g}", to_um(m)) : fmt::format("{:.0f}", to_um(m));
}

constexpr const char* kNotInTube =
    "the tube is compared with the deflection of the machine, not with the uncertainty of its position";

}  // namespace

Json spread_json(const machining::Spread& s, double scale) {
  if (s.count == 0) return {{"min", 0.0}, {"mean", 0.0}, {"max", 0.0}};
  return {{"min", s.min * scale}, {"mean", s.mean * scale}, {"max", s.max * scale}};
}

std::string spread_text(const machining::Spread& s) {
  if (s.count == 0) return "no point cuts";
  const auto um = [](double x) { return unsigned_zero(fmt::format("{:.1f}", to_um(x))); };
  return fmt::format("{} .. {} um, mean {} um", um(s.min), um(s.max), um(s.mean));
}

void add_uncertainty(Json& document, const machining::Uncertainty& u) {
  using kinematics::kCoverageFactor;
  const auto mean_and_max = [](const machining::Spread& s) {
    return Json{{"mean", to_um(s.mean)}, {"max", to_um(s.max)}};
  };
  if (u.compliances) {
    document["compliance_uncertainty_um"] = {{"k", kCoverageFactor},
                                             {"points", u.compliances->across.count},
                                             {"normal", mean_and_max(u.compliances->normal)},
                                             {"across_path", mean_and_max(u.compliances->across)}};
  }
  if (u.reach) {
    document["within_tolerance_with_uncertainty"] = u.reach->within;
    document["reach_with_uncertainty"] = {{"line", u.reach->line > 0 ? Json(u.reach->line) : Json()},
                                          {"distance_um", to_um(u.reach->distance)},
                                          {"U_um", to_um(u.reach->U)},
                                          {"sum_um", to_um(u.reach->total())}};
  }
  if (u.place) {
    document["place_uncertainty_um"] = mean_and_max(u.place->tip);
    document["place_uncertainty_um"].update(
        {{"k", kCoverageFactor}, {"points", u.place->tip.count}, {"line", u.place->line}, {"note", kNotInTube}});
  }
}

void print_uncertainty(const machining::Uncertainty& u, const machining::Reach* reach) {
  if (u.compliances) {
    fmt::print("compliances    U (k = 2) {} um of the normal error on average, up to {} um (at {} points)\n",
               um2(u.compliances->normal.mean), um2(u.compliances->normal.max), u.compliances->normal.count);
  }
  if (reach != nullptr) {
    fmt::print("               with it the tool may come to {:.1f} um {}: {} the tolerance\n", to_um(reach->total()),
               reach->where(), reach->within ? "within" : "beyond");
  }
  if (u.place) {
    fmt::print("machine        U (k = 2) {} um of the tip's place on average, up to {} um (line {}): {}\n",
               um2(u.place->tip.mean), um2(u.place->tip.max), u.place->line, kNotInTube);
  }
}

void add_map(Json& document, const machining::Job& job, const machining::MapBand& band) {
  if (!job.measured) return;
  const auto mean_and_max = [](const machining::Spread& s) {
    return Json{{"mean", to_um(s.mean)}, {"max", to_um(s.max)}};
  };
  const statics::MeasuredMap& map = job.measured->map;
  document["measured_compliance"] = {{"files", job.measured->files},
                                     {"points", map.size()},
                                     {"correlation_length_mm", to_mm(map.correlation_length())},
                                     {"left_out", job.measured->left_out},
                                     {"unused_columns", job.measured->unused_columns},
                                     {"doubts", problems_json(job.measured->doubts)}};
  document["map_band_95_um"] = mean_and_max(band.normal);
  if (band.joints.count > 0) document["model_difference_um"] = mean_and_max(band.joints);
}

void print_map(const machining::Job& job, const machining::MapBand& band) {
  if (!job.measured) return;
  const statics::MeasuredMap& map = job.measured->map;
  fmt::print("compliance     interpolated from {} measured points, correlation length {:.0f} mm\n", map.size(),
             to_mm(map.correlation_length()));
  if (job.measured->left_out > 0) {
    fmt::print("               {} points do not have all six compliances and are left out\n", job.measured->left_out);
  }
  print_doubts(job.measured->doubts);
  print_unused(job.measured->unused_columns);
  if (band.normal.count > 0) {
    fmt::print("its band       +- {:.1f} um of the normal error, up to {:.1f} um (95 %, at {} points)\n",
               to_um(band.normal.mean), to_um(band.normal.max), band.normal.count);
  }
  if (band.joints.count > 0) {
    fmt::print("joints' model  deflections {:.1f} um from these, up to {:.1f} um\n", to_um(band.joints.mean),
               to_um(band.joints.max));
  }
}

Json not_judged_json(const std::vector<machining::NotJudged>& moves, const std::vector<machining::Plunge>& plunges) {
  Json out = Json::array();
  for (const machining::NotJudged& m : moves) out.push_back({{"line", m.line}, {"why", m.why}});
  for (const machining::Plunge& p : plunges) {
    out.push_back({{"line", p.line},
                   {"why", p.why()},
                   {"axial_deflection_um", to_um(p.held_back)},
                   {"remaining_um", to_um(p.remaining)},
                   {"dwell_s", p.dwell},
                   {"dwell_needed_s", p.needed > 0 ? Json(p.needed) : Json()}});
  }
  return out;
}

void print_plunges(const std::vector<machining::Plunge>& plunges, const machining::Plunge& within, double shown,
                   const std::string& at) {
  if (to_um(within.distance) >= to_um(shown) + 1) {
    fmt::print("plunges        the thrust may leave up to {:.0f} um at the end of line {}, inside the tube{}\n",
               to_um(within.distance), within.line, at);
  }
  if (plunges.empty()) return;
  const auto worst = std::max_element(plunges.begin(), plunges.end(),
                                      [](const auto& a, const auto& b) { return a.distance < b.distance; });
  fmt::print("not judged{}: line {}: {}{}\n", at, worst->line, worst->why(),
             plunges.size() > 1 ? fmt::format("; likewise {} more, see --json", plunges.size() - 1) : "");
}

Json steep_json(const machining::Steep& s) {
  return {{"length_mm", to_mm(s.length)},
          {"line", s.line},
          {"distance_um", to_um(s.distance)},
          {"window_mm", to_mm(s.window)},
          {"largest_within_um", to_um(s.within)},
          {"line_within", s.within > 0 ? Json(s.within_line) : Json()},
          {"elsewhere_on_line_um", to_um(s.elsewhere)}};
}

void print_steep(const machining::Steep& s, double shown, const std::string& at) {
  if (to_um(s.within) >= to_um(shown) + 1) {
    fmt::print(
        "quick changes  where the force changes quickly the deflection may differ{}: up to {:.0f} um from the "
        "programmed path, inside the tube (line {})\n",
        at, to_um(s.within), s.within_line);
  }
  if (!(s.distance > 0)) return;
  fmt::print(
      "not judged{}: {:.1f} mm of the cut, where the force changes quickly: the deflection lags behind it, and the "
      "place of the change is known only to the {:.2f} mm ahead over which the engagement is averaged; the tool may be "
      "up to {:.0f} um from the "
      "programmed path there (line {}{})\n",
      at, to_mm(s.length), to_mm(s.window), to_um(s.distance), s.line,
      s.elsewhere > s.distance ? fmt::format("; elsewhere on it {:.1f} um", to_um(s.elsewhere)) : "");
}

Json slow_corners_json(const machining::SlowCorners& s) {
  return {{"count", s.count},
          {"line", s.count > 0 ? Json(s.line) : Json()},
          {"distance_um", to_um(s.distance)},
          {"feed_share", s.count > 0 ? Json(s.share) : Json()},
          {"largest_within_um", to_um(s.within)},
          {"line_within", s.within > 0 ? Json(s.within_line) : Json()}};
}

void print_slow_corners(const machining::SlowCorners& s, double shown, const std::string& at) {
  if (to_um(s.within) >= to_um(shown) + 1) {
    fmt::print(
        "slow corners   where the controller slows down, chips are thinner{}: up to {:.0f} um from the programmed "
        "path, "
        "inside the tube (line {})\n",
        at, to_um(s.within), s.within_line);
  }
  if (s.count == 0) return;
  fmt::print("not judged{}: {}\n", at, s.in_words());
}

double to_a_millionth(double x) {
  return std::round(x * 1e6) / 1e6;
}

double rounded_um(double m) {
  return to_a_millionth(to_um(m));
}

Json rounded_mm(const Vec3& p) {
  return Json::array({to_a_millionth(to_mm(p.x())), to_a_millionth(to_mm(p.y())), to_a_millionth(to_mm(p.z()))});
}

std::string answer_in_words(const machining::Correction& c, const std::optional<machining::Reach>& reach) {
  return c.answer(reach && !reach->within ? " by the compliances as identified" : "");
}

void print_answer(const machining::Correction& c, const std::optional<machining::Reach>& reach) {
  print_steep(c.after.steep, c.largest_after);
  print_slow_corners(c.after.slow, c.largest_after);
  print_plunges(c.after.plunges, c.after.plunge_within, c.largest_after);
  if (!c.within_tolerance) return;
  fmt::print("{}\n", answer_in_words(c, reach));
  if (!reach) return;
  fmt::print("{} their uncertainty (U {} um, k = 2) {}; the tool may come to {:.1f} um\n",
             reach->within ? "     and" : "     but", um2(reach->U),
             reach->within ? "stays inside the tube, too, nearest to it " + reach->where()
                           : "reaches beyond the tube " + reach->where(),
             to_um(reach->total()));
}

Json short_blocks_json(const machining::ShortBlocks& s) {
  const auto some = [&](Json value) { return s.count > 0 ? std::move(value) : Json(); };
  return {{"count", s.count},
          {"of", s.written},
          {"line", some(s.line)},
          {"line_out", some(s.written_line)},
          {"shortest_mm", some(to_mm(s.length))},
          {"shortest_ms", some(s.time / units::from_ms(1))}};
}

void print_short_blocks(const machining::ShortBlocks& s, bool written) {
  if (s.count == 0) return;
  fmt::print(
      "short blocks   {} of {} blocks of rewritten moves are shorter than [controller] of the job asks, because shared "
      "corners would leave the tube there (least {:.3f} mm, {:.1f} ms; the first is of line {}{})\n",
      s.count, s.written, to_mm(s.length), s.time / units::from_ms(1), s.line,
      written ? fmt::format(", in line {} of the corrected program", s.written_line) : "");
}

void print_not_judged(const std::vector<machining::NotJudged>& moves) {
  for (const machining::NotJudged& m : moves) fmt::print("not judged: line {}: {}\n", m.line, m.why);
}

void add_other_switch(Json& document, const std::optional<machining::OtherSwitch>& other, bool trust) {
  if (!other) return;
  document["other_block_delete"] = {{"block_delete", other->block_delete},
                                    {"cuts", other->cuts},
                                    {"fixed", other->fixed},
                                    {"collision", other->collision ? Json(to_string(*other->collision)) : Json()},
                                    {"distance_before_um", to_um(other->distance_before)},
                                    {"distance_after_um", to_um(other->distance_after)},
                                    {"line", other->line > 0 ? Json(other->line) : Json()},
                                    {"within_tolerance", other->within_tolerance && trust},
                                    {"not_judged", not_judged_json({}, other->plunges)},
                                    {"steep_not_judged", steep_json(other->steep)},
                                    {"slow_corners_not_judged", slow_corners_json(other->slow)}};
}

std::string kept_free(const machining::Job& job, double distance) {
  const double free = machining::resolution(job);
  if (distance > job.tolerance || distance <= job.tolerance - free) return "";
  return fmt::format(", of which {:.1f} um are kept free for what the cells of the stock leave open", to_um(free));
}

void print_other_switch(const std::optional<machining::OtherSwitch>& other, bool trust, bool correction) {
  if (!other) return;
  const char* position = other->block_delete ? "on" : "off";
  if (other->collision) {
    fmt::print("block delete   {}: a rapid move (G0) goes through material\n", position);
    return;
  }
  if (!other->cuts) {
    fmt::print("block delete   {}: nothing is cut\n", position);
    return;
  }
  const std::string verdict = !other->within_tolerance
                                  ? other->reason.empty() ? "beyond the tolerance" : "but " + other->reason
                              : trust ? "within the tolerance"
                                      : "by a doubtful measurement, not judged against the tolerance";
  const std::string where = other->line > 0 ? fmt::format(" (line {})", other->line) : "";
  fmt::print("block delete   {}{}: up to {:.1f} um from the programmed path{}, {}\n", position,
             other->fixed && correction ? ", with a correction for that position, which is not the one written" : "",
             to_um(other->distance_after), where, verdict);
  const std::string at = fmt::format(", with block delete {}", other->block_delete ? "on" : "off");
  print_steep(other->steep, other->distance_after, at);
  print_slow_corners(other->slow, other->distance_after, at);
  print_plunges(other->plunges, {}, other->distance_after, at);
}

void print_modes(const machining::Correction& c) {
  const machining::PathModes& m = c.modes;
  fmt::print("corners        rounded by the controller by up to {:.1f} um, after {:.1f} um\n", to_um(m.corner_before),
             to_um(m.corner_after));
  if (!m.written.empty()) {
    fmt::print("path control   {} was written, which the tolerance needs\n", m.written);
    for (const int line : m.replaced) fmt::print("               it replaces the mode of line {}\n", line);
  }
  if (m.chords > 0) {
    fmt::print("               {} arc{} written as chords, so that the controller need not stop\n", m.chords,
               m.chords > 1 ? "s" : "");
  }
  fmt::print("time           {:.1f} s, after {:.1f} s\n", m.time_before, m.time_after);
}

void print_outside(const machining::Correction& c) {
  constexpr int kMostOutside = 20;
  int outside = 0;
  for (const machining::MoveOutcome& m : c.moves) {
    if (m.within || ++outside > kMostOutside) continue;
    const auto corner = [](double deviation) {
      return deviation > 0 ? fmt::format(" and {:.1f} um at its corner", to_um(deviation)) : "";
    };
    fmt::print("outside: line {}: {:.1f} um{}, before {:.1f} um{}{}\n", m.line, to_um(m.distance_after),
               corner(m.corner_after), to_um(m.distance_before), corner(m.corner_before),
               m.rewritten ? "" : ", as it was");
  }
  if (outside > kMostOutside) fmt::print("outside: {} lines more, see --json\n", outside - kMostOutside);
}

Json confidence_json(const machining::Confidence& c) {
  Json walls = Json::array(), inputs = Json::array();
  for (const machining::WallConfidence& w : c.walls) {
    walls.push_back({{"line", w.line},
                     {"band_95_um", Json::array({to_um(w.low), to_um(w.high)})},
                     {"sd_um", to_um(w.sd)},
                     {"room_um", to_um(w.room)},
                     {"probability", w.probability}});
  }
  for (const machining::UncertainInput& input : c.inputs) {
    inputs.push_back({{"name", input.name},
                      {"share_percent", 100 * input.share},
                      {"least_probability_if_halved", input.least_if_halved}});
  }
  return {{"walls", walls}, {"inputs", inputs}, {"least_probability", c.least}, {"line", c.line}, {"draws", c.draws}};
}

void print_confidence(const machining::Confidence& c) {
  const auto percent = [&](double p) { return c.percent(p); };
  fmt::print("how likely the walls are inside, as far as the given inputs are uncertain:\n");
  constexpr std::size_t kMost = 20;
  std::vector<machining::WallConfidence> walls = c.walls;
  std::stable_sort(walls.begin(), walls.end(),
                   [](const auto& a, const auto& b) { return a.probability < b.probability; });
  for (std::size_t i = 0; i < std::min(kMost, walls.size()); ++i) {
    const machining::WallConfidence& w = walls[i];
    const auto um = [](double x) { return unsigned_zero(fmt::format("{:.1f}", to_um(x))); };
    fmt::print("  line {:>4}  normal error {:>7} .. {:<7} um (95 %), room {} um: {}\n", w.line, um(w.low), um(w.high),
               um(w.room), percent(w.probability));
  }
  if (walls.size() > kMost) fmt::print("  and {} walls more, likelier than these\n", walls.size() - kMost);
  if (c.inputs.empty() || c.walls.empty()) return;
  const machining::UncertainInput& first = c.inputs.front();
  fmt::print("know better first: {}, {:.0f} % of the variance{}{}\n", first.name, 100 * first.share,
             first.share > 1 ? " (others cancel a part of it)" : "",
             percent(c.least) == percent(first.least_if_halved)
                 ? ""
                 : fmt::format("; known twice as well, the least likely wall would be inside with {}",
                               percent(first.least_if_halved)));
}

}  // namespace polypod::app
