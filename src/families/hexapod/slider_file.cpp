// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/families/hexapod/slider_machine.hpp"

#include <fmt/format.h>

#include <cmath>
#include <numbers>

#include "../../machine/machine_file.hpp"
#include "../../machine/parameter_list.hpp"
#include "file.hpp"
#include "polypod/core/units.hpp"

namespace polypod::machine {
namespace {

/// Rails of JEL Figure 8.14: pair k about k * 120 deg, legs (6,1), (2,3), (4,5) as for the struts; the radii are
/// measured along the middle line of a pair.
void place_pairs(SliderHexapod& m) {
  const PairedRails& r = *m.rail_pairs;
  for (int i = 1; i <= kLegs; ++i) {
    const double angle = 2 * std::numbers::pi / 3 * (i / 2);
    const Vec3 outward(std::cos(angle), std::sin(angle), 0), across(-std::sin(angle), std::cos(angle), 0);
    const Vec3 side = r.spacing * (i % 2 - 0.5) * across;
    m.rail_outer[i - 1] = r.outer_radius * outward + side;
    m.rail_inner[i - 1] = r.inner_radius * outward + Vec3(0, 0, r.inner_height) + side;
  }
}

Result<SliderHexapod> with_rails(const config::Table& table, SliderHexapod m) {
  POLYPOD_ASSIGN(rail, table.table("rail"));
  if (rail.has("outer_mm") || rail.has("inner_mm")) {
    POLYPOD_ASSIGN(outer, read_six(rail, "outer_mm"));
    POLYPOD_ASSIGN(inner, read_six(rail, "inner_mm"));
    m.rail_outer = outer;
    m.rail_inner = inner;
  } else {
    POLYPOD_ASSIGN(outer_radius, rail.number("outer_radius_mm", config::kPositive));
    POLYPOD_ASSIGN(inner_radius, rail.number("inner_radius_mm", config::kNotNegative));
    POLYPOD_ASSIGN(inner_height, rail.number("inner_height_mm"));
    POLYPOD_ASSIGN(spacing, rail.number("spacing_mm", config::kNotNegative));
    m.rail_pairs = PairedRails{units::from_mm(outer_radius), units::from_mm(inner_radius), units::from_mm(inner_height),
                               units::from_mm(spacing)};
    place_pairs(m);
  }
  POLYPOD_TRY(rail.finish());
  double size = 0;
  for (const Vec3& a : m.rail_outer)
    for (const Vec3& b : m.rail_inner) size = std::max(size, (a - b).norm());
  for (int i = 0; i < kLegs; ++i) {
    const Vec3 along = m.rail_inner[i] - m.rail_outer[i];
    m.rail_length[i] = along.norm();
    if (!(m.rail_length[i] > 1e-9 * size) || !(size > 0)) {
      return fail("MA130", fmt::format("rail {} has no length", i + 1), rail.place());
    }
    m.rail_direction[i] = along / m.rail_length[i];
  }
  for (int i = 0; i < kLegs; ++i) {
    // The neighbours' outer ends span a plane with this rail; legs stay on the side of the normal (4.17).
    const Vec3 before = m.rail_outer[(i + kLegs - 1) % kLegs] - m.rail_outer[i];
    const Vec3 after = m.rail_outer[(i + 1) % kLegs] - m.rail_outer[i];
    const Vec3 n1 = m.rail_direction[i].cross(before), n2 = after.cross(m.rail_direction[i]);
    if (n1.norm() > 1e-9 * size)
      m.guard[i][0] = n1.normalized();
    else
      m.guard[i][0].setZero();
    if (n2.norm() > 1e-9 * size)
      m.guard[i][1] = n2.normalized();
    else
      m.guard[i][1].setZero();
  }
  return m;
}

}  // namespace

Result<SliderHexapod> SliderHexapod::from(const config::Table& table) {
  SliderHexapod empty;
  POLYPOD_TRY(read_common(table, empty.name, empty.description, empty.provenance));
  POLYPOD_ASSIGN(m, with_rails(table, std::move(empty)));
  POLYPOD_ASSIGN(platform, read_joints(table, "platform", false));
  m.platform_joint = platform.points;
  m.platform_circle = platform.circle;
  POLYPOD_TRY(check_legs(table, m.rail_outer, m.platform_joint));

  POLYPOD_ASSIGN(leg, table.table("leg"));
  POLYPOD_ASSIGN(length, leg.number("length_mm", config::kPositive));
  POLYPOD_ASSIGN(diameter, leg.optional_number("diameter_mm", 0, config::kNotNegative));
  POLYPOD_ASSIGN(base_check, leg.optional_boolean("base_check", false));
  POLYPOD_ASSIGN(compliance, leg.optional_number("compliance_um_per_N", 0, config::kNotNegative));
  POLYPOD_ASSIGN(each, read_six_numbers(leg, "compliance_each_um_per_N", compliance, config::kNotNegative));
  POLYPOD_ASSIGN(offset, read_six_numbers(leg, "offset_mm", 0));
  POLYPOD_TRY(leg.finish());
  m.leg_length = units::from_mm(length);
  m.leg_diameter = units::from_mm(diameter);
  m.base_check = base_check;
  for (int i = 0; i < kLegs; ++i) {
    m.leg_compliance[i] = units::from_um(each[i]);
    m.leg_offset[i] = units::from_mm(offset[i]);
    if (!(m.length_of_leg(i) > 0)) {
      return fail("MA133", fmt::format("leg.offset_mm[{}] = {:g} leaves no leg", i + 1, offset[i]),
                  leg.place_of("offset_mm"));
    }
  }
  m.compliance = mean_of(m.leg_compliance);
  POLYPOD_ASSIGN(tool_length, read_tool_length(table));
  m.tool_length = tool_length;
  POLYPOD_ASSIGN(joints, read_joint_limits(table));
  m.joint = joints.limit;
  m.base_seats = joints.base;
  m.platform_seats = joints.platform;
  POLYPOD_TRY(read_tip_limits(table, m));

  POLYPOD_ASSIGN(home, table.optional_table("home"));
  if (home) {
    if (home->has("height_mm")) {
      POLYPOD_ASSIGN(height, home->number("height_mm"));
      m.home.height_given = units::from_mm(height);
    }
    POLYPOD_ASSIGN(share, home->optional_number("slider", SliderHexapod::kHomeSlider, {0, 1}));
    m.home_slider = share;
    POLYPOD_TRY(home->finish());
  }
  POLYPOD_TRY(table.finish());

  // Home: the given height, or the one at which legs from the sliders' home have (in the mean of squares) their length.
  SixPoints from;
  double mean_z = 0, mean_square = 0, mean_leg = 0;
  for (int i = 0; i < kLegs; ++i) {
    from[i] = m.platform_joint[i] - (m.rail_outer[i] + m.home_slider * m.rail_length[i] * m.rail_direction[i]);
    mean_z += from[i].z() / kLegs;
    mean_square += from[i].squaredNorm() / kLegs;
    mean_leg += m.length_of_leg(i) * m.length_of_leg(i) / kLegs;
  }
  const double under_root = mean_leg - mean_square + mean_z * mean_z;
  if (m.home.height_given) {
    m.home.height = *m.home.height_given;
  } else if (under_root > 0) {
    m.home.height = std::sqrt(under_root) - mean_z;
  } else {
    return fail("MA131",
                fmt::format("legs of {:g} mm do not reach the platform from {:g} of the rails", length, m.home_slider),
                home ? home->place() : table.place(), "change home.slider or give home.height_mm");
  }
  for (int i = 0; i < kLegs; ++i) {
    Vec3 direction = from[i] + Vec3(0, 0, m.home.height);
    if (m.home.height_given) {  // where the slider really stands then: the root nearer the outer end
      const Vec3 y = m.platform_joint[i] + Vec3(0, 0, m.home.height) - m.rail_outer[i];
      const Vec3 across = y - m.rail_direction[i].dot(y) * m.rail_direction[i];
      const double square_root = m.length_of_leg(i) * m.length_of_leg(i) - across.squaredNorm();
      if (square_root < 0) {
        return fail("MA132",
                    fmt::format("leg {} does not reach its rail at the home height of {:g} mm", i + 1,
                                units::to_mm(m.home.height)),
                    home->place_of("height_mm"));
      }
      direction = across + std::sqrt(square_root) * m.rail_direction[i];
    }
    m.home.direction[i] = direction.normalized();
  }
  return m;
}

namespace {
template <class Each>
void list_parameters(const SliderHexapod& m, Each&& each) {
  for (int i = 0; i < kLegs; ++i) {
    each(m.length_of_leg(i), "mm", "leg.length[{}]", i + 1);
    list_point(each, m.rail_outer[i], "mm", "base.joint[{}].{}", i);
    list_point(each, m.rail_direction[i], "", "rail.direction[{}].{}", i);
    list_point(each, m.platform_joint[i], "mm", "platform.joint[{}].{}", i);
  }
  each(m.tool_length, "mm", "tool.length");
}
}  // namespace

std::vector<Parameter> parameters(const SliderHexapod& m) {
  return named_parameters([&](auto&& each) { list_parameters(m, each); });
}
std::vector<double> parameter_values(const SliderHexapod& m) {
  return values_of([&](auto&& each) { list_parameters(m, each); });
}

std::vector<Parameter> settings(const SliderHexapod& m) {
  std::vector<Parameter> out;
  if (m.rail_pairs) {
    out.push_back({"rail.outer_radius", m.rail_pairs->outer_radius, "mm"});
    out.push_back({"rail.inner_radius", m.rail_pairs->inner_radius, "mm"});
    out.push_back({"rail.inner_height", m.rail_pairs->inner_height, "mm"});
    out.push_back({"rail.spacing", m.rail_pairs->spacing, "mm"});
  }
  push_circle(out, "platform", m.platform_circle);
  out.push_back({"leg.length", m.leg_length, "mm"});
  out.push_back({"leg.diameter", m.leg_diameter, "mm"});
  out.push_back({"tool.length", m.tool_length, "mm"});
  push_joint_limits(out, {m.joint, m.base_seats, m.platform_seats});
  out.push_back({"home.slider", m.home_slider, ""});
  out.push_back({"home.height", m.home.height, "mm"});
  push_tip_limits(out, m);
  return out;
}

std::string to_toml(const SliderHexapod& m) {
  std::string out = common_toml(m.name, std::string(SliderHexapod::kFamily), m.description);
  if (m.rail_pairs) {
    const PairedRails& r = *m.rail_pairs;
    out +=
        fmt::format("rail = {{ outer_radius_mm = {}, inner_radius_mm = {}, inner_height_mm = {}, spacing_mm = {} }}\n",
                    number_toml(units::to_mm(r.outer_radius)), number_toml(units::to_mm(r.inner_radius)),
                    number_toml(units::to_mm(r.inner_height)), number_toml(units::to_mm(r.spacing)));
  } else {
    out += fmt::format("rail = {{ outer_mm = {}, inner_mm = {} }}\n", six_toml(m.rail_outer), six_toml(m.rail_inner));
  }
  out += joints_toml("platform", m.platform_joint, m.platform_circle);
  out += fmt::format("leg = {{ length_mm = {}, diameter_mm = {}, base_check = {}{}{} }}\n",
                     number_toml(units::to_mm(m.leg_length)), number_toml(units::to_mm(m.leg_diameter)), m.base_check,
                     leg_compliance_toml(m.leg_compliance), leg_offset_toml(m.leg_offset));
  out += fmt::format("tool = {{ length_mm = {} }}\n", number_toml(units::to_mm(m.tool_length)));
  out += joint_limits_toml({m.joint, m.base_seats, m.platform_seats}) + tip_limits_toml(m);
  if (m.home.height_given) {
    out += fmt::format("home = {{ slider = {}, height_mm = {} }}\n", number_toml(m.home_slider),
                       number_toml(units::to_mm(*m.home.height_given)));
  } else {
    out += fmt::format("home = {{ slider = {} }}\n", number_toml(m.home_slider));
  }
  return out + provenance_toml(m.provenance);
}

Result<SliderHexapod> with_parameters(const SliderHexapod& m, std::span<const double> p) {
  SliderHexapod out = m;
  for (int i = 0; i < kLegs; ++i) {
    const double* leg = p.data() + 10 * i;
    const Vec3 outer(leg[1], leg[2], leg[3]), direction(leg[4], leg[5], leg[6]);
    if (leg[0] != m.length_of_leg(i)) out.leg_offset[i] = leg[0] - m.leg_length;
    if (outer != m.rail_outer[i] || direction != m.rail_direction[i]) {
      out.rail_outer[i] = outer;
      out.rail_inner[i] = outer + m.rail_length[i] * direction.normalized();
      out.rail_pairs.reset();
    }
    out.platform_joint[i] = Vec3(leg[7], leg[8], leg[9]);
  }
  out.tool_length = p[60];
  if (out.platform_joint != m.platform_joint) out.platform_circle.reset();
  POLYPOD_ASSIGN(table, config::parse(to_toml(out), m.name));
  return SliderHexapod::from(table);
}

}  // namespace polypod::machine
