// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// The scripts of the pages, from viewer/dist.
#pragma once

#include <string_view>

namespace polypod::report::viewer {

extern const std::string_view page_js;        ///< of every page
extern const std::string_view live_js;        ///< of pages that `polypod view` serves
extern const std::string_view live_sha256;    ///< base64
extern const std::string_view viewer_b64;     ///< of pages with scenes: compressed (deflate), base64
extern const std::string_view licences_txt;   ///< of what viewer_b64 holds
extern const std::string_view page_sha256;    ///< of page_js, base64
extern const std::string_view viewer_sha256;  ///< of the viewer before it was compressed, base64

}  // namespace polypod::report::viewer
