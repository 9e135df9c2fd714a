// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Comments, messages and the numbers of lines, as rs274 prints them.
#include "engine.hpp"
#include "words.hpp"

namespace polypod::gcode {

/// rs274 shows the digits that directly follow an N at the front of the line.
void Engine::read_number(std::string_view text) {
  std::size_t i = 0;
  while (i < text.size() && (is_space(text[i]) || text[i] == '/')) ++i;
  if (i >= text.size() || upper(text[i]) != 'N') {
    number_ = kNoNumber;
    return;
  }
  number_ = "N";
  for (++i; i < text.size() && text[i] >= '0' && text[i] <= '9'; ++i) number_ += text[i];
  if (number_.size() < kNoNumber.size()) number_.resize(kNoNumber.size(), ' ');
}

/// Of several comments in brackets the last one counts; `;` comments do not.
Status Engine::comment() {
  std::string_view text;
  bool found = false;
  for (const std::string_view candidate : comments(*block_)) {
    if (candidate.front() != '(' || candidate.size() < 2) continue;
    text = candidate.substr(1, candidate.size() - 2);
    found = !text.empty();
  }
  if (!found) return {};
  text = from_first_word(text);
  const auto begins = [&](std::string_view word) { return begins_with(text, word); };
  const auto message = [&](std::size_t from) {
    in_message_ = true;
    std::string out = expanded(text.substr(from), *this);
    in_message_ = false;
    return out;
  };
  if (begins("MSG,")) {
    put_now(fmt::format("MESSAGE(\"{}\")", text.substr(4)));
  } else if (begins("DEBUG,")) {
    if (parameter(5599) != 0) put_now(fmt::format("MESSAGE(\"{}\")", message(6)));
  } else if (begins("PRINT,")) {
    out_ += message(6);
    out_ += '\n';
  } else if (begins("LOG,")) {
    put_now(fmt::format("LOG(\"{}\")", message(4)));
  } else if (begins("LOGOPEN,")) {
    put_now(fmt::format("LOGOPEN(\"{}\")", text.substr(8)));
  } else if (begins("LOGAPPEND,")) {
    put_now(fmt::format("LOGAPPEND(\"{}\")", text.substr(10)));
  } else if (begins("LOGCLOSE") && text.size() == 8) {
    put_now("LOGCLOSE()");
  } else if (begins("ABORT,")) {
    return error(1, "GC177", fmt::format("the program aborts itself here: {}", from_first_word(message(6))),
                 "set what it asks for, or take the (ABORT, ...) out");
  } else {
    put("COMMENT(\"{}\")", text);
  }
  return {};
}

}  // namespace polypod::gcode
