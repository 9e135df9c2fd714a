// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/core/files.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <unistd.h>

#include <csignal>
#include <filesystem>

namespace polypod::files {
namespace {

namespace fs = std::filesystem;
using ::testing::HasSubstr;

class Files : public ::testing::Test {
 protected:
  void SetUp() override {
    folder_ = fs::temp_directory_path() / (std::string("polypod-files-") + std::to_string(::getpid()) + "-" +
                                           ::testing::UnitTest::GetInstance()->current_test_info()->name());
    fs::remove_all(folder_);
    ASSERT_TRUE(fs::create_directory(folder_));
  }
  void TearDown() override { fs::remove_all(folder_); }

  [[nodiscard]] std::string path(const char* name) const { return (folder_ / name).string(); }
  [[nodiscard]] long entries() const {
    return std::distance(fs::directory_iterator(folder_), fs::directory_iterator{});
  }

 private:
  fs::path folder_;
};

TEST_F(Files, WhatIsWrittenIsRead) {
  const std::string bytes("a\0b\r\n\xff", 6);
  ASSERT_TRUE(write_whole(path("f"), bytes));
  EXPECT_EQ(*read(path("f")), bytes);
  ASSERT_TRUE(write_whole(path("f"), "")) << "an empty file is a file";
  EXPECT_EQ(*read(path("f")), "");
  EXPECT_EQ(entries(), 1) << "no temporary file stays";
}

TEST_F(Files, LargerThanABuffer) {
  const std::string bytes(300'000, 'x');
  ASSERT_TRUE(write_whole(path("f"), bytes));
  EXPECT_EQ(*read(path("f")), bytes);
}

TEST_F(Files, ReadNamesWhatIsWrong) {
  const auto missing = read(path("no"));
  ASSERT_FALSE(missing);
  EXPECT_EQ(missing.error().id, "FI100");
  EXPECT_EQ(missing.error().place.file, path("no"));
  EXPECT_THAT(missing.error().message, HasSubstr("No such file"));

  const auto folder = read(path("."));
  ASSERT_FALSE(folder);
  EXPECT_EQ(folder.error().id, "FI100");
  EXPECT_THAT(folder.error().message, HasSubstr("directory"));
}

TEST_F(Files, ADirectoryIsNoOutput) {
  ASSERT_TRUE(fs::create_directory(path("d")));
  const auto status = write_whole(path("d"), "x");
  ASSERT_FALSE(status);
  EXPECT_EQ(status.error().id, "FI101");
  EXPECT_EQ(status.error().place.file, path("d"));
  EXPECT_THAT(status.error().message, HasSubstr("directory"));
  EXPECT_EQ(entries(), 1);
}

TEST_F(Files, NoSuchFolder) {
  const auto status = write_whole(path("no/f"), "x");
  ASSERT_FALSE(status);
  EXPECT_EQ(status.error().id, "FI101");
  EXPECT_THAT(status.error().message, HasSubstr("No such file"));
}

TEST_F(Files, AFullDeviceIsAnError) {
  const auto status = write_whole("/dev/full", "x");
  ASSERT_FALSE(status);
  EXPECT_EQ(status.error().id, "FI101");
  EXPECT_THAT(status.error().message, HasSubstr("No space left"));
}

TEST_F(Files, ADeviceIsWrittenTo) {
  EXPECT_TRUE(write_whole("/dev/null", "x"));
}

TEST_F(Files, AWriteThatBreaksOffLeavesTheOldFile) {
  ASSERT_TRUE(write_whole(path("f"), "old"));
  // A limit on the size of files stands for a disk that fills up half-way.
  struct rlimit before {};
  ASSERT_EQ(::getrlimit(RLIMIT_FSIZE, &before), 0);
  const auto old_handler = std::signal(SIGXFSZ, SIG_IGN);
  struct rlimit small = before;
  small.rlim_cur = 1000;
  ASSERT_EQ(::setrlimit(RLIMIT_FSIZE, &small), 0);
  const auto status = write_whole(path("f"), std::string(5000, 'x'));
  ASSERT_EQ(::setrlimit(RLIMIT_FSIZE, &before), 0);
  std::signal(SIGXFSZ, old_handler);

  ASSERT_FALSE(status);
  EXPECT_EQ(status.error().id, "FI101");
  EXPECT_EQ(*read(path("f")), "old");
  EXPECT_EQ(entries(), 1) << "no temporary file stays";
}

}  // namespace
}  // namespace polypod::files
