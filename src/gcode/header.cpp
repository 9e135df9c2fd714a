// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/gcode/header.hpp"

#include <charconv>
#include <cmath>

#include "polypod/core/units.hpp"
#include "polypod/gcode/writer.hpp"

namespace polypod::gcode {
namespace {

constexpr std::string_view kOurs = "Polypod: ", kAnyMark = " for the static compliance of ";  // of whatever header

bool holds(std::string_view text, std::string_view part) {
  return text.find(part) != std::string_view::npos;
}

/// What follows "Polypod: " and `what` in a comment.
std::string_view behind_ours(std::string_view text, std::string_view what) {
  const std::size_t at = text.find(kOurs);
  if (at == std::string_view::npos || !text.substr(at + kOurs.size()).starts_with(what)) return {};
  return text.substr(at + kOurs.size() + what.size());
}

/// "Polypod: posture front elbow-up, tool held at C 30 deg", or either of the two.
void read_hold(std::string_view text, CorrectionHeader& out) {
  constexpr std::string_view kComma = ", ";
  const std::size_t held = text.find(kHeldText);
  const bool posture = !behind_ours(text, kPostureText).empty();
  if (posture) {
    const std::size_t begin = text.find(kOurs) + kOurs.size() + kPostureText.size();
    out.posture = text.substr(begin, held == std::string_view::npos ? held : held - kComma.size() - begin);
  }
  if (held == std::string_view::npos || (!posture && behind_ours(text, kHeldText).empty())) return;
  const char* number = text.data() + held + kHeldText.size();
  double deg = 0;
  const auto [end, code] = std::from_chars(number, text.data() + text.size(), deg);
  if (code == std::errc{} && std::isfinite(deg)) out.c = units::from_deg(deg);
}

}  // namespace

bool CorrectionHeader::names(const std::string& name) const {
  constexpr std::string_view kCut = " ...";
  const std::string was = comment_text(machine, false), is = comment_text(name, false);
  if (was.ends_with(kCut)) return is.starts_with(was.substr(0, was.size() - kCut.size()));
  return was == is;
}

std::optional<CorrectionHeader> correction_header(const std::vector<Remark>& remarks) {
  std::optional<CorrectionHeader> out;
  for (const auto& [line, text] : remarks) {
    if (!holds(text, kOurs)) continue;
    if (out && holds(text, kAnyMark)) break;
    for (const std::string_view mark : {std::string_view(kCorrectedMark), kLookedAtMark}) {
      const std::size_t at = text.find(std::string(mark) + ' ');
      if (at == std::string::npos) continue;
      out.emplace();
      out->line = line;
      out->corrected = mark == kCorrectedMark;
      out->machine = text.substr(at + mark.size() + 1);
    }
    if (!out || out->line == line) continue;
    if (const std::size_t at = text.find(kOriginText); at != std::string::npos && out->origin.empty()) {
      out->origin = text.substr(at + kOriginText.size() - 1);
      constexpr std::string_view kTube = " um, ";
      const std::size_t tube = text.find(kTube);
      if (tube < at) out->cutters = text.substr(tube + kTube.size(), at - tube - kTube.size());
    }
    if (holds(text, kDeflectText) && out->compliance.empty()) out->compliance = text;
    if (holds(text, kJointsText) && out->joints.empty()) out->joints = text;
    out->measured = out->measured || !behind_ours(text, kMeasuredText).empty();
    if (out->material.empty()) out->material = behind_ours(text, kMaterialText);
    if (out->stock.empty()) out->stock = behind_ours(text, kStockText);
    read_hold(text, *out);
  }
  return out;
}

std::optional<CorrectionHeader> correction_header(const Program& program) {
  std::vector<Remark> remarks;
  for (const Block& block : program.blocks) {
    for (const std::string_view comment : comments(block)) {
      if (!holds(comment, kOurs)) continue;
      const bool bracket = comment.front() == '(';
      remarks.push_back({block.line, std::string(comment.substr(1, comment.size() - (bracket ? 2 : 1)))});
    }
  }
  return correction_header(remarks);
}

}  // namespace polypod::gcode
