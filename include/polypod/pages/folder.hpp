// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// One page that leads to the results of a folder.
#pragma once

#include <string>
#include <vector>

#include "polypod/core/error.hpp"

namespace polypod::pages {

struct FolderPage {
  std::string html;
  std::vector<std::string> pages;   ///< names of the pages of Polypod in the folder, in order
  std::vector<std::string> others;  ///< names of the other files
};

/// The index of the files in `folder` (not of the folders in it): each page of Polypod with its title, its first
/// answer, up to three of its figures and a small picture, all copied from it, and the names of the other files.
/// `leave_out` (a name in the folder) is not listed, nor are other indices, symbolic links and hidden files. Errors:
/// VW130 (no folder), VW131 (no page of Polypod in it).
Result<FolderPage> folder_page(const std::string& folder, const std::string& leave_out, const std::string& version);

/// Whether a file may become a page that nobody has named: it is not there, or is a page of Polypod. Errors: VW132.
Status may_be_page(const std::string& path);
/// Whether a file may become the index: it is not there, or is an index that this made. Errors: VW132.
Status may_be_index(const std::string& path);

}  // namespace polypod::pages
