// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>

#include "polypod/bodies/bodies.hpp"
#include "polypod/core/units.hpp"
#include "polypod/families/serial/frames.hpp"
#include "polypod/kinematics/any_machine.hpp"

namespace polypod::bodies {
namespace {

using Frame = Body::Frame;

// A distance is asked for up to this much more than the next step needs, so that it serves many steps, m.
constexpr double kAhead = 0.5;

bool still(const Body& b) {
  return b.frame == Frame::machine || b.frame == Frame::work || (b.frame == Frame::link && b.link == 0);
}
/// The row of the table that carries it.
int row_of(const Body& b, int rows) {
  return b.frame == Frame::tool ? rows : b.frame == Frame::link ? b.link : 0;
}

}  // namespace

Watch::Watch(const machine::AnyMachine& machine, const Pose& X_MW, Bodies bodies)
    : machine_(machine), bodies_(std::move(bodies.all)), X_MW_(X_MW) {
  arm_ = std::get_if<machine::SerialArm>(&machine_);
  const int rows = arm_ != nullptr ? static_cast<int>(arm_->dh.size()) : 1;
  for (const Body& b : bodies_) {
    const std::vector<Vec3>& points = b.shape.mesh ? b.shape.mesh->points : b.shape.points;
    Vec3 low = points.front(), high = low;
    for (const Vec3& p : points) {
      low = low.cwiseMin(p);
      high = high.cwiseMax(p);
    }
    middles_.push_back(0.5 * (low + high));
    spheres_.push_back(b.shape.extent(middles_.back()));
    extents_.push_back(b.shape.extent(Vec3::Zero()));
    std::vector<double> levers;
    if (arm_ != nullptr && !still(b)) {
      const int row = row_of(b, rows);
      double lever = b.frame == Frame::tool ? b.shape.extent(Vec3::Zero()) + arm_->X_FT.p.norm() : extents_.back();
      std::vector<double> of_coupled(static_cast<std::size_t>(rows), 0);  // what a joint moves through rows behind it
      // From the last joint that moves it to the first: what lies between adds to the lever.
      for (int i = row - 1; i >= 0; --i) {
        const machine::DhRow& r = arm_->dh[static_cast<std::size_t>(i)];
        const bool turns = r.kind == machine::JointKind::revolute;
        const double slides = turns ? 0 : std::max(std::abs(r.range.min), std::abs(r.range.max));
        lever += std::hypot(r.a, std::abs(r.d) + (r.locked && !turns ? std::abs(*r.locked) : slides));
        if (r.coupled_back > 0)
          of_coupled[static_cast<std::size_t>(i - r.coupled_back)] += std::abs(r.coupling) * lever;
        if (!r.locked) levers.push_back(turns ? lever + of_coupled[static_cast<std::size_t>(i)] : 1.0);
      }
      std::reverse(levers.begin(), levers.end());
    }
    levers_.push_back(std::move(levers));
  }
  for (std::size_t i = 0; i < bodies_.size(); ++i) {
    for (std::size_t j = i + 1; j < bodies_.size(); ++j) {
      const Body &a = bodies_[i], &b = bodies_[j];
      if (still(a) && still(b)) continue;
      if ((a.cuts && b.is_cut) || (b.cuts && a.is_cut)) continue;
      if (a.tool_number >= 0 && b.tool_number >= 0 && a.tool_number != b.tool_number) continue;
      const auto carried = [](const Body& x) { return x.frame == Frame::link || x.frame == Frame::tool; };
      if (carried(a) && carried(b) && (arm_ == nullptr || std::abs(row_of(a, rows) - row_of(b, rows)) <= 1)) continue;
      const auto named = [&](const auto& p) {
        return (p.first == a.name && p.second == b.name) || (p.first == b.name && p.second == a.name);
      };
      if (std::any_of(bodies.ignored.begin(), bodies.ignored.end(), named)) {
        const std::string text = a.name + " and " + b.name;
        if (std::find(left_out_.begin(), left_out_.end(), text) == left_out_.end()) left_out_.push_back(text);
        continue;
      }
      pairs_.push_back({i, j});
    }
  }
}

std::vector<Pose> Watch::frames(const Config& c) const {
  if (arm_ == nullptr) return {Pose{}, c.X_MT};
  std::vector<Pose> out = machine::frames_of_table(*arm_, c.q);
  out.push_back(out.back() * arm_->X_FT);
  return out;
}

const Pose& Watch::frame_of(const Body& body, const std::vector<Pose>& frames) const {
  static const Pose kMachine{};
  switch (body.frame) {
    case Frame::machine:
      return kMachine;
    case Frame::work:
      return X_MW_;
    case Frame::link:
      return frames[static_cast<std::size_t>(body.link)];
    case Frame::tool:
      break;
  }
  return frames.back();
}

Watch::Config Watch::between(const Config& a, const Config& b) const {
  Config c;
  if (arm_ != nullptr) {
    c.q = 0.5 * (a.q + b.q);
    return c;
  }
  c.X_MT.p = 0.5 * (a.X_MT.p + b.X_MT.p);
  c.X_MT.R = a.X_MT.R * rotation_of(0.5 * rotation_vector(a.X_MT.R.transpose() * b.X_MT.R));
  return c;
}

double Watch::motion(std::size_t body, const Config& a, const Config& b) const {
  if (still(bodies_[body])) return 0;
  constexpr double kUp = 1 + 1e-9;  // rounding
  if (arm_ == nullptr) {
    const double angle = rotation_vector(a.X_MT.R.transpose() * b.X_MT.R).norm();
    return kUp * ((b.X_MT.p - a.X_MT.p).norm() + angle * extents_[body]);
  }
  double sum = 0;
  const std::vector<double>& levers = levers_[body];
  for (std::size_t j = 0; j < levers.size(); ++j) {
    sum += levers[j] * std::abs(b.q[static_cast<Eigen::Index>(j)] - a.q[static_cast<Eigen::Index>(j)]);
  }
  return kUp * sum;
}

Bracket Watch::apart(const Pair& pair, const std::vector<Pose>& frames, double enough) const {
  const Body &a = bodies_[pair.a], &b = bodies_[pair.b];
  const Pose &X_A = frame_of(a, frames), &X_B = frame_of(b, frames);
  const double by_spheres =
      (X_A * middles_[pair.a] - X_B * middles_[pair.b]).norm() * (1 - 1e-12) - spheres_[pair.a] - spheres_[pair.b];
  if (by_spheres >= enough) return {by_spheres, by_spheres + 1};
  return distance(a.shape, X_A, b.shape, X_B, enough);
}

bool Watch::one_inside(const Pair& pair, const std::vector<Pose>& frames) const {
  const auto holds = [&](std::size_t outer, std::size_t inner) {
    const Body &o = bodies_[outer], &i = bodies_[inner];
    if (!o.shape.mesh) return false;
    const Pose X_OI = frame_of(o, frames).inverse() * frame_of(i, frames);
    if (!i.shape.mesh) return o.shape.mesh->holds(X_OI * i.shape.points.front());
    const Mesh& parts = *i.shape.mesh;
    return std::any_of(parts.parts.begin(), parts.parts.end(),
                       [&](int k) { return o.shape.mesh->holds(X_OI * parts.points[static_cast<std::size_t>(k)]); });
  };
  return holds(pair.a, pair.b) || holds(pair.b, pair.a);
}

bool Watch::free_between(const Pair& pair, const Config& a, const Config& b) const {
  const Config middle = between(a, b);
  const double moves = std::max(motion(pair.a, a, middle) + motion(pair.b, a, middle),
                                motion(pair.a, middle, b) + motion(pair.b, middle, b));
  const Bracket d = apart(pair, frames(middle), moves + 1e-9);
  if (d.low > moves) return true;
  if (d.high <= 0 || moves < kResolution / 2) return false;
  return free_between(pair, a, middle) && free_between(pair, middle, b);
}

std::optional<std::pair<std::string, std::string>> Watch::to(const Pose& X_MT, const machine::JointVector& q,
                                                             bool continues, int tool_number) {
  const Config now{X_MT, q};
  const bool way = continues && last_.has_value();
  const bool other_tool = !last_.has_value() || tool_number != last_tool_;
  const std::vector<Pose> here = frames(now);
  std::vector<double> moves(bodies_.size(), 0.0);
  if (way) {
    for (std::size_t i = 0; i < bodies_.size(); ++i) moves[i] = motion(i, *last_, now);
  }
  std::optional<std::pair<std::string, std::string>> found;
  for (Pair& pair : pairs_) {
    const Body &a = bodies_[pair.a], &b = bodies_[pair.b];
    const auto absent = [&](const Body& x) { return x.tool_number >= 0 && x.tool_number != tool_number; };
    if (absent(a) || absent(b)) {
      pair.free = false;
      continue;
    }
    if (other_tool || !way) pair.free = false;
    bool free = true;
    if (pair.free) {
      const double step = moves[pair.a] + moves[pair.b];
      pair.slack -= step;
      if (pair.slack > 0) continue;
      // How far apart they were, then the way by halves; then how far they are.
      const Bracket before = apart(pair, last_frames_, step + kAhead);
      free = before.low > step || free_between(pair, *last_, now);
    } else if (way) {
      // They touched, or a tool was changed: the whole way is looked at by halves.
      free = free_between(pair, *last_, now);
    }
    const Bracket d = apart(pair, here, kAhead);
    free = free && d.low > 0 && (pair.free || !one_inside(pair, here));
    pair.free = free;
    pair.slack = d.low;
    if (!free && !found) found = {a.name, b.name};
  }
  last_ = now;
  last_frames_ = here;
  last_tool_ = tool_number;
  return found;
}

std::vector<std::string> Watch::notes() const {
  std::vector<std::string> out;
  out.push_back(fmt::format(
      "bodies: {} of them, {} pairs, judged on the whole way between the checked points (nearer than {:g} mm counts as "
      "touching){}",
      bodies_.size(), pairs_.size(), units::to_mm(kResolution),
      arm_ != nullptr ? ", with joints that turn evenly from point to point" : ""));
  if (arm_ == nullptr) {
    out.push_back(
        "bodies of legs, rails, arms and platform are not judged: only what is fixed to the tool, to M and to W");
  } else {
    std::vector<std::string> bare;
    for (std::size_t row = 1; row <= arm_->dh.size(); ++row) {
      const auto on = [&](const Body& b) { return b.frame == Frame::link && b.link == static_cast<int>(row); };
      if (std::none_of(bodies_.begin(), bodies_.end(), on)) bare.push_back(std::to_string(row));
    }
    if (!bare.empty()) {
      out.push_back(fmt::format("bodies: none are given for link{} {}, so {} not judged", bare.size() == 1 ? "" : "s",
                                fmt::join(bare, ", "), bare.size() == 1 ? "it is" : "they are"));
    }
    out.push_back(
        "bodies of neighbouring links are not judged against each other, nor is the tool against the last two");
  }
  if (!left_out_.empty()) {
    out.push_back(fmt::format("bodies: not judged, since the file says so: {}", fmt::join(left_out_, "; ")));
  }
  return out;
}

}  // namespace polypod::bodies
