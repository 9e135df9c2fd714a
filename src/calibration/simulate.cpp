// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/calibration/simulate.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "model.hpp"
#include "polypod/core/random.hpp"
#include "polypod/core/units.hpp"
#include "polypod/kinematics/surplus.hpp"

namespace polypod::calibration {
namespace {

// Streams of one seed: who draws more of one thing does not change another.
constexpr std::uint64_t kOfParameters = 1, kOfStands = 2, kOfNoise = 3, kOfOutliers = 4, kOfCompliance = 5;

Vec3 normal_vector(Random& random) {
  const double x = random.normal(), y = random.normal(), z = random.normal();
  return {x, y, z};
}

Status check(const SimulationOptions& o) {
  if (o.count < 1 || o.count > 100000 || !(o.noise_position >= 0) || !(o.noise_angle >= 0) || !(o.outliers >= 0) ||
      o.outliers > 1 || o.touches < 2) {
    return fail("CA120", "an option of the simulation is out of range", {},
                "1 to 100000 rows, noise not below 0, share of outliers 0 to 1");
  }
  return {};
}

/// Stands that the controller may command and that the real machine can take: the joints of the one, the pose of the
/// other.
Result<std::vector<Stand>> common_stands(const AnyMachine& nominal, const AnyMachine& real, std::size_t count,
                                         std::uint64_t seed) {
  std::vector<Stand> out;
  for (Stand& stand : random_stands(nominal, count + count / 2 + 10, seed)) {
    const kinematics::ForwardResult at = kinematics::forward(real, stand.q);
    if (at.poses.empty() || out.size() == count) continue;
    stand.X_MT = at.poses.front();
    out.push_back(std::move(stand));
  }
  if (out.size() < count) {
    return fail("CA121", fmt::format("only {} of {} poses found within the limits", out.size(), count), {},
                kinematics::has_more_legs_than_freedoms(nominal)
                    ? "a machine with more legs than freedoms has no pose where its errors do not agree without "
                      "strain: give --perturb-mm 0 --perturb-deg 0"
                    : "widen the limits of the machine, or ask for fewer rows");
  }
  return out;
}

tl::unexpected<Error> not_finite() {
  return fail("CA121", "a reading of this machine is no finite number", {},
              "are its lengths and compliances sensible?");
}

// Nobody measures where the machine is nearly singular: a small error of a length would put the tool anywhere.
constexpr double kWorstCondition = 100;
bool steady(const AnyMachine& machine, const Stand& stand) {
  return kinematics::dexterity(machine, stand.X_MT, stand.q).condition < kWorstCondition;
}

/// The box of the poses of stands: places, and turns against the first.
struct Box {
  Mat3 R_0;
  Vec6 low = Vec6::Constant(1e300), high = Vec6::Constant(-1e300);

  explicit Box(const std::vector<Stand>& stands) : R_0(stands.front().X_MT.R) {
    for (const Stand& stand : stands) {
      Vec6 at;
      at << stand.X_MT.p, rotation_vector(stand.X_MT.R * R_0.transpose());
      low = low.cwiseMin(at);
      high = high.cwiseMax(at);
    }
  }
  void grow(double length, double angle) {
    Vec6 by;
    by << Vec3::Constant(length), Vec3::Constant(angle);
    low -= by;
    high += by;
  }
  Pose pose(Random& random) const {
    Vec6 at;
    for (int i = 0; i < 6; ++i) at[i] = random.uniform(low[i], high[i]);
    return {rotation_of(at.tail<3>()) * R_0, at.head<3>()};
  }
};

/// Adds a stand at the pose if the machine takes it there; what the joints say must be this pose and no other assembly
/// mode.
bool add_stand_at(const AnyMachine& machine, const Pose& target, std::vector<Stand>& out) {
  const kinematics::InverseResult inverse = kinematics::inverse(machine, target);
  const kinematics::Solution* s = inverse.reachable();
  if (s == nullptr) return false;
  const Pose X_MT = kinematics::settled(machine, target, s->joints);
  const kinematics::ForwardResult back = kinematics::forward(machine, s->joints);
  if (back.poses.empty()) return false;
  if ((back.poses.front().p - X_MT.p).norm() + (back.poses.front().R - X_MT.R).norm() > 1e-6) return false;
  Stand stand{s->joints, X_MT};
  if (!steady(machine, stand)) return false;
  out.push_back(std::move(stand));
  return true;
}

}  // namespace

Result<AnyMachine> perturbed(const AnyMachine& machine, double length, double angle, std::uint64_t seed) {
  Random random(seed, kOfParameters);
  std::vector<double> p;
  for (const machine::Parameter& parameter : kinematics::parameters(machine)) {
    p.push_back(parameter.value + (parameter.unit == "mm" ? length : angle) * random.normal());
  }
  return machine::with_parameters(machine, p);
}

Result<AnyMachine> perturbed_compliance(const AnyMachine& machine, double share, std::uint64_t seed) {
  Random random(seed, kOfCompliance);
  std::vector<double> c = statics::column_compliances(machine);
  for (double& value : c) value *= std::max(0.1, 1 + share * random.normal());
  return statics::with_compliances(machine, c);
}

std::vector<Stand> random_stands(const AnyMachine& machine, std::size_t count, std::uint64_t seed) {
  constexpr int kMostDraws = 300000;
  constexpr int kMostInVain = 100000;  // draws of joints without a first stand
  constexpr std::size_t kFirst = 24;
  constexpr int kPoor = 10;  // draws a stand, above which poses are drawn instead of joints
  constexpr int kSparse = 20000;
  Random random(seed, kOfStands);
  const int n = kinematics::joint_count(machine);
  std::vector<Stand> out;
  int draw = 0;
  for (; draw < kMostDraws && out.size() < count; ++draw) {
    if (out.size() >= kFirst && draw > kPoor * static_cast<int>(out.size())) break;
    if (draw > (out.empty() ? kMostInVain : kSparse)) break;
    if (const auto home = kinematics::home_pose(machine); draw == kSparse && out.empty() && home) {
      // A machine that does not even take its home pose will hardly take another.
      if (!add_stand_at(machine, *home, out)) break;
    }
    Stand stand;
    stand.q.resize(n);
    for (int i = 0; i < n; ++i) {
      const machine::JointRange range = kinematics::joint_range(machine, i);
      stand.q[i] = random.uniform(range.min, range.max);
    }
    const kinematics::ForwardResult at = kinematics::forward(machine, stand.q);
    if (at.poses.empty()) continue;
    stand.X_MT = at.poses.front();
    if (kinematics::violations(machine, stand.X_MT, stand.q) == 0 && steady(machine, stand)) {
      out.push_back(std::move(stand));
    }
  }
  if (out.size() >= count || out.empty()) return out;
  // A parallel machine has few joints that fit together, but a quick inverse: draw poses, from the box of the first.
  Box box(out);
  if (out.size() < kFirst) {
    box.grow(0.1 * size_of(machine), 0.1);
    for (; draw < kMostDraws && out.size() < std::min(count, kFirst); ++draw) {
      if (!add_stand_at(machine, box.pose(random), out)) continue;
      box = Box(out);
      box.grow(0.1 * size_of(machine), 0.1);
    }
    box = Box(out);
  }
  for (; draw < kMostDraws && out.size() < count; ++draw) add_stand_at(machine, box.pose(random), out);
  return out;
}

Result<std::vector<Measurement>> simulate(const AnyMachine& nominal, const AnyMachine& real,
                                          const SimulationOptions& o) {
  POLYPOD_TRY(check(o));
  POLYPOD_ASSIGN(stands, common_stands(nominal, real, o.count, o.seed));
  Random noise(o.seed, kOfNoise), off(o.seed, kOfOutliers);
  const std::vector<Vec3> anchors = o.anchors.empty() ? std::vector<Vec3>{Vec3::Zero()} : o.anchors;
  std::vector<Measurement> rows;
  if (o.kind == Kind::contact) {
    constexpr double kTilt = 20;  // deg
    const machine::Task task = kinematics::task(real);
    for (std::size_t place = 0; rows.size() < o.count && place < stands.size(); ++place) {
      std::vector<Measurement> touches;
      for (int trial = 0; trial < 200 && touches.size() < o.touches; ++trial) {
        const Vec3 turn =
            units::from_deg(kTilt) * Vec3(noise.uniform(-1, 1), noise.uniform(-1, 1), noise.uniform(-1, 1));
        Pose target = stands[place].X_MT;
        if (task.turns()) target.R = rotation_of(turn) * target.R;
        target.p = (stands[place].X_MT * o.X_TR).p - target.R * o.X_TR.p + o.noise_position * normal_vector(noise);
        // As at stands: not nearly singular, and with joints that both machines can take.
        std::vector<Stand> touch;
        if (!add_stand_at(real, target, touch) || kinematics::forward(nominal, touch[0].q).poses.empty()) continue;
        // Where x, y or z follows from the turn, the point is elsewhere.
        constexpr double kSamePlace = 1e-6;  // m
        if (((touch[0].X_MT * o.X_TR).p - (target * o.X_TR).p).norm() > kSamePlace) continue;
        Measurement row;
        row.kind = o.kind;
        row.q = touch[0].q;
        row.contact = fmt::format("{}", place + 1);
        touches.push_back(std::move(row));
      }
      if (touches.size() < o.touches) continue;
      for (Measurement& row : touches)
        if (rows.size() < o.count) rows.push_back(std::move(row));
    }
    if (rows.empty()) {
      return fail("CA121", "no point was found that can be touched from several directions", {},
                  "where a turn of the tool takes its tip elsewhere, measure points, poses or gauge readings");
    }
    return rows;
  }
  for (const Stand& stand : stands) {
    Measurement row;
    row.kind = o.kind;
    row.q = stand.q;
    Pose Y = o.X_SM * stand.X_MT * o.X_TR;
    Y.p += o.noise_position * normal_vector(noise);
    Y.R = rotation_of(o.noise_angle * normal_vector(noise)) * Y.R;
    if (off.uniform() < o.outliers) Y.p += o.outlier_size * normal_vector(off).normalized();
    row.X_SR = Y;
    row.anchor_S = anchors[rows.size() % anchors.size()];
    // Noise along the line of sight: the target's own has the right size in every direction.
    if (o.kind == Kind::distance) row.reading = (Y.p - row.anchor_S).norm();
    if (o.kind == Kind::gauge) row.reading = row.normal_S.dot(Y.p - row.anchor_S);
    if (!Y.p.allFinite() || !Y.R.allFinite() || !std::isfinite(row.reading)) return not_finite();
    rows.push_back(std::move(row));
  }
  return rows;
}

Result<std::vector<statics::MeasuredPoint>> simulate_displacements(const AnyMachine& machine, double force,
                                                                   const SimulationOptions& o) {
  POLYPOD_TRY(check(o));
  if (!(force > 0)) return fail("CA120", "the force must be above 0");
  if (!statics::has_compliance(machine)) return fail("CA122", "the machine has no compliances");
  POLYPOD_ASSIGN(stands, common_stands(machine, machine, o.count, o.seed));
  Random noise(o.seed, kOfNoise), off(o.seed, kOfOutliers);
  std::vector<statics::MeasuredPoint> points;
  for (const Stand& stand : stands) {
    statics::MeasuredPoint point;
    point.X_MT = kinematics::pose_of(kinematics::task(machine),
                                     kinematics::coordinates_of(kinematics::task(machine), stand.X_MT));
    point.force = force;
    const statics::Compliance c = statics::compliance_at(machine, point.X_MT);
    if (!c.reachable) continue;
    point.displacement = c.linear() * force;
    for (double& d : point.displacement.reshaped()) {
      d += o.noise_position * noise.normal();
      if (off.uniform() < o.outliers) d += off.uniform() < 0.5 ? o.outlier_size : -o.outlier_size;
    }
    if (!point.displacement.allFinite()) return not_finite();
    points.push_back(point);
  }
  if (points.size() < o.count) {
    return fail("CA121", fmt::format("only {} of {} poses found within the limits", points.size(), o.count));
  }
  return points;
}

std::string displacements_csv(const std::vector<statics::MeasuredPoint>& points) {
  static constexpr const char* kAxes = "xyz";
  std::string out = "x_mm,y_mm,z_mm,a_deg,b_deg,c_deg,force_N";
  for (int f = 0; f < 3; ++f)
    for (int d = 0; d < 3; ++d) out += fmt::format(",d{}_F{}_um", kAxes[d], kAxes[f]);
  out += '\n';
  for (const statics::MeasuredPoint& point : points) {
    const Vec3 p = point.X_MT.p * units::kMmPerMetre, abc = angles_abc(point.X_MT.R) / units::kRadPerDeg;
    out += fmt::format("{:.6f},{:.6f},{:.6f},{:.7f},{:.7f},{:.7f},{:g}", p.x(), p.y(), p.z(), abc.x(), abc.y(), abc.z(),
                       point.force);
    for (int f = 0; f < 3; ++f)
      for (int d = 0; d < 3; ++d) out += fmt::format(",{:.4f}", units::to_um(point.displacement(d, f)));
    out += '\n';
  }
  return out;
}

}  // namespace polypod::calibration
