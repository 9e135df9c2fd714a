// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/design/store.hpp"

#include <fcntl.h>
#include <fmt/format.h>
#include <sqlite3.h>
#include <sys/file.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <chrono>
#include <cmath>
#include <cstring>
#include <ctime>
#include <filesystem>
#include <system_error>
#include <thread>

namespace polypod::design {
namespace {

constexpr const char* kFormat = "1";
constexpr int kPatience_ms = 10'000;
constexpr int kKindOfError = 0xff;  // of SQLite's extended codes
constexpr const char* kLock = "lock";
constexpr const char* kSamples = "sensitivity";
constexpr const char* kAgain = "judged_again";
constexpr const char* kCompared = "compared";

/// An identifier of SQL in its quotes.
std::string quoted(const std::string& name) {
  std::string out = "\"";
  for (const char c : name) out += c == '"' ? std::string("\"\"") : std::string(1, c);
  return out + "\"";
}

struct CloseDatabase {
  void operator()(sqlite3* db) const { sqlite3_close_v2(db); }
};
using Database = std::unique_ptr<sqlite3, CloseDatabase>;
struct Finalize {
  void operator()(sqlite3_stmt* s) const { sqlite3_finalize(s); }
};
using Statement = std::unique_ptr<sqlite3_stmt, Finalize>;

/// A lock that the system gives back when the process ends, however it ends.
class Lock {
 public:
  Lock() = default;
  explicit Lock(int fd) : fd_(fd) {}
  Lock(Lock&& other) noexcept : fd_(std::exchange(other.fd_, -1)) {}
  Lock& operator=(Lock&& other) noexcept {
    std::swap(fd_, other.fd_);
    return *this;
  }
  ~Lock() {
    if (fd_ >= 0) ::close(fd_);
  }

 private:
  int fd_ = -1;
};

tl::unexpected<Error> cannot(const std::string& path, const std::string& what, const std::string& why) {
  return fail("OP110", fmt::format("{}: {}: {}", path, what, why), {}, "check the folder and its permissions");
}

std::string now() {
  const std::time_t t = std::time(nullptr);
  std::tm utc{};
  gmtime_r(&t, &utc);
  std::array<char, 32> text{};
  std::strftime(text.data(), text.size(), "%Y-%m-%dT%H:%M:%SZ", &utc);
  return text.data();
}

State state_of(std::string_view name) {
  for (const State s : {State::done, State::violates, State::dropped})
    if (name == name_of(s)) return s;
  return State::refused;
}

Phase phase_of(std::string_view name) {
  for (const Phase p : {Phase::start, Phase::sample, Phase::grid, Phase::refine})
    if (name == name_of(p)) return p;
  return Phase::search;
}

constexpr std::array kFixed{
    "row",       "state",   "reason", "phase",   "objective", "objective_lower", "objective_upper",
    "violation", "seconds", "seed",   "version", "at"};

/// The columns of a study, in order.
std::vector<std::string> columns_of(const Study& study) {
  std::vector<std::string> out(kFixed.begin(), kFixed.end());
  for (const Vary& v : study.vary) out.push_back("vary:" + v.key);
  for (const Figure f : study.figures()) {
    const std::string name = std::string("figure:") + info_of(f).name;
    out.insert(out.end(), {name, name + ":lower", name + ":upper"});
  }
  return out;
}

}  // namespace

struct Store::Impl {
  std::string path, seen_version;
  Lock lock;
  Database db;
  Statement insert, insert_sample;
  Study study;

  [[nodiscard]] std::string why() const { return sqlite3_errmsg(db.get()); }

  tl::unexpected<Error> failed(int code) const {
    const int kind = code & kKindOfError;
    if (kind == SQLITE_NOTADB || kind == SQLITE_CORRUPT) {
      return fail("OP111", fmt::format("{}: not a database of a study: {}", path, why()), {}, "take another folder");
    }
    if (kind == SQLITE_FULL || kind == SQLITE_IOERR) {
      return fail("OP115", fmt::format("{}: cannot be written: {}", path, why()), {},
                  "what was stored before is whole; make room on the disk and run the same command again");
    }
    return fail("OP110", fmt::format("{}: {}", path, why()), {}, "check the folder and its permissions");
  }

  /// A process that is being killed gives its locks back one after the other, and not every statement of SQLite waits
  /// for that by itself.
  Status run(const std::string& sql) const {
    const auto until = std::chrono::steady_clock::now() + std::chrono::milliseconds(kPatience_ms);
    constexpr std::chrono::milliseconds kPause(10);
    while (true) {
      const int code = sqlite3_exec(db.get(), sql.c_str(), nullptr, nullptr, nullptr);
      if (code == SQLITE_OK) return {};
      const bool busy = (code & kKindOfError) == SQLITE_BUSY || (code & kKindOfError) == SQLITE_LOCKED;
      if (!busy || std::chrono::steady_clock::now() > until) return failed(code);
      std::this_thread::sleep_for(kPause);
    }
  }

  Result<Statement> prepare(const std::string& sql) const {
    sqlite3_stmt* s = nullptr;
    const int code = sqlite3_prepare_v2(db.get(), sql.c_str(), -1, &s, nullptr);
    if (code != SQLITE_OK) return failed(code);
    return Statement(s);
  }

  Status connect(int flags) {
    sqlite3* opened = nullptr;
    const int code = sqlite3_open_v2(path.c_str(), &opened, flags | SQLITE_OPEN_FULLMUTEX, nullptr);
    db.reset(opened);
    if (code != SQLITE_OK) return failed(code);
    sqlite3_extended_result_codes(db.get(), 1);
    sqlite3_busy_timeout(db.get(), kPatience_ms);
    return {};
  }

  /// Empty where the key is not there.
  [[nodiscard]] Result<std::string> meta(const std::string& key) const {
    POLYPOD_ASSIGN(s, prepare("SELECT value FROM meta WHERE key = ?"));
    sqlite3_bind_text(s.get(), 1, key.c_str(), -1, SQLITE_TRANSIENT);
    const int code = sqlite3_step(s.get());
    if (code == SQLITE_DONE) return std::string();
    if (code != SQLITE_ROW) return failed(code);
    const auto* text = reinterpret_cast<const char*>(sqlite3_column_text(s.get(), 0));
    return std::string(text != nullptr ? text : "", static_cast<std::size_t>(sqlite3_column_bytes(s.get(), 0)));
  }

  Status set_meta(const std::string& key, const std::string& value) const {
    POLYPOD_ASSIGN(s, prepare("INSERT OR REPLACE INTO meta VALUES (?, ?)"));
    sqlite3_bind_text(s.get(), 1, key.c_str(), -1, SQLITE_TRANSIENT);
    sqlite3_bind_text(s.get(), 2, value.c_str(), static_cast<int>(value.size()), SQLITE_TRANSIENT);
    const int code = sqlite3_step(s.get());
    if (code != SQLITE_DONE) return failed(code);
    return {};
  }

  [[nodiscard]] Result<bool> has_tables() const {
    POLYPOD_ASSIGN(s, prepare("SELECT count(*) FROM sqlite_master"));
    const int code = sqlite3_step(s.get());
    if (code != SQLITE_ROW) return failed(code);
    return sqlite3_column_int(s.get(), 0) > 0;
  }

  /// The columns of a table of evaluations with their types.
  static std::string typed_columns(const Study& of) {
    std::string columns;
    for (const std::string& c : columns_of(of)) {
      const bool is_text = c == "state" || c == "reason" || c == "phase" || c == "version" || c == "at";
      const char* type = c == "row" ? "INTEGER PRIMARY KEY" : c == "seed" ? "INTEGER" : is_text ? "TEXT" : "REAL";
      columns += fmt::format("{}{} {}", columns.empty() ? "" : ", ", quoted(c), type);
    }
    return columns;
  }

  [[nodiscard]] Result<Statement> prepare_insert(const char* table) const {
    std::string names, marks;
    for (const std::string& c : columns_of(study)) {
      names += (names.empty() ? "" : ", ") + quoted(c);
      marks += marks.empty() ? "?" : ", ?";
    }
    return prepare(fmt::format("INSERT INTO {} ({}) VALUES ({})", table, names, marks));
  }

  Status add(sqlite3_stmt* s, const Row& row) const;
  /// A table with these rows alone; without rows none.
  [[nodiscard]] Status replace_rows(const char* table, const std::vector<Row>& rows) const;
  [[nodiscard]] Result<std::vector<Row>> rows_of(const char* table) const;
  /// None of a table that is not there.
  [[nodiscard]] Result<std::vector<Row>> rows_where_there(const char* table) const {
    POLYPOD_ASSIGN(s, prepare(fmt::format("SELECT count(*) FROM sqlite_master WHERE name = '{}'", table)));
    if (sqlite3_step(s.get()) != SQLITE_ROW || sqlite3_column_int(s.get(), 0) == 0) return std::vector<Row>();
    return rows_of(table);
  }

  Status create(const Study& of, const std::string& text, const std::string& version) const {
    const std::string columns = typed_columns(of);
    POLYPOD_TRY(run("BEGIN IMMEDIATE"));
    POLYPOD_TRY(run("CREATE TABLE meta (key TEXT PRIMARY KEY, value TEXT)"));
    POLYPOD_TRY(run("CREATE TABLE evaluation (" + columns + ")"));
    for (const auto& [key, value] : {std::pair<const char*, std::string>{"format", kFormat},
                                     {"version", version},
                                     {"study", text},
                                     {"study_file", of.file},
                                     {"machine", of.machine_toml},
                                     {"seed", fmt::format("{}", of.seed)},
                                     {"identity", of.identity()},
                                     {"made", now()}}) {
      POLYPOD_TRY(set_meta(key, value));
    }
    return run("COMMIT");
  }

  Status check_format() const {
    POLYPOD_ASSIGN(s, prepare("SELECT count(*) FROM sqlite_master WHERE name IN ('meta', 'evaluation')"));
    if (sqlite3_step(s.get()) != SQLITE_ROW || sqlite3_column_int(s.get(), 0) != 2) {
      return fail("OP111", fmt::format("{}: a database, but not of a study", path), {}, "take another folder");
    }
    POLYPOD_ASSIGN(format, meta("format"));
    if (format == kFormat) return {};
    return fail("OP111",
                fmt::format("{}: a study of format \"{}\"; this version reads format {}", path, format, kFormat), {},
                "take the version of Polypod that made it");
  }
};

const char* name_of(Phase phase) {
  switch (phase) {
    case Phase::start:
      return "start";
    case Phase::sample:
      return "sample";
    case Phase::grid:
      return "grid";
    case Phase::refine:
      return "refine";
    case Phase::search:
      break;
  }
  return "search";
}

std::string database_of(const std::string& folder) {
  return (std::filesystem::path(folder) / "study.sqlite").string();
}

std::vector<std::string> files_of(const std::string& folder) {
  const std::string database = database_of(folder);
  return {database, database + "-journal", database + "-wal", database + "-shm",
          (std::filesystem::path(folder) / kLock).string()};
}

Store::Store(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
Store::Store(Store&&) noexcept = default;
Store& Store::operator=(Store&&) noexcept = default;
Store::~Store() = default;

namespace {

/// The first line in which two identities differ, as the message shows it.
std::string difference(const std::string& stored, const std::string& given) {
  std::size_t a = 0, b = 0;
  const auto line = [](const std::string& text, std::size_t& at) {
    const std::size_t end = std::min(text.find('\n', at), text.size());
    std::string out = text.substr(std::min(at, text.size()), end - std::min(at, text.size()));
    at = end + 1;
    return out;
  };
  while (a < stored.size() || b < given.size()) {
    const std::string x = line(stored, a), y = line(given, b);
    if (x != y) return fmt::format("it has \"{}\" where this study has \"{}\"", x, y);
  }
  return "they differ";
}

}  // namespace

Result<Store> Store::open(const std::string& folder, const Study& study, const std::string& text,
                          const std::string& version) {
  std::error_code ec;
  std::filesystem::create_directories(folder, ec);
  if (ec || !std::filesystem::is_directory(folder)) {
    return cannot(folder, "no folder can be made here", ec ? ec.message() : "there is a file of this name");
  }
  auto impl = std::make_unique<Impl>();
  impl->path = database_of(folder);
  const std::string lock = (std::filesystem::path(folder) / kLock).string();
  const int fd = ::open(lock.c_str(), O_RDWR | O_CREAT | O_CLOEXEC, 0644);
  if (fd < 0) return cannot(lock, "cannot be opened", std::strerror(errno));
  impl->lock = Lock(fd);
  if (::flock(fd, LOCK_EX | LOCK_NB) != 0) {
    return fail("OP114", fmt::format("{}: another process works on this study", folder), {},
                "wait until it has ended, or take another folder; `polypod study` reads it meanwhile");
  }
  POLYPOD_TRY(impl->connect(SQLITE_OPEN_READWRITE | SQLITE_OPEN_CREATE));
  POLYPOD_TRY(impl->run("SELECT count(*) FROM sqlite_master"));  // waits until the file is free
  POLYPOD_ASSIGN(there, impl->has_tables());
  if (there) {
    POLYPOD_TRY(impl->check_format());
    POLYPOD_ASSIGN(by, impl->meta("version"));
    if (by != version) {
      return fail("OP113", fmt::format("{}: made by version {}, and this is {}", impl->path, by, version), {},
                  "figures of two versions may differ: take another folder, or that version");
    }
    POLYPOD_ASSIGN(stored, impl->meta("identity"));
    if (stored != study.identity()) {
      return fail("OP112",
                  fmt::format("{}: a folder of another study: {}", impl->path, difference(stored, study.identity())),
                  {}, "take another folder; only the number of evaluations, `search` and [[compare]] may change");
    }
  }
  POLYPOD_TRY(impl->run("PRAGMA journal_mode = WAL"));
  POLYPOD_TRY(impl->run("PRAGMA synchronous = NORMAL"));
  if (!there) POLYPOD_TRY(impl->create(study, text, version));
  // The same study may compare with other machines now.
  if (there && !text.empty()) POLYPOD_TRY(impl->set_meta("study", text));
  impl->seen_version = version;
  impl->study = study;
  POLYPOD_ASSIGN(insert, impl->prepare_insert("evaluation"));
  impl->insert = std::move(insert);
  return Store(std::move(impl));
}

Result<Store> Store::read(const std::string& folder) {
  auto impl = std::make_unique<Impl>();
  impl->path = database_of(folder);
  std::error_code ec;
  if (!std::filesystem::is_regular_file(impl->path, ec)) {
    return fail("OP116", fmt::format("{}: no study is kept here", folder), {},
                "give the folder that `polypod optimize STUDY -o FOLDER` wrote");
  }
  // A journal that a killed search has left is rolled back by whoever may write.
  const bool journal = std::filesystem::exists(impl->path + "-journal", ec);
  POLYPOD_TRY(impl->connect(journal ? SQLITE_OPEN_READWRITE : SQLITE_OPEN_READONLY));
  POLYPOD_TRY(impl->check_format());
  POLYPOD_ASSIGN(text, impl->meta("study"));
  POLYPOD_ASSIGN(name, impl->meta("study_file"));
  POLYPOD_ASSIGN(machine, impl->meta("machine"));
  POLYPOD_ASSIGN(seed, impl->meta("seed"));
  POLYPOD_ASSIGN(version, impl->meta("version"));
  POLYPOD_ASSIGN(study, study_from_text(text, name, machine));
  study.seed = std::strtoull(seed.c_str(), nullptr, 10);
  impl->study = std::move(study);
  impl->seen_version = version;
  return Store(std::move(impl));
}

const Study& Store::study() const {
  return impl_->study;
}

const std::string& Store::version() const {
  return impl_->seen_version;
}

Status Store::add(const Row& row) {
  return impl_->add(impl_->insert.get(), row);
}

Status Store::add_sample(const Row& row) {
  if (!impl_->insert_sample) {
    POLYPOD_TRY(
        impl_->run(fmt::format("CREATE TABLE IF NOT EXISTS {} ({})", kSamples, Impl::typed_columns(impl_->study))));
    POLYPOD_ASSIGN(insert, impl_->prepare_insert(kSamples));
    impl_->insert_sample = std::move(insert);
  }
  return impl_->add(impl_->insert_sample.get(), row);
}

Status Store::Impl::add(sqlite3_stmt* s, const Row& row) const {
  const Evaluation& e = row.evaluation;
  int at = 0;
  const auto number = [&](double x) {
    if (std::isfinite(x)) {
      sqlite3_bind_double(s, ++at, x);
    } else {
      sqlite3_bind_null(s, ++at);
    }
  };
  const auto text = [&](const std::string& x) { sqlite3_bind_text(s, ++at, x.c_str(), -1, SQLITE_TRANSIENT); };
  sqlite3_bind_int64(s, ++at, row.row);
  text(name_of(e.state));
  text(e.reason);
  text(name_of(row.phase));
  number(e.objective.value);
  number(e.objective.lower);
  number(e.objective.upper);
  number(e.violation);
  number(e.seconds);
  sqlite3_bind_int64(s, ++at, static_cast<std::int64_t>(study.seed));
  text(row.version);
  text(now());
  for (const double x : row.varied) number(x);
  for (const Value& v : e.figures) {
    number(v.value);
    number(v.lower);
    number(v.upper);
  }
  const int code = sqlite3_step(s);
  sqlite3_reset(s);
  if (code != SQLITE_DONE) return failed(code);
  return {};
}

Result<std::vector<Row>> Store::rows() const {
  return impl_->rows_of("evaluation");
}

Result<std::vector<Row>> Store::samples() const {
  return impl_->rows_where_there(kSamples);
}

Status Store::Impl::replace_rows(const char* table, const std::vector<Row>& rows) const {
  POLYPOD_TRY(run(fmt::format("DROP TABLE IF EXISTS {}", table)));
  if (rows.empty()) return {};
  POLYPOD_TRY(run(fmt::format("CREATE TABLE {} ({})", table, typed_columns(study))));
  POLYPOD_ASSIGN(into, prepare_insert(table));
  for (const Row& row : rows) POLYPOD_TRY(add(into.get(), row));
  return {};
}

Status Store::set_judged_again(int resolution, const std::vector<Row>& rows) {
  POLYPOD_TRY(impl_->run("BEGIN IMMEDIATE"));
  POLYPOD_TRY(impl_->replace_rows(kAgain, rows));
  POLYPOD_TRY(impl_->set_meta(kAgain, fmt::format("{}", resolution)));
  return impl_->run("COMMIT");
}

Result<std::pair<int, std::vector<Row>>> Store::judged_again() const {
  POLYPOD_ASSIGN(resolution, impl_->meta(kAgain));
  POLYPOD_ASSIGN(rows, impl_->rows_where_there(kAgain));
  return std::pair(std::atoi(resolution.c_str()), std::move(rows));
}

Status Store::set_compared(const std::vector<Row>& rows) {
  POLYPOD_TRY(impl_->run("BEGIN IMMEDIATE"));
  POLYPOD_TRY(impl_->replace_rows(kCompared, rows));
  return impl_->run("COMMIT");
}

Result<std::vector<Row>> Store::compared() const {
  return impl_->rows_where_there(kCompared);
}

Result<std::string> Store::note(const std::string& key) const {
  return impl_->meta(key);
}

Status Store::set_note(const std::string& key, const std::string& text) {
  return impl_->set_meta(key, text);
}

Result<std::vector<Row>> Store::Impl::rows_of(const char* table) const {
  std::string names;
  for (const std::string& c : columns_of(study)) names += (names.empty() ? "" : ", ") + quoted(c);
  POLYPOD_ASSIGN(s, prepare(fmt::format("SELECT {} FROM {} ORDER BY row", names, table)));
  std::vector<Row> out;
  {
    POLYPOD_ASSIGN(count, prepare(fmt::format("SELECT count(*) FROM {}", table)));
    if (sqlite3_step(count.get()) == SQLITE_ROW)
      out.reserve(static_cast<std::size_t>(sqlite3_column_int64(count.get(), 0)));
  }
  const std::size_t varied = study.vary.size(), figures = study.figures().size();
  int code = 0;
  while ((code = sqlite3_step(s.get())) == SQLITE_ROW) {
    int at = 0;
    constexpr double kInf = std::numeric_limits<double>::infinity(), kNone = std::numeric_limits<double>::quiet_NaN();
    const auto number = [&](double otherwise) {
      const int column = at++;
      return sqlite3_column_type(s.get(), column) == SQLITE_NULL ? otherwise : sqlite3_column_double(s.get(), column);
    };
    const auto text = [&]() -> std::string {
      const int column = at++;
      const auto* bytes = reinterpret_cast<const char*>(sqlite3_column_text(s.get(), column));
      return bytes == nullptr ? "" : bytes;
    };
    Row row;
    Evaluation& e = row.evaluation;
    row.row = sqlite3_column_int64(s.get(), at++);
    e.state = state_of(text());
    e.reason = text();
    row.phase = phase_of(text());
    e.objective.value = number(kNone);
    e.objective.lower = number(e.objective.value);
    e.objective.upper = number(std::isnan(e.objective.value) ? kNone : kInf);
    e.violation = number(kInf);
    e.seconds = number(0);
    ++at;  // the seed is that of the study
    row.version = text();
    row.at = text();
    row.varied.reserve(varied);
    e.figures.reserve(figures);
    for (std::size_t i = 0; i < varied; ++i) row.varied.push_back(number(kNone));
    for (std::size_t i = 0; i < figures; ++i) {
      Value v;
      v.value = number(kNone);
      v.lower = number(v.value);
      v.upper = number(v.value);
      e.figures.push_back(v);
    }
    out.push_back(std::move(row));
  }
  if (code != SQLITE_DONE) return failed(code);
  return out;
}

Status Store::set_complete(bool complete) {
  return impl_->set_meta("complete", complete ? "yes" : "no");
}

Result<bool> Store::complete() const {
  POLYPOD_ASSIGN(text, impl_->meta("complete"));
  return text == "yes";
}

Status Store::close() {
  impl_->insert.reset();
  impl_->insert_sample.reset();
  // Another program that has the database open keeps the journal beside it; every row is there all the same.
  constexpr int kShort_ms = 500;
  sqlite3_busy_timeout(impl_->db.get(), kShort_ms);
  const int code = sqlite3_exec(impl_->db.get(), "PRAGMA journal_mode = DELETE", nullptr, nullptr, nullptr);
  const bool busy = (code & kKindOfError) == SQLITE_BUSY || (code & kKindOfError) == SQLITE_LOCKED;
  return code == SQLITE_OK || busy ? Status() : impl_->failed(code);
}

}  // namespace polypod::design
