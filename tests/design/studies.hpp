// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Study files for the tests.
#pragma once

#include <gtest/gtest.h>

#include <filesystem>
#include <functional>
#include <limits>
#include <random>
#include <string>

#include "polypod/design/crew.hpp"

namespace polypod::design {

/// The strut hexapod of JEL Table 8.2 whose home follows the struts' mean length.
inline constexpr const char* kStrut = R"(
name = "strut"
family = "strut-hexapod"
base = { radius_mm = 50, pair_angle_deg = 30 }
platform = { radius_mm = 25, pair_angle_deg = 30 }
leg = { length_min_mm = 50, length_max_mm = 90, diameter_mm = 3 }
tool = { length_mm = 0 }
joint = { limit = "cone", cone_deg = 60 }
)";

/// A folder of its own, removed with the object.
class Folder {
 public:
  Folder()
      : path_(std::filesystem::temp_directory_path() / ("polypod-design-" + std::to_string(std::random_device{}()))) {
    std::filesystem::create_directories(path_);
  }
  ~Folder() {
    std::error_code ec;
    std::filesystem::remove_all(path_, ec);
  }
  Folder(const Folder&) = delete;
  Folder& operator=(const Folder&) = delete;
  [[nodiscard]] std::string operator/(const std::string& name) const { return (path_ / name).string(); }

 private:
  std::filesystem::path path_;
};

/// A study on kStrut.
inline Study study_on_strut(const std::string& text) {
  const auto study = study_from_text("machine = \"strut\"\n" + text, "test.toml", kStrut);
  EXPECT_TRUE(study) << to_string(study.error());
  return study.value_or(Study{});
}

/// Candidates that are worth what a function of their shares of the ranges says, in the order of Study::figures(), with
/// an objective where the study has one; no figures: it is refused. As many as `at_a_time` are fetched, and done in any
/// order.
class KnownCrew final : public Crew {
 public:
  using Function = std::function<std::vector<double>(const std::vector<double>&)>;
  KnownCrew(const Study& study, Function f, int most = -1, std::size_t at_a_time = 1)
      : study_(study), f_(std::move(f)), left_(most), at_a_time_(at_a_time) {}

  using Crew::work;
  Result<bool> work(Tasks& tasks) override {
    std::vector<Task> in_work;
    while (true) {
      while (in_work.size() < at_a_time_) {
        auto task = tasks.next();
        if (!task) break;
        in_work.push_back(std::move(*task));
      }
      if (in_work.empty()) return true;
      if (left_-- == 0) return false;
      const auto which = in_work.begin() + static_cast<std::ptrdiff_t>(order_() % in_work.size());
      const Task task = *which;
      in_work.erase(which);
      std::vector<double> u;
      for (std::size_t k = 0; k < study_.vary.size(); ++k) u.push_back(study_.vary[k].share_of(task.row.varied[k]));
      Evaluation e;
      e.state = State::done;
      e.violation = 0;
      for (const double x : f_(u)) {
        Value v;
        v.value = v.lower = v.upper = x;
        e.figures.push_back(v);
      }
      if (e.figures.empty()) {
        e.state = State::refused;
        e.violation = std::numeric_limits<double>::infinity();
        e.figures.resize(study_.figures().size());
      }
      e.objective = objective_of(study_, e.figures);
      POLYPOD_TRY(tasks.taken(task.index, std::move(e)));
    }
  }

 private:
  const Study& study_;
  Function f_;
  int left_;  // evaluations until it is cancelled; negative: it is not
  std::size_t at_a_time_;
  std::mt19937 order_{1};
};

/// The least rectangle round the machine that is at least 2500 mm2, figures that take no workspace.
inline constexpr const char* kQuick = R"(
evaluations = 120
[[vary]]
key = "base.radius_mm"
min = 10
max = 60
[[vary]]
key = "base.pair_angle_deg"
min = 0
max = 60
[[goal]]
figure = "footprint_mm2"
sense = "min"
[[hold]]
figure = "footprint_mm2"
min = 2500
)";

}  // namespace polypod::design
