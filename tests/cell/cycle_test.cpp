// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Times of ways and the cycle as a whole.
#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <fstream>
#include <iterator>
#include <set>

#include "cells.hpp"
#include "paths.hpp"
#include "polypod/cell/judge.hpp"
#include "polypod/cell/reach.hpp"
#include "polypod/cell/simulate.hpp"
#include "polypod/core/statistics.hpp"
#include "polypod/motion/cycles.hpp"

namespace polypod::cell {
namespace {

const Cell& kozubik() {
  static const Cell kCell = *read(test::source("cells/kozubik/cell.toml"));
  return kCell;
}
const Motions& kozubik_motions() {
  static const Motions kMotions = motions(kozubik());
  return kMotions;
}
Cell cell_of(std::string text, const std::string& from = "", const std::string& to = "") {
  for (std::size_t at = from.empty() ? std::string::npos : text.find(from); at != std::string::npos;
       at = text.find(from, at + to.size()))
    text.replace(at, from.size(), to);
  auto cell = from_text(text, "cell.toml");
  if (!cell) ADD_FAILURE() << to_string(cell.error());
  return std::move(*cell);
}
RunSettings for_seconds(double seconds) {
  RunSettings s;
  s.seconds = seconds;
  return s;
}

TEST(CellTimes, TrapezoidsOfSpeed) {
  // 1 m at 1 m/s and 2 m/s2: half a second up, half a second down, over 0.25 m each; 0.5 m at speed.
  EXPECT_DOUBLE_EQ(trapezoid_time(1, 1, 2), 1.5);
  // 0.18 m: a triangle, 2 sqrt(0.18 / 2).
  EXPECT_DOUBLE_EQ(trapezoid_time(0.18, 1, 2), 0.6);
  // The two agree where the speed is just reached.
  EXPECT_DOUBLE_EQ(trapezoid_time(0.5, 1, 2), 1.0);
  EXPECT_EQ(trapezoid_time(0, 1, 2), 0);
}

TEST(CellTimes, TheToolPointsWhereItIsTold) {
  const Pose down = tool_pose({1, 2, 3}, std::acos(-1.0) / 2, 0.7, 0);
  EXPECT_NEAR((down.R.col(2) - Vec3(0, 0, 1)).norm(), 0, 1e-12) << "z_T points back to the flange";
  const Pose level = tool_pose({0, 0, 0}, 0, 0, 0);
  EXPECT_NEAR((level.R.col(2) - Vec3(-1, 0, 0)).norm(), 0, 1e-12);
  for (const double roll : {0.0, 1.0, 3.0}) EXPECT_NEAR(tool_pose({0, 0, 0}, 0.4, 1.1, roll).R.determinant(), 1, 1e-12);
  // Turned by 180 deg about its axis, what stood upright hangs: y_T turns round.
  EXPECT_NEAR((tool_pose({0, 0, 0}, 0, 0, std::acos(-1.0)).R.col(1) - Vec3(0, -1, 0)).norm(), 0, 1e-12);
}

TEST(CellTimes, EveryPlaceOfTheSeedsCellIsInReach) {
  for (const Problem& p : kozubik_motions().problems) ADD_FAILURE() << p.detail;
  EXPECT_GT(kozubik_motions().judged, 90);
  // The stands are what they say: the arm's forward kinematics gives the slot.
  const Machine& arm = kozubik().machines[1];
  for (std::size_t k = 0; k < 18; ++k) {
    const Stand& s = kozubik_motions().stands[1][0][k];
    const auto f = kinematics::forward(arm.model, s.joints);
    ASSERT_FALSE(f.poses.empty());
    EXPECT_NEAR(((arm.X_CM * f.poses[0]).p - kozubik().spots[0].slots[k]).norm(), 0, 1e-9);
    EXPECT_EQ(kinematics::violations(arm.model, f.poses[0], s.joints), 0U);
  }
}

TEST(CellTimes, BetweenNodesTheTableIsNearToThePlannedCycle) {
  const Cell& cell = kozubik();
  const Machine& delta = cell.machines[0];
  const std::size_t fill = 4;
  const PickTable& table = kozubik_motions().picks[fill];
  const Pose X_MC = delta.X_CM.inverse();
  // Plans of neighbours differ by how well their search ends: 3 % at the nodes, and as much between them.
  constexpr double kBetween = 0.05;
  for (const double u : {0.13, 0.37, 0.61, 0.9}) {
    for (const double v : {0.2, 0.7}) {
      const double along = table.low + u * (table.high - table.low),
                   across = table.across_low + v * (table.across_high - table.across_low);
      Vec3 pick = cell.conveyors[0].point(along, across);
      pick.z() += cell.items[0].height;
      const Vec3 slot = cell.spots[1].slots[0];
      const auto plan = motion::plan(
          delta.model,
          {X_MC * pick, X_MC * Vec3(slot.x(), slot.y(), cell.tasks[fill].release), delta.lift, delta.blend},
          limits_of(delta));
      ASSERT_TRUE(plan);
      EXPECT_NEAR(table.time(0, along, across), plan->time, kBetween * plan->time) << u << " " << v;
    }
  }
}

TEST(CellTimes, PublishedPickerCycle) {
  // ABB IRB 340: 150 cycles a minute of 25, 305, 25 mm there and back at up to 10 m/s and 100 m/s2 (published); nothing
  // is published of its jerk and its drives, which do not limit here.
  const auto picker = machine::load("delta-picker");
  ASSERT_TRUE(picker);
  motion::MotionLimits limits;
  limits.tool = {10, 100, 1e5};
  limits.drive = {1e3, 1e5, 1e8};
  const auto plan = motion::plan(*picker, {{-0.1525, 0, 0.85}, {0.1525, 0, 0.85}, 0.025, 0.025}, limits);
  ASSERT_TRUE(plan) << to_string(plan.error());
  EXPECT_LT(2 * plan->time, 60.0 / 150);
  // No faster than a way of 305 mm at that acceleration: 2 sqrt(d / a).
  EXPECT_GT(plan->time, 2 * std::sqrt(0.305 / 100));
}

TEST(CellCycle, ASlowSourceIsServedWhole) {
  const Cell cell = cell_of(test::kPicking);
  const Motions m = motions(cell);
  ASSERT_TRUE(m.problems.empty()) << m.problems.front().detail;
  const Outcome o = run(cell, m, for_seconds(300));
  // One a second from 0 s on, the window is 7 s behind the source: 301 come in 300 s, what is on the way is 7 or 8.
  EXPECT_EQ(o.fed, 301);
  EXPECT_EQ(o.missed, 0);
  EXPECT_NEAR(o.placed, 301 - 8, 1);
  EXPECT_GE(o.fed - o.placed - o.remaining, 0) << "none is there twice";
  EXPECT_LE(o.fed - o.placed - o.remaining, 1) << "one may be in the air";
  // Busy: the way there, the way back, and both grips, for each item; the table's times are the only ones.
  const double each = o.machines[0].busy / o.placed;
  double least = 1e9, most = 0;
  for (const auto& row : m.picks[0].times) {
    least = std::min(least, *std::min_element(row.begin(), row.end()));
    most = std::max(most, *std::max_element(row.begin(), row.end()));
  }
  const double matching = 0.1 / cell.machines[0].tool_acceleration;
  EXPECT_GT(each, 2 * least + 0.1 + matching);
  EXPECT_LT(each, 2 * most + 0.1 + matching + 0.02);
}

TEST(CellCycle, AFastSourceIsMissedAtTheRateOfTheMachine) {
  const Cell cell = cell_of(test::kPicking, "per_minute = 60", "per_minute = 600");
  const Motions m = motions(cell);
  const Outcome o = run(cell, m, for_seconds(300));
  EXPECT_GT(o.missed, 1000);
  // The machine never waits once the first item has come: its rate is that of its ways.
  EXPECT_GT(o.machines[0].busy / o.seconds, 0.95);
  EXPECT_NEAR(o.fed, o.placed + o.missed + o.remaining, 1);
}

// What leaves on an outfeed is not missed; a belt that is picked from is no outfeed.
TEST(CellCycle, ItemsLeaveOnAnOutfeed) {
  std::string text = test::kPicking;
  text.replace(text.find("per_minute = 60"), 15, "per_minute = 6000");
  const std::string onto =
      "speed_mm_per_s = 100\nonto = \"out\"\ndrop_mm = 50\n[[conveyor]]\nname = \"out\"\n"
      "at_mm = [1600, 0, 900]\nlength_mm = 600\nwidth_mm = 400\nspeed_mm_per_s = 100\n";
  text.replace(text.find("speed_mm_per_s = 100\n"), 21, onto);
  const auto dead_end = from_text(text, "small.toml");
  ASSERT_TRUE(dead_end) << to_string(dead_end.error());
  text.replace(text.find("name = \"out\"\n"), 13, "name = \"out\"\noutfeed = true\n");
  const auto outfeed = from_text(text, "small.toml");
  ASSERT_TRUE(outfeed) << to_string(outfeed.error());
  const Outcome missed = run(*dead_end, motions(*dead_end), for_seconds(60));
  const Outcome left = run(*outfeed, motions(*outfeed), for_seconds(60));
  EXPECT_GT(missed.missed, 100);
  EXPECT_EQ(missed.left, 0);
  EXPECT_EQ(left.missed, 0);
  EXPECT_EQ(left.left, missed.missed);
  EXPECT_EQ(left.fed, left.placed + left.left + left.remaining) << "where they are";
  text = test::kPicking;
  text.replace(text.find("speed_mm_per_s = 100\n"), 21, "speed_mm_per_s = 100\noutfeed = true\n");
  const auto picked = from_text(text, "small.toml");
  ASSERT_FALSE(picked);
  EXPECT_EQ(picked.error().id, "CE107");
}

TEST(CellCycle, ASensorStopsTheBeltInsteadOfMissing) {
  const Cell cell = cell_of(cell_of(test::kPicking).name.empty() ? "" : std::string(test::kPicking),
                            "speed_mm_per_s = 100", "speed_mm_per_s = 100\nsensor_mm = 890");
  Cell fast = cell;
  fast.sources[0].rate = 10;
  const Motions m = motions(fast);
  const Outcome o = run(fast, m, for_seconds(300));
  EXPECT_EQ(o.missed, 0);
  EXPECT_LT(o.belts[0].running, 299);
  EXPECT_GT(o.placed, 250);
  // Ten a second are offered: what does not come while the belt stands is counted, to one.
  EXPECT_GT(o.held[0], 100);
  EXPECT_NEAR(o.held[0] * 10, o.lost[0], 1);
  EXPECT_NEAR(o.fed + o.lost[0], 3000, 15);
  EXPECT_EQ(run(cell_of(test::kPicking), m, for_seconds(300)).lost[0], 0);
}

TEST(CellCycle, AListThatComesLateIsCounted) {
  Cell cell = cell_of(test::kPicking, "speed_mm_per_s = 100", "speed_mm_per_s = 100\nsensor_mm = 890");
  cell.sources[0].arrival = Source::Arrival::list;
  for (int k = 0; k < 1000; ++k) cell.sources[0].times.push_back(0.1 * k);
  const Outcome o = run(cell, motions(cell), for_seconds(100));
  EXPECT_GT(o.lost[0], 400);
  // The sensor lies 8.9 s after the source: what was due before that came in time.
  EXPECT_LE(o.lost[0], 1000 - 80);
}

TEST(CellCycle, AStopHoldsNoSourceBack) {
  Cell cell = cell_of(test::kPicking);
  cell.commands = {{0, Order::start}, {50, Order::stop}, {150, Order::start}};
  const Outcome o = run(cell, motions(cell), for_seconds(300));
  EXPECT_NEAR(o.held[0], 0, 1e-9);
  EXPECT_EQ(o.lost[0], 0);
}

TEST(CellCycle, ACameraThatIsTooSlowDoesNotSee) {
  std::string text = test::kPicking;
  text +=
      "[[camera]]\nname = \"eye\"\nconveyor = \"A\"\nat_mm = 300\nfield_mm = [60, 300]\ninterval_ms = 1000\ndelay_ms = "
      "50\n";
  text.replace(text.find("at_mm = 0 #source"), 9, "at_mm = 15");
  const Cell cell = cell_of(text);
  const Motions m = motions(cell);
  const Outcome o = run(cell, m, for_seconds(120));
  // The field less the item is 20 mm, 0.2 s of the belt: one picture a second sees none of the items, which come in
  // step with it and lie whole from 2.9 s on, after each picture.
  EXPECT_EQ(o.placed, 0);
  EXPECT_GT(o.unseen, 100);
  // Ten pictures a second see all.
  const Cell fast = cell_of(text, "interval_ms = 1000", "interval_ms = 100");
  const Outcome seen = run(fast, motions(fast), for_seconds(120));
  EXPECT_EQ(seen.unseen, 0);
  EXPECT_GT(seen.placed, 100);
  // Items of 40 mm lie anywhere between -50 and 50 mm; across 100 mm of field those between -30 and 30 are seen whole.
  const std::string narrow_field = "field_mm = [60, 100]";
  text.replace(text.find("field_mm = [60, 300]"), narrow_field.size(), narrow_field);
  const Cell narrow = cell_of(text, "interval_ms = 1000", "interval_ms = 100");
  const Outcome part = run(narrow, motions(narrow), for_seconds(600));
  const double items = part.unseen + part.placed;
  EXPECT_NEAR(part.unseen / items, 0.4, 3 * std::sqrt(0.4 * 0.6 / items));
}

TEST(CellCycle, TheSeedsFourteenSteps) {
  Cell cell = kozubik();
  cell.commands = {{1, Order::start}, {100, Order::serve}, {300, Order::end}};
  RunSettings s = for_seconds(500);
  s.record = true;
  const Outcome o = run(cell, kozubik_motions(), s);
  EXPECT_EQ(o.served, 1);
  EXPECT_EQ(o.missed, 0);
  EXPECT_EQ(o.state, "waiting");
  // Both tins are full again, and back in the pallet: what was poured out was put in.
  EXPECT_EQ(o.emptied * 12, o.placed);
  EXPECT_EQ(o.remaining, 0);
  EXPECT_EQ(o.filled * 12, o.placed);
  EXPECT_EQ(o.done[0], 2) << "returned";
  EXPECT_EQ(o.done[1], 1) << "served";
  EXPECT_EQ(o.done[3], 3) << "two at the start and one for the served one";
  // The steps happen in their order.
  std::vector<int> first;
  for (const Event& e : o.events)
    if (e.step > 0 && std::find(first.begin(), first.end(), e.step) == first.end()) first.push_back(e.step);
  EXPECT_EQ(first, (std::vector<int>{1, 2, 3, 4, 5, 6, 8, 7, 9, 10, 11}));
  EXPECT_FALSE(o.stands_since);
}

// The shipped shift has all of them, and is the seed's cell but for tins, commands and time.
TEST(CellCycle, TheShiftHasAllFourteenSteps) {
  const auto shift = read(test::source("cells/kozubik/shift.toml"));
  ASSERT_TRUE(shift);
  RunSettings s = for_seconds(60 * shift->minutes);
  s.record = true;
  const Outcome o = run(*shift, motions(*shift), s);
  std::set<int> steps;
  for (const Event& e : o.events) steps.insert(e.step);
  for (int step = 1; step <= 14; ++step) EXPECT_TRUE(steps.contains(step)) << step;
  EXPECT_EQ(o.missed, 0);
  EXPECT_FALSE(o.stands_since);
  // All else is the seed's: behind the head of the file the two differ in tins and commands alone.
  const auto body = [](const char* file) {
    std::ifstream in(test::source(file));
    std::string out, line;
    bool head = true, command = false;
    while (std::getline(in, line)) {
      if (line.starts_with("[")) command = line == "[[command]]";
      head = head && !line.starts_with("[");
      if (!head && !command && !line.empty()) out += line + "\n";
    }
    return out;
  };
  std::string seed = body("cells/kozubik/cell.toml");
  const std::string tins = "containers = 18";
  seed.replace(seed.find(tins), tins.size(), "containers = 3");
  EXPECT_EQ(body("cells/kozubik/shift.toml"), seed);
}

/// The problems of a kind after a change of the seed's cell, in a run of a second.
std::vector<std::string> problems_of(const Cell& cell, const std::string& kind, double seconds = 1) {
  CellQuestion question;
  question.settings.seconds = seconds;
  question.plan = false;
  std::vector<std::string> out;
  for (const Problem& p : judge_cell(cell, question).problems)
    if (p.kind == kind) out.push_back(p.detail);
  return out;
}

// 50 mm of fall take sqrt(2 0.05 / 9.80665) = 0.101 s: 10.1 mm at 100 mm/s. A belt that begins 30 mm on is missed.
TEST(CellBelts, ItemsFlyAsFarAsTheyFall) {
  Conveyor belt;
  belt.speed = 0.1;
  EXPECT_NEAR(belt.flight(0.05), 0.0101, 1e-5);
  EXPECT_TRUE(problems_of(kozubik(), "drop").empty());
  Cell cell = kozubik();
  Conveyor& b = cell.conveyors[1];
  b.at = {0.590, 0.345, 0.950};
  b.drop = 0.190;
  b.drop_spread = 0.045;
  const std::vector<std::string> both = problems_of(cell, "drop");
  ASSERT_EQ(both.size(), 2U);
  EXPECT_NE(both[0].find("land 10 mm beyond its end; drop_mm = 190 +- 45 is not that"), std::string::npos) << both[0];
  EXPECT_NE(both[1].find("beside the belt of A"), std::string::npos) << both[1];
  // A chute of 150 mm from the end of B on leads them there; one of 60 mm leaves a gap.
  b.chute = "chute";
  cell.bodies.push_back({"chute", "chute", {0.590, 1.120, 0.925}, {0.15, 0.150, 0.02}, 0, false});
  EXPECT_TRUE(problems_of(cell, "drop").empty());
  cell.bodies.back().size.y() = 0.06;
  ASSERT_EQ(problems_of(cell, "drop").size(), 1U);
  EXPECT_NE(problems_of(cell, "drop")[0].find("leaves a gap"), std::string::npos);
}

// 120 mm/s at 500 mm/s2: 14.4 mm, and 10 mm lie between the sensor and the end of the window; 720 mm/s2 just do.
TEST(CellBelts, ABeltStopsBeforeTheEndOfTheWindow) {
  Cell cell = kozubik();
  EXPECT_TRUE(problems_of(cell, "belt").empty()) << "not given";
  cell.conveyors[0].acceleration = 0.5;
  const std::vector<std::string> late = problems_of(cell, "belt");
  ASSERT_EQ(late.size(), 1U);
  EXPECT_NE(late[0].find("A needs 14.4 mm to stop, and 10.0 mm lie"), std::string::npos) << late[0];
  cell.conveyors[0].acceleration = 0.72;
  EXPECT_TRUE(problems_of(cell, "belt").empty());
}

// Boxes go from one place to another with a single slot: when that is full, the work has ended, and nobody waits for
// anybody.
TEST(CellCycle, AFullPalletIsNoDeadlock) {
  std::string text = test::kCrossing;
  for (std::size_t at = 0; (at = text.find("KEEPS")) != std::string::npos;) text.replace(at, 5, "false");
  Cell cell = cell_of(text);
  cell.tasks.pop_back();
  cell.machines.pop_back();
  cell.spots[0].slots.push_back(cell.spots[0].slots[0] + Vec3(0, -0.15, 0));
  cell.spots[0].containers = 2;
  const Outcome o = run(cell, motions(cell), for_seconds(100));
  ASSERT_TRUE(o.stands_since);
  EXPECT_EQ(o.full, "Q2");
  EXPECT_EQ(o.done[0], 1);
  const std::vector<std::string> full = problems_of(cell, "full", 100);
  ASSERT_EQ(full.size(), 1U);
  EXPECT_NE(full[0].find("Q2 is full, and no task takes anything from it"), std::string::npos) << full[0];
  EXPECT_TRUE(problems_of(cell, "deadlock", 100).empty());
}

TEST(CellCycle, TheFilmShowsTheRunAndDoesNotChangeIt) {
  RunSettings s = for_seconds(200);
  const Outcome plain = run(kozubik(), kozubik_motions(), s);
  s.record = true;
  const Outcome o = run(kozubik(), kozubik_motions(), s);
  EXPECT_EQ(o.placed, plain.placed);
  EXPECT_EQ(o.calendar, plain.calendar);
  EXPECT_EQ(o.machines[1].busy, plain.machines[1].busy);
  EXPECT_TRUE(plain.pictures.empty());
  // From START at 1 s on, 60 s in steps of 0.15 s.
  ASSERT_EQ(o.pictures.size(), 401U);
  EXPECT_DOUBLE_EQ(o.pictures.front().time, 1);
  for (std::size_t m = 0; m < 2; ++m) {
    const std::vector<Leg>& legs = o.machines[m].legs;
    ASSERT_GT(legs.size(), 10U);
    for (std::size_t k = 0; k + 1 < legs.size(); ++k) EXPECT_LE(legs[k].to, legs[k + 1].from + 1e-9) << m << " " << k;
  }
  // What is placed was carried; tins are in places or in the hand: 18 until one is served.
  bool carried = false;
  for (const Picture& p : o.pictures) {
    carried |= p.hands[0] == Picture::Hand::item;
    EXPECT_EQ(p.containers.size() + (p.hands[1] == Picture::Hand::container ? 1 : 0), 18U) << p.time;
    for (const Vec3& item : p.items) EXPECT_TRUE(item.z() > 0.9 && item.z() < 1.06) << item.transpose();
  }
  EXPECT_TRUE(carried);
  EXPECT_GT(o.pictures.back().placed, 10);
  // A STOP ends the film.
  Cell stopped = kozubik();
  stopped.commands = {{1, Order::start}, {31, Order::stop}};
  EXPECT_EQ(run(stopped, kozubik_motions(), s).pictures.size(), 201U);
}

TEST(CellCycle, WhenAllIsServedTheOperatorRefills) {
  Cell cell = kozubik();
  cell.spots[0].containers = 3;
  cell.commands.assign(1, {1, Order::start});
  for (int k = 0; k < 3; ++k) cell.commands.push_back({2.0 + k, Order::serve});
  RunSettings s = for_seconds(400);
  const Outcome asks = run(cell, kozubik_motions(), s);
  // Items of the last tin go round no more once the other tins are served: what was poured out fills two, then one.
  EXPECT_EQ(asks.served, 3);
  EXPECT_EQ(asks.state, "refill");
  cell.refill = 30;
  const Outcome goes_on = run(cell, kozubik_motions(), s);
  EXPECT_GT(goes_on.placed, asks.placed);
  EXPECT_EQ(goes_on.state, "working");
}

TEST(CellCycle, StopHaltsAndStartGoesOn) {
  Cell cell = cell_of(test::kPicking);
  cell.commands = {{0, Order::start}, {50.3, Order::stop}, {150.3, Order::start}};
  const Motions m = motions(cell);
  const Outcome o = run(cell, m, for_seconds(400));
  EXPECT_NEAR(o.working, 300, 1e-9);
  EXPECT_NEAR(o.belts[0].running, 300, 1e-9);
  const Outcome whole = run(cell_of(test::kPicking), m, for_seconds(300));
  EXPECT_NEAR(o.placed, whole.placed, 2);
}

/// Of a machine: busy, stopped and waiting are all of the time.
double whole_time(const MachineUse& m) {
  double sum = m.busy + m.stopped;
  for (const auto& [what, seconds] : m.waiting) sum += seconds;
  return sum;
}

// While a STOP holds everything nothing is busy, and nothing waits for anything else: the shares are those of a run
// without the STOP, whatever the machines were doing when it came.
TEST(CellCycle, AStopIsAShareOfItsOwn) {
  Cell cell = kozubik();
  for (const double at : {40.0, 71.3, 100.0, 133.7}) {
    cell.commands = {{1, Order::start}, {at, Order::stop}, {at + 400, Order::start}};
    const Outcome o = run(cell, kozubik_motions(), for_seconds(600));
    cell.commands = {{1, Order::start}};
    const Outcome plain = run(cell, kozubik_motions(), for_seconds(200));
    for (std::size_t m = 0; m < 2; ++m) {
      EXPECT_NEAR(o.machines[m].stopped, 400, 1e-9);
      EXPECT_NEAR(whole_time(o.machines[m]), 600, 1e-9);
      // A STOP lets cameras and visitors go on: what follows differs a little.
      EXPECT_NEAR(o.machines[m].busy, plain.machines[m].busy, 6) << at << " " << m;
      EXPECT_EQ(plain.machines[m].stopped, 0);
      EXPECT_NEAR(whole_time(plain.machines[m]), 200, 1e-9);
    }
  }
  // Until the end of the run, too, and in the Gantt chart.
  cell.commands = {{1, Order::start}, {100, Order::stop}};
  RunSettings s = for_seconds(600);
  s.record = true;
  const Outcome held = run(cell, kozubik_motions(), s);
  for (const MachineUse& m : held.machines) {
    EXPECT_NEAR(m.stopped, 500, 1e-9);
    EXPECT_LT(m.busy, 100);
    ASSERT_FALSE(m.intervals.empty());
    EXPECT_EQ(m.intervals.back().what, "stopped");
    EXPECT_FALSE(m.intervals.back().busy);
    EXPECT_EQ(m.intervals.back().from, 100);
  }
}

TEST(CellCycle, TheSameSeedGivesTheSameAndAnotherAnother) {
  RunSettings s = for_seconds(600);
  s.record = true;
  const Outcome a = run(kozubik(), kozubik_motions(), s), b = run(kozubik(), kozubik_motions(), s);
  ASSERT_EQ(a.events.size(), b.events.size());
  for (std::size_t k = 0; k < a.events.size(); ++k) {
    EXPECT_EQ(a.events[k].time, b.events[k].time);
    EXPECT_EQ(a.events[k].what, b.events[k].what);
  }
  s.seed = 2;
  const Outcome c = run(kozubik(), kozubik_motions(), s);
  bool differs = c.events.size() != a.events.size();
  for (std::size_t k = 0; k < std::min(a.events.size(), c.events.size()) && !differs; ++k)
    differs = a.events[k].time != c.events[k].time;
  EXPECT_TRUE(differs);
}

TEST(CellCycle, MachinesThatWaitInEachOthersZonesAreADeadlock) {
  const Cell stuck = cell_of(test::kCrossing, "KEEPS", "true");
  const Outcome o = run(stuck, motions(stuck), for_seconds(60));
  ASSERT_TRUE(o.stands_since);
  EXPECT_LT(*o.stands_since, 10);
  EXPECT_EQ(o.standstill,
            "one waits for zone right, which two would bring, two waits for zone left, which one would bring");
  EXPECT_EQ(o.done[0] + o.done[1], 0);
  // Outside of the zones they pass.
  const Cell passes = cell_of(test::kCrossing, "KEEPS", "false");
  const Outcome done = run(passes, motions(passes), for_seconds(60));
  EXPECT_EQ(done.done[0] + done.done[1], 2);
}

TEST(CellCycle, ItemsThatAreLostStarveTheCell) {
  // One picture a second and a narrow field: some biscuits are seen by nobody and fall off; the tins never fill.
  Cell cell = kozubik();
  cell.conveyors[0].sensor = -1;
  cell.cameras[0].interval = 2;
  cell.cameras[0].field_along = 0.1;
  const Outcome o = run(cell, kozubik_motions(), for_seconds(600));
  EXPECT_GT(o.unseen, 0);
  ASSERT_TRUE(o.stands_since);
  EXPECT_NE(o.standstill.find("delta waits for items on A"), std::string::npos) << o.standstill;
  EXPECT_NE(o.standstill.find("arm waits for a full container in holder"), std::string::npos) << o.standstill;
}

TEST(CellCycle, ABetterPartNeverMakesTheStudyLie) {
  RunSettings s = for_seconds(600);
  const Study st = study(kozubik(), kozubik_motions(), s, 4, true);
  ASSERT_EQ(st.outcomes.size(), 4U);
  ASSERT_EQ(st.policies.size(), 3U);
  ASSERT_EQ(st.gains.size(), 4U);
  EXPECT_EQ(st.policies[0].second.mean, st.throughput.mean);
  // Both machines share the place over the holder and limit the cell together; belts do not.
  std::set<std::string> first{st.gains[0].what, st.gains[1].what};
  EXPECT_EQ(first, (std::set<std::string>{"arm 10 % faster", "delta 10 % faster"}));
  EXPECT_LT(st.gains[2].change.mean, st.gains[1].change.mean / 2);
  ASSERT_FALSE(st.next_gains.empty());
  EXPECT_EQ(st.next_gains.front().what, st.gains[1].what) << "with the one twice as fast, the other limits";
}

TEST(CellCycle, Estimates) {
  // 1 to 5: mean 3, variance 2.5, t(4) = 2.776; 1, 2, 3: variance 1, t(2) = 4.303.
  EXPECT_DOUBLE_EQ(estimate({1, 2, 3, 4, 5}).mean, 3);
  EXPECT_NEAR(estimate({1, 2, 3, 4, 5}).half_width, 2.776 * std::sqrt(0.5), 1e-3);
  EXPECT_NEAR(estimate({1, 2, 3, 4}).half_width, 3.182 * std::sqrt(5.0 / 12), 1e-3);
  EXPECT_NEAR(student_95(11), 2.2010, 2e-4);
  EXPECT_NEAR(student_95(10), 2.2281, 2e-4);
  EXPECT_NEAR(student_95(1e6), 1.95996, 1e-5);
  EXPECT_NEAR(estimate({1, 2, 3}).half_width, 4.303 / std::sqrt(3.0), 1e-3);
  EXPECT_TRUE(std::isinf(estimate({5}).half_width));
}

/// The problems of a cell, "kind: detail".
std::vector<std::string> problems_of(Cell cell, double seconds = 60) {
  CellQuestion question;
  question.settings.seconds = seconds;
  std::vector<std::string> out;
  for (const Problem& p : judge_cell(std::move(cell), question).problems) out.push_back(p.kind + ": " + p.detail);
  return out;
}

TEST(CellVerdict, WhatIsTooHeavy) {
  // 20 g and an item of 15 g: 35 g.
  const auto with = [](const std::string& payload) {
    std::string text = test::kPicking;
    text.replace(text.find("diameter_mm = 40"), 16, "diameter_mm = 40\nmass_g = 15");
    text.replace(text.find("grip_s = 0.05"), 13, "grip_s = 0.05\nhand_mass_g = 20\npayload_kg = " + payload);
    return problems_of(cell_of(text));
  };
  EXPECT_THAT(with("0.036"), testing::Not(testing::Contains(testing::StartsWith("payload"))));
  EXPECT_THAT(with("0.034"), testing::Contains(testing::StartsWith("payload: delta carries 0.0")));
}

// The arm of the seed's cell carries full tins: 3 kg are allowed.
TEST(CellVerdict, AFullContainerIsTooHeavy) {
  Cell cell = kozubik();
  EXPECT_THAT(problems_of(cell), testing::Not(testing::Contains(testing::StartsWith("payload"))));
  cell.containers[0].mass = 4;
  EXPECT_THAT(problems_of(cell), testing::Contains(testing::AllOf(testing::StartsWith("payload: arm carries"),
                                                                  testing::HasSubstr("with a full"))));
}

// Two screws of 10 EUR each.
TEST(CellVerdict, PartsBeyondTheBudget) {
  const auto with = [](const std::string& budget) {
    return problems_of(cell_of(test::kPicking, "currency = \"EUR\"", "currency = \"EUR\"\nbudget = " + budget));
  };
  EXPECT_THAT(with("20"), testing::Not(testing::Contains(testing::StartsWith("budget"))));
  EXPECT_THAT(with("19"), testing::Contains("budget: the parts cost 20.00 EUR, 1.00 more than the budget"));
}

// 6000 items a minute on a belt of 16 s.
TEST(CellVerdict, ABeltThatGathersTooMuch) {
  std::string text = test::kPicking;
  text.replace(text.find("per_minute = 60"), 15, "per_minute = 60000");
  EXPECT_THAT(problems_of(cell_of(text)),
              testing::Contains(testing::StartsWith("crowded: more than 5000 items gather on conveyor A")));
}

// Items of 40 mm move by 13 mm from picture to picture: some lie wholly in no field of 45 mm.
TEST(CellVerdict, ItemsThatNoCameraSees) {
  const auto with = [](double field) {
    return problems_of(cell_of(std::string(test::kPicking) +
                               fmt::format("\n[[camera]]\nname = \"eye\"\nconveyor = \"A\"\nat_mm = 300\nfield_mm = "
                                           "[{0}, 400]\ninterval_ms = 130\ndelay_ms = 50\n",
                                           field)));
  };
  EXPECT_THAT(with(200), testing::Not(testing::Contains(testing::StartsWith("unseen"))));
  EXPECT_THAT(with(45), testing::Contains(testing::AllOf(testing::StartsWith("unseen: "),
                                                         testing::HasSubstr("lie wholly in no picture of a camera"))));
}

// A source of 100 items that could bring ten a second, and is held: no more are lost than it had.
TEST(CellCycle, ASourceLosesNoMoreThanItHas) {
  std::string text = test::kPicking;
  text.replace(text.find("per_minute = 60"), 15, "per_minute = 600\nlimit = 100");
  text.replace(text.find("speed_mm_per_s = 100"), 20, "speed_mm_per_s = 100\nsensor_mm = 890");
  const Cell cell = cell_of(text);
  const Outcome o = run(cell, motions(cell), for_seconds(300));
  EXPECT_GT(o.held.at(0), 0) << "it waits";
  EXPECT_GE(o.lost.at(0), 0);
  EXPECT_LE(o.lost.at(0) + o.fed, 100);
}

}  // namespace
}  // namespace polypod::cell
