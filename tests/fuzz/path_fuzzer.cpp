// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Any bytes as the path of `polypod move`: refused with an error, or a path of finite pieces.
#include <cmath>
#include <cstdint>
#include <string_view>

#include "memory_file.hpp"
#include "polypod/motion/path.hpp"
#include "require.hpp"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace polypod;
  using fuzz::require;
  const fuzz::MemoryFile file({reinterpret_cast<const char*>(data), size});
  const auto path = motion::read_path(file.path());
  if (!path) return fuzz::require_error(path.error()), 0;
  require(!path->path.segments.empty() && std::isfinite(path->path.length) && path->path.length > 0,
          "a path has a length");
  for (const motion::Segment& s : path->path.segments) {
    require(std::isfinite(s.length) && s.length > 0 && s.from.allFinite() && s.to.allFinite(), "pieces are finite");
    require(std::isfinite(s.radius) && s.center.allFinite(), "arcs are finite");
  }
  return 0;
}
