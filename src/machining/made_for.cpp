// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/machining/made_for.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <charconv>
#include <cmath>
#include <string>
#include <vector>

#include "polypod/core/units.hpp"
#include "polypod/gcode/writer.hpp"
#include "polypod/kinematics/surplus.hpp"
#include "polypod/machining/compliance_mark.hpp"
#include "polypod/statics/compliance.hpp"

namespace polypod::machining {

bool speaks_of(const gcode::CorrectionHeader& header, const Job& job) {
  return header.names(machine::name_of(job.machine)) && header.origin == place_in_words(job.X_MW);
}

namespace {
/// Whether a job says what is cut: `--machine` alone does not.
bool says_what_is_cut(const Job& job) {
  return job.cuts && job.cutter.diameter > 0;
}

/// Of a corrected program and a job that cuts: which of the program's cutters is none of the job's, or has another
/// number; else empty.
std::string other_cutter(const gcode::CorrectionHeader& header, const Job& job) {
  std::vector<std::string> kinds{cutter_in_words(job.cutter)}, own = kinds;
  for (const auto& [tool, cutter] : job.cutters) {
    kinds.push_back(cutter_in_words(cutter));
    own.push_back(fmt::format("T{} {}", tool, kinds.back()));
  }
  std::string left = header.cutters;
  // Of several cutters the header says the numbers: "T1 cutter 10 mm with 3 teeth, T2 ball ..., ".
  const bool numbered = left.starts_with('T');
  while (numbered && !left.empty()) {
    int tool = 0;
    std::from_chars(left.data() + 1, left.data() + left.size(), tool);
    const std::string one = fmt::format("T{} {}, ", tool, cutter_in_words(job.cutter_of(tool)));
    if (!left.starts_with(one)) break;
    left.erase(0, one.size());
  }
  for (const std::string& one : kinds)
    if (const std::size_t at = left.find(one + ", "); !numbered && at != std::string::npos)
      left.erase(at, one.size() + 2);
  if (left.size() < 2) return {};
  return fmt::format("the program was corrected for {}, the job has {}", left.substr(0, left.size() - 2),
                     fmt::join(own, "; "));
}

/// The numbers in a text, in their order.
std::vector<double> numbers_in(std::string_view text) {
  std::vector<double> out;
  for (std::size_t at = text.find_first_of("-0123456789"); at != std::string_view::npos;) {
    double value = 0;
    const auto [end, code] = std::from_chars(text.data() + at, text.data() + text.size(), value);
    if (code == std::errc{}) out.push_back(value);
    at = text.find_first_of("-0123456789", code == std::errc{} ? static_cast<std::size_t>(end - text.data()) : at + 1);
  }
  return out;
}

/// Likewise of the material: forces that differ by a hundredth are the same.
std::string other_material(const gcode::CorrectionHeader& header, const Job& job) {
  if (header.material.empty()) return {};
  const std::string own = material_in_words(job.material);
  const std::vector<double> was = numbers_in(header.material), is = numbers_in(own);
  constexpr double kShare = 0.01, kLeast = 0.005;  // of a coefficient, and in its unit
  bool same = was.size() == is.size();
  for (std::size_t k = 0; same && k < is.size(); ++k)
    same = std::abs(was[k] - is[k]) <= kShare * std::abs(is[k]) + kLeast;
  if (same) return {};
  return fmt::format("the program was corrected for a material with {}, the job has one with {}", header.material, own);
}

/// Likewise of the stock: cells of another size round it.
std::string other_stock(const gcode::CorrectionHeader& header, const Job& job) {
  if (header.stock.empty()) return {};
  const std::string own = stock_in_words(job.stock);
  const std::vector<double> was = numbers_in(header.stock), is = numbers_in(own);
  constexpr double kSide = 0.2, kVolume = 0.01;  // mm, a share
  constexpr std::size_t kSides = 6;
  const std::size_t first = was.size() + kSides == is.size() ? kSides : 0;  // of a tilted tool the volume alone
  bool same = was.size() + first == is.size();
  for (std::size_t k = first; same && k < is.size(); ++k) {
    same = std::abs(was[k - first] - is[k]) <= (k < kSides ? kSide : kVolume * is[k]);
  }
  return same ? ""
              : fmt::format("the program was corrected in a stock from {}, the job has one from {}", header.stock, own);
}
}  // namespace

MadeFor made_for(const gcode::CorrectionHeader& header, const Job& given,
                 const std::function<bool(const Vec3& p, double within)>& comes_to) {
  using Other = MadeFor::Other;
  const std::string machine = machine::name_of(given.machine), origin = place_in_words(given.X_MW);
  if (!speaks_of(header, given)) {
    if (!header.corrected) return {};
    if (!header.names(machine)) {
      return {Other::machine,
              fmt::format("the program was corrected for the machine {}, not for {}", header.machine, machine),
              {},
              false};
    }
    if (header.origin.empty())
      return {Other::unknown_place, "the header of this corrected program does not say for which origin", {}, false};
    return {Other::place,
            fmt::format("the program was corrected for the origin {} in M, not for {}", header.origin, origin),
            {},
            false};
  }
  if (header.corrected && says_what_is_cut(given)) {
    if (std::string other = other_cutter(header, given); !other.empty()) return {Other::cutter, other, {}, false};
    if (std::string other = other_material(header, given); !other.empty()) return {Other::material, other, {}, false};
    if (std::string other = other_stock(header, given); !other.empty()) return {Other::stock, other, {}, false};
    if (header.measured != (given.measured != nullptr)) {
      return {Other::compliance,
              header.measured
                  ? "the program was corrected with a measured compliance, which this job does not give"
                  : "the program was corrected with the compliances of the machine file, and this job gives a "
                    "measured one",
              {},
              false};
    }
  }
  if (header.measured) {
    return {Other::none,
            {},
            fmt::format("the program was {} with a measured compliance: whether this machine, its tool and the "
                        "measurements are still those is not judged",
                        header.was()),
            false};
  }
  const auto mark = ComplianceMark::from(header.compliance);
  if (!mark) return {};  // before headers said it
  // The correction moves a command by far less.
  constexpr double kNear = 5e-3;
  if (header.corrected && !comes_to(mark->p, kNear)) {
    const auto mm = [](double x) { return gcode::number(units::to_mm(x), 1); };
    return {Other::offsets,
            fmt::format("the first cut that was corrected begins at X{} Y{} Z{} in the frame of the workpiece, and no "
                        "move of the program comes there with the work offsets of this job",
                        mm(mark->p.x()), mm(mark->p.y()), mm(mark->p.z())),
            {},
            false};
  }
  if (!statics::has_compliance(given.machine)) {
    return {
        Other::none,
        {},
        fmt::format("the machine file has no compliances, so whether the program was {} for this machine is not judged",
                    header.was()),
        false};
  }
  Job job = given;
  job.posture = header.posture;
  const std::optional<DeflectedBy100N> here =
      deflections_at(job, *mark, ComplianceMark::joints_from(header.joints, job.machine));
  if (!here) return {Other::none, {}, {}, true};
  if (mark->same(*here)) {
    if (!header.joints.empty() || !kinematics::leaves_a_joint_free(job.machine)) return {};
    return {Other::none,
            {},
            fmt::format("the header does not say where the joint was that the pose leaves free: whether the program "
                        "was {} for where it is here is not judged; correct the program of the CAM system again",
                        header.was()),
            false};
  }
  const DeflectedBy100N was{mark->deflection, mark->across};
  return {Other::compliance,
          fmt::format("the program was {} for a machine whose tool 100 N along X, Y, Z deflect by {} where the first "
                      "cut begins; this one they deflect by {}",
                      header.was(), mark->in_words(was, *here), mark->in_words(*here, was)),
          {},
          false};
}

}  // namespace polypod::machining
