// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/families/hexapod/machine.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <numbers>

#include "../../machine/machine_file.hpp"
#include "file.hpp"
#include "polypod/core/units.hpp"

namespace polypod::machine {
namespace {

constexpr double kThird = 2 * std::numbers::pi / 3;
// Joints closer than this share of the platform's size are one joint: far above rounding, far below any workshop.
constexpr double kSameShare = 1e-9;

Vec3 on_circle(double radius, double angle) {
  return {radius * std::cos(angle), radius * std::sin(angle), 0};
}

/// The size of a set of points and whether they span a plane (three of them not on a line).
struct Span {
  double size = 0;
  bool plane = false;
};
Span span_of(const SixPoints& points) {
  Span out;
  for (const Vec3& a : points)
    for (const Vec3& b : points) out.size = std::max(out.size, (a - b).norm());
  for (const Vec3& a : points)
    for (const Vec3& b : points)
      for (const Vec3& c : points)
        if ((b - a).cross(c - a).norm() > kSameShare * out.size * out.size) out.plane = true;
  return out;
}

}  // namespace

SixPoints base_pairs(const PairedCircle& circle) {
  SixPoints out;
  for (int i = 1; i <= kLegs; ++i) {
    out[i - 1] = on_circle(circle.radius, kThird * (i / 2) + circle.pair_angle * (i % 2 - 0.5));
  }
  return out;
}

SixPoints platform_pairs(const PairedCircle& circle) {
  SixPoints out;
  for (int i = 1; i <= kLegs; ++i) {
    out[i - 1] = on_circle(circle.radius, kThird / 2 + kThird * ((i - 1) / 2) - circle.pair_angle * (i % 2 - 0.5));
  }
  return out;
}

std::array<Vec3, 4> pyramid_normals(const Vec3& s, const JointLimit& limit) {
  Vec3 tangential = Vec3::UnitZ().cross(s);
  tangential = tangential.norm() > 1e-9 ? Vec3(tangential.normalized()) : Vec3::UnitY();
  const Vec3 across = s.cross(tangential).normalized();
  const Vec3 u = std::cos(limit.angle) * tangential, v = std::cos(limit.angle_across) * across;
  const Vec3 su = std::sin(limit.angle) * s, sv = std::sin(limit.angle_across) * s;
  return {su + u, su - u, sv + v, sv - v};
}

Result<SixPoints> read_six(const config::Table& table, const std::string& key) {
  POLYPOD_ASSIGN(rows, table.points(key, 3));
  if (rows.size() != kLegs) {
    return fail("MA120", fmt::format("{}.{} has {} points, but a hexapod has six", table.name(), key, rows.size()),
                table.place_of(key));
  }
  SixPoints out;
  for (int i = 0; i < kLegs; ++i) {
    const auto& row = rows[static_cast<std::size_t>(i)];
    out[i] = Vec3(units::from_mm(row[0]), units::from_mm(row[1]), units::from_mm(row[2]));
  }
  return out;
}

std::string six_toml(const SixPoints& points) {
  std::string out = "[";
  for (int i = 0; i < kLegs; ++i) {
    out += fmt::format("{}[{}, {}, {}]", i == 0 ? "" : ", ", number_toml(units::to_mm(points[i].x())),
                       number_toml(units::to_mm(points[i].y())), number_toml(units::to_mm(points[i].z())));
  }
  return out + "]";
}

Result<SixNumbers> read_six_numbers(const config::Table& table, const std::string& key, double otherwise,
                                    config::Range range) {
  SixNumbers out;
  out.fill(otherwise);
  if (!table.has(key)) return out;
  POLYPOD_ASSIGN(numbers, table.numbers(key, kLegs, range));
  std::copy(numbers.begin(), numbers.end(), out.begin());
  return out;
}

namespace {
std::string numbers_toml(const SixNumbers& numbers, double factor) {
  std::string out = "[";
  for (int i = 0; i < kLegs; ++i) out += (i == 0 ? "" : ", ") + number_toml(factor * numbers[i]);
  return out + "]";
}
}  // namespace

std::string leg_offset_toml(const SixNumbers& offset) {
  if (offset == SixNumbers{}) return "";
  return ", offset_mm = " + numbers_toml(offset, units::kMmPerMetre);
}

std::string leg_compliance_toml(const SixNumbers& compliance) {
  const bool same = std::all_of(compliance.begin(), compliance.end(), [&](double c) { return c == compliance[0]; });
  if (same) return fmt::format(", compliance_um_per_N = {}", number_toml(units::to_um(compliance[0])));
  return ", compliance_each_um_per_N = " + numbers_toml(compliance, units::kUmPerMetre);
}

double mean_of(const SixNumbers& numbers) {
  double sum = 0;
  for (const double x : numbers) sum += x;
  return sum / kLegs;
}

Result<JointsOfFile> read_joints(const config::Table& table, const std::string& key, bool base) {
  POLYPOD_ASSIGN(part, table.table(key));
  JointsOfFile out;
  if (part.has("joints_mm")) {
    POLYPOD_ASSIGN(points, read_six(part, "joints_mm"));
    out.points = points;
  } else {
    POLYPOD_ASSIGN(radius, part.number("radius_mm", config::kPositive));
    POLYPOD_ASSIGN(angle, part.number("pair_angle_deg", {0, 120}));
    out.circle = PairedCircle{units::from_mm(radius), units::from_deg(angle)};
    out.points = base ? base_pairs(*out.circle) : platform_pairs(*out.circle);
  }
  POLYPOD_TRY(part.finish());
  return out;
}

std::string joints_toml(const std::string& key, const SixPoints& points, const std::optional<PairedCircle>& circle) {
  if (!circle) return fmt::format("{} = {{ joints_mm = {} }}\n", key, six_toml(points));
  return fmt::format("{} = {{ radius_mm = {}, pair_angle_deg = {} }}\n", key, number_toml(units::to_mm(circle->radius)),
                     number_toml(units::to_deg(circle->pair_angle)));
}

namespace {

constexpr double kAtBase = 1, kAtPlatform = -1;  // the leg leaves the platform against its direction from the base
constexpr double kFree = std::numbers::pi;       // an end without an angle

/// One axis for all six joints or six of them, from the joint along its leg; `toward` turns it to the direction from
/// base to platform.
Result<SixPoints> read_seat_axes(const config::Table& part, double toward) {
  SixPoints out;
  if (const auto one = part.numbers("axis", 3)) {
    out.fill(Vec3((*one)[0], (*one)[1], (*one)[2]));
  } else {
    POLYPOD_ASSIGN(rows, part.points("axis", 3));
    if (rows.size() != kLegs) {
      return fail("MA120", fmt::format("{}.axis has {} rows, but a hexapod has six joints", part.name(), rows.size()),
                  part.place_of("axis"), "give one axis [x, y, z] for all or six");
    }
    for (std::size_t i = 0; i < kLegs; ++i) out[i] = Vec3(rows[i][0], rows[i][1], rows[i][2]);
  }
  for (Vec3& axis : out) {
    if (!(axis.norm() > 1e-9)) {
      return fail("MA126", fmt::format("{}.axis = [0, 0, 0] has no direction", part.name()), part.place_of("axis"),
                  "give the direction from the joint along its leg");
    }
    // A unit vector to twelve digits, as a file is written, stays as it is, so that it reads back to itself.
    if (std::abs(axis.norm() - 1) > 1e-11) axis.normalize();
    axis *= toward;
  }
  return out;
}

/// One number for all six or six numbers, deg.
Result<SixNumbers> read_cones(const config::Table& part) {
  constexpr config::Range kAngle{0, 180, true, true};
  SixNumbers out;
  if (const auto each = part.numbers("cone_deg", kLegs, kAngle)) {
    std::copy(each->begin(), each->end(), out.begin());
  } else if (each.error().id != "CF104") {
    return tl::unexpected(each.error());
  } else {
    POLYPOD_ASSIGN(all, part.number("cone_deg", kAngle));
    out.fill(all);
  }
  for (double& angle : out) angle = units::from_deg(angle);
  return out;
}

Result<JointSeats> read_seats(const config::Table& joint, const char* end, double toward) {
  JointSeats out;
  POLYPOD_ASSIGN(part, joint.optional_table(end));
  if (!part) return out;
  if (part->has("axis")) {
    POLYPOD_ASSIGN(axes, read_seat_axes(*part, toward));
    out.axis = axes;
  }
  if (part->has("cone_deg")) {
    POLYPOD_ASSIGN(angles, read_cones(*part));
    out.angle = angles;
  }
  POLYPOD_TRY(part->finish());
  return out;
}

bool all_equal(const SixNumbers& numbers) {
  return std::all_of(numbers.begin(), numbers.end(), [&](double x) { return x == numbers[0]; });
}

std::string seats_toml(const char* end, const JointSeats& seats, double toward) {
  std::string out;
  if (seats.axis) {
    for (const Vec3& a : *seats.axis) {
      out += fmt::format("{}[{}, {}, {}]", out.empty() ? "axis = [" : ", ", number_toml(toward * a.x()),
                         number_toml(toward * a.y()), number_toml(toward * a.z()));
    }
    out += "]";
  }
  if (seats.angle) {
    out += out.empty() ? "cone_deg = " : ", cone_deg = ";
    out += all_equal(*seats.angle) ? number_toml(units::to_deg((*seats.angle)[0]))
                                   : numbers_toml(*seats.angle, units::to_deg(1));
  }
  return out.empty() ? out : fmt::format(", {} = {{ {} }}", end, out);
}

void push_seats(std::vector<Parameter>& out, const std::string& end, const JointSeats& seats) {
  if (!seats.angle) return;
  if (all_equal(*seats.angle)) {
    out.push_back({"joint." + end + ".cone", (*seats.angle)[0], "deg"});
    return;
  }
  for (std::size_t i = 0; i < kLegs; ++i) {
    out.push_back({fmt::format("joint.{}.cone[{}]", end, i + 1), (*seats.angle)[i], "deg"});
  }
}

}  // namespace

Result<JointsOfLegs> read_joint_limits(const config::Table& table) {
  JointsOfLegs out;
  JointLimit& limit = out.limit;
  POLYPOD_ASSIGN(part, table.optional_table("joint"));
  if (!part) return out;
  POLYPOD_ASSIGN(kind, part->optional_text("limit", part->has("pyramid_deg") ? "pyramid" : "cone"));
  const bool seats = part->has("base") || part->has("platform");
  if (seats && kind != "cone") {
    return fail("MA126", fmt::format("joint.limit = \"{}\" has no seats of its own at base and platform", kind),
                part->place_of(part->has("base") ? "base" : "platform"), "joint.base and joint.platform need cones");
  }
  if (kind == "cone" || kind == "elevation") {
    limit.kind = kind == "cone" ? JointLimitKind::cone : JointLimitKind::elevation;
    if (seats && !part->has("cone_deg")) {
      limit.angle = kFree;
    } else {
      POLYPOD_ASSIGN(angle, part->number("cone_deg", {0, 180, true, true}));
      limit.angle = units::from_deg(angle);
    }
    POLYPOD_ASSIGN(base, read_seats(*part, "base", kAtBase));
    POLYPOD_ASSIGN(platform, read_seats(*part, "platform", kAtPlatform));
    out.base = base;
    out.platform = platform;
  } else if (kind == "pyramid") {
    limit.kind = JointLimitKind::pyramid;
    POLYPOD_ASSIGN(angles, part->numbers("pyramid_deg", 2, {0, 90, true, true}));
    limit.angle = units::from_deg(angles[0]);
    limit.angle_across = units::from_deg(angles[1]);
  } else if (kind != "none") {
    return fail("MA122",
                fmt::format("joint.limit = \"{}\" must be \"cone\", \"elevation\", \"pyramid\" or \"none\"", kind),
                part->place_of("limit"));
  }
  POLYPOD_TRY(part->finish());
  return out;
}

std::string joint_limits_toml(const JointsOfLegs& joints) {
  const JointLimit& limit = joints.limit;
  if (limit.kind == JointLimitKind::none) return "";
  if (limit.kind == JointLimitKind::pyramid) {
    return fmt::format("joint = {{ limit = \"pyramid\", pyramid_deg = [{}, {}] }}\n",
                       number_toml(units::to_deg(limit.angle)), number_toml(units::to_deg(limit.angle_across)));
  }
  return fmt::format("joint = {{ limit = \"{}\"{}{}{} }}\n", limit.kind == JointLimitKind::cone ? "cone" : "elevation",
                     limit.angle == kFree ? "" : ", cone_deg = " + number_toml(units::to_deg(limit.angle)),
                     seats_toml("base", joints.base, kAtBase), seats_toml("platform", joints.platform, kAtPlatform));
}

void push_circle(std::vector<Parameter>& out, const std::string& key, const std::optional<PairedCircle>& circle) {
  if (!circle) return;
  out.push_back({key + ".radius", circle->radius, "mm"});
  out.push_back({key + ".pair_angle", circle->pair_angle, "deg"});
}

void push_joint_limits(std::vector<Parameter>& out, const JointsOfLegs& joints) {
  const JointLimit& limit = joints.limit;
  if (limit.kind == JointLimitKind::cone || limit.kind == JointLimitKind::elevation) {
    if (limit.angle != kFree) out.push_back({"joint.cone", limit.angle, "deg"});
    push_seats(out, "base", joints.base);
    push_seats(out, "platform", joints.platform);
  } else if (limit.kind == JointLimitKind::pyramid) {
    out.push_back({"joint.pyramid[1]", limit.angle, "deg"});
    out.push_back({"joint.pyramid[2]", limit.angle_across, "deg"});
  }
}

Result<double> read_tool_length(const config::Table& table) {
  POLYPOD_ASSIGN(part, table.optional_table("tool"));
  if (!part) return 0.0;
  POLYPOD_ASSIGN(length, part->optional_number("length_mm", 0));
  POLYPOD_TRY(part->finish());
  return units::from_mm(length);
}

Status check_legs(const config::Table& table, const SixPoints& base, const SixPoints& platform) {
  const Span at_base = span_of(base), at_platform = span_of(platform);
  for (const auto& [span, end] : {std::pair{at_base, "base"}, std::pair{at_platform, "platform"}}) {
    if (span.plane) continue;
    return fail("MA121", fmt::format("the joints of the {} lie in one point or on one line", end), table.place(),
                "a platform on such joints turns freely about them; give at least three that span a triangle");
  }
  for (int i = 0; i < kLegs; ++i) {
    for (int j = i + 1; j < kLegs; ++j) {
      if ((base[i] - base[j]).norm() > kSameShare * at_base.size) continue;
      if ((platform[i] - platform[j]).norm() > kSameShare * at_platform.size) continue;
      return fail("MA121", fmt::format("legs {} and {} coincide at both ends", i + 1, j + 1), table.place(),
                  "two legs may share a joint (a double joint), but not both of theirs");
    }
  }
  return {};
}

}  // namespace polypod::machine
