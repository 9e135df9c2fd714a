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
void Engine::comment() {
  std::string_view text;
  bool found = false;
  for (const std::string_view candidate : comments(*block_)) {
    if (candidate.front() != '(' || candidate.size() < 2) continue;
    text = candidate.substr(1, candidate.size() - 2);
    found = !text.empty();
  }
  if (!found) return;
  text = from_first_word(text);
  const auto begins = [&](std::string_view word) { return begins_with(text, word); };
  if (begins("MSG,")) return put_now(fmt::format("MESSAGE(\"{}\")", text.substr(4)));
  if (begins("DEBUG,")) {
    if (parameter(5599) != 0) put_now(fmt::format("MESSAGE(\"{}\")", expanded(text.substr(6), *this)));
    return;
  }
  if (begins("PRINT,")) {
    out_ += expanded(text.substr(6), *this);
    out_ += '\n';
    return;
  }
  if (begins("LOG,")) return put_now(fmt::format("LOG(\"{}\")", expanded(text.substr(4), *this)));
  if (begins("LOGOPEN,")) return put_now(fmt::format("LOGOPEN(\"{}\")", text.substr(8)));
  if (begins("LOGAPPEND,")) return put_now(fmt::format("LOGAPPEND(\"{}\")", text.substr(10)));
  if (begins("LOGCLOSE") && text.size() == 8) return put_now("LOGCLOSE()");
  put("COMMENT(\"{}\")", text);
}

}  // namespace polypod::gcode
