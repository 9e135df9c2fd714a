// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Shows: a machine of legs from a text in the program, its workspace between proven bounds, and the largest position
// error that tolerances of its legs and joints allow. The commands `polypod workspace` and `polypod errors` say the
// same. Build, with Polypod installed under PREFIX:
//   cmake -S examples/cpp -B build/examples -DCMAKE_PREFIX_PATH=PREFIX && cmake --build build/examples
#include <cstdio>

#include "polypod/core/units.hpp"
#include "polypod/kinematics/any_machine.hpp"
#include "polypod/quality/errors.hpp"
#include "polypod/workspace/volume.hpp"

namespace {
// Three struts, and a central tube that slides through a universal joint in the base; dimensions invented.
constexpr const char* kMachine = R"toml(
family = "parallel"
task = ["x", "y", "z"]
home = { z_mm = 1200 }
tool = { z_mm = 300 }
limits = { z_min_mm = 900, z_max_mm = 1500 }
leg = [
  { drive = "strut", base_mm = [0, 270, 0], platform_mm = [0, 120, 0], min_mm = 650, max_mm = 1250 },
  { drive = "strut", base_mm = [-233.827, -135, 0], platform_mm = [-103.923, -60, 0], min_mm = 650, max_mm = 1250 },
  { drive = "strut", base_mm = [233.827, -135, 0], platform_mm = [103.923, -60, 0], min_mm = 650, max_mm = 1250 },
]
constraint = [
  { kind = "line", platform_mm = [0, 0, 0], axis = [0, 0, 1], base_mm = [0, 0, 0] },
  { kind = "square", base_axis = [1, 0, 0], platform_axis = [0, 1, 0] },
]
)toml";

int stop(const polypod::Error& error) {
  std::fprintf(stderr, "%s\n", to_string(error).c_str());
  return 1;
}
}  // namespace

int main() {
  using namespace polypod;
  namespace u = units;
  const auto machine = machine::from_text(kMachine, "a text of this program");
  if (!machine) return stop(machine.error());

  // Boxes are split until the bounds of the volume are within 5 % of each other; both bounds are proven.
  workspace::Options options;
  options.relative_tolerance = 0.05;
  const auto volume = workspace::volume(*machine, options);
  if (!volume) return stop(volume.error());
  std::printf("workspace certainly between %.1f and %.1f dm^3\n", volume->lower * 1e3, volume->upper * 1e3);

  // Every strut may be 20 um too long or too short, every joint of the base 50 um off in x, y and z.
  const auto tolerances = quality::sized(*machine, {{"leg.length", 0.02}, {"base.joint", 0.05}}, true);
  if (!tolerances) return stop(tolerances.error());
  for (const double x_mm : {0.0, 150.0, 300.0}) {
    const Pose position{Mat3::Identity(), Vec3(u::from_mm(x_mm), 0, u::from_mm(1100))};
    const kinematics::InverseResult inverse = kinematics::inverse(*machine, position);
    const kinematics::Solution* solution = inverse.reachable();
    if (solution == nullptr) return 1;
    // The tilt follows from x, y, z: `settled` gives the whole pose that the machine then has.
    const Pose X_MT = kinematics::settled(*machine, position, solution->joints);
    const auto worst = quality::worst_case(*machine, X_MT, solution->joints, *tolerances);
    if (!worst) return stop(worst.error());
    std::printf("largest position error at x = %3.0f mm, z = 1100 mm: %.1f um\n", x_mm, u::to_um(worst->position));
  }
  return 0;
}
