// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include <gmock/gmock.h>

#include "parts.hpp"

namespace polypod {
namespace {

using post::StepKind;
using test::id_of;
using test::value;

post::Path read(const std::string& text) {
  return value(post::parse_cl(text, "t.cl"));
}

TEST(Cl, ReadsPointsAxesFeedsAndWhatIsInForce) {
  const post::Path path = read(
      "partno/shaft\nUNITS/MM\nMULTAX/ON\nLOADTL/3,LENGTH,80\nSPINDL/RPM,1200,CCLW\nCOOLNT/MIST\n"
      "FROM/0,0,50\nRAPID\nGOTO/ 10.0, -2.5E1, +3. , $ the axis follows\n  0.6,0,.8\nFEDRAT/600.,MMPM $$ a cut\n"
      "GODLTA/0,0,-10\nGODLTA/-1\nDELAY/0.5\nSTOP\nOPSTOP\nSPINDL/OFF\nFINI\n");
  ASSERT_EQ(path.steps.size(), 8u);
  EXPECT_EQ(path.steps[0].kind, StepKind::comment);
  EXPECT_EQ(path.steps[0].text, "PARTNO shaft");
  const post::Step& rapid = path.steps[2];
  EXPECT_EQ(rapid.kind, StepKind::rapid);
  EXPECT_TRUE(rapid.tip.isApprox(Vec3(0.010, -0.025, 0.003), 1e-15));
  EXPECT_TRUE(rapid.axis.isApprox(Vec3(0.6, 0, 0.8), 1e-15));
  EXPECT_EQ(rapid.line, 9);
  EXPECT_EQ(rapid.tool, 3);
  EXPECT_EQ(rapid.spindle, gcode::Spindle::counterclockwise);
  EXPECT_DOUBLE_EQ(rapid.spindle_speed, 20);
  EXPECT_EQ(rapid.coolant, post::Coolant::mist);
  const post::Step& cut = path.steps[3];
  EXPECT_EQ(cut.kind, StepKind::line);
  EXPECT_DOUBLE_EQ(cut.feed, 0.01);
  EXPECT_TRUE(cut.tip.isApprox(Vec3(0.010, -0.025, -0.007), 1e-12));
  EXPECT_TRUE(path.steps[4].tip.isApprox(cut.tip - 1e-3 * cut.axis, 1e-12)) << "one number goes along the tool axis";
  EXPECT_DOUBLE_EQ(path.steps[5].seconds, 0.5);
  EXPECT_EQ(path.steps[6].kind, StepKind::stop);
  EXPECT_EQ(path.steps[7].kind, StepKind::optional_stop);
}

TEST(Cl, InchesFeedsPerRevolutionAndTheirUnits) {
  const post::Path path =
      read("UNITS/INCHES\nSPINDL/1500,CLW\nFEDRAT/0.004,IPR\nGOTO/1,2,3\nFEDRAT/254,MMPM\nGOTO/1,2,4\nFINI\n");
  EXPECT_TRUE(path.steps[0].tip.isApprox(Vec3(0.0254, 0.0508, 0.0762), 1e-14));
  EXPECT_NEAR(path.steps[0].feed, 0.004 * 0.0254 * 25, 1e-15);
  EXPECT_NEAR(path.steps[1].feed, 0.254 / 60, 1e-15);
  EXPECT_EQ(id_of(post::parse_cl("FEDRAT/10,IPM\nGOTO/1,2,3\n", "t")), "PO107") << "inches without UNITS";
  EXPECT_EQ(id_of(post::parse_cl("UNITS/MM\nRAPID\nGOTO/1,2,3\nUNITS/INCHES\n", "t")), "PO107");
  EXPECT_THAT(read("RAPID\nGOTO/1,2,3\nFINI\n").notes, ::testing::Contains(::testing::HasSubstr("taken as mm")));
}

TEST(Cl, ASpindleWithoutADirectionTurnsClockwiseAndANoteSaysSo) {
  using ::testing::Contains, ::testing::HasSubstr, ::testing::Not;
  const post::Path path = read("UNITS/MM\nSPINDL/5000\nRAPID\nGOTO/1,2,3\nFINI\n");
  EXPECT_EQ(path.steps[0].spindle, gcode::Spindle::clockwise);
  EXPECT_THAT(path.notes, Contains(HasSubstr("line 2: SPINDL without CLW or CCLW turns clockwise (M3)")));
  // Another speed of a spindle that turns needs none.
  for (const char* text : {"UNITS/MM\nSPINDL/5000,CCLW\nRAPID\nGOTO/1,2,3\nSPINDL/6000\nRAPID\nGOTO/1,2,4\nFINI\n",
                           "UNITS/MM\nSPINDL/OFF\nRAPID\nGOTO/1,2,3\nFINI\n"})
    EXPECT_THAT(read(text).notes, Not(Contains(HasSubstr("SPINDL")))) << text;
}

TEST(Cl, ArcsTurnCounterclockwiseAboutTheirAxis) {
  const std::string head = "UNITS/MM\nFROM/10,0,0\nFEDRAT/100\nCIRCLE/0,0,0,0,0,";
  const post::Path ccw = read(head + "1,10\nGOTO/0,10,0\nFINI\n"), cw = read(head + "-1,10\nGOTO/0,10,0\nFINI\n"),
                   full = read(head + "1,10\nGOTO/10,0,-2\nFINI\n");
  EXPECT_NEAR(ccw.steps[1].sweep, std::numbers::pi / 2, 1e-12);
  EXPECT_NEAR(cw.steps[1].sweep, 1.5 * std::numbers::pi, 1e-12);
  EXPECT_NEAR(full.steps[1].sweep, 2 * std::numbers::pi, 1e-12);
  EXPECT_EQ(id_of(post::parse_cl(head + "1,10\nGOTO/0,10.5,0\n", "t")), "PO110") << "off the radius";
  EXPECT_EQ(id_of(post::parse_cl(head + "1,10\nFINI\n", "t")), "PO110") << "no end";
}

// TLON,GOFWD/(CIRCLE/centre,r),ON[,2,INTOF],(LINE/centre,end) with the direction of INDIRV, square to the tool.
TEST(Cl, ArcsAsCatiaWritesThem) {
  const std::string head = "UNITS/MM\nFROM/30,20,-1\nFEDRAT/100\nAUTOPS\nINDIRV/0.00000,1.00000,0.00000\n",
                    circle = "TLON,GOFWD/ (CIRCLE/ 20.00000, 20.00000, -1.00000,$\n 10.00000),ON",
                    line = "(LINE/ 20.00000, 20.00000, -1.00000,$\n ";
  const post::Path quarter = read(head + circle + "," + line + "20.0, 30.0, -1.0)\nFINI\n");
  ASSERT_EQ(quarter.steps.size(), 2u);
  const post::Step& arc = quarter.steps[1];
  EXPECT_EQ(arc.kind, StepKind::arc);
  EXPECT_NEAR(arc.sweep, std::numbers::pi / 2, 1e-12);
  EXPECT_TRUE(arc.normal.isApprox(Vec3(0, 0, 1), 1e-12));
  EXPECT_TRUE(arc.centre.isApprox(Vec3(0.020, 0.020, -0.001), 1e-12));
  EXPECT_TRUE(arc.tip.isApprox(Vec3(0.020, 0.030, -0.001), 1e-12));
  const post::Path three = read(head + circle + ",2,INTOF,$\n" + line + "20.0, 10.0, -1.0)\nFINI\n");
  EXPECT_NEAR(three.steps[1].sweep, 1.5 * std::numbers::pi, 1e-12);
  const post::Path full = read(head + circle + ",2,INTOF," + line + "30.0, 20.0, -1.0)\nFINI\n");
  EXPECT_NEAR(full.steps[1].sweep, 2 * std::numbers::pi, 1e-12);
  for (const char* half : {"", ",2,INTOF"}) {  // half a turn is both
    const post::Path path = read(head + circle + half + "," + line + "10.0, 20.0, -1.0)\nFINI\n");
    EXPECT_NEAR(path.steps[1].sweep, std::numbers::pi, 1e-12) << half;
  }
  // Clockwise, about a tool that leans.
  const post::Path leans = read(
      "UNITS/MM\nMULTAX/ON\nFROM/10,0,0,0,0.6,0.8\nFEDRAT/100\nINDIRV/0,-0.8,0.6\nTLON,GOFWD/(CIRCLE/0,0,0,10),ON,"
      "(LINE/0,0,0,-10,0,0)\nFINI\n");
  EXPECT_TRUE(leans.steps[1].normal.isApprox(Vec3(0, -0.6, -0.8), 1e-12));
  const std::string quarter_end = "," + line + "20.0, 30.0, -1.0)\n";
  for (const std::string& bad : {
           head + circle + ",2,INTOF" + quarter_end,                        // the first, called the second
           head + circle + "," + line + "20.0, 10.0, -1.0)\n",              // the second, called the first
           head + circle + ",2" + quarter_end,                              // neither
           head + "INDIRV/1,0,0\n" + circle + quarter_end,                  // not along the circle
           head + "INDIRV/0,0.8,0.6\n" + circle + quarter_end,              // not square to the tool
           head + circle + ",(LINE/ 0,0,0, 20.0, 30.0, -1.0)\n",            // the line of another centre
           head + "TLON,GOFWD/(CIRCLE/20,20,-1,0),ON" + quarter_end,        // no radius
           "UNITS/MM\nFROM/30,20,-1\nFEDRAT/100\n" + circle + quarter_end,  // no direction
           head + circle + quarter_end + circle + quarter_end,              // one direction, two arcs
           "UNITS/MM\nFEDRAT/100\nINDIRV/0,1,0\n" + circle + quarter_end,   // from nowhere
       })
    EXPECT_EQ(id_of(post::parse_cl(bad, "t")), "PO110") << bad;
}

/// Operations of NX that lie in different systems would be cut in one place.
TEST(Cl, OneSystemOfCoordinatesAFile) {
  const std::string one = "MSYS/0,0,0,1,0,0,0,1,0\nRAPID\nGOTO/0,0,50\n", other = "MSYS/100,20,0,0,1,0,-1,0,0\n";
  EXPECT_EQ(read("UNITS/MM\n" + one + one + "FINI\n").steps.size(), 2u);
  EXPECT_EQ(id_of(post::parse_cl("UNITS/MM\n" + one + other + "GOTO/0,0,0\n", "t")), "PO105");
  EXPECT_THAT(read("UNITS/MM\n" + other + "RAPID\nGOTO/0,0,50\n" + other + "RAPID\nGOTO/0,0,60\nFINI\n").notes,
              ::testing::Contains(::testing::HasSubstr("MSYS tells where the coordinates lie")));
}

TEST(Cl, DrillsAlongTheToolAxis) {
  const post::Path path = read(
      "UNITS/MM\nMULTAX/ON\nRAPID\nGOTO/0,0,50,0.6,0,0.8\nCYCLE/DRILL,DEPTH,10,MMPM,120,CLEAR,2\n"
      "GOTO/10,0,0\nGOTO/20,0,0\nCYCLE/OFF\nRAPID\nGOTO/0,0,50\nFINI\n");
  ASSERT_EQ(path.steps.size(), 10u);
  const Vec3 k(0.6, 0, 0.8), hole(0.010, 0, 0), start(0, 0, 0.050);
  EXPECT_NEAR((path.steps[1].tip - start).dot(k), 0, 1e-12) << "across first";
  EXPECT_TRUE(path.steps[2].tip.isApprox(hole + 0.002 * k, 1e-12));
  EXPECT_EQ(path.steps[3].kind, StepKind::line);
  EXPECT_TRUE(path.steps[3].tip.isApprox(hole - 0.010 * k, 1e-12));
  EXPECT_DOUBLE_EQ(path.steps[3].feed, 0.002);
  EXPECT_EQ(path.steps[4].kind, StepKind::rapid);
  EXPECT_TRUE((path.steps[5].tip - path.steps[4].tip).cross(k).norm() < 1e-12) << "up first";
}

/// GODLTA counts from the last point of the program, which is the hole, not the place above it.
TEST(Cl, StepsInACycleCountFromTheHole) {
  const post::Path path = read(
      "UNITS/MM\nFROM/0,0,50\nRAPID\nGOTO/0,0,10\nCYCLE/DRILL,DEPTH,8,MMPM,120,CLEAR,2\nGOTO/0,0,0\nGODLTA/10,0,0\n"
      "GODLTA/10,0,-1\nCYCLE/OFF\nRAPID\nGODLTA/0,0,20\nFINI\n");
  ASSERT_EQ(path.steps.size(), 13u);
  EXPECT_TRUE(path.steps[6].tip.isApprox(Vec3(0.010, 0, -0.008), 1e-12));
  EXPECT_TRUE(path.steps[10].tip.isApprox(Vec3(0.020, 0, -0.009), 1e-12));
  EXPECT_TRUE(path.steps[12].tip.isApprox(Vec3(0.020, 0, 0.019), 1e-12));
}

TEST(Cl, NormalisesAnAxisAndRefusesWhatIsNone) {
  EXPECT_NEAR(read("UNITS/MM\nRAPID\nGOTO/0,0,0,0.7071,0,0.7071\nFINI\n").steps[0].axis.norm(), 1, 1e-15);
  EXPECT_EQ(id_of(post::parse_cl("UNITS/MM\nRAPID\nGOTO/0,0,0,0.5,0,0.5\n", "t")), "PO106");
  EXPECT_EQ(id_of(post::parse_cl("UNITS/MM\nRAPID\nGOTO/0,0,0,0,0,0\n", "t")), "PO106");
}

/// Each kind of bad input has an id, the line and a hint.
TEST(Cl, RefusesBadInputWithItsPlace) {
  const std::vector<std::tuple<std::string, std::string, int>> bad{
      {"UNITS/MM\nP1 = POINT/0,0,0\n", "PO101", 2},
      {"UNITS/MM\nGOTO/1,,3\n", "PO101", 2},
      {"UNITS/MM\nRAPID\nGOTO/1,2,3,$\n", "PO101", 3},
      {"UNITS/MM\nRAPID\nGOTO/1,2,$\n3x\n", "PO102", 4},
      {"UNITS/MM\nRAPID\nGOTO/1,2,1E99\n", "PO102", 3},
      {"UNITS/MM\nRAPID\nGOTO/1,2\n", "PO103", 3},
      {"UNITS/MM\nSPLASH/1,2\n", "PO104", 2},
      {"UNITS/MM\nCYCLE/TAP,DEPTH,10\n", "PO105", 2},
      {"UNITS/MM\nSPINDL/RPM,1000,CLW\nFROM/0,0,9\nFEDRAT/0.1,MMPR\nGOTO/0,0,0\nSPINDL/OFF\nGOTO/9,0,0\n", "PO108", 7},
      {"UNITS/MM\nTRANS/1,2,3\n", "PO105", 2},
      {"UNITS/MM\nCYCLE/DRILL,FEDTO,10,MMPM,50,CLEAR,2\n", "PO105", 2},
      {"UNITS/MM\nFROM/0,0,9\nCYCLE/DRILL,DEPTH,8,MMPM,50,CLEAR,2\nGOTO/0,0,0\nGOHOME\n", "PO105", 5},
      {"UNITS/MM\nINSERT G10 L2\n", "PO105", 2},
      {"UNITS/MM\nAUXFUN/8\n", "PO105", 2},
      {"UNITS/MM\nPREFUN/55\n", "PO105", 2},
      // Creo's arc of two points: the second is none of a line.
      {"UNITS/MM\nFEDRAT/100,MMPM\nGOTO/20,0,0\nCIRCLE/0,0,0,0,0,1,20\nGOTO/0,20,0\nGOTO/-20,0,0\n", "PO110", 6},
      {"UNITS/FEET\n", "PO107", 1},
      {"UNITS/MM\nGOTO/1,2,3\n", "PO108", 2},
      {"UNITS/MM\nFEDRAT/0.1,MMPR\nFROM/0,0,9\nGOTO/0,0,0\n", "PO108", 4},
      {"UNITS/MM\nSPINDL/CLW\n", "PO109", 2},
      {"UNITS/MM\nSPINDL/100,SFM\n", "PO109", 2},
      {"UNITS/MM\nMULTAX/OFF\nRAPID\nGOTO/0,0,0,0.6,0,0.8\n", "PO111", 4},
      {"UNITS/MM\nFINI\n", "PO112", 0},
      {"UNITS/MM\nRAPID\nGODLTA/1,2,3\n", "PO113", 3},
      {"UNITS/MM\nGOHOME\n", "PO113", 2}};
  for (const auto& [text, id, line] : bad) {
    const auto path = post::parse_cl(text, "t.cl");
    ASSERT_FALSE(path) << text;
    EXPECT_EQ(path.error().id, id) << text << to_string(path.error());
    EXPECT_EQ(path.error().place.line, line) << text;
    EXPECT_FALSE(path.error().hint.empty()) << text;
  }
}

TEST(Cl, ReadsTheWordsOfNxCatiaAndCreo) {
  const post::Path path = read(
      "$$-> MFGNO / PART\n$$-> CSYS / 1.0, 0.0, 0.0, 0.0, $\n        0.0, 1.0, 0.0, 0.0, $\n        0.0, 0.0, 1.0, "
      "0.0\n"
      "UNITS/MM\nLOAD/TOOL,4,ZOFF,12\nSPINDL/RPM,1200,CLW\n$$ costs 5 $\nRAPID\nGOTO/1,2,3\nFEDRAT/100,MMPM\n"
      "GOTO/1,2,0\nREWIND/0\nEND\nFINI\n");
  ASSERT_EQ(path.steps.size(), 2u);
  EXPECT_EQ(path.steps[0].kind, StepKind::rapid) << "a remark that ends with $ goes on in Creo's own alone";
  EXPECT_EQ(path.steps[0].tool, 4);
  EXPECT_EQ(path.steps[1].kind, StepKind::line);
  EXPECT_EQ(id_of(post::parse_cl("LOAD/4\nGOTO/1,2,3\nFINI\n", "t.cl")), "PO103");
  EXPECT_EQ(id_of(post::parse_cl("LOAD/TOOL\nGOTO/1,2,3\nFINI\n", "t.cl")), "PO103");
}

/// Creo and CATIA write where their coordinates lie into remarks: a second system that lies elsewhere is refused, as a
/// second MSYS is.
TEST(Cl, RefusesASecondSystemInARemark) {
  const auto creo = [](double x) {
    return fmt::format("$$-> CSYS / 1.0, 0.0, 0.0, {:.1f}, $\n  0.0, 1.0, 0.0, 0.0, $\n  0.0, 0.0, 1.0, 0.0\n", x);
  };
  const auto catia = [](double x) {
    return fmt::format(
        "$$*CATIA0\n$$ Manufacturing Program.1\n$$     1.00000    0.00000    0.00000    {:.5f}\n"
        "$$     0.00000    1.00000    0.00000    0.00000\n$$     0.00000    0.00000    1.00000    0.00000\n",
        x);
  };
  const auto read = [](const std::string& first, const std::string& second) {
    const auto path = post::parse_cl(
        "UNITS/MM\n" + first + "RAPID\nGOTO/1,2,3\nFEDRAT/100,MMPM\n" + second + "GOTO/1,2,0\nFINI\n", "t.cl");
    return path ? std::string() : fmt::format("{}:{}", path.error().id, path.error().place.line);
  };
  EXPECT_EQ(read(creo(0), creo(50)), "PO105:10");
  EXPECT_EQ(read(catia(0), catia(50)), "PO105:14");
  EXPECT_EQ(read(creo(5), creo(5)), "");
  EXPECT_EQ(read(catia(5), catia(5)), "");
  EXPECT_EQ(read(creo(5), "$$ 1 2 3\n"), "");
}

/// NX drills with a retract of its own behind each hole.
TEST(Cl, ACycleRetractsToItsOwnHeight) {
  const post::Path path = read(
      "UNITS/MM\nRAPID\nGOTO/0,0,20\nSELECT/TOOL,2\nCYCLE/DRILL,RAPTO,3,FEDTO,-15,RTRCTO,10,MMPM,250\nGOTO/5,0,0\n"
      "CYCLE/OFF\nFINI\n");
  ASSERT_EQ(path.steps.size(), 5u);
  const double heights[] = {20, 20, 3, -15, 10};
  for (std::size_t i = 0; i < 5; ++i) EXPECT_NEAR(path.steps[i].tip.z(), heights[i] * 1e-3, 1e-12);
  EXPECT_EQ(path.steps[3].kind, StepKind::line);
  EXPECT_EQ(path.steps[4].kind, StepKind::rapid);
  EXPECT_EQ(id_of(post::parse_cl("UNITS/MM\nCYCLE/DRILL,RAPTO,3,FEDTO,-15,RTRCTO,1,MMPM,250\nGOTO/5,0,0\nFINI\n", "t")),
            "PO105");
}

/// A feed per revolution is that of the spindle in each cut, and so is that of a cycle.
TEST(ClFiles, AFeedPerRevolutionFollowsTheSpindle) {
  const auto path = value(post::parse_cl(
      "UNITS/MM\nSPINDL/RPM,1000,CLW\nFROM/0,0,50\nFEDRAT/0.1,MMPR\nGOTO/0,0,2\nSPINDL/RPM,4000,CLW\nGOTO/10,0,2\n"
      "FEDRAT/300,MMPM\nGOTO/20,0,2\nCYCLE/DRILL,DEPTH,5,MMPR,0.2,CLEAR,2\nGOTO/30,0,0\nSPINDL/RPM,500,CLW\nGOTO/"
      "40,0,0\n"
      "CYCLE/OFF\nEND\n",
      "t"));
  std::vector<double> feeds;  // mm/min
  for (const post::Step& s : path.steps)
    if (s.kind == post::StepKind::line) feeds.push_back(units::to_mm_per_min(s.feed));
  ASSERT_EQ(feeds.size(), 5u);
  const double expected[] = {100, 400, 300, 800, 100};
  for (std::size_t i = 0; i < feeds.size(); ++i) EXPECT_NEAR(feeds[i], expected[i], 1e-9) << i;
  for (const std::string& note : path.notes) EXPECT_EQ(note.find("cut off"), std::string::npos) << note;
}

/// The rapid to a hole: across before down, up before across, along the tool axis.
TEST(ClFiles, AHoleIsComeToFromAbove) {
  const auto path = value(post::parse_cl(
      "UNITS/MM\nFROM/0,0,50\nFEDRAT/300,MMPM\nGOTO/0,0,0\nCYCLE/DRILL,DEPTH,10,MMPM,50,CLEAR,3\nGOTO/100,0,-20\n"
      "GOTO/120,0,5\nCYCLE/OFF\nFINI\n",
      "t"));
  std::vector<Vec3> rapids;  // mm
  for (const post::Step& s : path.steps)
    if (s.kind == post::StepKind::rapid) rapids.push_back(s.tip * 1e3);
  const Vec3 expected[] = {{0, 0, 50},  {100, 0, 0}, {100, 0, -17}, {100, 0, -17},
                           {100, 0, 8}, {120, 0, 8}, {120, 0, 8}};
  ASSERT_EQ(rapids.size(), std::size(expected));
  for (std::size_t i = 0; i < rapids.size(); ++i) EXPECT_LT((rapids[i] - expected[i]).norm(), 1e-9) << i;
}

TEST(Cl, TellsItsFilesFromPrograms) {
  for (const char* cl : {"$$ from a CAM system\n", "\n  PARTNO/A\n", "units/mm\n", "GOTO/1,2,3\n"})
    EXPECT_TRUE(post::looks_like_cl(cl)) << cl;
  for (const char* ngc :
       {"%\nG0\n", "(comment)\nG0\n", "G21\n", "N10 G0\n", "; x\n", "O100\n", "o<a> sub\n", "#1=2\n", ""}) {
    EXPECT_FALSE(post::looks_like_cl(ngc)) << ngc;
  }
}

}  // namespace
}  // namespace polypod
