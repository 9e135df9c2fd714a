// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/families/delta/study.hpp"

#include <fmt/format.h>

#include <cmath>

#include "../../workspace/margin.hpp"
#include "polypod/core/memory.hpp"
#include "polypod/core/units.hpp"
#include "polypod/kinematics/closure.hpp"

namespace polypod::workspace {
namespace {

template <machine::DeltaFamily M>
class Study {
 public:
  Study(const M& m, const DeltaStudyOptions& options)
      : m_(m), options_(options), p_(kinematics::nominal_parameters(m)) {}

  [[nodiscard]] bool within(const Vec3& X) const {
    machine::JointVector q(m_.arms);
    if (!drive_positions(m_, X, q.data())) return false;
    const auto g =
        limits(m_, Pose{Mat3::Identity(), X}, std::span<const double>(q.data(), q.size()), std::span<const double>(p_));
    return std::all_of(g.begin(), g.begin() + machine::DeltaLimits::kFirstBody,
                       [](double value) { return value >= -kinematics::kLimitSlack; });
  }

  [[nodiscard]] DeltaPoint at(const Vec3& X) const {
    DeltaPoint point;
    point.X = X;
    point.close = closeness(m_, X);
    point.by_geometry = point.close.least() < options_.d_min;
    point.by_determinant = std::abs(point.close.det_A) < options_.h_min || std::abs(point.close.det_B) < options_.h_min;
    point.deep = true;
    for (int k = 0; k < 27 && point.deep; ++k) {
      const Vec3 d(k % 3 - 1, k / 3 % 3 - 1, k / 9 - 1);
      if (!d.isZero()) point.deep = within(X + options_.border * d.normalized());
    }
    return point;
  }

 private:
  const M& m_;
  const DeltaStudyOptions& options_;
  std::vector<double> p_;
};

void count(DeltaCounts& counts, const DeltaPoint& point, double d_min) {
  const machine::Closeness& c = point.close;
  ++counts.points;
  counts.geometry += point.by_geometry ? 1 : 0;
  counts.determinant += point.by_determinant ? 1 : 0;
  counts.both += point.by_geometry && point.by_determinant ? 1 : 0;
  if (c.elbow_gap < d_min) ++(c.folded ? counts.folded : counts.stretched);
  double& least = c.folded ? counts.least_folded : counts.least_stretched;
  least = std::min(least, c.elbow_gap);
  counts.least_poses = std::min(counts.least_poses, c.pose_gap);
  counts.least_drop = std::min(counts.least_drop, c.drop);
  counts.level += c.drop < d_min ? 1 : 0;
  counts.flat += c.pose_gap < d_min ? 1 : 0;
}

template <class M>
Result<DeltaStudy> study_of(const M& m, const AnyMachine& machine, const DeltaStudyOptions& options) {
  if constexpr (!machine::DeltaFamily<M>) {
    return fail("WS140", "this study is about deltas", {}, "name a machine of family rotary-delta or linear-delta");
  } else {
    Options limits_only;
    limits_only.threads = options.threads;
    POLYPOD_ASSIGN(box, extent(machine, limits_only, false));
    DeltaStudy out;
    if (box.empty()) return out;
    const Vec3 size = box.high - box.low;
    std::array<std::size_t, 3> n{};
    for (std::size_t k = 0; k < 3; ++k) {
      n[k] = 1 + static_cast<std::size_t>(std::ceil(size[static_cast<Eigen::Index>(k)] / options.step));
    }
    const std::size_t most = options.max_memory > 0 ? options.max_memory : machine_memory() / 2;
    const double bytes = sizeof(DeltaPoint) * static_cast<double>(n[0]) * static_cast<double>(n[1]) *
                         static_cast<double>(n[2]);  // if every point were within the limits
    if (most > 0 && bytes > static_cast<double>(most)) {
      return fail("WS143",
                  fmt::format("a grid of {} x {} x {} points takes up to {:.0f} MB, more than {:.0f} MB", n[0], n[1],
                              n[2], 1e-6 * bytes, 1e-6 * static_cast<double>(most)),
                  {}, "take a larger step");
    }
    const Study<M> study(m, options);
    const std::size_t columns = n[0] * n[1];
    std::vector<std::vector<DeltaPoint>> column(columns);
    POLYPOD_TRY(in_rounds(
        limits_only, columns,
        [&](std::size_t i) {
          for (std::size_t k = 0; k < n[2]; ++k) {
            // Centred on the box, so that a symmetric machine gets a symmetric grid in x.
            Vec3 X = 0.5 * (box.low + box.high);
            X.x() += options.step * (static_cast<double>(i % n[0]) - 0.5 * static_cast<double>(n[0] - 1));
            X.y() += options.step * (static_cast<double>(i / n[0]) - 0.5 * static_cast<double>(n[1] - 1));
            X.z() += options.step * (static_cast<double>(k) - 0.5 * static_cast<double>(n[2] - 1));
            if (study.within(X)) column[i].push_back(study.at(X));
          }
        },
        nullptr));
    std::size_t total = 0;
    for (const auto& points : column) total += points.size();
    out.points.reserve(total);
    for (auto& points : column) {
      for (const DeltaPoint& point : points) {
        count(out.all, point, options.d_min);
        if (point.deep) count(out.deep, point, options.d_min);
        out.points.push_back(point);
      }
      points = {};
    }
    return out;
  }
}

}  // namespace

Result<DeltaStudy> delta_study(const AnyMachine& machine, const DeltaStudyOptions& options) {
  if (!(options.step >= 1e-3 && options.step <= 0.1)) {
    return fail("WS141", fmt::format("a step of {:g} mm must be 1 to 100", units::to_mm(options.step)));
  }
  if (!(options.d_min >= 0 && options.h_min >= 0 && options.border >= 0 && std::isfinite(options.border))) {
    return fail("WS141", "distances and thresholds must not be negative");
  }
  return std::visit([&](const auto& m) { return study_of(m, machine, options); }, machine);
}

Result<std::vector<Vec3>> drive_cloud(const AnyMachine& machine, int steps) {
  if (steps < 2 || steps > 200) return fail("WS141", fmt::format("{} steps must be 2 to 200", steps));
  return std::visit(
      [&]<class M>(const M& m) -> Result<std::vector<Vec3>> {
        if constexpr (!machine::DeltaFamily<M>) {
          return fail("WS140", "this study is about deltas", {},
                      "name a machine of family rotary-delta or linear-delta");
        } else {
          const DeltaStudyOptions options;
          const Study<M> study(m, options);
          std::vector<Vec3> out;
          machine::JointVector q(m.arms), back(m.arms);
          const auto at = [&](int k) { return m.range.min + (m.range.max - m.range.min) * k / (steps - 1); };
          for (int i = 0; i < steps * steps * steps; ++i) {
            q.setZero();
            q.template head<3>() << at(i / steps / steps), at(i / steps % steps), at(i % steps);
            const machine::DeltaPoses both = both_poses(m, q);
            if (!both.real || !study.within(both.machine)) continue;
            drive_positions(m, both.machine, back.data());
            constexpr double kSame = 1e-6;
            if ((back - q).template head<3>().cwiseAbs().maxCoeff() < kSame) out.push_back(both.machine);
          }
          return out;
        }
      },
      machine);
}

}  // namespace polypod::workspace
