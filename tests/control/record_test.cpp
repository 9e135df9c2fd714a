// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Whole runs in LinuxCNC: export, start, home, a program, and the record against Polypod's own inverse. They need root
// and LinuxCNC. Some machines are run every day; POLYPOD_LONG=1 runs all of the catalogue, and what goes wrong.
#include "polypod/control/record.hpp"

#include <gtest/gtest.h>
#include <unistd.h>

#include <chrono>
#include <cmath>
#include <cstdlib>
#include <fstream>
#include <limits>
#include <map>
#include <numbers>
#include <sstream>
#include <thread>

#include "machines.hpp"
#include "module_host.hpp"
#include "polypod/control/force_loop.hpp"
#include "polypod/control/linuxcnc.hpp"
#include "polypod/control/watch.hpp"
#include "polypod/core/units.hpp"
#include "polypod/kinematics/any_machine.hpp"
#include "polypod/machining/correct.hpp"
#include "polypod/machining/recorded.hpp"

namespace polypod::control {
namespace {

namespace fs = std::filesystem;
using machine::JointKind;

// m and rad, the requirement.
constexpr double kAgrees = 1e-6;
// m and rad. The record's digits are 1e-12 m; what is left is the curvature of the inverse over the travel of one
// cycle. Axes that are not weighted as the joints are would be off by their acceleration times 1e-6 s^2 / 6, 1e-7 and
// more.
constexpr double kAgreesWell = 5e-8;

/// What may make namespaces of its own, as `record` does: root, outside of most containers.
bool may_run() {
  return ::geteuid() == 0 && std::system("unshare --pid --fork --mount true 2> /dev/null") == 0;
}
#define POLYPOD_NEEDS_RUNS                                                                              \
  ASSERT_TRUE(test::has_linuxcnc()) << "scripts/install-packages test brings LinuxCNC and its headers"; \
  if (!may_run()) GTEST_SKIP() << "record needs root and namespaces"
/// These, where POLYPOD_LONG is set; else none.
template <class T>
std::vector<T> where_long(std::vector<T> cases) {
  return std::getenv("POLYPOD_LONG") != nullptr ? cases : std::vector<T>();
}

void write(const fs::path& file, const std::string& text) {
  std::ofstream(file) << text;
}
LinuxcncConfiguration exported(const std::string& machine, const fs::path& folder) {
  LinuxcncOptions options;
  options.stands = 200;
  const auto out = linuxcnc_configuration(test::load(machine), options);
  if (!out) throw std::runtime_error(to_string(out.error()));
  for (const auto& file : out->files) write(folder / file.name, file.text);
  return *out;
}

struct Row {
  double time = 0;
  int line = 0;
  std::vector<double> pose, joints;  ///< mm, deg
};
std::vector<Row> rows_of(const std::string& csv) {
  std::istringstream lines(csv);
  std::vector<Row> out;
  std::string text;
  std::getline(lines, text);
  while (std::getline(lines, text)) {
    std::istringstream cells(text);
    Row row;
    std::size_t k = 0;
    for (std::string cell; std::getline(cells, cell, ','); ++k) {
      const double value = std::stod(cell);
      if (k == 0) row.time = value;
      if (k == 1) row.line = static_cast<int>(value);
      if (k >= 2 && k < 8) row.pose.push_back(value);
      if (k >= 8) row.joints.push_back(value);
    }
    out.push_back(row);
  }
  return out;
}

/// m and rad
JointVector joints_of(const AnyMachine& m, const Row& row) {
  JointVector q(static_cast<Eigen::Index>(row.joints.size()));
  for (int i = 0; i < static_cast<int>(q.size()); ++i) {
    const double value = row.joints[static_cast<std::size_t>(i)];
    q[i] = kinematics::joint_kind(m, i) == JointKind::revolute ? units::from_deg(value) : units::from_mm(value);
  }
  return q;
}

/// Every so many rows: the joints are a solution of the inverse at the tip of the same row. Returns the largest
/// difference, m or rad.
double off(const AnyMachine& m, const std::vector<Row>& rows, std::size_t step) {
  const machine::Task task = kinematics::task(m);
  double worst = 0;
  for (std::size_t k = 0; k < rows.size(); k += step) {
    std::vector<double> c;
    for (int i = 0; i < task.size(); ++i) {
      const double value = rows[k].pose[static_cast<std::size_t>(task[i])];
      c.push_back(task.is_angle(i) ? units::from_deg(value) : units::from_mm(value));
    }
    const auto found = kinematics::inverse(m, kinematics::pose_of(task, c));
    const JointVector q = joints_of(m, rows[k]);
    double nearest = std::numeric_limits<double>::infinity();
    for (const kinematics::Solution& s : found.solutions) {
      double apart = 0;
      for (int i = 0; i < static_cast<int>(s.joints.size()); ++i) {
        const bool turns = kinematics::joint_kind(m, i) == JointKind::revolute;
        const double d = s.joints[i] - q[i];
        apart = std::max(apart, std::abs(turns ? std::remainder(d, 2 * std::numbers::pi) : d));
      }
      nearest = std::min(nearest, apart);
    }
    worst = std::max(worst, nearest);
  }
  return worst;
}

/// Every so many rows: the tip's coordinates that no pose prescribes are those that Polypod has for what a pose does.
/// Returns the largest difference, m or rad.
double off_whole_pose(const AnyMachine& m, const std::vector<Row>& rows, std::size_t step) {
  const machine::Task task = kinematics::task(m);
  double worst = 0;
  for (std::size_t k = 0; k < rows.size() && task.size() < 6; k += step) {
    const std::vector<double>& at = rows[k].pose;
    std::vector<double> c;
    for (int i = 0; i < task.size(); ++i) {
      const double value = at[static_cast<std::size_t>(task[i])];
      c.push_back(task.is_angle(i) ? units::from_deg(value) : units::from_mm(value));
    }
    const Pose X = kinematics::settled(m, kinematics::pose_of(task, c), joints_of(m, rows[k]));
    for (int i = 0; i < 3; ++i)
      worst = std::max(worst, std::abs(X.p[i] - units::from_mm(at[static_cast<std::size_t>(i)])));
    const Mat3 R = rotation_abc(units::from_deg(at[3]), units::from_deg(at[4]), units::from_deg(at[5]));
    if (task.names_axis()) {  // C is 0 there
      worst = std::max(worst, (R.col(2) - X.R.col(2)).cwiseAbs().maxCoeff());
    } else {
      worst = std::max(worst, (R - X.R).cwiseAbs().maxCoeff());
    }
  }
  return worst;
}

/// Runs a relative program that comes back to home, and compares.
void expect_run(const test::Folder& folder, const LinuxcncConfiguration& c, const AnyMachine& m,
                const std::string& program, std::size_t lines, double agrees = kAgrees) {
  const fs::path file = folder.path() / "program.ngc";
  write(file, program);
  const auto found = record(folder.path().string(), file.string());
  ASSERT_TRUE(found) << to_string(found.error());
  const std::vector<Row> rows = rows_of(found->csv);
  ASSERT_EQ(rows.size(), found->samples);
  ASSERT_GT(rows.size(), 200U);
  EXPECT_EQ(found->lines, lines);
  EXPECT_NEAR(found->seconds, 0.001 * static_cast<double>(rows.size() - 1), 1e-9);
  for (std::size_t k = 1; k < rows.size(); ++k) EXPECT_NEAR(rows[k].time - rows[k - 1].time, 0.001, 1e-9);
  // It begins at home and comes back.
  for (const ControllerAxis& axis : c.axes) {
    const std::size_t k = std::string_view("XYZABC").find(axis.letter);
    EXPECT_NEAR(rows.front().pose[k], axis.home, 1e-6) << axis.letter;
    EXPECT_NEAR(rows.back().pose[k], axis.home, 1e-6) << axis.letter;
  }
  for (std::size_t i = 0; i < c.joints.size(); ++i) EXPECT_NEAR(rows.front().joints[i], c.joints[i].home, 1e-6);
  const std::size_t step = 1 + rows.size() / 400;
  EXPECT_LT(off(m, rows, step), agrees);
  EXPECT_LT(off_whole_pose(m, rows, step), agrees);
  // The run of LinuxCNC changed nothing in the folder.
  EXPECT_EQ(std::distance(fs::directory_iterator(folder.path()), {}), 7);
}

const std::string kLines = "G21 G17 G40 G49 G80 G54 G94 G61\nG91\nF1200\n";

TEST(Record, Delta) {
  POLYPOD_NEEDS_RUNS;
  const test::Folder folder;
  const LinuxcncConfiguration c = exported("delta-brno", folder.path());
  expect_run(folder, c, test::load("delta-brno"), kLines + "G1 X10 Y5 Z4\nG2 X6 Y6 I6 J0\nG1 X-16 Y-11 Z-4\nG90\nM2\n",
             3, kAgreesWell);
}

/// The switch for block delete stands as it is told.
TEST(Record, BlocksThatBeginWithASlash) {
  POLYPOD_NEEDS_RUNS;
  const test::Folder folder;
  exported("delta-brno", folder.path());
  const fs::path file = folder.path() / "program.ngc";
  write(file, kLines + "G1 X5\n/G1 X10\nG1 Y5\nG90\nM2\n");
  for (const bool on : {true, false}) {
    RecordOptions options;
    options.block_delete = on;
    std::string live;
    int parts = 0;
    options.rows = [&](std::string_view more) {
      live += more;
      ++parts;
    };
    const auto found = record(folder.path().string(), file.string(), options);
    ASSERT_TRUE(found) << to_string(found.error());
    EXPECT_EQ(live, found->csv) << "the rows that came while it ran";
    EXPECT_GT(parts, 5);
    const std::vector<Row> rows = rows_of(found->csv);
    ASSERT_GT(rows.size(), 100U);
    EXPECT_NEAR(rows.back().pose[0] - rows.front().pose[0], on ? 5 : 15, 1e-3);
    EXPECT_EQ(found->lines, on ? 2U : 3U);
  }
}

// In LinuxCNC itself: a force of 200 N deflects the tip, the program moves, and the sensor fails for 0.8 s. The shift
// stays for 0.1 s, fades at the rate of 400 N/s, the tool waits, and then all goes on. The force is that of a
// multiplexer whose second input is no number; the program starts it.
TEST(Record, AForceThatIsNoNumberHoldsFadesAndHoldsTheFeed) {
  POLYPOD_NEEDS_RUNS;
  const test::Folder folder;
  const LinuxcncConfiguration c = exported("lola50", folder.path());
  const std::string hal = c.files[1].name;
  std::ofstream(folder.path() / hal, std::ios::app) << fmt::format(R"(
loadrt oneshot names=lost-for
loadrt mux2 names=sensor
addf lost-for servo-thread
addf sensor servo-thread
setp lost-for.width 0.8
setp sensor.in0 200
setp sensor.in1 nan
net lost motion.digital-out-00 => lost-for.in
net no-number lost-for.out => sensor.sel
net force sensor.out => {0}.force-z
setp {0}.force-rate 400
)",
                                                                   c.module.name);
  const fs::path file = folder.path() / "program.ngc";
  write(file, kLines + "G4 P1\nG1 X10\nM62 P0\nG1 X20\nG1 X-30\nG90\nM2\n");
  // The operator is told, and a record ends with that.
  auto found = record(folder.path().string(), file.string());
  ASSERT_FALSE(found);
  EXPECT_EQ(found.error().id, "LC116");
  EXPECT_NE(to_string(found.error()).find("the force is no number"), std::string::npos);
  // What the machine does meanwhile: the same without the message.
  std::string module = c.module.source;
  const std::string told = "rtapi_print_msg(RTAPI_MSG_ERR, MODULE_NAME \": the force";
  ASSERT_NE(module.find(told), std::string::npos);
  module.replace(module.find(told), told.size(), "rtapi_print_msg(RTAPI_MSG_DBG, MODULE_NAME \": the force");
  write(folder.path() / (c.module.name + ".c"), module);
  found = record(folder.path().string(), file.string());
  ASSERT_TRUE(found) << to_string(found.error());
  const std::vector<Row> rows = rows_of(found->csv);
  const AnyMachine m = test::load("lola50");
  std::vector<double> shift, speed;  // um along z, mm/s
  for (std::size_t k = 0; k < rows.size(); ++k) {
    JointVector q(static_cast<Eigen::Index>(rows[k].joints.size()));
    for (Eigen::Index i = 0; i < q.size(); ++i) q[i] = units::from_deg(rows[k].joints[static_cast<std::size_t>(i)]);
    const double z = kinematics::forward(m, q).poses.front().p.z();
    shift.push_back(units::to_um(z) - 1000 * rows[k].pose[2]);
    speed.push_back(k == 0 ? 0 : 1000 * std::abs(rows[k].pose[0] - rows[k - 1].pose[0]));
  }
  const double whole = shift.front();
  EXPECT_LT(whole, -10);  // against the force
  const double a_cycle = std::abs(whole) * 400 / 200 * 0.001;
  std::size_t faded = 0, nine = 0, one = 0;
  double largest_step = 0, while_faded = 0;
  for (std::size_t k = 1; k < shift.size(); ++k) {
    largest_step = std::max(largest_step, std::abs(shift[k] - shift[k - 1]));
    if (nine == 0 && shift[k] > 0.9 * whole) nine = k;
    if (one == 0 && shift[k] > 0.1 * whole) one = k;
    if (shift[k] < 0.001 * whole) continue;
    ++faded;
    // But for the cycles in which the machine moves on and the shift begins to come back.
    constexpr std::size_t kMovesOn = 5;
    if (k + kMovesOn < shift.size() && shift[k + kMovesOn] > 0.001 * whole) {
      while_faded = std::max(while_faded, speed[k]);
    }
  }
  EXPECT_LT(largest_step, 1.2 * a_cycle);  // C changes on the way by some per cent
  EXPECT_NEAR(static_cast<double>(one - nine), 400, 20);
  // 0.8 s less 0.1 s of hold and 0.5 s of fading.
  EXPECT_NEAR(static_cast<double>(faded), 200, 10);
  EXPECT_LT(while_faded, 1e-6);
  // Afterwards the shift comes back, and the program comes to its end.
  EXPECT_NEAR(shift.back(), whole, 0.02 * std::abs(whole));
  EXPECT_NEAR(rows.back().pose[0], rows.front().pose[0], 1e-6);
}

// A square of 30 mm round a block, as the one of SLAV 6.1: with LinuxCNC's own planner, G64 and its rounded corners.
constexpr const char* kSquareJob = R"(
machine = "lola50"
tolerance_um = 100
[workpiece]
origin_mm = [0, -1300, 0]
rotation_deg = 0
[cutter]
name = "8 mm, 4 flutes"
diameter_mm = 8
teeth = 4
helix_deg = 30
length_mm = 20
[material]
name = "aluminium"
Ktc_N_per_mm2 = 1027.78
Krc_N_per_mm2 = 182.03
Kac_N_per_mm2 = 64.5
Kte_N_per_mm = 13.65
Kre_N_per_mm = 27.95
Kae_N_per_mm = 2.21
[stock]
kind = "allowance"
contour_mm = [[-15, -15], [15, -15], [15, 15], [-15, 15]]
allowance_mm = 4
side = "outside"
corners = "square"
z_top_mm = 0
z_bottom_mm = -20
)";
constexpr const char* kSquareProgram =
    "%\nG17 G21 G40 G49 G80 G90 G94\nG54\nT1 M6\nS8000 M3\nG0 X-29 Y19 Z10\nG0 Z2\nG1 Z-2 F400\n"
    "G1 X19 Y19 F1600\nX19 Y-19\nX-19 Y-19\nX-19 Y29\nG0 Z10\nM5\nM30\n%\n";

TEST(Record, TheDeflectedTipOnTheRealPlanner) {
  POLYPOD_NEEDS_RUNS;
  const test::Folder folder;
  exported("lola50", folder.path());
  const fs::path program = folder.path() / "square.ngc", corrected = folder.path() / "corrected.ngc",
                 job_file = folder.path() / "job.toml";
  write(program, kSquareProgram);
  write(job_file, kSquareJob);
  const auto job = machining::read_job(job_file.string());
  ASSERT_TRUE(job) << to_string(job.error());
  const auto meant = gcode::read(program.string());
  ASSERT_TRUE(meant);
  const auto moves = gcode::interpret(*meant, job->interpret_options());
  ASSERT_TRUE(moves);
  const auto correction = machining::correct(*job, *meant, *moves);
  ASSERT_TRUE(correction) << to_string(correction.error());
  ASSERT_TRUE(correction->within_tolerance) << correction->answer();
  write(corrected, correction->text());
  const auto machine = exported_machine(folder.path().string());
  ASSERT_TRUE(machine) << to_string(machine.error());
  ASSERT_GT(machine->acceleration, 0);
  RecordOptions options;
  options.parameters = work_offset_parameters(*job);
  const auto judged = [&](const fs::path& ran_file) {
    const auto run = record(folder.path().string(), ran_file.string(), options);
    EXPECT_TRUE(run) << to_string(run.error());
    const fs::path csv = folder.path() / "record.csv";
    write(csv, run->csv);
    const auto rows = read_record(machine->machine, csv.string());
    EXPECT_TRUE(rows) << to_string(rows.error());
    std::vector<machining::RecordedTip> tips;
    for (const RecordRow& row : *rows) {
      const Vec3 p = kinematics::forward(machine->machine, row.joints).poses.front().p;
      tips.push_back({row.time, row.line, job->X_MW.inverse() * p});
    }
    const auto ran = gcode::read(ran_file.string());
    const auto ran_moves = gcode::interpret(*ran, job->interpret_options());
    machining::RecordedOptions how;
    how.planner = job->controller.planner;
    how.planner.acceleration = machine->acceleration;
    how.planner.velocity = machine->velocity;
    const auto cut = machining::judge_recorded(*job, *meant, *moves, *ran, *ran_moves, tips, how);
    EXPECT_TRUE(cut) << to_string(cut.error());
    EXPECT_TRUE(cut->to_the_end);
    return *cut;
  };
  const machining::RecordedCut plain = judged(program);
  // Nothing is taken back, and the mean deflection is the predicted one but for the corners.
  EXPECT_NEAR(plain.gain.removed_mean(), 0, 0.01);
  EXPECT_NEAR(plain.gain.mean_deflection, correction->before.normal.mean, 0.02 * correction->before.normal.mean);
  // The corners of two lines by the rule of the path mode, which meets recorded motion to 0.2 um at 1 m/s^2 (see
  // path_mode.hpp); the interpolators of the joints add their own smoothing, v^2 / 12 times the square of the cycle
  // over the radius, far below.
  int corners = 0;
  for (const machining::RecordedCorner& c : plain.corners) {
    if (!c.cutting || c.bound || std::abs(units::to_deg(c.turn) - 90) > 1) continue;
    ++corners;
    EXPECT_NEAR(c.recorded, c.predicted, 0.5e-6 + 0.005 * c.predicted) << c.line;
  }
  EXPECT_GE(corners, 3);
  const machining::RecordedCut after = judged(corrected);
  EXPECT_GT(after.gain.removed_mean(), 0.98);
  EXPECT_GT(after.gain.removed_rms(), 0.9);
  EXPECT_LT(after.cut.largest_distance, job->tolerance);
  EXPECT_GT(plain.cut.largest_distance, 0.2e-3);
}

struct Square {
  machining::Job job;
  gcode::Program program;
  gcode::Interpretation moves;
};
Square square_in(const test::Folder& folder, const std::string& job_text, const std::string& program_text) {
  write(folder.path() / "square.toml", job_text);
  write(folder.path() / "square.ngc", program_text);
  auto job = machining::read_job((folder.path() / "square.toml").string());
  auto program = gcode::read((folder.path() / "square.ngc").string());
  if (!job || !program) throw std::runtime_error("the square cannot be read");
  auto moves = gcode::interpret(*program, job->interpret_options());
  if (!moves) throw std::runtime_error(to_string(moves.error()));
  return {std::move(*job), std::move(*program), std::move(*moves)};
}
/// The configuration with an on-line correction; forces a fifth larger than those of the job, a sensor 20 ms late.
void exported_online(const Square& square, OnlineMethod method, const fs::path& folder) {
  OnlineOptions options;
  options.sensor.delay = 20e-3;
  options.real_force = 1.2;
  const auto loop = force_loop(square.job, square.program, square.moves, options, method);
  if (!loop) throw std::runtime_error(to_string(loop.error()));
  LinuxcncOptions how;
  how.stands = 200;
  how.force = &*loop;
  const auto out = linuxcnc_configuration(square.job.machine, how);
  if (!out) throw std::runtime_error(to_string(out.error()));
  for (const auto& file : out->files) write(folder / file.name, file.text);
}

// The loop closed in LinuxCNC: sensor, component, kinematics module and a machine that bends under the cut. What the
// tool then cuts is judged with the stock and the real forces, not with the played machine's table.
TEST(Record, OnlineCorrectionTakesBackWhatTheJobDoesNotKnow) {
  POLYPOD_NEEDS_RUNS;
  const test::Folder files;
  const Square square = square_in(files, kSquareJob, kSquareProgram);
  // The same with the forces that are cut with.
  machining::Job real = square.job;
  for (double* k : {&real.material.ktc, &real.material.krc, &real.material.kac, &real.material.kte, &real.material.kre,
                    &real.material.kae})
    *k *= 1.2;
  for (const OnlineMethod method : {OnlineMethod::online, OnlineMethod::both}) {
    SCOPED_TRACE(name_of(method));
    const test::Folder folder;
    exported_online(square, method, folder.path());
    const fs::path ran_file =
        method == OnlineMethod::both ? folder.path() / "corrected.ngc" : files.path() / "square.ngc";
    const auto machine = exported_machine(folder.path().string());
    ASSERT_TRUE(machine) << to_string(machine.error());
    RecordOptions options;
    options.parameters = work_offset_parameters(square.job);
    const auto run = record(folder.path().string(), ran_file.string(), options);
    ASSERT_TRUE(run) << to_string(run.error());
    const fs::path csv = files.path() / "record.csv";
    write(csv, run->csv);
    const auto rows = read_record(machine->machine, csv.string());
    ASSERT_TRUE(rows) << to_string(rows.error());
    std::vector<machining::RecordedTip> tips;
    for (const RecordRow& row : *rows) {
      const Vec3 p = kinematics::forward(machine->machine, row.joints).poses.front().p;
      tips.push_back({row.time, row.line, real.X_MW.inverse() * p});
    }
    const auto ran = gcode::read(ran_file.string());
    ASSERT_TRUE(ran);
    const auto ran_moves = gcode::interpret(*ran, real.interpret_options());
    ASSERT_TRUE(ran_moves);
    const auto cut = machining::judge_recorded(real, square.program, square.moves, *ran, *ran_moves, tips, {});
    ASSERT_TRUE(cut) << to_string(cut.error());
    EXPECT_TRUE(cut->to_the_end);
    // Off-line alone leaves the fifth: 83 % removed.
    EXPECT_GT(cut->gain.mean_deflection, 0.25e-3);
    EXPECT_GT(cut->gain.removed_mean(), 0.95);
    EXPECT_GT(cut->gain.removed_rms(), method == OnlineMethod::both ? 0.9 : 0.75);
    if (method == OnlineMethod::both) {
      EXPECT_LT(cut->cut.largest_distance, 1.3 * square.job.tolerance);
    }
  }
}

// A sensor that fails on a side: the operator is told, the feed is held, and the run ends with that.
TEST(Record, OnlineCorrectionStopsWhereTheSensorFails) {
  POLYPOD_NEEDS_RUNS;
  for (const char* fault : {"M62 P0", "M62 P1"}) {  // no number; no new readings
    const test::Folder files, folder;
    const Square square = square_in(files, kSquareJob, kSquareProgram);
    exported_online(square, OnlineMethod::online, folder.path());
    std::string program = kSquareProgram;
    const std::string third = "X-19 Y-19\n";
    ASSERT_NE(program.find(third), std::string::npos);
    program.insert(program.find(third), std::string(fault) + "\n");
    write(files.path() / "fault.ngc", program);
    RecordOptions options;
    options.parameters = work_offset_parameters(square.job);
    options.partial = fault == std::string("M62 P1");
    const auto run = record(folder.path().string(), (files.path() / "fault.ngc").string(), options);
    ASSERT_EQ(run.has_value(), options.partial);
    const Error error = run ? *run->failed : run.error();
    EXPECT_EQ(error.id, "LC116") << to_string(error);
    EXPECT_NE(error.message.find("the sensor gives no force"), std::string::npos) << to_string(error);
    if (!run) continue;
    // What was recorded ends on the lines about the fault: neither at the first nor at the last.
    EXPECT_GT(run->seconds, 1);
    EXPECT_EQ(static_cast<std::size_t>(std::count(run->csv.begin(), run->csv.end(), '\n')), run->samples + 1);
    const auto whole = record(folder.path().string(), (files.path() / "square.ngc").string(), options);
    ASSERT_TRUE(whole) << to_string(whole.error());
    EXPECT_FALSE(whole->failed);
    EXPECT_LT(run->lines, whole->lines);
  }
}

/// A program of the machine's own: out from home in every length, in every angle, along an arc while all of it turns
/// back beyond home, to the other side, and home; as large as what Polypod's inverse reaches without a jump.
struct OwnProgram {
  std::string text;
  std::size_t lines = 0;
};
class Planned {
 public:
  Planned(const AnyMachine& machine, const LinuxcncConfiguration& configuration)
      : machine_(machine), c_(configuration), task_(kinematics::task(machine)) {}

  /// The largest program that is reachable. A share of what lies between home and the nearer end of each axis.
  std::optional<OwnProgram> program() const {
    constexpr double kLargest = 0.3, kLeast = 0.01;
    for (double share = kLargest; share >= kLeast; share *= 0.7)
      if (const auto out = of(share)) return out;
    return std::nullopt;
  }

 private:
  using Thousandths = std::vector<long>;  ///< mm / 1000 and deg / 1000, one a coordinate of the task
  const AnyMachine& machine_;
  const LinuxcncConfiguration& c_;
  machine::Task task_;

  [[nodiscard]] std::optional<OwnProgram> of(double share) const {
    // A line that would take longer at its axis's speed is cut short: the whole runs some seconds.
    constexpr double kLongest = 0.7;  // s
    const std::size_t n = c_.axes.size();
    Thousandths size(n, 0);
    long least = std::numeric_limits<long>::max();
    for (std::size_t k = 0; k < n; ++k) {
      const ControllerAxis& a = c_.axes[k];
      const double room = std::min(std::min(a.home - a.min, a.max - a.home), a.turns ? 90.0 : HUGE_VAL);
      size[k] = std::lround(1000 * std::min(share * room, kLongest * a.speed));
      if (!a.turns) least = std::min(least, size[k]);
      if (size[k] < 10) return std::nullopt;  // it would show nothing
    }
    const auto moved = [&](double lengths, double angles) {
      Thousandths out(n);
      for (std::size_t k = 0; k < n; ++k) {
        const double by = c_.axes[k].turns ? angles : lengths;
        out[k] = std::lround(by * (k % 2 == 0 ? 1 : -1) * static_cast<double>(size[k]));
      }
      return out;
    };
    const bool arcs = task_.holds(machine::Coordinate::x) && task_.holds(machine::Coordinate::y);
    std::string text = kLines;
    std::size_t lines = 0;
    std::vector<double> at;
    for (const ControllerAxis& a : c_.axes) at.push_back(a.home);
    Thousandths sum(n, 0);
    JointVector q = joints_at_home();
    const auto along = [&](const Thousandths& by, double feed, std::optional<long> radius = {}) {
      text += radius ? "G3" : "G1";
      for (std::size_t k = 0; k < n; ++k) {
        if (by[k] != 0) text += fmt::format(" {}{:.3f}", c_.axes[k].letter, 0.001 * static_cast<double>(by[k]));
        sum[k] += by[k];
      }
      if (radius) text += fmt::format(" I{:.3f} J0", -0.001 * static_cast<double>(*radius));
      text += fmt::format(" F{:.0f}\n", std::max(60 * feed, 1.0));
      ++lines;
      return reaches(at, by, radius, q);
    };
    double fast = 0, fast_turn = 0;
    for (const ControllerAxis& a : c_.axes) (a.turns ? fast_turn : fast) = a.speed;
    if (!along(moved(1, 0), fast)) return std::nullopt;
    if (task_.turns() && !along(moved(0, 1), fast_turn)) return std::nullopt;
    Thousandths back = moved(arcs ? 0 : -0.5, -1.5);
    if (arcs) {  // a quarter of a circle
      back[0] = -least;
      back[1] = least;
    }
    if (!along(back, fast, arcs ? std::optional<long>(least) : std::nullopt)) return std::nullopt;
    if (!along(moved(-1.2, 0.2), fast)) return std::nullopt;
    Thousandths home(n);
    for (std::size_t k = 0; k < n; ++k) home[k] = -sum[k];
    if (!along(home, fast)) return std::nullopt;
    return OwnProgram{text + "G90\nM2\n", lines};
  }

  [[nodiscard]] JointVector joints_at_home() const {
    JointVector q(static_cast<Eigen::Index>(c_.joints.size()));
    for (std::size_t i = 0; i < c_.joints.size(); ++i)
      q[static_cast<Eigen::Index>(i)] =
          c_.joints[i].turns ? units::from_deg(c_.joints[i].home) : units::from_mm(c_.joints[i].home);
    return q;
  }

  /// Goes along a move in small steps; false where a pose is out of reach or the joints would jump.
  bool reaches(std::vector<double>& at, const Thousandths& by, std::optional<long> radius, JointVector& q) const {
    constexpr int kSteps = 25;
    constexpr double kJump = 0.1;  // m or rad in one step
    const std::vector<double> begin = at;
    for (int step = 1; step <= kSteps; ++step) {
      const double part = static_cast<double>(step) / kSteps;
      std::vector<double> c;
      for (std::size_t k = 0; k < begin.size(); ++k) {
        at[k] = begin[k] + part * 0.001 * static_cast<double>(by[k]);
        if (radius && k < 2) {
          const double r = 0.001 * static_cast<double>(*radius), turn = part * std::numbers::pi / 2;
          at[k] = begin[k] + r * (k == 0 ? std::cos(turn) - 1 : std::sin(turn));
        }
        c.push_back(c_.axes[k].turns ? units::from_deg(at[k]) : units::from_mm(at[k]));
      }
      const auto found = kinematics::inverse_near(machine_, kinematics::pose_of(task_, c), q);
      if (found.solutions.empty() || found.solutions.front().violations != 0) return false;
      const JointVector& next = found.solutions.front().joints;
      if ((next - q).cwiseAbs().maxCoeff() > kJump) return false;
      q = next;
    }
    return true;
  }
};

std::string with_underscores(std::string name) {
  std::replace(name.begin(), name.end(), '-', '_');
  return name;
}
std::vector<std::string> catalogue_names() {
  std::vector<std::string> out;
  for (const auto& entry : machine::catalogue()) out.emplace_back(entry.name);
  return out;
}

class Machines : public testing::TestWithParam<std::string> {};
TEST_P(Machines, RunAProgramOfTheirOwn) {
  POLYPOD_NEEDS_RUNS;
  const test::Folder folder;
  const LinuxcncConfiguration c = exported(GetParam(), folder.path());
  const AnyMachine m = test::load(GetParam());
  const auto program = Planned(m, c).program();
  ASSERT_TRUE(program) << "no way about home that is large enough to show something";
  SCOPED_TRACE(program->text);
  expect_run(folder, c, m, program->text, program->lines);
}
// Every day all six coordinates on struts, and a chain before closed loops with coordinates that no pose prescribes.
INSTANTIATE_TEST_SUITE_P(Daily, Machines, testing::Values("hexapod-strut", "dynapod"),
                         [](const auto& machine) { return with_underscores(machine.param); });
INSTANTIATE_TEST_SUITE_P(Long, Machines, testing::ValuesIn(where_long(catalogue_names())),
                         [](const auto& machine) { return with_underscores(machine.param); });

struct Wrong {
  const char *name, *program, *id, *says;
};
class WhatGoesWrong : public testing::TestWithParam<Wrong> {};
GTEST_ALLOW_UNINSTANTIATED_PARAMETERIZED_TEST(WhatGoesWrong);
TEST_P(WhatGoesWrong, IsSaidInLinuxcncsWords) {
  POLYPOD_NEEDS_RUNS;
  const test::Folder folder;
  const LinuxcncConfiguration c = exported("delta-brno", folder.path());
  const fs::path file = folder.path() / "program.ngc";
  // The corner of the box of the axes is out of reach.
  std::string program = GetParam().program;
  for (std::size_t k = 0; k < 2; ++k) {
    const std::string word = k == 0 ? "{x}" : "{y}";
    if (const auto at = program.find(word); at != std::string::npos)
      program.replace(at, word.size(), fmt::format("{:.3f}", c.axes[k].max - c.axes[k].home - 2));
  }
  write(file, program);
  RecordOptions options;
  options.time_limit = 25;
  const auto found = record(folder.path().string(), file.string(), options);
  ASSERT_FALSE(found);
  EXPECT_EQ(found.error().id, GetParam().id) << to_string(found.error());
  EXPECT_THAT(found.error().message, testing::HasSubstr(GetParam().says));
  if (found.error().id == "LC116") {
    EXPECT_EQ(found.error().place.file, file.string());
  }
}
INSTANTIATE_TEST_SUITE_P(Long, WhatGoesWrong,
                         testing::ValuesIn(where_long<Wrong>(
                             {{"beyond_an_axis", "G21 G91 F1000\nG1 X1000\nM2\n", "LC116", "exceed"},
                              {"out_of_reach", "G21 G91 F1000\nG1 X1\nG1 X{x} Y{y}\nM2\n", "LC116", "on line 3"},
                              {"no_feed", "G21\nG1 X1 F0\nM2\n", "LC116", "feed"},
                              {"open_subprogram", "G21\nO100 sub\nM2\n", "LC116", ""},
                              {"too_long", "G21\nG4 P3000\nM2\n", "LC117", "25 s"}})),
                         [](const auto& wrong) { return std::string(wrong.param.name); });

class ManyRuns : public testing::TestWithParam<const char*> {};
GTEST_ALLOW_UNINSTANTIATED_PARAMETERIZED_TEST(ManyRuns);
TEST_P(ManyRuns, AtOnceAndAnInterruptLeaveNothing) {
  POLYPOD_NEEDS_RUNS;
  const test::Folder folder;
  exported(GetParam(), folder.path());
  const fs::path file = folder.path() / "program.ngc", wait = folder.path() / "wait.ngc";
  write(file, kLines + "G1 X10\nG1 X-10\nG90\nM2\n");
  write(wait, "G21\nG4 P60\nM2\n");
  std::vector<Result<Record>> out(3);
  std::vector<std::thread> threads;
  for (auto& one : out) threads.emplace_back([&] { one = record(folder.path().string(), file.string()); });
  for (std::thread& t : threads) t.join();
  for (const auto& one : out) {
    ASSERT_TRUE(one) << to_string(one.error());
    EXPECT_EQ(one->csv, out.front()->csv);
  }
  RecordOptions options;
  options.progress = [](double seconds) { return seconds < 6; };
  const auto broken_off = record(folder.path().string(), wait.string(), options);
  ASSERT_FALSE(broken_off);
  EXPECT_EQ(broken_off.error().id, "LC119");
  std::this_thread::sleep_for(std::chrono::milliseconds(500));
  for (const auto& entry : fs::directory_iterator(fs::temp_directory_path())) {
    EXPECT_FALSE(entry.path().filename().string().starts_with("polypod-record-")) << entry.path();
  }
  EXPECT_NE(std::system("pgrep -x milltask > /dev/null"), 0);
}

INSTANTIATE_TEST_SUITE_P(Long, ManyRuns, testing::ValuesIn(where_long<const char*>({"delta-brno"})),
                         [](const auto&) { return std::string("delta"); });

TEST(Record, RefusesWhatIsNoConfiguration) {
  const test::Folder folder;
  const std::string dir = folder.path().string();
  const auto id = [&](const std::string& where) {
    const auto found = record(where, "-");
    return found ? std::string() : found.error().id;
  };
  EXPECT_EQ(id(dir + "/nowhere"), "LC110");
  EXPECT_EQ(id(dir), "LC110");
  const LinuxcncConfiguration c = exported("delta-brno", folder.path());
  write(folder.path() / "other.ini", "");
  EXPECT_EQ(id(dir), "LC110");
  fs::remove(folder.path() / "other.ini");
  EXPECT_EQ(record(dir, dir + "/no-program.ngc").error().id, "FI100");
  // Another machine in the place of its own.
  write(folder.path() / "machine.toml", machine::to_toml(test::load("hexapod-strut")));
  EXPECT_EQ(id(dir), "LC110");
  fs::remove(folder.path() / (c.module.name + ".c"));
  EXPECT_EQ(id(dir), "LC110");
}

}  // namespace
}  // namespace polypod::control
