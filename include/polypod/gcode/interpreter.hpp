// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// What a program does: its moves, in order, each with the block that asked for it.
#pragma once

#include <array>
#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "polypod/core/error.hpp"
#include "polypod/core/long_vector.hpp"
#include "polypod/gcode/program.hpp"
#include "polypod/geometry/pose.hpp"

namespace polypod::gcode {

/// How the note about tool length offsets ends.
inline constexpr const char* kLengthNote = "is passed through; the programmed point is taken as the tool tip";

enum class MoveKind : std::uint8_t {
  rapid,  ///< G0: no cut is allowed
  line,   ///< G1
  arc     ///< G2 or G3, also helices and full turns
};

enum class Plane : std::uint8_t { xy, zx, yz };              ///< G17, G18, G19
enum class FeedMode : std::uint8_t { per_minute, inverse };  ///< G94, G93
enum class Spindle : std::uint8_t { off, clockwise, counterclockwise };

enum class PathMode : std::uint8_t {
  continuous,  ///< G64: corners are rounded to keep up the speed
  exact_path,  ///< G61: stops at every corner that is not tangent
  exact_stop   ///< G61.1: stops at every end of a move
};

/// The path control mode in force (G61, G61.1, G64), as LinuxCNC reads it.
struct PathControl {
  PathMode mode = PathMode::continuous;
  /// P of G64: how far a rounded corner may leave the path, m; 0 without P (or with P <= 0): as far as the speed needs.
  float blend_tolerance = 0;
  /// Q of G64, LinuxCNC's naive cam tolerance: lines are merged whose ends stay this close to the merged one, m.
  /// Without Q it is P; 0 merges nothing.
  float naive_cam_tolerance = 0;

  friend bool operator==(const PathControl&, const PathControl&) = default;
};

/// The modal words in force; ten bytes, one a block, for whoever rewrites blocks.
struct ModalState {
  std::int16_t motion = -1;      ///< 0 to 3 for G0 to G3; -1 for none (before the first, after G80)
  std::uint8_t work_offset = 0;  ///< 0 for G54 ... 5 for G59
  Plane plane = Plane::xy;
  FeedMode feed_mode = FeedMode::per_minute;
  bool inches = false;        ///< G20
  bool incremental = false;   ///< G91
  bool arc_absolute = false;  ///< G90.1
  bool executed = false;      ///< false for blocks that are skipped or stand after the end

  friend bool operator==(const ModalState&, const ModalState&) = default;
};

/// One motion of the tool tip in the workpiece frame W (the frame of G54; G55 to G59 are moved into it).
struct Move {
  MoveKind kind = MoveKind::rapid;
  Plane plane = Plane::xy;
  FeedMode feed_mode = FeedMode::per_minute;
  Spindle spindle = Spindle::off;
  bool clockwise = false;  ///< arcs: G2, seen against the plane's normal axis
  /// False until the program has said where all of X, Y and Z are: the start depends on where the machine stood. What
  /// is not known is taken as 0. A new tool length offset (G43, G49) makes Z unknown again, until Z is commanded.
  bool start_known = true;
  std::array<bool, 3> known_start{true, true, true};  ///< the same for each of X, Y, Z
  std::array<bool, 3> known_end{true, true, true};    ///< and for its end
  bool inches = false;                                ///< G20: the block's numbers are inches
  bool incremental = false;                           ///< G91: the block's numbers are steps from `start`
  /// The controller comes to rest before it: between the last way and this one stands a word for which LinuxCNC waits
  /// until the motion is done (G4, G43 to G49, M0, M1, M60, M3 to M9, M19, M6, M61, M64 to M66, M68, M100 to M199, S, a
  /// message). It does not for T, F, M48 to M53, M62, M63, M67 and modes.
  bool stops_before = false;
  int block = 0;                   ///< index into Program::blocks
  int tool = 0;                    ///< T number of the tool in the spindle (0: none was changed in)
  PathControl path;                ///< in force during the move
  int work_offset = 0;             ///< 0 for G54 ... 5 for G59
  Vec3 start = Vec3::Zero();       ///< p_W, m
  Vec3 end = Vec3::Zero();         ///< p_W, m
  Vec3 centre = Vec3::Zero();      ///< arcs: a point on the axis, at the height of the start, p_W, m
  double sweep = 0;                ///< arcs: angle turned, rad, > 0, more than 2 pi with P
  Vec3 axes_start = Vec3::Zero();  ///< A, B, C before, rad
  Vec3 axes_end = Vec3::Zero();    ///< A, B, C after, rad
  double feed = 0;                 ///< m/s along the path (G93: length over time); 0 for rapids
  double spindle_speed = 0;        ///< rev/s

  /// m, of the tip's path. An arc whose radius differs at its ends (rounded numbers; `interpret` says how much is
  /// allowed) is a spiral with the radius linear in the angle, whose length is taken with the mean radius.
  [[nodiscard]] double length() const;
  [[nodiscard]] Vec3 point(double s) const;      ///< p_W at arc length s, cut to 0 <= s <= length()
  [[nodiscard]] Vec3 direction(double s) const;  ///< unit tangent at s; zero for a move of no length
  /// The point of the move closest to p, as arc length; the distance is |p - point(nearest(p))|. Exact for lines, arcs
  /// and helices in every plane: all zeros of the derivative that can be the smallest are bracketed in closed form,
  /// then found by a safeguarded Newton iteration. Where several points are equally close, one of them. Constant cost.
  [[nodiscard]] double nearest(const Vec3& p) const;
};

/// A word or block that Polypod reads but that moves nothing (M8, comments with a meaning, M6, ...): passed through.
struct PassedThrough {
  int block = 0;
  int column = 0;  ///< 1-based
  int length = 0;
  [[nodiscard]] std::string_view what(const Program& program) const {
    return program.blocks[static_cast<std::size_t>(block)].text.substr(static_cast<std::size_t>(column) - 1,
                                                                       static_cast<std::size_t>(length));
  }
};

/// What an M code that LinuxCNC does not have, or that switches its kinematics, does on a controller.
enum class MCode : std::uint8_t {
  nothing,  ///< it moves nothing: a clamp, air
  tip,      ///< from here on X, Y, Z, A, B, C are those of the tool, as at the start of a program
  joints    ///< from here on they are joints, and moves are refused until an M code of `tip`
};

/// The number of an M code that a controller may have beside LinuxCNC's own: "M10" is 10; none for M3, M98, M1000, ...
std::optional<int> m_code_named(std::string_view name);

struct InterpretOptions {
  /// p_W of the origins of G54 ... G59, m. The first is usually zero: W is the frame of G54.
  std::array<Vec3, 6> work_offsets{Vec3::Zero(), Vec3::Zero(), Vec3::Zero(), Vec3::Zero(), Vec3::Zero(), Vec3::Zero()};
  bool block_delete = false;          ///< whether blocks that begin with `/` are skipped (the switch of the machine)
  std::map<int, MCode> m_codes = {};  ///< of the controller at hand, beside those of LinuxCNC and M100 to M199
};

struct Interpretation {
  LongVector<Move> moves;
  LongVector<PassedThrough> passed_through;
  std::vector<std::string> notes;  ///< what a reader should know, e.g. that the start of the first move is not known
  LongVector<ModalState> states;   ///< the modal state after each block of the program
  bool ended = false;              ///< M2, M30 or the closing % was seen
};

/// Runs the program without a machine: modal state, units, planes, arcs.
///
/// Understood: G0 to G3 (IJK with G90.1/G91.1, R, helices, full turns, P), G4, G17 to G19, G20/G21, G40, G43/G43.1
/// (the tip stays the controlled point), G49, G54 to G59, G61/G64, G80, G90/G91, G93/G94, F, S, T, M.
/// Whatever else changes motion (cutter compensation, cycles, O-words, parameters, G10, G28, G30, G52, G53, G68, G92,
/// ...) is refused with its place, never skipped; docs/gcode.md lists the ids. Words act in the order of RS-274, not in
/// the order in which they stand in the block. G94 forgets the feed, as in LinuxCNC. An arc may have radii at its start
/// and end that differ by 28.3 um (under G20 by 71.8 um) or by 0.1 % of the larger one; the half chord of an R arc may
/// exceed R by 1.27 um (LinuxCNC's tolerances). Before the program says otherwise: mm, G17, G90, G91.1, G94, G54, no
/// motion mode, spindle off, no tool, G64 without P, X = Y = Z = 0. Cost: linear; one Move a motion block, one
/// ModalState a block.
Result<Interpretation> interpret(const Program& program, const InterpretOptions& options = {});

/// Whether `interpret` takes the program; nothing of what it does is kept. Errors: those of `interpret`.
Status judge(const Program& program, const InterpretOptions& options = {});

}  // namespace polypod::gcode
