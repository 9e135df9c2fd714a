// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/calibration/poses.hpp"

#include <fmt/format.h>

#include <cmath>
#include <limits>
#include <numeric>

#include "model.hpp"
#include "polypod/core/units.hpp"

namespace polypod::calibration {
namespace {

constexpr double kInfinite = std::numeric_limits<double>::infinity();

Eigen::MatrixXd information(const std::vector<Eigen::MatrixXd>& equations, const std::vector<std::size_t>& chosen) {
  const Eigen::Index n = equations.front().cols();
  Eigen::MatrixXd M = Eigen::MatrixXd::Zero(n, n);
  for (const std::size_t i : chosen) M.noalias() += equations[i].transpose() * equations[i];
  return M;
}

double log_determinant(const Eigen::MatrixXd& M) {
  const Eigen::LLT<Eigen::MatrixXd> factor(M);
  if (factor.info() != Eigen::Success) return -kInfinite;
  return 2 * factor.matrixLLT().diagonal().array().log().sum();
}

/// What a candidate J adds to a set with M = V^-1: by how much log det M grows, log det(I + J V J^T), or, where `over`
/// is the mean of J_i^T J_i over all candidates, by how much the mean variance of a reading, trace(over V), falls.
struct Worth {
  const Eigen::MatrixXd* over = nullptr;

  double operator()(const Eigen::MatrixXd& J, const Eigen::MatrixXd& V) const {
    const Eigen::MatrixXd JV = J * V;
    Eigen::MatrixXd small = JV * J.transpose();
    small.diagonal().array() += 1;
    if (over == nullptr) return log_determinant(small);
    return small.llt().solve(JV * *over * JV.transpose()).trace();
  }
};

/// The free candidate that adds most to a set with M = V^-1, if it adds more than `than`; else `otherwise`.
std::size_t most_worth(const std::vector<Eigen::MatrixXd>& candidates, const std::vector<bool>& taken,
                       const Eigen::MatrixXd& V, const Worth& worth, double than, std::size_t otherwise) {
  for (std::size_t j = 0; j < candidates.size(); ++j) {
    if (taken[j]) continue;
    const double w = worth(candidates[j], V);
    if (w > than) {
      than = w;
      otherwise = j;
    }
  }
  return otherwise;
}

/// Exchanges one for another until no single one helps.
void exchange(const std::vector<Eigen::MatrixXd>& candidates, const Eigen::MatrixXd& floor, const Worth& worth,
              std::vector<std::size_t>& chosen, std::vector<bool>& taken) {
  constexpr int kPasses = 20;
  constexpr double kGain = 1e-6;  // least gain: of log det, or as a share of the variance
  for (int pass = 0; pass < kPasses; ++pass) {
    bool better = false;
    for (std::size_t& mine : chosen) {
      const Eigen::MatrixXd M = information(candidates, chosen) + floor;
      const Eigen::MatrixXd V = (M - candidates[mine].transpose() * candidates[mine]).inverse();
      const double unit = worth.over == nullptr ? 1.0 : (*worth.over * V).trace();
      const double own = worth(candidates[mine], V) + kGain * unit;
      const std::size_t best = most_worth(candidates, taken, V, worth, own, mine);
      if (best == mine) continue;
      taken[mine] = false;
      taken[best] = true;
      mine = best;
      better = true;
    }
    if (!better) return;
  }
}

/// Exchanges by the least eigenvalue: what says least along the worst direction goes for what says most, as long as the
/// least eigenvalue grows.
void exchange_by_eigenvalue(const std::vector<Eigen::MatrixXd>& candidates, std::vector<std::size_t>& chosen,
                            std::vector<bool>& taken) {
  constexpr int kMost = 400;
  constexpr std::size_t kTried = 8;  // of each side, in the order of what they say
  for (int k = 0; k < kMost; ++k) {
    const Eigen::MatrixXd M = information(candidates, chosen);
    const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> now(M);
    const Eigen::VectorXd worst = now.eigenvectors().col(0);
    const auto says = [&](std::size_t i) { return (candidates[i] * worst).squaredNorm(); };
    std::vector<std::size_t> out(chosen.size()), in;
    std::iota(out.begin(), out.end(), 0);
    std::stable_sort(out.begin(), out.end(), [&](auto a, auto b) { return says(chosen[a]) < says(chosen[b]); });
    for (std::size_t j = 0; j < candidates.size(); ++j)
      if (!taken[j]) in.push_back(j);
    std::stable_sort(in.begin(), in.end(), [&](auto a, auto b) { return says(a) > says(b); });
    bool better = false;
    for (std::size_t a = 0; a < std::min(kTried, out.size()) && !better; ++a) {
      for (std::size_t b = 0; b < std::min(kTried, in.size()) && !better; ++b) {
        const std::size_t goes = chosen[out[a]], comes = in[b];
        const Eigen::MatrixXd changed =
            M - candidates[goes].transpose() * candidates[goes] + candidates[comes].transpose() * candidates[comes];
        const double least =
            Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd>(changed, Eigen::EigenvaluesOnly).eigenvalues()[0];
        if (!(least > now.eigenvalues()[0] * (1 + 1e-6))) continue;
        chosen[out[a]] = comes;
        taken[goes] = false;
        taken[comes] = true;
        better = true;
      }
    }
    if (!better) return;
  }
}

Measurement row_at(const Stand& stand, Kind kind, const std::vector<Vec3>& anchors, const CalibrationOptions& options,
                   std::size_t index) {
  Measurement row;
  row.kind = kind;
  row.q = stand.q;
  row.X_SR = options.X_SM * stand.X_MT * options.X_TR;
  if (!anchors.empty()) row.anchor_S = anchors[index % anchors.size()];
  return row;
}

/// Takes the rules that parameters keep into the equations' columns: of each rule the parameter that it holds most
/// follows from the others, so its effect goes to theirs and its own column becomes 0.
void apply_rules(const Eigen::MatrixXd& rules, Eigen::MatrixXd& J) {
  for (Eigen::Index i = 0; i < rules.rows(); ++i) {
    Eigen::Index follows = 0;
    const double most = rules.row(i).cwiseAbs().maxCoeff(&follows);
    if (most == 0) continue;
    J -= J.col(follows).eval() * (rules.row(i) / rules(i, follows));
    J.col(follows).setZero();
  }
}

/// Equations by all unknowns of the layout, in units that compare.
std::vector<Eigen::MatrixXd> all_equations(const AnyMachine& machine, const std::vector<Stand>& stands, Kind kind,
                                           const std::vector<Vec3>& anchors, const CalibrationOptions& options,
                                           Layout& layout, Eigen::MatrixXd* rules_seen = nullptr) {
  layout = layout_of({}, kinematics::parameters(machine).size());
  const Start start = start_of(machine, layout, options.X_SM, options.X_TR);
  Eigen::VectorXd unused;
  Eigen::MatrixXd rules;
  rules_at(machine, layout, start.x, unused, rules);
  if (rules_seen != nullptr) *rules_seen = rules;
  std::vector<Eigen::MatrixXd> out;
  const Noise noise{options.noise_position, options.noise_angle};
  Equations e;
  for (std::size_t i = 0; i < stands.size(); ++i) {
    equations_of(machine, row_at(stands[i], kind, anchors, options, i), stands[i].X_MT, layout, start.x, noise, true, e,
                 Lost::first_order);
    apply_rules(rules, e.J);
    out.emplace_back(e.J * start.scale.asDiagonal());
  }
  return out;
}

/// Stands that can be measured at the site: `count` of them, or CA121, CA123.
Status draw(const AnyMachine& machine, std::size_t count, std::uint64_t seed, const Site& site, const Pose& X_TR,
            Candidates& out) {
  constexpr std::size_t kMostTimes = 20;
  for (std::size_t times = 1;; times = std::min(2 * times, kMostTimes)) {
    std::vector<Stand> drawn = random_stands(machine, times * count, seed);
    if (drawn.size() < count) {
      return fail("CA121", fmt::format("only {} of {} poses found within the limits", drawn.size(), count));
    }
    const bool all = drawn.size() < times * count;
    out.drawn = drawn.size();
    out.stands.clear();
    out.left_out.fill(0);
    if (!site.any()) {
      out.stands = std::move(drawn);
      return {};
    }
    const SiteCheck check(machine, site, X_TR, drawn);
    std::size_t looked_at = 0;
    for (Stand& stand : drawn) {
      if (out.stands.size() == count) break;
      ++looked_at;
      const Hindrance why = check.of(stand);
      ++out.left_out[static_cast<std::size_t>(why)];
      if (why == Hindrance::none) out.stands.push_back(std::move(stand));
    }
    out.drawn = looked_at;
    out.left_out[static_cast<std::size_t>(Hindrance::none)] = 0;
    if (out.stands.size() == count) return {};
    if (!all && times < kMostTimes) continue;
    const auto left = [&](Hindrance why) { return out.left_out[static_cast<std::size_t>(why)]; };
    return fail(
        "CA123",
        fmt::format("only {} of {} poses can be measured there: {} come below the floor, {} into a box, at {} the "
                    "target is turned away, at {} it is hidden",
                    out.stands.size(), out.drawn, left(Hindrance::floor), left(Hindrance::box),
                    left(Hindrance::turned_away), left(Hindrance::hidden)),
        {}, "are floor, boxes and instrument given in M, in mm? Fewer --candidates and --count may do");
  }
}

Eigen::MatrixXd columns(const Eigen::MatrixXd& J, const std::vector<int>& kept) {
  Eigen::MatrixXd out(J.rows(), static_cast<Eigen::Index>(kept.size()));
  for (std::size_t k = 0; k < kept.size(); ++k) out.col(static_cast<Eigen::Index>(k)) = J.col(kept[k]);
  return out;
}

}  // namespace

Result<Candidates> geometry_candidates(const AnyMachine& machine, std::size_t count, std::uint64_t seed, Kind kind,
                                       const std::vector<Vec3>& anchors, const CalibrationOptions& options,
                                       const Site& site) {
  if (kind == Kind::contact) return fail("CA120", "poses for contacts cannot be chosen");
  if (!(options.noise_position > 0) || !(options.noise_angle > 0)) return fail("CA116", "noise must be above 0");
  Candidates out;
  POLYPOD_TRY(draw(machine, count, seed, site, options.X_TR, out));
  Layout layout;
  Eigen::MatrixXd rules;
  const auto all = all_equations(machine, out.stands, kind, anchors, options, layout, &rules);
  Eigen::MatrixXd J(static_cast<Eigen::Index>(all.size()) * all.front().rows(), layout.count);
  for (std::size_t i = 0; i < all.size(); ++i) {
    J.middleRows(static_cast<Eigen::Index>(i) * all[i].rows(), all[i].rows()) = all[i];
  }
  const auto chosen = chosen_parameters(kinematics::parameters(machine), options);
  if (!chosen) return tl::unexpected(chosen.error());
  const std::vector<int> wanted = wanted_unknowns(layout, *chosen, options, kind == Kind::pose || kind == Kind::axis);
  const Identifiability known = identifiable(J, wanted, Eigen::VectorXd::Ones(layout.count));
  out.total = wanted.size();
  for (Eigen::Index i = 0; i < rules.rows(); ++i) out.total -= rules(i, wanted).isZero(0) ? 0 : 1;
  for (const int j : known.kept) out.unknowns.push_back(unknown_of(machine, layout, j).key);
  for (const auto& [j, tie] : known.ties) out.held.push_back(unknown_of(machine, layout, j).key);
  for (const Eigen::MatrixXd& one : all) out.equations.push_back(columns(one, known.kept));
  return out;
}

std::vector<Eigen::MatrixXd> geometry_equations(const AnyMachine& machine, const std::vector<Stand>& stands, Kind kind,
                                                const std::vector<Vec3>& anchors, const CalibrationOptions& options,
                                                const Candidates& like) {
  Layout layout;
  std::vector<Eigen::MatrixXd> out = all_equations(machine, stands, kind, anchors, options, layout);
  std::vector<int> kept;
  for (int j = 0; j < layout.count; ++j) {
    const std::string key = unknown_of(machine, layout, j).key;
    const bool follows = std::all_of(out.begin(), out.end(), [&](const auto& J) { return J.col(j).isZero(0); });
    if (!follows && std::find(like.unknowns.begin(), like.unknowns.end(), key) != like.unknowns.end())
      kept.push_back(j);
  }
  for (Eigen::MatrixXd& one : out) one = columns(one, kept);
  return out;
}

std::vector<Eigen::MatrixXd> compliance_equations(const AnyMachine& machine, const std::vector<Stand>& stands,
                                                  double force, double noise) {
  const std::vector<double> nominal = statics::column_compliances(machine);
  std::vector<Eigen::MatrixXd> out;
  for (const Stand& stand : stands) {
    const std::vector<Mat3> shapes = statics::unit_compliances(machine, stand.X_MT, stand.q);
    Eigen::MatrixXd J(9, 0);
    for (std::size_t k = 0; k < shapes.size(); ++k) {
      if (!(nominal[k] > 0)) continue;
      J.conservativeResize(9, J.cols() + 1);
      J.rightCols<1>() = (nominal[k] * force / noise) * shapes[k].reshaped();
    }
    out.push_back(std::move(J));
  }
  return out;
}

Result<Candidates> compliance_candidates(const AnyMachine& machine, std::size_t count, std::uint64_t seed, double force,
                                         double noise, const Site& site, const Pose& X_TR) {
  if (!(force > 0) || !(noise > 0)) return fail("CA120", "force and noise must be above 0");
  if (!statics::has_compliance(machine)) return fail("CA122", "the machine has no compliances");
  Candidates out;
  POLYPOD_TRY(draw(machine, count, seed, site, X_TR, out));
  out.equations = compliance_equations(machine, out.stands, force, noise);
  const std::vector<double> nominal = statics::column_compliances(machine);
  const std::vector<std::string> names = statics::column_names(machine);
  for (std::size_t k = 0; k < nominal.size(); ++k) (nominal[k] > 0 ? out.unknowns : out.held).push_back(names[k]);
  out.total = out.unknowns.size();
  return out;
}

Result<std::vector<std::size_t>> choose(const std::vector<Eigen::MatrixXd>& candidates, std::size_t count,
                                        Criterion criterion) {
  const Eigen::Index n = candidates.empty() ? 0 : candidates.front().cols();
  const Eigen::Index each = candidates.empty() ? 0 : candidates.front().rows();
  if (count > candidates.size() || static_cast<Eigen::Index>(count) * each < n || n == 0) {
    return fail(
        "CA130",
        fmt::format("{} poses of {} equations for {} unknowns, from {} candidates", count, each, n, candidates.size()),
        {}, "measure more poses, or give more candidates");
  }
  // A floor under M, so that the first poses can be compared before they tell everything.
  std::vector<std::size_t> all(candidates.size());
  std::iota(all.begin(), all.end(), 0);
  const double size = information(candidates, all).diagonal().maxCoeff() / double(candidates.size());
  const auto not_numbers = [] {
    return fail("CA130", "the information of the candidates is not a finite number above 0", {},
                "are the force, the noise and the machine's lengths of a sensible size?");
  };
  if (!(size > 0) || !std::isfinite(size)) return not_numbers();
  const Eigen::MatrixXd floor = 1e-9 * size * Eigen::MatrixXd::Identity(n, n);
  std::vector<std::size_t> chosen;
  std::vector<bool> taken(candidates.size(), false);
  Eigen::MatrixXd M = floor;
  while (chosen.size() < count) {
    const std::size_t best = most_worth(candidates, taken, M.inverse(), Worth{}, -kInfinite, candidates.size());
    if (best == candidates.size()) return not_numbers();
    taken[best] = true;
    chosen.push_back(best);
    M += candidates[best].transpose() * candidates[best];
  }
  exchange(candidates, floor, Worth{}, chosen, taken);
  if (criterion == Criterion::reading) {
    const Eigen::MatrixXd over = information(candidates, all) / double(candidates.size());
    exchange(candidates, floor, Worth{&over}, chosen, taken);
  } else if (criterion == Criterion::eigenvalue) {
    exchange_by_eigenvalue(candidates, chosen, taken);
  }
  std::sort(chosen.begin(), chosen.end());
  return chosen;
}

Uncertainty uncertainty(const std::vector<Eigen::MatrixXd>& measured, const std::vector<Eigen::MatrixXd>& over) {
  Uncertainty out{kInfinite, kInfinite, kInfinite};
  if (measured.empty() || over.empty()) return out;
  std::vector<std::size_t> all(measured.size());
  std::iota(all.begin(), all.end(), 0);
  const Eigen::MatrixXd M = information(measured, all);
  const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> eigen(M);
  const Eigen::VectorXd& lambda = eigen.eigenvalues();
  if (!(lambda[0] > 1e-12 * lambda[lambda.size() - 1])) return out;
  const Eigen::MatrixXd root = eigen.eigenvectors() * lambda.cwiseSqrt().cwiseInverse().asDiagonal();
  double sum = 0, count = 0;
  for (const Eigen::MatrixXd& J : over) {
    sum += (J * root).squaredNorm();
    count += static_cast<double>(J.rows());
  }
  out.reading = std::sqrt(sum / count);
  out.mean = std::exp(-0.5 * lambda.array().log().mean());
  out.worst = 1 / std::sqrt(lambda[0]);
  return out;
}

LostPose worst_loss(const std::vector<Eigen::MatrixXd>& candidates, const std::vector<std::size_t>& chosen,
                    const std::vector<Eigen::MatrixXd>& over) {
  LostPose out;
  for (std::size_t lost = 0; lost < chosen.size(); ++lost) {
    std::vector<Eigen::MatrixXd> rest;
    for (std::size_t k = 0; k < chosen.size(); ++k)
      if (k != lost) rest.push_back(candidates[chosen[k]]);
    const Uncertainty left = uncertainty(rest, over);
    if (lost == 0 || left.reading > out.left.reading) out = {lost, left};
  }
  return out;
}

double least_mean(const std::vector<Eigen::MatrixXd>& candidates, const std::vector<std::size_t>& chosen) {
  const Eigen::MatrixXd M = information(candidates, chosen);
  const double n = static_cast<double>(M.rows()), logarithm = log_determinant(M);
  if (!std::isfinite(logarithm)) return 0;
  const Eigen::MatrixXd V = M.inverse();
  double most = 0;
  for (const Eigen::MatrixXd& J : candidates) most = std::max(most, (J * V * J.transpose()).trace());
  return std::exp(-(logarithm + most * static_cast<double>(chosen.size()) - n) / (2 * n));
}

std::vector<Stand> grid_stands(const AnyMachine& machine, const std::vector<Stand>& box, std::size_t count,
                               double grid_tilt) {
  constexpr int kMost = 30;  // points a side
  Vec3 low = Vec3::Constant(kInfinite), high = -low;
  for (const Stand& stand : box) {
    low = low.cwiseMin(stand.X_MT.p);
    high = high.cwiseMax(stand.X_MT.p);
  }
  const bool turns = kinematics::task(machine).turns();
  const double tilt = turns ? grid_tilt : 0.0;
  const Vec3 tilts[] = {Vec3::Zero(), Vec3(tilt, 0, 0), Vec3(0, tilt, 0), Vec3(-tilt, 0, 0), Vec3(0, -tilt, 0)};
  std::vector<Stand> reached;
  for (int side = 2; side <= kMost && reached.size() < count; ++side) {
    reached.clear();
    for (int k = 0; k < side * side * side; ++k) {
      const Vec3 share(k % side + 0.5, k / side % side + 0.5, k / side / side + 0.5);
      // The tilts in turn; where one is out of reach, the next.
      for (std::size_t t = 0; t < std::size(tilts); ++t) {
        const Vec3& turn = tilts[(reached.size() + t) % std::size(tilts)];
        Stand stand{{}, Pose{rotation_of(turn), low + (high - low).cwiseProduct(share / side)}};
        const kinematics::InverseResult inverse = kinematics::inverse(machine, stand.X_MT);
        const kinematics::Solution* s = inverse.reachable();
        if (s == nullptr) continue;
        stand.q = s->joints;
        // Of a machine with five axes the turn about the tool is what the joints give.
        const kinematics::ForwardResult at = kinematics::forward(machine, stand.q);
        if (at.poses.empty()) continue;
        stand.X_MT = at.poses.front();
        reached.push_back(std::move(stand));
        break;
      }
    }
  }
  std::vector<Stand> out;
  const std::size_t wanted = std::min(count, reached.size());
  for (std::size_t i = 0; i < wanted; ++i) out.push_back(reached[i * reached.size() / wanted]);
  return out;
}

}  // namespace polypod::calibration
