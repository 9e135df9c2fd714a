// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Where to put the part, as a page.
#pragma once

#include <string>

#include "polypod/machining/place.hpp"

namespace polypod::pages {

struct PlacePageOptions {
  std::string version;  ///< of Polypod; default: not named
  std::string command;  ///< the command line that makes this page again; default: left out
  std::string program;  ///< its file
};

/// One self-contained HTML file: the best place and its gain, maps of the estimated error, of the compliance and of the
/// joints' margin over x and y, the error over all rotations there, what stops the program elsewhere, the places that
/// `predict` judged, inputs, and what is not judged. `result` must have a best place.
std::string place_page(const machining::Job& job, const machining::PlaceResult& result,
                       const PlacePageOptions& options = {});

}  // namespace polypod::pages
