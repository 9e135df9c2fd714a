// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "rtapi.h"
#include "rtapi_app.h"
#include "rtapi_math.h"
#include "rtapi_string.h"
#include "hal.h"
#include "kinematics.h"

MODULE_LICENSE("Dual BSD/GPL");
MODULE_DESCRIPTION("Kinematics of one machine, made by polypod export linuxcnc");

/* What the INI file counts lengths and angles in: loadrt hands it over, and anything but mm and degrees is refused. */
static char *linear_units = "mm";
static char *angular_units = "deg";
RTAPI_MP_STRING(linear_units, "[TRAJ]LINEAR_UNITS, must be mm");
RTAPI_MP_STRING(angular_units, "[TRAJ]ANGULAR_UNITS, must be deg");

#define RAD (M_PI / 180.0)
#define ARRAY_SIZE_OR_ONE(n) ((n) > 0 ? (n) : 1)

/* Inside: mm and rad. A pose is R, p of the tool tip in the machine's frame. */
typedef struct {
  double R[3][3], p[3];
} Pose;

static double dot(const double a[3], const double b[3]) {
  return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}
static void cross(const double a[3], const double b[3], double out[3]) {
  out[0] = a[1] * b[2] - a[2] * b[1];
  out[1] = a[2] * b[0] - a[0] * b[2];
  out[2] = a[0] * b[1] - a[1] * b[0];
}
static void rotate(const double R[3][3], const double v[3], double out[3]) {
  int i;
  for (i = 0; i < 3; i++) out[i] = R[i][0] * v[0] + R[i][1] * v[1] + R[i][2] * v[2];
}
static void product(const double A[3][3], const double B[3][3], double out[3][3]) {
  int i, k;
  for (i = 0; i < 3; i++)
    for (k = 0; k < 3; k++) out[i][k] = A[i][0] * B[0][k] + A[i][1] * B[1][k] + A[i][2] * B[2][k];
}

/* R_z(c) R_y(b) R_x(a) */
static void rotation_abc(double a, double b, double c, double R[3][3]) {
  const double ca = cos(a), sa = sin(a), cb = cos(b), sb = sin(b), cc = cos(c), sc = sin(c);
  R[0][0] = cc * cb;
  R[0][1] = cc * sb * sa - sc * ca;
  R[0][2] = cc * sb * ca + sc * sa;
  R[1][0] = sc * cb;
  R[1][1] = sc * sb * sa + cc * ca;
  R[1][2] = sc * sb * ca - cc * sa;
  R[2][0] = -sb;
  R[2][1] = cb * sa;
  R[2][2] = cb * ca;
}

/* Coordinates x, y, z, a, b, c of the machine and back. Where a pose names the tool's axis alone, that is R_y(b) R_x(a) z
 * and c is the turn about it: R = R_y(b) R_x(a) R_z(c). Else R = R_z(c) R_y(b) R_x(a). */
static void pose_of(int names_axis, const double c[6], Pose *X) {
  X->p[0] = c[0];
  X->p[1] = c[1];
  X->p[2] = c[2];
  if (names_axis) {
    double axis[3][3], spin[3][3];
    rotation_abc(c[3], c[4], 0, axis);
    rotation_abc(0, 0, c[5], spin);
    product(axis, spin, X->R);
  } else {
    rotation_abc(c[3], c[4], c[5], X->R);
  }
}
static void coordinates_of(int names_axis, const Pose *X, double c[6]) {
  const double(*R)[3] = X->R;
  int k;
  for (k = 0; k < 3; k++) c[k] = X->p[k];
  if (names_axis) {
    double axis[3][3];
    c[3] = atan2(-R[1][2], sqrt(R[0][2] * R[0][2] + R[2][2] * R[2][2]));
    c[4] = atan2(R[0][2], R[2][2]);
    rotation_abc(c[3], c[4], 0, axis);
    c[5] = atan2(axis[0][1] * R[0][0] + axis[1][1] * R[1][0] + axis[2][1] * R[2][0],
                 axis[0][0] * R[0][0] + axis[1][0] * R[1][0] + axis[2][0] * R[2][0]);
  } else {
    c[3] = atan2(R[2][1], R[2][2]);
    c[4] = atan2(-R[2][0], sqrt(R[2][1] * R[2][1] + R[2][2] * R[2][2]));
    c[5] = atan2(R[1][0], R[0][0]);
  }
}

/* Gauss with row pivots on the n x (n + more) matrix M, whose further columns become the solutions. Returns the sign of
 * the determinant, 0 where a pivot is below 1e-9 (all rows are of about unit size). */
static int solve(int n, int more, double *M, int stride) {
  int i, k, r, sign = 1;
  for (i = 0; i < n; i++) {
    int best = i;
    double inverse;
    for (r = i + 1; r < n; r++)
      if (fabs(M[r * stride + i]) > fabs(M[best * stride + i])) best = r;
    if (!(fabs(M[best * stride + i]) > 1e-9)) return 0;
    if (best != i) {
      for (k = i; k < n + more; k++) {
        const double t = M[i * stride + k];
        M[i * stride + k] = M[best * stride + k];
        M[best * stride + k] = t;
      }
      sign = -sign;
    }
    if (M[i * stride + i] < 0) sign = -sign;
    inverse = 1 / M[i * stride + i];
    for (r = i + 1; r < n; r++) {
      const double f = M[r * stride + i] * inverse;
      if (f == 0) continue;
      for (k = i + 1; k < n + more; k++) M[r * stride + k] -= f * M[i * stride + k];
    }
  }
  for (k = n; k < n + more; k++)
    for (i = n - 1; i >= 0; i--) {
      double t = M[i * stride + k];
      for (r = i + 1; r < n; r++) t -= M[i * stride + r] * M[r * stride + k];
      M[i * stride + k] = t / M[i * stride + i];
    }
  return sign;
}

static double larger(double a, double b) {
  return a > b ? a : b;
}
