// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Each robot language has a reader here that follows the makers' published form; what it reads are the moves again.
#include <gmock/gmock.h>

#include <algorithm>
#include <cmath>
#include <regex>
#include <set>

#include "parts.hpp"
#include "polypod/families/serial/kinematics.hpp"
#include "polypod/kinematics/any_machine.hpp"

namespace polypod {
namespace {

using post::Dialect;
using test::Posted;
using test::value;

struct RobotMove {
  char kind = 'L';  // J, L, C
  Pose X, via;
  double speed = 0;  // m/s
  double blend = 0;  // m
  int status = 0, turns = 0;
  std::array<int, 4> conf{};
};
struct RobotProgram {
  Pose base, tool;
  std::vector<RobotMove> moves;
};

std::vector<double> numbers_in(const std::string& text) {
  static const std::regex number(R"([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)");
  std::vector<double> out;
  for (std::sregex_iterator it(text.begin(), text.end(), number), end; it != end; ++it)
    out.push_back(std::stod(it->str()));
  return out;
}

std::vector<std::string> lines_of(const std::string& text) {
  std::vector<std::string> out;
  std::size_t at = 0;
  while (at < text.size()) {
    const std::size_t end = text.find('\n', at);
    out.push_back(text.substr(at, end - at));
    at = end + 1;
  }
  return out;
}

/// KRL: A turns about z, B about y, C about x; mm and deg.
RobotProgram read_krl(const std::string& text) {
  RobotProgram out;
  static const std::regex frame(
      R"(\{X ([^,]+),Y ([^,]+),Z ([^,]+),A ([^,]+),B ([^,]+),C ([^,}]+)(?:,S (\d+),T (\d+))?\})");
  const auto pose = [](const std::smatch& m) {
    const auto rad = [&](int i) { return units::from_deg(std::stod(m[static_cast<std::size_t>(i)])); };
    return Pose{rotation_abc(rad(6), rad(5), rad(4)), Vec3(std::stod(m[1]), std::stod(m[2]), std::stod(m[3])) * 1e-3};
  };
  double speed = 0, blend = 0;
  for (const std::string& l : lines_of(text)) {
    EXPECT_LT(l.size(), 250u) << "KRL lines are short";
    std::vector<std::smatch> frames;
    for (std::sregex_iterator it(l.begin(), l.end(), frame), end; it != end; ++it) frames.push_back(*it);
    if (l.rfind("$BASE=", 0) == 0) out.base = pose(frames.at(0));
    if (l.rfind("$TOOL=", 0) == 0) out.tool = pose(frames.at(0));
    if (l.rfind("$VEL.CP=", 0) == 0) speed = std::stod(l.substr(8));
    if (l.rfind("$APO.CDIS=", 0) == 0) blend = std::stod(l.substr(10)) * 1e-3;
    RobotMove m;
    if (l.rfind("PTP ", 0) == 0)
      m.kind = 'J';
    else if (l.rfind("LIN ", 0) == 0)
      m.kind = 'L';
    else if (l.rfind("CIRC ", 0) == 0)
      m.kind = 'C';
    else
      continue;
    m.X = pose(frames.back());
    m.via = pose(frames.front());
    m.status = std::stoi(frames.back()[7]);
    m.turns = std::stoi(frames.back()[8]);
    m.speed = speed;
    m.blend = l.find(" C_DIS") != std::string::npos ? blend : 0;
    out.moves.push_back(m);
  }
  return out;
}

/// RAPID: mm, quaternions with the real part first, [cf1, cf4, cf6, cfx].
RobotProgram read_rapid(const std::string& text) {
  RobotProgram out;
  const auto pose = [](const std::vector<double>& v, std::size_t at) {
    const Eigen::Quaterniond q(v.at(at + 3), v.at(at + 4), v.at(at + 5), v.at(at + 6));
    EXPECT_NEAR(q.norm(), 1, 1e-6);
    return Pose{q.normalized().toRotationMatrix(), Vec3(v[at], v[at + 1], v[at + 2]) * 1e-3};
  };
  double zone = 0;
  for (const std::string& raw : lines_of(text)) {
    const std::string l = raw.substr(std::min(raw.find_first_not_of(' '), raw.size()));
    const std::size_t value_at = l.find(":=");
    if (l.rfind("PERS tooldata", 0) == 0) out.tool = pose(numbers_in(l.substr(value_at)), 0);
    if (l.rfind("PERS wobjdata", 0) == 0) out.base = pose(numbers_in(l.substr(value_at)), 7);
    if (l.rfind("CONST zonedata", 0) == 0) zone = numbers_in(l.substr(value_at)).at(0) * 1e-3;
    if (l.rfind("Move", 0) != 0) continue;
    RobotMove m;
    m.kind = l[4];
    std::vector<double> v = numbers_in(l.substr(6));
    const std::size_t target = 17;  // 3 + 4 + 4 + 6
    if (m.kind == 'C') {
      m.via = pose(v, 0);
      v.erase(v.begin(), v.begin() + target);
    }
    m.X = pose(v, 0);
    for (std::size_t i = 0; i < 4; ++i) m.conf[i] = static_cast<int>(v.at(7 + i));
    m.speed = v.at(target) * 1e-3;
    m.blend = l.find(",fine,") == std::string::npos ? zone : 0;
    EXPECT_THAT(l, ::testing::EndsWith("tPart\\WObj:=wPart;"));
    out.moves.push_back(m);
  }
  return out;
}

/// URScript: m and rotation vectors in p[...].
RobotProgram read_urscript(const std::string& text) {
  RobotProgram out;
  static const std::regex pose_text(R"(p\[([^\]]+)\])");
  const auto poses = [&](const std::string& l) {
    std::vector<Pose> all;
    for (std::sregex_iterator it(l.begin(), l.end(), pose_text), end; it != end; ++it) {
      const std::vector<double> v = numbers_in((*it)[1]);
      all.push_back({rotation_of(Vec3(v.at(3), v.at(4), v.at(5))), Vec3(v[0], v[1], v[2])});
    }
    return all;
  };
  const auto after = [](const std::string& l, const std::string& key) {
    const std::size_t at = l.rfind(key);
    return at == std::string::npos ? 0.0 : std::stod(l.substr(at + key.size()));
  };
  for (const std::string& raw : lines_of(text)) {
    const std::string l = raw.substr(std::min(raw.find_first_not_of(' '), raw.size()));
    if (l.rfind("global work=", 0) == 0) out.base = poses(l).at(0);
    if (l.rfind("set_tcp(", 0) == 0) out.tool = poses(l).at(0);
    if (l.rfind("move", 0) != 0) continue;
    RobotMove m;
    m.kind = l[4] == 'j' ? 'J' : l[4] == 'c' ? 'C' : 'L';
    m.X = poses(l).back();
    m.via = poses(l).front();
    m.speed = after(l, ",v=");
    m.blend = after(l, ",r=");
    out.moves.push_back(m);
  }
  return out;
}

RobotProgram read(Dialect dialect, const std::string& text) {
  return dialect == Dialect::krl ? read_krl(text) : dialect == Dialect::rapid ? read_rapid(text) : read_urscript(text);
}

// Half of the last digit: 4 of mm (7 of m in URScript) on three axes, 6 of deg (9 of a quaternion, 8 of rad).
constexpr double kTip = 0.9e-7, kAngle = 2.5e-8;

constexpr Dialect kRobots[] = {Dialect::krl, Dialect::rapid, Dialect::urscript};

TEST(Robots, TheirProgramsHoldTheMovesOfThePlan) {
  const post::Path path = value(post::read_path(test::example("part.cl")));
  for (const test::Case& c : test::cases()) {
    for (const Dialect dialect : kRobots) {
      SCOPED_TRACE(std::string(c.machine) + " " + c.config + " " + std::to_string(int(dialect)));
      const Posted posted = test::post_to(dialect, test::machine_of(c), c.config, path, c.origin_mm);
      EXPECT_TRUE(posted.plan.ok());
      const RobotProgram program = read(dialect, posted.written.text);
      ASSERT_EQ(program.moves.size(), posted.plan.moves.size());
      EXPECT_EQ(program.moves.front().kind, 'J');
      const auto& arm = std::get<machine::SerialArm>(posted.configuration.machine);
      const Pose X_MW{Mat3::Identity(), c.origin_mm * 1e-3};
      EXPECT_LT(((arm.X_MB * program.base).p - X_MW.p).norm(), kTip);
      EXPECT_LT(rotation_vector((arm.X_MB * program.base).R).norm(), kAngle);
      EXPECT_LT((program.tool.p - arm.X_FT.p).norm(), kTip);
      int arcs = 0;
      std::size_t step = 0;
      for (std::size_t i = 0; i < program.moves.size(); ++i) {
        const RobotMove& m = program.moves[i];
        const post::PlannedMove& p = posted.plan.moves[i];
        EXPECT_LT((m.X.p - p.tip).norm(), kTip);
        EXPECT_LT(rotation_vector(m.X.R.transpose() * p.R).norm(), kAngle);
        // The flange that the controller computes is that of the joints.
        const Pose flange = arm.X_MB * program.base * m.X * program.tool.inverse();
        const Pose real = machine::forward(arm, p.joints) * arm.X_FT.inverse();
        EXPECT_LT((flange.p - real.p).norm(), 1e-6);
        const post::Step& s = posted.path.steps[static_cast<std::size_t>(p.step)];
        if (!p.inserted) {
          EXPECT_LT((m.X.p - s.tip).norm(), kTip);
          EXPECT_LT(angle_between(m.X.R.col(2), s.axis), 1e-6) << "line " << s.line;
          ++step;
        }
        if (i > 0 && s.kind != post::StepKind::rapid) {
          EXPECT_NEAR(m.speed, s.feed, 1e-6);
        }
        if (m.kind == 'C') {
          ++arcs;
          EXPECT_NEAR(m.via.p.norm(), 0.070, 2e-7);
        }
        if (m.blend > 0) {
          EXPECT_LE(m.blend, 1e-4 + 1e-12);
        }
        if (i + 1 == program.moves.size()) {
          EXPECT_EQ(m.blend, 0) << "the last point is exact";
        }
      }
      EXPECT_EQ(arcs, 4) << "two half circles in pieces of at most 120 deg";
      EXPECT_EQ(step, static_cast<std::size_t>(std::count_if(path.steps.begin(), path.steps.end(),
                                                             [](const post::Step& s) { return s.moves(); })));
    }
  }
}

/// With the names of a data list replaced by what stands there, the program is that with the values in their places.
TEST(Robots, TheDataListOfKrlHoldsWhatTheProgramNames) {
  const post::Path path = value(post::read_path(test::example("part.cl")));
  const test::Case c = test::cases().front();
  post::WriteOptions options;
  const Posted inline_values =
      test::post_to(Dialect::krl, test::machine_of(c), c.config, path, c.origin_mm, {}, options);
  EXPECT_EQ(inline_values.written.data, "");
  options.data_list = true;
  const Posted named = test::post_to(Dialect::krl, test::machine_of(c), c.config, path, c.origin_mm, {}, options);
  std::string text = named.written.text;
  const std::vector<std::string> data = lines_of(named.written.data);
  ASSERT_EQ(data.size(), 6u);
  EXPECT_EQ(data[1], "DEFDAT PART PUBLIC");
  EXPECT_EQ(data.back(), "ENDDAT");
  const std::regex declared(R"(DECL (FRAME|POS) (WORK_[A-Z]+)=(\{.*\}))");
  for (std::size_t i = 2; i + 1 < data.size(); ++i) {
    std::smatch m;
    ASSERT_TRUE(std::regex_match(data[i], m, declared)) << data[i];
    const std::size_t at = text.find(m.str(2));
    ASSERT_NE(at, std::string::npos) << m.str(2);
    text.replace(at, m.str(2).size(), m.str(3));
    EXPECT_EQ(text.find(m.str(2)), std::string::npos) << "named once";
  }
  EXPECT_EQ(text, inline_values.written.text);
  options.data_list = true;
  EXPECT_EQ(test::post_to(Dialect::rapid, test::machine_of(c), c.config, path, c.origin_mm, {}, options).written.data,
            "");
}

/// Between two points the robot turns its tool about one axis: the tool axis stays within the tolerance.
TEST(Robots, TheAxisStaysOnItsWayBetweenPoints) {
  const post::Path path = value(post::parse_cl(
      "UNITS/MM\nRAPID\nGOTO/-50,0,0,-0.3420201,0,0.9396926\nFEDRAT/600\nGOTO/50,0,0,0,0.3420201,0.9396926\nFINI\n",
      "t"));
  const Posted posted = test::post_to(Dialect::krl, test::load("lola50"), "auto", path, {0, -1300, 0});
  const RobotProgram program = read_krl(posted.written.text);
  const Vec3 k_0 = path.steps[0].axis, k_1 = path.steps[1].axis, n = k_0.cross(k_1).normalized();
  for (std::size_t i = 1; i < program.moves.size(); ++i) {
    const Pose &a = program.moves[i - 1].X, &b = program.moves[i].X;
    for (const double f : {0.1, 0.5, 0.9}) {
      const Vec3 k = (a.R * rotation_of(f * rotation_vector(a.R.transpose() * b.R))).col(2);
      const double s = ((a.p + f * (b.p - a.p)).x() + 0.05) / 0.1;
      const Vec3 ideal = Eigen::AngleAxisd(s * angle_between(k_0, k_1), n) * k_0;
      EXPECT_LT(angle_between(k, ideal), 1.02 * units::from_deg(0.1));
    }
  }
}

/// The posture words against the inverse kinematics: every branch of a pose has its own S and its own cfx.
TEST(Robots, PosturesHaveNames) {
  // Counts like a robot of the makers: joint 5 is 0 where axes 4 and 6 are in line.
  const machine::AnyMachine machine = value(machine::from_text(R"(
family = "serial"
dh = [
  { a_mm = 150, alpha_deg = 90, d_mm = 450 },
  { a_mm = 700, theta_offset_deg = 90 },
  { a_mm = 0, alpha_deg = 90 },
  { d_mm = 650, alpha_deg = -90 },
  { alpha_deg = 90 },
  { d_mm = 100 },
]
tool = { a_deg = 180 }
)",
                                                               "robot.toml"));
  const post::Configuration six = value(post::configure(machine, "six"));
  const auto inverse = kinematics::inverse(six.machine, {rotation_abc(0.2, 0.1, 0.3), Vec3(0.6, 0.1, 0.5)});
  ASSERT_EQ(inverse.solutions.size(), 8u);
  std::set<int> status, cfx;
  for (const kinematics::Solution& s : inverse.solutions) {
    const post::Posture p = post::posture_of(six, s.joints);
    EXPECT_TRUE(p.known);
    // By geometry: the wrist centre in the plane of the arm, seen from axis 2 and from the elbow.
    const Pose tool = kinematics::forward(six.machine, s.joints).poses.front();
    const Vec3 wrist = rotation_z(-s.joints[0]) * (tool.p + 0.1 * tool.R.col(2)), axis_2(0.15, 0, 0.45);
    EXPECT_EQ(p.overhead, wrist.x() < 0);
    const double shoulder = s.joints[1] + std::numbers::pi / 2;
    const Vec3 elbow = axis_2 + 0.7 * Vec3(std::cos(shoulder), 0, std::sin(shoulder));
    EXPECT_EQ(p.bent, (elbow - axis_2).cross(wrist - elbow).y() > 0) << "the forearm turns down and forward";
    for (int i = 0; i < 6; ++i) EXPECT_EQ((p.turns() >> i) & 1, s.joints[i] < 0 ? 1 : 0);
    status.insert(p.status());
    cfx.insert(p.conf()[3]);
  }
  EXPECT_EQ(status.size(), 8u);
  EXPECT_EQ(status.size(), cfx.size());
  // The usual posture of a robot before its base: S 2, cfx 0; a joint at 100 deg is in quadrant 1, at -1 deg in -1.
  post::Posture p;
  p.joints = {units::from_deg(100), -0.5, 0.5, units::from_deg(-1), 0.3, units::from_deg(-181)};
  EXPECT_EQ(p.status(), 2);
  EXPECT_EQ(p.turns(), 2 + 8 + 32);
  EXPECT_EQ(p.conf(), (std::array<int, 4>{1, -1, -3, 0}));
}

TEST(Robots, LongProgramsAreSplit) {
  const post::Path path = value(post::read_path(test::example("part.cl")));
  post::WriteOptions options;
  options.moves_per_part = 40;
  options.name = "9 part-name";
  for (const Dialect dialect : kRobots) {
    const Posted whole = test::post_to(dialect, test::load("lola50"), "auto", path, {0, -1300, 0});
    const Posted split = test::post_to(dialect, test::load("lola50"), "auto", path, {0, -1300, 0}, {}, options);
    const RobotProgram a = read(dialect, whole.written.text), b = read(dialect, split.written.text);
    ASSERT_EQ(a.moves.size(), b.moves.size());
    for (std::size_t i = 0; i < a.moves.size(); ++i)
      EXPECT_TRUE(a.moves[i].X.p == b.moves[i].X.p && a.moves[i].kind == b.moves[i].kind);
    const std::regex begin(dialect == Dialect::krl     ? "DEF P_9_part_name_\\d+\\( \\)"
                           : dialect == Dialect::rapid ? "PROC part_\\d+\\(\\)"
                                                       : "def part_\\d+\\(\\):");
    const auto count = std::distance(std::sregex_iterator(split.written.text.begin(), split.written.text.end(), begin),
                                     std::sregex_iterator());
    EXPECT_EQ(count, static_cast<long>((a.moves.size() + 39) / 40));
  }
}

/// A module cannot have the name of a word of its language.
TEST(Robots, ProgramsHaveNamesThatTheirLanguageTakes) {
  const post::Path path = value(post::parse_cl("UNITS/MM\nRAPID\nGOTO/0,0,0\nFINI\n", "t"));
  post::WriteOptions options;
  for (const char* name : {"test", "WAIT", "if", "While", "module"}) {
    options.name = name;
    for (const Dialect dialect : kRobots) {
      const Posted posted = test::post_to(dialect, test::load("lola50"), "auto", path, {0, -1300, 0}, {}, options);
      const std::string head = dialect == Dialect::krl ? "DEF " : dialect == Dialect::rapid ? "MODULE " : "def ";
      EXPECT_THAT(posted.written.text, ::testing::HasSubstr(head + "P_" + name)) << name;
    }
  }
}

TEST(Robots, AreArms) {
  const post::Configuration delta = value(post::configure(test::load("delta-brno"), "auto"));
  const post::Path path = value(post::parse_cl("UNITS/MM\nRAPID\nGOTO/0,0,500\nFINI\n", "t"));
  const post::Plan plan = value(post::plan(delta, path));
  EXPECT_EQ(test::id_of(post::write(Dialect::krl, delta, path, plan)), "PO121");
}

// The rail was left out of what was written, with a yes.
TEST(Robots, AreNotWrittenWithoutTheirRails) {
  auto arm = std::get<machine::SerialArm>(test::load("kuka-kr210"));
  machine::DhRow rail;
  rail.kind = machine::JointKind::prismatic;
  rail.range = {0, 2};
  const auto id_for = [&](Dialect dialect) {
    arm.dh.insert(arm.dh.begin(), rail);
    const machine::AnyMachine machine(arm);
    const post::Configuration moving{"rail", machine, machine, post::Rotary::none};
    return test::id_of(post::write(dialect, moving, {}, {}));
  };
  EXPECT_EQ(id_for(Dialect::urscript), "PO121") << "it has no external axis";
  EXPECT_EQ(id_for(Dialect::krl), "PO121") << "two rails";
}

}  // namespace
}  // namespace polypod
