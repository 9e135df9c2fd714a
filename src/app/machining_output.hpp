// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// What `predict` and `correct` say: JSON and text.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "command.hpp"
#include "polypod/machining/confidence.hpp"
#include "polypod/machining/correct.hpp"
#include "polypod/machining/uncertainty.hpp"

namespace polypod::app {

Json spread_json(const machining::Spread& s, double scale);
std::string spread_text(const machining::Spread& s);
void add_uncertainty(Json& document, const machining::Uncertainty& u);
/// `reach`: said in one line, where it is not null.
void print_uncertainty(const machining::Uncertainty& u, const machining::Reach* reach);
/// Adds what the measured compliance is made of and how far it is known; nothing where the job has none.
void add_map(Json& document, const machining::Job& job, const machining::MapBand& band);
void print_map(const machining::Job& job, const machining::MapBand& band);
Json not_judged_json(const std::vector<machining::NotJudged>& moves, const std::vector<machining::Plunge>& plunges);
/// `at`: "" or ", with block delete on"; `shown`: the distance that is printed already, m.
void print_plunges(const std::vector<machining::Plunge>& plunges, const machining::Plunge& within, double shown,
                   const std::string& at = "");
Json steep_json(const machining::Steep& s);
/// `at`: "" or ", with block delete on".
/// `shown`: the distance that is printed already, m.
void print_steep(const machining::Steep& s, double shown, const std::string& at = "");
Json slow_corners_json(const machining::SlowCorners& s);
/// Likewise.
void print_slow_corners(const machining::SlowCorners& s, double shown, const std::string& at = "");
/// To a millionth: mm, deg or um without the noise that a conversion leaves, so that a job can take them as they stand.
double to_a_millionth(double x);
double rounded_um(double m);
Json rounded_mm(const Vec3& p);
/// The answer of `correct` in one sentence.
std::string answer_in_words(const machining::Correction& c, const std::optional<machining::Reach>& reach);
/// The answer of `correct` where it is yes, and what it does not hold for.
void print_answer(const machining::Correction& c, const std::optional<machining::Reach>& reach);
Json short_blocks_json(const machining::ShortBlocks& s);
void print_short_blocks(const machining::ShortBlocks& s, bool written);
void print_not_judged(const std::vector<machining::NotJudged>& moves);
void add_other_switch(Json& document, const std::optional<machining::OtherSwitch>& other, bool trust);
/// Why a distance below the tolerance is beyond it.
std::string kept_free(const machining::Job& job, double distance);
/// `correction`: of `correct`, where a fixed program has another one for the other position.
void print_other_switch(const std::optional<machining::OtherSwitch>& other, bool trust, bool correction);
void print_modes(const machining::Correction& c);
void print_outside(const machining::Correction& c);

Json confidence_json(const machining::Confidence& confidence);
void print_confidence(const machining::Confidence& confidence);

}  // namespace polypod::app
