// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Tools: the table, what is in the spindle, lengths (G43, G49) and entries (G10 L1, L10, L11).
#include <algorithm>
#include <cmath>

#include "engine.hpp"
#include "polypod/core/units.hpp"
#include "words.hpp"

namespace polypod::gcode {

/// The place of a tool in the table, from 1; 0 for tool 0.
Result<std::size_t> Engine::index_of(const Word& word) const {
  if (word.value == 0) return std::size_t{0};
  for (std::size_t i = 0; i < options_.tools.size(); ++i) {
    if (options_.tools[i].number == static_cast<int>(word.value)) return i + 1;
  }
  return error(word.column, "GC151", fmt::format("tool {} is not in the tool table", word.value),
               "add it to the table; --tool-table names the file");
}

Status Engine::tools() {
  const auto place = [&](const Word& word) -> Result<std::size_t> {
    if (options_.any_tool) {
      bool found = false;
      for (const Tool& tool : options_.tools) found = found || tool.number == static_cast<int>(word.value);
      if (!found) {
        Tool tool;
        tool.number = static_cast<int>(word.value);
        if (word.value != 0) options_.tools.push_back(tool);
      }
    }
    return index_of(word);
  };
  if (const Word* t = find('T'); t != nullptr) {
    POLYPOD_ASSIGN(index, place(*t));
    selected_ = index;
    if (index > 0) told_selected_ = options_.tools[index - 1].pocket;
    selected_number_ = static_cast<int>(t->value);
    put_now(fmt::format("SELECT_TOOL({})", selected_number_));
  }
  const int p = integer('P');
  const int e = integer('E');
  switch (one_of('M', 620, 630, 640, 650, 670, 680)) {
    case 620:
      put("SET_MOTION_OUTPUT_BIT({})", p);
      break;
    case 630:
      put("CLEAR_MOTION_OUTPUT_BIT({})", p);
      break;
    case 640:
      put("SET_AUX_OUTPUT_BIT({})", p);
      break;
    case 650:
      put("CLEAR_AUX_OUTPUT_BIT({})", p);
      break;
    case 670:
      put("SET_MOTION_OUTPUT_VALUE({},{:.6f})", e, value('Q', -1));
      break;
    case 680:
      put("SET_AUX_OUTPUT_VALUE({},{:.6f})", e, value('Q', -1));
      break;
    default:
      break;
  }
  switch (one_of('M', 60, 610)) {
    case 60:
      put("START_CHANGE()");
      put("STOP_SPINDLE_TURNING(0)");
      put("CHANGE_TOOL({})", selected_);
      turning_ = 0;
      if (selected_ > 0) loaded_ = options_.tools[selected_ - 1];  // rs274 keeps the lengths of the tool before T0
      loaded_pocket_ = selected_;
      told_pocket_ = told_selected_;
      resync_ = true;
      if (selected_number_ >= 0) spindle_tool_ = selected_number_;
      stale_tool_ = selected_ == 0;
      break;
    case 610: {
      const Word* q = find('Q');
      if (q == nullptr || q->value < 0 || q->value != std::floor(q->value)) {
        return error(1, "GC132", "M61 needs Q with a tool number", "write M61 Q...");
      }
      POLYPOD_ASSIGN(index, place(*q));
      put("CHANGE_TOOL_NUMBER({})", index);
      told_pocket_ = index > 0 ? options_.tools[index - 1].pocket : told_selected_;
      loaded_pocket_ = index;  // rs274 keeps the lengths and the diameter of the tool before
      resync_ = true;
      spindle_tool_ = static_cast<int>(q->value);
      stale_tool_ = true;
      break;
    }
    default:
      break;
  }
  return {};
}

Status Engine::length_offset(int g) {
  ToolOffset next{};
  if (g == 430) {
    const Word* h = find('H');
    if (h == nullptr) {
      const bool now =
          loaded_pocket_ > 0 && one_of('M', 60, 610) >= 0;  // rs274 looks up a tool that this block changes in
      next = now ? options_.tools[loaded_pocket_ - 1].offset : loaded_.offset;
    } else if (!options_.any_tool) {
      POLYPOD_ASSIGN(index, index_of(*h));
      // rs274 takes H0 as the tool in the spindle, as it was before this block.
      next = index > 0 ? options_.tools[index - 1].offset : loaded_before_.offset;
    }
    if (!inches_) {
      scale(next, kMmPerInch);
      for (std::size_t k = 6; k < 9; ++k) next[k] *= kMmPerInch;
    }
  } else if (g == 431) {
    next = length_offset_;
    for (std::size_t k = 0; k < 6; ++k) next[k] = value(kAxisLetters[k], next[k]);
  }
  tool_offset_ = g != 490;
  if (options_.any_tool) {  // lengths are not known
    known_[2] = false;
    if (g == 431) known_[0] = known_[1] = false;
    return {};
  }
  ToolOffset shift = length_offset_;
  for (std::size_t k = 0; k < shift.size(); ++k) shift[k] -= next[k];
  if (rotation_ != 0) {  // offsets of tools lie along the axes of the machine
    const double c = std::cos(units::from_deg(rotation_)), s = std::sin(units::from_deg(rotation_)), x = shift[0];
    shift[0] = c * x + s * shift[1];
    shift[1] = -s * x + c * shift[1];
  }
  for (std::size_t k = 0; k < 6; ++k) current_[k] += shift[k];
  length_offset_ = next;
  tool_offset_ = std::any_of(next.begin(), next.end(), [](double length) { return length != 0; });
  put("USE_TOOL_LENGTH_OFFSET({:.4f} {:.4f} {:.4f}, {:.4f} {:.4f} {:.4f}, {:.4f} {:.4f} {:.4f})", next[0], next[1],
      next[2], next[3], next[4], next[5], next[6], next[7], next[8]);
  return {};
}

/// G10 L1, L10 and L11: the tool table.
Status Engine::set_tool(int l) {
  const int column = g_word(100)->column;
  const Word* p = find('P');
  if (p == nullptr)
    return error(column, "GC168", "G10 with a tool table entry without P", "P is the number of the tool");
  const auto number_of_tool = whole(*p);
  if (!number_of_tool)
    return error(p->column, "GC168", fmt::format("P{} is no number of a tool", p->value), "use an integer from 1");
  if (options_.any_tool) {  // lengths of tools do not count: the programmed point is the tip
    if (axis_words()) {
      return error(column, "GC125",
                   fmt::format("G10 L{} sets the length of a tool, and what is written would leave it out", l),
                   "set it in the tool table before; R alone, the radius, is carried out");
    }
    if (const Word* r = find('R'); r != nullptr && *number_of_tool >= 0 && *number_of_tool <= 99999) {
      options_.diameters[*number_of_tool] = units::from_inch(2 * inches(r->value));
    }
    return {};
  }
  Word tool_word = *p;
  tool_word.value = *number_of_tool;
  POLYPOD_ASSIGN(index, index_of(tool_word));
  if (index == 0) return error(p->column, "GC151", "tool 0 is not in the tool table", "name a tool");
  Tool& tool = options_.tools[index - 1];
  const ToolOffset before = tool.offset;
  const bool sets =
      axis_words() || find('R') != nullptr || find('I') != nullptr || find('J') != nullptr || find('Q') != nullptr;
  if (!sets)
    return error(column, "GC168", fmt::format("G10 L{} without what it sets", l), "give an axis, R, I, J or Q");
  // Where the tool's holder stands, in the directions of the machine: L10 from the origin in force, with the shift of
  // G92; L11 from that of G59.3, without.
  const double turn = units::from_deg(l == 1 ? 0 : l == 10 ? rotation_ : parameter(5390));
  const double c = std::cos(turn), s = std::sin(turn);
  Axes holder = l == 10 ? current_ : to_machine(current_);
  if (l == 10 && turn != 0) {
    const double x = holder[0];
    holder[0] = c * x - s * holder[1];
    holder[1] = s * x + c * holder[1];
  }
  for (std::size_t k = 0; k < 6; ++k) {
    const double stored = l == 11 ? parameter(5381 + static_cast<int>(k)) : 0;
    holder[k] += length_offset_[k] - (k < 3 ? lengths(stored) : stored);
  }
  for (std::size_t k = 0; k < 6; ++k) {
    const Word* word = find(kAxisLetters[k]);
    if (word == nullptr || (k < 2 && turn != 0)) continue;
    const double next = l == 1 ? word->value : holder[k] - word->value;
    tool.offset[k] = k < 3 ? inches(next) : next;
  }
  if (turn != 0 && (find('X') != nullptr || find('Y') != nullptr)) {
    // Lengths lie along the axes of the machine: of X and Y the one that is not given stays what it would be with this
    // tool as it was. With R the turn, h the holder and t the length, the tip is at q = R^-1 (h - t).
    const double x = holder[0] - lengths(before[0]), y = holder[1] - lengths(before[1]);
    const double qx = value('X', c * x + s * y), qy = value('Y', -s * x + c * y);
    tool.offset[0] = inches(holder[0] - (c * qx - s * qy));
    tool.offset[1] = inches(holder[1] - (s * qx + c * qy));
  }
  if (const Word* r = find('R'); r != nullptr) tool.diameter = 2 * inches(r->value);
  tool.front_angle = value('I', tool.front_angle);
  tool.back_angle = value('J', tool.back_angle);
  if (const Word* q = find('Q'); q != nullptr) {
    if (q->value < 0 || q->value > 9 || q->value != std::floor(q->value)) {
      return error(q->column, "GC168", "Q is no orientation from 0 to 9", "check Q");
    }
    tool.orientation = static_cast<int>(q->value);
  }
  const auto entry = [&](std::size_t place) {
    const ToolOffset& o = tool.offset;
    put_now(fmt::format(
        "SET_TOOL_TABLE_ENTRY({}, {}, {:.4f} {:.4f} {:.4f} {:.4f} {:.4f} {:.4f} {:.4f} {:.4f} {:.4f}, {:.4f}, {:.4f}, "
        "{})",
        place, tool.number, o[0], o[1], o[2], o[3], o[4], o[5], o[6], o[7], o[8], tool.front_angle, tool.back_angle,
        tool.orientation));
  };
  entry(index);
  if (index == loaded_pocket_) {
    loaded_ = tool;
    entry(0);
  }
  return {};
}

}  // namespace polypod::gcode
