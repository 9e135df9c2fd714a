// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// What LinuxCNC really does with a program: joints, tip and line at every servo cycle.
#pragma once

#include <functional>
#include <optional>
#include <string>
#include <string_view>

#include "polypod/core/error.hpp"

namespace polypod::machining {
struct Job;
}

namespace polypod::control {

struct RecordOptions {
  double time_limit = 600;  ///< s, of the whole run by the clock; LinuxCNC runs in real time
  /// The run's file of parameters: "5221 0\t..." a line each; the offsets of G54 to G59. Empty: all are 0.
  std::string parameters;
  bool block_delete = true;  ///< whether blocks that begin with / are left out, as LinuxCNC starts
  /// Of a program that fails (LC116) what was recorded up to there, with Record::failed; else an error alone.
  bool partial = false;
  /// Called with the beginning of Record::csv, and then with what it got since, some twenty times a second while
  /// LinuxCNC runs. While nothing moves no rows come: whether they belong to the record is known when it moves again.
  std::function<void(std::string_view)> rows;
  /// Asked some twenty times a second with the seconds since the start; false ends everything (LC119).
  std::function<bool(double)> progress = [](double) { return true; };
};

struct Record {
  std::size_t samples = 0;  ///< rows, one a servo cycle (1 ms)
  double seconds = 0;       ///< from the first row to the last
  std::size_t lines = 0;    ///< of the program, on which the machine moved or waited
  /// time_s,line,x_mm,...,c_deg,q1,...: from the last cycle before the first motion to the first after the last one.
  std::string csv;
  std::optional<Error> failed;  ///< LC116, of RecordOptions::partial
};

/// Runs the program on the configuration in `folder` (linuxcnc_configuration's files) in LinuxCNC, without a screen,
/// and gives its record. The commanded positions of the joints lag those of the axes by two servo cycles, and
/// LinuxCNC's interpolators smooth them: (q_-1 + 4 q_0 + q_+1) / 6. A row has the joints of one cycle and the axes of
/// two cycles before, weighted in the same way, so that both belong to the same instant: the tip that the drives are
/// told to take (what is left is the curvature of the inverse over one cycle's way, some nm at 100 mm/s). The figures
/// have nine decimals in mm and deg (six where the configuration loads LinuxCNC's component `scale` itself).
/// Coordinates that the machine's poses do not prescribe follow from the joints; C of a machine whose poses name the
/// tool's axis is 0.
///
/// The module is compiled anew. LinuxCNC runs in namespaces of its own (processes, shared memory, network, mounts), so
/// that several runs do not meet and nothing is left behind, whatever ends this process.
/// Errors: LC110 (the folder holds no such configuration), LC111 (not root, or the system gives no namespaces), LC112
/// (LinuxCNC, its headers or a compiler is missing), LC113 (the module does not compile), LC114 (LinuxCNC did not
/// start), LC115 (it refused to switch on, home or read the program), LC116 (the program failed), LC117 (time limit),
/// LC118 (samples were lost), LC119 (interrupted), FI100. Cost: the program's time and some 4 s.
Result<Record> record(const std::string& folder, const std::string& program, const RecordOptions& options = {});

/// Where the job's work offsets lie in M, as LinuxCNC's parameters, a line each: 5221 .. 5223 the origin of G54 in mm,
/// 5230 its turn about z in deg, 5241 .. of G55, and so on. What the job does not say is left out (0).
std::string work_offset_parameters(const machining::Job& job);

}  // namespace polypod::control
