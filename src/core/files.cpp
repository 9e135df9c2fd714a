// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/core/files.hpp"

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/random.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <cerrno>
#include <charconv>
#include <climits>
#include <csignal>
#include <cstdint>
#include <cstdio>
#include <cstring>
#include <ctime>
#include <filesystem>
#include <optional>

#include "polypod/core/file_parts.hpp"

namespace polypod::files {
namespace {

// What a signal handler must see, and what is one for the whole process as standard output itself is -----------------

/// The name of a temporary file that is open now. A slot is taken before its file is made.
struct Slot {
  enum State { free, filling, live };
  std::atomic<int> state{free};
  std::array<char, PATH_MAX> path{};
};
constexpr std::size_t kSlots = 64;
constinit std::array<Slot, kSlots> slots{};
/// How many commits are renaming now; with kClosed none begins any more.
constinit std::atomic<unsigned> commits{0};
constexpr unsigned kClosed = 1U << 31U;
constinit std::atomic<bool> appeared{false};
constinit std::atomic<int> output_descriptor{STDOUT_FILENO};

/// A slot with this name, or none: all are taken, or the name is too long.
Slot* take_slot(const std::string& path) {
  if (path.size() + 1 > PATH_MAX) return nullptr;
  for (Slot& slot : slots) {
    int expected = Slot::free;
    if (!slot.state.compare_exchange_strong(expected, Slot::filling)) continue;
    std::memcpy(slot.path.data(), path.c_str(), path.size() + 1);
    slot.state = Slot::live;
    return &slot;
  }
  return nullptr;
}

constexpr std::array<int, 5> kEnding = {SIGINT, SIGTERM, SIGHUP, SIGQUIT, SIGXCPU};

/// Whether a signal that ends the program has come and waits to be taken.
bool end_is_pending() {
  sigset_t pending;
  return sigpending(&pending) == 0 &&
         std::any_of(kEnding.begin(), kEnding.end(), [&](int s) { return sigismember(&pending, s) == 1; });
}

/// Signals that end the program wait while this lives: they are held back on this thread, and remove_temporaries waits
/// on any other. Where one has come before, this does not begin: begun() is false.
class RenamesWhole {
 public:
  RenamesWhole() {
    if (end_is_pending()) close_outputs();
    sigset_t ending;
    sigemptyset(&ending);
    for (const int signal : kEnding) sigaddset(&ending, signal);
    pthread_sigmask(SIG_BLOCK, &ending, &before_);
    unsigned now = commits;
    while ((now & kClosed) == 0 && !begun_) begun_ = commits.compare_exchange_weak(now, now + 1);
  }
  ~RenamesWhole() {
    if (begun_) --commits;
    pthread_sigmask(SIG_SETMASK, &before_, nullptr);
  }
  [[nodiscard]] bool begun() const { return begun_; }
  RenamesWhole(const RenamesWhole&) = delete;
  RenamesWhole& operator=(const RenamesWhole&) = delete;

 private:
  sigset_t before_{};
  bool begun_ = false;
};

// -------------------------------------------------------------------------------------------------------------------

tl::unexpected<Error> cannot_write(const std::string& path, int code) {
  return fail("FI101", fmt::format("cannot write the file: {}", std::strerror(code)), Place{path, 0, 0},
              "choose another output");
}

/// N where `path` names a descriptor of this process: `-` (which is `dash`), /dev/stdout, /dev/fd/N, /proc/self/fd/N.
std::optional<int> descriptor_of(const std::string& path, int dash) {
  if (path == "-") return dash;
  if (path == "/dev/stdin") return STDIN_FILENO;
  if (path == "/dev/stdout") return STDOUT_FILENO;
  if (path == "/dev/stderr") return STDERR_FILENO;
  for (const std::string_view folder : {"/dev/fd/", "/proc/self/fd/"}) {
    if (!path.starts_with(folder)) continue;
    int number = -1;
    const char* end = path.data() + path.size();
    const auto [rest, code] = std::from_chars(path.data() + folder.size(), end, number);
    if (code == std::errc{} && rest == end && number >= 0) return number;
  }
  return std::nullopt;
}

/// The descriptor that `path` names for writing, past keep_standard_output_for_files.
std::optional<int> output_of(const std::string& path) {
  const auto named = descriptor_of(path, STDOUT_FILENO);
  return named == STDOUT_FILENO ? output_descriptor.load() : named;
}

std::string folder_of(const std::string& path) {
  const std::size_t slash = path.rfind('/');
  return slash == std::string::npos ? "." : slash == 0 ? "/" : path.substr(0, slash);
}

/// Where the symbolic links lead whose first one is `path`; it need not exist. Errors: ELOOP by the code.
tl::expected<std::string, int> followed(std::string path) {
  constexpr int kMostLinks = 40;  // as Linux
  for (int i = 0; i < kMostLinks; ++i) {
    struct stat info {};
    if (::lstat(path.c_str(), &info) != 0 || !S_ISLNK(info.st_mode)) return path;
    std::error_code error;
    const std::string next = std::filesystem::read_symlink(path, error).string();
    if (error) return tl::unexpected(error.value());
    path = next.starts_with('/') ? next : folder_of(path) + "/" + next;
  }
  return tl::unexpected(ELOOP);
}

/// Errors by errno's codes, 0 is none.
int write_all(int fd, std::string_view bytes) {
  while (!bytes.empty()) {
    const ssize_t n = ::write(fd, bytes.data(), bytes.size());
    if (n >= 0) {
      bytes.remove_prefix(static_cast<std::size_t>(n));
    } else if (errno != EINTR) {
      return errno;
    }
  }
  return 0;
}

/// Errors by errno's codes; EFBIG where there is more than a gigabyte, or more than 64 MB of a device, as /dev/zero
/// has. Ends where `take` says no.
template <class Take>
int read_all(int fd, Take&& take) {
  std::size_t most = std::size_t{1} << 30;
  struct stat info {};
  if (::fstat(fd, &info) == 0) {
    if (S_ISREG(info.st_mode) && info.st_size > static_cast<off_t>(most)) return EFBIG;
    if (S_ISCHR(info.st_mode)) most >>= 4U;
  }
  std::array<char, 1 << 16> buffer;
  std::size_t bytes = 0;
  while (bytes <= most) {
    const ssize_t n = ::read(fd, buffer.data(), buffer.size());
    if (n == 0) return 0;
    if (n > 0) {
      bytes += static_cast<std::size_t>(n);
      if (!take(std::string_view(buffer.data(), static_cast<std::size_t>(n)))) return 0;
    } else if (errno != EINTR) {
      return errno;
    }
  }
  return EFBIG;
}

/// A name that is removed, from the disk and from the handler's list, when this ends.
class Temporary {
 public:
  Temporary() = default;
  Temporary(Temporary&& other) noexcept : slot_(std::exchange(other.slot_, nullptr)), path_(std::move(other.path_)) {}
  Temporary& operator=(Temporary&& other) noexcept {
    std::swap(slot_, other.slot_);
    std::swap(path_, other.path_);
    return *this;
  }
  Temporary(const Temporary&) = delete;
  Temporary& operator=(const Temporary&) = delete;
  ~Temporary() {
    if (slot_ == nullptr) return;
    ::unlink(path_.c_str());
    slot_->state = Slot::free;
  }

  [[nodiscard]] const std::string& path() const { return path_; }
  explicit operator bool() const { return slot_ != nullptr; }

  /// A new name in `folder` for which `make(name)` is 0; other codes than EEXIST are errors.
  template <class Make>
  static tl::expected<Temporary, int> in(const std::string& folder, Make&& make) {
    constexpr int kTrials = 16;  // of 2^64 names
    for (int i = 0; i < kTrials; ++i) {
      std::uint64_t random = 0;
      if (::getrandom(&random, sizeof random, 0) != sizeof random) return tl::unexpected(EIO);
      Temporary temporary;
      temporary.path_ = fmt::format("{}/.polypod-{:016x}.tmp", folder, random);
      temporary.slot_ = take_slot(temporary.path_);
      if (temporary.slot_ == nullptr) return tl::unexpected(temporary.path_.size() < PATH_MAX ? EMFILE : ENAMETOOLONG);
      const int code = make(temporary.path_.c_str());
      if (code == 0) return temporary;
      temporary.forget();  // nothing of ours has this name
      if (code != EEXIST) return tl::unexpected(code);
    }
    return tl::unexpected(EEXIST);
  }

  /// The file under this name is not temporary any more, or is not there.
  void forget() {
    if (slot_ != nullptr) slot_->state = Slot::free;
    slot_ = nullptr;
  }

 private:
  Slot* slot_ = nullptr;
  std::string path_;
};

/// A file of these bytes beside `target`, with its mode and owner if it exists.
tl::expected<Temporary, int> written_beside(const std::string& target, std::string_view bytes) {
  struct stat old {};
  const bool exists = ::stat(target.c_str(), &old) == 0;
  return Temporary::in(folder_of(target), [&](const char* name) {
    const int fd = ::open(name, O_WRONLY | O_CREAT | O_EXCL | O_NOFOLLOW | O_CLOEXEC, exists ? 0600 : 0666);
    if (fd < 0) return errno;
    int code = write_all(fd, bytes);
    if (code == 0 && exists) {
      // Without the right to give files away the owner stays who runs this; the mode is what matters.
      if (::fchown(fd, old.st_uid, old.st_gid) != 0) errno = 0;
      if (::fchmod(fd, old.st_mode & 07777) != 0) code = errno;
    }
    if (code == 0 && ::fsync(fd) != 0 && errno != EINVAL && errno != EROFS) code = errno;
    if (::close(fd) != 0 && code == 0) code = errno;
    if (code != 0) ::unlink(name);
    return code;
  });
}

/// The old file under a second name; empty if there is none.
tl::expected<Temporary, int> kept_copy(const std::string& target) {
  struct stat info {};
  if (::lstat(target.c_str(), &info) != 0) return Temporary{};
  auto linked =
      Temporary::in(folder_of(target), [&](const char* name) { return ::link(target.c_str(), name) == 0 ? 0 : errno; });
  if (linked) return linked;
  const auto bytes = read(target);  // a file system without hard links
  return bytes ? written_beside(target, *bytes) : tl::unexpected(linked.error());
}

/// Why `target` cannot become a file, as far as can be told beforehand; 0 is nothing.
int obstacle(const std::string& target) {
  if (target.empty()) return ENOENT;
  struct stat info {};
  const bool exists = ::stat(target.c_str(), &info) == 0;
  if (!exists && errno != ENOENT) return errno;
  if ((exists && S_ISDIR(info.st_mode)) || target.ends_with('/')) return EISDIR;
  if (exists && ::access(target.c_str(), W_OK) != 0) return errno;
  if (exists && !S_ISREG(info.st_mode)) return 0;
  return ::access(folder_of(target).c_str(), W_OK | X_OK) == 0 ? 0 : errno;
}

/// Whether what stands at `target` is written to as it is: a device or a pipe.
bool is_stream(const std::string& target) {
  struct stat info {};
  return ::stat(target.c_str(), &info) == 0 && !S_ISREG(info.st_mode);
}

}  // namespace

struct Outputs::Pending {
  std::string path;       ///< as it was given
  std::string target;     ///< after its links
  std::optional<int> to;  ///< a descriptor that is written to
  bool stream = false;    ///< a device or a pipe that is opened and written to
  std::string bytes;      ///< for these two
  Temporary temporary;    ///< for all others
  Temporary old;          ///< what `target` was
  bool renamed = false;

  /// For descriptors, devices and pipes. Errors by errno's codes.
  [[nodiscard]] int write() const {
    if (to) return write_all(*to, bytes);
    const int fd = ::open(target.c_str(), O_WRONLY | O_CLOEXEC);
    if (fd < 0) return errno;
    const int code = write_all(fd, bytes);
    return ::close(fd) == 0 || code != 0 ? code : errno;
  }
  /// Errors by errno's codes.
  int rename() {
    if (!temporary) return 0;
    if (::rename(temporary.path().c_str(), target.c_str()) != 0) return errno;
    temporary.forget();
    renamed = true;
    return 0;
  }
  void take_back() {
    if (!renamed) return;
    if (!old) {
      ::unlink(target.c_str());
    } else if (::rename(old.path().c_str(), target.c_str()) == 0) {
      old.forget();
    }
  }
};

Outputs::Outputs() = default;
Outputs::~Outputs() = default;
Outputs::Outputs(Outputs&&) noexcept = default;
Outputs& Outputs::operator=(Outputs&&) noexcept = default;

Status Outputs::add(const std::string& path, std::string bytes) {
  for (const Pending& other : pending_) {
    if (!same_file(other.path, path)) continue;
    return fail("FI102", fmt::format("{} and {} are one file", other.path, path), Place{path, 0, 0},
                "choose another output");
  }
  Pending one;
  one.path = path;
  one.to = output_of(path);
  if (!one.to) {
    auto target = followed(path);
    if (!target) return cannot_write(path, target.error());
    one.target = std::move(*target);
    if (const int code = obstacle(one.target); code != 0) return cannot_write(path, code);
    one.stream = is_stream(one.target);
  }
  if (one.to || one.stream) {
    one.bytes = std::move(bytes);
  } else {
    auto temporary = written_beside(one.target, bytes);
    if (!temporary) return cannot_write(path, temporary.error());
    one.temporary = std::move(*temporary);
  }
  pending_.push_back(std::move(one));
  return {};
}

Status Outputs::commit() {
  std::vector<Pending> all = std::move(pending_);
  pending_.clear();
  // The last rename needs no copy: if it fails, it has changed nothing.
  for (std::size_t i = 0; i + 1 < all.size(); ++i) {
    if (!all[i].temporary) continue;
    auto old = kept_copy(all[i].target);
    if (!old) return cannot_write(all[i].path, old.error());
    all[i].old = std::move(*old);
  }
  for (const Pending& one : all) {
    if (one.temporary) continue;
    if (const int code = one.write(); code != 0) return cannot_write(one.path, code);
  }
  const RenamesWhole guard;
  if (!guard.begun()) return fail("FI103", "a signal ended the program before its files appeared");
  for (Pending& one : all) {
    const int code = one.rename();
    if (code == 0) continue;
    for (Pending& before : all) before.take_back();
    return cannot_write(one.path, code);
  }
  appeared = true;
  return {};
}

void close_outputs() noexcept {
  commits |= kClosed;
}

bool outputs_appeared() noexcept {
  return appeared;
}

Status read_parts(const std::string& path, const std::function<Status(std::string_view)>& take) {
  const auto failed = [&](const char* why) {
    return fail("FI100", fmt::format("cannot read the file: {}", why), Place{path, 0, 0}, "check the path");
  };
  std::error_code ec;
  if (std::filesystem::is_directory(path, ec)) return failed("it is a directory");
  const int fd = path == "-" ? ::fcntl(STDIN_FILENO, F_DUPFD_CLOEXEC, 3) : ::open(path.c_str(), O_RDONLY | O_CLOEXEC);
  if (fd < 0) return failed(std::strerror(errno));
  Status taken;
  const int code = read_all(fd, [&](std::string_view bytes) {
    taken = take(bytes);
    return taken.has_value();
  });
  ::close(fd);
  if (code == EFBIG) return failed("it holds more than 1 GiB");
  if (code != 0) return failed(std::strerror(code));
  return taken;
}

Result<std::string> read(const std::string& path) {
  std::string bytes;
  POLYPOD_TRY(read_parts(path, [&](std::string_view part) -> Status {
    bytes += part;
    return {};
  }));
  return bytes;
}

Status write_whole(const std::string& path, std::string_view bytes) {
  Outputs one;
  POLYPOD_TRY(one.add(path, std::string(bytes)));
  return one.commit();
}

Status may_write(const std::string& path) {
  if (const auto descriptor = output_of(path)) {
    const int flags = ::fcntl(*descriptor, F_GETFL);
    if (flags == -1) return cannot_write(path, errno);
    return (flags & O_ACCMODE) == O_RDONLY ? Status(cannot_write(path, EBADF)) : Status{};
  }
  const auto target = followed(path);
  const int code = target ? obstacle(*target) : target.error();
  return code == 0 ? Status{} : Status(cannot_write(path, code));
}

bool same_file(const std::string& a, const std::string& b) {
  const auto to_a = descriptor_of(a, STDOUT_FILENO), to_b = descriptor_of(b, STDOUT_FILENO);
  if (to_a && to_b) return *to_a == *to_b;
  struct stat at_a {
  }, at_b{};
  const auto look = [](const std::string& path, const std::optional<int>& to, struct stat& info) {
    return (to ? ::fstat(*to == STDOUT_FILENO ? output_descriptor.load() : *to, &info) : ::stat(path.c_str(), &info)) ==
           0;
  };
  const bool is_a = look(a, to_a, at_a), is_b = look(b, to_b, at_b);
  // What is written to devices stands nowhere: /dev/null may be named twice.
  if (is_a && is_b) return at_a.st_dev == at_b.st_dev && at_a.st_ino == at_b.st_ino && !S_ISCHR(at_a.st_mode);
  if (to_a || to_b || is_a != is_b) return false;
  const auto whole = [](const std::string& path) {
    std::error_code none;
    // From the root: of a name that is not there weakly_canonical makes no absolute one.
    return std::filesystem::weakly_canonical(std::filesystem::absolute(followed(path).value_or(path), none), none);
  };
  return whole(a) == whole(b);
}

bool is_standard_output(const std::string& path) {
  return descriptor_of(path, STDOUT_FILENO) == STDOUT_FILENO;
}

bool is_standard_input(const std::string& path) {
  return descriptor_of(path, STDIN_FILENO) == STDIN_FILENO;
}

Status keep_standard_output_for_files() {
  if (output_descriptor != STDOUT_FILENO) return {};
  const int kept = ::fcntl(STDOUT_FILENO, F_DUPFD_CLOEXEC, 3);
  if (kept < 0) return cannot_write("-", errno);
  if (::dup2(STDERR_FILENO, STDOUT_FILENO) < 0) {
    const int code = errno;
    ::close(kept);
    return cannot_write("-", code);
  }
  output_descriptor = kept;
  return {};
}

void open_standard_streams() noexcept {
  for (const auto& [number, direction] :
       {std::pair{STDIN_FILENO, O_WRONLY}, {STDOUT_FILENO, O_RDONLY}, {STDERR_FILENO, O_WRONLY}}) {
    // The lowest number that is free is this one, because those below it are open.
    if (::fcntl(number, F_GETFD) == -1 && errno == EBADF) (void)::open("/dev/null", direction);
  }
}

void remove_temporaries() noexcept {
  const int before = errno;
  const timespec moment{0, 1'000'000};
  for (int i = 0; i < 1000 && (commits & ~kClosed) != 0; ++i) ::nanosleep(&moment, nullptr);
  for (const Slot& slot : slots) {
    if (slot.state == Slot::live) ::unlink(slot.path.data());
  }
  errno = before;
}

}  // namespace polypod::files
