// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include <fmt/format.h>

#include <pthread.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <cctype>
#include <charconv>
#include <chrono>
#include <cmath>
#include <csignal>
#include <cstdio>
#include <cstring>
#include <filesystem>
#include <string_view>
#include <system_error>
#include <thread>

#include "command.hpp"
#include "interrupt.hpp"
#include "json_rows.hpp"
#include "messages.hpp"
#include "polypod/core/excerpt.hpp"
#include "polypod/core/figures.hpp"
#include "polypod/core/files.hpp"
#include "polypod/core/named_files.hpp"
#include "polypod/core/nearest_word.hpp"
#include "polypod/core/range_text.hpp"
#include "polypod/core/units.hpp"
#include "polypod/gcode/calls.hpp"
#include "polypod/kinematics/any_machine.hpp"
#include "polypod/machine/urdf.hpp"
#include "polypod/statics/compliance.hpp"

namespace polypod::app {

namespace {
std::atomic<int> ending_signal{0};
std::atomic<bool> said{false};

void say_interrupted() {
  if (said.exchange(true)) return;
  const std::string_view text =
      ::isatty(STDERR_FILENO) != 0 ? "\r\x1b[Kpolypod: interrupted\n" : "polypod: interrupted\n";
  [[maybe_unused]] const auto written = ::write(STDERR_FILENO, text.data(), text.size());
}

/// Waits for a signal, and 100 ms later or at the next one for nobody: the kernel takes up to 60 ms more to take back
/// the memory of a large run.
void end_on_signal(sigset_t ending) {
  int signal = 0;
  if (sigwait(&ending, &signal) != 0) return;
  files::close_outputs();
  ending_signal = signal;
  constexpr timespec kGrace{0, 100'000'000};
  sigtimedwait(&ending, nullptr, &kGrace);
  say_interrupted();
  files::remove_temporaries();
  ::_exit(128 + signal);
}
}  // namespace

void catch_interrupts() {
  std::signal(SIGINT, SIG_DFL);  // a shell that starts a program with & ignores it for the program
  sigset_t ending;
  sigemptyset(&ending);
  for (const int signal : {SIGINT, SIGTERM, SIGHUP, SIGQUIT, SIGXCPU}) {
    struct sigaction now {};
    sigaction(signal, nullptr, &now);
    if (now.sa_handler != SIG_IGN) sigaddset(&ending, signal);  // nohup ignores SIGHUP for the program, and so it stays
  }
  pthread_sigmask(SIG_BLOCK, &ending, nullptr);  // threads that are started later inherit it
  try {
    std::thread(end_on_signal, ending).detach();
  } catch (const std::system_error&) {
    throw NoThreads();
  }
}
bool interrupted() {
  return ending_signal != 0;
}
void wait_for_interrupt() {
  for (int i = 0; i < 1000 && !interrupted(); ++i) std::this_thread::sleep_for(std::chrono::milliseconds(1));
}
int interrupted_status() {
  if (!interrupted()) return 0;
  say_interrupted();
  return 128 + ending_signal;
}

namespace {

tl::unexpected<Error> not_taken(const std::string& option, const std::string& text, const char* what,
                                config::Range range, const std::string& unit) {
  const bool any = range.min == kAnyCount.min && range.max == kAnyCount.max;  // what an int holds is no news
  const std::string bounds = any ? "" : ", " + config::in_words(range, unit);
  return fail("AP115", fmt::format("{} {}: must be {}{}", option, text, what, bounds), {},
              "`polypod COMMAND --help` says what the option means");
}

bool within(double value, config::Range range) {
  return value >= range.min && value <= range.max && !(range.open_min && value == range.min) &&
         !(range.open_max && value == range.max);
}

/// The whole text as a number, with or without a sign.
template <class Number>
bool reads_as(std::string_view text, Number& value) {
  if (text.starts_with('+')) text.remove_prefix(1);
  const auto [rest, code] = std::from_chars(text.data(), text.data() + text.size(), value);
  return code == std::errc{} && rest == text.data() + text.size();
}

}  // namespace

Result<double> number_of(const std::string& text, const std::string& option, config::Range range,
                         const std::string& unit) {
  double value = 0;
  if (!reads_as(text, value) || !within(value, range)) return not_taken(option, text, "a number", range, unit);
  return value;
}

Result<int> count_of(const std::string& text, const std::string& option, config::Range range, const std::string& unit) {
  int value = 0;
  if (!reads_as(text, value) || !within(value, range)) return not_taken(option, text, "a whole number", range, unit);
  return value;
}

std::string unsigned_zero(std::string text) {
  const bool zero = text.starts_with('-') && text.find_first_of("123456789") == std::string::npos;
  return zero ? text.substr(1) : text;
}

Status in_range(const char* id, const std::string& option, double value, config::Range range, const std::string& unit) {
  if (within(value, range)) return {};
  return fail(id, fmt::format("{} {}: must be {}", option, value, config::in_words(range, unit)));
}

Result<std::vector<double>> numbers_of(const std::string& text, const std::string& option) {
  std::vector<double> out;
  const char* p = text.data();
  const char* end = p + text.size();
  const auto bad = [&] {
    return fail("AP100",
                fmt::format("{} {}: not a list of numbers of at most {:g} in size", option, text, kAnyNumber.max), {},
                "write numbers with commas between them: 1,-2.5,3");
  };
  while (true) {
    while (p != end && *p == ' ') ++p;
    if (p != end && *p == '+') ++p;
    double value = 0;
    const auto [rest, code] = std::from_chars(p, end, value);
    if (code != std::errc{} || !within(value, kAnyNumber)) return bad();
    out.push_back(value);
    p = rest;
    while (p != end && *p == ' ') ++p;
    if (p == end) return out;
    if (*p++ != ',') return bad();
  }
}

Status refuse(const Context& context, const std::vector<std::string>& options, const std::string& serves) {
  for (const std::string& option : options) {
    if (!context.given(option)) continue;
    return fail("AP107", fmt::format("{} does nothing here", option), {}, serves);
  }
  return {};
}

namespace {

std::string without_digits(std::string text) {
  std::erase_if(text, [](char c) { return std::isdigit(static_cast<unsigned char>(c)) != 0; });
  return text;
}

/// The error of a key that the machine does not have, with the nearest one that it has.
Error with_nearest_key(Error error, const std::string& name, const std::vector<machine::Override>& overrides) {
  const bool of_key = error.id == "MA102" || error.id == "CF103";
  if (!of_key || !error.place.file.starts_with("--set") || error.hint.starts_with("did you mean") ||
      files::is_standard_input(name)) {
    return error;
  }
  const auto machine = machine::load(name, {});
  if (!machine) return error;
  std::vector<std::string> known;
  for (const machine::Parameter& p : machine::settings(*machine)) known.push_back(machine::key_of(p));
  for (const machine::Parameter& p : kinematics::parameters(*machine)) known.push_back(machine::key_of(p));
  for (const machine::Override& given : overrides) {
    if (!error.message.ends_with(" " + given.key)) continue;
    const auto another_number = [&](const std::string& key) {
      return without_digits(key) == without_digits(given.key);
    };
    if (std::any_of(known.begin(), known.end(), another_number)) continue;  // there is no ninth joint
    error.hint = did_you_mean(given.key, known) + error.hint;
    break;
  }
  return error;
}

}  // namespace

Result<machine::AnyMachine> machine_of(const std::string& name, const std::vector<std::string>& sets) {
  std::vector<machine::Override> overrides;
  for (const std::string& set : sets) {
    const std::size_t equals = set.find('=');
    if (equals == std::string::npos || equals == 0) {
      return fail("AP102", fmt::format("--set {}: no key=value", set), {}, "write --set tool.length_mm=120");
    }
    overrides.push_back({set.substr(0, equals), set.substr(equals + 1)});
  }
  return machine::load(name, overrides).map_error([&](Error error) {
    return with_nearest_key(std::move(error), name, overrides);
  });
}

void declare_machine(Arguments& arguments, std::string& name, std::vector<std::string>& sets) {
  arguments.positional("MACHINE", name, "A machine file or a name of `polypod machines`");
  arguments.option("--set", sets, "key=value: override a parameter of the machine (repeatable)");
}

Result<Pose> pose_argument(const machine::AnyMachine& machine, const std::string& text) {
  POLYPOD_ASSIGN(c, numbers_of(text, "--pose"));
  const machine::Task task = kinematics::task(machine);
  const int most = task.size(), least = std::min(3, most);
  if (static_cast<int>(c.size()) < least || static_cast<int>(c.size()) > most) {
    std::string names;
    for (int i = 0; i < most; ++i) {
      names += fmt::format("{}{}{}", i == least ? "[" : "", i > 0 ? "," : "", machine::name_of(task[i]));
    }
    if (most > least) names += "]";
    return fail("AP101", fmt::format("--pose {}: {} numbers, but this machine takes {}", text, c.size(), names), {},
                "lengths in mm, angles in deg");
  }
  for (std::size_t i = 0; i < c.size(); ++i) {
    const bool angle = task.is_angle(static_cast<int>(i));
    if (std::abs(c[i]) > kAnyCoordinate.max) {
      return fail("AP101", fmt::format("--pose {}: {:g} {} is beyond any machine", text, c[i], angle ? "deg" : "mm"),
                  {}, fmt::format("coordinates are at most {:g} in size", kAnyCoordinate.max));
    }
    c[i] = angle ? units::from_deg(c[i]) : units::from_mm(c[i]);
  }
  return kinematics::pose_of(task, c);
}

std::vector<double> pose_for_user(const machine::AnyMachine& machine, const Pose& X) {
  const machine::Task task = kinematics::task(machine);
  std::vector<double> c = kinematics::coordinates_of(task, X);
  for (std::size_t i = 0; i < c.size(); ++i) {
    c[i] = task.is_angle(static_cast<int>(i)) ? units::to_deg(c[i]) : units::to_mm(c[i]);
  }
  return c;
}

std::vector<double> whole_pose_for_user(const Pose& X) {
  const Vec3 abc = angles_abc(X.R);
  std::vector<double> out;
  for (int k = 0; k < 3; ++k) out.push_back(units::to_mm(X.p[k]) + 0.0);  // + 0.0: no negative zero
  for (int k = 0; k < 3; ++k) {
    constexpr double kHalfTurn = 180, kRounding = 1e-9;
    const double angle = units::to_deg(abc[k]);
    out.push_back(angle < kRounding - kHalfTurn ? kHalfTurn : angle + 0.0);  // not -180 by rounding
  }
  return out;
}

std::string pose_text(const machine::AnyMachine& machine, const Pose& X, int digits) {
  const Figures length(units::to_mm(X.p.norm()), digits);
  std::string out;
  int k = 0;
  for (const double c : pose_for_user(machine, X)) {
    const double angle = std::abs(c) < 0.5 * std::pow(10.0, -digits) ? 0 : c;  // not -0.00
    out += (out.empty() ? "" : ", ") +
           (kinematics::task(machine).is_angle(k++) ? fmt::format("{:.{}f}", angle, digits) : length(c));
  }
  return out;
}

namespace {

/// A file that a command reads: an argument, or what the file `from` names.
struct Input {
  std::string path;
  std::string from;
};

/// Whether an output is a file beside a program that it may call, itself or through others.
bool is_subprogram_of(const std::string& program, const std::string& output) {
  const std::filesystem::path file(output);
  std::error_code none;
  if (file.extension() != ".ngc" || !program.ends_with(".ngc") || !std::filesystem::is_regular_file(file, none) ||
      !std::filesystem::equivalent(std::filesystem::absolute(file, none).parent_path(),
                                   std::filesystem::absolute(program, none).parent_path(), none)) {
    return false;
  }
  const std::vector<std::string> called = gcode::files_called(program);
  return std::any_of(called.begin(), called.end(),
                     [&](const std::string& one) { return files::same_file(one, output); });
}

Result<std::vector<Input>> inputs_of(const std::vector<std::string>& given) {
  std::vector<Input> all;
  for (const std::string& name : given) {
    const std::string path = files::is_standard_input(name) ? "/dev/stdin" : machine::file_of_machine(name);
    std::error_code none;
    if (path.empty() || !std::filesystem::exists(path, none)) continue;  // a name of the catalogue, or soon an error
    const auto same = [&](const Input& other) { return files::same_file(other.path, path); };
    if (std::any_of(all.begin(), all.end(), same)) {
      return fail("AP106", fmt::format("{} is given twice", name), {}, "what is given twice would count twice");
    }
    all.push_back({path, ""});
  }
  for (std::size_t i = 0, count = all.size(); i < count; ++i) {
    if (!all[i].path.ends_with(".toml")) continue;
    for (const std::string& file : config::files_named_by(all[i].path)) all.push_back({file, all[i].path});
  }
  return all;
}

}  // namespace

Status check_files(const std::vector<std::string>& inputs, const std::vector<std::string>& outputs, bool json) {
  POLYPOD_ASSIGN(read, inputs_of(inputs));
  const auto clash = [](const std::string& path, const std::string& why) {
    return fail("AP106", fmt::format("{} is {}", path, why), {}, "choose another output");
  };
  bool to_standard_output = false;
  for (std::size_t i = 0; i < outputs.size(); ++i) {
    const std::string& path = outputs[i];
    if (path.empty()) continue;
    for (const Input& input : read) {
      if (!files::same_file(input.path, path)) continue;
      return clash(path, input.from.empty() ? "read and would be written over"
                                            : "named in " + input.from + " and would be written over");
    }
    for (const Input& input : read) {
      if (is_subprogram_of(input.path, path))
        return clash(path, "called by " + input.path + " and would be written over");
    }
    const bool twice =
        std::any_of(outputs.begin(), outputs.begin() + static_cast<std::ptrdiff_t>(i),
                    [&](const std::string& other) { return !other.empty() && files::same_file(other, path); });
    if (twice) return clash(path, "named for two outputs");
    if (files::is_standard_output(path)) {
      to_standard_output = true;
    } else if (files::same_file(path, "-")) {
      return clash(path, "where standard output goes");
    }
    POLYPOD_TRY(files::may_write(path));
  }
  if (!to_standard_output) return {};
  if (json) {
    return fail("AP114", "--json and an output would both go to standard output", {},
                "give the output a file, or leave --json out");
  }
  return files::keep_standard_output_for_files();
}

Status needs_compliance(const machine::AnyMachine& machine) {
  return statics::needs_compliance(machine);
}

std::vector<double> joints_for_user(const machine::AnyMachine& machine, const machine::JointVector& q) {
  std::vector<double> out;
  for (int i = 0; i < q.size(); ++i) {
    const bool turns = kinematics::joint_kind(machine, i) == machine::JointKind::revolute;
    out.push_back(turns ? units::to_deg(q[i]) : units::to_mm(q[i]));
  }
  return out;
}

Json matrix_json(const Eigen::MatrixXd& M) {
  Json rows = Json::array();
  for (int i = 0; i < M.rows(); ++i) {
    Json row = Json::array();
    for (int j = 0; j < M.cols(); ++j) row.push_back(M(i, j));
    rows.push_back(row);
  }
  return rows;
}

Json vector_json(const Vec3& v) {
  return Json::array({v.x(), v.y(), v.z()});
}

void declare_columns(Arguments& arguments, std::vector<std::string>& columns) {
  arguments.option("--columns", columns,
                   "NAME=COLUMN: which column of the files is read under a name, as \"x_mm=X [m]\" (repeatable)");
}

void print_json(const Json& document) {
  fmt::print("{}\n", json_text(document));
}

int cannot_take(const Context& context, const std::string& reason, const char* which) {
  const Error error{"AP119", fmt::format("the machine cannot take {}: {}", which, reason), {}, {}};
  print_error(context, error);
  if (context.json) print_json({{"error", error_json(error)}});
  return kAnswerIsNo;
}

void print_error(const Context& context, const Error& error) {
  fmt::print(stderr, "{}polypod: {}\n{}", context.progress ? "\r\x1b[K" : "", to_string(error),
             context.json ? "" : excerpt(error));  // in the place of a line of progress
}

Json error_json(const Error& e) {
  return {{"id", e.id},           {"message", e.message},     {"file", e.place.file},
          {"line", e.place.line}, {"column", e.place.column}, {"hint", e.hint}};
}

std::string for_shell(const std::string& argument) {
  const auto plain = [](char c) {
    return std::isalnum(static_cast<unsigned char>(c)) != 0 || std::strchr("_-./=:,+", c) != nullptr;
  };
  if (!argument.empty() && std::all_of(argument.begin(), argument.end(), plain)) return argument;
  std::string out = "'";
  for (const char c : argument) out += c == '\'' ? std::string("'\\''") : std::string(1, c);
  return out + "'";
}

namespace {

/// "45 s", "3 min", "2 h 5 min": what is left, rounded up.
std::string in_words(std::chrono::duration<double> left) {
  const auto seconds = static_cast<long>(std::ceil(left.count()));
  if (seconds < 60) return fmt::format("{} s", seconds);
  const long minutes = (seconds + 59) / 60;
  if (minutes < 60) return fmt::format("{} min", minutes);
  return fmt::format("{} h {} min", minutes / 60, minutes % 60);
}

std::string& kept_command_line() {
  static std::string line;
  return line;
}

}  // namespace

const std::string& command_line() {
  return kept_command_line();
}

void keep_command_line(const std::vector<std::string>& words) {
  kept_command_line() = "polypod";
  for (std::size_t i = 1; i < words.size(); ++i) kept_command_line() += " " + for_shell(words[i]);
}

std::function<bool(double)> progress_line(const Context& context, std::string what,
                                          std::optional<std::chrono::steady_clock::time_point> since) {
  using Clock = std::chrono::steady_clock;
  static constexpr std::chrono::milliseconds kQuiet{2000}, kBetween{200};
  constexpr double kLeastShare = 0.01;  // from less nobody can say how long the rest takes
  return [shown = context.progress, what = std::move(what), since, begin = Clock::now(), last = Clock::now(),
          drawn = false](double share) mutable {
    const auto now = Clock::now();
    if (shown && now - since.value_or(begin) > kQuiet && now - last > kBetween && share < 1) {
      const std::chrono::duration<double> passed = now - begin;
      const std::string left =
          share < kLeastShare || passed < std::chrono::seconds(1)
              ? ""
              : fmt::format(", {} left{}", in_words(passed * (1 / share - 1)), since ? " of this stage" : "");
      fmt::print(stderr, "\r{} {:.0f} %{}\x1b[K", what, 100 * share, left);
      std::fflush(stderr);
      last = now;
      drawn = true;
    }
    if (drawn && share >= 1) fmt::print(stderr, "\r\x1b[K");
    return !interrupted();
  };
}

}  // namespace polypod::app
