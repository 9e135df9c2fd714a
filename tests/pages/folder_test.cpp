// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// The index of a folder of results: what it copies, and what it does with pages that mean harm.
#include "polypod/pages/folder.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>

#include "polypod/report/html.hpp"
#include "report/markup.hpp"

namespace polypod::pages {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::Not;

class Folder : public ::testing::Test {
 protected:
  void SetUp() override {
    folder_ =
        ::testing::TempDir() + "/polypod-folder-" + ::testing::UnitTest::GetInstance()->current_test_info()->name();
    std::filesystem::remove_all(folder_);
    std::filesystem::create_directory(folder_);
  }
  void TearDown() override { std::filesystem::remove_all(folder_); }
  void put(const std::string& name, const std::string& text) { std::ofstream(folder_ + "/" + name) << text; }
  static std::string page(const std::string& title) {
    report::Report out(title, "What it is");
    out.add_verdict(report::Verdict::bad, "No. It does not fit: 3 < 4.");
    out.add_key_figures({{"41.5", "um", "largest error"}, {"7", "", "places"}});
    report::LinePlot chart;
    chart.title = "A curve";
    chart.series.push_back({"c", {0, 1}, {0, 2}});
    out.add_figure(chart, "A curve.");
    return out.to_html();
  }
  std::string folder_;
};

TEST_F(Folder, ListsPagesWithTheirAnswersFiguresAndPictures) {
  put("b.html", page("Second"));
  put("a part.html", page("First <of> \"two\""));
  put("x.csv", "1");
  put("foreign.html", "<title>no page of ours</title>");
  put(".hidden.html", page("Hidden"));
  const auto found = folder_page(folder_, "index.html", "1");
  ASSERT_TRUE(found) << found.error().message;
  EXPECT_THAT(found->pages, ElementsAre("a part.html", "b.html"));
  EXPECT_THAT(found->others, ElementsAre("foreign.html", "x.csv"));
  EXPECT_EQ(report::what_is_wrong(found->html), "");
  EXPECT_THAT(found->html, HasSubstr("<a href=\"./a%20part.html\">First &lt;of&gt; &quot;two&quot;</a>"));
  EXPECT_THAT(found->html, HasSubstr("<p class=\"verdict bad\">No. It does not fit: 3 &lt; 4.</p>"));
  EXPECT_THAT(found->html, HasSubstr("<b>41.5 um</b> largest error"));
  EXPECT_EQ(report::count_of(found->html, "src=\"data:image/svg+xml,"), 2);
  // The index is not listed in the next one, and may be written again; a page may not be written over.
  put("index.html", found->html);
  EXPECT_THAT(folder_page(folder_, "other.html", "1")->pages, ElementsAre("a part.html", "b.html"));
  EXPECT_TRUE(may_be_index(folder_ + "/index.html"));
  EXPECT_TRUE(may_be_index(folder_ + "/new.html"));
  EXPECT_EQ(may_be_index(folder_ + "/b.html").error().id, "VW132");
  EXPECT_EQ(may_be_index(folder_ + "/x.csv").error().id, "VW132");
}

TEST_F(Folder, WhatAPageHoldsStaysText) {
  put("javascript:alert(1).html",
      "<meta name=\"generator\" content=\"Polypod\"><title>&lt;script&gt;evil()&lt;/script&gt;</title>"
      "<p class=\"verdict\" onclick=\"evil()\"><script>evil()</script>bad</p>"
      "<div class=\"card\"><b><img src=x onerror=evil()>9</b><span><a href=\"http://x.example\">l</a></span></div>"
      "<svg class=\"pp\" onload=\"evil()\"><script>evil()</script></svg></html>");
  const auto found = folder_page(folder_, "index.html", "");
  ASSERT_TRUE(found) << found.error().message;
  EXPECT_EQ(report::what_is_wrong(found->html), "");
  for (const char* bad :
       {"<script>evil", "onclick=\"", "onerror=evil", "onload=\"", "href=\"http", "href=\"javascript"})
    EXPECT_THAT(found->html, Not(HasSubstr(bad)));
  EXPECT_THAT(found->html, HasSubstr("href=\"./javascript%3Aalert%281%29.html\""));
}

TEST_F(Folder, BearsDamagedPages) {
  const std::string whole = page("Whole");
  for (std::size_t length = 0; length < whole.size(); length += 97) {
    put("cut.html", whole.substr(0, length));
    put("whole.html", whole);
    const auto found = folder_page(folder_, "index.html", "");
    ASSERT_TRUE(found);
    EXPECT_EQ(report::what_is_wrong(found->html), "") << length;
  }
}

TEST_F(Folder, SaysWhatItDoesNotList) {
  EXPECT_EQ(folder_page(folder_ + "/none", "", "").error().id, "VW130");
  EXPECT_EQ(folder_page(folder_, "", "").error().id, "VW131");
  put("a.html", page("A"));
  EXPECT_EQ(folder_page(folder_ + "/a.html", "", "").error().id, "VW130");
  std::filesystem::create_symlink("/etc/hostname", folder_ + "/link.html");
  const auto found = folder_page(folder_, "", "");
  ASSERT_TRUE(found);
  EXPECT_THAT(found->html, Not(HasSubstr("link.html"))) << "a link may lead out of the folder";
}

// A page that was cut short is no result, and what is no page of ours is not written over unasked.
TEST_F(Folder, PagesAreWhole) {
  put("whole.html", page("Whole"));
  put("cut.html", page("Cut").substr(0, 2000));
  put("mine.html", "mine");
  const auto found = folder_page(folder_, "index.html", "1");
  ASSERT_TRUE(found);
  EXPECT_THAT(found->pages, ElementsAre("whole.html"));
  EXPECT_THAT(found->others, ElementsAre("cut.html", "mine.html"));
  EXPECT_TRUE(may_be_page(folder_ + "/whole.html"));
  EXPECT_TRUE(may_be_page(folder_ + "/new.html"));
  EXPECT_EQ(may_be_page(folder_ + "/mine.html").error().id, "VW132");
}

}  // namespace
}  // namespace polypod::pages
