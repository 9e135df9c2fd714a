// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
component MACHINE_force "On-line correction: the force of a sensor, for the kinematics module that shifts the command by -C F";
description """Once a cycle, before the function force of the kinematics module: a low-pass, the weight of spindle and tool off, the force
that the program is corrected for already off. The shift C F is kept within its limit and follows at its rate. The watchdog trips where no good
force came for hold-s, or where the shift asked for was beyond its limit for as long: the shift holds until then, fades at its rate, and error
is on until the machine is switched off. Made by polypod export linuxcnc.""";
option singleton yes;
pin in float sensor_x "N, on the tool, in the machine frame M, with the weight";
pin in float sensor_y "N";
pin in float sensor_z "N";
pin in s32 heartbeat "changes with each reading of the sensor";
pin in float expected_x "N, for which the program is corrected already; as late as the sensor";
pin in float expected_y "N";
pin in float expected_z "N";
pin in float compliance_xx "um/N, of the tip: tip-compliance-xx of the kinematics module";
pin in float compliance_xy "um/N";
pin in float compliance_xz "um/N";
pin in float compliance_yy "um/N";
pin in float compliance_yz "um/N";
pin in float compliance_zz "um/N";
pin in bit on = 1 "0: no correction, nothing trips";
pin in bit machine_is_on "while it is off the shift fades, and what tripped is forgotten";
pin in bit module_error "force-error of the kinematics module";
pin in float weight = 0 "N, of spindle and tool, which the sensor bears along -z of M";
pin in float cutoff = 10 "Hz, of the low-pass of first order";
pin in float shift_limit = 500 "um";
pin in float shift_rate = 10000 "um/s";
pin in float hold = 0.1 "s";
pin out float force_x "N: force-x of the kinematics module";
pin out float force_y "N";
pin out float force_z "N";
pin out float shift_x "um, of the command: -C F";
pin out float shift_y "um";
pin out float shift_z "um";
pin out bit lost "no good reading in this cycle, or none for half of hold";
pin out bit limited "the shift asked for is beyond its limit";
pin out bit error "the watchdog has tripped: holds the feed";
variable double filtered[3];
variable double force[3];
variable double since; // s, since the last good reading
variable double beyond; // s, for which the limit has been exceeded
variable int last_beat;
function _ fp;
license "Dual BSD/GPL";
author "the Polypod authors";
include <rtapi_math.h>;
;;
static double positive(double value) {
  return isfinite(value) && value > 0 ? value : 0;
}

/* C f, um, and its length. */
static double times(double C[3][3], const double f[3], double out[3]) {
  int i;
  for (i = 0; i < 3; i++) out[i] = C[i][0] * f[0] + C[i][1] * f[1] + C[i][2] * f[2];
  return sqrt(out[0] * out[0] + out[1] * out[1] + out[2] * out[2]);
}

FUNCTION(_) {
  const double dt = 1e-9 * (double)period, way = positive(shift_rate) * dt, limit = positive(shift_limit);
  const double share = 1 - exp(-2 * M_PI * positive(cutoff) * dt), longest = positive(hold) + 0.5 * dt;
  const double reading[3] = {sensor_x, sensor_y, sensor_z + weight}, meant[3] = {expected_x, expected_y, expected_z};
  double C[3][3] = {{compliance_xx, compliance_xy, compliance_xz},
                    {compliance_xy, compliance_yy, compliance_yz},
                    {compliance_xz, compliance_yz, compliance_zz}};
  double target[3], change[3], s[3], size;
  const int active = on && machine_is_on;
  int k, bad = 0, hold_still;
  for (k = 0; k < 3; k++) bad = bad || !isfinite(reading[k]) || !isfinite(meant[k]);

  since = bad || heartbeat == last_beat ? since + dt : 0;
  last_beat = heartbeat;
  lost = bad || since > 0.5 * longest;
  if (!active) since = beyond = 0;
  if (!bad)
    for (k = 0; k < 3; k++) filtered[k] += share * (reading[k] - meant[k] - filtered[k]);

  for (k = 0; k < 3; k++) target[k] = filtered[k];
  size = times(C, target, s);
  limited = active && size > limit;
  if (size > limit)
    for (k = 0; k < 3; k++) target[k] *= limit / size;
  beyond = limited && !bad ? beyond + dt : limited ? beyond : 0;

  if (!machine_is_on) {
    error = 0;
  } else if (on && !error && (since > longest || beyond > longest)) {
    error = 1;
    rtapi_print_msg(RTAPI_MSG_ERR, "MACHINE_force: on-line correction stopped: %s; the shift fades, the feed is held\n",
                    since > longest ? "the sensor gives no force" : "the shift asked for is larger than its limit");
  }
  if (module_error) error = 1;
  hold_still = bad && active && !error;
  if (!active || error) target[0] = target[1] = target[2] = 0;

  for (k = 0; k < 3; k++) change[k] = target[k] - force[k];
  size = times(C, change, s);
  for (k = 0; k < 3 && !hold_still; k++) force[k] += size > way ? change[k] * (way / size) : change[k];
  times(C, force, s);
  force_x = force[0];
  force_y = force[1];
  force_z = force[2];
  shift_x = -s[0];
  shift_y = -s[1];
  shift_z = -s[2];
}
