// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause

/* ---- serial chains: rows of Denavit-Hartenberg tables, before and behind the stage with closed loops ----------------- */

static void identity(Pose *X) {
  int i, k;
  for (i = 0; i < 3; i++) {
    X->p[i] = 0;
    for (k = 0; k < 3; k++) X->R[i][k] = i == k;
  }
}

static void compose(const Pose *A, const Pose *B, Pose *out) {
  double p[3], R[3][3];
  int i, k;
  rotate(A->R, B->p, p);
  product(A->R, B->R, R);
  for (i = 0; i < 3; i++) {
    out->p[i] = A->p[i] + p[i];
    for (k = 0; k < 3; k++) out->R[i][k] = R[i][k];
  }
}

typedef struct {
  int joint, slides, craig, fixed; /* joint -1: locked at `held`; craig: R_x(alpha) T_x(a) R_z(theta) T_z(d) */
  Pose before;                     /* in front of the row, where `fixed` */
  double a, d, theta, ca, sa, sense, held;
} Row;

/* What follows from the pins; made anew when one of them changes. */
static Row chain_rows[ROWS];
#if LEGS > 0
static Pose front; /* in front of the closed stage */
#endif
static Pose behind; /* at the end */

/* A joint's axis and a point on it. */
typedef struct {
  double k[3], o[3];
} Axis;

/* Columns of a Jacobian: joints, rows (of locked ones alone), legs (of the closed stage, by their length). */
#define COLUMNS (JOINTS + ROWS + LEGS)

/* X = X A(q); the axis of its joint on the way. */
static void walk_row(const Row *row, const double *q, Pose *X, Axis *axis) {
  const double value = row->joint < 0 ? row->held : q[row->joint];
  const double theta = row->theta + (row->slides ? 0 : row->sense * value);
  const double d = row->d + (row->slides ? row->sense * value : 0);
  const double ct = cos(theta), st = sin(theta), ca = row->ca, sa = row->sa;
  Pose A;
  int k;
  if (row->fixed) compose(X, &row->before, X);
  if (row->craig) {
    const Pose x = {{{1, 0, 0}, {0, ca, -sa}, {0, sa, ca}}, {row->a, 0, 0}};
    const Pose z = {{{ct, -st, 0}, {st, ct, 0}, {0, 0, 1}}, {0, 0, d}};
    compose(X, &x, X);
    A = z;
  } else {
    const Pose whole = {{{ct, -ca * st, sa * st}, {st, ca * ct, -sa * ct}, {0, sa, ca}}, {row->a * ct, row->a * st, d}};
    A = whole;
  }
  for (k = 0; k < 3; k++) {
    axis->k[k] = row->sense * X->R[k][2];
    axis->o[k] = X->p[k];
  }
  compose(X, &A, X);
}

/* The tip of the joints with its Jacobian, J[joint] = [v; w]. `closed` is the pose of the closed stage: in, where its
 * search begins; out, what it is. */
static int tip(const double *q, Pose *closed, Pose *X, double J[COLUMNS][6]) {
  Axis axes[ROWS];
  Pose at;
  int i, k;
#if LEGS > 0
  double platform[3];
#endif
  identity(&at);
  for (i = 0; i < ROWS_BEFORE; i++) walk_row(&chain_rows[i], q, &at, &axes[i]);
#if LEGS > 0
  {
    double values[EQUATIONS], rows[EQUATIONS][6], by_drive[LEGS], M[6][6 + LEG_JOINTS + LEGS];
    Pose base, end;
    int r, c, n, drives = 0, passive = LEG_JOINTS;
    compose(&at, &front, &base);
    if (legs_forward(q + FIRST_LEG_JOINT, closed) != 0) return -1;
    compose(&base, closed, &end);
    n = closure_rows(closed, q + FIRST_LEG_JOINT, values, rows, by_drive);
    for (r = 0; r < 6; r++) {
      for (c = 0; c < 6; c++) {
        M[r][c] = 0;
        if (n == 6)
          M[r][c] = rows[r][c];
        else
          for (i = 0; i < n; i++) M[r][c] += rows[i][r] * rows[i][c];
      }
      for (c = 0; c < LEG_JOINTS; c++)
        M[r][6 + c] = n == 6 ? (r == c ? -by_drive[c] : 0) : -rows[c][r] * by_drive[c];
      for (c = 0; c < LEGS; c++) M[r][6 + LEG_JOINTS + c] = 0;
    }
    for (c = 0; c < LEGS && n == 6; c++) {
      const Leg *leg = &legs[c];
      const double length = leg->drive == STRUT ? q[FIRST_LEG_JOINT + leg->joint] + leg->length : leg->length;
      M[leg->drive == ROD ? passive++ : drives++][6 + LEG_JOINTS + c] = length / leg->reference;
    }
    if (solve(6, LEG_JOINTS + LEGS, &M[0][0], 6 + LEG_JOINTS + LEGS) == 0) return -1;
    for (c = 0; c < LEG_JOINTS + LEGS; c++) {
      double *column = J[c < LEG_JOINTS ? FIRST_LEG_JOINT + c : JOINTS + ROWS + c - LEG_JOINTS];
      double v[3], w[3];
      for (k = 0; k < 3; k++) {
        v[k] = M[k][6 + c];
        w[k] = M[3 + k][6 + c] / size;
      }
      rotate(base.R, v, column);
      rotate(base.R, w, column + 3);
    }
    for (k = 0; k < 3; k++) platform[k] = end.p[k];
    at = end;
  }
#else
  (void)closed;
#endif
  for (i = ROWS_BEFORE; i < ROWS; i++) walk_row(&chain_rows[i], q, &at, &axes[i]);
  compose(&at, &behind, X);
  for (i = 0; i < ROWS; i++) {
    const Row *row = &chain_rows[i];
    double arm[3], *column = J[row->joint < 0 ? JOINTS + i : row->joint];
    for (k = 0; k < 3; k++) {
      arm[k] = X->p[k] - axes[i].o[k];
      column[k] = axes[i].k[k];
      column[3 + k] = row->slides ? 0 : axes[i].k[k];
    }
    if (!row->slides) cross(axes[i].k, arm, column);
  }
#if LEGS > 0
  for (i = 0; i < LEG_JOINTS + LEGS; i++) { /* from the closed stage's tip to the machine's */
    double arm[3], more[3], *column = J[i < LEG_JOINTS ? FIRST_LEG_JOINT + i : JOINTS + ROWS + i - LEG_JOINTS];
    for (k = 0; k < 3; k++) arm[k] = X->p[k] - platform[k];
    cross(column + 3, arm, more);
    for (k = 0; k < 3; k++) column[k] += more[k];
  }
#endif
  for (k = 0; k < 3; k++)
    if (!isfinite(X->p[k])) return -1;
  return 0;
}

/* How far the pose misses the coordinates c, and the Jacobian of that; angles count SCALE mm a radian. */
static double task_rows(const Pose *X, const double c[6], double J[COLUMNS][6], double *e, double rows[][JOINTS]) {
  double worst = 0, w[3], E[3][6], is[6];
  Pose want;
  int i, j, k;
  pose_of(NAMES_AXIS, c, &want);
  if (ALL_ANGLES) {
    for (k = 0; k < 3; k++) w[k] = 0;
    for (k = 0; k < 3; k++) {
      double r[3], t[3], more[3];
      for (i = 0; i < 3; i++) {
        r[i] = X->R[i][k];
        t[i] = want.R[i][k];
      }
      cross(r, t, more);
      for (i = 0; i < 3; i++) w[i] += 0.5 * more[i];
    }
  } else if (NAMES_AXIS) {
    double r[3], t[3];
    for (i = 0; i < 3; i++) {
      r[i] = X->R[i][2];
      t[i] = want.R[i][2];
    }
    cross(r, t, w);
  } else {
    coordinates_of(NAMES_AXIS, X, is);
    for (i = 0; i < 3; i++) { /* twists of the rates of a, b, c; their inverse beside them */
      E[i][0] = X->R[i][0];
      E[i][1] = i == 0 ? -sin(is[5]) : i == 1 ? cos(is[5]) : 0;
      E[i][2] = i == 2;
      for (k = 0; k < 3; k++) E[i][3 + k] = i == k;
    }
    if (ANY_ANGLE && solve(3, 3, &E[0][0], 6) == 0) return -1;
  }
  for (i = 0; i < COORDINATES; i++) {
    const int coordinate = kCoordinate[i];
    double along[3] = {0, 0, 0};
    if (coordinate < 3) {
      e[i] = c[coordinate] - X->p[coordinate];
      for (j = 0; j < JOINTS; j++) rows[i][j] = J[j][coordinate];
      worst = larger(worst, fabs(e[i]));
      continue;
    }
    if (ALL_ANGLES) {
      along[coordinate - 3] = 1;
      e[i] = w[coordinate - 3];
    } else if (NAMES_AXIS) {
      for (k = 0; k < 3; k++) along[k] = X->R[k][coordinate - 3];
      e[i] = dot(along, w);
    } else {
      for (k = 0; k < 3; k++) along[k] = E[coordinate - 3][3 + k];
      e[i] = c[coordinate] - is[coordinate];
      e[i] -= 2 * M_PI * rint(e[i] / (2 * M_PI));
    }
    e[i] *= SCALE;
    for (j = 0; j < JOINTS; j++) rows[i][j] = SCALE * dot(along, J[j] + 3);
    worst = larger(worst, fabs(e[i]));
  }
  return worst;
}

static double unit_of(int joint) {
  return kTurns[joint] ? 1 : SCALE;
}

/* Newton's method from the joints q, which become those of the coordinates c. Returns the sign of the Jacobian's
 * determinant there: it changes at singular poses alone, between postures; 0 where it does not converge. */
static int joints_newton(const double c[6], double *q, Pose *closed) {
  double J[COLUMNS][6], e[JOINTS], rows[JOINTS][JOINTS], M[JOINTS][JOINTS + 1];
  Pose X;
  int iteration, i, j;
  for (iteration = 0; iteration < 25; iteration++) {
    double worst = 0, share, miss;
    int sign;
    if (tip(q, closed, &X, J) != 0) return 0;
    miss = task_rows(&X, c, J, e, rows);
    if (!(miss >= 0)) return 0;
    for (i = 0; i < JOINTS; i++) {
      for (j = 0; j < JOINTS; j++) M[i][j] = rows[i][j] * unit_of(j) / SCALE;
      M[i][JOINTS] = e[i] / SCALE;
    }
    sign = solve(JOINTS, 1, &M[0][0], JOINTS + 1);
    if (sign == 0) return 0;
    for (i = 0; i < JOINTS; i++) worst = larger(worst, fabs(M[i][JOINTS]));
    if (!isfinite(worst)) return 0;
    share = worst > 0.3 ? 0.3 / worst : 1;
    for (i = 0; i < JOINTS; i++) q[i] += share * M[i][JOINTS] * unit_of(i);
    iterations_last = iteration + 1;
    /* the next step would be about the square of this one; a half turn off has no error either */
    if (share == 1 && worst < 1e-8 && miss < 1e-4 * SCALE) {
      Pose want;
      pose_of(NAMES_AXIS, c, &want);
      if (ALL_ANGLES && dot(want.R[0], X.R[0]) + dot(want.R[1], X.R[1]) + dot(want.R[2], X.R[2]) < 2) return 0;
      if (NAMES_AXIS && want.R[0][2] * X.R[0][2] + want.R[1][2] * X.R[1][2] + want.R[2][2] * X.R[2][2] < 0) return 0;
      return sign;
    }
  }
  return 0;
}

static int side_at(const double *q, Pose *closed, double c[6]) {
  double J[COLUMNS][6], e[JOINTS], rows[JOINTS][JOINTS], M[JOINTS][JOINTS + 1];
  Pose X;
  int i, j;
  if (tip(q, closed, &X, J) != 0) return 0;
  coordinates_of(NAMES_AXIS, &X, c);
  if (!(task_rows(&X, c, J, e, rows) >= 0)) return 0;
  for (i = 0; i < JOINTS; i++) {
    for (j = 0; j < JOINTS; j++) M[i][j] = rows[i][j] * unit_of(j) / SCALE;
    M[i][JOINTS] = 0;
  }
  return solve(JOINTS, 1, &M[0][0], JOINTS + 1);
}

/* The joints of the coordinates c, in the posture of the joints that are given: by steps along the straight line of the
 * coordinates where one step would be long. Never through a singular pose. */
static int chain_inverse(const double c[6], double *joints) {
  static const int kSteps[5] = {1, 4, 16, 64, 256};
  double start[JOINTS], q[JOINTS], from[6], at[6], turns[6];
  Pose closed, begin;
  int i, k, s, side, still = 1;
  for (i = 0; i < JOINTS; i++) {
    if (!isfinite(joints[i])) return -1;
    still = still && joints[i] == 0;
    start[i] = joints[i];
  }
#if LEGS > 0
  begin = legs_home;
#else
  identity(&begin);
#endif
  side = side_at(start, &begin, from);
  if (side == 0 && still) { /* nobody has told the joints yet, and 0 is no posture */
    for (i = 0; i < JOINTS; i++) start[i] = kHomeJoints[i];
    side = side_at(start, &begin, from);
  }
  if (side == 0) return -1;
  for (k = 0; k < 6; k++) {
    turns[k] = c[k] - from[k];
    if (k >= 3) turns[k] -= 2 * M_PI * rint(turns[k] / (2 * M_PI));
  }
  for (s = 0; s < 5; s++) {
    for (i = 0; i < JOINTS; i++) q[i] = start[i];
    closed = begin;
    for (k = 1; k <= kSteps[s]; k++) {
      double last[JOINTS];
      int near = 1;
      for (i = 0; i < JOINTS; i++) last[i] = q[i];
      for (i = 0; i < 6; i++) at[i] = from[i] + turns[i] * k / kSteps[s];
      if (k == kSteps[s])
        for (i = 0; i < 6; i++) at[i] = c[i];
      if (joints_newton(at, q, &closed) != side) break;
      for (i = 0; i < JOINTS; i++) near = near && fabs(q[i] - last[i]) < 0.5 * unit_of(i);
      if (!near) break;
    }
    if (k > kSteps[s]) {
      for (i = 0; i < JOINTS; i++) {
        if (!isfinite(q[i])) return -1;
        joints[i] = q[i];
      }
      return 0;
    }
  }
  return -1;
}

#if ELEMENTS > 0
/* s = C force at the tip of the joints q. */
static int chain_deflection(const double *q, const double force[3], double s[3]) {
  double J[COLUMNS][6];
  Pose X, closed;
  int i, k;
#if LEGS > 0
  closed = legs_home;
#else
  identity(&closed);
#endif
  if (tip(q, &closed, &X, J) != 0) return -1;
  for (k = 0; k < 3; k++) s[k] = 0;
  for (i = 0; i < ELEMENTS; i++) {
    const double *column = J[kNumber[i] + (kElement[i] == BY_JOINT ? 0 : kElement[i] == BY_ROW ? JOINTS : JOINTS + ROWS)];
    const double gives = 1e-3 * *hal->compliance[i] * dot(column, force); /* mm/N, rad/Nmm */
    for (k = 0; k < 3; k++) s[k] += gives * column[k];
  }
  return 0;
}
#endif
