// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Families of the library's users: their readers by name, and what Own's files hold beside them.
#include <fmt/format.h>

#include <map>
#include <stdexcept>

#include "../../machine/machine_file.hpp"
#include "polypod/families/own/questions.hpp"
#include "polypod/machine/any_machine.hpp"

namespace polypod::machine {
namespace {

constexpr const char* kCompliance = "compliance_rad_per_Nm";

std::map<std::string, own_detail::Reader>& readers() {
  static std::map<std::string, own_detail::Reader> known;
  return known;
}

template <class... F>
bool is_taken(FamilyList<F...>, const std::string& family) {
  return ((family == F::kFamily) || ...);
}

}  // namespace

namespace own_detail {

void add_reader(std::string family, Reader reader) {
  if (is_taken(Families{}, family)) throw std::invalid_argument(family + " is a family of Polypod");
  readers()[std::move(family)] = std::move(reader);
}

}  // namespace own_detail

bool Own::reads(const std::string& family) {
  return readers().contains(family);
}
std::vector<std::string> Own::families() {
  std::vector<std::string> out;
  for (const auto& [name, reader] : readers()) out.push_back(name);
  return out;
}

Result<Own> Own::from(const config::Table& table) {
  std::string name, description;
  Provenance provenance;
  POLYPOD_TRY(read_common(table, name, description, provenance));
  std::vector<double> compliance;
  if (table.has(kCompliance)) {
    POLYPOD_ASSIGN(values, table.numbers(kCompliance, 0, config::kNotNegative));
    compliance = values;
  }
  POLYPOD_ASSIGN(family, table.text("family"));
  POLYPOD_ASSIGN(out, readers().at(family)(table));
  out.name = std::move(name);
  out.description = std::move(description);
  out.provenance = std::move(provenance);
  if (!compliance.empty() && compliance.size() != out.compliance.size()) {
    return fail("MA170",
                fmt::format("{} has {} values, but the machine has {} joints", kCompliance, compliance.size(),
                            out.compliance.size()),
                table.place_of(kCompliance), "write one number a joint: rad/Nm, of prismatic ones m/N");
  }
  if (!compliance.empty()) out.compliance = compliance;
  return out;
}

std::vector<Parameter> parameters(const Own& m) {
  return m.questions->figures();
}
std::vector<Parameter> settings(const Own& m) {
  return m.questions->designed();
}
std::string family_of(const Own& m) {
  return m.family;
}

std::string to_toml(const Own& m) {
  std::string compliance;
  bool gives_way = false;
  for (const double c : m.compliance) {
    compliance += (compliance.empty() ? "" : ", ") + number_toml(c);
    gives_way = gives_way || c != 0;
  }
  // The family's own text stands last but one: it may end in tables.
  std::string out = common_toml(m.name, m.family, m.description);
  if (gives_way) out += fmt::format("{} = [{}]\n", kCompliance, compliance);
  return out + m.questions->written() + provenance_toml(m.provenance);
}

Result<Own> with_parameters(const Own& m, std::span<const double> p) {
  POLYPOD_ASSIGN(changed, m.questions->with(p));
  if (changed == nullptr) {
    return fail("MA104", fmt::format("the parameters of a {} cannot be changed one by one", m.family), {},
                "give the family a function with_parameters(m, p)");
  }
  Own out = m;
  out.questions = changed;
  return out;
}

}  // namespace polypod::machine
