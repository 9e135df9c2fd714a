// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause

/* ---- the stage with closed loops: legs and constraints between its base and its platform ---------------------------- */

static void rotate_back(const double R[3][3], const double v[3], double out[3]) {
  int i;
  for (i = 0; i < 3; i++) out[i] = R[0][i] * v[0] + R[1][i] * v[1] + R[2][i] * v[2];
}

/* R becomes exp([w]) R */
static void turn(const double w[3], double R[3][3]) {
  const double n2 = dot(w, w), n = sqrt(n2);
  const double s = n < 1e-6 ? 1 - n2 / 6 : sin(n) / n, h = n < 1e-6 ? 0.5 - n2 / 24 : (1 - cos(n)) / n2;
  double E[3][3], old[3][3];
  int i, k;
  for (i = 0; i < 3; i++)
    for (k = 0; k < 3; k++) {
      E[i][k] = h * w[i] * w[k] + (i == k ? 1 - h * n2 : 0);
      old[i][k] = R[i][k];
    }
  E[0][1] -= s * w[2];
  E[0][2] += s * w[1];
  E[1][0] += s * w[2];
  E[1][2] -= s * w[0];
  E[2][0] -= s * w[1];
  E[2][1] += s * w[0];
  product(E, old, R);
}

/* A x = b in least squares where there are more rows than unknowns, by normal equations; x replaces b's first entries.
 * The sign of the determinant where it is square, 1 where it is not, 0 where it is singular. */
static int solve_rows(int rows, int unknowns, const double A[][6], const double *b, double *x) {
  double M[6][7];
  int i, k, r, sign;
  if (rows == unknowns) {
    for (i = 0; i < rows; i++) {
      for (k = 0; k < unknowns; k++) M[i][k] = A[i][k];
      M[i][unknowns] = b[i];
    }
  } else {
    for (i = 0; i < unknowns; i++) {
      for (k = 0; k < unknowns; k++) {
        M[i][k] = 0;
        for (r = 0; r < rows; r++) M[i][k] += A[r][i] * A[r][k];
      }
      M[i][unknowns] = 0;
      for (r = 0; r < rows; r++) M[i][unknowns] += A[r][i] * b[r];
    }
  }
  sign = solve(unknowns, 1, &M[0][0], 7);
  if (sign == 0) return 0;
  for (i = 0; i < unknowns; i++) x[i] = M[i][unknowns];
  return rows == unknowns ? sign : 1;
}

enum { STRUT, RAIL, CRANK, ROD };
enum { PLANE, PLATFORM_PLANE, LINE, SQUARE, ORIENTATION };

/* A leg's length is that between its driven end and its end on the platform; `end` from the tool tip. */
typedef struct {
  int drive, joint, ring;
  double length; /* of the rod; of struts what is added to the reading */
  double base[3], end[3], still[3];
  double direction[3]; /* of the rail, the crank's axis, the ring's axis */
  double zero[3], side[3], arm, offset, radius;
  double reference, middle; /* length at home; middle of the drive's range */
} Leg;

typedef struct {
  int kind;
  double at[3], base[3], base_axis[3], platform_axis[3], across[2][3];
} Constraint;

/* What follows from the pins; made anew when one of them changes. */
static Leg legs[LEGS];
static Constraint constraints[ARRAY_SIZE_OR_ONE(CONSTRAINTS)];
static Pose legs_home;
static double home_joints[ARRAY_SIZE_OR_ONE(LEG_JOINTS)];
static double size; /* mm, what a radian counts as */
static int home_side, home_passive_side, legs_usable;

/* Two unit vectors square to a unit vector. */
static void set_across(Constraint *c) {
  const double x[3] = {1, 0, 0}, y[3] = {0, 1, 0};
  double n;
  int k;
  cross(c->platform_axis, fabs(c->platform_axis[0]) < 0.9 ? x : y, c->across[0]);
  n = sqrt(dot(c->across[0], c->across[0]));
  for (k = 0; k < 3; k++) c->across[0][k] /= n;
  cross(c->platform_axis, c->across[0], c->across[1]);
}

static void add_row(double F, const double linear[3], const double angular[3], double *values, double rows[][6], int *n) {
  int k;
  values[*n] = F;
  for (k = 0; k < 3; k++) {
    rows[*n][k] = linear[k];
    rows[*n][3 + k] = angular[k] / size;
  }
  ++*n;
}

/* The end of the drive of a leg. */
static void anchor_of(const Leg *leg, double q, double out[3]) {
  int k;
  for (k = 0; k < 3; k++) out[k] = leg->base[k];
  if (leg->drive == RAIL) {
    for (k = 0; k < 3; k++) out[k] += (q + leg->offset) * leg->direction[k];
  } else if (leg->drive == CRANK) {
    const double c = leg->arm * cos(q + leg->offset), s = leg->arm * sin(q + leg->offset);
    for (k = 0; k < 3; k++) out[k] += c * leg->zero[k] + s * leg->side[k];
  }
}

/* (length^2 - wanted^2) / (2 reference), its row by the tip's twist [v; w size], and by q where `by_drive` is given. */
static void leg_row(const Leg *leg, const Pose *X, double q, double *values, double rows[][6], int *n, double *by_drive) {
  const double wanted = leg->drive == STRUT ? q + leg->length : leg->length, scale = 1 / leg->reference;
  double anchor[3], r[3], linear[3], angular[3];
  int k;
  anchor_of(leg, q, anchor);
  if (leg->ring) {
    double u[3], d[3], h, rho, g[3];
    for (k = 0; k < 3; k++) u[k] = anchor[k] - X->p[k];
    rotate_back(X->R, u, d);
    for (k = 0; k < 3; k++) d[k] -= leg->end[k];
    h = dot(leg->direction, d);
    for (k = 0; k < 3; k++) g[k] = d[k] - h * leg->direction[k];
    rho = sqrt(dot(g, g));
    for (k = 0; k < 3; k++)
      g[k] = (rho > 0 ? (rho - leg->radius) / rho * g[k] : 0) + h * leg->direction[k];
    rotate(X->R, g, linear);
    for (k = 0; k < 3; k++) linear[k] *= -scale;
    cross(u, linear, angular);
    rho -= leg->radius;
    add_row(0.5 * scale * (rho * rho + h * h - wanted * wanted), linear, angular, values, rows, n);
    if (by_drive) *by_drive = leg->drive == STRUT ? -scale * wanted : 0;
    return;
  }
  rotate(X->R, leg->end, r);
  {
    double y[3];
    for (k = 0; k < 3; k++) {
      y[k] = X->p[k] + r[k] + leg->still[k] - anchor[k];
      linear[k] = scale * y[k];
    }
    cross(r, linear, angular);
    add_row(0.5 * scale * (dot(y, y) - wanted * wanted), linear, angular, values, rows, n);
    if (!by_drive) return;
    if (leg->drive == STRUT) {
      *by_drive = -scale * wanted;
    } else if (leg->drive == RAIL) {
      *by_drive = -scale * dot(y, leg->direction);
    } else if (leg->drive == CRANK) {
      const double c = cos(q + leg->offset), s = sin(q + leg->offset);
      *by_drive = -scale * leg->arm * (c * dot(y, leg->side) - s * dot(y, leg->zero));
    } else {
      *by_drive = 0;
    }
  }
}

static void constraint_rows(const Constraint *c, const Pose *X, double *values, double rows[][6], int *n) {
  const double none[3] = {0, 0, 0};
  double r[3], angular[3];
  int i, k;
  if (c->kind == PLANE) {
    double d[3];
    rotate(X->R, c->at, r);
    for (k = 0; k < 3; k++) d[k] = X->p[k] + r[k] - c->base[k];
    cross(r, c->base_axis, angular);
    add_row(dot(c->base_axis, d), c->base_axis, angular, values, rows, n);
  } else if (c->kind == PLATFORM_PLANE) {
    double u[3], normal[3], back[3];
    for (k = 0; k < 3; k++) u[k] = c->base[k] - X->p[k];
    rotate(X->R, c->platform_axis, normal);
    cross(normal, u, angular);
    for (k = 0; k < 3; k++) back[k] = -normal[k];
    add_row(dot(normal, u) - dot(c->platform_axis, c->at), back, angular, values, rows, n);
  } else if (c->kind == LINE) {
    double u[3], d[3], E[3];
    for (k = 0; k < 3; k++) u[k] = c->base[k] - X->p[k];
    rotate_back(X->R, u, d);
    for (k = 0; k < 3; k++) d[k] -= c->at[k];
    for (i = 0; i < 2; i++) {
      rotate(X->R, c->across[i], E);
      for (k = 0; k < 3; k++) E[k] = -E[k];
      cross(u, E, angular);
      add_row(dot(c->across[i], d), E, angular, values, rows, n);
    }
  } else if (c->kind == SQUARE) {
    double b[3];
    rotate(X->R, c->platform_axis, b);
    cross(b, c->base_axis, angular);
    for (k = 0; k < 3; k++) angular[k] *= size;
    add_row(size * dot(c->base_axis, b), none, angular, values, rows, n);
  } else {
    double M[3][3], trace;
    for (i = 0; i < 3; i++)
      for (k = 0; k < 3; k++) M[i][k] = dot(X->R[i], legs_home.R[k]); /* R R_home^T */
    trace = M[0][0] + M[1][1] + M[2][2];
    for (k = 0; k < 3; k++) {
      const int a = (k + 1) % 3, b = (k + 2) % 3;
      for (i = 0; i < 3; i++) angular[i] = 0.5 * size * ((i == k ? trace : 0) - M[k][i]);
      add_row(0.5 * size * (M[b][a] - M[a][b]), none, angular, values, rows, n);
    }
  }
}

/* What holds whatever the drives do. */
static int passive_rows(const Pose *X, double *values, double rows[][6]) {
  int i, n = 0;
  for (i = 0; i < LEGS; i++)
    if (legs[i].drive == ROD) leg_row(&legs[i], X, 0, values, rows, &n, 0);
  for (i = 0; i < CONSTRAINTS; i++) constraint_rows(&constraints[i], X, values, rows, &n);
  if (IDLE_TURN) { /* all legs end on rings round the tool axis: c is kept */
    const double none[3] = {0, 0, 0}, c = cos(kHome[5]), s = sin(kHome[5]);
    double angular[3];
    angular[0] = -size * X->R[2][0] * c;
    angular[1] = -size * X->R[2][0] * s;
    angular[2] = size * (X->R[0][0] * c + X->R[1][0] * s);
    add_row(size * (X->R[1][0] * c - X->R[0][0] * s), none, angular, values, rows, &n);
  }
  return n;
}

/* All equations, the drives' legs first; `by_drive` of those. */
static int closure_rows(const Pose *X, const double *q, double *values, double rows[][6], double *by_drive) {
  int i, n = 0;
  for (i = 0; i < LEGS; i++)
    if (legs[i].drive != ROD) leg_row(&legs[i], X, q[legs[i].joint], values, rows, &n, by_drive ? &by_drive[n] : 0);
  return n + passive_rows(X, values + n, rows + n);
}

/* Both roots of a drive at a pose are real where this is not negative. */
static double root_of(const Leg *leg, const Pose *X, int high, double *q) {
  double r[3], y[3], under;
  int k;
  if (leg->ring) {
    double u[3], d[3], h;
    for (k = 0; k < 3; k++) u[k] = leg->base[k] - X->p[k];
    rotate_back(X->R, u, d);
    for (k = 0; k < 3; k++) d[k] -= leg->end[k];
    h = dot(leg->direction, d);
    for (k = 0; k < 3; k++) d[k] -= h * leg->direction[k];
    under = sqrt(dot(d, d)) - leg->radius;
    *q = sqrt(under * under + h * h) - leg->length;
    return 0;
  }
  rotate(X->R, leg->end, r);
  for (k = 0; k < 3; k++) y[k] = X->p[k] + r[k] + leg->still[k] - leg->base[k];
  if (leg->drive == STRUT) {
    *q = sqrt(dot(y, y)) - leg->length;
    return 0;
  }
  if (leg->drive == RAIL) {
    const double along = dot(y, leg->direction);
    under = leg->length * leg->length - dot(y, y) + along * along;
    if (!(under >= 0)) return -1;
    *q = along + (high ? sqrt(under) : -sqrt(under)) - leg->offset;
    return under;
  }
  {
    const double c = dot(y, leg->zero), s = dot(y, leg->side), rho2 = c * c + s * s;
    const double want = (dot(y, y) + leg->arm * leg->arm - leg->length * leg->length) / (2 * leg->arm);
    double t;
    under = rho2 - want * want;
    if (!(under >= 0)) return -1;
    t = atan2(s, c) + (high ? atan2(sqrt(under), want) : -atan2(sqrt(under), want)) - leg->offset;
    *q = t - 2 * M_PI * rint((t - leg->middle) / (2 * M_PI));
    return under;
  }
}

/* The drives at a whole pose, in the working mode of the pins high-N; -1 where a leg does not reach. */
static int legs_inverse(const Pose *X, double *q) {
  int i;
  for (i = 0; i < LEGS; i++) {
    const Leg *leg = &legs[i];
    if (leg->drive == ROD) continue;
    if (root_of(leg, X, is_high(leg->joint), &q[leg->joint]) < 0 || !isfinite(q[leg->joint])) return -1;
  }
  return 0;
}

/* One Newton's way to the pose of the joints; 1 where it converged, in the assembly mode of home, not far from the seed. */
static int legs_newton(const double *q, Pose *X) {
  const Pose seed = *X;
  double values[EQUATIONS], rows[EQUATIONS][6], step[6], bound = 0;
  int iteration, i, k, n, sign = 0, done = 0;
  for (iteration = 0; iteration < 25 && !done; iteration++) {
    double way, angle, share;
    n = closure_rows(X, q, values, rows, 0);
    sign = solve_rows(n, 6, rows, values, step);
    if (sign == 0) return 0;
    for (k = 3; k < 6; k++) step[k] /= size;
    way = sqrt(dot(step, step)) / size;
    angle = sqrt(dot(step + 3, step + 3));
    if (!isfinite(way + angle)) return 0;
    share = larger(way, angle) > 0.5 ? 0.5 / larger(way, angle) : 1;
    for (k = 0; k < 6; k++) step[k] *= -share;
    for (k = 0; k < 3; k++) X->p[k] += step[k];
    turn(step + 3, X->R);
    /* the next step would be about the square of this one */
    done = share == 1 && larger(way, angle) < (n == 6 ? 1e-8 : 1e-11);
  }
  iterations_last = iteration;
  if (!done) return 0;
  if (n != 6 || iteration > 6) { /* drives that contradict each other close nowhere */
    n = closure_rows(X, q, values, rows, 0);
    for (i = 0; i < n; i++) bound = larger(bound, fabs(values[i]));
    if (!(bound < (n == 6 ? 1e-9 * size : 0.05))) return 0;
  }
  if (n == 6 && sign != home_side) return 0;
  for (k = 0; k < 3; k++)
    if (fabs(X->p[k] - seed.p[k]) > 0.5 * size) return 0;
  for (i = 0; i < 3; i++)
    for (k = 0; k < 3; k++)
      if (fabs(X->R[i][k] - seed.R[i][k]) > 0.5) return 0;
  return 1;
}

/* Whether the drives stand in the working mode of the pins: else the inverse would jump. */
static int in_working_mode(const double *q, const Pose *X) {
  int i;
  for (i = 0; i < LEGS; i++) {
    double root;
    if (legs[i].drive != RAIL && legs[i].drive != CRANK) continue;
    if (root_of(&legs[i], X, is_high(legs[i].joint), &root) < 0) continue; /* at the end of its reach, where both meet */
    root -= q[legs[i].joint];
    if (legs[i].drive == CRANK) root = legs[i].arm * (root - 2 * M_PI * rint(root / (2 * M_PI)));
    if (fabs(root) > 0.05 + 1e-6 * size) return 0;
  }
  return 1;
}

/* The pose of the joints: from the seed where it is near, else from home by joints between those of home and q. */
static int legs_forward(const double *q, Pose *X) {
  static const int kSteps[4] = {1, 4, 16, 64};
  Pose at = *X;
  double between[ARRAY_SIZE_OR_ONE(LEG_JOINTS)];
  int i, k, s;
  if (!legs_usable) return -1;
  if (legs_newton(q, &at)) {
    if (!in_working_mode(q, &at)) return -1;
    *X = at;
    return 0;
  }
  for (s = 0; s < (is_armed() ? 4 : 1); s++) { /* a machine that is off may stand anyhow, and needs no search */
    at = legs_home;
    for (k = 1; k <= kSteps[s]; k++) {
      for (i = 0; i < LEG_JOINTS; i++) between[i] = home_joints[i] + (q[i] - home_joints[i]) * k / kSteps[s];
      if (!legs_newton(between, &at)) break;
    }
    if (k > kSteps[s]) {
      if (!in_working_mode(q, &at)) return -1;
      *X = at;
      return 0;
    }
  }
  return -1;
}

/* The rates of x, y, z, a, b, c as twists. */
static void coordinate_twist(int coordinate, const double c[6], const Pose *X, double twist[6]) {
  int k;
  for (k = 0; k < 6; k++) twist[k] = 0;
  if (coordinate < 3) {
    twist[coordinate] = 1;
  } else if (LEGS_NAME_AXIS && coordinate == 5) {
    for (k = 0; k < 3; k++) twist[3 + k] = size * X->R[k][2];
  } else if (coordinate == 3) {
    for (k = 0; k < 3; k++) twist[3 + k] = size * X->R[k][0];
  } else if (coordinate == 4) {
    twist[3] = -size * sin(c[5]);
    twist[4] = size * cos(c[5]);
  } else {
    twist[5] = size;
  }
}

/* Newton's method for the coordinates that no pose prescribes, in c. Angles are in c as size rad. */
static int settle_newton(double c[6], Pose *X) {
  double start[6];
  int iteration, i, k, n, sign = 1;
  for (k = 0; k < 6; k++) start[k] = c[k];
  for (iteration = 0; iteration < 20; iteration++) {
    double values[EQUATIONS], rows[EQUATIONS][6], twist[6], small[EQUATIONS][6], step[6], worst = 0, share;
    pose_of(LEGS_NAME_AXIS, c, X);
    n = passive_rows(X, values, rows);
    for (k = 0; k < LEG_FREE; k++) {
      int r;
      coordinate_twist(kFree[k], c, X, twist);
      for (i = 0; i < n; i++) {
        small[i][k] = 0;
        for (r = 0; r < 6; r++) small[i][k] += rows[i][r] * twist[r];
        if (kFree[k] >= 3) small[i][k] /= size;
      }
    }
    for (i = 0; i < n; i++) worst = larger(worst, fabs(values[i]));
    sign = solve_rows(n, LEG_FREE, small, values, step);
    if (sign == 0 || !isfinite(worst)) return 0;
    if (worst < 1e-12 * size) break;
    worst = 0;
    for (k = 0; k < LEG_FREE; k++) worst = larger(worst, fabs(step[k]) / size);
    if (!isfinite(worst)) return 0;
    share = worst > 0.5 ? 0.5 / worst : 1;
    for (k = 0; k < LEG_FREE; k++) c[kFree[k]] -= share * step[k] / (kFree[k] >= 3 ? size : 1);
    if (worst < 1e-9) {
      pose_of(LEGS_NAME_AXIS, c, X);
      break;
    }
  }
  if (iteration == 20) return 0;
  if (home_passive_side != 0 && sign != home_passive_side) return 0;
  for (k = 0; k < 6; k++)
    if (fabs(c[k] - start[k]) > (k < 3 ? 0.35 * size : 0.35)) return 0;
  return 1;
}

/* The whole pose for what the machine's coordinates prescribe: the others follow from home without a jump. */
static int settle(const double given[6], Pose *X, double c[6]) {
  static const int kSteps[4] = {1, 4, 16, 64};
  double from[6];
  int i, k, s, j;
  if (LEG_FREE == 0) {
    for (k = 0; k < 6; k++) c[k] = given[k];
    pose_of(LEGS_NAME_AXIS, c, X);
    return 0;
  }
  for (s = 0; s < 4; s++) {
    for (i = 0; i < 6; i++) c[i] = from[i] = kHome[i];
    for (k = 1; k <= kSteps[s]; k++) {
      for (j = 0; j < 6; j++) {
        int is_free = 0;
        for (i = 0; i < LEG_FREE; i++) is_free = is_free || kFree[i] == j;
        if (!is_free) c[j] = from[j] + (given[j] - from[j]) * k / kSteps[s];
      }
      if (!settle_newton(c, X)) break;
    }
    if (k > kSteps[s]) return 0;
  }
  return -1;
}

/* Home and what is compared with it. */
static void prepare_legs(void) {
  double values[EQUATIONS], rows[EQUATIONS][6], step[6], c[6];
  int i, k, n;
  size = 0;
  for (i = 0; i < LEGS; i++) size += sqrt(dot(legs[i].end, legs[i].end)) / LEGS;
  if (!(size > 1)) size = 1;
  pose_of(LEGS_NAME_AXIS, kHome, &legs_home);
  for (i = 0; i < CONSTRAINTS; i++)
    if (constraints[i].kind == LINE) set_across(&constraints[i]);
  home_passive_side = 0;
  legs_usable = settle(kHome, &legs_home, c) == 0 && legs_inverse(&legs_home, home_joints) == 0;
  if (!legs_usable) return;
  if (LEG_FREE > 0) {
    double twist[6], small[EQUATIONS][6];
    int r;
    n = passive_rows(&legs_home, values, rows);
    for (k = 0; k < LEG_FREE; k++) {
      coordinate_twist(kFree[k], c, &legs_home, twist);
      for (i = 0; i < n; i++) {
        small[i][k] = 0;
        for (r = 0; r < 6; r++) small[i][k] += rows[i][r] * twist[r];
        if (kFree[k] >= 3) small[i][k] /= size;
      }
    }
    if (n == LEG_FREE) home_passive_side = solve_rows(n, LEG_FREE, small, values, step);
  }
  n = closure_rows(&legs_home, home_joints, values, rows, 0);
  home_side = solve_rows(n, 6, rows, values, step);
  legs_usable = home_side != 0;
}

#if ELEMENTS > 0 && ROWS == 0
/* s = C force at the tip: with lambda = A^-T (force, 0) the load of each equation, s = A^-1 of what that deflects. */
static int deflection(const Pose *X, const double *q, const double force[3], double s[3]) {
  double values[EQUATIONS], rows[EQUATIONS][6], by_drive[LEGS], M[6][7], gives[6];
  int row_of[LEGS], i, k, n = 0, passive = LEG_JOINTS;
  for (i = 0; i < LEGS; i++) row_of[i] = legs[i].drive == ROD ? passive++ : n++;
  closure_rows(X, q, values, rows, by_drive);
  for (i = 0; i < 6; i++) {
    for (k = 0; k < 6; k++) M[i][k] = rows[k][i];
    M[i][6] = i < 3 ? force[i] : 0;
    gives[i] = 0;
  }
  if (solve(6, 1, &M[0][0], 7) == 0) return -1;
  for (i = 0; i < ELEMENTS; i++) {
    int row, leg = kNumber[i];
    const double c = 1e-3 * *hal->compliance[i]; /* mm/N, rad/Nmm */
    double per;
    if (kElement[i] == BY_JOINT) {
      for (leg = 0; legs[leg].drive == ROD || legs[leg].joint != kNumber[i]; leg++) {
      }
      per = -by_drive[row_of[leg]];
    } else {
      const Leg *l = &legs[leg];
      per = (l->drive == STRUT ? q[l->joint] + l->length : l->length) / l->reference;
    }
    row = row_of[leg];
    gives[row] += c * per * per * M[row][6];
  }
  for (i = 0; i < 6; i++) {
    for (k = 0; k < 6; k++) M[i][k] = rows[i][k];
    M[i][6] = gives[i];
  }
  if (solve(6, 1, &M[0][0], 7) == 0) return -1;
  for (k = 0; k < 3; k++) s[k] = M[k][6];
  return 0;
}
#endif
