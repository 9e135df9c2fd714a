// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// The only source file that sees CLI11: it compiles slowly.
#include <fmt/format.h>
#include <unistd.h>

#include <CLI/CLI.hpp>
#include <algorithm>
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
#include "polypod/app/program.hpp"
#include "polypod/core/files.hpp"
#include "polypod/core/text.hpp"

namespace polypod::app {
namespace {

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
    const std::string name = names.substr(names.rfind(',') + 1);
    return app_.add_option_function<std::string>(
        names,
        [&value, &wrong = wrong_, name, range, read](const std::string& text) {
          const Result<Number> given = read(text, name, range);
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

/// The commands that know an option, "workspace, sweep"; empty where none does.
std::string commands_with(const CLI::App& app, const std::string& option, const std::string& before = "") {
  std::string out;
  for (const CLI::App* sub : app.get_subcommands([](const CLI::App*) { return true; })) {
    const std::string name = before + sub->get_name();
    std::string found = sub->get_option_no_throw(option) != nullptr ? name : commands_with(*sub, option, name + " ");
    if (!found.empty()) out += (out.empty() ? "" : ", ") + found;
  }
  return out;
}

/// What is wrong with a command line that CLI11 refuses: an option of other commands alone (AP107) or a command that
/// there is not (AP108) are named, the rest is CLI11's text (AP116).
std::string what_is_wrong(const CLI::App& app, const CLI::ParseError& e, int argc, char** argv) {
  const CLI::App* chosen = &app;
  for (auto subs = app.get_subcommands(); !subs.empty(); subs = chosen->get_subcommands()) chosen = subs.front();
  if (chosen == &app && argc > 1 && argv[1][0] != '-') {
    return to_string(
        Error{"AP108", fmt::format("there is no command \"{}\"", argv[1]), {}, "`polypod --help` lists the commands"});
  }
  for (int i = 2; i < argc && chosen != &app; ++i) {
    const std::string option = std::string(argv[i]).substr(0, std::string(argv[i]).find('='));
    if (option.rfind("--", 0) != 0 || chosen->get_option_no_throw(option) != nullptr) continue;
    const std::string others = commands_with(app, option);
    if (others.empty()) break;
    return to_string(Error{"AP107",
                           fmt::format("{} does nothing in `{}`", option, chosen->get_name()),
                           {},
                           fmt::format("it serves {}", others)});
  }
  return to_string(Error{"AP116", e.what(), {}, {}});
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

int standard_output_failed() {
  std::fprintf(stderr, "polypod: %s\n",
               to_string(Error{"AP117",
                               "standard output cannot be written",
                               {},
                               files::outputs_appeared() ? "the files that the command writes are there, whole"
                                                         : "the command has written no file"})
                   .c_str());
  return kBadInput;
}

/// `status` if what was printed has reached standard output.
int shown(int status) {
  std::cout.flush();
  const bool reached = std::cout.good() && std::fflush(stdout) == 0 && std::ferror(stdout) == 0;
  return reached ? status : standard_output_failed();
}

int run_command(int argc, char** argv) {
  std::vector<std::string> named = with_names_of_now(argc, argv);
  std::vector<char*> words;
  for (std::string& word : named) words.push_back(word.data());
  CLI::App app{
      "Polypod: machines that cut and handle with arms and legs.\n"
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
  std::optional<Error> wrong_number;
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
    CliArguments arguments(*sub, wrong_number);
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
  try {
    app.parse(argc, words.data());
  } catch (const CLI::ParseError& e) {
    if (e.get_exit_code() == 0) return shown(app.exit(e));  // --help, --version
    fmt::print(stderr, "polypod: {}\nRun `polypod --help` or `polypod COMMAND --help`.\n",
               one_line(wrong_number ? to_string(*wrong_number) : what_is_wrong(app, e, argc, words.data())));
    return kBadInput;
  }
  if (wrong_number) {
    fmt::print(stderr, "polypod: {}\n", to_string(*wrong_number));
    return kBadInput;
  }
  const Result<int> status = chosen(context);
  if (!status) {
    constexpr const char* kEnded = "FI103";
    if (status.error().id == kEnded) wait_for_interrupt();
    if (interrupted()) return kBadInput;  // what was broken off is no error of the input
    fmt::print(stderr, "polypod: {}\n", to_string(status.error()));
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
