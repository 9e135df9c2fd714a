// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "corrected_program.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

#include "polypod/core/units.hpp"
#include "polypod/kinematics/any_machine.hpp"
#include "polypod/machining/compliance_mark.hpp"
#include "polypod/machining/made_for.hpp"
#include "polypod/statics/compliance.hpp"

namespace polypod::app {
namespace {

constexpr const char* kCorrectForPosture =
    "correct the program of the CAM system for the other posture (correct --branch), or at another place, and post the "
    "result";
constexpr const char* kCorrectForC = "correct the program of the CAM system with this C in it, and post the result";

const char* hint_for(machining::MadeFor::Other other) {
  using Other = machining::MadeFor::Other;
  switch (other) {
    case Other::machine:
      return "post it for that machine, or correct the program of the CAM system for this one";
    case Other::unknown_place:
      return "correct the program of the CAM system again, and post what `polypod correct` writes";
    case Other::place:
      return "post it at that place, or correct the program of the CAM system for this one";
    case Other::cutter:
      return "give the job of the correction, or correct the program of the CAM system with this cutter";
    case Other::offsets:
      return "give the job of the correction (`work_offsets_mm`), or correct the program of the CAM system with these";
    case Other::material:
    case Other::stock:
      return "give the job of the correction, or correct the program of the CAM system for this one";
    case Other::compliance:
      return "give the job and the machine file of the correction, or correct the program of the CAM system with these";
    case Other::none:
      break;
  }
  return "";
}

}  // namespace

Result<CorrectedProgram> CorrectedProgram::of(const post::Path& path, const machining::Job& given,
                                              const machining::Job& job) {
  CorrectedProgram out(path, given, job);
  out.header_ = post::correction_header(path);
  if (!out.header_) return out;
  const auto comes_to = [&](const Vec3& p, double within) {
    return std::any_of(path.steps.begin(), path.steps.end(), [&](const post::Step& step) {
      return step.moves() && (job.X_MW * step.tip - given.X_MW * p).norm() < within;
    });
  };
  machining::MadeFor made = machining::made_for(*out.header_, given, comes_to);
  if (made.other != machining::MadeFor::Other::none)
    return fail("PO125", std::move(made.message), Place{path.file, out.header_->line, 1}, hint_for(made.other));
  out.not_judged_ = std::move(made.not_judged);
  out.unreached_ = made.unreached;
  return out;
}

Error CorrectedProgram::not_as_corrected(std::string message, std::string hint) const {
  return {"PO128", std::move(message), Place{path_.file, header_->line, 1}, std::move(hint)};
}

Status CorrectedProgram::take_hold(const post::Configuration& configuration, const HoldSaid& said,
                                   post::PlanOptions& p) {
  if (!header_ || (header_->posture.empty() && !header_->c && header_->joints.empty())) return {};
  if (!machining::speaks_of(*header_, given_)) return {};  // looked at for another place
  const std::string was = std::string("the program was ") + header_->was();
  const auto refused = [&](std::string message, std::string hint) {
    return tl::unexpected(not_as_corrected(std::move(message), std::move(hint)));
  };
  const int joints = kinematics::joint_count(given_.machine), now = kinematics::joint_count(configuration.machine);
  if (joints != now) {
    return refused(fmt::format("{} with {} joints that move, and --config {} moves {}", was, joints, said.config, now),
                   "leave --config out, or correct the program of the CAM system with a machine file that locks the "
                   "same joint");
  }
  if (!header_->posture.empty() && !p.branch.empty() && p.branch != header_->posture) {
    const char* from = said.branch.empty() ? "the posture of the job," : "--branch";
    return refused(fmt::format("{} for the posture {}, not for {} {}", was, header_->posture, from, p.branch),
                   fmt::format("leave {} out; for another posture: {}",
                               said.branch.empty() ? "`branch` of the job" : "--branch", kCorrectForPosture));
  }
  if (header_->c && said.gives_c) {
    constexpr double kWritten = units::from_deg(1e-4);  // a header has as many digits
    if (!p.c || std::abs(std::remainder(*p.c - *header_->c, 2 * std::numbers::pi)) > kWritten) {
      return refused(fmt::format("{} for a tool that is held at C {:.7g} deg, not for --c {}", was,
                                 units::to_deg(*header_->c), said.c),
                     std::string("leave --c out; for another C: ") + kCorrectForC);
    }
  }
  if (!header_->joints.empty() && said.gives_external && p.external != post::External::linear) {
    return refused(
        fmt::format("{} for an external axis that follows the moves, not for --external-axis {}", was, said.external),
        "leave --external-axis out; for another place of the axis: correct the program of the CAM system "
        "with a machine file that locks it there, or with `start_joints`, and post the result");
  }
  if (header_->c) p.c = header_->c;
  // The correction was made for where the axis stood.
  if (p.external == post::External::chosen && !said.gives_external) p.external = post::External::linear;
  if (!header_->posture.empty()) {
    p.branch = header_->posture;
    p.keep_branch = true;
  }
  holds_ = true;
  return {};
}

std::optional<Error> CorrectedProgram::other_joints(const post::Plan& plan) const {
  const auto mark = machining::ComplianceMark::from(header_->compliance);
  const machine::JointVector was = machining::ComplianceMark::joints_from(header_->joints, job_.machine);
  if (!mark || was.size() == 0 || !statics::has_compliance(job_.machine)) return {};
  const Pose X_MT = machining::pose_of(given_, *mark);
  constexpr double kLever = 0.1;  // m, by which a turn counts
  const post::PlannedMove* nearest = nullptr;
  double least = std::numeric_limits<double>::infinity();
  for (const post::PlannedMove& m : plan.moves) {
    if (m.joints.size() != was.size()) continue;
    const double turn = rotation_vector(X_MT.R.transpose() * job_.X_MW.R * m.R).norm();
    const double away = (job_.X_MW * m.tip - X_MT.p).norm() + kLever * turn;
    if (away < least) nearest = &m;
    least = std::min(least, away);
  }
  if (nearest == nullptr) return {};
  const machine::JointVector& is = nearest->joints;
  const std::optional<machining::DeflectedBy100N> here = machining::deflections_at(given_, *mark, is);
  if (!here || mark->same(*here)) return {};  // out of reach there: the plan says so
  const machining::DeflectedBy100N there{mark->deflection, mark->across};
  Eigen::Index joint = 0;
  (is - was).cwiseAbs().maxCoeff(&joint);
  const bool turns = kinematics::joint_kind(job_.machine, static_cast<int>(joint)) == machine::JointKind::revolute;
  const auto user = [turns](double v) { return turns ? units::to_deg(v) : units::to_mm(v); };
  return not_as_corrected(
      fmt::format("the program was {} with joint {} at {:.1f} {} where the first cut begins, and 100 N along X, Y, Z "
                  "deflect the tool by {}; here the joint comes there at {:.1f} {}, and they deflect it by {}",
                  header_->was(), joint + 1, user(was[joint]), turns ? "deg" : "mm", mark->in_words(there, *here),
                  user(is[joint]), turns ? "deg" : "mm", mark->in_words(*here, there)),
      "post it with the start joints of the correction, or correct the program of the CAM system with these "
      "(`start_joints` of the job)");
}

Result<post::Plan> CorrectedProgram::plan_held(const post::Configuration& configuration, const post::PlanOptions& with,
                                               bool allow_problems) const {
  Result<post::Plan> plan = post::plan(configuration, path_, with);
  if (!plan && plan.error().id == "PO122") {
    return tl::unexpected(not_as_corrected(fmt::format("the program was {} for the posture {}: {}", header_->was(),
                                                       header_->posture, plan.error().message),
                                           unreached_ ? std::string(hint_for(machining::MadeFor::Other::compliance)) +
                                                            "; or, on this machine, " + kCorrectForPosture
                                                      : kCorrectForPosture));
  }
  if (!plan) return plan;
  if (const post::Step* step = header_->c ? post::turned_cut(path_, *plan) : nullptr) {
    return tl::unexpected(not_as_corrected(
        fmt::format("the program was {} for a tool that is held at C {:.7g} deg, and this configuration turns it about "
                    "its axis in the cut of line {}",
                    header_->was(), units::to_deg(*header_->c), step->line),
        "use --config six, or auto"));
  }
  if (plan->ok() || !with.keep_branch || allow_problems) return plan;
  post::PlanOptions free = with;
  free.branch.clear();
  free.keep_branch = false;
  POLYPOD_ASSIGN(other, post::plan(configuration, path_, free));
  if (!other.ok()) return plan;  // it is not the posture
  const post::PlanProblem& first = plan->problems.front();
  const std::string elsewhere =
      other.branch == header_->posture
          ? "a way that begins in it and takes all comes to another posture there"
          : fmt::format("the posture {} takes all, but the tool deflects otherwise there", other.branch);
  return tl::unexpected(not_as_corrected(
      fmt::format("the program was {} for the posture {}, in which the machine cannot take every move: line {}: {}: "
                  "{}{}; {}",
                  header_->was(), header_->posture, first.line, first.kind, first.detail,
                  plan->problems.size() > 1 ? fmt::format(" (and {} more)", plan->problems.size() - 1) : "", elsewhere),
      kCorrectForPosture));
}

Result<post::Plan> CorrectedProgram::plan(const post::Configuration& configuration, const post::PlanOptions& with,
                                          const HoldSaid& said) const {
  if (!holds_) return post::plan(configuration, path_, with);
  Result<post::Plan> first = plan_held(configuration, with, said.allow_problems);
  if (!first || header_->joints.empty()) return first;
  std::optional<Error> other = other_joints(*first);
  if (!other) return first;
  if (said.gives_start) return tl::unexpected(std::move(*other));
  const bool of_job = with.start_joints.has_value();
  post::PlanOptions from_there = with;
  from_there.start_joints = machining::ComplianceMark::joints_from(header_->joints, job_.machine);
  Result<post::Plan> again = plan_held(configuration, from_there, said.allow_problems);
  if (!again) return again;
  if (auto still = other_joints(*again)) return tl::unexpected(std::move(*still));
  machining::ComplianceMark beginning;
  if (!again->moves.empty()) beginning.joints = again->moves.front().joints;
  again->notes.push_back(
      fmt::format("the program begins where the correction did{}: bring the machine there before it starts; {}",
                  of_job ? ", not at `start_joints` of the job" : "", beginning.joints_in_words(job_.machine)));
  return again;
}

}  // namespace polypod::app
