// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Which coordinates of the tool a pose of a machine prescribes.
#pragma once

#include <array>
#include <cstdint>
#include <initializer_list>

#include "polypod/geometry/pose.hpp"

namespace polypod::machine {

/// A coordinate of the tool tip's pose, R = R_z(C) R_y(B) R_x(A).
enum class Coordinate : std::uint8_t { x, y, z, a, b, c };

/// Any subset of x, y, z, A, B, C, in the order in which a pose of the machine gives them; the other coordinates follow
/// from the machine. A and B of `axis`, the task of a 5-axis machine, are those of the tool's axis, R_y(B) R_x(A) z,
/// whatever the turn about it is; those of any other task are angles of R_z(C) R_y(B) R_x(A).
class Task {
 public:
  static const Task pose;   ///< x, y, z, A, B, C
  static const Task axis;   ///< x, y, z, A, B: the position and the direction of the tool axis
  static const Task point;  ///< x, y, z

  constexpr Task() = default;
  constexpr Task(std::initializer_list<Coordinate> coordinates) {
    for (const Coordinate c : coordinates) push_back(c);
  }
  /// Leaves out what it has already.
  constexpr void push_back(Coordinate c) {
    if (!holds(c)) which_[static_cast<std::size_t>(size_++)] = c;
  }

  [[nodiscard]] constexpr int size() const { return size_; }
  [[nodiscard]] constexpr Coordinate operator[](int i) const { return which_[static_cast<std::size_t>(i)]; }
  [[nodiscard]] constexpr bool holds(Coordinate c) const {
    for (int i = 0; i < size_; ++i)
      if (which_[static_cast<std::size_t>(i)] == c) return true;
    return false;
  }
  /// Whether it prescribes an angle: only then can the machine turn its tool as the pose prescribes.
  [[nodiscard]] constexpr bool turns() const {
    return holds(Coordinate::a) || holds(Coordinate::b) || holds(Coordinate::c);
  }
  /// Whether it prescribes the whole position.
  [[nodiscard]] constexpr bool places() const {
    return holds(Coordinate::x) && holds(Coordinate::y) && holds(Coordinate::z);
  }
  /// Whether the turn about the tool axis is free: the position and the tool's axis are all that counts.
  [[nodiscard]] constexpr bool names_axis() const {
    return places() && size_ == 5 && holds(Coordinate::a) && holds(Coordinate::b);
  }
  [[nodiscard]] constexpr bool is_angle(int i) const { return (*this)[i] >= Coordinate::a; }
  friend constexpr bool operator==(const Task& a, const Task& b) {
    for (int i = 0; i < a.size_ && i < b.size_; ++i)
      if (a[i] != b[i]) return false;
    return a.size_ == b.size_;
  }

 private:
  std::array<Coordinate, 6> which_{};
  int size_ = 0;
};

inline constexpr Task Task::pose{Coordinate::x, Coordinate::y, Coordinate::z,
                                 Coordinate::a, Coordinate::b, Coordinate::c};
inline constexpr Task Task::axis{Coordinate::x, Coordinate::y, Coordinate::z, Coordinate::a, Coordinate::b};
inline constexpr Task Task::point{Coordinate::x, Coordinate::y, Coordinate::z};

/// "x", "y", "z", "A", "B" or "C".
inline constexpr const char* name_of(Coordinate c) {
  constexpr std::array<const char*, 6> kNames{"x", "y", "z", "A", "B", "C"};
  return kNames[static_cast<std::size_t>(c)];
}

/// The pose that has the coordinates of `target` that the task prescribes and the others of `other`. Of a task that
/// names the tool's axis, `other` is turned by the smallest rotation that brings its axis there (opposite axes have no
/// smallest one: about the target's x axis).
Pose prescribed(Task task, const Pose& target, const Pose& other);

/// Rows that select from a twist [linear; angular] in M what the task sees of it, at most 6: the held coordinates of
/// the position; all rotation where all angles are held, that across the tool axis where the task names it, else the
/// rates of the angles that are held (singular at B = 90 deg). Angular rows count `length` metres a radian.
Eigen::Matrix<double, Eigen::Dynamic, 6, 0, 6, 6> task_rows(Task task, const Pose& target, double length);

/// Error of `actual` against `target` as a twist in M: the motion that would bring what the task prescribes of actual
/// onto target (`prescribed`).
Vec6 pose_error(Task task, const Pose& target, const Pose& actual);

}  // namespace polypod::machine
