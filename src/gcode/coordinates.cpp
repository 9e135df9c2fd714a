// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Coordinate systems: origins, rotation, shifts (G10 L2 and L20, G52, G92) and places of the machine (G28, G30).
#include <algorithm>
#include <cmath>

#include "engine.hpp"
#include "polypod/core/units.hpp"
#include "words.hpp"

namespace polypod::gcode {

void Engine::select(int index) {
  for (std::size_t k = 0; k < 6; ++k) {
    const double stored = parameter(5201 + 20 * index + static_cast<int>(k));
    origin_[k] = k < 3 ? lengths(stored) : stored;
  }
  rotation_ = parameter(5210 + 20 * index);
}

Axes Engine::stored_shift() const {
  Axes shift{};
  if (parameter(5210) == 0) return shift;
  for (std::size_t k = 0; k < 6; ++k) {
    const double stored = parameter(5211 + static_cast<int>(k));
    const double own = k < 3 ? inches(g92_[k]) : g92_[k];
    shift[k] = stored == own ? g92_[k] : k < 3 ? lengths(stored) : stored;
  }
  return shift;
}

void Engine::print_system(int index, bool with_g92) {
  put("SET_G5X_OFFSET({}, {})", index, list(origin_));
  if (with_g92) put("SET_G92_OFFSET({})", list(g92_));
  put("SET_XY_ROTATION({:.4f})", rotation_);
}

Axes Engine::to_machine(const Axes& p) const {
  Axes m = p;
  for (std::size_t k = 0; k < 6; ++k) m[k] += g92_[k];
  if (rotation_ != 0) {
    const double c = std::cos(units::from_deg(rotation_));
    const double s = std::sin(units::from_deg(rotation_));
    const double x = m[0];
    m[0] = c * x - s * m[1];
    m[1] = s * x + c * m[1];
  }
  for (std::size_t k = 0; k < 6; ++k) m[k] += origin_[k];
  return m;
}

Axes Engine::from_machine(const Axes& machine) const {
  Axes p = machine;
  for (std::size_t k = 0; k < 6; ++k) p[k] -= origin_[k];
  if (rotation_ != 0) {
    const double c = std::cos(units::from_deg(rotation_));
    const double s = std::sin(units::from_deg(rotation_));
    const double x = p[0];
    p[0] = c * x + s * p[1];
    p[1] = -s * x + c * p[1];
  }
  for (std::size_t k = 0; k < 6; ++k) p[k] -= g92_[k];
  return p;
}

void Engine::keep_place(const std::function<void()>& change) {
  const double before = rotation_;
  const Axes origin = origin_;
  const Axes g92 = g92_;
  const Axes here = to_machine(current_);
  const Axes last = to_machine(canon_);
  change();
  if (before == 0 && rotation_ == 0) {  // sums alone: nothing is rounded that need not be
    for (std::size_t k = 0; k < 6; ++k) {
      const double shift = (origin[k] - origin_[k]) + (g92[k] - g92_[k]);
      current_[k] += shift;
      canon_[k] += shift;
    }
    return;
  }
  if (before == rotation_ && origin == origin_) {
    for (std::size_t k = 0; k < 6; ++k) {
      current_[k] += g92[k] - g92_[k];
      canon_[k] += g92[k] - g92_[k];
    }
    return;
  }
  current_ = from_machine(here);
  if (options_.machine_known) {
    // rs274 alone does not turn the position that it asks for after a tool change.
    for (std::size_t k = 0; k < 6; ++k) canon_[k] += (origin[k] - origin_[k]) + (g92[k] - g92_[k]);
  } else {
    canon_ = from_machine(last);
  }
  if (before != rotation_) known_[0] = known_[1] = known_[0] && known_[1];
}

/// The machine moves an axis to a place that is not known. Where coordinates are turned, X and Y both follow.
void Engine::forget(std::size_t axis) {
  if (axis > 2) return;
  known_[axis] = false;
  if (axis < 2 && rotation_ != 0) known_[0] = known_[1] = false;
}

/// G10, G28, G30, G52, G92: what takes axis words without being a motion.
Status Engine::origin() {
  const int g = one_of('G', 100, 280, 281, 300, 301, 520, 920);
  if (g < 0) return {};
  const int column = g_word(g)->column;
  rewritten_ = true;
  switch (g) {
    case 100: {
      const Word* word = find('L');
      const int l = word != nullptr ? whole(*word).value_or(-1) : -1;
      if (l == 2 || l == 20) return set_system(l == 20);
      if (l == 1 || l == 10 || l == 11) return set_tool(l);
      return error(column, "GC168", "G10 without L1, L2, L10, L11 or L20", "add L");
    }
    case 280:
    case 300:
      return go_home(g);
    case 281:
    case 301: {
      if (!options_.machine_known) return {};  // what it stores is not known, and never used
      const Axes m = to_machine(current_);
      for (std::size_t k = 0; k < 6; ++k) {
        const double place = m[k] + length_offset_[k];
        parameter((g == 281 ? 5161 : 5181) + static_cast<int>(k)) = k < 3 ? inches(place) : place;
      }
      return {};
    }
    default: {  // G52, G92
      if (!axis_words())
        return error(column, "GC168", fmt::format("G{} without axes", g / 10), "name at least one axis");
      Axes next = g92_;
      for (std::size_t k = 0; k < 6; ++k) {
        const Word* word = find(kAxisLetters[k]);
        if (word == nullptr) continue;
        if (g == 920 && !known_[k]) {
          return error(word->column, "GC169", fmt::format("G92 where the position of {} is not known", kAxisLetters[k]),
                       "give X, Y and Z before, in absolute coordinates");
        }
        next[k] = g == 520 ? word->value : current_[k] + g92_[k] - word->value;
      }
      keep_place([&] { g92_ = next; });
      for (std::size_t k = 0; k < 6; ++k) {  // as it was said, without the error of a sum
        if (const Word* word = find(kAxisLetters[k]); word != nullptr && g == 920) current_[k] = word->value;
      }
      store_shift();
      g92_told_ = true;
      parameter(5210) = 1;
      note_own_offset();
      put("SET_G92_OFFSET({})", list(g92_));
      return {};
    }
  }
}

void Engine::store_shift() {
  for (std::size_t k = 0; k < 6; ++k) parameter(5211 + static_cast<int>(k)) = k < 3 ? inches(g92_[k]) : g92_[k];
}

/// G92.1 to G92.3: a modal group of their own, after G4, G10, G28, G52 and the like, before the motion.
Status Engine::shift() {
  const int g = one_of('G', 921, 922, 923);
  if (g < 0) return {};
  const int column = g_word(g)->column;
  rewritten_ = true;
  switch (g) {
    case 921:
      keep_place([&] { g92_ = {}; });
      store_shift();
      g92_told_ = true;
      parameter(5210) = 0;
      plain("G92.1");  // what a run before has left at the controller ends here, too
      break;
    case 922:
      keep_place([&] { g92_ = {}; });
      parameter(5210) = 0;
      plain("G92.2");
      break;
    default: {
      if (!options_.machine_known && parameter(5210) == 0 && !g92_told_) {
        bool any = false;
        for (int k = 0; k < 6; ++k) any = any || parameter(5211 + k) != 0;
        if (!any) {
          return error(column, "GC125", "G92.3 takes up an offset that the job does not hold", "use G92 with axes");
        }
      }
      Axes next;
      for (std::size_t k = 0; k < 6; ++k) {
        const double stored = parameter(5211 + static_cast<int>(k));
        next[k] = k < 3 ? lengths(stored) : stored;
      }
      keep_place([&] { g92_ = next; });
      parameter(5210) = 1;
      note_own_offset();
    }
  }
  put("SET_G92_OFFSET({})", list(g92_));
  return {};
}

void Engine::note_own_offset() {
  if (own_offsets_noted_ || options_.machine_known) return;
  own_offsets_noted_ = true;
  notes_.push_back(fmt::format(
      "the program sets offsets of its own (line {}: G10, G52 or G92): the plain blocks do not, and count in "
      "those of the job. On the controller they must be as in the job when it starts: take back what a run "
      "of the original has left there",
      written_block_ != nullptr ? written_block_->line : 0));
}

/// G10 L2 and G10 L20.
Status Engine::set_system(bool from_here) {
  const int column = g_word(100)->column;
  const Word* p_word = find('P');
  int p = p_word != nullptr ? whole(*p_word).value_or(-1) : -1;
  if (p < 0 || p > 9) {
    return error(column, "GC168", "G10 L2 or L20 without P from 0 to 9", "P1 is G54, P0 the system in force");
  }
  for (const char c : {'I', 'J', 'Q'}) {
    if (find(c) != nullptr)
      return error(find(c)->column, "GC119", fmt::format("{} has no use in this block", c), "remove it");
  }
  const Word* r = find('R');
  if (p == 0) p = active_;
  const bool is_active = p == active_;
  const bool has_origin = p <= 6 || set_[static_cast<std::size_t>(p - 1)];  // G54 to G59 have that of the job
  if (!options_.machine_known && !from_here && (axis_words() || (r != nullptr && !has_origin))) {
    return error(column, "GC125", "G10 L2 counts from the machine's zero, which the job does not tell",
                 "use G10 L20, or G54 to G59 with the offsets of the job; R alone turns them");
  }
  const int base = 5201 + 20 * p;
  if (r != nullptr && from_here) return error(r->column, "GC119", "R has no use with L20", "remove it");
  if (!axis_words() && r == nullptr && !options_.machine_known) return {};
  const double rotation = r != nullptr ? r->value : parameter(base + 9);
  if (from_here) {
    const double c = std::cos(units::from_deg(rotation));
    const double s = std::sin(units::from_deg(rotation));
    Axes local = to_machine(current_);
    const Axes here = local;
    for (std::size_t k = 0; k < 6; ++k) {
      const double stored = parameter(base + static_cast<int>(k));
      local[k] -= k < 3 ? lengths(stored) : stored;
    }
    const double x = local[0];
    local[0] = c * x + s * local[1];
    local[1] = -s * x + c * local[1];
    const Axes shift = stored_shift();
    bool plane = false;
    for (std::size_t k = 0; k < 6; ++k) {
      const Word* word = find(kAxisLetters[k]);
      if (word == nullptr) continue;
      const bool turned = k < 2 && (rotation_ != 0 || rotation != 0);
      if (turned ? !known_[0] || !known_[1] : !known_[k]) {
        return error(word->column, "GC169",
                     fmt::format("G10 L20 where the position of {} is not known", kAxisLetters[k]),
                     "give X, Y and Z before, in absolute coordinates");
      }
      // The shift as the parameters have it, which a program may set beside the one in force.
      local[k] = word->value + shift[k];
      plane = plane || k < 2;
    }
    for (std::size_t k = 0; k < 6; ++k) {
      if (k < 2 ? !plane || (rotation == 0 && find(kAxisLetters[k]) == nullptr) : find(kAxisLetters[k]) == nullptr)
        continue;
      const double turned = k == 0 ? c * local[0] - s * local[1] : k == 1 ? s * local[0] + c * local[1] : local[k];
      const double place = here[k] - turned;
      parameter(base + static_cast<int>(k)) = k < 3 ? inches(place) : place;
    }
  } else {
    for (std::size_t k = 0; k < 6; ++k) {
      const Word* word = find(kAxisLetters[k]);
      if (word != nullptr) parameter(base + static_cast<int>(k)) = k < 3 ? inches(word->value) : word->value;
    }
    if (r != nullptr) parameter(base + 9) = r->value;
  }
  set_[static_cast<std::size_t>(p - 1)] = true;
  for (std::size_t k = 0; k < 6 && from_here; ++k) {
    if (find(kAxisLetters[k]) != nullptr) own_axes_[static_cast<std::size_t>(p - 1)] |= 1U << k;
  }
  note_own_offset();
  const bool shifted = std::any_of(g92_.begin(), g92_.end(), [](double x) { return x != 0; });
  if (options_.plain && is_active && shifted && (rotation_ != 0 || rotation != 0)) {
    return error(column, "GC125",
                 "G10 on turned coordinates while G92 or G52 is in force: LinuxCNC 2.9 loses its place",
                 "write G92.1 before it");
  }
  if (!is_active) {
    put("COMMENT(\"interpreter: setting coordinate system origin\")");
    return {};
  }
  // Where coordinates are turned, LinuxCNC 2.9 leaves G92 out of the position that it takes the machine to stand at.
  if (rotation_ != 0 || rotation != 0) {
    const Axes g92 = g92_;
    g92_ = {};
    keep_place([&] { select(p); });
    g92_ = g92;
  } else {
    keep_place([&] { select(p); });
  }
  print_system(p, false);
  return {};
}

/// G28 and G30: over a point in between to a stored place of the machine.
Status Engine::go_home(int g) {
  const bool named = axis_words();
  const Axes between = named ? target() : current_;
  if (!options_.machine_known) {
    if (rotation_ != 0 && named && (find('X') == nullptr) != (find('Y') == nullptr)) {
      return error(g_word(g)->column, "GC125",
                   fmt::format("G{} with one of X and Y in turned coordinates, where it would move both", g / 10),
                   "name both, or neither");
    }
    // Where the machine's place is, nobody knows: the word is passed on, and the axes are not known after it.
    if (between != current_ || left_) {
      traverse(between);
      for (std::size_t k = 0; k < 3 && !incremental_; ++k) known_[k] = known_[k] || find(kAxisLetters[k]) != nullptr;
    }
    std::string text = incremental_ || !named ? fmt::format("G{}", g / 10) : fmt::format("G91 G{}", g / 10);
    for (std::size_t k = 0; k < 6; ++k) {
      if (named && find(kAxisLetters[k]) == nullptr) continue;
      if (named) text += fmt::format(" {}0", kAxisLetters[k]);
      forget(k);
    }
    plain(text);
    if (!incremental_ && named) plain("G90");
    return {};
  }
  traverse(between);
  Axes machine;
  for (std::size_t k = 0; k < 6; ++k) {
    const double stored = parameter((g == 280 ? 5161 : 5181) + static_cast<int>(k));
    machine[k] = k < 3 ? lengths(stored) - length_offset_[k] : stored;  // LinuxCNC takes no rotary offset off
  }
  const Axes home = from_machine(machine);
  Axes end = current_;
  for (std::size_t k = 0; k < 6; ++k) {
    if (!named || find(kAxisLetters[k]) != nullptr) end[k] = home[k];
  }
  traverse(end);
  return {};
}

}  // namespace polypod::gcode
