// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/report/html.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "svg.hpp"
#include "viewer_bundle.hpp"

namespace polypod::report {
namespace {

constexpr double kWide =
    840;  // px: between the 960 of a screen (where text then shows a little larger) and the 690 of a printed page
constexpr double kNarrow = 360;  // px: a telephone held upright

constexpr std::string_view kPageCss = R"(*{box-sizing:border-box}
html{-webkit-text-size-adjust:100%}
body{margin:0;background:var(--ground);color:var(--ink);font:16px/1.55 system-ui,-apple-system,"Segoe UI",Roboto,"Noto Sans","Liberation Sans",sans-serif}
main,header.top{max-width:992px;margin:0 auto;padding:0 16px}
header.top{padding-top:36px}
h1{font-size:2rem;line-height:1.2;margin:0 0 .3rem;letter-spacing:-.01em}
.subtitle{font-size:1.1rem;color:var(--muted);margin:0 0 1rem;max-width:44em}
h2{font-size:1.4rem;margin:2.6rem 0 .8rem;padding-top:.7rem;border-top:1px solid var(--rule)}
h3{font-size:1.08rem;margin:1.7rem 0 .4rem}
p{margin:.6rem 0;max-width:46em} ul{margin:.6rem 0;padding-left:1.2em;max-width:46em} li{margin:.2rem 0}
a{color:var(--blue)}
nav{margin:1.2rem 0 0;display:flex;flex-wrap:wrap;gap:.3rem 1.2rem;font-size:.95rem}
dl{display:grid;grid-template-columns:repeat(auto-fill,minmax(270px,1fr));gap:0 2rem;margin:.8rem 0;font-size:.94rem}
dl>div{display:flex;justify-content:space-between;gap:1rem;padding:.28rem 0;border-bottom:1px solid var(--grid);break-inside:avoid}
dt{color:var(--muted)} dd{margin:0;text-align:right;overflow-wrap:anywhere;font-variant-numeric:tabular-nums}
.cards{display:grid;grid-template-columns:repeat(auto-fit,minmax(150px,1fr));gap:12px;margin:1.1rem 0}
.card{background:var(--panel);border-radius:8px;padding:14px 16px;border-left:4px solid var(--rule);break-inside:avoid}
.card b{display:block;font-size:1.7rem;line-height:1.2;font-weight:650;font-variant-numeric:tabular-nums;white-space:nowrap}
.card b.long{font-size:1.25rem}
.card b small{font-size:1rem;font-weight:500;color:var(--muted)}
.card span{font-size:.9rem;color:var(--muted)}
.good{border-left-color:var(--green)!important} .bad{border-left-color:var(--vermillion)!important}
.verdict{background:var(--panel);border-left:4px solid var(--rule);border-radius:8px;padding:.8rem 1rem;margin:1rem 0;font-size:1.05rem;max-width:none;break-inside:avoid}
.verdict strong{margin-right:.4em} .good strong{color:color-mix(in srgb,var(--green) 75%,var(--ink))} .bad strong{color:color-mix(in srgb,var(--vermillion) 75%,var(--ink))}
figure{margin:1.3rem 0;break-inside:avoid}
figcaption{color:var(--muted);font-size:.92rem;margin-top:.35rem;max-width:52em}
.narrow{display:none}
.panels{display:grid;gap:14px 18px} .panels h4{margin:0 0 2px;font-size:.95rem;font-weight:600}
.panels>div{break-inside:avoid}
.scroll{overflow-x:auto;margin:.8rem 0}
table{border-collapse:collapse;font-size:.92rem;font-variant-numeric:tabular-nums;min-width:50%}
caption{text-align:left;color:var(--muted);font-size:.92rem;padding-bottom:.35rem}
th{text-align:left;font-weight:600;border-bottom:2px solid var(--rule);padding:.3rem .8rem;vertical-align:bottom}
th small{display:block;font-weight:400;color:var(--muted)}
td{border-bottom:1px solid var(--grid);padding:.26rem .8rem;vertical-align:top}
th:first-child,td:first-child{padding-left:0} th.r,td.r{text-align:right} td.r{white-space:nowrap} tr{break-inside:avoid}
details{margin:.8rem 0} summary{cursor:pointer;color:var(--blue);font-weight:500}
pre{background:var(--panel);border-radius:8px;padding:12px 14px;overflow-x:auto;font:13px/1.45 ui-monospace,"DejaVu Sans Mono","Liberation Mono",monospace}
footer{max-width:992px;margin:3rem auto 2rem;padding:.8rem 16px 0;color:var(--muted);font-size:.88rem}
#tip{position:fixed;pointer-events:none;background:var(--ink);color:var(--ground);border-radius:6px;padding:6px 9px;font-size:12px;line-height:1.4;white-space:nowrap;display:none;z-index:2}
.tools{display:flex;gap:6px;justify-content:flex-end;margin:2px 0} .tools button,.tools input{font:inherit;font-size:.78rem;color:var(--muted);background:none;border:1px solid var(--grid);border-radius:5px;padding:1px 8px;min-height:26px}
.tools button{cursor:pointer} .tools button:hover{color:var(--ink)} .tools button:focus-visible,.sort:focus-visible{outline:2px solid var(--blue)}
.sort{font:inherit;color:inherit;background:none;border:0;padding:0;text-align:inherit;cursor:pointer}
th[aria-sort=ascending] .sort::after{content:" \25B2";font-size:.7em} th[aria-sort=descending] .sort::after{content:" \25BC";font-size:.7em}
tr.picks{cursor:pointer} tr.picked td{background:color-mix(in srgb,var(--orange) 28%,transparent)} rect.picked{fill:var(--orange);fill-opacity:.25} svg[data-plot=curves]{user-select:none} rect.stretch{fill:var(--sky);fill-opacity:.28} p.stretch{font-size:.9rem;color:var(--muted);margin:.2rem 0} p.stretch button{font:inherit;font-size:.78rem;color:inherit;background:none;border:1px solid var(--grid);border-radius:5px;cursor:pointer} path.cursor{fill:none;stroke:var(--ink);stroke-width:1.6;stroke-opacity:.75;pointer-events:none}
@media (max-width:640px){
.wide{display:none} .narrow{display:block} h1{font-size:1.55rem} header.top{padding-top:20px}
.panels{grid-template-columns:1fr!important} .cards{grid-template-columns:1fr 1fr} .card{padding:10px 12px} .card b{font-size:1.35rem}
}
@media print{
@page{margin:15mm 14mm}
body{font-size:10.5pt;background:#fff} main,header.top,footer{max-width:none;padding-left:0;padding-right:0}
.wide{display:block!important} .narrow{display:none!important}
h2,h3,h4,summary{break-after:avoid} nav,#tip,.tools,.cursor,.stretch{display:none!important} a{color:inherit;text-decoration:none}
pre{white-space:pre-wrap;overflow-wrap:anywhere;font-size:8.5pt} .scroll{overflow:visible} summary{color:inherit;list-style:none}
*{-webkit-print-color-adjust:exact;print-color-adjust:exact}
}
)";

constexpr std::string_view kSceneCss = R"(.scene canvas[data-scene],.scene .stage,.scene .controls{display:none}
.live .stage{display:block;position:relative;height:min(74vh,620px);overflow:hidden;border-radius:8px;background:var(--panel)}
.live .stage canvas{display:block;width:100%;height:100%;touch-action:pan-y;cursor:grab;outline-offset:-3px}
.live .stage canvas.turning{cursor:grabbing} .live .stage canvas:focus-visible{outline:3px solid var(--blue)}
.live>.wide,.live>.narrow{display:none}
.labels{position:absolute;inset:0;pointer-events:none;font-size:11px;color:var(--muted)}
.labels span{position:absolute;left:0;top:0;white-space:nowrap;text-shadow:0 0 3px var(--panel),0 0 3px var(--panel)} .labels .axis{font-size:12px;color:var(--ink)}
.bar{position:absolute;left:8px;top:8px;display:flex;flex-wrap:wrap;gap:4px}
.bar button,.player button,.player select{font:inherit;font-size:13px;min-width:30px;min-height:30px;padding:2px 8px;border:1px solid var(--rule);border-radius:6px;background:var(--ground);color:var(--ink);cursor:pointer}
.bar button:focus-visible,.player button:focus-visible,.controls input:focus-visible{outline:2px solid var(--blue);outline-offset:1px}
.live .controls{display:block;font-size:.9rem;margin-top:.5rem}
.legend{list-style:none;display:flex;flex-wrap:wrap;gap:.15rem 1.1rem;margin:0;padding:0;max-width:none}
.legend li{display:flex;align-items:center;gap:.4rem;margin:0} .legend label{display:flex;align-items:center;gap:.4rem;cursor:pointer;min-height:26px}
.legend i{width:18px;height:11px;border-radius:2px;flex:none} .legend i.line{height:3px} .legend i.dot{width:9px;height:9px;border-radius:50%}
.slides{display:grid;grid-template-columns:repeat(auto-fill,minmax(300px,1fr));gap:.1rem 2rem;margin-top:.4rem}
.slide{display:grid;grid-template-columns:7.5em 1fr 6.5em;align-items:center;gap:.7rem;min-height:30px}
.slide input{width:100%;min-width:0;accent-color:var(--blue)} .slide output{text-align:right;font-variant-numeric:tabular-nums}
.player{display:flex;flex-wrap:wrap;gap:5px;align-items:center} .follow{display:flex;align-items:center;gap:.4rem;min-height:30px;margin-left:.5rem;cursor:pointer}
.now{font-family:ui-monospace,monospace;font-size:.88rem;margin:.5rem 0 0;padding:.25rem .6rem;border-left:3px solid var(--blue);background:var(--panel);overflow-wrap:anywhere;min-height:1.6em;max-width:none}
.reading{grid-template-columns:repeat(auto-fill,minmax(140px,1fr));margin:.5rem 0 0}
.note{color:color-mix(in srgb,var(--vermillion) 75%,var(--ink));font-weight:600;margin:.4rem 0 0} .still{color:var(--muted);font-size:.92rem}
.ramp{display:flex;flex-wrap:wrap;align-items:center;gap:.5rem;margin-top:.4rem} .ramp i{width:180px;height:12px;border-radius:3px}
footer pre{white-space:pre-wrap}
#live fieldset{border:1px solid var(--rule);border-radius:8px;margin:.8rem 0;padding:.5rem 1rem .8rem} #live legend{font-weight:600;padding:0 .4rem}
#live .fields{display:grid;grid-template-columns:repeat(auto-fill,minmax(min(100%,410px),1fr));gap:.3rem 2rem} #live label>span{overflow-wrap:anywhere;min-width:0}
#live label{display:grid;grid-template-columns:1fr 9.5em 2.4em;gap:.5rem;align-items:center;font-size:.93rem} #live label.wide{display:grid;grid-template-columns:2em 1fr 9.5em 2.4em}
#live label.wide input[type=range]{width:100%;min-width:0;accent-color:var(--blue)}
#live input[type=number]{font:inherit;width:100%;padding:3px 6px;border:1px solid var(--rule);border-radius:5px;background:var(--ground);color:var(--ink);text-align:right;font-variant-numeric:tabular-nums}
#live .beyond{color:color-mix(in srgb,var(--vermillion) 75%,var(--ink));font-weight:600}
#live button{justify-self:start;font:inherit;min-height:30px;padding:2px 12px;border:1px solid var(--rule);border-radius:6px;background:var(--ground);color:var(--ink);cursor:pointer}
@media screen{
/* A picture that turns has a layer of its own, and figures out of sight are not painted with each of its frames. */
.live .stage{contain:strict;isolation:isolate;will-change:transform}
figure:not(.scene){content-visibility:auto;contain-intrinsic-height:auto 600px}
}
@media print{.live>.wide{display:block!important} .live .stage,.live .controls,.still,footer.licences{display:none!important}}
@media (max-width:640px){.live .stage{height:min(68vh,420px)} .slides{grid-template-columns:1fr} .slide{grid-template-columns:6.5em 1fr 5.8em} .bar button{padding:2px 6px}}
)";

/// Of UTF-8 text: bytes that do not go on with a character.
std::size_t characters(const std::string& text) {
  return static_cast<std::size_t>(
      std::count_if(text.begin(), text.end(), [](unsigned char c) { return (c & 0xC0) != 0x80; }));
}

const char* class_of(Verdict verdict) {
  return verdict == Verdict::good ? " good" : verdict == Verdict::bad ? " bad" : "";
}

/// Escaped, with leave to break a line after each slash: paths are long.
std::string breakable(const std::string& text) {
  std::string out;
  for (const char c : escape(text)) {
    out += c;
    if (c == '/') out += "<wbr>";
  }
  return out;
}

std::string definitions(const std::vector<std::pair<std::string, std::string>>& entries) {
  std::string out = "<dl>\n";
  for (const auto& [name, value] : entries) {
    out += fmt::format("<div><dt>{}</dt><dd>{}</dd></div>\n", escape(name), breakable(value));
  }
  return out + "</dl>\n";
}

}  // namespace

Report::Report(std::string title, std::string subtitle, std::vector<std::pair<std::string, std::string>> facts)
    : title_(std::move(title)), subtitle_(std::move(subtitle)), facts_(std::move(facts)) {}

std::string Report::next_id() {
  return fmt::format("p{}", ++pictures_);
}

void Report::add_section(const std::string& title) {
  if (in_section_) body_ += "</section>\n";
  in_section_ = true;
  sections_.push_back(title);
  body_ += fmt::format("<section id=\"s{}\">\n<h2>{}</h2>\n", sections_.size(), escape(title));
}

void Report::add_heading(const std::string& title) {
  body_ += fmt::format("<h3>{}</h3>\n", escape(title));
}

void Report::add_text(const std::string& paragraph) {
  body_ += fmt::format("<p>{}</p>\n", escape(paragraph));
}

void Report::add_verdict(Verdict verdict, const std::string& sentence) {
  // Colour alone does not carry the meaning: a word stands before the sentence, unless it begins with it.
  std::string_view word = verdict == Verdict::good ? "Yes." : verdict == Verdict::bad ? "No." : "", rest = sentence;
  if (!word.empty() && rest.starts_with(word.substr(0, word.size() - 1))) {
    const std::size_t end = rest.find_first_of(" ");
    const std::string_view own = rest.substr(0, end);
    if (own.size() == word.size() && std::string_view(".,:;").find(own.back()) != std::string_view::npos) {
      word = own;
      rest.remove_prefix(std::min(rest.size(), own.size() + 1));
    }
  }
  body_ += fmt::format("<p class=\"verdict{}\">{}{}</p>\n", class_of(verdict),
                       word.empty() ? "" : fmt::format("<strong>{}</strong>", word), escape(std::string(rest)));
}

void Report::add_list(const std::vector<std::string>& items) {
  if (items.empty()) return;
  body_ += "<ul>\n";
  for (const std::string& item : items) body_ += fmt::format("<li>{}</li>\n", escape(item));
  body_ += "</ul>\n";
}

void Report::add_links(const std::vector<std::pair<std::string, std::string>>& links) {
  if (links.empty()) return;
  body_ += "<ul>\n";
  for (const auto& [address, text] : links)
    body_ += fmt::format("<li><a href=\"{}\">{}</a></li>\n", escape(address), escape(text));
  body_ += "</ul>\n";
}

void Report::add_key_figures(const std::vector<KeyFigure>& figures) {
  if (figures.empty()) return;
  body_ += "<div class=\"cards\">\n";
  constexpr std::size_t kLong = 7;  // characters that fit into a card in the large type
  for (const KeyFigure& f : figures) {
    const bool is_long = characters(f.value) + characters(f.unit) > kLong;
    body_ += fmt::format("<div class=\"card{}\"><b{}>{}{}</b><span>{}</span></div>\n", class_of(f.verdict),
                         is_long ? " class=\"long\"" : "", escape(f.value),
                         f.unit.empty() ? "" : " <small>" + escape(f.unit) + "</small>", escape(f.label));
  }
  body_ += "</div>\n";
}

void Report::add_definitions(const std::vector<std::pair<std::string, std::string>>& entries) {
  if (!entries.empty()) body_ += definitions(entries);
}

void Report::add_table(const Table& table) {
  // A column is set to the right if it holds numbers only.
  std::vector<char> right(table.columns.size(), 0);
  for (std::size_t k = 0; k < table.columns.size(); ++k) {
    right[k] = std::any_of(table.rows.begin(), table.rows.end(),
                           [&](const auto& row) { return k < row.size() && std::holds_alternative<double>(row[k]); });
  }
  std::string out = "<div class=\"scroll\"><table>\n";
  if (!table.caption.empty() && !table.folded) out += fmt::format("<caption>{}</caption>\n", escape(table.caption));
  out += "<thead><tr>";
  for (std::size_t k = 0; k < table.columns.size(); ++k) {
    const Column& c = table.columns[k];
    out += fmt::format("<th{}>{}{}</th>", right[k] != 0 ? " class=\"r\"" : "", escape(c.title),
                       c.unit.empty() ? "" : "<small>" + escape(c.unit) + "</small>");
  }
  out += "</tr></thead>\n<tbody>\n";
  for (const auto& row : table.rows) {
    out += "<tr>";
    for (std::size_t k = 0; k < table.columns.size(); ++k) {
      std::string text;
      if (k < row.size()) {
        const double* value = std::get_if<double>(&row[k]);
        const int decimals = table.columns[k].decimals;
        text = value == nullptr ? escape(std::get<std::string>(row[k]))
               : decimals >= 0  ? fixed(*value, decimals)
                                : number(*value);
      }
      out += fmt::format("<td{}>{}</td>", right[k] != 0 ? " class=\"r\"" : "", text);
    }
    out += "</tr>\n";
  }
  out += "</tbody></table></div>\n";
  if (table.folded) {
    out = fmt::format("<details><summary>{}</summary>\n{}</details>\n",
                      escape(table.caption.empty() ? "Table" : table.caption), out);
  }
  body_ += out;
}

std::string script_sources(bool scenes, bool live) {
  return fmt::format("'sha256-{}'{}{}", viewer::page_sha256,
                     live ? fmt::format(" 'sha256-{}'", viewer::live_sha256) : "",
                     scenes ? fmt::format(" 'sha256-{}'", viewer::viewer_sha256) : "");
}

void Report::add_figure(const Figure& figure, const std::string& caption) {
  const std::string id = next_id();
  body_ += fmt::format(
      "<figure><div class=\"wide\">{}</div><div class=\"narrow\">{}</div>\n<figcaption>{}</figcaption></figure>\n",
      figure(Canvas{kWide, id}), figure(Canvas{kNarrow, id + "n", true}), escape(caption));
}

void Report::add_scene(const Scene& drawn, const std::string& caption, const Scene* turns) {
  if (POLYPOD_VIEWER == 0) {
    add_figure(drawn, caption);
    return;
  }
  const std::string id = next_id();
  const Scene& scene = turns != nullptr ? *turns : drawn;
  // Without a script, on paper and in browsers without WebGL the drawn picture stands; the script shows the canvas.
  body_ += fmt::format(
      "<figure class=\"scene\"><canvas data-scene=\"{}\"></canvas>\n"
      "<div class=\"wide\">{}</div><div class=\"narrow\">{}</div>\n"
      "<figcaption>{}<span class=\"how\"> Drag turns the picture; the wheel (after a click) or two fingers zoom; with "
      "shift a drag moves it.</span></figcaption>\n"
      "<script type=\"application/json\" class=\"scene-data\">{}</script></figure>\n",
      id, drawn(Canvas{kWide, id}), drawn(Canvas{kNarrow, id + "n", true}), escape(caption), scene_data(scene));
  ++scenes_;
}

void Report::make_live(const std::string& data) {
  std::string inert;  // in a page, whatever it holds
  for (const char c : data) inert += c == '<' ? std::string("\\u003c") : std::string(1, c);
  body_ +=
      fmt::format("<div id=\"live\"></div><script type=\"application/json\" id=\"live-data\">{}</script>\n", inert);
  live_ = true;
}

void Report::add_figure_grid(int columns, const std::vector<std::pair<std::string, Figure>>& panels,
                             const std::string& caption) {
  columns = std::clamp(columns, 1, 6);
  constexpr double kGap = 18;
  // One drawing serves both: a panel is about as wide as a telephone's page.
  const double width = std::max((kWide - kGap * (columns - 1)) / columns, 220.0);
  body_ += fmt::format("<figure><div class=\"panels\" style=\"grid-template-columns:repeat({},1fr)\">\n", columns);
  for (const auto& [title, figure] : panels) {
    body_ += fmt::format("<div>{}{}</div>\n", title.empty() ? "" : "<h4>" + escape(title) + "</h4>\n",
                         figure(Canvas{width, next_id()}));
  }
  body_ += fmt::format("</div>\n<figcaption>{}</figcaption></figure>\n", escape(caption));
}

void Report::add_code(const std::string& title, const std::string& text, bool folded) {
  const std::string code = fmt::format("<pre>{}</pre>\n", escape(text));
  if (folded) {
    body_ += fmt::format("<details><summary>{}</summary>\n{}</details>\n", escape(title), code);
  } else {
    body_ += fmt::format("<h3>{}</h3>\n{}", escape(title), code);
  }
}

std::string Report::to_html() const {
  std::string contents;
  if (sections_.size() > 1) {
    contents = "<nav>";
    for (std::size_t i = 0; i < sections_.size(); ++i) {
      contents += fmt::format("<a href=\"#s{}\">{}</a>\n", i + 1, escape(sections_[i]));
    }
    contents += "</nav>\n";
  }
  std::string page = "<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n";
  page += "<meta name=\"generator\" content=\"Polypod\">\n";
  // Nothing from anywhere, and no script but the ones that this program has put here.
  page += fmt::format(
      "<meta http-equiv=\"Content-Security-Policy\" content=\"default-src 'none'; script-src {}; style-src "
      "'unsafe-inline'; img-src data: blob:; base-uri 'none'; form-action 'none'{}\">\n",
      script_sources(scenes_ > 0, live_), live_ ? "; connect-src 'self'" : "");
  page += "<meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n";
  page += "<meta name=\"color-scheme\" content=\"light dark\">\n";
  page += fmt::format("<title>{}</title>\n<style>\n:root{{{}}}\n", escape(title_), svg::light_colours());
  page += fmt::format("@media screen and (prefers-color-scheme:dark){{:root{{{}}}}}\n", svg::dark_colours());
  page += svg::css();
  page += kPageCss;
  if (scenes_ > 0 || live_) page += kSceneCss;
  page += "</style>\n</head>\n<body>\n";
  page += fmt::format("<header class=\"top\">\n<h1>{}</h1>\n", escape(title_));
  if (!subtitle_.empty()) page += fmt::format("<p class=\"subtitle\">{}</p>\n", escape(subtitle_));
  if (!facts_.empty()) page += definitions(facts_);
  page += contents + "</header>\n<main>\n" + body_;
  if (in_section_) page += "</section>\n";
  page += "</main>\n";
  if (scenes_ > 0) {
    page += fmt::format(
        "<footer class=\"licences\"><details><summary>Licence of the script that turns the pictures</summary>\n"
        "<p>The script is part of Polypod (BSD-3-Clause) and holds three.js:</p><pre>{}</pre></details></footer>\n"
        "<script type=\"text/plain\" id=\"polypod-viewer\">{}</script>\n",
        escape(viewer::licences_txt), viewer::viewer_b64);
  }
  page += fmt::format("<script>{}</script>\n", viewer::page_js);
  if (live_) page += fmt::format("<script>{}</script>\n", viewer::live_js);
  page += "</body>\n</html>\n";
  return page;
}

}  // namespace polypod::report
