// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Bodies of a machine, its tool and what stands round it; whether they touch on the way of the joints.
#pragma once

#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "polypod/bodies/shape.hpp"
#include "polypod/core/config.hpp"
#include "polypod/machine/any_machine.hpp"

namespace polypod::bodies {

struct Body {
  /// What it is fixed to: M, the workpiece frame W, the frame after a row of an arm's table (0: its base), or the tool.
  enum class Frame { machine, work, link, tool };
  std::string name;
  Frame frame = Frame::machine;
  int link = 0;          ///< of Frame::link
  bool cuts = false;     ///< it may touch what is `cut`
  bool is_cut = false;   ///< stock or part
  int tool_number = -1;  ///< only while this tool is in the spindle; -1: always
  Shape shape;
};

struct Bodies {
  std::vector<Body> all;
  double towards_spindle = 1;  ///< +1 or -1: on which side of the tip, along z_T, cutter and holder are
  std::vector<std::pair<std::string, std::string>> ignored;  ///< pairs that may touch, by name
};

/// Reads a file of bodies (docs/bodies.md) for a machine. Errors: those of config::Table and read_stl; BO100 to BO108.
Result<Bodies> read(const std::string& path, const machine::AnyMachine& machine);

/// The cutters and the box of the stock before it is cut, as bodies: what a job says besides the file.
Body cutter_body(double diameter, double length, int tool_number, double towards_spindle = 1);
Body stock_body(const Vec3& min, const Vec3& max);

/// Follows a way from pose to pose and says where bodies touch.
///
/// Between two poses that follow each other each joint of a serial arm is taken to go monotonously from its one value
/// to the other; then no point of a body moves farther than the sum over the joints of lever times change. Of other
/// machines the tool is taken to move straight and to turn about one axis. Bodies whose distance (its proven lower
/// bound) is above how far both can move are free on the whole way; otherwise the way is halved, down to
/// `kResolution`. So what is not reported is proven free under that assumption; what is reported touches or comes
/// nearer than kResolution. Constant model, and the state of one way: one instance a thread.
class Watch {
 public:
  static constexpr double kResolution = 20e-6;  ///< m

  Watch(const machine::AnyMachine& machine, const Pose& X_MW, Bodies bodies);

  /// The way to the pose X_MT with the joints q (rad or m), from the one before where `continues`. The names of the
  /// first two bodies that touch on it; nothing where all are free.
  std::optional<std::pair<std::string, std::string>> to(const Pose& X_MT, const machine::JointVector& q, bool continues,
                                                        int tool_number);

  /// What was judged and what was not, in sentences.
  [[nodiscard]] std::vector<std::string> notes() const;
  [[nodiscard]] std::size_t pairs() const { return pairs_.size(); }

 private:
  struct Pair {
    std::size_t a, b;
    bool free = false;  ///< proven so at the last pose
    double slack = 0;   ///< m, how far both may still move
  };
  struct Config {
    Pose X_MT;
    machine::JointVector q;
  };
  [[nodiscard]] std::vector<Pose> frames(const Config& c) const;
  [[nodiscard]] Config between(const Config& a, const Config& b) const;
  [[nodiscard]] double motion(std::size_t body, const Config& a, const Config& b) const;
  [[nodiscard]] const Pose& frame_of(const Body& body, const std::vector<Pose>& frames) const;
  [[nodiscard]] Bracket apart(const Pair& pair, const std::vector<Pose>& frames, double enough) const;
  [[nodiscard]] bool one_inside(const Pair& pair, const std::vector<Pose>& frames) const;
  [[nodiscard]] bool free_between(const Pair& pair, const Config& a, const Config& b) const;

  machine::AnyMachine machine_;
  const machine::SerialArm* arm_ = nullptr;
  std::vector<Body> bodies_;
  std::vector<Pair> pairs_;
  std::vector<std::vector<double>> levers_;  ///< of each body, m (revolute) or 1 (prismatic) for each free joint
  std::vector<double> extents_;              ///< of bodies on the tool, from the tip
  std::vector<double> spheres_;              ///< radius round `middles_`
  std::vector<Vec3> middles_;
  std::vector<std::string> left_out_;
  Pose X_MW_;
  std::optional<Config> last_;
  std::vector<Pose> last_frames_;
  int last_tool_ = 0;
};

}  // namespace polypod::bodies
