// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// What the tests of post-processing share: reading, planning and writing in one line each.
#pragma once

#include <gtest/gtest.h>

#include <numbers>
#include <string>
#include <vector>

#include "machines.hpp"
#include "paths.hpp"
#include "polypod/core/files.hpp"
#include "polypod/core/units.hpp"
#include "polypod/post/write.hpp"

namespace polypod::test {

inline std::string example(const std::string& file) {
  return test::source("examples/cl_file/" + file);
}

/// Fails the test with the error where there is one.
template <class T>
T value(Result<T> result) {
  if (!result) throw std::runtime_error(to_string(result.error()));
  return std::move(*result);
}

/// The id of the error, its line, or "".
template <class T>
std::string id_of(const Result<T>& result) {
  return result ? "" : result.error().id;
}

struct Posted {
  post::Configuration configuration;
  post::Path path;
  post::Plan plan;
  post::Written written;
};

inline Posted post_to(post::Dialect dialect, const machine::AnyMachine& machine, const std::string& config,
                      post::Path path, const Vec3& origin_mm, post::PlanOptions options = {},
                      post::WriteOptions writing = {}) {
  post::set_for(dialect, options);
  options.origin = origin_mm * 1e-3;
  writing.origin = options.origin;
  Posted out{value(post::configure(machine, config)), std::move(path), {}, {}};
  out.plan = value(post::plan(out.configuration, out.path, options));
  out.written = value(post::write(dialect, out.configuration, out.path, out.plan, writing));
  return out;
}

/// A configuration of SLAV 2.2.1 and where the work lies.
struct Case {
  const char* machine;
  const char* config;
  Vec3 origin_mm;
};
inline const std::vector<Case>& cases() {
  static const std::vector<Case> all{{"lola50", "vertical-ab", {0, -1300, 0}},
                                     {"lola50_six.toml", "vertical-ab", {0, -1300, 0}},
                                     {"lola50_horizontal.toml", "horizontal-ab", {0, 257, -1550}},
                                     {"lola50_six.toml", "vertical-ac", {0, -1300, 0}},
                                     {"lola50_six.toml", "six", {0, -1300, 0}}};
  return all;
}
inline machine::AnyMachine machine_of(const Case& c) {
  const std::string name = c.machine;
  return load(name.find('.') == std::string::npos ? name : example(name));
}

}  // namespace polypod::test
