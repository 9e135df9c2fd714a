// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// The server of `polypod view`, asked without sockets: who may ask, for what, and whether the answers are the
// library's.
#include "polypod/viewer/site.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <chrono>
#include <fstream>
#include <nlohmann/json.hpp>
#include <random>
#include <set>
#include <thread>

#include "paths.hpp"
#include "polypod/core/units.hpp"
#include "polypod/kinematics/any_machine.hpp"

namespace polypod::viewer {
namespace {

using nlohmann::json;
using ::testing::HasSubstr;

constexpr int kPort = 4711;

Site site_of(const std::vector<std::string>& files) {
  auto site = Site::of(files, "test");
  EXPECT_TRUE(site) << site.error().message;
  return *site;
}
Request get(const std::string& path, const std::string& host = "127.0.0.1:4711", const std::string& origin = "") {
  return {"GET", path, host, origin, ""};
}
Request post(const std::string& path, const json& body) {
  return {"POST", path, "localhost:4711", "http://localhost:4711", body.dump()};
}

TEST(Site, OnlyItsOwnPagesMayAsk) {
  const Site site = site_of({"hexapod-strut"});
  EXPECT_EQ(site.answer(get("/"), kPort).status, 200);
  for (const char* host : {"localhost:4711", "LocalHost:4711", "127.0.0.1:4711"}) {
    EXPECT_EQ(site.answer(get("/", host, "http://127.0.0.1:4711"), kPort).status, 200) << host;
    EXPECT_EQ(site.answer(get("/", host, "http://localhost:4711"), kPort).status, 200) << host;
    EXPECT_EQ(site.answer(get("/", host), kPort + 1).status, 403) << host;
  }
  // Browsers leave the port of http out.
  EXPECT_EQ(site.answer(get("/", "localhost", "http://localhost"), 80).status, 200);
  EXPECT_EQ(site.answer(get("/", "localhost:80"), 80).status, 200);
  EXPECT_EQ(site.answer(get("/", "evil.example"), 80).status, 403);
  for (const char* host :
       {"", "127.0.0.1", "127.0.0.1:4712", "evil.example:4711", "127.0.0.1:4711.evil.example", "[::1]:4711"}) {
    EXPECT_EQ(site.answer(get("/", host), kPort).status, 403) << host;
  }
  for (const char* origin :
       {"null", "http://evil.example", "https://127.0.0.1:4711", "http://127.0.0.1", "http://127.0.0.1:47110"}) {
    EXPECT_EQ(site.answer(get("/", "127.0.0.1:4711", origin), kPort).status, 403) << origin;
  }
}

TEST(Site, NoRequestNamesAFile) {
  const Site site = site_of({"hexapod-strut", "lola50"});
  EXPECT_THAT(site.answer(get("/"), kPort).body, HasSubstr("href=\"/1\""));
  for (const char* path : {"/../../etc/passwd", "/etc/passwd", "//etc/passwd", "/0/../1", "/0/", "/2", "/-1", "/0x0",
                           "/99999999999999999999", "/%2e%2e/etc/passwd", "", "0", "/0/pose/..", "/lola50"}) {
    EXPECT_EQ(site.answer(get(path), kPort).status, 404) << path;
  }
  EXPECT_EQ(site.answer(get("/0/pose"), kPort).status, 405) << "a question is posted";
  Request put = get("/0");
  put.method = "PUT";
  EXPECT_EQ(site.answer(put, kPort).status, 405);
}

TEST(Site, PosesAreThoseOfTheLibraryForEveryMachineOfTheCatalogue) {
  // Both sides are the same library: what is tested is the way there and back, in mm and deg, in the task's order.
  constexpr double kRounding = 1e-9;  // mm or deg
  int asked = 0;
  for (const machine::CatalogueEntry& entry : machine::catalogue()) {
    const std::string name(entry.name);
    const auto m = machine::load(name);
    ASSERT_TRUE(m);
    const Site site = site_of({name});
    const std::string page = site.answer(get("/"), kPort).body;
    const std::string mark = "id=\"live-data\">";
    const std::size_t from = page.find(mark) + mark.size();
    const json live = json::parse(page.substr(from, page.find("</script>", from) - from));
    json pose = json::array();
    for (const json& c : live["pose"]) pose.push_back(c["value"].get<double>() + (c["unit"] == "mm" ? 1.5 : 0.5));
    const json answer = json::parse(site.answer(post("/0/pose", {{"pose", pose}}), kPort).body);
    ASSERT_FALSE(answer.contains("error")) << name << answer;
    const machine::Task task = kinematics::task(*m);
    std::vector<double> c;
    for (std::size_t i = 0; i < pose.size(); ++i) {
      const double v = pose[i].get<double>();
      c.push_back(task.is_angle(static_cast<int>(i)) ? units::from_deg(v) : units::from_mm(v));
    }
    const auto inverse = kinematics::inverse(*m, kinematics::pose_of(task, c));
    if (inverse.solutions.empty()) {
      EXPECT_TRUE(answer.contains("reason")) << name;
      continue;
    }
    ++asked;
    double nearest = 1e300;
    for (const auto& s : inverse.solutions) {
      double off = 0;
      for (int i = 0; i < s.joints.size(); ++i) {
        const bool turns = kinematics::joint_kind(*m, i) == machine::JointKind::revolute;
        const double q = turns ? units::to_deg(s.joints[i]) : units::to_mm(s.joints[i]);
        off = std::max(off, std::abs(q - answer["joints"][static_cast<std::size_t>(i)].get<double>()));
      }
      nearest = std::min(nearest, off);
    }
    EXPECT_LT(nearest, kRounding) << name;
    EXPECT_FALSE(answer["scene"]["lines"].empty()) << name;
    // And back: the joints give the pose.
    const json back = json::parse(site.answer(post("/0/pose", {{"joints", answer["joints"]}}), kPort).body);
    ASSERT_TRUE(back.contains("pose")) << name << back;
    ASSERT_EQ(back["pose"].size(), pose.size()) << name;
    for (std::size_t i = 0; i < pose.size(); ++i) {
      EXPECT_NEAR(back["pose"][i].get<double>(), answer["pose"][i].get<double>(), 1e-6) << name << i;
      EXPECT_NEAR(answer["pose"][i].get<double>(), pose[i].get<double>(), 1e-6) << name << i;
    }
  }
  EXPECT_GT(asked, 20);
}

TEST(Site, FiguresChangeTheMachineAndNothingElse) {
  const Site site = site_of({"hexapod-strut"});
  const json pose{0, 0, 75, 0, 0, 0};
  const json as_is = json::parse(site.answer(post("/0/pose", {{"pose", pose}}), kPort).body);
  const json other =
      json::parse(site.answer(post("/0/pose", {{"pose", pose}, {"sets", {{"base.radius_mm", "60"}}}}), kPort).body);
  ASSERT_TRUE(other.contains("joints")) << other;
  EXPECT_GT(other["joints"][0].get<double>(), as_is["joints"][0].get<double>() + 1);
  EXPECT_EQ(json::parse(site.answer(post("/0/pose", {{"pose", pose}}), kPort).body)["joints"], as_is["joints"]);
  const json unknown =
      json::parse(site.answer(post("/0/pose", {{"pose", pose}, {"sets", {{"no.such", "1"}}}}), kPort).body);
  EXPECT_THAT(unknown["error"].get<std::string>(), HasSubstr("no.such"));
}

TEST(Site, AWorkspaceHasItsBoundsAndASurface) {
  const Site site = site_of({"hexapod-strut"});
  const json answer =
      json::parse(site.answer(post("/0/workspace", {{"pose", {0, 0, 75, 0, 0, 0}}, {"tilt_deg", 20}}), kPort).body);
  ASSERT_TRUE(answer.contains("volume_mm3")) << answer;
  // JEL Table 8.2's machine at 20 deg, as docs/workspace.md has it: 30154 mm3 between 30114 and 30195.
  EXPECT_LE(answer["volume_lower_mm3"].get<double>(), 30195);
  EXPECT_GE(answer["volume_upper_mm3"].get<double>(), 30114);
  EXPECT_FALSE(answer["scene"]["meshes"].empty());
}

TEST(Site, AWorkspaceOfOtherCoordinatesIsSaidInThem) {
  const Site site = site_of({"planar-3rrr"});
  const json answer = json::parse(site.answer(post("/0/workspace", {{"pose", {0, 0, 0}}}), kPort).body);
  ASSERT_TRUE(answer.contains("volume")) << answer;
  EXPECT_FALSE(answer.contains("volume_mm3"));
  const std::string text = answer["volume"].get<std::string>();
  EXPECT_THAT(text, HasSubstr("Of the coordinates x, y and C, a region of 7"));
  EXPECT_THAT(text, HasSubstr("mm² deg is reached: certainly between"));
  EXPECT_THAT(text, HasSubstr("beyond a singular pose"));
}

/// A form begins within the limits where it can, says nothing of rounding, and holds every figure that can be set.
TEST(Site, FormsBeginWithinTheLimits) {
  for (const char* name : {"ur10e", "lola50", "puma560", "delta-picker", "pentapod", "hexapod-strut"}) {
    SCOPED_TRACE(name);
    const Site site = site_of({name});
    const std::string page = site.answer({"GET", "/0", "127.0.0.1:4711", "", ""}, kPort).body;
    const std::string opening = "id=\"live-data\"";
    const auto at = page.find(opening);
    ASSERT_NE(at, std::string::npos);
    const auto begin = page.find('{', at);
    const json live = json::parse(page.substr(begin, page.find("</script>", begin) - begin));
    json pose = json::array();
    for (const json& c : live["pose"]) {
      const double value = c["value"].get<double>();
      EXPECT_TRUE(value == 0 || std::abs(value) > 1e-9) << value;
      pose.push_back(value);
    }
    const json there = json::parse(site.answer(post("/0/pose", {{"pose", pose}}), kPort).body);
    ASSERT_TRUE(there.contains("violations")) << there;
    EXPECT_TRUE(there["violations"].empty()) << there["violations"];
    const machine::AnyMachine m = *machine::load(name);
    std::set<std::string> keys;
    for (const json& s : live["settings"]) keys.insert(s["key"].get<std::string>());
    for (const machine::Parameter& p : kinematics::parameters(m)) EXPECT_TRUE(keys.contains(machine::key_of(p)));
  }
}

TEST(Site, NumbersBeyondAllMeasureAreNamed) {
  const Site site = site_of({"hexapod-strut"});
  const json there = json::parse(site.answer(post("/0/pose", {{"pose", {0, 1e308, 75, 0, 0, 0}}}), kPort).body);
  EXPECT_THAT(there.value("error", ""), HasSubstr("pose: its number 2 is 1e+308, beyond -1e+09 to 1e+09")) << there;
}

TEST(Site, JointsThatGiveNoPoseAreNamed) {
  const Site site = site_of({"hexapod-strut"});
  const json there = json::parse(site.answer(post("/0/pose", {{"joints", {300, 70, 70, 70, 70, 70}}}), kPort).body);
  EXPECT_THAT(there.value("reason", ""), HasSubstr("q1 is beyond its range of 50 to 90 mm")) << there;
}

/// What a page asked for before it asks anew, or for nothing, ends.
TEST(Site, AWorkspaceThatNobodyWaitsForEnds) {
  const Site site = site_of({"tripod-z3"});
  const auto begin = std::chrono::steady_clock::now();
  std::string answer;
  std::thread slow([&] {
    answer = site.answer(post("/0/workspace", {{"pose", {900, 0, 0}}, {"client", "a"}}), kPort).body;
  });
  std::this_thread::sleep_for(std::chrono::milliseconds(300));
  EXPECT_EQ(site.answer(post("/0/cancel", {{"client", "b"}}), kPort).status, 200);  // another page
  EXPECT_TRUE(json::parse(site.answer(post("/0/cancel", {{"client", "a"}}), kPort).body)["cancelled"].get<bool>());
  slow.join();
  EXPECT_THAT(json::parse(answer).value("error", ""), HasSubstr("WS110"));
  EXPECT_LT(std::chrono::steady_clock::now() - begin, std::chrono::seconds(5));
}

TEST(Site, BearsAnyQuestion) {
  const Site site = site_of({"hexapod-strut"});
  for (const char* body : {"", "{", "[]", "null", "{\"pose\":1}", "{\"pose\":[1]}", "{\"pose\":[1,2,3,4,5,1e400]}",
                           "{\"pose\":[0,0,75,0,0,\"0\"]}", "{\"joints\":[]}", "{\"sets\":[],\"pose\":[0,0,75,0,0,0]}",
                           "{\"sets\":{\"a\":1},\"pose\":[0,0,75,0,0,0]}",
                           "{\"sets\":{\"base.radius_mm\":\"nan\"},\"pose\":[0,0,75,0,0,0]}", "\xff\xfe"}) {
    const Response r = site.answer({"POST", "/0/pose", "127.0.0.1:4711", "", body}, kPort);
    EXPECT_EQ(r.status, 200);
    EXPECT_TRUE(json::parse(r.body).contains("error")) << body << r.body;
  }
  // Damaged questions: whatever comes, an answer is JSON.
  std::mt19937 random(1);
  const std::string good = R"({"sets":{"base.radius_mm":"55"},"pose":[1,2,75,0,0,0],"tilt_deg":5})";
  for (int k = 0; k < 2000; ++k) {
    std::string body = good;
    for (int n = 1 + static_cast<int>(random() % 4); n > 0; --n)
      body[random() % body.size()] = static_cast<char>(random() % 256);
    const Response r = site.answer({"POST", "/0/pose", "127.0.0.1:4711", "", body}, kPort);
    EXPECT_EQ(r.status, 200);
    EXPECT_TRUE(json::accept(r.body)) << body;
  }
}

TEST(Site, SaysWhatItDoesNotShow) {
  EXPECT_EQ(Site::of({}, "").error().id, "VW100");
  const std::string folder = ::testing::TempDir();
  const auto file = [&](const std::string& name, const std::string& text) {
    std::ofstream(folder + "/" + name) << text;
    return folder + "/" + name;
  };
  EXPECT_EQ(Site::of({file("a.stl", "solid a")}, "").error().id, "VW101");
  EXPECT_EQ(Site::of({file("a.html", "<script>alert(1)</script>")}, "").error().id, "VW103");
  const std::string square = test::source("examples/slavkovic_square/");
  EXPECT_EQ(Site::of({square + "program.ngc"}, "").error().id, "VW102");
  EXPECT_EQ(Site::of({square + "job.toml"}, "").error().id, "VW102");
  EXPECT_EQ(Site::of({"no-such-machine"}, "").error().id, "MA100");
  EXPECT_TRUE(Site::of({square + "program.ngc", square + "job.toml", "lola50"}, ""));
  EXPECT_EQ(Site::of({file("a.csv", "time_s\n")}, "").error().id, "VW104");
  EXPECT_EQ(Site::of({file("a.csv", "time_s\n"), "lola50", "hexapod-strut"}, "").error().id, "VW104");
}

TEST(Site, ShowsACellInMotion) {
  const std::string cell = test::source("examples/picking_line/cell.toml");
  const Site site = site_of({cell});
  const Response page = site.answer(get("/0"), kPort);
  EXPECT_EQ(page.status, 200);
  EXPECT_THAT(page.body, HasSubstr("Robot cell: picking line"));
  EXPECT_THAT(page.body, HasSubstr("When a tool is where is that of the simulation"));
  // A cell with a fault is answered with that fault, not as a machine without a family.
  std::ifstream in(cell);
  std::string text((std::istreambuf_iterator<char>(in)), {});
  text.replace(text.find("speed_mm_per_s = 200"), 20, "speed_mm_per_s = -20");
  const std::string bad = ::testing::TempDir() + "/backward.toml";
  std::ofstream(bad) << text;
  EXPECT_EQ(Site::of({bad}, "").error().id, "CE104");
}

TEST(Site, ShowsARecordWithItsMachine) {
  const std::string path = ::testing::TempDir() + "/record.csv";
  const auto m = machine::load("hexapod-strut");
  ASSERT_TRUE(m);
  std::ofstream out(path);
  out << "time_s,line,x_mm,y_mm,z_mm,a_deg,b_deg,c_deg,q1,q2,q3,q4,q5,q6\n";
  for (int k = 0; k < 20; ++k) {
    const Vec3 p(1e-4 * k, 0, 75e-3);
    const auto found = kinematics::inverse(*m, {Mat3::Identity(), p});
    ASSERT_FALSE(found.solutions.empty());
    out << 0.001 * k << ",7," << 0.1 * k << ",0,75,0,0,0";
    for (const double q : found.solutions.front().joints) out << ',' << 1000 * q;
    out << '\n';
  }
  out.close();
  const auto site = Site::of({path, "hexapod-strut"}, "");
  ASSERT_TRUE(site);
  const Response r = site->answer({"GET", "/0", "127.0.0.1:4711", "", ""}, kPort);
  EXPECT_EQ(r.status, 200);
  EXPECT_NE(r.body.find("<canvas data-scene"), std::string::npos);
  EXPECT_NE(r.body.find("20 pictures of 20 rows"), std::string::npos);
  // A record that is no record is a page that says so.
  std::ofstream(path) << "time_s,x_mm\n0,1\n";
  const Response bad = site->answer({"GET", "/0", "127.0.0.1:4711", "", ""}, kPort);
  EXPECT_EQ(bad.status, 200);
  EXPECT_NE(bad.body.find("LC120"), std::string::npos);
}

}  // namespace
}  // namespace polypod::viewer
