// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/cell/rewrite.hpp"

#include "polypod/core/toml.hpp"
#include "reader.hpp"

namespace polypod::cell {
namespace {

std::string key_text(const std::string& key) {
  const bool bare = !key.empty() && std::all_of(key.begin(), key.end(), [](char c) {
    return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') || c == '_' || c == '-';
  });
  return bare ? key : quoted_toml(key);
}

std::string number_text(double value) {
  constexpr double kExact = 1e15;
  if (value == 0) return "0";  // not -0, which reads back as 0
  return value == std::floor(value) && std::abs(value) < kExact ? fmt::format("{:.0f}", value)
                                                                : fmt::format("{}", value);
}

/// What stands under a key.
struct Entry {
  std::optional<double> number;
  std::optional<std::string> text;
  std::optional<bool> boolean;
  std::optional<Table> table;
  std::optional<std::vector<Table>> tables;
  std::optional<std::vector<double>> numbers;
  std::optional<std::vector<std::string>> texts;
  std::optional<std::vector<std::vector<double>>> points;
};

Result<Entry> entry_of(const Table& t, const std::string& key) {
  Entry out;
  if (t.holds_text(key)) {
    POLYPOD_ASSIGN(text, t.text(key));
    out.text = text;
    return out;
  }
  if (const auto number = t.number(key)) {
    out.number = *number;
  } else if (number.error().id != "CF104") {
    return tl::unexpected(number.error());
  } else if (const auto boolean = t.optional_boolean(key, false)) {
    out.boolean = *boolean;
  } else if (const auto table = t.table(key)) {
    out.table = *table;
  } else if (const auto tables = t.tables(key)) {
    out.tables = *tables;
  } else if (const auto texts = t.optional_texts(key)) {
    out.texts = *texts;
  } else {
    POLYPOD_ASSIGN(numbers, t.numbers(key));
    out.numbers = numbers;
  }
  return out;
}

class Writer {
 public:
  explicit Writer(const std::string& file) : file_(file) {}

  Status table(const Table& t, const std::string& header) {
    const bool machine = header == "[[machine]]";
    std::vector<std::pair<std::string, Entry>> inner;
    if (machine) POLYPOD_TRY(model(t));
    for (const std::string& key : t.keys()) {
      if (machine && (key == "model" || key == "file" || key == "set")) continue;
      POLYPOD_ASSIGN(entry, entry_of(t, key));
      if (entry.table || (entry.tables && !entry.tables->empty() && header.empty())) {
        inner.emplace_back(key, std::move(entry));
        continue;
      }
      POLYPOD_ASSIGN(text, inline_text(entry));
      out += fmt::format("{} = {}\n", key_text(key), text);
    }
    for (const auto& [key, entry] : inner) {
      if (entry.table) {
        if (!header.empty()) {
          POLYPOD_ASSIGN(text, inline_text(entry));
          out += fmt::format("{} = {}\n", key_text(key), text);
          continue;
        }
        const std::string name = fmt::format("[{}]", key_text(key));
        out += fmt::format("\n{}\n", name);
        POLYPOD_TRY(table(*entry.table, name));
        continue;
      }
      for (const Table& one : *entry.tables) {
        const std::string name = fmt::format("[[{}]]", key_text(key));
        out += fmt::format("\n{}\n", name);
        POLYPOD_TRY(table(one, name));
      }
    }
    return {};
  }

  std::string out;

 private:
  static Result<std::string> inline_text(const Entry& e) {
    if (e.text) return quoted_toml(*e.text);
    if (e.number) return number_text(*e.number);
    if (e.boolean) return std::string(*e.boolean ? "true" : "false");
    std::string list;
    const auto add = [&](const std::string& text) { list += (list.empty() ? "" : ", ") + text; };
    if (e.table) {
      POLYPOD_ASSIGN(text, braces(*e.table));
      return text;
    }
    if (e.texts)
      for (const std::string& text : *e.texts) add(quoted_toml(text));
    if (e.numbers)
      for (const double x : *e.numbers) add(number_text(x));
    if (e.tables) {
      for (const Table& t : *e.tables) {
        POLYPOD_ASSIGN(text, braces(t));
        add(text);
      }
    }
    return "[" + list + "]";
  }

  static Result<std::string> braces(const Table& t) {
    std::string list;
    for (const std::string& key : t.keys()) {
      POLYPOD_ASSIGN(entry, entry_of(t, key));
      POLYPOD_ASSIGN(text, inline_text(entry));
      list += fmt::format("{}{} = {}", list.empty() ? "" : ", ", key_text(key), text);
    }
    return "{" + list + "}";
  }

  /// The machine of a table as the text of its file.
  Status model(const Table& t) {
    POLYPOD_ASSIGN(made, machine_of(t, file_));
    const std::string text = machine::to_toml(made);
    // On lines of its own where it can stand as it is: no closing quotes, no other control characters.
    std::string flat = text;
    std::erase(flat, '\n');
    const bool plain = text.find("'''") == std::string::npos && quoted_toml(flat).find("\\u") == std::string::npos;
    out += fmt::format("model = {}\n", plain ? "'''\n" + text + "'''" : quoted_toml(text));
    return {};
  }

  const std::string& file_;
};

void collect(const Table& t, const std::string& key, const std::string& counted, std::vector<CellNumber>& out) {
  const auto inside = [](const std::string& of, const std::string& name) {
    return of.empty() ? name : of + "." + name;
  };
  for (const std::string& name : t.keys()) {
    const auto entry = entry_of(t, name);
    if (!entry) continue;
    const std::string here = inside(key, name), there = inside(counted, name);
    if (entry->number) out.push_back({here, there, *entry->number});
    if (entry->table) collect(*entry->table, here, there, out);
    if (entry->numbers) {
      for (std::size_t i = 0; i < entry->numbers->size(); ++i) {
        const std::string index = fmt::format("[{}]", i + 1);
        out.push_back({here + index, there + index, (*entry->numbers)[i]});
      }
    }
    if (!entry->tables) continue;
    for (std::size_t i = 0; i < entry->tables->size(); ++i) {
      const Table& one = (*entry->tables)[i];
      const std::string index = fmt::format("[{}]", i + 1);
      const auto own = key.empty() && one.holds_text("name") ? one.text("name") : Result<std::string>(std::string());
      collect(one, own && !own->empty() ? here + "." + *own : here + index, there + index, out);
    }
  }
}

}  // namespace

Result<std::string> self_contained(std::string_view toml, const std::string& file,
                                   const std::vector<Override>& overrides) {
  POLYPOD_ASSIGN(top, config::parse(toml, file));
  POLYPOD_TRY(override_numbers(top, overrides));
  Writer writer(file);
  POLYPOD_TRY(writer.table(top, ""));
  return std::move(writer.out);
}

std::vector<CellNumber> numbers_of(std::string_view toml) {
  std::vector<CellNumber> out;
  if (const auto top = config::parse(toml, "cell")) collect(*top, "", "", out);
  return out;
}

std::optional<double> number_at(std::string_view toml, const std::string& key) {
  const auto top = config::parse(toml, "cell");
  if (!top) return {};
  const std::string counted = by_number(*top, key);
  std::vector<CellNumber> all;
  collect(*top, "", "", all);
  for (const CellNumber& n : all)
    if (n.counted == counted) return n.value;
  return {};
}

std::string counted_key(std::string_view toml, const std::string& key) {
  const auto top = config::parse(toml, "cell");
  return top ? by_number(*top, key) : key;
}

}  // namespace polypod::cell
