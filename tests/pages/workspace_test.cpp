// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Pages of workspaces: the machine that they begin with, and the pictures behind their sliders.
#include "polypod/pages/workspace.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <nlohmann/json.hpp>

#include "polypod/core/units.hpp"
#include "polypod/kinematics/any_machine.hpp"
#include "polypod/pages/machine.hpp"

namespace polypod::pages {
namespace {

using nlohmann::json;
using ::testing::HasSubstr;

/// The page of a workspace that is found roughly.
std::string page_of(const machine::AnyMachine& m) {
  workspace::Options options;
  options.relative_tolerance = 0.5;
  options.bounds_tolerance = 0;
  const auto volume = workspace::volume(m, options);
  EXPECT_TRUE(volume) << volume.error().message;
  WorkspacePageOptions how;
  how.resolution = 8;
  const auto page = workspace_page(m, options, *volume, how);
  EXPECT_TRUE(page) << page.error().message;
  return page.value_or("");
}

/// The first scene of a page.
json scene_in(const std::string& page) {
  const std::string mark = "class=\"scene-data\">";
  const std::size_t from = page.find(mark) + mark.size();
  return json::parse(page.substr(from, page.find("</script>", from) - from));
}

TEST(WorkspacePage, SlidersOfArmsKeepTheLimitsWhereASolutionDoes) {
  for (const char* name : {"kuka-kr210", "puma560"}) {
    SCOPED_TRACE(name);
    const machine::AnyMachine m = *machine::load(name);
    const json scene = scene_in(page_of(m));
    const MachineAt start = machine_at(m, start_pose(m));
    const machine::Task task = kinematics::task(m);
    const int joints = kinematics::joint_count(m);
    ASSERT_GE(scene["frames"].size(), 6U) << "sliders";
    // At half the opacity the arm within is seen.
    EXPECT_LT(scene["meshes"][0]["opacity"].get<double>(), 0.7);
    int looked = 0, kept = 0;
    for (const json& frames : scene["frames"]) {
      SCOPED_TRACE(frames["name"]);
      const auto value = [&](int column, std::size_t k) {
        return frames["columns"][static_cast<std::size_t>(column)]["values"][k].get<double>();
      };
      const auto at_start = frames["start"].get<std::size_t>();
      EXPECT_EQ(frames["notes"][at_start], "") << "the page begins with a broken limit";
      constexpr double kShown = 1e-6;  // ten digits stand in the page
      for (int i = 0; i < joints; ++i)
        EXPECT_NEAR(value(task.size() + i, at_start), units::to_deg(start.q[i]), kShown) << "not where `view` begins";
      if (frames["name"].get<std::string>()[0] == 'q') continue;
      for (std::size_t k = 0; k < frames["at"].size(); ++k) {
        std::vector<double> c;
        for (int i = 0; i < task.size(); ++i)
          c.push_back(task.is_angle(i) ? units::from_deg(value(i, k)) : units::from_mm(value(i, k)));
        const bool reached = kinematics::inverse(m, kinematics::pose_of(task, c)).reachable() != nullptr;
        EXPECT_EQ(frames["notes"][k] == "", reached) << "at " << frames["at"][k];
        ++looked;
        kept += reached ? 1 : 0;
      }
    }
    EXPECT_GT(looked, 100);
    EXPECT_GT(kept, 30);
  }
}

TEST(WorkspacePage, ALimitThatAloneEndsTheMachineIsSaidToBeWithoutEnd) {
  EXPECT_THAT(page_of(*machine::load("delta-linear")), HasSubstr("<td>without end</td>"));
}

}  // namespace
}  // namespace polypod::pages
