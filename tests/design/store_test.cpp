// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/design/store.hpp"

#include <sqlite3.h>
#include <sys/resource.h>

#include <csignal>
#include <fstream>

#include "studies.hpp"

namespace polypod::design {
namespace {

const std::string kText = std::string("machine = \"strut\"\n") + kQuick;

Result<Store> opened(const std::string& folder, const std::string& more = "", const char* version = "1.0") {
  const Study s = study_on_strut(more + kQuick);
  return Store::open(folder, s, kText, version);
}

Row row_of(std::int64_t number) {
  Row row;
  row.row = number;
  row.varied = {10 + 0.1 * static_cast<double>(number), 1.0 / 3};
  row.phase = Phase::refine;
  row.version = "1.0";
  Evaluation& e = row.evaluation;
  e.state = State::done;
  e.figures.resize(1);
  e.figures[0].value = e.figures[0].lower = e.figures[0].upper = 1e6 / 7;
  e.objective.value = 0.1 + 0.2;
  e.objective.lower = 0.25;
  e.objective.upper = 0.35;
  e.violation = 0;
  e.seconds = 0.5;
  return row;
}

TEST(Store, GivesBackWhatItKeepsToTheBit) {
  const Folder folder;
  {
    auto store = opened(folder / "a");
    ASSERT_TRUE(store) << to_string(store.error());
    ASSERT_TRUE(store->add(row_of(1)));
    Row none = row_of(2);
    none.evaluation = Evaluation{};
    none.evaluation.figures.resize(1);
    none.evaluation.reason = "no machine: \"quoted\"; line\nbreak";
    ASSERT_TRUE(store->add(none));
    ASSERT_TRUE(store->set_complete(true));
    ASSERT_TRUE(store->close());
  }
  const auto store = Store::read(folder / "a");
  ASSERT_TRUE(store) << to_string(store.error());
  EXPECT_EQ(store->study().vary.size(), 2U);
  EXPECT_EQ(store->study().identity(), study_on_strut(kQuick).identity());
  EXPECT_TRUE(*store->complete());
  const auto rows = store->rows();
  ASSERT_TRUE(rows);
  ASSERT_EQ(rows->size(), 2U);
  const Row want = row_of(1), &got = (*rows)[0];
  EXPECT_EQ(got.varied, want.varied);
  EXPECT_EQ(got.evaluation.objective.value, want.evaluation.objective.value);
  EXPECT_EQ(got.evaluation.objective.upper, want.evaluation.objective.upper);
  EXPECT_EQ(got.evaluation.figures[0].value, want.evaluation.figures[0].value);
  EXPECT_EQ(got.evaluation.state, State::done);
  EXPECT_EQ(got.phase, Phase::refine);
  EXPECT_EQ((*rows)[1].evaluation.state, State::refused);
  EXPECT_TRUE(std::isnan((*rows)[1].evaluation.figures[0].value));
  EXPECT_TRUE(std::isinf((*rows)[1].evaluation.violation));
  EXPECT_NE((*rows)[1].evaluation.reason.find("line\nbreak"), std::string::npos);
  // One file, and the lock.
  int files = 0;
  for (const auto& entry : std::filesystem::directory_iterator(folder / "a")) files += entry.is_regular_file() ? 1 : 0;
  EXPECT_EQ(files, 2);
}

/// A program that looks at the rows and does not close the database: the answer is given all the same.
TEST(Store, ClosesWhileAnotherProgramHasItOpen) {
  const Folder folder;
  sqlite3* other = nullptr;
  for (const std::int64_t number : {1, 2}) {
    auto store = opened(folder / "a");
    ASSERT_TRUE(store) << to_string(store.error());
    ASSERT_TRUE(store->add(row_of(number)));
    if (other == nullptr) {
      ASSERT_EQ(sqlite3_open((folder / "a/study.sqlite").c_str(), &other), SQLITE_OK);
    }
    ASSERT_EQ(sqlite3_exec(other, "SELECT count(*) FROM evaluation", nullptr, nullptr, nullptr), SQLITE_OK);
    const auto closed = store->close();
    EXPECT_TRUE(closed) << to_string(closed.error());
  }
  EXPECT_EQ(Store::read(folder / "a")->rows()->size(), 2U);
  sqlite3_close(other);
}

TEST(Store, RefusesAnotherStudyAnotherVersionAndASecondProcess) {
  const Folder folder;
  {
    const auto first = opened(folder / "a");
    ASSERT_TRUE(first);
    const auto second = opened(folder / "a");
    ASSERT_FALSE(second);
    EXPECT_EQ(second.error().id, "OP114");
    EXPECT_TRUE(Store::read(folder / "a"));  // reading may go on
  }
  EXPECT_TRUE(opened(folder / "a"));
  const auto other = opened(folder / "a", "seed = 2\n");
  ASSERT_FALSE(other);
  EXPECT_EQ(other.error().id, "OP112");
  EXPECT_NE(other.error().message.find("\"seed 1\" where this study has \"seed 2\""), std::string::npos)
      << other.error().message;
  const auto newer = opened(folder / "a", "", "1.1");
  ASSERT_FALSE(newer);
  EXPECT_EQ(newer.error().id, "OP113");
  EXPECT_TRUE(opened(folder / "a", ""));
}

TEST(Store, RefusesWhatIsNoDatabaseOfAStudy) {
  const Folder folder;
  std::filesystem::create_directories(folder / "text");
  std::ofstream(folder / "text/study.sqlite") << std::string(5000, 'x');
  const auto text = opened(folder / "text");
  ASSERT_FALSE(text);
  EXPECT_EQ(text.error().id, "OP111") << to_string(text.error());
  EXPECT_EQ(Store::read(folder / "text").error().id, "OP111");
  std::filesystem::create_directories(folder / "other");
  sqlite3* db = nullptr;
  ASSERT_EQ(sqlite3_open((folder / "other/study.sqlite").c_str(), &db), SQLITE_OK);
  ASSERT_EQ(sqlite3_exec(db, "CREATE TABLE mine (x)", nullptr, nullptr, nullptr), SQLITE_OK);
  sqlite3_close(db);
  EXPECT_EQ(opened(folder / "other").error().id, "OP111");
  EXPECT_EQ(Store::read(folder / "nothing").error().id, "OP116");
  std::ofstream(folder / "file") << "x";
  EXPECT_EQ(opened(folder / "file").error().id, "OP110");
}

TEST(Store, AFullDiskIsAnErrorAndWhatWasStoredStays) {
  const Folder folder;
  std::int64_t stored = 0;
  {
    auto store = opened(folder / "a");
    ASSERT_TRUE(store);
    rlimit before{};
    ASSERT_EQ(getrlimit(RLIMIT_FSIZE, &before), 0);
    rlimit small = before;
    small.rlim_cur = 200'000;
    auto* const old = std::signal(SIGXFSZ, SIG_IGN);
    ASSERT_EQ(setrlimit(RLIMIT_FSIZE, &small), 0);
    Status status;
    while (status && stored < 5000) {
      status = store->add(row_of(stored + 1));
      if (status) ++stored;
    }
    setrlimit(RLIMIT_FSIZE, &before);
    std::signal(SIGXFSZ, old);
    ASSERT_FALSE(status);
    EXPECT_EQ(status.error().id, "OP115") << to_string(status.error());
  }
  const auto store = Store::read(folder / "a");
  ASSERT_TRUE(store) << to_string(store.error());
  const auto rows = store->rows();
  ASSERT_TRUE(rows);
  EXPECT_EQ(static_cast<std::int64_t>(rows->size()), stored);
  EXPECT_GT(stored, 10);
}

}  // namespace
}  // namespace polypod::design
