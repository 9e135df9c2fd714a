// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/pages/folder.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <filesystem>
#include <system_error>

#include "polypod/core/files.hpp"
#include "polypod/report/html.hpp"

namespace polypod::pages {
namespace {

constexpr std::string_view kGenerator = "<meta name=\"generator\" content=\"Polypod\">";
constexpr std::string_view kSubtitle = "The results in this folder, listed by polypod report";
constexpr std::uintmax_t kMostBytes = 64'000'000;  // of a page that is read
constexpr std::size_t kMostPicture = 250'000;      // bytes: a longer one is not copied

/// What stands between two marks, from `from` on; empty where they are not there.
std::string_view between(std::string_view text, std::string_view open, std::string_view close, std::size_t* from) {
  const std::size_t begin = text.find(open, *from);
  if (begin == std::string_view::npos) return {};
  const std::size_t end = text.find(close, begin + open.size());
  if (end == std::string_view::npos) return {};
  *from = end + close.size();
  return text.substr(begin + open.size(), end - begin - open.size());
}
std::string_view between(std::string_view text, std::string_view open, std::string_view close) {
  std::size_t from = 0;
  return between(text, open, close, &from);
}

/// The words of a piece of a page: without tags, character references resolved. Whoever wrote the page, what is shown
/// of it is escaped again.
std::string words(std::string_view html) {
  static constexpr std::array<std::pair<std::string_view, char>, 5> kReferences{
      {{"&lt;", '<'}, {"&gt;", '>'}, {"&quot;", '"'}, {"&#39;", '\''}, {"&amp;", '&'}}};
  std::string out;
  for (std::size_t i = 0; i < html.size();) {
    if (html[i] == '<') {
      const std::size_t end = html.find('>', i);
      if (!out.empty() && out.back() != ' ') out += ' ';
      if (end == std::string_view::npos) break;
      i = end + 1;
      continue;
    }
    const auto reference = std::find_if(kReferences.begin(), kReferences.end(),
                                        [&](const auto& r) { return html.substr(i).starts_with(r.first); });
    if (reference == kReferences.end()) {
      out += html[i++];
    } else {
      out += reference->second;
      i += reference->first.size();
    }
  }
  while (!out.empty() && out.back() == ' ') out.pop_back();
  return out;
}

/// As it may stand in an address, whatever it holds.
std::string percent_encoded(std::string_view text, std::string_view also_plain = "-_.~") {
  std::string out;
  for (const char c : text) {
    const auto byte = static_cast<unsigned char>(c);
    const bool plain = (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') ||
                       also_plain.find(c) != std::string_view::npos;
    out += plain ? std::string(1, c) : fmt::format("%{:02X}", byte);
  }
  return out;
}

/// The first picture of a page that is not too long, as a file of its own in an address: in an `img` it runs no script
/// and asks for nothing, whoever wrote the page.
std::string picture_of(std::string_view page) {
  // Where a page has a drawing for narrow screens, that one: its text can be read when it is small.
  std::string_view found;
  for (std::size_t at = 0; found.empty() && at < page.size();) {
    const std::string_view narrow = between(page, "<div class=\"narrow\"><svg class=\"pp\"", "</svg>", &at);
    if (narrow.empty()) break;
    if (narrow.size() <= kMostPicture) found = narrow;
  }
  for (std::size_t at = 0; found.empty() && at < page.size();) {
    const std::string_view any = between(page, "<svg class=\"pp\"", "</svg>", &at);
    if (any.empty()) break;
    if (any.size() <= kMostPicture) found = any;
  }
  if (found.empty()) return {};
  const std::string svg = fmt::format("<svg class=\"pp\"{}</svg>", found);
  return "data:image/svg+xml," +
         percent_encoded(report::standalone_svg([&](const report::Canvas&) { return svg; }), "-_.~ /:;,()!*'+{}");
}

/// A page in the index.
struct Card {
  std::string name, text;

  std::string operator()(const report::Canvas& /*canvas*/) const {
    const std::string title = words(between(text, "<title>", "</title>"));
    const std::string address = report::escape("./" + percent_encoded(name));
    std::string out = fmt::format("<h4><a href=\"{}\">{}</a></h4>\n<p>{}</p>\n", address,
                                  report::escape(title.empty() ? name : title), report::escape(name));
    if (const std::string picture = picture_of(text); !picture.empty()) {
      out += fmt::format(
          "<img alt=\"The first small picture of {}\" style=\"width:100%;height:200px;object-fit:contain\" "
          "src=\"{}\">\n",
          report::escape(name), picture);
    }
    std::size_t from = 0;
    if (const std::string_view verdict = between(text, "<p class=\"verdict", "</p>", &from); !verdict.empty()) {
      const std::string_view kind = verdict.substr(0, verdict.find('"'));
      const std::string_view of = kind == " good" || kind == " bad" ? kind : std::string_view{};
      const std::size_t begin = verdict.find('>');
      if (begin != std::string_view::npos)
        out += fmt::format("<p class=\"verdict{}\">{}</p>\n", of, report::escape(words(verdict.substr(begin + 1))));
    }
    from = 0;
    constexpr int kFigures = 3;
    for (int k = 0; k < kFigures; ++k) {
      const std::string_view figure = between(text, "<div class=\"card", "</div>", &from);
      const std::string_view value = between(figure, "<b", "</b>"), label = between(figure, "<span>", "</span>");
      const std::size_t begin = value.find('>');
      if (begin == std::string_view::npos || label.empty()) break;
      out += fmt::format("<p><b>{}</b> {}</p>\n", report::escape(words(value.substr(begin + 1))),
                         report::escape(words(label)));
    }
    return out;
  }
};

bool is_index(std::string_view page) {
  return page.find(kGenerator) != std::string_view::npos &&
         between(page, "<p class=\"subtitle\">", "</p>") == kSubtitle;
}

}  // namespace

Status may_be_page(const std::string& path) {
  std::error_code none;
  if (!std::filesystem::is_regular_file(path, none)) return {};
  POLYPOD_ASSIGN(text, files::read(path));
  if (text.find(kGenerator) != std::string::npos) return {};
  return fail("VW132", fmt::format("{} is there already, and is no page that Polypod has written", path), {},
              "name the page with -o");
}

Status may_be_index(const std::string& path) {
  std::error_code none;
  if (!std::filesystem::is_regular_file(path, none)) return {};
  POLYPOD_ASSIGN(text, files::read(path));
  if (is_index(text)) return {};
  return fail("VW132", fmt::format("{} is there already, and is no index that polypod report has written", path), {},
              "give the index another name with -o");
}

Result<FolderPage> folder_page(const std::string& folder, const std::string& leave_out, const std::string& version) {
  std::error_code wrong;
  std::filesystem::directory_iterator at(folder, wrong);
  if (wrong) {
    return fail("VW130", fmt::format("{} is no folder that can be read", folder), {},
                "name the folder that holds the pages of results");
  }
  std::vector<std::string> names;
  for (; !wrong && at != std::filesystem::directory_iterator(); at.increment(wrong)) {
    const std::string name = at->path().filename().string();
    std::error_code none;
    if (name == leave_out || name.starts_with('.') || at->is_symlink(none) || !at->is_regular_file(none)) continue;
    names.push_back(name);
  }
  std::sort(names.begin(), names.end());

  FolderPage out;
  std::vector<std::pair<std::string, report::Figure>> cards;
  for (const std::string& name : names) {
    const std::filesystem::path path = std::filesystem::path(folder) / name;
    std::error_code none;
    if ((name.ends_with(".html") || name.ends_with(".htm")) && std::filesystem::file_size(path, none) <= kMostBytes) {
      POLYPOD_ASSIGN(text, files::read(path.string()));
      if (is_index(text)) continue;
      // A page that was cut short is no result.
      if (text.find(kGenerator) != std::string::npos && text.find("</html>") != std::string::npos) {
        out.pages.push_back(name);
        cards.emplace_back("", Card{name, std::move(text)});
        continue;
      }
    }
    out.others.push_back(name);
  }
  if (out.pages.empty()) {
    return fail("VW131", fmt::format("{} holds no page that Polypod has written", folder), {},
                "write some with --report FILE.html; folders within it are not searched");
  }
  std::vector<std::pair<std::string, std::string>> facts{{"folder", folder},
                                                         {"pages", fmt::format("{}", out.pages.size())}};
  if (!version.empty()) facts.emplace_back("made with", "Polypod " + version);
  std::filesystem::path shown = std::filesystem::absolute(folder, wrong).lexically_normal();
  if (shown.filename().empty()) shown = shown.parent_path();
  report::Report page("Results in " + shown.filename().string(), std::string(kSubtitle), facts);
  page.add_section("Pages");
  constexpr int kColumns = 3;
  page.add_figure_grid(kColumns, cards,
                       "Titles, answers, figures and pictures are those of the pages when this list was written; "
                       "each page says what it answers for.");
  if (!out.others.empty()) {
    page.add_section("Other files");
    std::vector<std::pair<std::string, std::string>> links;
    for (const std::string& name : out.others) links.emplace_back("./" + percent_encoded(name), name);
    page.add_links(links);
  }
  out.html = page.to_html();
  return out;
}

}  // namespace polypod::pages
