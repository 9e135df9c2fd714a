// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/control/record.hpp"

#include <fcntl.h>
#include <fmt/format.h>
#include <sched.h>
#include <signal.h>
#include <sys/prctl.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <optional>
#include <set>
#include <sstream>
#include <thread>

#include "module_text.hpp"
#include "polypod/core/files.hpp"
#include "polypod/core/text.hpp"
#include "polypod/core/units.hpp"
#include "polypod/kinematics/any_machine.hpp"
#include "polypod/machining/job.hpp"

namespace polypod::control {
namespace {

namespace fs = std::filesystem;
using machine::AnyMachine;
using Clock = std::chrono::steady_clock;

constexpr double kServoPeriod = 0.001;  // s
/// By how many servo cycles the commanded joints lag the commanded axes: LinuxCNC's interpolators, which take each
/// joint as (q_-1 + 4 q_0 + q_+1) / 6 of three cycles.
constexpr std::size_t kLag = 2;
constexpr const char* kHeaders = "/usr/include/linuxcnc";
constexpr const char* kModules = "/usr/lib/linuxcnc/modules";
constexpr const char* kNoConfiguration = "give a folder that `polypod export linuxcnc MACHINE -o DIR` wrote";

/// A folder for this run, removed with the object.
class Scratch {
 public:
  Scratch() {
    std::error_code error;
    const fs::path base = fs::temp_directory_path(error);
    std::string name = ((error ? fs::path("/tmp") : base) / "polypod-record-XXXXXX").string();
    if (::mkdtemp(name.data()) != nullptr) path_ = name;
    // LinuxCNC's realtime process is another user.
    if (!path_.empty()) fs::permissions(path_, fs::perms(0755), error);
  }
  ~Scratch() {
    std::error_code ignored;
    if (!path_.empty()) fs::remove_all(path_, ignored);
  }
  Scratch(const Scratch&) = delete;
  Scratch& operator=(const Scratch&) = delete;
  [[nodiscard]] const fs::path& path() const { return path_; }

 private:
  fs::path path_;
};

Status write(const fs::path& path, std::string_view text) {
  std::ofstream out(path, std::ios::binary);
  out.write(text.data(), static_cast<std::streamsize>(text.size()));
  out.close();
  if (!out)
    return fail("LC114", fmt::format("cannot write {}", path.string()), {}, "TMPDIR names the folder of the run");
  return {};
}

std::string text_of_file(const fs::path& path) {
  std::ifstream in(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(in), {}};
}

/// A program of its own that does not outlive this one.
class Child {
 public:
  /// Output and errors go to `log`. Nothing in the child but what is safe after a fork.
  Child(const std::vector<std::string>& command, const fs::path& log) {
    // With the folders where found_in_path looks, too.
    const char* path = std::getenv("PATH");
    std::vector<std::string> words{"/usr/bin/env",
                                   fmt::format("PATH={}:/usr/bin:/bin:/usr/sbin:/sbin", path != nullptr ? path : "")};
    words.insert(words.end(), command.begin(), command.end());
    std::vector<char*> argv;
    for (const std::string& word : words) argv.push_back(const_cast<char*>(word.c_str()));
    argv.push_back(nullptr);
    const std::string file = log.string();
    pid_ = ::fork();
    if (pid_ != 0) return;
    ::setpgid(0, 0);  // a terminal's Ctrl-C is for this process alone, which then ends the child
    ::prctl(PR_SET_PDEATHSIG, SIGKILL);
    sigset_t none;
    ::sigemptyset(&none);
    ::sigprocmask(SIG_SETMASK, &none, nullptr);
    for (const int s : {SIGINT, SIGTERM, SIGHUP, SIGQUIT, SIGXCPU, SIGPIPE, SIGXFSZ}) ::signal(s, SIG_DFL);
    const int in = ::open("/dev/null", O_RDONLY), out = ::open(file.c_str(), O_WRONLY | O_CREAT | O_TRUNC, 0644);
    ::dup2(in, 0);
    ::dup2(out, 1);
    ::dup2(out, 2);
    ::execvp(argv[0], argv.data());
    ::_exit(127);
  }
  ~Child() {
    if (pid_ > 0 && !status_) {
      ::kill(-pid_, SIGKILL);
      ::kill(pid_, SIGKILL);
      ::waitpid(pid_, nullptr, 0);
    }
  }
  Child(const Child&) = delete;
  Child& operator=(const Child&) = delete;
  /// The exit status once it has ended.
  std::optional<int> status() {
    if (pid_ < 0) return 127;
    int raw = 0;
    if (!status_ && ::waitpid(pid_, &raw, WNOHANG) == pid_) status_ = WIFEXITED(raw) ? WEXITSTATUS(raw) : 128;
    return status_;
  }

 private:
  pid_t pid_ = -1;
  std::optional<int> status_;
};

enum class Outcome { ended, late, interrupted };

/// Waits until the child ends.
Outcome wait_for(Child& child, Clock::time_point begin, const RecordOptions& options) {
  while (!child.status()) {
    const double seconds = std::chrono::duration<double>(Clock::now() - begin).count();
    if (!options.progress(seconds)) return Outcome::interrupted;
    if (seconds > options.time_limit) return Outcome::late;
    std::this_thread::sleep_for(std::chrono::milliseconds(20));
  }
  return Outcome::ended;
}

std::optional<fs::path> found_in_path(const char* program) {
  const char* path = std::getenv("PATH");
  std::istringstream folders(std::string(path != nullptr ? path : "") + ":/usr/bin:/bin:/usr/sbin:/sbin");
  for (std::string folder; std::getline(folders, folder, ':');) {
    const fs::path candidate = fs::path(folder) / program;
    if (!folder.empty() && ::access(candidate.c_str(), X_OK) == 0) return candidate;
  }
  return std::nullopt;
}

std::string trimmed(std::string_view text) {
  const auto begin = text.find_first_not_of(" \t\r");
  if (begin == std::string_view::npos) return {};
  return std::string(text.substr(begin, text.find_last_not_of(" \t\r") - begin + 1));
}

/// The configuration as far as a run needs it.
struct Configuration {
  fs::path folder;
  std::string ini_name, module, letters;
  int joints = 0;
  std::string record_ini;  ///< the INI file of the run
  std::string hal;         ///< all its HAL files
  std::string tool_table;  ///< its name
  AnyMachine machine;
};

Result<Configuration> configuration_in(const std::string& name) {
  Configuration out;
  std::error_code error;
  out.folder = fs::absolute(name, error);
  std::vector<fs::path> found;
  for (const auto& entry : fs::directory_iterator(out.folder, error))
    if (entry.path().extension() == ".ini") found.push_back(entry.path());
  if (error) {
    return fail("LC110", fmt::format("{} is no folder that can be read: {}", one_line(name), error.message()), {},
                kNoConfiguration);
  }
  if (found.size() != 1) {
    return fail("LC110", fmt::format("{} holds {} INI files; must be one", one_line(name), found.size()), {},
                kNoConfiguration);
  }
  out.ini_name = found.front().string();
  POLYPOD_ASSIGN(text, files::read(out.ini_name));
  std::istringstream lines(text);
  std::string section, kinematics, joints;
  bool display = false;
  int number = 0;
  for (std::string raw; std::getline(lines, raw);) {
    ++number;
    const std::string line = trimmed(raw);
    if (line.starts_with('[')) {
      section = line.substr(1, line.find(']') - 1);
      out.record_ini += line + "\n";
      if (section == "DISPLAY") {
        out.record_ini += "DISPLAY = ./driver.py\n";
        display = true;
      }
      if (section == "RS274NGC") out.record_ini += "PARAMETER_FILE = record.var\nSUBROUTINE_PATH = subroutines\n";
      continue;
    }
    const auto equals = line.find('=');
    if (line.empty() || line.front() == '#' || line.front() == ';' || equals == std::string::npos) continue;
    const std::string key = trimmed(line.substr(0, equals)), value = trimmed(line.substr(equals + 1));
    // What belongs to a screen, and what a run has of its own.
    if (section == "DISPLAY" || section == "APPLICATIONS" || section == "FILTER") continue;
    if (section == "RS274NGC" && (key == "PARAMETER_FILE" || key == "SUBROUTINE_PATH")) continue;
    if (section == "HAL" && (key == "POSTGUI_HALFILE" || key == "HALUI" || key == "SHUTDOWN")) continue;
    if (section == "HAL" && key == "HALFILE") {
      if (value.starts_with("LIB:") || value.starts_with('/')) {
        out.record_ini += line + "\n";
      } else {
        out.record_ini += "HALFILE = config/" + value + "\n";
        out.hal += text_of_file(out.folder / value);
      }
      continue;
    }
    if (section == "EMCIO" && key == "TOOL_TABLE") {
      out.tool_table = value;
      out.record_ini += "TOOL_TABLE = record.tbl\n";
      continue;
    }
    if (section == "KINS" && key == "KINEMATICS") kinematics = value;
    if (section == "KINS" && key == "JOINTS") joints = value;
    if (section == "TRAJ" && key == "COORDINATES") out.letters = value;
    out.record_ini += line + "\n";
  }
  const Place place{out.ini_name};
  out.module = kinematics.substr(0, kinematics.find(' '));
  out.joints = std::atoi(joints.c_str());
  std::erase(out.letters, ' ');
  const bool module_there = !out.module.empty() && out.module.find('/') == std::string::npos &&
                            fs::exists(out.folder / (out.module + ".c"), error);
  if (!module_there || !display) {
    return fail("LC110",
                fmt::format("the INI file names {} as kinematics, and {} is not in the folder",
                            kinematics.empty() ? "nothing" : one_line(kinematics), one_line(out.module + ".c")),
                place, kNoConfiguration);
  }
  const auto loaded = machine::load((out.folder / "machine.toml").string());
  if (!loaded) return tl::unexpected(loaded.error());
  out.machine = *loaded;
  const machine::Task task = kinematics::task(out.machine);
  std::string wanted;
  for (int i = 0; i < task.size(); ++i) wanted += "XYZABC"[static_cast<int>(task[i])];
  if (out.joints != kinematics::joint_count(out.machine) || out.letters != wanted) {
    return fail("LC110",
                fmt::format("the INI file has {} joints and the coordinates {}; machine.toml beside it has {} and {}",
                            out.joints, one_line(out.letters), kinematics::joint_count(out.machine), wanted),
                place, "export the machine anew");
  }
  // One more HAL file, behind the others.
  const auto at = out.record_ini.rfind("HALFILE = ");
  if (at == std::string::npos) return fail("LC110", "the INI file names no HALFILE", place, kNoConfiguration);
  out.record_ini.insert(out.record_ini.find('\n', at) + 1, "HALFILE = record.hal\n");
  return out;
}

/// The words of a line of HAL, comments left out.
std::vector<std::string> words_of(const std::string& line) {
  std::istringstream in(line.substr(0, line.find('#')));
  std::vector<std::string> out;
  for (std::string word; in >> word;) out.push_back(word);
  return out;
}
/// The signal that the HAL files link a pin to already, if there is one; else `otherwise`.
std::string signal_of(const std::string& hal, const std::string& pin, const std::string& otherwise) {
  std::istringstream lines(hal);
  for (std::string line; std::getline(lines, line);) {
    const std::vector<std::string> words = words_of(line);
    if (words.size() > 2 && words[0] == "net" && std::find(words.begin() + 2, words.end(), pin) != words.end())
      return words[1];
  }
  return otherwise;
}
/// The components that the HAL files load and whose sources, for halcompile, are in the folder.
std::vector<std::string> components_of(const Configuration& c) {
  std::vector<std::string> out;
  std::istringstream lines(c.hal);
  std::error_code error;
  for (std::string line; std::getline(lines, line);) {
    const std::vector<std::string> words = words_of(line);
    if (words.size() < 2 || words[0] != "loadrt" || words[1].find('/') != std::string::npos) continue;
    if (fs::exists(c.folder / (words[1] + ".comp"), error)) out.push_back(words[1]);
  }
  return out;
}

/// Samples joints, axes and the line. With LinuxCNC's component scale three more digits of each.
std::string sampling(const Configuration& c, bool scaled) {
  const std::size_t floats = static_cast<std::size_t>(c.joints) + c.letters.size();
  std::string out = fmt::format("loadrt sampler depth=20000 cfg={}s\n", std::string(floats, 'f'));
  if (scaled) out += fmt::format("loadrt scale count={}\n", floats);
  std::size_t pin = 0;
  const auto sample = [&](const std::string& source) {
    const std::string signal = signal_of(c.hal, source, fmt::format("record-{}", pin));
    if (scaled) {
      out += fmt::format("setp scale.{0}.gain 1000\nnet {2} {1} => scale.{0}.in\n", pin, source, signal);
      out += fmt::format("net record-more-{0} scale.{0}.out => sampler.0.pin.{0}\naddf scale.{0} servo-thread\n", pin);
    } else {
      out += fmt::format("net {2} {1} => sampler.0.pin.{0}\n", pin, source, signal);
    }
    ++pin;
  };
  for (int i = 0; i < c.joints; ++i) sample(fmt::format("joint.{}.pos-cmd", i));
  for (const char letter : c.letters) sample(fmt::format("axis.{}.pos-cmd", static_cast<char>(letter - 'A' + 'a')));
  out += fmt::format("net record-line motion.program-line => sampler.0.pin.{}\naddf sampler.0 servo-thread\n", pin);
  out += "setp sampler.0.enable 0\n";  // the driver switches it on before the program
  return out;
}

/// The last lines of a log that say something.
std::string tail_of(const fs::path& log) {
  std::istringstream lines(text_of_file(log));
  std::vector<std::string> kept, errors;
  for (std::string line; std::getline(lines, line);) {
    line = trimmed(line);
    if (line.empty()) continue;
    kept.push_back(line);
    const bool bad = line.find("rror") != std::string::npos || line.find("annot") != std::string::npos ||
                     line.find("must be") != std::string::npos || line.find("not found") != std::string::npos;
    if (bad && line.find("errorlevel") == std::string::npos) errors.push_back(line);
  }
  const std::vector<std::string>& from = errors.empty() ? kept : errors;
  std::string out;
  for (std::size_t i = 0; i < std::min<std::size_t>(from.size(), 3); ++i) {
    const std::string& line = errors.empty() ? from[from.size() - std::min<std::size_t>(from.size(), 3) + i] : from[i];
    out += (out.empty() ? "" : "; ") + one_line(line);
  }
  return out.empty() ? "it said nothing" : out;
}

Status ready() {
  if (::geteuid() != 0) {
    return fail("LC111",
                "a record needs root: LinuxCNC runs in namespaces of its own, so that nothing of it is left behind", {},
                "run it with sudo, or in a container");
  }
  for (const char* program : {"linuxcnc", "halsampler"}) {
    if (!found_in_path(program)) {
      return fail("LC112", fmt::format("LinuxCNC is not installed: no program {}", program), {},
                  "on Debian: apt-get install linuxcnc-uspace linuxcnc-uspace-dev");
    }
  }
  for (const char* program : {"unshare", "mount", "ip", "bash", "cc"}) {
    if (!found_in_path(program)) {
      return fail("LC112", fmt::format("no program {} is installed", program), {},
                  "on Debian: apt-get install util-linux mount iproute2 bash gcc");
    }
  }
  std::error_code error;
  if (!fs::exists(fs::path(kHeaders) / "kinematics.h", error)) {
    return fail("LC112", fmt::format("LinuxCNC's headers are not installed: no {}/kinematics.h", kHeaders), {},
                "on Debian: apt-get install linuxcnc-uspace-dev");
  }
  if (!fs::is_directory(kModules, error)) {
    return fail("LC112", fmt::format("LinuxCNC's modules are not in {}", kModules), {},
                "on Debian: apt-get install linuxcnc-uspace");
  }
  return {};
}

/// One cycle of the record, in LinuxCNC's units.
struct Sample {
  std::vector<double> joints, axes;
  int line = 0;
};

/// The samples that LinuxCNC has written so far.
class Samples {
 public:
  Samples(fs::path file, std::size_t joints, std::size_t axes, double scale)
      : file_(std::move(file)), joints_(joints), axes_(axes), scale_(scale) {}

  /// Those that came since. `all`: the file is whole, and its last line, if it can be read, is one without an end.
  Status read_more(bool all) {
    std::ifstream in(file_, std::ios::binary);
    in.seekg(read_);
    std::string text(std::istreambuf_iterator<char>(in), {});
    std::size_t begin = 0;
    for (std::size_t end = text.find('\n'); end != std::string::npos; end = text.find('\n', begin)) {
      POLYPOD_TRY(take(text.substr(begin, end - begin), true));
      read_ += static_cast<std::streamoff>(end + 1 - begin);
      begin = end + 1;
    }
    if (all && begin < text.size()) return take(text.substr(begin), false);
    return {};
  }
  [[nodiscard]] const std::vector<Sample>& list() const { return list_; }

 private:
  Status take(const std::string& line, bool has_end) {
    const char* at = line.c_str();
    char* next = nullptr;
    const long number = std::strtol(at, &next, 10);
    const bool lost = next == at || (last_ >= 0 && number != last_ + 1);
    Sample s;
    at = next;
    const auto numbers = [&](std::vector<double>& to, std::size_t count) {
      for (std::size_t i = 0; i < count; ++i) {
        to.push_back(std::strtod(at, &next) / scale_);
        if (next == at) return false;
        at = next;
      }
      return true;
    };
    const bool whole = !lost && numbers(s.joints, joints_) && numbers(s.axes, axes_);
    if (whole) s.line = static_cast<int>(std::strtol(at, &next, 10));
    if (!whole || next == at) {
      if (!has_end) return {};  // the last line may be cut
      return fail("LC118",
                  fmt::format("samples were lost after {:.3f} s: {}", kServoPeriod * static_cast<double>(list_.size()),
                              one_line(line)),
                  {}, "the machine is too busy; try again");
    }
    last_ = number;
    list_.push_back(std::move(s));
    return {};
  }

  fs::path file_;
  std::size_t joints_, axes_;
  double scale_;
  std::streamoff read_ = 0;
  long last_ = -1;
  std::vector<Sample> list_;
};

void write_number(std::string& out, double value, int digits) {
  std::string text = fmt::format("{:.{}f}", value, digits);
  if (text.starts_with('-') && text.find_first_of("123456789") == std::string::npos) text.erase(0, 1);
  out += ',';
  out += text;
}

/// Makes the rows of a record from samples as they come. Before the first change and behind the last one nothing
/// happens: rows wait until something changes again.
class Rows {
 public:
  Rows(const Configuration& c, int digits) : c_(c), digits_(digits), task_(kinematics::task(c.machine)) {
    out_.csv = "time_s,line,x_mm,y_mm,z_mm,a_deg,b_deg,c_deg";
    for (int i = 0; i < c.joints; ++i) out_.csv += fmt::format(",q{}", i + 1);
    out_.csv += "\n";
  }

  /// `samples`: those of the last call, and more.
  void go_on(const std::vector<Sample>& samples) {
    for (; seen_ + kLag + 1 < samples.size(); ++seen_) {
      const bool differs = samples[seen_].axes != samples[seen_ + 1].axes ||
                           samples[seen_ + kLag].joints != samples[seen_ + kLag + 1].joints;
      if (!differs) continue;
      if (out_.samples == 0) begin_ = next_ = seen_;
      while (next_ <= seen_ + 1) add(samples, next_++);
    }
  }
  /// A program without motion has one row.
  void stand(const std::vector<Sample>& samples) {
    if (samples.size() > kLag) add(samples, 0);
  }
  [[nodiscard]] bool empty() const { return out_.samples == 0; }
  Record end() {
    if (out_.samples > 0) out_.seconds = kServoPeriod * static_cast<double>(out_.samples - 1);
    out_.lines = lines_.size();
    return std::move(out_);
  }
  [[nodiscard]] const std::string& csv() const { return out_.csv; }

 private:
  void add(const std::vector<Sample>& samples, std::size_t k) {
    // The tip that the joints of this row give: weighted as they are.
    std::vector<double> axes = samples[k].axes;
    const std::vector<double>&before = samples[k > 0 ? k - 1 : 0].axes, &behind = samples[k + 1].axes;
    for (std::size_t i = 0; i < axes.size(); ++i) axes[i] += (before[i] - 2 * axes[i] + behind[i]) / 6;
    const std::vector<double>& joints = samples[k + kLag].joints;
    double coordinates[6] = {0, 0, 0, 0, 0, 0};
    if (task_.size() < 6 && !task_.names_axis()) {
      std::vector<double> given;
      for (int i = 0; i < task_.size(); ++i) {
        const double value = axes[static_cast<std::size_t>(i)];
        given.push_back(task_.is_angle(i) ? units::from_deg(value) : units::from_mm(value));
      }
      machine::JointVector q(c_.joints);
      for (int i = 0; i < c_.joints; ++i) {
        const double value = joints[static_cast<std::size_t>(i)];
        q[i] = kinematics::joint_kind(c_.machine, i) == machine::JointKind::revolute ? units::from_deg(value)
                                                                                     : units::from_mm(value);
      }
      const Pose X = kinematics::settled(c_.machine, kinematics::pose_of(task_, given), q);
      const Vec3 abc = angles_abc(X.R);
      for (int i = 0; i < 3; ++i) {
        coordinates[i] = units::to_mm(X.p[i]);
        coordinates[3 + i] = units::to_deg(abc[i]);
      }
    }
    for (int i = 0; i < task_.size(); ++i) coordinates[static_cast<int>(task_[i])] = axes[static_cast<std::size_t>(i)];
    out_.csv += fmt::format("{:.3f},{}", kServoPeriod * static_cast<double>(k - begin_), samples[k].line);
    for (const double value : coordinates) write_number(out_.csv, value, digits_);
    for (const double value : joints) write_number(out_.csv, value, digits_);
    out_.csv += "\n";
    ++out_.samples;
    if (samples[k].line > 0) lines_.insert(samples[k].line);
  }

  const Configuration& c_;
  int digits_;
  machine::Task task_;
  std::size_t seen_ = 0, begin_ = 0, next_ = 0;
  std::set<int> lines_;
  Record out_;
};

/// What the driver left.
Status verdict(const fs::path& scratch, const std::string& program) {
  std::istringstream result(text_of_file(scratch / "result.txt"));
  std::string first;
  std::getline(result, first);
  if (first == "ok") return {};
  if (first.empty()) {
    return fail("LC114", "LinuxCNC did not start: " + tail_of(scratch / "linuxcnc.txt"), {},
                "linuxcnc DIR/NAME.ini shows more; a changed HAL file is the usual reason");
  }
  std::istringstream words(first);
  std::string failed, where, said, line_said;
  int line = 0;
  words >> failed >> where >> line;
  while (std::getline(result, line_said)) said += (said.empty() ? "" : "; ") + one_line(line_said);
  if (where == "switch-on" || where == "homing") {
    return fail("LC115", fmt::format("LinuxCNC does not {}: {}", where == "homing" ? "home" : "switch on", said), {},
                "the joints' homes must lie within their limits and be a pose of the machine; export it anew");
  }
  // LinuxCNC reads ahead; its messages name the line that they are about.
  if (const auto at = said.find("on line "); at != std::string::npos) line = std::atoi(said.c_str() + at + 8);
  const bool tool = said.find("not found in the tool table") != std::string::npos;
  const bool sensor = said.find("the sensor gives no force") != std::string::npos;
  return fail("LC116", "LinuxCNC: " + said, {program, line, 0},
              tool     ? "add the tool to the tool table of the exported machine, NAME.tbl, as in T2 P2 D6"
              : sensor ? "look at what gives the force; its watchdog stops the machine (docs/linuxcnc.md)"
                       : "polypod check says where a program leaves what the machine can do");
}

}  // namespace

std::string work_offset_parameters(const machining::Job& job) {
  std::string out;
  for (std::size_t i = 0; i < job.work_offsets.size(); ++i) {
    if (!job.offset_given[i]) continue;
    const Vec3 origin = job.X_MW * job.work_offsets[i];
    const int first = 5221 + 20 * static_cast<int>(i);
    for (int k = 0; k < 3; ++k) out += fmt::format("{}\t{:.9f}\n", first + k, units::to_mm(origin[k]));
    out += fmt::format("{}\t{:.9f}\n", first + 9, units::to_deg(machining::rotation_of(job.X_MW)));
  }
  return out;
}

Result<Record> record(const std::string& folder, const std::string& program, const RecordOptions& options) {
  POLYPOD_ASSIGN(c, configuration_in(folder));
  POLYPOD_ASSIGN(text, files::read(program));
  POLYPOD_TRY(ready());
  const Scratch scratch;
  if (scratch.path().empty()) {
    return fail("LC114", "no folder can be made for the run", {}, "TMPDIR names where; it must be writable");
  }
  const Clock::time_point begin = Clock::now();
  const fs::path& dir = scratch.path();
  const auto stopped = [&](Outcome outcome) -> Status {
    if (outcome == Outcome::interrupted) return fail("LC119", "interrupted");
    if (outcome == Outcome::late) {
      return fail("LC117", fmt::format("the program did not end within {:g} s", options.time_limit), {program},
                  "--time-limit gives more; LinuxCNC runs in real time");
    }
    return {};
  };
  const auto compile = [&](const std::vector<std::string>& command, const char* what,
                           const fs::path& source) -> Status {
    const fs::path log = dir / "compiler.txt";
    Child compiler(command, log);
    POLYPOD_TRY(stopped(wait_for(compiler, begin, options)));
    if (*compiler.status() == 0) return {};
    return fail("LC113", fmt::format("the {} does not compile: {}", what, tail_of(log)), {source.string()},
                "export the machine anew");
  };
  const auto build = [&](const fs::path& source, const std::string& name, const char* what,
                         const fs::path& written) -> Status {
    return compile({"cc", "-std=gnu11", "-O2", "-fPIC", "-shared", "-DUSPACE", "-DRTAPI", "-D__MODULE__",
                    std::string("-I") + kHeaders, source.string(), "-o", (dir / (name + ".so")).string(), "-lm"},
                   what, written);
  };
  const fs::path module = c.folder / (c.module + ".c");
  POLYPOD_TRY(build(module, c.module, "kinematics module", module));
  for (const std::string& name : components_of(c)) {
    const fs::path source = c.folder / (name + ".comp"), copy = dir / (name + ".comp");
    if (!found_in_path("halcompile")) {
      return fail("LC112", "LinuxCNC's halcompile is not installed", {},
                  "on Debian: apt-get install linuxcnc-uspace-dev");
    }
    POLYPOD_TRY(write(copy, text_of_file(source)));
    POLYPOD_TRY(compile({"halcompile", "--preprocess", copy.string()}, "component", source));
    POLYPOD_TRY(build(dir / (name + ".c"), name, "component", source));
  }
  std::error_code error;
  for (const char* made : {"config", "subroutines"}) fs::create_directory(dir / made, error);
  const bool scaled = c.hal.find("loadrt scale") == std::string::npos;
  POLYPOD_TRY(write(dir / "record.ini", c.record_ini));
  POLYPOD_TRY(write(dir / "record.hal", sampling(c, scaled)));
  POLYPOD_TRY(write(dir / "record.var", options.parameters));
  POLYPOD_TRY(write(dir / "record.tbl", text_of_file(c.folder / c.tool_table)));
  POLYPOD_TRY(write(dir / "program.ngc", text));
  std::string driver(text_of_driver_py);
  constexpr std::string_view kOn = "block_delete = True";
  if (!options.block_delete) driver.replace(driver.find(kOn), kOn.size(), "block_delete = False");
  POLYPOD_TRY(write(dir / "driver.py", driver));
  POLYPOD_TRY(write(dir / "inside.sh", text_of_inside_sh));
  fs::permissions(dir / "driver.py", fs::perms(0755), error);
  Samples samples(dir / "samples.txt", static_cast<std::size_t>(c.joints), c.letters.size(), scaled ? 1000.0 : 1.0);
  Rows rows(c, scaled ? 9 : 6);
  std::size_t shown = 0;
  const auto show = [&] {
    if (options.rows && rows.csv().size() > shown) options.rows(std::string_view(rows.csv()).substr(shown));
    shown = rows.csv().size();
  };
  RecordOptions watching = options;
  watching.progress = [&](double seconds) {
    if (options.rows && samples.read_more(false)) {  // an error comes again at the end
      rows.go_on(samples.list());
      show();
    }
    return options.progress(seconds);
  };
  const std::string beside = program == "-" ? "" : fs::absolute(program, error).parent_path().string();
  {
    Child run({"unshare", "--ipc", "--pid", "--net", "--mount", "--fork", "--kill-child", "--mount-proc", "bash",
               (dir / "inside.sh").string(), dir.string(), kModules, c.folder.string(), beside},
              dir / "linuxcnc.txt");
    POLYPOD_TRY(stopped(wait_for(run, begin, watching)));
    if (!fs::exists(dir / "result.txt", error) && text_of_file(dir / "linuxcnc.txt").starts_with("unshare:")) {
      return fail("LC111", "the system gives no namespaces: " + tail_of(dir / "linuxcnc.txt"), {},
                  "a record needs root with CAP_SYS_ADMIN; containers may lack it");
    }
  }
  const Status ended = verdict(dir, program);
  const bool partial = !ended && options.partial && ended.error().id == "LC116";
  if (!partial) POLYPOD_TRY(ended);
  POLYPOD_TRY(samples.read_more(true));
  if (partial && samples.list().size() <= kLag) return tl::unexpected(ended.error());
  rows.go_on(samples.list());
  if (rows.empty()) rows.stand(samples.list());
  show();
  Record out = rows.end();
  if (partial) out.failed = ended.error();
  return out;
}

}  // namespace polypod::control
