// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause

/* ---- what LinuxCNC calls ------------------------------------------------------------------------------------------- */

/* Whether a pin has changed since the figures were made from them. */
static void refresh(void) {
  static int made = 0;
  int i, same = made;
  for (i = 0; i < PARAMETERS; i++) {
    const double value = *hal->parameter[i];
    if (value != parameter[i]) {
      parameter[i] = value;
      same = 0;
    }
  }
  for (i = 0; i < JOINTS; i++) {
    if (!kTwoRoots[i] || *hal->high[i] == high[i]) continue;
    high[i] = *hal->high[i];
    same = 0;
  }
  if (same) return;
  made = 1;
  figures();
#if LEGS > 0
  prepare_legs();
#endif
}

#if ROWS == 0
/* Whether the pose is in the assembly mode of home: det F_X changes its sign at singular poses alone. */
static int in_assembly_mode(const double *q, const Pose *X) {
  double values[EQUATIONS], rows[EQUATIONS][6], step[6];
  const int n = closure_rows(X, q, values, rows, 0);
  return n != 6 || solve_rows(n, 6, rows, values, step) == home_side;
}
#endif

static int stiff_inverse(const double c[6], double *q) {
#if ROWS > 0
  return chain_inverse(c, q);
#else
  Pose X;
  double whole[6];
  if (!legs_usable || settle(c, &X, whole) != 0) return -1;
  if (legs_inverse(&X, q) != 0) return -1;
  return in_assembly_mode(q, &X) ? 0 : -1;
#endif
}

/* c: in, near where to search; out, the coordinates of the joints. */
static int stiff_forward(const double *q, double c[6]) {
  Pose X;
#if ROWS > 0
  double J[COLUMNS][6];
  Pose closed;
#if LEGS > 0
  closed = legs_home;
#endif
  if (tip(q, &closed, &X, J) != 0) return -1;
#else
  double whole[6];
  if (!legs_usable) return -1;
  if (settle(c, &X, whole) != 0) X = legs_home;
  if (legs_forward(q, &X) != 0) return -1;
#endif
  coordinates_of(NAMES_AXIS, &X, c);
  return 0;
}

#if ELEMENTS > 0
/* What the force on the tip moves the coordinates by; q: in, joints near; out, those of c. */
static int shift_of(const double c[6], double *q, const double force[3], double s[3]) {
  if (stiff_inverse(c, q) != 0) return -1;
#if ROWS > 0
  return chain_deflection(q, force, s);
#else
  {
    double whole[6];
    Pose X;
    if (settle(c, &X, whole) != 0) return -1;
    return deflection(&X, q, force, s);
  }
#endif
}

/* Adds share s to those of x, y, z that a pose prescribes. */
static void add_shift(double c[6], const double s[3], double share) {
  int k;
  for (k = 0; k < COORDINATES; k++)
    if (kCoordinate[k] < 3) c[kCoordinate[k]] += share * s[kCoordinate[k]];
}
static int read_force(double force[3]) {
  int k, any = 0;
  for (k = 0; k < 3; k++) {
    force[k] = *hal->force_used[k];
    any = any || force[k] != 0;
  }
  return any;
}

/* um/N, of the tip where the kinematics last had it; 0 where nothing is known yet. Of the pose that the last inverse or
 * forward was asked for: the last call of a cycle is that of the machine's own pose. */
static double last_pose[6], last_joints[JOINTS];
static int last_known;
static void keep_last(const double c[6], const double *q) {
  int k;
  for (k = 0; k < 6; k++) last_pose[k] = c[k];
  for (k = 0; k < JOINTS; k++) last_joints[k] = q[k];
  last_known = 1;
}
static void show_compliance(void) {
  int i, k, pin = 0;
  double s[3][3];
  if (!last_known) return;
  refresh();
  for (i = 0; i < 3; i++) {
    const double unit[3] = {i == 0, i == 1, i == 2};
    double near[JOINTS];
    for (k = 0; k < JOINTS; k++) near[k] = last_joints[k];
    if (shift_of(last_pose, near, unit, s[i]) != 0) return;
  }
  for (i = 0; i < 3; i++)
    for (k = i; k < 3; k++) {
      const double value = 1e3 * s[i][k];
      if (isfinite(value)) *hal->tip_compliance[pin] = value;
      pin++;
    }
}

/* Once a cycle, before the kinematics: the force that they use follows the pins no faster than force-rate. Where one of the
 * pins is no number, it stays for force-hold, then fades, and force-error is on until all are numbers again. */
static void follow_force(void *unused, long period) {
  static double lost = 0; /* s since the last force that was one */
  const double dt = 1e-9 * (double)period, rate = *hal->force_rate, hold = *hal->force_hold;
  const double most = isfinite(rate) && rate > 0 ? rate * dt : 0;
  int k, bad = 0;
  (void)unused;
  show_compliance();
  for (k = 0; k < 3; k++) bad = bad || !isfinite(*hal->force[k]);
  if (bad && !*hal->force_error) {
    rtapi_print_msg(RTAPI_MSG_ERR, MODULE_NAME ": the force is no number; its shift stays for a moment, then fades\n");
  }
  lost = bad ? lost + dt : 0;
  *hal->force_error = bad;
  if (bad && isfinite(hold) && lost < hold + 0.5 * dt) return;
  for (k = 0; k < 3; k++) {
    const double to = bad ? 0 : *hal->force[k], by = to - *hal->force_used[k];
    *hal->force_used[k] += by > most ? most : by < -most ? -most : by;
  }
}
#endif

/* The joints of the pose that the force deflects to c. */
static int inverse(const double c[6], double *q) {
#if ELEMENTS > 0
  double force[3], s[3], at[6];
  int k;
  if (read_force(force)) {
    if (shift_of(c, q, force, s) != 0) return -1;
    for (k = 0; k < 6; k++) at[k] = c[k];
    add_shift(at, s, -1);
    return stiff_inverse(at, q);
  }
#endif
  return stiff_inverse(c, q);
}

/* The other way round: where the force deflects the tip of the joints to. */
static int forward(const double *q, double c[6]) {
#if ELEMENTS > 0
  double force[3], s[3], stiff[6], near[JOINTS], off[6], before, now = 1e300;
  int i, k;
  if (read_force(force)) {
    if (stiff_forward(q, c) != 0) return -1;
    for (k = 0; k < 6; k++) stiff[k] = off[k] = c[k];
    for (i = 0; i < JOINTS; i++) near[i] = q[i];
    for (i = 0; i < 20; i++) { /* the shift at the deflected pose, as in the inverse, is little else than that here */
      if (shift_of(off, near, force, s) != 0) return -1;
      for (k = 0; k < 6; k++) off[k] = stiff[k];
      add_shift(off, s, 1);
      before = now;
      now = s[0] + s[1] + s[2];
      if (fabs(now - before) < 1e-12) break;
    }
    for (k = 0; k < 6; k++) c[k] = off[k];
    return 0;
  }
#endif
  return stiff_forward(q, c);
}

static void read_world(const EmcPose *w, double c[6]) {
  const double given[6] = {w->tran.x, w->tran.y, w->tran.z, w->a * RAD, w->b * RAD, w->c * RAD};
  int k;
  for (k = 0; k < 6; k++) c[k] = kWorldHome[k];
  for (k = 0; k < COORDINATES; k++) c[kCoordinate[k]] = given[kCoordinate[k]];
}

int kinematicsInverse(const EmcPose *world, double *joints, const KINEMATICS_INVERSE_FLAGS *fi,
                      KINEMATICS_FORWARD_FLAGS *ff) {
  double c[6], q[JOINTS];
  int i, bad = 0;
  (void)fi;
  (void)ff;
  refresh();
  read_world(world, c);
  for (i = 0; i < 6; i++) bad = bad || !isfinite(c[i]);
  for (i = 0; i < JOINTS; i++) q[i] = kTurns[i] ? joints[i] * RAD : joints[i];
  bad = bad || inverse(c, q) != 0;
  for (i = 0; i < JOINTS; i++) bad = bad || !isfinite(q[i]);
  *hal->iterations = iterations_last;
  if (bad) {
    ++*hal->inverse_failures;
    *hal->error = *hal->armed;
    return -1;
  }
#if ELEMENTS > 0
  keep_last(c, q);
#endif
  for (i = 0; i < JOINTS; i++) joints[i] = kTurns[i] ? q[i] / RAD : q[i];
  *hal->error = 0;
  return 0;
}

int kinematicsForward(const double *joints, EmcPose *world, const KINEMATICS_FORWARD_FLAGS *ff,
                      KINEMATICS_INVERSE_FLAGS *fi) {
  double c[6], seed[6], q[JOINTS], out[6] = {0, 0, 0, 0, 0, 0};
  int i, bad = 0;
  (void)fi;
  (void)ff;
  refresh();
  read_world(world, seed);
  for (i = 0; i < 6; i++) {
    if (!isfinite(seed[i])) seed[i] = kWorldHome[i];
    c[i] = seed[i];
  }
  for (i = 0; i < JOINTS; i++) {
    q[i] = kTurns[i] ? joints[i] * RAD : joints[i];
    bad = bad || !isfinite(q[i]);
  }
  bad = bad || forward(q, c) != 0;
  for (i = 0; i < 6; i++) bad = bad || !isfinite(c[i]);
  *hal->iterations = iterations_last;
  if (bad) { /* the world stays what it was, and the machine stops by this pin */
    ++*hal->forward_failures;
    *hal->error = *hal->armed;
    return -1;
  }
#if ELEMENTS > 0
  keep_last(c, q);
#endif
  for (i = 0; i < COORDINATES; i++) {
    const int k = kCoordinate[i];
    /* angles in the turn next to where they were */
    if (k >= 3) c[k] += 2 * M_PI * rint((seed[k] - c[k]) / (2 * M_PI));
    out[k] = k < 3 ? c[k] : c[k] / RAD;
  }
  world->tran.x = out[0];
  world->tran.y = out[1];
  world->tran.z = out[2];
  world->a = out[3];
  world->b = out[4];
  world->c = out[5];
  world->u = world->v = world->w = 0;
  *hal->error = 0;
  return 0;
}

KINEMATICS_TYPE kinematicsType(void) {
  return KINEMATICS_BOTH;
}
KINS_NOT_SWITCHABLE
EXPORT_SYMBOL(kinematicsType);
EXPORT_SYMBOL(kinematicsForward);
EXPORT_SYMBOL(kinematicsInverse);

static int is_one_of(const char *text, const char *const *words) {
  for (; *words; words++)
    if (strcmp(text, *words) == 0) return 1;
  return 0;
}

int rtapi_app_main(void) {
#if ELEMENTS > 0
  static const char *const kTipCompliance[] = {"xx", "xy", "xz", "yy", "yz", "zz"};
#endif
  static const char *const kLengths[] = {"mm", "metric", "1", "1.0", 0};
  static const char *const kAngles[] = {"deg", "degree", "1", "1.0", 0};
  int i, failed = 0;
  if (!is_one_of(linear_units, kLengths) || !is_one_of(angular_units, kAngles)) {
    rtapi_print_msg(RTAPI_MSG_ERR, MODULE_NAME ": LINEAR_UNITS is %s and ANGULAR_UNITS %s; must be mm and deg\n",
                    linear_units, angular_units);
    return -1;
  }
  component = hal_init(MODULE_NAME);
  if (component < 0) return component;
  hal = hal_malloc(sizeof *hal);
  if (!hal) {
    hal_exit(component);
    return -1;
  }
  for (i = 0; i < PARAMETERS; i++) {
    failed = failed || hal_pin_float_newf(HAL_IN, &hal->parameter[i], component, MODULE_NAME ".%s", kName[i]) < 0;
    if (!failed) *hal->parameter[i] = kDefault[i];
  }
  for (i = 0; i < JOINTS; i++) {
    if (!kTwoRoots[i]) continue;
    failed = failed || hal_pin_bit_newf(HAL_IN, &hal->high[i], component, MODULE_NAME ".high-%d", i) < 0;
    if (!failed) *hal->high[i] = kHigh[i];
  }
  failed = failed || hal_pin_bit_newf(HAL_IN, &hal->armed, component, MODULE_NAME ".armed") < 0;
  if (!failed) *hal->armed = 1;
  failed = failed || hal_pin_bit_newf(HAL_OUT, &hal->error, component, MODULE_NAME ".kinematics-error") < 0 ||
           hal_pin_s32_newf(HAL_OUT, &hal->iterations, component, MODULE_NAME ".iterations") < 0 ||
           hal_pin_s32_newf(HAL_OUT, &hal->inverse_failures, component, MODULE_NAME ".inverse-failures") < 0 ||
           hal_pin_s32_newf(HAL_OUT, &hal->forward_failures, component, MODULE_NAME ".forward-failures") < 0;
#if ELEMENTS > 0
  for (i = 0; i < 3; i++)
    failed = failed || hal_pin_float_newf(HAL_IN, &hal->force[i], component, MODULE_NAME ".force-%c", 'x' + i) < 0 ||
             hal_pin_float_newf(HAL_OUT, &hal->force_used[i], component, MODULE_NAME ".force-used-%c", 'x' + i) < 0;
  failed = failed || hal_pin_float_newf(HAL_IN, &hal->force_rate, component, MODULE_NAME ".force-rate") < 0 ||
           hal_pin_float_newf(HAL_IN, &hal->force_hold, component, MODULE_NAME ".force-hold") < 0 ||
           hal_pin_bit_newf(HAL_OUT, &hal->force_error, component, MODULE_NAME ".force-error") < 0 ||
           hal_export_funct(MODULE_NAME ".force", follow_force, 0, 1, 0, component) < 0;
  for (i = 0; i < 6; i++)
    failed = failed || hal_pin_float_newf(HAL_OUT, &hal->tip_compliance[i], component, MODULE_NAME ".tip-compliance-%s",
                                          kTipCompliance[i]) < 0;
  if (!failed) {
    *hal->force_rate = 50;
    *hal->force_hold = 0.1;
  }
  for (i = 0; i < ELEMENTS; i++) {
    failed = failed ||
             hal_pin_float_newf(HAL_IN, &hal->compliance[i], component, MODULE_NAME ".compliance.%d", i + 1) < 0;
    if (!failed) *hal->compliance[i] = kCompliance[i];
  }
#endif
  if (failed) {
    hal_exit(component);
    return -1;
  }
  refresh();
  hal_ready(component);
  return 0;
}

void rtapi_app_exit(void) {
  hal_exit(component);
}
