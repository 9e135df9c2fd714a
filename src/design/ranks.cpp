// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/design/ranks.hpp"

#include <cstdlib>

namespace polypod::design {

bool Ranks::started() {
  // Open MPI; MPICH and its relatives; Slurm's srun with either of its interfaces.
  for (const char* name : {"OMPI_COMM_WORLD_SIZE", "PMI_SIZE"}) {
    const char* size = std::getenv(name);
    if (size != nullptr && std::atoi(size) > 1) return true;
  }
  return false;
}

}  // namespace polypod::design
