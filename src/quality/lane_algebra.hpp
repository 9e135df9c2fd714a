// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Linear algebra on four small matrices at once, one in each lane, for the inner loops of surveys. For files that are
// compiled without errno and without contraction of a * b + c, so that roots become one instruction and every processor
// gives the same numbers.
#pragma once

#include "lanes.hpp"

#define POLYPOD_INLINE [[gnu::always_inline]] inline

namespace polypod::quality {
namespace {

POLYPOD_INLINE Lanes all_of(double x) {
  return Lanes{x, x, x, x};
}
POLYPOD_INLINE Lanes root(const Lanes& x) {
  return Lanes{__builtin_sqrt(x[0]), __builtin_sqrt(x[1]), __builtin_sqrt(x[2]), __builtin_sqrt(x[3])};
}
POLYPOD_INLINE Lanes magnitude(const Lanes& x) {
  return x < 0 ? -x : x;
}
POLYPOD_INLINE Lanes larger(const Lanes& a, const Lanes& b) {
  return a > b ? a : b;
}
POLYPOD_INLINE bool any(const Mask& m) {
  return (m[0] | m[1] | m[2] | m[3]) != 0;
}

/// Solves K X = B for N x `Columns` right-hand sides in place: elimination with the largest pivot of each column, lane
/// by lane.
template <int N, int Columns>
POLYPOD_INLINE void solve(Lanes (&K)[N][N], Lanes (&B)[N][Columns]) {
  for (int c = 0; c < N; ++c) {
    for (int r = c + 1; r < N; ++r) {
      const Mask swap = magnitude(K[r][c]) > magnitude(K[c][c]);
      for (int j = c; j < N; ++j) {
        const Lanes upper = K[c][j];
        K[c][j] = swap ? K[r][j] : upper;
        K[r][j] = swap ? upper : K[r][j];
      }
      for (int j = 0; j < Columns; ++j) {
        const Lanes upper = B[c][j];
        B[c][j] = swap ? B[r][j] : upper;
        B[r][j] = swap ? upper : B[r][j];
      }
    }
    const Lanes inverse = 1 / K[c][c];
    for (int r = c + 1; r < N; ++r) {
      const Lanes factor = K[r][c] * inverse;
      for (int j = c + 1; j < N; ++j) K[r][j] -= factor * K[c][j];
      for (int j = 0; j < Columns; ++j) B[r][j] -= factor * B[c][j];
    }
    K[c][c] = inverse;
  }
  for (int c = N - 1; c >= 0; --c) {
    for (int j = 0; j < Columns; ++j) {
      Lanes x = B[c][j];
      for (int k = c + 1; k < N; ++k) x -= K[c][k] * B[k][j];
      B[c][j] = x * K[c][c];
    }
  }
}

/// The extreme eigenvalue of a symmetric tridiagonal matrix (a the diagonal, b2 the squares beside it, at least 0) from
/// `start` beyond it: Laguerre's steps on the characteristic polynomial, which never overshoot there. `side` = 1 goes
/// up to the least, -1 down to the largest.
template <int N>
POLYPOD_INLINE Lanes extreme(const Lanes (&a)[N], const Lanes (&b2)[N - 1], const Lanes& start, double side,
                             const Lanes& scale) {
  Lanes x = start;
  const Lanes tiny = 1e-15 * scale;
  for (int k = 0; k < 60; ++k) {
    // d_i = a_i - x - b_{i-1}^2 / d_{i-1}, whose product is the polynomial, with two derivatives.
    Lanes d = a[0] - x, d1 = all_of(-1), d2 = all_of(0);
    Lanes ratio = d1 / d;
    Lanes G = ratio, H = ratio * ratio;
    for (int i = 1; i < N; ++i) {
      const Lanes inverse = 1 / d, q = b2[i - 1] * inverse * inverse;
      const Lanes next1 = -1 + q * d1, next2 = q * (d2 - 2 * d1 * d1 * inverse);
      d = a[i] - x - b2[i - 1] * inverse;
      d1 = next1;
      d2 = next2;
      ratio = d1 / d;
      G += ratio;
      H += ratio * ratio - d2 / d;
    }
    const Lanes inside = (N - 1) * (N * H - G * G);
    const Lanes step = N / (magnitude(G) + root(larger(inside, all_of(0))));
    // Past the end, or at a pole: the eigenvalue is reached (comparisons with what is no number are false).
    const Mask go = (step > tiny) & (-side * G > 0);
    if (!any(go)) break;
    x = go ? x + side * step : x;
  }
  return x;
}

/// sigma_max / sigma_min, sigma_min and |det| of S from S S^T: squares lose what lies below 1e-8 sigma_max.
template <int N>
POLYPOD_INLINE void dexterity(Lanes (&S)[N][N], Lanes (&out)[3]) {
  Lanes A[N][N];
  for (int i = 0; i < N; ++i)
    for (int j = 0; j <= i; ++j) {
      Lanes sum = S[i][0] * S[j][0];
      for (int k = 1; k < N; ++k) sum += S[i][k] * S[j][k];
      A[i][j] = A[j][i] = sum;
    }
  // Householder's reflections to a tridiagonal matrix.
  Lanes b2[N - 1];
  for (int c = 0; c < N - 2; ++c) {
    Lanes tail = all_of(0);
    for (int i = c + 2; i < N; ++i) tail += A[i][c] * A[i][c];
    const Lanes head = A[c + 1][c];
    const Lanes norm2 = tail + head * head, norm = root(norm2);
    b2[c] = norm2;
    Lanes v[N];
    v[c + 1] = head + (head < 0 ? -norm : norm);
    for (int i = c + 2; i < N; ++i) v[i] = A[i][c];
    const Lanes v2 = tail + v[c + 1] * v[c + 1];
    const Lanes beta = v2 > 0 ? 2 / v2 : all_of(0);
    Lanes p[N], vp = all_of(0);
    for (int i = c + 1; i < N; ++i) {
      Lanes sum = A[i][c + 1] * v[c + 1];
      for (int j = c + 2; j < N; ++j) sum += A[i][j] * v[j];
      p[i] = beta * sum;
      vp += p[i] * v[i];
    }
    const Lanes half = 0.5 * beta * vp;
    for (int i = c + 1; i < N; ++i) p[i] -= half * v[i];
    for (int i = c + 1; i < N; ++i)
      for (int j = c + 1; j <= i; ++j) {
        A[i][j] -= v[i] * p[j] + p[i] * v[j];
        A[j][i] = A[i][j];
      }
  }
  b2[N - 2] = A[N - 1][N - 2] * A[N - 1][N - 2];
  Lanes a[N], trace = all_of(0);
  for (int i = 0; i < N; ++i) {
    a[i] = A[i][i];
    trace += a[i];
  }
  const Lanes largest = extreme(a, b2, trace, -1, trace), least = extreme(a, b2, all_of(0), 1, trace);
  out[1] = root(larger(least, all_of(0)));
  out[0] = root(largest) / out[1];
  // |det| by elimination on S itself.
  Lanes none[N][1];
  for (int i = 0; i < N; ++i) none[i][0] = all_of(0);
  solve(S, none);  // leaves the inverse pivots on the diagonal
  Lanes product = S[0][0];
  for (int i = 1; i < N; ++i) product *= S[i][i];
  out[2] = 1 / magnitude(product);
}

}  // namespace

}  // namespace polypod::quality
