// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Any bytes as the path of `polypod move`: refused with an error, or a path of finite pieces.
#include <cmath>
#include <cstdint>
#include <string_view>

#include "memory_file.hpp"
#include "polypod/motion/pose_path.hpp"
#include "require.hpp"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace polypod;
  using fuzz::require;
  const fuzz::MemoryFile file({reinterpret_cast<const char*>(data), size});
  const auto path = motion::read_pose_path(file.path());
  if (!path) return fuzz::require_error(path.error()), 0;
  require(!path->path.stretches.empty() && std::isfinite(path->path.size) && path->path.size > 0, "a path has a size");
  for (const motion::Stretch& s : path->path.stretches) {
    require(std::isfinite(s.length) && s.size > 0 && s.from.allFinite() && s.to.allFinite(), "pieces are finite");
    require(s.pose(0).p.allFinite() && s.pose(s.size).R.allFinite(), "poses are finite");
  }
  return 0;
}
