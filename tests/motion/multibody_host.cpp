// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "multibody_host.hpp"

#include <Simbody.h>

#include <cmath>
#include <functional>
#include <stdexcept>
#include <vector>

namespace polypod::test {
namespace {

using Eigen::MatrixXd;
using Eigen::VectorXd;

SimTK::Vec3 to(const Eigen::Vector3d& v) {
  return {v.x(), v.y(), v.z()};
}
SimTK::Rotation to(const Eigen::Matrix3d& R) {
  SimTK::Mat33 m;
  for (int i = 0; i < 3; ++i)
    for (int k = 0; k < 3; ++k) m(i, k) = R(i, k);
  return SimTK::Rotation(m, true);
}
SimTK::Transform to(const Place& X) {
  return {to(X.R), to(X.p)};
}
SimTK::Body body_of(const Mass& body) {
  const Eigen::Matrix3d& I = body.inertia;
  const SimTK::SymMat33 central(I(0, 0), I(1, 0), I(1, 1), I(2, 0), I(2, 1), I(2, 2));
  const SimTK::Vec3 center = to(body.center);
  return SimTK::Body::Rigid({body.mass, center, SimTK::Inertia(central).shiftFromMassCenter(center, body.mass)});
}
VectorXd eigen(const SimTK::Vector& v) {
  VectorXd out(v.size());
  for (int k = 0; k < v.size(); ++k) out[k] = v[k];
  return out;
}
MatrixXd eigen(const SimTK::Matrix& m) {
  MatrixXd out(m.nrow(), m.ncol());
  for (int i = 0; i < m.nrow(); ++i)
    for (int k = 0; k < m.ncol(); ++k) out(i, k) = m(i, k);
  return out;
}

}  // namespace

struct Multibody::Inside {
  explicit Inside(const Eigen::Vector3d& gravity)
      : matter(system), loads(system), weight(loads, matter, to(gravity)), bodies{matter.updGround()} {}

  SimTK::MultibodySystem system;
  SimTK::SimbodyMatterSubsystem matter;
  SimTK::GeneralForceSubsystem loads;
  SimTK::Force::Gravity weight;
  std::vector<SimTK::MobilizedBody> bodies;
  std::vector<std::function<void(SimTK::State&)>> places;
  struct Drive {
    SimTK::MobilizedBody body;
    double sign;
  };
  std::vector<Drive> drives;
  struct Given {
    SimTK::MobilizedBody body;
    int coordinate;
    double speed, acceleration;
  };
  std::vector<Given> given;
  SimTK::MobilizedBody platform;

  int keep(const SimTK::MobilizedBody& body) {
    bodies.push_back(body);
    return static_cast<int>(bodies.size()) - 1;
  }
  SimTK::MobilizedBody& at(int number) { return bodies.at(static_cast<std::size_t>(number)); }
};

Multibody::Multibody(const Eigen::Vector3d& gravity) : in_(std::make_unique<Inside>(gravity)) {}
Multibody::~Multibody() = default;

int Multibody::turning(int parent, const Eigen::Matrix3d& R_MP, const Eigen::Vector3d& point,
                       const Eigen::Vector3d& way, const Mass& mass) {
  // Away from the way at this instant, so that both angles are something.
  const Eigen::Vector3d aside = (way.normalized() + Eigen::Vector3d(0.15, -0.1, 0.2)).normalized();
  const SimTK::Rotation R_MF(SimTK::UnitVec3(to(aside)), SimTK::ZAxis);
  const SimTK::Rotation R_PF(~to(R_MP) * R_MF);
  SimTK::MobilizedBody::Universal leg(in_->at(parent), SimTK::Transform(R_PF, to(point)), body_of(mass),
                                      SimTK::Transform());
  const SimTK::Vec3 e = ~R_MF * to(way.normalized());
  // R_x(a) R_y(b) z = (sin b, -sin a cos b, cos a cos b)
  const double b = std::asin(e[0]), a = std::atan2(-e[1], e[2]);
  in_->places.emplace_back([leg, a, b](SimTK::State& s) {
    leg.setOneQ(s, 0, a);
    leg.setOneQ(s, 1, b);
  });
  return in_->keep(leg);
}

int Multibody::sliding(int parent, const Eigen::Vector3d& axis, const Eigen::Vector3d& from, double q,
                       const Mass& mass) {
  const SimTK::Rotation R(SimTK::UnitVec3(to(axis)), SimTK::XAxis);
  SimTK::MobilizedBody::Slider out(in_->at(parent), SimTK::Transform(R, to(from)), body_of(mass),
                                   SimTK::Transform(R, SimTK::Vec3(0)));
  in_->places.emplace_back([out, q](SimTK::State& s) { out.setOneQ(s, 0, q); });
  in_->drives.push_back({out, 1});
  return in_->keep(out);
}

int Multibody::pinned(int parent, const Place& X_PF, double angle, double sign, const Mass& mass) {
  SimTK::MobilizedBody::Pin out(in_->at(parent), to(X_PF), body_of(mass), SimTK::Transform());
  in_->places.emplace_back([out, angle](SimTK::State& s) { out.setOneQ(s, 0, angle); });
  in_->drives.push_back({out, sign});
  return in_->keep(out);
}

void Multibody::platform(const PlatformMotion& motion, bool turns, const Mass& mass) {
  SimTK::MobilizedBody out;
  if (turns) {
    out = SimTK::MobilizedBody::Free(in_->at(0), SimTK::Transform(), body_of(mass), SimTK::Transform());
  } else {
    out = SimTK::MobilizedBody::Translation(in_->at(0), SimTK::Transform(), body_of(mass), SimTK::Transform());
  }
  const SimTK::Transform at = to(motion.at);
  in_->places.emplace_back([out, at](SimTK::State& s) { out.setQToFitTransform(s, at); });
  for (int k = 0; k < 3; ++k) {
    if (turns) in_->given.push_back({out, k, motion.turning[k], motion.turning_rate[k]});
    in_->given.push_back({out, (turns ? 3 : 0) + k, motion.speed[k], motion.acceleration[k]});
  }
  in_->platform = out;
}

void Multibody::close(int leg, const Eigen::Vector3d& in_leg, const Eigen::Vector3d& in_platform) {
  SimTK::Constraint::Ball(in_->at(leg), to(in_leg), in_->platform, to(in_platform));
}

void Multibody::drives_move(const VectorXd& speeds, const VectorXd& accelerations) {
  for (std::size_t i = 0; i < in_->drives.size(); ++i) {
    const auto k = static_cast<Eigen::Index>(i);
    const Inside::Drive& d = in_->drives[i];
    in_->given.push_back({d.body, 0, d.sign * speeds[k], d.sign * accelerations[k]});
  }
}

VectorXd Multibody::forces() {
  SimTK::State state = in_->system.realizeTopology();
  in_->system.realizeModel(state);
  for (const auto& place : in_->places) place(state);
  in_->system.realize(state, SimTK::Stage::Position);
  const int n = state.getNU(), m = state.getNUErr();
  MatrixXd G(0, n);
  if (m > 0) {
    places_open = state.getQErr().normRMS();
    SimTK::Matrix found;
    in_->matter.calcG(state, found);
    G = eigen(found);
  }
  SimTK::Vector u(n, 0.0), rate(n, 0.0);
  std::vector<bool> known(static_cast<std::size_t>(n), false);
  for (const Inside::Given& g : in_->given) {
    const int k = static_cast<int>(g.body.getFirstUIndex(state)) + g.coordinate;
    u[k] = g.speed;
    rate[k] = g.acceleration;
    known[static_cast<std::size_t>(k)] = true;
  }
  std::vector<int> follows;
  for (int k = 0; k < n; ++k)
    if (!known[static_cast<std::size_t>(k)]) follows.push_back(k);
  if (static_cast<int>(follows.size()) != m) throw std::runtime_error("not as many speeds as equations of loops");
  MatrixXd by_follows(m, m);
  for (int k = 0; k < m; ++k) by_follows.col(k) = G.col(follows[static_cast<std::size_t>(k)]);
  Eigen::FullPivLU<MatrixXd> solver;
  if (m > 0) solver.compute(by_follows);
  const auto take_away = [&](SimTK::Vector& x, const VectorXd& error) {
    const VectorXd y = solver.solve(error);
    for (int k = 0; k < m; ++k) x[follows[static_cast<std::size_t>(k)]] -= y[k];
  };
  if (m > 0) take_away(u, G * eigen(u));
  state.updU() = u;
  in_->system.realize(state, SimTK::Stage::Velocity);
  if (m > 0) {
    speeds_open = state.getUErr().normRMS();
    SimTK::Vector error;
    in_->matter.calcConstraintAccelerationErrors(state, rate, error);
    take_away(rate, eigen(error));
    in_->matter.calcConstraintAccelerationErrors(state, rate, error);
    accelerations_open = error.normRMS();
  }
  in_->system.realize(state, SimTK::Stage::Dynamics);
  SimTK::Vector residual;
  in_->matter.calcResidualForceIgnoringConstraints(
      state, SimTK::Vector(), in_->system.getRigidBodyForces(state, SimTK::Stage::Dynamics), rate, residual);
  const auto drives = static_cast<Eigen::Index>(in_->drives.size());
  MatrixXd K = MatrixXd::Zero(n, drives + m);
  for (Eigen::Index i = 0; i < drives; ++i) {
    const Inside::Drive& d = in_->drives[static_cast<std::size_t>(i)];
    K(static_cast<int>(d.body.getFirstUIndex(state)), i) = d.sign;
  }
  K.rightCols(m) = G.transpose();
  return K.fullPivLu().solve(eigen(residual)).head(drives);
}

}  // namespace polypod::test
