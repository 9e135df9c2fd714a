// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
component MACHINE_cut "The force along one program: what is expected there, and a machine that deflects under it, with its sensor";
description """The function expected gives the force for which the corrected program is made, as late as the sensor. The function cut plays the
machine: the tip stands C F beside where the joints have it, F is the force of the cut at the nearest place of the programmed path, linear in
the feed, in the distance from the path and in the turn of the way where the tip moves aside, and the sensor sees F and the weight, late and with noise. On a machine with a sensor
of its own, leave the function cut out. Made by polypod export linuxcnc for one program.""";
option singleton yes;
pin in float command_x "mm, of the tip in the machine frame M, as LinuxCNC's planner has it";
pin in float command_y "mm";
pin in float command_z "mm";
pin in float force_x "N, with which the kinematics module shifts the command";
pin in float force_y "N";
pin in float force_z "N";
pin in float compliance_xx "um/N, of the tip: tip-compliance-xx of the kinematics module";
pin in float compliance_xy "um/N";
pin in float compliance_xz "um/N";
pin in float compliance_yy "um/N";
pin in float compliance_yz "um/N";
pin in float compliance_zz "um/N";
pin in bit corrected "the corrected program runs: the expected force is given, else 0";
pin in s32 delay = 0 "cycles from the force to the sensor's reading; the expected force comes as late; at most 1000";
pin in s32 lag = 2 "cycles from the planner's command to the tip; the expected force comes as much later; at most 100";
pin in float noise = 0 "N, standard deviation of each component";
pin in float weight = 0 "N, on the sensor, along -z of M";
pin in float force_factor = 1 "the real forces over those of the table";
pin in float compliance_factor = 1 "the real compliance over that of the model";
pin in u32 seed = 1 "of the noise";
pin in bit no_number "a fault: the sensor gives no number";
pin in bit stopped "a fault: the sensor gives no new readings";
pin out float expected_x "N";
pin out float expected_y "N";
pin out float expected_z "N";
pin out float sensor_x "N";
pin out float sensor_y "N";
pin out float sensor_z "N";
pin out s32 heartbeat;
pin out float cut_x "N, the force of the cut itself";
pin out float cut_y "N";
pin out float cut_z "N";
pin out bit cutting;
pin out float error "um, of the deflected tip across the path, > 0 to the side where the force pushes";
function expected fp "the expected force";
function cut fp "the machine that deflects, and its sensor";
license "Dual BSD/GPL";
author "the Polypod authors";
include <rtapi_math.h>;
;;
#define LONGEST 1000 /* cycles of delay */
#define RING (LONGEST + 101)
#define BEHIND 2     /* cycles that LinuxCNC's joints are behind the planner */
#define AHEAD 5.0    /* mm of the path that are looked at for its next place */
#define NEAR 2.0     /* mm from the path, beyond which nothing is cut */
#define TURN 0.5     /* rad, beyond which the force does not change any more */
#define STILL 0.01   /* mm/s, below which nothing is left to cut */

/* A place of the path. Along the straight line to the next one all is linear. */
typedef struct {
  double p[3];                      /* mm, in M */
  int ends;                         /* no cut goes from here to the next one */
  double edge[3], chip[3];          /* N, and N a mm/s of feed: the force on the path is edge + chip v */
  double edge_off[3], chip_off[3];  /* the same a mm to the left of it */
  double edge_turned[3], chip_turned[3]; /* the same a rad that the way of the tip turns to the left */
  double meant[3];                  /* N, that the corrected program is made for */
} Place;
#include_table
typedef struct {
  int at, on;
  double share;
} Where;

/* The square of the distance from p to the line behind place i; `share`: where on it. */
static double apart(int i, const double p[3], double *share) {
  const double *a = kPlace[i].p, *b = kPlace[i + 1].p;
  double l = 0, t = 0, out = 0;
  int k;
  for (k = 0; k < 3; k++) {
    l += (b[k] - a[k]) * (b[k] - a[k]);
    t += (b[k] - a[k]) * (p[k] - a[k]);
  }
  t = l > 0 ? t / l : 0;
  t = t < 0 ? 0 : t > 1 ? 1 : t;
  for (k = 0; k < 3; k++) out += (a[k] + t * (b[k] - a[k]) - p[k]) * (a[k] + t * (b[k] - a[k]) - p[k]);
  *share = t;
  return out;
}
static void look(Where *w, int from, int to, double most, const double p[3], double *best) {
  double way = 0, share;
  int i, k;
  for (i = from; i < to && way < most; i++) {
    double l = 0;
    if (!kPlace[i].ends) {
      const double d = apart(i, p, &share);
      if (d < *best) {
        *best = d;
        w->at = i;
        w->share = share;
      }
    }
    for (k = 0; k < 3; k++) l += (kPlace[i + 1].p[k] - kPlace[i].p[k]) * (kPlace[i + 1].p[k] - kPlace[i].p[k]);
    if (i > from + 1) way += sqrt(l);
  }
}
/* The nearest place: a little ahead of the last one, so that a path may cross itself; else ahead; else anywhere. */
static void follow(Where *w, const double p[3]) {
  const int last = w->at;
  double best = NEAR * NEAR;
  if (w->on) look(w, last > 1 ? last - 2 : 0, PLACES - 1, AHEAD, p, &best);
  if (best >= NEAR * NEAR) look(w, last, PLACES - 1, 1e300, p, &best);
  if (best >= NEAR * NEAR) look(w, 0, last, 1e300, p, &best);
  w->on = best < NEAR * NEAR;
}
static double between(double a, double b, double share) {
  return a + share * (b - a);
}
static double of(double a[3], double b[3]) {
  return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}
static void product(double C[3][3], double f[3], double out[3]) {
  int i;
  for (i = 0; i < 3; i++) out[i] = of(C[i], f);
}
/* A normally distributed number: the sum of twelve equal ones. */
static double random_number(unsigned *state) {
  double sum = -6;
  int k;
  for (k = 0; k < 12; k++) {
    *state ^= *state << 13;
    *state ^= *state >> 17;
    *state ^= *state << 5;
    sum += *state / 4294967296.0;
  }
  return sum;
}
static int late(int cycles, int most) {
  return cycles < 0 ? 0 : cycles > most ? most : cycles;
}

FUNCTION(expected) {
  static Where where;
  static double line[RING][3];
  static int now;
  const double p[3] = {command_x, command_y, command_z};
  int k, then;
  (void)period;
  follow(&where, p);
  now = (now + 1) % RING;
  for (k = 0; k < 3; k++) {
    const int i = where.at;
    line[now][k] =
        corrected && where.on ? between(kPlace[i].meant[k], kPlace[i + 1].meant[k], where.share) : 0;
  }
  then = (now + RING - late(delay, LONGEST) - late(lag, 100)) % RING;
  expected_x = line[then][0];
  expected_y = line[then][1];
  expected_z = line[then][2];
}

FUNCTION(cut) {
  static Where where;
  static double line[RING][3], stood[BEHIND + 2][3], ordered[BEHIND + 2][3], tip[3];
  static int now, behind, begun;
  static unsigned state;
  const double dt = 1e-9 * (double)period, p[3] = {command_x, command_y, command_z};
  const double f[3] = {force_x, force_y, force_z};
  double C[3][3] = {{compliance_xx, compliance_xy, compliance_xz},
                    {compliance_xy, compliance_yy, compliance_yz},
                    {compliance_xz, compliance_yz, compliance_zz}};
  double F[3] = {0, 0, 0}, deflected[3], u[3], used[3], speed = 0, *at, *was;
  int i, k, then;
  for (i = 0; i < 3; i++)
    for (k = 0; k < 3; k++) C[i][k] *= 1e-3; /* mm/N */

  /* Where the joints have the tip: the command, shifted, some cycles later. */
  for (k = 0; k < 3; k++) used[k] = f[k];
  product(C, used, u);
  behind = (behind + 1) % (BEHIND + 2);
  for (i = begun ? behind : 0; i < (begun ? behind + 1 : BEHIND + 2); i++)
    for (k = 0; k < 3; k++) {
      ordered[i][k] = p[k];
      stood[i][k] = p[k] - u[k];
    }
  if (!begun) {
    for (k = 0; k < 3; k++) tip[k] = p[k];
    state = 2463534242u ^ (seed * 2654435761u);
    if (state == 0) state = 1;
    begun = 1;
  }
  then = (behind + 2) % (BEHIND + 2);
  at = stood[then];
  was = ordered[(behind + 1) % (BEHIND + 2)];
  for (k = 0; k < 3; k++) speed += (ordered[then][k] - was[k]) * (ordered[then][k] - was[k]);
  speed = sqrt(speed) / dt;

  follow(&where, tip);
  cutting = 0;
  error = 0;
  if (where.on) {
    const Place *a = &kPlace[where.at], *b = a + 1;
    const double dx = b->p[0] - a->p[0], dy = b->p[1] - a->p[1], l = sqrt(dx * dx + dy * dy);
    if (l > 0) {
      double n[3] = {-dy / l, dx / l, 0}, G[3], T[3], by_force[3], softer[3], slower[3];
      double e = 0, aside = 0, push, joints, stiff, damped, turn; /* e and aside: of the tip now and a cycle ago */
      const double way = fmax(speed * dt, 1e-9); /* mm */
      for (k = 0; k < 3; k++) {
        e += n[k] * (at[k] - between(a->p[k], b->p[k], where.share));
        aside += n[k] * (tip[k] - between(a->p[k], b->p[k], where.share));
        F[k] = force_factor * (between(a->edge[k], b->edge[k], where.share) +
                               speed * between(a->chip[k], b->chip[k], where.share));
        G[k] = force_factor * (between(a->edge_off[k], b->edge_off[k], where.share) +
                               speed * between(a->chip_off[k], b->chip_off[k], where.share));
        T[k] = force_factor * (between(a->edge_turned[k], b->edge_turned[k], where.share) +
                               speed * between(a->chip_turned[k], b->chip_turned[k], where.share));
        if (!(speed > STILL)) F[k] = G[k] = T[k] = 0;
      }
      /* The balance e = e_joints + n C (F + G e + T (e - aside) / way). */
      product(C, F, by_force);
      product(C, G, softer);
      product(C, T, slower);
      push = of(n, F);
      joints = e + compliance_factor * of(n, by_force);
      stiff = fmax(1 - compliance_factor * of(n, softer), 0.1);
      damped = fmax(-compliance_factor * of(n, slower), 0);
      e = (joints + damped / way * aside) / (stiff + damped / way);
      turn = (e - aside) / way;
      if (fabs(turn) > TURN) {
        turn = turn < 0 ? -TURN : TURN;
        e = (joints - damped * turn) / stiff;
      }
      e = fmin(fmax(e, -NEAR), NEAR);
      for (k = 0; k < 3; k++) F[k] += T[k] * turn;
      for (k = 0; k < 3; k++) F[k] += G[k] * e;
      if (push * of(n, F) < 0) F[0] = F[1] = F[2] = 0; /* off the material */
      cutting = push != 0;
      error = push < 0 ? -1e3 * e : 1e3 * e;
    }
  }
  product(C, F, deflected);
  for (k = 0; k < 3; k++) tip[k] = at[k] + compliance_factor * deflected[k];
  cut_x = F[0];
  cut_y = F[1];
  cut_z = F[2];

  now = (now + 1) % RING;
  for (k = 0; k < 3; k++) line[now][k] = F[k] - (k == 2 ? weight : 0) + noise * random_number(&state);
  if (stopped) return;
  then = (now + RING - late(delay, LONGEST)) % RING;
  sensor_x = no_number ? NAN : line[then][0];
  sensor_y = no_number ? NAN : line[then][1];
  sensor_z = no_number ? NAN : line[then][2];
  heartbeat++;
}
