// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "path_answers.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cctype>

#include "polypod/core/units.hpp"

namespace polypod::pages {
namespace {

using report::fixed;
using report::Verdict;
using units::to_um;

constexpr const char* kUm = "µm";

std::string um(double metres) {
  return fixed(to_um(metres), 1) + " " + kUm;
}

}  // namespace

std::string with_sign(std::string text) {
  constexpr std::string_view kPlain = " um";
  for (std::size_t at = 0; (at = text.find(kPlain, at)) != std::string::npos; at += kPlain.size()) {
    const std::size_t end = at + kPlain.size();
    if (end == text.size() || std::isalnum(static_cast<unsigned char>(text[end])) == 0) text.replace(at + 1, 2, kUm);
  }
  return text;
}

void add_not_judged(report::Report& report, const machining::Steep& steep, const std::string& at) {
  if (!(steep.distance > 0)) return;
  report.add_verdict(
      Verdict::neutral,
      fmt::format(
          "Not judged{}: {} mm of the cut, where the force changes quickly, as where a cutter comes out of the "
          "stock. The deflection lags behind it, and the place of the change is known only to the {} mm ahead over "
          "which the engagement is averaged: the tool may be up to {} {} from the programmed path there (line {}{}).",
          at, fixed(units::to_mm(steep.length), 1), fixed(units::to_mm(steep.window), 2),
          fixed(to_um(steep.distance), 0), kUm, steep.line,
          steep.elsewhere > steep.distance ? "; elsewhere on it " + um(steep.elsewhere) : ""));
}

void add_not_judged(report::Report& report, const machining::SlowCorners& slow, const std::string& at) {
  if (slow.count == 0) return;
  report.add_verdict(Verdict::neutral, fmt::format("Not judged{}: {}.", at, slow.in_words(kUm)));
}

void add_not_judged(report::Report& report, const std::vector<machining::Plunge>& plunges, const std::string& at) {
  if (plunges.empty()) return;
  const auto worst = std::max_element(plunges.begin(), plunges.end(),
                                      [](const auto& a, const auto& b) { return a.distance < b.distance; });
  std::string others;
  constexpr std::size_t kNamed = 20;
  for (std::size_t i = 0; i < std::min(kNamed, plunges.size()); ++i) {
    others += fmt::format("{}{}", i == 0 ? "" : ", ", plunges[i].line);
  }
  if (plunges.size() > kNamed) others += fmt::format(" and {} more", plunges.size() - kNamed);
  report.add_verdict(Verdict::neutral,
                     fmt::format("Not judged{}: line {}: {}.{}", at, worst->line, with_sign(worst->why()),
                                 plunges.size() > 1 ? fmt::format(" Such plunges: lines {}.", others) : ""));
}

void add_other_position(report::Report& report, const machining::OtherSwitch& other, bool correction) {
  const char* position = other.block_delete ? "on" : "off";
  if (other.collision) {
    report.add_verdict(Verdict::bad,
                       fmt::format("With block delete {} a rapid move (G0) goes through material.", position));
    return;
  }
  if (!other.cuts) {
    report.add_verdict(Verdict::neutral, fmt::format("With block delete {} nothing is cut.", position));
    return;
  }
  if (other.within_tolerance || other.reason.empty()) {
    report.add_verdict(
        other.within_tolerance ? Verdict::good : Verdict::bad,
        fmt::format("With block delete {} the largest distance is {}{}{}.", position, um(other.distance_after),
                    other.line > 0 ? fmt::format(" (line {})", other.line) : "",
                    other.fixed && correction ? ", with a correction for that position" : ""));
  } else {
    report.add_verdict(Verdict::bad, fmt::format("With block delete {}: {}.", position, with_sign(other.reason)));
  }
  const std::string at = fmt::format(" with block delete {}", position);
  add_not_judged(report, other.steep, at);
  add_not_judged(report, other.slow, at);
  add_not_judged(report, other.plunges, at);
}

void add_error_plots(report::Report& report, const machining::Correction& c, const Tracks& tracks,
                     const std::string& rests) {
  report.add_figure(error_plot(c, tracks, &machining::Sample::distance, "distance from the programmed path"),
                    rests + (rests.empty() ? "The" : " the") +
                        " distance of the deflected tool from the programmed move in space, its ends included. Moves "
                        "that cut are laid end to end; gaps are paths through air.");
  report.add_figure(error_plot(c, tracks, &machining::Sample::normal, "normal error"),
                    "Across the path in the plane; above zero material is left, below zero the cutter gouges.");
  report.add_figure(
      error_plot(c, tracks, &machining::Sample::vertical, "vertical error"),
      "Along the tool axis, or along z of W where a ball turns in cuts; above zero the tool is too high.");
}

}  // namespace polypod::pages
