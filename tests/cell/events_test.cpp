// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// The core of the simulation against queueing theory: closed forms that hold exactly for the mean.
#include "polypod/cell/events.hpp"

#include <gtest/gtest.h>

#include <cmath>

#include "polypod/cell/simulate.hpp"
#include "polypod/core/random.hpp"

namespace polypod::cell {
namespace {

double exponential(Random& random, double rate) {
  return -std::log(1 - random.uniform()) / rate;
}

struct Queue {
  explicit Queue(Simulation& sim) : server(sim, "server") {}
  Resource server;
  double waited = 0;
  int served = 0;
};

Process customer(Simulation& sim, Queue& queue, double service, std::string name) {
  const double came = sim.now();
  co_await queue.server.take(name);
  queue.waited += sim.now() - came;
  ++queue.served;
  co_await sim.wait(service);
  queue.server.give(name);
}

Process arrivals(Simulation& sim, Queue& queue, Random& random, double rate, double service_rate, bool fixed) {
  for (int n = 0;; ++n) {
    co_await sim.wait(exponential(random, rate));
    const double service = fixed ? 1 / service_rate : exponential(random, service_rate);
    std::string name = std::to_string(n);
    sim.start(customer(sim, queue, service, name));
  }
}

/// Mean time in the queue over seeds, and the share of time in which the server works.
std::pair<Estimate, Estimate> queue(double rate, double service_rate, bool fixed) {
  std::vector<double> waits, busy;
  for (std::uint64_t seed = 1; seed <= 20; ++seed) {
    Simulation sim;
    Queue q(sim);
    Random random(seed);
    sim.start(arrivals(sim, q, random, rate, service_rate, fixed));
    constexpr double kTime = 20000;
    sim.run(kTime);
    waits.push_back(q.waited / q.served);
    busy.push_back(q.server.busy() / kTime);
  }
  return {estimate(waits), estimate(busy)};
}

// 95 % intervals of twenty seeds; three half widths hold in all but one case of 10^5.
constexpr double kWide = 3;
void expect_holds(const Estimate& e, double truth, const char* what) {
  EXPECT_NEAR(e.mean, truth, kWide * e.half_width) << what;
  EXPECT_LT(e.half_width, 0.1 * truth) << what << ": the interval is too wide to tell anything";
}

TEST(Events, QueueWithExponentialServiceWaitsAsTheTheorySays) {
  const double lambda = 0.7, mu = 1, rho = lambda / mu;
  const auto [wait, busy] = queue(lambda, mu, false);
  expect_holds(wait, rho / (mu - lambda), "M/M/1, time in the queue");
  expect_holds(busy, rho, "M/M/1, utilisation");
}

TEST(Events, QueueWithFixedServiceWaitsHalfAsLong) {
  const double lambda = 0.7, mu = 1, rho = lambda / mu;
  const auto [wait, busy] = queue(lambda, mu, true);
  expect_holds(wait, rho / (2 * mu * (1 - rho)), "M/D/1, time in the queue (Pollaczek and Khinchine)");
  expect_holds(busy, rho, "M/D/1, utilisation");
}

Process first_station(Simulation& sim, Buffer& between, Random& random, double rate) {
  for (;;) {
    co_await sim.wait(exponential(random, rate));
    co_await between.put();  // it is blocked while the piece finds no place
  }
}
Process second_station(Simulation& sim, Buffer& between, Random& random, double rate, int& done) {
  for (;;) {
    co_await between.get();
    co_await sim.wait(exponential(random, rate));
    ++done;
  }
}

double line(double first, double second, std::size_t places, std::uint64_t seed) {
  Simulation sim;
  Buffer between(sim, places);
  Random a(seed, 1), b(seed, 2);
  int done = 0;
  sim.start(first_station(sim, between, a, first));
  sim.start(second_station(sim, between, b, second, done));
  constexpr double kTime = 20000;
  sim.run(kTime);
  return done / kTime;
}

TEST(Events, TwoStationsWithBlocking) {
  // Hunt (1956): two exponential stations of one rate with `b` places between them bring (b + 2) / (b + 3) of it. With
  // different rates and no place: mu1 mu2 (mu1 + mu2) / (mu1^2 + mu1 mu2 + mu2^2).
  for (const std::size_t places : {0U, 1U, 3U}) {
    std::vector<double> rates;
    for (std::uint64_t seed = 1; seed <= 10; ++seed) rates.push_back(line(1, 1, places, seed));
    const auto b = static_cast<double>(places);
    expect_holds(estimate(rates), (b + 2) / (b + 3), "line with equal rates");
  }
  std::vector<double> rates;
  for (std::uint64_t seed = 1; seed <= 10; ++seed) rates.push_back(line(2, 1, 0, seed));
  expect_holds(estimate(rates), 2.0 * 1 * 3 / (4 + 2 + 1), "line with different rates");
}

Process note_times(Simulation& sim, Signal& signal, std::vector<double>& times) {
  co_await sim.wait(2);
  times.push_back(sim.now());
  const bool signalled = co_await signal.wait(5);
  times.push_back(signalled ? sim.now() : -sim.now());
  const bool again = co_await signal.wait(1);
  times.push_back(again ? sim.now() : -sim.now());
}
Process ring(Simulation& sim, Signal& signal) {
  co_await sim.wait(3);
  signal.notify();
}
TEST(Events, SignalsAndTimeWakeOnce) {
  Simulation sim;
  Signal signal(sim);
  std::vector<double> times;
  sim.start(note_times(sim, signal, times));
  sim.start(ring(sim, signal));
  sim.run(100);
  EXPECT_EQ(times, (std::vector<double>{2, 3, -4}));
  EXPECT_TRUE(sim.idle());
  EXPECT_EQ(sim.last_event(), 4);
  EXPECT_EQ(sim.now(), 100);
}

Process inner(Simulation& sim, std::vector<int>& order) {
  order.push_back(1);
  co_await sim.wait(1);
  order.push_back(2);
}
Process outer(Simulation& sim, std::vector<int>& order) {
  co_await inner(sim, order);
  order.push_back(3);
}
TEST(Events, ProcessesWaitForEachOther) {
  Simulation sim;
  std::vector<int> order;
  sim.start(outer(sim, order));
  sim.run(10);
  EXPECT_EQ(order, (std::vector<int>{1, 2, 3}));
}

Process hold(Simulation& sim, Resource& resource, std::string name, double time, std::vector<std::string>& order) {
  co_await resource.take(name);
  order.push_back(name);
  co_await sim.wait(time);
  resource.give(name);
}
TEST(Events, WhoComesFirstIsServedFirst) {
  Simulation sim;
  Resource two(sim, "two", 2);
  std::vector<std::string> order;
  std::vector<std::string> names{"a", "b", "c", "d"};
  for (const std::string& name : names) sim.start(hold(sim, two, name, 1, order));
  sim.run(1.5);
  EXPECT_EQ(order, names);
  EXPECT_EQ(two.holders(), (std::vector<std::string>{"c", "d"}));
  EXPECT_DOUBLE_EQ(two.busy(), 3);
}

TEST(Events, CyclesOfWaitingAreFound) {
  EXPECT_EQ(waiting_cycle({{"a", "", {"b"}}, {"b", "", {"c"}}, {"c", "", {}}}), std::vector<std::size_t>{});
  EXPECT_EQ(waiting_cycle({{"a", "", {"b"}}, {"b", "", {"c"}}, {"c", "", {"b"}}}), (std::vector<std::size_t>{1, 2}));
  EXPECT_EQ(waiting_cycle({{"a", "", {"a"}}}), (std::vector<std::size_t>{0}));
  EXPECT_EQ(waiting_cycle({}), std::vector<std::size_t>{});
}

}  // namespace
}  // namespace polypod::cell
