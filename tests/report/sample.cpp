// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "report/sample.hpp"

#include <cstdio>

#include "polypod/core/files.hpp"

int main(int argc, char** argv) {
  if (argc != 2) {
    std::fprintf(stderr, "usage: report_sample OUT.html\n");
    return 2;
  }
  const auto status = polypod::files::write_whole(argv[1], polypod::report::sample_report().to_html());
  if (!status) std::fprintf(stderr, "%s\n", to_string(status.error()).c_str());
  return status ? 0 : 2;
}
