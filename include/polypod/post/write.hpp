// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// A planned path as the program of a controller.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "polypod/core/error.hpp"
#include "polypod/post/plan.hpp"

namespace polypod::post {

enum class Dialect : std::uint8_t {
  ngc,      ///< RS-274/NGC of LinuxCNC
  krl,      ///< KUKA robot language, one .src file, and a .dat where asked for
  rapid,    ///< ABB RAPID, one module
  urscript  ///< Universal Robots
};

/// Whether arcs may lie in any plane, how far they may turn, and how the tool turns between points.
void set_for(Dialect dialect, PlanOptions& options);

struct WriteOptions {
  std::string name = "PART";         ///< of the program; letters, digits and `_` of it are kept
  std::vector<std::string> header;   ///< comment lines
  bool inverse_time = false;         ///< ngc: G93
  double turn_speed = 0.5235987756;  ///< rad/s of a turn without a way
  double rapid_speed = 0.1;          ///< m/s of rapids, for robots
  /// m, how far robots may round a corner (C_DIS, zone, r); ngc: P of G64; 0: exact stop, G61. Of a program with path
  /// modes of its own (G61, G61.1, G64 P) only where `blend_overrides` says so or where it gives no distance (G64).
  double blend = 1e-4;
  bool blend_overrides = false;
  double acceleration = 1.2;   ///< m/s^2, `a` of URScript
  int moves_per_part = 0;      ///< robots: moves in a subprogram; 0: no subprograms
  bool data_list = false;      ///< krl: frames and start in a data list, where the controller's panel can change them
  Vec3 origin = Vec3::Zero();  ///< as of the plan
  double rotation = 0;         ///< as of the plan
};

struct Written {
  std::string text;
  std::string data;  ///< krl with data_list: what stands in the .dat beside it; else empty
  int lines = 0;     ///< of the text
  int moves = 0;     ///< blocks that move
  std::vector<std::string> notes;
};

/// Writes the plan. Coordinates have 6 decimals (mm, deg) in G-code; 4 of mm and 6 of deg, 9 of quaternions, 7 of m and
/// 8 of rad for robots. Robots are told the workpiece frame and the tool frame of the machine file, begin with a move
/// in joints to the posture of the plan (S and T of KRL, confdata of RAPID) and go straight from there, rapids too.
/// A program keeps its words in their places; robots get comments for them, and for each move the exact stop (G61,
/// G61.1) or the distance (P of G64) of its path mode as the zone: on both sides of a corner by P, which leaves the
/// corner by less than P.
/// Errors: PO121 a robot's language for a machine that is no arm; PO117 a place that is not known whole behind the
/// first that is; PO118 a word that a robot's program cannot do without; PO119 several tools, where the language has
/// one TCP. Cost: linear.
Result<Written> write(Dialect dialect, const Configuration& configuration, const Path& path, const Plan& plan,
                      const WriteOptions& options = {});

/// What robots' languages say of a posture, of the joints as the machine file counts them.
struct Posture {
  bool known = false;     ///< the arm has a closed inverse that names postures; else only what follows from the joints
  bool overhead = false;  ///< the wrist centre lies behind axis 1
  bool bent = true;       ///< the forearm bends forward: KRL's bit 1, RAPID's "in front of the lower arm"
  std::array<double, 6> joints{};                 ///< rad, locked ones too
  [[nodiscard]] int status() const;               ///< S of KRL
  [[nodiscard]] int turns() const;                ///< T of KRL: bit i where joint i + 1 is negative
  [[nodiscard]] std::array<int, 4> conf() const;  ///< cf1, cf4, cf6, cfx of RAPID
};
Posture posture_of(const Configuration& configuration, const machine::JointVector& joints);

}  // namespace polypod::post
