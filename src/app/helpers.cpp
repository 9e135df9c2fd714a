// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include <fmt/format.h>

#include <algorithm>
#include <cctype>
#include <charconv>
#include <chrono>
#include <cmath>
#include <csignal>
#include <cstdio>
#include <cstring>
#include <filesystem>
#include <map>

#include "command.hpp"
#include "interrupt.hpp"
#include "polypod/core/files.hpp"
#include "polypod/core/units.hpp"
#include "polypod/kinematics/any_machine.hpp"
#include "polypod/statics/compliance.hpp"

namespace polypod::app {

namespace {
volatile std::sig_atomic_t interrupt_count = 0;
extern "C" void on_interrupt(int) {
  interrupt_count = interrupt_count + 1;
  std::signal(SIGINT, SIG_DFL);
}
}  // namespace

void catch_interrupts() {
  std::signal(SIGINT, on_interrupt);
}
bool interrupted() {
  return interrupt_count > 0;
}

Result<std::vector<double>> numbers_of(const std::string& text, const std::string& option) {
  std::vector<double> out;
  const char* p = text.data();
  const char* end = p + text.size();
  const auto bad = [&] {
    return fail("AP100", fmt::format("{} {}: not a list of finite numbers", option, text), {},
                "write numbers with commas between them: 1,-2.5,3");
  };
  while (true) {
    while (p != end && *p == ' ') ++p;
    if (p != end && *p == '+') ++p;
    double value = 0;
    const auto [rest, code] = std::from_chars(p, end, value);
    if (code != std::errc{} || !std::isfinite(value)) return bad();
    out.push_back(value);
    p = rest;
    while (p != end && *p == ' ') ++p;
    if (p == end) return out;
    if (*p++ != ',') return bad();
  }
}

Status refuse(const Context& context, const std::vector<std::string>& options, const std::string& serves) {
  for (const std::string& option : options) {
    if (!context.given(option)) continue;
    return fail("AP107", fmt::format("{} does nothing here", option), {}, serves);
  }
  return {};
}

Result<machine::AnyMachine> machine_of(const std::string& name, const std::vector<std::string>& sets) {
  std::vector<machine::Override> overrides;
  for (const std::string& set : sets) {
    const std::size_t equals = set.find('=');
    if (equals == std::string::npos || equals == 0) {
      return fail("AP102", fmt::format("--set {}: no key=value", set), {}, "write --set tool.length_mm=120");
    }
    overrides.push_back({set.substr(0, equals), set.substr(equals + 1)});
  }
  return machine::load(name, overrides);
}

void declare_machine(Arguments& arguments, std::string& name, std::vector<std::string>& sets) {
  arguments.positional("MACHINE", name, "A machine file or a name of `polypod machines`");
  arguments.option("--set", sets, "key=value: override a parameter of the machine (repeatable)");
}

Result<Pose> pose_argument(const machine::AnyMachine& machine, const std::string& text) {
  POLYPOD_ASSIGN(c, numbers_of(text, "--pose"));
  const machine::Task task = kinematics::task(machine);
  const int most = kinematics::coordinate_count(task);
  if (c.size() < 3 || static_cast<int>(c.size()) > most) {
    return fail("AP101",
                fmt::format("--pose {}: {} numbers, but this machine takes x,y,z{}", text, c.size(),
                            most == 6   ? "[,A,B,C]"
                            : most == 5 ? "[,A,B]"
                                        : ""),
                {}, "lengths in mm, angles in deg");
  }
  for (std::size_t i = 0; i < c.size(); ++i) c[i] = i < 3 ? units::from_mm(c[i]) : units::from_deg(c[i]);
  return kinematics::pose_of(task, c);
}

std::vector<double> pose_for_user(const machine::AnyMachine& machine, const Pose& X) {
  std::vector<double> c = kinematics::coordinates_of(kinematics::task(machine), X);
  for (std::size_t i = 0; i < c.size(); ++i) c[i] = i < 3 ? units::to_mm(c[i]) : units::to_deg(c[i]);
  return c;
}

std::string pose_text(const machine::AnyMachine& machine, const Pose& X, int digits) {
  std::string out;
  for (const double c : pose_for_user(machine, X)) out += fmt::format("{}{:.{}f}", out.empty() ? "" : ", ", c, digits);
  return out;
}

Status check_files(const std::vector<std::string>& inputs, const std::vector<std::string>& outputs) {
  std::map<std::filesystem::path, bool> seen;  // whether it is an input
  for (const bool input : {true, false}) {
    for (const std::string& path : input ? inputs : outputs) {
      if (path.empty()) continue;
      std::error_code none;
      if (input && !std::filesystem::exists(path, none)) continue;  // a name of the catalogue, or soon an error
      const auto whole = std::filesystem::weakly_canonical(path, none);
      const auto [it, fresh] = seen.try_emplace(whole, input);
      if (!fresh) {
        return fail("AP106",
                    fmt::format("{} is {}", path,
                                input        ? "given twice"
                                : it->second ? "read and would be written over"
                                             : "named for two outputs"),
                    {}, input ? "what stands twice would count twice" : "choose another output");
      }
      if (!input) POLYPOD_TRY(files::may_write(path));
    }
  }
  return {};
}

Status needs_compliance(const machine::AnyMachine& machine) {
  if (statics::has_compliance(machine)) return {};
  return fail("AP105", fmt::format("{} has no compliances", machine::name_of(machine)), {},
              "give compliance_rad_per_Nm (arms), leg.compliance_um_per_N (hexapods), drive.compliance_rad_per_Nm, "
              "rail.compliance_um_per_N or rod.compliance_um_per_N (deltas) in the machine file");
}

std::vector<double> joints_for_user(const machine::AnyMachine& machine, const machine::JointVector& q) {
  std::vector<double> out;
  for (int i = 0; i < q.size(); ++i) {
    const bool turns = kinematics::joint_kind(machine, i) == machine::JointKind::revolute;
    out.push_back(turns ? units::to_deg(q[i]) : units::to_mm(q[i]));
  }
  return out;
}

Json matrix_json(const Eigen::MatrixXd& M) {
  Json rows = Json::array();
  for (int i = 0; i < M.rows(); ++i) {
    Json row = Json::array();
    for (int j = 0; j < M.cols(); ++j) row.push_back(M(i, j));
    rows.push_back(row);
  }
  return rows;
}

Json vector_json(const Vec3& v) {
  return Json::array({v.x(), v.y(), v.z()});
}

void print_json(const Json& document) {
  fmt::print("{}\n", document.dump(2));
}

std::string for_shell(const std::string& argument) {
  const auto plain = [](char c) {
    return std::isalnum(static_cast<unsigned char>(c)) != 0 || std::strchr("_-./=:,+", c) != nullptr;
  };
  if (!argument.empty() && std::all_of(argument.begin(), argument.end(), plain)) return argument;
  std::string out = "'";
  for (const char c : argument) out += c == '\'' ? std::string("'\\''") : std::string(1, c);
  return out + "'";
}

std::function<bool(double)> progress_line(const Context& context, std::string what) {
  return [shown = context.progress, what = std::move(what), last = std::chrono::steady_clock::now(),
          drawn = false](double share) mutable {
    const auto now = std::chrono::steady_clock::now();
    if (shown && now - last > std::chrono::milliseconds(200)) {
      fmt::print(stderr, "\r{} {:3.0f} %\x1b[K", what, 100 * share);
      std::fflush(stderr);
      last = now;
      drawn = true;
    }
    if (drawn && share >= 1) fmt::print(stderr, "\r\x1b[K");
    return !interrupted();
  };
}

}  // namespace polypod::app
