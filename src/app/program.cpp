// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// The only source file that sees CLI11: it compiles slowly.
#include <fmt/format.h>
#include <poll.h>
#include <unistd.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <array>
#include <csignal>
#include <cstdio>
#include <exception>
#include <iostream>
#include <new>
#include <string>
#include <string_view>
#include <system_error>
#include <vector>

#include "command.hpp"
#include "interrupt.hpp"
#include "messages.hpp"
#include "polypod/app/program.hpp"
#include "polypod/core/files.hpp"
#include "polypod/core/nearest_word.hpp"
#include "polypod/core/text.hpp"

namespace polypod::app {
namespace {

/// The unit of an option: what its name ends with (--noise-um), or what its help says behind a comma or a colon, or
/// first ("Grid over the workspace, mm (default 20)", "deg/s or mm/s"); empty where neither says one.
std::string unit_of_option(const std::string& name, const std::string& help) {
  constexpr std::array<std::string_view, 19> kUnits{
      "mm",    "um",    "m",      "deg",    "rad",    "N",       "K",  "%",       "mm/s",          "mm/s2",
      "mm/s3", "deg/s", "deg/s2", "deg/s3", "mm/min", "deg/min", "MB", "percent", "um per m and K"};
  const auto is_unit = [&](std::string_view text) {
    return std::find(kUnits.begin(), kUnits.end(), text) != kUnits.end();
  };
  const std::string last = name.substr(name.rfind('-') + 1);
  const auto shown = [](std::string_view unit) { return unit == "percent" ? std::string("%") : std::string(unit); };
  if (is_unit(last)) return shown(last);
  for (std::size_t at = 0; at < help.size();) {
    std::string_view phrase = std::string_view(help).substr(at);
    phrase = phrase.substr(0, phrase.find_first_of(",:;("));
    while (phrase.ends_with(' ')) phrase.remove_suffix(1);
    const std::size_t either = phrase.find(" or ");
    if (either != std::string_view::npos && is_unit(phrase.substr(0, either)) && is_unit(phrase.substr(either + 4))) {
      return std::string(phrase);
    }
    if (is_unit(phrase)) return shown(phrase);
    if (const std::string_view first = phrase.substr(0, phrase.find(' ')); is_unit(first)) return shown(first);
    const std::size_t next = help.find_first_of(",:", at);
    if (next == std::string::npos) break;
    at = next + 2;
  }
  return "";
}

class CliArguments : public Arguments {
 public:
  /// `wrong` takes the first option whose number is refused.
  CliArguments(CLI::App& app, std::optional<Error>& wrong) : app_(app), wrong_(wrong) {}
  void positional(const char* name, std::string& value, const char* help, bool required) override {
    app_.add_option(name, value, help)->required(required);
  }
  void positional(const char* name, std::vector<std::string>& values, const char* help) override {
    app_.add_option(name, values, help)->required();
  }
  void option(const char* names, std::string& value, const char* help, bool required) override {
    app_.add_option(names, value, help)->required(required);
  }
  void option(const char* names, double& value, const char* help, bool required) override {
    option(names, value, kAnyNumber, help, required);
  }
  void option(const char* names, int& value, const char* help, bool required) override {
    option(names, value, kAnyCount, help, required);
  }
  void option(const char* names, double& value, config::Range range, const char* help, bool required) override {
    number(names, value, range, help, number_of)->required(required)->type_name("FLOAT");
  }
  void option(const char* names, int& value, config::Range range, const char* help, bool required) override {
    number(names, value, range, help, count_of)->required(required)->type_name("INT");
  }
  void option(const char* names, std::vector<std::string>& values, const char* help, bool required) override {
    app_.add_option(names, values, help)->required(required)->allow_extra_args(false);
  }
  void options(const char* names, std::vector<std::string>& values, const char* help) override {
    app_.add_option(names, values, help);
  }
  void flag(const char* names, bool& value, const char* help) override { app_.add_flag(names, value, help); }

 private:
  template <class Number, class Read>
  CLI::Option* number(const std::string& names, Number& value, config::Range range, const char* help, Read read) {
    const std::string name = names.substr(names.rfind(',') + 1), unit = unit_of_option(name, help);
    return app_.add_option_function<std::string>(
        names,
        [&value, &wrong = wrong_, name, range, unit, read](const std::string& text) {
          const Result<Number> given = read(text, name, range, unit);
          if (given) value = *given;
          if (!given && !wrong) wrong = given.error();
        },
        help);
  }

  CLI::App& app_;
  std::optional<Error>& wrong_;
};

/// "The answer is no" has its ids: out of reach, out of tolerance.
int exit_status(const Error& error) {
  return error.id.rfind("MC21", 0) == 0 || error.id.rfind("MC3", 0) == 0 ? kAnswerIsNo : kBadInput;
}

constexpr const char* kHelp = "help";

std::vector<const CLI::App*> commands_in(const CLI::App& app) {
  return app.get_subcommands([](const CLI::App*) { return true; });
}

/// The commands that know an option, "workspace, sweep"; empty where none does.
std::string commands_with(const CLI::App& app, const std::string& option, const std::string& before = "") {
  std::string out;
  for (const CLI::App* sub : commands_in(app)) {
    const std::string name = before + sub->get_name();
    std::string found = sub->get_option_no_throw(option) != nullptr ? name : commands_with(*sub, option, name + " ");
    if (!found.empty()) out += (out.empty() ? "" : ", ") + found;
  }
  return out;
}

const CLI::App* subcommand_of(const CLI::App& app, const std::string& name) {
  for (const CLI::App* sub : commands_in(app))
    if (sub->get_name() == name) return sub;
  return nullptr;
}

/// "polypod identify compliance"
std::string line_of(const CLI::App& app) {
  return (app.get_parent() == nullptr ? "" : line_of(*app.get_parent()) + " ") + app.get_name();
}

/// There is no command `name` in `app`, which is the program or a command that has commands of its own.
Error no_command(const CLI::App& app, const std::string& name) {
  const std::string before = app.get_parent() == nullptr ? "" : app.get_name() + " ";
  std::vector<std::string> known;
  for (const CLI::App* sub : commands_in(app)) known.push_back(before + sub->get_name());
  return {"AP108",
          fmt::format("there is no command \"{}{}\"", before, name),
          {},
          did_you_mean(before + name, known) +
              fmt::format("`{} --help` lists {}", line_of(app), known.empty() ? "its options" : "the commands")};
}

/// `help identify compliance` as `identify compliance --help`, so that both print one text; every other command line as
/// it is. Errors: AP108.
Result<std::vector<std::string>> without_help_command(const CLI::App& app, std::vector<std::string> words) {
  const auto is_option = [](const std::string& word) { return word.starts_with('-'); };
  if (words.size() < 2 || words[1] != kHelp || std::any_of(words.begin() + 2, words.end(), is_option)) return words;
  const CLI::App* at = &app;
  for (std::size_t i = 2; i < words.size(); ++i) {
    const CLI::App* sub = subcommand_of(*at, words[i]);
    if (sub == nullptr) return tl::unexpected(no_command(*at, words[i]));
    at = sub;
  }
  words.erase(words.begin() + 1);
  words.emplace_back("--help");
  return words;
}

/// An option that `command` does not know: it serves others alone (AP107), or nobody (AP116).
Error no_option(const CLI::App& app, const CLI::App& command, const std::string& option) {
  const std::string others = commands_with(app, option);
  if (!others.empty()) {
    return {"AP107", fmt::format("{} does nothing in `{}`", option, command.get_name()), {}, "it serves " + others};
  }
  std::vector<std::string> known;
  for (const CLI::Option* of : command.get_options())
    for (const std::string& name : of->get_lnames()) known.push_back("--" + name);
  return {"AP116",
          fmt::format("{} is no option of `{}`", option, line_of(command)),
          {},
          did_you_mean(option, known) + fmt::format("`{} --help` lists them", line_of(command))};
}

/// What is wrong with a command line that CLI11 refuses: an option or a command that there is not is named, the rest is
/// CLI11's text (AP116).
Error what_is_wrong(const CLI::App& app, const CLI::ParseError& e, const std::vector<std::string>& words) {
  const CLI::App* chosen = &app;
  auto next = words.begin() + 1;  // the first word after the command
  for (auto subs = app.get_subcommands(); !subs.empty(); subs = chosen->get_subcommands()) {
    chosen = subs.front();
    next = std::find(next, words.end(), chosen->get_name()) + 1;
  }
  const bool has_commands = !commands_in(*chosen).empty();
  if (has_commands && next != words.end() && !next->starts_with('-')) return no_command(*chosen, *next);
  for (; next != words.end() && *next != "--"; ++next) {
    const std::string option = next->substr(0, next->find('='));
    if (option.starts_with("--") && chosen->get_option_no_throw(option) == nullptr) {
      return no_option(app, *chosen, option);
    }
  }
  return {"AP116", e.what(), {}, {}};
}

/// An option of the command that was chosen, whose value is nothing, as of a variable of a script that is not set: a
/// file without a name would be none, in silence (AP116).
std::optional<Error> without_value(const CLI::App& app) {
  for (const CLI::App* sub : app.get_subcommands()) {
    if (auto wrong = without_value(*sub)) return wrong;
  }
  for (const CLI::Option* option : app.get_options()) {
    const std::vector<std::string>& values = option->results();
    if (option->get_lnames().empty() || std::find(values.begin(), values.end(), "") == values.end()) continue;
    return Error{
        "AP116", fmt::format("--{} has no value", option->get_lnames().front()), {}, "give one, or leave it out"};
  }
  return std::nullopt;
}

// words: off
struct Renamed {
  const char *command, *before, *now;
};
constexpr Renamed kRenamed[] = {
    {"budget", "--warming", "--temperature-rise"},
    {"calibrate", "--hold", "--fix"},
    {"calibrate", "--hold-back", "--validation"},
    {"delta", "--border", "--boundary"},
    {"dexterity", "--clearance", "--singularity-distance"},
    {"errors", "--clearance", "--singularity-distance"},
    {"ik", "--free-twist", "--free-rotation"},
    {"move", "--clearance", "--singularity-distance"},
    {"pick", "--clearance", "--singularity-distance"},
    {"pick", "--lift", "--clearance-height"},
    {"pick", "--rounding", "--corner-blend"},
    {"poses", "--hold", "--fix"},
    {"section", "--clearance", "--singularity-distance"},
    {"sweep", "--clearance", "--singularity-distance"},
    {"tolerances", "--clearance", "--singularity-distance"},
    {"tolerances", "--wanted", "--required"},
    {"tolerances", "--wanted-angle", "--required-angle"},
    {"workspace", "--clearance", "--singularity-distance"},
};
// words: on

/// The arguments with the options that have other names now; those of before keep working, and no help shows them.
std::vector<std::string> with_names_of_now(int argc, char** argv) {
  std::vector<std::string> out(argv, argv + argc);
  if (out.empty()) out.emplace_back("polypod");
  for (std::size_t i = 2; i < out.size(); ++i) {
    const std::size_t end = std::min(out[i].find('='), out[i].size());
    for (const Renamed& r : kRenamed) {
      if (out[1] == r.command && out[i].compare(0, end, r.before) == 0) {
        out[i].replace(0, end, r.now);
        break;
      }
    }
  }
  return out;
}

/// Whether whoever read standard output has enough of it, as `| head`.
bool nobody_reads() {
  pollfd output{STDOUT_FILENO, 0, 0};
  return poll(&output, 1, 0) == 1 && (output.revents & POLLERR) != 0;
}

int standard_output_failed() {
  if (nobody_reads() && !files::outputs_appeared()) return kBadInput;
  std::fprintf(
      stderr, "polypod: %s\n",
      to_string(Error{"AP117",
                      "standard output cannot be written",
                      {},
                      files::outputs_appeared() ? "the files that the command has written are there, whole"
                                                : "the command has written no file; evaluations of a study are kept"})
          .c_str());
  return kBadInput;
}

/// `status` if what was printed has reached standard output.
int shown(int status) {
  std::cout.flush();
  const bool reached = std::cout.good() && std::fflush(stdout) == 0 && std::ferror(stdout) == 0;
  return reached ? status : standard_output_failed();
}

/// It is listed and has a help of its own; without_help_command does what it is for.
void declare_help(CLI::App& app, std::vector<std::string>& command) {
  CLI::App* help =
      app.add_subcommand(kHelp, "How the program or a command is used: what `polypod COMMAND --help` prints");
  help->add_option("COMMAND", command, "As `workspace` or `identify compliance`; without one the list of all commands");
  help->footer("Example:\n  polypod help workspace");
}

int run_command(int argc, char** argv) {
  CLI::App app{
      "Polypod: kinematics, calibration and machining of parallel and serial machines.\n"
      "Lengths are mm, angles deg, forces N, deflections um, unless a name says otherwise.",
      "polypod"};
  app.set_version_flag("--version", POLYPOD_VERSION);
  app.require_subcommand(1);
  app.failure_message(CLI::FailureMessage::simple);
  // `polypod identify compliance ...` is a command of two words: its first word is a command with commands of its own.
  std::vector<Command> commands = all_commands();
  std::map<std::string, CLI::App*> groups;
  Context context;
  context.progress = ::isatty(STDERR_FILENO) != 0;
  std::function<Result<int>(const Context&)> chosen;
  std::optional<Error> wrong_value;
  for (Command& command : commands) {
    CLI::App* parent = &app;
    std::string name = command.name;
    if (const std::size_t space = name.find(' '); space != std::string::npos) {
      const std::string group = name.substr(0, space);
      name = name.substr(space + 1);
      if (!groups.contains(group)) {
        groups[group] = app.add_subcommand(group, "");
        groups[group]->require_subcommand(1);
      }
      parent = groups[group];
      const std::string before = parent->get_description();
      parent->description(before.empty() ? command.summary : before + "; " + command.summary);
    }
    CLI::App* sub = parent->add_subcommand(name, command.summary);
    CliArguments arguments(*sub, wrong_value);
    command.declare(arguments);
    sub->add_flag("--json", context.json, "Print one JSON document to stdout");
    sub->footer("Example:\n  " + command.example);
    sub->callback([&chosen, &command, &context, sub] {
      chosen = command.run;
      context.given = [sub](const std::string& option) {
        const CLI::Option* known = sub->get_option_no_throw(option);
        return known != nullptr && known->count() > 0;
      };
    });
  }
  std::vector<std::string> nobody_asks;
  declare_help(app, nobody_asks);  // without_help_command has done it before
  const std::vector<std::string> given = with_names_of_now(argc, argv);
  Result<std::vector<std::string>> words = without_help_command(app, given);
  const auto refused = [](const Error& error) {
    fmt::print(stderr, "polypod: {}\nRun `polypod --help` or `polypod COMMAND --help`.\n", to_string(error));
    return kBadInput;
  };
  if (!words) return refused(words.error());
  keep_command_line(given);
  try {
    app.parse(std::vector<std::string>(words->rbegin(), words->rend() - 1));  // CLI11 takes them from the back
  } catch (const CLI::ParseError& e) {
    if (e.get_exit_code() == 0) return shown(app.exit(e));  // --help, --version
    return refused(wrong_value ? *wrong_value : what_is_wrong(app, e, *words));
  }
  if (!wrong_value) wrong_value = without_value(app);
  if (wrong_value) {
    print_error(context, *wrong_value);
    return kBadInput;
  }
  const Result<int> status = chosen(context);
  if (!status) {
    constexpr const char* kEnded = "FI103";
    if (status.error().id == kEnded) wait_for_interrupt();
    if (interrupted()) return kBadInput;  // what was broken off is no error of the input
    print_error(context, status.error());
    const int answer = exit_status(status.error());
    if (context.json) print_json({{"error", error_json(status.error())}});
    return answer;
  }
  return shown(*status);
}

/// Whether TBB could not start a thread: it says so by the name of the call.
bool lacks_threads(const std::exception& e) {
  return dynamic_cast<const NoThreads*>(&e) != nullptr || std::string_view(e.what()).find("pthread_") == 0;
}

/// `status`, or that of a signal that came before the outputs appeared.
int after_signals(int status) {
  const bool too_late = status <= kAnswerIsNo && files::outputs_appeared();
  return interrupted() && !too_late ? interrupted_status() : status;
}

}  // namespace

int run(int argc, char** argv) {
  try {
    files::open_standard_streams();
    std::signal(SIGPIPE, SIG_IGN);
    std::signal(SIGXFSZ, SIG_IGN);  // a file that may not become so large is an error of writing
    catch_interrupts();
    return after_signals(run_command(argc, argv));
  } catch (const std::bad_alloc&) {
    constexpr const char* kId = "AP109";
    std::fprintf(stderr,
                 "polypod: %s: there is not enough memory for this; "
                 "ask for less where the command lets you (--resolution, --rel-tol, --max-memory), or give it more\n",
                 kId);
    return kBadInput;
  } catch (const std::system_error&) {  // fmt throws it where stdout or stderr cannot be written
    return after_signals(standard_output_failed());
  } catch (const std::exception& e) {
    if (lacks_threads(e)) {
      constexpr const char* kId = "AP118";
      std::fprintf(stderr,
                   "polypod: %s: the system starts no more threads for this process; "
                   "raise its limits of memory and of processes (ulimit -v, ulimit -u)\n",
                   kId);
      return kBadInput;
    }
    std::fprintf(stderr, "polypod: this is a bug: %s\n", e.what());
    return kBug;
  }
}

}  // namespace polypod::app
