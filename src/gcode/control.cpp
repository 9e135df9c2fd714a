// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Lines in the order in which they run: subprograms, loops, conditions.
#include <algorithm>
#include <cmath>
#include <filesystem>
#include <set>

#include "engine.hpp"
#include "polypod/core/files.hpp"
#include "text.hpp"

namespace polypod::gcode {
namespace {

constexpr const char* kRepeatHint =
    "break and continue act on while and do alone: write the loop so, or leave it by a condition";

/// LinuxCNC's depth of subprograms.
constexpr std::size_t kDeepestCall = 10;
constexpr std::size_t kLongestSubprogram = 16 << 20;  // bytes of a file

std::string shown(const std::string& label) {
  const bool number = !label.empty() && label.find_first_not_of("0123456789") == std::string::npos;
  return number ? "O" + label : "O<" + label + ">";
}

}  // namespace

Status Engine::run_lines() {
  const auto& all = source().program->blocks;
  const long most_lines = options_.most_lines + static_cast<long>(all.size());  // each once is no endless loop
  for (std::size_t i = 0; options_.checks && i < all.size(); ++i) {             // LinuxCNC reads what it skips, too
    other_ = all[i];
    if (other_.after_end || other_.text.size() <= kLongestLine) continue;
    written_block_ = block_ = &other_;
    return error(static_cast<int>(kLongestLine) + 1, "GC108",
                 "a line of more than 252 characters, which LinuxCNC refuses", "split the block");
  }
  while (!ends_) {
    Frame& f = frame();
    const auto& blocks = source().program->blocks;
    if (f.at >= blocks.size()) {
      if (frames_.size() == 1) return {};
      // A file that ends without M99 or endsub.
      other_ = blocks.back();
      written_block_ = block_ = &other_;
      return error(1, "GC163", fmt::format("the file ends within the subprogram {}", shown(f.name)),
                   "end it with endsub, or M99");
    }
    if (until_ > 0 && f.source == 0 && blocks[f.at].line == until_) return {};
    if (++lines_ > most_lines) {
      other_ = blocks[f.at];
      written_block_ = block_ = &other_;
      return error(1, "GC165", fmt::format("the program runs more than {} lines", options_.most_lines),
                   "check the conditions of its loops: one of them may never end");
    }
    constexpr std::size_t kSpill = 1 << 16;
    if (out_.size() > kSpill) spill();
    POLYPOD_TRY(step());
  }
  return {};
}

namespace {

/// Numbers of codes and tools that an expression gives but for its rounding, as LinuxCNC takes them: within 1e-4.
void round_integers(std::vector<Word>& words) {
  for (Word& word : words) {
    const double unit = word.letter == 'G' ? 0.1 : 1;
    const double rounded = std::round(word.value / unit) * unit;
    const bool code = std::string_view("GMTHL").find(word.letter) != std::string_view::npos;
    const bool may_be = std::string_view("DPQ").find(word.letter) != std::string_view::npos;
    if (std::abs(word.value - rounded) <= (code ? 1e-4 : may_be ? 1e-9 : 0)) word.value = rounded;
  }
}

}  // namespace

Status Engine::step() {
  here_ = source().program->blocks[frame().at++];
  const Block& block = here_;
  written_block_ = &block;
  if (block.percent) return percent(block);
  if (block.text.size() > kLongestLine && options_.checks) {
    block_ = &block;
    return error(static_cast<int>(kLongestLine) + 1, "GC108",
                 "a line of more than 252 characters, which LinuxCNC refuses", "split the block");
  }
  const bool evaluated = block.construct != Construct::none || block.after_end;
  if (!evaluated) {
    if (block.optional && options_.block_delete) return {};
    return execute(block);
  }
  Place place{source().program->path, block.line, 0};
  // A label alone is looked at first: what stands behind it must not be evaluated where it does not run.
  POLYPOD_ASSIGN(line, read_line(block.text, *this, place));
  if (line.percent) return percent(block);
  if (line.optional && options_.block_delete) return {};
  if (!line.keyword.empty()) return control(line, block);
  scratch_.text = block.text;
  scratch_.ending = block.ending;
  scratch_.line = block.line;
  scratch_words_ = std::move(line.words);
  round_integers(scratch_words_);
  scratch_.words = scratch_words_;
  // Assignments count when the whole line has been read, but before it runs.
  if (!line.assignments.empty()) POLYPOD_TRY(assign(line, scratch_));
  return execute(scratch_);
}

/// The first opens the program; the next one that is reached ends it, in a subprogram too.
Status Engine::percent(const Block& block) {
  block_ = &block;
  if (!is_percent(block.text)) {
    return error(1, "GC105", "'%' within a block; '%' stands alone on its line, without a comment",
                 "move it to its own line");
  }
  if (!percent_ && (frames_.size() > 1 || block.after_end)) {
    return error(1, "GC105", "'%' in a program that did not begin with '%'", "remove this line");
  }
  begin_plain();
  if (percent_) {
    number_ = kNoNumber;
    put_now("FINISH()");
    ends_ = finished_ = true;
  }
  percent_ = true;
  add_plain("%", true);
  return {};
}

Status Engine::execute(const Block& block) {
  if (options_.checks) {
    for (const Word& word : block.words) {
      if (word.letter != 'M') continue;
      if (word.value == 98 || word.value == 99) {
        block_ = &block;
        if (block.text.substr(0, static_cast<std::size_t>(word.column)).find('(') != std::string_view::npos) {
          return error(word.column, "GC119",
                       fmt::format("a comment before M{}, behind which LinuxCNC does not know it", word.value),
                       "write it behind");
        }
        for (const Word& other : block.words) {
          if (std::string_view("MNPLO").find(other.letter) == std::string_view::npos) {
            return error(other.column, "GC119", fmt::format("{} beside M{}", other.letter, word.value),
                         "move it to a line of its own");
          }
        }
        return word.value == 98 ? call_by_number(block) : return_from(block);  // rs274 prints no comment here
      }
    }
  }
  return this->block(block);
}

namespace {
/// Whether the label of a line is computed: O[#1+100] sub, O#1 while.
bool computes_label(std::string_view text) {
  const std::size_t o = text.find_first_not_of(" \t/nN0123456789.");
  if (o == std::string_view::npos || (text[o] != 'o' && text[o] != 'O')) return false;
  const std::size_t next = text.find_first_not_of(" \t", o + 1);
  return next != std::string_view::npos && (text[next] == '[' || text[next] == '#');
}
}  // namespace

/// A line that LinuxCNC reads though it passes it by. Its error is that of the line; nothing where it reads a parameter
/// that has no value, or one that nobody knows: LinuxCNC goes on there.
Result<std::optional<Line>> Engine::read_passed(const Block& block) {
  Result<Line> line = read_line(block.text, *this, Place{source().program->path, block.line, 0});
  if (line) return std::optional<Line>(std::move(*line));
  if (line.error().id == "GC162" || line.error().id == "GC169") return std::optional<Line>();
  other_ = block;
  written_block_ = block_ = &other_;
  return tl::unexpected(std::move(line.error()));
}

std::optional<std::pair<std::string, std::string>> Engine::o_word(std::string_view text) const {
  if (auto written = o_word_of(text)) return written;
  if (!computes_label(text)) return std::nullopt;
  const Result<Line> line = read_line(text, *this, {});
  if (!line || line->keyword.empty()) return std::nullopt;
  return std::pair{line->label, line->keyword};
}

std::optional<std::size_t> Engine::first_of(const std::string& label, const Source& source, std::size_t from) const {
  const auto& blocks = source.program->blocks;
  for (std::size_t i = from; i < blocks.size(); ++i) {
    const std::string_view text = blocks[i].text;
    if (ends_file(text)) return std::nullopt;
    const auto word = o_word(text);
    if (word && word->first == label && (word->second == "sub" || word->second.empty())) return i;
  }
  return std::nullopt;
}

/// As LinuxCNC: where the program has come past it or called it before; in a file of its name; else behind the call.
Result<std::pair<std::size_t, std::size_t>> Engine::find_sub(const std::string& label, const Block& block, int column,
                                                             bool by_number) {
  if (const auto known = subs_.find(label); known != subs_.end()) return known->second;
  block_ = &block;
  const auto missing = [&](std::string why) {
    return error(column, "GC164", fmt::format("the subprogram {} {}", shown(label), why),
                 "define it in the program, before its first call or behind M2, or lay LABEL.ngc beside the program");
  };
  // Only a file in the folder of the program: no label leads out of it.
  const bool plain_name = label.find_first_of("/\\:") == std::string::npos && label.find("..") == std::string::npos;
  const std::filesystem::path folder = std::filesystem::path(sources_.front()->program->path).parent_path();
  const std::filesystem::path path = folder / (label + ".ngc");
  std::error_code ignored;
  if (!options_.files || !plain_name || !std::filesystem::is_regular_file(path, ignored)) {
    const auto at = first_of(label, source(), frame().at);
    if (!at) return missing("is not in the program behind its call, nor a file beside it");
    return subs_[label] = {frame().source, *at};
  }
  if (sources_.size() > 100) return missing("would be the hundredth file");
  if (std::filesystem::file_size(path, ignored) > kLongestSubprogram) return missing("is a file of more than 16 MB");
  POLYPOD_ASSIGN(program, read(path.string()));
  auto source = std::make_unique<Source>();
  source->own = std::move(program);
  source->program = &source->own;
  const auto at = first_of(label, *source, 0);
  if (!at) {
    const auto& blocks = source->program->blocks;
    if (!blocks.empty() && ends_file(blocks[0].text)) {
      return error(
          column, "GC164",
          fmt::format("{} begins with '%', and so does the program: LinuxCNC stops reading there", path.string()),
          "take the '%' lines out of the file of the subprogram");
    }
    const std::string why = fmt::format("is not defined in {}, where LinuxCNC looks for it", path.string());
    if (!by_number) return missing(why);
    return error(column, "GC164", fmt::format("the subprogram {} {}", shown(label), why),
                 fmt::format("begin the file with the line O{}", label));
  }
  sources_.push_back(std::move(source));
  return subs_[label] = {sources_.size() - 1, *at};
}

Status Engine::call(const std::string& label, const std::vector<double>& arguments, const Block& block, int column) {
  block_ = &block;
  if (frames_.size() >= kDeepestCall) {
    return error(column, "GC165", fmt::format("subprograms nest deeper than {}", kDeepestCall - 1),
                 "check the condition that ends the recursion");
  }
  POLYPOD_ASSIGN(place, find_sub(label, block, column, false));
  const auto head = o_word(sources_[place.first]->program->blocks[place.second].text);
  if (!head || head->second != "sub") {
    return error(column, "GC163", fmt::format("{} is a program with a number; M98 calls it", shown(label)), "use M98");
  }
  Frame next;
  next.source = place.first;
  next.at = next.begin = place.second + 1;
  next.name = label;
  for (std::size_t i = 0; i < 30; ++i) {
    double& slot = parameter(static_cast<int>(i) + 1);
    next.saved[i] = slot;
    next.saved_told[i] = told_[i + 1];
    told_[i + 1] = true;
    slot = i < arguments.size() ? arguments[i] : 0;
  }
  frames_.push_back(std::move(next));  // #<_value> stays as the last subprogram, or one that was passed by, has left it
  return {};
}

/// Whether a subprogram, a loop or a branch is open here, or a `sub` follows.
bool Engine::in_or_before_o_words() const {
  const Frame& f = frames_.back();
  if (frames_.size() > 1 && !f.by_number) return true;
  std::set<std::string> opened;
  const auto& blocks = sources_[f.source]->program->blocks;
  for (std::size_t i = f.at; i < blocks.size(); ++i) {
    if (ends_file(blocks[i].text)) break;
    const auto word = o_word(blocks[i].text);
    if (!word || word->second.empty() || word->second == "call") continue;
    const auto& [label, keyword] = *word;
    if (keyword == "sub") return true;
    const auto known = f.labels.find(label);
    const bool closes_do = keyword == "while" && known != f.labels.end() && known->second.keyword == "do";
    if (!closes_do && (keyword == "if" || keyword == "while" || keyword == "do" || keyword == "repeat"))
      opened.insert(label);
    if (!opened.contains(label)) return true;
  }
  return false;
}

Status Engine::call_by_number(const Block& block) {
  block_ = &block;
  const Word* p = find('P');
  const Word* l = find('L');
  if (p == nullptr || p->value < 0 || p->value != std::floor(p->value) || p->value > 1e9) {
    return error(p != nullptr ? p->column : 1, "GC163", "M98 without the number of a subprogram", "write M98 P...");
  }
  if (l != nullptr && (l->value < 0 || l->value != std::floor(l->value) || l->value > 1e9)) {
    return error(l->column, "GC163", "L of M98 is no number of repetitions", "write an integer from 0");
  }
  if (l != nullptr && l->value == 0) {
    if (!frame().locals.empty() || frame().modes) {
      return error(l->column, "GC163", "M98 L0: LinuxCNC 2.9 forgets the local names and the saved modes there",
                   "remove the line, or use a condition");
    }
    if (in_or_before_o_words()) {
      return error(l->column, "GC163",
                   "M98 L0 in a loop, a branch or a subprogram, or before a 'sub': LinuxCNC 2.9 loses its place there",
                   "remove the line, or call only where there is something to call");
    }
    return {};
  }
  if (frames_.size() >= kDeepestCall) {
    return error(p->column, "GC165", fmt::format("subprograms nest deeper than {}", kDeepestCall - 1),
                 "check the condition that ends the recursion");
  }
  const std::string label = fmt::format("{:.0f}", p->value);
  POLYPOD_ASSIGN(place, find_sub(label, block, p->column, true));
  const auto head = o_word(sources_[place.first]->program->blocks[place.second].text);
  if (head && head->second == "sub") {
    return error(p->column, "GC163",
                 fmt::format("{} is a subprogram with 'sub'; a call with an O word calls it", shown(label)),
                 fmt::format("write O{} call", label));
  }
  Frame next;
  next.source = place.first;
  next.at = next.begin = place.second + 1;
  next.name = label;
  next.by_number = true;
  next.repeats = l != nullptr ? static_cast<long>(l->value) : 1;
  frames_.push_back(std::move(next));
  return {};
}

Status Engine::return_from(const Block& block) {
  block_ = &block;
  if (const Word* p = find('P')) {
    return error(p->column, "GC119", "P beside M99; LinuxCNC does not know it", "remove it");
  }
  if (frames_.size() == 1) {  // of the main program: its end
    number_ = kNoNumber;
    read_number(block.text);
    begin_plain();
    POLYPOD_TRY(end_program(false));
    add_plain("M2");
    return {};
  }
  Frame& f = frame();
  if (!f.by_number) {
    return error(1, "GC163", "M99 in a subprogram that 'call' called", "end it with endsub");
  }
  POLYPOD_TRY(leave());
  returned_ = false;
  returned_is_told_ = true;
  returned_value_ = 0;
  if (--f.repeats > 0) {
    f.at = f.begin;
    f.labels.clear();
    f.locals.clear();  // LinuxCNC 2.9 forgets the names between the passes
    return {};
  }
  frames_.pop_back();
  return {};
}

/// The modes that M73 has saved come back where a subprogram ends, after each of its passes.
Status Engine::leave() {
  if (!frame().restores || !frame().modes) return {};
  const Modes saved = *frame().modes;
  frame().modes.reset();
  frame().restores = false;
  return restore(saved, 1);
}

/// LinuxCNC 2.9 remembers that it has run the `break` of a `while` loop, or passed that of a loop on the way to its end
/// (as after `continue`), and ends the `do` loop whose `while` comes next.
void Engine::pass_break(const std::string& label, bool runs) {
  const auto known = frame().labels.find(label);
  if (known == frame().labels.end()) return;
  if (known->second.keyword == "while" || (!runs && known->second.keyword == "do")) break_passed_ = true;
}

void Engine::note_once(std::string note) {
  if (std::find(notes_.begin(), notes_.end(), note) == notes_.end()) notes_.push_back(std::move(note));
}

/// LinuxCNC 2.9 remembers a `continue` of a `do` loop until the end of the next other loop that is to be left there:
/// from it the loop goes back to its head instead.
Status Engine::leave_loop(const std::string& label, std::string_view end, std::size_t head, const Block& block) {
  POLYPOD_TRY(skip_to(label, {end}, block));
  if (!continued_) {
    ++frame().at;
    return {};
  }
  continued_ = false;
  frame().at = head;
  note_once(fmt::format(
      "line {}: LinuxCNC 2.9 goes back to the head of {} here instead of leaving it, for a 'continue' of a 'do' "
      "loop has run before; it may not be what was meant",
      block.line, shown(label)));
  return {};
}

Status Engine::skip_to(const std::string& label, std::initializer_list<std::string_view> keywords, const Block& block) {
  const auto& blocks = source().program->blocks;
  const std::size_t from = frame().at;
  for (std::size_t& at = frame().at; at < blocks.size(); ++at) {
    if (ends_file(blocks[at].text)) break;
    if (computes_label(blocks[at].text)) POLYPOD_TRY(read_passed(blocks[at]));
    const auto word = o_word(blocks[at].text);
    // LinuxCNC reads `continue` and `break` of a loop that repeats also where it passes them by, and those of the `if`
    // that it looks for the end of.
    if (word && (word->second == "continue" || word->second == "break") &&
        (word->first == label || repeats_left_.contains({frame().name, word->first}))) {
      const auto known = frame().labels.find(word->first);
      const std::string_view of = known != frame().labels.end() ? std::string_view(known->second.keyword) : "";
      if (of == "repeat" || (of == "if" && word->first == label)) {
        other_ = blocks[at];
        written_block_ = block_ = &other_;
        return error(1, "GC163", fmt::format("'{}' of {} within '{}'", word->second, shown(word->first), of),
                     kRepeatHint);
      }
    }
    if (!word || word->first != label) continue;
    if (word->second == "break") pass_break(label, false);
    if (blocks[at].optional && options_.block_delete) continue;
    if (std::find(keywords.begin(), keywords.end(), word->second) != keywords.end()) {
      lines_ += static_cast<long>((at - from) / 8);  // looking for a line costs less than running it
      return {};
    }
  }
  block_ = &block;
  return error(1, "GC163", fmt::format("{} is not closed: no '{}' follows", shown(label), *(keywords.end() - 1)),
               "close it with the same label");
}

Status Engine::control(const Line& line, const Block& block) {
  block_ = &block;
  const std::string& label = line.label;
  const std::string& word = line.keyword;
  Frame& f = frame();
  const std::size_t here = f.at - 1;
  const int column = line.label_column;
  const auto bad = [&](std::string message, std::string_view hint) {
    return error(column, "GC163", std::move(message), hint);
  };
  if (word == "call") return call(label, line.arguments, block, column);
  if (word == "sub") {
    if (frames_.size() > 1) return bad("a subprogram within a subprogram", "define it outside");
    const std::pair place{f.source, here};
    const auto [known, is_new] = subs_.try_emplace(label, place);
    if (!is_new) {
      return known->second == place
                 ? bad(fmt::format("the program comes to {} once more, or after it was called, which LinuxCNC refuses",
                                   shown(label)),
                       "define it before its first call, outside of loops, or behind M2")
                 : bad(fmt::format("{} is defined a second time", shown(label)), "give each subprogram its own label");
    }
    return [&]() -> Status {
      const auto& blocks = source().program->blocks;
      for (std::size_t i = f.at; i < blocks.size(); ++i) {
        if (ends_file(blocks[i].text)) break;
        if (computes_label(blocks[i].text)) POLYPOD_TRY(read_passed(blocks[i]));
        const auto other = o_word(blocks[i].text);
        if (!other) continue;
        if (other->second == "return" && other->first == label) POLYPOD_TRY(read_passed(blocks[i]));
        if (other->second == "sub") {
          other_ = blocks[i];
          written_block_ = block_ = &other_;
          return error(1, "GC163", "a subprogram within a subprogram", "define it outside");
        }
        if (other->second == "endsub" && other->first == label) {
          // LinuxCNC reads the value of the last line even where it passes the subprogram by.
          POLYPOD_ASSIGN(last, read_passed(blocks[i]));
          returned_is_told_ = last.has_value() || options_.machine_known;
          if (last) {
            returned_ = !last->arguments.empty();
            returned_value_ = returned_ ? last->arguments.front() : 0;
          }
          f.at = i + 1;
          return {};
        }
      }
      return bad(fmt::format("{} is not closed: no 'endsub' follows", shown(label)), "close it with the same label");
    }();
  }
  if (word == "endsub" || word == "return") {
    if (frames_.size() == 1) return bad(fmt::format("'{}' outside of a subprogram", word), "remove it");
    if (f.by_number) return bad(fmt::format("'{}' in a subprogram that M98 called", word), "end it with M99");
    // Whatever its label: LinuxCNC does not compare it, and one that is computed has other parameters in a call.
    POLYPOD_TRY(leave());
    returned_ = !line.arguments.empty();
    returned_is_told_ = true;
    returned_value_ = returned_ ? line.arguments.front() : 0;
    for (std::size_t i = 0; i < 30; ++i) {
      parameter(static_cast<int>(i) + 1) = f.saved[i];
      told_[i + 1] = f.saved_told[i];
    }
    frames_.pop_back();
    return {};
  }

  const auto known = f.labels.find(label);
  const bool is_known = known != f.labels.end();
  const auto claim = [&]() -> Status {  // for the head of a loop or a condition
    if (is_known && known->second.line != here) {
      return bad(fmt::format("the label {} is used a second time", shown(label)),
                 "give each loop and condition its own");
    }
    f.labels[label] = {word, here};
    return {};
  };
  const auto expect = [&](std::initializer_list<std::string_view> heads) -> Status {
    if (!is_known || std::find(heads.begin(), heads.end(), known->second.keyword) == heads.end()) {
      return bad(fmt::format("'{}' of {} without its beginning", word, shown(label)), "check its label");
    }
    return {};
  };
  if (word == "if") {
    POLYPOD_TRY(claim());
    if (line.arguments.front() != 0) return {};
    while (true) {
      POLYPOD_TRY(skip_to(label, {"else", "elseif", "endif"}, block));
      other_ = source().program->blocks[f.at++];
      const Block& next = other_;
      const auto found = o_word(next.text);
      if (found->second != "elseif") return {};
      written_block_ = &next;
      POLYPOD_ASSIGN(again, read_line(next.text, *this, Place{source().program->path, next.line, 0}));
      if (again.arguments.front() != 0) return {};
    }
  }
  if (word == "elseif" || word == "else") {  // the branch before it has run
    POLYPOD_TRY(expect({"if"}));
    POLYPOD_TRY(skip_to(label, {"endif"}, block));
    ++f.at;
    return {};
  }
  if (word == "endif") return expect({"if"});
  if (word == "do") return claim();
  if (word == "while") {
    if (is_known && known->second.keyword == "do") {
      if (break_passed_) {
        break_passed_ = false;
        if (line.arguments.front() != 0) {
          note_once(
              fmt::format("line {}: LinuxCNC 2.9 ends this loop here, for it has passed the 'break' of a loop "
                          "before; it may not be what was meant",
                          block.line));
        }
        return {};
      }
      if (line.arguments.front() != 0) f.at = known->second.line + 1;
      return {};
    }
    POLYPOD_TRY(claim());
    if (line.arguments.front() != 0) return {};
    return leave_loop(label, "endwhile", here, block);
  }
  if (word == "endwhile") {
    POLYPOD_TRY(expect({"while"}));
    f.at = known->second.line;
    return {};
  }
  if (word == "repeat") {
    POLYPOD_TRY(claim());
    const double count = std::nearbyint(line.arguments.front());  // halves to even, as LinuxCNC does
    const auto [left, begins] = repeats_left_.try_emplace({f.name, label}, 0);
    if (begins) left->second = static_cast<long>(std::clamp(count, 0.0, 1e15));
    if (left->second > 0) {
      --left->second;
      return {};
    }
    repeats_left_.erase(left);
    return leave_loop(label, "endrepeat", here, block);
  }
  if (word == "endrepeat") {
    POLYPOD_TRY(expect({"repeat"}));
    f.at = known->second.line;
    return {};
  }
  // break and continue
  if (is_known && known->second.keyword == "repeat") {
    return bad(fmt::format("'{}' of {} within 'repeat'", word, shown(label)), kRepeatHint);
  }
  POLYPOD_TRY(expect({"while", "do"}));
  const bool is_do = known->second.keyword == "do";
  if (word == "break") pass_break(label, true);
  const std::size_t head = known->second.line;
  if (is_do) {
    POLYPOD_TRY(skip_to(label, {"while"}, block));
    if (word == "continue") {
      continued_ = true;
    } else {
      ++f.at;
      break_passed_ = false;  // its own `while` has heeded it
    }
    return {};
  }
  if (word == "break") return leave_loop(label, "endwhile", head, block);
  POLYPOD_TRY(skip_to(label, {"endwhile"}, block));
  continued_ = false;
  f.at = head;
  return {};
}

}  // namespace polypod::gcode
