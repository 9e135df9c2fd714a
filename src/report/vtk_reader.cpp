// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/report/vtk_reader.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <bit>
#include <charconv>
#include <cmath>
#include <cstring>
#include <limits>
#include <optional>

#include "polypod/core/text.hpp"
#include "polypod/core/xml.hpp"

namespace polypod::report {
namespace {

static_assert(std::endian::native == std::endian::little, "the bytes of VTK files are taken as they are");

constexpr std::size_t kMostPoints = 20'000'000, kMostNumbers = 60'000'000;
constexpr const char* kSaveAs =
    "save it anew: in ParaView with Data Mode ASCII, Binary or Appended and Compressor Type None";

using xml::Attribute;
using xml::Element;
using xml::shown;

std::string_view value_of(const Element& e, std::string_view key) {
  const Attribute* a = e.attribute(key);
  return a == nullptr ? std::string_view() : a->value;
}

/// Text with the five entities that XML has without a document type.
std::string unescaped(std::string_view text) {
  static constexpr std::array<std::pair<std::string_view, char>, 5> kEntities{
      {{"&lt;", '<'}, {"&gt;", '>'}, {"&quot;", '"'}, {"&apos;", '\''}, {"&amp;", '&'}}};
  std::string out;
  while (!text.empty()) {
    const auto* const entity =
        std::find_if(kEntities.begin(), kEntities.end(), [&](const auto& e) { return text.starts_with(e.first); });
    out += entity == kEntities.end() ? text.front() : entity->second;
    text.remove_prefix(entity == kEntities.end() ? 1 : entity->first.size());
  }
  return out;
}

/// The bytes of a text in base64; pieces that end in = may follow each other, as VTK writes counts and numbers.
/// Ends at the first character that is none, or behind `most` bytes.
std::string decoded(std::string_view text, std::size_t most) {
  constexpr std::string_view kSpace = " \t\r\n";
  std::array<std::int8_t, 256> digit{};
  digit.fill(-1);
  constexpr std::string_view kDigits = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
  for (std::size_t i = 0; i < kDigits.size(); ++i)
    digit[static_cast<unsigned char>(kDigits[i])] = static_cast<std::int8_t>(i);
  std::string out;
  std::uint32_t bits = 0;
  int count = 0;
  for (const char c : text) {
    if (out.size() >= most) break;
    if (kSpace.find(c) != std::string_view::npos) continue;
    if (c == '=') {
      count = 0;
      bits = 0;
      continue;
    }
    const int value = digit[static_cast<unsigned char>(c)];
    if (value < 0) break;
    bits = bits << 6U | static_cast<std::uint32_t>(value);
    count += 6;
    if (count < 8) continue;
    count -= 8;
    out += static_cast<char>(bits >> static_cast<unsigned>(count) & 0xFFU);
  }
  return out;
}

class Reader {
 public:
  Reader(std::string_view text, const std::string& path) : text_(text), path_(path) {}

  Result<VtkPolyData> run() {
    // Appended bytes may hold anything: what stands before them is the XML.
    std::string head;
    std::string_view xml = text_;
    if (const std::size_t at = text_.find("<AppendedData"); at != std::string_view::npos) {
      const std::string_view rest = text_.substr(at);
      const std::size_t tag = rest.find('>'), mark = rest.find('_', tag == std::string_view::npos ? 0 : tag);
      if (tag == std::string_view::npos || mark == std::string_view::npos)
        return fail("RE110", "the appended data have no beginning _", {path_}, kSaveAs);
      raw_ = rest.substr(0, tag).find("raw") != std::string_view::npos;
      appended_ = rest.substr(mark + 1);
      head = std::string(text_.substr(0, at)) + "</VTKFile>";
      xml = head;
    }
    constexpr int kDepth = 5;  // VTKFile, PolyData, Piece, Points, DataArray
    auto scanned = xml::scan(xml, path_, {text_.size() + head.size() + 1, kDepth});
    if (!scanned) return fail("RE110", "no VTK file: " + scanned.error().message, scanned.error().place, kSaveAs);
    elements_ = std::move(*scanned);
    const Element& root = elements_.front();
    if (root.name != "VTKFile" || value_of(root, "type") != "PolyData") {
      return fail("RE110",
                  fmt::format("it is <{}> of type \"{}\", not the PolyData of VTK", shown(root.name),
                              shown(value_of(root, "type"))),
                  place_of(root),
                  "surfaces and lines are shown: PolyData, .vtp; ParaView's filter Extract Surface makes them");
    }
    if (root.attribute("compressor") != nullptr)
      return fail("RE111", "its data are compressed", place_of(root), kSaveAs);
    if (value_of(root, "byte_order") == "BigEndian")
      return fail("RE111", "its numbers are big-endian", place_of(root), kSaveAs);
    wide_header_ = value_of(root, "header_type") == "UInt64";
    constexpr int kMostPieces = 1000;
    int pieces = 0;
    for (std::size_t i = 0; i < elements_.size(); ++i) {
      if (elements_[i].depth != 3 || elements_[i].name != "Piece") continue;
      if (++pieces > kMostPieces) return wrong(elements_[i], fmt::format("more than {} pieces", kMostPieces));
      POLYPOD_TRY(piece(static_cast<int>(i)));
    }
    // An array that only some of the pieces have belongs to none.
    std::erase_if(out_.arrays, [&](const VtkArray& a) {
      return a.values.size() != out_.points.size() * static_cast<std::size_t>(a.components);
    });
    return std::move(out_);
  }

 private:
  [[nodiscard]] Place place_of(const Element& e) const { return {path_, e.line, e.column}; }
  [[nodiscard]] tl::unexpected<Error> wrong(const Element& e, const std::string& what) const {
    return fail("RE110", what, place_of(e), kSaveAs);
  }

  Result<std::size_t> count_of(const Element& e, std::string_view key) const {
    const std::string_view text = value_of(e, key);
    std::size_t out = 0;
    if (text.empty()) return out;
    const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), out);
    if (error != std::errc() || end != text.data() + text.size() || out > kMostPoints)
      return wrong(e, fmt::format("{}=\"{}\": not a number up to {}", key, shown(text), kMostPoints));
    return out;
  }

  /// The first element of this name within another.
  const Element* within(int parent, std::string_view name, std::string_view array = {}) const {
    for (const Element& e : elements_) {
      if (e.parent == parent && e.name == name && (array.empty() || value_of(e, "Name") == array)) return &e;
    }
    return nullptr;
  }
  [[nodiscard]] int index_of(const Element* e) const { return static_cast<int>(e - elements_.data()); }

  /// The bytes that the header of an array announces.
  Result<std::string> bytes_of(const Element& e) const {
    const std::size_t header = wide_header_ ? sizeof(std::uint64_t) : sizeof(std::uint32_t);
    std::string_view from = e.content;
    bool raw = false;
    if (value_of(e, "format") == "appended") {
      const std::string_view text = value_of(e, "offset");
      std::size_t offset = 0;
      const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), offset);
      if (error != std::errc() || end != text.data() + text.size() || offset >= appended_.size())
        return wrong(e, fmt::format("offset=\"{}\" lies beyond the appended data", shown(text)));
      from = appended_.substr(offset);
      raw = raw_;
    }
    const auto take = [&](std::size_t count) {
      return raw ? std::string(from.substr(0, count)) : decoded(from, count);
    };
    const std::string begin = take(header);
    std::uint64_t size = 0;
    if (begin.size() < header) return wrong(e, "an array without its size");
    std::memcpy(&size, begin.data(), header);
    if (size > from.size()) return wrong(e, fmt::format("an array of {} bytes is cut short", size));
    std::string bytes = take(header + size);
    if (bytes.size() < header + size)
      return wrong(
          e, fmt::format("an array of {} bytes ends after {}", size, bytes.size() - std::min(bytes.size(), header)));
    return bytes.substr(header, size);
  }

  template <class Number>
  static std::vector<double> numbers(const std::string& bytes) {
    std::vector<double> out(bytes.size() / sizeof(Number));
    for (std::size_t i = 0; i < out.size(); ++i) {
      Number value{};
      std::memcpy(&value, bytes.data() + i * sizeof value, sizeof value);
      out[i] = static_cast<double>(value);
    }
    return out;
  }

  Result<std::vector<double>> from_text(const Element& e) const {
    std::vector<double> out;
    const char* at = e.content.data();
    const char* const end = at + e.content.size();
    while (true) {
      while (at != end && (*at == ' ' || *at == '\n' || *at == '\r' || *at == '\t' || *at == '+')) ++at;
      if (at == end) return out;
      double value = 0;
      const auto [next, error] = std::from_chars(at, end, value);
      if (error == std::errc::result_out_of_range) {
        const std::string_view word(at, static_cast<std::size_t>(next - at));
        value = word.find('-', 1) == std::string_view::npos ? std::numeric_limits<double>::infinity() : 0.0;
      }
      if (error == std::errc::invalid_argument || out.size() >= kMostNumbers) {
        return wrong(e,
                     fmt::format("{}: not a number", shown(std::string_view(at, static_cast<std::size_t>(end - at)))));
      }
      out.push_back(value);
      at = next;
    }
  }

  /// All numbers of an array, as doubles (integers beyond 2^53 are rounded).
  Result<std::vector<double>> numbers_of(const Element& e) const {
    const std::string_view format = value_of(e, "format"), type = value_of(e, "type");
    if (format == "ascii" || format.empty()) return from_text(e);
    if (format != "binary" && format != "appended")
      return wrong(e, fmt::format("format=\"{}\" is not known", shown(format)));
    POLYPOD_ASSIGN(bytes, bytes_of(e));
    if (type == "Float64") return numbers<double>(bytes);
    if (type == "Float32") return numbers<float>(bytes);
    if (type == "Int64") return numbers<std::int64_t>(bytes);
    if (type == "UInt64") return numbers<std::uint64_t>(bytes);
    if (type == "Int32") return numbers<std::int32_t>(bytes);
    if (type == "UInt32") return numbers<std::uint32_t>(bytes);
    if (type == "Int16") return numbers<std::int16_t>(bytes);
    if (type == "UInt16") return numbers<std::uint16_t>(bytes);
    if (type == "Int8") return numbers<std::int8_t>(bytes);
    if (type == "UInt8") return numbers<std::uint8_t>(bytes);
    return wrong(e, fmt::format("type=\"{}\" is not known", shown(type)));
  }

  Result<std::vector<std::vector<std::int64_t>>> cells(int piece, const char* name, const char* count_key,
                                                       std::size_t first, std::size_t points) {
    std::vector<std::vector<std::int64_t>> out;
    POLYPOD_ASSIGN(count, count_of(elements_[static_cast<std::size_t>(piece)], count_key));
    if (count == 0) return out;
    const Element* group = within(piece, name);
    const Element* connectivity = group == nullptr ? nullptr : within(index_of(group), "DataArray", "connectivity");
    const Element* offsets = group == nullptr ? nullptr : within(index_of(group), "DataArray", "offsets");
    if (connectivity == nullptr || offsets == nullptr)
      return wrong(elements_[static_cast<std::size_t>(piece)],
                   fmt::format("<{}> without connectivity and offsets", name));
    POLYPOD_ASSIGN(indices, numbers_of(*connectivity));
    POLYPOD_ASSIGN(ends, numbers_of(*offsets));
    if (ends.size() != count)
      return wrong(*offsets, fmt::format("{} offsets, but {}=\"{}\"", ends.size(), count_key, count));
    double begin = 0;
    for (const double end : ends) {
      if (!(end >= begin && end <= static_cast<double>(indices.size())))
        return wrong(*offsets, fmt::format("the offset {:g} behind {:g}, of {} indices", end, begin, indices.size()));
      std::vector<std::int64_t>& cell = out.emplace_back();
      for (auto i = static_cast<std::size_t>(begin); i < static_cast<std::size_t>(end); ++i) {
        if (!(indices[i] >= 0 && indices[i] < static_cast<double>(points)))
          return wrong(*connectivity,
                       fmt::format("a cell uses point {:g}, but there are {} points", indices[i], points));
        cell.push_back(static_cast<std::int64_t>(first) + static_cast<std::int64_t>(indices[i]));
      }
      begin = end;
    }
    return out;
  }

  Status piece(int at) {
    const Element& e = elements_[static_cast<std::size_t>(at)];
    POLYPOD_ASSIGN(points, count_of(e, "NumberOfPoints"));
    if (points == 0) return {};
    const std::size_t first = out_.points.size();
    if (first + points > kMostPoints) return wrong(e, fmt::format("more than {} points", kMostPoints));
    const Element* group = within(at, "Points");
    const Element* array = group == nullptr ? nullptr : within(index_of(group), "DataArray");
    if (array == nullptr) return wrong(e, "no <Points>");
    {
      POLYPOD_ASSIGN(xyz, numbers_of(*array));
      if (xyz.size() != 3 * points) return wrong(*array, fmt::format("{} numbers for {} points", xyz.size(), points));
      for (std::size_t i = 0; i < xyz.size(); i += 3) out_.points.push_back({xyz[i], xyz[i + 1], xyz[i + 2]});
    }
    POLYPOD_ASSIGN(lines, cells(at, "Lines", "NumberOfLines", first, points));
    std::move(lines.begin(), lines.end(), std::back_inserter(out_.lines));
    POLYPOD_ASSIGN(polygons, cells(at, "Polys", "NumberOfPolys", first, points));
    std::move(polygons.begin(), polygons.end(), std::back_inserter(out_.polygons));
    POLYPOD_ASSIGN(strips, cells(at, "Strips", "NumberOfStrips", first, points));
    for (const auto& strip : strips) {
      for (std::size_t i = 2; i < strip.size(); ++i) {
        const bool odd = i % 2 != 0;  // every other triangle of a strip is turned round
        out_.polygons.push_back({strip[i - 2], strip[odd ? i : i - 1], strip[odd ? i - 1 : i]});
      }
    }
    if (const Element* data = within(at, "PointData")) POLYPOD_TRY(point_data(index_of(data), first, points));
    return {};
  }

  Status point_data(int group, std::size_t first, std::size_t points) {
    for (const Element& e : elements_) {
      if (e.parent != group || e.name != "DataArray") continue;
      if (value_of(e, "type") == "String") continue;
      POLYPOD_ASSIGN(components, count_of(e, "NumberOfComponents"));
      components = std::max<std::size_t>(components, 1);
      POLYPOD_ASSIGN(values, numbers_of(e));
      if (values.size() != points * components) {
        return wrong(e,
                     fmt::format("array \"{}\" has {} numbers, but {} points of {} components need {}",
                                 shown(value_of(e, "Name")), values.size(), points, components, points * components));
      }
      const std::string name = unescaped(value_of(e, "Name"));
      auto known = std::find_if(out_.arrays.begin(), out_.arrays.end(), [&](const VtkArray& a) {
        return a.name == name && a.components == static_cast<int>(components) && a.values.size() == first * components;
      });
      if (known == out_.arrays.end()) {
        if (first > 0) continue;
        known = out_.arrays.insert(out_.arrays.end(), {name, static_cast<int>(components), {}});
      }
      known->values.insert(known->values.end(), values.begin(), values.end());
    }
    return {};
  }

  std::string_view text_, appended_;
  const std::string& path_;
  bool raw_ = false, wide_header_ = false;
  std::vector<Element> elements_;
  VtkPolyData out_;
};

}  // namespace

Result<VtkPolyData> read_vtp(std::string_view text, const std::string& path) {
  return Reader(text, path).run();
}

}  // namespace polypod::report
