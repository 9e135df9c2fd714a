// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/core/files.hpp"

#include <fcntl.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include <array>
#include <csignal>
#include <filesystem>
#include <fstream>

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

TEST_F(Files, WhatIsTooLargeIsNotRead) {
  ASSERT_TRUE(write_whole(path("f"), "x"));
  fs::resize_file(path("f"), (std::uintmax_t{1} << 30) + 1);  // a hole: it takes no room
  const auto bytes = read(path("f"));
  ASSERT_FALSE(bytes);
  EXPECT_EQ(bytes.error().id, "FI100");
  EXPECT_THAT(bytes.error().message, HasSubstr("more than 1 GiB"));
}

/// Writes "new" over "old" in a process of its own, after `before`; the id of the error, or "" .
template <class Before>
std::string id_of_write_after(const std::string& path, Before before) {
  int ends[2];
  if (::pipe(ends) != 0) return "no pipe";
  const pid_t child = ::fork();
  if (child == 0) {
    before();
    const auto status = write_whole(path, "new");
    const std::string id = status ? "" : status.error().id;
    const bool said = ::write(ends[1], id.data(), id.size()) == static_cast<ssize_t>(id.size());
    ::_exit(said && outputs_appeared() == static_cast<bool>(status) ? 0 : 1);
  }
  ::close(ends[1]);
  std::array<char, 16> id{};
  const ssize_t n = ::read(ends[0], id.data(), id.size());
  ::close(ends[0]);
  int status = 0;
  ::waitpid(child, &status, 0);
  return WIFEXITED(status) && WEXITSTATUS(status) == 0 ? std::string(id.data(), static_cast<std::size_t>(n)) : "ended";
}

TEST_F(Files, AfterASignalNothingBeginsToAppear) {
  std::ofstream(path("f")) << "old";  // not by write_whole, whose outputs count
  const auto is_pending = [] {
    sigset_t one;
    sigemptyset(&one);
    sigaddset(&one, SIGINT);
    ::pthread_sigmask(SIG_BLOCK, &one, nullptr);
    ::kill(::getpid(), SIGINT);
  };
  EXPECT_EQ(id_of_write_after(path("f"), is_pending), "FI103");
  EXPECT_EQ(id_of_write_after(path("f"), [] { close_outputs(); }), "FI103");
  EXPECT_EQ(*read(path("f")), "old");
  EXPECT_EQ(entries(), 1) << "a temporary file stays";
  EXPECT_EQ(id_of_write_after(path("f"), [] {}), "");
  EXPECT_EQ(*read(path("f")), "new");
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

/// What `path` holds, or its error.
std::string held(const std::string& path) {
  const auto bytes = read(path);
  return bytes ? *bytes : bytes.error().message;
}

mode_t mode_of(const std::string& path) {
  struct stat info {};
  EXPECT_EQ(::stat(path.c_str(), &info), 0);
  return info.st_mode & 07777;
}

TEST_F(Files, ModesOfExistingFilesStay) {
  ASSERT_TRUE(write_whole(path("f"), "old"));
  ASSERT_EQ(::chmod(path("f").c_str(), 0640), 0);
  ASSERT_TRUE(write_whole(path("f"), "new"));
  EXPECT_EQ(mode_of(path("f")), 0640u);
  const mode_t mask = ::umask(027);
  const auto fresh = write_whole(path("g"), "x");
  ::umask(mask);
  ASSERT_TRUE(fresh);
  EXPECT_EQ(mode_of(path("g")), 0640u) << "new files follow the umask";
}

TEST_F(Files, LinksAreFollowedAndStay) {
  ASSERT_TRUE(fs::create_directory(path("d")));
  ASSERT_TRUE(write_whole(path("d/f"), "old"));
  fs::create_symlink("d/f", path("one"));
  fs::create_symlink(path("one"), path("two"));
  ASSERT_TRUE(write_whole(path("two"), "new"));
  EXPECT_EQ(held(path("d/f")), "new");
  EXPECT_TRUE(fs::is_symlink(path("one")) && fs::is_symlink(path("two")));
  fs::create_symlink("d/fresh", path("dangling"));
  ASSERT_TRUE(write_whole(path("dangling"), "x")) << "a link to what is not there yet";
  EXPECT_EQ(held(path("d/fresh")), "x");
  EXPECT_TRUE(fs::is_symlink(path("dangling")));
  fs::create_symlink("round", path("round"));
  const auto loop = write_whole(path("round"), "x");
  ASSERT_FALSE(loop);
  EXPECT_THAT(loop.error().message, HasSubstr("symbolic links"));
}

TEST_F(Files, SameFileUnderTwoNames) {
  ASSERT_TRUE(write_whole(path("f"), "x"));
  ASSERT_TRUE(fs::create_directory(path("d")));
  fs::create_hard_link(path("f"), path("hard"));
  fs::create_symlink("f", path("soft"));
  fs::create_symlink("new", path("to_new"));
  for (const char* other : {"f", "hard", "soft", "d/../f", "./f"}) {
    EXPECT_TRUE(same_file(path("f"), path(other))) << other;
    EXPECT_TRUE(same_file(path(other), path("f"))) << other;
  }
  EXPECT_FALSE(same_file(path("f"), path("d")));
  EXPECT_FALSE(same_file(path("f"), path("new")));
  EXPECT_TRUE(same_file(path("new"), path("d/../new"))) << "none of them is there";
  EXPECT_TRUE(same_file(path("new"), path("to_new")));
  EXPECT_TRUE(same_file("-", "/dev/stdout"));
  EXPECT_TRUE(same_file("/dev/fd/1", "/proc/self/fd/1"));
  EXPECT_FALSE(same_file("/dev/null", "/dev/null")) << "what is written there stands nowhere";
}

TEST_F(Files, OutputsAppearTogether) {
  ASSERT_TRUE(write_whole(path("a"), "old a"));
  Outputs outputs;
  ASSERT_TRUE(outputs.add(path("a"), "new a"));
  ASSERT_TRUE(outputs.add(path("b"), "new b"));
  EXPECT_EQ(held(path("a")), "old a") << "nothing before commit";
  EXPECT_FALSE(fs::exists(path("b")));
  ASSERT_TRUE(outputs.commit());
  EXPECT_EQ(held(path("a")), "new a");
  EXPECT_EQ(held(path("b")), "new b");
  EXPECT_EQ(entries(), 2) << "no temporary file stays";
}

TEST_F(Files, OutputsThatAreNotCommittedLeaveNothing) {
  {
    Outputs outputs;
    ASSERT_TRUE(outputs.add(path("a"), "x"));
    EXPECT_EQ(entries(), 1);
    const Outputs moved = std::move(outputs);
    EXPECT_EQ(entries(), 1);
  }
  EXPECT_EQ(entries(), 0);
}

TEST_F(Files, ARenameThatFailsTakesTheEarlierOnesBack) {
  ASSERT_TRUE(write_whole(path("a"), "old a"));
  struct stat before {};
  ASSERT_EQ(::stat(path("a").c_str(), &before), 0);
  Outputs outputs;
  ASSERT_TRUE(outputs.add(path("a"), "new a"));
  ASSERT_TRUE(outputs.add(path("b"), "new b"));
  ASSERT_TRUE(outputs.add(path("c"), "new c"));
  ASSERT_TRUE(fs::create_directory(path("c"))) << "in the meantime";
  const auto status = outputs.commit();
  ASSERT_FALSE(status);
  EXPECT_EQ(status.error().id, "FI101");
  EXPECT_EQ(status.error().place.file, path("c"));
  EXPECT_EQ(held(path("a")), "old a");
  struct stat after {};
  ASSERT_EQ(::stat(path("a").c_str(), &after), 0);
  EXPECT_EQ(after.st_ino, before.st_ino) << "the very file, not a copy";
  EXPECT_FALSE(fs::exists(path("b")));
  EXPECT_EQ(entries(), 2) << "a and the folder c";
}

TEST_F(Files, AFullDeviceKeepsTheOthersAway) {
  ASSERT_TRUE(write_whole(path("a"), "old a"));
  Outputs outputs;
  ASSERT_TRUE(outputs.add(path("a"), "new a"));
  ASSERT_TRUE(outputs.add("/dev/full", "x"));
  ASSERT_TRUE(outputs.add(path("b"), "new b"));
  const auto status = outputs.commit();
  ASSERT_FALSE(status);
  EXPECT_THAT(status.error().message, HasSubstr("No space left"));
  EXPECT_EQ(held(path("a")), "old a");
  EXPECT_FALSE(fs::exists(path("b")));
  EXPECT_EQ(entries(), 1);
}

TEST_F(Files, FI102OneFileForTwoOutputs) {
  ASSERT_TRUE(write_whole(path("f"), "old"));
  fs::create_hard_link(path("f"), path("hard"));
  Outputs outputs;
  ASSERT_TRUE(outputs.add(path("f"), "x"));
  const auto status = outputs.add(path("hard"), "y");
  ASSERT_FALSE(status);
  EXPECT_EQ(status.error().id, "FI102");
}

TEST_F(Files, AReadOnlyFolder) {
  ASSERT_TRUE(write_whole(path("f"), "old"));
  ASSERT_EQ(::chmod(path(".").c_str(), 0555), 0);
  ASSERT_EQ(::chmod(path("f").c_str(), 0666), 0);
  const pid_t child = ::fork();
  if (child == 0) {  // root may write everywhere, nobody may not
    if (::geteuid() == 0 && ::setuid(65534) != 0) ::_exit(3);
    const auto before = may_write(path("f")), status = write_whole(path("f"), "new");
    const bool named = !status && status.error().message.find("Permission denied") != std::string::npos;
    ::_exit(!before && named ? 0 : 1);
  }
  int status = 0;
  ASSERT_EQ(::waitpid(child, &status, 0), child);
  ::chmod(path(".").c_str(), 0755);
  EXPECT_TRUE(WIFEXITED(status) && WEXITSTATUS(status) == 0) << status;
  EXPECT_EQ(held(path("f")), "old");
}

TEST_F(Files, ADeviceWithoutEndIsAnError) {
  const auto endless = read("/dev/zero");
  ASSERT_FALSE(endless);
  EXPECT_EQ(endless.error().id, "FI100");
}

/// Runs `what` in a process of its own with these descriptors closed; its exit status.
template <class What>
int without(std::initializer_list<int> closed, What&& what) {
  const pid_t child = ::fork();
  if (child == 0) {
    for (const int fd : closed) ::close(fd);
    ::_exit(what());
  }
  int status = 0;
  EXPECT_EQ(::waitpid(child, &status, 0), child);
  return WIFEXITED(status) ? WEXITSTATUS(status) : -1;
}

TEST_F(Files, SignalsThatEndTheProgramLeaveNoTemporaryFile) {
  const int status = without({}, [&] {
    std::signal(SIGTERM, [](int) {
      remove_temporaries();
      ::_exit(7);
    });
    Outputs outputs;
    if (!outputs.add(path("a"), "x") || !outputs.add(path("b"), "y") || entries() != 2) return 1;
    std::raise(SIGTERM);
    return 2;
  });
  EXPECT_EQ(status, 7);
  EXPECT_EQ(entries(), 0);
}

TEST_F(Files, TemporaryNamesAreNotForeseen) {
  const auto name_of_temporary = [&] {
    Outputs outputs;
    EXPECT_TRUE(outputs.add(path("a"), "x"));
    return fs::directory_iterator(path("."))->path().filename().string();
  };
  EXPECT_NE(name_of_temporary(), name_of_temporary());
}

TEST_F(Files, MoreOutputsThanTemporaryNamesAreRefusedWhole) {
  {
    Outputs outputs;
    Status status;
    for (int made = 0; status && made < 1000; ++made) status = outputs.add(path(std::to_string(made).c_str()), "x");
    ASSERT_FALSE(status);
    EXPECT_EQ(status.error().id, "FI101");
  }
  EXPECT_EQ(entries(), 0);
  EXPECT_TRUE(write_whole(path("f"), "x")) << "the names are free again";
}

TEST_F(Files, NoFileGetsTheNumberOfAStandardStream) {
  const std::string file = path("f");
  ASSERT_TRUE(write_whole(file, "x"));
  const int status = without({0, 1, 2}, [&] {
    open_standard_streams();
    const int fd = ::open(file.c_str(), O_RDONLY | O_CLOEXEC);
    if (fd <= 2) return 1;
    if (::write(1, "x", 1) >= 0 || errno != EBADF) return 2;
    return !read("-") && ::write(2, "x", 1) == 1 ? 0 : 3;
  });
  EXPECT_EQ(status, 0);
}

TEST_F(Files, AClosedStandardOutputIsNoOutput) {
  EXPECT_EQ(without({1}, [] { return may_write("-") ? 1 : 0; }), 0);
  EXPECT_EQ(without({1}, [] { return open_standard_streams(), may_write("-") ? 1 : 0; }), 0);
}

TEST_F(Files, StandardOutputKeptForAFile) {
  const std::string file = path("out"), messages = path("err");
  const int status = without({}, [&] {
    const int out = ::open(file.c_str(), O_WRONLY | O_CREAT | O_CLOEXEC, 0600);
    const int err = ::open(messages.c_str(), O_WRONLY | O_CREAT | O_CLOEXEC, 0600);
    if (::dup2(out, 1) < 0 || ::dup2(err, 2) < 0 || !keep_standard_output_for_files()) return 1;
    std::printf("printed");
    std::fflush(stdout);
    return write_whole("/dev/stdout", "the file") && keep_standard_output_for_files() ? 0 : 1;
  });
  EXPECT_EQ(status, 0);
  EXPECT_EQ(held(file), "the file");
  EXPECT_EQ(held(messages), "printed");
}

TEST_F(Files, MinusIsStandardInput) {
  const std::string file = path("f");
  ASSERT_TRUE(write_whole(file, "from there"));
  const int status = without({0}, [&] {
    if (::open(file.c_str(), O_RDONLY) != 0) return 1;
    const auto bytes = read("-");
    return bytes && *bytes == "from there" ? 0 : 2;
  });
  EXPECT_EQ(status, 0);
  EXPECT_TRUE(is_standard_input("-") && is_standard_input("/dev/stdin") && !is_standard_input("/dev/stdout"));
  EXPECT_TRUE(is_standard_output("-") && is_standard_output("/dev/fd/1") && !is_standard_output("/dev/fd/10"));
}

}  // namespace
}  // namespace polypod::files
