// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// The one place where units are converted. Inside: SI (m, rad, N, s). At every user surface: mm, deg, um, N, with the
// unit in the name of the key.
#pragma once

#include <numbers>
#include <string_view>

namespace polypod::units {

inline constexpr double kMetrePerMm = 1e-3;
// For whole vectors and matrices, and for areas: p * kMmPerMetre.
inline constexpr double kMmPerMetre = 1e3;
inline constexpr double kUmPerMetre = 1e6;
inline constexpr double kMm2PerSquareMetre = 1e6;
inline constexpr double kMetrePerInch = 25.4e-3;
inline constexpr double kMradPerRad = 1e3;
inline constexpr double kStandardGravity = 9.80665;  // m/s^2, ISO 80000-3
inline constexpr double kRadPerDeg = std::numbers::pi / 180.0;

constexpr double from_mm(double mm) {
  return mm * kMetrePerMm;
}
constexpr double to_mm(double m) {
  return m * kMmPerMetre;
}
constexpr double from_um(double um) {
  return um * 1e-6;
}
constexpr double to_um(double m) {
  return m * kUmPerMetre;
}
constexpr double from_inch(double inch) {
  return inch * kMetrePerInch;
}
constexpr double to_inch(double m) {
  return m / kMetrePerInch;
}
constexpr double from_deg(double deg) {
  return deg * kRadPerDeg;
}
constexpr double to_deg(double rad) {
  return rad / kRadPerDeg;
}
/// Tenths of a microrad, as compliances of joints are given: 1e-7 rad/Nm.
constexpr double to_tenth_urad(double rad) {
  return rad * 1e7;
}
constexpr double to_mrad(double rad) {
  return rad * kMradPerRad;
}
/// SI to what a person sees and back, by the unit of a parameter: "mm", "deg"; any other number stays as it is.
constexpr double to_user(double si, std::string_view unit) {
  return unit == "mm" ? to_mm(si) : unit == "deg" ? to_deg(si) : si;
}
constexpr double from_user(double value, std::string_view unit) {
  return unit == "mm" ? from_mm(value) : unit == "deg" ? from_deg(value) : value;
}
constexpr double from_mm_per_min(double v) {
  return v * (kMetrePerMm / 60.0);
}
constexpr double to_mm_per_min(double v) {
  return v * 60e3;
}
constexpr double from_per_min(double n) {
  return n / 60.0;
}  ///< rev/min to rev/s
constexpr double to_per_min(double n) {
  return n * 60.0;
}  ///< rev/s to rev/min
constexpr double from_N_per_mm2(double k) {
  return k * 1e6;
}  ///< N/mm^2 to N/m^2
constexpr double to_N_per_mm2(double k) {
  return k * 1e-6;
}
constexpr double from_N_per_mm(double k) {
  return k * 1e3;
}  ///< N/mm to N/m
constexpr double to_N_per_mm(double k) {
  return k * 1e-3;
}
constexpr double to_um_per_N(double c) {
  return c * 1e6;
}  ///< m/N to um/N
constexpr double to_mm3(double v) {
  return v * 1e9;
}
constexpr double from_mm3(double v) {
  return v / 1e9;
}
constexpr double from_ms(double t) {
  return t * 1e-3;
}

}  // namespace polypod::units
