// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// A build without MPI.
#include "polypod/design/ranks.hpp"

namespace polypod::design {

Result<std::unique_ptr<Ranks>> Ranks::join() {
  return fail("OP130", "mpirun has started this process, and this build of Polypod has no MPI", {},
              "run it without mpirun: it uses all cores of one machine; or build it with POLYPOD_MPI=ON");
}

}  // namespace polypod::design
