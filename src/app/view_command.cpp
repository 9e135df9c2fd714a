// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// view
#include <fmt/format.h>

#include <cstdio>
#include <memory>

#include "commands.hpp"
#include "interrupt.hpp"
#include "polypod/viewer/server.hpp"

namespace polypod::app {

Command view_command() {
  struct Options {
    std::vector<std::string> files;
    int port = 0;
    bool once = false;
  };
  auto o = std::make_shared<Options>();
  return {
      "view", "Show machines, reports, programs, records, cells and surfaces as pages in a browser of this computer",
      "polypod view hexapod-strut",
      [o](Arguments& a) {
        a.positional(
            "FILE", o->files,
            "Machine files or names of `polypod machines`, reports (.html), programs (.ngc) alone or with their job, "
            "records (.csv), which may grow, and their machine, cells, surfaces (.stl, .vtp)");
        a.option("--port", o->port, {0, 65535}, "Of 127.0.0.1 (default 0: a free one)");
        a.flag("--once", o->once, "End after the first page was served");
      },
      [o](const Context& context) -> Result<int> {
        for (const std::string& file : o->files) {
          if (file != "-") continue;
          return fail("AP250", "view reads no standard input", {}, "write it to a file, and name that");
        }
        POLYPOD_ASSIGN(site, viewer::Site::of(o->files, POLYPOD_VERSION));
        viewer::ServeOptions options;
        options.port = o->port;
        options.once = o->once;
        options.stop = [] { return interrupted(); };
        options.ready = [&](const std::string& address) {
          if (context.json) {
            print_json({{"address", address}});
          } else {
            fmt::print("{}\n", address);
          }
          std::fflush(stdout);
          if (context.progress) fmt::print(stderr, "open this address in a browser; Ctrl-C ends the program\n");
        };
        POLYPOD_TRY(viewer::serve(site, options));
        return kDone;
      }};
}

}  // namespace polypod::app
