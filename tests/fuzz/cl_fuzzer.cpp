// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Any bytes as a CL file: refused with an id, a place and a hint, or finite steps with unit axes; and what is written
// from them for a machine is read again.
#include <cmath>
#include <cstdint>
#include <string_view>

#include "polypod/gcode/interpreter.hpp"
#include "polypod/kinematics/any_machine.hpp"
#include "polypod/post/write.hpp"
#include "require.hpp"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace polypod;
  using fuzz::require;
  const std::string_view text(reinterpret_cast<const char*>(data), size);
  (void)post::looks_like_cl(text);
  const auto path = post::parse_cl(text, "fuzz.cl");
  if (!path) {
    fuzz::require_error(path.error());
    require(!path.error().hint.empty(), "an error about a CL file has a hint");
    require(path.error().place.line >= 0 && path.error().place.column >= 0, "an error has a place");
    return 0;
  }
  double length = 0;
  Vec3 at = Vec3::Zero();
  bool moves = false;
  for (const post::Step& s : path->steps) {
    require(s.line > 0, "a step has a line");
    require(std::isfinite(s.feed) && s.feed >= 0 && std::isfinite(s.spindle_speed) && std::isfinite(s.seconds),
            "figures are finite");
    require(s.text.find('\n') == std::string::npos, "a comment is one line");
    if (!s.moves()) continue;
    require(s.tip.allFinite() && std::abs(s.axis.norm() - 1) < 1e-12, "points are finite and axes have the length 1");
    require(s.kind != post::StepKind::line || s.feed > 0, "a cut has a feed");
    if (s.kind == post::StepKind::arc) {
      require(s.centre.allFinite() && s.sweep > 0 && s.sweep < 6.2832 + 1e-3, "an arc is at most a circle");
      length += s.sweep * (s.tip - s.centre).norm();
    }
    length += moves ? (s.tip - at).norm() : 0;
    at = s.tip;
    moves = true;
  }
  require(moves, "a path moves");
  // A path of some metres for a machine without joints to search: it is written as a program that is read again.
  if (length > 2 || path->steps.size() > 200) return 0;
  static const auto machine = machine::load("delta-brno");
  const auto configuration = post::configure(*machine, "auto");
  post::PlanOptions options;
  options.tolerance = 1e-4;
  options.step = 0.05;
  const auto plan = post::plan(*configuration, *path, options);
  require(plan.has_value(), "a path is planned");
  const auto written = post::write(post::Dialect::ngc, *configuration, *path, *plan);
  require(written.has_value(), "a plan is written");
  const auto program = gcode::parse(written->text, "out.ngc");
  require(program.has_value(), "what is written is a program");
  const auto run = gcode::interpret(*program);
  if (!run) fuzz::require_error(run.error());
  require(run.has_value(), "what is written is understood");
  require(run->ended, "what is written ends");
  return 0;
}
