// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "report_command.hpp"

#include <fmt/format.h>

#include <filesystem>
#include <memory>

#include "polypod/core/files.hpp"
#include "polypod/pages/folder.hpp"

namespace polypod::app {

Command report_command() {
  struct Options {
    std::string folder, output;
  };
  auto o = std::make_shared<Options>();
  return {"report", "List the pages of results in a folder on one page, with their answers and small pictures",
          "polypod report results",
          [o](Arguments& a) {
            a.positional("DIR", o->folder, "The folder; those within it are not searched");
            a.option("-o,--output", o->output, "The index (default: DIR/index.html)");
          },
          [o](const Context& context) -> Result<int> {
            namespace fs = std::filesystem;
            const std::string output = o->output.empty() ? (fs::path(o->folder) / "index.html").string() : o->output;
            const fs::path place = fs::path(output).has_parent_path() ? fs::path(output).parent_path() : fs::path(".");
            std::error_code none;
            if (!files::is_standard_output(output) && fs::is_directory(o->folder, none) &&
                fs::is_directory(place, none) && !fs::equivalent(place, o->folder, none)) {
              return fail("VW133",
                          fmt::format("{} does not lie in {}: its links would lead nowhere", output, o->folder), {},
                          "give -o a name in that folder");
            }
            POLYPOD_ASSIGN(found, pages::folder_page(o->folder, fs::path(output).filename().string(), POLYPOD_VERSION));
            POLYPOD_TRY(check_files({}, {output}, context.json));
            if (!files::is_standard_output(output)) {
              POLYPOD_TRY(pages::may_be_index(output));
            }
            POLYPOD_TRY(files::write_whole(output, found.html));
            if (context.json) {
              print_json({{"output", output}, {"pages", found.pages}, {"others", found.others}});
            } else {
              fmt::print("{}: {} page{} of results, {} other file{}\n", output, found.pages.size(),
                         found.pages.size() == 1 ? "" : "s", found.others.size(), found.others.size() == 1 ? "" : "s");
            }
            return kDone;
          }};
}

}  // namespace polypod::app
