// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Saved modal states (M70 to M73), in the calls that LinuxCNC 2.9 makes of them; what its reference leaves open was
// found with rs274: which modes come back, in which order, and to how many digits.
#include <cmath>
#include <utility>
#include <vector>

#include "engine.hpp"
#include "words.hpp"

namespace polypod::gcode {
namespace {

/// LinuxCNC writes F with one decimal, S with none, and the tolerances of G64 with six.
constexpr double kFeedDigits = 10;
constexpr double kToleranceDigits = 1e6;

double rounded(double value, double digits) {
  const double scaled = value * digits;
  return std::abs(scaled) < 1e15 ? std::nearbyint(scaled) / digits : value;
}

Word word(char letter, double value) {
  return Word{letter, value, 1, 1};
}

}  // namespace

Engine::Modes Engine::modes() const {
  Modes m;
  m.inches = inches_;
  m.inverse = inverse_;
  m.feed = feed_;
  m.speed = speed_;
  m.turning = turning_;
  m.plane = plane_;
  m.side = side_;
  m.tool_offset = tool_offset_;
  m.system = active_;
  m.path_mode = path_mode_;
  m.tolerance = tolerance_;
  m.cam_tolerance = cam_tolerance_;
  m.incremental = incremental_;
  m.arc_absolute = arc_absolute_;
  m.old_level = old_level_;
  m.mist = mist_;
  m.flood = flood_;
  m.feed_override = feed_override_;
  m.adaptive_feed = adaptive_feed_;
  m.feed_hold = feed_hold_;
  m.g92 = parameter(5210) != 0;
  return m;
}

/// M70 saves, M71 forgets, M72 restores, M73 saves and restores where the subprogram ends. Each level of calls has its
/// own.
Status Engine::save_or_restore(int m) {
  Frame& f = frame();
  const int column = find('M')->column;
  switch (m) {
    case 710:
      f.modes.reset();
      return {};
    case 720:
      if (!f.modes) {
        return error(column, "GC123", "M72 without an M70 or M73 before it at the same level of calls",
                     "save the modes with M70, in this subprogram");
      }
      return restore(*f.modes, column);
    default:
      f.modes = modes();
      f.restores = f.restores || m == 730;
      return {};
  }
}

/// The modes that differ come back as blocks of their own words: units, then all others but M words, of which a block
/// takes one. Neither the motion mode nor the tool nor the origins are among them. As in LinuxCNC 2.9, overrides count
/// by that of the feed, and the modes of M52 and M53 are only switched on.
Status Engine::restore(const Modes& saved, int column) {
  if (saved.side != 0 && saved.side != side_) {
    return error(column, "GC123", "the saved modes hold cutter radius compensation, which would begin anew here",
                 "save the modes where it is off, and write G41 or G42 again");
  }
  const Modes now = modes();
  if (saved.inches != now.inches) POLYPOD_TRY(run_words({word('G', saved.inches ? 20 : 21)}));
  std::vector<Word> words;
  const auto g = [&](bool differs, double code) {
    if (differs) words.push_back(word('G', code));
  };
  g(saved.inverse != now.inverse, saved.inverse ? 93 : 94);
  if (!saved.inverse && saved.feed != now.feed) {
    words.push_back(word('F', rounded(saved.feed, kFeedDigits)));
    if (words.back().value != saved.feed) {
      notes_.push_back(fmt::format("line {}: LinuxCNC 2.9 restores the feed {} as {:.1f}", written_block_->line,
                                   number(saved.feed, 9), saved.feed));
    }
  }
  if (saved.speed != now.speed) words.push_back(word('S', std::nearbyint(saved.speed)));
  g(saved.plane != now.plane, saved.plane == Plane::xy ? 17 : saved.plane == Plane::zx ? 18 : 19);
  g(saved.side != now.side, 40);
  g(saved.tool_offset != now.tool_offset, saved.tool_offset ? 43 : 49);
  g(saved.system != now.system, saved.system <= 6 ? 53 + saved.system : 59 + (saved.system - 6) / 10.0);
  const bool blends = saved.path_mode == 640;
  const bool path = saved.path_mode != now.path_mode ||
                    (blends && (saved.tolerance != now.tolerance || saved.cam_tolerance != now.cam_tolerance));
  g(path, saved.path_mode / 10.0);
  if (path && blends) {
    words.push_back(word('P', rounded(saved.tolerance, kToleranceDigits)));
    words.push_back(word('Q', rounded(saved.cam_tolerance, kToleranceDigits)));
  }
  g(saved.incremental != now.incremental, saved.incremental ? 91 : 90);
  g(saved.arc_absolute != now.arc_absolute, saved.arc_absolute ? 90.1 : 91.1);
  g(saved.old_level != now.old_level, saved.old_level ? 98 : 99);
  g(saved.g92 != now.g92, saved.g92 ? 92.3 : 92.2);

  std::vector<double> switches;  // M words
  const auto m = [&](bool differs, double code) {
    if (differs) switches.push_back(code);
  };
  m(saved.turning != now.turning, saved.turning > 0 ? 3 : saved.turning < 0 ? 4 : 5);
  if (!saved.mist && !saved.flood) {
    m(now.mist || now.flood, 9);
  } else {
    m(saved.mist && !now.mist, 7);
    m(saved.flood && !now.flood, 8);
  }
  m(saved.feed_override != now.feed_override, saved.feed_override ? 48 : 51);
  m(saved.adaptive_feed && !now.adaptive_feed, 52);
  m(saved.feed_hold && !now.feed_hold, 53);
  if (!switches.empty()) words.push_back(word('M', switches.front()));
  POLYPOD_TRY(run_words(words));
  for (std::size_t i = 1; i < switches.size(); ++i) POLYPOD_TRY(run_words({word('M', switches[i])}));
  return {};
}

/// Runs words as a block of the line at hand.
Status Engine::run_words(const std::vector<Word>& words) {
  if (words.empty()) return {};
  Block block;
  block.line = written_block_ != nullptr ? written_block_->line : 0;
  block.words = words;
  const Block* const before = block_;
  Status done = this->block(block);
  block_ = before;
  return done;
}

}  // namespace polypod::gcode
