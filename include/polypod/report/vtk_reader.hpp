// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Polygonal data (.vtp) as ParaView, VTK and Polypod write them.
#pragma once

#include <string>
#include <string_view>

#include "polypod/core/error.hpp"
#include "polypod/report/vtk.hpp"

namespace polypod::report {

/// What a .vtp file holds: numbers as text, in base64, or appended (raw or in base64). All its pieces together; strips
/// become triangles, vertices and data of cells are left out, and so are arrays that not every piece has. Errors: RE110
/// (no PolyData that can be read, with its place), RE111 (compressed, or big-endian). Cost: linear; all numbers as
/// doubles.
Result<VtkPolyData> read_vtp(std::string_view text, const std::string& path);

}  // namespace polypod::report
