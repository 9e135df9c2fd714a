// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Loads kinematics modules of LinuxCNC into this process, without HAL and realtime: the few functions that they call
// stand here.
#pragma once

#include <filesystem>
#include <functional>
#include <map>
#include <string>
#include <vector>

namespace polypod::test {

/// Whether LinuxCNC's headers and its own modules are installed.
bool has_linuxcnc();

/// Compiles a module as LinuxCNC's own tool does; warnings are errors. Empty where it does not compile.
std::filesystem::path compiled(const std::filesystem::path& source);
/// The same of a component for halcompile, by that.
std::filesystem::path compiled_component(const std::filesystem::path& source);

/// A folder for the test, removed at its end.
class Folder {
 public:
  Folder();
  ~Folder();
  Folder(const Folder&) = delete;
  Folder& operator=(const Folder&) = delete;
  [[nodiscard]] const std::filesystem::path& path() const { return path_; }

 private:
  std::filesystem::path path_;
};

class ModuleHost {
 public:
  /// A file, or the name of one of LinuxCNC's modules; a component has neither inverse nor forward. `parameters`: those
  /// of loadrt. `loaded` says how it went.
  explicit ModuleHost(const std::string& name, const std::map<std::string, std::string>& parameters = {});
  ~ModuleHost();
  ModuleHost(const ModuleHost&) = delete;
  ModuleHost& operator=(const ModuleHost&) = delete;

  int loaded = -1;  ///< what rtapi_app_main returned

  /// Nine coordinates and up to sixteen joints, mm and deg; as LinuxCNC the caller's are changed.
  int inverse(const std::vector<double>& pose, std::vector<double>& joints) const;
  int forward(const std::vector<double>& joints, std::vector<double>& pose) const;

  /// A pin without the module's name, of any type.
  [[nodiscard]] double pin(const std::string& name) const;
  void set(const std::string& name, double value);
  [[nodiscard]] bool has(const std::string& name) const;

  /// Lets a function that the module exported run, as a thread of this period does.
  void run(const std::string& function, long period_ns);
  using Function = std::function<void(long)>;

  struct Pin {
    enum Kind { number, bit, whole } kind;
    void* at;
  };

 private:
  void* handle_ = nullptr;
  void* forward_ = nullptr;
  void* inverse_ = nullptr;
  std::map<std::string, Pin> pins_;
  std::map<std::string, Function> functions_;
};

}  // namespace polypod::test
