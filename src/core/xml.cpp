// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/core/xml.hpp"

#include <fmt/format.h>

#include <algorithm>

#include "polypod/core/text.hpp"

namespace polypod::xml {
namespace {

constexpr std::string_view kSpace = " \t\r\n";
constexpr int kMostDepth = 64;
constexpr std::size_t kMostElements = 200'000, kMostAttributes = 100;

bool is_space(char c) {
  return kSpace.find(c) != std::string_view::npos;
}
bool begins_name(char c) {
  return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || c == '_' || c == ':' ||
         static_cast<unsigned char>(c) >= 128;
}
bool in_name(char c) {
  return begins_name(c) || (c >= '0' && c <= '9') || c == '-' || c == '.';
}

class Scanner {
 public:
  Scanner(std::string_view text, const std::string& file, const Bounds& bounds)
      : text_(text), file_(file), bounds_(bounds) {}

  Result<std::vector<Element>> run() {
    if (text_.size() > bounds_.bytes) {
      return fail("MA181", fmt::format("{} bytes, but at most {} are read", text_.size(), bounds_.bytes),
                  {file_, 0, 0});
    }
    if (const std::size_t nul = text_.find('\0'); nul != std::string_view::npos) {
      at_ = 0;
      step_to(nul);
      return wrong("a byte 0, which no XML text has");
    }
    if (text_.starts_with("\xEF\xBB\xBF")) at_ = line_begin_ = 3;
    while (at_ < text_.size()) {
      if (text_[at_] == '<') {
        POLYPOD_TRY(markup());
      } else if (open_.empty() && !is_space(text_[at_])) {
        return wrong(seen_root_ ? "text behind the last element" : "text before the first element");
      } else {
        step(1);
      }
    }
    if (!open_.empty()) {
      const Open& last = open_.back();
      return fail("MA180", fmt::format("<{}> has no end", shown(last.name)), {file_, last.line, last.column},
                  fmt::format("write </{}>", shown(last.name)));
    }
    if (!seen_root_) return wrong("no element");
    return std::move(out_);
  }

 private:
  struct Open {
    std::string_view name;
    int line, column;
    int kept;  ///< its index, -1 where it is not kept
  };

  void step(std::size_t count) {
    for (const std::size_t end = std::min(at_ + count, text_.size()); at_ < end; ++at_) {
      if (text_[at_] == '\n') {
        ++line_;
        line_begin_ = at_ + 1;
      }
    }
  }
  void step_to(std::size_t at) { step(at - at_); }
  [[nodiscard]] int column() const { return static_cast<int>(at_ - line_begin_) + 1; }
  [[nodiscard]] Place here() const { return {file_, line_, column()}; }
  [[nodiscard]] tl::unexpected<Error> wrong(std::string what) const { return fail("MA180", std::move(what), here()); }
  [[nodiscard]] std::string_view rest() const { return text_.substr(at_); }
  void skip_space() {
    while (at_ < text_.size() && is_space(text_[at_])) step(1);
  }

  /// Beyond the next `end`.
  Status skip_behind(std::string_view end, const char* what) {
    const std::size_t found = text_.find(end, at_);
    if (found == std::string_view::npos) return wrong(fmt::format("{} has no end {}", what, end));
    step_to(found + end.size());
    return {};
  }

  Status markup() {
    if (rest().starts_with("<!--")) {
      step(4);
      return skip_behind("-->", "a comment");
    }
    if (rest().starts_with("<![CDATA[")) {
      if (open_.empty()) return wrong("text outside of the first element");
      return skip_behind("]]>", "a CDATA section");
    }
    if (rest().starts_with("<?")) return skip_behind("?>", "a processing instruction");
    if (rest().starts_with("<!")) {
      return fail("MA181", "a document type (<!DOCTYPE ...>): its entities are not read", here(),
                  "leave it out; it is needed nowhere");
    }
    if (rest().starts_with("</")) return end_tag();
    return start_tag();
  }

  Result<std::string_view> name(const char* what) {
    const std::size_t begin = at_;
    if (at_ >= text_.size() || !begins_name(text_[at_])) return wrong(fmt::format("{} is missing", what));
    while (at_ < text_.size() && in_name(text_[at_])) ++at_;  // no line ends within a name
    return text_.substr(begin, at_ - begin);
  }

  Status end_tag() {
    const Place place = here();
    step(2);
    POLYPOD_ASSIGN(tag, name("the name of an end tag"));
    skip_space();
    if (!rest().starts_with(">")) return wrong(fmt::format("</{}> has no >", shown(tag)));
    step(1);
    if (open_.empty() || open_.back().name != tag) {
      const std::string wanted =
          open_.empty() ? "no element is open"
                        : fmt::format("<{}> of line {} is open", shown(open_.back().name), open_.back().line);
      return fail("MA180", fmt::format("</{}>, but {}", shown(tag), wanted), place);
    }
    open_.pop_back();
    return {};
  }

  Result<Attribute> attribute() {
    Attribute out;
    out.line = line_;
    out.column = column();
    POLYPOD_ASSIGN(key, name("the name of an attribute"));
    out.name = key;
    skip_space();
    if (!rest().starts_with("=")) return wrong(fmt::format("the attribute {} has no value", shown(key)));
    step(1);
    skip_space();
    const char quote = at_ < text_.size() ? text_[at_] : ' ';
    if (quote != '"' && quote != '\'') {
      return wrong(fmt::format("the value of {} does not stand in quotes", shown(key)));
    }
    const std::size_t end = text_.find(quote, at_ + 1);
    out.value = text_.substr(at_ + 1, end == std::string_view::npos ? 0 : end - at_ - 1);
    if (end == std::string_view::npos || out.value.find('<') != std::string_view::npos) {
      return wrong(fmt::format("the value of {} has no closing quotes", shown(key)));
    }
    step_to(end + 1);
    return out;
  }

  Status start_tag() {
    Element element;
    element.line = line_;
    element.column = column();
    element.depth = static_cast<int>(open_.size()) + 1;
    if (open_.empty() && seen_root_) return wrong("a second outermost element");
    if (element.depth > kMostDepth) {
      return fail("MA181", fmt::format("elements inside each other more than {} deep", kMostDepth), here());
    }
    step(1);
    POLYPOD_ASSIGN(tag, name("the name of an element"));
    element.name = tag;
    while (true) {
      const std::size_t before = at_;
      skip_space();
      if (rest().starts_with(">") || rest().starts_with("/>")) break;
      if (at_ == before || at_ >= text_.size()) return wrong(fmt::format("<{}> has no >", shown(tag)));
      POLYPOD_ASSIGN(one, attribute());
      if (element.attribute(one.name) != nullptr) {
        return fail("MA180", fmt::format("<{}> has the attribute {} twice", shown(tag), shown(one.name)),
                    {file_, one.line, one.column});
      }
      if (element.attributes.size() >= kMostAttributes) {
        return fail("MA181", fmt::format("<{}> has more than {} attributes", shown(tag), kMostAttributes), here());
      }
      element.attributes.push_back(one);
    }
    seen_root_ = true;
    const bool empty = rest().starts_with("/>");
    int kept = -1;
    if (element.depth <= bounds_.depth) {
      if (out_.size() >= kMostElements) {
        return fail("MA181", fmt::format("more than {} elements", kMostElements), here());
      }
      kept = static_cast<int>(out_.size());
      element.parent = open_.empty() ? -1 : open_.back().kept;
      out_.push_back(element);
    }
    step(empty ? 2 : 1);
    if (!empty && kept >= 0) out_.back().content = rest().substr(0, rest().find('<'));
    if (!empty) open_.push_back({tag, element.line, element.column, kept});
    return {};
  }

  std::string_view text_;
  const std::string& file_;
  const Bounds& bounds_;
  std::size_t at_ = 0, line_begin_ = 0;
  int line_ = 1;
  bool seen_root_ = false;
  std::vector<Open> open_;
  std::vector<Element> out_;
};

}  // namespace

const Attribute* Element::attribute(std::string_view wanted) const {
  for (const Attribute& a : attributes)
    if (a.name == wanted) return &a;
  return nullptr;
}

std::string shown(std::string_view text) {
  constexpr std::size_t kMost = 60;
  return one_line(text.substr(0, kMost));
}

Result<std::vector<Element>> scan(std::string_view text, const std::string& file, const Bounds& bounds) {
  return Scanner(text, file, bounds).run();
}

}  // namespace polypod::xml
