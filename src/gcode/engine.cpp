// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// The order in which the words of a block act, and how a program begins and ends.
#include "engine.hpp"

#include <algorithm>
#include <cmath>

#include "words.hpp"

namespace polypod::gcode {

Engine::Engine(const Program& program, EngineOptions options) : options_(std::move(options)) {
  // LinuxCNC takes the first place of its table for the spindle's, whatever lies there.
  told_pocket_ = options_.tools.empty() ? -1 : options_.tools.front().pocket;
  parameters_.assign(static_cast<std::size_t>(kLastParameter) + 1, 0);
  told_.assign(parameters_.size(), false);
  for (const auto& [index, value] : options_.parameters) {
    if (index >= 1 && index <= kLastParameter) parameter(index) = value;
  }
  parameter(5599) = 1;
  if (parameter(5220) < 1 || parameter(5220) > 9) parameter(5220) = 1;
  active_ = static_cast<int>(parameter(5220));
  if (parameter(5210) != 0) {
    for (std::size_t k = 0; k < 6; ++k) g92_[k] = parameter(5211 + static_cast<int>(k)) * (k < 3 ? kMmPerInch : 1);
  }
  for (int i = 1; i <= 6; ++i) {
    for (std::size_t k = 0; k < 6; ++k) {
      plain_origins_[static_cast<std::size_t>(i - 1)][k] =
          parameter(5201 + 20 * i + static_cast<int>(k)) * (k < 3 ? kMmPerInch : 1);
    }
    if (parameter(5210) != 0) {
      for (std::size_t k = 0; k < 6; ++k) plain_origins_[static_cast<std::size_t>(i - 1)][k] += g92_[k];
    }
  }
  plain_system_ = active_ <= 6 ? active_ : 1;
  known_.fill(options_.machine_known);
  known_[3] = known_[4] = known_[5] = true;
  select(active_);
  // The start of rs274: the machine's zero, which it does not turn with the coordinates.
  for (std::size_t k = 0; k < 6; ++k) current_[k] = canon_[k] = 0 - origin_[k] - g92_[k];
  auto source = std::make_unique<Source>();
  source->program = &program;
  sources_.push_back(std::move(source));
  frames_.emplace_back();
  plain_.path = program.path;
}

void Engine::begin() {
  number_ = kNoNumber;
  put("USE_LENGTH_UNITS(CANON_UNITS_MM)");
  print_system(active_, true);
  put("SET_FEED_REFERENCE(CANON_XYZ)");
  put("ON_RESET()");
}

std::string Engine::take_text() {
  std::string text;
  text.reserve(long_out_.size() + out_.size());
  text.assign(long_out_.begin(), long_out_.end());
  return text += out_;
}

Status Engine::run() {
  begin();
  POLYPOD_TRY(run_lines());
  if (!waiting_.empty()) {
    if (options_.plain) {
      return error(1, "GC176",
                   "the program ends while cutter radius compensation is on: LinuxCNC leaves its last move out",
                   "write G40 and a line behind the contour");
    }
    waiting_.clear();
  }
  if (motion_ == 52) return error(1, "GC127", "the program ends within a curve (G5.2)", "end it with G5.3");
  if (closes_) {
    begin_plain();
    add_plain("%", true);
  }
  number_ = kNoNumber;
  put("ON_RESET()");
  put("ON_RESET()");
  return {};
}

tl::unexpected<Error> Engine::error(int column, std::string_view id, std::string message, std::string_view hint) const {
  const int line = written_block_ != nullptr ? written_block_->line : 0;
  return fail(std::string(id), std::move(message), Place{sources_[frames_.back().source]->program->path, line, column},
              std::string(hint));
}

int Engine::integer(char letter) const {
  return static_cast<int>(std::clamp(value(letter), -1e9, 1e9));
}

/// The whole number that a word means: rs274 takes what is as near to one as 1e-4.
std::optional<int> Engine::whole(const Word& word) {
  constexpr double kNear = 1e-4, kMost = 1e9;
  const double nearest = std::round(word.value);
  if (!(std::abs(word.value - nearest) <= kNear && std::abs(nearest) <= kMost)) return std::nullopt;
  return static_cast<int>(nearest);
}

const Word* Engine::g_word(int tenfold) const {
  for (const Word& word : block_->words) {
    if (word.letter == 'G' && std::lround(word.value * 10) == tenfold) return &word;
  }
  return nullptr;
}

bool Engine::axis_words() const {
  return std::any_of(block_->words.begin(), block_->words.end(), [](const Word& w) {
    return kAxisLetters.find(w.letter) != std::string_view::npos || w.letter == '@' || w.letter == '^';
  });
}

Status Engine::block(const Block& block) {
  block_ = &block;
  read_number(block.text);
  if (resync_) {
    current_ = canon_;
    if (side_ != 0) programmed_ = canon_;
    resync_ = false;
  }
  begin_plain();
  if (find('O') == nullptr) POLYPOD_TRY(comment());  // rs274 prints none beside an O word
  if (block.words.empty()) {
    end_plain();
    return {};
  }
  const bool written = !block.text.empty();  // else M72 has made it
  if (options_.checks && written) POLYPOD_TRY(check());
  if (side_ != 0) POLYPOD_TRY(judge_compensated());
  if (motion_ == 52) POLYPOD_TRY(judge_within_nurbs());
  if (const int m = one_of('M', 700, 710, 720, 730); m >= 0) {
    rewritten_ = true;
    end_plain();
    return save_or_restore(m);
  }
  loaded_before_ = loaded_;
  feed_and_speed();
  POLYPOD_TRY(tools());
  POLYPOD_TRY(spindle());
  switches();
  switch_kinematics();
  POLYPOD_TRY(settings());
  POLYPOD_TRY(motion());
  POLYPOD_TRY(stop());
  if (resync_ && drawn_back_) current_ = canon_;  // for what reads the position before the next block acts
  end_plain();
  return {};
}

/// M codes that make the controller take words for joints, and back (InterpretOptions::m_codes). Between them the place
/// of the tip is not known to the program; afterwards it is where it was, unless the joints have moved.
void Engine::switch_kinematics() {
  if (in_joints_ && one_of('G', 280, 300, 530) >= 0) known_as_tip_.fill(false);
  for (const Word& word : block_->words) {
    if (word.letter != 'M') continue;
    const auto meaning = options_.m_codes.find(static_cast<int>(word.value));
    if (meaning == options_.m_codes.end()) continue;
    if (meaning->second == MCode::joints) {
      if (!in_joints_) known_as_tip_ = known_;
      known_.fill(false);
      in_joints_ = true;
    } else if (meaning->second == MCode::tip && in_joints_) {
      known_ = known_as_tip_;
      in_joints_ = false;
    }
  }
}

Status Engine::stop() {
  const int m = one_of('M', 0, 10, 20, 300, 600);
  if (m >= 0 && m != 20 && m != 300) {
    stopped_ = stopped_ || !waiting_.empty();
    POLYPOD_TRY(settle());
    reached_.reset();
  }
  switch (m) {
    case 0:
      put("PROGRAM_STOP()");
      break;
    case 10:
      put("OPTIONAL_PROGRAM_STOP()");
      break;
    case 600:
      put("PALLET_SHUTTLE()");
      put("PROGRAM_STOP()");
      break;
    case 20:
    case 300:
      return end_program(m == 300);
    default:
      break;
  }
  return {};
}

Status Engine::end_program(bool pallet) {
  POLYPOD_TRY(settle());
  side_ = 0;
  keep_place([&] { select(1); });
  print_system(1, false);
  if (plane_ != Plane::xy) put("SELECT_PLANE(CANON_PLANE_XY)");
  put("SET_FEED_MODE(0, 0)");
  put("SET_FEED_RATE(0.0000)");
  if (!feed_override_) put("ENABLE_FEED_OVERRIDE()");
  put("STOP_SPINDLE_TURNING(0)");
  put("SET_SPINDLE_MODE(0 0.0000)");
  if (mist_) put("MIST_OFF()");
  if (flood_) put("FLOOD_OFF()");
  if (pallet) put("PALLET_SHUTTLE()");
  put("PROGRAM_END()");
  ends_ = true;
  if (percent_ && frame().source == 0) {  // the closing one is looked for in the rest of the file
    const Blocks& blocks = source().program->blocks;
    for (std::size_t i = frame().at; i < blocks.size() && !closes_; ++i) {
      closes_ = is_percent(blocks[i].text);
    }
    if (!closes_) put("COMMENT(\"interpreter: percent sign missing from end of file\")");
  }
  return {};
}

}  // namespace polypod::gcode
