// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// The server of `polypod view`, asked without sockets: who may ask, for what, and whether the answers are the
// library's.
#include "polypod/viewer/site.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <chrono>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <random>
#include <set>
#include <thread>

#include "paths.hpp"
#include "polypod/core/units.hpp"
#include "polypod/kinematics/any_machine.hpp"
#include "polypod/report/html.hpp"

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

/// Whatever comes instead of a good question, the answer is JSON.
void answers_damaged(const Site& site, const char* path, const std::string& good) {
  std::mt19937 random(1);
  for (int k = 0; k < 2000; ++k) {
    std::string body = good;
    for (int n = 1 + static_cast<int>(random() % 4); n > 0; --n)
      body[random() % body.size()] = static_cast<char>(random() % 256);
    const Response r = site.answer({"POST", path, "127.0.0.1:4711", "", body}, kPort);
    EXPECT_EQ(r.status, 200);
    EXPECT_TRUE(json::accept(r.body)) << body;
  }
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
  answers_damaged(site, "/0/pose", R"({"sets":{"base.radius_mm":"55"},"pose":[1,2,75,0,0,0],"tilt_deg":5})");
}

// A page that was given is another file by the time it is asked for.
TEST(Site, WhatIsServedIsStillAPageOfPolypod) {
  const std::string path = std::string(::testing::TempDir()) + "/given.html";
  std::ofstream(path) << report::Report("given", "").to_html();
  const auto site = Site::of({path}, "");
  ASSERT_TRUE(site) << to_string(site.error());
  const auto body = [&] { return site->answer({"GET", "/0", "127.0.0.1:4711", "", ""}, kPort).body; };
  EXPECT_NE(body().find("<h1>given</h1>"), std::string::npos);
  std::ofstream(path) << "root:x:0:0";
  EXPECT_EQ(body().find("root:x"), std::string::npos);
  EXPECT_NE(body().find("VW103"), std::string::npos);
}

// An arm's bounds stay wide with few boxes: a sample is said beside them, and lies within.
TEST(Site, AWorkspaceOfAnArmHasASampleBesideItsBounds) {
  const Site site = site_of({"puma560"});
  const json pose = json::parse(site.answer(post("/0/pose", {{"joints", {0, -45, 180, 0, 0, 0}}}), kPort).body);
  ASSERT_TRUE(pose.contains("pose")) << pose;
  const json answer = json::parse(site.answer(post("/0/workspace", {{"pose", pose["pose"]}}), kPort).body);
  ASSERT_TRUE(answer.contains("volume_sample_mm3")) << answer.dump().substr(0, 300);
  EXPECT_TRUE(answer["proven"].get<bool>());
  EXPECT_GE(answer["volume_sample_mm3"].get<double>(), answer["volume_lower_mm3"].get<double>());
  EXPECT_LE(answer["volume_sample_mm3"].get<double>(), answer["volume_upper_mm3"].get<double>());
  EXPECT_THAT(answer["volume"].get<std::string>(), HasSubstr("(by a sample, with 95 % between "));
}

TEST(Site, SaysWhatItDoesNotShow) {
  EXPECT_EQ(Site::of({}, "").error().id, "VW100");
  const std::string folder = ::testing::TempDir();
  const auto file = [&](const std::string& name, const std::string& text) {
    std::ofstream(folder + "/" + name) << text;
    return folder + "/" + name;
  };
  EXPECT_EQ(Site::of({file("a.vti", "<VTKFile/>")}, "").error().id, "VW101");
  EXPECT_EQ(Site::of({folder + "/there-is-no-such.stl"}, "").error().id, "FI100");
  EXPECT_EQ(Site::of({file("a.html", "<script>alert(1)</script>")}, "").error().id, "VW103");
  const std::string square = test::source("examples/slavkovic_square/");
  EXPECT_EQ(Site::of({square + "job.toml"}, "").error().id, "VW102");
  EXPECT_EQ(Site::of({square + "program.ngc", square + "job.toml", square + "job.toml"}, "").error().id, "VW102");
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

std::string written(const std::string& name, const std::string& text) {
  const std::string path = ::testing::TempDir() + "/" + name;
  std::ofstream(path, std::ios::binary) << text;
  return path;
}
/// Without the script that turns the pictures.
std::string page_of(const std::vector<std::string>& files, const std::string& path = "/0") {
  const std::string page = site_of(files).answer(get(path), kPort).body;
  return page.substr(0, page.find("<footer"));
}
/// The scene of a page.
json scene_in(const std::string& page) {
  const std::string mark = "class=\"scene-data\">";
  const std::size_t from = page.find(mark);
  if (from == std::string::npos) return {};
  return json::parse(page.substr(from + mark.size(), page.find("</script>", from) - from - mark.size()));
}

std::string stl_of(const std::vector<std::array<std::array<float, 3>, 3>>& triangles) {
  std::string out(80, ' ');
  const auto put = [&](const auto& v) { out.append(reinterpret_cast<const char*>(&v), sizeof v); };
  put(static_cast<std::uint32_t>(triangles.size()));
  for (const auto& t : triangles) {
    put(std::array<float, 3>{});
    for (const auto& p : t) put(p);
    put(std::uint16_t{0});
  }
  return out;
}
/// The sides of a box with `n` by `n` squares each.
std::vector<std::array<std::array<float, 3>, 3>> box_of(int n, std::array<float, 3> size, bool open) {
  std::vector<std::array<std::array<float, 3>, 3>> out;
  for (std::size_t axis = 0; axis < 3; ++axis) {
    for (const bool far : {false, true}) {
      if (open && axis == 2 && far) continue;
      const auto at = [&](int i, int j) {
        std::array<float, 3> p{};
        p[axis] = far ? size[axis] : 0;
        p[(axis + 1) % 3] = size[(axis + 1) % 3] * static_cast<float>(i) / static_cast<float>(n);
        p[(axis + 2) % 3] = size[(axis + 2) % 3] * static_cast<float>(j) / static_cast<float>(n);
        return p;
      };
      for (int i = 0; i < n; ++i) {
        for (int j = 0; j < n; ++j) {
          const auto a = at(i, j), b = at(i + 1, j), c = at(i + 1, j + 1), d = at(i, j + 1);
          out.push_back(far ? std::array{a, b, c} : std::array{a, c, b});
          out.push_back(far ? std::array{a, c, d} : std::array{a, d, c});
        }
      }
    }
  }
  return out;
}

TEST(Site, ShowsAnStlFileWithItsFigures) {
  const std::string page = page_of({written("box.stl", stl_of(box_of(4, {20, 30, 40}, false)))});
  EXPECT_THAT(page, HasSubstr("<b>20.00 <small>mm</small></b><span>along x, from 0.00 to 20.00"));
  EXPECT_THAT(page, HasSubstr("<b>40.00 <small>mm</small></b><span>along z"));
  EXPECT_THAT(page, HasSubstr("The surface is closed"));
  EXPECT_THAT(page, HasSubstr("It encloses 24"));
  EXPECT_THAT(page, HasSubstr("000 mm³"));
  EXPECT_THAT(page, HasSubstr("<b>192</b><span>triangles"));
  EXPECT_THAT(page, HasSubstr("An STL file has no unit: its numbers are taken as mm."));
  EXPECT_EQ(page.find("coarser than the file"), std::string::npos);
  EXPECT_EQ(scene_in(page)["meshes"].size(), 1U);
  const std::string open = page_of({written("open.STL", stl_of(box_of(1, {20, 30, 40}, true)))});
  EXPECT_THAT(open, HasSubstr("The surface is not closed: 4 of its edges"));
  // A file that is none, or holds nothing, is a page that says so.
  EXPECT_THAT(page_of({written("bad.stl", "no mesh")}), HasSubstr("BO112"));
  EXPECT_THAT(page_of({written("without_triangles.stl", "solid a\nendsolid a\n")}), HasSubstr("VW106"));
}

/// What is too much to draw is drawn coarser, and what is too much to read is not read.
TEST(Site, LargeSurfacesAreDrawnCoarser) {
  const std::string page = page_of({written("fine.stl", stl_of(box_of(120, {20, 30, 40}, false)))});
  EXPECT_THAT(page, HasSubstr("The picture is coarser than the file: of 172"));
  EXPECT_THAT(page, HasSubstr("The surface is closed"));
  EXPECT_LT(page.size(), 4'500'000U);
  const json mesh = scene_in(page)["meshes"][0];
  const std::size_t triangles = mesh["triangles"].get<std::string>().size() * 3 / 4 / 12;
  EXPECT_LE(triangles, 60'000U);
  EXPECT_GT(triangles, 20'000U);
  const std::string path = written("huge.stl", "x");
  std::filesystem::resize_file(path, 300U << 20U);  // a hole: no bytes on the disk
  EXPECT_THAT(page_of({path}), HasSubstr("VW105"));
  std::filesystem::remove(path);
}

TEST(Site, ShowsAVtpFileInItsColours) {
  const auto vtp = [](const char* values) {
    return std::string(
               "<VTKFile type=\"PolyData\" version=\"1.0\" byte_order=\"LittleEndian\"><PolyData>"
               "<Piece NumberOfPoints=\"4\" NumberOfPolys=\"1\" NumberOfLines=\"1\"><PointData>"
               "<DataArray type=\"Float64\" Name=\"error &lt;um&gt;\" format=\"ascii\">") +
           values +
           "</DataArray></PointData><Points><DataArray type=\"Float64\" NumberOfComponents=\"3\" format=\"ascii\">"
           "0 0 0 10 0 0 10 5 0 0 5 2</DataArray></Points>"
           "<Lines><DataArray Name=\"connectivity\" format=\"ascii\">0 2</DataArray><DataArray Name=\"offsets\" "
           "format=\"ascii\">2</DataArray></Lines>"
           "<Polys><DataArray Name=\"connectivity\" format=\"ascii\">0 1 2 3</DataArray><DataArray Name=\"offsets\" "
           "format=\"ascii\">4</DataArray></Polys></Piece></PolyData></VTKFile>";
  };
  const std::string page = page_of({written("a.vtp", vtp("0.5 1 2 8.5"))});
  EXPECT_THAT(page, HasSubstr("Coloured by error &lt;um&gt;, the first scalar"));
  EXPECT_THAT(page, HasSubstr("from 0.5 to 8.5"));
  json scene = scene_in(page);
  EXPECT_EQ(scene["levels"].size(), 7U);
  EXPECT_EQ(scene["kinds"][0]["name"], "error <um> 0.5 to 1.5");
  EXPECT_EQ(scene["lines"].size(), 1U);
  EXPECT_EQ(scene["colours"]["high"], 8.5);
  // Few whole numbers are kinds; what has no value is apart.
  scene = scene_in(page_of({written("b.vtp", vtp("0 0 3 nan"))}));
  EXPECT_TRUE(scene["levels"].empty());
  ASSERT_EQ(scene["kinds"].size(), 2U);
  EXPECT_EQ(scene["kinds"][1]["name"], "error <um> 3");
  ASSERT_EQ(scene["meshes"].size(), 2U);
  EXPECT_EQ(scene["meshes"][1]["name"], "without a value");
  EXPECT_THAT(page_of({written("c.vtp", "<VTKFile type=\"PolyData\" compressor=\"x\"/>")}), HasSubstr("RE111"));
}

TEST(Site, ShowsAProgramWithoutItsJob) {
  const std::string mm =
      "G21 G17 G90\nG0 X0 Y0 Z5\nG0 X10\nG1 Z-1 F100\nG1 X30 F600\nG2 X40 Y-10 I0 J-10\nG1 X40 Y-10 F600\nG4 P2\nG0 "
      "Z5\nM2\n";
  const std::string page = page_of({written("a.ngc", mm)});
  EXPECT_THAT(page, HasSubstr("Not judged: no machine and no job were given"));
  // 6 + 20 mm and a quarter of 20 pi; 6 at 100 mm/min, the others at 600.
  EXPECT_THAT(page, HasSubstr("<b>41.7 <small>mm</small></b><span>length of 4 feed moves"));
  EXPECT_THAT(page, HasSubstr("<span>feed moves at their programmed feeds"));
  EXPECT_THAT(page, HasSubstr("<b>7.2 <small>s</small>"));
  EXPECT_THAT(page, HasSubstr("<td>10.000 to 40.000</td><td>\u221210.000 to 0.000</td><td>\u22121.000 to 5.000</td>"));
  EXPECT_THAT(page, HasSubstr("Dwells (G4) take 2 s more."));
  EXPECT_THAT(page, HasSubstr("<th>line</th>"));
  EXPECT_THAT(page, HasSubstr("G1 X30 F600"));
  EXPECT_THAT(page, HasSubstr("polypod check PROGRAM --machine NAME"));
  const json scene = scene_in(page);
  ASSERT_EQ(scene["lines"].size(), 2U);
  EXPECT_EQ(scene["lines"][1]["name"], "feed moves");
  EXPECT_TRUE(scene["lines"][1].contains("value")) << "the colour is the feed";
  EXPECT_EQ(scene["colours"]["low"], 100);
  EXPECT_EQ(scene["colours"]["high"], 600);
  // Inches of the program are mm of the page; the first move is not known where it begins.
  const std::string inch = page_of({written("b.ngc", "G20 G90\nG0 X0 Y0 Z0.2\nG1 X1 F10\nM2\n")});
  EXPECT_THAT(inch, HasSubstr("<td>0.000 to 25.400</td>"));
  EXPECT_THAT(inch, HasSubstr(">254 <small>mm/min</small>"));
  EXPECT_THAT(inch, HasSubstr("1 move is not drawn and not counted"));
  // Nothing but a start that is not known; and what is no program.
  EXPECT_THAT(page_of({written("c.ngc", "G0 X1\nM2\n")}), HasSubstr("of none is it known"));
  EXPECT_THAT(page_of({written("d.ngc", "M2\n")}), HasSubstr("The program moves nothing."));
  EXPECT_THAT(page_of({written("e.ngc", "G1 X\n")}), HasSubstr("GC101"));
}

/// An arc that turns back between its ends is as wide as it is.
TEST(Site, TheBoxOfAProgramHoldsItsArcs) {
  const std::string page =
      page_of({written("f.ngc", "G21 G90 F300\nG0 X-7 Y-24 Z0\nG1 X-7 Y-24\nG3 X-7 Y-24 I7 J24 P2\nM2\n")});
  EXPECT_THAT(page, HasSubstr("<td>\u221225.000 to 25.000</td><td>\u221225.000 to 25.000</td><td>0.000 to 0.000</td>"));
}

constexpr const char* kRecordHead = "time_s,line,x_mm,y_mm,z_mm,a_deg,b_deg,c_deg,q1,q2,q3,q4,q5,q6\n";
std::string record_row(const machine::AnyMachine& m, int k, double q2 = 0) {
  const auto found = kinematics::inverse(m, {Mat3::Identity(), Vec3(1e-4 * k, 0, 75e-3)});
  std::string out = std::to_string(0.01 * k) + ",7," + std::to_string(0.1 * k) + ",0,75,0,0,0";
  for (int i = 0; i < 6; ++i)
    out += ',' + std::to_string(i == 1 && q2 > 0 ? q2 : 1000 * found.solutions.front().joints[i]);
  return out + "\n";
}

TEST(Site, FollowsARecordThatGrows) {
  const machine::AnyMachine m = *machine::load("hexapod-strut");
  const std::string path = written("live.csv", kRecordHead);
  const Site site = site_of({path, "hexapod-strut"});
  const auto ask = [&](const json& next) {
    const Response r = site.answer(post("/0/rows", next), kPort);
    EXPECT_EQ(r.status, 200);
    return json::parse(r.body);
  };
  const std::string page = site.answer(get("/0/live"), kPort).body;
  EXPECT_THAT(page, HasSubstr("The record as it grows"));
  EXPECT_THAT(page, HasSubstr("<canvas data-scene"));
  // The page of a record leads to it, with rows or without.
  EXPECT_THAT(site.answer(get("/0"), kPort).body, HasSubstr("href=\"/0/live\""));
  EXPECT_THAT(site.answer(get("/"), kPort).body, HasSubstr("href=\"/0/live\""));
  json news = ask({{"from", 0}});
  EXPECT_TRUE(news["there"].get<bool>());
  EXPECT_FALSE(news.contains("row"));
  std::ofstream(path, std::ios::app) << record_row(m, 1) << record_row(m, 2) << "0.03,7";
  news = ask(news["next"]);
  EXPECT_EQ(news["rows"], 2);
  EXPECT_EQ(news["unfinished"], 6);
  EXPECT_NEAR(news["row"]["time_s"].get<double>(), 0.02, 1e-9);
  EXPECT_NEAR(news["row"]["pose"][0].get<double>(), 0.2, 1e-4);
  EXPECT_EQ(news["row"]["line"], 7);
  EXPECT_LT(news["row"]["deviation_um"].get<double>(), 1) << "six decimals of the joints";
  EXPECT_TRUE(news["row"]["violations"].empty());
  ASSERT_GT(news["scene"]["lines"].size(), 3U);
  EXPECT_EQ(news["scene"]["lines"].back()["name"], "path of the tip");
  EXPECT_EQ(news["scene"]["lines"].back()["points"].get<std::string>().size(), 32U) << "two points";
  EXPECT_THAT(news["scene"].dump(),
              ::testing::Not(HasSubstr("\"colour\":\"vermillion\",\"dots\":false,\"layer\":\"legs")));
  // Two look at once: each goes on from where it is.
  EXPECT_EQ(ask({{"from", 0}})["rows"], 2);
  EXPECT_EQ(ask(news["next"])["rows"], 0);
  std::ofstream(path, std::ios::app) << ",";
  EXPECT_EQ(ask(news["next"])["rows"], 0);
  // A joint beyond its limit is named; and begun anew.
  std::ofstream(path) << kRecordHead << record_row(m, 1, 90.2);
  news = ask(news["next"]);
  EXPECT_TRUE(news["anew"].get<bool>());
  EXPECT_FALSE(news["row"]["violations"].empty()) << news["row"];
  EXPECT_THAT(news["scene"].dump(), HasSubstr("vermillion"));
  std::filesystem::remove(path);
  news = ask(news["next"]);
  EXPECT_FALSE(news["there"].get<bool>());
  std::ofstream(path) << "time_s,x_mm\n0,1\n";
  EXPECT_THAT(ask({{"from", 0}})["error"].get<std::string>(), HasSubstr("LC120"));
}

TEST(Site, BearsAnyQuestionAboutRows) {
  const machine::AnyMachine m = *machine::load("hexapod-strut");
  const std::string path = written("any.csv", kRecordHead + record_row(m, 1) + record_row(m, 2));
  const Site site = site_of({path, "hexapod-strut"});
  EXPECT_EQ(site.answer(get("/0/rows"), kPort).status, 405);
  EXPECT_EQ(site.answer(post("/1/rows", {{"from", 0}}), kPort).status, 404) << "a machine has no rows";
  EXPECT_EQ(site.answer(get("/1/live"), kPort).status, 404);
  EXPECT_EQ(site.answer(post("/0/live", {}), kPort).status, 404);
  EXPECT_EQ(site.answer(post("/0/pose", {{"pose", {0, 0, 75, 0, 0, 0}}}), kPort).status, 404);
  Request foreign = post("/0/rows", {{"from", 0}});
  foreign.origin = "http://evil.example";
  EXPECT_EQ(site.answer(foreign, kPort).status, 403);
  for (const char* body :
       {"", "[]", "{}", "{\"from\":-1}", "{\"from\":0.5}", "{\"from\":1e300}", "{\"from\":\"0\"}", "{\"from\":null}",
        "{\"from\":0,\"file\":1}", "{\"from\":0,\"time_s\":\"x\"}", "{\"from\":18446744073709551616}"}) {
    const Response r = site.answer({"POST", "/0/rows", "127.0.0.1:4711", "", body}, kPort);
    EXPECT_EQ(r.status, 200);
    EXPECT_THAT(json::parse(r.body).value("error", ""), HasSubstr("VW120")) << body << r.body;
  }
  answers_damaged(site, "/0/rows", R"({"from":140,"file":"2049-131","time_s":0.01})");
}

}  // namespace
}  // namespace polypod::viewer
