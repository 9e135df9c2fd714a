// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Four floats or two doubles that the processor handles at once. What they compute does not depend on the processor.
#pragma once

#include <cmath>
#include <cstdint>
#include <cstring>

#if defined(__SSE2__)
#include <emmintrin.h>
#endif

namespace polypod::cutting {

typedef float Quad __attribute__((vector_size(16)));
typedef double Pair __attribute__((vector_size(16)));
/// Which of the floats of a Quad are meant: all bits or none.
typedef std::int32_t Mask __attribute__((vector_size(16)));
static_assert(sizeof(Pair) == 2 * sizeof(double));

inline Quad load(const float* p) {
  Quad q;
  std::memcpy(&q, p, sizeof q);
  return q;
}
inline void store(float* p, Quad q) {
  std::memcpy(p, &q, sizeof q);
}
inline Pair load(const double* p) {
  Pair q;
  std::memcpy(&q, p, sizeof q);
  return q;
}
inline void store(double* p, Pair q) {
  std::memcpy(p, &q, sizeof q);
}
inline Quad all(float x) {
  return Quad{x, x, x, x};
}
inline Pair two(double x) {
  return Pair{x, x};
}

// g++ 12 makes four instructions of `a < b ? a : b`; the processor has one, which means the same.
#if defined(__SSE2__)
inline Quad smaller(Quad a, Quad b) {
  return _mm_min_ps(a, b);
}
inline Quad larger(Quad a, Quad b) {
  return _mm_max_ps(a, b);
}
inline Pair clamped(Pair q, Pair lo, Pair hi) {
  return _mm_min_pd(hi, _mm_max_pd(lo, q));  // lo > q ? lo : q, then hi < that ? hi : that
}
inline Pair root(Pair q) {
  return _mm_sqrt_pd(q);
}
inline bool any(Mask mask) {
  return _mm_movemask_ps(reinterpret_cast<__m128>(mask)) != 0;
}
/// Rounded towards zero, as integers of 32 bits; returns them as numbers again.
inline Pair truncated(std::int32_t* p, Pair q) {
  const __m128i i = _mm_cvttpd_epi32(q);
  _mm_storel_epi64(reinterpret_cast<__m128i*>(p), i);
  return _mm_cvtepi32_pd(i);
}
#else
inline Quad smaller(Quad a, Quad b) {
  return a < b ? a : b;
}
inline Quad larger(Quad a, Quad b) {
  return a > b ? a : b;
}
inline Pair clamped(Pair q, Pair lo, Pair hi) {
  q = q < lo ? lo : q;
  return q > hi ? hi : q;
}
inline Pair root(Pair q) {
  return Pair{std::sqrt(q[0]), std::sqrt(q[1])};
}
inline bool any(Mask mask) {
  std::uint64_t halves[2];
  std::memcpy(halves, &mask, sizeof halves);
  return (halves[0] | halves[1]) != 0;
}
inline Pair truncated(std::int32_t* p, Pair q) {
  for (int i = 0; i < 2; ++i) p[i] = static_cast<std::int32_t>(q[i]);
  return Pair{static_cast<double>(p[0]), static_cast<double>(p[1])};
}
#endif

inline float sum(Quad q) {
  return (q[0] + q[1]) + (q[2] + q[3]);
}
inline Quad where(Mask mask, Quad q) {
  Mask bits;
  std::memcpy(&bits, &q, sizeof bits);
  bits &= mask;
  std::memcpy(&q, &bits, sizeof q);
  return q;
}
inline Quad narrow(Pair a, Pair b) {
  typedef double Four __attribute__((vector_size(32)));
  return __builtin_convertvector((Four{a[0], a[1], b[0], b[1]}), Quad);
}

}  // namespace polypod::cutting
