// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "m_codes.hpp"

#include <fmt/format.h>

#include <charconv>

namespace polypod::gcode {

std::string_view arguments_of_m(int m) {
  if ((m >= 50 && m <= 53) || (m >= 62 && m <= 65)) return "P";
  if (m == 61) return "Q";
  if (m == 66) return "PQLE";
  if (m == 67 || m == 68) return "EQ";
  if (m == 19) return "RQP";
  return m >= 100 ? "PQ" : "";
}

int m_group_of(int m) {
  switch (m) {
    case 0:
    case 1:
    case 2:
    case 30:
    case 60:
      return 4;
    case 62:
    case 63:
    case 64:
    case 65:
    case 66:
    case 67:
    case 68:
      return 5;
    case 6:
    case 61:
      return 6;
    case 3:
    case 4:
    case 5:
    case 19:
      return 7;
    case 7:
    case 8:
    case 9:
      return 8;
    case 48:
    case 49:
    case 50:
    case 51:
    case 52:
    case 53:
      return 9;
    default:
      return 0;
  }
}

bool is_own_m(int m) {
  return m_group_of(m) != 0 || (m >= 70 && m <= 73) || m == 98 || m == 99;
}

std::optional<int> m_code_named(std::string_view name) {
  int m = 0;
  if (name.size() < 2 || name.size() > 4 || name[0] != 'M') return std::nullopt;
  const auto [end, error] = std::from_chars(name.data() + 1, name.data() + name.size(), m);
  if (error != std::errc() || end != name.data() + name.size() || m < 0 || is_own_m(m) || m == 97) return std::nullopt;
  return m;
}

std::optional<MRefusal> refusal_of_m(int m, const std::map<int, MCode>& meanings) {
  if (is_own_m(m) || meanings.contains(m)) return std::nullopt;
  const std::string in_job = fmt::format("say in the job what it does here: [controller.m_codes] M{}", m);
  if (m >= 428 && m <= 430) {
    return MRefusal{
        "GC120", fmt::format("M{} switches the controller's kinematics", m),
        "post the program for the kinematics that the machine starts with, or " + in_job + " = \"tip\" or \"joints\""};
  }
  if (m >= 100 && m <= 199) return std::nullopt;
  return MRefusal{"GC178", fmt::format("LinuxCNC has no M{}", m),
                  "remove it; where the controller's INI file remaps it, " + in_job + " = \"nothing\""};
}

}  // namespace polypod::gcode
