// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// A stock as a file, so that one program can begin with what another one left.
#include <fmt/format.h>

#include <bit>
#include <cmath>
#include <cstdint>
#include <cstring>

#include "polypod/core/files.hpp"
#include "polypod/cutting/stock.hpp"

namespace polypod::cutting {
namespace {

static_assert(std::endian::native == std::endian::little, "stock files are little-endian");

constexpr char kMagic[8] = {'P', 'O', 'L', 'Y', 'S', 'T', 'O', 'K'};
constexpr std::uint32_t kSolid = 1, kHollow = 2;  // versions: with one height a layer, or two

struct Header {
  char magic[8];
  std::uint32_t version;
  std::int32_t columns, rows;
  std::int32_t layers;
  double x_min, y_min, cell, bottom, top;
};
static_assert(sizeof(Header) == 64);

std::uint64_t fnv1a(std::string_view bytes) {
  std::uint64_t hash = 14695981039346656037ull;
  for (const char c : bytes) hash = (hash ^ static_cast<unsigned char>(c)) * 1099511628211ull;
  return hash;
}

}  // namespace

std::string stock_bytes(const Stock& stock) {
  Header header{};
  std::memcpy(header.magic, kMagic, sizeof kMagic);
  header.version = stock.hollow() == nullptr ? kSolid : kHollow;
  header.columns = stock.columns();
  header.rows = stock.rows();
  header.layers = Stock::kLayers;
  header.x_min = stock.x_min();
  header.y_min = stock.y_min();
  header.cell = stock.cell();
  header.bottom = stock.bottom();
  header.top = stock.top();
  std::string bytes(reinterpret_cast<const char*>(&header), sizeof header);
  for (const Stock* map : {&stock, stock.hollow()}) {
    if (map == nullptr) continue;
    bytes.append(reinterpret_cast<const char*>(map->layers().data()), map->layers().size() * sizeof(float));
  }
  const std::uint64_t hash = fnv1a(bytes);
  bytes.append(reinterpret_cast<const char*>(&hash), sizeof hash);
  return bytes;
}

Status write_stock(const Stock& stock, const std::string& path) {
  return files::write_whole(path, stock_bytes(stock));
}

Result<Stock> read_stock(const std::string& path) {
  POLYPOD_ASSIGN(bytes, files::read(path));
  const Place place{path, 0, 0};
  const std::string again = "write it again with the program that made it";
  if (bytes.size() < sizeof kMagic || std::memcmp(bytes.data(), kMagic, sizeof kMagic) != 0) {
    return fail("CT120", "this is not a stock file", place, "give a file that an earlier run wrote as its stock");
  }
  Header header{};
  if (bytes.size() < sizeof header) {
    return fail("CT121", fmt::format("the stock file ends after {} bytes, within its header", bytes.size()), place,
                again);
  }
  std::memcpy(&header, bytes.data(), sizeof header);
  if (header.version != kSolid && header.version != kHollow) {
    return fail(
        "CT122",
        fmt::format("the stock file has version {}; this program reads {} and {}", header.version, kSolid, kHollow),
        place, again);
  }
  if (header.columns < 1 || header.rows < 1) {
    return fail("CT123", fmt::format("the stock file is damaged: {} by {} cells", header.columns, header.rows), place,
                again);
  }
  if (header.layers != Stock::kLayers) {
    return fail("CT122",
                fmt::format("the stock file has {} layers a cell; this program uses {}", header.layers, Stock::kLayers),
                place, again);
  }
  // Whole numbers below 2^31: their product with 32 bytes fits in 64 bits only if checked first.
  const std::size_t cells = static_cast<std::size_t>(header.columns) * static_cast<std::size_t>(header.rows);
  if (cells > bytes.size()) {
    return fail("CT121",
                fmt::format("the stock file has {} bytes, too few for {} by {} cells", bytes.size(), header.columns,
                            header.rows),
                place, again);
  }
  const std::size_t count = cells * Stock::kLayers;
  const std::size_t expected = sizeof header + header.version * count * sizeof(float) + sizeof(std::uint64_t);
  if (bytes.size() != expected) {
    return fail("CT121",
                fmt::format("the stock file has {} bytes, but {} by {} cells need {}", bytes.size(), header.columns,
                            header.rows, expected),
                place, again);
  }
  std::uint64_t hash = 0;
  std::memcpy(&hash, bytes.data() + expected - sizeof hash, sizeof hash);
  if (hash != fnv1a(std::string_view(bytes).substr(0, expected - sizeof hash))) {
    return fail("CT123", "the stock file is damaged: its checksum does not fit", place, again);
  }
  std::vector<float> layers(count), hollow(header.version == kHollow ? count : 0);
  const char* heights = bytes.data() + sizeof header;
  std::memcpy(layers.data(), heights, count * sizeof(float));
  if (!hollow.empty()) std::memcpy(hollow.data(), heights + count * sizeof(float), count * sizeof(float));
  auto stock = Stock::from_layers(header.x_min, header.y_min, header.cell, header.columns, header.rows, header.bottom,
                                  header.top, std::move(layers), std::move(hollow));
  if (!stock) stock.error().place = place;
  return stock;
}

}  // namespace polypod::cutting
