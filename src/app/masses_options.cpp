// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "masses_options.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <filesystem>

#include "messages.hpp"
#include "polypod/core/config.hpp"
#include "polypod/core/files.hpp"
#include "polypod/machine/urdf.hpp"

namespace polypod::app {

std::string in_words(const motion::Dynamics& d) {
  std::string axis;
  for (int k = 0; k < 3; ++k) {
    const double rest = (d.gravity - d.gravity[k] * Vec3::Unit(k)).norm();
    if (rest < 1e-9 * d.gravity.norm()) axis = fmt::format("along {}{} of M", d.gravity[k] < 0 ? "-" : "+", "xyz"[k]);
  }
  const std::string g =
      d.gravity.isZero(0) ? "none"
      : !axis.empty()     ? fmt::format("{:.4g} m/s2 {}", d.gravity.norm(), axis)
                      : fmt::format("{:.4g}, {:.4g}, {:.4g} m/s2 in M", d.gravity.x(), d.gravity.y(), d.gravity.z());
  const std::vector<std::string> odd = d.not_rigid();
  const std::string unread = d.not_read.empty()
                                 ? ""
                                 : fmt::format("; [[dynamics.stage]] stands for the masses in the file of stage {}",
                                               fmt::join(d.not_read, ", "));
  const std::string left_out = d.left_out.empty()
                                   ? ""
                                   : fmt::format("; left out, because the whole or the next stage stands for it: {}",
                                                 fmt::join(d.left_out, ", "));
  return fmt::format("gravity {}{}; mass has: {}; other parts weigh nothing{}{}{}", g,
                     d.gravity_given ? "" : ", assumed from how the machine stands (gravity_m_per_s2)",
                     fmt::join(d.parts_with_mass(), ", "),
                     odd.empty() ? ""
                                 : fmt::format("; the inertia of {} is taken as it is, though one of its principal "
                                               "moments is larger than the sum of the others, which no rigid body has",
                                               fmt::join(odd, ", ")),
                     unread, left_out);
}

void MassesOptions::declare(Arguments& a) {
  a.option("--dynamics", dynamics, "A file with the table `dynamics`: masses (default: that of the machine file)");
  a.option("--drive-force", drive_force, "Largest force or torque of the drives, N or Nm, one or one a drive");
}

Result<Masses> MassesOptions::read(const machine::AnyMachine& m, const std::string& machine_file,
                                   const Context& context) const {
  Masses out;
  out.why_not = motion::no_dynamics(m);
  if (out.why_not.empty()) {
    if (!dynamics.empty()) POLYPOD_TRY(files::read(dynamics));  // else it would be one without the table
    POLYPOD_ASSIGN(read, motion::read_dynamics(dynamics.empty() ? machine_file : dynamics, m));
    out.dynamics = std::move(read);
    if (!out.dynamics) {
      out.why_not =
          dynamics.empty() ? "the machine has no masses (table dynamics, docs/motion.md)" : "it has no table dynamics";
    } else if (out.dynamics->parts_with_mass().empty()) {
      out.dynamics.reset();
      out.why_not = "no part of the table dynamics has a mass";
    }
  }
  if (!out.dynamics && !dynamics.empty()) {
    return fail("AP214", fmt::format("--dynamics {}: {}", dynamics, out.why_not), {}, "docs/motion.md has the table");
  }
  if (!out.dynamics) {
    POLYPOD_TRY(refuse(context, {"--drive-force"}, "it serves machines with masses: " + out.why_not));
    return out;
  }
  if (drive_force.empty()) return out;
  POLYPOD_ASSIGN(force, numbers_of(drive_force, "--drive-force"));
  const int n = kinematics::joint_count(m);
  if (force.size() != 1 && static_cast<int>(force.size()) != n) {
    return fail("AP210", fmt::format("--drive-force {}: the machine has {} drives", drive_force, n), {},
                "give one number for all drives, or one a drive");
  }
  out.force = machine::JointVector::Zero(n);
  for (int i = 0; i < n; ++i) {
    const double f = force[force.size() == 1 ? 0 : static_cast<std::size_t>(i)];
    POLYPOD_TRY(in_range("AP210", "--drive-force", f, {1e-9, 1e12}, "N or Nm"));
    out.force[i] = f;
  }
  return out;
}

std::string machine_file_of(const machining::Job& job) {
  const std::string beside = machine::file_of_machine(config::beside(job.path, job.machine_name));
  std::error_code none;
  return std::filesystem::exists(beside, none) ? beside : job.machine_name;
}

Result<Masses> masses_of_job(const machining::Job& job, const std::string& dynamics, const Context& context) {
  MassesOptions file;
  file.dynamics = dynamics;
  return file.read(job.machine, machine_file_of(job), context);
}

}  // namespace polypod::app
