// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/machining/job.hpp"

#include <gmock/gmock.h>

#include "machining/examples.hpp"
#include "polypod/core/units.hpp"

namespace polypod {
namespace {

std::string good_job() {
  return testing::unwrap(files::read(testing::example_path("slavkovic_square", "job.toml")));
}

Result<machining::Job> read_text(const std::string& text) {
  const testing::Scratch scratch;
  EXPECT_TRUE(files::write_whole(scratch.file("job.toml"), text));
  return machining::read_job(scratch.file("job.toml"));
}

std::string replaced(std::string text, const std::string& what, const std::string& with) {
  const std::size_t at = text.find(what);
  EXPECT_NE(at, std::string::npos) << what;
  return text.replace(at, what.size(), with);
}

// What a corrected program says of its place, and what `post` compares: a hundredth of a millimetre at a metre counts.
TEST(Job, PlaceInWords) {
  EXPECT_EQ(machining::place_in_words(Pose{Mat3::Identity(), {-0.05, -1.335, 0}}), "X-50 Y-1335 Z0 mm");
  EXPECT_EQ(machining::place_in_words(Pose{Mat3::Identity(), {1e-9, -1.3327679, 2.5e-3}}), "X0 Y-1332.7679 Z2.5 mm");
  const Pose turned{rotation_z(units::from_deg(-30.25)), {0.1, 0, 0}};
  EXPECT_EQ(machining::place_in_words(turned), "X100 Y0 Z0 mm, turned by -30.25 deg about z");
  EXPECT_NEAR(machining::rotation_of(turned), units::from_deg(-30.25), 1e-15);
}

TEST(Job, ReadsTheExamples) {
  const auto job = testing::unwrap(machining::read_job(testing::example_path("slavkovic_square", "job.toml")));
  EXPECT_DOUBLE_EQ(job.tolerance, 100e-6);
  EXPECT_DOUBLE_EQ(job.X_MW.p.y(), -1.3);
  EXPECT_EQ(job.cutter.teeth, 4);
  EXPECT_LE(job.stock.cell(), 0.025 * job.cutter.diameter);
}

struct Bad {
  const char* what;
  const char* replace;
  const char* with;
  const char* id;
};

TEST(Job, EveryErrorHasIdAndLine) {
  const Bad cases[] = {
      {"unknown key", "tolerance_um = 100", "tolerance_um = 100\ntolerence_um = 50", "CF103"},
      {"no tolerance", "tolerance_um = 100", "", "CF106"},
      {"tolerance zero", "tolerance_um = 100", "tolerance_um = 0", "CF105"},
      {"tolerance not finite", "tolerance_um = 100", "tolerance_um = nan", "CF105"},
      {"no such machine", "\"lola50\"", "\"lola51\"", "MA100"},
      {"missing coefficient", "Krc_N_per_mm2 = 182.03", "", "CF106"},
      {"text for a number", "Ktc_N_per_mm2 = 1027.78", "Ktc_N_per_mm2 = \"much\"", "CF104"},
      {"cells too coarse", "kind = \"allowance\"", "kind = \"allowance\"\ncell_mm = 0.3", "CT112"},
      {"two coordinates", "[0, -1300, 0]", "[0, -1300]", "CF107"},
      {"broken file", "[stock]", "[stock", "CF101"},
      {"no cutter", "[cutter]", "[cuter]", "CF106"},
  };
  for (const Bad& bad : cases) {
    SCOPED_TRACE(bad.what);
    const auto job = read_text(replaced(good_job(), bad.replace, bad.with));
    ASSERT_FALSE(job);
    EXPECT_EQ(job.error().id, bad.id) << to_string(job.error());
    if (job.error().id != "MA100") {
      EXPECT_GT(job.error().place.line, 0);
      EXPECT_THAT(job.error().place.file, ::testing::HasSubstr("job.toml"));
    }
  }
}

TEST(Job, MissingFileAndDirectory) {
  EXPECT_EQ(machining::read_job("/nonexistent/job.toml").error().id, "FI100");
  EXPECT_EQ(machining::read_job("/").error().id, "FI100");
}

TEST(Job, ToolsWithTheirOwnCutters) {
  const auto job = testing::unwrap(read_text(good_job() + R"(
[[tool]]
number = 2
cutter = { diameter_mm = 5, teeth = 3, helix_deg = 30, length_mm = 12 }
)"));
  EXPECT_EQ(job.cutter_of(1).teeth, 4);
  EXPECT_EQ(job.cutter_of(2).teeth, 3);
  EXPECT_LE(job.stock.cell(), 0.025 * 5e-3);
}

}  // namespace
}  // namespace polypod
