// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "choice.hpp"

#include <algorithm>
#include <cmath>
#include <functional>
#include <iterator>
#include <limits>
#include <numbers>
#include <optional>

#include "polypod/core/units.hpp"
#include "polypod/families/serial/carried_arm.hpp"
#include "polypod/families/serial/six_joint_inverse.hpp"
#include "polypod/post/ladder.hpp"
#include "turns.hpp"

namespace polypod::post {
namespace {

constexpr double kTurn = 2 * std::numbers::pi;
constexpr double kPole = 1e-9;  // of a unit vector across the axis about which the tool turns: none
constexpr double kNone = std::numeric_limits<double>::infinity();
constexpr std::size_t kMostJoints = 7;

// Rungs of C, and by how many it changes from point to point; places of the external axis. The finer ones hold the
// coarser.
constexpr int kTurns = 72, kCoarseTurns = 36;
constexpr double kFarthestTurn = units::from_deg(30), kAvoided = units::from_deg(12);
constexpr int kPlaces = 65, kCoarsePlaces = 17;
constexpr int kFine = 33, kFinerBy = 8;  // beside a way: values, and how much finer
constexpr int kLookedTurns = 24, kLookedPlaces = 9, kLookedPlacesAlone = 33;
constexpr double kRungEvery = 1.0 / 200;  // of the sum of links
constexpr double kRungTurn = units::from_deg(5);

// What a state costs: a joint this share of its range from a limit, and a pose this near to a singular one, cost their
// weight; so does the compliance across the path where it is as large as the least at the first point.
constexpr double kNearLimit = 0.05, kLimitWeight = 0.02;
constexpr double kNearSingular = 0.02, kSingularWeight = 0.05;
constexpr double kComplianceWeight = 0.02;
// What a step costs besides the squares of the joints' changes: a joint at its speed limit, and a joint that moves by
// more than `kJump` rad in a cut.
constexpr double kSpeedWeight = 0.1, kJump = 1.0, kJumpCost = 100, kRungWeight = 1e-4;
constexpr double kStartWeight = 0.5;

/// m, of the joints that turn; not 0.
double sum_of_links(const machine::SerialArm& arm) {
  double out = 0;
  for (const machine::DhRow& row : arm.dh)
    if (row.kind == machine::JointKind::revolute) out += std::abs(row.a) + std::abs(row.d);
  return std::max(out, 1e-3);
}

/// The joints of a state, those of the whole arm.
struct Rung {
  bool exists = false;
  std::array<double, kMostJoints> q{};
};

/// One point of the path as the ladder sees it.
struct LadderPoint {
  Vec3 p = Vec3::Zero();           // in M
  Vec3 axis = Vec3::UnitZ();       // of the tool
  Vec3 across = Vec3::Zero();      // of the path and the tool; 0: none
  std::optional<Vec3> angles;      // where C is not chosen
  std::optional<double> external;  // where it is not chosen
  /// Poses on the step that leads there, of a long one.
  struct Between {
    Vec3 p, axis;
    std::optional<Vec3> angles;
  };
  std::vector<Between> between;
  std::vector<double> avoided;  // values of C, rad
  double seconds = 0;           // of the step that leads there; 0: not judged, as in rapids
  double length = 0;            // m, the same; of a turn alone it is none
  bool rapid = false;
  std::size_t step = 0;  // of the path
};

/// The inverse with six joints by its branches, also of arms with coupled joints.
using Solver = std::function<void(const Pose&, machine::SixJointBranches&)>;
Solver solver_of(const machine::SerialArm& arm) {
  if (const auto six = machine::six_joint_inverse(arm)) {
    return [form = *six](const Pose& X, machine::SixJointBranches& out) {
      std::visit([&](const auto& inverse) { inverse.solve(X, out); }, form);
    };
  }
  return [arm](const Pose& X, machine::SixJointBranches& out) {
    std::fill(std::begin(out.exists), std::end(out.exists), false);
    for (const kinematics::Solution& s : machine::inverse(arm, X).solutions) {
      if (s.branch >= machine::SixJointBranches::kCount) continue;
      out.exists[s.branch] = true;
      out.singular[s.branch] = s.singular;
      std::copy_n(s.joints.data(), 6, out.joints[s.branch]);
    }
  };
}

/// Which values a ladder has: all round and over the whole range, or beside those of a way that is known.
struct Values {
  int turns = 1, places = 1;
  const std::vector<double>* beside_c = nullptr;       // of each rung: kFine values about it, an eighth of a step apart
  const std::vector<double>* beside_places = nullptr;  // likewise
};

/// The states of one arm along a path, in one posture.
class States {
 public:
  States(const machine::SerialArm& arm, const std::vector<LadderPoint>& points, const PlanOptions& options,
         unsigned branch, const Values& values)
      : arm_(arm),
        carried_(machine::CarriedArm::on_external_axis(arm)),
        solve_(solver_of(carried_ ? carried_->arm() : arm)),
        points_(points),
        options_(options),
        branch_(static_cast<int>(branch)),
        values_(values),
        row_(static_cast<std::size_t>(values.turns * values.places)),
        next_(row_.size()) {
    for (const machine::DhRow& row : arm.dh) {
      if (row.locked) continue;
      ranges_[joints_] = row.range;
      whole_turns_[joints_] = row.kind == machine::JointKind::revolute;
      compliance_[joints_++] = row.compliance;
    }
    weighs_compliance_ = std::any_of(compliance_.begin(), compliance_.end(), [](double c) { return c > 0; });
    if (carried_ && carried_->moves()) behind_ = 1;
  }

  [[nodiscard]] double turn(std::size_t n, int rung) const {
    const int off = rung - values_.turns / 2;
    if (values_.beside_c != nullptr) return (*values_.beside_c)[n] + kTurn / kTurns / kFinerBy * off;
    return kTurn / values_.turns * off;
  }
  [[nodiscard]] double place(std::size_t n, int column) const {
    const machine::JointRange range = ranges_.front();
    const double width = range.max - range.min;
    if (values_.beside_places != nullptr) {
      const double step = width / (kPlaces - 1) / kFinerBy;
      const int off = column - values_.places / 2;
      return std::clamp((*values_.beside_places)[n] + step * off, range.min, range.max);
    }
    return values_.places < 2 ? range.min : range.min + width * column / (values_.places - 1);
  }

  double state(std::size_t n, int j) {
    if (j == 0) std::swap(row_, next_);
    const LadderPoint& point = points_[n];
    Rung& rung = next_[static_cast<std::size_t>(j)];
    rung.exists = false;
    const int turned = j % values_.turns;
    if (!point.angles && std::any_of(point.avoided.begin(), point.avoided.end(), [&](double c) {
          return std::abs(std::remainder(turn(n, turned) - c, kTurn)) < kAvoided;
        }))
      return kNone;
    const Vec3 angles =
        point.angles ? *point.angles : both_turns(Rotary::abc, point.axis, turn(n, turned), Vec3::Zero())[0];
    Pose X{R_MW_ * rotation_abc(angles.x(), angles.y(), angles.z()) * R_MW_.transpose(), point.p};
    if (carried_) {
      const double u = point.external ? *point.external : place(n, j / values_.turns);
      X = carried_->seen(X, u);
      rung.q[0] = u;
    }
    if (!stands(X, rung)) return kNone;
    rung.exists = true;
    // On the way that leads there the axis stands about where it ends: there the arm must reach it, too.
    Rung between = rung, before = rung;
    bool first = true;
    for (const LadderPoint::Between& at : point.between) {
      const Vec3 abc = at.angles ? *at.angles : both_turns(Rotary::abc, at.axis, turn(n, turned), Vec3::Zero())[0];
      Pose X_at{R_MW_ * rotation_abc(abc.x(), abc.y(), abc.z()) * R_MW_.transpose(), at.p};
      if (carried_) X_at = carried_->seen(X_at, rung.q[0]);
      if (!stands(X_at, between)) return kNone;
      if (!first && hurries(before, between, point)) return kNone;
      before = between;
      first = false;
    }
    if (!first && hurries(before, rung, point)) return kNone;
    double cost = cost_of_limits(rung) + cost_of_pose(rung, point);
    if (n == 0) {
      const int off = values_.turns > 1 ? turned - values_.turns / 2 : 0;
      cost += cost_of_start(rung) + 1e-6 * off * off;
    }
    return cost;
  }

  double step(std::size_t n, int i, int j) const {
    const Rung &a = row_[static_cast<std::size_t>(i)], &b = next_[static_cast<std::size_t>(j)];
    const LadderPoint& point = points_[n];
    const int way = std::abs(i % values_.turns - j % values_.turns);
    double cost = kRungWeight * (values_.beside_c != nullptr ? way : std::min(way, values_.turns - way));
    for (std::size_t k = 0; k < joints_; ++k) {
      const double change = change_of(k, a.q[k], b.q[k]);
      if (!std::isfinite(change)) return kNone;
      cost += change * change;
      if (std::abs(change) > kJump && whole_turns_[k] && !point.rapid) cost += kJumpCost;
      if (options_.joint_speeds.empty() || !(point.seconds > 0)) continue;
      const double share = std::abs(change) / (point.seconds * options_.joint_speeds[k]);
      if (share > 1) return kNone;
      cost += kSpeedWeight * share * share;
    }
    return cost;
  }

  /// Joints that may turn more than once go on in the turn of the way that leads there.
  void chosen(std::size_t, int j, int i) {
    Rung& b = next_[static_cast<std::size_t>(j)];
    const Rung& a = row_[static_cast<std::size_t>(i)];
    for (std::size_t k = 0; k < joints_; ++k) b.q[k] = a.q[k] + change_of(k, a.q[k], b.q[k]);
  }

 private:
  static constexpr double kSlack = 1e-10;  // rad or m

  /// The joints at a pose as the six see it, in the posture of the ladder; false where there are none within limits.
  bool stands(const Pose& X, Rung& rung) const {
    machine::SixJointBranches out;
    solve_(X, out);
    if (!out.exists[branch_] || out.singular[branch_]) return false;
    std::copy_n(out.joints[branch_], 6, rung.q.begin() + behind_);
    for (std::size_t i = 0; i < joints_; ++i) {
      if (rung.q[i] < ranges_[i].min - kSlack || rung.q[i] > ranges_[i].max + kSlack) return false;
    }
    return true;
  }

  /// Whether a joint is too fast between two of the poses between, as where the way passes near a singular pose.
  [[nodiscard]] bool hurries(const Rung& from, const Rung& to, const LadderPoint& point) const {
    if (options_.joint_speeds.empty() || !(point.seconds > 0)) return false;
    const double seconds = point.seconds / static_cast<double>(point.between.size() + 1);
    for (std::size_t k = 0; k < joints_; ++k) {
      if (std::abs(change_of(k, from.q[k], to.q[k])) > seconds * options_.joint_speeds[k]) return true;
    }
    return false;
  }

  /// By how much joint k moves; by whole turns less where its range has them. Not finite: beyond its range.
  [[nodiscard]] double change_of(std::size_t k, double from, double to) const {
    double change = to - from;
    const double span = ranges_[k].max - ranges_[k].min;
    if (!whole_turns_[k] || span <= kTurn || std::abs(change) <= std::numbers::pi) return change;
    if (k < static_cast<std::size_t>(behind_)) return change;  // where the axis stands is what is chosen
    change -= kTurn * std::round(change / kTurn);
    const double arrives = from + change;
    return arrives < ranges_[k].min - kSlack || arrives > ranges_[k].max + kSlack ? kNone : change;
  }

  [[nodiscard]] double cost_of_limits(const Rung& rung) const {
    double cost = 0;
    for (std::size_t i = 0; i < joints_; ++i) {
      const machine::JointRange& r = ranges_[i];
      const double share = std::min(rung.q[i] - r.min, r.max - rung.q[i]) / (r.max - r.min);
      const double near = kNearLimit / (std::max(share, 0.0) + kNearLimit);
      cost += kLimitWeight * near * near;
    }
    return cost;
  }

  /// How near to a singular pose, and how soft across the path: both from the Jacobian.
  double cost_of_pose(const Rung& rung, const LadderPoint& point) {
    machine::JointVector q(static_cast<Eigen::Index>(joints_));
    for (std::size_t i = 0; i < joints_; ++i) q[static_cast<Eigen::Index>(i)] = rung.q[i];
    const machine::JacobianMatrix J = machine::forward_jacobian(arm_, q).J;
    Eigen::Matrix<double, 6, 6> S = J.rightCols<6>();
    S.topRows<3>() /= length_;
    const double near = kNearSingular / (std::abs(S.determinant()) * kDeterminantScale + kNearSingular);
    double cost = kSingularWeight * near * near;
    if (!weighs_compliance_ || point.across.isZero(0)) return cost;
    double compliance = 0;
    for (std::size_t i = 0; i < joints_; ++i) {
      const double lever = point.across.dot(J.col(static_cast<Eigen::Index>(i)).head<3>());
      compliance += compliance_[i] * lever * lever;
    }
    if (reference_ == 0) reference_ = compliance;
    return reference_ > 0 ? cost + kComplianceWeight * compliance / reference_ : cost;
  }

  [[nodiscard]] double cost_of_start(const Rung& rung) const {
    if (!options_.start_joints) return 0;
    double cost = 0;
    for (std::size_t i = 0; i < joints_; ++i) {
      const double off = rung.q[i] - (*options_.start_joints)[static_cast<Eigen::Index>(i)];
      cost += kStartWeight * off * off;
    }
    return cost;
  }

  // |det S| of an arm in a good pose is some hundredths: links of a third of the sum of lengths each.
  static constexpr double kDeterminantScale = 20;

  const machine::SerialArm& arm_;
  const std::optional<machine::CarriedArm> carried_;
  const Solver solve_;
  const std::vector<LadderPoint>& points_;
  const PlanOptions& options_;
  const int branch_;
  const Values values_;
  Mat3 R_MW_ = rotation_z(options_.rotation);
  std::size_t joints_ = 0;
  int behind_ = 0;  // joints before the six
  std::array<machine::JointRange, kMostJoints> ranges_{};
  std::array<bool, kMostJoints> whole_turns_{};
  std::array<double, kMostJoints> compliance_{};
  const double length_ = sum_of_links(arm_);
  double reference_ = 0;
  bool weighs_compliance_ = false;
  std::vector<Rung> row_, next_;
};

bool chooses_c(const PlanOptions& options) {
  return !options.c;
}
bool chooses_place(const PlanOptions& options) {
  return options.external == External::chosen;
}

/// Poses between the ends of a cut that is longer than kLongStep, turns farther than kFarSweep or tilts the tool by
/// more than kFarTilt: near a singular pose joints hurry on a short way.
void add_between(const Step& from, const Step& to, const Vec3& angles_from, const Mat3& R_MW,
                 const PlanOptions& options, LadderPoint& point) {
  constexpr double kLongStep = 0.05, kFarSweep = units::from_deg(45), kFarTilt = units::from_deg(2);  // m, rad
  constexpr int kMost = 100;
  const bool curved = to.kind == StepKind::arc;
  const double wanted = std::max({point.length / kLongStep, curved ? to.sweep / kFarSweep : 0.0,
                                  point.rapid ? 0.0 : angle_between(from.axis, to.axis) / kFarTilt});
  const int pieces = std::min(kMost, static_cast<int>(std::ceil(wanted - 1e-9)));
  for (int k = 1; k < pieces; ++k) {
    const double s = double(k) / pieces;
    Vec3 tip = from.tip + s * (to.tip - from.tip);
    if (curved) {
      const Vec3 r = from.tip - to.centre;
      const double rise = (to.tip - to.centre).dot(to.normal) - r.dot(to.normal);
      tip = to.centre + Eigen::AngleAxisd(s * to.sweep, to.normal) * r + s * rise * to.normal;
    }
    LadderPoint::Between at{options.origin + R_MW * tip, between_axes(from.axis, to.axis, s), std::nullopt};
    if (point.angles) at.angles = Vec3(angles_from + s * (*point.angles - angles_from));
    point.between.push_back(at);
  }
}

/// The placed steps of a path as points of a ladder.
std::vector<LadderPoint> points_of(const Path& path, const PlanOptions& options, int turn) {
  const Mat3 R_MW = rotation_z(options.rotation);
  std::vector<LadderPoint> out;
  const Step* before = nullptr;
  Vec3 angles = Vec3::Zero();
  for (std::size_t i = 0; i < path.steps.size(); ++i) {
    const Step& step = path.steps[i];
    if (!step.placed()) continue;
    LadderPoint point;
    point.step = i;
    point.p = options.origin + R_MW * step.tip;
    point.axis = step.axis;
    const Vec3 angles_before = angles;
    if (options.c) {
      const bool sets = path.leaves_c() && *options.c != 0;
      angles = step.angles && !sets ? *step.angles
               : before == nullptr
                   ? both_turns(Rotary::abc, step.axis, *options.c, Vec3::Zero())[static_cast<std::size_t>(turn)]
                   : nearest_turn(Rotary::abc, step.axis, *options.c, angles);
      point.angles = angles;
    } else if (step.turned && !path.leaves_c()) {
      point.angles = step.angles;  // a program without C leaves C free
    }
    if (options.external != External::chosen) point.external = options.external_at;
    point.rapid = step.kind == StepKind::rapid;
    if (before != nullptr) {
      Vec3 along = step.tip - before->tip;
      point.length = along.norm();
      if (step.kind == StepKind::arc) {
        const Vec3 r = step.tip - step.centre;
        point.length = std::hypot((r - r.dot(step.normal) * step.normal).norm() * step.sweep, along.dot(step.normal));
        along = step.normal.cross(r);
      }
      if (!point.rapid) add_between(*before, step, angles_before, R_MW, options, point);
      const Vec3 across = R_MW * step.axis.cross(along);
      if (across.norm() > kPole) point.across = across.normalized();
      if (!point.rapid && step.feed > 0) point.seconds = point.length / step.feed;
    }
    before = &step;
    out.push_back(point);
  }
  return out;
}

/// Those of the points that are rungs, each with the way since the one before it.
std::vector<LadderPoint> rungs_of(const std::vector<LadderPoint>& points, double every) {
  std::vector<LadderPoint> out;
  double length = 0, seconds = 0;
  bool judged = true;
  for (std::size_t n = 0; n < points.size(); ++n) {
    const LadderPoint& point = points[n];
    length += point.length;
    seconds += point.seconds;
    judged = judged && point.seconds > 0;
    const bool end = n == 0 || n + 1 == points.size() || point.rapid || points[n + 1].rapid;
    const auto turned = [&] {
      const LadderPoint& last = out.back();
      if (angle_between(point.axis, last.axis) >= kRungTurn) return true;
      return point.angles && last.angles && (*point.angles - *last.angles).cwiseAbs().maxCoeff() >= kRungTurn;
    };
    if (!end && length < every && !turned()) continue;
    out.push_back(point);
    out.back().length = length;
    out.back().seconds = judged ? seconds : 0;
    length = seconds = 0;
    judged = true;
  }
  return out;
}

/// One value a rung for every step: linear between rungs over their way, by its time where that is known.
std::vector<double> along_steps(const Path& path, const std::vector<LadderPoint>& points,
                                const std::vector<LadderPoint>& rungs, const std::vector<double>& values) {
  std::vector<double> out(path.steps.size(), values.front());
  std::size_t next = 0;
  double done = 0;
  for (const LadderPoint& point : points) {
    const LadderPoint& rung = rungs[next];
    const bool timed = rung.seconds > 0;
    const double whole = timed ? rung.seconds : rung.length;
    done += timed ? point.seconds : point.length;
    const bool arrived = point.step == rung.step;
    const double share = arrived ? 1 : whole > 0 ? std::min(done / whole, 1.0) : 0;
    const double from = values[next == 0 ? 0 : next - 1];
    const double value = arrived ? values[next] : from + share * (values[next] - from);
    std::fill(out.begin() + static_cast<std::ptrdiff_t>(point.step), out.end(), value);
    if (!arrived) continue;
    ++next;
    done = 0;
  }
  return out;
}

}  // namespace

Choice choose(const Configuration& configuration, const Path& path, const PlanOptions& options,
              const ChoiceQuestion& question) {
  Choice out;
  const auto& arm = std::get<machine::SerialArm>(configuration.machine);
  const std::vector<LadderPoint> points = points_of(path, options, question.turn);
  std::vector<LadderPoint> rungs = rungs_of(points, question.every_point ? 0 : kRungEvery * sum_of_links(arm));
  if (rungs.empty()) return out;
  for (const ChoiceQuestion::Avoided& avoided : question.avoided) {
    for (LadderPoint& rung : rungs)
      if (rung.step == avoided.step) rung.avoided.push_back(avoided.c);
  }
  bool stopped = false;
  double begins = 0, ends = 0;  // of the progress
  std::vector<double> c(rungs.size()), places(rungs.size());
  /// Takes the values of the cheapest way; false where there is none.
  const auto run = [&](const Values& values, double share_of_work) {
    begins = ends;
    ends += share_of_work;
    States states(arm, rungs, options, question.branch, values);
    LadderSize size;
    size.points = rungs.size();
    size.rungs = values.turns;
    size.around = values.beside_c == nullptr;
    size.farthest =
        size.around ? static_cast<int>(std::lround(kFarthestTurn / kTurn * values.turns)) : kFinerBy;  // beside the way
    if (values.beside_places != nullptr) size.farthest_column = kFinerBy;
    size.columns = values.places;
    constexpr std::size_t kReport = 64;
    const LadderWay way = cheapest_way(
        size,
        [&](std::size_t n, int j) {
          if (j == 0 && n % kReport == 0) {
            const double share = double(n) / double(rungs.size());
            stopped = stopped || !options.progress(begins + (ends - begins) * share);
          }
          return stopped ? kNone : states.state(n, j);
        },
        [&](std::size_t n, int i, int j) { return states.step(n, i, j); },
        [&](std::size_t n, int j, int i) { states.chosen(n, j, i); });
    if (way.rungs.empty()) {
      out.blocked = rungs[way.blocked].step;
      return false;
    }
    for (std::size_t n = 0; n < rungs.size(); ++n) {
      if (values.turns > 1) c[n] = states.turn(n, way.rungs[n]);
      if (values.places > 1) places[n] = states.place(n, way.columns[n]);
    }
    return true;
  };
  const bool turns = chooses_c(options), moves = chooses_place(options);
  const std::vector<LadderPoint> open = rungs;
  // With one of the two as it is, the other alone.
  const auto hold_c = [&] {
    rungs = open;
    for (std::size_t n = 0; turns && n < rungs.size(); ++n)
      if (!rungs[n].angles) rungs[n].angles = both_turns(Rotary::abc, rungs[n].axis, c[n], Vec3::Zero())[0];
  };
  const auto hold_places = [&] {
    rungs = open;
    for (std::size_t n = 0; moves && n < rungs.size(); ++n) rungs[n].external = places[n];
  };
  constexpr double kMost = 0.8, kRest = 0.05;
  const Values whole =
      turns && moves ? Values{kCoarseTurns, kCoarsePlaces} : Values{turns ? kTurns : 1, moves ? kPlaces : 1};
  if (!run(whole, kMost)) return out;
  if (turns && moves) {
    hold_c();
    if (!run({1, kPlaces}, kRest)) return out;
    hold_places();
    if (!run({kTurns, 1}, kRest)) return out;
  }
  // Finer, beside the way that was found: small moves of joints cost little.
  const std::vector<double> found_c = c, found_places = places;
  if (moves) {
    hold_c();
    if (!run({1, kFine, nullptr, &found_places}, kRest)) return out;
  }
  if (turns) {
    hold_places();
    if (!run({kFine, 1, &found_c, nullptr}, kRest)) return out;
  }
  out.found = true;
  if (turns) out.c = along_steps(path, points, rungs, c);
  if (moves) out.external = along_steps(path, points, rungs, places);
  return out;
}

double first_look(const Configuration& configuration, const Path& path, const PlanOptions& options,
                  const ChoiceQuestion& question) {
  const auto& arm = std::get<machine::SerialArm>(configuration.machine);
  const std::vector<LadderPoint> all = points_of(path, options, question.turn);
  constexpr std::size_t kLooked = 64;
  std::vector<LadderPoint> points;
  for (std::size_t i = 0; i < std::min(kLooked, all.size()); ++i) {
    points.push_back(all[i * all.size() / std::min(kLooked, all.size())]);
    points.back().seconds = 0;  // whether it can be reached, at whatever speed
  }
  const Values values{chooses_c(options) ? kLookedTurns : 1, !chooses_place(options) ? 1
                                                             : chooses_c(options)    ? kLookedPlaces
                                                                                     : kLookedPlacesAlone};
  States states(arm, points, options, question.branch, values);
  double sum = 0;
  for (std::size_t n = 0; n < points.size(); ++n) {
    double least = kNone;
    for (int j = 0; j < values.turns * values.places; ++j) least = std::min(least, states.state(n, j));
    sum += least;
  }
  return sum;
}

}  // namespace polypod::post
