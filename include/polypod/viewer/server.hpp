// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Serves a site on this computer.
#pragma once

#include <functional>
#include <string>

#include "polypod/viewer/site.hpp"

namespace polypod::viewer {

struct ServeOptions {
  int port = 0;       ///< 0: a free one
  bool once = false;  ///< ends after the first page was served
  /// Called when the server listens, with its address: "http://127.0.0.1:41234/".
  std::function<void(const std::string&)> ready;
  /// Asked ten times a second; true ends the server.
  std::function<bool()> stop;
};

/// Listens on 127.0.0.1 alone and answers until it is told to stop. Requests of more than 1 MB are refused, and slow
/// ones after 5 s. Errors: VW110 (the port cannot be listened on).
Status serve(const Site& site, const ServeOptions& options);

}  // namespace polypod::viewer
