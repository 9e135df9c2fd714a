// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// NC programs: what they switch, their path modes, tool lengths and offsets come out in their places, or are refused.
// The oracle is LinuxCNC's rs274, which reads the source and the output.
#include <gmock/gmock.h>

#include <fmt/format.h>

#include <algorithm>
#include <map>

#include "../gcode/rs274.hpp"
#include "parts.hpp"
#include "polypod/kinematics/any_machine.hpp"

namespace polypod {
namespace {

using post::Dialect;
using test::Posted;
using test::value;
using ::testing::DoubleNear;
using ::testing::HasSubstr;
using ::testing::Not;
using ::testing::Pointwise;

constexpr Dialect kRobots[] = {Dialect::krl, Dialect::rapid, Dialect::urscript};
const Vec3 kOrigin_mm(-50, -1335, 0);

/// A file of this text.
class Source {
 public:
  explicit Source(const std::string& text) : name_(folder_ / "source.ngc") { std::ofstream{name_} << text; }
  [[nodiscard]] const std::string& name() const { return name_; }
  [[nodiscard]] Result<post::Path> read(const post::ProgramOptions& options = {}) const {
    return post::read_path(name_, options);
  }

 private:
  gcode::Scratch folder_;
  std::string name_;
};

Posted posted(Dialect dialect, const std::string& text, const post::WriteOptions& writing = {},
              const post::PlanOptions& planning = {}, const post::ProgramOptions& options = {}) {
  return test::post_to(dialect, test::load("lola50"), "auto", value(Source(text).read(options)), kOrigin_mm, planning,
                       writing);
}

std::vector<std::string> lines_of(const std::string& text) {
  std::vector<std::string> out = gcode::lines(text);
  for (std::string& l : out) l.erase(0, std::min(l.find_first_not_of(' '), l.size()));
  return out;
}

/// Where this line stands, or -1.
int at(const std::vector<std::string>& lines, const std::string& line, int from = 0) {
  const auto it = std::find(lines.begin() + from, lines.end(), line);
  return it == lines.end() ? -1 : static_cast<int>(it - lines.begin());
}

/// What rs274 does with a program: its calls without numbers of lines and without those that only set the scene.
std::vector<std::string> calls(const std::string& text) {
  const gcode::Scratch folder;
  const std::string file = folder / "program.ngc";
  std::ofstream{file} << text;
  const gcode::Reference run = gcode::rs274(folder, file, {});
  EXPECT_TRUE(run.accepted) << run.errors;
  std::vector<std::string> out;
  for (const std::string& l : gcode::lines(run.text)) {
    const std::size_t call = l.find("N..... ");
    if (call == std::string::npos) continue;
    std::string name = l.substr(call + 7);
    const bool scene = name.starts_with("COMMENT") || name.starts_with("SET_FEED_RATE(0.0") ||
                       name.starts_with("SET_FEED_MODE") || name.starts_with("SELECT_PLANE") ||
                       name.starts_with("SET_G5X") || name.starts_with("SET_XY_ROT") ||
                       name.starts_with("USE_LENGTH_UNITS") || name.starts_with("SET_FEED_REF");
    if (!scene) out.push_back(std::move(name));
  }
  return out;
}

/// The two programs do the same, call by call.
void expect_same_calls(const std::string& before, const std::string& after) {
  EXPECT_EQ(calls(before), calls(after)) << after;
}

const std::string kStop =
    "G21 G90 G17 G54\nM6 T1\nG43 H1\nM3 S12000\nG4 P3\nG0 X0 Y0 Z30\nG1 Z5 F300\nG1 X20\nM5\nM0 (turn the clamp)\n"
    "M3 S12000\nG1 X0\nM5\nM2\n";

TEST(Programs, TheSpindleStandsDuringAStop) {
  const Posted p = posted(Dialect::ngc, kStop);
  expect_same_calls(kStop, p.written.text);
  const auto lines = lines_of(p.written.text);
  const int off = at(lines, "M5"), stop = at(lines, "M0"), on = at(lines, "S12000 M3", stop);
  EXPECT_LT(at(lines, "X20"), off);
  EXPECT_LT(off, stop);
  EXPECT_LT(stop, on);
  EXPECT_LT(on, at(lines, "X0", on));
  EXPECT_GT(at(lines, "(turn the clamp)"), 0) << "what the operator has to do is told";
}

TEST(Programs, EverySwitchComesInItsPlace) {
  const std::string text =
      "(first)\nG21 G90 G17 G54 G94 G40 G80\nM5\nT1 M6\nG43 H1\nM3 S12000 M8\nG4 P2\nM0\nG0 X0 Y0 Z30\nG1 Z5 F300\n"
      "M9\nM7\nG4 P0.5\nX20 F600\nM1\nS8000\nT2\nX10\nM9\nM5\nM60\nM6\nG43 H2\nS500 M4\nG0 Z40\nG49\nG0 Z60\nM30\n";
  expect_same_calls(text, posted(Dialect::ngc, text).written.text);
  // In the order of RS-274 within a block, however it is written.
  const std::string jumbled = "G21 G90 G54\nM8 M3 T1 S900 M6\nG0 X0 Y0 Z30\nG1 X5 F300\nM9 G1 X20 M0\nM2\n";
  expect_same_calls(jumbled, posted(Dialect::ngc, jumbled).written.text);
}

TEST(Programs, SubprogramsAndShiftsKeepTheirSwitches) {
  const std::string text =
      "G21 G90 G17 G54\nT1 M6\nM3 S900\nG0 X0 Y0 Z30\no100 repeat [2]\nM8\nG1 X20 F300\nM9\nM0\nG1 X0\no100 endrepeat\n"
      "G92 X10\nG1 X30\nG92.1\nM5\nM2\n";
  const Posted p = posted(Dialect::ngc, text);
  const auto lines = lines_of(p.written.text);
  EXPECT_EQ(std::count(lines.begin(), lines.end(), "M0"), 2);
  EXPECT_EQ(std::count(lines.begin(), lines.end(), "M8"), 2);
  EXPECT_GT(at(lines, "X20", at(lines, "M5") - 3), 0) << "G92 is carried out: " << p.written.text;
}

TEST(Programs, RobotsHaveTheSwitchesAsCommentsInTheirPlaces) {
  for (const Dialect dialect : kRobots) {
    const std::string remark = dialect == Dialect::krl ? "; " : dialect == Dialect::rapid ? "! " : "# ";
    const Posted p = posted(dialect, kStop);
    const auto lines = lines_of(p.written.text);
    const auto line = [&](const std::string& text, int from = 0) { return at(lines, remark + text, from); };
    const int change = line("change to tool 1"), start = line("spindle 12000 rev/min clockwise");
    EXPECT_GT(change, 0) << p.written.text;
    EXPECT_GT(start, change);
    const int off = line("spindle off");
    EXPECT_GT(off, start);
    const auto stop = std::find_if(lines.begin(), lines.end(), [](const std::string& l) {
      return l == "HALT" || l == "Stop;" || l.starts_with("popup(");
    });
    ASSERT_NE(stop, lines.end());
    const int halt = static_cast<int>(stop - lines.begin());
    EXPECT_GT(halt, off);
    EXPECT_GT(line("spindle 12000 rev/min clockwise", halt), halt);
    EXPECT_THAT(p.written.notes, ::testing::Contains(HasSubstr("wire them")));
    EXPECT_THAT(p.written.notes, ::testing::Contains(HasSubstr("line 3: tool length offsets are not written")));
  }
}

TEST(Programs, PathModesStay) {
  const std::string text =
      "G21 G90 G54 G64 P0.01 Q0.005\nG0 X0 Y0 Z30\nG1 X20 F900\nG61\nY20\nG61.1\nX0\nG64\nY0\nM2\n";
  expect_same_calls(text, posted(Dialect::ngc, text).written.text);
  EXPECT_THAT(posted(Dialect::ngc, "G20 G90 G54 G64 P0.001\nG0 X0 Y0 Z1\nM2\n").written.text,
              HasSubstr("G64 P0.0254\n"));
  // A program without one gets none.
  const std::string none = "G21 G90 G54\nG0 X0 Y0 Z30\nG1 X20 F900\nM2\n";
  EXPECT_THAT(posted(Dialect::ngc, none).written.text, Not(HasSubstr("G6")));
  // What is asked for on the command line replaces them.
  post::WriteOptions asked;
  asked.blend = 0.05e-3;
  asked.blend_overrides = true;
  const std::string replaced = posted(Dialect::ngc, text, asked).written.text;
  EXPECT_THAT(replaced, HasSubstr("\nG64 P0.05\n"));
  EXPECT_THAT(replaced, Not(HasSubstr("G61")));
  EXPECT_EQ(replaced.find("G64"), replaced.rfind("G64"));
  asked.blend = 0;
  EXPECT_THAT(posted(Dialect::ngc, text, asked).written.text, HasSubstr("\nG61\n"));
}

/// The distance by which each move may round its end, as the language says it, mm.
std::vector<double> zones_of(Dialect dialect, const std::string& text) {
  std::vector<double> out;
  double distance = 0;
  std::map<std::string, double> zones;
  for (const std::string& l : lines_of(text)) {
    if (l.starts_with("$APO.CDIS=")) distance = std::stod(l.substr(10));
    if (l.starts_with("CONST zonedata "))
      zones[l.substr(15, l.find(':') - 15)] = std::stod(l.substr(l.find("[FALSE,") + 7));
    if (dialect == Dialect::krl && l.starts_with("LIN ")) out.push_back(l.ends_with(" C_DIS") ? distance : 0);
    if (dialect == Dialect::rapid && l.starts_with("MoveL ")) {
      const std::size_t end = l.find(",tPart"), begin = l.rfind(',', end - 1) + 1;
      out.push_back(zones[l.substr(begin, end - begin)]);
    }
    if (dialect == Dialect::urscript && l.starts_with("movel("))
      out.push_back(1e3 * std::stod(l.substr(l.rfind("r=") + 2)));
  }
  return out;
}

TEST(Programs, RobotsRoundCornersAsThePathModeSays) {
  const std::string text =
      "G21 G90 G54 G64 P0.01\nG0 X0 Y0 Z30\nG1 X20 F900\nY20\nX0\nG61\nY0\nX20\nG61.1\nY20\nG64 "
      "P0.2\nX0\nY0\nG64\nX20\n"
      "Y20\nX0\nM2\n";
  for (const Dialect dialect : kRobots) {
    const Posted p = posted(dialect, text);
    // The stricter of both sides of a corner counts; G64 without P has the default.
    EXPECT_THAT(
        zones_of(dialect, p.written.text),
        Pointwise(DoubleNear(1e-9), std::vector<double>{0.01, 0.01, 0.0, 0.0, 0.0, 0.0, 0.2, 0.1, 0.1, 0.1, 0.0}))
        << p.written.text;
    EXPECT_THAT(p.written.notes, ::testing::Contains(HasSubstr("line 15: no path mode says")));
    post::WriteOptions asked;
    asked.blend = 0;
    asked.blend_overrides = true;
    for (const double zone : zones_of(dialect, posted(dialect, text, asked).written.text)) EXPECT_EQ(zone, 0);
  }
}

TEST(Programs, CoordinatesThatAreNotKnownAreNotInvented) {
  const std::string text = "G21 G90 G54\nG0 Z26\nG0 X100 Y70\nG1 Z17 F300\nX0\nM2\n";
  const Posted p = posted(Dialect::ngc, text);
  expect_same_calls(text, p.written.text);
  const auto lines = lines_of(p.written.text);
  EXPECT_GT(at(lines, "G0 Z26"), 0);
  EXPECT_EQ(at(lines, "X100 Y70"), at(lines, "G0 Z26") + 1);
  EXPECT_THAT(p.path.notes, ::testing::Contains(HasSubstr("line 2: X, Y or Z are not known yet")));
  for (const Dialect dialect : kRobots) {
    const Posted robot = posted(dialect, text);
    EXPECT_EQ(robot.written.moves, 3) << "it begins at X100 Y70 Z26";
    EXPECT_THAT(robot.written.notes, ::testing::Contains(HasSubstr("line 2: rapids before")));
  }
  EXPECT_NEAR((p.plan.moves.front().tip - Vec3(0.1, 0.07, 0.026)).norm(), 0, 1e-12);
  const auto refused = [](const std::string& t) {
    const auto path = Source(t).read();
    return path ? std::string() : fmt::format("{}:{}", path.error().id, path.error().place.line);
  };
  EXPECT_EQ(refused("G21 G90\nG0 X0 Y0\nG1 Z5 F300\nM2\n"), "PO117:3");
  EXPECT_EQ(refused("G21 G90\nG0 X0 Y0\nM2\n"), "PO117:0");
  EXPECT_EQ(refused("G21 G90\nG0 A10\nG0 X0 Y0 Z5\nM2\n"), "PO117:2");
  EXPECT_EQ(refused("G21 G90\nG0 X0 Y0 Z30\nT1 M6\nG43 H1\nG1 Z5 F300\nM2\n"), "PO117:5");
}

TEST(Programs, AfterAToolLengthZIsWrittenAgain) {
  const std::string text =
      "G21 G90 G54\nT1 M6\nG43 H1\nG0 X0 Y0 Z30\nG1 X20 F300\nT2 M6\nG43 H2\nG0 Z30\nX30 Y5\nG1 X40\nM2\n";
  const Posted p = posted(Dialect::ngc, text);
  expect_same_calls(text, p.written.text);
  for (const Dialect dialect : kRobots) {
    post::PlanOptions planning;
    post::set_for(dialect, planning);
    const auto configuration = value(post::configure(test::load("lola50"), "auto"));
    const auto path = value(Source(text).read());
    planning.origin = 1e-3 * kOrigin_mm;
    const auto plan = value(post::plan(configuration, path, planning));
    const auto written = post::write(dialect, configuration, path, plan);
    EXPECT_EQ(test::id_of(written), "PO119");
    EXPECT_EQ(written.error().place.line, 8);
  }
}

TEST(Programs, MovesInMachineCoordinatesAreRefusedOrNamed) {
  const Posted p = posted(Dialect::ngc, "G21 G90 G54\nG0 X0 Y0 Z30\nG1 X20 F300\n G53 G0 Z0 \nM5\nM2\n");
  ASSERT_EQ(p.path.left_out.size(), 1u);
  EXPECT_EQ(p.path.left_out[0].line, 4);
  EXPECT_EQ(p.path.left_out[0].text, "G53 G0 Z0");
  EXPECT_THAT(p.path.notes, ::testing::Contains(HasSubstr("line 4: `G53 G0 Z0` at the end is left out")));
  const auto refused = [](const std::string& t) {
    const auto path = Source(t).read();
    return path ? std::string() : fmt::format("{}:{}", path.error().id, path.error().place.line);
  };
  EXPECT_EQ(refused("G21 G90\nG53 G0 Z0\nG0 X0 Y0 Z30\nM2\n"), "PO116:2");
  EXPECT_EQ(refused("G21 G90\nG0 X0 Y0 Z30\nG28 Z50\nG0 X5 Y5 Z30\nM2\n"), "PO116:3");
  EXPECT_EQ(refused("G21 G90\nG0 X0 Y0 Z30\nG1 X5 F300\nG53 G1 Z0\nM2\n"), "PO116:4");
}

TEST(Programs, WordsThatCannotBeCarriedOverAreRefused) {
  const auto refused = [](const std::string& t) { return test::id_of(Source(t).read()); };
  EXPECT_EQ(refused("G21 G90\nG9 G0 X0 Y0 Z30\nM2\n"), "GC120");
  EXPECT_EQ(refused("G21 G90\nM250\nG0 X0 Y0 Z30\nM2\n"), "GC178");
  EXPECT_EQ(refused("G21 G90\n/G0 X0 Y0 Z30\nM2\n"), "PO126");
  post::ProgramOptions said;
  said.block_delete_said = true;
  EXPECT_TRUE(Source("G21 G90\n/G0 X0 Y0 Z30\nM2\n").read(said));
  // Outputs of the controller pass to LinuxCNC as they stand, and to no robot.
  const std::string outputs = "G21 G90 G54\nM64 P1\nG0 X0 Y0 Z30\nM66 P2 L3 Q5\nM49\nG1 X20 F300\nM65 P1\nM48\nM2\n";
  expect_same_calls(outputs, posted(Dialect::ngc, outputs).written.text);
  EXPECT_THAT(posted(Dialect::ngc, outputs).written.text, HasSubstr("M66 P2 L3 Q5"));
  const auto configuration = value(post::configure(test::load("lola50"), "auto"));
  const auto path = value(Source(outputs).read());
  post::PlanOptions planning;
  planning.origin = 1e-3 * kOrigin_mm;
  const auto written = post::write(Dialect::krl, configuration, path, value(post::plan(configuration, path, planning)));
  EXPECT_EQ(test::id_of(written), "PO118");
  EXPECT_EQ(written.error().place.line, 2);
}

/// The radius of an arc is not a number of the M word beside it, and M60 takes no P.
TEST(Programs, NumbersStayWithTheWordsThatTakeThem) {
  const std::string text =
      "G21 G90 G17 G54\nG0 X0 Y0 Z30\nG1 X30 Y5 F300\nG3 X10 Y25 R20 M52\nG4 P0.5 M60\nG1 X5\nM2\n";
  const Posted p = posted(Dialect::ngc, text);
  expect_same_calls(text, p.written.text);
  EXPECT_GT(at(lines_of(p.written.text), "M52"), 0) << p.written.text;
}

TEST(Programs, ATurnedWorkpieceTurnsItsFrame) {
  const std::string text = "G21 G90 G54\nG0 X0 Y0 Z30\nG1 X50 F300\nG3 X50 Y20 J10\nM2\n";
  post::PlanOptions planning;
  planning.rotation = units::from_deg(30);
  post::WriteOptions writing;
  writing.rotation = planning.rotation;
  const Posted p = posted(Dialect::krl, text, writing, planning);
  EXPECT_TRUE(p.plan.ok());
  // Base at X-50 Y-1335 of M, turned; targets in W; the joints are those of the turned place.
  const auto& arm = std::get<machine::SerialArm>(p.configuration.machine);
  for (const post::PlannedMove& m : p.plan.moves) {
    const Pose X = kinematics::forward(p.configuration.machine, m.joints).poses.front();
    EXPECT_LT((X.p - (1e-3 * kOrigin_mm + rotation_z(planning.rotation) * m.tip)).norm(), 1e-9);
  }
  const auto lines = lines_of(p.written.text);
  const std::string base = *std::find_if(lines.begin(), lines.end(), [](auto& l) { return l.starts_with("$BASE="); });
  const Pose X_BW = arm.X_MB.inverse() * Pose{rotation_z(planning.rotation), 1e-3 * kOrigin_mm};
  EXPECT_THAT(base, HasSubstr(fmt::format("A {:g}", units::to_deg(angles_abc(X_BW.R).z()))));
  EXPECT_THAT(p.written.text, HasSubstr("LIN {X 50,Y 0,Z 30,"));
  // G-code keeps the coordinates: G54 of the controller is turned.
  EXPECT_THAT(posted(Dialect::ngc, text, writing, planning).written.text, HasSubstr("G3 Y20 I0 J10"));
  const auto tilted = value(Source("G21 G90 G54\nG0 X0 Y0 Z30 A10\nM2\n").read());
  EXPECT_EQ(test::id_of(post::plan(p.configuration, tilted, planning)), "PO124");
}

/// Where joint 6 comes to its end the machine could only go on with the wrist turned over: the limit is named, not the
/// jump of half a turn.
TEST(Programs, NameTheLimitWhereAPostureEnds) {
  machine::AnyMachine machine = test::load("kuka-kr210");
  const auto path = value(Source("G21 G90 G54\nG0 X0 Y0 Z30 A10 B10 C0\nG1 C100 F600\nM2\n").read());
  post::PlanOptions planning;
  post::set_for(Dialect::krl, planning);
  planning.origin = Vec3(1.6, 0.1, 0.9);
  const post::Plan free = value(post::plan(value(post::configure(machine, "six")), path, planning));
  ASSERT_TRUE(free.ok());
  const double from = free.moves.front().joints[5], to = free.moves.back().joints[5];
  ASSERT_GT(std::abs(to - from), units::from_deg(60));
  auto& range = std::get<machine::SerialArm>(machine).dh[5].range;
  const double end = 0.5 * (from + to), turned_over = end + std::copysign(units::from_deg(200), from - to);
  range = {std::min(end, turned_over), std::max(end, turned_over)};
  const post::Plan plan = value(post::plan(value(post::configure(machine, "six")), path, planning));
  ASSERT_FALSE(plan.ok());
  EXPECT_EQ(plan.problems.front().kind, "limit");
  EXPECT_THAT(plan.problems.front().detail, HasSubstr("in the posture that it has the machine cannot go on, joint 6"));
}

/// On a turned workpiece the tool of a six-axis arm tilts and turns with it: the same joints as those of the program
/// whose points and orientations are turned by hand, and targets in the frame of the workpiece.
TEST(Programs, ATiltedToolTurnsWithTheWorkpiece) {
  const auto configuration = value(post::configure(test::load("kuka-kr210"), "six"));
  const double turn = units::from_deg(40);
  const Mat3 R = rotation_z(turn);
  const std::vector<std::array<double, 6>> points{
      {0, 0, 30, 0, 0, 0}, {40, 10, 30, 20, -10, 15}, {60, -20, 10, -15, 25, 60}, {20, -30, 10, 10, 10, -20}};
  std::string text = "G21 G90 G54\n", by_hand = text;
  const char* move = "G0";
  for (const auto& p : points) {
    text += fmt::format("{} X{} Y{} Z{} A{} B{} C{} F600\n", move, p[0], p[1], p[2], p[3], p[4], p[5]);
    const Vec3 at = R * Vec3(p[0], p[1], p[2]);
    const Vec3 angles = angles_abc(
        R * rotation_abc(units::from_deg(p[3]), units::from_deg(p[4]), units::from_deg(p[5])) * R.transpose());
    by_hand += fmt::format("{} X{:.9f} Y{:.9f} Z{:.9f} A{:.9f} B{:.9f} C{:.9f} F600\n", move, at.x(), at.y(), at.z(),
                           units::to_deg(angles.x()), units::to_deg(angles.y()), units::to_deg(angles.z()));
    move = "G1";
  }
  post::PlanOptions planning;
  post::set_for(Dialect::krl, planning);
  planning.origin = Vec3(1.6, 0.1, 0.9);
  const auto path = value(Source(text + "M2\n").read());
  planning.rotation = turn;
  const post::Plan turned = value(post::plan(configuration, path, planning));
  planning.rotation = 0;
  const post::Plan straight = value(post::plan(configuration, value(Source(by_hand + "M2\n").read()), planning));
  ASSERT_TRUE(turned.ok());
  ASSERT_TRUE(straight.ok());
  const auto ends = [](const post::Plan& plan) {
    std::vector<post::PlannedMove> out;
    for (const post::PlannedMove& m : plan.moves)
      if (!m.inserted) out.push_back(m);
    return out;
  };
  const auto a = ends(turned), b = ends(straight);
  ASSERT_EQ(a.size(), points.size());
  ASSERT_EQ(b.size(), points.size());
  for (std::size_t i = 0; i < a.size(); ++i)
    EXPECT_LT((a[i].joints - b[i].joints).cwiseAbs().maxCoeff(), 1e-9) << "point " << i;
  // The tool's axis goes along the same way between them: the inserted points are those of 0.1 deg.
  EXPECT_LE(turned.axis_error, planning.axis_tolerance);
  // C chosen along the program has the same limits and the same joints to choose from.
  planning.c.reset();
  planning.rotation = turn;
  const auto free = value(Source("G21 G90 G54\nG0 X0 Y0 Z30 A10 B5\nG1 X40 A-20 B15 F600\nM2\n").read());
  const post::Plan chosen = value(post::plan(configuration, free, planning));
  ASSERT_TRUE(chosen.ok());
  for (const post::PlannedMove& m : chosen.moves) {
    const Vec3 axis = kinematics::forward(configuration.machine, m.joints).poses.front().R.col(2);
    const Vec3 want = R * rotation_abc(m.angles.x(), m.angles.y(), m.angles.z()).col(2);
    EXPECT_LT((axis - want).norm(), 1e-9);
  }
  // G-code has no frame for orientations.
  post::set_for(Dialect::ngc, planning);
  EXPECT_EQ(test::id_of(post::plan(configuration, path, planning)), "PO124");
}

TEST(Programs, TheHeaderOfACorrectedProgramIsKept) {
  const std::string text =
      "(Polypod: corrected for the static compliance of lola50)\n"
      "(Polypod: tube radius 100 um, cutter 5 mm with 3 teeth, origin X-50 Y-1335 Z0 mm)\n"
      "(Polypod: 48 of 65 moves rewritten, do not correct again)\nG21 G90 G54 G61.1\nG0 X0 Y0 Z30\nG1 X20 F300\nM2\n";
  for (const Dialect dialect : {Dialect::ngc, Dialect::krl, Dialect::rapid, Dialect::urscript}) {
    const Posted p = posted(dialect, text);
    for (const char* part :
         {"Polypod: corrected for the static compliance of lola50", "origin X-50 Y-1335 Z0 mm", "do not correct again"})
      EXPECT_THAT(p.written.text, HasSubstr(part));
    const auto header = post::correction_header(p.path);
    ASSERT_TRUE(header);
    EXPECT_EQ(header->machine, "lola50");
    EXPECT_EQ(header->origin, "X-50 Y-1335 Z0 mm");
    EXPECT_EQ(header->line, 1);
  }
  std::string turned = text;
  turned.replace(turned.find("Z0 mm"), 5, "Z0 mm, turned by 30 deg about z");
  const auto header = post::correction_header(value(Source(turned).read()));
  ASSERT_TRUE(header);
  EXPECT_EQ(header->origin, "X-50 Y-1335 Z0 mm, turned by 30 deg about z");
  EXPECT_FALSE(post::correction_header(value(Source(kStop).read())));
}

TEST(Programs, TheHeaderSaysHowTheToolWasHeld) {
  const auto header = [](const std::string& lines) {
    return post::correction_header(value(Source(lines + "G21 G90 G54 G61.1\nG0 X0 Y0 Z30\nG1 X20 F300\nM2\n").read()));
  };
  const std::string mark = "(Polypod: corrected for the static compliance of lola50)\n";
  const std::string place = "(Polypod: tube radius 100 um, cutter 5 mm with 3 teeth, origin X-50 Y-1335 Z0 mm)\n";
  const auto both = header(mark + place + "(Polypod: posture 1 low, 2 high, tool held at C -30.5 deg)\n");
  ASSERT_TRUE(both && both->c);
  EXPECT_EQ(both->posture, "1 low, 2 high");
  EXPECT_NEAR(*both->c, units::from_deg(-30.5), 1e-12);
  const auto posture = header(mark + place + "(Polypod: posture front elbow-up)\n");
  ASSERT_TRUE(posture);
  EXPECT_EQ(posture->posture, "front elbow-up");
  EXPECT_FALSE(posture->c);
  const auto held = header(mark + place + "(Polypod: tool held at C 0 deg)\n");
  ASSERT_TRUE(held && held->c);
  EXPECT_EQ(held->posture, "");
  EXPECT_EQ(*held->c, 0);
  // Headers from before say nothing of it, and neither does what stands elsewhere.
  for (const char* other :
       {"", "(posture front elbow-up, tool held at C 3 deg)\n", "(Polypod: a tool held at C x)\n"}) {
    const auto old = header(mark + place + other);
    ASSERT_TRUE(old);
    EXPECT_EQ(old->posture, "");
    EXPECT_FALSE(old->c);
  }
  // Of a program that was corrected again the first header counts, and only its own lines.
  const auto again = header(mark + place + "(Polypod: corrected for the static compliance of hexapod-strut)\n" +
                            "(Polypod: origin X1 Y2 Z3 mm)\n(Polypod: posture front elbow-down)\n");
  ASSERT_TRUE(again);
  EXPECT_EQ(again->machine, "lola50");
  EXPECT_EQ(again->origin, "X-50 Y-1335 Z0 mm");
  EXPECT_EQ(again->posture, "");
}

/// C of a program that does not command it is what is asked for; the tool axes stay.
TEST(Programs, CIsTakenWhereTheProgramHasNone) {
  const machine::AnyMachine six = test::load(test::example("lola50_six.toml"));
  const auto with = [&](Dialect dialect, const std::string& text, std::optional<double> c_deg) {
    post::PlanOptions planning;
    planning.c = c_deg ? std::optional(units::from_deg(*c_deg)) : std::nullopt;
    return test::post_to(dialect, six, "six", value(Source(text).read()), kOrigin_mm, planning);
  };
  const std::string plain = "G21 G90 G54 G61.1\nG0 X0 Y0 Z30\nG1 X20 F300\nM2\n";
  const std::string tilted = "G21 G90 G54 G61.1\nG0 X0 Y0 Z30 A5 B10\nG1 X20 F300\nM2\n";
  for (const std::string& text : {plain, tilted}) {
    const Posted at_20 = with(Dialect::krl, text, 20), at_0 = with(Dialect::krl, text, 0);
    EXPECT_TRUE(at_20.plan.ok());
    EXPECT_TRUE(at_20.plan.sets_c);
    EXPECT_FALSE(at_0.plan.sets_c);
    ASSERT_EQ(at_20.plan.moves.size(), at_0.plan.moves.size());
    for (std::size_t i = 0; i < at_20.plan.moves.size(); ++i) {
      EXPECT_NEAR(at_20.plan.moves[i].angles.z(), units::from_deg(20), 1e-12);
      EXPECT_LT((at_20.plan.moves[i].R.col(2) - at_0.plan.moves[i].R.col(2)).norm(), 1e-9);
      EXPECT_GT((at_20.plan.moves[i].R.col(0) - at_0.plan.moves[i].R.col(0)).norm(), 0.3);
    }
    EXPECT_THAT(with(Dialect::ngc, text, 20).written.text, HasSubstr(" C20"));
    EXPECT_TRUE(with(Dialect::krl, text, {}).plan.sets_c);
  }
  EXPECT_THAT(with(Dialect::ngc, plain, 0).written.text, Not(HasSubstr("C0")));
  const Posted own = with(Dialect::krl, "G21 G90 G54 G61.1\nG0 X0 Y0 Z30 C5\nG1 X20 F300\nM2\n", 20);
  EXPECT_EQ(own.path.c_line, 2);
  EXPECT_NEAR(own.plan.moves.back().angles.z(), units::from_deg(5), 1e-12);
}

TEST(Programs, ABranchThatIsNoneIsNamedWithThoseThatAre) {
  const post::Path path = value(Source("G21 G90 G54 G61.1\nG0 X0 Y0 Z30\nG1 X20 F300\nM2\n").read());
  const auto refused = [&](const machine::AnyMachine& machine, std::optional<double> c) {
    post::PlanOptions planning;
    planning.origin = 1e-3 * kOrigin_mm;
    planning.branch = "up";
    planning.c = c;
    const auto plan = post::plan(value(post::configure(machine, "auto")), path, planning);
    EXPECT_EQ(test::id_of(plan), "PO122");
    return plan ? "" : to_string(plan.error());
  };
  const std::string all = "back elbow-down and back elbow-down wrist-flipped";
  EXPECT_THAT(refused(test::load("lola50"), 0), HasSubstr("`up`; it can with front elbow-up"));
  EXPECT_THAT(refused(test::load("lola50"), 0), HasSubstr(all));
  EXPECT_THAT(refused(test::load(test::example("lola50_six.toml")), {}), HasSubstr(all));
}

TEST(Programs, ACompensatedContourTakesTheCutter) {
  const std::string text =
      "G21 G90 G17 G54\nT1 M6\nM3 S12000\nG0 X-20 Y-20 Z15\nG41 D1\nG1 X-8 Y-8 F1200\nX0 Y0\nY70\nG40\nX-20 Y-20\nM2\n";
  post::ProgramOptions options;
  options.unroll.diameter = 5e-3;
  options.unroll.diameters[1] = 5e-3;
  const Posted p = posted(Dialect::ngc, text, {}, {}, options);
  EXPECT_THAT(p.written.text, HasSubstr("X-2.5 "));
  EXPECT_THAT(p.written.text, Not(HasSubstr("G41")));
}

/// A tool change stops the spindle: what a CL file leaves running is started again.
TEST(Programs, OfACLFileTheSpindleStartsAgainBehindAToolChange) {
  const auto path =
      value(post::parse_cl("UNITS/MM\nLOADTL/1\nSPINDL/RPM,900,CLW\nRAPID\nGOTO/0,0,30\nFEDRAT/300\nGOTO/"
                           "20,0,30\nLOADTL/2\nGOTO/0,0,30\nFINI\n",
                           "t"));
  const Posted p = test::post_to(Dialect::ngc, test::load("lola50"), "auto", path, kOrigin_mm);
  const auto lines = lines_of(p.written.text);
  EXPECT_EQ(at(lines, "S900 M3", at(lines, "T2 M6")), at(lines, "T2 M6") + 1) << p.written.text;
}

}  // namespace
}  // namespace polypod
