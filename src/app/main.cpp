// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/app/program.hpp"

int main(int argc, char** argv) {
  return polypod::app::run(argc, argv);
}
