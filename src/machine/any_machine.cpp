// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/machine/any_machine.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <concepts>
#include <filesystem>
#include <set>

#include "arm_table.hpp"
#include "machine_file.hpp"
#include "polypod/core/files.hpp"
#include "polypod/core/nearest_word.hpp"
#include "polypod/core/toml.hpp"
#include "polypod/core/units.hpp"
#include "polypod/machine/urdf.hpp"
#include "polypod/machine/whole_table.hpp"

namespace polypod::machine {

Status read_common(const config::Table& table, std::string& name, std::string& description, Provenance& provenance) {
  POLYPOD_ASSIGN(family, table.text("family"));
  POLYPOD_ASSIGN(n, table.optional_text("name", family));
  POLYPOD_ASSIGN(d, table.optional_text("description", ""));
  POLYPOD_ASSIGN(sources, table.optional_table("provenance"));
  name = n;
  description = d;
  if (!sources) return {};
  for (const std::string& key : sources->keys()) {
    POLYPOD_ASSIGN(text, sources->text(key));
    provenance[key] = text;
  }
  return sources->finish();
}

Result<Pose> read_frame(const config::Table& table, const std::string& key) {
  POLYPOD_ASSIGN(frame, table.optional_table(key));
  if (!frame) return Pose{};
  POLYPOD_ASSIGN(x, frame->optional_number("x_mm", 0));
  POLYPOD_ASSIGN(y, frame->optional_number("y_mm", 0));
  POLYPOD_ASSIGN(z, frame->optional_number("z_mm", 0));
  POLYPOD_ASSIGN(a, frame->optional_number("a_deg", 0));
  POLYPOD_ASSIGN(b, frame->optional_number("b_deg", 0));
  POLYPOD_ASSIGN(c, frame->optional_number("c_deg", 0));
  POLYPOD_TRY(frame->finish());
  return Pose{rotation_abc(units::from_deg(a), units::from_deg(b), units::from_deg(c)),
              {units::from_mm(x), units::from_mm(y), units::from_mm(z)}};
}

Result<double> speed_of(const config::Table& table, bool turns) {
  const char* key = turns ? "speed_deg_per_s" : "speed_mm_per_s";
  if (!table.has(key)) return 0.0;
  POLYPOD_ASSIGN(speed, table.number(key, {0, 1e6, true}));
  return turns ? units::from_deg(speed) : units::from_mm(speed);
}

Result<Task> read_task(const config::Table& table, Task otherwise) {
  constexpr const char* kRule = "must be \"pose\", \"axis\", \"point\" or a list of x, y, z, A, B, C";
  if (!table.has("task")) return otherwise;
  if (table.holds_text("task")) {
    POLYPOD_ASSIGN(name, table.text("task"));
    if (name == "pose") return Task::pose;
    if (name == "axis") return Task::axis;
    if (name == "point") return Task::point;
    return fail("MA119", fmt::format("task = \"{}\" {}", name, kRule), table.place_of("task"));
  }
  POLYPOD_ASSIGN(names, table.optional_texts("task"));
  Task out;
  for (const std::string& name : names) {
    bool known = false;
    for (int k = 0; k < 6; ++k) {
      const auto c = static_cast<Coordinate>(k);
      if (name != name_of(c) && !(k >= 3 && name.size() == 1 && name[0] == "abc"[k - 3])) continue;
      if (out.holds(c)) {
        return fail("MA119", fmt::format("task names {} twice", name_of(c)), table.place_of("task"));
      }
      out.push_back(c);
      known = true;
    }
    if (!known) return fail("MA119", fmt::format("task holds \"{}\", but {}", name, kRule), table.place_of("task"));
  }
  if (out.size() == 0) return fail("MA119", "task is empty", table.place_of("task"), kRule);
  return out;
}

std::string task_toml(Task task) {
  std::string out;
  for (int i = 0; i < task.size(); ++i) out += fmt::format("{}\"{}\"", i > 0 ? ", " : "", name_of(task[i]));
  return fmt::format("task = [{}]\n", out);
}

namespace {
constexpr std::array<const char*, 3> kLowKeys{"x_min_mm", "y_min_mm", "z_min_mm"},
    kHighKeys{"x_max_mm", "y_max_mm", "z_max_mm"};
}  // namespace

Status read_tip_limits(const config::Table& table, TipLimits& limits) {
  POLYPOD_ASSIGN(part, table.optional_table("limits"));
  if (!part) return {};
  for (std::size_t k = 0; k < 3; ++k) {
    const auto axis = static_cast<Eigen::Index>(k);
    for (const bool upper : {false, true}) {
      const char* key = upper ? kHighKeys[k] : kLowKeys[k];
      if (!part->has(key)) continue;
      POLYPOD_ASSIGN(value, part->number(key));
      (upper ? limits.high : limits.low)[axis] = units::from_mm(value);
    }
    if (!(limits.low[axis] < limits.high[axis])) {
      return fail("MA142",
                  fmt::format("limits: {} = {:g} is not below {} = {:g}", kLowKeys[k], units::to_mm(limits.low[axis]),
                              kHighKeys[k], units::to_mm(limits.high[axis])),
                  part->place_of(kHighKeys[k]));
    }
  }
  return part->finish();
}

std::string tip_limits_toml(const TipLimits& limits) {
  std::string out;
  for (std::size_t k = 0; k < 3; ++k) {
    for (const bool upper : {false, true}) {
      const double value = (upper ? limits.high : limits.low)[static_cast<Eigen::Index>(k)];
      if (!std::isfinite(value)) continue;
      out += fmt::format("{}{} = {}", out.empty() ? "" : ", ", upper ? kHighKeys[k] : kLowKeys[k],
                         number_toml(units::to_mm(value)));
    }
  }
  return out.empty() ? out : fmt::format("limits = {{ {} }}\n", out);
}

void push_tip_limits(std::vector<Parameter>& out, const TipLimits& limits) {
  for (int k = 0; k < 3; ++k) {
    if (std::isfinite(limits.low[k])) out.push_back({fmt::format("limits.{}_min", "xyz"[k]), limits.low[k], "mm"});
    if (std::isfinite(limits.high[k])) out.push_back({fmt::format("limits.{}_max", "xyz"[k]), limits.high[k], "mm"});
  }
}

std::string number_toml(double value) {
  const std::string rounded = fmt::format("{:.12g}", value);
  double again = 0;  // what is below the smallest normal number is refused by std::stod, not by this
  std::from_chars(rounded.data(), rounded.data() + rounded.size(), again);
  const std::string text = std::abs(again - value) <= 1e-12 * std::abs(value) ? rounded : fmt::format("{}", value);
  return text == "-0" ? "0" : text;
}

std::string common_toml(const std::string& name, const std::string& family, const std::string& description) {
  std::string out = fmt::format("name = {}\nfamily = \"{}\"\n", quoted_toml(name), family);
  if (!description.empty()) out += fmt::format("description = {}\n", quoted_toml(description));
  return out;
}

std::string frame_toml(const std::string& key, const Pose& X) {
  const Vec3 abc = angles_abc(X.R);
  if (X.p.isZero(0) && abc.norm() < 1e-15) return "";
  return fmt::format("{} = {{ x_mm = {}, y_mm = {}, z_mm = {}, a_deg = {}, b_deg = {}, c_deg = {} }}\n", key,
                     number_toml(units::to_mm(X.p.x())), number_toml(units::to_mm(X.p.y())),
                     number_toml(units::to_mm(X.p.z())), number_toml(units::to_deg(abc.x())),
                     number_toml(units::to_deg(abc.y())), number_toml(units::to_deg(abc.z())));
}

std::string provenance_toml(const Provenance& provenance) {
  if (provenance.empty()) return "";
  std::string out = "\n[provenance]\n";
  for (const auto& [key, text] : provenance) out += fmt::format("{} = {}\n", quoted_toml(key), quoted_toml(text));
  return out;
}

namespace {

Result<double> number_of(const Override& override_) {
  double value = 0;
  const char* begin = override_.value.data();
  const char* end = begin + override_.value.size();
  if (begin != end && *begin == '+') ++begin;
  const auto [rest, code] = std::from_chars(begin, end, value);
  if (code != std::errc{} || rest != end || !std::isfinite(value)) {
    return fail("MA103", fmt::format("{}={}: the value is not a finite number", override_.key, override_.value),
                Place{"--set", 0, 0}, "write --set key=number");
  }
  return value;
}

tl::unexpected<Error> unknown(const std::string& key) {
  return fail("MA102", fmt::format("unknown parameter {}", key), Place{"--set", 0, 0},
              "`polypod info MACHINE` lists the parameters");
}

/// "base.joint[3].x_mm" -> "base.joint[].x_mm".
std::string without_indices(const std::string& key) {
  std::string out;
  bool inside = false;
  for (const char c : key) {
    inside = inside && c != ']';
    if (!inside) out += c;
    inside = inside || c == '[';
  }
  return out;
}

/// The machine that the first family of this name reads.
template <class... F>
Result<AnyMachine> read_as(FamilyList<F...>, const std::string& family, const config::Table& table) {
  Result<AnyMachine> out = AnyMachine();
  std::vector<std::string> known;
  const auto attempt = [&]<class M>(std::type_identity<M>) {
    if constexpr (requires { M::reads(family); }) {
      for (const std::string& name : M::families()) known.push_back(name);
      if (!M::reads(family)) return false;
    } else {
      known.emplace_back(M::kFamily);
      if (family != M::kFamily) return false;
    }
    out = M::from(table).map([](M&& m) { return AnyMachine(std::move(m)); });
    return true;
  };
  if ((attempt(std::type_identity<F>{}) || ...)) return out;
  return fail("MA101", fmt::format("unknown family \"{}\"", family), table.place_of("family"),
              fmt::format("known: {}", fmt::join(known, ", ")));
}

/// The table of a machine by its text: that of a TOML file, or of the arm that a URDF file describes.
Result<config::Table> read_table(std::string_view text, const std::string& name) {
  if (!is_urdf(text, name)) return config::parse(text, name);
  POLYPOD_ASSIGN(arm, arm_from_urdf(text, name));
  return table_of(arm, {urdf_name(name).file, 0, 0});
}

/// The table of a machine that a file names: another file, found from the folder of `from`, or a catalogue machine.
/// What is no file itself, as a machine of the catalogue, names machines of the catalogue alone.
Result<config::Table> named_machine(const std::string& name, const Place& from) {
  const std::string path = config::beside(from.file, name);
  std::error_code ec;
  const bool of_file = files::is_standard_input(from.file) || std::filesystem::exists(from.file, ec);
  if (of_file && std::filesystem::is_regular_file(file_of_machine(path), ec)) {
    POLYPOD_ASSIGN(text, files::read(file_of_machine(path)));
    return read_table(text, path);
  }
  for (const CatalogueEntry& entry : catalogue())
    if (entry.name == name) return config::parse(entry.toml, name + ".toml");
  return fail("MA100", fmt::format("no machine file or catalogue machine \"{}\"", name), from,
              "give a path from the folder of this file, or a name of `polypod machines`");
}

/// Stages that name their machine hold its table instead, so that all that follows sees one file.
Status put_named_machines(config::Table& table) {
  POLYPOD_ASSIGN(family, table.text("family"));
  if (family != Stages::kFamily) return {};
  POLYPOD_ASSIGN(stages, table.tables("stage"));
  for (std::size_t k = 0; k < stages.size(); ++k) {
    if (!stages[k].holds_text("machine")) continue;
    POLYPOD_ASSIGN(name, stages[k].text("machine"));
    POLYPOD_ASSIGN(machine, named_machine(name, stages[k].place_of("machine")));
    table.put(fmt::format("stage[{}].machine", k + 1), machine);
  }
  return {};
}

/// The table of a machine file, whole.
Result<config::Table> table_from(std::string_view toml, const std::string& file_name) {
  POLYPOD_ASSIGN(table, read_table(toml, file_name));
  POLYPOD_TRY(put_named_machines(table));
  return table;
}

std::vector<Parameter> parameters_of(const AnyMachine& machine) {
  return std::visit([](const auto& m) { return parameters(m); }, machine);
}

/// Which keys of overrides are figures of a machine, and which of these are not keys of its file.
class Figures {
 public:
  /// None where the file gives no machine by itself: then every key is one of the file.
  explicit Figures(const Result<AnyMachine>& nominal) {
    if (!nominal) return;
    for (const Parameter& p : settings(*nominal)) settings_.insert(key_of(p));
    std::visit(
        [&]<class M>(const M&) {
          if constexpr (std::derived_from<M, TipLimits>) {  // they may be set where the file gives none
            for (const char* key : kLowKeys) settings_.insert(fmt::format("limits.{}", key));
            for (const char* key : kHighKeys) settings_.insert(fmt::format("limits.{}", key));
          }
        },
        *nominal);
    if (std::holds_alternative<SerialArm>(*nominal)) return;  // the parameters of arms are keys of their files
    for (const Parameter& p : parameters_of(*nominal)) parameters_.insert(without_indices(key_of(p)));
  }
  [[nodiscard]] bool is_setting(const std::string& key) const { return settings_.contains(key); }
  [[nodiscard]] bool is_parameter(const std::string& key) const {
    return !is_setting(key) && parameters_.contains(without_indices(key));
  }

 private:
  std::set<std::string> settings_, parameters_;
};

/// A number of a list, "joint.pyramid[1]_deg", as the path of a file has it: "joint.pyramid_deg[1]".
std::string as_path(const std::string& key) {
  const std::size_t open = key.rfind('['), close = key.rfind(']');
  if (open == std::string::npos || close == std::string::npos || key.compare(close, 2, "]_") != 0) return key;
  return key.substr(0, open) + key.substr(close + 1) + key.substr(open, close + 1 - open);
}

Result<AnyMachine> with_single(const AnyMachine& machine, const std::vector<Override>& overrides) {
  const std::vector<Parameter> known = parameters_of(machine);
  std::vector<double> p;
  for (const Parameter& parameter : known) p.push_back(parameter.value);
  for (const Override& override_ : overrides) {
    POLYPOD_ASSIGN(value, number_of(override_));
    const auto found =
        std::find_if(known.begin(), known.end(), [&](const Parameter& k) { return key_of(k) == override_.key; });
    if (found == known.end()) return unknown(override_.key);
    p[static_cast<std::size_t>(found - known.begin())] = units::from_user(value, found->unit);
  }
  return with_parameters(machine, p);
}

}  // namespace

Result<config::Table> whole_table(const std::string& path) {
  POLYPOD_ASSIGN(text, files::read(path));
  return table_from(text, path);
}

Result<AnyMachine> machine_from(const config::Table& table) {
  POLYPOD_ASSIGN(family, table.text("family"));
  POLYPOD_TRY(table.optional_table("dynamics"));  // masses: motion/dynamics.hpp reads them
  return read_as(Families{}, family, table);
}

std::string key_of(const Parameter& parameter) {
  return parameter.unit.empty() ? parameter.key : parameter.key + "_" + parameter.unit;
}

Result<AnyMachine> from_text(std::string_view toml, const std::string& file_name,
                             const std::vector<Override>& overrides) {
  POLYPOD_ASSIGN(table, table_from(toml, file_name));
  if (overrides.empty()) return machine_from(table);
  POLYPOD_ASSIGN(untouched, table_from(toml, file_name));
  const Figures figures(machine_from(untouched));
  std::vector<Override> single;
  for (const Override& override_ : overrides) {
    POLYPOD_ASSIGN(value, number_of(override_));
    if (override_.key.starts_with("dynamics") || override_.key.find(".dynamics") != std::string::npos) {
      return fail("MA102",
                  fmt::format("{} is no figure of the machine: masses are read as the file has them", override_.key),
                  {}, "change the table `dynamics` of the file, or give another one by --dynamics");
    }
    if (figures.is_parameter(override_.key)) {
      single.push_back(override_);
    } else if (const bool known = figures.is_setting(override_.key);
               !table.replace(known ? as_path(override_.key) : override_.key, value, known)) {
      return unknown(override_.key);
    }
  }
  POLYPOD_ASSIGN(machine, machine_from(table));
  if (single.empty()) return machine;
  return with_single(machine, single);
}

Result<AnyMachine> with_value(const AnyMachine& machine, const std::string& key, double value) {
  return from_text(to_toml(machine), name_of(machine), {{key, fmt::format("{}", value)}});
}

Result<AnyMachine> load(const std::string& name_or_path, const std::vector<Override>& overrides) {
  std::error_code ec;
  const std::string file = file_of_machine(name_or_path);
  if (!files::is_standard_input(file) && !std::filesystem::exists(file, ec)) {
    std::string names;
    std::vector<std::string> words;
    for (const CatalogueEntry& entry : catalogue()) {
      words.emplace_back(entry.name);
      if (entry.name == name_or_path) return from_text(entry.toml, name_or_path + ".toml", overrides);
      names += (names.empty() ? "" : ", ") + std::string(entry.name);
    }
    return fail("MA100", fmt::format("no machine file or catalogue machine \"{}\"", name_or_path), {},
                did_you_mean(name_or_path, words) + "the catalogue has " + names);
  }
  POLYPOD_ASSIGN(text, files::read(file));
  return from_text(text, name_or_path, overrides);
}

std::vector<Parameter> settings(const AnyMachine& machine) {
  return std::visit(
      [](const auto& m) {
        if constexpr (requires { settings(m); }) return settings(m);
        return std::vector<Parameter>{};
      },
      machine);
}

Result<AnyMachine> with_parameters(const AnyMachine& machine, std::span<const double> p) {
  return std::visit(
      [&]<class M>(const M& m) -> Result<AnyMachine> {
        if constexpr (requires { with_parameters(m, p); }) {
          if (const std::size_t wanted = parameters(m).size(); p.size() != wanted) {
            return fail("MA105", fmt::format("{} values for {} parameters", p.size(), wanted));
          }
          POLYPOD_ASSIGN(changed, with_parameters(m, p));
          return AnyMachine(std::move(changed));
        } else {
          return fail("MA104", fmt::format("the parameters of a {} cannot be changed one by one", M::kFamily));
        }
      },
      machine);
}

void note(AnyMachine& machine, const std::string& key, const std::string& text) {
  std::visit([&](auto& m) { m.provenance[key] = text; }, machine);
}

std::string to_toml(const AnyMachine& machine) {
  return std::visit([](const auto& m) { return to_toml(m); }, machine);
}
std::string name_of(const AnyMachine& machine) {
  return std::visit([](const auto& m) { return m.name; }, machine);
}
std::string family_of(const AnyMachine& machine) {
  return std::visit(
      [](const auto& m) {
        if constexpr (requires { family_of(m); }) return family_of(m);
        return std::string(m.kFamily);
      },
      machine);
}
const Provenance& provenance_of(const AnyMachine& machine) {
  return std::visit([](const auto& m) -> const Provenance& { return m.provenance; }, machine);
}
std::string description_of(const AnyMachine& machine) {
  return std::visit([](const auto& m) { return m.description; }, machine);
}

}  // namespace polypod::machine
