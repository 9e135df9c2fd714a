// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/core/files.hpp"

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/stat.h>
#include <unistd.h>

#include <atomic>
#include <cerrno>
#include <cstdio>
#include <cstring>
#include <filesystem>

namespace polypod::files {
namespace {
/// The temporary file that is open now.
constinit std::atomic<const char*> open_temporary{nullptr};
}  // namespace

void remove_temporaries() noexcept {
  if (const char* path = open_temporary.exchange(nullptr)) ::unlink(path);
}

Result<std::string> read(const std::string& path) {
  const auto failed = [&](const char* why) {
    return fail("FI100", fmt::format("cannot read the file: {}", why), Place{path, 0, 0}, "check the path");
  };
  std::error_code ec;
  if (std::filesystem::is_directory(path, ec)) return failed("it is a directory");
  std::FILE* file = std::fopen(path.c_str(), "rb");
  if (file == nullptr) return failed(std::strerror(errno));
  std::string bytes;
  char buffer[1 << 16];
  std::size_t n = 0;
  while ((n = std::fread(buffer, 1, sizeof buffer, file)) > 0) bytes.append(buffer, n);
  const bool bad = std::ferror(file) != 0;
  const int code = errno;
  std::fclose(file);
  if (bad) return failed(std::strerror(code));
  return bytes;
}

Status write_whole(const std::string& path, std::string_view bytes) {
  const auto failed = [&](int code) {
    return fail("FI101", fmt::format("cannot write the file: {}", std::strerror(code)), Place{path, 0, 0},
                "choose another output");
  };
  struct stat info {};
  if (::stat(path.c_str(), &info) == 0) {
    if (S_ISDIR(info.st_mode)) return failed(EISDIR);
    if (!S_ISREG(info.st_mode)) {  // a device or a pipe cannot be replaced by a rename: write to it as it is
      const int fd = ::open(path.c_str(), O_WRONLY | O_CLOEXEC);
      if (fd < 0) return failed(errno);
      while (!bytes.empty()) {
        const ssize_t n = ::write(fd, bytes.data(), bytes.size());
        if (n < 0 && errno == EINTR) continue;
        if (n < 0) {
          const int code = errno;
          ::close(fd);
          return failed(code);
        }
        bytes.remove_prefix(static_cast<std::size_t>(n));
      }
      return ::close(fd) == 0 ? Status{} : failed(errno);
    }
  }
  const std::string temporary = fmt::format("{}.{}.tmp", path, ::getpid());
  open_temporary = temporary.c_str();
  const int fd = ::open(temporary.c_str(), O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0666);
  if (fd < 0) {
    const int code = errno;
    open_temporary = nullptr;
    return failed(code);
  }
  int code = 0;
  while (code == 0 && !bytes.empty()) {
    const ssize_t n = ::write(fd, bytes.data(), bytes.size());
    if (n < 0) {
      if (errno != EINTR) code = errno;
    } else {
      bytes.remove_prefix(static_cast<std::size_t>(n));
    }
  }
  if (code == 0 && ::fsync(fd) != 0 && errno != EINVAL && errno != EROFS) code = errno;
  if (::close(fd) != 0 && code == 0) code = errno;
  if (code == 0 && ::rename(temporary.c_str(), path.c_str()) != 0) code = errno;
  open_temporary = nullptr;
  if (code != 0) {
    ::unlink(temporary.c_str());
    return failed(code);
  }
  return {};
}

Status may_write(const std::string& path) {
  const auto failed = [&](int code) {
    return fail("FI101", fmt::format("cannot write the file: {}", std::strerror(code)), Place{path, 0, 0},
                "choose another output");
  };
  struct stat info {};
  if (path.empty()) return failed(ENOENT);
  if (::stat(path.c_str(), &info) == 0) {
    if (S_ISDIR(info.st_mode)) return failed(EISDIR);
    return ::access(path.c_str(), W_OK) == 0 ? Status{} : failed(errno);
  }
  const std::string folder = std::filesystem::path(path).parent_path().string();
  return ::access(folder.empty() ? "." : folder.c_str(), W_OK) == 0 ? Status{} : failed(errno);
}

}  // namespace polypod::files
