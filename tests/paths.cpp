// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "paths.hpp"

namespace polypod::test {

std::string source(const std::string& file) {
  return std::string(POLYPOD_SOURCE_DIR) + "/" + file;
}

}  // namespace polypod::test
