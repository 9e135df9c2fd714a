// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// What a command of the program is. One file a command; no mathematics here.
#pragma once

#include <chrono>
#include <functional>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <vector>

#include "polypod/core/config.hpp"
#include "polypod/core/error.hpp"
#include "polypod/machine/any_machine.hpp"

namespace polypod::app {

using Json = nlohmann::ordered_json;

inline constexpr int kDone = 0;
inline constexpr int kAnswerIsNo = 1;
inline constexpr int kBadInput = 2;
inline constexpr int kBug = 3;

/// What an option takes of which nothing narrower is said: any number that a computation can bear.
inline constexpr config::Range kAnyNumber{-1e12, 1e12};
inline constexpr config::Range kForce_N{1e-3, 1e6};        ///< on a tool
inline constexpr config::Range kAnyCoordinate{-1e9, 1e9};  ///< mm or deg, as in files
inline constexpr config::Range kLength_mm{1e-3, 1e6};      ///< a characteristic length
inline constexpr config::Range kAnyCount{-2147483648.0, 2147483647.0};

/// Where a command declares its arguments. Names as CLI11 takes them: "-o,--output".
class Arguments {
 public:
  virtual ~Arguments() = default;
  virtual void positional(const char* name, std::string& value, const char* help, bool required = true) = 0;
  virtual void positional(const char* name, std::vector<std::string>& values, const char* help) = 0;
  virtual void option(const char* names, std::string& value, const char* help, bool required = false) = 0;
  /// A number of kAnyNumber, or a whole one.
  virtual void option(const char* names, double& value, const char* help, bool required = false) = 0;
  virtual void option(const char* names, int& value, const char* help, bool required = false) = 0;
  /// May be given several times.
  virtual void option(const char* names, std::vector<std::string>& values, const char* help, bool required = false) = 0;
  /// Takes all values that follow it, and may be given several times.
  virtual void options(const char* names, std::vector<std::string>& values, const char* help) = 0;
  virtual void flag(const char* names, bool& value, const char* help) = 0;
  /// A number of this range, in the unit of the option; what is none, is not finite or lies outside is refused before
  /// the command runs (AP115).
  virtual void option(const char* names, double& value, config::Range range, const char* help,
                      bool required = false) = 0;
  virtual void option(const char* names, int& value, config::Range range, const char* help, bool required = false) = 0;
};

/// How a command speaks: results to stdout, as one JSON document or as text; everything else to stderr.
struct Context {
  bool json = false;
  bool progress = false;  ///< stderr is a terminal
  /// Whether the command line gives this option of the command ("--box").
  std::function<bool(const std::string&)> given = [](const std::string&) { return false; };
};

struct Command {
  std::string name;
  std::string summary;
  std::string example;  ///< shown by --help
  std::function<void(Arguments&)> declare;
  std::function<Result<int>(const Context&)> run;
};

/// All commands, in the order of `polypod --help`. A new command adds its maker here and in commands.cpp.
std::vector<Command> all_commands();

// Helpers that several commands share -------------------------------------------------------------------------------

/// "1,2.5,-3" as numbers of kAnyNumber. Errors: AP100 with the text and the option's name.
Result<std::vector<double>> numbers_of(const std::string& text, const std::string& option);

/// Errors: AP107 for the first of these options that was given although it does nothing here; `serves` says where it
/// would: "it serves --analysis errors".
Status refuse(const Context& context, const std::vector<std::string>& options, const std::string& serves);

/// A machine by name or path with `--set key=value` applied.
Result<machine::AnyMachine> machine_of(const std::string& name, const std::vector<std::string>& sets);

/// Declares MACHINE and --set.
void declare_machine(Arguments& arguments, std::string& name, std::vector<std::string>& sets);

/// The pose that `--pose x,y,z[,A,B[,C]]` gives for this machine (mm, deg). Errors: AP101.
Result<Pose> pose_argument(const machine::AnyMachine& machine, const std::string& text);
/// x, y, z in mm and the angles of the machine's task in deg.
std::vector<double> pose_for_user(const machine::AnyMachine& machine, const Pose& X);
/// x, y, z, A, B, C, mm and deg.
std::vector<double> whole_pose_for_user(const Pose& X);
/// The same as text, `digits` after the point, more of lengths where the machine is so small that they would show
/// nothing.
std::string pose_text(const machine::AnyMachine& machine, const Pose& X, int digits);
/// Whether a command may read these files and write those; empty names count as not given. Files that a TOML file among
/// the inputs names (a job's machine, cutters, stock, ...) count as inputs. With an output to standard output, what the
/// command prints goes to stderr from now on. Errors: AP106 an output that is an input or another output too, under
/// whatever name, an input that is given twice; AP114 standard output is asked for twice, by --json too; those of
/// files::may_write.
Status check_files(const std::vector<std::string>& inputs, const std::vector<std::string>& outputs, bool json = false);
/// Errors: AP105 where the machine has no compliances.
Status needs_compliance(const machine::AnyMachine& machine);
/// Joint values in mm or deg.
std::vector<double> joints_for_user(const machine::AnyMachine& machine, const machine::JointVector& q);

/// What every command says of a machine that is singular at every pose, or nearly so
/// (quality::pose_independent_singularity); it says nothing of others.
class SingularNote {
 public:
  /// As text the note is printed now, so that it stands first.
  SingularNote(const machine::AnyMachine& machine, const Context& context);
  /// No pose was found where the drives hold the platform.
  [[nodiscard]] bool never_held() const { return never_held_; }
  [[nodiscard]] bool everywhere() const { return everywhere_; }
  [[nodiscard]] const std::string& text() const { return text_; }
  /// The document with `singular_everywhere` and `note` in front.
  [[nodiscard]] Json in(const Json& document) const;
  /// The exit status "no" where never_held(), or hardly so at every pose, for commands whose figures have no meaning
  /// then; `figures` are the keys of the document, which are null.
  [[nodiscard]] std::optional<int> refusal(const std::vector<std::string>& figures) const;

 private:
  bool json_ = false;
  bool never_held_ = false, hardly_held_ = false, everywhere_ = false;
  std::string text_;
};
/// The note, and SingularNote::refusal.
std::optional<int> refused_as_singular(const machine::AnyMachine& machine, const Context& context,
                                       const std::vector<std::string>& figures = {});

/// --columns, as csv::columns_of takes them.
void declare_columns(Arguments& arguments, std::vector<std::string>& columns);

Json matrix_json(const Eigen::MatrixXd& M);
Json vector_json(const Vec3& v);
/// Prints the document and a newline.
void print_json(const Json& document);
/// What JSON holds as `error`.
Json error_json(const Error& error);
/// kAnswerIsNo of a command that needs a pose, with the reason on stderr and, where JSON is asked for, as its `error`
/// (AP119).
int cannot_take(const Context& context, const std::string& reason, const char* which = "this pose");
/// An argument as a shell reads it back.
std::string for_shell(const std::string& argument);
/// A progress line on stderr, if it is a terminal; false if the user pressed Ctrl-C. `since`: when all of the work
/// began of which this is a stage; a line of two seconds' work is not drawn.
std::function<bool(double)> progress_line(const Context& context, std::string what,
                                          std::optional<std::chrono::steady_clock::time_point> since = std::nullopt);

}  // namespace polypod::app
