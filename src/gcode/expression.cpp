// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "expression.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <numbers>
#include <optional>

#include "text.hpp"
#include "words.hpp"

namespace polypod::gcode {
namespace {

/// Numbers that differ by less are equal (EQ, NE; found by bisection with rs274).
constexpr double kEqual = 1e-4;
/// How far an index may be from an integer.
constexpr double kInteger = 1e-4;
/// How deep brackets and signs may nest.
constexpr int kDeepest = 250;

bool is_blank(char c) {
  return c == ' ' || c == '\t' || c == '\r';
}
bool is_digit(char c) {
  return c >= '0' && c <= '9';
}
char lower(char c) {
  return c >= 'A' && c <= 'Z' ? static_cast<char>(c - 'A' + 'a') : c;
}
bool is_letter(char c) {
  return lower(c) >= 'a' && lower(c) <= 'z';
}

// LinuxCNC computes angles in long double: COS[90] is -2.5e-20, whose sign shows where a coordinate is printed.
using Precise = long double;
Precise precise(double x) {
  return x;
}
Precise radians(double deg) {
  return deg * std::numbers::pi_v<Precise> / 180;
}
double degrees(Precise rad) {
  return static_cast<double>(rad * 180 / std::numbers::pi_v<Precise>);
}

struct Operator {
  std::string_view name;
  int level;  // the higher, the sooner
};
constexpr std::array<Operator, 15> kOperators{{{"**", 5},
                                               {"*", 4},
                                               {"/", 4},
                                               {"mod", 4},
                                               {"+", 3},
                                               {"-", 3},
                                               {"eq", 2},
                                               {"ne", 2},
                                               {"gt", 2},
                                               {"ge", 2},
                                               {"lt", 2},
                                               {"le", 2},
                                               {"and", 1},
                                               {"or", 1},
                                               {"xor", 1}}};
constexpr std::array<std::string_view, 14> kFunctions{"abs", "acos", "asin", "atan",  "cos", "exists", "exp",
                                                      "fix", "fup",  "ln",   "round", "sin", "sqrt",   "tan"};
constexpr std::array<std::string_view, 15> kKeywords{"sub",      "endsub",   "call",   "do",     "while",
                                                     "endwhile", "if",       "elseif", "else",   "endif",
                                                     "break",    "continue", "return", "repeat", "endrepeat"};

class LineReader {
 public:
  LineReader(std::string_view text, const Parameters& parameters, const Place& place)
      : text_(text), parameters_(parameters), place_(place) {}

  Result<Line> run() {
    if (at_end()) return std::move(line_);
    if (peek() == '%') {
      line_.percent = true;
      return std::move(line_);
    }
    if (peek() == '/') {
      line_.optional = true;
      ++at_;
    }
    if (!at_end() && lower(peek()) == 'n') POLYPOD_TRY(word());
    if (!at_end() && lower(peek()) == 'o') {
      POLYPOD_TRY(o_word());
      if (!line_.keyword.empty() || at_end()) return std::move(line_);
      POLYPOD_TRY(skip_comments());
      if (!at_end() && peek() != ';') return error("GC163", fmt::format("'{}' {}", peek(), kBehindO), kBehindOHint);
    }
    while (!at_end()) {
      const char c = peek();
      if (c == '(') {
        const std::size_t close = text_.find(')', at_);
        if (close == std::string_view::npos) {
          return error("GC103", "a comment that is not closed on its line", "add ')'");
        }
        if (const std::size_t nested = text_.find('(', at_ + 1); nested < close) {
          at_ = nested;
          return error("GC103", "'(' within a comment; comments do not nest", "use other brackets inside");
        }
        if (runs_python(text_.substr(at_ + 1))) {
          return error("GC122", "a comment that LinuxCNC runs as Python",
                       "take it out, or write what it does as G-code");
        }
        at_ = close + 1;
      } else if (c == ';') {
        break;
      } else if (c == '#') {
        POLYPOD_TRY(assignment());
      } else {
        POLYPOD_TRY(word());
      }
    }
    POLYPOD_TRY(spindle_taken());
    return std::move(line_);
  }

 private:
  [[nodiscard]] tl::unexpected<Error> error(std::string id, std::string message, std::string hint) const {
    Place place = place_;
    place.column = static_cast<int>(at_) + 1;
    return fail(std::move(id), std::move(message), place, std::move(hint));
  }
  void skip() {
    while (at_ < text_.size() && is_blank(text_[at_])) ++at_;
  }
  bool at_end() {
    skip();
    return at_ >= text_.size();
  }
  [[nodiscard]] char peek() const { return text_[at_]; }
  bool take(char c) {
    if (at_end() || peek() != c) return false;
    ++at_;
    return true;
  }
  /// Takes `name`, blanks inside allowed; leaves the place where it does not stand there.
  bool take_name(std::string_view name) {
    const std::size_t from = at_;
    for (const char c : name) {
      if (at_end() || lower(peek()) != c) {
        at_ = from;
        return false;
      }
      ++at_;
    }
    return true;
  }

  /// $ chooses the spindle of the block: the only one (0), or all (-1).
  Status spindle() {
    const std::size_t from = at_++;
    POLYPOD_ASSIGN(number, value());
    const bool again = spindle_.has_value();
    spindle_ = from;
    if (!again && (std::trunc(number) == 0 || std::trunc(number) == -1)) return {};
    at_ = from;
    return error("GC132",
                 again ? std::string("two $ words in a block") : fmt::format("there is no spindle {:g}", number),
                 again ? "leave one out" : "the machine has one spindle: $0, or no $");
  }
  /// Something in the block takes the spindle that $ chooses.
  Status spindle_taken() {
    if (!spindle_) return {};
    constexpr std::array kByM{3.0, 4.0, 5.0, 19.0, 51.0};
    constexpr std::array kByG{33.0, 33.1, 76.0, 95.0, 96.0, 97.0};
    const auto is_one_of = [](const auto& codes, double code) {
      constexpr double kSame = 1e-3;
      return std::any_of(codes.begin(), codes.end(), [&](double c) { return std::abs(c - code) < kSame; });
    };
    for (const Word& w : line_.words) {
      if (w.letter == 'S' || (w.letter == 'M' && is_one_of(kByM, w.value)) ||
          (w.letter == 'G' && is_one_of(kByG, w.value)))
        return {};
    }
    at_ = *spindle_;
    return error("GC132", "a $ word without S, M3, M4, M5, M19, M51, G33, G33.1, G76, G95, G96 or G97 that takes it",
                 "leave it out");
  }

  Status word() {
    const char c = peek();
    const std::size_t from = at_;
    if (c == '$') return spindle();
    if (c == '*') return error("GC107", kStar, kStarHint);
    if (lower(c) == 'o') return error("GC163", kOWithin, kOWithinHint);
    if (!is_letter(c) && c != '@' && c != '^') {
      return error("GC100", fmt::format("'{}' does not belong into a block", c), "remove it, or put it into a comment");
    }
    if (lower(c) == 'n' && !line_.words.empty()) {
      return error("GC106", "N within a block; a line number stands at the start of its line",
                   "move N to the start of the line, or remove it");
    }
    ++at_;
    if (lower(c) == 'n' && !at_end() && !is_digit(peek())) {
      at_ = from;
      return error("GC106", "N without the digits of a line number", "write N and an integer from 0");
    }
    if (at_end() || (is_letter(peek()) && !is_function())) {
      at_ = from;
      return error("GC101", fmt::format("{} without a number", static_cast<char>(c & ~0x20)),
                   missing_number_hint(text_, from));
    }
    POLYPOD_ASSIGN(number, value());
    const char letter = is_letter(c) ? static_cast<char>(lower(c) - 'a' + 'A') : c;
    line_.words.push_back({letter, number, static_cast<int>(from) + 1, static_cast<int>(at_ - from)});
    return {};
  }

  bool is_function() {
    const std::size_t from = at_;
    for (const std::string_view name : kFunctions) {
      if (take_name(name) && take('[')) {
        at_ = from;
        return true;
      }
      at_ = from;
    }
    return false;
  }

  Result<std::string> name_in_angles() {
    std::string name;
    while (!at_end() && peek() != '>') {
      if (peek() == '(' || name.size() > 250) break;
      name += lower(text_[at_++]);
    }
    if (!take('>')) return error("GC160", "a name that is not closed", "add '>'");
    return name;
  }

  Status skip_comments() {
    while (!at_end() && peek() == '(') {
      const std::size_t close = text_.find(')', at_);
      if (close == std::string_view::npos) {
        return error("GC103", "a comment that is not closed on its line", "add ')'");
      }
      at_ = close + 1;
    }
    return {};
  }

  Status o_word() {
    line_.label_column = static_cast<int>(at_) + 1;
    ++at_;
    if (take('<')) {
      POLYPOD_ASSIGN(name, name_in_angles());
      line_.label = std::move(name);
    } else {
      POLYPOD_ASSIGN(number, value());
      const double rounded = std::round(number);
      if (std::abs(number - rounded) > kInteger || !(std::abs(rounded) < 1e9)) {
        return error("GC163", fmt::format("O{} is no label; labels are integers", number), "use an integer");
      }
      line_.label = fmt::format("{:.0f}", rounded);
    }
    const std::size_t from = at_;
    std::string name;
    while (!at_end() && is_letter(peek())) name += lower(text_[at_++]);
    if (name.empty()) {
      at_ = from;
      return {};
    }
    for (const std::string_view keyword : kKeywords) {
      if (name == keyword) line_.keyword = keyword;
    }
    if (line_.keyword.empty()) {  // O100 G0 X1: words
      at_ = from;
      return {};
    }
    const bool call = line_.keyword == "call";
    const bool condition =
        line_.keyword == "if" || line_.keyword == "elseif" || line_.keyword == "while" || line_.keyword == "repeat";
    const bool returns = line_.keyword == "endsub" || line_.keyword == "return";
    const std::size_t most = call ? 30 : condition || returns ? 1 : 0;
    if (call) POLYPOD_TRY(skip_comments());
    while (!at_end() && peek() == '[') {
      if (line_.arguments.size() == most) {
        return call ? error("GC163", "more than 30 arguments", "remove some")
                    : error("GC163", fmt::format("{} behind '{}'", most == 0 ? "a value" : "a second value", name),
                            "remove it");
      }
      POLYPOD_ASSIGN(argument, value());
      line_.arguments.push_back(argument);
      if (call) POLYPOD_TRY(skip_comments());  // they may stand between its arguments alone
    }
    POLYPOD_TRY(skip_comments());
    if (!at_end() && peek() != ';') {
      return error("GC163", fmt::format("'{}' behind an O word", peek()), "move it to a line of its own");
    }
    if (condition && line_.arguments.size() != 1) {
      return error("GC163", fmt::format("'{}' without its value in brackets", line_.keyword), "write [...] behind it");
    }
    return {};
  }

  Status assignment() {
    Line::Assignment assignment;
    assignment.column = static_cast<int>(at_) + 1;
    ++at_;
    if (take('<')) {
      POLYPOD_ASSIGN(name, name_in_angles());
      named_here_.push_back(name);
      assignment.name = std::move(name);
    } else {
      POLYPOD_ASSIGN(index, parameter_index());
      assignment.index = index;
    }
    if (!take('=')) return error("GC160", "a parameter at the place of a word", "write its letter before it, or '='");
    POLYPOD_ASSIGN(number, value());
    assignment.value = number;
    line_.assignments.push_back(std::move(assignment));
    return {};
  }

  /// LinuxCNC makes a name where a line is about to give it a value: with 0 until the line has been read.
  [[nodiscard]] bool is_named_here(const std::string& name) const {
    return std::find(named_here_.begin(), named_here_.end(), name) != named_here_.end();
  }

  Result<int> parameter_index() {
    POLYPOD_ASSIGN(number, value());
    const double rounded = std::round(number);
    if (!(std::abs(number - rounded) <= kInteger)) {
      return error("GC162", fmt::format("#{} is no parameter; parameters have integers", number), "check the number");
    }
    if (rounded < 1 || rounded > kLastParameter) {
      return error("GC162", fmt::format("#{:.0f} is out of range; parameters go from 1 to {}", rounded, kLastParameter),
                   "check the number");
    }
    return static_cast<int>(rounded);
  }

  /// A number, a parameter, an expression in brackets or a function, with signs before it.
  Result<double> value() {
    if (at_end()) return error("GC160", "a value is missing", "complete the line");
    if (++depth_ > kDeepest) return error("GC160", "an expression that nests too deep", "use parameters in between");
    auto result = value_inside();
    --depth_;
    if (result && !std::isfinite(*result)) {
      return error("GC161", "an expression whose value is not finite", "check its numbers");
    }
    return result;
  }

  Result<double> value_inside() {
    const char c = peek();
    if (c == '[') return expression();
    if (c == '#') return parameter();
    if (c == '+' || c == '-') {
      const std::size_t from = at_++;
      if (!at_end() && (is_digit(peek()) || peek() == '.')) {
        at_ = from;
        return number();
      }
      POLYPOD_ASSIGN(inner, value());
      return c == '-' ? -inner : inner;
    }
    if (is_letter(c)) return function();
    return number();
  }

  Result<double> number() {
    std::array<char, 400> digits{};
    std::size_t count = 0;
    const std::size_t from = at_;
    bool point = false;
    bool any = false;
    if (take('+')) {
    } else if (take('-')) {
      digits[count++] = '-';
    }
    while (!at_end() && (is_digit(peek()) || peek() == '.')) {
      if (peek() == '.' && point) break;
      point = point || peek() == '.';
      any = any || is_digit(peek());
      if (count < digits.size()) digits[count++] = peek();
      ++at_;
    }
    double value = 0;
    const auto [rest, code] = std::from_chars(digits.data(), digits.data() + count, value);
    if (!any || code != std::errc() || count == digits.size()) {
      at_ = from;
      return error("GC102", "a malformed number", "write [+-] digits, with at most one point and no exponent");
    }
    return value;
  }

  Result<double> parameter() {
    const std::size_t from = at_;
    ++at_;
    if (take('<')) {
      POLYPOD_ASSIGN(name, name_in_angles());
      const auto value = parameters_.named(name);
      if (value && *value) return **value;
      if (value && is_named_here(name)) return 0;
      at_ = from;
      if (!value)
        return error("GC169", value.error(),
                     name.starts_with("_value") ? "set the parameters that it reads at the start of the program"
                                                : "give X, Y and Z before, in absolute coordinates");
      return error("GC162", fmt::format("#<{}> is not defined", name), "give it a value before");
    }
    POLYPOD_ASSIGN(index, parameter_index());
    const auto value = parameters_.numbered(index);
    if (value) return *value;
    at_ = from;
    if (index <= kLastOwnParameter || index == 5399) {
      return error("GC162", value.error(),
                   index == 5399 ? std::string("take the decision out of the program that is judged")
                                 : fmt::format("set it in the program before, as #{}=0", index));
    }
    return error("GC169", value.error(),
                 index >= 5420 && parameters_.compensates() ? "read it before G41 or G42, or behind G40"
                                                            : "give X, Y and Z before, in absolute coordinates");
  }

  Result<double> expression() {
    ++at_;  // [
    POLYPOD_ASSIGN(result, operation(1));
    if (!take(']')) {
      return error("GC160", at_end() ? "'[' that is not closed" : fmt::format("'{}' within an expression", peek()),
                   !at_end() && lower(peek()) == 'e' ? "numbers have no exponent: write its digits"
                   : !at_end() && peek() == ','      ? "write a point in numbers"
                                                     : "check the operator, or add ']'");
    }
    return result;
  }

  /// Operators of at least this level, from left to right.
  Result<double> operation(int level) {
    POLYPOD_ASSIGN(left, level > 5 ? value() : operation(level + 1));
    while (true) {
      const Operator* found = nullptr;
      const std::size_t from = at_;
      for (const Operator& candidate : kOperators) {
        if (take_name(candidate.name)) {
          found = &candidate;
          break;
        }
      }
      if (found == nullptr) return left;
      if (found->level != level) {
        at_ = from;
        return left;
      }
      POLYPOD_ASSIGN(right, level > 4 ? value() : operation(level + 1));
      POLYPOD_ASSIGN(result, apply(found->name, left, right));
      if (!std::isfinite(result)) {
        return error("GC161", "an expression whose value is not finite", "check its numbers");
      }
      left = result;
    }
  }

  [[nodiscard]] Result<double> apply(std::string_view name, double a, double b) const {
    if (name == "+") return a + b;
    if (name == "-") return a - b;
    if (name == "*") return a * b;
    if (name == "/") {
      if (b == 0) return error("GC161", "a division by zero", "check the divisor");
      return a / b;
    }
    if (name == "**") {
      if (a < 0 && b != std::floor(b)) {
        return error("GC161", "a negative number to a power that is no integer", "check the base");
      }
      return std::pow(a, b);
    }
    if (name == "mod") {
      const double rest = std::fmod(a, b);
      return rest < 0 ? rest + std::abs(b) : rest;
    }
    if (name == "and") return a != 0 && b != 0 ? 1.0 : 0.0;
    if (name == "or") return a != 0 || b != 0 ? 1.0 : 0.0;
    if (name == "xor") return (a != 0) != (b != 0) ? 1.0 : 0.0;
    if (name == "eq") return std::abs(a - b) < kEqual ? 1.0 : 0.0;
    if (name == "ne") return std::abs(a - b) >= kEqual ? 1.0 : 0.0;
    if (name == "gt") return a > b ? 1.0 : 0.0;
    if (name == "ge") return a >= b ? 1.0 : 0.0;
    if (name == "lt") return a < b ? 1.0 : 0.0;
    return a <= b ? 1.0 : 0.0;
  }

  /// Nothing with this name is a function: what stands there instead.
  [[nodiscard]] tl::unexpected<Error> no_function(std::size_t from) {
    std::string name;
    for (std::size_t i = from; i < text_.size() && is_letter(text_[i]); ++i) name += lower(text_[i]);
    const auto known = std::find(kFunctions.begin(), kFunctions.end(), name);
    if (known != kFunctions.end())
      return error("GC160", fmt::format("'{}' without '['", name), "write its argument in brackets");
    for (const Operator& known_operator : kOperators) {
      if (known_operator.name == name)
        return error("GC160", fmt::format("'{}' without a value before it", name), "write a value on both sides");
    }
    return error("GC160", fmt::format("'{}' is no function", name),
                 fmt::format("functions are {}", fmt::join(kFunctions, ", ")));
  }

  Result<double> function() {
    const std::size_t from = at_;
    std::string_view name;
    for (const std::string_view candidate : kFunctions) {
      if (take_name(candidate)) {
        if (!at_end() && peek() == '[') {
          name = candidate;
          break;
        }
        at_ = from;
      }
    }
    if (name.empty()) return no_function(from);
    if (name == "exists") {
      ++at_;  // [
      if (!take('#')) return error("GC160", "EXISTS without a parameter", "write EXISTS[#<name>]");
      bool exists = true;
      if (take('<')) {
        POLYPOD_ASSIGN(wanted, name_in_angles());
        const auto value = parameters_.named(wanted);
        exists = !value || value->has_value() || is_named_here(wanted);
      } else {
        POLYPOD_ASSIGN(index, parameter_index());
        exists = index > 0;
      }
      if (!take(']')) return error("GC160", "'[' that is not closed", "add ']'");
      return exists ? 1.0 : 0.0;
    }
    POLYPOD_ASSIGN(x, expression());
    const auto out_of_range = [&] {
      at_ = from;
      return error("GC161", fmt::format("{} of {}", name, x), "check its number");
    };
    if (name == "abs") return x < 0 ? -x : x;  // a negative zero stays one, as in LinuxCNC
    if (name == "acos") return std::abs(x) > 1 ? Result<double>(out_of_range()) : degrees(std::acos(precise(x)));
    if (name == "asin") return std::abs(x) > 1 ? Result<double>(out_of_range()) : degrees(std::asin(precise(x)));
    if (name == "cos") return static_cast<double>(std::cos(radians(x)));
    if (name == "sin") return static_cast<double>(std::sin(radians(x)));
    if (name == "tan") return static_cast<double>(std::tan(radians(x)));
    if (name == "exp") return std::exp(x);
    if (name == "fix") return std::floor(x);
    if (name == "fup") return std::ceil(x);
    if (name == "ln") return x <= 0 ? Result<double>(out_of_range()) : std::log(x);
    if (name == "round") return std::round(x) + 0.0;  // no negative zero
    if (name == "sqrt") return x < 0 ? Result<double>(out_of_range()) : std::sqrt(x);
    if (!take('/') || at_end() || peek() != '[') {
      return error("GC160", "ATAN without its second number", "write ATAN[y]/[x]");
    }
    POLYPOD_ASSIGN(divisor, expression());
    return degrees(std::atan2(precise(x), precise(divisor)));
  }

  std::string_view text_;
  const Parameters& parameters_;
  const Place& place_;
  Line line_;
  std::optional<std::size_t> spindle_;   ///< where $ stands
  std::vector<std::string> named_here_;  // names that the line has come to give a value to
  std::size_t at_ = 0;
  int depth_ = 0;
};

}  // namespace

std::optional<std::pair<std::string, std::string>> o_word_of(std::string_view text) {
  std::size_t at = 0;
  const auto skip = [&] {
    while (at < text.size() && is_blank(text[at])) ++at;
  };
  skip();
  if (at < text.size() && text[at] == '/') {
    ++at;
    skip();
  }
  if (at < text.size() && lower(text[at]) == 'n') {
    ++at;
    while (at < text.size() && (is_blank(text[at]) || is_digit(text[at]) || text[at] == '.')) ++at;
  }
  if (at >= text.size() || lower(text[at]) != 'o') return std::nullopt;
  ++at;
  skip();
  std::string label;
  if (at < text.size() && text[at] == '<') {
    for (++at; at < text.size() && text[at] != '>'; ++at) {
      if (!is_blank(text[at])) label += lower(text[at]);
    }
    if (at < text.size()) ++at;
  } else {
    for (; at < text.size() && (is_blank(text[at]) || is_digit(text[at])); ++at) {
      if (is_digit(text[at]) && (!label.empty() || text[at] != '0')) label += text[at];
    }
  }
  if (label.empty()) return std::nullopt;
  std::string keyword;
  for (; at < text.size() && (is_blank(text[at]) || is_letter(text[at])); ++at) {
    if (is_letter(text[at])) keyword += lower(text[at]);
  }
  return std::pair{std::move(label), std::move(keyword)};
}

Result<Line> read_line(std::string_view text, const Parameters& parameters, const Place& place) {
  return LineReader(text, parameters, place).run();
}

std::string expanded(std::string_view message, const Parameters& parameters) {
  std::string out;
  int decimals = 6;
  constexpr double kNothing = 1e-4;  // rs274 prints 0 below it, whatever the decimals
  const auto put = [&](double value) {
    out += fmt::format("{:.{}f}", std::abs(value) < kNothing ? 0.0 : value, decimals);
  };
  for (std::size_t i = 0; i < message.size(); ++i) {
    const std::string_view rest = message.substr(i);
    if (rest.starts_with("%d")) {
      decimals = 0;
      ++i;
    } else if (rest.starts_with("%f")) {
      decimals = 4;
      ++i;
    } else if (rest.size() >= 4 && rest.starts_with("%.") && is_digit(rest[2]) && rest[3] == 'f') {
      decimals = rest[2] - '0';
      i += 3;
    } else if (rest.size() >= 2 && rest[0] == '#' && is_digit(rest[1])) {
      int index = 0;
      const auto [end, code] = std::from_chars(rest.data() + 1, rest.data() + rest.size(), index);
      const auto value = code == std::errc() && index >= 1 && index <= kLastParameter
                             ? parameters.numbered(index)
                             : tl::expected<double, std::string>(tl::unexpected(std::string()));
      if (value || (code == std::errc() && index == 0)) {
        put(value.value_or(0));  // #0 is 0 in a message alone
      } else {
        out += "######";
      }
      i += static_cast<std::size_t>(end - rest.data()) - 1;
    } else if (rest.starts_with("#<")) {
      const std::size_t close = rest.find('>');
      if (close == std::string_view::npos) {
        out += '#';
        continue;
      }
      std::string name;
      for (const char c : rest.substr(2, close - 2)) {
        if (!is_blank(c)) name += lower(c);
      }
      const auto value = parameters.named(name);
      if (value && *value) {
        put(**value);
      } else {
        out += "######";
      }
      i += close;
    } else {
      out += message[i];
    }
  }
  return out;
}

}  // namespace polypod::gcode
