// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <array>
#include <memory>
#include <vector>

#include "polypod/bodies/shape.hpp"

namespace polypod::bodies {

/// A box as twelve triangles.
inline std::shared_ptr<const Mesh> cube(const Vec3& min, const Vec3& max) {
  return *mesh_of(box(min, max).points,
                  {{0, 2, 1},
                   {1, 2, 3},
                   {4, 5, 6},
                   {5, 7, 6},
                   {0, 1, 4},
                   {1, 5, 4},
                   {2, 6, 3},
                   {3, 6, 7},
                   {0, 4, 2},
                   {2, 4, 6},
                   {1, 3, 5},
                   {3, 7, 5}},
                  "cube");
}

}  // namespace polypod::bodies
