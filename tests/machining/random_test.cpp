// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Random programs in random stock: never worse, never silently unjudged, and "within the tolerance" is true at a finer
// step and with finer cells. POLYPOD_RANDOM_PROGRAMS=1000 draws so many; the daily test draws a few.
#include <fmt/format.h>
#include <gtest/gtest.h>

#include <cstdlib>
#include <numbers>

#include "machining/examples.hpp"
#include "polypod/core/random.hpp"
#include "polypod/core/units.hpp"

namespace polypod {
namespace {

using units::to_um;

constexpr int kDaily = 25;

class Draw {
 public:
  explicit Draw(std::uint64_t seed) : random_(seed) {}
  double in(double low, double high) { return low + (high - low) * random_.uniform(); }
  int pick(int n) { return std::min(n - 1, static_cast<int>(random_.uniform() * n)); }

  /// Lines, arcs, ramps and helices at several depths with rapids between them, in a block of 40 x 40 x 12 mm.
  std::string program() {
    std::string text = fmt::format("G21 G90 G17 G94\nS{} M3\n", 6000 + 1000 * pick(7));
    const int cuts = 1 + pick(3);
    for (int c = 0; c < cuts; ++c) {
      double x = in(-26, 26), y = in(-26, 26), z = -in(0.3, 2.5);
      text += fmt::format("G0 Z5\nG0 X{:.3f} Y{:.3f}\nG1 Z{:.3f} F{}\n", x, y, z, 60 + 20 * pick(5));
      text += fmt::format("F{}\n", 400 + 200 * pick(5));
      const int moves = 1 + pick(4);
      for (int m = 0; m < moves; ++m) {
        const int kind = pick(5);
        const double angle = in(0, 2 * std::numbers::pi), length = in(0.4, 18);
        if (kind < 3) {  // a line, sometimes a ramp
          if (kind == 2) z = std::max(-3.5, z - in(0, 0.3) * length * 0.3);
          x = std::clamp(x + length * std::cos(angle), -27.0, 27.0);
          y = std::clamp(y + length * std::sin(angle), -27.0, 27.0);
          text += fmt::format("G1 X{:.3f} Y{:.3f} Z{:.3f}\n", x, y, z);
        } else {  // an arc or a helix about a centre at that angle
          const double r = in(0.6, 9), cx = x + r * std::cos(angle), cy = y + r * std::sin(angle);
          const double turn = in(0.3, 6.0), end = angle + std::numbers::pi + (kind == 3 ? turn : -turn);
          const double ex = cx + r * std::cos(end), ey = cy + r * std::sin(end);
          if (pick(3) == 0) z = std::max(-3.5, z - in(0, 0.05) * r * turn);
          text += fmt::format("G{} X{:.4f} Y{:.4f} Z{:.3f} I{:.4f} J{:.4f}\n", kind == 3 ? 3 : 2, ex, ey, z, cx - x,
                              cy - y);
          x = ex;
          y = ey;
        }
      }
      text += "G0 Z5\n";
    }
    return text + "M2\n";
  }

 private:
  Random random_;
};

machining::Job job_of(Draw& draw, double cell) {
  auto e = testing::load_example("slavkovic_groove");
  e.job.cutter.diameter = draw.pick(2) == 0 ? 6e-3 : 8e-3;
  e.job.cutter.length = 30e-3;
  e.job.tolerance = units::from_um(60 + 40 * draw.pick(4));
  e.job.stock = testing::unwrap(cutting::Stock::block(Vec3(-0.02, -0.02, -0.012), Vec3(0.02, 0.02, 0), cell));
  e.job.rapid_volume = 1e-6;  // what a deflected tool leaves may stand in the way of these rapids
  return e.job;
}

/// The largest distance of the written program, corners and all, as a job with finer cells and steps sees it.
double seen_finely(const machining::Job& job, const machining::Correction& c) {
  cutting::Stock stock = job.stock;
  machining::PassOptions options;
  options.step = 0.05e-3;
  std::vector<double> start(c.programmed.size(), 1), end(c.programmed.size(), 1), along(c.programmed.size(), 0);
  std::vector<bool> at_start(c.programmed.size()), at_end(c.programmed.size());
  const auto counts = [&](std::size_t i, Vec3 off) {
    const gcode::Move& m = c.programmed[i];
    if (m.kind == gcode::MoveKind::line && m.length() > 0 && m.direction(0).z() < -0.866) {
      off -= m.direction(0) * std::min(0.0, m.direction(0).dot(off));
    }
    return off.norm();
  };
  const auto pass = machining::run_pass(job, c.program, c.commanded, stock, options, [&](const machining::Sample& s) {
    const auto k = static_cast<std::size_t>(s.move), i = static_cast<std::size_t>(c.source[k]);
    for (std::size_t n = i > 0 ? i - 1 : 0; n <= std::min(i + 1, c.programmed.size() - 1); ++n) {
      start[n] = std::min(start[n], counts(n, s.bent() - c.programmed[n].start));
      end[n] = std::min(end[n], counts(n, s.bent() - c.programmed[n].end));
    }
    if (!s.cutting) return;
    double best = 1;
    for (std::size_t n = i > 0 ? i - 1 : 0; n <= std::min(i + 1, c.programmed.size() - 1); ++n) {
      const gcode::Move& m = c.programmed[n];
      if (n != i && (!c.commanded[k].transition || m.kind == gcode::MoveKind::rapid)) continue;
      best = std::min(best, counts(n, s.bent() - m.point(m.nearest(s.bent()))));
    }
    along[i] = std::max(along[i], best);
    const bool first = k == 0 || c.source[k - 1] != c.source[k] || c.commanded[k - 1].transition;
    const bool last = k + 1 == c.source.size() || c.source[k + 1] != c.source[k] || c.commanded[k + 1].transition;
    if (c.commanded[k].transition) return;
    if (first && s.s == 0) at_start[i] = true;
    if (last && s.s >= c.commanded[k].move.length()) at_end[i] = true;
  });
  EXPECT_TRUE(pass);
  double worst = 0;
  for (std::size_t i = 0; i < along.size(); ++i) {
    worst = std::max({worst, along[i], at_start[i] ? start[i] : 0, at_end[i] ? end[i] : 0});
  }
  return worst;
}

TEST(RandomPrograms, AreNeverWorseAndWithinIsTrue) {
  const char* wanted = std::getenv("POLYPOD_RANDOM_PROGRAMS");
  const int programs = wanted != nullptr ? std::atoi(wanted) : kDaily;
  const char* from = std::getenv("POLYPOD_RANDOM_SEED");
  const int first = from != nullptr ? std::atoi(from) : 1;
  int corrected = 0, within = 0;
  for (int seed = first; seed < first + programs; ++seed) {
    Draw draw(static_cast<std::uint64_t>(seed));
    const machining::Job job = job_of(draw, 0.125e-3);
    const std::string text = draw.program();
    SCOPED_TRACE(fmt::format("seed {}, diameter {} mm, tube {} um\n{}", seed, units::to_mm(job.cutter.diameter),
                             to_um(job.tolerance), text));
    const auto program = testing::unwrap(gcode::parse(text, "random.ngc"));
    const auto run = testing::unwrap(gcode::interpret(program));
    machining::CorrectOptions options;
    options.verify = seed % 2 == 0;  // what is said without a second look must hold as well
    const auto c = machining::correct(job, program, run, options);
    if (!c) {  // refused with a reason, never in silence
      EXPECT_TRUE(c.error().id == "MC302" || c.error().id == "MC304") << to_string(c.error());
      continue;
    }
    EXPECT_LE(to_um(c->largest_distance), to_um(c->before.largest_distance) + 1);
    for (const auto& m : c->moves) {
      if (m.rewritten) {
        EXPECT_LE(to_um(m.distance_after), to_um(m.distance_before) + 1) << "line " << m.line;
      }
    }
    corrected += c->rewritten_moves > 0 ? 1 : 0;
    if (!c->within_tolerance) continue;
    ++within;
    machining::Job fine = job;
    fine.stock = testing::unwrap(cutting::Stock::block(Vec3(-0.02, -0.02, -0.012), Vec3(0.02, 0.02, 0), 0.0625e-3));
    EXPECT_LE(to_um(seen_finely(fine, *c)), to_um(job.tolerance));
  }
  RecordProperty("corrected", corrected);
  RecordProperty("within", within);
  EXPECT_GT(corrected, programs / 4);
  EXPECT_GT(within, programs / 4);
}

}  // namespace
}  // namespace polypod
