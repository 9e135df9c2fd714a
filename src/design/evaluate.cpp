// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/design/evaluate.hpp"

#include <fmt/format.h>

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <chrono>
#include <cmath>

#include "polypod/core/units.hpp"
#include "polypod/design/cell_study.hpp"
#include "polypod/kinematics/any_machine.hpp"
#include "polypod/kinematics/parts.hpp"
#include "polypod/quality/singularity.hpp"
#include "polypod/quality/survey.hpp"
#include "polypod/statics/compliance.hpp"
#include "polypod/workspace/shape.hpp"
#include "rounded.hpp"

namespace polypod::design {
namespace {

constexpr double kInf = std::numeric_limits<double>::infinity();
constexpr double kNone = std::numeric_limits<double>::quiet_NaN();
/// The gap of the first volume as a share of it: a tenth of the boxes that a volume to 1 % takes.
constexpr double kCoarse = 0.25;
constexpr const char* kCancelled = "WS110";

Value exactly(double value) {
  Value out;
  out.value = out.lower = out.upper = value;
  return out;
}

bool is_volume(Figure figure) {
  return figure == Figure::volume || figure == Figure::largest_box;
}

double product(const std::array<double, 2>& sides) {
  return sides[0] * sides[1];
}

/// One candidate on its way through the stages.
class Judge {
 public:
  Judge(const Study& study, const Incumbents& incumbents, const EvaluateOptions& options)
      : study_(study), incumbents_(incumbents), options_(options), wanted_(study.figures()) {
    out_.figures.resize(wanted_.size());
    workspace_ = workspace_options(study);
    workspace_.threads = options.threads;
    workspace_.cancelled = options.cancelled;
  }

  Result<Evaluation> operator()(const AnyMachine& m) {
    POLYPOD_TRY(stages(m));
    out_.objective = objective_of(study_, out_.figures);
    return out_;
  }

 private:
  [[nodiscard]] bool wants(Figure figure) const {
    return std::find(wanted_.begin(), wanted_.end(), figure) != wanted_.end();
  }
  void set(Figure figure, const Value& value) {
    for (std::size_t i = 0; i < wanted_.size(); ++i)
      if (wanted_[i] == figure) out_.figures[i] = value;
  }
  [[nodiscard]] Value get(Figure figure) const {
    for (std::size_t i = 0; i < wanted_.size(); ++i)
      if (wanted_[i] == figure) return out_.figures[i];
    return {};
  }

  void refuse(const std::string& why) {
    out_.state = State::refused;
    out_.reason = why;
    out_.violation = kInf;
  }

  /// Whether what is known decides already. `last`: nothing else will be computed, and a hold is kept only where the
  /// worse bound of its figure keeps it.
  bool decided(bool last) {
    double certain = box_violation_ + duty_violation_, not_proven = certain;
    std::string broken = certain > 0 ? "not kept: " + (duty_violation_ > 0 ? duty_reason_ : box_reason_) : "";
    for (const Hold& h : study_.holds) {
      if (h.box) continue;
      const Value v = get(h.figure);
      if (std::isnan(v.value)) continue;
      const auto share = [](double by, double bound) { return by > 0 ? by / (bound != 0 ? std::abs(bound) : 1) : 0; };
      // No figure is negative, so what is infinite breaks an upper bound by a lot, but not by infinity.
      constexpr double kLot = 1e6;
      if (h.min) {
        certain += share(*h.min - v.upper, *h.min);
        not_proven += share(*h.min - v.lower, *h.min);
      }
      if (h.max) {
        certain += std::min(kLot, share(v.lower - *h.max, *h.max));
        not_proven += std::min(kLot, share(v.upper - *h.max, *h.max));
      }
      if (!broken.empty() || !((last ? not_proven : certain) > 0)) continue;
      broken = fmt::format("{} {}: {:.6g}", certain > 0 ? "not kept:" : "not proven:", h.in_words(), v.value);
      if (v.lower < v.upper) broken += fmt::format(", certainly {:.6g} to {:.6g}", v.lower, v.upper);
    }
    out_.violation = last ? not_proven : certain;
    if (out_.violation > 0) {
      out_.state = State::violates;
      out_.reason = broken;
      return true;
    }
    for (const Goal& g : study_.goals) {
      if (!last || g.maximise || !std::isinf(get(g.figure).value)) continue;
      refuse(fmt::format("{} is infinite: the workspace holds a singular pose", info_of(g.figure).name));
      return true;
    }
    out_.state = State::done;
    for (const Goal& g : study_.goals) {
      if (g.maximise || study_.wants_front() || get(g.figure).value != 0) continue;
      refuse(fmt::format("{} is 0, and {} cannot be divided by it", info_of(g.figure).name, g.best));
      return true;
    }
    if (!last && worse()) {
      out_.state = State::dropped;
      return true;
    }
    return last;
  }

  /// Whether the goals at their better bounds are worse than an incumbent at its worse ones. Figures that are not known
  /// yet bound nothing.
  [[nodiscard]] bool worse() {
    for (const Goal& g : study_.goals)
      if (std::isnan(get(g.figure).value)) return false;
    if (!study_.wants_front()) {
      const double upper = objective_of(study_, out_.figures).upper;
      if (!(upper < incumbents_.objective)) return false;
      out_.reason =
          fmt::format("its objective is at most {:.6g}, below {:.6g} of another, proven", upper, incumbents_.objective);
      return true;
    }
    const std::vector<double> hopeful = goals_of(study_, out_, true);
    const bool beaten = std::any_of(incumbents_.front.begin(), incumbents_.front.end(),
                                    [&](const auto& point) { return dominates(point, hopeful); });
    if (beaten) out_.reason = "dominated by a point of the front, proven";
    return beaten;
  }

  /// Error of a computation on a candidate: it has no such figure. Only Ctrl-C ends the search.
  Status candidate(const Error& error) {
    if (error.id == kCancelled) return tl::unexpected(error);
    refuse(error.message);
    return {};
  }

  Status stages(const AnyMachine& m) {
    const quality::PoseIndependentSingularity s = quality::pose_independent_singularity(m);
    if (s.never_held()) {
      refuse("singular at every pose that was judged (type 2): the drives do not constrain the platform");
      return {};
    }
    out_.state = State::done;
    at_home(m);
    if (out_.state == State::refused || decided(false)) return {};
    if (!study_.duty.poses.empty() && at_poses_wanted()) {
      judge_poses(m, study_.duty.poses, true);
      if (out_.state == State::refused || decided(false)) return {};
    }
    const bool volumes = std::any_of(wanted_.begin(), wanted_.end(), is_volume);
    const bool survey = std::any_of(wanted_.begin(), wanted_.end(), [&](Figure f) { return study_.surveys(f); });
    const bool boxes = std::any_of(study_.holds.begin(), study_.holds.end(), [](const Hold& h) { return h.box; });
    if (volumes || survey || boxes) {
      bool go_on = false;
      POLYPOD_TRY(coarse_volume(m).map([&](bool g) { go_on = g; }));
      if (!go_on || decided(false)) return {};
    }
    if (boxes) {
      POLYPOD_TRY(boxes_inside(m));
      if (out_.state == State::refused || decided(false)) return {};
    }
    if (wants(Figure::cycle_time)) {
      POLYPOD_TRY(timed(m));
      if (out_.state == State::refused || decided(false)) return {};
    }
    if (survey) {
      bool go_on = false;
      POLYPOD_TRY(surveyed(m).map([&](bool g) { go_on = g; }));
      if (!go_on || decided(false)) return {};
    }
    if (wants(Figure::volume)) {
      const auto v = workspace::volume(m, workspace_);
      if (!v) return candidate(v.error());
      set_volume(*v);
      if (decided(!wants(Figure::largest_box))) return {};
    }
    if (wants(Figure::largest_box)) {
      const auto shape = workspace::largest_inside(m, workspace_, workspace::ShapeKind::box);
      if (!shape) return candidate(shape.error());
      set(Figure::largest_box, exactly(units::to_mm3(shape->volume())));
    }
    decided(true);
    return {};
  }

  void at_home(const AnyMachine& m) {
    if (wants(Figure::compliance)) {
      Pose X{Mat3::Identity(), kinematics::middle_of_work(m)};
      if (const auto home = kinematics::home_pose(m)) X = *home;
      const statics::Compliance c = statics::compliance_at(m, X);
      if (c.reachable) {
        const Eigen::SelfAdjointEigenSolver<Mat3> eigen(c.linear(), Eigen::EigenvaluesOnly);
        set(Figure::compliance, exactly(units::to_um_per_N(eigen.eigenvalues().maxCoeff())));
      } else {
        refuse("the machine cannot stand at the middle of its work: " + c.reason +
               " (stiffness_N_per_um and deflection_um are asked at poses of the study)");
        return;
      }
    }
    if (wants(Figure::footprint) || wants(Figure::height)) {
      const auto home = kinematics::home_pose(m);
      if (home) {
        if (const auto found = kinematics::inverse(m, *home); found.reachable() == nullptr) {
          refuse("the machine cannot stand at home: " + kinematics::reason_of(m, found));
          return;
        }
      }
      Vec3 low = Vec3::Constant(kInf), high = Vec3::Constant(-kInf);
      for (const machine::OutlinePart& part : kinematics::outline(m, kinematics::middle_of_work(m))) {
        for (const Vec3& p : part.points) {
          low = low.cwiseMin(p);
          high = high.cwiseMax(p);
        }
      }
      const Vec3 sides = (high - low) * units::kMmPerMetre;
      set(Figure::footprint, exactly(product({sides.x(), sides.y()})));
      set(Figure::height, exactly(sides.z()));
    }
  }

  [[nodiscard]] bool at_poses_wanted() const {
    return std::any_of(wanted_.begin(), wanted_.end(), [](Figure f) { return info_of(f).of_poses; });
  }

  /// The worst at all these poses. `must`: each pose that the machine does not reach breaks the study; else it is left
  /// out.
  void judge_poses(const AnyMachine& m, const std::vector<Pose>& poses, bool must) {
    const AtPoseWanted wanted{wants(Figure::natural_frequency),
                              wants(Figure::drive_force) || wants(Figure::drive_torque), wants(Figure::stiffness),
                              wants(Figure::deflection), wants(Figure::longest_leg)};
    AtPose worst;
    std::size_t reached = 0;
    for (std::size_t i = 0; i < poses.size(); ++i) {
      const auto at = at_pose(m, study_.duty, wanted, poses[i]);
      if (!at) {
        if (!must) continue;
        constexpr double kNotReached = 0.01;
        duty_violation_ += (duty_violation_ > 0 ? 0 : kNotReached) + 1.0 / static_cast<double>(poses.size());
        if (duty_reason_.empty()) duty_reason_ = fmt::format("{} (pose {}: {})", kAllPoses, i + 1, at.error().message);
        continue;
      }
      ++reached;
      worst.frequency = std::min(worst.frequency, at->frequency);
      worst.stiffness = std::min(worst.stiffness, at->stiffness);
      worst.force = std::max(worst.force, at->force);
      worst.torque = std::max(worst.torque, at->torque);
      worst.deflection = std::max(worst.deflection, at->deflection);
      worst.leg = std::max(worst.leg, at->leg);
    }
    if (reached == 0 || duty_violation_ > 0) return;
    for (const auto& [figure, value] :
         {std::pair{Figure::natural_frequency, worst.frequency}, std::pair{Figure::drive_force, worst.force},
          std::pair{Figure::drive_torque, worst.torque},
          std::pair{Figure::stiffness, worst.stiffness / units::kUmPerMetre},
          std::pair{Figure::deflection, units::to_um(worst.deflection)},
          std::pair{Figure::longest_leg, units::to_mm(worst.leg)}}) {
      if (!wants(figure)) continue;
      if (!std::isfinite(value)) {
        refuse(fmt::format("{} has no bound: the machine is singular, or nothing deflects, at one of the poses",
                           info_of(figure).name));
        return;
      }
      set(figure, exactly(value));
    }
  }

  Status timed(const AnyMachine& m) {
    const auto time = cycle_time(m, study_.duty);
    if (!time) return candidate(time.error());
    if (time->broken.empty()) {
      set(Figure::cycle_time, exactly(time->seconds));
      return {};
    }
    constexpr double kBroken = 0.01;
    duty_violation_ += kBroken + 1 - time->passed;
    duty_reason_ = fmt::format("{} ({})", kMotion, time->broken);
    return {};
  }

  void set_volume(const workspace::Volume& v) {
    Value value;
    value.value = units::to_mm3(v.volume);
    value.lower = units::to_mm3(v.lower);
    value.upper = units::to_mm3(v.upper);
    if (!v.proven) value.lower = value.upper = value.value;  // of a sample nothing is certain
    set(Figure::volume, value);
    // A box inside is no larger than the workspace.
    if (wants(Figure::largest_box)) {
      Value box;
      box.lower = 0;
      box.upper = v.proven ? value.upper : kInf;
      box.value = 0.5 * value.value;
      set(Figure::largest_box, box);
    }
  }

  /// False where the candidate is done with.
  Result<bool> coarse_volume(const AnyMachine& m) {
    workspace::Options coarse = workspace_;
    coarse.relative_tolerance = std::max(kCoarse, workspace_.relative_tolerance);
    const auto v = workspace::volume(m, coarse);
    if (!v) {
      POLYPOD_TRY(candidate(v.error()));
      return false;
    }
    if (v->empty || (!v->proven && !v->reached)) {
      refuse(v->proven ? "no point is reachable from every required direction (proven)"
                       : "a sample found no point that is reachable from every required direction");
      return false;
    }
    if (v->proven) set_volume(*v);  // a coarse sample bounds nothing
    return true;
  }

  /// How many of 27 points of a box are not reached, as a share; 0 where the box is proven to be inside.
  Status boxes_inside(const AnyMachine& m) {
    const std::vector<Mat3> orientations = workspace::sampled_orientations(workspace_.directions);
    for (const Hold& h : study_.holds) {
      if (!h.box) continue;
      const Vec3 center = 0.5 * ((*h.box)[0] + (*h.box)[1]), half = 0.5 * ((*h.box)[1] - (*h.box)[0]);
      const auto held = workspace::certainly_holds(m, workspace_, {workspace::ShapeKind::box, center, half});
      if (!held) return candidate(held.error());
      if (*held) continue;
      constexpr double kNotProven = 0.01;
      double missed = kNotProven;
      for (int i = 0; i < 27; ++i) {
        const Vec3 at(i % 3 - 1, i / 3 % 3 - 1, i / 9 - 1);
        if (!workspace::reaches_samples(m, workspace_, orientations, center + half.cwiseProduct(at)))
          missed += 1.0 / 27;
      }
      box_violation_ += missed;
      if (box_reason_.empty()) box_reason_ = h.in_words();
    }
    return {};
  }

  Result<bool> surveyed(const AnyMachine& m) {
    quality::SurveyOptions options;
    options.workspace = workspace_;
    options.resolution = study_.resolution;
    const auto failed = [&](const Error& error) -> Result<bool> {
      POLYPOD_TRY(candidate(error));
      return false;
    };
    const auto survey = quality::survey(m, options);
    if (!survey) return failed(survey.error());
    const auto mean = [&](const quality::Quantity& q) { return quality::statistics(*survey, q.mean).mean; };
    const auto worst = [&](const quality::Quantity& q, const quality::Anywhere& a, std::size_t number, double sign) {
      return quality::worst_seen(m, *survey, options, q, a, number, sign).value;
    };
    const auto any = [&](std::initializer_list<Figure> list) {
      return std::any_of(list.begin(), list.end(), [&](Figure f) { return wants(f); });
    };
    if (any({Figure::condition, Figure::sigma_min, Figure::determinant, Figure::condition_max,
             Figure::sigma_min_least})) {
      const auto f = quality::dexterity_field(m, *survey, options);
      if (!f) return failed(f.error());
      set(Figure::condition, exactly(mean(f->condition)));
      set(Figure::sigma_min, exactly(mean(f->sigma_min)));
      set(Figure::determinant, exactly(mean(f->determinant)));
      if (wants(Figure::condition_max)) {
        set(Figure::condition_max, exactly(worst(f->condition, f->anywhere, 0, 1)));
      }
      if (wants(Figure::sigma_min_least)) {
        set(Figure::sigma_min_least, exactly(worst(f->sigma_min, f->anywhere, 1, -1)));
      }
    }
    if (any({Figure::tolerance, Figure::tolerance_max, Figure::tolerance_angle})) {
      const auto sizes = quality::sized(m, study_.tolerances, true);
      if (!sizes) return failed(sizes.error());
      const auto f = quality::tolerance_field(m, *survey, options, *sizes);
      if (!f) return failed(f.error());
      set(Figure::tolerance, exactly(units::to_mm(mean(f->position))));
      set(Figure::tolerance_angle, exactly(mean(f->orientation)));
      if (wants(Figure::tolerance_max)) {
        set(Figure::tolerance_max, exactly(units::to_mm(worst(f->position, f->anywhere, 0, 1))));
      }
    }
    if (any({Figure::known_error, Figure::known_error_max})) {
      const auto sizes = quality::sized(m, study_.errors, false);
      if (!sizes) return failed(sizes.error());
      const auto f = quality::known_error_field(m, *survey, options, *sizes);
      if (!f) return failed(f.error());
      set(Figure::known_error, exactly(units::to_mm(mean(f->position))));
      if (wants(Figure::known_error_max)) {
        set(Figure::known_error_max, exactly(units::to_mm(worst(f->position, f->anywhere, 0, 1))));
      }
    }
    if (study_.duty.poses.empty() && at_poses_wanted()) {
      std::vector<Pose> poses;
      for (std::size_t i = 0; i < survey->inside.size(); ++i) {
        for (std::size_t k = 0; k < survey->orientations.size(); ++k)
          poses.push_back(quality::pose_at(*survey, i, static_cast<int>(k)));
      }
      judge_poses(m, poses, false);
      if (out_.state == State::refused) return false;
    }
    for (std::size_t i = 0; i < wanted_.size(); ++i) {
      if (!study_.surveys(wanted_[i]) || !std::isnan(out_.figures[i].value)) continue;
      refuse(fmt::format("{} has no value: the machine is singular at every point that was looked at",
                         info_of(wanted_[i]).name));
      return false;
    }
    return true;
  }

  const Study& study_;
  const Incumbents& incumbents_;
  const EvaluateOptions& options_;
  std::vector<Figure> wanted_;
  workspace::Options workspace_;
  Evaluation out_;
  double box_violation_ = 0, duty_violation_ = 0;
  std::string box_reason_, duty_reason_;
};

/// A goal as a share of its normalising value, so that more is better.
double share_of(const Goal& g, double value) {
  if (g.maximise) return value / g.best;
  return value > 0 ? g.best / value : kInf;
}

}  // namespace

const char* name_of(State state) {
  switch (state) {
    case State::done:
      return "done";
    case State::violates:
      return "violates";
    case State::dropped:
      return "dropped";
    case State::refused:
      break;
  }
  return "refused";
}

workspace::Options workspace_options(const Study& study) {
  workspace::Options out;
  out.directions.tilt = study.tilt;
  out.directions.a_range = study.a_range;
  out.directions.b_range = study.b_range;
  out.relative_tolerance = study.relative_tolerance;
  out.interference = study.interference;
  out.bounds_tolerance = 0;
  return out;
}

Value objective_of(const Study& study, const std::vector<Value>& figures) {
  if (study.wants_front()) return {};
  const std::vector<Figure> order = study.figures();
  Value sum = exactly(0);
  for (const Goal& g : study.goals) {
    const auto at = static_cast<std::size_t>(std::find(order.begin(), order.end(), g.figure) - order.begin());
    const Value& v = figures[at];
    if (std::isnan(v.value)) return {};
    sum.value += g.weight * share_of(g, v.value);
    sum.lower += g.weight * share_of(g, g.maximise ? v.lower : v.upper);
    sum.upper += g.weight * share_of(g, g.maximise ? v.upper : v.lower);
  }
  return sum;
}

std::vector<double> goals_of(const Study& study, const Evaluation& e, bool hopeful) {
  const std::vector<Figure> order = study.figures();
  std::vector<double> out;
  for (const Goal& g : study.goals) {
    const auto at = static_cast<std::size_t>(std::find(order.begin(), order.end(), g.figure) - order.begin());
    const Value& v = e.figures[at];
    out.push_back(g.maximise ? (hopeful ? v.upper : v.lower) : -(hopeful ? v.lower : v.upper));
  }
  return out;
}

bool dominates(const std::vector<double>& a, const std::vector<double>& b) {
  bool better = false;
  for (std::size_t i = 0; i < a.size(); ++i) {
    if (!(a[i] >= b[i])) return false;
    better = better || a[i] > b[i];
  }
  return better;
}

namespace {

Evaluation no_machine(const Study& study, const Error& error) {
  Evaluation out;
  out.figures.resize(study.figures().size());
  out.reason = error.message;
  return out;
}

/// -1 where the worst of a figure is its smallest, 1 where it is its largest: by the goal, else by the bound that a
/// hold gives it; 0 where holds bound it on both sides: the worst is then the one that is the nearest to a bound.
int worst_side(const Study& study, Figure figure) {
  for (const Goal& g : study.goals)
    if (g.figure == figure) return g.maximise ? -1 : 1;
  int out = 0;
  for (const Hold& h : study.holds) {
    if (h.box || h.figure != figure) continue;
    out += (h.min ? -1 : 0) + (h.max ? 1 : 0);
  }
  return std::clamp(out, -1, 1);
}

/// By how much a value keeps the holds on its figure, as shares of their bounds.
double margin(const Study& study, Figure figure, double value) {
  double out = std::numeric_limits<double>::infinity();
  for (const Hold& h : study.holds) {
    if (h.box || h.figure != figure) continue;
    if (h.min) out = std::min(out, (value - *h.min) / std::max(std::abs(*h.min), 1e-12));
    if (h.max) out = std::min(out, (*h.max - value) / std::max(std::abs(*h.max), 1e-12));
  }
  return out;
}

Value worst(const Value& a, const Value& b, int side) {
  if (std::isnan(a.value) || side == 0) return a;
  if (std::isnan(b.value)) return b;
  const auto of = [side](double x, double y) { return side < 0 ? std::min(x, y) : std::max(x, y); };
  Value out;
  out.value = of(a.value, b.value);
  out.lower = of(a.lower, b.lower);
  out.upper = of(a.upper, b.upper);
  return out;
}

/// The machine with these parameters, in the units of their keys.
using Parameters = std::vector<std::pair<std::string, double>>;
Result<AnyMachine> machine_with(const Study& study, const Parameters& parameters) {
  std::vector<machine::Override> overrides;
  for (const auto& [key, value] : parameters) overrides.push_back({key, fmt::format("{}", value)});
  return machine::from_text(study.machine_toml, study.machine, overrides);
}

/// The middle of the box of tolerances, judged already, and its corners: what is worst of each. A corner that breaks a
/// hold, or is proven worse than what there is, decides; figures that are not known of all machines then stay out.
Result<Evaluation> worst_case(const Study& study, const Parameters& parameters, const AnyMachine& middle,
                              Evaluation out, const Incumbents& incumbents, const EvaluateOptions& options) {
  const std::vector<Figure> order = study.figures();
  const unsigned corners = 1U << study.robust.size();
  std::vector<unsigned> known(order.size(), 0);  // machines, by figure
  const auto count = [&](const Evaluation& e) {
    for (std::size_t i = 0; i < order.size(); ++i) known[i] += std::isnan(e.figures[i].value) ? 0 : 1;
  };
  count(out);
  if (out.state == State::violates) out.reason = "in the middle of the tolerances: " + out.reason;
  for (unsigned corner = 0; corner < corners && out.state != State::refused && out.state != State::dropped; ++corner) {
    Parameters at = parameters;
    std::string where;
    for (std::size_t i = 0; i < study.robust.size(); ++i) {
      const auto& [key, size] = study.robust[i];
      const double offset = (corner >> i & 1U) != 0 ? size : -size;
      auto found = std::find_if(at.begin(), at.end(), [&key = key](const auto& p) { return p.first == key; });
      if (found == at.end()) {
        double value = std::numeric_limits<double>::quiet_NaN();
        for (const auto& list : {machine::settings(middle), kinematics::parameters(middle)})
          for (const machine::Parameter& p : list)
            if (machine::key_of(p) == key) value = units::to_user(p.value, p.unit);
        if (std::isnan(value)) return no_machine(study, Error{"", key + " has no value to be off from", {}, {}});
        found = at.insert(at.end(), {key, value});
      }
      found->second = rounded(found->second + offset);
      where += fmt::format("{}{} = {}", where.empty() ? "" : ", ", key, found->second);
    }
    const auto m = machine_with(study, at);
    Evaluation e = no_machine(study, m ? Error{} : m.error());
    if (m) {
      POLYPOD_ASSIGN(judged, Judge(study, incumbents, options)(*m));
      e = std::move(judged);
    }
    if (e.state != State::done && (out.state == State::done || e.state == State::refused)) {
      out.state = e.state;
      out.reason = fmt::format("at a corner of the tolerances ({}): {}", where, e.reason);
    }
    out.violation = std::max(out.violation, e.violation);
    count(e);
    for (std::size_t i = 0; i < order.size(); ++i) {
      Value& is = out.figures[i];
      const Value& there = e.figures[i];
      const int side = worst_side(study, order[i]);
      if (side != 0) {
        is = worst(is, there, side);
      } else if (margin(study, order[i], there.value) < margin(study, order[i], is.value)) {
        is = there;
      }
    }
    out.objective = worst(out.objective, e.objective, -1);
  }
  for (std::size_t i = 0; i < order.size(); ++i) {
    if (known[i] <= corners) out.figures[i] = Value();
  }
  return out;
}

Result<Evaluation> judged(const Study& study, const AnyMachine& machine, const Parameters& parameters,
                          const Incumbents& incumbents, const EvaluateOptions& options) {
  const auto begin = std::chrono::steady_clock::now();
  POLYPOD_ASSIGN(out, Judge(study, incumbents, options)(machine));
  if (!study.robust.empty()) {
    POLYPOD_ASSIGN(worst, worst_case(study, parameters, machine, std::move(out), incumbents, options));
    out = std::move(worst);
  }
  out.seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
  return out;
}

}  // namespace

Result<Evaluation> evaluate_machine(const Study& study, const AnyMachine& machine, const Incumbents& incumbents,
                                    const EvaluateOptions& options) {
  return judged(study, machine, {}, incumbents, options);
}

Result<Evaluation> evaluate(const Study& study, const std::vector<double>& varied, const Incumbents& incumbents,
                            const EvaluateOptions& options) {
  if (study.of_cell) return evaluate_cell(study, &varied, options);
  const auto m = study.machine_at(varied);
  if (!m) return no_machine(study, m.error());
  return judged(study, *m, study.parameters(varied), incumbents, options);
}

bool to_be_judged_again(const Study& study, bool complete, bool best, bool front) {
  return complete && may_flatter(study) && (best || (front && !study.holds.empty()));
}

bool may_flatter(const Study& study) {
  const std::vector<Figure> figures = study.figures();
  return !study.of_cell && study.resolution < kFinestResolution &&
         std::any_of(figures.begin(), figures.end(), [&](Figure f) { return study.surveys(f); });
}

}  // namespace polypod::design
