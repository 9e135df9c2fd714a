// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "module_host.hpp"

#include <dlfcn.h>
#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cstdarg>
#include <cstdlib>
#include <stdexcept>

namespace {

/// EmcPose of LinuxCNC's emcpos.h: x, y, z, a, b, c, u, v, w.
using EmcPose = std::array<double, 9>;
using Forward = int (*)(const double*, EmcPose*, const unsigned long*, unsigned long*);
using Inverse = int (*)(const EmcPose*, double*, const unsigned long*, unsigned long*);
using Pin = polypod::test::ModuleHost::Pin;

constexpr std::size_t kJoints = 16;

using Function = polypod::test::ModuleHost::Function;

/// What the module that is being loaded has made.
std::map<std::string, Pin>* pins_now = nullptr;
std::map<std::string, Function>* functions_now = nullptr;

std::string text(const char* form, va_list rest) {
  char out[256];
  std::vsnprintf(out, sizeof out, form, rest);
  return out;
}
template <class T>
int make(Pin::Kind kind, T** pin, const char* form, va_list rest) {
  void* at = std::calloc(1, sizeof(double));
  *pin = static_cast<T*>(at);
  (*pins_now)[text(form, rest)] = {kind, at};
  return 0;
}
int keep(Pin::Kind kind, void* parameter, const char* form, va_list rest) {
  (*pins_now)[text(form, rest)] = {kind, parameter};
  return 0;
}

}  // namespace

#define POLYPOD_PIN(name, type, kind)                     \
  int name(int, type** pin, int, const char* form, ...) { \
    va_list rest;                                         \
    va_start(rest, form);                                 \
    const int out = make(Pin::kind, pin, form, rest);     \
    va_end(rest);                                         \
    return out;                                           \
  }
#define POLYPOD_PARAMETER(name, kind)                          \
  int name(int, void* parameter, int, const char* form, ...) { \
    va_list rest;                                              \
    va_start(rest, form);                                      \
    const int out = keep(Pin::kind, parameter, form, rest);    \
    va_end(rest);                                              \
    return out;                                                \
  }

#define POLYPOD_NAMED_PIN(name, type, kind)              \
  int name(const char* pin_name, int, type** pin, int) { \
    void* at = std::calloc(1, sizeof(double));           \
    *pin = static_cast<type*>(at);                       \
    (*pins_now)[pin_name] = {Pin::kind, at};             \
    return 0;                                            \
  }

extern "C" {
int hal_init(const char*) {
  return 1;
}
int hal_exit(int) {
  return 0;
}
int hal_ready(int) {
  return 0;
}
void* hal_malloc(long size) {
  return std::calloc(1, static_cast<std::size_t>(size));
}
POLYPOD_PIN(hal_pin_float_newf, double, number)
POLYPOD_PIN(hal_pin_bit_newf, bool, bit)
POLYPOD_PIN(hal_pin_s32_newf, int, whole)
POLYPOD_PIN(hal_pin_u32_newf, int, whole)
POLYPOD_NAMED_PIN(hal_pin_float_new, double, number)
POLYPOD_NAMED_PIN(hal_pin_bit_new, bool, bit)
POLYPOD_NAMED_PIN(hal_pin_s32_new, int, whole)
POLYPOD_NAMED_PIN(hal_pin_u32_new, int, whole)
POLYPOD_PARAMETER(hal_param_float_newf, number)
POLYPOD_PARAMETER(hal_param_bit_newf, bit)
POLYPOD_PARAMETER(hal_param_s32_newf, whole)
POLYPOD_PARAMETER(hal_param_u32_newf, whole)
int hal_export_funct(const char* name, void (*function)(void*, long), void* argument, int, int, int) {
  (*functions_now)[name] = [function, argument](long period) { function(argument, period); };
  return 0;
}
int rtapi_snprintf(char* out, unsigned long size, const char* form, ...) {
  va_list rest;
  va_start(rest, form);
  const int length = std::vsnprintf(out, size, form, rest);
  va_end(rest);
  return length;
}
void rtapi_print(const char*, ...) {}
void rtapi_print_msg(int, const char*, ...) {}
}

namespace polypod::test {

namespace fs = std::filesystem;

bool has_linuxcnc() {
  return fs::exists("/usr/include/linuxcnc/kinematics.h") && fs::exists("/usr/lib/linuxcnc/modules/genhexkins.so");
}

fs::path compiled(const fs::path& source) {
  fs::path out = source;
  out.replace_extension(".so");
  const std::string command = fmt::format(
      "cc -std=gnu11 -O2 -Wall -Wextra -Werror -Wno-unused-parameter -fPIC -shared -DUSPACE -DRTAPI -D__MODULE__ "
      "-I/usr/include/linuxcnc '{}' -o '{}' -lm",
      source.string(), out.string());
  return std::system(command.c_str()) == 0 ? out : fs::path();
}

fs::path compiled_component(const fs::path& source) {
  const std::string command = fmt::format("halcompile --preprocess '{}'", source.string());
  if (std::system(command.c_str()) != 0) return {};
  fs::path c = source;
  return compiled(c.replace_extension(".c"));
}

Folder::Folder() {
  std::string name = (fs::temp_directory_path() / "polypod-test-XXXXXX").string();
  if (::mkdtemp(name.data()) == nullptr) throw std::runtime_error("no temporary folder");
  path_ = name;
}
Folder::~Folder() {
  std::error_code ignored;
  fs::remove_all(path_, ignored);
}

ModuleHost::ModuleHost(const std::string& name, const std::map<std::string, std::string>& parameters) {
  const bool own = name.find('/') == std::string::npos;
  handle_ = ::dlopen((own ? "/usr/lib/linuxcnc/modules/" + name + ".so" : name).c_str(), RTLD_NOW | RTLD_LOCAL);
  if (handle_ == nullptr) throw std::runtime_error(::dlerror());
  // The strings must stay as long as the module: it keeps pointers to them.
  for (const auto& [key, value] : parameters) {
    void* address = ::dlsym(handle_, ("rtapi_info_address_" + key).c_str());
    if (address == nullptr) throw std::runtime_error("no parameter " + key);
    **static_cast<char***>(address) = ::strdup(value.c_str());
  }
  const auto start = reinterpret_cast<int (*)()>(::dlsym(handle_, "rtapi_app_main"));
  forward_ = ::dlsym(handle_, "kinematicsForward");
  inverse_ = ::dlsym(handle_, "kinematicsInverse");
  if (start == nullptr) throw std::runtime_error("no module");
  std::map<std::string, Pin> made;
  std::map<std::string, Function> functions;
  pins_now = &made;
  functions_now = &functions;
  loaded = start();
  for (const auto& [full, function] : functions) functions_[full.substr(full.find('.') + 1)] = function;
  for (const auto& [full, pin] : made) pins_[full.substr(full.find('.') + 1)] = pin;
}
ModuleHost::~ModuleHost() {
  if (handle_ != nullptr) ::dlclose(handle_);
}

void ModuleHost::run(const std::string& function, long period_ns) {
  functions_.at(function)(period_ns);
}

int ModuleHost::inverse(const std::vector<double>& pose, std::vector<double>& joints) const {
  EmcPose world{};
  std::copy(pose.begin(), pose.end(), world.begin());
  double all[kJoints] = {};
  std::copy(joints.begin(), joints.end(), all);
  unsigned long flags = 0, more = 0;
  const int out = reinterpret_cast<Inverse>(inverse_)(&world, all, &flags, &more);
  std::copy_n(all, joints.size(), joints.begin());
  return out;
}
int ModuleHost::forward(const std::vector<double>& joints, std::vector<double>& pose) const {
  EmcPose world{};
  std::copy(pose.begin(), pose.end(), world.begin());
  double all[kJoints] = {};
  std::copy(joints.begin(), joints.end(), all);
  unsigned long flags = 0, more = 0;
  const int out = reinterpret_cast<Forward>(forward_)(all, &world, &flags, &more);
  std::copy_n(world.begin(), pose.size(), pose.begin());
  return out;
}

double ModuleHost::pin(const std::string& name) const {
  const Pin& pin = pins_.at(name);
  switch (pin.kind) {
    case Pin::number:
      return *static_cast<double*>(pin.at);
    case Pin::bit:
      return *static_cast<bool*>(pin.at) ? 1 : 0;
    case Pin::whole:
      return *static_cast<int*>(pin.at);
  }
  return 0;
}
void ModuleHost::set(const std::string& name, double value) {
  const Pin& pin = pins_.at(name);
  switch (pin.kind) {
    case Pin::number:
      *static_cast<double*>(pin.at) = value;
      return;
    case Pin::bit:
      *static_cast<bool*>(pin.at) = value != 0;
      return;
    case Pin::whole:
      *static_cast<int*>(pin.at) = static_cast<int>(value);
      return;
  }
}
bool ModuleHost::has(const std::string& name) const {
  return pins_.contains(name);
}

}  // namespace polypod::test
