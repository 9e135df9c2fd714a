// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Shows: a family of machines that Polypod does not know (gantry.hpp) in every command of the program. With a file
//   family = "gantry"
//   travel_mm = 500
//   compliance_rad_per_Nm = [1e-7, 2e-7, 3e-7]   # m/N of each slide
// `04_a_family_of_your_own errors FILE --tolerance out_of_square=0.01` and all others work as with `polypod`.
#include "gantry.hpp"
#include "polypod/app/program.hpp"

int main(int argc, char** argv) {
  polypod::machine::add_family<gantry::Gantry>();
  return polypod::app::run(argc, argv);
}
