// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// One self-contained HTML file: no network (its policy forbids it), no script that reading needs, good on paper, on
// small screens, light and dark.
#pragma once

#include <string>
#include <utility>
#include <variant>
#include <vector>

#include "polypod/report/plot.hpp"
#include "polypod/report/scene.hpp"

namespace polypod::report {

enum class Verdict { neutral, good, bad };

/// A number that stands out: `255 um`, "mean error before".
struct KeyFigure {
  std::string value;
  std::string unit;
  std::string label;
  Verdict verdict = Verdict::neutral;
};

struct Column {
  std::string title;
  std::string unit;
  int decimals = -1;  ///< of numbers; -1: three significant digits
};
using Cell = std::variant<std::string, double>;

struct Table {
  std::string caption;
  std::vector<Column> columns;
  std::vector<std::vector<Cell>> rows;
  bool folded = false;  ///< shut until the reader opens it (printed open)
};

/// The scripts that pages of this version may run, as a list of sources for a content security policy: that of every
/// page, that of its scenes, that of pages which `polypod view` serves.
std::string script_sources(bool scenes, bool live);

/// A report in the order in which its parts are added. All text is escaped; the same calls give the same bytes.
class Report {
 public:
  /// `facts` stand under the title: what was computed, with which inputs and version. No date unless the caller gives
  /// it.
  Report(std::string title, std::string subtitle, std::vector<std::pair<std::string, std::string>> facts = {});

  /// A chapter with an entry in the list of contents.
  void add_section(const std::string& title);
  void add_heading(const std::string& title);  ///< inside a section
  void add_text(const std::string& paragraph);
  /// A sentence in a frame of its colour: the answer of the report, or a warning.
  void add_verdict(Verdict verdict, const std::string& sentence);
  void add_list(const std::vector<std::string>& items);
  /// Address in this document or its server, and text.
  void add_links(const std::vector<std::pair<std::string, std::string>>& links);
  void add_key_figures(const std::vector<KeyFigure>& figures);
  /// Name and value, one a line, in as many columns as fit: inputs.
  void add_definitions(const std::vector<std::pair<std::string, std::string>>& entries);
  void add_table(const Table& table);
  void add_figure(const Figure& figure, const std::string& caption);
  /// A picture in space that turns by mouse, touch and keys where the browser has scripts and WebGL, and stands as it
  /// is drawn where it has not and on paper. What turns may hold more than what is drawn: `turns`, by default `drawn`.
  void add_scene(const Scene& drawn, const std::string& caption, const Scene* turns = nullptr);
  /// Small pictures side by side (one below the other on a narrow screen), each with its own title.
  void add_figure_grid(int columns, const std::vector<std::pair<std::string, Figure>>& panels,
                       const std::string& caption);
  /// Text as it is, in a fixed-width font, e.g. a program; `folded` as in Table.
  void add_code(const std::string& title, const std::string& text, bool folded = true);

  /// The page is served by `polypod view`: its script shows a form for the scene above, by `data` (JSON), and may ask
  /// the server that the page came from, and nobody else. Once a page.
  void make_live(const std::string& data);

  [[nodiscard]] std::string to_html() const;

 private:
  std::string next_id();

  std::string title_, subtitle_;
  std::vector<std::pair<std::string, std::string>> facts_;
  std::vector<std::string> sections_;
  std::string body_;
  bool in_section_ = false;
  int pictures_ = 0, scenes_ = 0;
  bool live_ = false;
};

}  // namespace polypod::report
