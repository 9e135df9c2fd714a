// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Small cells for tests.
#pragma once

namespace polypod::test {

/// A delta picks items that come one a second into the containers of a holder, which are large.
inline constexpr const char* kPicking = R"(name = "small"
minutes = 5
policy = "first"
[item]
name = "item"
diameter_mm = 40
height_mm = 10
[container]
name = "box"
capacity = 100000
diameter_mm = 100
height_mm = 50
[[conveyor]]
name = "A"
at_mm = [0, 0, 900]
length_mm = 1600
width_mm = 400
speed_mm_per_s = 100
[[source]]
name = "oven"
conveyor = "A"
arrival = "even"
per_minute = 60
at_mm = 0 #source
across_mm = [-50, 50]
[[spot]]
name = "holder"
kind = "holder"
at_mm = [800, 250, 900]
columns = 2
pitch_mm = 120
containers = 2
[[machine]]
name = "delta"
file = "delta-picker"
at_mm = [800, 50, 1800]
angles_deg = [180, 0, 0]
home_mm = [800, 50, 960]
lift_mm = 40
grip_s = 0.05
release_s = 0.05
[[task]]
name = "fill"
machine = "delta"
from = "A"
to = "holder"
window_mm = [700, 900]
release_mm = 920
when = ["work", "end"]
[[command]]
at_s = 0
order = "START"
[cost]
currency = "EUR"
part = [{ name = "screw", quantity = 2, price = 10 }]
)";

/// Two deltas bring containers from P to Q and back, each through the zone of both; they wait inside.
inline constexpr const char* kCrossing = R"(name = "crossing"
[item]
name = "item"
diameter_mm = 40
height_mm = 10
[container]
name = "box"
capacity = 5
diameter_mm = 100
height_mm = 50
[[conveyor]]
name = "A"
at_mm = [0, 900, 900]
length_mm = 600
width_mm = 400
speed_mm_per_s = 100
[[spot]]
name = "P"
kind = "holder"
at_mm = [-100, 0, 900]
containers = 1
zone = "left"
[[spot]]
name = "Q"
kind = "holder"
at_mm = [100, 0, 900]
containers = 1
zone = "right"
[[spot]]
name = "P2"
kind = "holder"
at_mm = [-100, 150, 900]
zone = "left"
[[spot]]
name = "Q2"
kind = "holder"
at_mm = [100, 150, 900]
zone = "right"
[[machine]]
name = "one"
file = "delta-picker"
at_mm = [0, 0, 1800]
angles_deg = [180, 0, 0]
home_mm = [0, 0, 1000]
grip_s = 0.1
[[machine]]
name = "two"
file = "delta-picker"
at_mm = [0, 0, 1800]
angles_deg = [180, 0, 0]
home_mm = [0, 0, 1000]
grip_s = 0.1
[[task]]
name = "there"
machine = "one"
from = "P"
to = "Q2"
keeps_zone = KEEPS
[[task]]
name = "back"
machine = "two"
from = "Q"
to = "P2"
keeps_zone = KEEPS
[[command]]
at_s = 0
order = "START"
)";

}  // namespace polypod::test
