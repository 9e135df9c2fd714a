// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/core/memory.hpp"

#include <unistd.h>

#include <algorithm>
#include <fstream>
#include <string>

namespace polypod {
namespace {

/// The least `memory.max` from the control group of this process up to the root; 0 where none is set.
std::size_t group_memory() {
  std::ifstream self("/proc/self/cgroup");
  std::string group;
  for (std::string line; std::getline(self, line);)
    if (line.rfind("0::", 0) == 0) group = line.substr(3);
  std::size_t least = 0;
  while (true) {
    std::ifstream file("/sys/fs/cgroup" + group + "/memory.max");
    std::size_t bytes = 0;
    if (file >> bytes && (least == 0 || bytes < least)) least = bytes;  // "max" is no number
    if (group.empty()) return least;
    group.resize(group.rfind('/') == std::string::npos ? 0 : group.rfind('/'));
  }
}

}  // namespace

std::size_t machine_memory() {
  const long pages = ::sysconf(_SC_PHYS_PAGES), page = ::sysconf(_SC_PAGESIZE);
  const std::size_t machine =
      pages > 0 && page > 0 ? static_cast<std::size_t>(pages) * static_cast<std::size_t>(page) : 0;
  const std::size_t group = group_memory();
  return machine == 0 ? group : group == 0 ? machine : std::min(machine, group);
}

std::size_t resident_memory() {
  std::ifstream file("/proc/self/statm");
  std::size_t pages = 0, resident = 0;
  const long page = ::sysconf(_SC_PAGESIZE);
  return file >> pages >> resident && page > 0 ? resident * static_cast<std::size_t>(page) : 0;
}

}  // namespace polypod
