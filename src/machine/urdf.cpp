// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/machine/urdf.hpp"

#include <filesystem>

#include "urdf_chain.hpp"

namespace polypod::machine {
namespace {

constexpr const char* kMark = ".urdf#";

using xml::shown;

}  // namespace

UrdfName urdf_name(const std::string& name) {
  const std::size_t mark = name.find(kMark);
  if (mark == std::string::npos) return {name, "", ""};
  const std::size_t hash = mark + std::string_view(kMark).size() - 1;
  UrdfName out{name.substr(0, hash), "", name.substr(hash + 1)};
  if (const std::size_t colon = out.tip.find(':'); colon != std::string::npos) {
    out.base = out.tip.substr(0, colon);
    out.tip = out.tip.substr(colon + 1);
  }
  return out;
}

std::string file_of_machine(const std::string& name) {
  std::error_code ec;
  return std::filesystem::exists(name, ec) ? name : urdf_name(name).file;
}

bool is_urdf(std::string_view text, const std::string& name) {
  const std::string file = urdf_name(name).file;
  if (file.ends_with(".urdf") || file.ends_with(".xacro") || file.ends_with(".xml")) return true;
  if (text.starts_with("\xEF\xBB\xBF")) text.remove_prefix(3);
  const std::size_t begin = text.find_first_not_of(" \t\r\n");
  return begin != std::string_view::npos && text[begin] == '<';
}

Result<SerialArm> arm_from_urdf(std::string_view text, const std::string& name) {
  const UrdfName parts = urdf_name(name);
  POLYPOD_ASSIGN(opened, urdf::open(text, parts));
  const urdf::Tree& tree = *opened->tree;
  urdf::ChainReader reader(tree, opened->base, opened->tip);
  POLYPOD_ASSIGN(arm, reader.read());
  const std::string file = files::is_standard_input(parts.file)
                               ? "standard input"
                               : shown(std::filesystem::path(parts.file).filename().string());
  const std::string base = opened->link_name(opened->base), tip = opened->link_name(opened->tip);
  arm.name = tree.name();
  arm.description = fmt::format("URDF, {} to {}", base, tip);
  arm.task = arm.usual_task();
  arm.provenance["dh"] = fmt::format("{} (URDF, m and rad), from the axes of the chain {} to {}", file, base, tip);
  arm.provenance["joints"] = fmt::format("{}", fmt::join(reader.names(), ", "));
  arm.provenance["tool"] = fmt::format("link {}, turned by 180 deg about its x axis: z_T points to the flange", tip);
  arm.provenance[kFlange] =
      reader.flange().empty()
          ? fmt::format("{}: no link tool0 on the last axis; the last frame lies at the foot of the tip on it",
                        kNotKnown)
          : fmt::format("link {}, the last frame of the table", reader.flange());
  if (reader.has_speeds()) arm.provenance["speeds"] = "the same file";
  if (!reader.rounded().empty())
    arm.provenance["angles"] = "read as multiples of 15 deg: " + urdf::list_of(reader.rounded());
  const int bodies = tree.count("visual") + tree.count("collision");
  if (bodies > 0)
    arm.provenance["bodies"] = fmt::format(
        "{} visual and collision bodies of the links are no part of the machine: `polypod info --bodies` writes them "
        "as "
        "a file for `check`",
        bodies);
  return arm;
}

}  // namespace polypod::machine
