// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// What a certificate says, against figures computed by hand.
#include "polypod/calibration/certificate.hpp"

#include <gmock/gmock.h>

#include <filesystem>
#include <fstream>

#include "polypod/core/units.hpp"

namespace polypod::calibration {
namespace {

using units::from_mm;

// FIPS 180-4 and NIST's examples (SHA_All.pdf).
TEST(Sha256, GivesThePublishedDigests) {
  EXPECT_EQ(sha256(""), "e3b0c44298fc1c149afbf4c8996fb92427ae41e4649b934ca495991b7852b855");
  EXPECT_EQ(sha256("abc"), "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad");
  EXPECT_EQ(sha256("abcdbcdecdefdefgefghfghighijhijkijkljklmklmnlmnomnopnopq"),
            "248d6a61d20638b8e5c026930c3e6039a33ce45964ff2167f6ecedd419db06c1");
  EXPECT_EQ(sha256(std::string(1000000, 'a')), "cdc76e5c9914fb9281a1c7e284d73e67f1809a48a497200e046d39ccc7112cd0");
}

class StatementFile : public testing::Test {
 protected:
  Result<Statement> read(const std::string& text) {
    const auto path = std::filesystem::temp_directory_path() /
                      ("polypod_statement_" + std::to_string(::testing::UnitTest::GetInstance()->random_seed()) +
                       std::to_string(std::hash<std::string>{}(text)) + ".toml");
    std::ofstream(path) << text;
    auto out = read_statement(path.string());
    std::filesystem::remove(path);
    return out;
  }
  std::string id_of(const std::string& text) {
    const auto s = read(text);
    return s ? "none" : s.error().id;
  }
};

TEST_F(StatementFile, HoldsWhoWhatAndWhen) {
  const auto s = read(R"(
    number = "2026-017"
    date = "2026-02-28"
    operator = "A. Person"
    remarks = ["one", "two"]
    [machine]
    serial = "M-1"
    [instrument]
    name = "tracker"
    traceability = "certificate 7"
    [temperature]
    mean_C = 20.4
    min_C = 19.9
    max_C = 20.8
    [[systematic]]
    quantity = "scale"
    half_width_um_per_m = 5
  )");
  ASSERT_TRUE(s) << to_string(s.error());
  EXPECT_EQ(s->operator_name, "A. Person");
  EXPECT_EQ(s->machine_serial, "M-1");
  EXPECT_EQ(s->traceability, "certificate 7");
  EXPECT_EQ(s->temperature_max, 20.8);
  EXPECT_EQ(s->remarks.size(), 2U);
  EXPECT_EQ(s->systematic.size(), 1U);
  EXPECT_EQ(id_of("date = \"2026-02-30\""), "CA152");
  EXPECT_EQ(id_of("date = \"1 May 2026\""), "CA152");
  EXPECT_EQ(id_of("[temperature]\nmean_C = 20\nmin_C = 21"), "CA152");
  EXPECT_EQ(id_of("operater = \"x\""), "CF103");
  EXPECT_EQ(id_of("[machine]\nserial_number = \"x\""), "CF103");
}

/// Rows of points at these places of lola50, and a calibration that holds residuals only.
struct Made {
  AnyMachine machine = *machine::load("delta-linear");
  std::vector<Measurement> rows;
  Calibration c;

  void add(const JointVector& q, const Vec3& before_mm, const Vec3& after_mm, Kind kind = Kind::point) {
    Measurement row;
    row.kind = kind;
    row.q = q;
    rows.push_back(row);
    RowResidual r;
    r.row = rows.size() - 1;
    r.before = from_mm(1) * before_mm;
    r.after = from_mm(1) * after_mm;
    r.lengths = 3;
    c.residuals.push_back(r);
  }
};

// Five cycles; measured less commanded (1, 0, 0) mm on the mean, 0.03 and 0.04 mm beside it along y and z.
TEST(PoseAccuracy, IsThatOfIso9283) {
  Made m;
  const std::vector<Stand> stands = random_stands(m.machine, 2, 3);
  for (const double d : {-1.0, -0.5, 0.0, 0.5, 1.0}) m.add(stands[0].q, {-1, -0.03 * d, -0.04 * d}, {0.1, 0, 0});
  for (int i = 0; i < 4; ++i) m.add(stands[1].q, {1, 0, 0}, {1, 0, 0});  // too few
  const auto found = pose_accuracy(m.machine, m.rows, m.c);
  ASSERT_EQ(found.size(), 1U);
  EXPECT_EQ(found[0].cycles, 5U);
  EXPECT_NEAR(found[0].accuracy, 1e-3, 1e-12);
  EXPECT_NEAR(found[0].accuracy_after, 0.1e-3, 1e-12);
  // Distances from the barycentre 0.05 (1, 0.5, 0, 0.5, 1): mean 0.03, S = 0.05 sqrt(0.7 / 4) = 0.0209165 mm.
  EXPECT_NEAR(found[0].repeatability, 0.03e-3 + 3 * 0.0209165e-3, 1e-9);
  EXPECT_LT((found[0].command - stands[0].X_MT.p).norm(), 1e-9);
}

TEST(LengthErrors, AreTheLargestOfTheDistances) {
  Made m;
  const std::vector<Stand> stands = random_stands(m.machine, 3, 3);
  EXPECT_FALSE(length_errors(m.rows, m.c));
  for (int i = 0; i < 3; ++i) {
    m.add(stands[std::size_t(i)].q, {}, {}, Kind::distance);
    m.rows.back().reading = 0.1 * (i + 1);
    m.c.residuals.back().before = Eigen::VectorXd::Constant(1, 1e-3 * (i - 2));
    m.c.residuals.back().after = Eigen::VectorXd::Constant(1, 1e-5 * i);
    m.c.residuals.back().lengths = 1;
  }
  const auto found = length_errors(m.rows, m.c);
  ASSERT_TRUE(found);
  EXPECT_EQ(found->lengths, 3U);
  EXPECT_NEAR(found->shortest, 0.1, 1e-12);
  EXPECT_NEAR(found->longest, 0.3, 1e-12);
  EXPECT_NEAR(found->error_before, 2e-3, 1e-12);
  EXPECT_NEAR(found->error_after, 2e-5, 1e-12);
}

// t of 95 %: 3.182 with 3 degrees of freedom, 2.101 with 18.
TEST(Budget, FewDegreesOfFreedomAskForALargerFactor) {
  Made m;
  const auto n = static_cast<Eigen::Index>(kinematics::parameters(m.machine).size());
  m.c.covariance = m.c.covariance_readings = 1e-10 * Eigen::MatrixXd::Identity(n, n);
  m.c.covariance_drawing = Eigen::MatrixXd::Zero(n, n);
  const Stand stand = random_stands(m.machine, 1, 3).front();
  for (const auto& [degrees, k95] : {std::pair{3.0, 3.182}, {18.0, 2.101}}) {
    m.c.free_equations = degrees;
    const Budget budget = budget_at(m.machine, m.c, {}, stand);
    for (const double k : budget.k95) EXPECT_NEAR(k, k95, 1e-3);
  }
}

// Six places 20 mm apart along x, then one off the line; along the line the residuals go from -0.05 to 0.02 mm.
TEST(LineErrors, AreTheRangeAlongTheLine) {
  Made m;
  const std::vector<Stand> stands = random_stands(m.machine, 40, 3);
  Vec3 middle = Vec3::Zero();
  for (const Stand& s : stands) middle += s.X_MT.p / double(stands.size());
  const std::vector<double> along{0.02, 0.01, 0, -0.05, 0.01, 0.015};
  for (int i = 0; i < 7; ++i) {
    const Vec3 p = middle + from_mm(1) * Vec3(20 * i - 50, i == 6 ? 3 : 0, 0);
    const auto inverse = kinematics::inverse(m.machine, Pose{Mat3::Identity(), p});
    ASSERT_NE(inverse.reachable(), nullptr);
    m.add(inverse.reachable()->joints, {i < 6 ? along[std::size_t(i)] : 5.0, 1, 1}, {0.001 * i, 0, 0});
  }
  const auto found = line_errors(m.machine, m.rows, m.c);
  ASSERT_EQ(found.size(), 1U);
  EXPECT_EQ(found[0].points, 6U);
  EXPECT_NEAR(found[0].error_before, 0.07e-3, 1e-9);
  EXPECT_NEAR(found[0].error_after, 0.005e-3, 1e-9);
  EXPECT_NEAR((found[0].to - found[0].from).norm(), 0.1, 1e-6);
}

}  // namespace
}  // namespace polypod::calibration
